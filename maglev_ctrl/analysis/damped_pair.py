"""A pair of modes at one depth with damping added to either: its exponents over passing frequency and damping ratio.

Where several tongues lie at one place, the two exponents nearest to a pair say nothing of the others. A tongue is gone
where the whole loop decays: no exponent of it grows at any passing frequency within the tongue's width.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import brentq, minimize_scalar

from maglev_ctrl.analysis.exponent_surface import ExponentSurface
from maglev_ctrl.analysis.floquet import floquet
from maglev_ctrl.analysis.resonance import modal_harmonics, pair_indices, pair_interval, state_modes
from maglev_ctrl.analysis.resonance_seeds import PairCoupling, pair_coupling
from maglev_ctrl.analysis.resonant_pair import PairExponents, pair_window
from maglev_ctrl.analysis.tongue_search import (
    NOISE,
    Crossing,
    Track,
    apex,
    exponents_of,
    pair_exponents,
    pairs_of,
    polished,
)
from maglev_ctrl.arrays import ComplexArray, FloatArray, read_only_any
from maglev_ctrl.errors import Agreement
from maglev_ctrl.systems import PeriodicSystem

_LOOKS, _LOOKS_SEARCHING = 801, 201  # passing frequencies of a window at which the whole loop is read
_PEAKS, _CLOSER, _ROUNDS = 3, 9, 5  # peaks of its growth that are closed in on, by so many points, so many times
_STEP = 1.25  # of the damping ratio, on the way to where the whole loop decays
_AHEAD = 4.0  # how far beyond a ratio a surface reaches
_UNDAMPED = 1e-9  # decay rate over modulus below which a mode has no damping

Reader = Callable[[FloatArray], ComplexArray]
"""Exponents (P, n) at passing frequencies (P,)."""


def coupling_degree(pair: PairCoupling, harmonics: dict[int, ComplexArray]) -> int:
    """Degree of a pair's coupling in the modulation: 1 direct, 2 where no harmonic couples it directly."""
    size = max(float(np.max(np.abs(B))) for B in harmonics.values())
    return 1 if abs(pair.direct[0] * pair.direct[1]) > 1e-14 * size**2 else 2


@dataclass(slots=True, eq=False)
class DampedPair:
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
    def of(cls, system: PeriodicSystem, crossing: Crossing) -> DampedPair:
        """The pair of a crossing that is there, see `pair_at`."""
        modes = state_modes(system.A_0, states=system.states)
        first, second, distance = pair_indices(modes, crossing.kind, *crossing.modes)
        frequency = distance / crossing.order
        harmonics = modal_harmonics(modes, system.A_cos, system.A_sin)
        coupling = pair_coupling(modes, harmonics, first=first, second=second, order=crossing.order,
                                 frequency=frequency)  # fmt: skip
        x = coupling.direct if coupling_degree(coupling, harmonics) == 1 else coupling.indirect
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

    def peak(self, added: tuple[float, float], read: Reader | None = None) -> tuple[float, float]:
        """Largest growth of the pair over the passing frequency, 1/s, and where, rad/s.

        `read` gives the exponents (P, n) at passing frequencies (P,); they are integrated without it.
        """
        window = pair_window(
            lambda places: self.sampled(added, places, read), self.frequency, self.reach(added),
            limits=(0.6 * self.frequency, 1.4 * self.frequency),
        )  # fmt: skip
        if window is not None and window.smooth:
            W = window.top()[0]
            return self.sampled(added, np.array([W]), read)[0].growth, W
        track = Track(lambda W: self.damped(added, W), None if read is None else lambda W: read(np.array([W]))[0])

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

    def reach(self, added: tuple[float, float]) -> float:
        """Twice the first-order half-width without damping, widened where the two decay rates differ, rad/s."""
        a, b = (max(rate + more, 0.0) for rate, more in zip(self.decay, added, strict=True))
        wider = 0.5 * (a + b) / np.sqrt(a * b) if a * b > 0.0 else 1.0
        half = 2.0 * float(np.sqrt(abs(self.product))) / self.crossing.order
        return float(np.clip(2.0 * wider * half, 1e-4 * self.frequency, 0.2 * self.frequency))

    def sampled(self, added: tuple[float, float], places: FloatArray, read: Reader | None) -> list[PairExponents]:
        """The pair's exponents at passing frequencies (P,)."""
        expected = self.s[0] - added[0], self.s[1] - added[1]
        every = exponents_of([self.damped(added, float(W)) for W in places]) if read is None else read(places)
        first, second = (np.full(len(places), one) for one in expected)
        pairs = pairs_of(every, places, first, second)
        return [PairExponents(complex(a), complex(b)) for a, b in zip(*pairs, strict=True)]

    def half_width(self) -> float:
        """The tongue's half-width: of locking without damping, or the present first-order one if wider, rad/s."""
        lock = 2.0 * float(np.sqrt(abs(self.product)))
        present = pair_interval(*self.decay, self.product)[1]
        half = max(lock, present if np.isfinite(present) else 0.0) / self.crossing.order
        return float(np.clip(half, 1e-4 * self.frequency, 0.2 * self.frequency))

    def within(self, peaks: tuple[float, float]) -> tuple[float, float]:
        """Passing frequencies within the tongue's width: about its peaks without and with damping, rad/s."""
        half = self.half_width()
        lean = abs(self.product.imag) > 1e-6 * abs(self.product)
        around = 2.0 * half if lean else half  # a leaning tongue does not lie evenly about its peak
        first, moved = peaks[0], float(np.clip(peaks[1], peaks[0] - around, peaks[0] + around))
        low, high = min(first, moved) - around, max(first, moved) + around
        return max(0.6 * self.frequency, low), min(1.4 * self.frequency, high)

    def undamped(self, added: tuple[float, float]) -> int:
        """How many eigenvalues of the mean system have no damping: they neither grow nor decay without modulation."""
        s = np.linalg.eigvals(self.damped(added, self.frequency).A_0)
        size = np.abs(s)
        return int(np.sum(np.abs(s.real) <= _UNDAMPED * np.maximum(size, np.max(size))))

    def grows(self, added: tuple[float, float], places: tuple[float, ...]) -> bool:
        """Whether both engines find an exponent of the whole loop growing at one of the places."""
        for place in places:
            found = floquet(self.damped(added, place))
            if found.agreement is Agreement.AGREED and np.any(found.exponents.real > found.error_bound):
                return True
        return False

    def decays(self, added: tuple[float, float], places: tuple[float, ...]) -> bool:
        """Whether both engines find the whole loop decaying at all of the places, its undamped modes left aside."""
        spared = self.undamped(added)
        for place in places:
            found = floquet(self.damped(added, place))
            growing = np.any(found.exponents.real > found.error_bound)
            open_ = np.sum(found.exponents.real + found.error_bound >= 0.0)
            if found.agreement is not Agreement.AGREED or growing or open_ > spared:
                return False
        return True


