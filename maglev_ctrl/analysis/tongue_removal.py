"""What removes a tongue: the damping it takes, and the element whose modulation feeds it.

Damping is added to modes: the decay rate of mode m grows by zeta |s_m|, its frequency and its shape stay. The closed
form is Hsu's: with decay rates a, b and the product g of the two couplings, a tongue is gone over all detunings when
2 (a + zeta_i w_i) (b + zeta_j w_j) = |g| + Re g. The exact value is found on the Floquet exponents of the pair.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import brentq, minimize_scalar

from maglev_ctrl.analysis.floquet import floquet
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
from maglev_ctrl.analysis.resonance_seeds import PairCoupling, pair_coupling
from maglev_ctrl.analysis.resonant_pair import PairExponents, pair_window
from maglev_ctrl.analysis.tongue_search import Crossing, Track, apex, exponents_of, pair_at, pair_exponents
from maglev_ctrl.arrays import ComplexArray, FloatArray, read_only_any
from maglev_ctrl.errors import Agreement
from maglev_ctrl.systems import PeriodicSystem, SecondOrderSystem, at_depth
from maglev_ctrl.vehicle import ElementModulation

_WIDER = 1.05  # a half-width beyond this times the present one is warned of; equal ratios alone make some of it
_BRACKETS = (1e-5, 1e-4, 1e-3, 1e-2)  # relative distances from the removing damping at which the engines are asked


@dataclass(frozen=True, slots=True)
class Removal:
    """Smallest damping ratio, added to `modes` (counted from 1), that removes a tongue.

    `closed_form`: Hsu's (inf: no damping of these modes does it). `unsafe`, `safe`: the tongue is still there at the
    one and gone at the other, both verified by both engines; safe is inf where it is still there at the largest ratio
    tried. NaN with agreement UNRESOLVED where the engines do not confirm it. `widening`: largest first-order half-width
    met on the way over the present one; `warning` in words when damping first widens the tongue.
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
    tongues present within its width; their exponents mix with this pair's, and the exact values speak of the two
    exponents nearest to it.
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
    pair, first = _Pair.of(scaled, crossing), known[1]
    crossing = replace(crossing, at=pair.frequency)
    equal = _removal(pair, (low, high) if low != high else (low,), (1.0, 1.0), largest)
    alone = () if low == high else (
        _removal(pair, (low,), pair.weights_of(low), largest), _removal(pair, (high,), pair.weights_of(high), largest)
    )  # fmt: skip
    name = make_resonance(kind, order, (low, high), first.labels, frequency=pair.frequency).name
    return TongueRemoval(name, crossing, depth, pair.frequency, pair.peak((0.0, 0.0))[0], equal, alone,
                         _crowd(scaled, crossing, 2.0 * float(np.sqrt(abs(pair.product))) / order))  # fmt: skip


def _crowd(system: PeriodicSystem, crossing: Crossing, reach: float) -> tuple[str, ...]:
    """Names of the other tongues present at this depth whose centres lie within `reach` (rad/s) of this one's."""
    modes = state_modes(system.A_0, states=system.states)
    names = []
    for kind, i, j in resonant_pairs(len(modes.oscillating)):
        for order in range(1, 2 * len(system.A_cos) + 1):
            frequency = pair_indices(modes, kind, i, j)[2] / order
            same = (kind, (i, j), order) == (crossing.kind, crossing.modes, crossing.order)
            if same or abs(frequency - crossing.at) > reach:
                continue
            known = pair_at(system, Crossing(kind, (i, j), order, frequency))
            if known is not None and known[0].critical(1.0) <= 1.0:
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
    chosen = degree or _degree(pair, harmonics)
    return (pair.direct if chosen == 1 else pair.indirect), chosen


def _degree(pair: PairCoupling, harmonics: dict[int, ComplexArray]) -> int:
    size = max(float(np.max(np.abs(B))) for B in harmonics.values())
    return 1 if abs(pair.direct[0] * pair.direct[1]) > 1e-14 * size**2 else 2


