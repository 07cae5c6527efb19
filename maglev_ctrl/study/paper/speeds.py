"""What changes with speed: lift and drag, the drag peak, and damping from the response to an oscillating magnet."""

from __future__ import annotations

from math import pi
from typing import Final

import numpy as np
from scipy.optimize import brentq

from maglev_ctrl.arrays import read_only_any
from maglev_ctrl.study.paper.records import SolvedCase, SpeedStudy

HEIGHT: Final = 12.7e-3
GAP: Final = 12.7e-3
FREQUENCY: Final = 2.0 * pi * 5.0  # rad/s, near the frequencies of heave, roll and sway
RANGE: Final = (5.0, 100.0)
SLOW: Final = (10.0, 20.0)  # m/s, of the lower velocities
SLOW_SCAN: Final = 15  # points: each costs tens of milliseconds where no map is at hand
UNSTEADY_SPEEDS: Final = (5.0, 10.0, 15.0, 20.0, 25.0, 36.1, 50.0, 75.0, 100.0)
SURGE, SWAY, HEAVE = 0, 1, 2


def speed_study(solved: SolvedCase) -> SpeedStudy | None:
    """Lift, drag and damping at h = Y* = 12.7 mm; None where the force model knows only one speed."""
    model = solved.any_speed
    if model is None:
        return None
    speeds = np.linspace(*RANGE, 39)
    forces = model.forces(np.full_like(speeds, HEIGHT), np.full_like(speeds, GAP), speeds)
    known = np.array(UNSTEADY_SPEEDS if solved.unsteady is not None else ())
    damping = np.zeros((known.size, 3))
    for i, speed in enumerate(known):
        assert solved.unsteady is not None
        Q = solved.unsteady.motion_stiffness(HEIGHT, GAP, float(speed), np.array([FREQUENCY]))[0]
        damping[i] = [Q[j, j].imag / FREQUENCY for j in (SURGE, SWAY, HEAVE)]

    def slope(speed: float) -> float:
        return float(model.derivatives(HEIGHT, GAP, speed).by_speed.drag)

    top = int(np.argmax(forces.drag))
    peak = float("nan")
    if 0 < top < speeds.size - 1:
        peak = float(brentq(slope, speeds[top - 1], speeds[top + 1], xtol=1e-6))
    return SpeedStudy(
        HEIGHT, GAP, read_only_any(speeds), read_only_any(forces.lift), read_only_any(forces.drag),
        peak, FREQUENCY, read_only_any(known), read_only_any(damping),
    )  # fmt: skip
