"""The `fast` extra: spectral radii and Taylor propagation compiled by numba, behind the interface of the rest.

Importing this module imports numba where it is installed; nothing else in the package does.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.kernels.compiled import require_numba
from maglev_ctrl.kernels.radius_lanes import block_size, decide_lanes, moduli_lanes
from maglev_ctrl.kernels.spectral_radius import (
    NumpyRadius,
    chunks,
    evaluated,
    series_rounding,
)
from maglev_ctrl.kernels.taylor_lanes import monodromy_many

__all__ = ["FastRadius", "fast_engine", "monodromy_many"]


class FastRadius(NumpyRadius):
    """The engine compiled by numba; leading multipliers themselves stay with LAPACK, which is faster at them."""

    name = "fast"

    def _moduli(self, coefficients: FloatArray, basis: FloatArray) -> tuple[FloatArray, NDArray[np.bool_]]:
        n = coefficients.shape[-1]
        modulus = np.full(len(basis), np.nan)
        for part in chunks(len(basis), n):
            values = evaluated(coefficients, basis[part]).reshape(-1, n * n)
            moduli_lanes(values, n, block_size(n), modulus[part])
            modulus[part][~np.any(values, axis=1)] = 0.0
        return modulus, ~np.isnan(modulus)

    def _decide(
        self, coefficients: FloatArray, basis: FloatArray, stable_below: float, unstable_above: float
    ) -> NDArray[np.int8]:
        n, result = coefficients.shape[-1], np.zeros(len(basis), dtype=np.int8)
        stable, unstable = (math.log2(r) if r > 0.0 else -math.inf for r in (stable_below, unstable_above))
        with np.errstate(all="ignore"):
            rounding = series_rounding(coefficients, basis)
        for part in chunks(len(basis), n):
            values = evaluated(coefficients, basis[part]).reshape(-1, n * n)
            decide_lanes(values, rounding[part], n, block_size(n), stable, unstable, result[part])
        return result


def fast_engine() -> FastRadius:
    """The compiled engine.

    Raises
    ------
    ModelError : numba is not installed
    """
    require_numba()
    return FastRadius()
