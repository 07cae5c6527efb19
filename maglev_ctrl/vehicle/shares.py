"""The share of each element in the linear model: its M, C, K, internal states, inputs and guideway terms.

Most shares follow from the stance alone; those of magnets, air drag and turning forces depend on the operating point
too, and come as stacks over all elements of a kind.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from maglev_ctrl.arrays import FloatArray, transpose
from maglev_ctrl.systems.second_order import ContributionKind
from maglev_ctrl.vehicle.elements import GUIDEWAY, Actuator, CoefficientElement, SpringDamper, Vector
from maglev_ctrl.vehicle.kinematics import Stance, geometric_stiffness
from maglev_ctrl.vehicle.loads import MagnetField, longitudinal_forces
from maglev_ctrl.vehicle.operating import Posture
from maglev_ctrl.vehicle.pade import pade_delay
from maglev_ctrl.vehicle.structure import structure
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


def body_shares(vehicle: Vehicle, here: Stance) -> list[Share]:
    """Masses and inertias, turned with the bodies."""
    known = structure(vehicle)
    shares = []
    for body, rotation, spread in zip(vehicle.bodies, here.rotation, known.spread, strict=True):
        share = Share(body.name, "body", len(known.dofs))
        local = np.zeros((6, 6))
        local[:3, :3] = body.mass * np.eye(3)
        local[3:, 3:] = rotation @ body.inertia_matrix @ rotation.T
        share.M = spread.T @ local @ spread
        shares.append(share)
    return shares


def magnet_stiffness(fields: MagnetField) -> FloatArray:
    """K = -J^T S J of every magnet (Sec. 2.3); (m, n, n)."""
    return np.asarray(-transpose(fields.jacobian) @ fields.by_position @ fields.motion)


def magnet_damping(fields: MagnetField) -> FloatArray:
    """C = -J^T D J of every magnet, and the lateral damping of its drag; (m, n, n)."""
    # The speed enters with the magnet's own motion, rise and sway with what the kinematics makes of them.
    moving = fields.motion.copy()
    moving[:, 0] = fields.jacobian[:, 0]
    sway = fields.motion[:, 1]
    following = fields.drag_direction[:, None, None] * (sway[:, :, None] * sway[:, None, :])
    return np.asarray(-transpose(fields.jacobian) @ fields.by_velocity @ moving + following)


def coefficient_share(element: CoefficientElement, vehicle: Vehicle, *, speed: float) -> Share:
    """Measured matrices of a body; the guideway's acceleration acting on M_m is left out."""
    known = structure(vehicle)
    size = len(known.dofs)
    share = Share(element.name, "magnet", size)
    table, body = element.table.at(speed), known.index[element.body]
    columns, axes = list(known.columns[body]), list(known.axes[body])
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


def spring_damper_share(element: SpringDamper, row: FloatArray) -> Share:
    """Spring and damper with a stroke row (n,); a lag makes the damper's velocity an internal state (it pushes -c)."""
    share = Share(element.name, "spring_damper", len(row))
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


def actuator_share(element: Actuator, row: FloatArray, *, pade_order: int) -> Share:
    """Command -> delay (Pade) -> first-order lag -> force along a stroke row (n,)."""
    size = len(row)
    share = Share(element.name, "actuator", size)
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


def aerodynamic_damping(vehicle: Vehicle, posture: Posture, here: Stance) -> FloatArray:
    """Slope 2 K_a v0 of the air drag at each of its points, as damping; (air, n, n)."""
    known = structure(vehicle)
    air = len(vehicle.aerodynamics)
    row = here.jacobian[known.pushes, 0][:air]
    slope = 2.0 * known.drag_factor[:air] * posture.speed
    return np.asarray(slope[:, None, None] * (row[:, :, None] * row[:, None, :]))


def turning_stiffness(vehicle: Vehicle, posture: Posture, here: Stance, fields: MagnetField) -> FloatArray:
    """Stiffness of every static point force at a turning point: magnets, preloads, thrust and air drag; (n, n)."""
    known = structure(vehicle)
    force = np.zeros_like(here.lever)
    force[known.magnets] = fields.force
    force[known.pushes, 0] = longitudinal_forces(vehicle, posture, posture.speed)
    links = len(known.links)
    # A torque has no lever; sensors, after the links, push nothing.
    tension = np.array([posture.static_forces.get(link.name, 0.0) for link in known.links])
    along = np.where(known.angular[:links], 0.0, tension)[:, None] * known.direction[:links]
    own, far = known.own_ends.start, known.far_ends.start
    force[own : own + links] = along
    force[far : far + links] = -known.apart[:links, None] * along
    return geometric_stiffness(vehicle, here, force)
