"""From a scenario's records to a vehicle: bodies, magnets, connections, and an option's elements."""

from __future__ import annotations

from functools import lru_cache
from typing import Literal, assert_never

import numpy as np

from maglev_ctrl.forces import AbstractForceModel, CoefficientTable, ImageForce, TabulatedForce
from maglev_ctrl.forces.corner_image import CornerImageForce
from maglev_ctrl.forces.electromagnet import Electromagnet
from maglev_ctrl.scenario.eddy_current import UnsolvedForce, domain_of
from maglev_ctrl.scenario.force_schema import (
    CoefficientForces,
    CornerImageForces,
    ElectromagnetForces,
    ImageForces,
    TableForces,
)
from maglev_ctrl.scenario.force_table import ForceSamples
from maglev_ctrl.scenario.guideway_schema import EddyCurrentForces
from maglev_ctrl.scenario.layout import (
    CAR,
    Layout,
    design_mass,
    layout,
    place_element,
    place_sensor,
    secondary_places,
)
from maglev_ctrl.scenario.option_schema import OptionRecord, SensorRecord
from maglev_ctrl.scenario.scenario_schema import Scenario
from maglev_ctrl.scenario.vehicle_schema import Bogie, Car, DoubleL, TwoStage
from maglev_ctrl.vehicle import (
    Actuator,
    Aerodynamics,
    Body,
    CoefficientElement,
    Magnet,
    Sensor,
    SpringDamper,
    Vehicle,
)

GRAVITY = 9.80665
_DIRECTIONS = {"vertical": (0.0, 0.0, 1.0), "lateral": (0.0, 1.0, 0.0)}
_SIDES: dict[int, Literal[-1, 0, 1]] = {-1: -1, 0: 0, 1: 1}


def build_vehicle(scenario: Scenario, *, payload: float | None = None) -> Vehicle:
    """The bare vehicle of a scenario.

    The payload sits at the car's centre of mass and leaves its moments of inertia alone. Magnets are sized for the
    scenario's own payload, whatever `payload` says. Eddy-current forces take long to solve: until the scenario holds
    them (`with_solved_force`), the magnets have their domain but no forces.

    Parameters
    ----------
    payload : kg; None = the scenario's

    Raises
    ------
    ValueError : a negative payload, or a force table that cannot be fitted
    """
    record = scenario.vehicle
    here = layout(record)
    freedoms = dict(here.bodies)
    load = record.car.payload if payload is None else payload
    if load < 0.0:
        raise ValueError(f"payload: expected zero or more, got {load}")
    car = Body(
        CAR, record.car.mass + load,
        inertia=_inertia(record.car), dofs=freedoms[CAR], position=(0.0, 0.0, record.car.centre_height),
    )  # fmt: skip
    bogies = record.bogies if isinstance(record, TwoStage) else ()
    frames = tuple(
        Body(b.name, b.mass, inertia=_inertia(b), dofs=b.freedom, position=(b.position, 0.0, 0.0)) for b in bogies
    )
    double_l = record if isinstance(record, DoubleL) else None
    drag = None if double_l else getattr(record, "aerodynamics", None)
    return Vehicle(
        scenario.name,
        bodies=(car, *frames),
        reference_height=scenario.operating.height,
        reference_gap=scenario.operating.gap,
        magnets=_magnets(scenario, here),
        coefficient_elements=_coefficients(scenario, tuple(body.name for body in frames or (car,))),
        connections=_secondary(record) if isinstance(record, TwoStage) else (),
        aerodynamics=(Aerodynamics(CAR, drag.drag / drag.drag_speed**2),) if drag else (),
        kinematics=double_l.kinematics if double_l else "consistent",
        geometric_stiffness=double_l.geometric_stiffness if double_l else True,
    )


def build_option(scenario: Scenario, option: OptionRecord, vehicle: Vehicle) -> Vehicle:
    """The vehicle grown by an option's elements.

    Raises
    ------
    ValueError : the vehicle lacks a body the option names, or has an element of the same name
    """
    here = layout(scenario.vehicle)
    connections = tuple(
        SpringDamper(
            place.name, place.body,
            to=place.to or "", position=(place.x, 0.0, 0.0), direction=_DIRECTIONS[spring.direction],
            stiffness=spring.stiffness, damping=spring.damping, lag=spring.lag,
        )
        for spring in option.spring_dampers
        for place in place_element(spring, here)
    )  # fmt: skip
    actuators = tuple(
        Actuator(
            place.name, place.body,
            to=place.to or "", position=(place.x, 0.0, 0.0), direction=_DIRECTIONS[actuator.direction],
            force_limit=actuator.force_limit, bandwidth=actuator.bandwidth, delay=actuator.delay,
        )
        for actuator in option.actuators
        for place in place_element(actuator, here)
    )  # fmt: skip
    sensors = tuple(
        Sensor(
            place.name, sensor.kind,
            body=place.body, to=place.to, position=(place.x, 0.0, 0.0), direction=_measured(sensor, vehicle),
            noise=sensor.noise or 0.0, magnet=place.magnet,
        )
        for sensor in option.sensors
        for place in place_sensor(sensor, here)
    )  # fmt: skip
    return vehicle.with_elements(connections=connections, actuators=actuators, sensors=sensors)


def _measured(sensor: SensorRecord, vehicle: Vehicle) -> tuple[float, float, float]:
    """Direction a sensor measures along; the gap under a rail is measured downwards, so that it reads the gap."""
    x, y, z = _DIRECTIONS[sensor.direction]
    return (x, y, -z) if sensor.kind == "gap" and vehicle.hangs else (x, y, z)


def _inertia(body: Car | Bogie) -> tuple[float, float, float]:
    return body.roll_inertia or 0.0, body.pitch_inertia or 0.0, body.yaw_inertia or 0.0


