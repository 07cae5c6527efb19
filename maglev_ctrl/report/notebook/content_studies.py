"""What a notebook shows of studies: options, comparisons, maps, designs, simulations, tuning."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from maglev_ctrl.report.charts_comparison import options_over_speed
from maglev_ctrl.report.charts_margins import requirement_names
from maglev_ctrl.report.charts_modes import speed_chart
from maglev_ctrl.report.comparison.tuning import tuning_section
from maglev_ctrl.report.content import MOST_COLUMNS, verdict_banner, verdict_matrix
from maglev_ctrl.report.content_option import mode_table, requirement_table, verdict_words
from maglev_ctrl.report.design.content import design_model
from maglev_ctrl.report.map.content import map_model
from maglev_ctrl.report.model import Banner, Block, Bullets, FigureBlock, Paragraph, Report
from maglev_ctrl.report.notebook.content import blocks_of, fact_table, figure
from maglev_ctrl.report.simulation.folder import simulation_model
from maglev_ctrl.report.style import ABSENT, number
from maglev_ctrl.report.values import bound_words, margin_words, reason_words, value_words
from maglev_ctrl.study.design.records import DesignStudy
from maglev_ctrl.study.map.records import MapStudy
from maglev_ctrl.study.nonlinear.records import SimulationStudy
from maglev_ctrl.study.records import Comparison, OptionStudy, RequirementResult
from maglev_ctrl.study.tuning.records import TuningStudy

_MOST_FIGURES: Final = 2


@blocks_of.register
def _requirement(result: RequirementResult) -> list[Block]:
    sign = "≥" if result.sense == "at_least" else "≤"
    words = reason_words(result) if result.reason else bound_words(result)
    kind = "" if result.hard else " (a wish)"
    return [
        Banner(result.verdict, f"{words}{kind}"),
        fact_table(result.description, [
            ("Limit", f"{sign} {number(result.limit, result.unit)}"), ("Value", value_words(result)),
            ("Margin", margin_words(result)), ("Worst at", result.worst_at or ABSENT), ("Method", result.method),
        ]),
    ]  # fmt: skip


@blocks_of.register
def _option(option: OptionStudy) -> list[Block]:
    blocks: list[Block] = [Banner(option.verdict, f"{option.label}: {verdict_words(option)}")]
    blocks += [Bullets(option.summary)] if option.summary else []
    if option.failure:
        return [*blocks, Paragraph(f"This option could not be studied: {option.failure}")]
    if option.requirements:
        blocks.append(requirement_table(option, f"Requirements of {option.label}"))
    if option.modes is not None:
        blocks.append(mode_table(option.modes, f"{option.label} at the design point", system=option.system))
    if option.equilibrium is not None:
        blocks += figure(speed_chart(option, design_speed=option.equilibrium.at.speed))
    return blocks


@blocks_of.register
def _comparison(comparison: Comparison) -> list[Block]:
    names = requirement_names(comparison)
    parts = [names[k : k + MOST_COLUMNS] for k in range(0, max(len(names), 1), MOST_COLUMNS)]
    matrices = [verdict_matrix(comparison, part) for part in parts] if names else []
    banner = verdict_banner(comparison)
    return [
        Banner(banner.verdict, f"{comparison.title}. {banner.text}"), *matrices,
        *figure(options_over_speed(comparison)),
    ]  # fmt: skip


@blocks_of.register
def _map_study(study: MapStudy) -> list[Block]:
    return _opening(map_model(study))


@blocks_of.register
def _design_study(study: DesignStudy) -> list[Block]:
    return _opening(design_model(study))


@blocks_of.register
def _simulation(study: SimulationStudy) -> list[Block]:
    return _opening(simulation_model(study))


@blocks_of.register
def _tuning(study: TuningStudy) -> list[Block]:
    return _shortened(tuning_section(study).blocks)


def _opening(report: Report) -> list[Block]:
    """The summary of a report and its first figures; the page written into a folder has everything."""
    first, *others = report.sections
    figures = [block for section in others for block in section.blocks if isinstance(block, FigureBlock)]
    return [Paragraph(report.title), *_shortened([*first.blocks, *figures])]


def _shortened(blocks: Iterable[Block]) -> list[Block]:
    """All words and tables, and the first figures."""
    kept: list[Block] = []
    drawn = 0
    for block in blocks:
        drawn += isinstance(block, FigureBlock)
        if not isinstance(block, FigureBlock) or drawn <= _MOST_FIGURES:
            kept.append(block)
    return kept
