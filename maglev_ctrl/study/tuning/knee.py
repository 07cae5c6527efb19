"""The knee of a Pareto front: where giving up a little of one objective stops buying much of another.

Das, Structural Optimization 18 (1999) 107: on the front scaled to 0 .. 1 in every objective, the point farthest from
the plane through the best points of the single objectives, on the side of the ideal point.
"""

from __future__ import annotations

import numpy as np

from maglev_ctrl.arrays import FloatArray


def knee(score: FloatArray) -> int:
    """Row of a front's knee.

    Where the single best points span no plane (one of them is best in two objectives) it is the row nearest to the
    ideal point instead. Objectives in which all rows are equal are left out.

    Parameters
    ----------
    score : (p, k) rows that do not better one another, every column to be made small

    Raises
    ------
    ValueError : no row, or values that are not finite

    Examples
    --------
    >>> x = np.linspace(0.0, 1.0, 101)
    >>> front = np.column_stack([x, (1.0 - np.sqrt(x)) ** 2])   # farthest from its chord at x = 1/4
    >>> float(x[knee(front)])
    0.25
    """
    values = np.asarray(score, dtype=np.float64)
    if values.ndim != 2 or not len(values) or not np.all(np.isfinite(values)):
        raise ValueError("score: expected finite rows of objectives, at least one")
    low, high = np.min(values, axis=0), np.max(values, axis=0)
    varying = high - low > 1e-9 * np.maximum(np.abs(high), np.abs(low))
    if not np.any(varying):
        return 0
    scaled = (values[:, varying] - low[varying]) / (high - low)[varying]
    k = scaled.shape[1]
    if k == 1:
        return int(np.argmin(scaled[:, 0]))
    ends = scaled[[_end(scaled, j) for j in range(k)]]
    try:
        # The plane n x = 1 through the single best points; n positive, for all of them lie above the ideal point.
        normal = np.linalg.solve(ends, np.ones(k)) if np.linalg.cond(ends) < 1e9 else np.zeros(k)
    except np.linalg.LinAlgError:
        normal = np.zeros(k)
    if not np.all(normal > 0.0):
        return int(np.argmin(np.linalg.norm(scaled, axis=1)))
    depth = (1.0 - scaled @ normal) / np.linalg.norm(normal)
    return int(np.argmax(depth))


def _end(scaled: FloatArray, objective: int) -> int:
    """The best row of one objective; of equals the best in the sum of the others."""
    return min(range(len(scaled)), key=lambda i: (scaled[i, objective], float(np.sum(scaled[i]))))
