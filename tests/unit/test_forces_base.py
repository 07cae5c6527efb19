from __future__ import annotations

import numpy as np
import pytest

from maglev_ctrl.errors import OutOfDomain
from maglev_ctrl.forces import AbstractForceModel, Domain, MagnetDerivatives, MagnetForces
from maglev_ctrl.forces.base import checked_factor, no_forces

BOX = Domain(height=(0.005, 0.05), gap=(0.002, 0.02), speed=(10.0, 100.0))


@pytest.mark.parametrize(
    ("point", "message"),
    [
        ((0.004, 0.01, 50.0), r"height 0\.004 m is outside the model's range 0\.005 to 0\.05 m"),
        ((0.01, 0.03, 50.0), r"gap 0\.03 m is outside the model's range 0\.002 to 0\.02 m"),
        ((0.01, 0.01, 9.0), r"speed 9 m/s is outside the model's range 10 to 100 m/s"),
        ((0.01, 0.01, np.nan), "speed nan"),
        (([0.01, 0.06], 0.01, 50.0), r"height 0\.06"),
    ],
)
def test_a_point_outside_names_the_quantity_the_value_and_the_range(point: tuple[float, ...], message: str) -> None:
    with pytest.raises(OutOfDomain, match=message):
        BOX.require(*point)


def test_the_ends_belong_to_the_domain_with_the_rounding_of_a_unit_conversion() -> None:
    BOX.require([0.005, 0.05 * (1 + 1e-15)], [0.002, 0.02], [10.0, 100.0 * (1 + 1e-12)])
    with pytest.raises(OutOfDomain):
        BOX.require(0.01, 0.01, 100.0 * (1 + 1e-7))


def test_a_model_with_a_gap_needs_a_gap() -> None:
    with pytest.raises(ValueError, match="gap: this force model depends on the guidance gap"):
        BOX.require(0.01, None, 50.0)


def test_contact_is_outside_every_domain() -> None:
    with pytest.raises(OutOfDomain, match="zero is contact"):
        Domain(height=(0.0, np.inf), gap=None, speed=(-np.inf, np.inf)).require(0.0, None, 1.0)


@pytest.mark.parametrize("height", [(0.05, 0.005), (-0.1, 0.1), (np.nan, 1.0)])
def test_a_wrong_range_is_refused(height: tuple[float, float]) -> None:
    with pytest.raises(ValueError, match="height: expected a range"):
        Domain(height=height, gap=None, speed=(0.0, 1.0))


def test_forces_are_read_only_of_one_shape_and_scale() -> None:
    forces = MagnetForces(lift=np.array([1.0, 2.0]), guidance=np.zeros(()), drag=np.array(0.5))
    assert forces.guidance.shape == forces.drag.shape == (2,)
    with pytest.raises(ValueError, match="read-only"):
        forces.lift[0] = 3.0
    assert forces.scaled([2.0, 3.0]).lift.tolist() == [2.0, 6.0]
    part = MagnetDerivatives(forces, forces, forces, forces, no_forces((2,)))
    assert part.scaled(2.0).by_vertical_velocity.drag.tolist() == [1.0, 1.0]
    assert part.scaled(2.0).by_lateral_velocity.drag.tolist() == [0.0, 0.0]


@pytest.mark.parametrize("factor", [-1.0, np.nan, np.inf, [1.0, -0.5]])
def test_a_negative_or_endless_factor_is_refused(factor: float) -> None:
    with pytest.raises(ValueError, match="factor"):
        checked_factor(factor)


def test_the_interface_is_abstract() -> None:
    with pytest.raises(TypeError, match="abstract"):
        AbstractForceModel()  # type: ignore[abstract]
