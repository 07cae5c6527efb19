"""Compiled doubling for many continuous Riccati equations: loops over rows x (columns x lanes), one lane per equation.

Entry (i, j) of all matrices of a block lies in one row of memory, so every inner loop runs over equations and
vectorises whatever n is. The method is that of `synthesis.doubling`; every equation's residual and the size of its last
power are returned, so that the caller judges each one.
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.kernels.compiled import compiled, require_numba
from maglev_ctrl.kernels.lanes import lane_product

MAXIMUM_DOUBLINGS: Final = 40
_BLOCK: Final = 32  # equations of a block: enough to vectorise, few enough for the second-level cache
_CONVERGED: Final = 1e-10  # quadratic: the next step is about the square of this one


def many_by_doubling(
    A: FloatArray, G: FloatArray, Q: FloatArray, factor: float = 1.0
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """P of Q + A'P + P A - P G P = 0 for many equations, their relative residuals and the norms of the last powers.

    Parameters
    ----------
    A, G, Q : (k, n, n); G and Q symmetric
    factor : on the Cayley shift, the geometric mean of the moduli of the closed-loop poles

    Raises
    ------
    ModelError : numba is not installed
    """
    require_numba()
    count, n = A.shape[0], A.shape[-1]
    P, residual, rest = np.empty((count, n, n)), np.empty(count), np.empty(count)
    a, g, q = (np.ascontiguousarray(x) for x in (A, G, Q))
    _equations(a, g, q, float(factor), _BLOCK, P, residual, rest)
    return P, residual, rest


@compiled
def _transposed(matrix: Any, result: Any, lanes: int) -> None:
    for i in range(matrix.shape[0]):
        for j in range(matrix.shape[1]):
            for lane in range(lanes):
                result[j, i, lane] = matrix[i, j, lane]


@compiled
def _eliminated(work: Any, lanes: int, logarithm: Any) -> None:
    """Rows of `work` (r, c, block) reduced: the left square becomes triangular; log |det| of it per lane."""
    rows, columns = work.shape[0], work.shape[1]
    ratio = np.empty(work.shape[2])
    for lane in range(lanes):
        logarithm[lane] = 0.0
    for k in range(rows):
        for lane in range(lanes):
            best, at = abs(work[k, k, lane]), k
            for i in range(k + 1, rows):
                size = abs(work[i, k, lane])
                if size > best:
                    best, at = size, i
            if at != k:
                for j in range(k, columns):
                    kept = work[k, j, lane]
                    work[k, j, lane] = work[at, j, lane]
                    work[at, j, lane] = kept
            logarithm[lane] += math.log(best) if best > 0.0 else -math.inf
        for i in range(k + 1, rows):
            for lane in range(lanes):
                ratio[lane] = work[i, k, lane] / work[k, k, lane]
            for j in range(k + 1, columns):
                upper, target = work[k, j], work[i, j]
                for lane in range(lanes):
                    target[lane] -= ratio[lane] * upper[lane]


@compiled
def _solved(work: Any, lanes: int, scratch: Any) -> None:
    """The right part of `work` = [matrix, right side] becomes the solution."""
    rows, columns = work.shape[0], work.shape[1]
    _eliminated(work, lanes, scratch)
    inverse = np.empty(work.shape[2])
    for k in range(rows - 1, -1, -1):
        for lane in range(lanes):
            inverse[lane] = 1.0 / work[k, k, lane]
        for j in range(rows, columns):
            target = work[k, j]
            for i in range(k + 1, rows):
                factor, below = work[k, i], work[i, j]
                for lane in range(lanes):
                    target[lane] -= factor[lane] * below[lane]
            for lane in range(lanes):
                target[lane] *= inverse[lane]


@compiled
def _shift(A: Any, G: Any, Q: Any, factor: float, lanes: int, work: Any, shift: Any) -> None:
    """Geometric mean of the moduli of the closed-loop poles, |det H|^(1/2n), times `factor`."""
    n = A.shape[0]
    for i in range(n):
        for j in range(n):
            for lane in range(lanes):
                work[i, j, lane] = A[i, j, lane]
                work[i, n + j, lane] = -G[i, j, lane]
                work[n + i, j, lane] = -Q[i, j, lane]
                work[n + i, n + j, lane] = -A[j, i, lane]
    _eliminated(work, lanes, shift)
    for lane in range(lanes):
        size = 0.0
        for i in range(n):
            for j in range(n):
                size += A[i, j, lane] * A[i, j, lane]
        size = math.sqrt(size) + 1.0
        mean = math.exp(shift[lane] / (2.0 * n))
        shift[lane] = factor * (mean if 1e-8 * size < mean < math.inf else size)


@compiled
def _started(
    A: Any, G: Any, Q: Any, shift: Any, lanes: int, power: Any, dual: Any, primal: Any, scratch: Any, work: Any
) -> None:
    """Symplectic pencil of the Cayley transform: I + 2 s W', 2 s V G W and 2 s W Q V with V, W as in `doubling`."""
    n = A.shape[0]
    one, two, three = scratch[0], scratch[1], scratch[2]
    spare = np.empty(A.shape[2])
    for i in range(n):
        for j in range(n):
            for lane in range(lanes):
                work[i, j, lane] = A[i, j, lane] - (shift[lane] if i == j else 0.0)
                work[i, n + j, lane] = 1.0 if i == j else 0.0
    _solved(work, lanes, spare)
    for i in range(n):
        for j in range(n):
            for lane in range(lanes):
                one[i, j, lane] = work[i, n + j, lane]  # V
    lane_product(one, G, two, lanes)  # V G
    lane_product(Q, two, three, lanes)
    for i in range(n):
        for j in range(n):
            for lane in range(lanes):
                work[i, j, lane] = A[j, i, lane] - (shift[lane] if i == j else 0.0) + three[i, j, lane]
                work[i, n + j, lane] = 1.0 if i == j else 0.0
    _solved(work, lanes, spare)
    for i in range(n):
        for j in range(n):
            for lane in range(lanes):
                three[i, j, lane] = work[i, n + j, lane]  # W
                power[j, i, lane] = 2.0 * shift[lane] * three[i, j, lane] + (1.0 if i == j else 0.0)
    lane_product(two, three, dual, lanes)
    lane_product(three, Q, two, lanes)
    lane_product(two, one, primal, lanes)
    for matrix in (dual, primal):
        for i in range(n):
            for j in range(i + 1):
                for lane in range(lanes):
                    value = shift[lane] * (matrix[i, j, lane] + matrix[j, i, lane])
                    matrix[i, j, lane] = value
                    matrix[j, i, lane] = value


