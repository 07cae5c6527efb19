"""Eigenvalues in the complex plane: tracks over speed, and markers that run along them while the speed is moved."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from bokeh.layouts import column
from bokeh.models import (
    BoxAnnotation,
    ColumnDataSource,
    CustomJS,
    Label,
    Range1d,
    Select,
    Slope,
    TapTool,
)

from maglev_ctrl.analysis.tracking import ModeTracks
from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.report.charts_modes import growth_window
from maglev_ctrl.report.style import FAIL_COLOUR, number
from maglev_ctrl.study.live.records import LiveView
from maglev_ctrl.workbench.style import BAD, FADED, FONT, FONT_SIZE, INKED, LIGHT, MARKERS, dress
from maglev_ctrl.workbench.views.cursor import MOVE, Cursor
from maglev_ctrl.workbench.views.frame import frame, hover, palette_mapper, shortened, widget_style, words_only
from maglev_ctrl.workbench.views.legend import legend_block, legend_html, marker_sign, tint_of
from maglev_ctrl.workbench.views.shown import ShownMode, default_mode, mode_words, shown_modes

_DASHES: Final = ("solid", "dashed", "dotted", "dashdot")
_RATIOS: Final = (0.02, 0.05, 0.1, 0.3)  # damping ratios with a ray
_TWO_PI: Final = 2.0 * np.pi
_NONE: Final = "no modes"
MOST_LETTERS: Final = 48  # of a name in the legend
LEAST_STABLE: Final = 0.45  # how much of the stable half plane is seen beside the unstable one, times its width
LEAST_UNSTABLE: Final = 0.2  # and the other way round

# The markers' own values hold at the speed they were computed for; elsewhere they run along the tracks.
_RUN: Final = """
const v = Number(cursor.data.speed[0])
const at = grid.data
const own = at.own[0]
const x = Float64Array.from(exact.growth), y = Float64Array.from(exact.frequency)
const speed = at.speed
if (Math.abs(v - own) > 1e-9 * Math.max(1, Math.abs(own))) {
  let j = 1
  while (j < speed.length - 1 && speed[j] < v) j += 1
  const inside = speed.length > 1 && v >= speed[0] && v <= speed[speed.length - 1]
  const share = inside ? (v - speed[j - 1]) / (speed[j] - speed[j - 1]) : 0
  for (let i = 0; i < x.length; i++) {
    const row = exact.row[i]
    const a = inside && row >= 0 ? tracks.data.x[row] : null
    const b = a === null ? null : tracks.data.y[row]
    x[i] = a === null ? NaN : (1 - share) * a[j - 1] + share * a[j]
    y[i] = b === null ? NaN : (1 - share) * b[j - 1] + share * b[j]
  }
}
"""
_MARK: Final = f"""
const exact = {{growth: marks.data.own_growth, frequency: marks.data.own_frequency, row: marks.data.row}}
{_RUN}
const damping = Float64Array.from(x, (re, i) => {{
  const size = Math.hypot(re, 2 * Math.PI * y[i])
  return size > 0 ? -100 * re / size : NaN
}})
const mode = Number(cursor.data.mode[0])
const size = Float64Array.from(x, (_, i) => i === mode ? 17 : 10)
const edge = Float64Array.from(x, (_, i) => i === mode ? 2.4 : 0.8)
marks.data.x = x; marks.data.y = y; marks.data.damping = damping; marks.data.size = size; marks.data.edge = edge
marks.change.emit()
if (mode >= 0 && mode < marks.data.label.length) picker.setv({{value: String(mode)}}, {{sync: false}})
"""


class EigenvalueView:
    """The complex plane of one option; a tap on a marker, or the list above, picks a mode.

    `root`: what is put on the page; `summary`: the same in a sentence for readers who do not see it.

    Examples
    --------
    >>> view = EigenvalueView(Cursor(100.0))
    >>> view.clear("no equilibrium at this height")
    >>> view.summary
    'Eigenvalues: no equilibrium at this height'
    """

    def __init__(self, cursor: Cursor) -> None:
        self.cursor = cursor
        self.summary = ""
        self.grid = ColumnDataSource({"speed": np.zeros(0), "own": np.zeros(0)})
        self.tracks = ColumnDataSource({"x": [], "y": [], "colour": [], "dash": [], "label": []})
        self.marks = ColumnDataSource(_no_marks())
        self.legend = legend_block("eigenvalue-legend")
        self.figure = frame(
            "eigenvalues", "Eigenvalues over speed", y_label="frequency (Hz)", height=380,
            x_label="growth rate Re s (1/s); dotted: damping ratio 2, 5, 10, 30 %",
        )  # fmt: skip
        self.picker = Select(
            title="Mode looked at",
            options=[("0", _NONE)],
            value="0",
            name="mode-picker",
            sizing_mode="stretch_width",
            stylesheets=[widget_style()],
        )
        self._window: tuple[float, float, float, float] | None = None
        self._lines: tuple[ModeTracks, tuple[tuple[int, int, str], ...]] | None = None  # what is drawn over speed
        self._draw()
        self._link()
        dress(self.figure, False)
        self.figures = (self.figure,)
        self.root = column(self.picker, self.figure, self.legend, sizing_mode="stretch_width", name="eigenvalue-view")

    def _draw(self) -> None:
        drawn = self.figure
        drawn.x_range, drawn.y_range = Range1d(-1.0, 1.0), Range1d(0.0, 1.0)
        drawn.add_layout(
            BoxAnnotation(
                left=0.0,
                fill_color=FAIL_COLOUR,
                fill_alpha=0.09,
                line_color=FAIL_COLOUR,
                line_alpha=0.8,
                level="underlay",
            )
        )
        for ratio in _RATIOS:
            drawn.add_layout(
                Slope(
                    gradient=-np.sqrt(1.0 - ratio**2) / (_TWO_PI * ratio),
                    y_intercept=0.0,
                    line_color=LIGHT.faded,
                    line_dash="dotted",
                    line_alpha=0.55,
                    tags=[FADED],
                    level="underlay",
                )
            )
        drawn.add_layout(
            Label(
                x=0.0,
                y=24,
                y_units="screen",
                x_offset=6,
                text="unstable",
                text_font=FONT,
                text_font_size=FONT_SIZE,
                text_color=LIGHT.bad,
                tags=[BAD],
            )
        )
        mapper = palette_mapper()
        paint = {"field": "colour", "transform": mapper}
        drawn.multi_line("x", "y", source=self.tracks, line_color=paint, line_width=2.0, line_dash="dash",
                         line_alpha=0.85)  # fmt: skip
        self.renderer = drawn.scatter(
            "x", "y", source=self.marks, marker="marker", size="size", fill_color=paint, line_color=LIGHT.ink,
            line_width="edge", fill_alpha=0.95, nonselection_fill_alpha=0.95,
            nonselection_line_alpha=1.0,
        )  # fmt: skip
        self.renderer.glyph.tags = [INKED]
        drawn.add_tools(
            hover([self.renderer], [
                ("mode", "@label"), ("frequency", "@y{0.000} Hz"), ("growth", "@x{0.0000} 1/s"),
                ("damping ratio", "@damping{0.00} %"), ("kind at the computed speed", "@kind"),
            ])
        )  # fmt: skip
        drawn.add_tools(TapTool(renderers=[self.renderer], visible=False))

    def _link(self) -> None:
        args = {
            "cursor": self.cursor.source, "marks": self.marks, "tracks": self.tracks, "grid": self.grid,
            "picker": self.picker,
        }  # fmt: skip
        run = CustomJS(args=args, code=_MARK)
        self.cursor.source.js_on_change("data", run)
        self.marks.js_on_change("data", run)
        self.figure.js_on_change("inner_width", run)
        pick = f"{MOVE}\nconst found = marks.selected.indices\nif (found.length) {{ place({{mode: found[0]}}); "
        self.marks.selected.js_on_change(
            "indices", CustomJS(args=args, code=pick + "marks.selected.setv({indices: []}, {sync: false}) }")
        )
        self.picker.js_on_change("value", CustomJS(args=args, code=f"{MOVE}\nplace({{mode: Number(cb_obj.value)}})"))

    def show(self, view: LiveView) -> None:
        """Put the modes of a view into the figure."""
        if view.modes is None:
            self.clear(view.failure or "the modes could not be computed")
            return
        shown = shown_modes(view)
        labels = tuple(one.label for one in shown)
        self.cursor.keep(labels, default_mode(shown, view.modes))
        self._show_tracks(view, shown)
        self.marks.data = _marks(view, shown, self.cursor.mode)
        legend = legend_html(_legend(shown))
        if legend != self.legend.text:
            self.legend.text = legend
        options = _options(view, shown)
        if options != self.picker.options:
            self.picker.options = options
        self.picker.value = str(self.cursor.mode)
        self._zoom(view, shown)
        self.figure.title.text = words_only(f"Eigenvalues of {view.label} over speed")
        growing = [one for one in shown if view.modes.s[one.mode].real > view.modes.error_bound[one.mode]]
        told = "; ".join(f"{one.label}: {mode_words(view.modes, one.mode)}" for one in growing)
        self.summary = (
            f"Eigenvalues of {view.label} at {number(3.6 * view.speed, 'km/h')}: {view.modes.verdict.value}; "
            + (f"growing: {told}." if growing else f"none of {len(shown)} shown modes grows.")
        )  # fmt: skip

    def clear(self, reason: str) -> None:
        """Nothing to show, and why."""
        self.marks.data, self._lines = _no_marks(), None
        self.tracks.data = {"x": [], "y": [], "colour": [], "dash": [], "label": []}
        self.grid.data = {"speed": np.zeros(0), "own": np.zeros(0)}
        self.legend.text = ""
        self.figure.title.text = words_only(f"Eigenvalues: {reason}")
        self.summary = f"Eigenvalues: {reason}"

    def _show_tracks(self, view: LiveView, shown: tuple[ShownMode, ...]) -> None:
        tracks = view.tracks
        rows = [one for one in shown if one.track >= 0 and tracks is not None]
        speed = np.array([view.speed]) if tracks is None else np.array(tracks.parameter)
        self.grid.data = {"speed": speed, "own": np.full(len(speed), view.speed)}
        lines = tuple((one.track, one.colour, one.label) for one in rows)
        if tracks is not None and self._lines is not None and self._lines[0] is tracks and self._lines[1] == lines:
            return
        self._lines = None if tracks is None else (tracks, lines)
        s = np.zeros((0, 0), dtype=complex) if tracks is None else tracks.s
        self.tracks.data = {
            "x": [np.array(s[:, one.track].real) for one in rows],
            "y": [np.array(s[:, one.track].imag) / _TWO_PI for one in rows],
            "colour": np.array([one.colour % len(LIGHT.palette) for one in rows], dtype=np.int32),
            "dash": [_DASHES[one.colour // len(LIGHT.palette) % len(_DASHES)] for one in rows],
            "label": [one.label for one in rows],
        }

    def _zoom(self, view: LiveView, shown: tuple[ShownMode, ...]) -> None:
        """The window of the dominant modes; one that the reader has chosen stays."""
        window = _window(view, shown)
        x, y = self.figure.x_range, self.figure.y_range
        now = (x.start, x.end, y.start, y.end)
        untouched = self._window is None or all(
            value is not None and abs(value - own) <= 1e-6 * max(1.0, abs(own))
            for value, own in zip(now, self._window, strict=True)
        )
        if window == self._window:
            return
        for range_, low, high in ((x, window[0], window[1]), (y, window[2], window[3])):
            if untouched:
                range_.update(start=low, end=high, reset_start=low, reset_end=high)
            else:
                range_.update(reset_start=low, reset_end=high)
        if untouched:
            self._window = window


def _no_marks() -> dict[str, Any]:
    names = ("x", "y", "own_growth", "own_frequency", "damping", "size", "edge")
    return {
        **{name: np.zeros(0) for name in names}, "colour": np.zeros(0, dtype=np.int32),
        "row": np.zeros(0, dtype=np.int32), "marker": [], "label": [], "kind": [],
    }  # fmt: skip


def _options(view: LiveView, shown: tuple[ShownMode, ...]) -> list[tuple[str, str]]:
    """The list of modes; their numbers once the view rests, for a list that changes lays out the page again."""
    found = view.modes
    if found is None or not shown:
        return [("0", _NONE)]
    if not view.settled:
        return [(str(k), one.label) for k, one in enumerate(shown)]
    return [(str(k), f"{one.label}: {mode_words(found, one.mode)}") for k, one in enumerate(shown)]


def _legend(shown: tuple[ShownMode, ...]) -> list[tuple[str, str]]:
    """Marker and name of every shown mode."""
    return [
        (marker_sign(MARKERS[one.colour % len(MARKERS)], tint_of(one.colour)), shortened(one.label, MOST_LETTERS))
        for one in shown
    ]


def _marks(view: LiveView, shown: tuple[ShownMode, ...], picked: int) -> dict[str, Any]:
    """Markers at the operating point; `row`: place of the mode's track among the drawn ones, -1 without one."""
    if view.modes is None:
        return _no_marks()
    found, places = view.modes, [one.mode for one in shown]
    rows = {one.track: row for row, one in enumerate(one for one in shown if one.track >= 0)}
    growth, frequency = np.array(found.s[places].real), np.array(found.frequency[places])
    mine = np.arange(len(shown)) == picked
    return {
        "x": growth, "y": frequency, "own_growth": growth, "own_frequency": frequency,
        "damping": 100.0 * np.array(found.damping_ratio[places]),
        "size": np.where(mine, 17.0, 10.0), "edge": np.where(mine, 2.4, 0.8),
        "colour": np.array([one.colour % len(LIGHT.palette) for one in shown], dtype=np.int32),
        "row": np.array([rows.get(one.track, -1) for one in shown], dtype=np.int32),
        "marker": [MARKERS[one.colour % len(MARKERS)] for one in shown],
        "label": [one.label for one in shown], "kind": [found.kind[one.mode].value for one in shown],
    }  # fmt: skip


