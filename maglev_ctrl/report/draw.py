"""Charts on paper: a chart drawn by matplotlib.

Panels are drawn as plain artists of the figure, not as matplotlib axes: ticks and grids of axes take most of
matplotlib's time, and a report holds dozens of figures.
"""

from __future__ import annotations

import textwrap
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, assert_never

import numpy as np

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.report.chart import Area, Axis, Bars, Cells, Chart, Heat, Item, Line, Marks, Note, Panel, Rule, Span
from maglev_ctrl.report.legend import DASHES, SYMBOLS, legend_columns, legend_entries
from maglev_ctrl.report.raster import outer_edges, rectangles
from maglev_ctrl.report.scales import data_limits, even_ticks, log_ticks, share
from maglev_ctrl.report.style import FONT_SIZE, GRID, INK, ON_MAP, PAPER, RAMPS, RC, WIDTH, tick_text

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.figure import Figure

_LEGEND_WIDTH: Final = 1.75  # in
_LEGEND_WRAP: Final = 25
_LINE: Final = 0.15  # in, one line of text


@dataclass(frozen=True, eq=False, slots=True)
class _Frame:
    """Where one panel stands (in, from the lower left corner of the figure) and its limits."""

    left: float
    bottom: float
    width: float
    height: float
    x: tuple[float, float]
    y: tuple[float, float]
    log: tuple[bool, bool] = (False, False)

    def to_x(self, values: Any) -> Any:
        return self.left + share(values, self.x, log=self.log[0]) * self.width

    def to_y(self, values: Any) -> Any:
        return self.bottom + share(values, self.y, log=self.log[1]) * self.height


def draw(chart: Chart) -> Figure:
    """A chart as a matplotlib figure, in its own style, without touching matplotlib's global state.

    Examples
    --------
    >>> from maglev_ctrl.report.chart import Axis, Chart, Line, Panel
    >>> line = Line(np.array([0.0, 1.0]), np.array([0.0, 1.0]), "rise")
    >>> figure = draw(Chart("k", "caption", "alt", (Panel((line,), Axis("time (s)"), Axis("height (m)")),)))
    >>> [text.get_text() for text in figure.texts][-2:]
    ['time (s)', 'height (m)']
    """
    import matplotlib
    from matplotlib.figure import Figure

    with matplotlib.rc_context(RC):
        frames, height, legend_top = _layout(chart)
        figure = Figure(figsize=(WIDTH, height))
        for place, (panel, frame) in enumerate(zip(chart.panels, frames, strict=True)):
            last = place + chart.columns >= len(chart.panels)
            _Canvas(figure, frame).panel(panel, label_x=last or not chart.share_x)
        entries = legend_entries(chart)
        if entries and chart.legend == "right":
            figure.legend(
                handles=[handle for handle, _ in entries],
                labels=[textwrap.fill(label, _LEGEND_WRAP) for _, label in entries], loc="upper left",
                bbox_to_anchor=((WIDTH - _LEGEND_WIDTH + 0.05) / WIDTH, legend_top / height),
                borderaxespad=0.0, handlelength=2.0, labelspacing=0.55,
            )  # fmt: skip
        elif entries and chart.legend == "bottom":
            figure.legend(
                handles=[handle for handle, _ in entries], labels=[label for _, label in entries],
                ncols=legend_columns(entries),
                loc="lower left", bbox_to_anchor=(frames[0].left / WIDTH, 0.02 / height), borderaxespad=0.0,
                handlelength=2.0, labelspacing=0.4, columnspacing=1.4,
            )  # fmt: skip
        return figure


