"""Every place along a path where Floquet multipliers meet, whatever the order of the tongue: a scan with refinement.

A motion can only lock to the passing frequency where two multipliers meet: the angles of two of them, folded into
[0, pi], become equal, or one reaches 0 or pi. Between two speeds of a scan an angle moves little, so a meeting shows as
a minimum of the gap between neighbouring angles that is no larger than the change of the gap beside it. There the scan
is refined, level after level, around the minimum. What grows between samples without a meeting is smooth: a top of any
real part that its curvature could lift above zero is refined in the same way.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from maglev_ctrl.arrays import ComplexArray, FloatArray

Read = Callable[[FloatArray], tuple[ComplexArray, FloatArray] | None]
"""Places (P,) -> exponents (P, n) 1/s and passing frequencies (P,) rad/s; None where one place has no answer."""

POINTS: Final = 17
LEVELS: Final = 5
_ROOM: Final = 1 << 15  # places read at once
_FADED: Final = -18.0  # log modulus: below it rounding of the largest multipliers hides the angle
_FLAT: Final = 1e-9  # rad: gaps below it are those of a pair with its conjugate, or of a locked pair
_TURN: Final = 0.3  # rad an angle may move within a step for its meetings to be told apart
_TOP_LEVELS: Final = 1  # a parabola's top is then known to a 500th of what it is above its samples


@dataclass(frozen=True, eq=False, slots=True)
class MultiplierScan:
    """What a scan with refinement has seen.

    `places` (P,) ascending, all that was read; `growth` (P,) 1/s and `per_period` (P,) its logarithm per period, NaN
    without an answer. `tops` the places of most growth of every refinement. `meetings` how many meetings were refined.
    `narrowest`: an unstable interval of multipliers that meet may be missing if it is narrower than this. It is the
    step down to which meetings were refined; where the scan was too coarse to tell meetings apart, its own step.
    """

    places: FloatArray
    growth: FloatArray
    per_period: FloatArray
    tops: tuple[float, ...]
    meetings: int
    narrowest: float


@dataclass(frozen=True, eq=False, slots=True)
class _Samples:
    """Angles (P, n) and real parts (P, n) 1/s, largest modulus first; log moduli (P, n), -inf where there is none."""

    places: FloatArray
    angle: FloatArray
    real: FloatArray
    level: FloatArray

    @property
    def known(self) -> NDArray[np.bool_]:
        return np.asarray(np.isfinite(self.level[:, 0]))

    def kept(self) -> NDArray[np.intp]:
        """How many multipliers of each place rounding does not hide."""
        return np.asarray(np.sum(self.level > _FADED, axis=1))

    def gaps(self, count: int) -> FloatArray:
        """Gaps (P, count + 1) between neighbours of 0, the angles of the `count` largest multipliers, and pi."""
        inner = np.sort(self.angle[:, :count], axis=1)
        ends = np.zeros((len(inner), 1)), np.full((len(inner), 1), np.pi)
        return np.asarray(np.diff(np.concatenate([ends[0], inner, ends[1]], axis=1), axis=1))


@dataclass(frozen=True, eq=False, slots=True)
class _Candidates:
    """Minima to refine: bracket (C,) and which quantity: gap `index` among `count` angles; count 0: minus the real part
    number `index`."""

    left: FloatArray
    right: FloatArray
    count: NDArray[np.intp]
    index: NDArray[np.intp]


def scan_multipliers(read: Read, places: FloatArray, *, refine: bool = True) -> MultiplierScan:
    """A scan of `places`, refined wherever multipliers meet or a smooth top could lie above zero.

    Parameters
    ----------
    read : see `Read`
    places : (P,) ascending
    refine : False leaves the bare scan

    Examples
    --------
    >>> from maglev_ctrl.analysis.tongue_search import exponents_of
    >>> from maglev_ctrl.systems import PeriodicSystem
    >>> A_0, A_1 = [[0.0, 1.0], [-1.0, -2e-4]], [[[0.0, 0.0], [-1e-3, 0.0]]]
    >>> def read(W):
    ...     systems = [PeriodicSystem.from_matrices(A_0, A_1, frequency=w) for w in W]
    ...     return exponents_of(systems), W
    >>> found = scan_multipliers(read, np.linspace(1.75, 2.3, 30))
    >>> round(float(np.max(found.growth)), 6), found.narrowest < 1e-5
    (0.00015, True)
    """
    base = _sampled(read, np.asarray(places, dtype=np.float64))
    parts, tops, narrowest, meetings = [base], [], _too_coarse(base), 0
    for candidates, levels in ((_meetings(base), LEVELS), (_hidden_tops(base), LEVELS), (_all_tops(base), _TOP_LEVELS)):
        if not refine or not len(candidates.left):
            continue
        seen, width = _refined(read, candidates, levels)
        parts += seen
        tops += _highest(seen, candidates)
        if candidates.count[0]:
            meetings, narrowest = len(candidates.left), max(narrowest, width)
    if not refine:
        tops = [float(a) for a in _all_tops(base).left]
        narrowest = float(np.max(np.diff(base.places), initial=0.0))
    return _collected(parts, tuple(tops), meetings, narrowest)


def _collected(parts: list[_Samples], tops: tuple[float, ...], meetings: int, narrowest: float) -> MultiplierScan:
    every = np.concatenate([one.places for one in parts])
    growth = np.concatenate([np.where(one.known, one.real[:, 0], np.nan) for one in parts])
    level = np.concatenate([np.where(one.known, one.level[:, 0], np.nan) for one in parts])
    unique, first = np.unique(every, return_index=True)
    return MultiplierScan(unique, growth[first], level[first], tops, meetings, narrowest)


def _sampled(read: Read, places: FloatArray) -> _Samples:
    """Samples of places; those without an answer have log moduli of -inf."""
    parts: list[tuple[int, ComplexArray, FloatArray]] = []

    def ask(start: int, stop: int) -> None:
        found = read(places[start:stop])
        if found is not None:
            parts.append((start, *found))
        elif stop - start > 1:
            middle = (start + stop) // 2
            ask(start, middle)
            ask(middle, stop)

    for start in range(0, len(places), _ROOM):
        ask(start, min(start + _ROOM, len(places)))
    n = max((one[1].shape[1] for one in parts), default=1)
    shape = len(places), n
    real, level, angle = np.full(shape, -np.inf), np.full(shape, -np.inf), np.full(shape, np.nan)
    for start, exponents, frequency in parts:
        order = np.argsort(-exponents.real, axis=1)
        ranked = np.take_along_axis(exponents, order, axis=1)
        period = (2.0 * np.pi / frequency)[:, None]
        rows, columns = slice(start, start + len(ranked)), slice(0, ranked.shape[1])
        real[rows, columns], level[rows, columns] = ranked.real, ranked.real * period
        angle[rows, columns] = np.minimum(np.abs(ranked.imag) * period, np.pi)
    return _Samples(places, angle, real, level)


def _too_coarse(base: _Samples) -> float:
    """The widest step within which an angle moves too far for meetings to be told apart; 0: none."""
    widest, kept = 0.0, base.kept()
    both = base.known[1:] & base.known[:-1] & (kept[1:] == kept[:-1])
    for count in np.unique(kept):
        rows = np.flatnonzero(both & (kept[1:] == count))
        if count and len(rows):
            angles = np.sort(base.angle[:, :count], axis=1)
            far = np.max(np.abs(angles[rows + 1] - angles[rows]), axis=1) > _TURN
            widest = max(widest, float(np.max(np.diff(base.places)[rows[far]], initial=0.0)))
    return widest


def _meetings(base: _Samples) -> _Candidates:
    """Minima of gaps that may reach zero between the samples."""
    found: list[tuple[int, int, int]] = []
    kept = np.where(base.known, base.kept(), 0)
    around = np.maximum(kept, np.maximum(np.append(kept[1:], 0), np.append(0, kept[:-1])))
    for count in np.unique(around[around > 0]):
        gaps = np.where(base.known[:, None], np.nan_to_num(base.gaps(int(count)), nan=np.pi), np.inf)
        rows, columns = np.nonzero(_may_reach(gaps, 0.0) & (around == count)[:, None] & base.known[:, None])
        beside = _beside(gaps)
        flat = np.all([np.where(np.isfinite(one), one, 0.0)[rows, columns] < _FLAT for one in beside], axis=0)
        found += [(int(k), int(count), int(j)) for k, j in zip(rows[~flat], columns[~flat], strict=True)]
    return _candidates(base.places, found)


def _hidden_tops(base: _Samples) -> _Candidates:
    """Tops of any real part below zero that could reach it between the samples."""
    depth = np.where(np.isfinite(base.real), -base.real, np.inf)
    rows, columns = np.nonzero(_may_reach(depth, 0.0) & (depth > 0.0) & np.isfinite(depth))
    return _candidates(base.places, [(int(k), 0, int(j)) for k, j in zip(rows, columns, strict=True)])


def _all_tops(base: _Samples) -> _Candidates:
    """Every top of growth."""
    depth = np.where(base.known, -base.real[:, 0], np.inf)[:, None]
    before, after = _beside(depth)
    rows = np.flatnonzero((base.known[:, None] & (depth <= before) & (depth < after))[:, 0])
    return _candidates(base.places, [(int(k), 0, 0) for k in rows])


def _beside(values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Values (P, m) one place before and after; inf beyond the ends."""
    rim = np.full((1, values.shape[1]), np.inf)
    return np.concatenate([rim, values[:-1]]), np.concatenate([values[1:], rim])


