"""Force models as plain functions of arrays: what an integration asks of them thousands of times.

`MagnetSet` has put every place inside the models' data already, so nothing is checked again here, and no records are
built for the models that have a form of their own below. Every other model answers by `forces` and `derivatives`.
"""

from __future__ import annotations

from collections.abc import Callable
from math import pi

import numpy as np

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.forces.base import AbstractForceModel
from maglev_ctrl.forces.image import MAGNETIC_CONSTANT, ImageForce

SLOWEST = 1e-140
"""Speed ratio below which the drag's ratio is left to the force model, which knows its limit at rest."""

Answer = tuple[FloatArray, FloatArray | None, FloatArray, FloatArray]
"""Lift, guidance (None: none), drag, and drag with the partials by velocity; N."""

Answering = Callable[[FloatArray, FloatArray | None, FloatArray, FloatArray, FloatArray], Answer]
"""Heights (...) m, gaps (...) m or None, speeds (...) m/s, rates (...) m/s at which heights and gaps widen."""


def answering(force: AbstractForceModel, *, kinetic: bool) -> Answering:
    """The function of a force model.

    Parameters
    ----------
    kinetic : whether the model has partials by vertical or lateral velocity

    Examples
    --------
    >>> magnet = ImageForce(1e5, 1.0, 2.5e7, 0.02, 1.0)
    >>> place = np.array([0.1]), None, np.array([100.0]), np.zeros(1), np.zeros(1)
    >>> lift, guidance, drag, _ = answering(magnet, kinetic=False)(*place)
    >>> bool(abs(lift - magnet.forces(0.1, None, 100.0).lift)[0] < 1e-12 * lift[0]), guidance
    (True, None)
    """
    if isinstance(force, ImageForce) and np.ndim(force.current) == 0:
        return _image(force, kinetic=kinetic)
    return _recorded(force, kinetic=kinetic)


def _recorded(force: AbstractForceModel, *, kinetic: bool) -> Answering:
    """By the records of the force model."""

    def answer(
        height: FloatArray, gap: FloatArray | None, speed: FloatArray, rise: FloatArray, widening: FloatArray
    ) -> Answer:
        one = force.forces(height, gap, speed)
        if not kinetic:
            return one.lift, one.guidance, one.drag, one.drag
        slopes = force.derivatives(height, gap, speed)
        by_rise, by_gap = slopes.by_vertical_velocity, slopes.by_lateral_velocity
        return (
            one.lift + by_rise.lift * rise + by_gap.lift * widening,
            one.guidance + by_rise.guidance * rise + by_gap.guidance * widening,
            one.drag,
            one.drag + by_rise.drag * rise + by_gap.drag * widening,
        )

    return answer


def _image(force: ImageForce, *, kinetic: bool) -> Answering:
    """Eq. 15 with x = v/w: lift = F eps_L and drag = F eps_L / x, F = mu0 I^2 l / (4 pi z)."""
    w, n = force.characteristic, force.exponent
    perfect = MAGNETIC_CONSTANT * float(force.current) ** 2 * force.length / (4.0 * pi)
    recorded = _recorded(force, kinetic=kinetic)

    def line(
        height: FloatArray, gap: FloatArray | None, speed: FloatArray, rise: FloatArray, widening: FloatArray
    ) -> Answer:
        x = speed / w
        square = x * x
        whole = 1.0 + square
        share = perfect / height / whole  # eps_L = x^2 / (1 + x^2) for n = 1
        lift, drag = share * square, share * x
        if not kinetic:
            return lift, None, drag, drag
        # Receding images: dr/du = (1/w) (x^2 - 1 - 2 i x) / (1 + x^2)^2, lift = F Re r, drag = -F Im r.
        by_rise = share / whole * (rise / w)
        return lift + by_rise * (square - 1.0), None, drag, drag + by_rise * (2.0 * x)

    def coil(
        height: FloatArray, gap: FloatArray | None, speed: FloatArray, rise: FloatArray, widening: FloatArray
    ) -> Answer:
        x = speed / w
        if np.abs(x).min(initial=np.inf) <= SLOWEST:
            return recorded(height, gap, speed, rise, widening)
        lift = perfect / height * -np.expm1(-n * np.log1p(x * x))
        drag = lift / x
        return lift, None, drag, drag

    return line if n == 1.0 else coil
