"""Tongues over speed: passing lines against Campbell curves, and the speeds that are safe at a given depth.

The lines k v/L of the passing frequency meet the sums and differences of the frequencies of the modes; each meeting
gets its first-order width in speed and the growth computed there. The table of speed ranges rests on the exponents,
not on the lines: a scan refined wherever two multipliers meet finds tongues of any order. Every edge is verified on
either side by both engines, what they do not decide is a range of its own.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Literal

import numpy as np

from maglev_ctrl.analysis.floquet import Floquet, floquet
from maglev_ctrl.analysis.multiplier_scan import MultiplierScan, Read, even_places, scan_multipliers
from maglev_ctrl.analysis.resonance import Resonance
from maglev_ctrl.analysis.resonance_naming import name_instability
from maglev_ctrl.analysis.tongue_search import (
    NOISE,
    Crossing,
    Path,
    Point,
    Track,
    exponents_of,
    find_crossings,
    leading_exponents,
    locate,
    pair_growth_in,
)
from maglev_ctrl.analysis.tongue_widths import first_order
from maglev_ctrl.arrays import ComplexArray, FloatArray, read_only, read_only_any
from maglev_ctrl.errors import Agreement
from maglev_ctrl.systems import PeriodicSystem

Verdict = Literal["go", "no-go", "unresolved"]

_TOPS_NAMED = 12  # places of most growth of one unstable range that are named
_TOPS_CHECKED = 3  # places of most growth of one stable range that both engines have to confirm
_UNDECIDED = "the engines do not decide"
_SCAN = (2000, 16000)  # fewest and most speeds of a scan that reads exponents
_SCAN_INTEGRATED = (200, 1000)  # and of one that integrates them
_TURN = 0.02  # rad per step
_FADED = -18.0  # log modulus of a multiplier that has no tongue of its own
_CLOSE = 1e-6  # growth per period that is integrated where it was read
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
    engines.

    What is sought are pairs of multipliers that meet, of any order: at every meeting that shows between two steps of
    the scan it is refined down to `missed_width` (m/s), and an unstable interval narrower than that may be missing. Two
    motions can hide their meetings from a scan only by meeting twice within one of its steps, `scan_step` (m/s) at
    most; where a step is so coarse that angles turn too far within it, `missed_width` is that step itself.
    """

    speed: FloatArray
    frequencies: FloatArray
    passing: FloatArray
    growth: FloatArray
    crossings: tuple[TongueCrossing, ...]
    ranges: tuple[SpeedRange, ...]
    checked: FloatArray
    missed_width: float
    scan_step: float

    def of(self, verdict: Verdict) -> tuple[SpeedRange, ...]:
        """The rows of one verdict."""
        return tuple(one for one in self.ranges if one.verdict == verdict)


