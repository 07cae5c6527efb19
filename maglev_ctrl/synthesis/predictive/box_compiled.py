"""The active-set sweeps of `condensed`, compiled: the same steps, without the cost of small NumPy calls.

Importing this module imports numba; without it the functions run as plain Python, slowly, so `require_numba` is asked
first.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.kernels.compiled import compiled_sum, require_numba

__all__ = ["newton_steps", "require_numba", "sweeps"]


@compiled_sum
def _solved(matrix: FloatArray, chosen: NDArray[np.int64], count: int, system: FloatArray, right: FloatArray) -> bool:
    """Solve the chosen rows and columns for `right`, in place, by Cholesky's factor; False where it does not exist."""
    for a in range(count):
        i = chosen[a]
        for b in range(a + 1):
            total = matrix[i, chosen[b]]
            for c in range(b):
                total -= system[a, c] * system[b, c]
            if a == b:
                if not total > 0.0:
                    return False
                system[a, a] = np.sqrt(total)
            else:
                system[a, b] = total / system[b, b]
        total = right[a]
        for c in range(a):
            total -= system[a, c] * right[c]
        right[a] = total / system[a, a]
    for a in range(count - 1, -1, -1):
        right[a] /= system[a, a]
        for c in range(a):
            right[c] -= system[a, c] * right[a]
    return True


@compiled_sum
def sweeps(
    matrices: tuple[FloatArray, FloatArray, FloatArray, FloatArray],
    x0: FloatArray,
    lower: FloatArray,
    upper: FloatArray,
    signs: NDArray[np.int8],
    most: int,
) -> tuple[FloatArray, NDArray[np.int8], int, bool]:
    """Plan, active limits, sweeps taken, and whether the active set settled.

    Parameters
    ----------
    matrices : H, its inverse, free, F of a condensed problem
    signs : guess of the active limits
    most : sweeps at most

    Examples
    --------
    >>> from maglev_ctrl.arrays import read_only
    >>> one = read_only(np.eye(1), name="one")
    >>> start = np.zeros(1, dtype=np.int8)
    >>> back = read_only(-one, name="back")
    >>> data, sides = (one, one, back, one), (-np.ones(1), np.ones(1))
    >>> plan, signs, taken, settled = sweeps(data, np.array([3.0]), *sides, start, 8)
    >>> plan.tolist(), signs.tolist(), taken, settled
    ([-1.0], [-1], 2, True)
    """
    H, inverse, free_map, F = matrices
    n, states = free_map.shape
    free, slope = np.zeros(n), np.zeros(n)
    for i in range(n):
        total = 0.0
        for j in range(states):
            total += free_map[i, j] * x0[j]
        free[i] = total
    sloped, fewest = False, n + 1
    now, plan, push = signs.copy(), free.copy(), np.zeros(n)
    chosen, right = np.empty(n, dtype=np.int64), np.empty(n)
    system = np.empty((n, n))
    for sweep in range(1, most + 1):
        held = 0
        for i in range(n):
            if now[i] != 0:
                held += 1
        dual = 2 * held <= n
        count = 0
        for i in range(n):
            if (now[i] != 0) == dual:
                chosen[count] = i
                count += 1
        matrix = inverse if dual else H
        if dual:
            for i in range(n):
                plan[i] = free[i]
            for k in range(count):
                i = chosen[k]
                right[k] = free[i] - (upper[i] if now[i] > 0 else lower[i])
        else:
            if not sloped:
                sloped = True
                for i in range(n):
                    total = 0.0
                    for j in range(states):
                        total += F[i, j] * x0[j]
                    slope[i] = total
            for i in range(n):  # the gradient at the plan, free entries at zero
                push[i], plan[i] = slope[i], 0.0
            for i in range(n):
                if now[i] != 0:
                    plan[i] = upper[i] if now[i] > 0 else lower[i]
                    for j in range(n):
                        push[j] += plan[i] * H[i, j]
            for k in range(count):
                right[k] = push[chosen[k]]
        if not _solved(matrix, chosen, count, system, right):
            return plan, now, sweep, False
        if dual:
            for k in range(count):
                i = chosen[k]
                step = right[k]
                for j in range(n):
                    plan[j] -= step * inverse[i, j]
            for k in range(count):
                i = chosen[k]
                plan[i] = upper[i] if now[i] > 0 else lower[i]
                push[i] = right[k]
        else:
            for k in range(count):
                i = chosen[k]
                step = right[k]
                plan[i] = -step
                for j in range(n):
                    push[j] -= step * H[i, j]
            for i in range(n):
                push[i] = -push[i]
        changes = 0
        for i in range(n):
            if now[i] != 0:
                after = now[i] if push[i] * now[i] >= 0.0 else 0
            elif plan[i] > upper[i]:
                after = 1
            elif plan[i] < lower[i]:
                after = -1
            else:
                after = 0
            if after != now[i]:
                changes += 1
            now[i] = after
        if changes == 0:
            return plan, now, sweep, True
        if changes >= fewest:
            return plan, now, sweep, False
        fewest = changes
    return plan, now, most, False


