"""Every tongue of a loop over speed with its first-order and its computed centre and width, its cause and its cure.

Tongues are taken where perturbation theory puts them at each depth and followed on the pair's own exponents: what the
table says of a tongue rests on the exponents, and both engines verify each edge on either side and the onset.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import brentq

from maglev_ctrl.analysis.exponent_surface import SpeedSurface
from maglev_ctrl.analysis.floquet import Floquet, floquet
from maglev_ctrl.analysis.followed_tongue import FollowedTongue
from maglev_ctrl.analysis.resonance import Resonance, make_resonance
from maglev_ctrl.analysis.resonance_naming import name_instability
from maglev_ctrl.analysis.tongue_removal import TongueRemoval, feeding_shares, tongue_removal
from maglev_ctrl.analysis.tongue_search import (
    Crossing,
    Path,
    Track,
    find_crossings,
    polished,
)
from maglev_ctrl.analysis.tongue_widths import FirstOrder, gap_at
from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.errors import Agreement, ModelError
from maglev_ctrl.systems import PeriodicSystem

Elements = Callable[[float], Mapping[str, tuple[FloatArray, FloatArray]]]

_SAMPLES = 49
_BEYOND = 1.25  # tongues predicted to begin beyond this times the largest depth are asked once there and left
_SHARES = (1e-6, 1e-5, 1e-4, 1e-3, 1e-2)  # of the half-width (and of the onset) at which the engines are asked


@dataclass(frozen=True, eq=False, slots=True)
class TongueRow:
    """One tongue at one depth of modulation, over speed.

    `first_order`: centre and half-width by perturbation theory (m/s; half-width 0 below the threshold, NaN where the
    order has no first-order term). `computed`: centre and half-width of the unstable interval found by bisection on
    the multipliers, both edges verified by both engines; NaN with `reason` where there is none or they do not agree.
    `onset`: smallest unstable depth (inf: none up to the largest searched; NaN: the engines do not confirm it).
    `peak_growth`: of the pair at the computed centre, 1/s; NaN without one.
    `removal`: the damping that removes it, for overlapping tongues too; None where it is not there.
    `feeding`: share of each element's modulation.
    `needs`: sign condition on the couplings of a combination tongue in words; "" for parametric ones.
    """

    resonance: Resonance
    depth: float
    first_order_centre: float
    first_order_half_width: float
    computed_centre: float
    computed_half_width: float
    onset: float
    peak_growth: float
    removal: TongueRemoval | None
    feeding: tuple[tuple[str, float], ...]
    needs: str
    reason: str


def tongue_table(
    path: Path, *, depth: float, lower: float, upper: float, largest_depth: float, elements: Elements | None = None,
    max_order: int | None = None, removals: bool = True, surface: SpeedSurface | None = None,
) -> tuple[TongueRow, ...]:  # fmt: skip
    """Every tongue that crosses a range of speeds, in order of speed.

    Parameters
    ----------
    path : speed -> periodic system, its modulation at unit depth; ModelError and OutOfDomain mean "no answer there"
    depth : modulation depth at which widths, growth and removal are told
    lower, upper : m/s, positive
    largest_depth : end of the search for the onset
    elements : speed -> A_cos, A_sin of each element's modulation at unit depth, see `element_terms`
    max_order : largest order k of the tongues; twice the harmonics when left out
    removals : whether the damping that removes each tongue present at `depth` is computed
    surface : of this path over these speeds and at least these depths; made when left out

    Raises
    ------
    ValueError : depths or limits that are not positive and ascending
    ModelError : no speed of the range has an answer

    Examples
    --------
    >>> A_0, A_1 = [[0.0, 1.0], [-1.0, -0.02]], [[[0.0, 0.0], [-1.0, 0.0]]]
    >>> path = lambda v: PeriodicSystem.from_matrices(A_0, A_1, frequency=2.0 * v)
    >>> (row,) = tongue_table(path, depth=0.1, lower=0.8, upper=1.2, largest_depth=0.3, removals=False)
    >>> row.resonance.name, round(row.first_order_half_width, 5), round(row.computed_half_width, 5), round(row.onset, 6)
    ('2 w1/1', 0.02291, 0.02291, 0.04)
    """
    if not (0.0 < lower < upper < np.inf and 0.0 < depth <= largest_depth < np.inf):
        raise ValueError(
            f"speeds, depths: expected 0 < lower < upper and 0 < depth <= largest_depth, got {lower:g}, {upper:g}, "
            f"{depth:g}, {largest_depth:g}"
        )
    if surface is None:
        surface = SpeedSurface.of(path, lower=lower, upper=upper, largest_depth=largest_depth)
    base = Track(surface.smooth)
    good = np.array([v for v in np.linspace(lower, upper, _SAMPLES) if base.system(float(v)) is not None])
    if len(good) < 2:
        why = next(iter(base.faults.values()), "")
        raise ModelError(f"speeds: the model has no answer from {lower:g} to {upper:g} m/s: {why}")
    system = base.system(float(good[0]))
    assert system is not None
    harmonics = len(system.A_cos)
    crossings = [_refined(base, one, float(good[1] - good[0]), (lower, upper))
                 for one in find_crossings(base, good, max_order=max_order or 2 * harmonics)]  # fmt: skip
    rows = []
    for one in crossings:
        if base.system(one.at) is not None:
            tongue = FollowedTongue(base, surface, one, depth, largest_depth, (lower, upper))
            rows.append(_row(tongue, elements, removals))
    return tuple(sorted(rows, key=lambda row: row.first_order_centre))


def _refined(base: Track, one: Crossing, step: float, limits: tuple[float, float]) -> Crossing:
    """The crossing moved to where line and curve meet exactly, where they do."""
    low, high = max(limits[0], one.at - step), min(limits[1], one.at + step)
    ends = gap_at(base, one, low), gap_at(base, one, high)
    if not ends[0] * ends[1] < 0.0:
        return one

    def gap(speed: float) -> float:
        value = gap_at(base, one, speed)
        return value if np.isfinite(value) else ends[0]

    return replace(one, at=float(brentq(gap, low, high, xtol=1e-12 * one.at, rtol=1e-12)))


def _row(tongue: FollowedTongue, elements: Elements | None, removals: bool) -> TongueRow:
    one, theory = tongue.crossing, tongue.theory
    nan = float("nan")
    unit = tongue.base.system(one.at)
    assert unit is not None
    row = TongueRow(
        resonance=theory.resonance, depth=tongue.depth, first_order_centre=theory.centre if np.isfinite(theory.centre)
        else one.at, first_order_half_width=theory.half_width, computed_centre=nan, computed_half_width=nan,
        onset=nan, peak_growth=nan, removal=None, feeding=_feeding(unit, elements, one), needs=_needs(theory, one),
        reason="",
    )  # fmt: skip
    if min(theory.decay) < 0.0:
        return replace(row, onset=0.0, reason="one of its modes grows without modulation")
    predicted = tongue.unit.critical(_BEYOND) * tongue.largest_depth
    onset, doubt = _onset(tongue, predicted)
    if doubt and tongue.calm():
        onset, doubt = float("inf"), ""
    row = replace(row, onset=onset)
    if doubt or not onset < tongue.depth:
        return replace(row, reason=doubt or ("begins at a greater depth" if np.isfinite(onset) else
                                             f"none up to depth {tongue.largest_depth:g}"))  # fmt: skip
    centre, half, reason = _interval(tongue)
    if np.isfinite(half):
        pair = tongue.pair(centre, tongue.depth)
        row = replace(row, peak_growth=nan if pair is None else pair.growth)
    cure = None
    if removals and (np.isfinite(half) or reason.startswith("overlaps")):
        modes = (one.modes[0] + 1, one.modes[1] + 1)
        cure = tongue_removal(unit, one.kind, modes, order=one.order, depth=tongue.depth)
    return replace(row, computed_centre=centre, computed_half_width=half, removal=cure, reason=reason)


def _onset(tongue: FollowedTongue, predicted: float) -> tuple[float, str]:
    """Smallest unstable depth over speed, verified by both engines, and why it is not known."""
    largest, nan = tongue.largest_depth, float("nan")
    if not np.isfinite(predicted) and tongue.foreseen and not _seen(tongue):
        return float("inf"), ""
    if tongue.undamped:
        there = tongue.foreseen or tongue.peak(largest) > 0.0
        return (0.0 if there else float("inf")), ""
    high = min(1.02 * predicted, largest)
    while tongue.peak(high) <= 0.0:
        seen = tongue.window(high)
        if seen is None or not seen.smooth:
            return nan, "other tongues mix with it"
        if high >= largest:
            return float("inf"), ""
        high = min(1.3 * high, largest)
    if _mixed(tongue, high):
        return nan, "other tongues mix with it"
    low = 0.95 * high
    while tongue.peak(low) > 0.0:
        high, low = low, 0.6 * low
        if low < 1e-6 * largest:
            return nan, "the pair cannot be followed to small depths"
    if tongue.window(high) is None:
        return nan, "the pair cannot be followed"
    depth = float(brentq(tongue.peak, low, high, xtol=1e-9 * high, rtol=1e-9))
    window = tongue.window(depth)
    assert window is not None
    if not window.smooth:
        return nan, "other tongues mix with it"
    speed = window.top()[0]
    # growth is stationary over speed at its peak, so that the depth alone has to move
    depth = polished(lambda d: tongue.grown(speed, d), lambda d: tongue.sought(speed, d), depth, 1e-4 * depth)
    for share in _SHARES:
        below, above = depth * (1.0 - share), depth * (1.0 + share)
        if _grows(tongue, speed, below) is False and _grows(tongue, speed, above) is True:
            return depth, ""
    return nan, "the engines do not confirm the onset"


def _mixed(tongue: FollowedTongue, depth: float) -> bool:
    """Whether what is met at a depth is another tongue's doing: no smooth window, and another name at its top."""
    window = tongue.window(depth)
    if window is None or window.smooth:
        return False
    system = tongue.at(window.top()[0], depth)
    return system is None or name_instability(system).name != tongue.theory.resonance.name


