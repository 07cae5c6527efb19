"""Compiled spectral radii: loops over rows x (columns x lanes), one lane per matrix.

Entry (i, j) of all matrices of a block lies in one row of memory, so every inner loop runs over matrices and
vectorises whatever n is; lanes that are done are squeezed out. Beyond `LANES_UP_TO` a block is one matrix, multiplied
by BLAS. The method and its error bounds are those of `spectral_radius`.
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np

from maglev_ctrl.kernels.compiled import compiled, compiled_sum
from maglev_ctrl.kernels.lanes import lane_product
from maglev_ctrl.kernels.spectral_radius import ACCURACY, CHECKS, LAST_SQUARING, ROUNDING, SAFETY, SLACK, TINY

LANES_UP_TO: Final = 8  # larger matrices are multiplied one by one by BLAS, which is faster then
_FIRST, _STEP, _LAST = CHECKS[0], 2, CHECKS[-1]
_SMALL = 2.0**-24  # a norm below this is scaled up again
_BLOCK_ENTRIES = 4096  # entries of one block: two blocks fit the first-level cache


def block_size(n: int) -> int:
    """Lanes per block: as many as the first-level cache holds; one where the matrix alone fills BLAS's registers."""
    return 1 if n > LANES_UP_TO else int(min(128, max(16, _BLOCK_ENTRIES // (n * n) // 8 * 8)))


@compiled
def _multiply(left: Any, right: Any, result: Any, lanes: int) -> None:
    """result = left @ right for every lane; all (n, n, block)."""
    n = left.shape[0]
    if left.shape[2] == 1:
        np.dot(left.reshape(n, n), right.reshape(n, n), result.reshape(n, n))
        return
    lane_product(left, right, result, lanes)


@compiled
def _load(values: Any, first: int, lanes: int, matrix: Any, exponent: Any, error: Any) -> None:
    """One block from `values` (q, n n), scaled exactly so that the largest entry is in [1/2, 1)."""
    n = matrix.shape[0]
    for lane in range(lanes):
        source = values[first + lane]
        largest = 0.0
        for entry in range(n * n):
            size = abs(source[entry])
            largest = size if size > largest or size != size else largest
        shift = 0
        if 0.0 < largest < math.inf:
            _, shift = math.frexp(largest)
        # in two steps, because 2^shift alone may overflow
        one = math.ldexp(1.0, -(shift // 2))
        two = math.ldexp(1.0, -(shift - shift // 2))
        for i in range(n):
            for j in range(n):
                matrix[i, j, lane] = source[i * n + j] * one * two
        exponent[lane] = float(shift)
        error[lane] = error[lane] * one * two


@compiled_sum
def _squares(entries: Any) -> float:
    """Sum of the squares of a one-dimensional array."""
    total = 0.0
    for k in range(entries.shape[0]):
        total += entries[k] * entries[k]
    return total


@compiled_sum
def _squares_of_rest(one: Any, two: Any, three: Any, first: float, product: float) -> float:
    """Sum of the squares of `three` - first * `two` + product * `one`, all one-dimensional."""
    total = 0.0
    for k in range(one.shape[0]):
        part = three[k] - first * two[k] + product * one[k]
        total += part * part
    return total


@compiled_sum
def _mixed(left: Any, right: Any) -> float:
    """tr(left @ right)."""
    total = 0.0
    for i in range(left.shape[0]):
        for j in range(left.shape[0]):
            total += left[i, j] * right[j, i]
    return total


@compiled
def _normalise(matrix: Any, exponent: Any, error: Any, norm: Any, lanes: int) -> None:
    """Frobenius norms; matrices that became small are scaled up by a power of two."""
    n = matrix.shape[0]
    if matrix.shape[2] == 1:
        norm[0] = _squares(matrix.reshape(n * n))
    else:
        for lane in range(lanes):
            norm[lane] = 0.0
        for i in range(n):
            for j in range(n):
                row = matrix[i, j]
                for lane in range(lanes):
                    norm[lane] += row[lane] * row[lane]
    for lane in range(lanes):
        norm[lane] = math.sqrt(norm[lane])
        if (norm[lane] >= 1.0 or norm[lane] < _SMALL) and TINY < norm[lane] < math.inf:
            _, shift = math.frexp(norm[lane])
            scale = math.ldexp(1.0, -shift)
            for i in range(n):
                for j in range(n):
                    matrix[i, j, lane] *= scale
            exponent[lane] += shift
            norm[lane] *= scale
            error[lane] *= scale


@compiled
def _squeeze(matrix: Any, numbers: Any, place: Any, lanes: int) -> int:
    """Lanes with place >= 0 moved to the front of `matrix` (n, n, .) and `numbers` (k, .); how many remain."""
    n, kept = matrix.shape[0], 0
    source = np.empty(lanes, np.int64)
    for lane in range(lanes):
        if place[lane] >= 0:
            source[kept] = lane
            place[kept] = place[lane]
            kept += 1
    for i in range(n):
        for j in range(n):
            for lane in range(kept):
                matrix[i, j, lane] = matrix[i, j, source[lane]]
    for i in range(numbers.shape[0]):
        for lane in range(kept):
            numbers[i, lane] = numbers[i, source[lane]]
    return kept


@compiled
def decide_lanes(values: Any, rounding: Any, n: int, block: int, stable: float, unstable: float, result: Any) -> None:
    """`result` (q,) from `values` (q, n n): see `spectral_radius.judged`; `stable`, `unstable`: log2 of the levels."""
    matrix, square = np.empty((n, n, block)), np.empty((n, n, block))
    numbers, norm, place = np.empty((2, block)), np.empty(block), np.empty(block, np.int64)
    exponent, error = numbers[0], numbers[1]
    for first in range(0, values.shape[0], block):
        lanes = min(block, values.shape[0] - first)
        for lane in range(lanes):
            place[lane] = first + lane
            error[lane] = rounding[first + lane]
        _load(values, first, lanes, matrix, exponent, error)
        count, squarings = 1.0, 0
        while True:
            _normalise(matrix, exponent, error, norm, lanes)
            left = 0
            for lane in range(lanes):
                if place[lane] < 0:
                    continue
                size, scale, bound = norm[lane], exponent[lane], error[lane]
                above = math.log2((size + bound) * SLACK)
                trace = 0.0
                for i in range(n):
                    trace += matrix[i, i, lane]
                trace = abs(trace) - n * (bound + n * ROUNDING * size)
                found = 0
                if trace > 0.0:
                    below = math.log2(trace / (n * SLACK))
                    room = 4.0 * ROUNDING * (abs(below) + abs(scale) + abs(count * unstable) + 1.0)
                    if below + scale > count * unstable + room:
                        found = 1
                room = 4.0 * ROUNDING * (abs(above) + abs(scale) + abs(count * stable) + 1.0)
                if above + scale < count * stable - room:
                    found = -1
                if found != 0 or not bound < 1.0 or not size < math.inf:
                    result[place[lane]] = found
                    place[lane] = -1
                else:
                    left += 1
            if left == 0 or squarings == LAST_SQUARING:
                break
            if lanes - left >= 8:
                kept = _squeeze(matrix, numbers, place, lanes)
                for lane in range(kept):
                    norm[lane] = 0.0
                lanes = kept
                _normalise(matrix, exponent, error, norm, lanes)
            _multiply(matrix, matrix, square, lanes)
            matrix, square = square, matrix
            for lane in range(lanes):
                size, bound = norm[lane], error[lane]
                error[lane] = (bound * (2.0 * size + bound) + n * ROUNDING * size * size + TINY) * SLACK
                exponent[lane] *= 2.0
            count, squarings = 2.0 * count, squarings + 1


@compiled
def _pair(matrix: Any, square: Any, lanes: int, traces: Any) -> None:
    """tr P, tr P^2 and tr P^3 of every lane into `traces` (3, lanes)."""
    n = matrix.shape[0]
    for lane in range(lanes):
        traces[0, lane] = traces[1, lane] = traces[2, lane] = 0.0
    if matrix.shape[2] == 1:
        for i in range(n):
            traces[0, 0] += matrix[i, i, 0]
            traces[1, 0] += square[i, i, 0]
        traces[2, 0] = _mixed(matrix.reshape(n, n), square.reshape(n, n))
        return
    first, second, third = traces[0], traces[1], traces[2]
    for i in range(n):
        one, two = matrix[i, i], square[i, i]
        for lane in range(lanes):
            first[lane] += one[lane]
            second[lane] += two[lane]
        for j in range(n):
            one, two = matrix[i, j], square[j, i]
            for lane in range(lanes):
                third[lane] += one[lane] * two[lane]


@compiled
def _residuals(matrix: Any, square: Any, cube: Any, traces: Any, rest: Any, lanes: int) -> None:
    """Frobenius norm of P^3 - e_1 P^2 + e_2 P per lane."""
    n = matrix.shape[0]
    if matrix.shape[2] == 1:
        first, second = traces[0, 0], traces[1, 0]
        product = 0.5 * (first * first - second)
        one, two, three = matrix.reshape(n * n), square.reshape(n * n), cube.reshape(n * n)
        rest[0] = math.sqrt(_squares_of_rest(one, two, three, first, product))
        return
    for lane in range(lanes):
        rest[lane] = 0.0
    for i in range(n):
        for j in range(n):
            for lane in range(lanes):
                first, second = traces[0, lane], traces[1, lane]
                part = cube[i, j, lane] - first * square[i, j, lane]
                part += 0.5 * (first * first - second) * matrix[i, j, lane]
                rest[lane] += part * part
    for lane in range(lanes):
        rest[lane] = math.sqrt(rest[lane])


@compiled
def _leading(first: float, second: float) -> tuple[float, float, float]:
    """e_2, the squared root distance and the larger modulus from tr P and tr P^2."""
    product, distance = 0.5 * (first * first - second), 2.0 * second - first * first
    if distance >= 0.0:
        return product, distance, 0.5 * (abs(first) + math.sqrt(distance))
    return product, distance, math.sqrt(product)


@compiled
def _estimate(distance: float, size: float, rest: float, n: int, squarings: int, history: Any) -> tuple[float, float]:
    """Spectral radius and its relative error from one lane; see `spectral_radius.verified_modulus`.

    `history` (squarings + 1,): log2 |M^(2^j)|. Sizes here are relative to the matrix as it is scaled.
    """
    count = 2.0**squarings
    logarithm = history[squarings] / count + math.log2(size) / count
    loss, condition, power = 0.0, 0.0, 1.0
    for level in range(squarings + 1):
        growth = 2.0 ** (history[level] - power * logarithm)
        loss, condition, power = loss + growth / power, max(condition, growth), 2.0 * power
    truncation = rest / size**3
    rounding = SAFETY * n * ROUNDING * (1.0 / size**2 + count * loss * condition)
    error = truncation + rounding
    apart = max(math.sqrt(abs(distance)) / size, math.sqrt(error))
    amplified = 2.0 * error / apart
    if distance < -4.0 * error * size**2:
        amplified = n * truncation + rounding
    return 2.0**logarithm, amplified / count if error < 1e-2 else math.inf


@compiled
def moduli_lanes(values: Any, n: int, block: int, modulus: Any) -> None:
    """`modulus` (q,) from `values` (q, n n), left alone where not sure."""
    matrix, square, cube = np.empty((n, n, block)), np.empty((n, n, block)), np.empty((n, n, block))
    # rows: the exponent now, the error (unused here), log2 of the norms of all powers so far
    numbers, norm, place = np.zeros((_LAST + 3, block)), np.empty(block), np.empty(block, np.int64)
    traces, rest, tried = np.empty((3, block)), np.empty(block), np.empty(block, np.bool_)
    exponent, error = numbers[0], numbers[1]
    for first in range(0, values.shape[0], block):
        lanes = min(block, values.shape[0] - first)
        for lane in range(lanes):
            place[lane], error[lane] = first + lane, 0.0
        _load(values, first, lanes, matrix, exponent, error)
        for squarings in range(_LAST + 1):
            _normalise(matrix, exponent, error, norm, lanes)
            for lane in range(lanes):
                numbers[2 + squarings, lane] = exponent[lane] + math.log2(norm[lane])
            _multiply(matrix, matrix, square, lanes)
            if squarings >= _FIRST and (squarings - _FIRST) % _STEP == 0:
                _pair(matrix, square, lanes, traces)
                any_tried = False
                for lane in range(lanes):
                    one = traces[0, lane]
                    product, _, size = _leading(one, traces[1, lane])
                    third = abs(traces[2, lane] - one * one * one + 3.0 * one * product)
                    tried[lane] = place[lane] >= 0 and size > 0.0 and third <= ACCURACY * 2.0**squarings * size**3
                    any_tried = any_tried or tried[lane]
                if any_tried:
                    _multiply(square, matrix, cube, lanes)
                    _residuals(matrix, square, cube, traces, rest, lanes)
                left = 0
                for lane in range(lanes):
                    if tried[lane]:
                        # relative to the norm, as the bounds want it
                        scale = 1.0 / norm[lane]
                        _, distance, size = _leading(traces[0, lane], traces[1, lane])
                        value, wrong = _estimate(
                            distance * scale**2, size * scale, rest[lane] * scale**3, n, squarings, numbers[2:, lane]
                        )
                        if wrong <= ACCURACY:
                            modulus[place[lane]] = value
                            place[lane] = -1
                    if not norm[lane] > TINY:
                        place[lane] = -1
                    left += 1 if place[lane] >= 0 else 0
                if left == 0:
                    break
                if lanes - left >= 8:
                    lanes = _squeeze(square, numbers, place, lanes)
            matrix, square = square, matrix
            for lane in range(lanes):
                exponent[lane] *= 2.0
