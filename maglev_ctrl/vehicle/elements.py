"""What a vehicle is made of: rigid bodies, magnets, connections, actuators and sensors.

Axes: x forward, y left, z up; roll, pitch, yaw turn about +x, +y, +z (positive pitch is nose down).
Positions are points of the vehicle frame in the reference posture, m.
"""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike

from maglev_ctrl.arrays import FloatArray, read_only

if TYPE_CHECKING:
    from maglev_ctrl.forces.base import AbstractForceModel
    from maglev_ctrl.forces.coefficients import CoefficientTable

GUIDEWAY = "guideway"
"""What a connection, actuator or sensor names as its other end when that end is the guideway."""

DOF_NAMES = ("surge", "sway", "heave", "roll", "pitch", "yaw")
"""The six freedoms of a rigid body, in the order of the axes."""

Vector = tuple[float, float, float]
SensorKind = Literal["gap", "stroke", "velocity", "acceleration", "current"]

UP: Vector = (0.0, 0.0, 1.0)
ORIGIN: Vector = (0.0, 0.0, 0.0)


@dataclass(frozen=True, eq=False, slots=True)
class Body:
    """A rigid body; freedoms that `dofs` leaves out are held fixed.

    Parameters
    ----------
    name : unique in its vehicle
    mass : kg
    inertia : about the centre of mass, (3,) principal moments or (3, 3) matrix, kg m^2
    dofs : freedoms out of `DOF_NAMES`; kept in that order
    position : centre of mass in the vehicle frame, m

    Raises
    ------
    ValueError : an unknown or doubled freedom, a mass that is not positive, an inertia that is not symmetric

    Examples
    --------
    >>> Body("car", 88e3, inertia=(0.0, 2.8e7, 0.0), dofs=("pitch", "heave")).dofs
    ('heave', 'pitch')
    """

    name: str
    mass: float
    _: KW_ONLY
    inertia: ArrayLike = (0.0, 0.0, 0.0)
    dofs: tuple[str, ...] = ("heave",)
    position: Vector = ORIGIN

    def __post_init__(self) -> None:
        _check_name(self.name)
        _check_positive(self.mass, f"body {self.name}: mass")
        moments = np.asarray(self.inertia, dtype=np.float64)
        matrix = np.diag(moments) if moments.shape == (3,) else moments
        if matrix.shape != (3, 3) or not np.allclose(matrix, matrix.T, rtol=1e-12, atol=0.0):
            raise ValueError(
                f"body {self.name}: inertia: expected (3,) or a symmetric (3, 3), got shape {moments.shape}"
            )
        unknown = [dof for dof in self.dofs if dof not in DOF_NAMES]
        if unknown or len(set(self.dofs)) != len(self.dofs):
            raise ValueError(
                f"body {self.name}: dofs: expected distinct names out of {', '.join(DOF_NAMES)}, got {self.dofs}"
            )
        object.__setattr__(self, "inertia", read_only(matrix, name=f"body {self.name}: inertia"))
        object.__setattr__(self, "dofs", tuple(dof for dof in DOF_NAMES if dof in self.dofs))
        object.__setattr__(self, "position", _vector(self.position, f"body {self.name}: position"))

    @property
    def inertia_matrix(self) -> FloatArray:
        """Inertia about the centre of mass, (3, 3) kg m^2."""
        return np.asarray(self.inertia, dtype=np.float64)


@dataclass(frozen=True, eq=False, slots=True)
class Magnet:
    """A magnet on a body: force (-drag, -side guidance, lift) at a point.

    An `Electromagnet` hangs under its rail: its height is the gap to the rail, which closes as the body rises. Its
    command is the input "<name>.voltage" (V), with the internal state "<name>.current" (A), or "<name>.current".

    Parameters
    ----------
    name, body : its name, and the name of the body that carries it
    force : force model of one magnet
    position : where the force acts, vehicle frame, m
    side : +1 with the guidance wall at +y (gap = g0 - lateral displacement), -1 with it at -y, 0 without a wall
    count : how many such magnets act here (any positive number)
    """

    name: str
    body: str
    _: KW_ONLY
    force: AbstractForceModel
    position: Vector = ORIGIN
    side: Literal[-1, 0, 1] = 0
    count: float = 1.0

    def __post_init__(self) -> None:
        _check_name(self.name)
        if self.side not in (-1, 0, 1):
            raise ValueError(f"magnet {self.name}: side: expected -1, 0 or 1, got {self.side!r}")
        _check_positive(self.count, f"magnet {self.name}: count")
        object.__setattr__(self, "position", _vector(self.position, f"magnet {self.name}: position"))


