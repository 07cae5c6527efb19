"""Speeds at which spans excite a loop most: where a harmonic of the span meets a mode, and where a peak is largest.

The k-th harmonic of spans of length L is met at the frequency k v / L, so a mode of frequency f is excited at the
critical speeds v = f L / k. The worst speed is not quite one of them: damping, phases between the elements and other
harmonics move it, and it is searched for.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import pi

import numpy as np
from scipy import linalg
from scipy.optimize import minimize_scalar

from maglev_ctrl.analysis.girder.drive import periodic_solution
from maglev_ctrl.analysis.girder.passing import PassingPeak, driven_system, passing_response
from maglev_ctrl.analysis.girder.shapes import PieceShape, shifted_breaks
from maglev_ctrl.arrays import FloatArray, read_only_any
from maglev_ctrl.errors import Agreement, NotStable
from maglev_ctrl.systems import SecondOrderSystem

Loop = SecondOrderSystem | Callable[[float], SecondOrderSystem]
"""A closed loop, or what gives it for a speed in m/s."""


@dataclass(frozen=True, eq=False, slots=True)
class CriticalSpeed:
    """A speed (m/s) at which the harmonic `order` of the span meets a mode of `frequency` (Hz)."""

    speed: float
    order: int
    frequency: float
    damping_ratio: float


@dataclass(frozen=True, eq=False, slots=True)
class WorstSpeed:
    """The speed (m/s) at which one output's peak is largest, and the peak there by two methods.

    `at_limit`: it is an end of the range, so that a larger one may lie beyond. `nearest` is the critical speed next to
    it (None where no mode oscillates within the range).
    """

    name: str
    speed: float
    peak: PassingPeak
    at_limit: bool
    nearest: CriticalSpeed | None


@dataclass(frozen=True, eq=False, slots=True)
class PassingScan:
    """Peaks over speed: `speeds` (k,) m/s, `peaks` (outputs, k), NaN where the loop is not stable (`reasons`)."""

    speeds: FloatArray
    peaks: FloatArray
    reasons: tuple[str, ...]
    critical: tuple[CriticalSpeed, ...]
    worst: tuple[WorstSpeed, ...]


def critical_speeds(
    closed: Loop, *, span: float, speeds: tuple[float, float], harmonics: int = 8, points: int = 65
) -> tuple[CriticalSpeed, ...]:
    """Speeds v = f L / k in a range, f the damped frequency of a mode (at that speed), rising.

    Parameters
    ----------
    speeds : from, to, m/s
    harmonics : largest k
    points : speeds at which a loop that depends on the speed is looked at; its modes are followed in between

    Raises
    ------
    ValueError : a range that is empty or not positive

    Examples
    --------
    >>> car = SecondOrderSystem.from_matrices([[1.0]], [[0.1]], [[(2 * pi) ** 2]])
    >>> [round(one.speed, 2) for one in critical_speeds(car, span=25.0, speeds=(8.0, 30.0), harmonics=3)]
    [8.33, 12.5, 25.0]
    """
    low, high = _range(speeds)
    found: list[CriticalSpeed] = []
    if isinstance(closed, SecondOrderSystem):
        for frequency, ratio in _oscillations(closed):
            for k in range(1, harmonics + 1):
                if low <= frequency * span / k <= high:
                    found.append(CriticalSpeed(frequency * span / k, k, frequency, ratio))
        return tuple(sorted(found, key=lambda one: one.speed))
    grid = np.linspace(low, high, points)
    before: list[tuple[float, float]] = _oscillations(closed(low))
    for a, b in pairwise(grid.tolist()):
        after = _oscillations(closed(b))
        for one in before:
            if not after:
                break
            # The mode goes on as the one whose frequency is nearest; between two speeds it moves along a line.
            other = min(after, key=lambda pair: abs(pair[0] - one[0]))
            for k in range(1, harmonics + 1):
                start, end = one[0] * span / k - a, other[0] * span / k - b
                if start * end < 0.0 or start == 0.0:
                    share = start / (start - end) if start != end else 0.0
                    frequency = one[0] + share * (other[0] - one[0])
                    found.append(CriticalSpeed(float(a + share * (b - a)), k, frequency, one[1]))
        before = after
    return tuple(sorted(found, key=lambda one: one.speed))


def worst_passing_speed(
    closed: Loop,
    shape: PieceShape,
    *,
    speeds: tuple[float, float],
    places: Mapping[str, float],
    outputs: Sequence[str],
    lateral: PieceShape | None = None,
    harmonics: int = 8,
    points: int = 40,
) -> PassingScan:
    """Peaks over a range of speeds, and the worst speed of every output.

    Evenly spaced speeds and all critical ones are looked at by exponentials; around the best the peak is climbed to
    its top, and there both methods of `passing_response` have to agree.

    Parameters
    ----------
    closed : a loop, or a function that gives it for a speed
    speeds : from, to, m/s
    places, outputs, lateral : see `passing_response`
    harmonics : of the span, for critical speeds
    points : evenly spaced speeds

    Raises
    ------
    NotStable : the loop is not stable at any of the speeds
    ValueError : see `passing_response`

    Examples
    --------
    >>> from maglev_ctrl.analysis.girder.shapes import PieceShape
    >>> car = SecondOrderSystem.from_matrices([[1e3]], [[1e3]], [[4e4]], dofs=("z",), guideway=("heave@m",),
    ...                                       K_w=[[4e4]])
    >>> wave = PieceShape.polyline([0.0, 10.0, 20.0], [0.0, 0.004, 0.0])
    >>> scan = worst_passing_speed(car, wave, speeds=(12.0, 30.0), places={"m": 0.0}, outputs=["z"], points=9)
    >>> (worst,) = scan.worst
    >>> round(worst.speed, 1), round(worst.nearest.speed, 1), worst.nearest.order
    (20.0, 20.1, 1)
    """
    low, high = _range(speeds)
    names = tuple(outputs)
    critical = critical_speeds(closed, span=shape.span, speeds=(low, high), harmonics=harmonics)
    grid = np.unique(np.concatenate([np.linspace(low, high, max(points, 2)), [one.speed for one in critical]]))

    def peaks_at(speed: float) -> tuple[FloatArray, str]:
        loop = closed if isinstance(closed, SecondOrderSystem) else closed(speed)
        try:
            system = driven_system(loop, shape, speed=speed, places=places, outputs=names, lateral=lateral)
        except NotStable as fault:
            return np.full(len(names), np.nan), str(fault)
        times = shifted_breaks(system.shapes, system.places, speed=speed)
        _, values, _ = periodic_solution(system, times).sampled(max(17, 256 // len(times)))
        felt = np.any((system.D_v != 0.0) & np.array([bool(np.any(s.jumps)) for s in system.shapes]), axis=1)
        return np.where(felt, np.inf, np.max(np.abs(values), axis=1)), ""

    looked = [peaks_at(float(speed)) for speed in grid]
    peaks = np.array([found for found, _ in looked]).T
    if np.all(np.isnan(peaks)):
        raise NotStable(f"speeds: the loop is not stable anywhere from {low:g} to {high:g} m/s: {looked[0][1]}")
    worst = []
    for i, name in enumerate(names):
        best = int(np.nanargmax(peaks[i]))
        speed = float(grid[best])
        left, right = float(grid[max(best - 1, 0)]), float(grid[min(best + 1, len(grid) - 1)])
        if np.isfinite(peaks[i, best]) and right > left:

            def lower(v: float, row: int = i) -> float:
                value = float(peaks_at(v)[0][row])
                return -value if np.isfinite(value) else 0.0

            search = minimize_scalar(lower, bounds=(left, right), method="bounded", options={"xatol": 1e-5 * high})
            if -float(search.fun) > peaks[i, best]:
                speed = float(search.x)
        loop = closed if isinstance(closed, SecondOrderSystem) else closed(speed)
        found = passing_response(loop, shape, speed=speed, places=places, outputs=[name], lateral=lateral).of(name)
        near = min(critical, key=lambda one: abs(one.speed - speed)) if critical else None
        edge = min(speed - low, high - speed) <= 1e-4 * (high - low)
        worst.append(WorstSpeed(name, speed, found, edge, near))
    return PassingScan(
        read_only_any(grid), read_only_any(peaks), tuple(reason for _, reason in looked), critical, tuple(worst)
    )


def unresolved(scan: PassingScan) -> tuple[str, ...]:
    """Outputs whose worst peak two methods do not agree on."""
    return tuple(one.name for one in scan.worst if one.peak.agreement is Agreement.UNRESOLVED)


def _oscillations(closed: SecondOrderSystem) -> list[tuple[float, float]]:
    """Frequency (Hz) and damping ratio of every mode that oscillates."""
    s = linalg.eigvals(closed.state_matrix())
    up = s[s.imag > 1e-9 * np.max(np.abs(s), initial=0.0)]
    return [(float(root.imag) / (2.0 * pi), -float(root.real) / float(abs(root))) for root in up]


def _range(speeds: tuple[float, float]) -> tuple[float, float]:
    low, high = float(speeds[0]), float(speeds[1])
    if not (np.isfinite(high) and 0.0 < low < high):
        raise ValueError(f"speeds: expected 0 < from < to in m/s, got {low} and {high}")
    return low, high
