"""What the map report says, in order: summary, each option, methods."""

from __future__ import annotations

import re

from maglev_ctrl._version import __version__
from maglev_ctrl.analysis.first_instability import PeriodicMargin
from maglev_ctrl.analysis.plane_records import NO_ANSWER, UNRESOLVED, UNSTABLE
from maglev_ctrl.report.map.atlas_chart import atlas_chart
from maglev_ctrl.report.map.chart import map_chart, pair_chart
from maglev_ctrl.report.map.tables import LOST_ITSELF, cure_table, law_table, margin_table, place_table, range_table
from maglev_ctrl.report.map.words import (
    HOW_TO_READ,
    absent_words,
    critical_depth_words,
    is_speed,
    margin_words,
    missed_words,
    option_sentence,
    ranges_words,
    reasons,
    share,
    worst_tongue,
)
from maglev_ctrl.report.model import Banner, Block, Bullets, Cell, FigureBlock, Paragraph, Report, Section, Table, row
from maglev_ctrl.report.style import ABSENT, number
from maglev_ctrl.study.map.records import MapStudy, OptionMap

_KILOMETRES_PER_HOUR = 3.6
METHOD = (
    "A point is unstable where a Floquet multiplier of the closed loop lies outside the unit circle, by more than the "
    "bound on its error; its growth rate is that of the motion that grows fastest.",
    "A point is stable only where that bound leaves it inside; what the bound or the second engine leaves open is "
    "UNRESOLVED and never counts as stable.",
    "A region is named by the modes that its growing motion is made of, found with right and left solutions; the "
    "modes w1, w2, ... are the oscillating modes of the vehicle without modulation, counted by frequency.",
    "Widths by first-order theory are Hsu's, from the modes and the modulation alone; computed edges come from the "
    "multipliers by bisection, and both engines have to agree on either side.",
    "The speeds of the atlas are go only between speeds that both engines found stable.",
)


def map_model(study: MapStudy) -> Report:
    """The whole report as a tree of blocks."""
    sections = [_summary(study)]
    for option in study.options:
        sections += _option(study, option)
    sections.append(_method(study))
    return Report(
        title=f"Stability maps: {study.title}",
        subtitle=f"{study.x.label} and {study.y.label} of {study.name}", created=study.created,
        scenario_hash=study.scenario_hash, version=dict(study.versions).get("maglev-ctrl", __version__),
        sections=tuple(sections),
    )  # fmt: skip


def speed_unit(study: MapStudy) -> tuple[float, str]:
    """Display over SI and unit of speeds: those of the axis that is a speed, else km/h as in the other reports."""
    for quantity in (study.x, study.y):
        if is_speed(quantity):
            return quantity.scale, quantity.unit
    return _KILOMETRES_PER_HOUR, "km/h"


def depth_words(study: MapStudy) -> str:
    """The expected depth."""
    return f"the expected depth of {number(100.0 * study.depth, '%')}"


def _summary(study: MapStudy) -> Section:
    options = study.options
    blocks: list[Block] = [Banner(None, " ".join(option_sentence(option) for option in options) or "No options.")]
    if options:
        blocks.append(comparison_table(study))
    blocks.append(Paragraph(HOW_TO_READ))
    period = f"wavelength {number(study.wavelength, 'm')}, expected depth {number(100.0 * study.depth, '%')}"
    blocks += [Paragraph(f"What makes the forces periodic ({period}):")]
    blocks.append(Bullets(study.sources) if study.sources else Paragraph("No source was recorded."))
    if study.notes:
        blocks += [Paragraph("Notes:"), Bullets(study.notes)]
    return Section("Summary", "summary", 1, tuple(blocks))


def comparison_table(study: MapStudy) -> Table:
    """One row per option."""
    speed = speed_unit(study)
    rows: list[tuple[Cell, ...]] = []
    for option in study.options:
        plane, margins = option.plane, option.margins
        gain, over_speed = (None, None) if margins is None else (margins.gain, margins.speed)
        doubt = share(option, UNRESOLVED)
        if plane is not None and plane.share(NO_ANSWER):
            doubt += f" + {share(option, NO_ANSWER)} no answer"
        rows.append(row(
            option.label,
            "no map" if plane is None else share(option, UNSTABLE), doubt,
            option.failure or "no map" if plane is None else critical_depth_words(study, plane, option.tongues),
            ranges_words(option.atlas, speed, "go"), worst_tongue(option),
            margin_words(None if margins is None else margins.depth, 100.0, "%"),
            _pair_words(option, gain, 1.0, ""), _pair_words(option, over_speed, *speed),
        ))  # fmt: skip
    heads = ("Option", "Unstable", "UNRESOLVED", "Smallest unstable depth", "Go speeds", "Worst tongue",
             "Design point: lost at depth", "at gain factor", "at speed")  # fmt: skip
    caption = (
        "The options compared. Shares and smallest depth speak of the map; go speeds, worst tongue (at "
        f"{depth_words(study)}) and what the design point bears speak of the scenario's own values, whatever the map "
        "runs over"
    )
    return Table(caption, heads, tuple(rows), (1.3, 0.8, 1.0, 1.4, 1.8, 1.2, 0.9, 1.1, 1.3), (), True)


