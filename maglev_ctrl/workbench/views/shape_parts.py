"""The vehicle in a mode as points at rest and how far each one moves: what the browser needs to animate it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from maglev_ctrl.arrays import ComplexArray, FloatArray
from maglev_ctrl.report.geometry import (
    AXES,
    Box,
    View,
    at_largest,
    best_view,
    bounds,
    boxes,
    corners,
    displacement,
    metre,
    motion,
)
from maglev_ctrl.vehicle import GUIDEWAY, Vehicle

_ZIGZAG = 9  # points of a spring
_BOX, _MAGNET, _SPRING, _ACTUATOR = "box", "magnet", "spring", "actuator"
AXIS_WORDS = {
    "side": ("along the track (m)", "seen from the side"), "front": ("across the track (m)", "seen from ahead"),
    "top": ("along the track (m)", "seen from above"),
}  # fmt: skip


@dataclass(frozen=True, eq=False, slots=True)
class Part:
    """A polygon (a box) or a stroke: `rest` (k, 2) m, `moved` (k, 2) complex displacement of unit amplitude, m."""

    kind: str
    name: str
    colour: int
    rest: FloatArray
    moved: ComplexArray


@dataclass(frozen=True, eq=False, slots=True)
class MovingShape:
    """One mode on the vehicle: its parts, the view they are seen in, the rail and the window, in m."""

    view: View
    parts: tuple[Part, ...]
    rail: FloatArray
    window: tuple[float, float, float, float]


def moving_shape(vehicle: Vehicle, shape: ComplexArray) -> MovingShape:
    """The vehicle's parts in the view in which the mode moves most.

    Parameters
    ----------
    shape : (n,) over the vehicle's coordinates
    """
    outline = boxes(vehicle)
    view = best_view(vehicle, outline, shape)
    turned = at_largest(vehicle, outline, shape, view)
    low, high = bounds(outline)
    unit, span = metre(low, high), high - low
    first, second = AXES[view]
    stretch = np.zeros(3)
    stretch[first], stretch[second] = 0.05 * span[first], 0.16 * max(span[second], unit)
    level = float(low[second]) - 0.9 * unit
    scene = _Scene(vehicle, {box.body: box for box in outline}, turned, view, stretch, unit, level)
    parts = [scene.box(box, i) for i, box in enumerate(outline)]
    if view != "top":
        parts += [part for box in outline for part in scene.magnets(box)]
        parts += scene.links()
    margin = 0.08 * float(span[first])
    left, right = float(low[first]) - margin, float(high[first]) + margin
    room = 0.24 * max(float(span[second]), unit)
    bottom = level - 0.2 * unit if view != "top" else float(low[second]) - room
    rail = np.array([[left, level], [right, level]]) if view != "top" else np.zeros((0, 2))
    return MovingShape(view, tuple(parts), rail, (left, right, bottom, float(high[second]) + room))


@dataclass(frozen=True, eq=False, slots=True)
class _Scene:
    """A vehicle in one mode and one view."""

    vehicle: Vehicle
    outline: dict[str, Box]
    shape: ComplexArray
    view: View
    stretch: FloatArray
    unit: float
    level: float

    def _moved(self, box: Box, points: FloatArray) -> ComplexArray:
        first, second = AXES[self.view]
        found = self.stretch * displacement(box, points, motion(self.vehicle, self.shape, box.body))
        return np.asarray(found[:, [first, second]])

    def _seen(self, points: FloatArray) -> FloatArray:
        return np.asarray(points[:, list(AXES[self.view])])

    def box(self, box: Box, place: int) -> Part:
        at = corners(box, self.view)
        return Part(_BOX, box.body, place, self._seen(at), self._moved(box, at))

    def magnets(self, box: Box) -> list[Part]:
        """Short strokes below a box, moved with it."""
        if not box.magnets.size:
            return []
        first, second = AXES[self.view]
        base = np.tile(box.centre, (len(np.unique(box.magnets[:, first])), 1))
        base[:, first], base[:, second] = np.unique(box.magnets[:, first]), box.centre[second] - box.half[second]
        rest, moved = self._seen(base), self._moved(box, base)
        down = np.array([0.0, -0.35 * self.unit])
        return [
            Part(_MAGNET, box.body, 0, np.stack([point, point + down]), np.stack([step, step]))
            for point, step in zip(rest, moved, strict=True)
        ]

    def links(self) -> list[Part]:
        """Springs and actuators between the near faces of two boxes, or between a box and the rail; seen once each."""
        found: list[Part] = []
        seen: set[tuple[object, ...]] = set()
        for kind, links in ((_SPRING, self.vehicle.connections), (_ACTUATOR, self.vehicle.actuators)):
            for one in links:
                at = float(one.position[AXES[self.view][0]])
                key = (kind, *sorted((one.body, one.to)), round(at, 6))
                if one.angular or key in seen or one.body not in self.outline:
                    continue
                seen.add(key)  # twins on both sides of the vehicle cover each other
                # An actuator beside a spring stands a little aside, so that both are seen.
                found.append(self._link(kind, one.name, one.body, one.to, at))
        return found

    def _link(self, kind: str, name: str, body: str, to: str, at: float) -> Part:
        start, end = self.outline[body], self.outline.get(to)
        second = AXES[self.view][1]
        aside = at + (0.5 * self.unit if kind == _ACTUATOR else 0.0)
        if end is None or to == GUIDEWAY:
            first_end = self._face(start, aside, upper=False)
            last = np.array([aside, self.level])
            moved = np.stack([first_end[1], np.zeros(2, dtype=complex)])
            rest = np.stack([first_end[0], last])
        else:
            above = bool(start.centre[second] >= end.centre[second])
            one, other = self._face(start, aside, upper=not above), self._face(end, aside, upper=above)
            rest, moved = np.stack([one[0], other[0]]), np.stack([one[1], other[1]])
        if kind == _ACTUATOR:
            return Part(kind, name, 0, rest, moved)
        share = np.linspace(0.0, 1.0, _ZIGZAG)[:, None]
        points = (1.0 - share) * rest[0] + share * rest[1]
        points[2:-2, 0] += 0.28 * self.unit * np.where(np.arange(_ZIGZAG - 4) % 2 == 0, 1.0, -1.0)
        return Part(kind, name, 0, points, (1.0 - share) * moved[0] + share * moved[1])

    def _face(self, box: Box, at: float, *, upper: bool) -> tuple[FloatArray, ComplexArray]:
        """A point of a box's upper or lower face and how it moves."""
        first, second = AXES[self.view]
        point = np.array(box.centre, dtype=float)[None, :].copy()
        reach = float(box.half[first])
        point[0, first] = np.clip(at, box.centre[first] - reach, box.centre[first] + reach)
        point[0, second] += box.half[second] if upper else -box.half[second]
        return self._seen(point)[0], self._moved(box, point)[0]
