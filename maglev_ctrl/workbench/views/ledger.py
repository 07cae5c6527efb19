"""The energy ledger of the picked mode: which elements feed it, which damp it, through damping and circulation."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from bokeh.layouts import column
from bokeh.models import (
    CDSView,
    ColumnDataSource,
    CustomJS,
    CustomJSFilter,
    CustomJSTickFormatter,
    FixedTicker,
    Range1d,
    Span,
)

from maglev_ctrl.analysis.modes import Modes
from maglev_ctrl.report.groups import ledger_groups
from maglev_ctrl.report.style import number
from maglev_ctrl.study.live.records import LiveView
from maglev_ctrl.workbench.style import INKED, LIGHT, SOLID, dress
from maglev_ctrl.workbench.views.cursor import Cursor
from maglev_ctrl.workbench.views.frame import TELL, frame, hover, words_block, words_only
from maglev_ctrl.workbench.views.legend import INK, box_sign, legend_block, marker_sign
from maglev_ctrl.workbench.views.shown import default_mode, mode_words, shown_modes
from maglev_ctrl.workbench.views.table import escaped

MOST_ROWS: Final = 10
SUM: Final = "sum = growth rate"
_LEGEND: Final = (
    (box_sign(LIGHT.palette[0]), "through damping"),
    (box_sign("transparent", "right_diagonal_line", LIGHT.palette[1]), "through circulation (non-symmetric stiffness)"),
    (marker_sign("diamond", INK), SUM),
)
_PICKED: Final = """
const mode = Number(cursor.data.mode[0])
const found = []
const column = source.data.mode ?? []
for (let i = 0; i < column.length; i++) if (column[i] === mode) found.push(i)
return found
"""
_NAME: Final = """
const mode = Number(cursor.data.mode[0])
const {mode: modes, name, slot} = source.data
for (let i = 0; i < modes.length; i++) {
  if (modes[i] === mode && slot[i] === tick) return name[i].length > 26 ? name[i].slice(0, 25) + '\u2026' : name[i]
}
return ''
"""
_FOLLOW: Final = (
    TELL
    + """
const mode = Number(cursor.data.mode[0])
if (cb_obj === cursor && source.followed === source.data && source.mode_shown === mode) return // only the speed moved
source.followed = source.data
source.mode_shown = mode
let reach = 0, rows = 0
const {mode: modes, damping, circulatory, total, slot} = source.data
for (let i = 0; i < modes.length; i++) {
  if (modes[i] !== mode) continue
  rows += 1
  for (const value of [damping[i], circulatory[i], total[i]]) if (Math.abs(value) > reach) reach = Math.abs(value)
}
const told = titles.data
figure.title.setv({text: told.title[mode] ?? 'Energy ledger'}, {sync: false})
tell(words, told.words[mode] ?? told.words[0] ?? '')
if (reach > 0) x_range.setv({start: -1.12 * reach, end: 1.12 * reach}, {sync: false})
y_range.setv({start: 0.4 - Math.max(rows, 1), end: 0.7}, {sync: false})
source.change.emit()
figure.request_paint?.()
"""
)


class LedgerView:
    """Shares of the picked mode's growth rate, element by element; those of all shown modes are in the browser.

    Examples
    --------
    >>> view = LedgerView(Cursor(100.0))
    >>> view.clear("no equilibrium")
    >>> view.summary
    'Energy ledger: no equilibrium'
    """

    def __init__(self, cursor: Cursor) -> None:
        self.cursor = cursor
        self.summary = ""
        self.rows = ColumnDataSource(_no_rows())
        self.titles = ColumnDataSource({"title": [], "words": []})
        self.words = words_block("ledger-words")
        self.figure = frame(
            "ledger", "Energy ledger", x_label="share of the growth rate (1/s)", y_label="", height=340, zoom=False
        )
        self.legend = legend_block("ledger-legend", _LEGEND)
        self._draw()
        self._link()
        dress(self.figure, False)
        self.figures = (self.figure,)
        self.root = column(self.figure, self.legend, self.words, sizing_mode="stretch_width", name="ledger-view")

    def _draw(self) -> None:
        drawn = self.figure
        drawn.x_range, drawn.y_range = Range1d(-1.0, 1.0), Range1d(-10.5, 0.7)
        args = {"cursor": self.cursor.source, "source": self.rows}
        axis = drawn.yaxis[0]
        axis.ticker = FixedTicker(ticks=[-k for k in range(MOST_ROWS + 2)])
        axis.formatter = CustomJSTickFormatter(args=args, code=_NAME)
        axis.major_tick_line_color = None
        drawn.ygrid.visible = False
        view = CDSView(filter=CustomJSFilter(args={"cursor": self.cursor.source}, code=_PICKED))
        drawn.add_layout(Span(location=0.0, dimension="height", line_width=1.2, line_color=LIGHT.ink, tags=[INKED]))
        bars = []
        for name, at, tint, pattern in (
            ("damping", "upper", LIGHT.palette[0], None), ("circulatory", "lower", LIGHT.palette[1], "/"),
        ):  # fmt: skip
            bar = drawn.hbar(
                y=at, right=name, left=0.0, height=0.36, source=self.rows, view=view, fill_color=tint,
                line_color=tint, fill_alpha=0.9 if pattern is None else 0.35, hatch_pattern=pattern, hatch_color=tint,
                hatch_scale=8.0, hatch_weight=1.6,
            )  # fmt: skip
            bars.append(bar)
        total = drawn.scatter(
            "total", "slot", source=self.rows, view=view, marker="diamond", size=14, fill_color=LIGHT.ink,
            line_color=LIGHT.ink,
        )  # fmt: skip
        total.glyph.tags = [INKED, SOLID]
        drawn.add_tools(
            hover(bars, [("element", "@name"), ("through damping", "@damping{0.00000} 1/s"),
                         ("through circulation", "@circulatory{0.00000} 1/s")])
        )  # fmt: skip

    def _link(self) -> None:
        args = {
            "cursor": self.cursor.source, "source": self.rows, "titles": self.titles, "figure": self.figure,
            "words": self.words, "x_range": self.figure.x_range, "y_range": self.figure.y_range,
        }  # fmt: skip
        follow = CustomJS(args=args, code=_FOLLOW)
        self.cursor.source.js_on_change("data", follow)
        self.titles.js_on_change("data", follow)
        self.figure.js_on_change("inner_width", follow)

    def show(self, view: LiveView) -> None:
        """Put the ledgers of a view's modes into the figure; the picked one is shown."""
        if view.modes is None or view.system is None:
            self.clear(view.failure or "the modes could not be computed")
            return
        shown = shown_modes(view)
        self.cursor.keep(tuple(one.label for one in shown), default_mode(shown, view.modes))
        groups = ledger_groups(view.system, view.modes.ledger)
        tables, titles, words = [], [], []
        for place, one in enumerate(shown):
            rows, said = ledger_rows(groups, view.modes, one.mode)
            tables.append((place, rows))
            titles.append(words_only(f"Energy ledger of {one.label}"))
            words.append(f'<p class="quiet">{escaped(said)}</p>')
        self.rows.data = _columns(tables)
        self.titles.data = {"title": titles, "words": words}
        place = min(max(self.cursor.mode, 0), len(shown) - 1)
        if place >= 0:
            self.figure.title.text = titles[place]
            rows, said = tables[place][1], ledger_rows(groups, view.modes, shown[place].mode)[1]
            told = ", ".join(f"{name} {number(a + b, '1/s')}" for name, a, b in rows[:3])
            label = shown[place].label
            self.summary = f"Energy ledger of {label} ({mode_words(view.modes, shown[place].mode)}): {told or said}"

    def clear(self, reason: str) -> None:
        """Nothing to show, and why."""
        self.rows.data = _no_rows()
        told = f"<p>{escaped(reason)}</p>"
        self.titles.data = {"title": ["Energy ledger"], "words": [told]}
        self.figure.title.text, self.words.text = "Energy ledger", told
        self.summary = f"Energy ledger: {reason}"


