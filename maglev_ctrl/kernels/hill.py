"""Hill's method: Floquet exponents as eigenvalues of the harmonic-balance operator, frequency domain.

A solution e^(st) sum_k p_k e^(ikWt) of x' = A(t) x satisfies (A_0 - i k W) p_k + sum_l A_(k-l) p_l = s p_k. Every
exponent appears once per harmonic shift (s + i m W); truncation spoils the copies near the edge. The physical ones are
picked by their harmonic content: resolved away from the edge, one shift per family, the most central one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import linalg
from scipy.sparse.csgraph import connected_components

from maglev_ctrl.arrays import ComplexArray, FloatArray
from maglev_ctrl.kernels.checks import check_periodic

_EPS = float(np.finfo(float).eps)
_CLUSTER = 1e-6  # copies of one exponent agree to this, relative to the size of the problem
_RESOLVED = 1e-8  # energy share allowed in the outermost harmonics of a copy that counts


@dataclass(frozen=True, eq=False, slots=True)
class HillSpectrum:
    """Floquet exponents `exponents` (n,) 1/s, largest real part first, with `vectors` (n, 2N+1, n).

    `vectors[i, k]` is the amplitude of harmonic k - N of solution i. The imaginary part is that of the most central
    copy, not folded. `change` (n,) is what further harmonics change, or the last change under refinement where that is
    smaller; `error` (n,) bounds the error of each exponent, truncation and rounding, 1/s; `harmonics` is N.
    """

    exponents: ComplexArray
    vectors: ComplexArray
    harmonics: int
    change: FloatArray
    error: FloatArray
    converged: bool


def hill_matrix(
    A_0: FloatArray, A_cos: FloatArray, A_sin: FloatArray, *, frequency: float, harmonics: int
) -> ComplexArray:
    """The truncated Hill matrix, blocks -N..N: (n (2N+1), n (2N+1)).

    Parameters
    ----------
    A_0 : (n, n); A_cos, A_sin : (H, n, n), 1/s
    frequency : W, rad/s
    harmonics : N

    Examples
    --------
    >>> zero = np.zeros((1, 1, 1))
    >>> hill_matrix(np.array([[-1.0]]), zero, zero, frequency=2.0, harmonics=1).diagonal()
    array([-1.+2.j, -1.+0.j, -1.-2.j])
    """
    n, blocks = A_0.shape[-1], 2 * harmonics + 1
    matrix = np.zeros((blocks, n, blocks, n), dtype=complex)
    index = np.arange(blocks)
    matrix[index, :, index, :] = A_0 - 1j * frequency * (index - harmonics)[:, None, None] * np.eye(n)
    for q, (cosine, sine) in enumerate(zip(A_cos, A_sin, strict=True), start=1):
        if q < blocks:
            upper = 0.5 * (cosine - 1j * sine)
            matrix[index[q:], :, index[:-q], :] = upper
            matrix[index[:-q], :, index[q:], :] = upper.conj()
    return matrix.reshape(blocks * n, blocks * n)


def hill_spectrum(
    A_0: FloatArray, A_cos: FloatArray, A_sin: FloatArray, *, frequency: float, tolerance: float = 1e-11,
    max_size: int = 700,
) -> HillSpectrum:  # fmt: skip
    """The n Floquet exponents by Hill's method, harmonics added until more of them change nothing.

    With right and left vectors the change that the next harmonics would make is known to first order: what the
    outermost amplitudes excite beyond the edge and send back. Only where that is not small are harmonics added.

    Parameters
    ----------
    A_0 : (n, n); A_cos, A_sin : (H, n, n), 1/s, scaled
    frequency : W, rad/s
    tolerance : change allowed, relative to max(W, |s|)
    max_size : largest matrix tried (but room for one refinement); beyond it the result says `converged=False`

    Raises
    ------
    ValueError : see `check_periodic`

    Examples
    --------
    >>> A_0, A_1 = np.array([[0.0, 1.0], [-1.0, 0.0]]), np.array([[[0.0, 0.0], [-0.4, 0.0]]])
    >>> spectrum = hill_spectrum(A_0, A_1, 0 * A_1, frequency=2.0)
    >>> [round(float(x), 6) for x in spectrum.exponents.real]
    [0.099536, -0.099536]
    """
    check_periodic(A_0, A_cos, A_sin, frequency)
    n, H = A_0.shape[-1], len(A_cos)
    amplitude = sum(float(np.linalg.norm(a, 2) + np.linalg.norm(b, 2)) for a, b in zip(A_cos, A_sin, strict=True))
    harmonics = 2 * H + 1 + H * int(np.ceil(min(2.0 * amplitude / frequency, 40.0) ** 0.5))
    trace = float(np.trace(A_0))
    max_size = max(max_size, 25 * n, n * (4 * harmonics + 1))  # room for one refinement at least
    last: HillSpectrum | None = None
    while n * (2 * harmonics + 1) <= max_size or last is None:
        matrix = hill_matrix(A_0, A_cos, A_sin, frequency=frequency, harmonics=harmonics)
        values, left, vectors = linalg.eig(  # type: ignore[misc]  # the stubs know two results only
            _real_form(matrix, n), left=True, overwrite_a=True, check_finite=False
        )
        shaped = _amplitudes(vectors.T.reshape(-1, 2 * harmonics + 1, n))
        picked = _pick(values, shaped, n, H, frequency)
        if picked and _trace_fits(values[picked], trace, frequency):
            found = values[picked], shaped[picked], _amplitudes(left.T[picked].reshape(n, -1, n))
            beyond = _beyond(*found, A_0, A_cos, A_sin, frequency)
            rounding = _rounding(found[1], found[2], float(np.max(np.sum(np.abs(matrix), axis=1))))
            last = _record(*found[:2], beyond, rounding, harmonics, frequency, tolerance, last)
            if last.converged:
                return last
        elif last is None and n * (2 * harmonics + 1) > max_size:
            break
        harmonics += max(2, H, harmonics // 3)
    if last is not None:
        return last
    lost = np.full(n, np.inf)
    return HillSpectrum(lost * complex(np.nan), np.zeros((n, 1, n), dtype=complex), harmonics, lost, lost, False)


def _real_form(matrix: ComplexArray, n: int) -> FloatArray:
    """The Hill matrix of a real system in the real unknowns (p_k + p_-k)/sqrt 2, (p_k - p_-k)/(i sqrt 2).

    The change of basis is unitary, so that spectrum and conditioning stay; real arithmetic is three times as fast.
    Blocks -N..N hold the odd parts of N..1, then p_0, then the even parts of 1..N.
    """
    blocks = len(matrix) // n
    N, root = blocks // 2, np.sqrt(0.5)
    H = matrix.reshape(blocks, n, blocks, n)
    early, late = slice(None, N), slice(None, N, -1)  # -N..-1 and N..1
    rows = H.copy()
    rows[early] = -1j * root * (H[late] - H[early])
    rows[late] = root * (H[late] + H[early])
    result = np.empty((blocks, n, blocks, n))
    result[:, :, N] = rows[:, :, N].real
    result[:, :, early] = (1j * root * (rows[:, :, late] - rows[:, :, early])).real
    result[:, :, late] = root * (rows[:, :, late] + rows[:, :, early]).real
    return result.reshape(len(matrix), len(matrix))


def _amplitudes(parts: ComplexArray) -> ComplexArray:
    """Harmonic amplitudes p_-N..p_N (..., 2N+1, n) from the unknowns of the real form."""
    N, root = parts.shape[-2] // 2, np.sqrt(0.5)
    early, late = slice(None, N), slice(None, N, -1)
    result = np.array(parts, dtype=np.complex128)
    result[:, late] = root * (parts[:, late] + 1j * parts[:, early])
    result[:, early] = root * (parts[:, late] - 1j * parts[:, early])
    return result


def _record(
    values: ComplexArray, vectors: ComplexArray, beyond: FloatArray, rounding: FloatArray, harmonics: int,
    frequency: float, tolerance: float, last: HillSpectrum | None,
) -> HillSpectrum:  # fmt: skip
    """One refinement step on record: settled when the change is small, or small and no longer falling (rounding)."""
    order = np.argsort(-values.real, kind="stable")
    found, beyond, rounding = values[order], beyond[order], rounding[order]
    scale = np.maximum(frequency, np.abs(found))
    change, stalled = beyond, False
    if last is not None:
        moved = folded_distance(found, last.exponents, frequency)
        change = np.minimum(beyond, moved)
        stalled = bool(np.all(change <= 1e-6 * scale)) and float(np.max(change)) > 0.3 * float(np.max(last.change))
    settled = stalled or bool(np.all(change <= tolerance * scale))
    # what moves one of two nearly equal exponents by more than its root moves them apart no further than that
    lost = 2.0 * change + rounding
    error = np.minimum(lost, change + 10.0 * np.sqrt(scale * np.minimum(lost, _EPS * scale * len(vectors[0]) ** 2)))
    return HillSpectrum(found, vectors[order], harmonics, change, np.asarray(error), settled)


def _beyond(
    values: ComplexArray, right: ComplexArray, left: ComplexArray, A_0: FloatArray, A_cos: FloatArray,
    A_sin: FloatArray, frequency: float,
) -> FloatArray:  # fmt: skip
    """First-order change of each exponent by the harmonics just beyond the edge, 1/s.

    Harmonic k > N of a solution is excited by the inner ones, p_k = (s - A_0 + i k W)^-1 sum_l A_(k-l) p_l, and acts
    back on them through the left vector.
    """
    n, band, reach = len(A_0), len(A_cos), right.shape[1] // 2
    upper = 0.5 * (A_cos - 1j * A_sin)
    overlap = np.abs(np.sum(left.conj() * right, axis=(1, 2)))
    total = np.zeros(len(values), dtype=complex)
    for side, into, back in ((1, upper, upper.conj()), (-1, upper.conj(), upper)):
        for step in range(1, band + 1):
            k = side * (reach + step)
            driven, returned = np.zeros((2, len(values), n), dtype=complex)
            for q in range(step, band + 1):
                inner = reach + k - side * q
                driven += right[:, inner] @ into[q - 1].T
                returned += left[:, inner].conj() @ back[q - 1]
            resolvent = (values + 1j * k * frequency)[:, None, None] * np.eye(n) - A_0
            total += np.sum(returned * np.linalg.solve(resolvent, driven[..., None])[..., 0], axis=1)
    return np.asarray(np.abs(total) / np.maximum(overlap, 1e-300))


def _rounding(right: ComplexArray, left: ComplexArray, size: float) -> FloatArray:
    """Backward error of the eigenvalues times the condition of each, 1/s."""
    overlap = np.abs(np.sum(left.conj() * right, axis=(1, 2)))
    return np.asarray(_EPS * size * np.sqrt(right[0].size) / np.maximum(overlap, 1e-300))


def _trace_fits(values: ComplexArray, trace: float, frequency: float) -> bool:
    """Liouville: the exponents add up to the mean trace; a family picked twice or missed breaks this."""
    scale = max(frequency, float(np.max(np.abs(values.real))))
    return abs(float(np.sum(values.real)) - trace) <= 1e-5 * scale


def folded_distance(values: ComplexArray, others: ComplexArray, frequency: float) -> FloatArray:
    """Distance of each value to its partner among `others`, imaginary parts modulo W, assigned one to one."""
    from scipy.optimize import linear_sum_assignment

    cost = _folded(values[:, None] - others[None, :], frequency)
    rows, columns = linear_sum_assignment(cost)
    result = np.full(len(values), np.inf)
    result[rows] = cost[rows, columns]
    return result


def _folded(difference: ComplexArray, frequency: float) -> FloatArray:
    turns = np.round(difference.imag / frequency)
    return np.asarray(np.abs(difference - 1j * frequency * turns))


def _pick(values: ComplexArray, vectors: ComplexArray, n: int, band: int, frequency: float) -> list[int]:
    """Indices of one copy per Floquet solution."""
    energy = np.sum(np.abs(vectors) ** 2, axis=2)
    energy /= np.sum(energy, axis=1, keepdims=True)
    reach = (energy.shape[1] - 1) // 2
    centre = energy @ np.arange(-reach, reach + 1)
    edge = np.sum(energy[:, :band], axis=1) + np.sum(energy[:, -band:], axis=1)
    resolved = np.nonzero(edge <= _RESOLVED)[0]
    if len(resolved) < n:
        return []
    s = values[resolved]
    scale = _CLUSTER * np.maximum(frequency, np.abs(s.real))
    near = _folded(s[:, None] - s[None, :], frequency) <= np.maximum(scale[:, None], scale[None, :])
    count, labels = connected_components(near, directed=False)
    chosen: list[tuple[float, list[int]]] = []
    for cluster in range(count):
        members = resolved[labels == cluster]
        level = np.round((values[members].imag - values[members[0]].imag) / frequency).astype(int)
        choices = [members[level == one] for one in np.unique(level)]
        most = max(len(choice) for choice in choices)
        best = min((c for c in choices if len(c) == most), key=lambda c: float(np.mean(np.abs(centre[c]))))
        chosen.append((float(np.mean(np.abs(centre[best]))), [int(i) for i in best]))
    picked: list[int] = []
    for _, members_of in sorted(chosen):
        if len(picked) < n:
            picked.extend(members_of)
    return picked if len(picked) == n else []


def hill_pair(
    matrix: ComplexArray, guess: complex, *, steps: int = 3
) -> tuple[complex, ComplexArray, ComplexArray, float]:
    """The eigenvalue of a Hill matrix nearest to `guess` with right and left vectors and its residual.

    Inverse iteration from a vector that knows nothing of `guess` but the shift, so that the value found is one of the
    matrix, not an echo of the guess.

    Examples
    --------
    >>> value, right, left, residual = hill_pair(np.diag([1.0 + 0j, 3.0]), 3.0001)
    >>> round(value.real, 12)
    3.0
    """
    size = len(matrix)
    scale = max(abs(guess), float(np.max(np.abs(np.diag(matrix)))))
    shift = guess + 1e-9 * scale * (1.0 + 0.7j)
    factors = linalg.lu_factor(matrix - shift * np.eye(size), check_finite=False)
    right: ComplexArray = np.random.default_rng(7).standard_normal(size).astype(np.complex128)
    left: ComplexArray = right.copy()
    value = complex(shift)
    for _ in range(steps):
        right = right / np.linalg.norm(right)
        grown = np.asarray(linalg.lu_solve(factors, right, check_finite=False), dtype=np.complex128)
        value = complex(shift + 1.0 / np.vdot(right, grown))
        right = grown
        back = linalg.lu_solve(factors, left / np.linalg.norm(left), trans=2, check_finite=False)
        left = np.asarray(back, dtype=np.complex128)
    right = np.asarray(right / np.linalg.norm(right), dtype=np.complex128)
    left = np.asarray(left / np.linalg.norm(left), dtype=np.complex128)
    residual = float(np.linalg.norm(matrix @ right - value * right))
    return value, right, left, residual
