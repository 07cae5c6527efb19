"""The share of each element in the linear model: its M, C, K, internal states, inputs and guideway terms."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.systems.second_order import ContributionKind
from maglev_ctrl.vehicle.elements import GUIDEWAY, Actuator, CoefficientElement, SpringDamper, Vector
from maglev_ctrl.vehicle.kinematics import Poses, geometric_stiffness, point_jacobian, stroke_row
from maglev_ctrl.vehicle.loads import MagnetField, longitudinal_forces
from maglev_ctrl.vehicle.operating import Posture
from maglev_ctrl.vehicle.pade import pade_delay
from maglev_ctrl.vehicle.vehicle import Vehicle


@dataclass(slots=True, eq=False)
class Share:
    """One element's share, gathered while the model is built.

    `K_w`, `C_w` (n,) and `G_wv` (k,) are keyed by the guideway input's name.
    """

    name: str
    kind: ContributionKind
    size: int
    M: FloatArray = field(init=False)
    C: FloatArray = field(init=False)
    K: FloatArray = field(init=False)
    F: FloatArray = field(init=False)
    internal: tuple[str, ...] = ()
    A_internal: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))
    G_v: FloatArray = field(init=False)
    inputs: tuple[str, ...] = ()
    B: FloatArray = field(init=False)
    B_internal: FloatArray = field(init=False)
    K_w: dict[str, FloatArray] = field(default_factory=dict)
    C_w: dict[str, FloatArray] = field(default_factory=dict)
    G_wv: dict[str, FloatArray] = field(default_factory=dict)

    def __post_init__(self) -> None:
        n = self.size
        self.M, self.C, self.K = np.zeros((n, n)), np.zeros((n, n)), np.zeros((n, n))
        self.F, self.G_v = np.zeros((n, 0)), np.zeros((0, n))
        self.B, self.B_internal = np.zeros((n, 0)), np.zeros((0, 0))


def guideway_inputs(name: str, to: str | None, direction: Vector, *, angular: bool) -> dict[str, float]:
    """Guideway displacements that an element attached to the guideway feels, with their direction cosines.

    Examples
    --------
    >>> guideway_inputs("skid", GUIDEWAY, (0.0, 0.6, 0.8), angular=False)
    {'heave@skid': 0.8, 'sway@skid': 0.6}
    """
    if to != GUIDEWAY or angular:
        return {}
    cosines = {f"heave@{name}": direction[2], f"sway@{name}": direction[1]}
    return {key: cosine for key, cosine in cosines.items() if cosine != 0.0}


def body_shares(found: Poses, size: int) -> list[Share]:
    """Masses and inertias, turned with the bodies."""
    shares = []
    for pose in found.values():
        share = Share(pose.body.name, "body", size)
        local = np.zeros((6, 6))
        local[:3, :3] = pose.body.mass * np.eye(3)
        local[3:, 3:] = pose.rotation @ pose.body.inertia_matrix @ pose.rotation.T
        share.M[np.ix_(pose.columns, pose.columns)] = local[np.ix_(pose.axes, pose.axes)]
        shares.append(share)
    return shares


def magnet_shares(vehicle: Vehicle, fields: MagnetField, size: int) -> list[Share]:
    """K = -J^T S J and C = -J^T D J of every magnet (Sec. 2.3), and its guideway inputs."""
    shares = []
    for i, magnet in enumerate(vehicle.magnets):
        share = Share(magnet.name, "magnet", size)
        J, motion = fields.jacobian[i], fields.motion[i]
        S, D = fields.by_position[i], fields.by_velocity[i]
        share.K = -J.T @ S @ motion
        # The speed enters with the magnet's own motion, rise and sway with what the kinematics makes of them.
        moving = np.stack([J[0], motion[1], motion[2]])
        share.C = -J.T @ D @ moving + fields.drag_direction[i] * np.outer(motion[1], motion[1])
        share.K_w[f"heave@{magnet.name}"] = -J.T @ S[:, 2]
        share.C_w[f"heave@{magnet.name}"] = -J.T @ D[:, 2]
        if magnet.side != 0:
            share.K_w[f"sway@{magnet.name}"] = -J.T @ S[:, 1]
            share.C_w[f"sway@{magnet.name}"] = -J.T @ D[:, 1]
        shares.append(share)
    return shares


def coefficient_share(element: CoefficientElement, found: Poses, *, speed: float, size: int) -> Share:
    """Measured matrices of a body; the guideway's acceleration acting on M_m is left out."""
    share = Share(element.name, "magnet", size)
    pose, table = found[element.body], element.table.at(speed)
    columns, axes = list(pose.columns), list(pose.axes)
    target, source = np.ix_(columns, columns), np.ix_(axes, axes)
    share.M[target], share.C[target], share.K[target] = (
        table.mass[source], table.damping[source], table.stiffness[source],
    )  # fmt: skip
    for axis, label in ((2, "heave"), (1, "sway")):
        stiffness, damping = np.zeros(size), np.zeros(size)
        stiffness[columns], damping[columns] = table.stiffness[axes, axis], table.damping[axes, axis]
        if axis == 2 or np.any(stiffness != 0.0) or np.any(damping != 0.0):
            share.K_w[f"{label}@{element.name}"] = stiffness
            share.C_w[f"{label}@{element.name}"] = damping
    return share


