"""Read-only float arrays with checked shapes: what every record of this package stores."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]


def read_only(value: ArrayLike, *, name: str, shape: tuple[int | None, ...] | None = None) -> FloatArray:
    """A read-only float64 copy of `value` whose trailing axes match `shape` (None = any length).

    Parameters
    ----------
    value : array-like of finite numbers
    name : what to call it in the error
    shape : trailing shape expected; leading batch axes are always allowed

    Raises
    ------
    ValueError : wrong shape, or an entry that is not finite

    Examples
    --------
    >>> read_only([[1, 2]], name="K", shape=(1, 2)).flags.writeable
    False
    """
    array = np.array(value, dtype=np.float64)
    if shape is not None and array.shape != shape:
        tail = array.shape[-len(shape) :] if shape else ()
        fits = array.ndim >= len(shape) and all(
            want is None or want == got for want, got in zip(shape, tail, strict=True)
        )
        if not fits:
            expected = "(..., " + ", ".join("any" if s is None else str(s) for s in shape) + ")"
            raise ValueError(f"{name}: expected shape {expected}, got {array.shape}")
    if not np.isfinite(array).all():
        raise ValueError(f"{name}: every entry must be finite")
    array.flags.writeable = False
    return array


def read_only_any(value: Any) -> NDArray[Any]:
    """A read-only copy of any array (complex, integer, boolean, with NaN), dtype kept.

    Examples
    --------
    >>> bool(read_only_any([1j]).flags.writeable)
    False
    """
    array = np.array(value)
    array.flags.writeable = False
    return array


def transpose(matrix: NDArray[Any]) -> NDArray[Any]:
    """Matrix transpose over the last two axes.

    Examples
    --------
    >>> transpose(np.zeros((4, 2, 3))).shape
    (4, 3, 2)
    """
    return np.swapaxes(matrix, -1, -2)


def join_columns(blocks: list[FloatArray]) -> FloatArray:
    """Blocks side by side; leading batch axes broadcast."""
    return _join(blocks, axis=-1)


def join_rows(blocks: list[FloatArray]) -> FloatArray:
    """Blocks on top of one another; leading batch axes broadcast."""
    return _join(blocks, axis=-2)


def _join(blocks: list[FloatArray], *, axis: int) -> FloatArray:
    if all(block.ndim == 2 for block in blocks):
        return np.concatenate(blocks, axis=axis)
    batch = np.broadcast_shapes(*(block.shape[:-2] for block in blocks))
    return np.concatenate([np.broadcast_to(block, batch + block.shape[-2:]) for block in blocks], axis=axis)
