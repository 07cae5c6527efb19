"""Compiled products of many small matrices: entry (i, j) of all of a block lies in one row of memory."""

from __future__ import annotations

from typing import Any

from maglev_ctrl.kernels.compiled import compiled


@compiled
def lane_product(left: Any, right: Any, result: Any, lanes: int) -> None:
    """result = left @ right for every lane; (r, k, block), (k, c, block), (r, c, block)."""
    inner = left.shape[1]
    whole = inner - inner % 4
    for i in range(left.shape[0]):
        for j in range(right.shape[1]):
            target = result[i, j]
            for lane in range(lanes):
                target[lane] = 0.0
            for k in range(0, whole, 4):
                a, b, c, d = left[i, k], left[i, k + 1], left[i, k + 2], left[i, k + 3]
                e, f, g, h = right[k, j], right[k + 1, j], right[k + 2, j], right[k + 3, j]
                for lane in range(lanes):
                    target[lane] += a[lane] * e[lane] + b[lane] * f[lane] + c[lane] * g[lane] + d[lane] * h[lane]
            for k in range(whole, inner):
                a, e = left[i, k], right[k, j]
                for lane in range(lanes):
                    target[lane] += a[lane] * e[lane]
