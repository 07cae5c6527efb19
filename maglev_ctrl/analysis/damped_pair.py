"""A pair of modes at one depth with damping added to either: its exponents over passing frequency and damping ratio."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import brentq, minimize_scalar

from maglev_ctrl.analysis.exponent_surface import ExponentSurface
from maglev_ctrl.analysis.floquet import floquet
from maglev_ctrl.analysis.resonance import modal_harmonics, pair_indices, state_modes
from maglev_ctrl.analysis.resonance_seeds import PairCoupling, pair_coupling
from maglev_ctrl.analysis.resonant_pair import PairExponents, pair_window
from maglev_ctrl.analysis.tongue_search import Crossing, Track, apex, exponents_of, pair_exponents, pairs_of, polished
from maglev_ctrl.arrays import ComplexArray, FloatArray, read_only_any
from maglev_ctrl.errors import Agreement
from maglev_ctrl.systems import PeriodicSystem

_LOOKS, _LOOKS_INTEGRATED = 801, 33  # passing frequencies at which a tongue that is gone may not grow

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

    def confirmed(self, added: tuple[float, float], *, gone: bool, read: Reader | None = None) -> bool:
        """Whether both engines find the pair decaying at its peak and beside it, or growing at its peak.

        A tongue that is gone may not grow anywhere about its peak either: where others mix with it there may be more
        peaks than one.
        """
        _, W = self.peak(added, read)
        if gone and self._grows_about(W, added, read):
            return False
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

    def _grows_about(self, W: float, added: tuple[float, float], read: Reader | None) -> bool:
        around = self.reach(added)
        low, high = max(0.6 * self.frequency, W - around), min(1.4 * self.frequency, W + around)
        places = np.linspace(low, high, _LOOKS if read is not None else _LOOKS_INTEGRATED)
        return any(one.growth > 0.0 for one in self.sampled(added, places, read))


@dataclass(slots=True, eq=False)
class Damping:
    """Damping shared out over the two modes of a pair, the pair's exponents read from one surface over the ratio."""

    pair: DampedPair
    weight: tuple[float, float]
    surface: ExponentSurface | None = None

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

    def root(self, top: float) -> float:
        """The ratio up to `top` at which the growth at the peak passes zero."""
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
