"""Where a parameter crosses a stability boundary: scan, refine, bisect; holes in the model are never bridged.

Every value of the parameter is stable, unstable or undefined (the model has no answer there, with its reason). Each
change of class between neighbouring samples is bisected. Between samples of one class a narrow window of the other
is looked for where the abscissa peaks (or dips) and where it bends more than its distance to zero.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Literal

import numpy as np

from maglev_ctrl.arrays import FloatArray, read_only_any
from maglev_ctrl.errors import ModelError, NotStable, OutOfDomain

GOLDEN = (np.sqrt(5.0) - 1.0) / 2.0
REFINEMENTS = 6  # halvings of one sample interval where the abscissa bends
GOLDEN_STEPS = 60
GOLDEN_LEAST = 6  # steps before a flat peak may be given up


@dataclass(frozen=True, eq=False, slots=True)
class Crossing:
    """A stability boundary at `value`: stability is lost or gained as the parameter rises; +- `error`."""

    value: float
    direction: Literal["loses", "gains"]
    error: float


@dataclass(frozen=True, eq=False, slots=True)
class Gap:
    """An interval of the parameter where the model has no answer, and why."""

    lower: float
    upper: float
    reason: str


@dataclass(frozen=True, eq=False, slots=True)
class Boundaries:
    """Result of a scan: crossings, intervals by verdict, gaps, and every evaluated point.

    `parameter`, `abscissa` (k,): all points evaluated, in order; NaN in gaps. `evaluated` is their number.
    """

    crossings: tuple[Crossing, ...]
    stable_intervals: tuple[tuple[float, float], ...]
    unstable_intervals: tuple[tuple[float, float], ...]
    gaps: tuple[Gap, ...]
    evaluated: int
    parameter: FloatArray
    abscissa: FloatArray
    lower: float
    upper: float


@dataclass(frozen=True, eq=False, slots=True)
class BoundaryMargin:
    """Distance from an operating value to the nearest place where stability ends or is no longer known.

    `kind`: "boundary" where stability is lost, "gap" where the model ends, "range" where the scan ended. For the
    last two, the distance is a lower bound on the margin as far as it is known. `relative` = distance / |value|.
    """

    value: float
    distance: float
    relative: float
    at: float
    kind: Literal["boundary", "gap", "range"]
    reason: str


@dataclass(slots=True)
class _Scan:
    """Points evaluated so far; a point is evaluated once."""

    function: Callable[[float], float]
    neutral: float
    values: dict[float, float] = field(default_factory=dict)
    reasons: dict[float, str] = field(default_factory=dict)

    def at(self, x: float) -> float:
        if x not in self.values:
            try:
                result = float(self.function(x))
                reason = "" if np.isfinite(result) else "the growth rate is not a number here"
            except (ModelError, OutOfDomain) as fault:
                result, reason = float("nan"), f"{type(fault).__name__}: {fault}"
            self.values[x] = result if not reason else float("nan")
            self.reasons[x] = reason
        return self.values[x]

    def state(self, x: float) -> str:
        value = self.at(x)
        if np.isnan(value):
            return self.reasons[x]
        return "unstable" if value > self.neutral else "stable"

    def points(self) -> list[float]:
        return sorted(self.values)


def stability_boundaries(
    abscissa: Callable[[float], float],
    lower: float,
    upper: float,
    *,
    samples: int = 200,
    tolerance: float | None = None,
    neutral: float = 0.0,
    candidates: Sequence[float] = (),
) -> Boundaries:
    """Values of a parameter in [lower, upper] where a system loses or gains stability.

    Parameters
    ----------
    abscissa : growth rate in 1/s at a value of the parameter; may raise ModelError or OutOfDomain, or return NaN,
        where there is no answer: such values form gaps
    lower, upper : range, in the unit of the parameter
    samples : points of the first scan
    tolerance : accuracy of a crossing, in the unit of the parameter; 1e-10 of the range when left out
    neutral : growth up to this many 1/s counts as not unstable (undamped models sit on the axis within rounding)
    candidates : further values to look at, for instance where two frequencies meet

    Raises
    ------
    ValueError : an empty range, fewer than 3 samples, or a tolerance that is not positive

    Examples
    --------
    >>> found = stability_boundaries(lambda v: (v - 1.0) * (v - 3.0), 0.0, 4.0, samples=21)
    >>> [(round(c.value, 8), c.direction) for c in found.crossings]
    [(1.0, 'gains'), (3.0, 'loses')]
    """
    if not (np.isfinite(lower) and np.isfinite(upper) and lower < upper):
        raise ValueError(f"lower, upper: expected lower < upper, got {lower} and {upper}")
    if samples < 3:
        raise ValueError(f"samples: expected at least 3, got {samples}")
    width = 1e-10 * (upper - lower) if tolerance is None else tolerance
    if not width > 0.0:
        raise ValueError(f"tolerance: expected a positive number, got {tolerance}")
    outside = [x for x in candidates if not lower <= x <= upper]
    if outside:
        raise ValueError(f"candidates: {outside[0]} lies outside [{lower}, {upper}]")
    scan = _Scan(abscissa, neutral)
    grid = sorted({float(x) for x in np.linspace(lower, upper, samples)} | {float(x) for x in candidates})
    for x in grid:
        scan.at(x)
    for a, b in pairwise(grid):
        _subdivide(scan, a, b, REFINEMENTS)
    _search_extremes(scan, width)
    points = scan.points()
    edges = [edge for a, b in pairwise(points) for edge in _transitions(scan, a, b, width)]
    return _assemble(scan, edges, lower, upper)


def margin_to_boundary(boundaries: Boundaries, value: float) -> BoundaryMargin:
    """Distance from a stable operating value to the nearest boundary, gap or end of the scan.

    Raises
    ------
    ValueError : the value lies outside the scan
    NotStable : the operating value is unstable, or the model has no answer there

    Examples
    --------
    >>> found = stability_boundaries(lambda v: v - 3.0, 0.0, 10.0, samples=21)
    >>> margin = margin_to_boundary(found, 2.0)
    >>> margin.kind, round(margin.distance, 6)
    ('boundary', 1.0)
    """
    if not boundaries.lower <= value <= boundaries.upper:
        raise ValueError(f"value: {value} lies outside the scan [{boundaries.lower}, {boundaries.upper}]")
    inside = [(a, b) for a, b in boundaries.stable_intervals if a <= value <= b]
    if not inside:
        raise NotStable(f"value: no stable interval holds {value}; a margin of an unstable point means nothing")
    a, b = inside[0]
    at = a if value - a < b - value else b
    distance = abs(at - value)
    kind: Literal["boundary", "gap", "range"] = "boundary"
    reason = "stability is lost"
    gaps = [gap for gap in boundaries.gaps if at in (gap.lower, gap.upper)]
    if gaps:
        kind, reason = "gap", gaps[0].reason
    elif at in (boundaries.lower, boundaries.upper):
        kind, reason = "range", "the scan ends here"
    relative = distance / abs(value) if value != 0.0 else float("inf")
    return BoundaryMargin(value, distance, relative, at, kind, reason)


def _subdivide(scan: _Scan, a: float, b: float, depth: int) -> None:
    """Halve an interval where a straight line between its ends cannot be trusted to keep its sign."""
    if depth == 0 or scan.state(a) != scan.state(b) or np.isnan(scan.at(a)):
        return
    middle = 0.5 * (a + b)
    if not a < middle < b or scan.state(middle) != scan.state(a):
        return
    bend = abs(scan.at(middle) - 0.5 * (scan.at(a) + scan.at(b)))
    distance = min(abs(scan.at(x) - scan.neutral) for x in (a, middle, b))
    if bend > 0.5 * distance:
        _subdivide(scan, a, middle, depth - 1)
        _subdivide(scan, middle, b, depth - 1)


def _search_extremes(scan: _Scan, width: float) -> None:
    """Golden section from every local peak of stable points (dip of unstable ones), until the sign changes."""
    points = scan.points()
    for a, x, b in zip(points, points[1:], points[2:], strict=False):
        state = scan.state(x)
        if not scan.state(a) == state == scan.state(b) or state not in ("stable", "unstable"):
            continue
        sign = 1.0 if state == "stable" else -1.0
        if sign * scan.at(x) >= max(sign * scan.at(a), sign * scan.at(b)):
            _golden(scan, a, b, sign, width)


def _golden(scan: _Scan, a: float, b: float, sign: float, width: float) -> None:
    start = scan.state(a)
    c, d = b - GOLDEN * (b - a), a + GOLDEN * (b - a)
    for step in range(GOLDEN_STEPS):
        if b - a <= width or scan.state(c) != start or scan.state(d) != start:
            return
        inner = [scan.at(x) for x in (a, c, d, b)]
        distance = min(abs(value - scan.neutral) for value in inner)
        if step >= GOLDEN_LEAST and 4.0 * (max(inner) - min(inner)) < distance:
            return  # what is left of the rise cannot reach the boundary
        if sign * scan.at(c) >= sign * scan.at(d):
            b, d = d, c
            c = b - GOLDEN * (b - a)
        else:
            a, c = c, d
            d = a + GOLDEN * (b - a)


def _transitions(scan: _Scan, a: float, b: float, width: float) -> list[tuple[float, float]]:
    """Brackets not wider than `width` for every change of class found by bisection between a and b."""
    left, right = scan.state(a), scan.state(b)
    if left == right or (_undefined(left) and _undefined(right)):
        return []
    middle = 0.5 * (a + b)
    if b - a <= width or not a < middle < b:
        return [(a, b)]
    return _transitions(scan, a, middle, width) + _transitions(scan, middle, b, width)


def _undefined(state: str) -> bool:
    return state not in ("stable", "unstable")


def _assemble(scan: _Scan, edges: list[tuple[float, float]], lower: float, upper: float) -> Boundaries:
    crossings: list[Crossing] = []
    intervals: dict[str, list[tuple[float, float]]] = {"stable": [], "unstable": []}
    gaps: list[Gap] = []
    start = lower
    state = scan.state(lower)
    for a, b in [*edges, (upper, upper)]:
        following = scan.state(b)
        # A gap reaches to the nearest point that has an answer; a crossing sits in the middle of its bracket.
        end = upper if a == b else a if _undefined(following) else b if _undefined(state) else 0.5 * (a + b)
        if _undefined(state):
            gaps.append(Gap(start, end, _reason(scan, start, end)))
        else:
            intervals[state].append((start, end))
        if a != b and not _undefined(state) and not _undefined(following):
            crossings.append(Crossing(end, "loses" if following == "unstable" else "gains", 0.5 * (b - a)))
        start, state = end, following
    points = scan.points()
    return Boundaries(
        tuple(crossings), tuple(intervals["stable"]), tuple(intervals["unstable"]), tuple(gaps), len(points),
        read_only_any(np.array(points)), read_only_any(np.array([scan.values[x] for x in points])), lower, upper,
    )  # fmt: skip


def _reason(scan: _Scan, start: float, end: float) -> str:
    """The distinct reasons found inside a gap, in order."""
    reasons = [scan.reasons[x] for x in scan.points() if start <= x <= end and scan.reasons[x]]
    return "; ".join(list(dict.fromkeys(reasons))[:3])
