"""The picked mode on the vehicle's own geometry, moved by the browser."""

from __future__ import annotations

from importlib.resources import files
from typing import Any, Final

import numpy as np
from bokeh.core.properties import value
from bokeh.layouts import column, row
from bokeh.models import ColumnDataSource, CustomJS, Range1d, Select, Toggle

from maglev_ctrl.analysis.modes import Modes
from maglev_ctrl.arrays import ComplexArray
from maglev_ctrl.study.live.records import LiveView
from maglev_ctrl.workbench.style import FADED, FONT, INKED, LIGHT, dress
from maglev_ctrl.workbench.views.cursor import Cursor
from maglev_ctrl.workbench.views.frame import (
    TELL,
    frame,
    palette_mapper,
    widget_style,
    words_block,
    words_only,
)
from maglev_ctrl.workbench.views.legend import legend_block, line_sign
from maglev_ctrl.workbench.views.shape_parts import AXIS_WORDS, Scene, moved
from maglev_ctrl.workbench.views.shown import ShownMode, default_mode, mode_words, shown_modes
from maglev_ctrl.workbench.views.table import escaped

LEAST_CYCLE: Final = 0.4  # a cycle shown lets a mode grow or decay by no more than this factor, or its inverse
PAUSE, PLAY = "Pause", "Play"
AMPLITUDES: Final = (("0", "none"), ("0.5", "half"), ("1", "normal"), ("2", "double"), ("3", "threefold"))
_LEGEND: Final = (
    (line_sign(1.4), "springs and dampers"), (line_sign(4.0), "actuators"), (line_sign(3.2), "magnets"),
)  # fmt: skip


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
        self.play = Toggle(
            label=PAUSE, active=True, name="shape-play", width=80, align="end", stylesheets=[widget_style()]
        )
        self.grow = Toggle(
            label="Show growth and decay", active=False, name="shape-grow", width=190, align="end",
            stylesheets=[widget_style()],
        )  # fmt: skip
        # A list rather than Bokeh's slider, whose handle has no name for those who hear the page.
        self.amplitude = Select(
            title="Amplitude", options=list(AMPLITUDES), value="1", name="shape-amplitude", width=110,
            stylesheets=[widget_style()],
        )  # fmt: skip
        self.legend = legend_block("shape-legend", _LEGEND)
        self.words = words_block("shape-words")
        self._draw()
        self._link()
        dress(self.figure, False)
        self.figures = (self.figure,)
        controls = row(self.play, self.grow, self.amplitude, sizing_mode="stretch_width")
        self.root = column(
            self.figure, self.legend, controls, self.words, sizing_mode="stretch_width", name="shape-view"
        )

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
                              line_join="round", line_cap="butt" if kind == "magnet" else "round")  # fmt: skip
            made.glyph.tags = [INKED]
        drawn.patches("xs", "ys", source=self.boxes, fill_color=paint, line_color=paint, fill_alpha=0.45,
                      line_width=2.2)  # fmt: skip
        named = drawn.text("x", "y", "text", source=self.names, text_font=value(FONT), text_font_size="12px",
                           text_align="center", text_baseline="middle", text_color=LIGHT.ink)  # fmt: skip
        named.glyph.tags = [INKED]

    def _link(self) -> None:
        args = {
            "cursor": self.cursor.source, "points": self.points, "modes": self.modes, "boxes": self.boxes,
            "still": self.still, "magnet": self.strokes["magnet"], "spring": self.strokes["spring"],
            "actuator": self.strokes["actuator"], "rail": self.rail, "names": self.names, "figure": self.figure,
            "x_range": self.figure.x_range, "y_range": self.figure.y_range, "play": self.play, "grow": self.grow,
            "amplitude": self.amplitude, "words": self.words, "axis": self.figure.xaxis[0],
        }  # fmt: skip
        code = files("maglev_ctrl.workbench.views").joinpath("shape.js").read_text(encoding="utf-8")
        run = CustomJS(args=args, code=TELL + code)
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
        if self.words.text:
            self.words.text = ""  # why there was nothing; what is said of a mode is put there by the browser
        shapes = [moved(view.vehicle, view.modes.shapes[:, one.mode]) for one in shown]
        self.points.data = _points(shapes)
        self.modes.data = _modes(view.modes, shown, shapes)
        place = self.cursor.mode
        if 0 <= place < len(shown):
            one = shown[place]
            seen = AXIS_WORDS[shapes[place][0].view][1]
            self.summary = f"Mode shape of {one.label} ({mode_words(view.modes, one.mode)}), {seen}."
            self.figure.title.text = words_only(f"Mode shape: {one.label}")

    def clear(self, reason: str) -> None:
        """Nothing to show, and why."""
        self.points.data, self.modes.data = _no_points(), _no_modes()
        self.figure.title.text = "Mode shape"
        self.words.text = f"<p>{escaped(reason)}</p>"
        self.summary = f"Mode shape: {reason}"