@compiled_sum
def newton_steps(
    H: FloatArray, slope: FloatArray, lower: FloatArray, upper: FloatArray, start: FloatArray, most: int
) -> tuple[FloatArray, int, bool]:
    """Projected Newton steps on x'H x / 2 + slope'x from `start`, downhill only; whether none is left to take.

    Parameters
    ----------
    most : steps at most

    Examples
    --------
    >>> from maglev_ctrl.arrays import read_only
    >>> one, H = np.ones(1), read_only(np.eye(1), name="H")
    >>> plan, taken, done = newton_steps(H, 3.0 * one, -one, one, 0.0 * one, 4)
    >>> plan.tolist(), taken, done
    ([-1.0], 2, True)
    """
    n = slope.size
    plan, trial, gradient = start.copy(), np.zeros(n), np.zeros(n)
    direction, right = np.zeros(n), np.zeros(n)
    held, chosen, system = np.zeros(n, dtype=np.bool_), np.empty(n, dtype=np.int64), np.empty((n, n))
    value = _gradient(H, slope, plan, gradient)
    for sweep in range(1, most + 1):
        size, square, largest = 1.0, 0.0, 0.0
        for i in range(n):
            rest = plan[i] - min(max(plan[i] - gradient[i] / H[i, i], lower[i]), upper[i])
            square += rest * rest
            largest = max(largest, abs(rest))
            size = max(size, abs(plan[i]))
        if largest <= 1e-13 * size:
            return plan, sweep, True
        near, count = min(np.sqrt(square), 1e-3), 0
        for i in range(n):
            low = plan[i] <= lower[i] + near and gradient[i] > 0.0
            held[i] = low or (plan[i] >= upper[i] - near and gradient[i] < 0.0)
            direction[i] = -gradient[i] / H[i, i]
            if not held[i]:
                chosen[count] = i
                right[count] = gradient[i]
                count += 1
        if not _solved(H, chosen, count, system, right):
            return plan, sweep, True
        fall = 0.0
        for k in range(count):
            direction[chosen[k]] = -right[k]
            fall += gradient[chosen[k]] * right[k]
        length, reached = 1.0, np.inf
        while length > 1e-12:
            expected = length * fall
            for i in range(n):
                trial[i] = min(max(plan[i] + length * direction[i], lower[i]), upper[i])
                if held[i]:
                    expected += gradient[i] * (plan[i] - trial[i])
            reached = _gradient(H, slope, trial, right)
            if reached <= value - 1e-4 * expected + 1e-14 * abs(value):
                break
            length *= 0.5
        if length <= 1e-12:
            return plan, sweep, True
        value = reached
        for i in range(n):
            plan[i], gradient[i] = trial[i], right[i]
    return plan, most, False


@compiled_sum
def _gradient(H: FloatArray, slope: FloatArray, x: FloatArray, gradient: FloatArray) -> float:
    """Gradient of x'H x / 2 + slope'x, in place, and the value."""
    value = 0.0
    for i in range(x.size):
        total = 0.0
        for j in range(x.size):
            total += H[i, j] * x[j]
        value += x[i] * (0.5 * total + slope[i])
        gradient[i] = total + slope[i]
    return value
