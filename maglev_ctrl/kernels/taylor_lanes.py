"""Compiled Taylor propagation of many periodic systems: loops over rows x (columns x segments).

The recurrence is that of `taylor`: coefficient m + 1 of the state follows from A_0 times coefficient m and from the
convolution of the earlier ones with the Taylor coefficients of cos and sin, for the states the modulation reads.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.kernels.compiled import compiled, require_numba

_TILE_COLUMNS = 96  # columns integrated at once: the inner trip count, and a history that fits the cache


def monodromy_many(
    A_0: FloatArray, A_cos: FloatArray, A_sin: FloatArray, frequency: FloatArray, segments: int, order: int
) -> FloatArray:
    """Propagators over one period of many systems x' = [A_0 + sum_h (A_cos[h] cos h W t + A_sin[h] sin h W t)] x.

    Parameters
    ----------
    A_0 : (B, n, n); A_cos, A_sin : (B, H, n, n), 1/s
    frequency : (B,) W in rad/s
    segments, order : steps per period and Taylor order, from `taylor_plan` for the hardest of the systems

    Raises
    ------
    ModelError : numba is not installed
    ValueError : shapes that do not fit, no segment, or an order below 1
    """
    require_numba()
    A_0, A_cos, A_sin = (np.ascontiguousarray(A, dtype=np.float64) for A in (A_0, A_cos, A_sin))
    frequency = np.ascontiguousarray(frequency, dtype=np.float64)
    count, n = A_0.shape[0], A_0.shape[-1]
    if A_0.shape != (count, n, n) or A_cos.shape != A_sin.shape or frequency.shape != (count,):
        raise ValueError("A_0, A_cos, A_sin, frequency: expected shapes (B, n, n), twice (B, H, n, n) and (B,)")
    if A_cos.ndim != 4 or A_cos.shape[0] != count or A_cos.shape[2:] != (n, n):
        raise ValueError(f"A_cos: expected shape ({count}, H, {n}, {n}), got {A_cos.shape}")
    if segments < 1 or order < 1:
        raise ValueError(f"segments, order: expected at least 1, got {segments} and {order}")
    read = np.nonzero(np.any((A_cos != 0.0) | (A_sin != 0.0), axis=(0, 1, 2)))[0].astype(np.int64)
    result = np.empty_like(A_0)
    tile = max(1, min(segments, -(-_TILE_COLUMNS // n)))
    _monodromy(A_0, A_cos, A_sin, frequency, segments, order, read, tile, result)
    return result


@compiled
def _monodromy(
    A_0: Any, A_cos: Any, A_sin: Any, frequency: Any, segments: int, order: int, read: Any, tile: int, result: Any
) -> None:
    """`result` (B, n, n); `read` (u,) the states the modulation reads; `tile` segments are integrated side by side."""
    n, harmonics, used = A_0.shape[1], A_cos.shape[1], read.shape[0]
    width = tile * n
    history = np.empty((order, used, width))
    current, following, total = np.empty((n, width)), np.empty((n, width)), np.empty((n, width))
    cosines, sines = np.empty((harmonics, width)), np.empty((harmonics, width))
    factors = np.empty((harmonics, order))
    even, odd = np.empty(width), np.empty(width)
    product = np.empty((n, n))
    for system in range(A_0.shape[0]):
        step = 2.0 * math.pi / (frequency[system] * segments)
        for h in range(harmonics):
            factors[h, 0] = 1.0
            for m in range(1, order):
                turn = 2.0 * math.pi * (h + 1) / segments / m
                factors[h, m] = factors[h, m - 1] * (turn if m % 2 else -turn)
        whole = result[system]
        for i in range(n):
            for j in range(n):
                whole[i, j] = 1.0 if i == j else 0.0
        for first in range(0, segments, tile):
            count = min(tile, segments - first)
            columns = count * n
            for h in range(harmonics):
                for c in range(columns):
                    phase = 2.0 * math.pi * ((h + 1) * (first + c // n) % segments) / segments
                    cosines[h, c], sines[h, c] = math.cos(phase), math.sin(phase)
            for i in range(n):
                for c in range(columns):
                    current[i, c] = total[i, c] = 1.0 if c % n == i else 0.0
            for m in range(order):
                for r in range(used):
                    for c in range(columns):
                        history[m, r, c] = current[read[r], c]
                for i in range(n):
                    for c in range(columns):
                        following[i, c] = 0.0
                    for k in range(n):
                        _add(following[i], A_0[system, i, k], current[k], columns)
                for h in range(harmonics):
                    for r in range(used):
                        for c in range(columns):
                            even[c] = odd[c] = 0.0
                        for j in range(m + 1):
                            _add(odd if j % 2 else even, factors[h, j], history[m - j, r], columns)
                        for c in range(columns):
                            e, o = even[c], odd[c]
                            even[c] = cosines[h, c] * e - sines[h, c] * o
                            odd[c] = sines[h, c] * e + cosines[h, c] * o
                        for i in range(n):
                            _add(following[i], A_cos[system, h, i, read[r]], even, columns)
                            _add(following[i], A_sin[system, h, i, read[r]], odd, columns)
                scale = step / (m + 1)
                for i in range(n):
                    for c in range(columns):
                        following[i, c] *= scale
                        total[i, c] += following[i, c]
                current, following = following, current
            for s in range(count):
                for i in range(n):
                    for j in range(n):
                        product[i, j] = 0.0
                    for k in range(n):
                        _add(product[i], total[i, s * n + k], whole[k], n)
                for i in range(n):
                    for j in range(n):
                        whole[i, j] = product[i, j]


@compiled
def _add(target: Any, factor: float, source: Any, count: int) -> None:
    """target += factor * source over the first `count` entries; nothing to do for a factor of zero."""
    if factor != 0.0:
        for c in range(count):
            target[c] += factor * source[c]