def _seen(tongue: FollowedTongue) -> bool:
    """Whether a tongue that is not predicted is there all the same at the largest depth, by name."""
    speed = float(np.clip(tongue.predicted(tongue.largest_depth)[0], *tongue.limits))
    system = tongue.at(speed, tongue.largest_depth)
    found = tongue.surface.exponents(np.array([speed]), np.array([tongue.largest_depth]))
    if system is None or found is None or np.max(found[0].real) <= 0.0:
        return False
    return name_instability(system).name == tongue.theory.resonance.name


def _interval(tongue: FollowedTongue) -> tuple[float, float, str]:
    """Centre and half-width of the pair's unstable interval at the depth, both edges verified; or NaN and why."""
    nan, depth = float("nan"), tongue.depth
    window = tongue.window(depth)
    if window is None or window.top()[1] <= tongue.floor:
        return nan, nan, "the pair cannot be followed at this depth"
    top = window.top()[0]
    found = _covering(tongue, top)
    if found is None:
        return nan, nan, "the engines do not decide at its centre"
    if found.name != tongue.theory.resonance.name:
        return nan, nan, f"overlaps with {_bare(found)}"
    if (edges := window.edges(tongue.floor)) is None:
        mixed = "overlaps with other tongues: the pair has no edge of its own"
        return nan, nan, "reaches beyond the range of speeds" if window.smooth else mixed
    ends = []
    for rough in edges:
        speed = _edge(tongue, top, rough)
        if speed is None:
            return nan, nan, "the pair cannot be followed to its edge"
        doubt = _doubt(tongue, top, speed)
        if doubt:
            return nan, nan, doubt
        ends.append(speed)
    return 0.5 * (ends[0] + ends[1]), 0.5 * (ends[1] - ends[0]), ""


