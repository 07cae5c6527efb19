"""Exact propagators of piecewise-constant systems (square-wave modulation, switching)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy import linalg

from maglev_ctrl.arrays import FloatArray, read_only

_FACTOR = 8.0
_SHARES = (0.125, 0.25, 0.5, 0.75, 0.875)


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


def piecewise_error(matrices: ArrayLike, durations: ArrayLike) -> FloatArray:
    """Bound on the error (spectral norm) of each propagator of `piecewise_propagators`: (..., S).

    Scaling and squaring gives the exponential of a matrix next to A t. What that does to exp(A t) is bounded by the
    largest |exp(A t s)| |exp(A t (1 - s))| over the piece; the factor holds the rounding of the squarings.

    Parameters
    ----------
    matrices, durations : see `piecewise_propagators`

    Raises
    ------
    ValueError : see `piecewise_propagators`

    Examples
    --------
    >>> bool(piecewise_error([[[0.0, 1.0], [-1.0, 0.0]]], [2.0])[0] < 1e-12)
    True
    """
    whole = piecewise_propagators(matrices, durations)
    times = np.asarray(durations, dtype=np.float64)
    share = np.array([piecewise_propagators(matrices, times * s) for s in _SHARES])
    sizes = np.linalg.norm(share, 2, axis=(-2, -1))
    size = np.linalg.norm(whole, 2, axis=(-2, -1))
    amplified = np.maximum(size, np.max(sizes * sizes[::-1], axis=0))
    reach = 1.0 + np.linalg.norm(np.asarray(matrices, dtype=np.float64), 2, axis=(-2, -1)) * times
    return np.asarray(_FACTOR * np.finfo(float).eps * whole.shape[-1] * reach * amplified)