@compiled
def _doubled(power: Any, dual: Any, primal: Any, lanes: int, scratch: Any, work: Any, moved: Any, size: Any) -> None:
    """One doubling; norms of the step of `primal` and of `primal`."""
    n = power.shape[0]
    one, two, three = scratch[0], scratch[1], scratch[2]
    lane_product(dual, primal, one, lanes)
    for i in range(n):
        for j in range(n):
            for lane in range(lanes):
                work[i, j, lane] = one[i, j, lane] + (1.0 if i == j else 0.0)
                work[i, n + j, lane] = power[i, j, lane]
                work[i, 2 * n + j, lane] = dual[i, j, lane]
    _solved(work, lanes, moved)
    # Views of columns would not be contiguous, and loops over them not vectorised.
    ahead, through = scratch[3], scratch[4]
    for i in range(n):
        for j in range(n):
            for lane in range(lanes):
                ahead[i, j, lane] = work[i, n + j, lane]
                through[i, j, lane] = work[i, 2 * n + j, lane]
    _transposed(power, three, lanes)
    lane_product(through, three, one, lanes)
    lane_product(power, one, two, lanes)
    _added(dual, two, lanes, moved, size)
    lane_product(primal, ahead, one, lanes)
    lane_product(three, one, two, lanes)
    _added(primal, two, lanes, moved, size)
    lane_product(power, ahead, one, lanes)
    for i in range(n):
        for j in range(n):
            for lane in range(lanes):
                power[i, j, lane] = one[i, j, lane]


