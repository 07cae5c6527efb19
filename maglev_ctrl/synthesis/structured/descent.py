"""Descent for functions that are smooth almost everywhere: BFGS with a weak Wolfe line search, within bounds.

Lewis & Overton, "Nonsmooth optimization via quasi-Newton methods", Mathematical Programming 141 (2013) 135.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from maglev_ctrl.arrays import FloatArray

_ARMIJO = 1e-4
_WOLFE = 0.5
_TRIALS = 30


class Function(Protocol):
    """Value and gradient; infinite outside the domain."""

    def __call__(self, t: FloatArray, *, ceiling: float = np.inf) -> tuple[float, FloatArray]:
        """Value and gradient at t; above `ceiling` the value may be any lower bound above it."""
        ...


@dataclass(frozen=True, eq=False, slots=True)
class Descent:
    """Where a descent ended: point, value, gradient, inverse Hessian estimate, iterations, why it stopped."""

    t: FloatArray
    value: float
    gradient: FloatArray
    inverse: FloatArray
    iterations: int
    reason: str


def descend(
    function: Function,
    start: FloatArray,
    *,
    lower: FloatArray,
    upper: FloatArray,
    iterations: int,
    deadline: float = np.inf,
    inverse: FloatArray | None = None,
    until: Callable[[FloatArray, float], bool] | None = None,
    progress: float = 1e-5,
    window: int = 15,
) -> Descent:
    """Minimise from `start` (moved into the bounds first).

    Parameters
    ----------
    iterations : at most this many steps
    deadline : time.monotonic() value at which to stop
    until : stop as soon as it is true of point and value
    progress : stop when `window` steps together lower the value by less than this times max(1, |value|)

    Examples
    --------
    >>> def bowl(t, *, ceiling=np.inf):
    ...     return float(np.sum(np.abs(t - 1.0))), np.sign(t - 1.0)
    >>> far = np.full(2, np.inf)
    >>> end = descend(bowl, np.array([3.0, -2.0]), lower=-far, upper=far, iterations=60)
    >>> bool(np.allclose(end.t, 1.0, atol=1e-6))
    True
    """
    t = np.clip(start, lower, upper)
    value, gradient = function(t)
    n = t.size
    H = np.eye(n) if inverse is None else inverse
    fresh = inverse is None
    history = [value]
    reason = "iterations"
    if not np.isfinite(value) or n == 0:
        return Descent(t, value, gradient, H, 0, "start outside the domain" if n else "nothing to choose")
    done = 0
    for _ in range(iterations):
        if until is not None and until(t, value):
            reason = "goal"
            break
        if time.monotonic() > deadline:
            reason = "time"
            break
        free = ~(((t <= lower) & (gradient > 0.0)) | ((t >= upper) & (gradient < 0.0)))
        if not np.any(free) or float(np.linalg.norm(gradient[free])) <= 1e-10:
            reason = "stationary"
            break
        direction = np.zeros(n)
        direction[free] = -(H[np.ix_(free, free)] @ gradient[free])
        slope = float(direction @ gradient)
        if not slope < -1e-12 * float(np.linalg.norm(direction) * np.linalg.norm(gradient)):
            H, fresh = np.eye(n), True
            direction = np.where(free, -gradient, 0.0)
            slope = float(direction @ gradient)
        first = 1.0
        if fresh:
            first = 0.1 * max(float(np.linalg.norm(t)), 1.0) / float(np.linalg.norm(direction))
        step, value_new, gradient_new, found = _line(function, t, value, slope, direction, first, lower, upper)
        if not found:
            if fresh:
                reason = "no descent"
                break
            H, fresh = np.eye(n), True
            if reason == "restarted":
                break
            reason = "restarted"
            continue
        t_new = np.clip(t + step * direction, lower, upper)
        s, y = t_new - t, gradient_new - gradient
        product = float(s @ y)
        if product > 1e-14 * float(np.linalg.norm(s) * np.linalg.norm(y)):
            if fresh:
                H = np.eye(n) * (product / float(y @ y))
                fresh = False
            rho = 1.0 / product
            left = np.eye(n) - rho * np.outer(s, y)
            H = left @ H @ left.T + rho * np.outer(s, s)
        t, value, gradient = t_new, value_new, gradient_new
        done += 1
        if reason == "restarted":
            reason = "iterations"
        history.append(value)
        if len(history) > window and history[-1 - window] - value < progress * max(1.0, abs(value)):
            reason = "no progress"
            break
    return Descent(t, value, gradient, H, done, reason)


def _line(
    function: Function,
    t: FloatArray,
    value: float,
    slope: float,
    direction: FloatArray,
    first: float,
    lower: FloatArray,
    upper: FloatArray,
) -> tuple[float, float, FloatArray, bool]:
    """Step with enough descent and a gradient that has risen enough (weak Wolfe), by bisection and doubling.

    A step that a bound cuts short needs enough descent only.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        room = np.where(
            direction > 0.0, (upper - t) / direction, np.where(direction < 0.0, (lower - t) / direction, np.inf)
        )
    room[~np.isfinite(room)] = np.inf
    longest = float(np.min(room[room > 0.0], initial=np.inf))
    low, high = 0.0, np.inf
    step = min(first, longest)
    best: tuple[float, float, FloatArray] | None = None
    for _ in range(_TRIALS):
        wanted = value + _ARMIJO * step * slope
        point = np.clip(t + step * direction, lower, upper)
        reached, gradient = function(point, ceiling=wanted)
        if not reached < wanted or not np.all(np.isfinite(gradient)):
            high = step
        else:
            best = (step, reached, gradient)
            if step >= longest or float(gradient @ direction) >= _WOLFE * slope:
                return step, reached, gradient, True
            low = step
        step = 0.5 * (low + high) if np.isfinite(high) else min(2.0 * step, longest)
        if high - low <= 1e-13 * high or step <= 1e-18:
            break
    if best is not None:
        return (*best, True)
    return 0.0, value, np.zeros(t.size), False
