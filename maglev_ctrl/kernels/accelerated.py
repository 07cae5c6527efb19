"""The `fast` extra: spectral radii and Taylor propagation compiled by numba, as loops over rows x (columns x lanes).

Many matrices are worked on side by side: entry (i, j) of all of them lies in one row of memory, so every inner loop
runs over matrices (or over columns of many segments) and vectorises whatever n is. The method and its error bounds are
those of `spectral_radius` and `taylor`. Lanes that are done are squeezed out of a block.

Importing this module imports numba where it is installed; nothing else in the package does. Only contraction to
fused multiply-add is allowed beyond IEEE arithmetic, so NaN and infinity behave; all bounds hold with it. Compiled
code is cached on disk.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.errors import ModelError
from maglev_ctrl.kernels.spectral_radius import (
    ACCURACY,
    CHECKS,
    LAST_SQUARING,
    ROUNDING,
    SLACK,
    TINY,
    NumpyRadius,
    check_levels,
    checked,
    chunks,
    completed,
    series_rounding,
)

try:
    from numba import njit
except ImportError:  # the extra is not installed: `fast_engine` says so
    njit = None

_Function = TypeVar("_Function", bound=Callable[..., Any])
_FIRST, _STEP, _LAST = CHECKS[0], 2, CHECKS[-1]
_SAFETY = 2.0
_SMALL = 2.0**-24  # a norm below this is scaled up again
_BLOCK_ENTRIES = 4096  # entries of one block: two blocks fit the first-level cache
_TILE_COLUMNS = 96  # columns integrated at once: the inner trip count


def _compiled(function: _Function) -> _Function:
    """Compiled on first use, without the interpreter lock, cached on disk; as it is where numba is missing."""
    if njit is None:
        return function
    compiled: _Function = njit(nogil=True, cache=True, fastmath={"contract"}, error_model="numpy")(function)
    return compiled


@_compiled
def _multiply(left: Any, right: Any, result: Any, lanes: int) -> None:
    """result = left @ right for every lane; all (n, n, lanes)."""
    n = left.shape[0]
    whole = n - n % 4
    for i in range(n):
        for j in range(n):
            target = result[i, j]
            for lane in range(lanes):
                target[lane] = 0.0
            for k in range(0, whole, 4):
                a, b, c, d = left[i, k], left[i, k + 1], left[i, k + 2], left[i, k + 3]
                e, f, g, h = right[k, j], right[k + 1, j], right[k + 2, j], right[k + 3, j]
                for lane in range(lanes):
                    target[lane] += a[lane] * e[lane] + b[lane] * f[lane] + c[lane] * g[lane] + d[lane] * h[lane]
            for k in range(whole, n):
                a, e = left[i, k], right[k, j]
                for lane in range(lanes):
                    target[lane] += a[lane] * e[lane]


@_compiled
def _load(values: Any, first: int, lanes: int, matrix: Any, exponent: Any, error: Any) -> None:
    """One block from `values` (n n, q), scaled exactly so that the largest entry is in [1/2, 1); NaN if not finite."""
    n = matrix.shape[0]
    for lane in range(lanes):
        largest = 0.0
        for entry in range(n * n):
            size = abs(values[entry, first + lane])
            largest = size if size > largest or size != size else largest
        shift = 0
        if 0.0 < largest < math.inf:
            _, shift = math.frexp(largest)
        # in two steps, because 2^shift alone may overflow
        one = math.ldexp(1.0, -(shift // 2))
        two = math.ldexp(1.0, -(shift - shift // 2))
        for entry in range(n * n):
            matrix[entry // n, entry % n, lane] = values[entry, first + lane] * one * two
        exponent[lane] = float(shift)
        error[lane] = error[lane] * one * two


@_compiled
def _normalise(matrix: Any, exponent: Any, error: Any, norm: Any, lanes: int) -> None:
    """Frobenius norms; matrices that became small are scaled up by a power of two."""
    n = matrix.shape[0]
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


@_compiled
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


@_compiled
def _decide(values: Any, rounding: Any, n: int, block: int, stable: float, unstable: float, result: Any) -> None:
    """`result` (q,) from `values` (n n, q): see `spectral_radius.judged`; `stable`, `unstable`: log2 of the levels."""
    matrix, square = np.empty((n, n, block)), np.empty((n, n, block))
    numbers, norm, place = np.empty((2, block)), np.empty(block), np.empty(block, np.int64)
    exponent, error = numbers[0], numbers[1]
    for first in range(0, values.shape[1], block):
        lanes = min(block, values.shape[1] - first)
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


@_compiled
def _pair(matrix: Any, square: Any, lanes: int, traces: Any) -> None:
    """tr P, tr P^2 and tr P^3 of every lane into `traces` (3, lanes)."""
    n = matrix.shape[0]
    for lane in range(lanes):
        traces[0, lane] = traces[1, lane] = traces[2, lane] = 0.0
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


@_compiled
def _moduli(values: Any, n: int, block: int, modulus: Any) -> None:
    """`modulus` (q,) from `values` (n n, q), left alone where not sure: see `spectral_radius.verified_modulus`."""
    matrix, square, cube = np.empty((n, n, block)), np.empty((n, n, block)), np.empty((n, n, block))
    # rows: the exponent now, the error (unused), the exponents of all powers so far
    numbers, norm, place = np.zeros((_LAST + 3, block)), np.empty(block), np.empty(block, np.int64)
    traces, rest, try_it = np.empty((3, block)), np.empty(block), np.empty(block, np.bool_)
    exponent, error = numbers[0], numbers[1]
    for first in range(0, values.shape[1], block):
        lanes = min(block, values.shape[1] - first)
        for lane in range(lanes):
            place[lane], error[lane] = first + lane, 0.0
        _load(values, first, lanes, matrix, exponent, error)
        for squarings in range(_LAST + 1):
            count = 2.0**squarings
            _normalise(matrix, exponent, error, norm, lanes)
            for lane in range(lanes):
                numbers[2 + squarings, lane] = exponent[lane] + math.log2(norm[lane])
            _multiply(matrix, matrix, square, lanes)
            if squarings >= _FIRST and (squarings - _FIRST) % _STEP == 0:
                _pair(matrix, square, lanes, traces)
                tried = 0
                for lane in range(lanes):
                    one, two, three = traces[0, lane], traces[1, lane], traces[2, lane]
                    product, distance = 0.5 * (one * one - two), 2.0 * two - one * one
                    size = 0.5 * (abs(one) + math.sqrt(distance)) if distance >= 0.0 else math.sqrt(product)
                    third = abs(three - one * one * one + 3.0 * one * product)
                    try_it[lane] = place[lane] >= 0 and third <= ACCURACY * count * size**3 and size > 0.0
                    tried += 1 if try_it[lane] else 0
                left = 0
                if tried:
                    _multiply(square, matrix, cube, lanes)
                    for lane in range(lanes):
                        rest[lane] = 0.0
                    for i in range(n):
                        for j in range(n):
                            for lane in range(lanes):
                                one, two = traces[0, lane], traces[1, lane]
                                part = cube[i, j, lane] - one * square[i, j, lane]
                                part += 0.5 * (one * one - two) * matrix[i, j, lane]
                                rest[lane] += part * part
                for lane in range(lanes):
                    if try_it[lane]:
                        one, two = traces[0, lane], traces[1, lane]
                        product, distance = 0.5 * (one * one - two), 2.0 * two - one * one
                        size = 0.5 * (abs(one) + math.sqrt(distance)) if distance >= 0.0 else math.sqrt(product)
                        logarithm = exponent[lane] / count + math.log2(size) / count
                        loss = 0.0
                        for level in range(squarings + 1):
                            loss += 2.0 ** (numbers[2 + level, lane] - level - 2.0**level * logarithm)
                        size /= norm[lane]
                        truncation = math.sqrt(rest[lane]) / (size * norm[lane]) ** 3
                        lost = _SAFETY * n * ROUNDING * (1.0 / size**2 + count * loss / size)
                        total = truncation + lost
                        apart = max(math.sqrt(abs(distance)) / (size * norm[lane]), math.sqrt(total))
                        amplified = 2.0 * total / apart
                        if distance < -4.0 * total * (size * norm[lane]) ** 2:
                            amplified = n * truncation + lost
                        if total < 1e-2 and amplified <= ACCURACY * count:
                            modulus[place[lane]] = 2.0**logarithm
                            place[lane] = -1
                    if place[lane] >= 0 and not norm[lane] > TINY:
                        place[lane] = -1
                    left += 1 if place[lane] >= 0 else 0
                if left == 0:
                    break
                if lanes - left >= 8:
                    _squeeze(square, numbers, place, lanes)
                    lanes = left
            matrix, square = square, matrix
            for lane in range(lanes):
                exponent[lane] *= 2.0


class FastRadius(NumpyRadius):
    """The engine compiled by numba; leading multipliers themselves stay with LAPACK, which is faster at them."""

    name = "fast"

    def moduli(self, coefficients: FloatArray, basis: FloatArray) -> tuple[FloatArray, NDArray[np.bool_]]:
        """Spectral radii (q,), and which of them are sure to 1e-10 relative; the others come from eigenvalues."""
        coefficients, basis = checked(coefficients, basis)
        n = coefficients.shape[-1]
        modulus = np.full(len(basis), np.nan)
        for part in chunks(len(basis), n):
            values = _in_lanes(coefficients, basis[part])
            _moduli(values, n, _block(n), modulus[part])
            modulus[part][~np.any(values, axis=0)] = 0.0
        return completed(modulus, ~np.isnan(modulus), coefficients, basis)

    def decide(
        self, coefficients: FloatArray, basis: FloatArray, stable_below: float, unstable_above: float
    ) -> NDArray[np.int8]:
        """-1 where the radius is proved < stable_below, 1 where proved > unstable_above, else 0; (q,).

        Raises
        ------
        ValueError : stable_below > unstable_above, or shapes that do not fit
        """
        coefficients, basis = checked(coefficients, basis)
        check_levels(stable_below, unstable_above)
        n, result = coefficients.shape[-1], np.zeros(len(basis), dtype=np.int8)
        stable, unstable = (math.log2(r) if r > 0.0 else -math.inf for r in (stable_below, unstable_above))
        with np.errstate(all="ignore"):
            rounding = series_rounding(coefficients, basis)
        for part in chunks(len(basis), n):
            values = _in_lanes(coefficients, basis[part])
            _decide(values, rounding[part], n, _block(n), stable, unstable, result[part])
        return result


def fast_engine() -> FastRadius:
    """The compiled engine.

    Raises
    ------
    ModelError : numba is not installed
    """
    require_numba()
    return FastRadius()


def require_numba() -> None:
    """Say what is missing instead of running compiled code's Python source for hours.

    Raises
    ------
    ModelError : numba is not installed
    """
    if njit is None:
        raise ModelError(
            'backend fast: numba is not installed; install the extra with pip install "maglev-ctrl[fast]", '
            "or use the backend numpy"
        )


def _in_lanes(coefficients: FloatArray, basis: FloatArray) -> FloatArray:
    """The matrices side by side: (n n, q)."""
    with np.errstate(over="ignore", invalid="ignore"):
        return np.ascontiguousarray(coefficients.reshape(len(coefficients), -1).T @ basis.T)


def _block(n: int) -> int:
    """Lanes per block: as many as the first-level cache holds, at least 16, a multiple of 8."""
    return int(min(128, max(16, _BLOCK_ENTRIES // (n * n) // 8 * 8)))
