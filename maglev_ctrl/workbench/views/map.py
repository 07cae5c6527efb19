"""The map of growth over speed and modulation depth, readable without colour, with a cross-hair that can be moved."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from bokeh.core.properties import value
from bokeh.events import Pan, PanEnd, PanStart, Tap
from bokeh.layouts import column
from bokeh.models import (
    ColorBar,
    ColumnDataSource,
    CustomJS,
    CustomJSHover,
    CustomJSTickFormatter,
    HoverTool,
    LinearColorMapper,
    Range1d,
    Span,
)

from maglev_ctrl.analysis.plane_records import NO_ANSWER, UNRESOLVED, UNSTABLE
from maglev_ctrl.report.chart import Line, Note
from maglev_ctrl.report.charts_periodic import short_words
from maglev_ctrl.report.labels import Anchor, Room, placed
from maglev_ctrl.report.raster import outer_edges, rectangles
from maglev_ctrl.report.style import ON_MAP, RAMPS, number
from maglev_ctrl.study.live.records import LiveMap, LiveView
from maglev_ctrl.workbench.style import FONT, FONT_SIZE, dress
from maglev_ctrl.workbench.views.cursor import MOVE, Cursor
from maglev_ctrl.workbench.views.frame import frame, words_block, words_only
from maglev_ctrl.workbench.views.legend import INK, box_sign, legend_block, line_sign, marker_sign
from maglev_ctrl.workbench.views.map_image import boundary_line, even_map, map_words, state_words
from maglev_ctrl.workbench.views.table import escaped

KILOMETRES_PER_HOUR: Final = 3.6
PER_CENT: Final = 100.0
NOT_CHECKED: Final = "Fast map, not checked yet."
CHECKED: Final = "Checked by two engines."
MOST_NAMES: Final = 6  # on the map; the others are in its summary
LEAST_SCALE: Final = 0.05  # 1/s: growth that is next to nothing looks like next to nothing
_ROOM: Final = (4.0, 2.6)  # in at the size of print: a plane of 430 by 280 px
_CLEAR: Final = "rgba(0, 0, 0, 0)"
_STATES: Final = ("#d4e2ee", "#f4f4f4", "#f98c0a", "#9b9b9b")  # stable, unresolved, unstable, no answer: without growth
_PALE: Final = ("#fffbe6", "#fdf0a8")  # before the printed ramp: what hardly grows
_PATTERNS: Final = {UNSTABLE: "right_diagonal_line", UNRESOLVED: "criss_cross", NO_ANSWER: "dot"}
_LEGEND: Final = (
    (marker_sign("circle_cross", INK), "cursor: tap or drag"), (line_sign(1.6), "boundary"),
    (box_sign(_STATES[2], _PATTERNS[UNSTABLE], ON_MAP), "unstable"),
    (box_sign(_STATES[1], _PATTERNS[UNRESOLVED], ON_MAP), "UNRESOLVED"),
    (box_sign(_STATES[3], _PATTERNS[NO_ANSWER], ON_MAP), "no answer"),
)  # fmt: skip
_BETWEEN: Final = 45  # ms between the moves of a drag that the server hears of

POINTED: Final = "maglev-ctrl-point"
"""Name of the event in the browser that tells speed and depth of a tap or a drag, and whether that begins."""
_POINT: Final = f"""
{MOVE}
const now = performance.now()
if (cb_obj.event_name === "pan" && now - (cursor.moved_at ?? 0) < {_BETWEEN}) return
cursor.moved_at = now
const inside = (value, range) => Math.min(Math.max(value, Math.min(range.start, range.end)),
                                          Math.max(range.start, range.end))
if (cb_obj.x === null || cb_obj.y === null || !image.data.growth?.length) return
const point = {{speed: inside(cb_obj.x, x_range) / {KILOMETRES_PER_HOUR},
               depth: Math.max(0, inside(cb_obj.y, y_range)) / {PER_CENT}}}
place(point)
document.dispatchEvent(new CustomEvent("{POINTED}", {{detail: {{...point, begins: cb_obj.event_name !== "pan"
  && cb_obj.event_name !== "panend"}}}}))