def _edge(tongue: FollowedTongue, top: float, rough: float) -> float | None:
    """The edge near a rough one, on the pair's own exponents."""

    def exact(speed: float) -> float:
        return tongue.grown(speed, tongue.depth)

    def sought(speed: float) -> float:
        return tongue.sought(speed, tongue.depth)

    # without damping growth leaves the floor as a square root does, which no step of Newton's follows
    growth = exact if tongue.undamped else sought
    for share in (1e-5, 1e-3, 1e-1):
        inner, outer = rough + share * (top - rough), rough - share * (top - rough)
        if growth(inner) > 0.0 > growth(outer):
            found = float(brentq(growth, inner, outer, xtol=1e-13 * abs(rough), rtol=1e-13))
            return found if tongue.undamped else polished(exact, sought, found, 1e-4 * abs(top - found))
    return None


def _doubt(tongue: FollowedTongue, top: float, edge: float) -> str:
    """Why an edge is not one: both engines asked just inside and just outside; "" when they confirm it."""
    for share in _SHARES:
        inside = _decided(tongue, edge + share * (top - edge), tongue.depth)
        outside = _decided(tongue, edge - share * (top - edge), tongue.depth)
        if inside is None or outside is None:
            return "the model has no answer at its edge"
        calm = outside.stable is True or (
            tongue.undamped
            and outside.agreement is Agreement.AGREED
            and abs(outside.growth_rate) <= outside.growth_error
        )
        if inside.stable is False and calm:
            return ""
        if outside.stable is False and share == _SHARES[-1]:
            other = _covering(tongue, edge - share * (top - edge))
            return f"overlaps with {'another tongue' if other is None else _bare(other)}"
    return "the engines do not confirm its edge"


