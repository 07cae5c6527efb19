"""What removes a tongue: the damping it takes, and the element whose modulation feeds it.

Damping is added to modes: the decay rate of mode m grows by zeta |s_m|, its frequency and its shape stay. The closed
form is Hsu's: with decay rates a, b and the product g of the two couplings, a tongue is gone over all detunings when
2 (a + zeta_i w_i) (b + zeta_j w_j) = |g| + Re g. The exact value is found on the Floquet exponents: on those of the
pair first, and where others grow within the tongue's width, on all of them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from maglev_ctrl.analysis.damped_pair import DampedPair, Damping, coupling_degree
from maglev_ctrl.analysis.resonance import (
    ResonanceKind,
    StateModes,
    make_resonance,
    modal_harmonics,
    pair_indices,
    pair_interval,
    resonant_pairs,
    state_modes,
)
from maglev_ctrl.analysis.resonance_seeds import pair_coupling
from maglev_ctrl.analysis.tongue_search import Crossing, pair_at
from maglev_ctrl.arrays import ComplexArray, FloatArray
from maglev_ctrl.errors import Agreement
from maglev_ctrl.systems import PeriodicSystem, SecondOrderSystem, at_depth
from maglev_ctrl.vehicle import ElementModulation

_WIDER = 1.05  # a half-width beyond this times the present one is warned of; equal ratios alone make some of it
_NEAR = 1.25  # a tongue that begins up to this times the depth is named as one of a crowd
_BRACKETS = (1e-5, 1e-4, 1e-3, 1e-2)  # relative distances from the removing damping at which the engines are asked


@dataclass(frozen=True, slots=True)
class Removal:
    """Smallest damping ratio, added to `modes` (counted from 1), that removes a tongue.

    `closed_form`: Hsu's (inf: no damping of these modes does it). `safe`: with this ratio no exponent of the whole loop
    grows at any passing frequency within the tongue's width, whichever pair it belongs to. The width: about the peaks
    of the pair without and with damping, to either side the half-width over which the pair locks without damping, or
    the present first-order one if that is wider (twice as far where couplings of unlike phase make the tongue lean).
    It is read at 801 places and closed in on at its peaks; there, and about the pair's peak, both engines verify it. A
    tongue narrower than a step of that can be missed. `unsafe`: both engines find the loop growing. safe is inf where
    the tongue is still there at the largest ratio tried. NaN with agreement UNRESOLVED where the engines do not confirm
    it, or where something else grows within the width up to the largest ratio: `TongueRemoval.crowd` names it. Modes
    without any damping, which stay so, are left aside.

    `widening`: largest first-order half-width met on the way over the present one; `warning` in words when damping
    first widens the tongue, or when something else goes on growing.
    """

    modes: tuple[int, ...]
    closed_form: float
    unsafe: float
    safe: float
    agreement: Agreement
    widening: float
    warning: str


@dataclass(frozen=True, slots=True)
class TongueRemoval:
    """One tongue at one depth: its `name`, `frequency` (rad/s) of exact resonance, `growth` (1/s) at its peak.

    `equal`: the same ratio added to both modes. `alone`: to either mode of a combination tongue alone. `crowd`: other
    tongues within its width that first-order theory finds there, or within a quarter of their depth of beginning, with
    the damping as it is or as it is added on the way. Their exponents mix with this pair's: `growth` then speaks of the
    two exponents nearest to it, the removing ratios of all.
    """

    name: str
    crossing: Crossing
    depth: float
    frequency: float
    growth: float
    equal: Removal
    alone: tuple[Removal, ...]
    crowd: tuple[str, ...]


def tongue_removals(
    system: PeriodicSystem, *, depth: float, max_order: int | None = None, largest: float = 1.0
) -> tuple[TongueRemoval, ...]:
    """The damping that removes each tongue present at a depth, over all passing frequencies.

    Parameters
    ----------
    system : one periodic system, its modulation at unit depth
    depth : modulation depth
    max_order : largest order k; twice the harmonics when left out
    largest : largest damping ratio tried

    Raises
    ------
    ValueError : a depth or a largest ratio that is not positive

    Examples
    --------
    >>> mathieu = PeriodicSystem.from_matrices([[0, 1], [-1, -0.02]], [[[0, 0], [-1, 0]]], frequency=2.0)
    >>> found = tongue_removals(mathieu, depth=0.1, max_order=1)[0]
    >>> found.name, round(found.equal.closed_form, 4), round(found.equal.safe, 4)
    ('2 w1/1', 0.015, 0.015)
    """
    orders = range(1, (max_order or 2 * len(system.A_cos)) + 1)
    scaled = at_depth(system, depth)
    count = len(state_modes(system.A_0).oscillating)
    found = []
    for kind, i, j in resonant_pairs(count):
        for order in orders:
            known = pair_at(scaled, Crossing(kind, (i, j), order, 0.0))
            if known is not None and known[0].critical(1.0) <= 1.0:
                found.append(tongue_removal(system, kind, (i + 1, j + 1), order=order, depth=depth, largest=largest))
    return tuple(sorted(found, key=lambda t: t.frequency))


def tongue_removal(
    system: PeriodicSystem, kind: ResonanceKind, modes: tuple[int, int], *, order: int, depth: float,
    largest: float = 1.0,
) -> TongueRemoval:  # fmt: skip
    """The damping that removes one tongue, see `tongue_removals`.

    Parameters
    ----------
    kind, modes, order : the tongue; modes counted from 1
    depth, largest : see `tongue_removals`

    Raises
    ------
    ValueError : no such pair of modes, or a depth or a largest ratio that is not positive
    """
    if not (depth > 0.0 and largest > 0.0):
        raise ValueError(f"depth, largest: expected positive values, got {depth} and {largest}")
    low, high = sorted(modes)
    crossing = Crossing(kind, (low - 1, high - 1), order, 0.0)
    scaled = at_depth(system, depth)
    known = pair_at(scaled, crossing) if low >= 1 and order >= 1 else None
    if known is None:
        raise ValueError(f"modes: expected two of the oscillating modes and an order from 1, got {modes}, {order}")
    pair, first = DampedPair.of(scaled, crossing), known[1]
    crossing = replace(crossing, at=pair.frequency)
    present = pair.peak((0.0, 0.0))
    ways = [((low, high) if low != high else (low,), (1.0, 1.0))]
    ways += [] if low == high else [((mode,), pair.weights_of(mode)) for mode in (low, high)]
    found = [_removal(pair, which, share, largest, present) for which, share in ways]
    asked = [(0.0, 0.0), *(added for _, more in found for added in more)]
    names = dict.fromkeys(name for added in asked for name in _crowd(pair, added))
    name = make_resonance(kind, order, (low, high), first.labels, frequency=pair.frequency).name
    return TongueRemoval(name, crossing, depth, pair.frequency, present[0], found[0][0],
                         tuple(one for one, _ in found[1:]), tuple(names))  # fmt: skip


def _crowd(pair: DampedPair, added: tuple[float, float]) -> tuple[str, ...]:
    """Names of the other tongues that reach into this one's width, there or about to be with decay rates added, 1/s."""
    middle, half, own = pair.frequency, pair.half_width(), pair.crossing
    system = pair.damped(added, pair.frequency)
    modes = state_modes(system.A_0, states=system.states)
    harmonics = modal_harmonics(modes, system.A_cos, system.A_sin)
    names = []
    for kind, i, j in resonant_pairs(len(modes.oscillating)):
        first, second, distance = pair_indices(modes, kind, i, j)
        for order in range(1, 2 * len(system.A_cos) + 1):
            frequency = distance / order
            same = (kind, (i, j), order) == (own.kind, own.modes, own.order)
            direct = harmonics[order][first, second] * harmonics[-order][second, first] if order in harmonics else 0.0
            if same or abs(frequency - middle) > half + 2.0 * np.sqrt(abs(direct)) / order:
                continue
            known = pair_coupling(modes, harmonics, first=first, second=second, order=order, frequency=frequency)
            if known.critical(_NEAR) > _NEAR:
                continue
            names.append(make_resonance(kind, order, (i + 1, j + 1), modes.labels, frequency=frequency).name)
    return tuple(names)


