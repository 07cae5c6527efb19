"""The picked mode on the vehicle's own geometry, moved by the browser."""

from __future__ import annotations

from importlib.resources import files
from typing import Any, Final

import numpy as np
from bokeh.layouts import column, row
from bokeh.models import ColumnDataSource, CustomJS, Range1d, Slider, Toggle

from maglev_ctrl.analysis.modes import Modes
from maglev_ctrl.study.live.records import LiveView
from maglev_ctrl.workbench.style import FADED, FONT, INKED, LIGHT, dress
from maglev_ctrl.workbench.views.cursor import Cursor
from maglev_ctrl.workbench.views.frame import frame, palette_mapper, words_block, words_only
from maglev_ctrl.workbench.views.shape_parts import AXIS_WORDS, MovingShape, moving_shape
from maglev_ctrl.workbench.views.shown import ShownMode, default_mode, mode_words, shown_modes
from maglev_ctrl.workbench.views.table import escaped

LEAST_CYCLE: Final = 0.4  # a cycle shown lets a mode grow or decay by no more than this factor, or its inverse
PAUSE, PLAY = "Pause", "Play"


class ShapeView:
    """Boxes, magnets, springs and actuators, swinging in the picked mode; shapes of all shown modes are in the browser.

    The motion rests while the page is hidden or the figure out of sight, and begins paused for readers who ask their
    system for less motion.

    Examples
    --------
    >>> view = ShapeView(Cursor(100.0))
    >>> view.clear("no equilibrium")
    >>> view.summary
    'Mode shape: no equilibrium'
    """

    def __init__(self, cursor: Cursor) -> None:
        self.cursor = cursor
        self.summary = ""
        self.points = ColumnDataSource(_no_points())
        self.modes = ColumnDataSource(_no_modes())
        self.boxes = ColumnDataSource({"xs": [], "ys": [], "colour": []})
        self.still = ColumnDataSource({"xs": [], "ys": []})
        self.strokes = {
            kind: ColumnDataSource({"x": np.zeros(0), "y": np.zeros(0)}) for kind in ("magnet", "spring", "actuator")
        }
        self.rail = ColumnDataSource({"x": np.zeros(0), "y": np.zeros(0)})
        self.names = ColumnDataSource({"x": np.zeros(0), "y": np.zeros(0), "text": []})
        self.figure = frame("shape", "Mode shape", x_label="along the track (m)", y_label="", height=280, zoom=False)
        self.play = Toggle(label=PAUSE, active=True, name="shape-play", width=80)
        self.grow = Toggle(label="Show growth and decay", active=False, name="shape-grow", width=190)
        self.amplitude = Slider(
            start=0.0, end=3.0, step=0.1, value=1.0, title="Amplitude", name="shape-amplitude", width=170
        )
        self.words = words_block("shape-words")
        self._draw()
        self._link()
        dress(self.figure, False)
        self.figures = (self.figure,)
        controls = row(self.play, self.grow, self.amplitude, sizing_mode="stretch_width")
        self.root = column(self.figure, controls, self.words, sizing_mode="stretch_width", name="shape-view")

    def _draw(self) -> None:
        drawn = self.figure
        drawn.x_range, drawn.y_range = Range1d(-1.0, 1.0), Range1d(-1.0, 1.0)
        drawn.yaxis.visible = False
        drawn.grid.visible = False
        paint = {"field": "colour", "transform": palette_mapper()}
        rest = drawn.multi_line("xs", "ys", source=self.still, line_color=LIGHT.faded, line_width=1.0,
                                line_dash="dotted")  # fmt: skip
        rest.glyph.tags = [FADED]
        rail = drawn.line("x", "y", source=self.rail, line_color=LIGHT.ink, line_width=5.0, line_alpha=0.55)
        rail.glyph.tags = [INKED]
        for kind, width in (("spring", 1.4), ("actuator", 4.0), ("magnet", 3.2)):
            made = drawn.line("x", "y", source=self.strokes[kind], line_color=LIGHT.ink, line_width=width,
                              line_join="round", line_cap="butt" if kind == "magnet" else "round",
                              legend_label={"spring": "springs and dampers", "actuator": "actuators",
                                            "magnet": "magnets"}[kind])  # fmt: skip
            made.glyph.tags = [INKED]
        drawn.patches("xs", "ys", source=self.boxes, fill_color=paint, line_color=paint, fill_alpha=0.45,
                      line_width=2.2)  # fmt: skip
        words = drawn.text("x", "y", "text", source=self.names, text_font=FONT, text_font_size="12px",
                           text_align="center", text_baseline="middle", text_color=LIGHT.ink)  # fmt: skip
        words.glyph.tags = [INKED]
        legend = drawn.legend[0]
        drawn.add_layout(legend, "below")
        legend.orientation, legend.label_text_font, legend.label_text_font_size = "horizontal", FONT, "11px"
        legend.background_fill_alpha = legend.border_line_alpha = 0.0

    def _link(self) -> None:
        args = {
            "cursor": self.cursor.source, "points": self.points, "modes": self.modes, "boxes": self.boxes,
            "still": self.still, "magnet": self.strokes["magnet"], "spring": self.strokes["spring"],
            "actuator": self.strokes["actuator"], "rail": self.rail, "names": self.names, "figure": self.figure,
            "x_range": self.figure.x_range, "y_range": self.figure.y_range, "play": self.play, "grow": self.grow,
            "amplitude": self.amplitude, "words": self.words, "axis": self.figure.xaxis[0],
        }  # fmt: skip
        code = files("maglev_ctrl.workbench.views").joinpath("shape.js").read_text(encoding="utf-8")
        run = CustomJS(args=args, code=code)
        self.cursor.source.js_on_change("data", run)
        self.modes.js_on_change("data", run)
        self.figure.js_on_change("inner_width", run)
        self.play.js_on_change("active", run)
        self.grow.js_on_change("active", run)
        self.amplitude.js_on_change("value", run)

    def show(self, view: LiveView) -> None:
        """Give the browser the shapes of a view's modes; the picked one swings."""
        if view.modes is None:
            self.clear(view.failure or "the modes could not be computed")
            return
        shown = shown_modes(view)
        self.cursor.keep(tuple(one.label for one in shown), default_mode(shown, view.modes))
        shapes = [moving_shape(view.vehicle, view.modes.shapes[:, one.mode]) for one in shown]
        self.points.data = _points(shapes)
        self.modes.data = _modes(view.modes, shown, shapes)
        place = self.cursor.mode
        if 0 <= place < len(shown):
            one = shown[place]
            seen = AXIS_WORDS[shapes[place].view][1]
            self.summary = f"Mode shape of {one.label} ({mode_words(view.modes, one.mode)}), {seen}."
            self.figure.title.text = words_only(f"Mode shape: {one.label}")

    def clear(self, reason: str) -> None:
        """Nothing to show, and why."""
        self.points.data, self.modes.data = _no_points(), _no_modes()
        self.figure.title.text = "Mode shape"
        self.words.text = f"<p>{escaped(reason)}</p>"
        self.summary = f"Mode shape: {reason}"


