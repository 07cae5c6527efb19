"""From a solver's point to one exact to rounding: the linear equations of the bounds that are active."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.linalg import lstsq

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.synthesis.predictive.kkt import kkt_residual, largest_in_rows

LARGEST = 1500
"""Unknowns and active bounds together, above which no dense refinement is tried."""


def refine(
    P: Any, q: FloatArray, A: Any, bounds: tuple[FloatArray, FloatArray], *, x: FloatArray, y: FloatArray
) -> tuple[FloatArray, FloatArray] | None:
    """The best (x, y) among guesses of the active bounds: P x + A_a'y_a = -q, A_a x = b_a by least squares.

    Least squares of least change take degenerate sets (dependent or idle rows) as they are. None where no guess gives
    finite numbers.

    Parameters
    ----------
    P, A : dense or sparse
    bounds : l, u (m,)
    x, y : the solver's point and multipliers

    Examples
    --------
    >>> one, none = np.eye(1), np.array([-np.inf])
    >>> found = refine(one, -np.ones(1), one, (none, np.array([0.5])), x=np.array([0.499]), y=np.array([0.49]))
    >>> [round(float(v[0]), 12) for v in found]
    [0.5, 0.5]
    """
    lower, upper = bounds
    rows = largest_in_rows(A)
    product = np.asarray(A @ x).ravel()
    length = max(_largest(x), 1e-300)
    steepness = max(_largest(P @ x), _largest(q), 1e-300)
    to_upper, to_lower = ((upper - product) / rows / length, (product - lower) / rows / length)
    push = y * rows / steepness
    fixed = lower == upper
    guesses = [
        (push > np.abs(to_upper), -push > np.abs(to_lower)),
        (push > 1e-6, -push > 1e-6),
        ((push >= 0.0) & (np.abs(to_upper) < 1e-6), (push <= 0.0) & (np.abs(to_lower) < 1e-6)),
        ((push > 1e-9) & (np.abs(to_upper) < 1e-4), (-push > 1e-9) & (np.abs(to_lower) < 1e-4)),
    ]
    best: tuple[FloatArray, FloatArray] | None = None
    least = np.inf
    for at_upper, at_lower in guesses:
        at_upper = (at_upper | fixed) & np.isfinite(upper)
        at_lower = at_lower & np.isfinite(lower) & ~at_upper
        found = _on_bounds(
            P, q, A, np.where(at_upper, upper, np.where(at_lower, lower, 0.0)), at_upper | at_lower, x, y
        )
        if found is None:
            continue
        moved, pushed = found
        # the wrong sign of a multiplier is no multiplier: drop it and let the residual tell
        pushed = np.where(fixed, pushed, np.where(at_upper, np.maximum(pushed, 0.0), np.minimum(pushed, 0.0)))
        residual = kkt_residual(P, q, A, bounds, x=moved, y=pushed).largest
        if residual < least:
            best, least = (moved, pushed), residual
    return best


def _on_bounds(
    P: Any, q: FloatArray, A: Any, sides: FloatArray, active: Any, x: FloatArray, y: FloatArray
) -> tuple[FloatArray, FloatArray] | None:
    n, chosen = q.size, np.flatnonzero(active)
    if n + chosen.size > LARGEST:
        return None
    weight, tied = _dense(P), _dense(A[chosen])
    size = float(np.max(np.abs(weight))) if weight.size and np.any(weight) else 1.0
    norms = largest_in_rows(tied)
    tied = tied / norms[:, None]
    K = np.block([[weight / size, tied.T], [tied, np.zeros((chosen.size, chosen.size))]])
    point, push = x.copy(), np.where(active, y, 0.0)
    try:
        for _ in range(2):
            scaled = push[chosen] * norms / size
            rest = np.concatenate([
                -(weight @ point + q) / size - tied.T @ scaled, sides[chosen] / norms - tied @ point
            ])  # fmt: skip
            change = np.asarray(lstsq(K, rest, cond=1e-12, lapack_driver="gelsy")[0], dtype=float)
            point = point + change[:n]
            push[chosen] = (scaled + change[n:]) * size / norms
    except np.linalg.LinAlgError:
        return None
    return (point, push) if np.all(np.isfinite(point)) and np.all(np.isfinite(push)) else None


def _dense(matrix: Any) -> FloatArray:
    return np.asarray(matrix.toarray() if hasattr(matrix, "toarray") else matrix, dtype=float)


def _largest(values: Any) -> float:
    array = np.asarray(values)
    return float(np.max(np.abs(array))) if array.size else 0.0
