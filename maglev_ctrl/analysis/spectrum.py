"""Eigenvalues with error bounds: balanced QR, Newton polishing on the unreduced pencil, clusters kept honest.

The state matrix is balanced first, so that kg beside kg m^2 does no harm. The bound of a lone eigenvalue is first
order and componentwise,

    |ds| <= c u |y|^T (|s| |E| + |A|) |x| / |y^H E x|,   E x' = A x the system before M is inverted,

which no choice of units changes. Eigenvalues whose first-order discs overlap are a cluster; there the bound is the
spread of the cluster plus the largest disc, because single members carry no more digits than that.

References: Golub & Van Loan, Matrix Computations, 7.2; Higham & Tisseur, Linear Algebra Appl. 351-352 (2002).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from maglev_ctrl.arrays import ComplexArray, FloatArray, join_columns, join_rows, read_only_any
from maglev_ctrl.errors import ModelError
from maglev_ctrl.kernels import balance, rescale
from maglev_ctrl.systems import SecondOrderSystem

UNIT_ROUNDOFF = float(np.finfo(np.float64).eps)
SAFETY = 8.0
SINGULAR = "mass matrix: singular to working precision, so accelerations are not determined"


@dataclass(frozen=True, eq=False, slots=True)
class Spectrum:
    """Eigenvalues, one per conjugate pair (Im s >= 0), with vectors and error bounds.

    `s` (m,) 1/s; `right`, `left` (nx, m) with left^H right = 1; `condition` (m,) of each eigenvalue in balanced
    coordinates; `error_bound` (m,) 1/s; `clustered` (m,) True where the bound is that of a cluster.
    """

    s: ComplexArray
    right: ComplexArray
    left: ComplexArray
    condition: FloatArray
    error_bound: FloatArray
    clustered: NDArray[np.bool_]

    @property
    def abscissa(self) -> float:
        """Largest real part in 1/s."""
        return float(np.max(self.s.real))


def descriptor_pencil(system: SecondOrderSystem) -> tuple[FloatArray, FloatArray]:
    """E and A of E x' = A x with the states of `system`: the matrices as given, nothing inverted.

    Examples
    --------
    >>> E, A = descriptor_pencil(SecondOrderSystem.from_matrices([[2.0]], [[0.1]], [[8.0]]))
    >>> E.diagonal().tolist(), A[1].tolist()
    ([1.0, 2.0], [-8.0, -0.1])
    """
    kept = list(system.positions)
    n, n_q, n_xi = len(system.dofs), len(kept), len(system.internal)
    rate = np.zeros((n_q, n_q + n + n_xi))
    rate[np.arange(n_q), n_q + np.array(kept, dtype=int)] = 1.0
    A = join_rows([
        rate,
        join_columns([-system.K[..., kept], -system.C, system.F]),
        join_columns([system.G_q[..., kept], system.G_v, system.A_internal]),
    ])  # fmt: skip
    E = np.zeros_like(A)
    E[..., :n_q, :n_q] = np.eye(n_q)
    E[..., n_q : n_q + n, n_q : n_q + n] = system.M
    E[..., n_q + n :, n_q : n_q + n] = -system.G_a
    E[..., n_q + n :, n_q + n :] = np.eye(n_xi)
    return E, A


def system_spectrum(system: SecondOrderSystem, *, relative_data_error: float = 0.0) -> Spectrum:
    """Eigenvalues of one system with error bounds; see `spectrum`.

    Raises
    ------
    ModelError : the mass matrix is singular
    ValueError : the system carries batch axes, or has no state
    """
    E, A = descriptor_pencil(system)
    return spectrum(A, E=E, relative_data_error=relative_data_error)


def spectrum(A: FloatArray, *, E: FloatArray | None = None, relative_data_error: float = 0.0) -> Spectrum:
    """Eigenvalues of E x' = A x (E = I when left out), sorted by frequency, then growth rate.

    Parameters
    ----------
    A, E : (nx, nx)
    relative_data_error : relative uncertainty of the entries, added to the rounding unit in every bound

    Raises
    ------
    ModelError : E is singular
    ValueError : a shape does not fit, or an entry is not finite

    Examples
    --------
    >>> found = spectrum(np.array([[0.0, 1.0], [-4.0, -0.4]]))
    >>> bool(abs(found.s[0] - (-0.2 + 3.96**0.5 * 1j)) < found.error_bound[0] < 1e-13)
    True
    """
    A = np.asarray(A, dtype=np.float64)
    if A.ndim != 2 or A.shape[0] != A.shape[1] or not A.size:
        raise ValueError(f"A: expected one square matrix (nx, nx) with nx >= 1, got {A.shape}; stacks: modes_of_stack")
    if not np.all(np.isfinite(A)):
        raise ValueError("A: every entry must be finite")
    E = np.eye(len(A)) if E is None else np.asarray(E, dtype=np.float64)
    try:
        state: FloatArray = np.asarray(np.linalg.solve(E, A), dtype=np.float64)
    except np.linalg.LinAlgError as fault:
        raise ModelError(SINGULAR) from fault
    unit = UNIT_ROUNDOFF + relative_data_error
    scale = balance(state)
    balanced = rescale(state, scale)
    decomposition: tuple[Any, ...] = scipy.linalg.eig(balanced, left=True, right=True)
    s, left, right = (np.asarray(part, dtype=np.complex128) for part in decomposition)
    overlap = np.abs(np.sum(left.conj() * right, axis=0))
    with np.errstate(divide="ignore", over="ignore"):
        condition = 1.0 / overlap
    discs, clusters = _discs(s, condition, float(np.linalg.norm(balanced, 2)) * unit, unit)
    bound, clustered = _cluster_bounds(s, discs, clusters)
    keep = np.flatnonzero(s.imag >= 0.0)
    keep = keep[np.lexsort((s.real[keep], s.imag[keep]))]
    pencil = _scaled_pencil(E, A, scale)
    s_kept, x, measured = _polished(pencil, s[keep], right[:, keep], discs[keep], ~clustered[keep])
    sensitivity = _componentwise(E, A, s_kept, x * scale[:, None], left[:, keep] / scale[:, None])
    lone = ~clustered[keep] & np.isfinite(measured)
    floor = SAFETY * unit * sensitivity
    final = np.where(lone, floor + np.where(lone, measured, 0.0), np.maximum(bound[keep], floor * ~clustered[keep]))
    final = np.maximum(final, unit * np.abs(s_kept))
    x_state, y_state = x * scale[:, None], left[:, keep] / scale[:, None]
    with np.errstate(over="ignore", invalid="ignore"):  # a defective eigenvalue has no left vector of that length
        product = np.sum(y_state.conj() * x_state, axis=0)
        y_state = y_state / np.where(product == 0.0, 1.0, product).conj()
    return Spectrum(*(read_only_any(a) for a in (s_kept, x_state, y_state, condition[keep], final, clustered[keep])))


def _discs(s: ComplexArray, condition: FloatArray, perturbation: float, unit: float) -> tuple[FloatArray, NDArray[Any]]:
    """First-order radii (capped for defective eigenvalues) and the label of each eigenvalue's cluster."""
    distance = np.abs(s[:, None] - s[None, :])
    norm = perturbation / unit
    # An eigenvalue of Jordan size k moves like the k-th root of the perturbation; k is not known, so it is the
    # smallest size that equals the number of eigenvalues within such a radius (else the largest not above it).
    size = np.arange(len(s), 1, -1)
    radius = norm * unit ** (1.0 / size)
    count = np.sum(distance <= radius[:, None, None], axis=2)
    exact, above = count == size[:, None], count > size[:, None]
    within = np.min(np.where(exact, radius[:, None], np.inf), axis=0, initial=np.inf)
    largest = np.max(np.where(above, radius[:, None], 0.0), axis=0, initial=0.0)
    caps = np.where(np.isfinite(within), within, np.where(largest > 0.0, largest, np.inf))
    discs = np.minimum(SAFETY * perturbation * condition, np.maximum(caps, SAFETY * perturbation))
    return discs, _connected(distance <= discs[:, None] + discs[None, :])


