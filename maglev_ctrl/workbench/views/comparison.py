"""All options side by side at the cursor's point, the current one marked."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from bokeh.layouts import column
from bokeh.models import (
    BasicTicker,
    BoxAnnotation,
    ColumnDataSource,
    CustomJSTickFormatter,
    DataRange1d,
    FixedTicker,
    GridBox,
    Range1d,
    Span,
)

from maglev_ctrl.errors import Verdict
from maglev_ctrl.report.model import SIGNS, Cell, cell
from maglev_ctrl.report.style import FAIL_COLOUR, number
from maglev_ctrl.study.live.records import LiveComparison
from maglev_ctrl.workbench.style import INKED, LIGHT, dress
from maglev_ctrl.workbench.views.frame import frame, hover, palette_mapper, words_block
from maglev_ctrl.workbench.views.table import TABLE_STYLE, escaped, table_html

# field of the record, words, unit on the axis, factor to it, and whether low values are the bad ones
QUANTITIES: Final = (
    ("growth", "growth", "1/s", 1.0, False),
    ("least_damping", "least damping", "%", 100.0, True),
    ("disk_margin", "disk margin", "", 1.0, True),
    ("periodic_growth", "growth, modulated", "1/s", 1.0, False),
)
WAITING: Final = "The options are compared when the checks are done ..."
WIDTH, NAMED_WIDTH = 150, 370  # px at least, of a panel and of the one with the names
_NAME: Final = """
const place = Math.round(-tick)
const name = source.data.label[place]
if (name === undefined) return ''
const short = name.length > 30 ? name.slice(0, 29) + '\u2026' : name
return (source.data.current[place] ? '\u25b6 ' : '') + short
"""


class ComparisonView:
    """Growth, least damping, disk margin and growth with modulation of every option, on axes of one order.

    Examples
    --------
    >>> view = ComparisonView()
    >>> view.clear("not computed yet")
    >>> view.summary
    'Comparison: not computed yet'
    """

    def __init__(self) -> None:
        self.summary = ""
        self.options = ColumnDataSource(_no_options())
        self.words = words_block("comparison-words", f'<p class="quiet">{WAITING}</p>')
        self.words.stylesheets[0].css = TABLE_STYLE
        self._names = Range1d(-1.5, 0.5)
        self._ticker = FixedTicker(ticks=[0])
        self.figures: tuple[Any, ...] = ()
        self.root = column(self.words, sizing_mode="stretch_width", name="comparison-view")

    def draw(self) -> bool:
        """Make the panels, which come with the first comparison: a page that opens has enough to build. Whether they
        are new."""
        if self.figures:
            return False
        self.figures = tuple(self._panel(k) for k in range(len(QUANTITIES)))
        for figure in self.figures:
            dress(figure, False)
        panels = GridBox(
            children=[(figure, 0, k) for k, figure in enumerate(self.figures)], spacing=6, sizing_mode="stretch_width",
            cols=[f"minmax({NAMED_WIDTH}px, 1.8fr)", *([f"minmax({WIDTH}px, 1fr)"] * (len(self.figures) - 1))],
        )  # fmt: skip
        self.root.children = [panels, self.words]
        return True

    def _panel(self, place: int) -> Any:
        name, words, unit, _, bad_low = QUANTITIES[place]
        label = f"{words} ({unit})" if unit else words
        drawn = frame(f"comparison-{name}", words.capitalize(), x_label=label, y_label="", height=200, zoom=False)
        drawn.min_width = WIDTH if place else NAMED_WIDTH
        drawn.xaxis[0].ticker = drawn.xgrid[0].ticker = BasicTicker(desired_num_ticks=4, num_minor_ticks=0)
        drawn.y_range, drawn.x_range = self._names, DataRange1d(range_padding=0.18)
        if name == "disk_margin":
            drawn.x_range.start = 0.0
        axis = drawn.yaxis[0]
        axis.ticker = self._ticker
        axis.formatter = CustomJSTickFormatter(args={"source": self.options}, code=_NAME if place == 0 else "return ''")
        axis.major_tick_line_color = None
        if name != "disk_margin":
            drawn.add_layout(
                BoxAnnotation(
                    left=None if bad_low else 0.0,
                    right=0.0 if bad_low else None,
                    fill_color=FAIL_COLOUR,
                    fill_alpha=0.09,
                    line_color=None,
                    level="underlay",
                )
            )
        drawn.add_layout(Span(location=0.0, dimension="height", line_color=LIGHT.ink, line_width=1.0, tags=[INKED]))
        paint = {"field": "tint", "transform": palette_mapper()}
        marks = drawn.scatter(
            name, "slot", source=self.options, size="size", marker="marker", fill_color=paint, line_color=paint,
            line_width=2.0,
        )  # fmt: skip
        drawn.add_tools(hover([marks], [("option", "@label"), (words, f"@{name}{{0.0000}} {unit}"),
                                        ("verdict", "@verdict")]))  # fmt: skip
        return drawn

    def show(self, found: LiveComparison, current: str = "") -> None:
        """Put the options into the panels; `current` is the name of the one the page shows."""
        count = len(found.options)
        if not count:
            self.clear("the scenario has no options")
            return
        self.draw()
        mine = [name == current for name in found.options]
        self.options.data = {
            "label": list(found.labels), "current": mine, "slot": -np.arange(count, dtype=float),
            "size": np.where(mine, 15.0, 10.0), "marker": ["diamond" if one else "circle" for one in mine],
            "tint": np.array(mine, dtype=np.int32),
            "verdict": [f"{SIGNS[one]} {one.value}" for one in found.verdicts],
            **{name: factor * np.asarray(getattr(found, name), float) for name, _, _, factor, _ in QUANTITIES},
        }  # fmt: skip
        ticks = [-k for k in range(count)]
        if self._ticker.ticks != ticks:
            self._ticker.ticks = ticks
            self._names.update(start=0.4 - count, end=0.6)
            for figure in self.figures:
                figure.height = 100 + 34 * max(count, 2)
        self.words.text = _table(found, current)
        passed = [label for label, one in zip(found.labels, found.verdicts, strict=True) if one is Verdict.PASS]
        growth = ", ".join(f"{label} {number(float(value), '1/s')}"
                           for label, value in zip(found.labels, found.growth, strict=True))  # fmt: skip
        self.summary = (
            f"Comparison of {count} options, growth rate: {growth}. "
            + (f"Stable: {', '.join(passed)}." if passed else "None is proved stable.")
        )  # fmt: skip

    def clear(self, reason: str) -> None:
        """Nothing to show, and why."""
        self.options.data = _no_options()
        self.words.text = f"<p>{escaped(reason)}</p>"
        self.summary = f"Comparison: {reason}"


def _table(found: LiveComparison, current: str) -> str:
    rows = []
    for k, name in enumerate(found.options):
        values = [
            Cell(number(factor * float(getattr(found, field)[k]), unit)) for field, _, unit, factor, _ in QUANTITIES
        ]
        label = f"▶ {found.labels[k]} (shown)" if name == current else found.labels[k]
        rows.append((Cell(label), *values, cell(found.verdicts[k]), Cell(found.reasons[k])))
    heads = ("Option", *(words.capitalize() for _, words, *_ in QUANTITIES), "Verdict", "Why not all is known")
    return table_html("Options at this operating point", heads, rows, right=(1, 2, 3, 4))


def _no_options() -> dict[str, Any]:
    names = ("slot", "size", *(one[0] for one in QUANTITIES))
    return {
        **{name: np.zeros(0) for name in names}, "label": [], "current": [], "marker": [], "verdict": [],
        "tint": np.zeros(0, dtype=np.int32),
    }  # fmt: skip