def _points(shapes: list[tuple[Scene, ComplexArray]]) -> dict[str, Any]:
    """All points of all parts one after the other; `part` counts them up, `kind` and `colour` say what they are."""
    counts = np.cumsum([0, *(int(scene.part[-1]) + 1 for scene, _ in shapes)])
    steps = np.concatenate([np.zeros((0, 2), dtype=complex), *(step for _, step in shapes)])
    rest = np.concatenate([np.zeros((0, 2)), *(scene.rest for scene, _ in shapes)])
    whole: dict[str, list[Any]] = {
        "mode": [np.full(len(scene.rest), place) for place, (scene, _) in enumerate(shapes)],
        "part": [scene.part + first for (scene, _), first in zip(shapes, counts, strict=False)],
        "kind": [scene.kind for scene, _ in shapes],
        "colour": [scene.colour % len(LIGHT.palette) for scene, _ in shapes],
    }
    numbers = {"x": rest[:, 0], "y": rest[:, 1], "x_re": steps[:, 0].real, "x_im": steps[:, 0].imag,
               "y_re": steps[:, 1].real, "y_im": steps[:, 1].imag}  # fmt: skip
    return {
        **{name: np.concatenate([np.zeros(0), *made]).astype(np.int32) for name, made in whole.items()},
        **{name: np.asarray(values, dtype=np.float32) for name, values in numbers.items()},
    }


def _modes(found: Modes, shown: tuple[ShownMode, ...], shapes: list[tuple[Scene, ComplexArray]]) -> dict[str, Any]:
    """One row per mode: where it is seen from, its window, its cycle, and what is said of it."""
    cycle, swings, words, labels = [], [], [], []
    for one, (scene, _) in zip(shown, shapes, strict=True):
        s = complex(found.s[one.mode])
        oscillates = s.imag > found.error_bound[one.mode]
        factor = np.exp(2.0 * np.pi * s.real / s.imag) if oscillates else np.exp(np.sign(s.real))
        cycle.append(float(np.clip(factor, LEAST_CYCLE, 1.0 / LEAST_CYCLE)))
        swings.append(1 if oscillates else 0)
        labels.append(words_only(f"Mode shape: {one.label}"))
        said = f"{mode_words(found, one.mode)}; {AXIS_WORDS[scene.view][1]}, displacements and heights not to scale."
        words.append(f'<p class="quiet">{escaped(said)}</p>')
    drawn = [scene for scene, _ in shapes]
    window = np.array([scene.window for scene in drawn]).reshape(-1, 4)
    return {
        **{name: window[:, k].copy() for k, name in enumerate(("left", "right", "bottom", "top"))},
        "level": np.array([scene.level for scene in drawn]), "axis": [AXIS_WORDS[scene.view][0] for scene in drawn],
        "cycle": np.array(cycle), "swings": np.array(swings, dtype=np.int32), "title": labels, "words": words,
        "names_x": [scene.places[:, 0].copy() for scene in drawn],
        "names_y": [scene.places[:, 1].copy() for scene in drawn], "names": [list(scene.names) for scene in drawn],
    }  # fmt: skip


def _no_points() -> dict[str, Any]:
    return _points([])


def _no_modes() -> dict[str, Any]:
    names = ("left", "right", "bottom", "top", "level", "cycle")
    return {**{name: np.zeros(0) for name in names}, "swings": np.zeros(0, dtype=np.int32), "axis": [], "title": [],
            "words": [], "names_x": [], "names_y": [], "names": []}  # fmt: skip
