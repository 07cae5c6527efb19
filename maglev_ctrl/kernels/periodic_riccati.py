"""Periodic stabilising solution of -P' = A'P + P A - P G P + Q with T-periodic A, G, Q, by structured doubling.

The Hamiltonian [[A, -G], [-Q, -A']] is carried over short segments by Taylor propagators. Each transition becomes a
triple (E, G, H) with x_1 = E x_0 - G l_1, l_0 = H x_0 + E' l_1 for states x and multipliers l: the form in which
products lose no symmetry and nothing that grows is ever formed. Triples are composed over the period, the period is
doubled until P(0) stands (E. K.-W. Chu, H.-Y. Fan, W.-W. Lin, C.-S. Wang, Int. J. Control 77 (2004) 767), and P at
the other instants follows from one stable pass backward in time. G = 0 gives the periodic Lyapunov equation.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from maglev_ctrl.arrays import ComplexArray, FloatArray, join_columns, join_rows, transpose
from maglev_ctrl.kernels import scaling
from maglev_ctrl.kernels.fourier_matrix import FourierMatrix
from maglev_ctrl.kernels.periodic_qr import periodic_multipliers
from maglev_ctrl.kernels.scaling import balance, eigen_triplets, rescale
from maglev_ctrl.kernels.taylor import propagators_over_depths, taylor_plan, tree_product

_STEP = 1.0  # norm of the Hamiltonian times the segment length: beyond, transitions lose digits before they are triples
_MOST_SEGMENTS = 50_000
_DOUBLINGS = 60
_ON_CIRCLE = 1e-10  # a closed-loop multiplier with a modulus above 1 less this does not count as stable
_NOISE = 4.0


@dataclass(frozen=True, eq=False, slots=True)
class Triple:
    """x_1 = E x_0 - G l_1, l_0 = H x_0 + E' l_1; each (..., n, n), G and H symmetric."""

    E: FloatArray
    G: FloatArray
    H: FloatArray


@dataclass(frozen=True, eq=False, slots=True)
class PeriodicRiccati:
    """Periodic stabilising solution at the times i T / S, i = 0..S-1.

    `P` (S, n, n); `closed` (S, n, n) transition of the closed loop from each time to the next; `logs` (n,) logarithms
    of its multipliers, largest modulus first; `closure` relative change of P(0) over one more period backward;
    `series` the Fourier series of P, `series_error` its error relative to P by the harmonics left out, both in
    coordinates that make the mean diagonal of P one; `doublings` made; `final_weight` whether doubling needed one
    (a growing mode that Q does not see).
    """

    P: FloatArray
    closed: FloatArray
    logs: ComplexArray
    closure: float
    series: FourierMatrix
    series_error: float
    doublings: int
    final_weight: bool


@dataclass(frozen=True, eq=False, slots=True)
class _Scaled:
    """Scaled data and the scaling back: x = states * x_scaled, P = level / outer(states, states) * P_scaled."""

    A: FourierMatrix
    G: FourierMatrix
    Q: FourierMatrix
    states: FloatArray
    level: float


def structured(transitions: FloatArray) -> Triple:
    """Triples of symplectic transitions (..., 2n, 2n) of (x, l).

    Examples
    --------
    >>> triple = structured(np.array([[1.0, -0.5], [0.0, 1.0]]))
    >>> float(triple.E[0, 0]), float(triple.G[0, 0]), abs(float(triple.H[0, 0]))
    (1.0, 0.5, 0.0)
    """
    n = transitions.shape[-1] // 2
    back = np.linalg.inv(transitions[..., n:, n:])
    return Triple(
        np.ascontiguousarray(transpose(back)),
        _symmetric(-transitions[..., :n, n:] @ back),
        _symmetric(-back @ transitions[..., n:, :n]),
    )


def compose(first: Triple, second: Triple) -> Triple:
    """The triple of `first` followed in time by `second`; leading axes broadcast.

    Examples
    --------
    >>> one = structured(np.array([[1.0, -0.5], [0.0, 1.0]]))
    >>> float(compose(one, one).G[0, 0])
    1.0
    """
    n = first.E.shape[-1]
    through = np.linalg.solve(np.eye(n) + first.G @ second.H, join_columns([first.E, first.G]))
    ahead, spread = through[..., :n], through[..., n:]
    return Triple(
        second.E @ ahead,
        second.G + _symmetric(second.E @ spread @ transpose(second.E)),
        first.H + _symmetric(transpose(first.E) @ second.H @ ahead),
    )