def _window(view: LiveView, shown: tuple[ShownMode, ...]) -> tuple[float, float, float, float]:
    """Window of the dominant modes, in steps, so that it rests while a slider moves."""
    values: list[np.ndarray[Any, Any]] = []
    if view.modes is not None:
        values.append(np.array([view.modes.s[one.mode] for one in shown], dtype=complex))
    if view.tracks is not None:
        values.append(view.tracks.s[:, [one.track for one in shown if one.track >= 0]].ravel())
    s = np.concatenate(values) if values else np.zeros(0, dtype=complex)
    low, high = both_sides(*growth_window(s))
    with np.errstate(invalid="ignore"):
        seen = s.imag[(s.real >= low) & (s.real <= high)]
    top = float(np.max(seen, initial=0.0)) / _TWO_PI or 1.0
    return -_step(-low), _step(high), -0.04 * _step(1.08 * top), _step(1.08 * top)


def both_sides(low: float, high: float) -> tuple[float, float]:
    """The window with enough of both half planes in it to see at a glance on which side a mode stands.

    Examples
    --------
    >>> both_sides(-1.0, 0.02), both_sides(-0.02, 1.0)
    ((-1.0, 0.2), (-0.45, 1.0))
    """
    return min(low, -LEAST_STABLE * high), max(high, LEAST_UNSTABLE * -low)


def _step(value: float) -> float:
    """The next number of a scale of about ten steps per decade that is not below a positive one; negative ones too."""
    if value == 0.0:
        return 0.0
    base = 10.0 ** np.floor(np.log10(abs(value)))
    steps: FloatArray = base * np.array([1.0, 1.2, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0])
    return float(steps[steps >= abs(value) * (1.0 - 1e-9)][0]) * (1.0 if value > 0.0 else -1.0)
