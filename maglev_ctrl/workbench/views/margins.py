"""Verdict, requirements and margins of the operating point in words and numbers."""

from __future__ import annotations

import math
from typing import Final

from bokeh.layouts import column
from bokeh.models import Div, InlineStyleSheet

from maglev_ctrl.analysis.margins import ChannelMargins, Margins
from maglev_ctrl.errors import Verdict
from maglev_ctrl.report.charts_margins import disk_value
from maglev_ctrl.report.model import Cell, cell
from maglev_ctrl.report.style import ABSENT, ALPHA, number
from maglev_ctrl.report.values import judged_cell, margin_words, value_words
from maglev_ctrl.study.live.records import LiveView
from maglev_ctrl.study.records import RequirementResult
from maglev_ctrl.workbench.views.table import TABLE_STYLE, escaped, table_html, verdict_html

HEADS: Final = ("Requirement", "Limit", "Value", "Margin", "Verdict", "Why")
CHANNEL_HEADS: Final = ("Loop", "Gain down", "Gain up", "Phase", "Delay", f"Disk {ALPHA}", "Confirmed")
_WAITING: Final = "being computed"


class MarginsView:
    """A verdict, a table of requirements and one of margins; every word from the file is text.

    Examples
    --------
    >>> view = MarginsView()
    >>> view.clear("no <equilibrium>")
    >>> "no &lt;equilibrium&gt;" in view.block.text
    True
    """

    def __init__(self) -> None:
        self.summary = ""
        self.figures = ()
        self.block = Div(
            text="", name="margins", disable_math=True, sizing_mode="stretch_width",
            stylesheets=[InlineStyleSheet(css=TABLE_STYLE)],
        )  # fmt: skip
        self.root = column(self.block, sizing_mode="stretch_width", name="margins-view")

    def show(self, view: LiveView) -> None:
        """Put a view's verdict, requirements and margins into the tables."""
        if view.failure:
            self.clear(view.failure)
            return
        sign = cell(view.verdict).text
        parts = [verdict_html(view.verdict, sign, view.verdict_words)]
        parts.append(_requirements(view))
        parts.append(_margins(view))
        parts += [f'<p class="quiet">{escaped(note)}</p>' for note in view.notes]
        self.block.text = "".join(parts)
        missed = [one.name for one in view.requirements if one.verdict is Verdict.FAIL and one.hard]
        open_ = [one.name for one in view.requirements if one.verdict is Verdict.NOT_EVALUATED]
        self.summary = (
            f"{view.label}: {view.verdict.value}. {view.verdict_words}"
            + (f" Missed: {', '.join(missed)}." if missed else "")
            + (f" Not evaluated here: {', '.join(open_)}." if open_ else "")
        )

    def clear(self, reason: str) -> None:
        """Nothing to show, and why."""
        self.block.text = verdict_html(Verdict.NOT_EVALUATED, cell(Verdict.NOT_EVALUATED).text, reason)
        self.summary = f"Margins: {reason}"


def _requirements(view: LiveView) -> str:
    if not view.requirements:
        words = "The scenario sets no requirements." if view.settled else f"Requirements: {_WAITING} ..."
        return f'<p class="quiet">{escaped(words)}</p>'
    rows = [_requirement(one) for one in view.requirements]
    return table_html("Requirements at the operating point", HEADS, rows, right=(1, 2, 3))


def _requirement(one: RequirementResult) -> tuple[Cell, ...]:
    sense = "≥" if one.sense == "at_least" else "≤"
    name = one.name if one.quantity in ("", one.name) else f"{one.name} ({one.quantity})"
    margin = ABSENT if math.isnan(one.margin_percent) else margin_words(one)
    return (
        Cell(name), Cell(f"{sense} {number(one.limit, one.unit)}"), Cell(value_words(one)), Cell(margin),
        judged_cell(one), Cell(one.reason),
    )  # fmt: skip


def _margins(view: LiveView) -> str:
    if view.margins is None:
        reason = view.margins_reason or ("there are no loops" if view.settled else _WAITING)
        return f'<p class="quiet">{escaped(f"Margins: {reason}.".replace("..", "."))}</p>'
    rows = [_channel(one) for one in view.margins.channels]
    if len(rows) > 1:
        rows.append(_all_loops(view.margins))
    return table_html("Margins, one loop at a time with the others closed", CHANNEL_HEADS, rows, right=(1, 2, 3, 4, 5))


def _channel(one: ChannelMargins) -> tuple[Cell, ...]:
    return (
        Cell(one.channel), Cell(number(one.gain_reduction.decibel, "dB")),
        Cell(number(one.gain_increase.decibel, "dB")),
        Cell(number(one.phase.value, "deg")), Cell(number(1e3 * one.delay.value, "ms")),
        Cell(number(disk_value(one.disk))), Cell("yes" if one.verified else "UNRESOLVED"),
    )  # fmt: skip


def _all_loops(margins: Margins) -> tuple[Cell, ...]:
    disk = margins.multi_loop
    low, high = disk.gain_range_db
    return (
        Cell("all at once"), Cell(number(low, "dB")), Cell(number(high, "dB")), Cell(number(disk.phase, "deg")),
        Cell(ABSENT), Cell(number(disk_value(disk))), Cell("yes" if disk.verified else "UNRESOLVED"),
    )  # fmt: skip
