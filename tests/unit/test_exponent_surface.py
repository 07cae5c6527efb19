"""Exponents read from panels are those integrated, and what panels do not cover is integrated."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from maglev_ctrl.analysis.exponent_surface import ExponentSurface, SpeedSurface
from maglev_ctrl.analysis.tongue_search import leading_exponents, polished
from maglev_ctrl.errors import ModelError
from maglev_ctrl.kernels.plane_series import PlaneSeries
from maglev_ctrl.systems import PeriodicSystem, SecondOrderSystem, at_depth, modulate

K_1 = np.array([[0.5, 0.4], [0.3, 0.6]])


def two_modes(speed: float) -> PeriodicSystem:
    """Frequencies 1 and 1.7, damping that falls with speed, W = 2 v."""
    damping = np.diag([0.004, 0.012]) / (1.0 + speed**2)
    return modulate(
        SecondOrderSystem.from_matrices(np.eye(2), damping, np.diag([1.0, 2.89]), dofs=("a", "b")), [K_1],
        frequency=2.0 * speed,
    )  # fmt: skip


def apart(surface: SpeedSurface) -> float:
    """Largest difference of the growth from integration over random speeds and depths, 1/s."""
    rng = np.random.default_rng(3)
    speeds, depths = rng.uniform(0.3, 1.9, 40), rng.uniform(0.0, 0.5, 40)
    found = surface.exponents(speeds, depths)
    assert found is not None
    exact = [np.max(leading_exponents(at_depth(two_modes(v), d)).real) for v, d in zip(speeds, depths, strict=True)]
    assert found[1] == pytest.approx(2.0 * speeds, rel=1e-12)
    return float(np.max(np.abs(np.max(found[0].real, axis=1) - exact)))


def test_panels_tell_the_integrated_exponents_and_a_mutant_is_caught() -> None:
    surface = SpeedSurface.of(two_modes, lower=0.3, upper=1.9, largest_depth=0.5)
    assert surface.surface.panels and apart(surface) < 1e-9
    broken = tuple(
        dataclasses.replace(one, series=PlaneSeries(np.flip(one.series.coefficients, 1), one.series.x, one.series.y,
                                                    one.series.error))
        for one in surface.surface.panels if one.series is not None
    )  # fmt: skip
    assert apart(dataclasses.replace(surface, surface=dataclasses.replace(surface.surface, panels=broken))) > 1e-3


def test_where_there_is_no_panel_exponents_are_integrated() -> None:
    surface = SpeedSurface.of(two_modes, lower=0.3, upper=1.9, largest_depth=0.5)
    bare = dataclasses.replace(surface, surface=dataclasses.replace(surface.surface, panels=()))
    assert apart(bare) < 1e-9
    beyond = surface.exponents(np.array([1.0, 1.0]), np.array([0.4, 0.6]))  # one on a panel, one beyond
    assert beyond is not None
    exact = np.max(leading_exponents(at_depth(two_modes(1.0), 0.6)).real)
    assert np.max(beyond[0][1].real) == pytest.approx(exact, abs=1e-12)


def test_no_answer_is_none_and_its_surroundings_are_answered() -> None:
    def path(v: float) -> PeriodicSystem:
        if v > 1.2:
            raise ModelError("no equilibrium")
        return two_modes(v)

    surface = SpeedSurface.of(path, lower=0.3, upper=1.9, largest_depth=0.5)
    read = surface.at(0.2)
    assert read(1.5) is None and surface.exponents(np.array([1.0, 1.5]), np.array([0.1, 0.1])) is None
    for speed in (0.4, 1.1999, 1.2):
        found, exact = read(speed), leading_exponents(at_depth(two_modes(speed), 0.2))
        assert found is not None and np.max(found.real) == pytest.approx(np.max(exact.real), abs=1e-9)


@pytest.mark.parametrize("change", [{"lower": 0.0}, {"upper": 0.2}, {"largest_depth": 0.0}])
def test_limits_are_checked(change: dict[str, float]) -> None:
    with pytest.raises(ValueError, match="expected 0 < lower < upper"):
        SpeedSurface.of(two_modes, **{"lower": 0.3, "upper": 1.9, "largest_depth": 0.5, **change})


def test_a_family_that_is_not_linear_in_its_second_quantity() -> None:
    def family(W: float, stiffness: float) -> PeriodicSystem:
        return PeriodicSystem.from_matrices([[0, 1], [-stiffness, -0.01]], [[[0, 0], [-0.3, 0]]], frequency=W)

    surface = ExponentSurface.of(family, (1.5, 2.5), (0.8, 1.3), linear=False)
    found = surface.exponents(np.array([1.9]), np.array([1.03]))
    assert surface.panels and found is not None
    assert np.max(found[0].real) == pytest.approx(np.max(leading_exponents(family(1.9, 1.03)).real), abs=1e-10)


def test_a_step_beyond_its_range_is_not_taken() -> None:
    assert polished(lambda x: x - 3.0, lambda x: x - 1.0, 1.0, 1e-3) == 1.0
    assert polished(lambda x: 2.0 * x - 2.0005, lambda x: 2.0 * x - 2.0, 1.0, 1e-3) == pytest.approx(1.00025)
