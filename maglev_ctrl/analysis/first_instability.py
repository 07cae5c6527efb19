"""The loss of stability nearest to a nominal point along a path of periodic systems, bracketed and verified.

The scan is seeded with the tongues predicted on the way (`tongue_search`), so that a narrow one is looked for where it
must be; what a scan of its step could still have missed is told as `missed_width`. Both ends of the bracket are
verified by both engines; what they do not decide is never told as stable.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Literal

import numpy as np

from maglev_ctrl.analysis.floquet import Floquet, floquet
from maglev_ctrl.analysis.resonance import NO_RESONANCE, Resonance
from maglev_ctrl.analysis.resonance_naming import name_instability
from maglev_ctrl.analysis.tongue_search import Crossing, Path, SoughtTongue, Track, find_crossings, locate
from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.errors import Agreement, NotStable

BoundKind = Literal["exact", "lower", "upper"]
Spacing = Literal["linear", "log"]

_PEAKS_CHECKED = 3  # stable places of most growth before the boundary that both engines have to confirm
_BISECTIONS = 50
_SHARES = (0.0, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 0.1, 0.5, 1.0)  # of the way from the boundary to where it is clear


@dataclass(frozen=True, eq=False, slots=True)
class PeriodicMargin:
    """How far one quantity may go from `nominal` towards `limit` before stability is lost.

    `safe` and `unsafe` bracket the loss, both verified by both engines; `unsafe` is NaN where none was found. `bound`:
    "exact" - the bracket, nothing nearer found; "lower" - stable as far as `safe`, where the search ended or the model
    or the engines gave no answer (`reason`); "upper" - lost at `unsafe` at the latest, a nearer place is undecided.
    `agreement` UNRESOLVED: no verified bracket, all NaN but what could be verified. `tongue` names the loss;
    `unmodulated` when the loop is unstable there without modulation too. An unstable interval narrower than
    `missed_width` (in the quantity; a ratio - 1 for a factor) could have been missed unless it is one of `sought`.
    """

    quantity: str
    nominal: float
    limit: float
    safe: float
    unsafe: float
    bound: BoundKind
    agreement: Agreement
    tongue: Resonance
    unmodulated: bool
    missed_width: float
    sought: tuple[SoughtTongue, ...]
    evaluated: int
    reason: str

    @property
    def value(self) -> float:
        """The margin: the safe end of the bracket ("exact", "lower"), the unsafe end ("upper"), NaN unresolved."""
        if self.agreement is Agreement.UNRESOLVED:
            return float("nan")
        return self.unsafe if self.bound == "upper" else self.safe

    @property
    def text(self) -> str:
        """The result in words."""
        name = "unstable without modulation" if self.unmodulated else self.tongue.name
        if self.agreement is Agreement.UNRESOLVED:
            return f"{self.quantity}: UNRESOLVED, {self.reason}"
        if self.bound == "lower":
            return f"{self.quantity}: stable as far as {self.safe:.6g} ({self.reason})"
        if self.bound == "upper":
            return f"{self.quantity}: lost at {self.unsafe:.6g} at the latest ({name}; {self.reason})"
        return f"{self.quantity}: lost between {self.safe:.6g} and {self.unsafe:.6g} ({name})"


def first_instability(
    path: Path, *, nominal: float, limit: float, quantity: str = "parameter", samples: int = 48,
    max_order: int | None = None, tolerance: float = 1e-6, spacing: Spacing = "linear",
    extra: tuple[Crossing, ...] = (),
) -> PeriodicMargin:  # fmt: skip
    """The loss of stability nearest to `nominal` on the way to `limit`, with both ends of its bracket verified.

    Parameters
    ----------
    path : parameter -> periodic system (at its actual depth); ModelError and OutOfDomain mean "no answer there"
    nominal, limit : start and end of the search, in either order
    quantity : name of the parameter, for the text
    samples : scan points; predicted tongues and local maxima of growth come on top
    max_order : largest order k of tongues sought; twice the harmonics (at least 2) when left out
    tolerance : width of the bracket relative to the distance from `nominal`, where the engines can tell
    spacing : "log" for factors
    extra : more predicted tongues

    Raises
    ------
    NotStable : unstable at `nominal`
    ValueError : nominal equals limit, too few samples, or a log spacing through zero

    Examples
    --------
    >>> from maglev_ctrl.systems import PeriodicSystem
    >>> A_0, A_1 = [[0.0, 1.0], [-1.0, -1e-4]], [[[0.0, 0.0], [-1e-3, 0.0]]]
    >>> path = lambda W: PeriodicSystem.from_matrices(A_0, A_1, frequency=W)
    >>> found = first_instability(path, nominal=1.5, limit=2.7, samples=9)     # the tongue is 300 times narrower
    >>> round(found.value, 4), found.tongue.name, found.bound
    (1.9995, '2 w1/1', 'exact')
    """
    _check(nominal, limit, samples, spacing)
    to, back = (np.exp, np.log) if spacing == "log" else (_same, _same)
    search = _Search(Track(lambda x: path(float(to(x)) if x != back(nominal) else nominal)), float(back(nominal)))
    result = search.run(float(back(limit)), samples, max_order, tolerance, extra)
    missed = float(np.expm1(result.missed_width)) if spacing == "log" else result.missed_width
    sought = tuple(replace(one, at=float(to(one.at)), width=one.width * (float(to(one.at)) if spacing == "log" else 1))
                   for one in result.sought)  # fmt: skip
    return replace(result, quantity=quantity, nominal=nominal, limit=limit, safe=float(to(result.safe)),
                   unsafe=float(to(result.unsafe)), missed_width=missed, sought=sought)  # fmt: skip


@dataclass(slots=True, eq=False)
class _Search:
    """One search away from `start`; parameters are those of the track (logarithms for factors)."""

    track: Track
    start: float

    def run(
        self, limit: float, samples: int, max_order: int | None, tolerance: float, extra: tuple[Crossing, ...]
    ) -> PeriodicMargin:
        here = floquet(self.track.path(self.start))
        if here.stable is False:
            name = name_instability(self.track.path(self.start), here).name
            raise NotStable(f"unstable at the nominal point ({name}): no margin can be told")
        if here.stable is None:
            return self._told(limit, "lower", reason="the engines do not decide the nominal point", resolved=False)
        places, fault = self._scan(np.linspace(self.start, limit, samples))
        sought = self._seek(places, max_order, extra)
        self._climb()
        bad = [p for p in self._ordered() if self.track.points[p].unstable]
        if not bad:
            return self._stable_to_the_end(limit, fault, sought)
        return self._bracket(limit, bad[0], tolerance, sought)

    def _ordered(self) -> list[float]:
        """Places with an answer, nearest to the start first."""
        known = [p for p, point in self.track.points.items() if point.system is not None]
        return sorted(known, key=lambda p: abs(p - self.start))

    def _scan(self, grid: FloatArray) -> tuple[FloatArray, str]:
        """Places as far as the first unstable one, or as far as the model has answers, and why it ends there."""
        for k, place in enumerate(grid):
            point = self.track.point(float(place))
            if point.system is None:
                good, bad = float(grid[k - 1]), float(place)
                for _ in range(20):
                    middle = 0.5 * (good + bad)
                    good, bad = (middle, bad) if self.track.point(middle).system is not None else (good, middle)
                end = [] if good == grid[k - 1] else [good]
                return np.array([*grid[:k], *end]), f"no model beyond: {point.fault}"
            if point.unstable:
                return grid[: k + 1], ""
        return grid, ""

    def _seek(self, places: FloatArray, max_order: int | None, extra: tuple[Crossing, ...]) -> tuple[SoughtTongue, ...]:
        system = self.track.point(self.start).system
        harmonics = 1 if system is None else len(system.A_cos)
        if len(places) < 2:
            return ()
        lower, upper = float(np.min(places)), float(np.max(places))
        step = float(np.max(np.abs(np.diff(places))))
        crossings = [*find_crossings(self.track, places, max_order=max_order or 2 * harmonics), *extra]
        found = []
        for one in crossings:
            if lower <= one.at <= upper:
                seen = locate(self.track, one, lower=max(lower, one.at - step), upper=min(upper, one.at + step))
                found += [] if seen is None else [seen]
        return tuple(sorted(found, key=lambda t: abs(t.at - self.start)))

    def _climb(self) -> None:
        """Follows the local maxima of growth nearer than the first unstable place to their tops."""
        order = self._ordered()
        growth = [self.track.points[p].growth for p in order]
        for k in range(1, len(order) - 1):
            if self.track.points[order[k]].unstable:
                break
            if growth[k] >= growth[k - 1] and growth[k] > growth[k + 1]:
                self.track.highest(*sorted((order[k - 1], order[k + 1])), steps=12)

    def _stable_to_the_end(self, limit: float, fault: str, sought: tuple[SoughtTongue, ...]) -> PeriodicMargin:
        doubt = self._doubtful(self._ordered())
        reachable = [p for p in self._ordered() if doubt is None or abs(p - self.start) < abs(doubt - self.start)]
        for place in reversed(reachable[1:]):
            if self._verdict(place).stable is True:
                reason = fault or "the search ended"
                if doubt is not None or place != max(self._ordered(), key=lambda p: abs(p - self.start)):
                    reason = "beyond it the engines do not decide"
                return self._told(limit, "lower", safe=place, reason=reason, sought=sought)
        return self._told(limit, "lower", reason="the engines decide nowhere on the way", resolved=False, sought=sought)

    def _bracket(
        self, limit: float, unstable: float, tolerance: float, sought: tuple[SoughtTongue, ...]
    ) -> PeriodicMargin:
        order = self._ordered()
        stable = order[order.index(unstable) - 1]
        good, bad = stable, unstable
        for _ in range(_BISECTIONS):
            if abs(bad - good) <= 0.25 * tolerance * max(abs(bad - self.start), 1e-12 * abs(self.start)):
                break
            middle = 0.5 * (good + bad)
            good, bad = (good, middle) if self.track.point(middle).unstable else (middle, bad)
        safe = self._towards(good, stable, wanted=True)
        unsafe = self._towards(bad, unstable, wanted=False)
        if safe is None or unsafe is None:
            return self._told(limit, "lower", reason="the engines do not confirm both ends", resolved=False,
                              sought=sought)  # fmt: skip
        result = self._verdict(unsafe)
        system = self.track.path(unsafe)
        alone = bool(np.max(np.linalg.eigvals(system.A_0).real) > 0.0)
        name = NO_RESONANCE if alone else name_instability(system, result)
        doubt = self._doubtful([p for p in order if abs(p - self.start) <= abs(safe - self.start)])
        return self._told(
            limit, "exact" if doubt is None else "upper", safe=safe if doubt is None else self.start, unsafe=unsafe,
            tongue=name, unmodulated=alone, sought=sought,
            reason="" if doubt is None else "the engines do not decide a nearer place",
        )  # fmt: skip

    def _towards(self, place: float, known: float, *, wanted: bool) -> float | None:
        """The place nearest to `place`, on the way to `known`, where both engines give the wanted verdict."""
        for share in _SHARES:
            tried = place + share * (known - place)
            if self._verdict(tried).stable is wanted:
                return float(tried)
        return None

    def _verdict(self, place: float) -> Floquet:
        return floquet(self.track.path(place))

    def _doubtful(self, places: list[float]) -> float | None:
        """The nearest of the least stable places whose stability the engines do not confirm; None when all are."""
        inner = places[1:]
        growth = [self.track.points[p].growth for p in inner]
        tops = [p for k, p in enumerate(inner) if growth[k] == max(growth[max(k - 1, 0) : k + 2])]
        worst = sorted(tops, key=lambda p: -self.track.points[p].growth)[:_PEAKS_CHECKED]
        doubts = [p for p in worst if self._verdict(p).stable is not True]
        return min(doubts, key=lambda p: abs(p - self.start)) if doubts else None

    def _told(
        self, limit: float, bound: BoundKind, *, safe: float = float("nan"), unsafe: float = float("nan"),
        tongue: Resonance = NO_RESONANCE, unmodulated: bool = False, reason: str = "", resolved: bool = True,
        sought: tuple[SoughtTongue, ...] = (),
    ) -> PeriodicMargin:  # fmt: skip
        end = unsafe if np.isfinite(unsafe) else safe
        passed = [p for p in self._ordered() if abs(p - self.start) <= abs(end - self.start)]
        gaps = [abs(b - a) for a, b in pairwise(passed)]
        reach = abs(end - self.start)
        near = tuple(t for t in sought if not np.isfinite(end) or abs(t.at - self.start) - t.width <= reach)
        return PeriodicMargin(
            "", self.start, limit, safe, unsafe, bound, Agreement.AGREED if resolved else Agreement.UNRESOLVED,
            tongue, unmodulated, max(gaps, default=float("nan")), near, len(self.track.points), reason,
        )  # fmt: skip


def _check(nominal: float, limit: float, samples: int, spacing: Spacing) -> None:
    if not (np.isfinite(nominal) and np.isfinite(limit) and nominal != limit):
        raise ValueError(f"limit: expected a finite value other than the nominal one, got {nominal} and {limit}")
    if samples < 3:
        raise ValueError(f"samples: expected at least 3, got {samples}")
    if spacing == "log" and min(nominal, limit) <= 0.0:
        raise ValueError(f"limit: expected positive factors, got {nominal} and {limit}")


def _same(value: float) -> float:
    return value
