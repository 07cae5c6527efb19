"""Parametric and combination resonances: where the tongues lie, how wide they are, at which depth they begin.

Perturbation theory on the eigenpairs of the full first-order state matrix A_0 (right and left eigenvectors), so that
internal states, controllers, damping and circulatory terms are all in it; for light damping it is Hsu's result.
`hsu_tongues` is that result itself for M q'' + C q' + [K + depth (K_cos cos W t + K_sin sin W t)] q = 0.

References: Hsu, J. Appl. Mech. 30 (1963) 367; Yakubovich and Starzhinskii (1975).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy import linalg

from maglev_ctrl.analysis.modes import leading_names, unique_labels
from maglev_ctrl.arrays import ComplexArray, FloatArray, read_only
from maglev_ctrl.errors import ModelError
from maglev_ctrl.kernels import eigen_triplets
from maglev_ctrl.systems import SecondOrderSystem, modulate

ResonanceKind = Literal["parametric", "sum", "difference", "none"]

_UNDAMPED = 1e-9  # real part of a mode, relative to its modulus, below which it counts as undamped


@dataclass(frozen=True, slots=True)
class Resonance:
    """A named resonance: 2 w_i/k ("parametric"), (w_i + w_j)/k ("sum"), (w_j - w_i)/k ("difference") or "none".

    `modes` counts the oscillating modes of A_0 from 1 in order of frequency, as the name does; `order` is k;
    `frequency` is the exactly resonant passing frequency in rad/s and `detuning` the actual one minus it.
    """

    kind: ResonanceKind
    order: int
    modes: tuple[int, ...]
    labels: tuple[str, ...]
    frequency: float
    detuning: float
    name: str


NO_RESONANCE = Resonance("none", 0, (), (), float("nan"), float("nan"), "none")


@dataclass(frozen=True, slots=True)
class Tongue:
    """First-order tongue of instability at one depth.

    `centre` and `half_width` of the unstable interval in W (rad/s; 0 below the threshold, inf where phases or one-sided
    damping leave no edge), `threshold` the depth where it begins, `growth` (1/s) the growth rate at exact resonance.
    """

    resonance: Resonance
    depth: float
    centre: float
    half_width: float
    threshold: float
    growth: float


@dataclass(frozen=True, eq=False, slots=True)
class StateModes:
    """Eigenvalues `s` (n,) of A_0 with `right` (n, n) and `left` (n, n) vectors, left^H right = 1.

    `oscillating` holds the indices with positive imaginary part in order of frequency, `conjugate[i]` the index of the
    conjugate of eigenvalue i, `labels` one name per oscillating mode (its leading coordinate).
    """

    s: ComplexArray
    right: ComplexArray
    left: ComplexArray
    oscillating: tuple[int, ...]
    conjugate: tuple[int, ...]
    labels: tuple[str, ...]

    @property
    def frequencies(self) -> FloatArray:
        """Damped natural frequencies of the oscillating modes, rad/s, ascending."""
        return np.asarray(self.s.imag[list(self.oscillating)])


def state_modes(A_0: FloatArray, *, states: tuple[str, ...] = (), labels: tuple[str, ...] | None = None) -> StateModes:
    """Eigenvalues with right and left eigenvectors of a state matrix, left^H right = 1.

    Parameters
    ----------
    A_0 : (n, n) 1/s
    states : names of the states, from which each mode gets the names of its leading coordinates
    labels : names of the oscillating modes in order of frequency, instead

    Examples
    --------
    >>> state_modes(np.array([[0.0, 1.0], [-4.0, 0.0]])).frequencies
    array([2.])
    """
    s, right, left = _eigenvectors(A_0)
    size = np.maximum(np.abs(s), 1e-300)
    positive = [int(i) for i in np.nonzero(s.imag > 1e-9 * size)[0]]
    oscillating = tuple(sorted(positive, key=lambda i: float(s[i].imag)))
    conjugate = tuple(int(np.argmin(np.abs(s - value.conjugate()))) for value in s)
    names = labels if labels is not None else _leading_states(right, left, oscillating, states)
    if len(names) < len(oscillating):
        names = (*names, *("" for _ in range(len(oscillating) - len(names))))
    return StateModes(s, right, left, oscillating, conjugate, tuple(names))


def _eigenvectors(A_0: FloatArray) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
    """Eigenvalues, right and left vectors with left^H right = 1; in a defective pair (free rigid motion) the left
    vectors are scaled one by one, and those without overlap stay at unit length."""
    s, own_left, right = eigen_triplets(A_0)
    if np.linalg.cond(right) < 1e10:
        return s, right, np.asarray(np.linalg.inv(right).conj().T)
    overlap = np.sum(own_left.conj() * right, axis=0)
    usable = np.abs(overlap) > 1e-8
    return s, right, np.asarray(own_left / np.where(usable, overlap.conj(), 1.0))


def _leading_states(
    right: ComplexArray, left: ComplexArray, oscillating: tuple[int, ...], states: tuple[str, ...]
) -> tuple[str, ...]:
    if not states:
        return tuple("" for _ in oscillating)
    share = np.abs(right * left.conj())[:, list(oscillating)]
    coordinates = tuple(dict.fromkeys(state.removesuffix(".velocity") for state in states))
    weights = np.zeros((len(coordinates), len(oscillating)))
    for state, row in zip(states, share, strict=True):
        weights[coordinates.index(state.removesuffix(".velocity"))] += row
    return unique_labels(tuple(leading_names(coordinates, weights)))


def make_resonance(
    kind: ResonanceKind, order: int, modes: tuple[int, int], labels: tuple[str, ...], *, frequency: float,
    detuning: float = 0.0,
) -> Resonance:  # fmt: skip
    """A `Resonance` with its name; `modes` counted from 1.

    Examples
    --------
    >>> make_resonance("sum", 1, (1, 2), ("heave", "pitch"), frequency=2.7).name
    '(w1 + w2)/1 (heave, pitch)'
    """
    i, j = modes
    pattern = {"parametric": f"2 w{i}/{order}", "sum": f"(w{i} + w{j})/{order}", "difference": f"(w{j} - w{i})/{order}"}
    unique = tuple(dict.fromkeys(labels[m - 1] for m in modes))
    told = f" ({', '.join(unique)})" if all(unique) else ""
    return Resonance(kind, order, modes, tuple(labels[m - 1] for m in modes), frequency, detuning, pattern[kind] + told)


def modal_harmonics(modes: StateModes, A_cos: FloatArray, A_sin: FloatArray) -> dict[int, ComplexArray]:
    """Modal coupling per signed harmonic q: B_q = left^H A_q right, A_q = (A_cos - i A_sin)/2, A_-q its conjugate."""
    result: dict[int, ComplexArray] = {}
    for q, (cosine, sine) in enumerate(zip(A_cos, A_sin, strict=True), start=1):
        upper = 0.5 * (cosine - 1j * sine)
        result[q] = modes.left.conj().T @ upper @ modes.right
        result[-q] = modes.left.conj().T @ upper.conj() @ modes.right
    return result


def pair_growth(decay_i: float, decay_j: float, product: complex, detuning: float) -> float:
    """Largest Re s of (s + decay_i + i detuning/2)(s + decay_j - i detuning/2) = product: growth of one resonance, 1/s.

    Examples
    --------
    >>> pair_growth(0.0, 0.0, 0.04 + 0j, 0.0)
    0.2
    """
    p, q = decay_i + 0.5j * detuning, decay_j - 0.5j * detuning
    root = np.sqrt(complex((p - q) ** 2 / 4.0 + product))
    return float(max((-(p + q) / 2.0 + root).real, (-(p + q) / 2.0 - root).real))


def pair_threshold(decay_i: float, decay_j: float, product: complex) -> float:
    """Depth where |growth| first reaches zero over all detunings, product being that at unit depth; inf when none.

    With a, b the decay rates and g the product, the edge condition is Im(g)^2 e^4 + 4ab Re(g) e^2 = 4 a^2 b^2.

    Examples
    --------
    >>> pair_threshold(0.1, 0.4, 1.0 + 0j)
    0.2
    """
    if decay_i < 0.0 or decay_j < 0.0:
        return 0.0
    reach = abs(product) + product.real
    if reach <= 1e-12 * abs(product) or abs(product) == 0.0:
        return float("inf")
    return float(np.sqrt(2.0 * decay_i * decay_j / reach))


def pair_interval(decay_i: float, decay_j: float, product: complex) -> tuple[float, float]:
    """Centre and half-width of the unstable detunings; half-width 0 when there is none, inf when there is no edge.

    Edges: a b d^2 + (b - a) Im(g) d - Im(g)^2 - (a + b)^2 (Re(g) - a b) = 0.

    Examples
    --------
    >>> pair_interval(0.0, 0.0, 0.0025 + 0j)
    (0.0, 0.1)
    """
    a, b, g = decay_i, decay_j, product
    if a < 0.0 or b < 0.0:
        return 0.0, float("inf")
    real = abs(g.imag) <= 1e-9 * abs(g)
    if a == 0.0 and b == 0.0:
        if not real:
            return 0.0, float("inf")
        return 0.0, 2.0 * float(np.sqrt(max(g.real, 0.0)))
    if a * b == 0.0:
        unstable = g.real > 0.0 or not real
        return 0.0, float("inf") if unstable else 0.0
    square, linear = a * b, (b - a) * g.imag
    constant = -(g.imag**2) - (a + b) ** 2 * (g.real - a * b)
    discriminant = linear**2 - 4.0 * square * constant
    if discriminant <= 0.0:
        return 0.0, 0.0
    return -linear / (2.0 * square), float(np.sqrt(discriminant)) / (2.0 * square)


def resonant_pairs(count: int) -> list[tuple[ResonanceKind, int, int]]:
    """All pairs of `count` oscillating modes with their kind, i <= j counted from 0."""
    pairs: list[tuple[ResonanceKind, int, int]] = [("parametric", i, i) for i in range(count)]
    for i in range(count):
        for j in range(i + 1, count):
            pairs += [("sum", i, j), ("difference", i, j)]
    return pairs


def pair_indices(modes: StateModes, kind: ResonanceKind, i: int, j: int) -> tuple[int, int, float]:
    """Eigenvalue indices (first, second) with Im s_first - Im s_second = the resonant sum or difference, and that."""
    low, high = modes.oscillating[i], modes.oscillating[j]
    first, second = (low, modes.conjugate[high]) if kind != "difference" else (high, low)
    return first, second, float(modes.s[first].imag - modes.s[second].imag)


def state_tongues(
    A_0: FloatArray, A_cos: FloatArray, A_sin: FloatArray, *, depth: float, states: tuple[str, ...] = (),
    labels: tuple[str, ...] | None = None,
) -> tuple[Tongue, ...]:  # fmt: skip
    """First-order tongues of x' = [A_0 + depth sum_k (A_cos[k] cos k W t + A_sin[k] sin k W t)] x.

    One per pair of oscillating modes, kind and harmonic k present; ordered by centre.

    Parameters
    ----------
    A_0 : (n, n); A_cos, A_sin : (H, n, n) at unit depth, 1/s
    depth : modulation depth
    states, labels : names, see `state_modes`

    Examples
    --------
    >>> A_0, A_1 = np.array([[0.0, 1.0], [-1.0, -0.02]]), np.array([[[0.0, 0.0], [-1.0, 0.0]]])
    >>> tongue = state_tongues(A_0, A_1, 0 * A_1, depth=0.1)[0]
    >>> tongue.resonance.name, round(tongue.threshold, 5)
    ('2 w1/1', 0.04)
    """
    modes = state_modes(A_0, states=states, labels=labels)
    couplings = modal_harmonics(modes, A_cos, A_sin)
    found = []
    for kind, i, j in resonant_pairs(len(modes.oscillating)):
        first, second, distance = pair_indices(modes, kind, i, j)
        decays = tuple(
            0.0 if abs(s.real) <= _UNDAMPED * abs(s) else -float(s.real) for s in (modes.s[first], modes.s[second])
        )
        for order in range(1, len(A_cos) + 1):
            product = complex(couplings[order][first, second] * couplings[-order][second, first])
            resonance = make_resonance(kind, order, (i + 1, j + 1), modes.labels, frequency=distance / order)
            found.append(_tongue(resonance, decays[0], decays[1], product, depth))
    return tuple(sorted(found, key=lambda t: t.resonance.frequency))


def _tongue(resonance: Resonance, a: float, b: float, product: complex, depth: float) -> Tongue:
    shift, half = pair_interval(a, b, product * depth**2)
    return Tongue(
        resonance=resonance,
        depth=depth,
        centre=resonance.frequency + shift / resonance.order,
        half_width=half / resonance.order,
        threshold=pair_threshold(a, b, product),
        growth=pair_growth(a, b, product * depth**2, 0.0),
    )


def tongues(
    system: SecondOrderSystem, K_cos: ArrayLike, K_sin: ArrayLike | None = None, *, depth: float,
    labels: tuple[str, ...] | None = None,
) -> tuple[Tongue, ...]:  # fmt: skip
    """First-order tongues of a vehicle (open or closed loop) whose stiffness is modulated.

    Parameters
    ----------
    system : one operating point
    K_cos, K_sin : (H, n, n) N/m at unit depth
    depth : modulation depth
    labels : names of the oscillating modes in order of frequency

    Raises
    ------
    ValueError : a shape does not fit

    Examples
    --------
    >>> spring = SecondOrderSystem.from_matrices([[1.0]], [[0.0]], [[4.0]], dofs=("heave",))
    >>> [(t.resonance.name, round(t.centre, 9), round(t.half_width, 9)) for t in tongues(spring, [[[4.0]]], depth=0.1)]
    [('2 w1/1 (heave)', 4.0, 0.1)]
    """
    unit = modulate(system, K_cos, K_sin, frequency=1.0)
    return state_tongues(unit.A_0, unit.A_cos, unit.A_sin, depth=depth, states=system.states, labels=labels)


def hsu_tongues(
    M: ArrayLike, K: ArrayLike, K_cos: ArrayLike, *, K_sin: ArrayLike | None = None, C: ArrayLike | None = None,
    depth: float,
) -> tuple[Tongue, ...]:  # fmt: skip
    """Hsu's first-order tongues of M q'' + C q' + [K + depth (K_cos cos W t + K_sin sin W t)] q = 0.

    Modes of the undamped system, modal damping c_i = left_i^T C right_i; K and K_cos need not be symmetric.

    Parameters
    ----------
    M, C, K, K_cos, K_sin : (n, n)
    depth : modulation depth

    Raises
    ------
    ModelError : the undamped system has no n distinct real positive natural frequencies (flutter or divergence)

    Examples
    --------
    >>> found = hsu_tongues(np.eye(2), np.diag([1.0, 2.89]), [[0.5, 0.4], [0.3, 0.6]], depth=0.05)
    >>> [(t.resonance.name, round(t.half_width, 6)) for t in found if t.half_width > 0]
    [('2 w1/1', 0.0125), ('(w1 + w2)/1', 0.006642), ('2 w2/1', 0.008824)]
    """
    mass, stiffness = read_only(M, name="M", shape=(None, None)), read_only(K, name="K", shape=(None, None))
    n = mass.shape[-1]
    cosine = read_only(K_cos, name="K_cos", shape=(n, n))
    sine = np.zeros((n, n)) if K_sin is None else read_only(K_sin, name="K_sin", shape=(n, n))
    damping = np.zeros((n, n)) if C is None else read_only(C, name="C", shape=(n, n))
    squares, R = linalg.eig(np.linalg.solve(mass, stiffness))
    if np.any(np.abs(squares.imag) > 1e-12 * np.abs(squares)) or np.any(squares.real <= 0.0):
        raise ModelError("K: expected distinct real positive squares of natural frequencies, got flutter or divergence")
    order = np.argsort(squares.real)
    w, R = np.sqrt(squares.real[order]), np.real(R[:, order])
    L = np.linalg.inv(mass @ R)
    modal = L @ (cosine - 1j * sine) @ R
    decay = 0.5 * np.diag(L @ damping @ R)
    found = []
    for kind, i, j in resonant_pairs(n):
        if kind == "difference":
            product = -modal[i, j].conjugate() * modal[j, i] / (16.0 * w[i] * w[j])
            a, b, centre = decay[j], decay[i], w[j] - w[i]
        else:
            product = modal[i, j] * modal[j, i].conjugate() / (16.0 * w[i] * w[j])
            a, b, centre = decay[i], decay[j], w[i] + w[j]
        resonance = make_resonance(kind, 1, (i + 1, j + 1), ("",) * n, frequency=float(centre))
        found.append(_tongue(resonance, float(a), float(b), complex(product), depth))
    return tuple(sorted(found, key=lambda t: t.resonance.frequency))