@dataclass(frozen=True, eq=False, slots=True)
class CoefficientElement:
    """Measured magnetic matrices M_m, C_m, K_m (6, 6) of one body about its centre of mass, left-hand side.

    They describe changes about the operating point; what static force stands behind them is not known. In a vehicle
    without magnets they carry the static load of their body; they add no geometric stiffness.
    """

    name: str
    body: str
    _: KW_ONLY
    table: CoefficientTable

    def __post_init__(self) -> None:
        _check_name(self.name)


@dataclass(frozen=True, eq=False, slots=True)
class SpringDamper:
    """Spring and damper in parallel between a body and another body or the guideway.

    Force on `body` along `direction`, with the stroke the displacement of `body` relative to `to`:
    -(k + c s / (1 + lag s)) stroke. A lag makes the eddy-current or shorted-coil damper (lag = L/R) with the internal
    state "<name>.lag", the lagged velocity.

    Parameters
    ----------
    to : other body, or GUIDEWAY
    position, direction : point of attachment (m) and unit vector, vehicle frame
    stiffness, damping : N/m and N s/m; N m/rad and N m s/rad when `angular`
    lag : s
    angular : a rotational spring and damper about `direction`
    """

    name: str
    body: str
    _: KW_ONLY
    to: str = GUIDEWAY
    position: Vector = ORIGIN
    direction: Vector = UP
    stiffness: float = 0.0
    damping: float = 0.0
    lag: float = 0.0
    angular: bool = False

    def __post_init__(self) -> None:
        _check_attachment("spring_damper", self.name, self.body, self.to)
        for label in ("stiffness", "damping"):
            _check_finite(getattr(self, label), f"spring_damper {self.name}: {label}")
        _check_not_negative(self.lag, f"spring_damper {self.name}: lag")
        object.__setattr__(self, "position", _vector(self.position, f"spring_damper {self.name}: position"))
        object.__setattr__(self, "direction", _unit(self.direction, f"spring_damper {self.name}: direction"))


@dataclass(frozen=True, eq=False, slots=True)
class Actuator:
    """A force actuator: +direction on `body`, the reaction on `to`. Its command (N) is an input of its name.

    Parameters
    ----------
    force_limit : N, None = none; recorded for checks, linear models do not saturate
    bandwidth : rad/s of a first-order lag from command to force, None = ideal
    delay : s from command to force
    static_stiffness : N/m; weight with which a constant bias of the actuator shares static load like a spring would
        (0: it carries none); adds no stiffness to the linear model
    angular : a torque about `direction` (N m)
    """

    name: str
    body: str
    _: KW_ONLY
    to: str = GUIDEWAY
    position: Vector = ORIGIN
    direction: Vector = UP
    force_limit: float | None = None
    bandwidth: float | None = None
    delay: float = 0.0
    static_stiffness: float = 0.0
    angular: bool = False

    def __post_init__(self) -> None:
        _check_attachment("actuator", self.name, self.body, self.to)
        for label in ("force_limit", "bandwidth"):
            value = getattr(self, label)
            if value is not None:
                _check_positive(value, f"actuator {self.name}: {label}")
        _check_not_negative(self.delay, f"actuator {self.name}: delay")
        _check_finite(self.static_stiffness, f"actuator {self.name}: static_stiffness")
        object.__setattr__(self, "position", _vector(self.position, f"actuator {self.name}: position"))
        object.__setattr__(self, "direction", _unit(self.direction, f"actuator {self.name}: direction"))


