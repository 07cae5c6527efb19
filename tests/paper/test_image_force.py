"""The image force against check values of Eqs. 15, 22 and 25 (closed forms evaluated to 40 digits)."""

from __future__ import annotations

from math import pi, sqrt

import numpy as np
import pytest
from scipy.optimize import brentq

from maglev_ctrl.forces import (
    ImageForce,
    characteristic_speed,
    drag_ratio,
    drag_ratio_slope,
    lift_ratio,
)

GRAVITY = 9.80665
MASS, HEIGHT, CONDUCTIVITY, THICKNESS = 20000.0, 0.1, 2.5e7, 0.02
AERODYNAMIC = 0.5 * 1.2 * 0.3 * 10.0  # K_a = rho C_D A / 2, kg/m

# exponent, v/w, eps_L
LIFT_RATIOS = [
    (1.0, 0.1, 0.009900990099009901),
    (1.0, 0.5, 0.2),
    (1.0, 1.0, 0.5),
    (1.0, 2.0, 0.8),
    (1.0, 5.0, 0.9615384615384616),
    (1.0, 10.0, 0.9900990099009901),
    (1.0, 50.0, 0.9996001599360256),
    (1 / 3, 0.1, 0.0033112825226609553),
    (1 / 3, 0.5, 0.07168223327744422),
    (1 / 3, 1.0, 0.20629947401590026),
    (1 / 3, 2.0, 0.4151964523574268),
    (1 / 3, 5.0, 0.6624468094104181),
    (1 / 3, 10.0, 0.7852699251903433),
    (1 / 3, 50.0, 0.9263291914922477),
    (1 / 5, 0.1, 0.0019880873018627986),
    (1 / 5, 0.5, 0.04364750020996301),
    (1 / 5, 1.0, 0.12944943670387585),
    (1 / 5, 2.0, 0.27522033632230447),
    (1 / 5, 5.0, 0.4787988918613511),
    (1 / 5, 10.0, 0.6026843012570607),
    (1 / 5, 50.0, 0.7908888157005084),
]

# exponent, v/w of the drag maximum, eps_D there (five digits)
DRAG_PEAKS = [
    (1.0, 1.0, 0.5),
    (1 / 2, 1.272019649514069, 0.30028),
    (1 / 3, 1.4231721634195025, 0.21683),
    (1 / 5, 1.5887129091945655, 0.14017),
]

# height m, heave frequency Hz
HEAVE_FREQUENCIES = [
    (0.005, 7.0484799267861),
    (0.015, 4.069441783107629),
    (0.05, 2.228925061062094),
    (0.15, 1.286870484007703),
    (0.3, 0.9099548457506613),
]

# exponent, C_zx and K_xz at 100 m/s, C_xx (with 2 K_a v) at v = 2 w
SURGE_COEFFICIENTS = [
    (1.0, 3.9704626225392934, 62431.07290688541, -9219.63156709267),
    (1 / 3, 145.78936486274, 62431.07290688541, -3809.672008582921),
    (1 / 5, 263.7570120383541, 62431.07290688541, -2400.0965824427644),
]


def vehicle(exponent: float, speed: float) -> ImageForce:
    return ImageForce.for_lift(
        MASS * GRAVITY, HEIGHT, speed, length=10.0, conductivity=CONDUCTIVITY, thickness=THICKNESS, exponent=exponent
    )


@pytest.mark.parametrize(("n", "x", "expected"), LIFT_RATIOS)
def test_fig5_lift_ratio(n: float, x: float, expected: float) -> None:
    assert float(lift_ratio(x, n)) == pytest.approx(expected, rel=1e-10)
    assert float(drag_ratio(x, n)) == pytest.approx(expected / x, rel=1e-10)  # eps_D = (w/v) eps_L


def test_fig5_mutant_is_caught() -> None:
    """(1 + x)^-n in place of (1 + x^2)^-n fits no value but x = 1."""
    missed = [x for n, x, expected in LIFT_RATIOS if abs(1 - (1 + x) ** -n - expected) > 1e-3 * expected]
    assert missed == [x for _, x, _ in LIFT_RATIOS if x != 1.0]


