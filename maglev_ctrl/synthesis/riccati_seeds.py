"""First approximations of the stabilising Riccati solution by methods that share no code: one must survive.

All take the equation with the cross weight removed, Q + A'P + P A - P G P = 0, already scaled.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.linalg import LinAlgError, schur, solve_continuous_are, solve_continuous_lyapunov

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.synthesis.doubling import cayley_shift, doubled_solution, hamiltonian, relative_residual

Seed = Callable[[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray], FloatArray]


def schur_seed(A: FloatArray, B: FloatArray, Q: FloatArray, R: FloatArray, G: FloatArray) -> FloatArray:
    """Ordered real Schur form of the Hamiltonian (Laub, IEEE Trans. Autom. Control 24 (1979) 913)."""
    n = A.shape[0]
    _, basis, count = schur(hamiltonian(A, G, Q), output="real", sort="lhp")
    if count != n:
        raise LinAlgError(f"the Hamiltonian has {count} stable eigenvalues, expected {n}")
    P = np.linalg.solve(basis[:n, :n].T, basis[n:, :n].T).T
    return np.asarray(0.5 * (P + P.T))


def doubling_seed(A: FloatArray, B: FloatArray, Q: FloatArray, R: FloatArray, G: FloatArray) -> FloatArray:
    """Structure-preserving doubling; an unlucky shift (at an eigenvalue of A) is moved."""
    best, least = np.full_like(A, np.nan), np.inf
    for factor in (1.0, 1.37, 0.41, 5.3):
        try:
            P, _ = doubled_solution(A, G, Q, factor * cayley_shift(A, G, Q))
        except LinAlgError:
            continue
        residual = float(relative_residual(A, G, Q, P))
        if residual < least:
            best, least = P, residual
        if residual <= 1e-11:
            break
    return best


def pencil_seed(A: FloatArray, B: FloatArray, Q: FloatArray, R: FloatArray, G: FloatArray) -> FloatArray:
    """Extended pencil by the QZ algorithm (scipy), which never forms B R^-1 B'."""
    return np.asarray(solve_continuous_are(A, B, Q, R))


def kleinman_seed(A: FloatArray, B: FloatArray, Q: FloatArray, R: FloatArray, G: FloatArray) -> FloatArray:
    """Kleinman's iteration from the stabilising gain of Bass and Armstrong (IEEE TAC 20 (1975) 153)."""
    n = A.shape[0]
    abscissa = float(np.max(np.linalg.eigvals(A).real))
    if abscissa < 0.0:
        gain: FloatArray = np.zeros((B.shape[1], n))
    else:
        pushed = A + (2.0 * abscissa + 1.0) * np.eye(n)
        Z = solve_continuous_lyapunov(pushed, 2.0 * B @ B.T)
        gain = np.asarray(np.linalg.lstsq(Z, B, rcond=None)[0].T, dtype=float)
    P: FloatArray = np.zeros((n, n))
    for _ in range(60):
        closed = A - B @ gain
        last, P = P, np.asarray(solve_continuous_lyapunov(closed.T, -(Q + gain.T @ R @ gain)), dtype=float)
        gain = np.asarray(np.linalg.solve(R, B.T @ P), dtype=float)
        if np.linalg.norm(P - last) <= 1e-12 * np.linalg.norm(P):
            break
    return np.asarray(0.5 * (P + P.T))


PRIMARY: dict[str, Seed] = {"ordered Schur": schur_seed, "doubling": doubling_seed}
FALLBACK: dict[str, Seed] = {"extended pencil": pencil_seed, "Kleinman": kleinman_seed}