"""
_FOLLOW: Final = f"""
upright.location = Number(cursor.data.speed[0]) * {KILOMETRES_PER_HOUR}
level.location = Number(cursor.data.depth[0]) * {PER_CENT}
at.data.x[0] = upright.location
at.data.y[0] = level.location
at.change.emit()
"""


class MapView:
    """Growth over speed (km/h) and depth (%): colours, a hatch where unstable, a line around it, names.

    A tap or a drag sets the cursor's speed and depth. `root`, `summary`: as of every view.

    Examples
    --------
    >>> view = MapView(Cursor(100.0, 0.1))
    >>> view.clear("the scenario describes no periodic forcing")
    >>> view.summary
    'Map: the scenario describes no periodic forcing'
    """

    def __init__(self, cursor: Cursor) -> None:
        self.cursor = cursor
        self.summary = ""
        self._drawn: LiveMap | None = None
        self.image = ColumnDataSource(_no_image())
        self.cells = ColumnDataSource(_no_cells())
        self.line = ColumnDataSource({"x": np.zeros(0), "y": np.zeros(0)})
        self.names = ColumnDataSource(_no_names())
        self.leaders = ColumnDataSource({"x": [], "y": []})
        self.at = ColumnDataSource({
            "x": [cursor.speed * KILOMETRES_PER_HOUR], "y": [cursor.depth * PER_CENT]
        })  # fmt: skip
        self.status = words_block("map-status")
        self.legend = legend_block("map-legend", _LEGEND)
        self.figure = frame(
            "map", "Resonance map", x_label="speed (km/h)", y_label="modulation depth (%)", height=380, zoom=False
        )
        self._draw()
        self._link()
        dress(self.figure, False)
        self.figures = (self.figure,)
        self.root = column(self.status, self.figure, self.legend, sizing_mode="stretch_width", name="map-view")

    def _draw(self) -> None:
        drawn = self.figure
        drawn.x_range, drawn.y_range = Range1d(0.0, 1.0), Range1d(0.0, 1.0)
        drawn.grid.visible = False
        self.growing = LinearColorMapper(
            palette=_ramp((*_PALE, *RAMPS["growth"])), low=0.0, high=1.0, low_color=_CLEAR, nan_color=_CLEAR
        )
        self.decaying = LinearColorMapper(
            palette=_ramp(RAMPS["decay"])[::-1], low=-1.0, high=0.0, high_color=_CLEAR, nan_color=_CLEAR
        )
        states = LinearColorMapper(palette=list(_STATES), low=-1.5, high=2.5, nan_color=_CLEAR)
        where = {"x": "x", "y": "y", "dw": "dw", "dh": "dh", "source": self.image}
        below = drawn.image("state", color_mapper=states, **where)
        drawn.image("growth", color_mapper=self.decaying, **where)
        drawn.image("growth", color_mapper=self.growing, **where)
        drawn.quad(
            "left", "right", "bottom", "top", source=self.cells, fill_color=None, line_color=None,
            hatch_pattern="pattern", hatch_color=ON_MAP, hatch_alpha=0.24, hatch_scale=13.0, hatch_weight=0.7,
        )  # fmt: skip
        drawn.line("x", "y", source=self.line, line_color=ON_MAP, line_width=1.6)
        drawn.multi_line("x", "y", source=self.leaders, line_color=ON_MAP, line_width=0.8)
        drawn.text(
            "x", "y", "text", source=self.names, text_font=value(FONT), text_font_size=FONT_SIZE, text_color=ON_MAP,
            text_align="center", text_baseline="middle", background_fill_color="#ffffff",
            background_fill_alpha=0.85, padding=2, border_radius=3,
        )  # fmt: skip
        # What follows the cursor lies on a sheet of its own, so that a move leaves the map's picture as it is.
        line = {"line_color": ON_MAP, "line_width": 1.2, "line_dash": "dashed", "level": "overlay"}
        self.upright = Span(location=0.0, dimension="height", **line)
        self.level = Span(location=0.0, dimension="width", **line)
        for span in (self.upright, self.level):
            drawn.add_layout(span)
        drawn.scatter(
            "x", "y", source=self.at, size=15, marker="circle_cross", fill_color="#ffffff", fill_alpha=0.75,
            line_color=ON_MAP, line_width=2.0, level="overlay",
        )  # fmt: skip
        drawn.add_tools(_hover(below))
        bars = []
        for mapper, words in ((self.growing, "growth (1/s)"), (self.decaying, "decay (1/s)")):
            bar = ColorBar(
                color_mapper=mapper, title=words, width=10, height="auto", title_text_font=FONT, location=(4, 0),
                title_text_font_size="11px", title_text_font_style="normal", major_label_text_font=FONT,
                major_label_text_font_size="11px", background_fill_alpha=0.0, padding=2, title_standoff=4,
                margin=2, formatter=CustomJSTickFormatter(code="return `${Math.abs(Number(tick.toPrecision(4)))}`"),
            )  # fmt: skip
            drawn.add_layout(bar, "right")
            bars.append(bar)
        self.bars = tuple(bars)

    def _link(self) -> None:
        args = {
            "cursor": self.cursor.source, "image": self.image, "x_range": self.figure.x_range,
            "y_range": self.figure.y_range, "upright": self.upright, "level": self.level, "at": self.at,
        }  # fmt: skip
        for event in (Tap, PanStart, Pan, PanEnd):
            self.figure.js_on_event(event, CustomJS(args=args, code=_POINT))
        follow = CustomJS(args=args, code=_FOLLOW)
        self.cursor.source.js_on_change("data", follow)
        self.figure.js_on_change("inner_width", follow)

    def show(self, view: LiveView) -> None:
        """Put a view's map into the figure."""
        if view.map is None:
            self.clear(view.failure or view.map_reason or "there is no map")
            return
        if view.map is not self._drawn:
            self._paint(view.map)
        self._tell(view, view.map)

    def _paint(self, found: LiveMap) -> None:
        """Everything that does not follow the operating point."""
        shown = even_map(found)
        x, y = KILOMETRES_PER_HOUR * shown.speed, PER_CENT * shown.depth
        (left, right), (low, high) = outer_edges(x), outer_edges(y)
        self.image.data = {
            "growth": [np.asarray(shown.signed, dtype=np.float32)], "state": [np.asarray(shown.state, np.float32)],
            "x": [left], "y": [low], "dw": [right - left], "dh": [high - low],
        }  # fmt: skip
        for range_, start, end in ((self.figure.x_range, left, right), (self.figure.y_range, max(low, 0.0), high)):
            if (range_.start, range_.end) != (start, end):
                range_.update(start=start, end=end)
        self._limits(shown.signed)
        self.cells.data = _cells(x, y, shown.state)
        across, up = boundary_line(x, y, shown)
        self.line.data = {"x": across, "y": up}
        self.names.data, self.leaders.data = _names(found, (left, right), (max(low, 0.0), high), shown.state)
        self._appear(True)
        self._drawn = found

    def _limits(self, signed: np.ndarray[Any, Any]) -> None:
        known = signed[np.isfinite(signed)]
        high = max(float(np.max(known, initial=0.0)), LEAST_SCALE)
        decay = -known[known < 0.0]
        for bar, needed in zip(self.bars, (bool(np.any(known > 0.0)), bool(decay.size)), strict=True):
            if bar.visible != needed:
                bar.visible = needed
        low = -(float(np.percentile(decay, 95.0)) if decay.size else 1.0)
        if (self.growing.high, self.decaying.low) != (high, low):
            self.growing.high, self.decaying.low = high, low

    def _tell(self, view: LiveView, found: LiveMap) -> None:
        checked = CHECKED if found.checked else NOT_CHECKED
        note = f" {found.note}" if found.note else ""
        kind = "checked" if found.checked else "quiet"
        self.status.text = f'<p class="{kind}">{escaped(checked)}<span class="quiet">{escaped(note)}</span></p>'
        self.figure.title.text = words_only(f"Resonance map of {view.label}")
        self.summary = (
            f"Map of {view.label}: {map_words(found)} At {number(KILOMETRES_PER_HOUR * view.speed, 'km/h')} and "
            f"{number(PER_CENT * view.depth, '%')}: {state_words(found, view.speed, view.depth)}. {checked}{note}"
        )

    def _appear(self, seen: bool) -> None:
        """Figure and legend are there only with a map in them: empty axes would say that there is one."""
        for model in (self.figure, self.legend):
            if model.visible != seen:
                model.visible = seen

    def clear(self, reason: str) -> None:
        """Nothing to show, and why."""
        self._drawn = None
        self.image.data, self.cells.data = _no_image(), _no_cells()
        self.line.data = {"x": np.zeros(0), "y": np.zeros(0)}
        self.names.data, self.leaders.data = _no_names(), {"x": [], "y": []}
        self._appear(False)
        self.status.text = f"<p>{escaped(reason)}</p>"
        self.figure.title.text = "Resonance map"
        self.summary = f"Map: {reason}"


