"""Engines for spectral radii by name: what is not installed is only missed when it is asked for."""

from __future__ import annotations

from typing import Literal

from maglev_ctrl.kernels.spectral_radius import NumpyRadius, RadiusEngine


def radius_engine(name: Literal["numpy", "fast", "gpu"]) -> RadiusEngine:
    """The engine of that name: `numpy` always, `fast` with numba, `gpu` with JAX and a device.

    Raises
    ------
    ModelError : what the engine needs is not installed, or there is no device
    ValueError : an unknown name

    Examples
    --------
    >>> radius_engine("numpy").name
    'numpy'
    """
    if name == "numpy":
        return NumpyRadius()
    if name == "fast":
        from maglev_ctrl.kernels.accelerated import fast_engine

        return fast_engine()
    if name == "gpu":
        from maglev_ctrl.kernels.device import device_engine

        return device_engine()
    raise ValueError(f"name: expected numpy, fast or gpu, got {name!r}")