def element_terms(system: SecondOrderSystem, modulation: ElementModulation) -> dict[str, tuple[FloatArray, FloatArray]]:
    """A_cos, A_sin (H, nx, nx) of each element's modulation in the state matrix of a vehicle, open or closed loop.

    Parameters
    ----------
    system : the vehicle's linear model, loop closed or not
    modulation : from `maglev_ctrl.vehicle.element_modulation`
    """

    def harmonics(K: FloatArray) -> FloatArray:
        return np.stack([system.modulated_state_matrix(part) for part in K])

    return {
        name: (harmonics(modulation.K_cos[e]), harmonics(modulation.K_sin[e]))
        for e, name in enumerate(modulation.names)
    }


def feeding_shares(
    system: PeriodicSystem, elements: Mapping[str, tuple[FloatArray, FloatArray]], crossing: Crossing
) -> dict[str, float]:
    """The share of each element's modulation in the product of couplings that feeds a tongue; they add up to one.

    The product is x_ij x_ji; an element's share is the real part of (x_ij^e x_ji + x_ij x_ji^e)/(2 x_ij x_ji), x^e the
    part of the coupling that its modulation makes. A negative share works against the tongue. Where no harmonic couples
    the pair directly, x is the second-order coupling, and x^e the half of its derivative.

    Parameters
    ----------
    system : periodic system whose modulation is the sum of the elements'
    elements : A_cos, A_sin (H, n, n) of each element, see `element_terms`
    crossing : the tongue, see `TongueRemoval.crossing`

    Raises
    ------
    ValueError : the elements do not add up to the modulation, or nothing couples the pair to second order

    Examples
    --------
    >>> front, rear = np.array([[[0, 0], [-0.3, 0]]]), np.array([[[0, 0], [-0.1, 0]]])
    >>> mathieu = PeriodicSystem.from_matrices([[0, 1], [-1, -0.02]], front + rear, frequency=2.0)
    >>> terms = {"front": (front, 0 * front), "rear": (rear, 0 * rear)}
    >>> {k: round(v, 9) for k, v in feeding_shares(mathieu, terms, Crossing("parametric", (0, 0), 1, 2.0)).items()}
    {'front': 0.75, 'rear': 0.25}
    """
    size = float(np.max(np.abs(system.A_cos)) + np.max(np.abs(system.A_sin)))
    for total, parts in ((system.A_cos, [e[0] for e in elements.values()]),
                         (system.A_sin, [e[1] for e in elements.values()])):  # fmt: skip
        if not parts or np.max(np.abs(np.sum(parts, axis=0) - total)) > 1e-9 * size:
            raise ValueError("elements: expected their modulations to add up to that of the system")
    modes = state_modes(system.A_0, states=system.states)
    if max(crossing.modes) >= len(modes.oscillating):
        raise ValueError(f"crossing: expected two of {len(modes.oscillating)} oscillating modes")
    whole = modal_harmonics(modes, system.A_cos, system.A_sin)
    x, degree = _coupling(modes, whole, crossing)
    strength = abs(x[0] * x[1])
    if not strength > 1e-14 * max(float(np.max(np.abs(B))) for B in whole.values()) ** 2:
        raise ValueError("crossing: nothing couples this pair to second order in the modulation")
    shares = {}
    for name, (A_cos, A_sin) in elements.items():
        part = modal_harmonics(modes, A_cos, A_sin)
        more, _ = _coupling(modes, {q: whole[q] + part[q] for q in whole}, crossing, degree)
        less, _ = _coupling(modes, {q: whole[q] - part[q] for q in whole}, crossing, degree)
        # The coupling is of first or second degree in the modulation: the central difference is its derivative.
        own = [(up - down) / (2.0 * degree) for up, down in zip(more, less, strict=True)]
        shares[name] = float(((own[0] * x[1] + x[0] * own[1]) / (2.0 * x[0] * x[1])).real)
    return shares


