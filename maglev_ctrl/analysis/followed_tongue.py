"""One tongue over speed at any depth, its pair of exponents followed from where perturbation theory puts it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from maglev_ctrl.analysis.exponent_surface import SpeedSurface
from maglev_ctrl.analysis.resonance_seeds import PairCoupling
from maglev_ctrl.analysis.resonant_pair import ExpectedPair, PairExponents, PairWindow, expected_pair, pair_window
from maglev_ctrl.analysis.tongue_search import (
    NOISE,
    Crossing,
    Track,
    leading_exponents,
    pair_at,
    pair_exponents,
    pairs_of,
)
from maglev_ctrl.analysis.tongue_widths import FirstOrder, first_order
from maglev_ctrl.arrays import ComplexArray, FloatArray
from maglev_ctrl.systems import PeriodicSystem, at_depth

_WINDOWS = 2.0  # half a window over the predicted half-width
_LEAST = 1e-4  # smallest half window relative to the speed
_DEPTHS, _ACROSS, _CLOSER = 16, 33, 2  # depths and speeds of the search for any growth, and how often it closes in


@dataclass(slots=True, eq=False)
class FollowedTongue:
    """One tongue over speed at any depth, its pair followed from where perturbation theory puts it."""

    base: Track
    surface: SpeedSurface
    crossing: Crossing
    depth: float
    largest_depth: float
    limits: tuple[float, float]
    theory: FirstOrder = field(init=False)
    unit: PairCoupling = field(init=False)
    expected: ExpectedPair = field(init=False)
    windows: dict[float, PairWindow | None] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.theory = first_order(self.base, self.crossing, depth=self.depth)
        system = self.base.system(self.crossing.at)
        assert system is not None
        known = pair_at(at_depth(system, self.largest_depth), self.crossing)
        assert known is not None
        self.unit = known[0]
        self.expected = expected_pair(self.base.system, self.crossing, apart=0.01 * self.crossing.at)

    @property
    def undamped(self) -> bool:
        """A pair without any damping begins at no depth and is neutral beside its tongue."""
        return max(map(abs, self.theory.decay)) == 0.0

    @property
    def foreseen(self) -> bool:
        """Whether the order is one that second-order theory speaks of."""
        system = self.base.system(self.crossing.at)
        return system is None or self.crossing.order <= 2 * len(system.A_cos)

    @property
    def floor(self) -> float:
        """Growth that counts as none, 1/s: what rounding can feign where there is no damping."""
        system = self.base.system(self.crossing.at)
        assert system is not None
        return NOISE * float(system.frequency) / (2.0 * np.pi) if self.undamped else 0.0

    def at(self, speed: float, depth: float) -> PeriodicSystem | None:
        """The system at a speed and a depth; None where the model has no answer."""
        system = self.base.system(speed)
        return None if system is None else at_depth(system, depth)

    def pair(self, speed: float, depth: float) -> PairExponents | None:
        """The pair's exponents, integrated."""
        system = self.at(speed, depth)
        if system is None:
            return None
        return self.own(leading_exponents(system), float(system.frequency), speed, depth)

    def pairs(self, speeds: FloatArray, depth: float) -> list[PairExponents] | None:
        """The pair's exponents at many speeds at once, for searches; None where one of them has no answer."""
        found = self.surface.exponents(speeds, np.full(len(speeds), depth))
        if found is None:
            return None
        expected = self.expected.many(speeds, depth)
        return [PairExponents(complex(a), complex(b)) for a, b in zip(*pairs_of(*found, *expected), strict=True)]

    def own(self, exponents: ComplexArray, frequency: float, speed: float, depth: float) -> PairExponents:
        """The pair among all exponents at a speed."""
        return PairExponents(*pair_exponents(exponents, frequency, *self.expected(speed, depth)))

    def sought(self, speed: float, depth: float) -> float:
        """Growth of the pair above `floor` for searches, 1/s; NaN where it has no answer."""
        found = self.pairs(np.array([speed]), depth)
        return float("nan") if found is None else found[0].growth - self.floor

    def grown(self, speed: float, depth: float) -> float:
        """Growth of the pair above `floor`, integrated, 1/s; NaN where it has no answer."""
        pair = self.pair(speed, depth)
        return float("nan") if pair is None else pair.growth - self.floor

    def predicted(self, depth: float) -> tuple[float, float]:
        """Centre and half-width over speed where the pair would lock without damping, by second-order theory."""
        share, order, slope = depth / self.largest_depth, self.crossing.order, self.theory.slope
        unit = self.unit
        product = (share * unit.direct[0] + share**2 * unit.indirect[0]) * (
            share * unit.direct[1] + share**2 * unit.indirect[1]
        )
        if not abs(slope) > 0.0:
            return self.crossing.at, 0.02 * self.crossing.at
        half = 2.0 * float(np.sqrt(abs(product))) / order / abs(slope)
        return self.crossing.at - unit.detuning(share) / order / slope, half

    def place(self, depth: float) -> tuple[float, float]:
        """Where the tongue is looked for at a depth, and how far to either side."""
        centre, half = self.predicted(depth)
        a, b = self.theory.decay
        half *= (a + b) / (2.0 * np.sqrt(a * b)) if a * b > 0.0 else 1.0
        middle = float(np.clip(centre, *self.limits))
        half = half if self.foreseen else max(abs(centre - self.crossing.at), 0.01 * middle)
        return middle, float(np.clip(_WINDOWS * half, _LEAST * middle, 0.25 * middle))

    def window(self, depth: float) -> PairWindow | None:
        """The pair over speed at a depth, its tongue inside."""
        if depth not in self.windows:
            (low, high), (middle, reach) = self.limits, self.place(depth)
            self.windows[depth] = pair_window(
                lambda speeds: self.pairs(speeds, depth), middle, reach,
                limits=(max(low, 0.3 * middle), min(high, 2.0 * middle)), floor=self.floor,
            )  # fmt: skip
        return self.windows[depth]

    def calm(self) -> bool:
        """Whether nothing at all grows from the crossing to where the tongue is looked for, at any depth up to the
        largest.

        The highest place of each depth is closed in on, so that a tongue between two samples is not missed.
        """
        depths = np.linspace(0.0, self.largest_depth, _DEPTHS + 1)[1:]
        spans = np.array([self.place(float(depth)) for depth in depths])
        nearer, farther = np.minimum(spans[:, 0], self.crossing.at), np.maximum(spans[:, 0], self.crossing.at)
        low, high = np.clip([nearer - spans[:, 1], farther + spans[:, 1]], *self.limits)
        for _ in range(_CLOSER + 1):
            speeds = low[:, None] + (high - low)[:, None] * np.linspace(0.0, 1.0, _ACROSS)
            found = self.surface.exponents(speeds.ravel(), np.repeat(depths, _ACROSS))
            if found is None:
                return False
            growth = np.max(found[0].real, axis=1).reshape(speeds.shape)
            if np.max(growth) >= 0.0:
                return False
            every, top = np.arange(len(depths)), np.argmax(growth, axis=1)
            low, high = speeds[every, np.maximum(top - 1, 0)], speeds[every, np.minimum(top + 1, _ACROSS - 1)]
        return True

    def peak(self, depth: float) -> float:
        """Largest growth of the pair over speed at a depth, 1/s; NaN where it cannot be followed."""
        window = self.window(depth)
        return float("nan") if window is None else self.sought(window.top()[0], depth)