def _decided(tongue: FollowedTongue, speed: float, depth: float) -> Floquet | None:
    system = tongue.at(speed, depth)
    return None if system is None else floquet(system)


def _grows(tongue: FollowedTongue, speed: float, depth: float) -> bool | None:
    """Whether the pair itself grows, beyond the error bound; None when the engines do not decide."""
    system, result = tongue.base.system(speed), _decided(tongue, speed, depth)
    if result is None or system is None or result.agreement is not Agreement.AGREED:
        return None
    W = float(system.frequency)
    pair = tongue.own(np.asarray(result.exponents), W, speed, depth)
    nearest = [
        int(np.argmin(np.abs(np.exp((result.exponents - one) * 2.0 * np.pi / W) - 1.0)))
        for one in (pair.one, pair.other)
    ]
    bound = float(np.max(result.error_bound[nearest]))
    return None if abs(pair.growth) <= bound else pair.growth > 0.0


def _covering(tongue: FollowedTongue, speed: float) -> Resonance | None:
    """The tongue that grows most at a speed; None where the engines do not decide."""
    system, result = tongue.at(speed, tongue.depth), _decided(tongue, speed, tongue.depth)
    if system is None or result is None or result.stable is not False:
        return None
    return name_instability(system, result)


def _bare(found: Resonance) -> str:
    """A tongue's name without the labels of its modes."""
    if found.kind == "none":
        return found.name
    i, j = found.modes
    return make_resonance(found.kind, found.order, (i, j), ("",) * max(i, j), frequency=found.frequency).name


def _feeding(unit: PeriodicSystem, elements: Elements | None, one: Crossing) -> tuple[tuple[str, float], ...]:
    if elements is None:
        return ()
    try:
        return tuple(feeding_shares(unit, elements(one.at), one).items())
    except ValueError as fault:
        if "couples" in str(fault):
            return ()
        raise


def _needs(theory: FirstOrder, one: Crossing) -> str:
    """The sign that a combination tongue needs of the product of its couplings, and the sign found."""
    if one.kind == "parametric":
        return ""
    i, j = one.modes[0] + 1, one.modes[1] + 1
    wanted = "< 0" if one.kind == "difference" else "> 0"
    told = f"needs d{i}{j} d{j}{i} {wanted}"
    if not np.isfinite(theory.product):
        return f"{told} of second order"
    found = -theory.product if one.kind == "difference" else theory.product
    if abs(found) == 0.0:
        return f"{told}, found 0"
    if abs(found.imag) > 1e-6 * abs(found):
        return f"{told}, found a phase of {round(float(np.degrees(np.angle(found))))} degrees"
    return f"{told}, found {'> 0' if found.real > 0.0 else '< 0'}"