def over_period(triples: Triple) -> Triple:
    """All triples of the first axis composed, pairwise."""
    while len(triples.E) > 1:
        even = 2 * (len(triples.E) // 2)
        early, late, rest = (_part(triples, x) for x in (slice(0, even, 2), slice(1, even, 2), slice(even, None)))
        joined = compose(early, late)
        triples = Triple(*(np.concatenate([getattr(joined, k), getattr(rest, k)]) for k in ("E", "G", "H")))
    return _part(triples, 0)


def with_final_weight(triple: Triple, S: FloatArray) -> Triple:
    """The triple in l - S x, so that doubling starts from the final cost x'S x instead of none."""
    n = len(S)
    through = np.asarray(np.linalg.solve(np.eye(n) + triple.G @ S, join_columns([triple.E, triple.G])), dtype=float)
    ahead, spread = through[:, :n], through[:, n:]
    return Triple(ahead, _symmetric(spread), triple.H - S + _symmetric(triple.E.T @ S @ ahead))


def doubled(triple: Triple) -> tuple[FloatArray, FloatArray, int]:
    """Limit of H under composition with itself, the last E, and the number of doublings.

    Examples
    --------
    >>> triple = Triple(np.array([[1.0]]), np.array([[1.0]]), np.array([[1.0]]))
    >>> round(float(doubled(triple)[0][0, 0]), 12)  # p = 1 + p/(1 + p)
    1.61803398875
    """
    count = 0
    while count < _DOUBLINGS:
        count += 1
        last, triple = triple, compose(triple, triple)
        moved, size = np.linalg.norm(triple.H - last.H), np.linalg.norm(triple.H)
        # E shrinks as fast as H settles; both have to, for H alone may settle on a solution that does not stabilise.
        if not np.isfinite(size) or (moved <= 1e-16 * size and np.linalg.norm(triple.E) <= 1e-8):
            break
    return triple.H, triple.E, count


def periodic_riccati(
    A: FourierMatrix, G: FourierMatrix, Q: FourierMatrix, *, segments: int = 64
) -> PeriodicRiccati | None:
    """Periodic stabilising solution; None where doubling finds none.

    Parameters
    ----------
    A, G, Q : (n, n) with the same frequency; G and Q symmetric, positive semidefinite
    segments : least number per period; more are taken where A is fast

    Raises
    ------
    ValueError : shapes or frequencies do not fit, or the system is too fast for its period

    Examples
    --------
    >>> one = FourierMatrix.of([[1.0]], frequency=2.0)
    >>> found = periodic_riccati(one, one, one)
    >>> round(float(found.P[0, 0, 0]), 12)  # 2 p - p^2 + 1 = 0
    2.414213562373
    """
    problem = _scaled(A, G, Q)
    if segments < 4:
        raise ValueError("segments: expected at least 4 per period")
    with np.errstate(all="ignore"):
        try:
            pieces = structured(_transitions(problem, segments))
            whole = over_period(pieces)
            size = 1.0 + float(np.linalg.norm(whole.H))
            # without G nothing can turn a growing motion round, so a final weight has nothing to find
            for weight in (0.0, size, 1e3 * size) if np.any(problem.G.magnitude()) else (0.0,):
                found = _settled(pieces, whole, weight)
                if found is not None:
                    P, closed, closure, doublings = found
                    logs = periodic_multipliers(closed).logs
                    if logs[0].real < -_ON_CIRCLE:
                        return _finished(problem, P, closed, logs, closure, doublings, weight > 0.0)
        except np.linalg.LinAlgError:
            return None
    return None


def hidden_multipliers(
    A: FourierMatrix, B: FourierMatrix, Q: FourierMatrix, *, tolerance: float = 1e-9
) -> tuple[ComplexArray, ComplexArray]:
    """Multipliers on or outside the unit circle that B never moves, and those on it that Q never sees.

    Parameters
    ----------
    A, B, Q : (n, n), (n, m), (n, n); the Popov-Belevitch-Hautus test with Floquet vectors in place of eigenvectors
    tolerance : largest share of the Floquet vector over the period that counts as none

    Examples
    --------
    >>> A = FourierMatrix.of([[0.1, 0.0], [0.0, -1.0]], frequency=1.0)
    >>> B, Q = (FourierMatrix.of(x, frequency=1.0) for x in ([[0.0], [1.0]], np.eye(2)))
    >>> hidden_multipliers(A, B, Q)[0].real.round(6)
    array([1.874456])
    """
    scale = balance(A.magnitude())
    a = FourierMatrix.of(*(rescale(x, scale) for x in (A.mean, A.cosine, A.sine)), frequency=A.frequency)
    factors = _propagators(a, 16)
    reach = B.scaled(1.0 / scale, np.ones(B.mean.shape[1])).samples(len(factors))
    look = Q.scaled(scale, scale).samples(len(factors))
    values, left, right = eigen_triplets(tree_product(factors))
    unmoved, unseen = np.zeros(len(values), dtype=bool), np.zeros(len(values), dtype=bool)
    for i, value in enumerate(values):
        off_circle = abs(value) - 1.0
        if off_circle >= -1e-7:
            unmoved[i] = _share(transpose(reach), _backward(factors, left[:, i])) <= tolerance
        if abs(off_circle) <= 1e-7:
            unseen[i] = _share(look, _forward(factors, right[:, i])) <= tolerance
    return np.asarray(values[unmoved], dtype=complex), np.asarray(values[unseen], dtype=complex)


def _scaled(A: FourierMatrix, G: FourierMatrix, Q: FourierMatrix) -> _Scaled:
    """Balance the Hamiltonian by a symplectic diagonal and level Q against G; powers of two, so nothing is rounded."""
    n = A.mean.shape[0]
    for name, matrix in (("A", A), ("G", G), ("Q", Q)):
        if matrix.mean.shape != (n, n):
            raise ValueError(f"{name}: expected shape ({n}, {n}), got {matrix.mean.shape}")
    strong, heavy = G.magnitude(), Q.magnitude()
    if np.any(strong) and np.any(heavy):
        magnitude = np.block([[A.magnitude(), strong], [heavy, A.magnitude().T]])
        np.fill_diagonal(magnitude, 0.0)
        found = scaling.balance(magnitude)
        states = np.exp2(np.round(0.5 * np.log2(found[:n] / found[n:])))
    else:
        states = balance(A.magnitude())
    heaviest = np.linalg.norm(heavy * np.outer(states, states))
    strongest = np.linalg.norm(strong / np.outer(states, states))
    level = 1.0
    if heaviest > 0.0:
        ratio = np.log2(heaviest) if strongest == 0.0 else 0.5 * np.log2(heaviest / strongest)
        level = float(np.exp2(np.round(ratio)))
    back = 1.0 / states
    return _Scaled(
        A.scaled(back, states), G.scaled(level * back, back), Q.scaled(states / level, states), states, level
    )


def _transitions(problem: _Scaled, segments: int) -> FloatArray:
    """Transitions of the Hamiltonian over each segment, (S, 2n, 2n)."""
    most = max(x.harmonics for x in (problem.A, problem.G, problem.Q))
    A, G, Q = (x.padded(most) for x in (problem.A, problem.G, problem.Q))
    whole = [
        join_rows([join_columns([a, -g]), join_columns([-q, -transpose(a)])])
        for a, g, q in ((getattr(A, k), getattr(G, k), getattr(Q, k)) for k in ("mean", "cosine", "sine"))
    ]
    return _propagators(FourierMatrix.of(*whole, frequency=problem.A.frequency), segments)


def _propagators(A: FourierMatrix, segments: int) -> FloatArray:
    """Transitions of x' = A(t) x over at least so many equal parts of the period, short against every rate."""
    A = A.padded(1)
    sizes = A.norms()
    least = max(segments, int(np.ceil(float(np.sum(sizes)) * A.period / _STEP)))
    if least > _MOST_SEGMENTS:
        raise ValueError(
            f"A: a rate of {float(np.sum(sizes)):.3g} 1/s needs {least} segments in a period of {A.period:.3g} s; "
            f"at most {_MOST_SEGMENTS} are allowed"
        )
    plan = taylor_plan(float(sizes[0]), sizes[1:], frequency=A.frequency, min_segments=least)
    depths = np.ones(1)
    found = propagators_over_depths(A.mean, A.cosine, A.sine, frequency=A.frequency, depths=depths, plan=plan)
    return np.asarray(found[0])


def _settled(pieces: Triple, whole: Triple, weight: float) -> tuple[FloatArray, FloatArray, float, int] | None:
    """P at every instant, the closed loop's transitions, the closure, and the doublings; None where it diverges."""
    S = weight * np.eye(whole.E.shape[0])
    limit, _, doublings = doubled(with_final_weight(whole, S) if weight else whole)
    start = _symmetric(limit + S)
    if not np.all(np.isfinite(start)):
        return None
    first, _ = _backward_pass(pieces, start)
    P, closed = _backward_pass(pieces, first[0])
    if not (np.all(np.isfinite(P)) and np.all(np.isfinite(closed))):
        return None
    closure = float(np.linalg.norm(P[0] - start) / max(float(np.linalg.norm(P[0])), 1e-300))
    return P, closed, closure, doublings


def _backward_pass(pieces: Triple, P_end: FloatArray) -> tuple[FloatArray, FloatArray]:
    count, n = pieces.E.shape[:2]
    P, closed = np.empty_like(pieces.E), np.empty_like(pieces.E)
    after = P_end
    for k in range(count - 1, -1, -1):
        closed[k] = np.linalg.solve(np.eye(n) + pieces.G[k] @ after, pieces.E[k])
        after = _symmetric(pieces.H[k] + pieces.E[k].T @ after @ closed[k])
        P[k] = after
    return P, closed


def _finished(
    problem: _Scaled, P: FloatArray, closed: FloatArray, logs: ComplexArray, closure: float, doublings: int,
    final_weight: bool,
) -> PeriodicRiccati:  # fmt: skip
    back = 1.0 / problem.states
    true_P = problem.level * P * np.outer(back, back)
    series, error = _series(true_P, problem.A.frequency)
    return PeriodicRiccati(
        P=true_P, closed=closed * problem.states[:, None] * back, logs=logs, closure=closure, series=series,
        series_error=error, doublings=doublings, final_weight=final_weight,
    )  # fmt: skip


def _series(P: FloatArray, frequency: float) -> tuple[FourierMatrix, float]:
    """Fourier series of P up to where its coefficients drown in rounding, and the size of what is left out."""
    diagonal = np.sqrt(np.abs(np.diagonal(np.mean(P, axis=0))))
    diagonal = np.where(diagonal > 0.0, diagonal, 1.0)
    weight = np.outer(diagonal, diagonal)
    spectrum = np.fft.rfft(P / weight, axis=0) / len(P)
    most = (len(P) - 1) // 2
    sizes = np.linalg.norm(spectrum[: most + 1], axis=(1, 2))
    size = max(float(sizes[0]), 1e-300)
    floor = _NOISE * float(np.median(sizes[2 * most // 3 :])) + 1e-16 * size
    above = np.nonzero(sizes > floor)[0]
    harmonics = min(most, int(above[-1]) if len(above) else 0)
    left_out = 2.0 * float(np.sum(sizes[harmonics + 1 :])) + float(sizes[-1])  # what lies beyond folds back
    return FourierMatrix.from_samples(P, frequency=frequency, harmonics=harmonics), left_out / size


def _forward(factors: FloatArray, start: ComplexArray) -> ComplexArray:
    """The solution through `start` at every instant of the period: (S, n)."""
    path = [start]
    for factor in factors[:-1]:
        path.append(factor @ path[-1])
    return np.asarray(path)


def _backward(factors: FloatArray, end: ComplexArray) -> ComplexArray:
    """The adjoint solution that ends in `end`, at the starts of the segments: (S, n)."""
    path = [factors[-1].T @ end]
    for factor in factors[-2::-1]:
        path.append(factor.T @ path[-1])
    return np.asarray(path[::-1])


def _share(matrices: FloatArray, path: ComplexArray) -> float:
    """Size of matrices[k] path[k] over the period relative to the sizes of both."""
    seen = np.linalg.norm(np.einsum("kij,kj->ki", matrices, path), axis=1)
    both = np.linalg.norm(matrices, axis=(1, 2)) * np.linalg.norm(path, axis=1)
    return float(np.linalg.norm(seen) / max(float(np.linalg.norm(both)), 1e-300))


def _part(triples: Triple, index: slice | int) -> Triple:
    return Triple(triples.E[index], triples.G[index], triples.H[index])


def _symmetric(matrix: FloatArray) -> FloatArray:
    return np.asarray(0.5 * (matrix + transpose(matrix)))
