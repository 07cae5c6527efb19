"""Diagonal scaling of state matrices whose entries mix kilograms, newtons and metres, and their eigenvectors."""

from __future__ import annotations

import numpy as np
from scipy import linalg

from maglev_ctrl.arrays import ComplexArray, FloatArray

LARGEST_SCALE = 2.0**300  # of a triangular matrix LAPACK's scales run away until they overflow; this far is enough


def balance(magnitude: FloatArray) -> FloatArray:
    """Scales d (powers of two) such that diag(1/d) A diag(d) has rows and columns of like size.

    Parameters
    ----------
    magnitude : (n, n) non-negative entries: |A_0| plus the amplitudes of the modulation

    Examples
    --------
    >>> d = balance(np.array([[0.0, 1.0], [2.0**20, 0.0]]))
    >>> float(d[1] / d[0])
    1024.0
    """
    # SciPy casts the scales to whole numbers on its way, though nobody asked for the permutation they might hold.
    with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
        _, (scale, _) = linalg.matrix_balance(np.asarray(magnitude, dtype=np.float64), permute=False, separate=True)
    return np.asarray(np.clip(scale, 1.0 / LARGEST_SCALE, LARGEST_SCALE), dtype=np.float64)


def rescale(matrix: FloatArray, scale: FloatArray) -> FloatArray:
    """diag(1/d) A diag(d), exact because the scales are powers of two; (..., n, n).

    Examples
    --------
    >>> rescale(np.array([[0.0, 1.0], [4.0, 0.0]]), np.array([1.0, 2.0]))
    array([[0., 2.],
           [2., 0.]])
    """
    return np.asarray(matrix * scale / scale[:, None])


def eigen_triplets(A: FloatArray) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
    """Eigenvalues (n,), left and right eigenvectors (n, n) of unit length: left^H A = s left^H, A right = right s.

    Examples
    --------
    >>> s, left, right = eigen_triplets(np.array([[1.0, 5.0], [0.0, 2.0]]))
    >>> np.round(s.real, 12).tolist()
    [1.0, 2.0]
    """
    s, left, right = linalg.eig(A, left=True, right=True)[:3]  # type: ignore[misc]  # the stubs know two results only
    return np.asarray(s), np.asarray(left), np.asarray(right)
