"""Where tongues lie along a path of periodic systems: predicted crossings, located on the exponents themselves.

A path is any function of one parameter (speed, gain, depth) that gives a periodic system at its actual depth. A tongue
crosses it where the passing frequency meets (w_i +- w_j)/k. The two exponents that meet there, s and s', make
(s - s')^2 a smooth function of the parameter, right through the tongue and on either side of it, with the apex of its
real part at the tongue's centre. A tongue is therefore found from samples beside it, however narrow it is.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from scipy.optimize import minimize_scalar

from maglev_ctrl.analysis.floquet import scaled_coefficients
from maglev_ctrl.analysis.resonance import (
    ResonanceKind,
    StateModes,
    make_resonance,
    modal_harmonics,
    pair_indices,
    resonant_pairs,
    state_modes,
)
from maglev_ctrl.analysis.resonance_seeds import PairCoupling, pair_coupling
from maglev_ctrl.arrays import ComplexArray, FloatArray
from maglev_ctrl.errors import ModelError, OutOfDomain
from maglev_ctrl.kernels.taylor_many import monodromy_many
from maglev_ctrl.systems import PeriodicSystem

Path = Callable[[float], PeriodicSystem]

NOISE = 1e-7  # growth per period that rounding can feign at the edge of an undamped tongue
WORTH = 3.0  # tongues predicted to begin beyond this times the actual depth are looked at only at their centre
_APEX_STEPS = 8


@dataclass(frozen=True, eq=False, slots=True)
class Point:
    """One evaluated place on a path: exponents (n,) 1/s by the time-domain engine, or why there is no answer."""

    system: PeriodicSystem | None
    exponents: ComplexArray
    fault: str

    @property
    def growth(self) -> float:
        """Largest real part, 1/s; NaN where the model has no answer."""
        return float(np.max(self.exponents.real)) if self.exponents.size else float("nan")

    @property
    def unstable(self) -> bool:
        """Growth beyond what rounding can feign."""
        if self.system is None:
            return False
        return self.growth * 2.0 * np.pi / float(self.system.frequency) > NOISE


@dataclass(frozen=True, slots=True)
class Crossing:
    """A predicted tongue: kind, modes (counted from 0, in order of frequency), order, and where on the path."""

    kind: ResonanceKind
    modes: tuple[int, int]
    order: int
    at: float


@dataclass(frozen=True, slots=True)
class SoughtTongue:
    """A tongue looked for where it is predicted: its `name`, `at` (parameter) the place of most growth nearby, the
    `growth` of the whole system there (1/s), `width` (parameter) over which the pair locks or would without damping,
    and `onset`, the depth where it is predicted to begin over the actual one (inf: not within three times that).
    """

    name: str
    at: float
    growth: float
    width: float
    onset: float


@dataclass(slots=True, eq=False)
class Track:
    """A path with everything evaluated on it; a place is evaluated once.

    `reader` gives the exponents at a parameter, None where it cannot; they are integrated without it.
    """

    path: Path
    reader: Callable[[float], ComplexArray | None] | None = None
    points: dict[float, Point] = field(default_factory=dict)
    systems: dict[float, PeriodicSystem | None] = field(default_factory=dict)
    faults: dict[float, str] = field(default_factory=dict)

    def system(self, parameter: float) -> PeriodicSystem | None:
        """The system at a parameter, nothing evaluated on it; None where the model has no answer."""
        key = float(parameter)
        if key not in self.systems:
            try:
                self.systems[key] = self.path(key)
            except (ModelError, OutOfDomain) as fault:
                self.systems[key], self.faults[key] = None, str(fault)
        return self.systems[key]

    def point(self, parameter: float) -> Point:
        """The point at a parameter; a model without an answer there gives a point with its reason."""
        key = float(parameter)
        if key not in self.points:
            system = self.system(key)
            if system is None:
                self.points[key] = Point(None, np.empty(0, dtype=np.complex128), self.faults[key])
            else:
                read = None if self.reader is None else self.reader(key)
                self.points[key] = Point(system, leading_exponents(system) if read is None else read, "")
        return self.points[key]

    def growth(self, parameter: float) -> float:
        """Growth rate at a parameter, 1/s; minus infinity where there is no answer, for searches."""
        value = self.point(parameter).growth
        return value if np.isfinite(value) else -np.inf

    def highest(self, lower: float, upper: float, *, steps: int = 16) -> float:
        """Where growth is largest between two places, by a bounded search; one local maximum is found."""
        if upper - lower <= 1e-12 * max(abs(lower), abs(upper)):
            return lower
        minimize_scalar(
            lambda x: -max(self.growth(float(x)), -1e300), bounds=(lower, upper), method="bounded",
            options={"xatol": 1e-4 * (upper - lower), "maxiter": steps},
        )  # fmt: skip
        inside = [x for x in self.points if lower <= x <= upper and self.points[x].system is not None]
        return max(inside, key=self.growth) if inside else lower


def leading_exponents(system: PeriodicSystem) -> ComplexArray:
    """Floquet exponents (n,) 1/s by the time-domain engine alone, imaginary parts modulo W: for searches, not verdicts.

    Examples
    --------
    >>> mathieu = PeriodicSystem.from_matrices([[0, 1], [-1, 0]], [[[0, 0], [-0.4, 0]]], frequency=2.0)
    >>> round(float(np.max(leading_exponents(mathieu).real)), 6)
    0.099536
    """
    return np.asarray(exponents_of((system,))[0])


def exponents_of(systems: Sequence[PeriodicSystem]) -> ComplexArray:
    """Floquet exponents (B, n) 1/s of many systems of one size, as `leading_exponents` gives them.

    Examples
    --------
    >>> A_1 = [[[0, 0], [-0.4, 0]]]
    >>> pair = [PeriodicSystem.from_matrices([[0, 1], [-1, 0]], A_1, frequency=W) for W in (2.0, 2.5)]
    >>> np.max(exponents_of(pair).real, axis=1).round(6) + 0.0
    array([0.099536, 0.      ])
    """
    scaled = [scaled_coefficients(one.A_0, one.A_cos, one.A_sin) for one in systems]
    A_0, A_cos, A_sin = (np.stack(parts) for parts in zip(*scaled, strict=True))
    frequency = np.array([float(one.frequency) for one in systems])
    products = monodromy_many(A_0, A_cos, A_sin, frequency=frequency).matrices[:, 0]
    return to_exponents(np.linalg.eigvals(products).astype(np.complex128), frequency)


def to_exponents(multipliers: ComplexArray, frequency: FloatArray) -> ComplexArray:
    """Exponents (B, n) 1/s of multipliers (B, n) over one period of passing frequencies (B,) rad/s."""
    kept = np.where(np.abs(multipliers) < 1e-300, 1e-300, multipliers)
    return np.asarray(np.log(kept) * frequency[:, None] / (2.0 * np.pi))


def find_crossings(track: Track, places: FloatArray, *, max_order: int) -> list[Crossing]:
    """Where (w_i +- w_j)/k of the mean system meets, or nearly touches, the passing frequency between places.

    Parameters
    ----------
    places : (P,) parameters in order, all of them with an answer
    max_order : largest k

    Examples
    --------
    >>> A_1 = [[[0.0, 0.0], [-0.1, 0.0]]]
    >>> track = Track(lambda W: PeriodicSystem.from_matrices([[0, 1], [-1, 0]], A_1, frequency=W))
    >>> [(c.order, round(c.at, 6)) for c in find_crossings(track, np.linspace(0.9, 2.2, 6), max_order=2)]
    [(1, 2.0), (2, 1.0)]
    """
    every = [float(p) for p in places]
    counts = {p: _frequencies(track, p) for p in every}
    for left, right in pairwise(list(every)):
        every += _where_modes_appear(track, left, right, counts)
    every = sorted(set(every), key=lambda p: abs(p - float(places[0])))
    found: list[Crossing] = []
    most = max((len(w) for w in counts.values()), default=0)
    for kind, i, j in resonant_pairs(most):
        sign = -1.0 if kind == "difference" else 1.0
        for order in range(1, max_order + 1):
            gaps = [
                (p, abs(w[j] + sign * w[i]) / order - W) for p, (w, W) in ((p, (counts[p], _passing(track, p)))
                for p in every) if len(w) > max(i, j)
            ]  # fmt: skip
            found += [Crossing(kind, (i, j), order, at) for at in _roots(gaps)]
    return found


def _frequencies(track: Track, parameter: float) -> FloatArray:
    system = track.system(parameter)
    if system is None:
        return np.empty(0)
    s = np.linalg.eigvals(system.A_0)
    return np.sort(s.imag[s.imag > 1e-9 * np.abs(s)])


def _passing(track: Track, parameter: float) -> float:
    system = track.system(parameter)
    return float("nan") if system is None else float(system.frequency)


def _where_modes_appear(track: Track, left: float, right: float, counts: dict[float, FloatArray]) -> list[float]:
    """Places that close in on a change in the number of oscillating modes between two places."""
    added = []
    for _ in range(8):
        if len(counts[left]) == len(counts[right]):
            break
        middle = 0.5 * (left + right)
        counts[middle] = _frequencies(track, middle)
        added.append(middle)
        left, right = (middle, right) if len(counts[middle]) == len(counts[left]) else (left, middle)
    return added


def _roots(gaps: list[tuple[float, float]]) -> list[float]:
    """Zeros of a sampled function: sign changes, and near touches between samples of one sign."""
    roots = [p for p, gap in gaps if gap == 0.0]
    for (p, a), (q, b) in pairwise(gaps):
        if a * b < 0.0:
            roots.append(p + (q - p) * a / (a - b))
    for (p, a), (q, b), (r, c) in zip(gaps, gaps[1:], gaps[2:], strict=False):
        touching = a * b > 0.0 and b * c > 0.0 and abs(b) <= min(abs(a), abs(c))
        if touching and abs(b) <= max(abs(a), abs(c)) - abs(b):
            square, slope, _ = np.polyfit([p - q, 0.0, r - q], [a, b, c], 2)
            roots.append(float(np.clip(q - slope / (2.0 * square), min(p, r), max(p, r))) if square else q)
    return [float(root) for root in roots]


def pair_at(system: PeriodicSystem, crossing: Crossing) -> tuple[PairCoupling, StateModes] | None:
    """The pair's decay and coupling by perturbation theory at one place, in balanced coordinates; None: no pair."""
    A_0, A_cos, A_sin = scaled_coefficients(system.A_0, system.A_cos, system.A_sin)
    modes = state_modes(A_0, states=system.states)
    if max(crossing.modes) >= len(modes.oscillating):
        return None
    first, second, distance = pair_indices(modes, crossing.kind, *crossing.modes)
    coupling = pair_coupling(
        modes, modal_harmonics(modes, A_cos, A_sin), first=first, second=second, order=crossing.order,
        frequency=distance / crossing.order,
    )  # fmt: skip
    return coupling, modes


