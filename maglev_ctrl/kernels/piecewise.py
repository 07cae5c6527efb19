"""Exact propagators of piecewise-constant systems (square-wave modulation, switching)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy import linalg

from maglev_ctrl.arrays import FloatArray, read_only

_FACTOR = 8.0
_LEVELS = 5  # squarings looked at one by one; what comes before them is one short exponential


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

    The exponential is squared up from a short time. The rounding of every squaring, eps |X|^2, reaches the end through
    all the ways in which the remaining time lies before and after it, sum |exp(A u)| |exp(A (t - u))|.

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
    A, times = np.asarray(matrices, dtype=np.float64), np.asarray(durations, dtype=np.float64)
    grid = 2**_LEVELS
    n = A.shape[-1]
    size = np.array([np.linalg.norm(piecewise_propagators(A, times * m / grid), 2, axis=(-2, -1))
                     for m in range(1, grid + 1)])  # fmt: skip
    size = np.concatenate([np.ones((1, *times.shape)), size])
    lost = np.zeros(times.shape)
    for level in range(1, _LEVELS + 2):
        step = grid >> (level - 1)  # what is squared up to at this level
        ways = sum(size[m] * size[grid - step - m] for m in range(0, grid, step))
        begun = 1.0 + np.linalg.norm(A, 2, axis=(-2, -1)) * times / grid
        own = size[step // 2] ** 2 if step > 1 else begun * np.maximum(size[1], 1.0)
        lost += ways * own
    return np.asarray(_FACTOR * np.finfo(float).eps * n * lost)
