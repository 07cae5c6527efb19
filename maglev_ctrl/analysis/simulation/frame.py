"""Where the points of a vehicle are, how they move, and what forces at them push: batched over runs.

A vehicle with its geometric stiffness on turns by finite rotations about its equilibrium, as `kinematics.stance` does
for one posture; without it (or without rotations) its levers stay those of the equilibrium.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from maglev_ctrl.arrays import FloatArray, read_only_any
from maglev_ctrl.vehicle import Vehicle
from maglev_ctrl.vehicle.kinematics import stance
from maglev_ctrl.vehicle.structure import structure

_CROSS = np.array(
    [[[0, 0, 0], [0, 0, -1], [0, 1, 0]], [[0, 0, 1], [0, 0, 0], [-1, 0, 0]], [[0, -1, 0], [1, 0, 0], [0, 0, 0]]],
    dtype=np.float64,
)
"""phi_k _CROSS[k] is the matrix of phi x ...; (3, 3, 3)."""

_FIVE = [0, 1, 2, 0, 1]


@dataclass(frozen=True, eq=False, slots=True)
class Frame:
    """The points of a vehicle about one posture: m magnets, then p pushes, then own and far ends of l links.

    `carried` (n, 3 k) and `turned` (n, 5 k): translation and rotation of each point's body over the coordinates;
    `lever` (5, k) m in the posture; `rotated` (9 b, 5 k): what the bodies' rotation matrices make of the levers;
    `turns` (n, 3 b). Of five rows x, y, z, x, y two shifted slices make a vector product without a copy.
    `shift` (3, k) of the posture itself; `plain` (n, 3 k): all motion of the points with the levers of the posture.
    `turning`: whether levers turn; `twists`: whether a link is angular. `sway_rows` (n, m): the lateral motion of the
    magnets in the paper's kinematics, which ignores roll; None where it is the points' own.
    `ends` (3 k, l): strokes of the points' displacements; `pull` (l, 5 k): forces on the points of the links' tensions.
    """

    carried: FloatArray
    turned: FloatArray
    lever: FloatArray
    rotated: FloatArray
    turns: FloatArray
    shift: FloatArray
    plain: FloatArray
    turning: bool
    twists: bool
    magnets: int
    pushes: int
    links: int
    sway_rows: FloatArray | None
    sway_shift: FloatArray
    ends: FloatArray
    pull: FloatArray
    angular_rows: FloatArray

    @classmethod
    def of(cls, vehicle: Vehicle, displacement: FloatArray) -> Frame:
        """The frame about a posture, (n,)."""
        known, here = structure(vehicle), stance(vehicle, displacement)
        links = len(known.links)
        chosen = np.concatenate(
            [
                np.arange(len(here.lever))[known.magnets],
                np.arange(len(here.lever))[known.pushes],
                np.arange(len(here.lever))[known.own_ends][:links],
                np.arange(len(here.lever))[known.far_ends][:links],
            ]
        )
        n, k, b = len(known.dofs), len(chosen), len(vehicle.bodies)
        pointwise = known.pointwise[chosen]  # (k, 6, n)
        lever = here.lever[chosen].T
        rotated = np.zeros((b, 3, 3, 3, k))  # body, row, column of its rotation, axis of the point, point
        for point, body in enumerate(known.point_body[chosen]):
            for axis in range(3):
                rotated[body, axis, :, axis, point] = lever[:, point]
        turns = np.moveaxis(known.spread[:, 3:], -1, 0)
        paper = vehicle.kinematics == "paper"
        m = len(known.count)
        own = m + len(known.drag_factor)
        direction = known.direction[:links].T * ~known.angular[:links]
        ends = np.zeros((3, k, links))
        for link in range(links):
            ends[:, own + link, link] = direction[:, link]
            ends[:, own + links + link, link] = -known.apart[link] * direction[:, link]
        return cls(
            carried=read_only_any(pointwise[:, :3].transpose(2, 1, 0).reshape(n, 3 * k)),
            turned=read_only_any(pointwise[:, 3:].transpose(2, 1, 0)[:, _FIVE].reshape(n, 5 * k)),
            lever=read_only_any(lever[_FIVE]),
            rotated=read_only_any(rotated[:, :, :, _FIVE].reshape(9 * b, 5 * k)),
            turns=read_only_any(turns.reshape(n, 3 * b)),
            shift=read_only_any(here.shift[chosen].T),
            plain=read_only_any(here.jacobian[chosen].transpose(2, 1, 0).reshape(n, 3 * k)),
            twists=bool(np.any(known.angular[:links])),
            turning=bool(vehicle.geometric_stiffness and np.any(turns)),
            magnets=m,
            pushes=len(known.drag_factor),
            links=links,
            sway_rows=read_only_any(here.magnet_motion[:, 1].T) if paper else None,
            sway_shift=read_only_any(here.magnet_shift[:, 1]),
            ends=read_only_any(ends.reshape(3 * k, links)),
            pull=read_only_any(ends[_FIVE].reshape(5 * k, links).T),
            angular_rows=read_only_any((here.stroke[:links] * known.angular[:links, None]).T),
        )

    def levers(self, q: FloatArray) -> tuple[FloatArray, FloatArray | None]:
        """Levers (5, k) or (r, 5, k) at increments (r, n), and how far they are from those of the posture."""
        if not self.turning:
            return self.lever, None
        b = self.turns.shape[1] // 3
        vector = (q @ self.turns).reshape(-1, b, 3)
        angle = np.sqrt(np.einsum("rbi,rbi->rb", vector, vector))
        cross = (vector @ _CROSS.reshape(3, 9)).reshape(-1, b, 3, 3)
        safe = np.maximum(angle, 1e-150)  # the quotients keep the small-angle limit
        first = (np.sin(safe) / safe)[..., None, None]
        second = (2.0 * (np.sin(0.5 * safe) / safe) ** 2)[..., None, None]
        rotation = first * cross + second * (cross @ cross)
        turned = (rotation.reshape(len(q), 9 * b) @ self.rotated).reshape(len(q), 5, -1)
        return self.lever + turned, turned

    def moved(self, q: FloatArray, turned: FloatArray | None) -> FloatArray:
        """Displacement of the points from the posture, (r, 3, k)."""
        if turned is None:
            return np.asarray((q @ self.plain).reshape(len(q), 3, -1))
        return np.asarray((q @ self.carried).reshape(len(q), 3, -1) + turned[:, :3])

    def velocities(self, v: FloatArray, lever: FloatArray) -> FloatArray:
        """Velocities of the points, (r, 3, k)."""
        if not self.turning:
            return np.asarray((v @ self.plain).reshape(len(v), 3, -1))
        moved = (v @ self.carried).reshape(len(v), 3, -1)
        return np.asarray(moved + _crossed((v @ self.turned).reshape(len(v), 5, -1), lever))

    def gathered(self, force: FloatArray, lever: FloatArray) -> FloatArray:
        """Generalised force (r, n) of forces (r, 5, k) at the points."""
        r = len(force)
        direct = force[:, :3].reshape(r, -1)
        if not self.turning:
            return np.asarray(direct @ self.plain.T)
        moment = _crossed(lever, force)
        k = force.shape[-1]
        return np.asarray(direct @ self.carried.T + moment.reshape(r, -1) @ self.turned[:, : 3 * k].T)


def _crossed(a: FloatArray, b: FloatArray) -> FloatArray:
    """a x b, (..., 3, k) of rows x, y, z, x, y, (..., 5, k) each."""
    return np.asarray(a[..., 1:4, :] * b[..., 2:5, :] - a[..., 2:5, :] * b[..., 1:4, :])
