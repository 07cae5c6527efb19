"""Exact propagators of piecewise-constant systems (square-wave modulation, switching)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy import linalg

from maglev_ctrl.arrays import FloatArray, read_only


def piecewise_propagators(matrices: ArrayLike, durations: ArrayLike) -> FloatArray:
    """Propagators exp(A_k t_k) of x' = A_k x, held for t_k; (..., S, n, n), in the order of time.

    Parameters
    ----------
    matrices : (..., S, n, n) 1/s
    durations : (..., S) s, positive

    Raises
    ------
    ValueError : shapes do not fit, there is no piece, an entry is not finite, or a duration is not positive

    Examples
    --------
    >>> piecewise_propagators([[[0.0, 1.0], [0.0, 0.0]]], [2.0])
    array([[[1., 2.],
            [0., 1.]]])
    """
    A = read_only(matrices, name="matrices", shape=(None, None, None))
    n = A.shape[-1]
    A = read_only(A, name="matrices", shape=(None, n, n))
    t = read_only(durations, name="durations", shape=(A.shape[-3],))
    if A.size == 0:
        raise ValueError(f"matrices: expected at least one piece with one state, got shape {A.shape}")
    if np.any(t <= 0.0):
        raise ValueError(f"durations: expected positive times in s, got {np.min(t):g}")
    return np.asarray(linalg.expm(A * t[..., None, None]))
