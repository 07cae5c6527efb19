from __future__ import annotations

import numpy as np
import pytest

from maglev_ctrl.errors import OutOfDomain
from maglev_ctrl.forces import CoefficientTable, ImageForce

ZERO = np.zeros((6, 6))
HEAVE = 2


def table(count: int = 4, *, constant: bool = False) -> CoefficientTable:
    rng = np.random.default_rng(count)
    return CoefficientTable(
        np.linspace(10.0, 40.0, count),
        rng.standard_normal((count, 6, 6)),
        rng.standard_normal((count, 6, 6)),
        rng.standard_normal((count, 6, 6)),
        constant=constant,
    )


def test_force_derivatives_change_sign_to_the_left_hand_side() -> None:
    """A lift that falls with height restores: dL/dh < 0 on the vehicle is K > 0 (the audit of Eq. 11)."""
    magnet = ImageForce(1e5, 1.0, 2.5e7, 0.02, 1.0, "receding_image")
    partials = magnet.derivatives(0.1, None, 1.0)
    k, c, m = ZERO.copy(), ZERO.copy(), ZERO.copy()
    k[HEAVE, HEAVE] = partials.by_height.lift
    c[HEAVE, HEAVE] = partials.by_vertical_velocity.lift
    m[HEAVE, HEAVE] = -0.2
    found = CoefficientTable.from_force_derivatives(1.0, m=m, c=c, k=k).at(1.0)
    assert found.stiffness[HEAVE, HEAVE] == -k[HEAVE, HEAVE] > 0.0
    assert found.damping[HEAVE, HEAVE] == -c[HEAVE, HEAVE] > 0.0
    assert found.mass[HEAVE, HEAVE] == 0.2
    # the printed plus sign, as a mutant, makes the levitated mass diverge
    vehicle = 100.0
    assert (-found.stiffness[HEAVE, HEAVE] / vehicle) < 0 < k[HEAVE, HEAVE] / -vehicle


@pytest.mark.parametrize("count", [2, 3, 6])
def test_the_table_is_kept_at_its_speeds_and_stays_between_neighbours(count: int) -> None:
    one = table(count)
    np.testing.assert_allclose(one.at(one.speeds).damping, one.damping, atol=1e-14)
    middle = (one.speeds[1:] + one.speeds[:-1]) / 2
    between = one.at(middle).stiffness
    low, high = np.minimum(one.stiffness[1:], one.stiffness[:-1]), np.maximum(one.stiffness[1:], one.stiffness[:-1])
    assert np.all((between >= low - 1e-12) & (between <= high + 1e-12))


def test_batches_of_speeds_come_first() -> None:
    one = table()
    assert one.at(np.full((2, 3), 20.0)).mass.shape == (2, 3, 6, 6)
    assert one.at(20.0).mass.shape == (6, 6)
    with pytest.raises(ValueError, match="read-only"):
        one.at(20.0).mass[0, 0] = 1.0


@pytest.mark.parametrize("speed", [9.9, 40.1, np.nan, [20.0, 50.0]])
def test_nothing_is_extrapolated(speed: float) -> None:
    with pytest.raises(OutOfDomain, match=r"outside the table's range 10 to 40 m/s"):
        table().at(speed)


def test_one_speed_is_only_that_speed_unless_constant() -> None:
    single = CoefficientTable(30.0, ZERO, ZERO, np.eye(6))
    assert single.at(30.0 * (1 + 1e-12)).stiffness[0, 0] == 1.0
    with pytest.raises(OutOfDomain, match="range 30 to 30"):
        single.at(31.0)
    everywhere = CoefficientTable(30.0, ZERO, ZERO, np.eye(6), constant=True)
    assert everywhere.at([0.0, 500.0]).stiffness.shape == (2, 6, 6)
    assert everywhere.speed_range == (-np.inf, np.inf)


def test_wrong_use_is_refused() -> None:
    with pytest.raises(ValueError, match=r"damping: expected shape \(1, 6, 6\), got \(3, 3\)"):
        CoefficientTable(30.0, ZERO, np.eye(3), ZERO)
    with pytest.raises(ValueError, match="speeds: expected a strictly increasing"):
        CoefficientTable([30.0, 30.0], np.zeros((2, 6, 6)), np.zeros((2, 6, 6)), np.zeros((2, 6, 6)))
    with pytest.raises(ValueError, match="speeds: expected a strictly increasing"):
        CoefficientTable([], np.zeros((0, 6, 6)), np.zeros((0, 6, 6)), np.zeros((0, 6, 6)))
    with pytest.raises(ValueError, match="constant: expected a table of one speed, got 4"):
        table(constant=True)
    with pytest.raises(ValueError, match="stiffness: every entry must be finite"):
        CoefficientTable(30.0, ZERO, ZERO, np.full((6, 6), np.nan))
    with pytest.raises(OutOfDomain, match="speed nan"):
        CoefficientTable(30.0, ZERO, ZERO, ZERO, constant=True).at(np.nan)
