"""How far a point is from solving a quadratic program, found without the solver: residuals and certificates.

    minimise  x'P x / 2 + q'x   subject to  l <= A x <= u        (P positive semidefinite)

x is a solution, and y its multipliers (positive at the upper, negative at the lower bound), exactly if
l <= A x <= u,  P x + q + A'y = 0,  and y_i (A x - bound)_i = 0 (Karush-Kuhn-Tucker).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from maglev_ctrl.arrays import FloatArray

NO_BOUND = 1e20
"""A bound of this size or more is none."""
FARTHEST = 1e7
"""A certificate of infeasibility holds if no feasible point lies within so many times the scale of the bounds."""
STRAIGHT = 1e-8
"""Relative size below which a product with a unit direction counts as zero."""


@dataclass(frozen=True, eq=False, slots=True)
class KktResidual:
    """Relative residuals: `primal` of the bounds, `dual` of stationarity, `complementarity` of the products."""

    primal: float
    dual: float
    complementarity: float

    @property
    def largest(self) -> float:
        """The largest of the three.

        Examples
        --------
        >>> KktResidual(0.0, 1e-9, 1e-12).largest
        1e-09
        """
        return max(self.primal, self.dual, self.complementarity)


def kkt_residual(
    P: Any, q: FloatArray, A: Any, bounds: tuple[FloatArray, FloatArray], *, x: FloatArray, y: FloatArray
) -> KktResidual:
    """Residuals of (x, y), relative to the sizes of the terms; NaN in x or y gives infinity.

    Parameters
    ----------
    P, A : (n, n), (m, n) dense or sparse
    bounds : l, u (m,) with infinities (1e20 and more) where there is none
    x, y : point (n,) and multipliers (m,)

    Examples
    --------
    >>> P, A = np.array([[2.0]]), np.array([[1.0]])
    >>> bounds = (np.array([1.0]), np.array([np.inf]))
    >>> kkt_residual(P, np.zeros(1), A, bounds, x=np.array([1.0]), y=np.array([-2.0])).largest
    0.0
    >>> kkt_residual(P, np.zeros(1), A, bounds, x=np.array([1.0]), y=np.array([2.0])).dual
    1.0
    """
    if not (np.all(np.isfinite(x)) and np.all(np.isfinite(y))):
        return KktResidual(np.inf, np.inf, np.inf)
    lower, upper = bounds
    rows = largest_in_rows(A)
    bounded_above, bounded_below = upper < NO_BOUND, lower > -NO_BOUND
    product, z = A @ x, np.clip(A @ x, lower, upper)
    pulled = np.asarray(P @ x).ravel()
    # a multiplier that pushes where there is no bound is no multiplier
    up = np.where(bounded_above, np.maximum(y, 0.0), 0.0)
    down = np.where(bounded_below, np.maximum(-y, 0.0), 0.0)
    push = np.asarray(A.T @ (up - down)).ravel()
    size_P = _largest(P.data) if hasattr(P, "data") and hasattr(P, "nnz") else _largest(P)
    length = max(_largest(x), _largest(z / rows), _largest(q) / size_P if size_P > 0.0 else 0.0) or 1.0
    steepness = max(_largest(pulled), _largest(q), _largest(push)) or 1.0
    slack_up = np.where(bounded_above, np.abs(upper - product), 0.0)
    slack_down = np.where(bounded_below, np.abs(product - lower), 0.0)
    slack_up[up == 0.0], slack_down[down == 0.0] = 0.0, 0.0
    return KktResidual(
        primal=_largest((product - z) / rows) / length,
        dual=_largest(pulled + q + push) / steepness,
        complementarity=float(up @ slack_up + down @ slack_down) / (length * steepness),
    )


def box_residual(H: FloatArray, gradient: FloatArray, lower: FloatArray, upper: FloatArray, x: FloatArray) -> float:
    """Residual of x'H x / 2 + f'x on a box: the largest step of one projected Jacobi sweep, relative to x or to one.

    Unknowns are in units of their limits, so one is the size that matters.

    Parameters
    ----------
    H : (n, n) positive definite; only its diagonal is used
    gradient : H x + f at x

    Examples
    --------
    >>> one = np.ones(1)
    >>> box_residual(np.eye(1), -0.5 * one, -one, one, one)
    0.0
    >>> box_residual(np.eye(1), 0.5 * one, -one, one, one)
    0.5
    """
    if not x.size:
        return 0.0
    step = x - np.minimum(np.maximum(x - gradient / H.diagonal(), lower), upper)
    residual = float(np.abs(step).max()) / max(1.0, float(np.abs(x).max()))
    return residual if residual == residual else np.inf


def proves_infeasible(A: Any, lower: FloatArray, upper: FloatArray, y: FloatArray) -> bool:
    """Whether y shows that no x has l <= A x <= u (Farkas): A'y = 0 and u'y+ - l'y- < 0.

    For every feasible x, support(y) = u'y+ - l'y- >= y'A x >= -|A'y|_1 |x|_inf; a negative support with a rest of A'y
    from rounding therefore excludes every |x|_inf below -support / |A'y|_1, which must be far beyond the data.

    Examples
    --------
    >>> A = np.array([[1.0], [1.0]])
    >>> proves_infeasible(A, np.array([1.0, -np.inf]), np.array([np.inf, 0.0]), np.array([-1.0, 1.0]))
    True
    >>> proves_infeasible(A, np.array([-1.0, -np.inf]), np.array([np.inf, 0.0]), np.array([-1.0, 1.0]))
    False
    """
    if not np.all(np.isfinite(y)) or not np.any(y):
        return False
    up, down = np.maximum(y, 0.0), np.maximum(-y, 0.0)
    if np.any((up > 0.0) & (upper >= NO_BOUND)) or np.any((down > 0.0) & (lower <= -NO_BOUND)):
        return False
    terms = np.concatenate([up[up > 0.0] * upper[up > 0.0], -down[down > 0.0] * lower[down > 0.0]])
    support, rounding = float(np.sum(terms)), 1e-13 * float(np.sum(np.abs(terms)))
    if not support < -rounding:
        return False
    rest = float(np.sum(np.abs(A.T @ y)))
    sides = np.where(y > 0.0, upper, lower)[y != 0.0] / largest_in_rows(A)[y != 0.0]
    reach = FARTHEST * max(_largest(sides), 1e-300)
    return rest * reach <= -support


def proves_unbounded(P: Any, q: FloatArray, A: Any, bounds: tuple[FloatArray, FloatArray], d: FloatArray) -> bool:
    """Whether the objective falls for ever along d: P d = 0, q'd < 0 and A d leaves through no bound.

    The problem is unbounded if it also has a feasible point, which is another question.

    Examples
    --------
    >>> A, free = np.eye(1), (np.array([0.0]), np.array([np.inf]))
    >>> proves_unbounded(np.zeros((1, 1)), -np.ones(1), A, free, np.ones(1))
    True
    >>> proves_unbounded(np.zeros((1, 1)), np.ones(1), A, free, np.ones(1))
    False
    """
    if not np.all(np.isfinite(d)) or not np.any(d):
        return False
    d, (lower, upper) = d / _largest(d), bounds
    slope = float(q @ d)
    if not slope < -STRAIGHT * float(np.abs(q) @ np.abs(d)):
        return False
    rows = largest_in_rows(A)
    moved = np.asarray(A @ d).ravel() / rows
    if np.any(moved[upper < NO_BOUND] > STRAIGHT) or np.any(moved[lower > -NO_BOUND] < -STRAIGHT):
        return False
    bend = np.asarray(P @ d).ravel()
    size = _largest(P.data) if hasattr(P, "nnz") else _largest(P)
    return _largest(bend) <= STRAIGHT * size


def largest_in_rows(A: Any) -> FloatArray:
    """Largest entry of each row, one where the row is empty; (m,).

    Examples
    --------
    >>> largest_in_rows(np.array([[1.0, -3.0], [0.0, 0.0]])).tolist()
    [3.0, 1.0]
    """
    if not A.shape[0] or not A.shape[1]:
        return np.ones(A.shape[0])
    found = abs(A).max(axis=1)
    found = np.asarray(found.toarray() if hasattr(found, "toarray") else found, dtype=float).ravel()
    found[found == 0.0] = 1.0
    return found


def _largest(values: Any) -> float:
    array = np.asarray(values)
    return float(np.max(np.abs(array))) if array.size else 0.0