def _may_reach(values: FloatArray, floor: float) -> NDArray[np.bool_]:
    """Minima (P, m) no higher above `floor` than the values change beside them.

    Proven for a kink (its sample is at most half a step from it) and for a parabola (it loses an eighth of its second
    difference between samples). At the rim there is no second neighbour, and every minimum counts.
    """
    before, after = _beside(values)
    with np.errstate(invalid="ignore"):
        change = np.fmax(before - values, after - values)
        return np.asarray(np.isfinite(values) & (values <= before) & (values <= after) & (values - floor <= change))


def _candidates(places: FloatArray, found: list[tuple[int, int, int]]) -> _Candidates:
    rows = np.array([one[0] for one in found], dtype=np.intp)
    last = len(places) - 1
    return _Candidates(
        places[np.maximum(rows - 1, 0)], places[np.minimum(rows + 1, last)],
        np.array([one[1] for one in found], dtype=np.intp), np.array([one[2] for one in found], dtype=np.intp),
    )  # fmt: skip


def _refined(read: Read, candidates: _Candidates, levels: int) -> tuple[list[_Samples], float]:
    """Samples around every candidate, closer from level to level, and the widest last step of what was not given up.

    A minimum that lies higher than it changes beside it does not reach zero and is given up.
    """
    left, right, alive = candidates.left.copy(), candidates.right.copy(), np.ones(len(candidates.left), dtype=bool)
    parts: list[_Samples] = []
    for _ in range(levels):
        rows = np.flatnonzero(alive)
        if not len(rows):
            break
        share = np.linspace(0.0, 1.0, POINTS)
        places = left[rows, None] + share * (right - left)[rows, None]
        part = _sampled(read, places.ravel())
        parts.append(part)
        values = _values(part, candidates.count[rows], candidates.index[rows])
        lowest = np.min(values, axis=1, keepdims=True)
        flat = values <= lowest + np.where(candidates.count[rows] > 0, _FLAT, 0.0)[:, None]
        every, number = np.arange(len(rows)), np.arange(POINTS)
        middle = np.sum(flat * number, axis=1, keepdims=True) / np.sum(flat, axis=1, keepdims=True)
        best = np.argmin(np.where(flat, np.abs(number - middle), np.inf), axis=1)
        low, high = np.maximum(best - 1, 0), np.minimum(best + 1, POINTS - 1)
        left[rows], right[rows] = places[every, low], places[every, high]
        here = values[every, best]
        with np.errstate(invalid="ignore"):
            change = np.fmax(values[every, low] - here, values[every, high] - here)
        rim = (best == 0) | (best == POINTS - 1)
        alive[rows] = np.isfinite(here) & (rim | (here <= np.maximum(change, _FLAT)))
    width = float(np.max((right - left)[alive], initial=0.0)) / 2.0
    return parts, width