def _coupling(
    modes: StateModes, harmonics: dict[int, ComplexArray], crossing: Crossing, degree: int | None = None
) -> tuple[tuple[complex, complex], int]:
    """The two couplings of a pair and their degree in the modulation: direct, or second order where there is none."""
    first, second, distance = pair_indices(modes, crossing.kind, *crossing.modes)
    pair = pair_coupling(
        modes, harmonics, first=first, second=second, order=crossing.order, frequency=distance / crossing.order
    )
    chosen = degree or coupling_degree(pair, harmonics)
    return (pair.direct if chosen == 1 else pair.indirect), chosen


_Told = tuple[Removal, tuple[tuple[float, float], ...]]


def _removal(
    pair: DampedPair, modes: tuple[int, ...], share: tuple[float, float], largest: float, present: tuple[float, float]
) -> _Told:  # fmt: skip
    """One way of sharing the damping out, and decay rates added at which something else grows, 1/s.

    `present`: growth of the pair at its peak, 1/s, and where that is, rad/s.
    """
    weight = (share[0] * pair.modulus[0], share[1] * pair.modulus[1])
    closed = _closed_form(pair.decay, weight, pair.needed())
    damping = Damping(pair, weight)
    widening, warning = _widening(pair, weight, min(closed, largest), modes)

    def told(unsafe: float, safe: float, *others: float, resolved: bool = True, why: str = "") -> _Told:
        agreement = Agreement.AGREED if resolved else Agreement.UNRESOLVED
        words = "; ".join(one for one in (warning, why) if one)
        asked = tuple(damping.added(ratio) for ratio in others)
        return Removal(modes, closed, unsafe, safe, agreement, widening, words), asked

    nan, peak = float("nan"), present[1]
    which = f"mode {modes[0]} alone" if len(modes) == 1 else "both modes"
    why = f"damping {which} up to {largest:g} leaves something else growing within its width"
    top = min(2.0 * closed, largest) if closed > 0.0 else min(1e-3, largest)
    damping.span(top)
    within = pair.within((peak, peak))
    if present[0] <= 0.0 and damping.gone(0.0, within):
        return told(nan, 0.0)
    others: tuple[float, ...] = ()
    start = min(closed, largest)
    if closed <= largest and any(_crowd(pair, damping.added(ratio)) for ratio in (0.0, start)):
        # the two exponents nearest to the pair may be another's: the whole loop is all there is to ask
        within = pair.within((peak, pair.frequency))
        found = damping.loop_root(start, largest, within)
        if found is None:
            return told(nan, nan, start, largest, resolved=False, why=why)
        ratio, others = found, (start, found)
    else:
        while damping.growth(top) > 0.0:
            if top >= largest:
                still = pair.grows(damping.added(largest), (pair.peak(damping.added(largest))[1],))
                return told(largest, float("inf")) if still else told(nan, nan, resolved=False)
            top = min(2.0 * top, largest)
            damping.span(top)
        ratio = damping.root(top) if present[0] > 0.0 else 0.0
        within = pair.within((peak, pair.peak(damping.added(ratio), damping.reader(ratio))[1]))
        beyond = min(ratio * (1.0 + _BRACKETS[-1]), largest)
        if damping.loop_growth(beyond, within) > 0.0:
            found = damping.loop_root(beyond, largest, within)
            if found is None:
                return told(nan, nan, ratio, largest, resolved=False, why=why)
            ratio, others = found, (ratio, found)
    for apart in _BRACKETS:
        low, high = ratio * (1.0 - apart), ratio * (1.0 + apart)
        if damping.there(low, within) and damping.gone(high, within):
            return told(low, high, *others)
    return told(nan, nan, *others, resolved=False)