def _connected(touching: NDArray[np.bool_]) -> NDArray[Any]:
    """Label of the connected component of each node: the smallest index that reaches it."""
    labels = np.arange(len(touching))
    while True:
        spread = np.min(np.where(touching, labels[None, :], len(labels)), axis=1)
        if np.array_equal(spread, labels):
            return labels
        labels = spread


def _cluster_bounds(s: ComplexArray, discs: FloatArray, labels: NDArray[Any]) -> tuple[FloatArray, NDArray[np.bool_]]:
    same = labels[:, None] == labels[None, :]
    spread = np.max(np.where(same, np.abs(s[:, None] - s[None, :]), 0.0), axis=1)
    largest = np.max(np.where(same, discs[None, :], 0.0), axis=1)
    clustered = np.sum(same, axis=1) > 1
    return np.where(clustered, spread + largest, discs), clustered


def _scaled_pencil(E: FloatArray, A: FloatArray, scale: FloatArray) -> tuple[FloatArray, FloatArray]:
    E_scaled, A_scaled = E * scale, A * scale
    rows = np.max(np.abs(E_scaled) + np.abs(A_scaled), axis=1, keepdims=True)
    return E_scaled / rows, A_scaled / rows


def _polished(
    pencil: tuple[FloatArray, FloatArray],
    s: ComplexArray,
    x: ComplexArray,
    discs: FloatArray,
    lone: NDArray[np.bool_],
) -> tuple[ComplexArray, ComplexArray, FloatArray]:
    """Two Newton steps on (A - s E) x = 0, |x| fixed; the second step measures what the first one left.

    A step longer than the eigenvalue's own disc is not a polish: such an eigenvalue stays as it was (measured = inf).
    """
    E, A = pencil
    best_s, best_x, measured = s.copy(), x.copy(), np.full(len(s), np.inf)
    chosen = np.flatnonzero(lone)
    if not len(chosen):
        return best_s, best_x, measured
    s_now, x_now = s[chosen], x[:, chosen].T
    try:
        for _ in range(2):
            step_x, step_s = _newton_step(E, A, s_now, x_now)
            x_now, s_now = x_now + step_x, s_now + step_s
    except np.linalg.LinAlgError:
        return best_s, best_x, measured
    s_now = np.where(s[chosen].imag == 0.0, s_now.real, s_now)
    good = (np.abs(s_now - s[chosen]) <= 4.0 * discs[chosen]) & np.all(np.isfinite(x_now), axis=1)
    best_s[chosen[good]] = s_now[good]
    best_x[:, chosen[good]] = x_now[good].T
    measured[chosen[good]] = np.abs(step_s[good])
    return best_s, best_x, measured


