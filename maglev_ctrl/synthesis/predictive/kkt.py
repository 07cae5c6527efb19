"""How far a point is from solving a quadratic program, found without the solver: residuals and certificates.

    minimise  x'P x / 2 + q'x   subject to  l <= A x <= u        (P positive semidefinite)

x is a solution, and y its multipliers (positive at the upper, negative at the lower bound), exactly if
l <= A x <= u,  P x + q + A'y = 0,  and y_i (A x - bound)_i = 0 (Karush-Kuhn-Tucker).
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np

from maglev_ctrl.arrays import FloatArray

NO_BOUND = 1e20
"""A bound of this size or more is none."""
FARTHEST = 1e7
"""A certificate of infeasibility holds if no feasible point lies within so many times the scale of the bounds."""
STRAIGHT = 1e-11
"""Relative size below which a product with a unit direction counts as zero."""
CANCELLED = 1e-4
"""Part of the terms of a row that counts with its bound as the size of the row: terms that cancel excuse little."""
ROUNDING = 1e-14
"""Relative rounding of a sum of products that counts as nothing."""
EXACT = 60
"""Largest number of rows of an exact certificate."""


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


def termwise_residual(
    P: Any, q: FloatArray, A: Any, bounds: tuple[FloatArray, FloatArray], *, x: FloatArray, y: FloatArray
) -> KktResidual:
    """Residuals of (x, y), each row and each unknown relative to its own terms; NaN in x or y gives infinity.

    `primal`: the violation of a row over |bound| + 1e-4 sum |a_j x_j|, so that neither another row's size nor large
    terms that cancel hide it; `dual`: a component of P x + q + A'y over the sum of its terms' magnitudes;
    `complementarity`: the sum of the products over the terms of the objective and of the bounds. Units of rows and of
    the objective do not matter; what rounding may make of it (1e-14 of the norms) is taken off.

    Parameters
    ----------
    P, A : (n, n), (m, n) dense or sparse
    bounds : l, u (m,) with infinities (1e20 and more) where there is none
    x, y : point (n,) and multipliers (m,)

    Examples
    --------
    >>> A, bounds = np.diag([1.0, 1e5]), (np.array([1e5, 1.0]), np.array([1e5, 1.0]))
    >>> args = (np.zeros((2, 2)), np.zeros(2), A, bounds)
    >>> termwise_residual(*args, x=np.array([1e5, 1.1e-5]), y=np.zeros(2)).primal > 0.05
    True
    >>> kkt_residual(*args, x=np.array([1e5, 1.1e-5]), y=np.zeros(2)).primal < 1e-10
    True
    """
    if not (np.all(np.isfinite(x)) and np.all(np.isfinite(y))):
        return KktResidual(np.inf, np.inf, np.inf)
    lower, upper = bounds
    above, below = upper < NO_BOUND, lower > -NO_BOUND
    far = np.abs(x)
    squares = A.power(2).sum(axis=1) if hasattr(A, "power") else np.sum(np.square(A), axis=1)
    product, norms = np.asarray(A @ x).ravel(), np.sqrt(np.asarray(squares, dtype=float).ravel())
    reach = norms * float(np.linalg.norm(x))
    terms = np.asarray(abs(A) @ far).ravel()
    top, bottom = np.where(above, upper, 0.0), np.where(below, lower, 0.0)
    primal = 0.0
    for violation, bound in (
        (np.where(above, product - top, 0.0), top),
        (np.where(below, bottom - product, 0.0), bottom),
    ):
        primal = max(primal, _over(violation - ROUNDING * reach, np.abs(bound) + CANCELLED * terms))
    # a multiplier that pushes where there is no bound is no multiplier
    up, down = np.where(above, np.maximum(y, 0.0), 0.0), np.where(below, np.maximum(-y, 0.0), 0.0)
    bend = np.asarray(P @ x).ravel()
    rest = np.abs(bend + q + np.asarray(A.T @ (up - down)).ravel())
    pulls = np.asarray(abs(P) @ far).ravel() + np.abs(q) + np.asarray(abs(A).T @ (up + down)).ravel()
    # an infinite slack is a multiplier that was dropped above
    slack = np.where(up > 0.0, np.abs(top - product), 0.0), np.where(down > 0.0, np.abs(product - bottom), 0.0)
    gap = float(up @ slack[0] + down @ slack[1]) - ROUNDING * float((up + down) @ reach)
    worth = float(far @ (pulls + np.abs(q)) + up @ np.abs(top) + down @ np.abs(bottom))
    # rounding of the multipliers reaches an unknown through its rows only
    held = abs(A).T @ (1.0 / np.where(norms > 0.0, norms, 1.0))
    noise = ROUNDING * _largest(pulls) * np.minimum(np.asarray(held).ravel(), 1.0)
    return KktResidual(
        primal=primal, dual=_over(rest - noise, pulls), complementarity=_over(np.array([gap]), np.array([worth]))
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


def proves_infeasible_exactly(A: Any, lower: FloatArray, upper: FloatArray, y: FloatArray) -> FloatArray | None:
    """A Farkas vector on the rows and with the signs of y, in rational arithmetic; its floats, or None.

    A vertex of the alternative system has rows with one dependency only, and that is found without rounding: A'y = 0
    and u'y+ - l'y- < 0 hold exactly for the data as stored, however near the bounds come to meeting. None where the
    dependency is not unique, its signs differ from those of y, the support is not negative, or rows are too many.

    Parameters
    ----------
    A, lower, upper : (m, n), (m,) and (m,)
    y : (m,) a vector whose non-zero entries tell the rows and their sides

    Examples
    --------
    >>> A = np.array([[1.0], [1.0]])
    >>> upper, y = np.array([np.inf, 1.0]), np.array([-1.0, 1.1])
    >>> proves_infeasible_exactly(A, np.array([1.0 + 1e-15, -np.inf]), upper, y).tolist()
    [-1.0, 1.0]
    >>> proves_infeasible_exactly(A, np.array([1.0, -np.inf]), upper, y) is None
    True
    """
    chosen = np.flatnonzero(y)
    if not 1 <= chosen.size <= EXACT or not np.all(np.isfinite(y)):
        return None
    sides = np.where(y[chosen] > 0.0, upper[chosen], lower[chosen])
    if np.any(np.abs(sides) >= NO_BOUND):
        return None
    picked = A[chosen]
    dense = np.asarray(picked.toarray() if hasattr(picked, "toarray") else picked, dtype=float)
    # columns of unknowns that no chosen row holds say nothing
    table = [[Fraction(float(value)) for value in column] for column in dense.T if np.any(column)]
    count, pivots, done = chosen.size, [], 0
    for k in range(count):
        at = next((i for i in range(done, len(table)) if table[i][k]), None)
        if at is None:
            continue
        table[done], table[at] = table[at], table[done]
        head = table[done][k]
        table[done] = [value / head for value in table[done]]
        for i, row in enumerate(table):
            if i != done and row[k]:
                factor = row[k]
                table[i] = [a - factor * b for a, b in zip(row, table[done], strict=True)]
        pivots.append(k)
        done += 1
    free = [k for k in range(count) if k not in pivots]
    if len(free) != 1:
        return None
    weights = [Fraction(0)] * count
    weights[free[0]] = Fraction(1 if y[chosen[free[0]]] > 0.0 else -1)
    for i, k in enumerate(pivots):
        weights[k] = -table[i][free[0]] * weights[free[0]]
    signs = [int(np.sign(value)) for value in y[chosen]]
    if any(weight * sign < 0 for weight, sign in zip(weights, signs, strict=True)):
        return None
    support = sum((w * Fraction(float(b)) for w, b in zip(weights, sides, strict=True)), Fraction(0))
    if support >= 0:
        return None
    largest = max(abs(weight) for weight in weights)
    found = np.zeros(y.size)
    found[chosen] = [float(weight / largest) for weight in weights]
    return found


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


def _over(parts: FloatArray, sizes: FloatArray) -> float:
    """Largest positive part over its size; infinite where the size is zero."""
    wrong = np.flatnonzero(parts > 0.0)
    if not wrong.size:
        return 0.0
    held = sizes[wrong]
    return float(np.max(np.divide(parts[wrong], held, out=np.full(wrong.size, np.inf), where=held > 0.0)))