def _points(shapes: list[MovingShape]) -> dict[str, Any]:
    """All points of all parts one after the other; `part` counts them up, `kind` and `colour` say what they are."""
    kinds = ("box", "magnet", "spring", "actuator")
    columns: dict[str, list[Any]] = {name: [] for name in ("mode", "part", "kind", "colour")}
    rest, moved = [np.zeros((0, 2))], [np.zeros((0, 2), dtype=complex)]
    count = 0
    for place, shape in enumerate(shapes):
        for part in shape.parts:
            size = len(part.rest)
            columns["mode"].append(np.full(size, place))
            columns["part"].append(np.full(size, count))
            columns["kind"].append(np.full(size, kinds.index(part.kind)))
            columns["colour"].append(np.full(size, part.colour % len(LIGHT.palette)))
            rest.append(part.rest)
            moved.append(part.moved)
            count += 1
    at, step = np.concatenate(rest), np.concatenate(moved)
    numbers = {"x": at[:, 0], "y": at[:, 1], "x_re": step[:, 0].real, "x_im": step[:, 0].imag,
               "y_re": step[:, 1].real, "y_im": step[:, 1].imag}  # fmt: skip
    return {
        **{name: np.concatenate([np.zeros(0), *made]).astype(np.int32) for name, made in columns.items()},
        **{name: np.asarray(values, dtype=np.float32) for name, values in numbers.items()},
    }


def _modes(found: Modes, shown: tuple[ShownMode, ...], shapes: list[MovingShape]) -> dict[str, Any]:
    """One row per mode: where it is seen from, its window, its cycle, and what is said of it."""
    cycle, swings, words, labels = [], [], [], []
    names_x, names_y, names_text = [], [], []
    for one, shape in zip(shown, shapes, strict=True):
        s = complex(found.s[one.mode])
        oscillates = s.imag > found.error_bound[one.mode]
        factor = np.exp(2.0 * np.pi * s.real / s.imag) if oscillates else np.exp(np.sign(s.real))
        cycle.append(float(np.clip(factor, LEAST_CYCLE, 1.0 / LEAST_CYCLE)))
        swings.append(1 if oscillates else 0)
        labels.append(words_only(f"Mode shape: {one.label}"))
        said = f"{mode_words(found, one.mode)}; {AXIS_WORDS[shape.view][1]}, displacements and heights not to scale."
        words.append(f'<p class="quiet">{escaped(said)}</p>')
        named = [part for part in shape.parts if part.kind == "box"]
        names_x.append(np.array([float(np.mean(part.rest[:, 0])) for part in named]))
        names_y.append(np.array([float(np.mean(part.rest[:, 1])) for part in named]))
        names_text.append([part.name for part in named])
    window = np.array([shape.window for shape in shapes]).reshape(-1, 4)
    return {
        **{name: window[:, k].copy() for k, name in enumerate(("left", "right", "bottom", "top"))},
        "level": np.array([shape.rail[0, 1] if len(shape.rail) else np.nan for shape in shapes]),
        "axis": [AXIS_WORDS[shape.view][0] for shape in shapes], "cycle": np.array(cycle),
        "swings": np.array(swings, dtype=np.int32), "title": labels, "words": words,
        "names_x": names_x, "names_y": names_y, "names": names_text,
    }  # fmt: skip


def _no_points() -> dict[str, Any]:
    return _points([])


def _no_modes() -> dict[str, Any]:
    names = ("left", "right", "bottom", "top", "level", "cycle")
    return {**{name: np.zeros(0) for name in names}, "swings": np.zeros(0, dtype=np.int32), "axis": [], "title": [],
            "words": [], "names_x": [], "names_y": [], "names": []}  # fmt: skip