@dataclass(slots=True, eq=False)
class _Pair:
    """One pair of modes at one depth: decay rates, moduli, product of couplings, and its exponents with damping."""

    system: PeriodicSystem
    crossing: Crossing
    shapes: tuple[ComplexArray, ComplexArray]
    s: tuple[complex, complex]
    decay: tuple[float, float]
    modulus: tuple[float, float]
    product: complex
    frequency: float

    @classmethod
    def of(cls, system: PeriodicSystem, crossing: Crossing) -> _Pair:
        modes = state_modes(system.A_0, states=system.states)
        first, second, distance = pair_indices(modes, crossing.kind, *crossing.modes)
        frequency = distance / crossing.order
        harmonics = modal_harmonics(modes, system.A_cos, system.A_sin)
        coupling = pair_coupling(modes, harmonics, first=first, second=second, order=crossing.order,
                                 frequency=frequency)  # fmt: skip
        x = coupling.direct if _degree(coupling, harmonics) == 1 else coupling.indirect
        s = (complex(modes.s[first]), complex(modes.s[second]))
        decay = tuple(0.0 if abs(one.real) <= 1e-9 * abs(one) else -one.real for one in s)
        shapes = tuple(np.outer(modes.right[:, k], modes.left[:, k].conj()) for k in (first, second))
        moved = (s[0] + coupling.shift[0], s[1] + coupling.shift[1])
        return cls(system, crossing, (shapes[0], shapes[1]), moved, (decay[0], decay[1]), (abs(s[0]), abs(s[1])),
                   x[0] * x[1], frequency)  # fmt: skip

    def weights_of(self, mode: int) -> tuple[float, float]:
        """Which of the two eigenvalues belongs to a mode counted from 1."""
        low, _ = self.crossing.modes
        first_is_low = self.crossing.kind != "difference"
        return (1.0, 0.0) if (mode - 1 == low) == first_is_low else (0.0, 1.0)

    def needed(self) -> float:
        """(|g| + Re g)/2: the product of decay rates at which the tongue is gone."""
        return 0.5 * (abs(self.product) + self.product.real)

    def damped(self, added: tuple[float, float], frequency: float) -> PeriodicSystem:
        """The system with decay rates added to the two modes, 1/s."""
        A_0 = np.array(self.system.A_0)
        both = (0,) if self.crossing.modes[0] == self.crossing.modes[1] else (0, 1)
        for k in both:
            A_0 -= 2.0 * added[k] * self.shapes[k].real
        return replace(self.system, A_0=read_only_any(A_0), frequency=read_only_any(frequency))

    def growth(self, exponents: ComplexArray, frequency: float, added: tuple[float, float]) -> float:
        """Largest real part of the pair's two exponents, 1/s."""
        pair = pair_exponents(exponents, frequency, self.s[0] - added[0], self.s[1] - added[1])
        return max(one.real for one in pair)

    def peak(self, added: tuple[float, float]) -> tuple[float, float]:
        """Largest growth of the pair over the passing frequency, 1/s, and where, rad/s."""
        window = pair_window(
            lambda places: self._sampled(added, places), self.frequency, self._reach(added),
            limits=(0.6 * self.frequency, 1.4 * self.frequency),
        )  # fmt: skip
        if window is not None and window.smooth:
            W = window.top()[0]
            return self._sampled(added, np.array([W]))[0].growth, W
        track = Track(lambda W: self.damped(added, W))

        def lost(W: float) -> float:
            return -self.growth(track.point(W).exponents, W, added)

        expected = (self.s[0] - added[0], self.s[1] - added[1])
        lower, upper = 0.6 * self.frequency, 1.4 * self.frequency
        centre, width = apex(track, self.frequency, expected, lower, upper)
        lean = abs(self.product.imag) / max(abs(self.product), 1e-300)
        reach = width if lean < 1e-6 else 4.0 * width
        low, high = max(lower, centre - reach), min(upper, centre + reach)
        places = [centre, *np.linspace(low, high, 9)]
        k = int(np.argmin([lost(float(W)) for W in places[1:]])) + 1
        left, right = float(places[max(k - 1, 1)]), float(places[min(k + 1, 9)])
        best = minimize_scalar(lost, bounds=(left, right), method="bounded",
                               options={"xatol": 1e-4 * (right - left)})  # fmt: skip
        W = min((centre, float(best.x)), key=lost)
        return -lost(W), W

    def _reach(self, added: tuple[float, float]) -> float:
        """Twice the first-order half-width without damping, widened where the two decay rates differ, rad/s."""
        a, b = (max(rate + more, 0.0) for rate, more in zip(self.decay, added, strict=True))
        wider = 0.5 * (a + b) / np.sqrt(a * b) if a * b > 0.0 else 1.0
        half = 2.0 * float(np.sqrt(abs(self.product))) / self.crossing.order
        return float(np.clip(2.0 * wider * half, 1e-4 * self.frequency, 0.2 * self.frequency))

    def _sampled(self, added: tuple[float, float], places: FloatArray) -> list[PairExponents]:
        """The pair's exponents at passing frequencies (P,)."""
        expected = self.s[0] - added[0], self.s[1] - added[1]
        every = exponents_of([self.damped(added, float(W)) for W in places])
        return [PairExponents(*pair_exponents(one, float(W), *expected))
                for one, W in zip(every, places, strict=True)]  # fmt: skip

    def confirmed(self, added: tuple[float, float], *, gone: bool) -> bool:
        """Whether both engines find the pair decaying at its peak and beside it, or growing at its peak."""
        _, W = self.peak(added)
        reach = 0.25 * float(np.sqrt(abs(self.product))) / self.crossing.order
        for place in (W, W - reach, W + reach) if gone else (W,):
            found = floquet(self.damped(added, place))
            if found.agreement is not Agreement.AGREED:
                return False
            margin = found.error_bound if gone else -found.error_bound
            growth = self.growth(np.asarray(found.exponents + margin), place, added)
            if (growth < 0.0) is not gone:
                return False
        return True


