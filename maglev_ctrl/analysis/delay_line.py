"""Rational stand-in of a pure delay: [p-1/p] Pade in Legendre coordinates, well conditioned at any order.

The state holds the shifted-Legendre moments of the input over the last tau seconds; the output is the value at the
old end. |value| <= 1 on the axis and in the right half plane (the approximant is A-acceptable), which the stability
gate relies on.
"""

from __future__ import annotations

import numpy as np

from maglev_ctrl.arrays import FloatArray

ORDERS = (3, 4, 5, 6, 8, 10, 12, 16, 20, 26, 32, 40, 52, 64, 80)


def delay_line(delay: float, order: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """State space (A, B, C) of the [order-1/order] Pade approximant of exp(-s delay), delay > 0 in s.

    Examples
    --------
    >>> A, B, C = delay_line(0.5, 6)
    >>> value = C @ np.linalg.solve(2j * np.eye(6) - A, B)
    >>> bool(abs(value[0, 0] - np.exp(-1j)) < 1e-9)
    True
    """
    i = np.arange(order)
    root = np.sqrt(2.0 * i + 1.0)
    upper = i[:, None] < i[None, :]
    sign = np.where(upper, -1.0, (-1.0) ** (i[:, None] - i[None, :] + 1))
    A = sign * root[:, None] * root[None, :] / delay
    return A, (root * (-1.0) ** i / delay)[:, None], root[None, :].copy()


def line_error(order: int, angle: float) -> float:
    """Largest error of the approximant on the axis up to the angle omega tau (rad); 2 where it says nothing.

    The error grows steadily with the angle until the approximant gives up, so its value at the end bounds it.

    Examples
    --------
    >>> line_error(8, 2.0) < 1e-9
    True
    """
    A, B, C = delay_line(1.0, order)
    angles = np.linspace(0.0, angle, 9)[1:]
    values = (C @ np.linalg.solve(1j * angles[:, None, None] * np.eye(order) - A, B + 0j))[:, 0, 0]
    return float(np.max(np.abs(values - np.exp(-1j * angles)))) + 1e-14


def sufficient_order(angle: float, error: float) -> tuple[int, float]:
    """Smallest order whose error up to the angle omega tau is at most `error`, and that error; else the largest.

    Examples
    --------
    >>> sufficient_order(1.0, 1e-9)[0] <= 8
    True
    """
    reached = 2.0
    for order in ORDERS:
        reached = line_error(order, angle)
        if reached <= error:
            return order, reached
    return ORDERS[-1], reached