def pair_growth_in(exponents: ComplexArray, system: PeriodicSystem, crossing: Crossing) -> float:
    """Largest real part of the two exponents that belong to one pair, 1/s; NaN where there is no such pair.

    Examples
    --------
    >>> system = PeriodicSystem.from_matrices([[0, 1], [-1, 0]], [[[0, 0], [-0.4, 0]]], frequency=2.0)
    >>> round(pair_growth_in(leading_exponents(system), system, Crossing("parametric", (0, 0), 1, 2.0)), 6)
    0.099536
    """
    known = pair_at(system, crossing)
    if known is None:
        return float("nan")
    first, second = (s + shift for s, shift in zip(known[0].s, known[0].shift, strict=True))
    pair = pair_exponents(exponents, float(system.frequency), first, second)
    return max(one.real for one in pair)


def pair_exponents(
    exponents: ComplexArray, frequency: float, first: complex, second: complex
) -> tuple[complex, complex]:
    """The two exponents nearest (modulo i W) to two expected ones, the second shifted next to the first.

    Examples
    --------
    >>> pair_exponents(np.array([-0.1 + 1j, -0.2 - 0.9j]), 2.0, 1j, -1j)
    ((-0.1+1j), (-0.2+1.1j))
    """
    one, other = pairs_of(exponents[None], np.array([frequency]), np.array([first]), np.array([second]))
    return complex(one[0]), complex(other[0])


