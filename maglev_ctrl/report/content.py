"""What the report says, in order: summary, comparison of options, each option, method and provenance."""

from __future__ import annotations

import math
from collections.abc import Sequence

from maglev_ctrl._version import __version__
from maglev_ctrl.errors import Verdict
from maglev_ctrl.report.charts_comparison import options_over_speed
from maglev_ctrl.report.charts_margins import margin_bars, requirement_names
from maglev_ctrl.report.comparison.ride_chart import ride_side_by_side
from maglev_ctrl.report.comparison.tuning import tuning_section
from maglev_ctrl.report.content_cover import cover
from maglev_ctrl.report.content_method import method_words, not_asked
from maglev_ctrl.report.content_option import option_section, requirement_table
from maglev_ctrl.report.equations import equation_blocks
from maglev_ctrl.report.findings import key_findings, leading_option
from maglev_ctrl.report.model import (
    Banner,
    Block,
    Bullets,
    Cell,
    FigureBlock,
    Listing,
    Paragraph,
    Report,
    Section,
    cell,
    row,
)
from maglev_ctrl.report.model import Table as TableBlock
from maglev_ctrl.report.style import ABSENT, number
from maglev_ctrl.report.values import breakable, judged_cell, value_words
from maglev_ctrl.study.records import Comparison, OptionStudy, RequirementResult

MOST_COLUMNS = 9
"""Requirements side by side in one table; more are continued in another."""


def report_model(comparison: Comparison) -> Report:
    """The whole report as a tree of blocks."""
    options = [option_section(comparison, option, place) for place, option in enumerate(comparison.options)]
    sections = [_summary(comparison)]
    if len(comparison.options) > 1:
        sections.append(_comparison(comparison))
    if comparison.tuning is not None:
        sections.append(tuning_section(comparison.tuning))
    for group in options:
        sections.extend(group)
    sections += [_method(comparison), _provenance(comparison), _scenario(comparison)]
    version = dict(comparison.versions).get("maglev-ctrl", __version__)
    return Report(
        comparison.title, _flowing(comparison.description), comparison.created, comparison.scenario_hash, version,
        tuple(sections), cover(comparison, verdict_banner(comparison)),
    )  # fmt: skip


def _flowing(text: str) -> str:
    """Paragraphs without the line breaks of the file they were typed in."""
    return "\n\n".join(" ".join(part.split()) for part in text.strip().split("\n\n"))


def _summary(comparison: Comparison) -> Section:
    verdict = _banner_verdict(comparison)
    blocks: list[Block] = [Bullets(key_findings(comparison))]
    best = leading_option(comparison)
    if best is not None and best.requirements:
        several = len(comparison.options) > 1
        which = f"leading option {best.label}" if several else best.label
        blocks.append(
            requirement_table(best, f"Requirements, judged for the {which}" if several else f"Requirements of {which}")
        )
    return Section("Summary", "summary", 1, tuple(blocks), verdict)


def verdict_banner(comparison: Comparison) -> Banner:
    """How many options pass, at which design point."""
    return Banner(_banner_verdict(comparison), _banner_words(comparison))


def _banner_verdict(comparison: Comparison) -> Verdict | None:
    """None where some options pass and others do not: one word for all of them would mislead."""
    mixed = comparison.verdict is not Verdict.PASS and any(o.verdict is Verdict.PASS for o in comparison.options)
    return None if mixed else comparison.verdict


def _banner_words(comparison: Comparison) -> str:
    counts = {v: sum(o.verdict is v for o in comparison.options) for v in Verdict}
    speed = number(comparison.design_speed * 3.6, "km/h")
    height = number(comparison.design_height * 1e3, "mm")
    return (
        f"{counts[Verdict.PASS]} of {len(comparison.options)} options PASS, {counts[Verdict.FAIL]} FAIL, "
        f"{counts[Verdict.NOT_EVALUATED]} NOT EVALUATED. Design point {speed} at {height} height."
    )


def _comparison(comparison: Comparison) -> Section:
    names = requirement_names(comparison)
    parts = [names[k : k + MOST_COLUMNS] for k in range(0, max(len(names), 1), MOST_COLUMNS)]
    blocks: list[Block] = [verdict_matrix(comparison, part) for part in parts]
    blocks += [_value_table(comparison, part) for part in parts]
    charts = (margin_bars(comparison), options_over_speed(comparison), ride_side_by_side(comparison))
    blocks += [FigureBlock(chart) for chart in charts if chart is not None]
    return Section("Comparison of options", "comparison", 1, tuple(blocks))


