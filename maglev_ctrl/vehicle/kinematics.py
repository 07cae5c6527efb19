"""Where points of a vehicle are and how they move: its stance, with the Jacobians of all its points.

Coordinates are increments from a posture: translations of the centre of mass along the axes and small rotations
about the space axes. A posture itself may be turned by finite angles (its displacement holds rotation vectors), and
an increment turns it further by a finite rotation, so that forces and their linear models agree to first order
about any posture.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from maglev_ctrl.arrays import FloatArray, read_only_any, transpose
from maglev_ctrl.vehicle.structure import KEPT, structure
from maglev_ctrl.vehicle.vehicle import Vehicle


@dataclass(frozen=True, eq=False, slots=True)
class Stance:
    """A vehicle at one posture; points are those of its `Structure`.

    `displacement` (n,) m and rad; `rotation` (b, 3, 3) of the bodies; `lever` (k, 3) m from the centre of mass to each
    point, as turned; `shift` (k, 3) m of each point from the level posture; `jacobian` (k, 3, n);
    `magnet_shift` (m, 3) and `magnet_motion` (m, 3, n): the magnets' own, whose lateral parts ignore roll in the
    paper's kinematics; `stroke` (t, n) rows d stroke / d q of links, then sensors.
    """

    displacement: FloatArray
    rotation: FloatArray
    lever: FloatArray
    shift: FloatArray
    jacobian: FloatArray
    magnet_shift: FloatArray
    magnet_motion: FloatArray
    stroke: FloatArray

    @property
    def level(self) -> bool:
        """Whether it is the reference posture."""
        return not self.displacement.any()


def stance(vehicle: Vehicle, displacement: FloatArray, increment: FloatArray | None = None) -> Stance:
    """The vehicle at a posture, moved on by an increment of the coordinates.

    Parameters
    ----------
    displacement : (n,) posture; its rotations are rotation vectors, rad
    increment : (n,) from there

    Examples
    --------
    >>> from maglev_ctrl.vehicle.elements import Body
    >>> car = Body("car", 1.0, dofs=("heave",))
    >>> shuttle = Vehicle("shuttle", bodies=(car,), reference_height=0.1)
    >>> stance(shuttle, np.array([0.02])).shift[0].tolist()
    [0.0, 0.0, 0.02]
    """
    if increment is None:
        return _moved(vehicle, displacement) if displacement.any() else level_stance(vehicle)
    return _moved(vehicle, displacement, increment)


@lru_cache(maxsize=KEPT)
def level_stance(vehicle: Vehicle) -> Stance:
    """The vehicle in its reference posture; remembered, because most operating points are met in it."""
    return _moved(vehicle, np.zeros(len(vehicle.dofs)))


def _moved(vehicle: Vehicle, displacement: FloatArray, increment: FloatArray | None = None) -> Stance:
    known = structure(vehicle)
    posture = known.spread @ displacement
    step = np.zeros_like(posture) if increment is None else known.spread @ increment
    rotation = np.stack([rotation_matrix(s[3:]) @ rotation_matrix(p[3:]) for s, p in zip(step, posture, strict=True)])
    moved = (posture + step)[known.point_body]
    lever = (rotation[known.point_body] @ known.arm[:, :, None])[..., 0]
    shift = moved[:, :3] + lever - known.arm
    jacobian = rigid_motion(lever) @ known.pointwise
    magnet_shift, magnet_motion = shift[known.magnets], jacobian[known.magnets]
    if vehicle.kinematics == "paper":
        # Eq. 43: a lateral displacement that ignores roll.
        ahead = known.arm[known.magnets, 0]
        magnet_shift, magnet_motion = magnet_shift.copy(), magnet_motion.copy()
        magnet_shift[:, 1] = moved[known.magnets, 1] + moved[known.magnets, 5] * ahead
        sway, yaw = known.pointwise[known.magnets, 1], known.pointwise[known.magnets, 5]
        magnet_motion[:, 1] = sway + ahead[:, None] * yaw
    motion = np.where(known.angular[:, None, None], known.pointwise[known.own_ends, 3:], jacobian[known.own_ends])
    far = np.where(known.angular[:, None, None], known.pointwise[known.far_ends, 3:], jacobian[known.far_ends])
    relative = motion - known.apart[:, None, None] * far
    stroke = (known.direction[:, None, :] @ relative)[:, 0]
    return Stance(
        *(
            read_only_any(part)
            for part in (displacement, rotation, lever, shift, jacobian, magnet_shift, magnet_motion, stroke)
        )
    )


def stroke_between(vehicle: Vehicle, start: Stance, now: Stance, step: FloatArray) -> FloatArray:
    """Strokes of all links between two stances that are `step` (n,) apart; (l,) m, rad when angular."""
    known = structure(vehicle)
    links = len(known.links)
    travel = now.shift - start.shift
    relative = travel[known.own_ends] - known.apart[:, None] * travel[known.far_ends]
    along = np.einsum("ti,ti->t", known.direction, relative)[:links]
    return np.where(known.angular[:links], start.stroke[:links] @ step, along)


def geometric_stiffness(vehicle: Vehicle, at: Stance, force: FloatArray) -> FloatArray:
    """K_geo = -(r F^T - (r . F) I) of forces (k, 3) with space-fixed directions at turning points; (n, n)."""
    known = structure(vehicle)
    work = np.einsum("ki,ki->k", at.lever, force)
    local = work[:, None, None] * np.eye(3) - at.lever[:, :, None] * force[:, None, :]
    by_body = (known.on_body @ local.reshape(-1, 9)).reshape(-1, 3, 3)
    turns = known.spread[:, 3:]
    return np.asarray(np.sum(transpose(turns) @ by_body @ turns, axis=0))


def rotation_matrix(vector: FloatArray) -> FloatArray:
    """Finite rotation about a rotation vector (Rodrigues); (3, 3).

    Examples
    --------
    >>> rotation_matrix(np.array([0.0, 0.0, np.pi / 2])).round(12)[1, 0]
    np.float64(1.0)
    """
    if not np.any(vector):
        return np.eye(3)
    angle = float(np.linalg.norm(vector))
    cross = skew(vector)
    # sinc keeps the small-angle limit exact.
    first = np.sinc(angle / np.pi)
    second = 0.5 * np.sinc(angle / (2.0 * np.pi)) ** 2
    return np.asarray(np.eye(3) + first * cross + second * (cross @ cross))


def skew(vector: FloatArray) -> FloatArray:
    """Matrix of the cross product vector x ..., (3, 3)."""
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def rigid_motion(lever: FloatArray) -> FloatArray:
    """J = [I, -[r]x] of points at levers (k, 3) over their bodies' six freedoms (Sec. 2.3); (k, 3, 6)."""
    found = np.zeros((len(lever), 3, 6))
    x, y, z = lever.T
    found[:, 0, 0] = found[:, 1, 1] = found[:, 2, 2] = 1.0
    found[:, 0, 4], found[:, 0, 5] = z, -y
    found[:, 1, 3], found[:, 1, 5] = -z, x
    found[:, 2, 3], found[:, 2, 4] = y, -x
    return found
