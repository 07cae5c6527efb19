"""The Pade form of a delay: an all-pass system with the delay's Taylor coefficients."""

from __future__ import annotations

from math import comb, factorial

import numpy as np
from scipy.linalg import matrix_balance

from maglev_ctrl.arrays import FloatArray


def pade_delay(delay: float, order: int) -> tuple[FloatArray, FloatArray, FloatArray, float]:
    """State space x' = A x + b u, y = c x + d u of exp(-s delay), numerator and denominator of one order.

    Parameters
    ----------
    delay : s
    order : of numerator and denominator; 0 leaves the delay out (y = u)

    Returns
    -------
    A (order, order), b (order,), c (order,), d : balanced

    Raises
    ------
    ValueError : a negative order

    Examples
    --------
    >>> A, b, c, d = pade_delay(0.1, 1)
    >>> float(A[0, 0]), float(c[0] * b[0]), d
    (-20.0, 40.0, -1.0)
    """
    if order < 0:
        raise ValueError(f"order: expected a number that is not negative, got {order}")
    if order == 0:
        return np.zeros((0, 0)), np.zeros(0), np.zeros(0), 1.0
    # p(s) = sum of weights[k] s^k with the delay as unit of time; the numerator is p(-s).
    weights = np.array([comb(order, k) * factorial(2 * order - k) // factorial(order) for k in range(order + 1)], float)
    signs = (-1.0) ** np.arange(order + 1)
    feedthrough = float(signs[-1])
    A = np.zeros((order, order))
    A[:-1, 1:] = np.eye(order - 1)
    A[-1] = -weights[:-1]
    c = (signs - feedthrough)[:-1] * weights[:-1]
    balanced, scale = matrix_balance(A, permute=False)
    T = scale if scale.ndim == 2 else np.diag(scale)
    b = np.linalg.solve(T, np.eye(order)[-1])
    return np.asarray(balanced / delay), b / delay, np.asarray(c @ T), feedthrough