def verdict_matrix(comparison: Comparison, names: Sequence[str]) -> TableBlock:
    """Options against requirements, a verdict in every cell."""
    rows = []
    for option in comparison.options:
        judged = {r.name: judged_cell(r) for r in option.requirements}
        found = [judged.get(name, Cell("not asked")) for name in names]
        rows.append((Cell(option.label), cell(option.verdict), *found))
    heads = ("Option", "Overall", *(breakable(name) for name in names))
    wishes = any(not r.hard for option in comparison.options for r in option.requirements)
    return TableBlock(
        "Verdicts of every option on every requirement: ✓ PASS, ✗ FAIL, ? NOT EVALUATED"
        + ("; a wish that is missed (✗ wish) fails nothing" if wishes else ""),
        heads, tuple(rows), (1.6, 1.0, *(1.0 for _ in names)), small=True,
    )  # fmt: skip


def _value_table(comparison: Comparison, names: Sequence[str]) -> TableBlock:
    base = next((o for o in comparison.options if o.kind == "baseline"), comparison.options[0])
    base_values = {r.name: r.value for r in base.requirements if r.bound == "exact"}
    rows = []
    for option in comparison.options:
        found = {r.name: r for r in option.requirements}
        label = f"{option.label} (baseline)" if option is base else option.label
        texts = [
            _value_and_change(found[n], base_values.get(n, math.nan), option is base) if n in found else ABSENT
            for n in names
        ]
        rows.append(row(label, *texts))
    return TableBlock(
        f"Values of every requirement's quantity, ≥ and ≤ where only a bound is known; in brackets the change from "
        f"{base.label} where both are exact",
        ("Option", *(breakable(name) for name in names)), tuple(rows), (1.6, *(1.0 for _ in names)), small=True,
    )  # fmt: skip


def _value_and_change(result: RequirementResult, base: float, is_base: bool) -> str:
    text = value_words(result)
    change = result.value - base
    if is_base or result.bound != "exact" or not math.isfinite(change):
        return text
    return f"{text} ({'+' if change > 0 else ''}{number(change)})"


def _method(comparison: Comparison) -> Section:
    blocks: list[Block] = [Bullets(method_words(comparison)), *equation_blocks(comparison)]
    missing = not_asked(comparison)
    if missing:
        blocks.append(Paragraph(f"Not part of this study, because the scenario does not ask for it: {missing}."))
    if comparison.forces:
        blocks += [Paragraph("Magnetic forces:"), Bullets(comparison.forces)]
    if comparison.assumptions:
        blocks += [Paragraph("Assumptions of this scenario:"), Bullets(comparison.assumptions)]
    if comparison.sources:
        rows = tuple(row(key, citation) for key, citation in comparison.sources)
        blocks.append(TableBlock("Sources of the scenario's numbers", ("Key", "Source"), rows, (1.0, 4.0)))
    return Section("Method, assumptions and sources", "method", 1, tuple(blocks))


def _provenance(comparison: Comparison) -> Section:
    facts = (
        row("Scenario file", comparison.scenario_path),
        row("Scenario hash", comparison.scenario_hash),
        row("Created", comparison.created),
        row("Computing time", number(comparison.seconds, "s")),
        *(row(name, version) for name, version in comparison.versions),
    )
    blocks: list[Block] = [TableBlock("Provenance", ("Item", "Value"), facts, (1.0, 2.6))]
    evidence = [line for option in comparison.options for line in _evidence(option)]
    if evidence:
        heads = ("Option", "Result", "Verdict of the check", "Numbers behind it")
        blocks.append(
            TableBlock("Certificates: what confirmed each result", heads, tuple(evidence), (1.2, 1.1, 1.1, 2.4))
        )
    return Section("Provenance and certificates", "provenance", 1, tuple(blocks))


def _evidence(option: OptionStudy) -> list[tuple[Cell, ...]]:
    lines: list[tuple[Cell, ...]] = []
    if option.modes is not None:
        worst = float(max(option.modes.error_bound))
        certified = "yes" if option.modes.certificate.certified else "no"
        numbers = f"largest eigenvalue error bound {number(worst, '1/s')}; Lyapunov inertia certified: {certified}"
        judged = option.modes.verdict.value.split(":")[0]
        lines.append(row(option.label, "modes at the design point", judged, numbers))
    if option.floquet is not None:
        at = option.floquet.at_design
        numbers = (
            f"spectral radius {number(at.spectral_radius, digits=6)}, growth error {number(at.growth_error, '1/s')}"
        )
        lines.append(row(option.label, "Floquet multipliers", at.agreement.value, numbers))
    if option.design is not None:
        proof = option.design.certificate
        numbers = (
            f"spectral abscissa {number(proof.spectral_abscissa, '1/s')}, Lyapunov residual "
            f"{number(proof.lyapunov_residual)} (proof below 1), closings differ "
            f"by {number(proof.eigenvalue_difference)}"
        )
        lines.append(row(option.label, f"{option.design.law} controller", proof.agreed.value, numbers))
    return lines


def _scenario(comparison: Comparison) -> Section:
    words = Paragraph("The scenario exactly as read; the hash on every page is of this text.")
    return Section("Scenario", "scenario", 1, (words, Listing(comparison.scenario_text)))
