"""Tongues over speed: passing lines against Campbell curves, and the speeds that are safe at a given depth.

The lines k v/L of the passing frequency meet the sums and differences of the frequencies of the modes; each meeting
gets its first-order width in speed and the growth computed there. The table of speed ranges rests on the exponents,
not on the lines: every edge is verified on either side by both engines, what they do not decide is a range of its own.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Literal

import numpy as np

from maglev_ctrl.analysis.floquet import Floquet, floquet
from maglev_ctrl.analysis.resonance import Resonance
from maglev_ctrl.analysis.resonance_naming import name_instability
from maglev_ctrl.analysis.tongue_search import Crossing, Path, Track, find_crossings, locate, pair_growth_in
from maglev_ctrl.analysis.tongue_widths import first_order
from maglev_ctrl.arrays import ComplexArray, FloatArray, read_only, read_only_any
from maglev_ctrl.errors import Agreement
from maglev_ctrl.systems import PeriodicSystem

Verdict = Literal["go", "no-go", "unresolved"]

_TOPS_NAMED = 12  # places of most growth of one unstable range that are named
_TOPS_CHECKED = 6  # places of most growth of one stable range that both engines have to confirm
_SHARES = (0.0, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 0.1, 0.5, 1.0)  # of the way from an edge to where it is clear


@dataclass(frozen=True, slots=True)
class TongueCrossing:
    """Where a line of the passing frequency meets a Campbell curve, a sum or a difference of two.

    `speed` where they meet, `located` the place of most growth nearby, m/s. `half_width` in speed by first-order
    theory (m/s; 0 below the threshold, inf without an edge, NaN where the order has no first-order term). `growth` of
    the pair's own exponents at `located`, 1/s, NaN where the engines disagree; by the time domain alone where the
    `onset`, the predicted threshold over the actual depth, is inf (beyond three).
    """

    resonance: Resonance
    speed: float
    located: float
    half_width: float
    growth: float
    onset: float


@dataclass(frozen=True, slots=True)
class SpeedRange:
    """One row of the table: verdict from `lower` to `upper` (m/s), names of the tongues, largest growth met (1/s).

    "no-go" reaches outwards to speeds verified stable, "go" is what remains; "unresolved" carries its `reason`.
    """

    lower: float
    upper: float
    verdict: Verdict
    tongues: tuple[str, ...]
    growth: float
    reason: str


@dataclass(frozen=True, eq=False, slots=True)
class TongueAtlas:
    """Campbell curves and tongues over speed.

    `speed` (V,) m/s; `frequencies` (V, m) rad/s of the oscillating modes, NaN where there are fewer; `passing` (V,)
    rad/s, order 1; `growth` (V,) 1/s. `ranges` cover the speeds without holes. `checked` (C,): speeds decided by both
    engines. A tongue narrower than `missed_width` (m/s) could have been missed unless it is one of the `crossings`.
    """

    speed: FloatArray
    frequencies: FloatArray
    passing: FloatArray
    growth: FloatArray
    crossings: tuple[TongueCrossing, ...]
    ranges: tuple[SpeedRange, ...]
    checked: FloatArray
    missed_width: float

    def of(self, verdict: Verdict) -> tuple[SpeedRange, ...]:
        """The rows of one verdict."""
        return tuple(one for one in self.ranges if one.verdict == verdict)


def tongue_atlas(
    path: Path, *, lower: float, upper: float, samples: int = 96, checks: int = 16, max_order: int | None = None,
    tolerance: float = 1e-6, engine: Callable[[PeriodicSystem], Floquet] = floquet,
    reader: Callable[[float], ComplexArray | None] | None = None,
) -> TongueAtlas:  # fmt: skip
    """Campbell curves, tongue crossings and go / no-go speeds of a loop with periodic terms at its actual depth.

    Parameters
    ----------
    path : speed -> periodic system at its actual depth; ModelError and OutOfDomain mean "no answer there"
    lower, upper : m/s, positive
    samples : speeds of the scan; predicted tongues, tops of growth and edges come on top
    checks : speeds of the scan decided by both engines, besides every edge and every top
    max_order : largest order k of the lines; twice the harmonics when left out
    tolerance : accuracy of the edges relative to the range of speeds
    engine : what decides a speed
    reader : exponents at a speed for the scan and the searches, see `SpeedSurface.at`; integrated when left out

    Raises
    ------
    ValueError : limits that are not positive and ascending, or too few samples

    Examples
    --------
    >>> A_0, A_1 = [[0.0, 1.0], [-1.0, -0.02]], [[[0.0, 0.0], [-0.1, 0.0]]]
    >>> path = lambda v: PeriodicSystem.from_matrices(A_0, A_1, frequency=2.0 * v)
    >>> atlas = tongue_atlas(path, lower=0.8, upper=1.2, samples=12, checks=4)
    >>> [(r.verdict, round(r.lower, 4), round(r.upper, 4), *r.tongues) for r in atlas.ranges]
    [('go', 0.8, 0.9769), ('no-go', 0.9769, 1.0227, '2 w1/1'), ('go', 1.0227, 1.2)]
    """
    if not 0.0 < lower < upper or samples < 3 or checks < 2:
        raise ValueError("speeds: expected 0 < lower < upper, at least 3 samples and 2 checks")
    track = Track(path, reader)
    grid = np.linspace(lower, upper, samples)
    good = np.array([v for v in grid if track.point(float(v)).system is not None])
    referee = _Referee(track, engine, {})
    step = float(grid[1] - grid[0])
    found = []
    for one in _orders(track, good, max_order) if len(good) > 1 else []:
        seen = locate(track, one, lower=max(lower, one.at - step), upper=min(upper, one.at + step))
        if seen is not None:
            found.append((one, seen.at, seen.onset))
    _climb(track)
    rows = _rows(
        track, referee, float(lower), float(upper), tolerance * (upper - lower), grid[:: max(1, samples // checks)]
    )
    known = sorted(v for v, point in track.points.items() if point.system is not None)
    frequencies, passing, growth = _campbell(track, grid)
    return TongueAtlas(
        speed=read_only(grid, name="speed"), frequencies=frequencies, passing=passing, growth=growth,
        crossings=tuple(sorted((_crossing(track, referee, *one) for one in found), key=lambda t: t.speed)),
        ranges=rows, checked=read_only_any(sorted(referee.seen)),
        missed_width=float(max((b - a for a, b in pairwise(known)), default=np.nan)),
    )  # fmt: skip


@dataclass(slots=True, eq=False)
class _Referee:
    """Verdicts of both engines, each speed decided once."""

    track: Track
    engine: Callable[[PeriodicSystem], Floquet]
    seen: dict[float, Floquet]

    def decide(self, speed: float) -> Floquet:
        if speed not in self.seen:
            system = self.track.point(speed).system
            assert system is not None
            self.seen[speed] = self.engine(system)
        return self.seen[speed]

    def name(self, speed: float) -> str:
        system = self.track.point(speed).system
        assert system is not None
        if np.max(np.linalg.eigvals(system.A_0).real) > 0.0:
            return "unstable without modulation"
        return name_instability(system, self.decide(speed)).name

    def nearest(self, place: float, known: float, *, wanted: bool) -> float | None:
        """The speed nearest to `place`, towards `known`, with the wanted verdict."""
        for share in _SHARES:
            tried = float(place + share * (known - place))
            if self.decide(tried).stable is wanted:
                return tried
        return None


def _orders(track: Track, good: FloatArray, max_order: int | None) -> list[Crossing]:
    system = track.point(float(good[0])).system
    harmonics = 1 if system is None else len(system.A_cos)
    return find_crossings(track, good, max_order=max_order or 2 * harmonics)


def _climb(track: Track) -> None:
    """Follows every stable local maximum of growth to its top."""
    places = sorted(v for v, point in track.points.items() if point.system is not None)
    growth = [track.points[v].growth for v in places]
    for k in range(1, len(places) - 1):
        if growth[k] >= growth[k - 1] and growth[k] > growth[k + 1] and not track.points[places[k]].unstable:
            track.highest(places[k - 1], places[k + 1], steps=12)


def _rows(
    track: Track, referee: _Referee, lower: float, upper: float, tolerance: float, checks: FloatArray
) -> tuple[SpeedRange, ...]:
    """The table: runs of one class, edges bisected and verified, the inside of every run verified."""
    places = sorted(float(v) for v in track.points if lower <= v <= upper)
    classes = [_class(track, v) for v in places]
    starts = [0, *(k for k in range(1, len(places)) if classes[k] != classes[k - 1]), len(places)]
    runs = [(classes[a], places[a], places[b - 1]) for a, b in pairwise(starts)]
    rows: list[SpeedRange] = []
    left = lower
    for k, (verdict, first, last) in enumerate(runs):
        right, doubt = upper, None
        if k + 1 < len(runs):
            right, doubt = _edge(track, referee, (verdict, last), (runs[k + 1][0], runs[k + 1][1]), tolerance)
        inside = [v for v in places if first <= v <= last]
        rows += _verified(track, referee, verdict, left, right, inside, checks)
        if doubt is not None:
            reason = "the engines do not confirm the edge"
            rows.append(SpeedRange(right, doubt, "unresolved", (), float("nan"), reason))
        left = right if doubt is None else doubt
    return _merged(rows)


def _class(track: Track, speed: float) -> Verdict:
    point = track.points[speed]
    if point.system is None:
        return "unresolved"
    return "no-go" if point.unstable else "go"


def _edge(
    track: Track, referee: _Referee, before: tuple[Verdict, float], after: tuple[Verdict, float], tolerance: float
) -> tuple[float, float | None]:
    """Where one run ends: on the safe side of the edge; or the two ends of what is undecided around it."""
    (kind, low), (next_kind, high) = before, after
    a, b = low, high
    while abs(b - a) > tolerance and a < 0.5 * (a + b) < b:
        middle = 0.5 * (a + b)
        track.point(middle)
        a, b = (middle, b) if _class(track, middle) == kind else (a, middle)
    if "unresolved" in (kind, next_kind):
        return (a if next_kind == "unresolved" else b), None
    near, far = (a, b) if kind == "go" else (b, a)
    stable = referee.nearest(near, low if kind == "go" else high, wanted=True)
    unstable = referee.nearest(far, high if kind == "go" else low, wanted=False)
    if stable is None or unstable is None:
        return low, high
    return stable, None


def _verified(
    track: Track, referee: _Referee, verdict: Verdict, left: float, right: float, inside: list[float],
    checks: FloatArray,
) -> list[SpeedRange]:  # fmt: skip
    """One run as rows: its tops and scan points decided by both engines, undecided neighbourhoods cut out."""
    if verdict == "unresolved":
        reason = next((track.points[v].fault for v in inside if track.points[v].fault), "no model")
        return [SpeedRange(left, right, "unresolved", (), float("nan"), reason)]
    growth = [track.points[v].growth for v in inside]
    tops = [v for k, v in enumerate(inside) if growth[k] == max(growth[max(k - 1, 0) : k + 2])]
    tops = sorted(tops, key=lambda v: -track.points[v].growth)
    if verdict == "no-go":
        tops = tops[:_TOPS_NAMED]
        decided = [v for v in tops if referee.decide(v).stable is False]
        if tops[0] not in decided:
            return [SpeedRange(left, right, "unresolved", (), max(growth), "the engines do not confirm the growth")]
        names = tuple(dict.fromkeys(referee.name(v) for v in sorted(decided)))
        return [SpeedRange(left, right, "no-go", names, max(growth), "")]
    asked = {left, right, *tops[:_TOPS_CHECKED], *(float(v) for v in checks if left <= v <= right)}
    places = sorted(v for v in asked if left <= v <= right)
    # What lies between two speeds is told safe only where both engines found both of them stable.
    stable = [referee.decide(v).stable is True for v in places]
    rows: list[SpeedRange] = []
    for (low, calm), (high, still) in pairwise(zip(places, stable, strict=True)):
        top = max((track.points[v].growth for v in inside if low <= v <= high), default=max(growth))
        row = SpeedRange(low, high, "go", (), top, "")
        rows.append(row if calm and still else replace(row, verdict="unresolved", reason="the engines do not decide"))
    return rows


def _merged(rows: list[SpeedRange]) -> tuple[SpeedRange, ...]:
    """Neighbouring rows of one verdict and reason made one; rows without length left out."""
    merged: list[SpeedRange] = []
    for row in rows:
        last = merged[-1] if merged else None
        if last is not None and last.verdict == row.verdict and last.reason == row.reason:
            names = tuple(dict.fromkeys((*last.tongues, *row.tongues)))
            merged[-1] = replace(last, upper=row.upper, tongues=names, growth=float(np.fmax(last.growth, row.growth)))
        elif row.upper > row.lower:
            merged.append(row)
    return tuple(merged)


def _campbell(track: Track, grid: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Frequencies (V, m), passing frequency (V,) and growth (V,) at the speeds of the scan."""
    found, passing, growth = [], [], []
    for v in grid:
        point = track.point(float(v))
        s = np.empty(0) if point.system is None else np.linalg.eigvals(point.system.A_0)
        found.append(np.sort(s.imag[s.imag > 1e-9 * np.abs(s)]))
        passing.append(np.nan if point.system is None else float(point.system.frequency))
        growth.append(point.growth)
    frequencies = np.full((len(grid), max((len(w) for w in found), default=0)), np.nan)
    for k, w in enumerate(found):
        frequencies[k, : len(w)] = w
    return read_only_any(frequencies), read_only_any(passing), read_only_any(growth)


def _crossing(track: Track, referee: _Referee, one: Crossing, located: float, onset: float) -> TongueCrossing:
    """One crossing with its first-order width in speed and the growth both engines find."""
    theory = first_order(track, one)
    there = track.point(located)
    assert there.system is not None
    exponents, agreed = there.exponents, True
    if np.isfinite(onset):
        decided = referee.decide(located)
        exponents, agreed = decided.exponents, decided.agreement is Agreement.AGREED
    grown = pair_growth_in(exponents, there.system, replace(one, at=located)) if agreed else float("nan")
    return TongueCrossing(theory.resonance, one.at, located, theory.half_width, grown, onset)
