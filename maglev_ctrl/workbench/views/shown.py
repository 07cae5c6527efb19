"""The modes the page shows: the same list, order, names and colours in every view."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.optimize import linear_sum_assignment

from maglev_ctrl.analysis.modes import Modes
from maglev_ctrl.analysis.tracking import ModeTracks
from maglev_ctrl.arrays import ComplexArray
from maglev_ctrl.report.charts_modes import MOST_MODES, slowest_tracks, worth_drawing
from maglev_ctrl.report.style import number
from maglev_ctrl.study.live.records import LiveView

_FAR = 1e6  # a cost no real distance reaches


@dataclass(frozen=True, eq=False, slots=True)
class ShownMode:
    """`mode`: index into the modes at the operating point; `track`: into the tracks, -1 without one.

    `label`: as its track is named where it has one, so that names stay while the speed changes; `colour`: place in the
    palette, the same for the same set of names whatever their order.
    """

    mode: int
    track: int
    label: str
    colour: int


@lru_cache(maxsize=4)
def shown_modes(view: LiveView) -> tuple[ShownMode, ...]:
    """The modes worth showing, by rising frequency: those of slow or lightly damped tracks, and all that grow."""
    if view.modes is None:
        return ()
    found = view.modes
    of_mode = _matched(found, view.tracks, view.speed) if view.tracks is not None else {}
    if of_mode:
        kept = [k for k in range(len(found.s)) if k in of_mode or found.s[k].real > 0.0]
    else:
        size = np.abs(found.s)
        lively = worth_drawing(size, np.where(found.s.imag > 0.0, found.s.real / np.maximum(size, 1e-300), -1.0))
        kept = [int(k) for k in np.flatnonzero(lively | (found.s.real > 0.0))]
    kept = kept[: MOST_MODES + 4]
    names = [
        view.tracks.labels[of_mode[k]] if view.tracks is not None and k in of_mode else found.labels[k] for k in kept
    ]
    rank = {label: place for place, label in enumerate(sorted(set(names)))}
    return tuple(ShownMode(k, of_mode.get(k, -1), label, rank[label]) for k, label in zip(kept, names, strict=True))


def at_speed(tracks: ModeTracks, speed: float) -> ComplexArray:
    """The tracks' eigenvalues (m,) at a speed between their points; NaN beyond their ends or next to a gap.

    Examples
    --------
    >>> from maglev_ctrl.analysis.tracking import track
    >>> from maglev_ctrl.systems import SecondOrderSystem
    >>> stack = SecondOrderSystem.from_matrices([[1.0]], [[0.0]], [[[4.0]], [[16.0]]])
    >>> at_speed(track(stack, parameter=[10.0, 20.0]), 15.0).imag.tolist()
    [3.0]
    """
    x = tracks.parameter
    if not (len(x) and x[0] <= speed <= x[-1]):
        return np.full(tracks.s.shape[1], complex(np.nan, np.nan))
    after = int(np.clip(np.searchsorted(x, speed), 1, max(1, len(x) - 1)))
    before = after - 1
    if len(x) == 1 or speed == x[before]:
        return np.asarray(tracks.s[before])
    if speed == x[after]:
        return np.asarray(tracks.s[after])
    share = (speed - x[before]) / (x[after] - x[before])
    return np.asarray((1.0 - share) * tracks.s[before] + share * tracks.s[after])


def _matched(found: Modes, tracks: ModeTracks, speed: float) -> dict[int, int]:
    """Mode -> track among the tracks worth drawing, the nearest eigenvalues together."""
    chosen = slowest_tracks(tracks.s)
    near = at_speed(tracks, speed)[chosen]
    apart = np.abs(found.s[:, None] - near[None, :])
    cost = np.where(np.isfinite(apart), apart / np.maximum(np.abs(found.s[:, None]), 1e-9), _FAR)
    rows, columns = linear_sum_assignment(cost)
    return {int(k): chosen[int(c)] for k, c in zip(rows, columns, strict=True) if cost[k, c] < _FAR}


def mode_words(found: Modes, mode: int) -> str:
    """Frequency and growth of a mode as its views tell them."""
    growth = float(found.s[mode].real)
    if abs(growth) <= found.error_bound[mode]:
        moves = "neutral"
    else:
        moves = f"{'grows' if growth > 0.0 else 'decays'} at {number(abs(growth), '1/s')}"
    oscillates = found.s[mode].imag > found.error_bound[mode]
    return f"{number(float(found.frequency[mode]), 'Hz')}, {moves}" if oscillates else f"no oscillation, {moves}"


def default_mode(shown: tuple[ShownMode, ...], found: Modes) -> int:
    """Place of the mode that grows fastest among the shown ones; 0 when there are none."""
    if not shown:
        return 0
    return int(np.argmax([found.s[one.mode].real for one in shown]))