def pairs_of(
    exponents: ComplexArray, frequency: FloatArray, first: ComplexArray, second: ComplexArray
) -> tuple[ComplexArray, ComplexArray]:
    """`pair_exponents` of many systems: exponents (P, n), frequencies (P,), expected (P,); two arrays (P,)."""
    W = frequency[:, None]
    to_first = np.abs(_folded(exponents - first[:, None], W))
    to_second = np.abs(_folded(exponents - second[:, None], W))
    cost = to_first[:, :, None] + to_second[:, None, :]
    every, n = np.arange(len(exponents)), exponents.shape[1]
    cost[:, np.arange(n), np.arange(n)] = np.inf
    i, j = np.divmod(np.argmin(cost.reshape(len(exponents), -1), axis=1), n)
    one = exponents[every, i]
    return one, one - _folded(one - exponents[every, j], frequency)


def _folded(difference: ComplexArray, frequency: FloatArray) -> ComplexArray:
    return np.asarray(difference - 1j * frequency * np.round(difference.imag / frequency))


def locate(track: Track, crossing: Crossing, *, lower: float, upper: float) -> SoughtTongue | None:
    """The tongue near a predicted crossing: its place, width and the growth there; points beside it are evaluated.

    Parameters
    ----------
    crossing : see `find_crossings`
    lower, upper : the search stays between them

    Examples
    --------
    >>> A_0, A_1 = [[0.0, 1.0], [-1.0, -2e-4]], [[[0.0, 0.0], [-1e-3, 0.0]]]
    >>> track = Track(lambda W: PeriodicSystem.from_matrices(A_0, A_1, frequency=W))
    >>> found = locate(track, Crossing("parametric", (0, 0), 1, 2.003), lower=1.5, upper=2.5)
    >>> round(found.at, 5), round(found.width, 5), f"{found.growth:.2g}"
    (2.0, 0.001, '0.00015')
    """
    start = float(np.clip(crossing.at, lower, upper))
    system = track.point(start).system
    known = None if system is None else pair_at(system, crossing)
    if system is None or known is None:
        return None
    coupling, modes = known
    harmonics = len(system.A_cos)
    onset = coupling.critical(WORTH)
    name = make_resonance(crossing.kind, crossing.order, (crossing.modes[0] + 1, crossing.modes[1] + 1), modes.labels,
                          frequency=float(system.frequency)).name  # fmt: skip
    if np.isinf(onset) and crossing.order <= 2 * harmonics:
        return SoughtTongue(name, start, track.growth(start), 0.0, onset)
    expected = tuple(s + shift for s, shift in zip(coupling.s, coupling.shift, strict=True))
    centre, width = apex(track, start, expected, lower, upper)
    for share in (-0.95, -0.6, -0.3, 0.0, 0.3, 0.6, 0.95):
        track.growth(float(np.clip(centre + 0.5 * share * width, lower, upper)))
    reach = (max(lower, centre - 0.75 * width), min(upper, centre + 0.75 * width))
    at = track.highest(*reach, steps=14)
    return SoughtTongue(name, at, track.growth(at), width, onset)