@pytest.mark.parametrize(("n", "expected", "peak"), DRAG_PEAKS)
def test_drag_peak(n: float, expected: float, peak: float) -> None:
    found = brentq(lambda x: float(drag_ratio_slope(x, n)), 0.5, 3.0, xtol=1e-14)
    assert found == pytest.approx(expected, rel=1e-9)
    assert float(drag_ratio(found, n)) == pytest.approx(peak, abs=5e-6)
    around = drag_ratio(found * np.array([0.99, 1.0, 1.01]), n)
    assert around[1] > max(around[0], around[2])


def test_drag_peak_at_half_is_the_root_of_the_golden_ratio() -> None:
    assert abs(float(drag_ratio_slope(sqrt((1 + sqrt(5)) / 2), 0.5))) < 1e-15


def test_drag_peak_mutant_is_caught() -> None:
    """The printed slope puts the peak at (2n-1)^-1/2, which for n < 1 is elsewhere or nowhere."""
    for n, expected, _ in DRAG_PEAKS:
        printed = (2 * n - 1) ** -0.5 if n > 0.5 else np.inf
        assert (abs(printed - expected) < 1e-9) is (n == 1.0)


@pytest.mark.parametrize(("n", "expected", "tolerance"), [(1 / 3, -0.24880084201472494, 1e-10), (1.0, -0.6, 1e-12)])
def test_surge_damping_bracket(n: float, expected: float, tolerance: float) -> None:
    """C_xx v^2 / (w m g) at v = 2 w with the lift pinned to the weight; the printed form gives +0.4667 at n = 1/3."""
    w = characteristic_speed(CONDUCTIVITY, THICKNESS)
    slope = float(vehicle(n, 2 * w).derivatives(HEIGHT, None, 2 * w).by_speed.drag)
    assert slope * (2 * w) ** 2 / (w * MASS * GRAVITY) == pytest.approx(expected, rel=tolerance)


def test_surge_damping_bracket_mutant_is_caught() -> None:
    printed = (1 - (2 / 3 - 1) * 4) / 5
    assert printed == pytest.approx(0.4667, abs=1e-4)
    assert np.sign(printed) != np.sign(-0.24880084201472494)


def test_characteristic_speed() -> None:
    assert characteristic_speed(CONDUCTIVITY, THICKNESS) == pytest.approx(3.1830988618379066, rel=1e-10)
    assert characteristic_speed(CONDUCTIVITY, THICKNESS) == pytest.approx(10 / pi, rel=1e-14)


@pytest.mark.parametrize(("n", "lift_by_speed", "drag_by_height", "surge"), SURGE_COEFFICIENTS)
def test_equation_22(n: float, lift_by_speed: float, drag_by_height: float, surge: float) -> None:
    at_100 = vehicle(n, 100.0).derivatives(HEIGHT, None, 100.0)
    assert float(at_100.by_speed.lift) == pytest.approx(lift_by_speed, rel=1e-9)  # C_zx = +dF_L/dv
    assert -float(at_100.by_height.drag) == pytest.approx(drag_by_height, rel=1e-9)  # K_xz = -dF_D/dz
    slow = 2 * characteristic_speed(CONDUCTIVITY, THICKNESS)
    slope = float(vehicle(n, slow).derivatives(HEIGHT, None, slow).by_speed.drag)
    assert slope + 2 * AERODYNAMIC * slow == pytest.approx(surge, rel=1e-9)


@pytest.mark.parametrize(("height", "expected"), HEAVE_FREQUENCIES)
def test_fig6_heave_frequency(height: float, expected: float) -> None:
    """Eq. 25 follows from F ~ 1/z at any speed and exponent: f = sqrt(g / z0) / 2 pi."""
    magnet = ImageForce.for_lift(
        MASS * GRAVITY, height, 60.0, length=10.0, conductivity=CONDUCTIVITY, thickness=THICKNESS, exponent=0.2
    )
    stiffness = -float(magnet.derivatives(height, None, 60.0).by_height.lift)
    assert sqrt(stiffness / MASS) / (2 * pi) == pytest.approx(expected, rel=1e-10)
