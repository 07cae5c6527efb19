"""A figure as data: what is drawn, in words and numbers, before any drawing library is asked.

The same chart is drawn by `draw` (matplotlib, for paper and for browsers without scripts) and by `interactive`
(plotly, for the live page), so the two can never tell different stories.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.report.style import INK, Dash, Ramp, Symbol


@dataclass(frozen=True, eq=False, slots=True)
class Line:
    """A curve; NaN breaks it. An empty label stays out of the legend."""

    x: FloatArray
    y: FloatArray
    label: str = ""
    colour: str = INK
    dash: Dash = "solid"
    width: float = 1.4


@dataclass(frozen=True, eq=False, slots=True)
class Marks:
    """Separate points, each with an optional text for the pointer."""

    x: FloatArray
    y: FloatArray
    symbol: Symbol
    label: str = ""
    colour: str = INK
    size: float = 5.0
    hover: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False, slots=True)
class Bars:
    """Horizontal bars from `start` to `start + length` at heights `position`; hatched bars tell without colour."""

    position: FloatArray
    start: FloatArray
    length: FloatArray
    thickness: float
    label: str = ""
    colour: str = INK
    hatched: bool = False
    hover: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False, slots=True)
class Area:
    """A closed polygon."""

    x: FloatArray
    y: FloatArray
    label: str = ""
    fill: str | None = None
    opacity: float = 0.25
    edge: str | None = INK
    dash: Dash = "solid"
    width: float = 0.9


@dataclass(frozen=True, eq=False, slots=True)
class Span:
    """A band across the whole panel between two values of one axis."""

    axis: Literal["x", "y"]
    start: float
    stop: float
    colour: str
    opacity: float = 0.12
    hatched: bool = False
    label: str = ""


@dataclass(frozen=True, eq=False, slots=True)
class Rule:
    """A straight line across the whole panel at one value of one axis."""

    axis: Literal["x", "y"]
    value: float
    label: str = ""
    colour: str = INK
    dash: Dash = "dash"
    width: float = 0.9


@dataclass(frozen=True, eq=False, slots=True)
class Heat:
    """Cell colours over a regular grid: z (ny, nx), NaN is left blank; colours from `low` to `high`.

    `scale`: where along the panel's height the scale of the colours stands, as two shares of it; None for no scale.
    """

    x: FloatArray
    y: FloatArray
    z: FloatArray
    label: str
    low: float
    high: float
    colours: Ramp = "viridis"
    scale: tuple[float, float] | None = (0.0, 1.0)


@dataclass(frozen=True, eq=False, slots=True)
class Cells:
    """Cells of a regular grid that are told apart whatever their colour: where `mask` (ny, nx) holds."""

    x: FloatArray
    y: FloatArray
    mask: NDArray[np.bool_]
    label: str
    colour: str
    hatched: bool = False


@dataclass(frozen=True, eq=False, slots=True)
class Note:
    """Words at a point."""

    x: float
    y: float
    text: str
    horizontal: Literal["left", "center", "right"] = "left"
    vertical: Literal["top", "center", "bottom"] = "center"
    colour: str = INK
    boxed: bool = False


Item = Line | Marks | Bars | Area | Span | Rule | Heat | Cells | Note


@dataclass(frozen=True, eq=False, slots=True)
class Axis:
    """One axis: label with unit, limits (None = from the data), named ticks; logarithmic where `log` says so."""

    label: str
    limits: tuple[float, float] | None = None
    ticks: tuple[float, ...] | None = None
    tick_labels: tuple[str, ...] | None = None
    hidden: bool = False
    log: bool = False


@dataclass(frozen=True, eq=False, slots=True)
class Panel:
    """One pair of axes and what stands in it."""

    items: tuple[Item, ...]
    x: Axis
    y: Axis
    title: str = ""
    equal: bool = False


@dataclass(frozen=True, eq=False, slots=True)
class Chart:
    """A figure: panels row by row, what it shows (caption) and what a reader who cannot see it is told (alt)."""

    key: str
    caption: str
    alt: str
    panels: tuple[Panel, ...]
    columns: int = 1
    panel_height: float = 1.9  # in
    legend: Literal["right", "bottom", "none"] = "right"
    share_x: bool = False
    row_heights: tuple[float, ...] = ()  # in, row by row where they differ

    @property
    def heights(self) -> tuple[float, ...]:
        """Height of each row of panels, in."""
        return self.row_heights or (self.panel_height,) * self.rows

    @property
    def rows(self) -> int:
        """Rows of panels."""
        return -(-len(self.panels) // self.columns)
