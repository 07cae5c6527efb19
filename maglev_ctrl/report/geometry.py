"""The vehicle as boxes: outlines of its bodies, and where they go when a mode moves them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from maglev_ctrl.arrays import ComplexArray, FloatArray
from maglev_ctrl.vehicle import DOF_NAMES, GUIDEWAY, Vehicle

View = Literal["side", "front", "top"]
AXES: Final[dict[View, tuple[int, int]]] = {"side": (0, 2), "front": (1, 2), "top": (0, 1)}
_LEAST_HALF: Final = (1.0, 1.0, 0.45)  # m, of a body with nothing attached away from its centre
_CLEARANCE: Final = 0.8  # m between stacked boxes; both shrink with a vehicle smaller than that


@dataclass(frozen=True, eq=False, slots=True)
class Box:
    """A body's outline: centre and half sizes (3,) in m; heights are schematic where the model gives none."""

    body: str
    centre: FloatArray
    half: FloatArray
    magnets: FloatArray  # (k, 3) points under or beside the box


def boxes(vehicle: Vehicle) -> tuple[Box, ...]:
    """Outlines from where magnets and connections sit; bodies that would overlap are stacked, magnets at the bottom."""
    made: list[Box] = []
    scale = _scale(vehicle)
    least = scale * np.array(_LEAST_HALF)
    carries = {magnet.body for magnet in vehicle.magnets} | {c.body for c in vehicle.coefficient_elements}
    for body in sorted(vehicle.bodies, key=lambda b: b.name not in carries):
        centre = np.array(body.position, dtype=float)
        points = _attached(vehicle, body.name)
        reach = np.max(np.abs(points - centre), axis=0) if points.size else np.zeros(3)
        half = np.maximum(reach, least)
        if reach[0] > least[0]:
            half[0] = reach[0] * 1.06
        half[2] = min(half[2], 2.0 * least[2])
        for other in made:
            apart = np.abs(centre - other.centre)
            if np.all(apart[:2] < half[:2] + other.half[:2]) and apart[2] < half[2] + other.half[2] + 0.1 * scale:
                centre[2] = other.centre[2] + other.half[2] + half[2] + scale * _CLEARANCE
        magnets = np.array([m.position for m in vehicle.magnets if m.body == body.name], dtype=float).reshape(-1, 3)
        made.append(Box(body.name, centre, half, magnets))
    order = {body.name: i for i, body in enumerate(vehicle.bodies)}
    return tuple(sorted(made, key=lambda box: order[box.body]))


def _scale(vehicle: Vehicle) -> float:
    """1 for a vehicle of a metre or more, less for a smaller one: how far its parts are from its bodies' centres."""
    reach = 0.0
    for body in vehicle.bodies:
        points = _attached(vehicle, body.name)
        if points.size:
            reach = max(reach, float(np.max(np.abs(points - np.array(body.position)))))
    return min(1.0, 1.2 * reach) if reach > 0.0 else 1.0


def _attached(vehicle: Vehicle, body: str) -> FloatArray:
    ends = [(m.body, GUIDEWAY, m.position) for m in vehicle.magnets]
    ends += [(c.body, c.to, c.position) for c in vehicle.connections]
    ends += [(a.body, a.to, a.position) for a in vehicle.actuators]
    points = [position for one, other, position in ends if body in (one, other)]
    return np.array(points, dtype=float).reshape(-1, 3)


def motion(vehicle: Vehicle, shape: ComplexArray, body: str) -> tuple[ComplexArray, ComplexArray]:
    """Translation (3,) and rotation (3,) of one body in a mode shape (n,) over the vehicle's coordinates."""
    values = np.zeros(6, dtype=complex)
    for place, name in enumerate(vehicle.dofs):
        owner, _, dof = name.rpartition(".")
        if owner == body:
            values[DOF_NAMES.index(dof)] = shape[place]
    return values[:3], values[3:]


def corners(box: Box, view: View) -> FloatArray:
    """Corners (4, 3) of the box's outline in a view, through its centre in the direction of sight."""
    first, second = AXES[view]
    points = np.tile(box.centre, (4, 1))
    points[:, first] += box.half[first] * np.array([-1.0, 1.0, 1.0, -1.0])
    points[:, second] += box.half[second] * np.array([-1.0, -1.0, 1.0, 1.0])
    return points


def displacement(box: Box, points: FloatArray, moved: tuple[ComplexArray, ComplexArray]) -> ComplexArray:
    """Displacement (k, 3) of points of a body: translation plus rotation times lever arm."""
    translation, rotation = moved
    return translation + np.cross(np.broadcast_to(rotation, points.shape), points - box.centre)


def best_view(vehicle: Vehicle, outline: tuple[Box, ...], shape: ComplexArray) -> View:
    """The view in which the corners of the boxes move most; the side view unless another shows clearly more."""
    seen: dict[View, float] = {}
    for view, axes in AXES.items():
        total = 0.0
        for box in outline:
            moved = displacement(box, corners(box, view), motion(vehicle, shape, box.body))
            total += float(np.sum(np.abs(moved[:, list(axes)]) ** 2))
        seen[view] = total
    return clearest_view(seen)


def clearest_view(seen: Mapping[View, float]) -> View:
    """The view with the largest motion; the side view unless another shows clearly more.

    Examples
    --------
    >>> clearest_view({"side": 1.0, "front": 1.1, "top": 0.0}), clearest_view({"side": 1.0, "front": 2.0, "top": 0.0})
    ('side', 'front')
    """
    best = max(seen, key=lambda view: seen[view])
    return best if seen[best] > 1.2 * seen["side"] else "side"


def bounds(outline: tuple[Box, ...]) -> tuple[FloatArray, FloatArray]:
    """Lowest and highest coordinates (3,) of all boxes, m."""
    low = np.min([box.centre - box.half for box in outline], axis=0)
    high = np.max([box.centre + box.half for box in outline], axis=0)
    return np.asarray(low), np.asarray(high)


def metre(low: FloatArray, high: FloatArray) -> float:
    """The unit of schematic sizes: a metre, or less for a vehicle of a metre or less."""
    return min(1.0, 0.5 * float(np.max(high - low)))


def at_largest(vehicle: Vehicle, outline: tuple[Box, ...], shape: ComplexArray, view: View) -> ComplexArray:
    """The shape scaled to largest corner displacement 1 and turned in phase so that its real part is largest."""
    moved = np.concatenate([displacement(b, corners(b, view), motion(vehicle, shape, b.body)) for b in outline])
    return np.asarray(shape * to_largest(moved[:, list(AXES[view])].ravel()))


def to_largest(seen: ComplexArray) -> complex:
    """The factor that makes the largest of the displacements (k,) one and their real parts as large as can be.

    Examples
    --------
    >>> bool(np.isclose(to_largest(np.array([2j, 1j])) * 2j, 1.0))
    True
    """
    size = float(np.max(np.abs(seen), initial=0.0)) or 1.0
    return complex(np.exp(-0.5j * np.angle(np.sum(seen**2))) / size)
