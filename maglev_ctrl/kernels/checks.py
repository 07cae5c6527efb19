"""What every engine asks of its input before it starts: finite numbers, something to work on, a frequency."""

from __future__ import annotations

import numpy as np

from maglev_ctrl.arrays import FloatArray


def check_periodic(A_0: FloatArray, A_cos: FloatArray, A_sin: FloatArray, frequency: float) -> None:
    """Refuses Fourier coefficients that no engine can work with.

    Parameters
    ----------
    A_0 : (n, n); A_cos, A_sin : (H, n, n), 1/s
    frequency : W, rad/s

    Raises
    ------
    ValueError : no states, shapes that do not fit, entries that are not finite, or a frequency that is not positive

    Examples
    --------
    >>> check_periodic(np.eye(2), np.zeros((1, 2, 2)), np.zeros((1, 2, 2)), 0.0)
    Traceback (most recent call last):
    ...
    ValueError: frequency: expected a positive finite angular frequency in rad/s, got 0.0
    """
    if A_0.ndim != 2 or A_0.shape[0] != A_0.shape[1] or A_0.shape[0] == 0:
        raise ValueError(f"A_0: expected a square matrix with at least one state, got shape {A_0.shape}")
    if len(A_cos) == 0:
        raise ValueError(f"A_cos: expected at least one harmonic (zero where there is none), got shape {A_cos.shape}")
    for name, value in (("A_cos", A_cos), ("A_sin", A_sin)):
        if value.ndim != 3 or value.shape[1:] != A_0.shape or len(value) != len(A_cos):
            raise ValueError(f"{name}: expected shape {(len(A_cos), *A_0.shape)}, got {value.shape}")
    for name, value in (("A_0", A_0), ("A_cos", A_cos), ("A_sin", A_sin)):
        if not np.isfinite(value).all():
            where = tuple(int(i) for i in np.argwhere(~np.isfinite(value))[0])
            raise ValueError(f"{name}: every entry must be finite, got {value[where]} at {list(where)}")
    if not 0.0 < frequency < np.inf:
        raise ValueError(f"frequency: expected a positive finite angular frequency in rad/s, got {frequency}")
