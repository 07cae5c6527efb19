"""Least collocated damping that certifies a decay rate at every vertex of a family, or for every blend of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from maglev_ctrl.arrays import FloatArray, read_only, read_only_any
from maglev_ctrl.errors import Status
from maglev_ctrl.synthesis.damping.certified import GUARANTEES, Guarantee, MoreDamping, assurance, more_damping
from maglev_ctrl.synthesis.damping.descent import PoleBound, excesses, least_cost, starting_points, trace_bound
from maglev_ctrl.synthesis.damping.followed import followed_damping
from maglev_ctrl.synthesis.damping.places import DampedFamily, DampingPlace, Scales, damped_family, scaled
from maglev_ctrl.synthesis.damping.restriction import restricted_damping
from maglev_ctrl.synthesis.result import Performance, Synthesis, proven, refused
from maglev_ctrl.systems import SecondOrderSystem
from maglev_ctrl.systems.plant import Plant

LAW = "collocated passive dampers"
RESERVE = 1e-3
"""Share of the decay rate kept in hand, so that the claim is strict."""
FLOOR = 1e-5
"""The same in parts of the fastest pole, for decay rates near zero."""
HALVINGS = 5


@dataclass(frozen=True, eq=False, slots=True)
class Route:
    """One way to a damping: `damping` (k,) N s/m (NaN where it found none), its cost, and why it found none."""

    name: str
    damping: FloatArray
    cost: float
    reason: str = ""


@dataclass(frozen=True, eq=False, slots=True)
class DampingDesign:
    """Damping at each place, what it costs and what is proved of it.

    `damping` (k,) N s/m and `cost` are NaN where nothing was proved; `lower_bound` no damping is cheaper (sum of the
    poles); `carried` the strongest guarantee proved; `reason` why there is none, or why the guarantee asked for is not
    carried; `more` what more damping does; `synthesis` holds plants (forces to stroke rates), law, claims and proofs.
    """

    places: tuple[str, ...]
    damping: FloatArray
    cost: float
    rate: float
    lower_bound: float
    carried: Guarantee | None
    routes: tuple[Route, ...]
    more: tuple[MoreDamping, ...]
    synthesis: Synthesis
    reason: str = ""

    @property
    def certified(self) -> bool:
        """Damping was found and every claim about it proved."""
        return self.carried is not None

    @property
    def warnings(self) -> tuple[str, ...]:
        """Where more damping spoils what was certified; empty where it does not."""
        return tuple(one.warning for one in self.more if one.warning)

    def require(self) -> DampingDesign:
        """This design where it is proved.

        Raises
        ------
        ModelError : nothing was proved, with the reason
        """
        self.synthesis.require()
        return self


def minimum_damping(
    vertices: Sequence[SecondOrderSystem] | Sequence[Plant],
    places: Sequence[DampingPlace],
    *,
    rate: float,
    ratio: float = 0.0,
    guarantee: Guarantee = "each vertex",
    starts: int = 8,
) -> DampingDesign:
    """Cheapest damping c >= 0 found with all poles of all vertices left of -rate, certified afterwards.

    Three ways: a convex restriction (second-order vertices), descents from many starts on the poles themselves, and
    for a guarantee between vertices the bilinear inequality followed from their results. The cheapest whose claims
    are proved is kept; the minimum itself is not proved, `lower_bound` tells how far off it can be.

    Parameters
    ----------
    vertices : speeds, gaps, payloads: second-order systems (any C and K, circulatory ones too) or plants with ports
    rate : 1/s, at least 0 (0: stability)
    ratio : least damping ratio of every pole, below 1 (0: none asked); proved vertex by vertex
    guarantee : "each vertex", "every constant blend" of the vertices' state matrices, or "any variation" between them
    starts : descents

    Raises
    ------
    ValueError : a rate below zero, a ratio not in [0, 1), an unknown guarantee, or as in `damped_family`
    ModelError : as in `damped_family`

    Examples
    --------
    >>> mass = SecondOrderSystem.from_matrices([[2.0]], [[0.0]], [[8.0]])
    >>> design = minimum_damping([mass], [DampingPlace("leg", [1.0])], rate=0.5)
    >>> round(design.cost, 2), round(design.lower_bound, 6), design.carried  # c = 2 m rate
    (2.0, 2.0, 'any variation')
    """
    if guarantee not in GUARANTEES:
        raise ValueError(f"guarantee: expected {', '.join(GUARANTEES)}, got {guarantee!r}")
    return designed(damped_family(vertices, places), rate, ratio=ratio, guarantee=guarantee, starts=starts)


def undone(family: DampedFamily, rate: float, reason: str) -> DampingDesign:
    """The record of a point that was not tried, for a reason.

    Examples
    --------
    >>> mass = SecondOrderSystem.from_matrices([[2.0]], [[0.0]], [[8.0]])
    >>> undone(damped_family([mass], [DampingPlace("leg", [1.0])]), 0.5, "out of time").certified
    False
    """
    return _refused(family, rate, np.nan, (), reason, Status.TIME_LIMIT)


def designed(
    family: DampedFamily,
    rate: float,
    *,
    ratio: float = 0.0,
    guarantee: Guarantee = "each vertex",
    starts: int = 8,
    warm: FloatArray | None = None,
) -> DampingDesign:
    """`minimum_damping` of a family, warm-started where a neighbouring solution (k,) N s/m is known.

    Examples
    --------
    >>> mass = SecondOrderSystem.from_matrices([[2.0]], [[0.0]], [[8.0]])
    >>> family = damped_family([mass], [DampingPlace("leg", [1.0])])
    >>> designed(family, 2.5).reason[:40]  # the mass decays at 2 1/s at most
    'no damping was found that decays at 2.5 '
    """
    if not (np.isfinite(rate) and rate >= 0.0):
        raise ValueError(f"rate: expected a decay rate of at least 0 1/s, got {rate!r}")
    if not 0.0 <= ratio < 1.0:
        raise ValueError(f"ratio: expected a damping ratio of at least 0 and below 1, got {ratio!r}")
    small, scales = scaled(family)
    lower = trace_bound(small, rate / scales.rate) * scales.cost
    if not np.isfinite(lower):
        reason = f"the dampers' limits are too low for a decay at {rate:g} 1/s: the sum of the poles forbids it"
        return _refused(family, rate, lower, (), reason)
    routes = _routes(family, small, scales, (rate, ratio), guarantee, starts, warm)
    design, told = _first_proved(family, scales, (rate, ratio), lower, guarantee, routes, routes)
    if design is None and guarantee == "every constant blend" and told:
        # The cheapest dampings hold at the vertices only: one P for all of them holds every blend.
        more = _followed(family, small, scales, rate * (1.0 + RESERVE) + FLOOR * scales.rate, routes)
        routes += more
        design, extra = _first_proved(family, scales, (rate, ratio), lower, guarantee, more, routes)
        told += extra
        if design is not None:
            nearer = _nearer(family, scales, (rate, ratio), guarantee, routes, design)
            if nearer:
                routes += nearer
                design = _first_proved(family, scales, (rate, ratio), lower, guarantee, nearer, routes)[0] or design
    if design is not None:
        return design
    ratio_too = f" with a damping ratio of {ratio:g}" if ratio else ""
    reason = f"no damping was found that decays at {rate:g} 1/s{ratio_too}"
    reason += "".join(f"; {route.name}: {route.reason}" for route in routes)
    if told:
        reason = f"not proved for {guarantee}: {'; '.join(told)}"
    return _refused(family, rate, lower, routes, reason, Status.NOT_VERIFIED if told else Status.INFEASIBLE)


def _first_proved(
    family: DampedFamily,
    scales: Scales,
    margins: tuple[float, float],
    lower: float,
    guarantee: Guarantee,
    routes: tuple[Route, ...],
    tried: tuple[Route, ...],
) -> tuple[DampingDesign | None, tuple[str, ...]]:
    """The cheapest route whose guarantee is proved, and why cheaper ones are not it."""
    (rate, ratio), told = margins, list[str]()
    for route in sorted((route for route in routes if not route.reason), key=lambda route: route.cost):
        held = assurance(family, route.damping, rate, scales.T, wanted=guarantee, ratio=ratio)
        if held.carried is None or GUARANTEES.index(held.carried) < GUARANTEES.index(guarantee):
            told += [f"{route.name}: {why}" for why in held.reasons]
            continue
        worst = float(np.max(family.abscissae(route.damping)))
        synthesis = proven(
            LAW, family.plants, [family.law(route.damping)], claims=held.claims,
            performance=[Performance("least decay rate", np.nan, -worst, "1/s")],
            notes=_notes(family, route, lower, held.carried, held.reasons),
        )  # fmt: skip
        if not synthesis.controllers:
            told.append(f"{route.name}: {synthesis.message}")
            continue
        more = more_damping(family, route.damping, rate, scales.T, ratio=ratio)
        damping = read_only(route.damping, name="damping")
        return DampingDesign(
            family.places, damping, route.cost, rate, lower, held.carried, tried, more, synthesis
        ), tuple(told)  # fmt: skip
    return None, tuple(told)


def _nearer(
    family: DampedFamily, scales: Scales, margins: tuple[float, float], guarantee: Guarantee,
    routes: tuple[Route, ...], design: DampingDesign,
) -> tuple[Route, ...]:  # fmt: skip
    """On the way from the cheapest damping without the guarantee to the proved one: the cheapest with it, halving."""
    cheapest = min((route for route in routes if not route.reason), key=lambda route: route.cost)
    low, high = 0.0, 1.0
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        c = cheapest.damping + middle * (design.damping - cheapest.damping)
        held = assurance(family, c, margins[0], scales.T, wanted=guarantee, ratio=margins[1])
        carried = held.carried is not None and GUARANTEES.index(held.carried) >= GUARANTEES.index(guarantee)
        low, high = (low, middle) if carried else (middle, high)
    if high == 1.0:
        return ()
    c = cheapest.damping + high * (design.damping - cheapest.damping)
    return (_route(f"between {cheapest.name} and the proved one", family, c, ""),)


def _followed(
    family: DampedFamily, small: DampedFamily, scales: Scales, inside: float, routes: tuple[Route, ...]
) -> tuple[Route, ...]:
    """One P for all vertices, followed from every damping found so far."""
    found = []
    for route in routes:
        if not route.reason:
            followed, why = followed_damping(small, inside / scales.rate, route.damping / scales.damping)
            c = None if followed is None else followed * scales.damping
            found.append(_route(f"inequality followed from the {route.name}", family, c, why))
    return tuple(found)


def _routes(
    family: DampedFamily,
    small: DampedFamily,
    scales: Scales,
    margins: tuple[float, float],
    guarantee: Guarantee,
    starts: int,
    warm: FloatArray | None,
) -> tuple[Route, ...]:
    rate, ratio = margins
    inside = rate * (1.0 + RESERVE) + FLOOR * scales.rate
    between = guarantee == "any variation" and len(family.plants) > 1
    # A neighbour's solution spares the inequalities: the descent from it is as good, and much faster.
    routes: list[Route] = []
    convex: FloatArray | None = None
    if warm is None or between:
        convex, why = restricted_damping(family, inside, scales.rate, common=between)
        if convex is not None and excesses(family, convex, PoleBound(-rate, ratio)) > 0.0:
            convex, why = None, "its solution misses the damping ratio" if ratio else "its solution is not accurate"
        routes.append(_route("convex restriction", family, convex, why))
    points = [] if warm is None else [warm / scales.damping, 1.1 * warm / scales.damping]
    points += [] if convex is None else [convex / scales.damping]
    bound = PoleBound(-inside / scales.rate, ratio + RESERVE * min(ratio, 1.0 - ratio))
    ends = least_cost(small, bound, points + starting_points(small, starts))
    bare = np.where(ends[0].c > 1e-8, ends[0].c, 0.0)
    best = bare if excesses(small, bare, bound) <= 1e-10 else ends[0].c  # the reserve is far larger
    descent = best * scales.damping if ends[0].excess <= 0.0 else None
    outside = ends[0].excess * scales.rate
    routes.append(_route("pole descent", family, descent, f"the best end leaves a pole {outside:.3g} 1/s outside"))
    return (*routes, *_followed(family, small, scales, inside, tuple(routes))) if between else tuple(routes)


def _route(name: str, family: DampedFamily, c: FloatArray | None, why: str) -> Route:
    if c is None:
        return Route(name, read_only_any(np.full(len(family.cost), np.nan)), np.nan, why)
    return Route(name, read_only(c, name="damping"), float(family.cost @ c))


def _notes(
    family: DampedFamily, route: Route, lower: float, carried: Guarantee, reasons: tuple[str, ...]
) -> tuple[str, ...]:
    chosen = ", ".join(f"{name} {value:.4g} N s/m" for name, value in zip(family.places, route.damping, strict=True))
    told = [f"{route.name}: {chosen}; cost {route.cost:.4g}, no damping costs less than {lower:.4g}"]
    if len(family.plants) > 1:
        told.append(f"proved for {carried}")
    return (*told, *reasons)


def _refused(
    family: DampedFamily, rate: float, lower: float, routes: tuple[Route, ...], reason: str,
    status: Status = Status.INFEASIBLE,
) -> DampingDesign:  # fmt: skip
    nothing = read_only_any(np.full(len(family.cost), np.nan))
    synthesis = refused(LAW, family.plants, status, reason)
    return DampingDesign(family.places, nothing, np.nan, rate, lower, None, routes, (), synthesis, reason)