def loop_growth(exponents: ComplexArray, frequency: FloatArray, undamped: int) -> FloatArray:
    """Largest real part (P,) of all exponents (P, n), 1/s; undamped modes that stay so to rounding are left aside.

    Examples
    --------
    >>> loop_growth(np.array([[-0.1 + 1j, 1e-15], [0.2, 1e-15]]), np.array([2.0, 2.0]), 1).tolist()
    [-0.1, 0.2]
    """
    real = np.sort(exponents.real, axis=1)[:, ::-1]
    spared = real[:, min(undamped, real.shape[1] - 1)]
    return np.where(real[:, 0] <= NOISE * frequency / (2.0 * np.pi), spared, real[:, 0]) if undamped else real[:, 0]


@dataclass(slots=True, eq=False)
class Damping:
    """Damping shared out over the two modes of a pair, the pair's exponents read from one surface over the ratio."""

    pair: DampedPair
    weight: tuple[float, float]
    surface: ExponentSurface | None = None
    spanned: float = 0.0

    def added(self, ratio: float) -> tuple[float, float]:
        """Decay rates that a ratio adds, 1/s."""
        return ratio * self.weight[0], ratio * self.weight[1]

    def span(self, most: float) -> None:
        """Make the surface reach from no damping to a ratio."""
        middle = self.pair.frequency
        reach = 3.0 * max(self.pair.reach(self.added(share * most)) for share in (0.0, 0.5, 1.0))
        low, high = max(0.6 * middle, middle - reach), min(1.4 * middle, middle + reach)
        self.surface = ExponentSurface.of(
            lambda W, ratio: self.pair.damped(self.added(ratio), W), (low, high), (0.0, most), linear=False
        )
        self.spanned = most

    def reader(self, ratio: float) -> Reader:
        """Exponents over the passing frequency at a ratio."""

        def read(places: FloatArray) -> ComplexArray:
            assert self.surface is not None
            found = self.surface.exponents(places, np.full(len(places), ratio))
            assert found is not None
            return found[0]

        return read

    def growth(self, ratio: float) -> float:
        """Growth of the pair at its peak, for searches, 1/s."""
        return self.pair.peak(self.added(ratio), self.reader(ratio))[0]

    def loop_peaks(self, ratio: float, within: tuple[float, float], looks: int) -> tuple[FloatArray, FloatArray]:
        """Where in a window the whole loop grows most, rad/s, and its growth there, 1/s; the largest first."""
        read, undamped = self.reader(ratio), self.pair.undamped(self.added(ratio))

        def grows(places: FloatArray) -> FloatArray:
            return loop_growth(read(places), places, undamped)

        step = (within[1] - within[0]) / (looks - 1)
        places = np.linspace(*within, looks)
        height = grows(places)
        beyond = np.concatenate([[-np.inf], height, [-np.inf]])
        tops = np.nonzero((height >= beyond[:-2]) & (height > beyond[2:]))[0]
        at = places[tops[np.argsort(-height[tops])[:_PEAKS]]]
        best = grows(at)
        for _ in range(_ROUNDS):
            closer = np.clip(at[:, None] + step * np.linspace(-1.0, 1.0, _CLOSER), *within)
            height = grows(closer.ravel()).reshape(closer.shape)
            k = np.argmax(height, axis=1)
            every = np.arange(len(at))
            at, best = closer[every, k], height[every, k]
            step *= 2.0 / (_CLOSER - 1)
        order = np.argsort(-best)
        return at[order], best[order]

    def loop_growth(self, ratio: float, within: tuple[float, float]) -> float:
        """Largest growth of the whole loop in a window, for searches, 1/s."""
        return float(self.loop_peaks(ratio, within, _LOOKS_SEARCHING)[1][0])

    def loop_root(self, start: float, largest: float, within: tuple[float, float]) -> float | None:
        """The ratio near `start` at which the whole loop ceases to grow in a window; None: not up to `largest`."""
        low = high = max(start, 1e-4 * largest)
        while self.loop_growth(high, within) > 0.0:
            if high >= largest:
                return None
            low, high = high, min(_STEP * high, largest)
            if high > self.spanned:
                self.span(min(_AHEAD * high, largest))
        while low >= high or self.loop_growth(low, within) <= 0.0:
            low, high = low / _STEP, low
            if low < 1e-6 * largest:
                return 0.0
        found = float(brentq(lambda ratio: self.loop_growth(ratio, within), low, high, xtol=1e-7 * high, rtol=1e-7))
        W = np.array([self.loop_peaks(found, within, _LOOKS)[0][0]])

        def exact(ratio: float) -> float:
            added = self.added(ratio)
            return self._loop_at(exponents_of([self.pair.damped(added, float(W[0]))]), W, ratio)

        def sought(ratio: float) -> float:
            return self._loop_at(self.reader(ratio)(W), W, ratio)

        return polished(exact, sought, found, 1e-4 * found)

    def there(self, ratio: float, within: tuple[float, float]) -> bool:
        """Whether both engines find the whole loop growing in a window, where it grows most."""
        return self.pair.grows(
            self.added(ratio), tuple(float(W) for W in self.loop_peaks(ratio, within, _LOOKS)[0][:1])
        )

    def gone(self, ratio: float, within: tuple[float, float]) -> bool:
        """Whether no exponent of the whole loop grows in a window: read densely, verified by both engines.

        They look at the peaks of its growth, and to either side where it has one peak only.
        """
        tops, growth = self.loop_peaks(ratio, within, _LOOKS)
        if growth[0] > 0.0:
            return False
        W = float(tops[0])
        reach = 0.25 * float(np.sqrt(abs(self.pair.product))) / self.pair.crossing.order
        beside = (W - reach, W + reach) if len(tops) == 1 else tuple(float(one) for one in tops[1:])
        return self.pair.decays(self.added(ratio), (W, *beside))

    def root(self, top: float) -> float:
        """The ratio up to `top` at which the growth of the pair at its peak passes zero."""
        found = float(brentq(self.growth, 0.0, top, xtol=1e-7 * top, rtol=1e-7))
        W = self.pair.peak(self.added(found), self.reader(found))[1]

        def exact(ratio: float) -> float:
            return self._at(W, ratio, None)

        def sought(ratio: float) -> float:
            return self._at(W, ratio, self.reader(ratio))

        # growth is stationary over the passing frequency at its peak, so that the ratio alone has to move
        return polished(exact, sought, found, 1e-4 * found)

    def _at(self, W: float, ratio: float, read: Reader | None) -> float:
        return self.pair.sampled(self.added(ratio), np.array([W]), read)[0].growth

    def _loop_at(self, exponents: ComplexArray, W: FloatArray, ratio: float) -> float:
        return float(loop_growth(exponents, W, self.pair.undamped(self.added(ratio)))[0])