@compiled
def _added(matrix: Any, step: Any, lanes: int, moved: Any, size: Any) -> None:
    """Symmetric part of `step` added; Frobenius norms of step and sum."""
    n = matrix.shape[0]
    for lane in range(lanes):
        moved[lane] = size[lane] = 0.0
    for i in range(n):
        for j in range(i + 1):
            weight = 1.0 if i == j else 2.0
            for lane in range(lanes):
                part = 0.5 * (step[i, j, lane] + step[j, i, lane])
                value = matrix[i, j, lane] + part
                matrix[i, j, lane] = value
                matrix[j, i, lane] = value
                moved[lane] += weight * part * part
                size[lane] += weight * value * value
    for lane in range(lanes):
        moved[lane], size[lane] = math.sqrt(moved[lane]), math.sqrt(size[lane])


@compiled
def _norm(matrix: Any, lane: int) -> float:
    total = 0.0
    for i in range(matrix.shape[0]):
        for j in range(matrix.shape[1]):
            total += matrix[i, j, lane] * matrix[i, j, lane]
    return math.sqrt(total)


@compiled
def _judged(
    A: Any, G: Any, Q: Any, primal: Any, power: Any, lanes: int, scratch: Any, residual: Any, rest: Any
) -> None:
    """Residual of the equation relative to the norms of its terms, and the norm of the last power."""
    n = A.shape[0]
    forward, middle, quadratic = scratch[0], scratch[1], scratch[2]
    lane_product(primal, A, forward, lanes)
    lane_product(primal, G, middle, lanes)
    lane_product(middle, primal, quadratic, lanes)
    for lane in range(lanes):
        total = 0.0
        for i in range(n):
            for j in range(n):
                value = Q[i, j, lane] + forward[i, j, lane] + forward[j, i, lane] - quadratic[i, j, lane]
                total += value * value
        size = _norm(Q, lane) + 2.0 * _norm(forward, lane) + _norm(quadratic, lane)
        residual[lane] = math.sqrt(total) / (size if size > 0.0 else 1.0)
        rest[lane] = _norm(power, lane)


@compiled
def _equations(A: Any, G: Any, Q: Any, factor: float, block: int, P: Any, residual: Any, rest: Any) -> None:
    """All equations, block by block."""
    n = A.shape[1]
    one_A, one_G, one_Q = np.empty((n, n, block)), np.empty((n, n, block)), np.empty((n, n, block))
    power, dual, primal = np.empty((n, n, block)), np.empty((n, n, block)), np.empty((n, n, block))
    scratch, square = np.empty((5, n, n, block)), np.empty((2 * n, 2 * n, block))
    wide, double = np.empty((n, 3 * n, block)), np.empty((n, 2 * n, block))
    shift, moved, size = np.empty(block), np.empty(block), np.empty(block)
    for first in range(0, A.shape[0], block):
        lanes = min(block, A.shape[0] - first)
        for lane in range(lanes):
            for i in range(n):
                for j in range(n):
                    one_A[i, j, lane] = A[first + lane, i, j]
                    one_G[i, j, lane] = G[first + lane, i, j]
                    one_Q[i, j, lane] = Q[first + lane, i, j]
        _shift(one_A, one_G, one_Q, factor, lanes, square, shift)
        _started(one_A, one_G, one_Q, shift, lanes, power, dual, primal, scratch, double)
        for _ in range(MAXIMUM_DOUBLINGS):
            _doubled(power, dual, primal, lanes, scratch, wide, moved, size)
            left = 0
            for lane in range(lanes):
                if moved[lane] > _CONVERGED * size[lane] and size[lane] < math.inf:
                    left += 1
            if left == 0:
                break
        end = first + lanes
        _judged(one_A, one_G, one_Q, primal, power, lanes, scratch, residual[first:end], rest[first:end])
        for lane in range(lanes):
            for i in range(n):
                for j in range(n):
                    P[first + lane, i, j] = primal[i, j, lane]
