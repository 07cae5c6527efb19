"""The two exponents of one resonant pair over a parameter: a window of samples, its top and the edges of instability.

The mean of the two exponents and the square of half their difference are smooth right through a tongue, where the
exponents themselves are not. A few samples over a window about the tongue therefore tell its top and its edges.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.polynomial import chebyshev
from scipy.optimize import brentq

from maglev_ctrl.analysis.tongue_search import Crossing, leading_exponents, pair_at, pair_exponents
from maglev_ctrl.arrays import ComplexArray, FloatArray
from maglev_ctrl.systems import PeriodicSystem

NODES = 9
_DENSE = 801
_CLOSER = 65  # points of each step that closes in on the top
_TAIL = 1e-3  # last coefficients against the largest, below which a window is smooth enough to lead a search
_MOST_WINDOWS = 6
_MOST_NODES = 33


@dataclass(frozen=True, slots=True)
class PairExponents:
    """`one`, `other`: the exponents of a pair, 1/s, next to each other."""

    one: complex
    other: complex

    @property
    def growth(self) -> float:
        """Larger real part, 1/s."""
        return max(self.one.real, self.other.real)


def pair_of(system: PeriodicSystem, crossing: Crossing, exponents: ComplexArray | None = None) -> PairExponents | None:
    """The exponents of one pair of modes of a system at its actual depth; None where there is no such pair.

    Parameters
    ----------
    system : one periodic system, near the resonance
    crossing : kind, modes and order
    exponents : (n,) all exponents, computed in the time domain when left out

    Examples
    --------
    >>> mathieu = PeriodicSystem.from_matrices([[0, 1], [-1, 0]], [[[0, 0], [-0.4, 0]]], frequency=2.0)
    >>> round(pair_of(mathieu, Crossing("parametric", (0, 0), 1, 2.0)).growth, 9)
    0.099536437
    """
    known = pair_at(system, crossing)
    if known is None:
        return None
    first, second = (s + shift for s, shift in zip(known[0].s, known[0].shift, strict=True))
    every = leading_exponents(system) if exponents is None else exponents
    return PairExponents(*pair_exponents(every, float(system.frequency), first, second))


@dataclass(frozen=True, eq=False, slots=True)
class ExpectedPair:
    """Where perturbation theory expects a pair near a place: quadratics in the parameter, the shift at unit depth."""

    place: float
    s: ComplexArray
    shift: ComplexArray

    def __call__(self, parameter: float, depth: float) -> tuple[complex, complex]:
        """The two expected exponents, 1/s."""
        first, second = self.many(np.array([parameter]), depth)
        return complex(first[0]), complex(second[0])

    def many(self, parameters: FloatArray, depth: float) -> tuple[ComplexArray, ComplexArray]:
        """The two expected exponents at parameters (P,), (P,) each, 1/s."""
        powers = np.vander(parameters - self.place, 3, increasing=True)
        both = powers @ (self.s + depth**2 * self.shift)
        return both[:, 0], both[:, 1]


def expected_pair(path: Callable[[float], PeriodicSystem | None], crossing: Crossing, *, apart: float) -> ExpectedPair:
    """The expected pair about a crossing, from systems at unit depth there and `apart` to either side.

    Parameters
    ----------
    path : parameter -> system at unit depth, None without an answer (then the place itself has to do)
    crossing : kind, modes, order and place
    apart : distance of the samples
    """
    found = []
    for step in (-apart, 0.0, apart):
        system = path(crossing.at + step)
        known = None if system is None else pair_at(system, crossing)
        if known is not None:
            found.append((step, known[0].s, known[0].shift))
    places = [step for step, _, _ in found]
    if len(found) < 3:
        found, places = [one for one in found if one[0] == 0.0], [0.0]
    powers = np.vander(places, 3, increasing=True)[:, : len(found)]
    s, shift = (np.zeros((3, 2), dtype=complex) for _ in range(2))
    s[: len(found)] = np.linalg.solve(powers, np.array([one[1] for one in found]))
    shift[: len(found)] = np.linalg.solve(powers, np.array([one[2] for one in found]))
    return ExpectedPair(crossing.at, s, shift)


@dataclass(frozen=True, eq=False, slots=True)
class PairWindow:
    """A pair between `lower` and `upper`: Chebyshev coefficients of the mean and of the squared half difference.

    `smooth` says whether the coefficients decay: elsewhere another tongue mixes in.
    """

    lower: float
    upper: float
    mean: FloatArray
    squared: ComplexArray
    smooth: bool
    _highest: tuple[float, float] = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_highest", self._found())

    def growth(self, at: FloatArray) -> FloatArray:
        """Larger real part of the two exponents at parameters (P,), 1/s."""
        u = (2.0 * np.asarray(at) - self.lower - self.upper) / (self.upper - self.lower)
        parts = np.column_stack([self.mean, self.squared.real, self.squared.imag])
        mean, real, imaginary = (chebyshev.chebvander(u, len(parts) - 1) @ parts).T
        # larger real part of the root: half of modulus plus real part, the way round that does not cancel
        modulus = np.hypot(real, imaginary)
        plus = 0.5 * (modulus + np.abs(real))
        square = np.where(real >= 0.0, plus, 0.25 * imaginary**2 / np.where(plus > 0.0, plus, 1.0))
        return np.asarray(mean + np.sqrt(square))

    def top(self) -> tuple[float, float]:
        """Where growth is largest and that growth, 1/s."""
        return self._highest

    def _found(self) -> tuple[float, float]:
        low, high = self.lower, self.upper
        for count in (_DENSE, *(_CLOSER,) * 3):
            places = np.linspace(low, high, count)
            values = self.growth(places)
            k = int(np.argmax(values))
            low, high = places[max(k - 1, 0)], places[min(k + 1, count - 1)]
        return float(places[k]), float(values[k])

    def apex(self) -> float:
        """Where the real part of the squared difference is largest: the tongue's centre."""
        places = np.linspace(self.lower, self.upper, _DENSE)
        u = np.linspace(-1.0, 1.0, _DENSE)
        return float(places[int(np.argmax(chebyshev.chebval(u, self.squared).real))])

    def edges(self, floor: float = 0.0) -> tuple[float, float] | None:
        """Where growth passes `floor` on either side of the top; None when it does not on both."""
        around = self.around(floor)
        if around is None:
            return None

        def above(place: float) -> float:
            return float(self.growth(np.array([place]))[0]) - floor

        low, high = (float(brentq(above, *ends)) for ends in around)
        return low, high

    def around(self, floor: float = 0.0) -> tuple[tuple[float, float], tuple[float, float]] | None:
        """Two places about each edge, the inner one first; None where there are no two edges."""
        top, height = self.top()
        if height <= floor:
            return None
        found = []
        for end in (self.lower, self.upper):
            places = np.linspace(top, end, _DENSE)
            below = np.nonzero(self.growth(places) <= floor)[0]
            if not len(below) or below[0] == 0:
                return None
            found.append((float(places[below[0] - 1]), float(places[below[0]])))
        return found[0], found[1]