def _layout(chart: Chart) -> tuple[list[_Frame], float, float]:
    """Frames of the panels, height of the figure and where the legend begins, in."""
    entries = legend_entries(chart)
    beside = chart.legend == "right" and bool(entries)
    below = 0.08 + 0.17 * -(-len(entries) // legend_columns(entries)) if chart.legend == "bottom" and entries else 0.0
    has_scale = any(isinstance(item, Heat) for panel in chart.panels for item in panel.items)
    title_lines = max((panel.title.count("\n") + 1 for panel in chart.panels if panel.title), default=0)
    left, right = _left_margin(chart), 0.85 if has_scale else 0.12
    top, bottom = 0.10 + _LINE * title_lines, 0.46 + below
    x_gap = left if chart.columns > 1 and not _named_ticks(chart) else 0.35
    y_gap = (0.14 if chart.share_x else 0.50) + _LINE * title_lines
    height = top + bottom + sum(chart.heights) + (chart.rows - 1) * y_gap
    width_all = WIDTH - left - (_LEGEND_WIDTH if beside else right)
    width = (width_all - (chart.columns - 1) * x_gap) / chart.columns
    shared = _shared_x(chart) if chart.share_x else None
    frames = []
    for place, panel in enumerate(chart.panels):
        row, column = divmod(place, chart.columns)
        y = height - top - sum(chart.heights[: row + 1]) - row * y_gap
        size = chart.heights[row]
        x_limits = shared or panel.x.limits or data_limits(panel, "x")
        y_limits = panel.y.limits or data_limits(panel, "y")
        used, logs = width, (panel.x.log, panel.y.log)
        if panel.equal:
            used = min(width, size * (x_limits[1] - x_limits[0]) / (y_limits[1] - y_limits[0]))
        frames.append(_Frame(left + column * (width + x_gap), y, used, size, x_limits, y_limits, logs))
    return frames, height, height - top + 0.06


def _named_ticks(chart: Chart) -> int:
    """Longest named tick of the vertical axes, in characters."""
    lines = [line for panel in chart.panels for label in panel.y.tick_labels or () for line in label.split("\n")]
    return max((len(line) for line in lines), default=0)


def _left_margin(chart: Chart) -> float:
    longest = _named_ticks(chart)
    if longest:
        return 0.16 + 0.062 * longest
    return 0.28 if all(panel.y.hidden for panel in chart.panels) else 0.62


def _shared_x(chart: Chart) -> tuple[float, float]:
    limits = [panel.x.limits or data_limits(panel, "x") for panel in chart.panels]
    return min(low for low, _ in limits), max(high for _, high in limits)


@dataclass(frozen=True, eq=False, slots=True)
class _Canvas:
    """Draws one panel's content into a figure."""

    figure: Figure
    frame: _Frame

    def panel(self, panel: Panel, *, label_x: bool) -> None:
        ticks_x, ticks_y = self._ticks(panel.x, "x"), self._ticks(panel.y, "y")
        if not any(isinstance(item, Heat) for item in panel.items):
            self._grid(panel, ticks_x[0], ticks_y[0])
        for item in panel.items:
            self._item(item)
        self._spines(panel, ticks_x, ticks_y, label_x=label_x)
        f = self.frame
        if panel.title:
            self._text(
                f.left, f.bottom + f.height + 0.06, panel.title, va="bottom", weight="bold", size=FONT_SIZE + 0.3
            )
        if label_x and panel.x.label:
            self._text(f.left + f.width / 2, f.bottom - 0.24, panel.x.label, ha="center", va="top")
        if panel.y.label:
            away = 0.12 if panel.y.hidden else 0.52
            self._text(f.left - away, f.bottom + f.height / 2, panel.y.label, ha="center", va="center", rotation=90)

    def _ticks(self, axis: Axis, which: str) -> tuple[FloatArray, list[str]]:
        """Positions inside the limits and their texts."""
        low, high = self.frame.x if which == "x" else self.frame.y
        if axis.hidden:
            return np.zeros(0), []
        if axis.ticks is not None:
            texts = axis.tick_labels or tuple(tick_text(t, 0.0) for t in axis.ticks)
            return np.array(axis.ticks, dtype=float), list(texts)
        size = self.frame.width if which == "x" else self.frame.height
        count = int(np.clip(size / (0.55 if which == "x" else 0.30), 3, 8))
        return even_ticks(low, high, count=count) if not axis.log else log_ticks(low, high, count=count)

    def _grid(self, panel: Panel, x: FloatArray, y: FloatArray) -> None:
        f = self.frame
        upright = [((f.to_x(v), f.bottom), (f.to_x(v), f.bottom + f.height)) for v in x]
        level = [((f.left, f.to_y(v)), (f.left + f.width, f.to_y(v))) for v in y]
        self._segments(upright + level, GRID, 0.5, order=0.5)

    def _spines(
        self, panel: Panel, x: tuple[FloatArray, list[str]], y: tuple[FloatArray, list[str]], *, label_x: bool
    ) -> None:
        f = self.frame
        lines = []
        if not panel.x.hidden:
            lines.append(((f.left, f.bottom), (f.left + f.width, f.bottom)))
            lines += [((f.to_x(v), f.bottom), (f.to_x(v), f.bottom - 0.04)) for v in x[0]]
        if not panel.y.hidden:
            lines.append(((f.left, f.bottom), (f.left, f.bottom + f.height)))
            lines += [((f.left, f.to_y(v)), (f.left - 0.04, f.to_y(v))) for v in y[0]]
        self._segments(lines, INK, 0.7, order=3.0)
        small = FONT_SIZE - 0.5
        if label_x:
            for value, text in zip(*x, strict=True):
                self._text(float(f.to_x(value)), f.bottom - 0.07, text, ha="center", va="top", size=small)
        for value, text in zip(*y, strict=True):
            if text:
                self._text(f.left - 0.07, float(f.to_y(value)), text, ha="right", va="center", size=small)

    def _segments(self, lines: list[Any], colour: str, width: float, *, order: float) -> None:
        from matplotlib.collections import LineCollection

        if lines:
            made = LineCollection(lines, colors=colour, linewidths=width, zorder=order, capstyle="butt")
            made.set_transform(self.figure.dpi_scale_trans)
            self.figure.add_artist(made)

    def _text(
        self, x: float, y: float, text: str, *, ha: str = "left", va: str = "center", size: float = FONT_SIZE,
        colour: str = INK, weight: str = "normal", rotation: float = 0.0, boxed: bool = False,
    ) -> None:  # fmt: skip
        box = {"boxstyle": "round,pad=0.15", "facecolor": PAPER, "edgecolor": "none", "alpha": 0.85} if boxed else None
        self.figure.text(
            x, y, text, ha=ha, va=va, fontsize=size, color=colour, weight=weight, rotation=rotation, bbox=box,
            transform=self.figure.dpi_scale_trans, zorder=4.0, linespacing=1.15,
        )  # fmt: skip

    def _add(self, artist: Artist, *, order: float, clip: bool = True) -> None:
        from matplotlib.transforms import Bbox, TransformedBbox

        artist.set_transform(self.figure.dpi_scale_trans)
        artist.set_zorder(order)
        if clip:
            f = self.frame
            box = Bbox.from_bounds(f.left, f.bottom, f.width, f.height)
            artist.set_clip_box(TransformedBbox(box, self.figure.dpi_scale_trans))
        self.figure.add_artist(artist, clip=False)

    def _item(self, item: Item) -> None:
        from matplotlib.lines import Line2D
        from matplotlib.patches import Rectangle

        f = self.frame
        match item:
            case Line():
                x, y = thinned(f.to_x(item.x), f.to_y(item.y))
                line = Line2D(
                    x, y, color=item.colour, linestyle=DASHES[item.dash], linewidth=item.width
                )  # fmt: skip
                self._add(line, order=2.0)
            case Marks():
                hollow = item.symbol == "open_circle"
                marks = Line2D(
                    f.to_x(item.x), f.to_y(item.y), linestyle="none", marker=SYMBOLS[item.symbol], markersize=item.size,
                    color=item.colour, markerfacecolor="none" if hollow else item.colour, markeredgewidth=1.1,
                )  # fmt: skip
                inside = (item.x >= f.x[0]) & (item.x <= f.x[1]) & (item.y >= f.y[0]) & (item.y <= f.y[1])
                marks.set_data(np.where(inside, marks.get_xdata(), np.nan), marks.get_ydata())
                self._add(marks, order=2.5, clip=False)
            case Bars():
                for at, start, length in zip(item.position, item.start, item.length, strict=True):
                    x0, x1 = sorted((float(f.to_x(start)), float(f.to_x(start + length))))
                    y0, y1 = float(f.to_y(at - item.thickness / 2)), float(f.to_y(at + item.thickness / 2))
                    bar = Rectangle(
                        (x0, y0), x1 - x0, y1 - y0, facecolor=item.colour, edgecolor=PAPER, linewidth=0.4,
                        hatch="////" if item.hatched else None,
                    )  # fmt: skip
                    self._add(bar, order=1.5)
            case Area():
                self._area(item)
            case Span():
                self._span(item)
            case Rule():
                self._rule(item)
            case Heat():
                self._heat(item)
            case Cells():
                self._cells(item)
            case Note():
                self._text(
                    float(f.to_x(item.x)), float(f.to_y(item.y)), item.text, ha=item.horizontal, va=item.vertical,
                    size=FONT_SIZE - 0.8, colour=item.colour, boxed=item.boxed,
                )  # fmt: skip
            case _:
                assert_never(item)

    def _area(self, item: Area) -> None:
        from matplotlib.colors import to_rgba
        from matplotlib.patches import Polygon

        points = np.column_stack([self.frame.to_x(item.x), self.frame.to_y(item.y)])
        face = to_rgba(item.fill, item.opacity) if item.fill else "none"
        area = Polygon(
            points, closed=True, facecolor=face, edgecolor=item.edge or "none", linestyle=DASHES[item.dash],
            linewidth=item.width if item.edge else 0.0,
        )  # fmt: skip
        self._add(area, order=1.8)

    def _span(self, item: Span) -> None:
        from matplotlib.patches import Rectangle

        f = self.frame
        low, high = (f.to_x if item.axis == "x" else f.to_y)((item.start, item.stop))
        corner, width, height = ((low, f.bottom), high - low, f.height) if item.axis == "x" else (
            (f.left, low), f.width, high - low
        )  # fmt: skip
        band = Rectangle(
            corner, width, height, facecolor="none" if item.hatched else item.colour, alpha=item.opacity,
            hatch="///" if item.hatched else None, edgecolor=item.colour if item.hatched else "none", linewidth=0,
        )  # fmt: skip
        self._add(band, order=0.2)

    def _rule(self, item: Rule) -> None:
        from matplotlib.lines import Line2D

        f = self.frame
        if item.axis == "x":
            at = float(f.to_x(item.value))
            x, y = (at, at), (f.bottom, f.bottom + f.height)
        else:
            at = float(f.to_y(item.value))
            x, y = (f.left, f.left + f.width), (at, at)
        self._add(
            Line2D(x, y, color=item.colour, linestyle=DASHES[item.dash], linewidth=item.width), order=1.9
        )  # fmt: skip

    def _heat(self, item: Heat) -> None:
        """The one thing drawn in axes of its own, because images need them; with its colour scale beside it."""
        from matplotlib.colors import LinearSegmentedColormap

        f, size = self.frame, self.figure.get_size_inches()
        box = (f.left / size[0], f.bottom / size[1], f.width / size[0], f.height / size[1])
        colours = LinearSegmentedColormap.from_list(item.colours, RAMPS[item.colours])
        axes = self.figure.add_axes(box)
        axes.set_axis_off()
        axes.imshow(
            np.ma.masked_invalid(item.z), origin="lower", aspect="auto", interpolation="none", cmap=colours,
            extent=(*outer_edges(item.x), *outer_edges(item.y)), vmin=item.low, vmax=item.high,
        )  # fmt: skip
        axes.set(xlim=f.x, ylim=f.y, zorder=0.3)
        if item.scale is None:
            return
        bottom, height = f.bottom + item.scale[0] * f.height, (item.scale[1] - item.scale[0]) * f.height
        scale = _Frame(f.left + f.width + 0.10, bottom, 0.11, height, (0.0, 1.0), (item.low, item.high))
        bar = self.figure.add_axes(
            (scale.left / size[0], bottom / size[1], scale.width / size[0], height / size[1])
        )  # fmt: skip
        bar.set_axis_off()
        bar.imshow(
            np.linspace(0.0, 1.0, 64)[:, None], origin="lower", aspect="auto", interpolation="none", cmap=colours
        )
        canvas = _Canvas(self.figure, scale)
        for value, text in zip(*canvas._ticks(Axis(""), "y"), strict=True):
            self._text(scale.left + 0.15, float(scale.to_y(value)), text, size=FONT_SIZE - 0.5)
        self._text(scale.left + 0.62, bottom + height / 2, item.label, ha="center", va="center", rotation=90)

    def _cells(self, item: Cells) -> None:
        from matplotlib.patches import PathPatch
        from matplotlib.path import Path

        f, corners = self.frame, []
        for left, right, low, high in rectangles(item.x, item.y, item.mask):
            x, y = f.to_x((left, right, right, left, left)), f.to_y((low, low, high, high, low))
            corners.append(np.column_stack([x, y]))
        if corners:
            codes = np.tile([Path.MOVETO, *[Path.LINETO] * 3, Path.CLOSEPOLY], len(corners))
            patch = PathPatch(
                Path(np.concatenate(corners), codes), facecolor=item.colour, edgecolor=ON_MAP, linewidth=0.0,
                hatch="/////" if item.hatched else None,
            )  # fmt: skip
            self._add(patch, order=0.6)


def thinned(x: FloatArray, y: FloatArray, *, tolerance: float = 0.0015) -> tuple[FloatArray, FloatArray]:
    """A curve without the points that lie on the straight line between their neighbours; lengths in inches.

    Each of four passes drops at most every other point, so that the curve never moves by more than four tolerances.

    Examples
    --------
    >>> x, y = thinned(np.linspace(0.0, 1.0, 17), np.zeros(17))
    >>> x.tolist()
    [0.0, 1.0]
    """
    for _ in range(4):
        if x.size < 3:
            break
        dx, dy = x[2:] - x[:-2], y[2:] - y[:-2]
        length = np.hypot(dx, dy)
        across = np.abs(dx * (y[1:-1] - y[:-2]) - dy * (x[1:-1] - x[:-2]))
        with np.errstate(invalid="ignore"):
            straight = (across <= tolerance * length) & (length > 0.0)
        along = (x[1:-1] - x[:-2]) * dx + (y[1:-1] - y[:-2]) * dy
        with np.errstate(invalid="ignore"):
            straight &= (along >= 0.0) & (along <= length**2)
        keep = np.ones(x.size, dtype=bool)
        keep[1:-1:2] = ~straight[::2]
        x, y = x[keep], y[keep]
    return x, y
