"""What a ride study asks about: passengers, clearances and actuators, by the names of a model's outputs."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass

import numpy as np

from maglev_ctrl.analysis.response.channels import Signal
from maglev_ctrl.analysis.response.records import ClearanceKind
from maglev_ctrl.arrays import FloatArray, read_only
from maglev_ctrl.systems import SecondOrderSystem
from maglev_ctrl.vehicle.vehicle import Vehicle


@dataclass(frozen=True, eq=False, slots=True)
class Passenger:
    """Where a passenger sits: `x` forward, `y` to the left, `z` up from the body's centre of mass, m.

    `vertical` and `lateral` are names of weightings, `factors` those of the vector sum (k of ISO 2631-1; one for
    comfort).
    """

    name: str
    x: float = 0.0
    y: float = 0.0
    _: KW_ONLY
    z: float = 0.0
    body: str = "car"
    vertical: str = "Wk"
    lateral: str = "Wd"
    factors: tuple[float, float] = (1.0, 1.0)


@dataclass(frozen=True, eq=False, slots=True)
class Clearance:
    """A gap or stroke to watch: the output, its value at equilibrium, how far it may go, what `sag` uses up; m.

    Raises
    ------
    ValueError : a clearance that is not positive, or a negative sag

    Examples
    --------
    >>> Clearance("front gap", "gap", "front.gap", nominal=0.1, clearance=0.08).sag
    0.0
    """

    name: str
    kind: ClearanceKind
    output: str
    _: KW_ONLY
    nominal: float
    clearance: float
    sag: float = 0.0

    def __post_init__(self) -> None:
        if not (np.isfinite(self.clearance) and self.clearance > 0.0):
            raise ValueError(f"clearance {self.name}: expected a positive length in m, got {self.clearance}")
        if not (np.isfinite(self.sag) and self.sag >= 0.0):
            raise ValueError(f"clearance {self.name}: sag: expected a length that is not negative, got {self.sag}")


@dataclass(frozen=True, eq=False, slots=True)
class Port:
    """Where an actuator (or a damper) meets the vehicle: signals of its force and of its stroke's velocity.

    Force times velocity is the power given to the vehicle. `limit` of the force, N, or None.
    """

    name: str
    force: Signal
    velocity: Signal
    _: KW_ONLY
    limit: float | None = None


def link_port(system: SecondOrderSystem, name: str, *, limit: float | None = None) -> Port:
    """The port of a connection or actuator of a vehicle; an actuator without bandwidth gives its command.

    Raises
    ------
    ValueError : the system has no such link, or the limit is not positive

    Examples
    --------
    >>> system = SecondOrderSystem.from_matrices([[1.0]], [[0.0]], [[4.0]], inputs=("motor",), B=[[1.0]],
    ...                                          outputs=("motor.stroke.velocity",), H_v=[[1.0]])
    >>> link_port(system, "motor").force.terms
    (('motor', 1.0),)
    """
    force, velocity = f"{name}.force", f"{name}.stroke.velocity"
    if velocity not in system.outputs or not (force in system.outputs or name in system.inputs):
        raise ValueError(f"link: expected a connection or actuator of the system, got {name!r}")
    if limit is not None and not (np.isfinite(limit) and limit > 0.0):
        raise ValueError(f"limit of {name}: expected a positive force in N or None, got {limit!r}")
    given = force if force in system.outputs else name
    return Port(
        name, Signal(force, ((given, 1.0),), "N"), Signal.of(velocity, unit="m/s"), limit=limit
    )  # fmt: skip


def guideway_places(vehicle: Vehicle, names: tuple[str, ...]) -> FloatArray:
    """Where a vehicle's elements meet the guideway: x and y (k, 2), m, of inputs "heave@<element>", "sway@<element>".

    Measured coefficients act at their body's centre of mass.

    Raises
    ------
    ValueError : an input of no element

    Examples
    --------
    >>> from maglev_ctrl.vehicle import Body, SpringDamper
    >>> cart = Vehicle("cart", bodies=(Body("car", 10.0),), reference_height=0.1,
    ...                connections=(SpringDamper("leg", "car", stiffness=40.0, position=(3.0, -1.0, 0.0)),))
    >>> guideway_places(cart, ("heave@leg",)).tolist()
    [[3.0, -1.0]]
    """
    found = vehicle.places
    places: list[tuple[float, float]] = []
    for name in names:
        kind, _, element = name.partition("@")
        if kind not in ("heave", "sway") or element not in found:
            raise ValueError(f"names: expected guideway inputs of the vehicle's elements, got {name!r}")
        places.append(found[element][:2])
    return read_only(np.array(places).reshape(len(places), 2), name="places")