def _removal(pair: _Pair, modes: tuple[int, ...], share: tuple[float, float], largest: float) -> Removal:
    """Closed form and exact for one way of sharing the damping out."""
    weight = (share[0] * pair.modulus[0], share[1] * pair.modulus[1])
    closed = _closed_form(pair.decay, weight, pair.needed())

    def added(ratio: float) -> tuple[float, float]:
        return ratio * weight[0], ratio * weight[1]

    known: dict[float, float] = {}

    def growth(ratio: float) -> float:
        if ratio not in known:
            known[ratio] = pair.peak(added(ratio))[0]
        return known[ratio]

    widening, warning = _widening(pair, weight, min(closed, largest), modes)

    def told(unsafe: float, safe: float, resolved: bool = True) -> Removal:
        agreement = Agreement.AGREED if resolved else Agreement.UNRESOLVED
        return Removal(modes, closed, unsafe, safe, agreement, widening, warning)

    nan = float("nan")
    if growth(0.0) <= 0.0:
        return told(nan, 0.0) if pair.confirmed((0.0, 0.0), gone=True) else told(nan, nan, False)
    top = min(2.0 * closed, largest) if closed > 0.0 else min(1e-3, largest)
    while growth(top) > 0.0:
        if top >= largest:
            still = pair.confirmed(added(largest), gone=False)
            return told(largest, float("inf")) if still else told(nan, nan, False)
        top = min(2.0 * top, largest)
    ratio = float(brentq(growth, 0.0, top, xtol=1e-7 * top, rtol=1e-7))
    for apart in _BRACKETS:
        low, high = ratio * (1.0 - apart), ratio * (1.0 + apart)
        if pair.confirmed(added(low), gone=False) and pair.confirmed(added(high), gone=True):
            return told(low, high)
    return told(nan, nan, False)


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


def _widening(pair: _Pair, weight: tuple[float, float], until: float, modes: tuple[int, ...]) -> tuple[float, str]:
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