def _values(part: _Samples, count: NDArray[np.intp], index: NDArray[np.intp]) -> FloatArray:
    """What every candidate is to be least of, (C, POINTS); inf without an answer."""
    n = part.angle.shape[1]
    out = np.full(len(part.places), np.inf)
    counts, indices = np.repeat(count, POINTS), np.repeat(index, POINTS)
    for one in np.unique(count):
        rows = np.flatnonzero((counts == one) & part.known)
        if one == 0:
            out[rows] = -part.real[rows, np.minimum(indices[rows], n - 1)]
        elif one <= n:
            gaps = part.gaps(int(one))[rows]
            out[rows] = np.nan_to_num(gaps[np.arange(len(rows)), indices[rows]], nan=np.pi)
    return out.reshape(len(count), POINTS)


def _highest(parts: list[_Samples], candidates: _Candidates) -> list[float]:
    """The place of most growth within the bracket of every candidate."""
    places = np.concatenate([one.places for one in parts])
    growth = np.concatenate([np.where(one.known, one.real[:, 0], -np.inf) for one in parts])
    order = np.argsort(places, kind="stable")
    places, growth = places[order], growth[order]
    first = np.searchsorted(places, candidates.left, side="left")
    last = np.searchsorted(places, candidates.right, side="right")
    return [float(places[a + int(np.argmax(growth[a:b]))]) for a, b in zip(first, last, strict=True) if b > a]


def even_places(lower: float, upper: float, count: int) -> FloatArray:
    """About `count` speeds: half of them even in 1/v, as the angles of the multipliers go, and half even in v.

    Examples
    --------
    >>> even_places(1.0, 2.0, 6).round(3)
    array([1.   , 1.333, 1.5  , 2.   ])
    """
    half = max(2, count // 2)
    inverse = np.clip(1.0 / np.linspace(1.0 / lower, 1.0 / upper, half), lower, upper)
    places = np.unique(np.concatenate([inverse, np.linspace(lower, upper, half)]))
    apart = [True, *(b - a > 1e-12 * upper for a, b in pairwise(places))]
    return np.asarray(places[apart])
