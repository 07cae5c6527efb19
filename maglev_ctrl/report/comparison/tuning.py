"""Tuning and trade-off of the options: variables, fronts, ranking, and how firm the ranking is."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from maglev_ctrl.errors import Verdict
from maglev_ctrl.report.chart import Chart
from maglev_ctrl.report.comparison.pareto import Front, Objective, ParetoChartData, pareto_chart
from maglev_ctrl.report.model import Banner, Block, Bullets, Cell, FigureBlock, Paragraph, Section, Table, row
from maglev_ctrl.report.style import ABSENT, TIMES, number, unit_words
from maglev_ctrl.report.values import breakable
from maglev_ctrl.study.tuning.records import ObjectiveAxis, TunedOption, TunedVariable, TuningStudy

_MOST_SITUATIONS: Final = 8
_SENSES: Final = {"smaller": "smaller is better", "larger": "larger is better"}


def tuning_section(study: TuningStudy) -> Section:
    """The chapter on tuning, in reading order."""
    chart = fronts(study)
    figure: list[Block] = [] if chart is None else [FigureBlock(chart)]
    blocks = (*_search_blocks(study), *figure, *_ranking_blocks(study))
    return Section("Tuning and trade-off", "tuning", 1, blocks)


def fronts(study: TuningStudy) -> Chart | None:
    """What each option can reach; an option that misses a hard requirement is told so in its name. None without one."""
    scale = np.array([axis.scale for axis in study.objectives])
    told = [
        Front(
            option.label if option.feasible else f"{option.label} (misses {option.binding})", option.front * scale,
            option.chosen, option.knee if option.feasible else -1,
        )
        for option in study.options
        if not option.reason
    ]  # fmt: skip
    if not any(np.isfinite(front.points).all(axis=1).any() for front in told):
        return None
    axes = tuple(Objective(axis.label, unit_words(axis.unit), axis.sense) for axis in study.objectives)
    return pareto_chart(ParetoChartData(axes, tuple(told)), key="tuning-fronts")


def _search_blocks(study: TuningStudy) -> list[Block]:
    """How was searched, what each search found, and what keeps options from meeting the requirements."""
    blocks: list[Block] = [Paragraph(_method_words(study)), Bullets((*_objective_words(study), *_judged_words(study)))]
    lost = [option for option in study.options if not option.feasible and not option.reason]
    if lost:
        blocks.append(Banner(Verdict.FAIL, " ".join(_lost_words(option) for option in lost)))
    failed = [f"{option.label}: {option.reason}" for option in study.options if option.reason]
    if failed:
        blocks.append(Banner(Verdict.NOT_EVALUATED, f"Without a result: {'; '.join(failed)}."))
    blocks.append(_search_table(study))
    variables = _variable_table(study)
    return [*blocks, variables] if variables is not None else blocks


def _ranking_blocks(study: TuningStudy) -> list[Block]:
    """Who stands where, by which numbers, and whether that changes with limits and weights."""
    blocks: list[Block] = []
    if study.ranking:
        blocks.append(_ranking_table(study))
    if study.shifts:
        blocks.append(Paragraph(_firmness(study)))
        if any(shift.changed for shift in study.shifts):
            blocks.append(_shift_table(study))
    return blocks


def _method_words(study: TuningStudy) -> str:
    asked = sum(option.evaluations for option in study.options)
    count = len(study.situations)
    shown = ", ".join(study.situations[:_MOST_SITUATIONS])
    more = f" and {count - _MOST_SITUATIONS} more" if count > _MOST_SITUATIONS else ""
    return (
        f"Every option was tuned by the same method with the same budget: {study.method}; {asked} candidates in "
        f"{number(study.seconds, 's')}. Each was judged at {count} operating points: {shown}{more}. Another seed is "
        "another search: what it finds is not proven to be the best."
    )


def _objective_words(study: TuningStudy) -> tuple[str, ...]:
    return tuple(f"{_axis_head(axis)}: {_SENSES[axis.sense]}" for axis in study.objectives)


def _judged_words(study: TuningStudy) -> list[str]:
    """Which hard requirements the search itself judged, and which only the full study of the chosen candidates."""
    told = []
    if study.in_loop:
        told.append(f"Hard requirements that every candidate had to meet: {', '.join(study.in_loop)}")
    if study.after:
        told.append(f"Judged only afterwards, for the chosen candidates: {', '.join(study.after)}")
    return told


def _axis_head(axis: ObjectiveAxis) -> str:
    return f"{axis.label} ({unit_words(axis.unit)})" if axis.unit else axis.label


def _lost_words(option: TunedOption) -> str:
    by = f", by {number(100.0 * option.violation, '%')} of its limit" if math.isfinite(option.violation) else ""
    which = "has nothing to tune and misses" if not option.variables else "misses in every candidate"
    return f"{option.label} {which} hard requirements; {option.binding} by most{by}."


def _search_table(study: TuningStudy) -> Table:
    rows = tuple(
        (
            *row(
                option.label, str(len(option.variables)), str(option.evaluations), str(option.failures),
                str(option.generations), option.stopped, str(len(option.front)) if option.feasible else ABSENT,
                number(option.seconds, "s"),
            ),
            _feasible_cell(option),
        )
        for option in study.options
    )  # fmt: skip
    heads = ("Option", "Variables", "Candidates", "Without a model", "Generations", "Ended by", "On the front", "Time",
             "Hard requirements")  # fmt: skip
    return Table(
        "What each search did; candidates without a model or a law count as worst, the front holds the candidates that "
        "no other betters and that meet every hard requirement judged in the search",
        heads, rows, (1.8, 0.8, 0.9, 0.9, 1.0, 1.1, 0.8, 0.8, 1.5), right=(1, 2, 3, 4, 6, 7), small=True,
    )  # fmt: skip


def _feasible_cell(option: TunedOption) -> Cell:
    if option.reason:
        return Cell("? no result", Verdict.NOT_EVALUATED)
    if option.feasible:
        return Cell("✓ met", Verdict.PASS)
    return Cell(f"✗ {breakable(option.binding)}", Verdict.FAIL)


def _variable_table(study: TuningStudy) -> Table | None:
    rows = tuple(
        (
            *row(option.label, variable.label, *_range(variable), variable.text),
            Cell(f"at its {variable.at_bound} bound" if variable.at_bound else "inside"),
        )
        for option in study.options
        for variable in option.variables
    )
    if not rows:
        return None
    return Table(
        "Design variables: range searched and value chosen; a value at a bound says that the range decides, not the "
        "search",
        ("Option", "Variable", "From", "To", "Chosen", "Place"), rows, (1.8, 2.2, 1.0, 1.0, 1.2, 1.1), right=(2, 3, 4),
        small=True,
    )  # fmt: skip


def _range(variable: TunedVariable) -> tuple[str, str]:
    """Ends of the range in display units; a list of choices has no ends."""
    if variable.name == "control":
        return ABSENT, ABSENT
    return (
        number(variable.lower * variable.scale, variable.unit), number(variable.upper * variable.scale, variable.unit)
    )  # fmt: skip


def _ranking_table(study: TuningStudy) -> Table:
    found = {option.option: option for option in study.options}
    rows = []
    for entry in sorted(study.ranking, key=lambda r: r.place):
        option = found.get(entry.option)
        values = [ABSENT] * len(study.objectives)
        if option is not None and 0 <= option.chosen < len(option.front):
            point = option.front[option.chosen]
            values = [number(float(v) * axis.scale) for v, axis in zip(point, study.objectives, strict=True)]
        misses = (
            Cell(f"✗ {breakable(', '.join(entry.misses))}", Verdict.FAIL)
            if entry.misses
            else Cell("✓ none", Verdict.PASS)
        )
        rows.append((*row(str(entry.place), entry.label, *values, number(entry.distance)), misses))
    heads = ("Place", "Option", *(_axis_head(axis) for axis in study.objectives), "Distance", "Misses")
    return Table(
        "Ranking: each option with the point chosen on its front; distance to the ideal point of all fronts in ranges "
        "of the objectives, 0 is best; options that miss a hard requirement come last",
        heads, tuple(rows), (0.5, 1.8, *(1.7 for _ in study.objectives), 0.8, 1.4),
        right=tuple(range(2, 3 + len(study.objectives))), small=True,
    )  # fmt: skip


def _firmness(study: TuningStudy) -> str:
    moved = sum(shift.changed for shift in study.shifts)
    first = min(study.ranking, key=lambda r: r.place) if study.ranking else None
    lost = 0 if first is None else sum(shift.first != first.option for shift in study.shifts)
    if not moved:
        return f"The ranking is firm: none of {len(study.shifts)} changes of a limit or a weight alters it."
    who = (
        ""
        if first is None
        else f"; {first.label} " + (f"loses first place in {lost}" if lost else "stays first in all")
    )
    moving = {shift.what for shift in study.shifts if shift.changed}
    same = ", ".join(dict.fromkeys(shift.what for shift in study.shifts if shift.what not in moving))
    kept = f" No other value tried of these alters it: {same}." if same else ""
    return f"The ranking changes in {moved} of {len(study.shifts)} trials{who}.{kept}"


def _shift_table(study: TuningStudy) -> Table:
    labels = {entry.option: entry.label for entry in study.ranking}
    order = [entry.label for entry in study.ranking]
    rows = tuple(
        row(
            breakable(shift.what), f"{TIMES} {number(shift.factor)}", labels.get(shift.first, shift.first),
            "; ".join(f"{place}. {name}" for place, name in sorted(zip(shift.places, order, strict=True))),
        )
        for shift in study.shifts if shift.changed
    )  # fmt: skip
    return Table(
        "What changes the ranking: one limit or weight changed at a time",
        ("Changed", "By", "Then first", "Places"), rows, (1.8, 0.7, 1.7, 3.4), right=(1,), small=True,
    )  # fmt: skip