def _no_names() -> dict[str, Any]:
    return {"x": np.zeros(0), "y": np.zeros(0), "text": []}


def _names(
    found: LiveMap, across: tuple[float, float], up: tuple[float, float], state: np.ndarray[Any, Any]
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Names of the regions inside the frame and clear of each other, and lines to what stands beside its name."""
    anchors = [
        Anchor(KILOMETRES_PER_HOUR * one.speed, PER_CENT * one.depth, short_words(one.name))
        for one in found.regions[:MOST_NAMES]
    ]
    items, _ = placed(anchors, Room(across, up, _ROOM, state == UNSTABLE))
    notes = [one for one in items if isinstance(one, Note)]
    lines = [one for one in items if isinstance(one, Line)]
    names = {
        "x": np.array([one.x for one in notes]), "y": np.array([one.y for one in notes]),
        "text": [one.text for one in notes],
    }  # fmt: skip
    return names, {"x": [one.x for one in lines], "y": [one.y for one in lines]}


def _ramp(tints: tuple[str, ...]) -> list[str]:
    """A ramp in even steps, fine enough to look smooth."""
    stops = np.array([[int(tint[i : i + 2], 16) for i in (1, 3, 5)] for tint in tints], dtype=float)
    places = np.linspace(0.0, len(stops) - 1.0, 128)
    mixed = [np.interp(places, np.arange(len(stops)), stops[:, part]) for part in range(3)]
    return [f"#{round(r):02x}{round(g):02x}{round(b):02x}" for r, g, b in zip(*mixed, strict=True)]


def _hover(renderer: Any) -> HoverTool:
    words = ["stable", "UNRESOLVED", "unstable", "no answer"]
    told = CustomJSHover(code=f"return {words!r}[Math.round(value) + 1] ?? ''")
    growth = CustomJSHover(code="return Number.isFinite(value) ? `${value.toPrecision(3)} 1/s` : 'not known'")
    return HoverTool(
        renderers=[renderer], visible=False, formatters={"@state": told, "@growth": growth},
        tooltips=[("speed", "$x{0.0} km/h"), ("depth", "$y{0.00} %"), ("state", "@state{custom}"),
                  ("growth", "@growth{custom}")],
    )  # fmt: skip


def _no_image() -> dict[str, Any]:
    return {"growth": [], "state": [], "x": [], "y": [], "dw": [], "dh": []}


def _no_cells() -> dict[str, Any]:
    return {**{name: np.zeros(0) for name in ("left", "right", "bottom", "top")}, "pattern": []}


def _cells(x: np.ndarray[Any, Any], y: np.ndarray[Any, Any], state: np.ndarray[Any, Any]) -> dict[str, Any]:
    """Rectangles of everything that is not stable, each with the hatch of its state."""
    found: list[tuple[float, float, float, float]] = []
    patterns: list[str] = []
    for sort, pattern in _PATTERNS.items():
        own = rectangles(x, y, state == sort) if np.any(state == sort) else []
        found += own
        patterns += [pattern] * len(own)
    table = np.array(found, dtype=float).reshape(-1, 4)
    names = ("left", "right", "bottom", "top")
    return {**{name: np.ascontiguousarray(table[:, k]) for k, name in enumerate(names)}, "pattern": patterns}
