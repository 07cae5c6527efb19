"""H2 norm with exact gradient from one Schur form and two Lyapunov solutions."""

from __future__ import annotations

import numpy as np
from scipy.linalg import schur, solve_continuous_lyapunov, solve_discrete_lyapunov
from scipy.linalg.lapack import dtrsyl

from maglev_ctrl.analysis.hamiltonian import balanced_realisation
from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.synthesis.structured.loop import Closed
from maglev_ctrl.synthesis.structured.spectral import Piece


def energy_piece(loop: Closed) -> Piece:
    """H2 norm of a stable loop (D = 0 in continuous time) and its derivatives by the entries of K.

    A P + P A' + B B' = 0, A'Q + Q A + C'C = 0, norm^2 = tr C P C'
    d norm^2 / dA = 2 Q P, / dB = 2 Q B, / dC = 2 C P   (Rautert & Sachs, SIAM J. Optim. 7 (1997) 456)
    """
    if loop.dt is None:
        P, Q = gramians(loop.A, loop.B, loop.C)
        inner, D = Q @ P, None
        square = float(np.sum((loop.C @ P) * loop.C))
    else:
        P = np.asarray(solve_discrete_lyapunov(loop.A, loop.B @ loop.B.T), dtype=np.float64)
        Q = np.asarray(solve_discrete_lyapunov(loop.A.T, loop.C.T @ loop.C), dtype=np.float64)
        inner, D = Q @ loop.A @ P, loop.D
        square = float(np.sum((loop.C @ P) * loop.C) + np.sum(D**2))
    dual = float(np.sum((Q @ loop.B) * loop.B)) + (0.0 if D is None else float(np.sum(D**2)))
    # The two Gramians give one norm; where they do not, the loop is marginal and neither number means anything.
    if not (np.isfinite(square) and square >= 0.0 and abs(square - dual) <= 1e-6 * abs(square)):
        return Piece(np.inf, np.zeros((loop.E.shape[1], loop.F.shape[0])))
    norm = max(float(np.sqrt(square)), 1e-300)
    return Piece(
        norm,
        loop.gain_gradient(inner / norm, Q @ loop.B / norm, loop.C @ P / norm, None if D is None else D / norm),
    )


def energy_norm(channel: tuple[FloatArray, FloatArray, FloatArray, FloatArray], dt: float | None) -> float:
    """H2 norm of a stable closed loop A, B, C, D, by one Lyapunov equation.

    Examples
    --------
    >>> one = np.ones((1, 1))
    >>> round(energy_norm((-one, one, one, 0.0 * one), None), 9)
    0.707106781
    """
    A, B, C = balanced_realisation(*channel[:3])
    D = channel[3]
    if dt is None:
        if np.any(D):
            return np.inf
        return float(np.sqrt(np.sum((C @ solve_continuous_lyapunov(A, -B @ B.T)) * C)))
    return float(np.sqrt(np.sum((C @ solve_discrete_lyapunov(A, B @ B.T)) * C) + np.sum(D**2)))


def gramians(A: FloatArray, B: FloatArray, C: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Reachability and observability Gramians of a stable continuous system.

    Examples
    --------
    >>> P, Q = gramians(np.array([[-1.0]]), np.array([[2.0]]), np.array([[1.0]]))
    >>> P.item(), Q.item()
    (2.0, 0.5)
    """
    T, U = schur(A, output="real")
    b, c = U.T @ B, C @ U
    X, scale_x, _ = dtrsyl(T, T, -b @ b.T, tranb="T")
    Y, scale_y, _ = dtrsyl(T, T, -c.T @ c, trana="T")
    return U @ X @ U.T / scale_x, U @ Y @ U.T / scale_y
