"""Measured or computed magnetic matrices of one body: M_m, C_m, K_m over speed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import PchipInterpolator

from maglev_ctrl.arrays import FloatArray, read_only
from maglev_ctrl.errors import OutOfDomain
from maglev_ctrl.forces.base import EDGE_TOLERANCE

FREEDOMS = ("surge", "sway", "heave", "roll", "pitch", "yaw")
"""Row and column order of a coefficient matrix."""


@dataclass(frozen=True, eq=False, slots=True)
class Coefficients:
    """Magnetic matrices at one operating point (or a batch), (..., 6, 6), left-hand-side sign, about the body's CM."""

    mass: FloatArray
    damping: FloatArray
    stiffness: FloatArray


@dataclass(frozen=True, eq=False, slots=True)
class CoefficientTable:
    """Magnetic matrices of a body's six freedoms at one or more speeds, on the LEFT-hand side of the equations.

    Positive stiffness restores and positive damping dissipates. Order: surge, sway, heave, roll, pitch, yaw.
    Between speeds the entries follow a shape-preserving cubic (no overshoot); outside them nothing is extrapolated.

    Parameters
    ----------
    speeds : (S,) strictly increasing, m/s
    mass, damping, stiffness : (S, 6, 6); kg, N s/m, N/m and their rotational kin. (6, 6) is accepted for one speed
    constant : a table of one speed that holds at every speed

    Raises
    ------
    ValueError : wrong shapes, entries that are not finite, speeds that do not increase, `constant` with many speeds

    Examples
    --------
    >>> table = CoefficientTable([10.0, 20.0], np.zeros((2, 6, 6)), np.zeros((2, 6, 6)), np.stack([np.eye(6)] * 2))
    >>> float(table.at(15.0).stiffness[2, 2])
    1.0
    """

    speeds: FloatArray
    mass: FloatArray
    damping: FloatArray
    stiffness: FloatArray
    constant: bool = False

    def __post_init__(self) -> None:
        speeds = np.atleast_1d(read_only(self.speeds, name="speeds"))
        object.__setattr__(self, "speeds", read_only(speeds, name="speeds"))
        if speeds.ndim != 1 or speeds.size == 0 or np.any(np.diff(speeds) <= 0.0):
            raise ValueError(f"speeds: expected a strictly increasing list of speeds in m/s, got {speeds.tolist()}")
        if self.constant and speeds.size > 1:
            raise ValueError(f"constant: expected a table of one speed, got {speeds.size} speeds")
        for name in ("mass", "damping", "stiffness"):
            matrices = np.asarray(getattr(self, name), dtype=np.float64)
            if matrices.shape == (6, 6) and speeds.size == 1:
                matrices = matrices[None]
            if matrices.shape != (speeds.size, 6, 6):
                raise ValueError(f"{name}: expected shape ({speeds.size}, 6, 6), got {matrices.shape}")
            object.__setattr__(self, name, read_only(matrices, name=name))

    @classmethod
    def from_force_derivatives(
        cls, speeds: ArrayLike, *, m: ArrayLike, c: ArrayLike, k: ArrayLike, constant: bool = False
    ) -> CoefficientTable:
        """The table of force derivatives m_ij, c_ij, k_ij, force ON the vehicle per unit motion (Eqs. 3-5, 9).

        The force stands on the right-hand side, so the left-hand-side matrices are M_m = -m, C_m = -c, K_m = -k; the
        plus signs of Eq. 11 hold only for the reaction on the guideway.

        Parameters
        ----------
        speeds : (S,) m/s
        m, c, k : (S, 6, 6), or (6, 6) for one speed

        Examples
        --------
        >>> k = np.zeros((6, 6)); k[2, 2] = -1e5        # lift falls with height
        >>> zero = np.zeros((6, 6))
        >>> float(CoefficientTable.from_force_derivatives(50.0, m=zero, c=zero, k=k).stiffness[0, 2, 2])
        100000.0
        """
        sign = -1.0
        return cls(
            speeds=np.asarray(speeds, dtype=np.float64),
            mass=sign * np.asarray(m, dtype=np.float64),
            damping=sign * np.asarray(c, dtype=np.float64),
            stiffness=sign * np.asarray(k, dtype=np.float64),
            constant=constant,
        )

    @property
    def speed_range(self) -> tuple[float, float]:
        """Lowest and highest speed at which `at` answers, m/s."""
        if self.constant:
            return (-np.inf, np.inf)
        return (float(self.speeds[0]), float(self.speeds[-1]))

    def at(self, speed: ArrayLike) -> Coefficients:
        """The matrices at a speed.

        Parameters
        ----------
        speed : (...) m/s

        Raises
        ------
        OutOfDomain : a speed outside the table
        """
        speeds = np.asarray(speed, dtype=np.float64)
        lower, upper = self.speed_range
        slack = 0.0 if self.constant else EDGE_TOLERANCE * max(abs(lower), abs(upper))
        outside = ~((speeds >= lower - slack) & (speeds <= upper + slack))
        if np.any(outside):
            worst = speeds[outside].flat[0]
            raise OutOfDomain(f"speed {worst:.10g} m/s is outside the table's range {lower:.10g} to {upper:.10g} m/s")
        inside = np.clip(speeds, lower, upper)
        return Coefficients(
            mass=self._interpolate(self.mass, inside),
            damping=self._interpolate(self.damping, inside),
            stiffness=self._interpolate(self.stiffness, inside),
        )

    def _interpolate(self, matrices: FloatArray, speed: FloatArray) -> FloatArray:
        if self.speeds.size == 1:
            return read_only(np.broadcast_to(matrices[0], (*speed.shape, 6, 6)), name="coefficients")
        return read_only(PchipInterpolator(self.speeds, matrices, axis=0)(speed), name="coefficients")