def apex(track: Track, start: float, expected: tuple[complex, ...], lower: float, upper: float) -> tuple[float, float]:
    """Apex of Re (s - s')^2 over the parameter, and the full width over which the pair locks."""
    centre, reach = start, 0.02 * (upper - lower)
    width = reach

    def squared(parameter: float) -> float:
        here = track.point(parameter)
        if here.system is None:
            return float("nan")
        one, other = pair_exponents(here.exponents, float(here.system.frequency), expected[0], expected[1])
        return float(((one - other) ** 2).real)

    decay = abs(expected[0].real + expected[1].real)
    for _ in range(_APEX_STEPS):
        left, right = max(lower, centre - reach), min(upper, centre + reach)
        places = np.array([left, 0.5 * (left + right), right])
        values = np.array([squared(float(p)) for p in places])
        if not np.all(np.isfinite(values)) or right - left <= 1e-13 * max(abs(left), abs(right), 1e-300):
            break
        square, slope, height = np.polyfit((places - places[1]) / reach, values, 2)
        if square >= 0.0:
            reach *= 0.25
            continue
        vertex = float(np.clip(-slope / (2.0 * square), -1.0, 1.0))
        top = height + slope * vertex + square * vertex**2
        # Real parts of a damped pair make a bump of their own; without any, the coupling alone sets the width.
        width = 2.0 * reach * float(np.sqrt(max(abs(top), 1e-6 * decay**2) / -square))
        moved, centre = abs(vertex) * reach, float(places[1]) + vertex * reach
        if moved <= 0.02 * width and reach <= 3.0 * width:
            break
        reach = min(reach, max(1.5 * width, 0.2 * reach, 0.0 if abs(vertex) < 0.999 else reach))
    return centre, min(width, upper - lower)


def polished(exact: Callable[[float], float], sought: Callable[[float], float], root: float, step: float) -> float:
    """A root of `sought` moved to that of `exact`, which costs more and differs by little: one step of Newton's.

    The slope is that of `sought` over `step` to either side. The root stays where the step would leave that range.

    Examples
    --------
    >>> round(polished(lambda x: x**2 - 2.0, lambda x: x**2 - 2.000001, 2.000001**0.5, 1e-3) - 2**0.5, 12)
    0.0
    """
    slope = (sought(root + step) - sought(root - step)) / (2.0 * step)
    moved = root - exact(root) / slope if abs(slope) > 0.0 else root
    return moved if abs(moved - root) <= step else root
