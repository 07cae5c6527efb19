"""The nonlinear check of an option: linear and nonlinear side by side, events, saturation, limit cycle, attraction."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from maglev_ctrl.errors import Agreement, Verdict
from maglev_ctrl.report.chart import Axis, Chart, Line, Panel
from maglev_ctrl.report.model import Banner, Block, Bullets, Cell, FigureBlock, Paragraph, Table, row
from maglev_ctrl.report.style import ABSENT, curve_colour, number, unit_words
from maglev_ctrl.study.nonlinear.records import Compared, NonlinearStudy
from maglev_ctrl.study.records import OptionStudy

_MOST_EVENTS: Final = 12
_MOST_SIGNALS: Final = 6
_KILOMETRES_PER_HOUR: Final = 3.6


def nonlinear_blocks(option: OptionStudy) -> list[Block]:
    """What the nonlinear vehicle says to the linear numbers; nothing where the scenario asks for no simulation."""
    study = option.nonlinear
    if study is None:
        reason = option.nonlinear_reason
        return [Paragraph(f"The nonlinear vehicle was not simulated: {reason}")] if reason else []
    return study_blocks(study, option.label, key=option.name)


def study_blocks(study: NonlinearStudy, label: str, *, key: str) -> list[Block]:
    """The same for a study on its own, of the option with that label; `key` begins the names of its figures."""
    blocks: list[Block] = [*_banners(study), Paragraph(_runs_words(study))]
    if study.compared:
        blocks.append(_compared_table(label, study.compared))
        told = tuple(f"{c.name}: {c.reason}" for c in study.compared if c.reason)
        blocks += [Bullets(told)] if told else []
    if study.events:
        blocks.append(_event_table(label, study))
    if study.saturated:
        blocks.append(Paragraph(_saturation_words(study)))
    if study.limit_cycle:
        blocks.append(Paragraph(f"{study.limit_cycle[0].upper()}{study.limit_cycle[1:].rstrip('.')}."))
    if study.attraction:
        blocks.append(_attraction_table(label, study))
    chart = time_traces(study, label, key=key)
    blocks += [FigureBlock(chart)] if chart is not None else []
    if study.assumptions:
        blocks += [Paragraph("What the simulation assumes:"), Bullets(study.assumptions)]
    return blocks


def _banners(study: NonlinearStudy) -> list[Block]:
    """What no reader may overlook: contact, other ends of runs, numbers that the nonlinear vehicle does not confirm."""
    found: list[Block] = []
    touched = sorted({event.run for event in study.events if event.kind == "contact"})
    if touched:
        found.append(Banner(Verdict.FAIL, f"Contact in {len(touched)} of {study.runs} runs."))
    others = sorted({event.run for event in study.events} - set(touched))
    if others:
        found.append(Banner(Verdict.NOT_EVALUATED, f"{len(others)} of {study.runs} runs ended early without contact."))
    differ = [c.name for c in study.compared if c.agreement is not Agreement.AGREED]
    if differ:
        found.append(
            Banner(
                Verdict.NOT_EVALUATED,
                f"The linear theory and the nonlinear vehicle do not agree on: {'; '.join(differ)}. What is told "
                "elsewhere about these holds for small motion only.",
            )
        )
    return found


def _runs_words(study: NonlinearStudy) -> str:
    speed = number(study.speed * _KILOMETRES_PER_HOUR, "km/h")
    return (
        f"{study.runs} runs of {number(study.duration, 's')} at {speed} over different guideways of the same spectrum "
        f"(first seed {study.seed}), steps of {number(1e3 * study.step, 'ms')}; half the step changes "
        f"the motion by {number(study.step_error, digits=2)} of its largest."
    )


def _compared_table(label: str, compared: tuple[Compared, ...]) -> Table:
    rows = tuple(
        (
            *row(one.name, number(one.linear, one.unit), number(one.nonlinear, one.unit), _band(one)),
            Cell("agree") if one.agreement is Agreement.AGREED else Cell("UNRESOLVED", Verdict.NOT_EVALUATED),
        )
        for one in compared
    )
    return Table(
        f"Linear theory and nonlinear vehicle of {label} side by side; the band is the confidence of the "
        "nonlinear value over its runs",
        ("Quantity", "Linear", "Nonlinear", "Band", "Agreement"), rows, (2.8, 1.1, 1.1, 1.4, 1.0), right=(1, 2, 3),
    )  # fmt: skip


def _band(one: Compared) -> str:
    if math.isnan(one.low) or one.low == one.high:
        return ABSENT
    return f"{number(one.low)} to {number(one.high)}"


def _event_table(label: str, study: NonlinearStudy) -> Table:
    ordered = sorted(study.events, key=lambda event: event.time)
    rows = tuple(
        row(
            number(event.time, "s"), str(event.run + 1), event.kind, event.element,
            number(event.value, "m/s") if event.kind == "contact" else ABSENT, event.words,
        )
        for event in ordered[:_MOST_EVENTS]
    )  # fmt: skip
    more = f" (first {_MOST_EVENTS} of {len(ordered)})" if len(ordered) > _MOST_EVENTS else ""
    return Table(
        f"What ended runs of {label}{more}", ("Time", "Run", "Event", "Element", "Closing speed", "In words"), rows,
        (0.8, 0.5, 1.3, 1.4, 1.0, 2.6), right=(0, 1, 4), small=True,
    )  # fmt: skip


def _saturation_words(study: NonlinearStudy) -> str:
    at_limit = [(name, share) for name, share in study.saturated if share > 0.0]
    if not at_limit:
        return "No actuator reaches its limit in any run."
    parts = ", ".join(f"{name} {number(100.0 * share, '%', digits=2)}" for name, share in at_limit)
    others = len(study.saturated) - len(at_limit)
    never = f"; {others} never" if others else ""
    return f"Share of time at the limit of the actuator: {parts}{never}."


def _attraction_table(label: str, study: NonlinearStudy) -> Table:
    rows = tuple(
        (*row(name, number(size)), Cell(f"{back} of {tried}", None if back == tried else Verdict.FAIL))
        for name, size, back, tried in study.attraction
    )
    return Table(
        f"Region of attraction of {label}: starts away from the equilibrium, in one coordinate (m or rad), and how "
        "many returned",
        ("Coordinate", "Size of the start", "Returned"), rows, (2.0, 1.0, 1.0), right=(1,),
    )  # fmt: skip


def time_traces(study: NonlinearStudy, label: str, *, key: str) -> Chart | None:
    """Signals of one run against time, one panel each; None without signals."""
    shown = study.signals[:_MOST_SIGNALS]
    if not shown or not study.time.size:
        return None
    limits = (float(study.time[0]), float(study.time[-1]))
    panels = tuple(
        Panel(
            (Line(study.time, signal.values, "", curve_colour(0), "solid", 0.9),), Axis("time (s)", limits),
            Axis(unit_words(signal.unit) or ABSENT), title=signal.name,
        )
        for signal in shown
    )  # fmt: skip
    left = len(study.signals) - len(shown)
    more = f" {left} more signals are in report.json." if left else ""
    ranges = ", ".join(f"{s.name} {_range(s.values)} {unit_words(s.unit)}".rstrip() for s in shown)
    return Chart(
        key=f"{key}-traces",
        caption=f"One run of the nonlinear vehicle of {label}, thinned for the figure.{more}",
        alt=f"Signals of one run of {label} over {number(study.duration, 's')}: {ranges}.",
        panels=panels,
        panel_height=1.0,
        legend="none",
        share_x=True,
    )


def _range(values: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> str:
    known = values[np.isfinite(values)]
    return f"from {number(float(np.min(known)))} to {number(float(np.max(known)))}" if known.size else ABSENT
