"""First approximations of the stabilising solution of a discrete Riccati equation, by methods that share no code.

All take the scaled data of A'XA - X - (A'XB + N)(R + B'XB)^-1 (B'XA + N') + Q = 0; none but the last inverts R.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.linalg import LinAlgError, ordqz, solve_discrete_are, solve_discrete_lyapunov

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.synthesis.doubling import symmetric

DiscreteSeed = Callable[[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray], FloatArray]
MAXIMUM_DOUBLINGS = 60


def extended_pencil(
    A: FloatArray, B: FloatArray, Q: FloatArray, R: FloatArray, N: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Pencil (H, J) of order 2n with the closed-loop poles and their reciprocals as eigenvalues, H v = z J v.

    The command is taken out of the optimality conditions by an orthogonal complement of the columns it stands in, so
    that R may be singular (Van Dooren, SIAM J. Sci. Stat. Comput. 2 (1981) 121).

    Raises
    ------
    scipy.linalg.LinAlgError : the pencil is singular: an input that costs nothing moves nothing
    """
    n, m = B.shape
    zero = np.zeros((n, n))
    left = np.block([[A, zero], [-Q, np.eye(n)], [N.T, np.zeros((m, n))]])
    right = np.block([[np.eye(n), zero], [zero, A.T], [np.zeros((m, n)), -B.T]])
    command = np.vstack([B, -N, R])
    if np.linalg.matrix_rank(command) < m:
        raise LinAlgError("an input neither costs nor moves anything")
    keep = np.linalg.qr(command, mode="complete")[0][:, m:]
    return keep.T @ left, keep.T @ right


def pencil_seed(A: FloatArray, B: FloatArray, Q: FloatArray, R: FloatArray, N: FloatArray) -> FloatArray:
    """Ordered QZ form of the extended pencil (Van Dooren 1981)."""
    n = A.shape[0]
    H, J = extended_pencil(A, B, Q, R, N)
    _, _, alpha, beta, _, basis = ordqz(H, J, sort="iuc", output="real")
    inside = int(np.count_nonzero(np.abs(alpha) < np.abs(beta)))
    if inside != n:
        raise LinAlgError(f"the pencil has {inside} eigenvalues inside the unit circle, expected {n}")
    return symmetric(np.asarray(np.linalg.solve(basis[:n, :n].T, basis[n : 2 * n, :n].T).T, dtype=float))


def doubling_seed(A: FloatArray, B: FloatArray, Q: FloatArray, R: FloatArray, N: FloatArray) -> FloatArray:
    """Structured doubling (Chu, Fan, Lin & Wang, Int. J. Control 77 (2004) 767) about an origin where R is regular.

    X = Y + s I turns the equation into one of the same form with Q + s (A'A - I), R + s B'B, N + s A'B; s = 0 where R
    itself is regular enough.
    """
    best, least = np.full_like(A, np.nan), np.inf
    size = float(np.linalg.norm(R, 2))
    strength = float(np.linalg.norm(B, 2)) ** 2
    unit = (size if size > 0.0 else 1.0) / (strength if strength > 0.0 else 1.0)
    for origin in (0.0, unit, 1e-2 * unit, 1e2 * unit, 1.0):
        moved_R = R + origin * B.T @ B
        if not np.linalg.cond(moved_R) < 1e10:
            continue
        shifted = Q + origin * (A.T @ A - np.eye(A.shape[0])), moved_R, N + origin * A.T @ B
        try:
            X = _doubled(A, B, *shifted) + origin * np.eye(A.shape[0])
        except LinAlgError:
            continue
        residual = relative_residual(A, B, Q, R, N, X)
        if residual < least:
            best, least = X, residual
        if residual <= 1e-11:
            break
    return best


def _doubled(A: FloatArray, B: FloatArray, Q: FloatArray, R: FloatArray, N: FloatArray) -> FloatArray:
    identity = np.eye(A.shape[0])
    power = A - B @ np.linalg.solve(R, N.T)
    dual = symmetric(B @ np.linalg.solve(R, B.T))
    primal = symmetric(Q - N @ np.linalg.solve(R, N.T))
    for _ in range(MAXIMUM_DOUBLINGS):
        solved = np.linalg.solve(identity + dual @ primal, np.hstack([power, dual]))
        ahead, through = solved[:, : len(A)], solved[:, len(A) :]
        step = symmetric(power.T @ primal @ ahead)
        dual, primal = dual + symmetric(power @ through @ power.T), primal + step
        power = power @ ahead
        moved = float(np.linalg.norm(step))
        if not np.isfinite(moved) or moved <= 1e-16 * float(np.linalg.norm(primal)):
            break
    return primal


def library_seed(A: FloatArray, B: FloatArray, Q: FloatArray, R: FloatArray, N: FloatArray) -> FloatArray:
    """The general solver of scipy."""
    return np.asarray(solve_discrete_are(A, B, Q, R, s=N), dtype=float)


def hewer_seed(A: FloatArray, B: FloatArray, Q: FloatArray, R: FloatArray, N: FloatArray) -> FloatArray:
    """Hewer's iteration (IEEE TAC 16 (1971) 382) from the stabilising gain of a shifted Lyapunov equation.

    With all poles of F = r A outside the unit circle, r >= 1, F Z F' = Z + 2 B B' gives the gain B'(Z + B B')^-1 A
    (Armstrong and Rublein, IEEE TAC 21 (1976) 629); no gain is needed where A is stable.
    """
    moduli = np.abs(np.linalg.eigvals(A))
    gain: FloatArray = np.zeros((B.shape[1], A.shape[0]))
    if np.max(moduli) >= 1.0:
        faster = A * (1.5 / max(float(np.min(moduli)), 1e-3) if np.min(moduli) < 1.5 else 1.0)
        inverse = np.linalg.inv(faster)
        Z = np.asarray(solve_discrete_lyapunov(inverse, 2.0 * inverse @ B @ B.T @ inverse.T), dtype=float)
        gain = np.asarray(np.linalg.lstsq((Z + B @ B.T).T, B, rcond=None)[0].T @ A, dtype=float)
    X: FloatArray = np.zeros_like(A)
    for _ in range(80):
        cost = Q + gain.T @ R @ gain - N @ gain - (N @ gain).T
        last, X = X, np.asarray(solve_discrete_lyapunov((A - B @ gain).T, cost), dtype=float)
        gain = np.asarray(np.linalg.solve(R + B.T @ X @ B, B.T @ X @ A + N.T), dtype=float)
        if np.linalg.norm(X - last) <= 1e-12 * np.linalg.norm(X):
            break
    return symmetric(X)


def relative_residual(
    A: FloatArray, B: FloatArray, Q: FloatArray, R: FloatArray, N: FloatArray, X: FloatArray
) -> float:
    """Norm of the equation at X relative to the norms of its terms."""
    cross = A.T @ X @ B + N
    quadratic = cross @ np.linalg.solve(R + B.T @ X @ B, cross.T)
    ahead = A.T @ X @ A
    size = sum(float(np.linalg.norm(term)) for term in (Q, X, ahead, quadratic))
    return float(np.linalg.norm(Q - X + ahead - quadratic)) / (size if size > 0.0 else 1.0)


PRIMARY: dict[str, DiscreteSeed] = {"ordered QZ": pencil_seed, "doubling": doubling_seed}
FALLBACK: dict[str, DiscreteSeed] = {"library": library_seed, "Hewer": hewer_seed}