def tongue_atlas(
    path: Path, *, lower: float, upper: float, samples: int = 96, checks: int = 16, max_order: int | None = None,
    tolerance: float = 1e-6, engine: Callable[[PeriodicSystem], Floquet] = floquet,
    reader: Read | None = None, extra: Sequence[float] = (), refine: bool = True,
) -> TongueAtlas:  # fmt: skip
    """Campbell curves, tongue crossings and go / no-go speeds of a loop with periodic terms at its actual depth.

    Parameters
    ----------
    path : speed -> periodic system at its actual depth; ModelError and OutOfDomain mean "no answer there"
    lower, upper : m/s, positive
    samples : speeds of the curves; the scan has at least as many and as many as the angles of the multipliers ask for
    checks : speeds of the scan decided by both engines, besides every edge and every top
    max_order : largest order k of the lines; twice the harmonics when left out
    tolerance : accuracy of the edges relative to the range of speeds
    engine : what decides a speed
    reader : exponents for the scan and the searches, see `SpeedSurface.over`; integrated at fewer speeds when left out
    extra : speeds the scan has to look at too, such as those another search found unstable or undecided
    refine : False leaves the scan as it is, to see what refinement at the meetings of multipliers finds

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
    track = Track(path, None if reader is None else _one_by_one(reader))
    grid = np.linspace(lower, upper, samples)
    good = np.array([v for v in grid if track.point(float(v)).system is not None])
    referee = _Referee(track, engine, {})
    step = float(grid[1] - grid[0])
    found = []
    for one in _orders(track, good, max_order) if len(good) > 1 else []:
        seen = locate(track, one, lower=max(lower, one.at - step), upper=min(upper, one.at + step))
        if seen is not None:
            found.append((one, seen.at, seen.onset))
    places = _scan_places(track, good, np.array(sorted({*track.points, *map(float, extra), lower, upper})), reader)
    scan = scan_multipliers(reader or _integrated(track), places[(places >= lower) & (places <= upper)], refine=refine)
    _take_over(track, scan)
    rows = _rows(
        track, referee, float(lower), float(upper), tolerance * (upper - lower), grid[:: max(1, samples // checks)]
    )
    frequencies, passing, growth = _campbell(track, grid)
    return TongueAtlas(
        speed=read_only(grid, name="speed"), frequencies=frequencies, passing=passing, growth=growth,
        crossings=tuple(sorted((_crossing(track, referee, *one) for one in found), key=lambda t: t.speed)),
        ranges=rows, checked=read_only_any(sorted(referee.seen)),
        missed_width=scan.narrowest if len(good) else float("nan"),
        scan_step=float(np.max(np.diff(places))),
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
        found = name_instability(system, self.decide(speed))
        if found.kind == "none" and np.max(np.linalg.eigvals(system.A_0).real) > 0.0:
            return "unstable without modulation"
        return found.name

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


def _one_by_one(reader: Read) -> Callable[[float], ComplexArray | None]:
    def read(speed: float) -> ComplexArray | None:
        found = reader(np.array([speed]))
        return None if found is None else found[0][0]

    return read


def _integrated(track: Track) -> Read:
    """Exponents of many speeds at once, integrated."""

    def read(speeds: FloatArray) -> tuple[ComplexArray, FloatArray] | None:
        systems = [one for one in map(track.system, map(float, speeds)) if one is not None]
        if len(systems) < len(speeds) or len({(one.A_0.shape, one.A_cos.shape) for one in systems}) != 1:
            return None
        return exponents_of(systems), np.array([float(one.frequency) for one in systems])

    return read


def _scan_places(track: Track, good: FloatArray, known: FloatArray, reader: Read | None) -> FloatArray:
    """Speeds of the scan: as many as keep the angle of the fastest motion from turning by more than `_TURN` a step."""
    lower, upper = float(known[0]), float(known[-1])
    turned = 0.0
    for v in (good[0], good[-1]) if len(good) > 1 else ():
        system = track.point(float(v)).system
        assert system is not None
        s = np.linalg.eigvals(system.A_0)
        period = 2.0 * np.pi / float(system.frequency)
        turned = abs(float(np.max(np.abs(s.imag) * (s.real * period > _FADED), initial=0.0)) * period - turned)
    fewest, most = _SCAN if reader is not None else _SCAN_INTEGRATED
    count = int(np.clip(2.0 * turned / _TURN, fewest, most))
    return np.unique(np.concatenate([even_places(lower, upper, count), known]))


def _take_over(track: Track, scan: MultiplierScan) -> None:
    """Puts into the track what of a scan decides the ranges: the ends of every run of one class and its tops."""
    kind = np.where(np.isnan(scan.growth), 0, np.where(scan.per_period > NOISE, 2, 1))
    ends = np.flatnonzero(np.diff(kind))
    wanted = {0, len(kind) - 1, *ends.tolist(), *(ends + 1).tolist()}
    starts = np.concatenate([[0], ends + 1, [len(kind)]])
    for a, b in pairwise(starts):
        if kind[a]:
            wanted.add(int(a + np.argmax(scan.growth[a:b])))
        calm = a + np.flatnonzero(scan.per_period[a:b] < -NOISE)
        if len(calm):
            wanted |= {int(calm[0]), int(calm[-1])}
    places = {*(float(scan.places[k]) for k in wanted), *scan.tops}
    doubtful = {float(v) for v in scan.places[np.abs(scan.per_period) < _CLOSE]} & places
    for place in sorted(places):
        point = track.point(place)
        if place in doubtful and point.system is not None:
            track.points[place] = Point(point.system, leading_exponents(point.system), "")


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
            kind, start, end = runs[k + 1]
            calm = (_calm(track, [v for v in places if first <= v <= last][::-1]),
                    _calm(track, [v for v in places if start <= v <= end]))  # fmt: skip
            right, doubt = _edge(track, referee, (verdict, last), (kind, start), tolerance, calm)
        inside = [v for v in places if first <= v <= last]
        rows += _verified(track, referee, verdict, left, right, inside, checks)
        if doubt is not None:
            rows.append(SpeedRange(right, doubt, "unresolved", (), float("nan"), _UNDECIDED))
        left = right if doubt is None else doubt
    return _merged(rows)


def _per_period(point: Point) -> float:
    return float("nan") if point.system is None else point.growth * 2.0 * np.pi / float(point.system.frequency)


def _calm(track: Track, run: list[float]) -> float:
    """The first place of a run whose motions decay by more than rounding can feign; its first one if none does."""
    return next((v for v in run if _per_period(track.points[v]) < -NOISE), run[0])


def _class(track: Track, speed: float) -> Verdict:
    point = track.points[speed]
    if point.system is None:
        return "unresolved"
    return "no-go" if point.unstable else "go"


def _edge(
    track: Track, referee: _Referee, before: tuple[Verdict, float], after: tuple[Verdict, float], tolerance: float,
    calm: tuple[float, float],
) -> tuple[float, float | None]:  # fmt: skip
    """Where one run ends: on the safe side of the edge; or the two ends of what is undecided around it.

    `calm`: the place of either run, nearest to the edge, that is clear of it.
    """
    (kind, low), (next_kind, high) = before, after
    a, b = low, high
    while abs(b - a) > tolerance and a < 0.5 * (a + b) < b:
        middle = 0.5 * (a + b)
        track.point(middle)
        a, b = (middle, b) if _class(track, middle) == kind else (a, middle)
    if "unresolved" in (kind, next_kind):
        return (a if next_kind == "unresolved" else b), None
    near, far = (a, b) if kind == "go" else (b, a)
    clear = calm[0] if kind == "go" else calm[1]
    if not _per_period(track.points[clear]) < -NOISE and referee.decide(clear).stable is not True:
        return low, high  # nothing decays here: no speed is nearer to the edge and stable
    stable = referee.nearest(near, clear, wanted=True)
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
        rows.append(row if calm and still else replace(row, verdict="unresolved", reason=_UNDECIDED))
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
