"""Rectangular coil in the corner of a perfectly conducting L-shaped guideway: the limit of infinite speed.

Three image coils (below the floor, behind the wall, behind the corner) carry the same current, with the senses that
keep the field tangential to both plates. The force is the gradient of W = I^2/2 (-M_floor + M_wall - M_corner), M the
mutual inductance of two equal parallel rectangles in closed form (filaments; F. W. Grover, Inductance Calculations,
1946).
The field is conservative: dF_lift/dgap = dF_guidance/dheight, and there is no drag.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.forces.base import (
    AbstractForceModel,
    Domain,
    MagnetDerivatives,
    MagnetForces,
    checked_factor,
    no_forces,
)

MU_0 = 4e-7 * np.pi


class _Jet(NamedTuple):
    """A function of (Y, Z) with its first and second partials."""

    y: FloatArray
    z: FloatArray
    yy: FloatArray
    yz: FloatArray
    zz: FloatArray

    def plus(self, other: _Jet, factor: float) -> _Jet:
        return _Jet(*(np.asarray(a + factor * b) for a, b in zip(self, other, strict=True)))


@dataclass(frozen=True, eq=False, slots=True)
class CornerImageForce(AbstractForceModel):
    """Lift and guidance of one rectangular coil over the floor and beside the wall of a perfectly conducting corner.

    A magnet is given by its equivalent current sheet, as one turn at half its thickness.

    Parameters
    ----------
    current : ampere-turns
    length, width : along the track and across it, m
    thickness : of the magnet, m; the coil lies at height + thickness/2
    strength : common factor on the forces

    Raises
    ------
    ValueError : a size that is not positive

    Examples
    --------
    >>> magnet = CornerImageForce(6000.0, length=50.8e-3, width=25.4e-3, thickness=6.35e-3)
    >>> forces = magnet.forces(0.015, 0.0127, 36.0)
    >>> round(float(forces.lift), 3), round(float(forces.guidance), 3)
    (5.961, 3.628)
    """

    current: float
    length: float
    width: float
    thickness: float
    strength: float = 1.0

    def __post_init__(self) -> None:
        for name in ("length", "width"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0.0):
                raise ValueError(f"{name}: expected a positive length in m, got {value}")
        if not (np.isfinite(self.thickness) and self.thickness >= 0.0):
            raise ValueError(f"thickness: expected a length that is not negative, got {self.thickness}")

    @property
    def domain(self) -> Domain:
        """Any positive height and gap; any speed, because the limit does not depend on it."""
        return Domain(height=(0.0, np.inf), gap=(1e-9, np.inf), speed=(0.0, np.inf))

    def forces(self, height: ArrayLike, gap: ArrayLike | None, speed: ArrayLike) -> MagnetForces:
        """Lift, guidance and drag (zero) of one coil.

        Raises
        ------
        OutOfDomain : a height or gap that is not positive
        ValueError : no gap
        """
        jet = self._energy(height, gap, speed)
        return MagnetForces(lift=jet.z, guidance=jet.y, drag=np.zeros_like(jet.z))

    def derivatives(self, height: ArrayLike, gap: ArrayLike | None, speed: ArrayLike) -> MagnetDerivatives:
        """Exact partials; there is no dependence on any velocity."""
        jet = self._energy(height, gap, speed)
        nothing = no_forces(jet.z.shape)
        return MagnetDerivatives(
            by_height=MagnetForces(lift=jet.zz, guidance=jet.yz, drag=nothing.drag),
            by_gap=MagnetForces(lift=jet.yz, guidance=jet.yy, drag=nothing.drag),
            by_speed=nothing,
            by_vertical_velocity=nothing,
            by_lateral_velocity=nothing,
        )

    def scaled(self, factor: ArrayLike) -> CornerImageForce:
        """The same coil with its forces times a scalar factor.

        Raises
        ------
        ValueError : a factor that is negative, not finite, or not a scalar
        """
        share = checked_factor(factor)
        if share.ndim:
            raise ValueError(f"factor: expected a scalar, got shape {share.shape}")
        return replace(self, strength=self.strength * float(share))

    def _energy(self, height: ArrayLike, gap: ArrayLike | None, speed: ArrayLike) -> _Jet:
        """Partials of W by gap (y) and height (z)."""
        self.domain.require(height, gap, speed)
        h, g, _ = np.broadcast_arrays(
            np.asarray(height, dtype=np.float64), np.asarray(gap, dtype=np.float64), np.asarray(speed, dtype=np.float64)
        )
        Y, Z = 2.0 * g + self.width, 2.0 * h + self.thickness
        zero = np.zeros_like(Y)
        floor = self._mutual(zero, Z)
        corner = self._mutual(Y, Z)
        wall = self._mutual(Y, zero)
        floor = floor._replace(y=zero, yy=zero, yz=zero)  # the floor's image follows the coil sideways
        wall = wall._replace(z=zero, zz=zero, yz=zero)  # the wall's image follows it up and down
        total = wall.plus(floor, -1.0).plus(corner, -1.0)
        # Y and Z grow twice as fast as gap and height: factor 2 on slopes, 4 on curvatures.
        scale = 0.5 * self.current**2 * self.strength
        return _Jet(*(np.asarray(scale * factor * part) for factor, part in zip((2, 2, 4, 4, 4), total, strict=True)))

    def _mutual(self, Y: FloatArray, Z: FloatArray) -> _Jet:
        """Mutual inductance of the coil and an equal one displaced by Y across and Z up, same sense."""
        a, b = self.length, self.width
        along = _lengthwise(a, Y, Z)
        along = _Jet(*(2.0 * part for part in along))
        along = along.plus(_lengthwise(a, Y + b, Z), -1.0).plus(_lengthwise(a, Y - b, Z), -1.0)
        return along.plus(_crosswise(b, Y, 0.0, Z), 2.0).plus(_crosswise(b, Y, a, Z), -2.0)


def _lengthwise(length: float, p: FloatArray, Z: FloatArray) -> _Jet:
    """Two filaments along the track, at distance d = hypot(p, Z): 2 [g(l, d) - g(0, d)], p moving with Y."""
    d = np.hypot(p, Z)
    root = np.hypot(length, d)
    # d/dd of g(l, d) - g(0, d), with g = u asinh(u/d) - sqrt(u^2 + d^2)
    slope = 2.0 * (1.0 - root / d)
    bend = 2.0 * (root / d**2 - 1.0 / root)
    first_y, first_z = p / d, Z / d
    k = MU_0 / (4.0 * np.pi)
    return _Jet(
        y=k * slope * first_y,
        z=k * slope * first_z,
        yy=k * (bend * first_y**2 + slope * Z**2 / d**3),
        yz=k * (bend * first_y * first_z - slope * p * Z / d**3),
        zz=k * (bend * first_z**2 + slope * p**2 / d**3),
    )


def _crosswise(length: float, s: FloatArray, x: float, Z: FloatArray) -> _Jet:
    """Two filaments across the track, shifted lengthwise by s = Y, at distance d = hypot(x, Z)."""
    d = np.hypot(x, Z)
    collinear = d == 0.0
    d_safe = np.where(collinear, 1.0, d)
    k = MU_0 / (4.0 * np.pi)
    total = _Jet(*(np.zeros_like(s) for _ in range(5)))
    for u, weight in ((s + length, 1.0), (s, -2.0), (s - length, 1.0)):
        root = np.hypot(u, d_safe)
        # On one line the terms in ln d cancel in the sum over u, which leaves ln|u| for asinh(u/d).
        log = np.where(collinear, np.sign(u) * np.log(np.abs(np.where(collinear, u, 1.0))), np.arcsinh(u / d_safe))
        slope_d = np.where(collinear, 0.0, -root / d_safe)
        bend_d = np.where(collinear, 0.0, root / d_safe**2 - 1.0 / root)
        bend_ud = np.where(collinear, 0.0, -u / (d_safe * root))
        bend_u = np.where(collinear, 1.0 / np.abs(np.where(collinear, u, 1.0)), 1.0 / root)
        first_z = np.where(collinear, 0.0, Z / d_safe)
        second_z = np.where(collinear, 0.0, x**2 / d_safe**3)
        part = _Jet(
            y=log,
            z=slope_d * first_z,
            yy=bend_u,
            yz=bend_ud * first_z,
            zz=bend_d * first_z**2 + slope_d * second_z,
        )
        total = total.plus(part, k * weight)
    return total
