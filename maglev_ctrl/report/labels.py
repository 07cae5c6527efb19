"""Names put into a figure so that they hide neither each other nor what they name."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from maglev_ctrl.report.chart import Item, Line, Note
from maglev_ctrl.report.style import FONT_SIZE, INK

_CHARACTER: Final = 0.6 * FONT_SIZE / 72.0  # in, mean width of one
_HEIGHT: Final = 1.75 * FONT_SIZE / 72.0  # in, of one line with its box
_RADII: Final = (0.0, 0.16, 0.24, 0.34, 0.46, 0.62, 0.82, 1.1, 1.5, 2.0)  # in
_DIRECTIONS: Final = 16
_HIDING: Final = 4.0  # in: how far a label goes to hide nothing
_CROSSING: Final = 3.0  # in: how far a label goes so that its line crosses nothing
_LEADER: Final = 0.12  # in: a label farther away than this gets a line


@dataclass(frozen=True, slots=True)
class Anchor:
    """A name and the point it belongs to; `edge` where its line ends when it does not fit on that point."""

    x: float
    y: float
    text: str
    edge: tuple[float, float] | None = None


@dataclass(frozen=True, eq=False, slots=True)
class Room:
    """Where labels may stand: limits of the axes, size of the panel (in), and cells (ny, nx) best left uncovered."""

    x: tuple[float, float]
    y: tuple[float, float]
    size: tuple[float, float]
    busy: NDArray[np.bool_]

    def inches(self, x: float, y: float) -> tuple[float, float]:
        """A point of the axes in inches from the lower left corner."""
        return (
            (x - self.x[0]) / (self.x[1] - self.x[0]) * self.size[0],
            (y - self.y[0]) / (self.y[1] - self.y[0]) * self.size[1],
        )

    def values(self, right: float, up: float) -> tuple[float, float]:
        """The same backwards."""
        return (
            self.x[0] + right / self.size[0] * (self.x[1] - self.x[0]),
            self.y[0] + up / self.size[1] * (self.y[1] - self.y[0]),
        )

    def hidden(self, box: tuple[float, float, float, float]) -> float:
        """The share of busy cells under a box (left, right, low, high) in inches."""
        if not self.busy.size:
            return 0.0
        rows, columns = self.busy.shape
        a, b = (int(np.clip(v / self.size[0] * columns, 0, columns - 1)) for v in box[:2])
        c, d = (int(np.clip(v / self.size[1] * rows, 0, rows - 1)) for v in box[2:])
        return float(np.mean(self.busy[c : d + 1, a : b + 1]))


def placed(
    anchors: list[Anchor], room: Room, *, taken: list[Anchor] | None = None, colour: str = INK, line: str = INK
) -> tuple[list[Item], int]:
    """Notes for the anchors, the first ones first, and how many found no free place; `taken` are words already there.

    A name inside a wide region stands on it, one of a narrow region beside it with a line to it.

    Examples
    --------
    >>> room = Room((0.0, 1.0), (0.0, 1.0), (3.0, 2.0), np.zeros((4, 4), dtype=bool))
    >>> items, left_out = placed([Anchor(0.5, 0.5, "one"), Anchor(0.5, 0.5, "two")], room)
    >>> [type(item).__name__ for item in items], left_out
    (['Note', 'Line', 'Note'], 0)
    """
    boxes = [_box(room.inches(one.x, one.y), one.text) for one in taken or []]
    items: list[Item] = []
    left_out = 0
    for anchor in anchors:
        own = _box(room.inches(anchor.x, anchor.y), anchor.text)
        at = room.inches(*(anchor.edge or (anchor.x, anchor.y)))
        place: tuple[float, float] | None
        if _fits(own, room, boxes) and room.hidden(own) == 1.0:
            place = at = room.inches(anchor.x, anchor.y)
        else:
            place = _beside(at, anchor.text, room, boxes)
        if place is None:
            left_out += 1
            continue
        boxes.append(_box(place, anchor.text))
        x, y = room.values(*place)
        if np.hypot(place[0] - at[0], place[1] - at[1]) > _LEADER:
            start = room.values(*at)
            items.append(Line(np.array([start[0], x]), np.array([start[1], y]), "", line, "solid", 0.6))
        items.append(Note(x, y, anchor.text, "center", "center", colour, True))
    return items, left_out


def _beside(
    at: tuple[float, float], text: str, room: Room, boxes: list[tuple[float, float, float, float]]
) -> tuple[float, float] | None:
    """The free place near a point that hides least and whose line back crosses least; None where there is none."""
    best: tuple[float, tuple[float, float]] | None = None
    for radius in _RADII:
        for turn in range(_DIRECTIONS if radius else 1):
            angle = 2.0 * np.pi * (turn - 4) / _DIRECTIONS  # downwards first
            # Words are wider than high: sideways a label has to go farther to come free of its point.
            aside = 0.5 * _CHARACTER * len(text) if radius else 0.0
            place = (at[0] + (radius + aside) * float(np.cos(angle)), at[1] + radius * float(np.sin(angle)))
            box = _box(place, text)
            if not _fits(box, room, boxes):
                continue
            cost = radius + _HIDING * room.hidden(box) + _CROSSING * _crossed(at, place, room)
            if best is None or cost < best[0] - 1e-9:
                best = (cost, place)
    return None if best is None else best[1]


def _crossed(start: tuple[float, float], end: tuple[float, float], room: Room) -> float:
    """The share of a line that runs over busy cells, not counting its beginning."""
    shares = np.linspace(0.2, 1.0, 12)
    points = [tuple(a + float(t) * (b - a) for a, b in zip(start, end, strict=True)) for t in shares]
    return float(np.mean([room.hidden((p[0], p[0], p[1], p[1])) for p in points]))


def _box(centre: tuple[float, float], text: str) -> tuple[float, float, float, float]:
    half = 0.5 * (_CHARACTER * len(text) + 0.09)
    return centre[0] - half, centre[0] + half, centre[1] - _HEIGHT / 2, centre[1] + _HEIGHT / 2


def _fits(box: tuple[float, float, float, float], room: Room, boxes: list[tuple[float, float, float, float]]) -> bool:
    inside = box[0] >= 0.0 and box[1] <= room.size[0] and box[2] >= 0.0 and box[3] <= room.size[1]
    return inside and not any(
        box[0] < other[1] and other[0] < box[1] and box[2] < other[3] and other[2] < box[3] for other in boxes
    )
