"""What of a vehicle does not depend on its posture, gathered once per vehicle as arrays.

A study asks for the same vehicle's equilibrium and linear model at hundreds of operating points; its points,
directions and incidence are the same at all of them. Vehicles never change, so the record is kept per vehicle.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from itertools import accumulate, pairwise

import numpy as np
from numpy.typing import NDArray

from maglev_ctrl.arrays import FloatArray, read_only_any
from maglev_ctrl.forces.base import AbstractForceModel
from maglev_ctrl.forces.electromagnet import Electromagnet
from maglev_ctrl.vehicle.elements import DOF_NAMES, GUIDEWAY, Actuator, Body, Sensor, SpringDamper, Vector
from maglev_ctrl.vehicle.vehicle import Vehicle

KEPT = 32
"""Vehicles remembered at a time: an option's vehicle at each payload, and a few more."""


@dataclass(frozen=True, eq=False, slots=True)
class MagnetGroup:
    """Magnets that share a force model; `blind` when the model knows no gap and none of them faces a wall.

    An electromagnet stands here without its flux limit: that holds at the strength of a posture (`Structure.limited`).
    """

    force: AbstractForceModel
    members: NDArray[np.int64]
    blind: bool


@dataclass(frozen=True, eq=False, slots=True)
class Structure:
    """Points and incidence of a vehicle with n coordinates, b bodies, m magnets, l links (connections, actuators).

    `columns`, `axes`: coordinates of each body, and the freedoms out of `DOF_NAMES` they are; `spread` (b, 6, n) the
    same as zeros and ones; `masses` (b,) kg; `carriers`: bodies of the magnets.

    Points stand one after another: magnets, centres of mass, points where air drag and thrust act ("pushes"), own
    ends of links and sensors ("strokes", links first), their far ends. `point_body` (k,) and `arm` (k, 3) m from the
    centre of mass of that body; `on_body` (b, k) ones where a point belongs to a body; `pointwise` (k, 6, n) is
    `spread` of each point's body. `direction` (t, 3), `angular` (t,), `apart` (t,) 1 where a stroke's far end is a
    body and 0 where it is the guideway or nothing.
    """

    dofs: tuple[str, ...]
    index: Mapping[str, int]
    columns: tuple[tuple[int, ...], ...]
    axes: tuple[tuple[int, ...], ...]
    spread: FloatArray
    masses: FloatArray
    force_scale: FloatArray
    """Weight for forces, weight times the largest lever for moments; (n,)."""
    magnets: slice
    centres: slice
    pushes: slice
    own_ends: slice
    far_ends: slice
    point_body: NDArray[np.int64]
    arm: FloatArray
    on_body: FloatArray
    pointwise: FloatArray
    groups: tuple[MagnetGroup, ...]
    carriers: tuple[str, ...]
    count: FloatArray
    side: FloatArray
    upward: FloatArray
    """What a magnet's height gains where it rises: 1 over the guideway, -1 under a rail, (m,)."""
    limited: tuple[tuple[Electromagnet, NDArray[np.int64]], ...]
    """Electromagnets whose iron saturates, with their members."""
    push_body: tuple[str, ...]
    drag_factor: FloatArray
    links: tuple[SpringDamper | Actuator, ...]
    direction: FloatArray
    angular: NDArray[np.bool_]
    apart: FloatArray
    link_stiffness: FloatArray
    link_damping: FloatArray
    """Of connections without a lag; zero otherwise, (l,) N s/m."""
    static_stiffness: FloatArray
    """With which links share static loads; (l,) N/m."""


