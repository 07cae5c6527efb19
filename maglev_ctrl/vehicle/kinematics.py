"""Where points of a vehicle are and how they move: poses of the bodies and Jacobians of points.

Coordinates are increments from a posture: translations of the centre of mass along the axes and small rotations
about the space axes. A posture itself may be turned by finite angles (its displacement holds rotation vectors), and
an increment turns it further by a finite rotation, so that forces and their linear models agree to first order
about any posture.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.vehicle.elements import DOF_NAMES, GUIDEWAY, Body, Vector
from maglev_ctrl.vehicle.vehicle import Vehicle


@dataclass(frozen=True, eq=False, slots=True)
class Pose:
    """Where a body is: translation (3,) m, rotation (3, 3), its coordinates' columns and the axes they move."""

    body: Body
    columns: tuple[int, ...]
    axes: tuple[int, ...]
    translation: FloatArray
    rotation: FloatArray
    yaw: float
    """Sum of the yaw angles; only the paper's lateral kinematics asks for it."""

    def lever(self, point: Vector) -> FloatArray:
        """From the centre of mass to a point given in the vehicle frame, as turned; (3,) m."""
        return self.rotation @ self.arm(point)

    def arm(self, point: Vector) -> FloatArray:
        """From the centre of mass to a point before turning; (3,) m."""
        return np.subtract(point, self.body.position)

    def shift(self, point: Vector) -> FloatArray:
        """Displacement of a point from the reference posture; (3,) m."""
        arm = self.arm(point)
        return self.translation + self.rotation @ arm - arm


Poses = dict[str, Pose]


def poses(vehicle: Vehicle, displacement: FloatArray, increment: FloatArray | None = None) -> Poses:
    """Poses of every body at a posture, moved on by an increment of the coordinates.

    Parameters
    ----------
    displacement : (n,) posture; its rotations are rotation vectors, rad
    increment : (n,) from there

    Examples
    --------
    >>> car = Body("car", 1.0, dofs=("heave",))
    >>> shuttle = Vehicle("shuttle", bodies=(car,), reference_height=0.1)
    >>> poses(shuttle, np.array([0.02]))["car"].translation.tolist()
    [0.0, 0.0, 0.02]
    """
    found: Poses = {}
    start = 0
    for body in vehicle.bodies:
        axes = tuple(DOF_NAMES.index(dof) for dof in body.dofs)
        columns = tuple(range(start, start + len(axes)))
        start += len(axes)
        posture, step = np.zeros(6), np.zeros(6)
        posture[list(axes)] = displacement[list(columns)]
        if increment is not None:
            step[list(axes)] = increment[list(columns)]
        turned = rotation_matrix(step[3:]) @ rotation_matrix(posture[3:])
        found[body.name] = Pose(body, columns, axes, posture[:3] + step[:3], turned, float(posture[5] + step[5]))
    return found


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


def point_jacobian(pose: Pose, point: Vector, *, size: int) -> FloatArray:
    """J = [I, -[r]x] of a point over all `size` coordinates (Sec. 2.3 of the theory); (3, size)."""
    return _spread(pose, _rigid_motion(pose.lever(point)), size)


def paper_jacobian(pose: Pose, point: Vector, *, size: int) -> FloatArray:
    """The same with a lateral displacement that ignores roll, as the paper's Eq. 43; (3, size)."""
    local = _rigid_motion(pose.lever(point))
    local[1] = [0.0, 1.0, 0.0, 0.0, 0.0, pose.arm(point)[0]]
    return _spread(pose, local, size)


def paper_sway(pose: Pose, point: Vector) -> float:
    """Lateral displacement that ignores roll, m."""
    return float(pose.translation[1] + pose.yaw * pose.arm(point)[0])


def rotation_jacobian(pose: Pose, *, size: int) -> FloatArray:
    """Rotation of a body over all coordinates; (3, size)."""
    return _spread(pose, np.hstack([np.zeros((3, 3)), np.eye(3)]), size)


def stroke_row(
    found: Poses, body: str, to: str | None, *, position: Vector, direction: Vector, angular: bool, size: int
) -> FloatArray:
    """Row d stroke / d q of an element between two bodies, or a body and the guideway; (size,)."""

    def row(name: str) -> FloatArray:
        pose = found[name]
        local = rotation_jacobian(pose, size=size) if angular else point_jacobian(pose, position, size=size)
        return np.asarray(direction) @ local

    own = row(body)
    return own if to is None or to == GUIDEWAY else own - row(to)


def geometric_stiffness(pose: Pose, lever: FloatArray, force: FloatArray, *, size: int) -> FloatArray:
    """K_geo = -(r F^T - (r . F) I) of a force with a space-fixed direction at a turning point; (size, size)."""
    local = np.zeros((6, 6))
    local[3:, 3:] = -(np.outer(lever, force) - float(lever @ force) * np.eye(3))
    total = np.zeros((size, size))
    total[np.ix_(pose.columns, pose.columns)] = local[np.ix_(pose.axes, pose.axes)]
    return total


def _rigid_motion(lever: FloatArray) -> FloatArray:
    """[I, -[r]x]; (3, 6)."""
    x, y, z = lever
    return np.array([[1.0, 0.0, 0.0, 0.0, z, -y], [0.0, 1.0, 0.0, -z, 0.0, x], [0.0, 0.0, 1.0, y, -x, 0.0]])


def _spread(pose: Pose, local: FloatArray, size: int) -> FloatArray:
    total = np.zeros((3, size))
    # A body's columns stand side by side.
    start = pose.columns[0] if pose.columns else 0
    total[:, start : start + len(pose.columns)] = local[:, pose.axes]
    return total