def spring_damper_share(element: SpringDamper, found: Poses, size: int) -> Share:
    """Spring and damper; a lag makes the damper's velocity an internal state, which pushes with -c."""
    share = Share(element.name, "spring_damper", size)
    row = stroke_row(
        found, element.body, element.to,
        position=element.position, direction=element.direction, angular=element.angular, size=size,
    )  # fmt: skip
    share.K = element.stiffness * np.outer(row, row)
    feels = guideway_inputs(element.name, element.to, element.direction, angular=element.angular)
    share.K_w = {key: element.stiffness * cosine * row for key, cosine in feels.items()}
    if element.lag == 0.0:
        share.C = element.damping * np.outer(row, row)
        share.C_w = {key: element.damping * cosine * row for key, cosine in feels.items()}
        return share
    share.internal = (f"{element.name}.lag",)
    share.A_internal = np.array([[-1.0 / element.lag]])
    share.G_v = row[None, :] / element.lag
    share.G_wv = {key: np.array([-cosine / element.lag]) for key, cosine in feels.items()}
    share.F = -element.damping * row[:, None]
    share.B_internal = np.zeros((1, 0))
    return share


def actuator_share(element: Actuator, found: Poses, *, pade_order: int, size: int) -> Share:
    """Command -> delay (Pade) -> first-order lag -> force."""
    share = Share(element.name, "actuator", size)
    row = stroke_row(
        found, element.body, element.to,
        position=element.position, direction=element.direction, angular=element.angular, size=size,
    )  # fmt: skip
    order = pade_order if element.delay > 0.0 else 0
    A, b, c, d = pade_delay(element.delay, order)
    share.inputs = (element.name,)
    delays = tuple(f"{element.name}.delay{i + 1}" for i in range(order))
    if element.bandwidth is None:
        share.internal, share.A_internal = delays, A
        share.F, share.B = np.outer(row, c), d * row[:, None]
        share.B_internal = b[:, None]
    else:
        w = element.bandwidth
        share.internal = (f"{element.name}.force", *delays)
        share.A_internal = np.block([[np.array([[-w]]), w * c[None, :]], [np.zeros((order, 1)), A]])
        share.F = np.hstack([row[:, None], np.zeros((size, order))])
        share.B, share.B_internal = np.zeros((size, 1)), np.concatenate([[w * d], b])[:, None]
    share.G_v = np.zeros((len(share.internal), size))
    return share


def aerodynamic_shares(vehicle: Vehicle, posture: Posture, found: Poses, size: int) -> list[Share]:
    """Slope 2 K_a v0 of the air drag at its point."""
    shares = []
    for push in longitudinal_forces(vehicle, posture):
        if push.drag_factor > 0.0:
            share = Share(push.name, "aerodynamics", size)
            row = point_jacobian(found[push.body], push.position, size=size)[0]
            share.C = 2.0 * push.drag_factor * posture.speed * np.outer(row, row)
            shares.append(share)
    return shares


def geometry_share(vehicle: Vehicle, posture: Posture, found: Poses, fields: MagnetField) -> Share:
    """Stiffness of every static point force at a turning point: magnets, preloads, thrust and air drag."""
    size = len(vehicle.dofs)
    share = Share("geometry", "geometry", size)

    def add(body: str, position: Vector, force: FloatArray) -> None:
        pose = found[body]
        share.K += geometric_stiffness(pose, pose.lever(position), force, size=size)

    for i, magnet in enumerate(vehicle.magnets):
        add(magnet.body, magnet.position, fields.force[i])
    for push in longitudinal_forces(vehicle, posture):
        add(push.body, push.position, np.array([push.at(posture.speed), 0.0, 0.0]))
    for element in vehicle.links:
        force = posture.static_forces.get(element.name, 0.0) * np.asarray(element.direction)
        if element.angular:
            continue
        add(element.body, element.position, force)
        if element.to != GUIDEWAY:
            add(element.to, element.position, -force)
    return share
