"""Lyapunov matrices along a schedule and how fast the parameter may move under them.

V = x'P(p) x with P linear between nodes; on a segment of width h, l from 0 to 1, V falls while

    A(l)'P(l) + P(l) A(l) +- (rate of p / h) (P_1 - P_0) < 0,

a polynomial in l whose Bernstein coefficients are tested (`SegmentClaim`). For fixed P_i the largest rate is a
generalised eigenvalue; the P_i come from Lyapunov equations at the nodes, or from one linear matrix inequality.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.linalg import eigh, solve_continuous_lyapunov

from maglev_ctrl.arrays import FloatArray, transpose
from maglev_ctrl.kernels import scaling
from maglev_ctrl.synthesis.lmi.session import Clock, solve_problem

BISECTIONS = 7
LARGEST = 1e6
"""Rates above this multiple of (schedule width x fastest pole) count as arbitrarily fast."""


def bernstein_loops(A: FloatArray, B: FloatArray, K: FloatArray) -> list[FloatArray]:
    """Coefficients in l of the closed loop of a segment, u = K x: A (2, n, n), B (2, n, m), K (2, m, n).

    Examples
    --------
    >>> one = np.ones((2, 1, 1))
    >>> len(bernstein_loops(one, one, -2.0 * one)), len(bernstein_loops(one, one * [[[1.0]], [[2.0]]],
    ...                                                                 -one * [[[2.0]], [[3.0]]]))
    (2, 3)
    """
    ends = A + B @ K
    if np.array_equal(B[0], B[1]) or np.array_equal(K[0], K[1]):
        return [ends[0], ends[1]]
    middle = 0.5 * (A[0] + A[1] + B[0] @ K[1] + B[1] @ K[0])
    return [ends[0], middle, ends[1]]


def decreases(coefficients: list[FloatArray], first: FloatArray, last: FloatArray) -> list[FloatArray]:
    """Bernstein coefficients of -(A'P + P A) along a segment, without the drift of P; each (n, n)."""
    degree = len(coefficients) - 1
    found = []
    for m in range(degree + 2):
        total = np.zeros_like(first)
        if m <= degree:
            total = total + (degree + 1 - m) * _fall(coefficients[m], first)
        if m:
            total = total + m * _fall(coefficients[m - 1], last)
        found.append(total / (degree + 1))
    return found


def segment_limit(coefficients: list[FloatArray], first: FloatArray, last: FloatArray, width: float) -> float:
    """Largest |rate of the parameter| for which V falls on the segment; 0 or less where it does not at rest.

    Examples
    --------
    >>> loop = np.array([[-1.0]])
    >>> round(segment_limit([loop, loop], np.array([[1.0]]), np.array([[3.0]]), 10.0), 9)  # 2 P(0) width / (P_1 - P_0)
    10.0
    """
    drift = (last - first) / width
    limit = np.inf
    for S in decreases(coefficients, first, last):
        if np.linalg.eigvalsh(S)[0] <= 0.0:
            return 0.0
        steepest = float(np.max(np.abs(eigh(drift, S, eigvals_only=True))))
        limit = min(limit, 1.0 / steepest if steepest > 0.0 else np.inf)
    return limit


def node_lyapunov(loops: FloatArray) -> FloatArray | None:
    """P_i (p, n, n) of A_i'P_i + P_i A_i = -I in balanced coordinates; None where a loop is not stable.

    Examples
    --------
    >>> node_lyapunov(np.array([[[-1.0]], [[-2.0]]]))[:, 0, 0].tolist()
    [0.5, 0.25]
    """
    if np.max(np.linalg.eigvals(loops).real) >= 0.0:
        return None
    T = scales(loops)
    P = np.stack([solve_continuous_lyapunov(A.T, -np.eye(len(T))) for A in loops * T / T[:, None]])
    return np.asarray(0.5 * (P + transpose(P)) / T[:, None] / T)


def scales(loops: FloatArray) -> FloatArray:
    """Balancing (n,) common to all loops, powers of two."""
    typical = np.max(np.abs(loops), axis=0)
    return scaling.balance(typical)


def best_lyapunov(
    segments: list[list[FloatArray]], nodes: FloatArray, *, start: float, clock: Clock
) -> tuple[FloatArray | None, float]:
    """P_i (p, n, n) that carry the fastest parameter found, by bisection over the rate; (None, 0) where none does.

    Parameters
    ----------
    segments : Bernstein coefficients of the closed loop of every segment
    start : a rate known to be carried, 0 where none is

    Examples
    --------
    >>> loop = np.array([[-1.0]])
    >>> P, rate = best_lyapunov([[loop, loop]], np.array([0.0, 1.0]), start=0.0, clock=Clock(30.0))
    >>> bool(rate > 1e3)  # the loops are equal: one P carries any rate
    True
    """
    ends = np.stack([*(one[0] for one in segments), segments[-1][-1]])
    T = scales(ends)
    speed = float(np.max(np.abs(np.linalg.eigvals(ends))))
    scaled = [[A * T / T[:, None] / speed for A in one] for one in segments]
    widths = np.diff(nodes)
    span = float(nodes[-1] - nodes[0]) * speed
    solve = _Inequality(scaled, widths * speed)
    best: FloatArray | None = None
    low, high = start, 0.0
    # Any rate first: one P for all nodes; then rest; then between the two.
    for rate in (LARGEST * span, max(start, 0.0)):
        found = solve(rate, clock)
        if found is not None:
            best, low = found, rate
            break
        high = rate
    if best is None:
        return None, 0.0
    if low >= LARGEST * span:
        best = np.broadcast_to(np.mean(best, axis=0), best.shape)
    else:
        low, high = max(low, 1e-6 * span), min(high, 1e2 * span)
        for _ in range(BISECTIONS):
            if clock.left <= 0.0:
                break
            middle = float(np.sqrt(low * high))
            found = solve(middle, clock)
            if found is None:
                high = middle
            else:
                best, low = found, middle
    return np.asarray(best / T[:, None] / T), low


class _Inequality:
    """One inequality for all nodes and segments, built once; the rate of the parameter is a number in it."""

    def __init__(self, segments: list[list[FloatArray]], widths: FloatArray) -> None:
        import cvxpy as cp

        n = segments[0][0].shape[0]
        self._rate = cp.Parameter(nonneg=True)
        self._shrink = cp.Parameter(nonneg=True)
        self._P = [cp.Variable((n, n), symmetric=True) for _ in range(len(segments) + 1)]
        t = cp.Variable()
        constraints: list[Any] = [sum(cp.trace(P) for P in self._P) == n * len(self._P), t <= 1.0]
        for coefficients, width, first, last in zip(segments, widths, self._P[:-1], self._P[1:], strict=True):
            degree = len(coefficients) - 1
            # The row is divided by 1 + rate / width, so that any rate keeps it of order one.
            drift = (last - first) / width
            for m in range(degree + 2):
                falls: Any = 0.0
                if m <= degree:
                    falls = falls + (degree + 1 - m) / (degree + 1) * _fall(coefficients[m], first)
                if m:
                    falls = falls + m / (degree + 1) * _fall(coefficients[m - 1], last)
                for sign in (1.0, -1.0):
                    constraints.append(self._shrink * falls + sign * self._rate * drift >> t * np.eye(n))
        self._t = t
        self._problem = cp.Problem(cp.Maximize(t), constraints)
        self._narrow = float(np.min(widths))

    def __call__(self, rate: float, clock: Clock) -> FloatArray | None:
        weight = 1.0 / (1.0 + rate / self._narrow)
        self._rate.value, self._shrink.value = rate * weight, weight
        answer = solve_problem(self._problem, {"t": self._t}, clock=clock)
        if not answer.usable or float(answer.values["t"]) <= 1e-9 * weight:
            return None
        return np.stack([np.asarray(P.value) for P in self._P])


def _fall(A: Any, P: Any) -> Any:
    return -(A.T @ P + P @ A)