def pair_window(
    pairs: Callable[[FloatArray], list[PairExponents] | None], centre: float, reach: float, *,
    limits: tuple[float, float], floor: float = 0.0, nodes: int = NODES,
) -> PairWindow | None:  # fmt: skip
    """A window about the pair's tongue that holds its top and its edges; None where there is no such pair.

    Parameters
    ----------
    pairs : parameters (P,) -> the pair's exponents at each; None where there is no such pair
    centre, reach : where to begin, and how far to either side
    limits : the window stays between them
    floor : growth that counts as none, 1/s
    nodes : samples in one window

    Examples
    --------
    >>> def pair(W):
    ...     system = PeriodicSystem.from_matrices([[0, 1], [-1, -0.02]], [[[0, 0], [-0.1, 0]]], frequency=W)
    ...     return pair_of(system, Crossing("parametric", (0, 0), 1, W))
    >>> pairs = lambda frequencies: [pair(float(W)) for W in frequencies]
    >>> [round(edge, 4) for edge in pair_window(pairs, 2.0, 0.1, limits=(1.5, 2.5)).edges()]
    [1.9538, 2.0454]
    """
    window: PairWindow | None = None
    for _ in range(_MOST_WINDOWS):
        lower, upper = max(limits[0], centre - reach), min(limits[1], centre + reach)
        window = _fitted(pairs, lower, upper, nodes)
        if window is None:
            return None
        apex, (top, height) = window.apex(), window.top()
        inside = min(top, apex) - lower > 0.1 * reach and upper - max(top, apex) > 0.1 * reach
        whole = lower <= limits[0] and upper >= limits[1]
        if window.smooth and (inside or whole) and (height <= floor or window.around(floor) is not None):
            return window
        if not window.smooth and nodes < _MOST_NODES:
            nodes = 2 * nodes - 1
        elif not window.smooth:
            centre, reach = (apex if inside else centre), 0.6 * reach
        elif not inside:
            centre = apex
        elif not whole:
            reach *= 2.0
        else:
            break
    return window


def _fitted(
    pairs: Callable[[FloatArray], list[PairExponents] | None], lower: float, upper: float, nodes: int
) -> PairWindow | None:  # fmt: skip
    u = np.cos(np.pi * (np.arange(nodes) + 0.5) / nodes)
    sampled = pairs(0.5 * (lower + upper) + 0.5 * (upper - lower) * u)
    if sampled is None:
        return None
    mean = np.array([0.5 * (one.one + one.other).real for one in sampled])
    squared = np.array([0.25 * (one.one - one.other) ** 2 for one in sampled])
    centre = np.asarray(chebyshev.chebfit(u, mean, nodes - 1))
    apart = chebyshev.chebfit(u, squared.real, nodes - 1) + 1j * chebyshev.chebfit(u, squared.imag, nodes - 1)
    tail = float(np.max(np.abs(apart[-2:])))
    return PairWindow(lower, upper, centre, apart, bool(tail <= _TAIL * np.max(np.abs(apart))))
