"""The `gpu` extra: spectral radii on a graphics processor through JAX, with the array functions of `spectral_radius`.

Every matrix of a chunk takes part in every squaring until the whole chunk is done (compressing would change shapes,
and each new shape costs a compilation); chunks are padded to one shape for the same reason. Double precision is
switched on for the whole process, because single precision would void every bound.
"""

from __future__ import annotations

import importlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.errors import ModelError
from maglev_ctrl.kernels.spectral_radius import (
    ACCURACY,
    CHECKS,
    LAST_SQUARING,
    NumpyRadius,
    first_power,
    judged,
    leading_pair,
    next_power,
    series_rounding,
    verified_modulus,
)

_CHUNK_ENTRIES = 1 << 25  # matrix entries on the device at once: a quarter of a gibibyte per array, some ten arrays
_SMALLEST_CHUNK = 64
_LOOK = 3  # squarings between two questions to the device whether the chunk is done


class DeviceRadius(NumpyRadius):
    """The engine on a JAX device; leading multipliers themselves stay with LAPACK on the processor.

    `xp` is the array namespace, `device` where its arrays live.
    """

    name = "gpu"

    def __init__(self, xp: Any, put: Any) -> None:
        self._xp = xp
        self._put = put

    def _moduli(self, coefficients: FloatArray, basis: FloatArray) -> tuple[FloatArray, NDArray[np.bool_]]:
        modulus, sure = np.empty(len(basis)), np.zeros(len(basis), dtype=np.bool_)
        flat = self._put(coefficients.reshape(len(coefficients), -1))
        for part, padded in _padded(basis, coefficients.shape[-1]):
            count = part.stop - part.start
            matrices = (self._put(padded) @ flat).reshape(-1, *coefficients.shape[1:])
            value, good = self._moduli_of(matrices)
            modulus[part], sure[part] = np.asarray(value)[:count], np.asarray(good)[:count]
        return modulus, sure

    def _decide(
        self, coefficients: FloatArray, basis: FloatArray, stable_below: float, unstable_above: float
    ) -> NDArray[np.int8]:
        result = np.zeros(len(basis), dtype=np.int8)
        flat = self._put(coefficients.reshape(len(coefficients), -1))
        for part, padded in _padded(basis, coefficients.shape[-1]):
            with np.errstate(all="ignore"):
                rounding = series_rounding(coefficients, padded)
            matrices = (self._put(padded) @ flat).reshape(-1, *coefficients.shape[1:])
            found = self._decided(matrices, self._put(rounding), stable_below, unstable_above)
            result[part] = np.asarray(found)[: part.stop - part.start]
        return result

    def _moduli_of(self, matrices: Any) -> tuple[Any, Any]:
        """Spectral radii of one chunk on the device and which are sure."""
        xp = self._xp
        zero = xp.all(matrices == 0.0, axis=(1, 2))
        modulus, sure = xp.zeros(len(matrices)), zero
        powers = first_power(xp, matrices, xp.zeros(len(matrices)))
        hopeless = ~xp.isfinite(powers.norm)
        row = xp.arange(CHECKS[-1] + 1)[:, None]
        history = xp.where(row == 0, powers.exponent, -np.inf)  # of one shape throughout
        while powers.squarings <= CHECKS[-1]:
            square = powers.matrix @ powers.matrix
            if powers.squarings in CHECKS:
                pair = leading_pair(xp, powers, square)
                value, error = verified_modulus(xp, powers, square, history, pair)
                good = pair[-1] & (error <= ACCURACY) & ~sure
                modulus, sure = xp.where(good, value, modulus), sure | good
                if bool(xp.all(sure | hopeless)):
                    break
            powers = next_power(xp, powers, square)
            history = xp.where(row == powers.squarings, powers.exponent, history)
        return modulus, sure

    def _decided(self, matrices: Any, rounding: Any, stable_below: float, unstable_above: float) -> Any:
        """Decisions for one chunk on the device."""
        xp = self._xp
        powers = first_power(xp, matrices, rounding)
        result = judged(xp, powers, stable_below, unstable_above)
        while powers.squarings < LAST_SQUARING:
            powers = next_power(xp, powers)
            found = judged(xp, powers, stable_below, unstable_above)
            result = xp.where(result == 0, found, result)
            if powers.squarings % _LOOK == 0 and bool(xp.all((result != 0) | ~(powers.error < 1.0))):
                break
        return result


def device_engine(platform: str = "gpu") -> DeviceRadius:
    """The engine on the first JAX device of a platform ("cpu" serves to check the code where there is no other).

    Raises
    ------
    ModelError : JAX is not installed, or it finds no such device
    """
    try:
        jax = importlib.import_module("jax")
    except ImportError as fault:
        raise ModelError(
            'backend gpu: JAX is not installed; install the extra with pip install "maglev-ctrl[gpu]", '
            "or use the backend numpy or fast"
        ) from fault
    try:
        device = jax.devices(platform)[0]
    except RuntimeError as fault:
        raise ModelError(
            f"backend gpu: JAX finds no {platform} device on this machine; use the backend numpy or fast"
        ) from fault
    jax.config.update("jax_enable_x64", True)
    return DeviceRadius(jax.numpy, lambda array: jax.device_put(array, device))


def _padded(basis: FloatArray, n: int) -> list[tuple[slice, FloatArray]]:
    """Slices of the rows of `basis` and those rows, the last one repeated until all chunks are alike."""
    if not len(basis):
        return []
    step = min(max(_SMALLEST_CHUNK, _CHUNK_ENTRIES // (n * n)), len(basis))
    parts = [slice(first, min(first + step, len(basis))) for first in range(0, len(basis), step)]
    return [(part, basis[np.minimum(np.arange(part.start, part.start + step), len(basis) - 1)]) for part in parts]
