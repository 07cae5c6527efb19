"""The page of a sweep: how the points of every option came out, figures, what is missing and why, how it was made."""

from __future__ import annotations

from typing import Final

from maglev_ctrl._version import __version__
from maglev_ctrl.report.model import (
    Block,
    Bullets,
    FigureBlock,
    Paragraph,
    Report,
    Section,
    Table,
    row,
)
from maglev_ctrl.report.style import number
from maglev_ctrl.report.sweep.charts import charts, under
from maglev_ctrl.report.sweep.digest import SweepDigest, share_interval
from maglev_ctrl.study.sweep.records import SweepStudy
from maglev_ctrl.study.sweep.request import SweepRange

SAMPLE: Final = (
    "The interval is Clopper and Pearson's for 95 %: at least so sure for points drawn one by one, and wider than need "
    "be for a Latin hypercube."
)
_METHODS: Final = {"grid": "grid", "random": "drawn one by one (Monte Carlo)", "latin": "Latin hypercube"}


def sweep_report(digest: SweepDigest) -> Report:
    """The page."""
    study = digest.study
    blocks: list[Block] = [counts_table(study)]
    if study.request.method != "grid":
        blocks.append(Paragraph(SAMPLE))
    if study.request.parts != ("modes",) and any(option.verdicts is not None for option in study.options):
        blocks.append(verdict_table(study))
    sections = [
        Section("How the points came out", "points", 1, tuple(blocks)),
        Section("Figures", "figures", 1, tuple(FigureBlock(chart) for chart in charts(digest))),
    ]
    missing = remarks_table(study)
    if missing is not None:
        sections.append(Section("What is missing, and why", "missing", 1, (missing,)))
    sections.append(Section("How it was computed", "method", 1, (method_table(study), Bullets(method_words(digest)))))
    return Report(
        title=f"Sweep: {study.title}", subtitle=f"{study.name}, {thousands(study.request.points)} points",
        created=study.created, scenario_hash=study.scenario_hash, version=__version__, sections=tuple(sections),
    )  # fmt: skip


def counts_table(study: SweepStudy) -> Table:
    """Points by state, option by option; the same on the page and on the terminal."""
    sample = study.request.method != "grid"
    heads = ["option", "stable", "UNRESOLVED", "unstable", "no answer"]
    heads += ["stable, 95 % interval"] if sample else []
    rows = []
    for option in study.options:
        states = option.modulated or option.states
        cells = [option.label, *(_count(states[name], study) for name in ("stable", "unresolved", "unstable"))]
        cells.append(_count(states["no_answer"], study))
        if sample:
            low, high = share_interval(states["stable"], study.request.points)
            cells.append(f"{number(100.0 * low)} to {number(100.0 * high, '%')}")
        rows.append(row(*cells))
    how = "under the periodic forces" if study.options and study.options[0].modulated else "without modulation"
    return Table(
        f"Points of every option by their stability {how}, of {thousands(study.request.points)}.", tuple(heads),
        tuple(rows), right=tuple(range(1, len(heads))), key="counts",
    )  # fmt: skip


def verdict_table(study: SweepStudy) -> Table:
    """At how many points the requirements that are about one point are met."""
    rows = [
        row(option.label, *(_count((option.verdicts or {}).get(name, 0), study) for name in ("met", "unresolved",
                                                                                           "missed")))
        for option in study.options
    ]  # fmt: skip
    return Table(
        "Points at which every hard requirement that is about one operating point is met (growth, damping, margins); "
        "the others are judged in the report.",
        ("option", "met", "UNRESOLVED", "missed"), tuple(rows), right=(1, 2, 3), key="requirements",
    )  # fmt: skip


def remarks_table(study: SweepStudy) -> Table | None:
    """The commonest reasons, numbers in them left out; None where nothing is missing."""
    rows = [row(option.label, words, thousands(count)) for option in study.options for words, count in option.remarks]
    if not rows:
        return None
    return Table(
        "The commonest reasons why a figure is missing or in doubt, numbers in them as #; every point has its own "
        "words in sweep.nc.",
        ("option", "reason", "points"), tuple(rows), widths=(2.0, 6.0, 1.0), right=(2,), key="remarks",
    )  # fmt: skip


def method_table(study: SweepStudy) -> Table:
    """The quantities and how their values were chosen."""
    rows = [row(one.quantity.name, one.quantity.label, range_words(one, study)) for one in study.request.ranges]
    return Table(
        f"Quantities of the sweep: {_METHODS[study.request.method]}.", ("quantity", "what it is", "values"),
        tuple(rows), key="quantities",
    )  # fmt: skip


def range_words(one: SweepRange, study: SweepStudy) -> str:
    """The values of a quantity in words."""
    unit, scale = one.shown()
    if one.normal:
        return f"normal, mean {number(one.first * scale, unit)}, standard deviation {number(one.last * scale, unit)}"
    ends = f"{number(one.first * scale)} to {number(one.last * scale, unit)}"
    return f"{ends}, {one.count} values" if study.request.method == "grid" else f"{ends}, even"


def method_words(digest: SweepDigest) -> tuple[str, ...]:
    """What was computed, where and how long it took."""
    study = digest.study
    computed = ", ".join(study.request.parts)
    words = [
        f"Computed at every point: {computed}. Stability {under(digest)} is decided by eigenvalues with error bounds "
        "and Lyapunov inertia"
        + (", and by two Floquet engines; what they do not agree on is UNRESOLVED." if digest.modulated else
           "; what they do not agree on is UNRESOLVED."),
        f"{thousands(study.blocks)} blocks of {thousands(study.block)} points on {study.workers}; {_span(study)}.",
    ]  # fmt: skip
    if study.resumed:
        words.append(f"{thousands(study.resumed)} of the blocks were kept from an earlier, interrupted run.")
    if study.damaged:
        words.append(f"{thousands(study.damaged)} kept block(s) were damaged and computed anew.")
    if study.request.method != "grid":
        words.append(f"Seed {study.request.seed}: the same seed gives the same points.")
    return (*words, *study.notes)


def thousands(count: int) -> str:
    """A count as people write it.

    Examples
    --------
    >>> thousands(1200000)
    '1 200 000'
    """
    return f"{count:,}".replace(",", " ")


def _count(count: int, study: SweepStudy) -> str:
    if not count:
        return "0"
    return f"{thousands(count)} ({number(100.0 * count / study.request.points, '%')})"


def _span(study: SweepStudy) -> str:
    return f"{number(study.seconds, 's')}, of work {number(study.busy, 's')}"
