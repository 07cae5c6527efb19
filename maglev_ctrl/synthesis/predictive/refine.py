"""From a solver's point to one exact to rounding: the equations of the active bounds; an own active-set method."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from scipy.linalg import cho_factor, lstsq, solve_triangular

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.synthesis.predictive.kkt import NO_BOUND, kkt_residual, largest_in_rows

LARGEST = 1500
"""Unknowns and active bounds together, above which no dense refinement is tried."""
SMALL = 200
"""Unknowns and rows together, above which the own active-set method is not tried."""


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


def active_set_steps(
    P: Any, q: FloatArray, A: Any, bounds: tuple[FloatArray, FloatArray], *, x: FloatArray
) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Points of the proximal-point method, each by a dual active-set method (Rockafellar 1976, Goldfarb & Idnani 1983).

    Every step minimises the objective plus d |x - x_k|^2 / 2, which is strictly convex; d falls with the steps. None is
    given where a step finds the bounds to exclude one another, or the program is not small. For scaled programs.

    Parameters
    ----------
    P, A : dense or sparse, of order one
    bounds : l, u (m,)
    x : the first centre

    Examples
    --------
    >>> one = np.eye(1)
    >>> steps = active_set_steps(one, -np.ones(1), one, (np.array([-np.inf]), np.array([0.5])), x=np.zeros(1))
    >>> [round(float(v[0]), 12) for v in next(steps)]
    [0.5, 0.495]
    """
    n, m = q.size, A.shape[0]
    if n + m > SMALL:
        return
    weight = _dense(P)
    above, below, sides, limits, norms = _unit_sides(A, bounds)
    size = _largest(weight) or _largest(q) or 1.0
    for damping in (1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-7, 1e-7, 1e-7, 1e-7):
        near = damping * size
        try:
            found = _dual_active_set(weight + near * np.eye(n), q - near * x, sides, limits)
        except np.linalg.LinAlgError:
            return
        if found is None or found[0] is None or not np.all(np.isfinite(found[0])):
            return
        x, push = found[0], found[1] / norms
        y = np.zeros(m)
        y[above] += push[: above.size]
        y[below] -= push[above.size :]
        yield x, y


def excluding_rows(A: Any, bounds: tuple[FloatArray, FloatArray]) -> FloatArray | None:
    """A vector (m,) whose signs tell rows, and sides of them, that exclude one another, to be proved; None else.

    From the dual active-set method on the point nearest to the origin, which compares violations in units of the rows.

    Parameters
    ----------
    A : (m, n) dense or sparse
    bounds : l, u (m,)

    Examples
    --------
    >>> excluding_rows(np.ones((2, 1)), (np.array([1.0, -np.inf]), np.array([np.inf, 0.0]))).tolist()
    [-1.0, 1.0]
    """
    m, n = A.shape
    if n + m > SMALL or not m:
        return None
    above, below, sides, limits, norms = _unit_sides(A, bounds)
    try:
        found = _dual_active_set(np.eye(n), np.zeros(n), sides, limits)
    except np.linalg.LinAlgError:
        return None
    if found is None or found[0] is not None:
        return None
    push, y = found[1] / norms, np.zeros(m)
    y[above] += push[: above.size]
    y[below] -= push[above.size :]
    return y


def _unit_sides(A: Any, bounds: tuple[FloatArray, FloatArray]) -> tuple[Any, Any, FloatArray, FloatArray, FloatArray]:
    """Rows with an upper and with a lower bound, all as sides x >= limits with sides of norm one, and the norms."""
    rows, (lower, upper) = _dense(A), bounds
    above, below = np.flatnonzero(upper < NO_BOUND), np.flatnonzero(lower > -NO_BOUND)
    sides, limits = np.vstack([-rows[above], rows[below]]), np.concatenate([-upper[above], lower[below]])
    norms = np.linalg.norm(sides, axis=1)
    norms[norms == 0.0] = 1.0
    return above, below, sides / norms[:, None], limits / norms, norms


def _dual_active_set(
    H: FloatArray, g: FloatArray, G: FloatArray, b: FloatArray
) -> tuple[FloatArray | None, FloatArray] | None:
    """Least x'H x / 2 + g'x with G x >= b, H positive definite, rows of norm one, and the multipliers.

    Where there is no such x, the second is a combination of rows that shows it; None where rounding stopped the search.
    """
    factor = cho_factor(H, lower=True)[0]
    root = np.tril(factor)
    across = solve_triangular(root, G.T, lower=True)
    # in z = root' x the objective is |z + root^-1 g|^2 / 2
    z = -solve_triangular(root, g, lower=True)
    active: list[int] = []
    push = np.zeros(0)
    for _ in range(20 * (b.size + g.size) + 50):
        x = solve_triangular(root.T, z, lower=False)
        slack = G @ x - b
        slack[active] = 0.0
        worst = int(np.argmin(slack)) if slack.size else 0
        if not slack.size or slack[worst] >= -1e-12 * max(_largest(x), abs(float(b[worst]))):
            multipliers = np.zeros(b.size)
            multipliers[active] = push
            return x, multipliers
        missing, normal, gained = float(-slack[worst]), across[:, worst], 0.0
        while True:
            held = across[:, active]
            along = lstsq(held, normal, cond=1e-13)[0] if active else np.zeros(0)
            free = normal - held @ along
            full = missing / float(free @ free) if free @ free > 1e-20 * (normal @ normal) else np.inf
            falling = np.flatnonzero(along > 1e-13)
            ratios = push[falling] / along[falling]
            first = float(np.min(ratios)) if falling.size else np.inf
            step = min(full, first)
            if not np.isfinite(step):
                excluding = np.zeros(b.size)
                excluding[active], excluding[worst] = np.where(along < -1e-11, -along, 0.0), 1.0
                return None, excluding
            push, gained = push - step * along, gained + step
            if np.isfinite(full):
                z, missing = z + step * free, missing - step * float(free @ free)
            if full <= first:
                active, push = [*active, worst], np.append(push, gained)
                break
            out = int(falling[int(np.argmin(ratios))])
            active, push = [*active[:out], *active[out + 1 :]], np.delete(push, out)
    return None


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