def _newton_step(E: FloatArray, A: FloatArray, s: ComplexArray, x: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
    """One bordered Newton step for every eigenpair at once; s (m,), x (m, nx)."""
    n = len(E)
    shifted = A - s[:, None, None] * E
    bordered = np.zeros((len(s), n + 1, n + 1), dtype=np.complex128)
    bordered[:, :n, :n] = shifted
    bordered[:, :n, n] = -x @ E.T
    bordered[:, n, :n] = x.conj()
    right_side = np.zeros((len(s), n + 1, 1), dtype=np.complex128)
    right_side[:, :n, 0] = -np.einsum("mij,mj->mi", shifted, x)
    step: ComplexArray = np.asarray(np.linalg.solve(bordered, right_side)[..., 0], dtype=np.complex128)
    return step[:, :n], step[:, n]


def _componentwise(E: FloatArray, A: FloatArray, s: ComplexArray, x: ComplexArray, left: ComplexArray) -> FloatArray:
    """|y|^T (|s||E| + |A|) |x| / |y^H E x|, y the left vector of the pencil; (m,)."""
    try:
        y = np.linalg.solve(E.T, left)
    except np.linalg.LinAlgError as fault:  # next to singular: of E and its transpose, one may be caught
        raise ModelError(SINGULAR) from fault
    size_x, size_y = np.abs(x), np.abs(y)
    weight = np.sum(size_y * (np.abs(E) @ size_x), axis=0) * np.abs(s) + np.sum(size_y * (np.abs(A) @ size_x), axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        sensitivity = weight / np.abs(np.sum(left.conj() * x, axis=0))
    return np.where(np.isfinite(sensitivity), sensitivity, 0.0)
