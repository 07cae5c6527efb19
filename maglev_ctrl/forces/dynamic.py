"""Dynamic stiffness of a magnet: what a force model offers beyond its quasi-static partials.

Force on the magnet = Q(w) u for a small motion u e^{iwt} about a steady passage. Coordinates of u and of the force:
surge forward, sway away from the guidance wall (the gap widens), heave up, roll about +x of a right-handed frame
whose y points away from the wall. Q(-w) is the conjugate of Q(w); Im Q > 0 on the diagonal feeds energy in.
"""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from maglev_ctrl.arrays import ComplexArray, FloatArray, read_only_any

MOTIONS = ("surge", "sway", "heave", "roll")
"""Coordinates of a dynamic stiffness, in order."""

UNIFORM = 1e-6
"""Static force per surge, relative to the largest stiffness, that still counts as none: rounding and mesh."""


@runtime_checkable
class DynamicForceModel(Protocol):
    """A magnet whose force on a small oscillation is known."""

    def motion_stiffness(self, height: float, gap: float | None, speed: float, frequency: ArrayLike) -> ComplexArray:
        """Q of force = Q u; (F, 4, 4) in N/m, N, N m.

        Parameters
        ----------
        height, gap, speed : of the steady passage, m, m (None without a wall), m/s
        frequency : (F,) rad/s; a model may also take complex ones, w = -i s
        """
        ...


def static_stiffness(model: DynamicForceModel, *, height: float, gap: float | None, speed: float) -> FloatArray:
    """Q(0), real, with the column of surge exactly zero; (4, 4).

    Raises
    ------
    ValueError : Q(0) is not real, or depends on surge: the guideway would not be uniform

    Examples
    --------
    >>> class Spring:
    ...     def motion_stiffness(self, height, gap, speed, frequency):
    ...         return np.zeros((len(np.atleast_1d(frequency)), 4, 4)) + np.diag([0.0, 0.0, -40.0, 0.0]) + 0j
    >>> float(static_stiffness(Spring(), height=0.1, gap=None, speed=30.0)[2, 2])
    -40.0
    """
    found = stiffness_at(model, np.zeros(1), height=height, gap=gap, speed=speed)[0]
    largest = float(np.max(np.abs(found[:3, :3])))
    if float(np.max(np.abs(found[:3, :3].imag))) > UNIFORM * largest:
        raise ValueError("motion_stiffness: expected a real matrix at frequency zero")
    if float(np.max(np.abs(found[:3, 0]))) > UNIFORM * largest:
        raise ValueError(
            "motion_stiffness: a surge at frequency zero changes the force, so the guideway is not uniform"
        )
    still = found.real.copy()
    still[:, 0] = 0.0
    return np.asarray(read_only_any(still), dtype=np.float64)


def stiffness_at(
    model: DynamicForceModel, frequency: FloatArray | ComplexArray, *, height: float, gap: float | None, speed: float
) -> ComplexArray:
    """Q at frequencies (F,) in rad/s with its shape checked; (F, 4, 4).

    Raises
    ------
    ValueError : the model answers with another shape or with an entry that is not finite
    """
    found = np.asarray(model.motion_stiffness(height, gap, speed, frequency), dtype=np.complex128)
    if found.shape != (len(frequency), 4, 4):
        raise ValueError(f"motion_stiffness: expected shape {(len(frequency), 4, 4)}, got {found.shape}")
    if not np.all(np.isfinite(found)):
        raise ValueError("motion_stiffness: every entry must be finite")
    return found
