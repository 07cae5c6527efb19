"""Wavenumbers along the track: Gauss panels, and weights exact for a coil's own transform times anything smooth."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np

from maglev_ctrl.arrays import FloatArray

_DECAY = 7.0
"""The field at distance c from a coil side decays as e^{-k c}: forces, its square, are cut where e^{-14} is left."""


def panels(clearance: float, size: float) -> FloatArray:
    """Ends of panels from 0 to where a coil's field no longer reaches the conductor, doubling in length, 1/m.

    Parameters
    ----------
    clearance : least distance of a coil side from a conductor, m
    size : of the largest conductor or coil, m; features of the response in k are no narrower than about its inverse
    """
    last = _DECAY / clearance
    first = min(1.0 / size, 0.25 * last)
    count = max(3, round(np.log2(last / first)) + 1)
    return np.concatenate([[0.0], first * (last / first) ** (np.arange(count) / (count - 1))])


def gauss_points(ends: FloatArray, points: int) -> FloatArray:
    """Gauss points of every panel, in order, 1/m."""
    x, _ = np.polynomial.legendre.leggauss(points)
    return np.concatenate([a + 0.5 * (x + 1.0) * (b - a) for a, b in pairwise(ends)])


def product_weights(
    ends: FloatArray, points: int, factor: Callable[[FloatArray], FloatArray], *, extent: float
) -> FloatArray:
    """Weights w (n,) with sum w f(k_n) = Int factor(k) f(k) dk for f a polynomial on every panel.

    A long coil's transform oscillates much faster than the guideway's response varies.

    Parameters
    ----------
    points : Gauss points on each panel
    factor : function of k (array), the product of two coils' transforms
    extent : along the track, m: the factor oscillates no faster than cos(2 k extent)
    """
    x, _ = np.polynomial.legendre.leggauss(points)
    vandermonde = np.polynomial.legendre.legvander(x, points - 1)
    found = []
    for a, b in pairwise(ends):
        fine = points + 8 + int(np.ceil((b - a) * extent))
        t, w = np.polynomial.legendre.leggauss(fine)
        values = factor(a + 0.5 * (t + 1.0) * (b - a))
        moments = np.polynomial.legendre.legvander(t, points - 1).T @ (0.5 * (b - a) * w * values)
        found.append(np.linalg.solve(vandermonde.T, moments))
    return np.concatenate(found)
