"""Lyapunov matrices for fixed loops: one for all, one that follows the parameter; matrices of pole regions.

Scaled to order one before any solver sees them; what comes back are candidates, judged by `maglev_ctrl.proofs`.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.proofs.candidates import modal_matrix
from maglev_ctrl.synthesis.lmi.session import Clock, solve_problem

TIME_LIMIT = 60.0
"""s, for one inequality."""
UNITS = (0.3, 1.0, 3.0)
"""Units of time tried for the slack certificate, in parts of the fastest loop's time constant."""
SLACK = 1e-8
"""Least strictness of an inequality of order one that is handed on for proof."""


def common_lyapunov(loops: FloatArray, rate: float, T: FloatArray) -> tuple[FloatArray | None, float]:
    """One P (n, n) for all loops (quadratic stability) of largest scaled margin, and that margin.

    Maximises t with A'P + P A + 2 rate P <= -t I, trace P = n; None where t is not positive.

    Examples
    --------
    >>> P, margin = common_lyapunov(np.array([[[-2.0]], [[-3.0]]]), 1.0, np.ones(1))
    >>> bool(margin > 0.0)
    True
    """
    import cvxpy as cp

    n = loops.shape[-1]
    scaled = loops * T / T[:, None]
    size = float(np.max(np.linalg.norm(scaled, 2, axis=(1, 2))))
    P, t = cp.Variable((n, n), symmetric=True), cp.Variable()
    constraints: list[Any] = [cp.trace(P) == n, P >> 0.0, t <= 1.0]
    for A in scaled / size + rate / size * np.eye(n):
        constraints.append(A.T @ P + P @ A << -t * np.eye(n))
    if not solved(cp.Problem(cp.Maximize(t), constraints)) or float(t.value) < SLACK:
        return None, -np.inf if t.value is None else float(t.value)
    return _unscaled(np.asarray(P.value), T), float(t.value)


def parameter_lyapunov(
    loops: FloatArray, rate: float, T: FloatArray
) -> tuple[FloatArray, FloatArray, float] | None:  # fmt: skip
    """P (v, n, n), slack V (n, n) and unit of time (s) of `ParameterClaim`: every constant blend decays at `rate`.

    The unit of time matters: a short one gives P nearly common, a long one leaves the slack little to do. A few about
    the time constant of the fastest loop are tried, and the one of largest margin is kept.

    Examples
    --------
    >>> parameter_lyapunov(np.array([[[-2.0]], [[-3.0]]]), 1.0, np.ones(1))[0].shape
    (2, 1, 1)
    """
    scaled = loops * T / T[:, None] + rate * np.eye(loops.shape[-1])
    size = max(float(np.max(np.linalg.norm(scaled, 2, axis=(1, 2)))), 1e-300)
    found = [(*_slack_certificate(scaled * (unit / size)), unit / size) for unit in UNITS]
    P, V, margin, time = max(found, key=lambda one: one[2])
    if P is None or V is None or margin < SLACK:
        return None
    return np.stack([_unscaled(one, T) for one in P]), np.asarray(V / T[:, None] / T), time


def _slack_certificate(loops: FloatArray) -> tuple[FloatArray | None, FloatArray | None, float]:
    """P, V of largest margin for loops of order one."""
    import cvxpy as cp

    n, count = loops.shape[-1], len(loops)
    matrices = [cp.Variable((n, n), symmetric=True) for _ in range(count)]
    V, t = cp.Variable((n, n)), cp.Variable()
    constraints: list[Any] = [sum(cp.trace(P) for P in matrices) == n * count, t <= 1.0]
    zero = np.zeros((n, n))
    for A, P in zip(loops, matrices, strict=True):
        side = V.T @ A + P
        block = cp.bmat([[-(V + V.T), side, V.T], [side.T, -P, zero], [V, zero, -P]])
        constraints += [block << -t * np.eye(3 * n)]
    if not solved(cp.Problem(cp.Maximize(t), constraints)):
        return None, None, -np.inf
    return np.stack([np.asarray(P.value) for P in matrices]), np.asarray(V.value), float(t.value)


def region_matrix(loop: FloatArray, L: FloatArray, M: FloatArray, T: FloatArray) -> FloatArray | None:
    """X (n, n) of `RegionClaim` for one loop: built on its eigenvectors, or found by a solver near double poles.

    With X = V V^H the inequality is diagonal: L + s M + conj(s) M' of each pole.

    Examples
    --------
    >>> region_matrix(np.array([[-2.0]]), np.array([[2.0]]), np.array([[1.0]]), np.ones(1))
    array([[1.]])
    """
    import cvxpy as cp

    A = loop * T / T[:, None]
    n, size = len(A), max(float(np.linalg.norm(A, 2)), 1e-300)
    X = modal_matrix(A)
    if _region_excess(A, L, M, X) < 0.0 and np.linalg.cond(X) < 1e8:
        return np.asarray(X * T * T[:, None])
    free, t = cp.Variable((n, n), symmetric=True), cp.Variable()
    product = (A / size) @ free
    value = cp.kron(L / size, free) + cp.kron(M, product) + cp.kron(M.T, product.T)
    constraints: list[Any] = [cp.trace(free) == n, free >> SLACK * np.eye(n), t <= 1.0]
    constraints.append(0.5 * (value + value.T) << -t * np.eye(n * len(L)))
    if not solved(cp.Problem(cp.Maximize(t), constraints)) or float(t.value) < SLACK:
        return None
    matrix = np.asarray(free.value)
    return np.asarray(0.5 * (matrix + matrix.T) * T * T[:, None])


def _region_excess(A: FloatArray, L: FloatArray, M: FloatArray, X: FloatArray) -> float:
    value = np.kron(L, X) + np.kron(M, A @ X) + np.kron(M.T, (A @ X).T)
    return float(np.max(np.linalg.eigvalsh(0.5 * (value + value.T))))


def solved(problem: Any) -> bool:
    """Solve a cvxpy problem; whether there is a point to look at, be it of reduced accuracy (proofs decide)."""
    variables = {f"{i}": one for i, one in enumerate(problem.variables())}
    return solve_problem(problem, variables, clock=Clock(TIME_LIMIT)).usable


def _unscaled(P: FloatArray, T: FloatArray) -> FloatArray:
    matrix = P / T[:, None] / T
    return np.asarray(0.5 * (matrix + matrix.T))