def ledger_rows(groups: Mapping[str, list[int]], found: Modes, mode: int) -> tuple[list[tuple[str, float, float]], str]:
    """(element, damping share, circulatory share) in 1/s of one mode, largest first, and a sentence about them.

    `groups`: which elements stand together, as in the printed ledger; what does not fit is one last row. Without rows
    the sentence says why there is no split.
    """
    damping, circulatory = found.ledger.damping[:, mode], found.ledger.circulatory[:, mode]
    if np.isnan(damping).any():
        if found.s[mode].imag <= found.error_bound[mode]:
            why = "the mode does not oscillate, so no element feeds it over a cycle"
        elif not np.any(found.shapes[:, mode]):
            why = "the mode is one of internal states alone: nothing of the vehicle moves"
        else:
            why = "no element does net work over a cycle, or rounding hides what it does"
        return [], f"There is no ledger: {why}."
    rows = [
        (name, float(np.sum(damping[members])), float(np.sum(circulatory[members]))) for name, members in groups.items()
    ]
    rows.sort(key=lambda row: -max(abs(row[1]), abs(row[2])))
    size = max((max(abs(row[1]), abs(row[2])) for row in rows), default=0.0)
    kept = [row for row in rows if max(abs(row[1]), abs(row[2])) > 1e-9 * size]
    if len(kept) > MOST_ROWS:
        rest = kept[MOST_ROWS - 1 :]
        others = (f"{len(rest)} others", sum(row[1] for row in rest), sum(row[2] for row in rest))
        kept = [*kept[: MOST_ROWS - 1], others]
    growth, residual = float(found.ledger.growth[mode]), abs(float(found.ledger.residual[mode]))
    within = "" if residual <= 1e-9 * abs(growth) else f" to within {number(residual, '1/s')}"
    said = (
        f"Bars to the right feed the mode, bars to the left damp it. They add up to {number(growth, '1/s')}, which is "
        f"the growth rate{within}."
    )
    return kept, said


def _no_rows() -> dict[str, Any]:
    return _columns([])


def _columns(tables: list[tuple[int, list[tuple[str, float, float]]]]) -> dict[str, Any]:
    """Every row of every mode; the last one of each mode is the sum, which has no bars of its own."""
    mode, name, damping, circulatory, total, slot = [], [], [], [], [], []
    for place, rows in tables:
        if not rows:
            continue
        for k, (label, one, other) in enumerate([*rows, (SUM, np.nan, np.nan)]):
            last = k == len(rows)
            mode.append(place)
            name.append(label)
            damping.append(one)
            circulatory.append(other)
            total.append(sum(a + b for _, a, b in rows) if last else np.nan)
            slot.append(-float(k))
    at = np.array(slot)
    return {
        "mode": np.array(mode, dtype=np.int32), "name": name, "damping": np.array(damping),
        "circulatory": np.array(circulatory), "total": np.array(total), "slot": at, "upper": at + 0.19,
        "lower": at - 0.19,
    }  # fmt: skip
