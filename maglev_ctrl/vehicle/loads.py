"""The forces on a vehicle: magnets, connections, weight, thrust and air, as one generalised force Q(q, q')."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.vehicle.kinematics import Stance, stance, stroke_between
from maglev_ctrl.vehicle.operating import Equilibrium, Posture
from maglev_ctrl.vehicle.structure import Structure, structure
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

    def scaled(self, factor: float) -> MagnetField:
        """The same magnets with all their forces and partials times a factor."""
        return replace(
            self,
            lift=factor * self.lift,
            guidance=factor * self.guidance,
            drag=factor * self.drag,
            force=factor * self.force,
            by_position=factor * self.by_position,
            by_velocity=factor * self.by_velocity,
            drag_direction=factor * self.drag_direction,
        )


def magnet_field(
    vehicle: Vehicle,
    posture: Posture,
    here: Stance,
    *,
    rates: FloatArray | None = None,
    partials: bool = True,
    trimmed: bool = True,
) -> MagnetField:
    """Every magnet's force and partials at a posture.

    Parameters
    ----------
    here : the vehicle's stance
    rates : (n,) coordinate velocities; they change the speed over the guideway
    partials : whether to find the partials too (zero otherwise)
    trimmed : whether the posture's strength is that of the currents; before it is known no iron saturates

    Raises
    ------
    OutOfDomain : a magnet outside its force model's data
    """
    known = structure(vehicle)
    m, side = len(known.count), known.side
    jacobian = here.jacobian[known.magnets]
    heights = posture.height + known.upward * here.magnet_shift[:, 2]
    if trimmed:
        require_unsaturated(vehicle, posture, heights)
    gaps = np.full(m, np.nan)
    if posture.gap is not None:
        gaps = posture.gap - side * (posture.offset + here.magnet_shift[:, 1])
    speed = np.full(m, posture.speed) if rates is None else posture.speed + jacobian[:, 0] @ rates
    forces, slopes = _evaluate(known, heights, gaps, speed, partials=partials)
    lift, guidance, drag = forces.T
    share = posture.strength * known.count
    signs = _signs(known, posture)
    vectors = signs[:, :, None] * slopes[:, ::-1]
    by_position, by_velocity = _by_position(known, vectors), np.zeros((m, 3, 3))
    by_velocity[:, :, 0], by_velocity[:, :, 2] = vectors[:, :, 2], known.upward[:, None] * vectors[:, :, 3]
    by_velocity[:, :, 1] = -side[:, None] * vectors[:, :, 4]
    drag_direction = np.zeros(m)
    if vehicle.drag_direction:
        moving = speed > 0.0
        drag_direction = share * np.where(moving, drag / np.where(moving, speed, 1.0), slopes[:, 2, 2])
    return MagnetField(
        heights=heights,
        gaps=gaps,
        lift=share * lift,
        guidance=share * guidance,
        drag=share * drag,
        force=signs * forces[:, ::-1],
        by_position=by_position,
        by_velocity=by_velocity,
        drag_direction=drag_direction,
        jacobian=jacobian,
        motion=here.magnet_motion,
    )


def position_slopes(
    vehicle: Vehicle, posture: Posture, here: Stance, *, rise: FloatArray, narrowing: FloatArray
) -> FloatArray:
    """S = `MagnetField.by_position` of every magnet with the guideway displaced under it; (q, m, 3, 3) N/m.

    The vehicle stays where it is. Magnets of one model at one height and gap are evaluated once.

    Parameters
    ----------
    here : the vehicle's stance
    rise, narrowing : (q,) m; how far the surface (the rail over hanging magnets) stands up, and each wall towards its
        magnets

    Raises
    ------
    OutOfDomain : a magnet outside its force model's data
    """
    known = structure(vehicle)
    heights = posture.height + known.upward * here.magnet_shift[:, 2]
    gaps = np.full(len(heights), np.nan)
    if posture.gap is not None:
        gaps = posture.gap - known.side * (posture.offset + here.magnet_shift[:, 1])
    require_unsaturated(vehicle, posture, heights - known.upward * rise[:, None])
    slopes = np.zeros((len(rise), len(heights), 3, 2))
    for group in known.groups:
        members = group.members
        places = np.stack([heights[members], np.nan_to_num(gaps[members])])
        (height, gap), back = np.unique(places, axis=1, return_inverse=True)
        bare = group.blind or bool(np.isnan(gaps[members]).any())
        beside = None if bare else gap - narrowing[:, None]
        over = -1.0 if group.force.hangs else 1.0
        found = group.force.derivatives(height - over * rise[:, None], beside, np.asarray(posture.speed))
        rows = [[part.lift, part.guidance, part.drag] for part in (found.by_height, found.by_gap)]
        slopes[:, members] = np.moveaxis(np.array(rows), (0, 1), (-1, -2))[:, np.ravel(back)]
    return _by_position(known, _signs(known, posture)[:, :, None] * slopes[..., ::-1, :])


def _signs(known: Structure, posture: Posture) -> FloatArray:
    """What turns lift, guidance, drag in reverse order into the vector (-D, -side G, L) of all magnets here; (m, 3)."""
    share = posture.strength * known.count
    return np.stack([-share, -known.side * share, share], axis=-1)


def _by_position(known: Structure, vectors: FloatArray) -> FloatArray:
    """S (..., m, 3, 3) from the partials (..., m, 3, 2 or more) of force vectors by height and gap."""
    found = np.zeros((*vectors.shape[:-1], 3))
    found[..., 1] = -known.side[:, None] * vectors[..., 1]
    found[..., 2] = known.upward[:, None] * vectors[..., 0]
    return found


def require_unsaturated(vehicle: Vehicle, posture: Posture, heights: FloatArray) -> None:
    """Refuse electromagnets whose iron saturates at a posture's strength.

    Parameters
    ----------
    heights : (..., m) m, of the magnets

    Raises
    ------
    OutOfDomain : a flux density above a magnet's limit
    """
    for force, members in structure(vehicle).limited:
        force.require_unsaturated(heights[..., members], strength=posture.strength)


def _evaluate(
    known: Structure, heights: FloatArray, gaps: FloatArray, speeds: FloatArray, *, partials: bool
) -> tuple[FloatArray, FloatArray]:
    """Forces (m, 3) of single magnets and partials (m, 3, 5): lift, guidance, drag; columns height, gap, speed,
    rising, widening. Magnets that share a model are evaluated together.
    """
    forces, slopes = np.zeros((len(heights), 3)), np.zeros((len(heights), 3, 5))
    for group in known.groups:
        members = group.members
        height, gap, speed = heights[members], gaps[members], speeds[members]
        beside = None if group.blind or np.isnan(gap).any() else gap
        found = group.force.forces(height, beside, speed)
        forces[members] = np.stack([found.lift, found.guidance, found.drag], axis=-1)
        if partials:
            derived = group.force.derivatives(height, beside, speed)
            parts = (
                derived.by_height, derived.by_gap, derived.by_speed,
                derived.by_vertical_velocity, derived.by_lateral_velocity,
            )  # fmt: skip
            rows = [[part.lift for part in parts], [part.guidance for part in parts], [part.drag for part in parts]]
            slopes[members] = np.moveaxis(np.array(rows), -1, 0)
    return forces, slopes


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
    vehicle: Vehicle,
    posture: Posture,
    *,
    increment: FloatArray | None = None,
    rates: FloatArray | None = None,
    field: MagnetField | None = None,
) -> FloatArray:
    """Net generalised force at a posture moved on by an increment; (n,).

    `field` is the magnets' when it is known already.
    """
    now = stance(vehicle, posture.displacement, increment)
    # At rest the partials with respect to velocities play no part.
    found = field or magnet_field(vehicle, posture, now, rates=rates, partials=rates is not None)
    magnets = magnet_force(found, rates)
    return np.asarray(magnets + other_forces(vehicle, posture, now, increment=increment, rates=rates))


def other_forces(
    vehicle: Vehicle,
    posture: Posture,
    now: Stance,
    *,
    increment: FloatArray | None = None,
    rates: FloatArray | None = None,
) -> FloatArray:
    """Generalised force of everything but the magnets; `now` is the posture moved on by the increment; (n,)."""
    known = structure(vehicle)
    weight = -vehicle.gravity * (known.masses @ now.jacobian[known.centres, 2])
    pushing = now.jacobian[known.pushes, 0]
    rows = now.stroke[: len(known.links)]
    tension = np.array([posture.static_forces.get(link.name, 0.0) for link in known.links])
    if increment is not None:
        start = stance(vehicle, posture.displacement)
        tension = tension - known.link_stiffness * stroke_between(vehicle, start, now, increment)
    if rates is not None:
        tension = tension - known.link_damping * (rows @ rates)
    forward = 0.0 if rates is None else pushing @ rates
    pushes = longitudinal_forces(vehicle, posture, posture.speed + forward)
    total = posture.loads + weight + pushes @ pushing + tension @ rows
    moved = posture.displacement if increment is None else posture.displacement + increment
    for element in vehicle.coefficient_elements:
        table, i = element.table.at(posture.speed), known.index[element.body]
        block, columns = np.ix_(known.axes[i], known.axes[i]), list(known.columns[i])
        total[columns] -= table.stiffness[block] @ moved[columns]
        if rates is not None:
            total[columns] -= table.damping[block] @ rates[columns]
    return np.asarray(total)


def magnet_force(field: MagnetField, velocity: FloatArray | None = None) -> FloatArray:
    """Generalised force of all magnets, with what their vertical and lateral velocities add; (n,)."""
    if velocity is None:
        return np.asarray(np.einsum("mij,mi->j", field.jacobian, field.force))
    rise, sway = field.motion[:, 2] @ velocity, field.motion[:, 1] @ velocity
    moving = field.by_velocity[:, :, 2] * rise[:, None] + field.by_velocity[:, :, 1] * sway[:, None]
    total = np.einsum("mij,mi->j", field.jacobian, field.force + moving)
    return np.asarray(total - np.einsum("mj,m->j", field.motion[:, 1], field.drag_direction * sway))


def longitudinal_forces(vehicle: Vehicle, posture: Posture, speed: float | FloatArray) -> FloatArray:
    """Air drag at each of its points, then the thrust on each body, where points move at `speed`; (p,) N forwards."""
    known = structure(vehicle)
    air = len(vehicle.aerodynamics)
    thrust = np.array([0.0] * air + [posture.thrust.get(name, 0.0) for name in known.push_body[air:]])
    return np.asarray(thrust - known.drag_factor * speed * np.abs(speed))


def longitudinal_thrust(vehicle: Vehicle, posture: Posture, drag: FloatArray | None) -> Mapping[str, float]:
    """Thrust on each body that balances the drag of its magnets (m,), None when they are off, and of the air, N."""
    thrust = {body.name: 0.0 for body in vehicle.bodies}
    if drag is not None:
        for body, share in zip(structure(vehicle).carriers, drag.tolist(), strict=True):
            thrust[body] += share
    for air in vehicle.aerodynamics:
        thrust[air.body] += air.drag_factor * posture.speed**2
    return thrust