def _closed_form(decay: tuple[float, float], weight: tuple[float, float], needed: float) -> float:
    """Smallest ratio z with (a + z u)(b + z v) = needed; inf when there is none."""
    (a, b), (u, v) = decay, weight
    missing = needed - a * b
    if missing <= 0.0 and min(a, b) >= 0.0:
        return 0.0
    square, slope = u * v, a * v + b * u
    if square == 0.0:
        return missing / slope if slope > 0.0 else float("inf")
    return float((-slope + np.sqrt(slope**2 + 4.0 * square * missing)) / (2.0 * square))


def _widening(pair: DampedPair, weight: tuple[float, float], until: float, modes: tuple[int, ...]) -> tuple[float, str]:
    """Largest first-order half-width on the way to `until` over the present one, and the warning."""
    (a, b), g = pair.decay, pair.product
    present = pair_interval(a, b, g)[1]
    if not (0.0 < present < np.inf) or until <= 0.0:
        return 1.0, ""
    ratios = until * np.linspace(0.0, 1.0, 200)[1:]
    widths = [pair_interval(a + z * weight[0], b + z * weight[1], g)[1] for z in ratios]
    widening = float(max(max(widths) / present, 1.0))
    if widening <= _WIDER:
        return widening, ""
    times = f"{widening:.3g} times" if np.isfinite(widening) else "without bound"
    which = f"mode {modes[0]} alone" if len(modes) == 1 else "both modes"
    return widening, f"damping {which} first widens the tongue {times}: unequal damping destabilises"
