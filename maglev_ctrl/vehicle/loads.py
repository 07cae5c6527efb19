"""The forces on a vehicle: magnets, connections, weight, thrust and air, as one generalised force Q(q, q')."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.forces.base import AbstractForceModel
from maglev_ctrl.vehicle.elements import Actuator, Aerodynamics, Magnet, SpringDamper, Vector
from maglev_ctrl.vehicle.kinematics import (
    Poses,
    paper_jacobian,
    paper_sway,
    point_jacobian,
    poses,
    stroke_row,
)
from maglev_ctrl.vehicle.operating import Equilibrium, Posture
from maglev_ctrl.vehicle.vehicle import Vehicle


@dataclass(frozen=True, eq=False, slots=True)
class MagnetField:
    """Forces of m magnets and their partials in space axes, with strength and count.

    `heights`, `gaps` (m,) m, gap NaN where there is none; `lift`, `guidance`, `drag` (m,) N; `force` (m, 3) N;
    `by_position` S and `by_velocity` D (m, 3, 3), N/m and N s/m, with the directions of motion as columns;
    `drag_direction` (m,) N s/m is D/v, the lateral damping of a drag that follows the velocity.
    `jacobian`, `motion` (m, 3, n): where forces act, and how the magnets move (they differ in the paper's kinematics).
    """

    heights: FloatArray
    gaps: FloatArray
    lift: FloatArray
    guidance: FloatArray
    drag: FloatArray
    force: FloatArray
    by_position: FloatArray
    by_velocity: FloatArray
    drag_direction: FloatArray
    jacobian: FloatArray
    motion: FloatArray


def magnet_field(
    vehicle: Vehicle, posture: Posture, found: Poses, *, rates: FloatArray | None = None, partials: bool = True
) -> MagnetField:
    """Every magnet's force and partials at a posture.

    Parameters
    ----------
    found : poses of the bodies
    rates : (n,) coordinate velocities; they change the speed over the guideway
    partials : whether to find the partials too (zero otherwise)

    Raises
    ------
    OutOfDomain : a magnet outside its force model's data
    """
    n, m = len(vehicle.dofs), len(vehicle.magnets)
    jacobian, motion = np.zeros((m, 3, n)), np.zeros((m, 3, n))
    heights, gaps = np.zeros(m), np.full(m, np.nan)
    for i, magnet in enumerate(vehicle.magnets):
        pose = found[magnet.body]
        shift = pose.shift(magnet.position)
        jacobian[i] = motion[i] = point_jacobian(pose, magnet.position, size=n)
        if vehicle.kinematics == "paper":
            motion[i] = paper_jacobian(pose, magnet.position, size=n)
            shift[1] = paper_sway(pose, magnet.position)
        heights[i] = posture.height + shift[2]
        if posture.gap is not None:
            gaps[i] = posture.gap - magnet.side * (posture.offset + shift[1])
    forward = np.zeros(m) if rates is None else jacobian[:, 0] @ rates
    speed = posture.speed + forward
    lift, guidance, drag, slopes = _evaluate(vehicle.magnets, heights, gaps, speed, partials=partials)
    share = posture.strength * np.array([magnet.count for magnet in vehicle.magnets])
    side = np.array([float(magnet.side) for magnet in vehicle.magnets])
    force = np.stack([-share * drag, -side * share * guidance, share * lift], axis=-1).reshape(m, 3)
    # Partials of (lift, guidance, drag) become partials of the vector (-D, -side G, L).
    signs = np.stack([-share, -side * share, share], axis=-1).reshape(m, 3, 1)
    vectors = signs * slopes[:, [2, 1, 0], :]
    by_height, by_gap, by_speed, by_rise, by_widening = np.moveaxis(vectors, -1, 0)
    zero = np.zeros((m, 3))
    moving = speed > 0.0
    drag_direction = share * np.where(moving, drag / np.where(moving, speed, 1.0), slopes[:, 2, 2])
    return MagnetField(
        heights=heights,
        gaps=gaps,
        lift=share * lift,
        guidance=share * guidance,
        drag=share * drag,
        force=force,
        by_position=np.stack([zero, -side[:, None] * by_gap, by_height], axis=-1),
        by_velocity=np.stack([by_speed, -side[:, None] * by_widening, by_rise], axis=-1),
        drag_direction=drag_direction if vehicle.drag_direction else np.zeros(m),
        jacobian=jacobian,
        motion=motion,
    )


def _evaluate(
    magnets: tuple[Magnet, ...], heights: FloatArray, gaps: FloatArray, speeds: FloatArray, *, partials: bool
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Lift, guidance, drag (m,) of single magnets and partials (m, 3, 5): rows lift, guidance, drag; columns
    height, gap, speed, rising, widening. Magnets that share a model are evaluated together.
    """
    forces = np.zeros((len(magnets), 3))
    slopes = np.zeros((len(magnets), 3, 5))
    groups: dict[tuple[int, bool], tuple[AbstractForceModel, list[int]]] = {}
    for i, magnet in enumerate(magnets):
        blind = magnet.side == 0 and magnet.force.domain.gap is None
        groups.setdefault((id(magnet.force), blind), (magnet.force, []))[1].append(i)
    for (_, blind), (model, members) in groups.items():
        gap = None if blind or np.any(np.isnan(gaps[members])) else gaps[members]
        found = model.forces(heights[members], gap, speeds[members])
        forces[members] = np.stack([found.lift, found.guidance, found.drag], axis=-1)
        if partials:
            derived = model.derivatives(heights[members], gap, speeds[members])
            parts = (
                derived.by_height, derived.by_gap, derived.by_speed,
                derived.by_vertical_velocity, derived.by_lateral_velocity,
            )  # fmt: skip
            columns = [np.stack([part.lift, part.guidance, part.drag], axis=-1) for part in parts]
            slopes[members] = np.stack(columns, axis=-1)
    return forces[:, 0], forces[:, 1], forces[:, 2], slopes


def generalized_force(
    vehicle: Vehicle, at: Equilibrium, displacement: FloatArray, velocity: FloatArray | None = None
) -> FloatArray:
    """Net generalised force Q about an equilibrium, dead loads included: zero when nothing moves.

    The magnet forces are the nonlinear ones, rotations are finite, and moments are about the space axes; dampers
    with a lag (their state is zero) and actuator commands are left out. The central difference of Q is -K and -C of
    `linearize` for a vehicle with its geometric stiffness on.

    Parameters
    ----------
    displacement : (n,) increment from the equilibrium, m and rad
    velocity : (n,) m/s and rad/s

    Raises
    ------
    OutOfDomain : a magnet outside its force model's data
    """
    rates = None if velocity is None else np.asarray(velocity, dtype=np.float64)
    return net_force(vehicle, at.posture, increment=np.asarray(displacement), rates=rates) - at.unbalanced


def net_force(
    vehicle: Vehicle, posture: Posture, *, increment: FloatArray | None = None, rates: FloatArray | None = None
) -> FloatArray:
    """Net generalised force at a posture moved on by an increment; (n,)."""
    n = len(vehicle.dofs)
    step = np.zeros(n) if increment is None else increment
    velocity = np.zeros(n) if rates is None else rates
    start = poses(vehicle, posture.displacement)
    now = start if increment is None else poses(vehicle, posture.displacement, step)
    # At rest the partials with respect to velocities play no part.
    field = magnet_field(vehicle, posture, now, rates=velocity, partials=rates is not None)
    total = posture.loads + magnet_force(field, velocity)
    for pose in now.values():
        weight = np.array([0.0, 0.0, -pose.body.mass * vehicle.gravity])
        total = total + point_jacobian(pose, pose.body.position, size=n).T @ weight
    for push in longitudinal_forces(vehicle, posture):
        row = point_jacobian(now[push.body], push.position, size=n)[0]
        total = total + row * push.at(posture.speed + float(row @ velocity))
    for connection in vehicle.links:
        total = total + _connection_force(connection, posture, start, now, step, velocity)
    for element in vehicle.coefficient_elements:
        found = element.table.at(posture.speed)
        pose = now[element.body]
        block = np.ix_(pose.axes, pose.axes)
        columns = list(pose.columns)
        total[columns] -= found.stiffness[block] @ (posture.displacement + step)[columns]
        total[columns] -= found.damping[block] @ velocity[columns]
    return np.asarray(total)


def magnet_force(field: MagnetField, velocity: FloatArray) -> FloatArray:
    """Generalised force of all magnets, with what their vertical and lateral velocities add; (n,)."""
    rise, sway = field.motion[:, 2] @ velocity, field.motion[:, 1] @ velocity
    moving = field.by_velocity[:, :, 2] * rise[:, None] + field.by_velocity[:, :, 1] * sway[:, None]
    total = np.einsum("mij,mi->j", field.jacobian, field.force + moving)
    return np.asarray(total - np.einsum("mj,m->j", field.motion[:, 1], field.drag_direction * sway))


@dataclass(frozen=True, eq=False, slots=True)
class LongitudinalForce:
    """Thrust or air drag at a point of a body: constant - drag_factor v |v|, N forwards."""

    name: str
    body: str
    position: Vector
    constant: float
    drag_factor: float

    def at(self, speed: float) -> float:
        """Force at a speed of its point, N."""
        return self.constant - self.drag_factor * speed * abs(speed)


def longitudinal_forces(vehicle: Vehicle, posture: Posture) -> list[LongitudinalForce]:
    """Thrust and air drag of every body."""
    points = dict(vehicle.thrust_positions)
    air = [
        LongitudinalForce(a.name, a.body, _air_position(vehicle, a), 0.0, a.drag_factor) for a in vehicle.aerodynamics
    ]
    thrust = [
        LongitudinalForce("thrust", b.name, points.get(b.name, b.position), posture.thrust.get(b.name, 0.0), 0.0)
        for b in vehicle.bodies
    ]
    return air + thrust


def _air_position(vehicle: Vehicle, air: Aerodynamics) -> Vector:
    return vehicle.body(air.body).position if air.position is None else air.position


def connection_stroke(element: SpringDamper | Actuator, start: Poses, now: Poses, step: FloatArray) -> float:
    """Stroke between two sets of poses that are `step` (n,) apart, m (rad when angular)."""
    if element.angular:
        row = stroke_row(
            start, element.body, element.to,
            position=element.position, direction=element.direction, angular=True, size=len(step),
        )  # fmt: skip
        return float(row @ step)

    def shift(name: str) -> FloatArray:
        if name not in now:
            return np.zeros(3)
        return now[name].shift(element.position) - start[name].shift(element.position)

    return float(np.asarray(element.direction) @ (shift(element.body) - shift(element.to)))


def _connection_force(
    element: SpringDamper | Actuator,
    posture: Posture,
    start: Poses,
    now: Poses,
    step: FloatArray,
    velocity: FloatArray,
) -> FloatArray:
    row = stroke_row(
        now, element.body, element.to,
        position=element.position, direction=element.direction, angular=element.angular, size=len(step),
    )  # fmt: skip
    force = posture.static_forces.get(element.name, 0.0)
    if isinstance(element, SpringDamper):
        force -= element.stiffness * connection_stroke(element, start, now, step)
        if element.lag == 0.0:
            force -= element.damping * float(row @ velocity)
    return row * force


def longitudinal_thrust(vehicle: Vehicle, posture: Posture) -> Mapping[str, float]:
    """Thrust on each body that balances the drag of its magnets and of the air, N."""
    field = magnet_field(vehicle, posture, poses(vehicle, posture.displacement), partials=False)
    thrust = {body.name: 0.0 for body in vehicle.bodies}
    for magnet, drag in zip(vehicle.magnets, field.drag, strict=True):
        thrust[magnet.body] += float(drag)
    for air in vehicle.aerodynamics:
        thrust[air.body] += air.drag_factor * posture.speed**2
    return thrust
