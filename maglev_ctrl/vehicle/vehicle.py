"""A vehicle: its elements, and the switches of its mechanics."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import KW_ONLY, dataclass, replace
from difflib import get_close_matches
from typing import ClassVar, Literal

import numpy as np

from maglev_ctrl.display import Shown
from maglev_ctrl.forces.electromagnet import Electromagnet
from maglev_ctrl.vehicle.elements import (
    GUIDEWAY,
    Actuator,
    Aerodynamics,
    Body,
    CoefficientElement,
    Magnet,
    Sensor,
    SpringDamper,
    Vector,
)

Kinematics = Literal["consistent", "paper"]


@dataclass(frozen=True, eq=False, slots=True, repr=False)
class Vehicle(Shown):
    """Bodies, magnets and connections; every model is a choice of them, and one assembly makes M, C and K.

    Parameters
    ----------
    reference_height, reference_gap : height and gap of the magnets in the reference posture, m
    gravity : m/s^2
    geometric_stiffness : whether static forces at turning points add stiffness (gamma of the double-L models)
    drag_direction : whether drag follows the direction of the velocity (lateral damping D/v0)
    kinematics : "paper" lets the magnets' lateral displacement ignore roll, as Eq. 43 does (kappa = 0)
    thrust_positions : (body, point) where the thrust that balances a body's drag acts; its centre of mass by default

    Raises
    ------
    ValueError : a name used twice, or a body that does not exist

    Examples
    --------
    >>> car = Body("car", 88e3, dofs=("heave",))
    >>> Vehicle("shuttle", bodies=(car,), reference_height=0.1).dofs
    ('car.heave',)
    >>> Vehicle("shuttle", bodies=(car,), reference_height=0.1, connections=(SpringDamper("skid", "cart"),))
    Traceback (most recent call last):
        ...
    ValueError: skid: there is no body 'cart'; did you mean 'car'?
    """

    _told: ClassVar = ("name", "bodies", "magnets", "connections", "actuators", "sensors")

    name: str
    bodies: tuple[Body, ...]
    _: KW_ONLY
    reference_height: float
    magnets: tuple[Magnet, ...] = ()
    coefficient_elements: tuple[CoefficientElement, ...] = ()
    connections: tuple[SpringDamper, ...] = ()
    actuators: tuple[Actuator, ...] = ()
    sensors: tuple[Sensor, ...] = ()
    aerodynamics: tuple[Aerodynamics, ...] = ()
    reference_gap: float | None = None
    gravity: float = 9.80665
    geometric_stiffness: bool = True
    drag_direction: bool = True
    kinematics: Kinematics = "consistent"
    thrust_positions: tuple[tuple[str, Vector], ...] = ()

    def __post_init__(self) -> None:
        if not self.bodies:
            raise ValueError("bodies: expected at least one body")
        if not (np.isfinite(self.reference_height) and self.reference_height > 0.0):
            raise ValueError(f"reference_height: expected a positive number, got {self.reference_height}")
        if self.kinematics not in ("consistent", "paper"):
            raise ValueError(f"kinematics: expected 'consistent' or 'paper', got {self.kinematics!r}")
        walls = [magnet.name for magnet in self.magnets if magnet.side != 0]
        if walls and self.reference_gap is None:
            raise ValueError(f"reference_gap: expected a gap because {walls[0]} has a guidance wall, got None")
        hanging = [magnet.name for magnet in self.magnets if magnet.force.hangs]
        if hanging and len(hanging) < len(self.magnets):
            other = next(magnet.name for magnet in self.magnets if not magnet.force.hangs)
            raise ValueError(
                f"magnets: expected all under a rail or all over a guideway, got {hanging[0]} that hangs and {other} "
                "that does not"
            )
        self._check_names()
        self._check_currents()

    def _check_names(self) -> None:
        names = [element.name for element in (*self.bodies, *self.elements)]
        doubled = sorted({name for name in names if names.count(name) > 1})
        if doubled:
            raise ValueError(f"vehicle {self.name}: name used twice: {', '.join(doubled)}")
        attached: Iterable[tuple[str, str | None]] = [
            *((e.name, e.body) for e in self.elements),
            *((e.name, e.to) for e in self.connections),
            *((e.name, e.to) for e in self.actuators),
            *((e.name, e.to) for e in self.sensors),
            *(("thrust_positions", body) for body, _ in self.thrust_positions),
        ]
        for element, body in attached:
            if body is not None and body != GUIDEWAY:
                self._check_body(element, body)

    def _check_currents(self) -> None:
        """A current is measured in a winding whose current is not the command itself."""
        carry = [
            magnet.name
            for magnet in self.magnets
            if isinstance(magnet.force, Electromagnet) and magnet.force.drive == "voltage"
        ]
        for sensor in self.sensors:
            if sensor.kind == "current" and sensor.magnet not in carry:
                near = get_close_matches(str(sensor.magnet), carry, n=1)
                listed = f"they are {', '.join(carry)}" if carry else "there is none"
                advice = f"did you mean {near[0]!r}?" if near else listed
                raise ValueError(
                    f"sensor {sensor.name}: magnet: expected an electromagnet driven by voltage, got "
                    f"{sensor.magnet!r}; {advice}"
                )

    def _check_body(self, element: str, body: str) -> None:
        known = [b.name for b in self.bodies]
        if body not in known:
            near = get_close_matches(body, [*known, GUIDEWAY], n=1)
            advice = f"did you mean {near[0]!r}?" if near else f"the bodies are {', '.join(known)}"
            raise ValueError(f"{element}: there is no body {body!r}; {advice}")

    @property
    def elements(self) -> tuple[Magnet | CoefficientElement | SpringDamper | Actuator | Sensor | Aerodynamics, ...]:
        """Everything attached to the bodies."""
        return (
            *self.magnets, *self.coefficient_elements, *self.connections,
            *self.actuators, *self.sensors, *self.aerodynamics,
        )  # fmt: skip

    @property
    def links(self) -> tuple[SpringDamper | Actuator, ...]:
        """Connections and actuators: everything that can carry a static force between two ends."""
        return (*self.connections, *self.actuators)

    @property
    def places(self) -> dict[str, Vector]:
        """Where magnets, links, sensors and measured elements meet the guideway, by name, m; the last at their body."""
        found = {one.name: one.position for one in (*self.magnets, *self.links, *self.sensors)}
        return found | {one.name: self.body(one.body).position for one in self.coefficient_elements}

    @property
    def dofs(self) -> tuple[str, ...]:
        """Coordinates, such as "car.heave", body by body."""
        return tuple(f"{body.name}.{dof}" for body in self.bodies for dof in body.dofs)

    @property
    def hangs(self) -> bool:
        """Whether the magnets hang under a rail, so that their heights shrink where the vehicle rises."""
        return any(magnet.force.hangs for magnet in self.magnets)

    @property
    def mass(self) -> float:
        """Mass of all bodies, kg."""
        return float(sum(body.mass for body in self.bodies))

    def body(self, name: str) -> Body:
        """A body by its name.

        Raises
        ------
        ValueError : there is no such body
        """
        self._check_body("body", name)
        return next(body for body in self.bodies if body.name == name)

    def with_elements(
        self,
        *,
        connections: tuple[SpringDamper, ...] = (),
        actuators: tuple[Actuator, ...] = (),
        sensors: tuple[Sensor, ...] = (),
    ) -> Vehicle:
        """A copy with elements added.

        Raises
        ------
        ValueError : a name used twice, or a body that does not exist

        Examples
        --------
        >>> bare = Vehicle("shuttle", bodies=(Body("car", 88e3),), reference_height=0.1)
        >>> bare.with_elements(connections=(SpringDamper("skid", "car", damping=1e4),)).connections[0].name
        'skid'
        """
        return replace(
            self,
            connections=self.connections + connections,
            actuators=self.actuators + actuators,
            sensors=self.sensors + sensors,
        )