def _pair_words(option: OptionMap, pair: tuple[PeriodicMargin, PeriodicMargin] | None, scale: float, unit: str) -> str:
    """A margin down and up in one cell."""
    margins = option.margins
    if pair is None:
        lost = margins is not None and margins.gain is None and margins.speed is None
        return LOST_ITSELF if lost else ABSENT
    return " to ".join(margin_words(one, scale, unit) for one in pair)


def _anchor(option: OptionMap, part: str) -> str:
    return re.sub(r"[^A-Za-z0-9_-]+", "-", f"option-{option.name}-{part}".rstrip("-"))


def _option(study: MapStudy, option: OptionMap) -> list[Section]:
    plane = option.plane
    if option.failure or plane is None:
        reason = option.failure or "no map was made and no reason was recorded"
        return [Section(option.label, _anchor(option, ""), 1, (Paragraph(f"No map: {reason}"), *_notes(option)))]
    head: list[Block] = [Bullets(option.summary)] if option.summary else []
    head += [
        FigureBlock(map_chart(option, plane, study.x, study.y)),
        Paragraph(f"{missed_words(plane, study.x)} Method: {plane.method}."),
    ]
    if plane.faults:
        head.append(Paragraph(f"Points without an answer: {reasons(plane)}."))
    sections = [Section(option.label, _anchor(option, ""), 1, (*head, *_notes(option)))]
    for title, part, blocks in (
        ("Tongues", "tongues", _tongues(study, option)), ("Speeds", "speeds", _speeds(study, option)),
        ("Floquet margins", "margins", _margins(study, option)),
        ("Periodic law against constant gain", "law", _law(study, option)),
    ):  # fmt: skip
        if blocks:
            sections.append(Section(f"{option.label}: {title}", _anchor(option, part), 2, tuple(blocks)))
    return sections


def _notes(option: OptionMap) -> list[Block]:
    return [Bullets(option.notes)] if option.notes else []


def _tongues(study: MapStudy, option: OptionMap) -> list[Block]:
    if not option.tongues:
        return []
    blocks: list[Block] = []
    found = place_table(option, speed_unit(study), depth_words(study))
    if found.rows:
        blocks.append(found)
    none = absent_words(option)
    if none:
        blocks += [Paragraph("Pairs of modes and orders without a tongue of their own:"), Bullets(none)]
    cures = cure_table(option)
    return [*blocks, cures] if cures.rows else blocks


def _speeds(study: MapStudy, option: OptionMap) -> list[Block]:
    if option.atlas is None:
        return [Paragraph(f"No tongue atlas: {option.atlas_reason}")] if option.atlas_reason else []
    speed = speed_unit(study)
    return [
        FigureBlock(atlas_chart(option, option.atlas, speed)),
        range_table(option, option.atlas, speed, depth_words(study)),
        *([Paragraph(option.atlas_reason)] if option.atlas_reason else []),
    ]


def _margins(study: MapStudy, option: OptionMap) -> list[Block]:
    if option.margins is None:
        return [Paragraph(f"No Floquet margins: {option.margins_reason}")] if option.margins_reason else []
    return [margin_table(option, option.margins, speed_unit(study), depth=study.depth)]


def _law(study: MapStudy, option: OptionMap) -> list[Block]:
    law = option.law
    if law is None:
        return []
    blocks: list[Block] = []
    if law.unresolved:
        blocks.append(Paragraph(f"UNRESOLVED: {law.unresolved}"))
    if law.comparison is not None:
        blocks.append(law_table(option, law.comparison))
    if law.certificate:
        blocks += [Paragraph("Independent check of the periodic law:"), Bullets(law.certificate)]
    if law.plane is not None and option.plane is not None:
        planes = (("as given (constant gain)", option.plane), ("periodic law", law.plane))
        blocks.append(FigureBlock(pair_chart(option, planes, study.x, study.y)))
    return blocks


def _method(study: MapStudy) -> Section:
    methods = dict.fromkeys(option.plane.method for option in study.options if option.plane is not None)
    blocks: list[Block] = [Bullets((*METHOD, *(f"Maps: {one}." for one in methods)))]
    rows = [row("scenario", study.scenario_path), row("scenario hash", study.scenario_hash),
            row("backend", study.backend), row("time", number(study.seconds, "s"))]  # fmt: skip
    rows += [row(name, version) for name, version in study.versions]
    blocks.append(Table("Where the maps come from", ("Item", "Value"), tuple(rows), (1.0, 3.0)))
    return Section("Methods and versions", "methods", 1, tuple(blocks))
