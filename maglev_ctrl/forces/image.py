"""Image-force model of a coil over a conducting sheet (Eq. 15), with exact partial derivatives.

With x = v/w, w the characteristic speed of the sheet and F(z) = mu0 I^2 l / (4 pi z) the force of the perfect image:

    lift = F(z) eps_L,   eps_L = 1 - (1 + x^2)^-n        even in v
    drag = F(z) eps_D,   eps_D = eps_L / x               odd in v

n = 1 is a line current over a thin sheet (exact); coils have n between about 1/5 and 1/3.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from maglev_ctrl.arrays import ComplexArray, FloatArray
from maglev_ctrl.errors import ModelError
from maglev_ctrl.forces.base import (
    AbstractForceModel,
    Domain,
    MagnetDerivatives,
    MagnetForces,
    checked_factor,
    no_forces,
)

MAGNETIC_CONSTANT = 4e-7 * pi
"""mu0, H/m."""

VerticalVelocity = Literal["none", "receding_image"]

_EVERYWHERE = Domain(height=(0.0, np.inf), gap=None, speed=(-np.inf, np.inf))
_NO_SQUARE = 1e-290  # below it x^2 loses digits to underflow and every ratio equals its limit at rest


def characteristic_speed(conductivity: float, thickness: float) -> float:
    """w = 2 / (mu0 sigma d) of a sheet: the speed at which its images recede, and of the drag peak for n = 1.

    Parameters
    ----------
    conductivity : sigma, S/m
    thickness : d, m

    Examples
    --------
    >>> round(characteristic_speed(2.5e7, 0.02), 6)
    3.183099
    """
    _require_positive(conductivity=conductivity, thickness=thickness)
    return 2.0 / (MAGNETIC_CONSTANT * conductivity * thickness)


def lift_ratio(speed_ratio: ArrayLike, exponent: float) -> FloatArray:
    """eps_L = 1 - (1 + x^2)^-n of Eq. 15, x = v/w; accurate to rounding also for small x.

    Examples
    --------
    >>> float(lift_ratio(1.0, 1.0))
    0.5
    """
    x = np.asarray(speed_ratio, dtype=np.float64)
    return np.asarray(-np.expm1(-exponent * np.log1p(x * x)))


def drag_ratio(speed_ratio: ArrayLike, exponent: float) -> FloatArray:
    """eps_D = eps_L / x of Eq. 15, x = v/w; zero at rest, odd in x.

    Examples
    --------
    >>> drag_ratio([-1.0, 0.0, 1.0], 1.0).tolist()
    [-0.5, 0.0, 0.5]
    """
    x = np.asarray(speed_ratio, dtype=np.float64)
    return x * _lift_over_square(x, exponent)


def lift_ratio_slope(speed_ratio: ArrayLike, exponent: float) -> FloatArray:
    """d eps_L / dx = 2 n x (1 + x^2)^(-n-1).

    Examples
    --------
    >>> float(lift_ratio_slope(1.0, 1.0))
    0.5
    """
    x = np.asarray(speed_ratio, dtype=np.float64)
    return np.asarray(2.0 * exponent * x * np.exp(-(exponent + 1.0) * np.log1p(x * x)))


def drag_ratio_slope(speed_ratio: ArrayLike, exponent: float) -> FloatArray:
    """d eps_D / dx = 2 n (1 + x^2)^(-n-1) - eps_L / x^2; it is n at rest and vanishes at the drag peak.

    Examples
    --------
    >>> float(drag_ratio_slope(0.0, 0.2)), abs(float(drag_ratio_slope(1.0, 1.0))) < 1e-15
    (0.2, True)
    """
    x = np.asarray(speed_ratio, dtype=np.float64)
    steep = 2.0 * exponent * np.exp(-(exponent + 1.0) * np.log1p(x * x))
    return np.asarray(steep - _lift_over_square(x, exponent))


def receding_image_ratio(speed: ArrayLike, vertical_velocity: ArrayLike, *, characteristic: float) -> ComplexArray:
    """Complex force ratio r of a line current that moves forward at v and steadily up at u over a thin sheet.

    Maxwell's images recede at w. A source step leaves a dipole of images behind; summed over the past,
    lift - i drag = F(z) (v - i u) / (v + i (w - u)): lift = F Re r, drag = -F Im r. At u = 0 this is Eq. 15, n = 1.

    Parameters
    ----------
    speed : (...) v, m/s
    vertical_velocity : (...) u, m/s, below w (a source that outruns its images has no steady force)
    characteristic : w, m/s

    Raises
    ------
    ModelError : u is not below w

    Examples
    --------
    >>> complex(receding_image_ratio(2.0, 0.0, characteristic=1.0))
    (0.8-0.4j)
    """
    v, u = (np.asarray(part, dtype=np.float64) for part in (speed, vertical_velocity))
    if np.any(u >= characteristic):
        raise ModelError(
            f"vertical velocity {np.max(u):.6g} m/s is not below the characteristic speed {characteristic:.6g} m/s"
        )
    return np.asarray((v - 1j * u) / (v + 1j * (characteristic - u)))


@dataclass(frozen=True, eq=False, slots=True)
class ImageForce(AbstractForceModel):
    """Image force of a coil over a conducting sheet, Eq. 15 times the coil's effective length.

    Parameters
    ----------
    current : ampere-turns, A (an array after `scaled` by an array)
    length : effective length, m
    conductivity, thickness : of the guideway sheet, S/m and m
    exponent : n > 0
    vertical_velocity : "receding_image" adds the partials with respect to a vertical velocity (n = 1 only), which
        make heave damping negative above the characteristic speed (Davis & Wilkie, J. Appl. Phys. 42, 1971)

    Raises
    ------
    ValueError : a parameter that is not positive, or "receding_image" with an exponent other than 1

    Examples
    --------
    >>> magnet = ImageForce(current=1e5, length=1.0, conductivity=2.5e7, thickness=0.02, exponent=1.0)
    >>> forces = magnet.forces(0.1, None, magnet.characteristic)
    >>> bool(abs(forces.lift - forces.drag) < 1e-9), round(float(forces.lift), 6)
    (True, 5000.0)
    """

    current: float | FloatArray
    length: float
    conductivity: float
    thickness: float
    exponent: float
    vertical_velocity: VerticalVelocity = "none"

    def __post_init__(self) -> None:
        _require_positive(
            length=self.length, conductivity=self.conductivity, thickness=self.thickness, exponent=self.exponent
        )
        if not np.all(np.isfinite(self.current)):
            raise ValueError(f"current: expected finite ampere-turns, got {self.current}")
        if self.vertical_velocity not in ("none", "receding_image"):
            raise ValueError(f"vertical_velocity: expected 'none' or 'receding_image', got {self.vertical_velocity!r}")
        if self.vertical_velocity == "receding_image" and self.exponent != 1.0:
            raise ValueError(f"exponent: 'receding_image' holds for a line current, exponent 1; got {self.exponent}")

    @classmethod
    def for_lift(
        cls,
        lift: float,
        height: float,
        speed: float,
        *,
        length: float,
        conductivity: float,
        thickness: float,
        exponent: float,
        vertical_velocity: VerticalVelocity = "none",
    ) -> ImageForce:
        """The coil whose current gives `lift` (N) at `height` (m) and `speed` (m/s).

        Raises
        ------
        ModelError : at rest, where no current lifts
        ValueError : a lift that is not positive

        Examples
        --------
        >>> coil = ImageForce.for_lift(1e4, 0.1, 100.0, length=1.0, conductivity=2.5e7, thickness=0.02, exponent=0.2)
        >>> round(float(coil.forces(0.1, None, 100.0).lift), 6)
        10000.0
        """
        _require_positive(lift=lift)
        if speed == 0.0:
            raise ModelError("speed 0 m/s: an image force has no lift at rest, whatever the current")
        unit = cls(1.0, length, conductivity, thickness, exponent, vertical_velocity)
        return unit.scaled(lift / float(unit.forces(height, None, speed).lift))

    @property
    def characteristic(self) -> float:
        """Characteristic speed w of the sheet, m/s."""
        return characteristic_speed(self.conductivity, self.thickness)

    @property
    def domain(self) -> Domain:
        """Every positive height and every speed; the gap does not matter."""
        return _EVERYWHERE

    def forces(self, height: ArrayLike, gap: ArrayLike | None, speed: ArrayLike) -> MagnetForces:
        """Lift and drag of Eq. 15; guidance is zero."""
        image, x, _ = self._image(height, gap, speed)
        n = self.exponent
        return MagnetForces(lift=image * lift_ratio(x, n), guidance=np.zeros(()), drag=image * drag_ratio(x, n))

    def derivatives(self, height: ArrayLike, gap: ArrayLike | None, speed: ArrayLike) -> MagnetDerivatives:
        """Exact partials of Eq. 15 (the corrected Eq. 22), for any exponent, at rest too."""
        image, x, z = self._image(height, gap, speed)
        n, w = self.exponent, self.characteristic
        zero = np.zeros(())
        by_height = MagnetForces(lift=-image / z * lift_ratio(x, n), guidance=zero, drag=-image / z * drag_ratio(x, n))
        by_speed = MagnetForces(
            lift=image / w * lift_ratio_slope(x, n), guidance=zero, drag=image / w * drag_ratio_slope(x, n)
        )
        nothing = no_forces(x.shape)
        climbing = nothing if self.vertical_velocity == "none" else _climbing(image / w, x)
        return MagnetDerivatives(
            by_height=by_height,
            by_gap=nothing,
            by_speed=by_speed,
            by_vertical_velocity=climbing,
            by_lateral_velocity=nothing,
        )

    def scaled(self, factor: ArrayLike) -> ImageForce:
        """The same coil with its current times the square root of `factor`.

        Examples
        --------
        >>> ImageForce(1e5, 1.0, 2.5e7, 0.02, 1.0).scaled(4.0).current
        200000.0
        """
        current = self.current * np.sqrt(checked_factor(factor))
        amperes = float(current) if current.ndim == 0 else current
        return ImageForce(
            amperes, self.length, self.conductivity, self.thickness, self.exponent, self.vertical_velocity
        )

    def _image(
        self, height: ArrayLike, gap: ArrayLike | None, speed: ArrayLike
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Force of the perfect image (N), speed ratio and height, all of one shape."""
        self.domain.require(height, gap, speed)
        z, v, current, _ = np.broadcast_arrays(
            np.asarray(height, dtype=np.float64),
            np.asarray(speed, dtype=np.float64),
            np.asarray(self.current, dtype=np.float64),
            np.zeros(() if gap is None else np.shape(gap)),
        )
        image = MAGNETIC_CONSTANT * current**2 * self.length / (4.0 * pi * z)
        return image, v / self.characteristic, z


def _climbing(slope: FloatArray, x: FloatArray) -> MagnetForces:
    """Partials by vertical velocity at u = 0 of `receding_image_ratio`; `slope` = F(z)/w.

    dr/du = (1/w) [x^2 - 1 - 2 i x] / (1 + x^2)^2, lift = F Re r, drag = -F Im r.
    """
    share = slope / (1.0 + x * x) ** 2
    return MagnetForces(lift=share * (x * x - 1.0), guidance=np.zeros(()), drag=share * 2.0 * x)


def _lift_over_square(x: NDArray[np.float64], exponent: float) -> FloatArray:
    """eps_L / x^2, which tends to n at rest."""
    square = x * x
    moving = square > _NO_SQUARE
    safe = np.where(moving, square, 1.0)
    return np.where(moving, -np.expm1(-exponent * np.log1p(safe)) / safe, exponent)


def _require_positive(**values: float) -> None:
    for name, value in values.items():
        if not (np.isfinite(value) and value > 0.0):
            raise ValueError(f"{name}: expected a positive number, got {value}")