@lru_cache(maxsize=KEPT)
def structure(vehicle: Vehicle) -> Structure:
    """The vehicle's points and incidence.

    Examples
    --------
    >>> shuttle = Vehicle("shuttle", bodies=(Body("car", 1.0, dofs=("heave", "pitch")),), reference_height=0.1)
    >>> structure(shuttle).spread[0, :, 0].tolist()
    [0.0, 0.0, 1.0, 0.0, 0.0, 0.0]
    """
    dofs = vehicle.dofs
    index = {body.name: i for i, body in enumerate(vehicle.bodies)}
    columns, axes, spread = _incidence(vehicle.bodies, len(dofs))
    strokes: tuple[SpringDamper | Actuator | Sensor, ...] = (*vehicle.links, *vehicle.sensors)
    apart = [stroke.to is not None and stroke.to != GUIDEWAY for stroke in strokes]
    pushes = _push_points(vehicle)
    points = [
        [(magnet.body, magnet.position) for magnet in vehicle.magnets],
        [(body.name, body.position) for body in vehicle.bodies],
        pushes,
        [(stroke.body, stroke.position) for stroke in strokes],
        # A far end on the guideway is never read; it borrows the own end's body.
        [(str(x.to) if far else x.body, x.position) for x, far in zip(strokes, apart, strict=True)],
    ]
    slices = [slice(a, b) for a, b in pairwise([0, *accumulate(len(group) for group in points)])]
    body = np.array([index[name] for group in points for name, _ in group], dtype=np.int64)
    centres = np.array([b.position for b in vehicle.bodies])
    arm = np.array([place for group in points for _, place in group]) - centres[body]
    springs = np.array([link.stiffness if isinstance(link, SpringDamper) else 0.0 for link in vehicle.links])
    bias = np.array([link.static_stiffness if isinstance(link, Actuator) else 0.0 for link in vehicle.links])
    return Structure(
        dofs=dofs,
        index=index,
        columns=columns,
        axes=axes,
        spread=read_only_any(spread),
        masses=read_only_any([b.mass for b in vehicle.bodies]),
        force_scale=read_only_any(_force_scale(vehicle)),
        magnets=slices[0],
        centres=slices[1],
        pushes=slices[2],
        own_ends=slices[3],
        far_ends=slices[4],
        point_body=read_only_any(body),
        arm=read_only_any(arm),
        on_body=read_only_any((body[None, :] == np.arange(len(vehicle.bodies))[:, None]).astype(np.float64)),
        pointwise=read_only_any(spread[body]),
        groups=_groups(vehicle),
        carriers=tuple(magnet.body for magnet in vehicle.magnets),
        count=read_only_any(np.array([magnet.count for magnet in vehicle.magnets], dtype=np.float64)),
        side=read_only_any(np.array([magnet.side for magnet in vehicle.magnets], dtype=np.float64)),
        upward=read_only_any(np.array([-1.0 if magnet.force.hangs else 1.0 for magnet in vehicle.magnets])),
        limited=_limited(vehicle),
        push_body=tuple(name for name, _ in pushes),
        drag_factor=read_only_any([*(air.drag_factor for air in vehicle.aerodynamics), *(0.0 for _ in index)]),
        links=vehicle.links,
        direction=read_only_any(np.array([stroke.direction for stroke in strokes]).reshape(len(strokes), 3)),
        angular=read_only_any(np.array([stroke.angular for stroke in strokes], dtype=bool)),
        apart=read_only_any(np.array(apart, dtype=np.float64)),
        link_stiffness=read_only_any(springs),
        link_damping=read_only_any(np.array([_direct_damping(link) for link in vehicle.links])),
        static_stiffness=read_only_any(springs + bias),
    )


def _incidence(
    bodies: tuple[Body, ...], n: int
) -> tuple[tuple[tuple[int, ...], ...], tuple[tuple[int, ...], ...], FloatArray]:
    """Columns and axes of each body, and both as zeros and ones (b, 6, n)."""
    columns: list[tuple[int, ...]] = []
    axes: list[tuple[int, ...]] = []
    spread = np.zeros((len(bodies), 6, n))
    start = 0
    for i, body in enumerate(bodies):
        axes.append(tuple(DOF_NAMES.index(dof) for dof in body.dofs))
        columns.append(tuple(range(start, start + len(body.dofs))))
        spread[i, list(axes[-1]), list(columns[-1])] = 1.0
        start += len(body.dofs)
    return tuple(columns), tuple(axes), spread


def _push_points(vehicle: Vehicle) -> list[tuple[str, Vector]]:
    """Where the air drags, then where thrust pushes each body."""
    centres = {body.name: body.position for body in vehicle.bodies}
    thrust = centres | dict(vehicle.thrust_positions)
    air = [(a.body, centres[a.body] if a.position is None else a.position) for a in vehicle.aerodynamics]
    return [*air, *((name, thrust[name]) for name in centres)]


def _groups(vehicle: Vehicle) -> tuple[MagnetGroup, ...]:
    found: dict[tuple[int, bool], tuple[AbstractForceModel, list[int]]] = {}
    for i, magnet in enumerate(vehicle.magnets):
        blind = magnet.side == 0 and magnet.force.domain.gap is None
        found.setdefault((id(magnet.force), blind), (magnet.force, []))[1].append(i)
    return tuple(
        MagnetGroup(
            force.unlimited() if isinstance(force, Electromagnet) else force,
            read_only_any(np.array(members, dtype=np.int64)),
            blind,
        )
        for (_, blind), (force, members) in found.items()
    )


def _limited(vehicle: Vehicle) -> tuple[tuple[Electromagnet, NDArray[np.int64]], ...]:
    found: dict[int, tuple[Electromagnet, list[int]]] = {}
    for i, magnet in enumerate(vehicle.magnets):
        if isinstance(magnet.force, Electromagnet) and magnet.force.flux_limit is not None:
            found.setdefault(id(magnet.force), (magnet.force, []))[1].append(i)
    return tuple((force, read_only_any(np.array(members, dtype=np.int64))) for force, members in found.values())


def _direct_damping(link: SpringDamper | Actuator) -> float:
    return link.damping if isinstance(link, SpringDamper) and link.lag == 0.0 else 0.0


def _force_scale(vehicle: Vehicle) -> FloatArray:
    weight = vehicle.mass * max(vehicle.gravity, 1e-300)
    points = [*(magnet.position for magnet in vehicle.magnets), *(link.position for link in vehicle.links)]
    reach = max((float(np.linalg.norm(p)) for p in points), default=0.0) or 1.0
    turning = [name.rsplit(".", 1)[1] in ("roll", "pitch", "yaw") for name in vehicle.dofs]
    return np.where(turning, weight * reach, weight)
