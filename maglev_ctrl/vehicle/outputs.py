"""What can be read off a vehicle: sensors, coordinates, gaps, strokes and forces."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import assert_never

import numpy as np

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.vehicle.circuits import circuit_state
from maglev_ctrl.vehicle.elements import Actuator, Sensor, SpringDamper
from maglev_ctrl.vehicle.shares import guideway_inputs
from maglev_ctrl.vehicle.vehicle import Vehicle


@dataclass(slots=True, eq=False)
class OutputRow:
    """One output: rows over q, q', q'' (n,), weights of internal states and of guideway displacements and rates."""

    name: str
    size: int
    H_q: FloatArray = field(init=False)
    H_v: FloatArray = field(init=False)
    H_a: FloatArray = field(init=False)
    internal: dict[str, float] = field(default_factory=dict)
    guideway: dict[str, float] = field(default_factory=dict)
    guideway_rate: dict[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.H_q, self.H_v, self.H_a = np.zeros(self.size), np.zeros(self.size), np.zeros(self.size)


def sensor_rows(vehicle: Vehicle, strokes: FloatArray) -> list[OutputRow]:
    """Every sensor's reading along its stroke row; (sensors, n)."""
    return [_sensor_row(sensor, row) for sensor, row in zip(vehicle.sensors, strokes, strict=True)]


def _sensor_row(sensor: Sensor, row: FloatArray) -> OutputRow:
    output = OutputRow(sensor.name, len(row))
    match sensor.kind:
        case "gap" | "stroke":
            output.H_q = row
            feels = guideway_inputs(sensor.name, sensor.to, sensor.direction, angular=sensor.angular)
            output.guideway = {key: -cosine for key, cosine in feels.items()}
        case "velocity":
            output.H_v = row
        case "acceleration":
            output.H_a = row
        case "current":
            output.internal = {f"{sensor.magnet}.current": 1.0}
        case _:
            assert_never(sensor.kind)
    return output


def magnet_rows(vehicle: Vehicle, motion: FloatArray) -> list[OutputRow]:
    """Height change of every magnet over (or under) the guideway, "<magnet>.gap", from their motion (m, 3, n).

    A magnet with a guidance wall has the change of its distance to it too, "<magnet>.guidance_gap".
    An electromagnet driven by voltage also has "<magnet>.current".
    """
    rows = []
    for i, magnet in enumerate(vehicle.magnets):
        output, upward = OutputRow(f"{magnet.name}.gap", len(vehicle.dofs)), -1.0 if magnet.force.hangs else 1.0
        output.H_q = upward * motion[i, 2]
        output.guideway = {f"heave@{magnet.name}": -upward}
        rows.append(output)
        if magnet.side:
            beside = OutputRow(f"{magnet.name}.guidance_gap", len(vehicle.dofs))
            beside.H_q = -magnet.side * motion[i, 1]
            beside.guideway = {f"sway@{magnet.name}": float(magnet.side)}
            rows.append(beside)
        for state in circuit_state(magnet):
            current = OutputRow(state, len(vehicle.dofs))
            current.internal = {state: 1.0}
            rows.append(current)
    return rows


def link_rows(element: SpringDamper | Actuator, row: FloatArray) -> list[OutputRow]:
    """Stroke (its row (n,) is given), its velocity, and the force where it is a function of the states."""
    size = len(row)
    feels = guideway_inputs(element.name, element.to, element.direction, angular=element.angular)
    away = {key: -cosine for key, cosine in feels.items()}
    stroke, velocity = OutputRow(f"{element.name}.stroke", size), OutputRow(f"{element.name}.stroke.velocity", size)
    stroke.H_q, stroke.guideway = row, away
    velocity.H_v, velocity.guideway_rate = row, dict(away)
    force = OutputRow(f"{element.name}.force", size)
    if isinstance(element, Actuator):
        force.internal = {f"{element.name}.force": 1.0}
        # Without a bandwidth the force is (partly) the command itself, which no output row can hold.
        return [stroke, velocity] if element.bandwidth is None else [stroke, velocity, force]
    force.H_q = -element.stiffness * row
    force.guideway = {key: -element.stiffness * weight for key, weight in away.items()}
    if element.lag > 0.0:
        force.internal = {f"{element.name}.lag": -element.damping}
    else:
        force.H_v = -element.damping * row
        force.guideway_rate = {key: -element.damping * weight for key, weight in away.items()}
    return [stroke, velocity, force]


def coordinate_rows(dofs: tuple[str, ...]) -> list[OutputRow]:
    """Displacement, velocity and acceleration of every coordinate."""
    rows = []
    for i, name in enumerate(dofs):
        position = OutputRow(name, len(dofs))
        velocity, acceleration = OutputRow(f"{name}.velocity", len(dofs)), OutputRow(f"{name}.acceleration", len(dofs))
        position.H_q[i], velocity.H_v[i], acceleration.H_a[i] = 1.0, 1.0, 1.0
        rows += [position, velocity, acceleration]
    return rows