@dataclass(frozen=True, eq=False, slots=True)
class Sensor:
    """A measurement along `direction` at a point of a body, or of the current in a magnet.

    Parameters
    ----------
    kind : "gap" (displacement relative to the guideway), "stroke" (relative to the body `to`), "velocity" or
        "acceleration" (both absolute), or "current" (of the electromagnet `magnet`, driven by voltage)
    to : GUIDEWAY for a gap, a body for a stroke, left out otherwise
    magnet : whose current; left out otherwise
    noise : density per sqrt(Hz), in the unit of what is measured
    angular : measures rotation about `direction`
    """

    name: str
    kind: SensorKind
    _: KW_ONLY
    body: str
    to: str | None = None
    position: Vector = ORIGIN
    direction: Vector = UP
    noise: float = 0.0
    angular: bool = False
    magnet: str | None = None

    def __post_init__(self) -> None:
        _check_name(self.name)
        if (self.kind == "current") != (self.magnet is not None):
            expected = "the name of a magnet" if self.magnet is None else "a magnet with kind 'current' only"
            raise ValueError(f"sensor {self.name}: magnet: expected {expected}, got {self.magnet!r}")
        match self.kind:
            case "gap":
                expected, valid = "the guideway", self.to in (None, GUIDEWAY)
                object.__setattr__(self, "to", GUIDEWAY)
            case "stroke":
                expected, valid = "another body", self.to not in (None, self.body)
            case "velocity" | "acceleration":
                expected, valid = "nothing (it is absolute)", self.to is None
            case "current":
                expected, valid = "nothing (it is that of a magnet)", self.to is None
            case _:
                raise ValueError(
                    f"sensor {self.name}: kind: expected gap, stroke, velocity, acceleration or current, got "
                    f"{self.kind!r}"
                )
        if not valid:
            raise ValueError(f"sensor {self.name}: to: a {self.kind} sensor measures to {expected}, got {self.to!r}")
        _check_not_negative(self.noise, f"sensor {self.name}: noise")
        object.__setattr__(self, "position", _vector(self.position, f"sensor {self.name}: position"))
        object.__setattr__(self, "direction", _unit(self.direction, f"sensor {self.name}: direction"))


@dataclass(frozen=True, eq=False, slots=True)
class Aerodynamics:
    """Aerodynamic drag K_a v^2 (Eq. 18 without its surplus length): K_a in kg/m, at the centre of mass by default.

    Parameters
    ----------
    drag_factor : K_a = 0.5 C_D A rho with the frontal area A, kg/m
    position : where it acts, vehicle frame, m; None = the body's centre of mass
    """

    body: str
    drag_factor: float
    _: KW_ONLY
    position: Vector | None = None
    name: str = "aerodynamics"

    def __post_init__(self) -> None:
        _check_name(self.name)
        _check_not_negative(self.drag_factor, f"{self.name}: drag_factor")
        if self.position is not None:
            object.__setattr__(self, "position", _vector(self.position, f"{self.name}: position"))


Connection = SpringDamper | Actuator


def _check_name(name: str) -> None:
    if not name or name == GUIDEWAY:
        raise ValueError(f"name: expected a name other than {GUIDEWAY!r}, got {name!r}")


def _check_attachment(kind: str, name: str, body: str, to: str) -> None:
    _check_name(name)
    if body == to:
        raise ValueError(f"{kind} {name}: to: expected another body or {GUIDEWAY!r}, got its own body {to!r}")


def _check_finite(value: float, label: str) -> None:
    if not np.isfinite(value):
        raise ValueError(f"{label}: expected a finite number, got {value}")


def _check_positive(value: float, label: str) -> None:
    if not (np.isfinite(value) and value > 0.0):
        raise ValueError(f"{label}: expected a positive number, got {value}")


def _check_not_negative(value: float, label: str) -> None:
    if not (np.isfinite(value) and value >= 0.0):
        raise ValueError(f"{label}: expected a number that is not negative, got {value}")


def _vector(value: Vector, label: str) -> Vector:
    array = np.asarray(value, dtype=np.float64)
    if array.shape != (3,) or not np.all(np.isfinite(array)):
        raise ValueError(f"{label}: expected three finite numbers, got {value}")
    return float(array[0]), float(array[1]), float(array[2])


def _unit(value: Vector, label: str) -> Vector:
    vector = _vector(value, label)
    if abs(float(np.linalg.norm(vector)) - 1.0) > 1e-9:
        raise ValueError(f"{label}: expected a unit vector, got {value}")
    return vector