def _magnets(scenario: Scenario, here: Layout) -> tuple[Magnet, ...]:
    if isinstance(scenario.forces, CoefficientForces) or not here.magnets:
        return ()
    each = scenario.forces.count if isinstance(scenario.forces, ElectromagnetForces) else 1
    force = _magnet_force(scenario, scenario.forces, each * sum(magnet.count for magnet in here.magnets))
    return tuple(
        Magnet(m.name, m.body, force=force, position=m.position, side=_SIDES[m.side], count=each * m.count)
        for m in here.magnets
    )


def _magnet_force(
    scenario: Scenario,
    forces: ImageForces | CornerImageForces | EddyCurrentForces | ElectromagnetForces | TableForces,
    count: float,
) -> AbstractForceModel:
    """Force of one magnet; unless the file fixes its strength, `count` of them lift the weight at the design point."""
    operating = scenario.operating
    share = design_mass(scenario) * GRAVITY / count
    match forces:
        case ImageForces():
            if forces.current is not None and forces.length is not None:
                return ImageForce(
                    forces.current, forces.length, forces.conductivity, forces.thickness, forces.exponent,
                    forces.vertical_velocity,
                )  # fmt: skip
            return ImageForce.for_lift(
                share, operating.height, operating.speed, length=1.0, conductivity=forces.conductivity,
                thickness=forces.thickness, exponent=forces.exponent, vertical_velocity=forces.vertical_velocity,
            )  # fmt: skip
        case CornerImageForces():
            coil = CornerImageForce(
                forces.current or 1.0, length=forces.coil_length, width=forces.coil_width,
                thickness=forces.coil_thickness,
            )  # fmt: skip
            if forces.current is not None:
                return coil
            lift = float(coil.forces(operating.height, operating.gap, operating.speed).lift)
            return coil.scaled(share / lift)
        case EddyCurrentForces():
            solved = scenario.solved_force
            if solved is None:
                return UnsolvedForce(domain_of(scenario, layout(scenario.vehicle)))
            if forces.absolute:
                return solved
            lift = float(solved.forces(operating.height, operating.gap, operating.speed).lift)
            if lift <= 0.0:
                raise ValueError(f"forces.coil: expected a lift above zero at the design point, got {lift:.6g} N")
            return solved.scaled(share / lift)
        case ElectromagnetForces():
            if forces.current is not None:
                magnet = Electromagnet(
                    forces.current, turns=forces.turns, pole_area=forces.pole_area, resistance=forces.resistance,
                    leakage=forces.leakage, iron_gap=forces.iron_gap, flux_limit=forces.flux_limit, drive=forces.drive,
                )  # fmt: skip
                magnet.require_unsaturated(operating.height)
                return magnet
            return Electromagnet.for_lift(
                share, operating.height, turns=forces.turns, pole_area=forces.pole_area,
                resistance=forces.resistance, leakage=forces.leakage, iron_gap=forces.iron_gap,
                flux_limit=forces.flux_limit, drive=forces.drive,
            )  # fmt: skip
        case TableForces():
            if scenario.force_samples is None:
                raise ValueError("force_samples: the scenario's force table has not been read")
            table = _fitted(scenario.force_samples, forces.method, forces.degree)
            if not forces.trim_to_weight:
                return table
            lift = float(table.forces(operating.height, operating.gap, operating.speed).lift)
            if lift <= 0.0:
                raise ValueError(f"forces.file: expected a lift above zero at the design point, got {lift:.6g} N")
            return table.scaled(share / lift)
        case _ as never:
            assert_never(never)


@lru_cache(maxsize=8)
def _fitted(samples: ForceSamples, method: Literal["spline", "polynomial"], degree: int) -> TabulatedForce:
    return TabulatedForce.from_samples(
        samples.height, samples.gap, samples.speed,
        lift=samples.lift, guidance=samples.guidance, drag=samples.drag, method=method, degree=degree,
    )  # fmt: skip


def _coefficients(scenario: Scenario, bodies: tuple[str, ...]) -> tuple[CoefficientElement, ...]:
    forces = scenario.forces
    if not isinstance(forces, CoefficientForces):
        return ()
    speeds = forces.speeds or (scenario.operating.speed,)
    constant = not forces.speeds
    if forces.convention == "left_hand_side":
        table = CoefficientTable(
            speeds=np.asarray(speeds), mass=np.asarray(forces.mass), damping=np.asarray(forces.damping),
            stiffness=np.asarray(forces.stiffness), constant=constant,
        )  # fmt: skip
    else:
        table = CoefficientTable.from_force_derivatives(
            speeds, m=forces.mass, c=forces.damping, k=forces.stiffness, constant=constant
        )
    return tuple(CoefficientElement(f"{body}_magnets", body, table=table) for body in bodies)


def _secondary(record: TwoStage) -> tuple[SpringDamper, ...]:
    """Springs between car and bogies; two per bogie share its stiffness."""
    suspension, springs = record.secondary, []
    share = 0.5 if suspension.half_spacing else 1.0
    lateral = suspension.lateral_stiffness or suspension.lateral_damping
    for name, (bogie, x, y) in secondary_places(record):
        directions = [("", "vertical", suspension.stiffness, suspension.damping)]
        if lateral:
            directions.append(("_lateral", "lateral", suspension.lateral_stiffness, suspension.lateral_damping))
        springs += [
            SpringDamper(
                name + ending, CAR,
                to=bogie, position=(x, y, 0.0), direction=_DIRECTIONS[word], stiffness=share * k, damping=share * c,
            )
            for ending, word, k, c in directions
        ]  # fmt: skip
    return tuple(springs)
