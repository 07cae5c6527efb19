"""Numba where it is installed: decorators of compiled loops, and one sentence where it is not.

Importing this module imports numba. Compiled functions run without the interpreter lock and are cached on disk. Only
contraction to fused multiply-add is allowed beyond IEEE arithmetic (in sums also their order), so NaN and infinity
behave.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from maglev_ctrl.errors import ModelError

try:
    from numba import njit
except ImportError:  # the extra is not installed: `require_numba` says so
    njit = None

_Function = TypeVar("_Function", bound=Callable[..., Any])


def compiled(function: _Function) -> _Function:
    """Compiled on first use; as it is where numba is missing."""
    return _with(function, {"contract"})


def compiled_sum(function: _Function) -> _Function:
    """Compiled on first use, sums in any order; as it is where numba is missing."""
    return _with(function, {"contract", "reassoc"})


def require_numba() -> None:
    """Say what is missing instead of running the Python source of compiled code for hours.

    Raises
    ------
    ModelError : numba is not installed
    """
    if njit is None:
        raise ModelError(
            'backend fast: numba is not installed; install the extra with pip install "maglev-ctrl[fast]", '
            "or use the backend numpy"
        )


def _with(function: _Function, freedom: set[str]) -> _Function:
    """`njit` with what every function here has in common."""
    if njit is None:
        return function
    decorated: _Function = njit(nogil=True, cache=True, fastmath=freedom, error_model="numpy")(function)
    return decorated
