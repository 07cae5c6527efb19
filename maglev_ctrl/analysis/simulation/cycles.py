"""Limit cycles: whether the late motion of a run is periodic, and its period and amplitude."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from maglev_ctrl.analysis.simulation.records import Trajectory
from maglev_ctrl.arrays import FloatArray

FEWEST_CYCLES = 5


@dataclass(frozen=True, eq=False, slots=True)
class LimitCycle:
    """The late motion of one signal in one run.

    `periodic`: cycles are alike within the tolerance; `period` s, `frequency` rad/s, `amplitude` half of the swing,
    `mean` of the extremes; `period_scatter`, `drift` (of the amplitude over the window), relative. NaN where there is
    no oscillation; `reason` why it does not count as periodic.
    """

    periodic: bool
    period: float
    frequency: float
    amplitude: float
    mean: float
    period_scatter: float
    drift: float
    reason: str


def limit_cycle(
    trajectory: Trajectory, signal: str, *, run: int = 0, share: float = 0.5, tolerance: float = 0.01
) -> LimitCycle:
    """Whether the late motion of a signal is a limit cycle.

    Parameters
    ----------
    share : of the run, at its end, that is looked at
    tolerance : largest scatter of the periods and drift of the amplitude, relative, for cycles to be alike

    Raises
    ------
    ValueError : no such signal or run, a share out of range
    """
    values = trajectory.of(signal)
    if not 0 <= run < len(values):
        raise ValueError(f"run: expected 0 to {len(values) - 1}, got {run}")
    if not 0.0 < share <= 1.0:
        raise ValueError(f"share: expected a share of one, got {share}")
    event = trajectory.event_of(run)
    if event is not None:
        return _none(f"the run ended at {event.time:.4g} s: {event.reason}")
    late = values[run, int((1.0 - share) * values.shape[1]) :]
    middle = 0.5 * float(np.max(late) + np.min(late))
    swing = late - middle
    rising = np.flatnonzero((swing[:-1] < 0.0) & (swing[1:] >= 0.0))
    if len(rising) <= FEWEST_CYCLES:
        return _none(f"{max(len(rising) - 1, 0)} whole cycles in the window; at least {FEWEST_CYCLES} are needed")
    times = trajectory.interval * (rising + swing[rising] / (swing[rising] - swing[rising + 1]))
    tops, bottoms = (np.array([_peak(sign * late[a : b + 2]) for a, b in pairwise(rising)]) for sign in (1.0, -1.0))
    periods, amplitudes = np.diff(times), 0.5 * (tops + bottoms)
    period, amplitude = float(np.mean(periods)), float(np.mean(amplitudes))
    scatter = float(np.std(periods)) / period
    slope = np.polyfit(np.arange(len(amplitudes)), amplitudes, 1)[0]
    uneven = float(np.max(np.abs(amplitudes - amplitude))) / amplitude
    drift = max(abs(float(slope)) * len(amplitudes) / amplitude, uneven)
    faults = []
    if scatter > tolerance:
        faults.append(f"periods scatter by {100.0 * scatter:.3g} %")
    if drift > tolerance:
        faults.append(f"the amplitude changes by {100.0 * drift:.3g} %")
    return LimitCycle(
        periodic=not faults,
        period=period,
        frequency=2.0 * np.pi / period,
        amplitude=amplitude,
        mean=0.5 * float(np.mean(tops) - np.mean(bottoms)),
        period_scatter=scatter,
        drift=drift,
        reason="; ".join(faults),
    )


def _peak(values: FloatArray) -> float:
    """The largest value, by a parabola through it and its neighbours."""
    top = int(np.argmax(values))
    if top in (0, len(values) - 1):
        return float(values[top])
    before, at, after = values[top - 1 : top + 2].tolist()
    bend = before - 2.0 * at + after
    return float(at if bend == 0.0 else at - (after - before) ** 2 / (8.0 * bend))


def _none(reason: str) -> LimitCycle:
    return LimitCycle(False, np.nan, np.nan, np.nan, np.nan, np.nan, np.nan, reason)
