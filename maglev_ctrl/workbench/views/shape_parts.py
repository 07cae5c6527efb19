"""The vehicle as points at rest and how far each one moves in a mode: what the browser needs to animate it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from maglev_ctrl.arrays import ComplexArray, FloatArray
from maglev_ctrl.report.geometry import (
    AXES,
    Box,
    View,
    bounds,
    boxes,
    clearest_view,
    corners,
    displacement,
    metre,
    motion,
    to_largest,
)
from maglev_ctrl.vehicle import GUIDEWAY, Actuator, SpringDamper, Vehicle

Kind = Literal["box", "magnet", "spring", "actuator"]
KINDS: Final[tuple[Kind, ...]] = ("box", "magnet", "spring", "actuator")
AXIS_WORDS: Final[dict[View, tuple[str, str]]] = {
    "side": ("along the track (m)", "seen from the side"), "front": ("across the track (m)", "seen from ahead"),
    "top": ("along the track (m)", "seen from above"),
}  # fmt: skip
_ZIGZAG: Final = 9  # points of a spring
_Effects = tuple[FloatArray, FloatArray]


@dataclass(frozen=True, eq=False, slots=True)
class Scene:
    """A vehicle in one view: N points of its parts at rest, and what each coordinate of the vehicle does to them.

    `rest` (N, 2) m; `basis` (N, 2, n) drawn displacement in m per unit of each of the n coordinates, stretched as the
    printed shapes are; `true` (N, 2, n) the same unstretched; `part`, `kind` (into KINDS), `colour` (N,); `names` of
    the boxes and where they stand (b, 2); `level` of the rail, NaN from above; `window`: left, right, bottom, top.
    """

    view: View
    rest: FloatArray
    basis: FloatArray
    true: FloatArray
    part: NDArray[np.int32]
    kind: NDArray[np.int32]
    colour: NDArray[np.int32]
    names: tuple[str, ...]
    places: FloatArray
    level: float
    window: tuple[float, float, float, float]


@lru_cache(maxsize=4)
def scenes(vehicle: Vehicle) -> dict[View, Scene]:
    """The vehicle in every view."""
    outline = boxes(vehicle)
    effects = {box.body: _effects(vehicle, box) for box in outline}
    return {view: _Draft(vehicle, outline, view, effects).scene() for view in AXES}


def _effects(vehicle: Vehicle, box: Box) -> _Effects:
    """What each coordinate does to a body: shift of its centre (n, 3), and (n, 3, 3) times the lever arm (3,)."""
    n = len(vehicle.dofs)
    probes = box.centre + np.vstack([np.zeros(3), np.eye(3)])
    found = np.zeros((n, 4, 3))
    for place, name in enumerate(vehicle.dofs):
        if name.rpartition(".")[0] == box.body:
            alone = np.zeros(n, dtype=complex)
            alone[place] = 1.0
            found[place] = displacement(box, probes, motion(vehicle, alone, box.body)).real
    return found[:, 0], found[:, 1:] - found[:, :1]


def moved(vehicle: Vehicle, shape: ComplexArray) -> tuple[Scene, ComplexArray]:
    """The view in which a mode moves most, and the drawn displacements (N, 2) of its points at unit amplitude.

    Parameters
    ----------
    shape : (n,) over the vehicle's coordinates
    """
    found = scenes(vehicle)
    seen = {view: scene.true[scene.kind == 0] @ shape for view, scene in found.items()}
    view = clearest_view({name: float(np.sum(np.abs(one) ** 2)) for name, one in seen.items()})
    return found[view], np.asarray(found[view].basis @ (shape * to_largest(seen[view].ravel())))


class _Draft:
    """Collects the parts of one view."""

    def __init__(self, vehicle: Vehicle, outline: tuple[Box, ...], view: View, effects: dict[str, _Effects]) -> None:
        self.effects = effects
        self.vehicle, self.outline, self.view = vehicle, {box.body: box for box in outline}, view
        self.first, self.second = AXES[view]
        self.low, self.high = bounds(outline)
        self.unit, self.span = metre(self.low, self.high), self.high - self.low
        self.level = float(self.low[self.second]) - 0.9 * self.unit
        self.rest: list[FloatArray] = []
        self.true: list[FloatArray] = []
        self.heads: list[tuple[int, int, int]] = []  # points, kind, colour of each part

    def scene(self) -> Scene:
        for place, box in enumerate(self.outline.values()):
            at = corners(box, self.view)
            self._add("box", place, self._seen(at), self._basis(box, at))
        if self.view != "top":
            for box in self.outline.values():
                self._magnets(box)
            self._links()
        stretch = np.array([0.05 * self.span[self.first], 0.16 * max(float(self.span[self.second]), self.unit)])
        true = np.concatenate(self.true)
        sizes = [size for size, _, _ in self.heads]
        left, right = float(self.low[self.first]), float(self.high[self.first])
        margin = 0.08 * (right - left)
        room = 0.24 * max(float(self.span[self.second]), self.unit)
        above = self.view == "top"
        bottom = float(self.low[self.second]) - room if above else self.level - 0.2 * self.unit
        return Scene(
            view=self.view, rest=np.concatenate(self.rest), basis=stretch[None, :, None] * true, true=true,
            part=np.repeat(np.arange(len(sizes), dtype=np.int32), sizes),
            kind=np.repeat(np.array([kind for _, kind, _ in self.heads], dtype=np.int32), sizes),
            colour=np.repeat(np.array([tint for _, _, tint in self.heads], dtype=np.int32), sizes),
            names=tuple(self.outline), level=float("nan") if above else self.level,
            places=np.array([box.centre[[self.first, self.second]] for box in self.outline.values()]),
            window=(left - margin, right + margin, bottom, float(self.high[self.second]) + room),
        )  # fmt: skip

    def _add(self, kind: Kind, colour: int, rest: FloatArray, basis: FloatArray) -> None:
        self.rest.append(rest)
        self.true.append(basis)
        self.heads.append((len(rest), KINDS.index(kind), colour))

    def _seen(self, points: FloatArray) -> FloatArray:
        return np.asarray(points[:, [self.first, self.second]])

    def _basis(self, box: Box, points: FloatArray) -> FloatArray:
        """What each coordinate does to points of a body, (k, 2, n)."""
        shift, turn = self.effects[box.body]
        found = shift[:, None, :] + np.einsum("ij,kjl->kil", points - box.centre, turn)
        return np.asarray(found[:, :, [self.first, self.second]].transpose(1, 2, 0))

    def _magnets(self, box: Box) -> None:
        """Short strokes below a box, moved with it."""
        if not box.magnets.size:
            return
        across = np.unique(box.magnets[:, self.first])
        base = np.tile(box.centre, (len(across), 1))
        base[:, self.first], base[:, self.second] = across, box.centre[self.second] - box.half[self.second]
        down = np.array([0.0, -0.35 * self.unit])
        for point, step in zip(self._seen(base), self._basis(box, base), strict=True):
            self._add("magnet", 0, np.stack([point, point + down]), np.stack([step, step]))

    def _links(self) -> None:
        """Springs and actuators between the near faces of two boxes, or between a box and the rail."""
        drawn: set[tuple[object, ...]] = set()
        links: list[tuple[Kind, SpringDamper | Actuator]] = [("spring", one) for one in self.vehicle.connections]
        links += [("actuator", one) for one in self.vehicle.actuators]
        for kind, one in links:
            at = float(one.position[self.first])
            key = (kind, *sorted((one.body, one.to)), round(at, 6))
            if one.angular or key in drawn:
                continue
            drawn.add(key)  # twins on both sides of the vehicle cover each other
            self._link(kind, one.body, one.to, at)

    def _link(self, kind: Kind, body: str, to: str, at: float) -> None:
        start, end = self.outline[body], self.outline.get(to)
        # An actuator stands a little aside, so that a spring at the same place is seen as well.
        at += 0.5 * self.unit if kind == "actuator" else 0.0
        if end is None or to == GUIDEWAY:
            one = self._face(start, at, upper=False)
            other = np.array([at, self.level]), np.zeros_like(one[1])
        else:
            above = bool(start.centre[self.second] >= end.centre[self.second])
            one, other = self._face(start, at, upper=not above), self._face(end, at, upper=above)
        if kind == "actuator":
            self._add(kind, 0, np.stack([one[0], other[0]]), np.stack([one[1], other[1]]))
            return
        share = np.linspace(0.0, 1.0, _ZIGZAG)
        points = (1.0 - share)[:, None] * one[0] + share[:, None] * other[0]
        points[2:-2, 0] += 0.28 * self.unit * np.where(np.arange(_ZIGZAG - 4) % 2 == 0, 1.0, -1.0)
        steps = (1.0 - share)[:, None, None] * one[1] + share[:, None, None] * other[1]
        self._add(kind, 0, points, steps)

    def _face(self, box: Box, at: float, *, upper: bool) -> tuple[FloatArray, FloatArray]:
        """A point of a box's upper or lower face and what each coordinate does to it."""
        point = np.array(box.centre, dtype=float)[None, :].copy()
        reach = float(box.half[self.first])
        point[0, self.first] = np.clip(at, box.centre[self.first] - reach, box.centre[self.first] + reach)
        point[0, self.second] += box.half[self.second] if upper else -box.half[self.second]
        return self._seen(point)[0], self._basis(box, point)[0]
