"""What the design report says, in order: summary, every law, method."""

from __future__ import annotations

import re

import numpy as np

from maglev_ctrl._version import __version__
from maglev_ctrl.errors import Verdict
from maglev_ctrl.report.content_margins import margin_blocks
from maglev_ctrl.report.design.charts import (
    budget_chart,
    manoeuvre_chart,
    response_chart,
    schedule_chart,
)
from maglev_ctrl.report.design.levels import level_blocks
from maglev_ctrl.report.design.tables import (
    budget_table,
    claim_table,
    corner_table,
    gain_table,
    manoeuvre_table,
    performance_table,
    sampled_table,
    smallest_margins,
)
from maglev_ctrl.report.design.words import gathered, round_down
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
    Table,
    cell,
    row,
)
from maglev_ctrl.report.style import ABSENT, number
from maglev_ctrl.study.design.records import DesignStudy, LawStudy
from maglev_ctrl.synthesis.damping.budget import BudgetCurve

_SCALES = {"speed": (3.6, "km/h"), "payload": (1e-3, "t"), "height": (1e3, "mm"), "gap": (1e3, "mm")}
THIN_GAIN, THIN_PHASE = 3.0, 20.0
"""dB and deg below which the summary warns, half of what is usually asked for."""
METHOD = (
    "A law is shown only with claims about its closed loop. Each claim comes with its matrix, and is proved again from "
    "the stored numbers of plant and law by arithmetic with bounds on its rounding, or exactly in rational arithmetic; "
    "no solver is trusted. What could not be proved is no law.",
    "A claim for several operating points with one matrix holds for every loop between them too, as far as their "
    "matrices are blends of those of the points; one matrix each holds at the points.",
    "Norms reported by a synthesis are computed again from the closed loop by bisection on Hamiltonian matrices or by "
    "Lyapunov equations; a difference of more than 1e-5 keeps the law back.",
    "Laws are designed without the delays of their actuators and judged with them, in Pade form of two orders.",
    "A sampled law holds its command for one period; its loss is told for the plant sampled exactly.",
    "design.json holds everything needed to prove it all again: maglev-ctrl verify design.json.",
)


def design_model(study: DesignStudy) -> Report:
    """The whole report as a tree of blocks."""
    sections = [_summary(study)]
    for option in study.options:
        sections += _option(option)
    sections.append(_method(study))
    sections.append(Section("Scenario file", "scenario", 1, (Listing(study.scenario_text),)))
    return Report(
        title=f"Designs: {study.title}", subtitle=_counted(study), created=study.created,
        scenario_hash=study.scenario_hash, version=dict(study.versions).get("maglev_ctrl", __version__),
        sections=tuple(sections),
    )  # fmt: skip


def _counted(study: DesignStudy) -> str:
    count = len(study.options)
    return f"{count} {'law' if count == 1 else 'laws'} of {study.name}"


def _summary(study: DesignStudy) -> Section:
    proved = [option.label for option in study.options if option.verdict is Verdict.PASS]
    words = f"Proved: {'; '.join(proved)}." if proved else "No law was proved."
    missing = [option for option in study.options if option.verdict is not Verdict.PASS]
    words += "".join(f" {option.label}: {_why(option)}." for option in missing)
    blocks: list[Block] = [Banner(study.verdict, words)]
    if study.description:
        blocks.append(Paragraph(" ".join(study.description.split())))
    rows: list[tuple[Cell, ...]] = []
    for option in study.options:
        gain, phase, disk = smallest_margins(option.margins)
        rows.append((
            cell(option.label), cell(option.law.partition("; acceptable")[0]), cell(option.verdict),
            cell(_slowest(option)), cell(number(_largest_gain(option))),
            cell(number(gain, "dB")), cell(number(phase, "deg")), cell(number(disk)),
        ))  # fmt: skip
    heads = ("Option", "Law", "Verdict", "Slowest pole", "Peak gain", "Gain margin", "Phase margin", "Disk margin")
    blocks.append(Table(
        "The laws beside each other, at the design point with actuator delays exact in the margins. Peak gain: from "
        "disturbances in units of their density to outputs and commands in units of their allowed values",
        heads, tuple(rows), (1.3, 2.2, 0.9, 0.9, 0.8, 0.9, 0.9, 0.9), (3, 4, 5, 6, 7), True,
    ))  # fmt: skip
    thin = [option.label for option in study.options if _thin(option)]
    if thin:
        blocks.append(Paragraph(
            f"Proved is not robust: {'; '.join(thin)} {'has' if len(thin) == 1 else 'have'} less than "
            f"{THIN_GAIN:g} dB of gain margin or {THIN_PHASE:g} deg of phase margin. A claim is about the model and "
            "its corners; maglev-ctrl report judges the requirements of the scenario."
        ))  # fmt: skip
    if study.assumptions:
        blocks += [Paragraph("Assumptions, which no source confirms:"), Bullets(study.assumptions)]
    if study.sources:
        blocks += [Paragraph("Sources:"), Bullets(tuple(f"{key}: {text}" for key, text in study.sources))]
    return Section("Summary", "summary", 1, tuple(blocks), study.verdict)


def _thin(option: LawStudy) -> bool:
    gain, phase, _ = smallest_margins(option.margins)
    return gain < THIN_GAIN or phase < THIN_PHASE


def _slowest(option: LawStudy) -> str:
    if not option.corners:
        return ABSENT
    return number(float(np.max(option.corners[0].closed_loop.real)), "1/s")


def _largest_gain(option: LawStudy) -> float:
    return float("nan") if option.gain is None else float(np.max(option.gain.closed_loop))


def _why(option: LawStudy) -> str:
    if option.failure:
        return option.failure
    proofs = option.synthesis.proofs if option.synthesis is not None else ()
    failed = [proof.reason for proof in proofs if not proof.holds]
    if option.delays:
        failed.append(f"with actuator delays {option.delays}")
    return "; ".join(failed) or "nothing was claimed"


def _option(option: LawStudy) -> list[Section]:
    anchor = "law-" + re.sub(r"[^A-Za-z0-9_-]+", "-", option.name)
    head: list[Block] = [Bullets(option.summary)] if option.summary else []
    if option.failure or option.synthesis is None:
        reason = option.failure or "there is no law and no reason was recorded"
        return [Section(option.label, anchor, 1, (Banner(option.verdict, f"No law: {reason}"), *head), option.verdict)]
    told = "Every claim is proved" + ("." if not option.delays else f"; but {option.delays}.")
    blocks: list[Block] = [Banner(option.verdict, told if option.verdict is Verdict.PASS else _why(option)), *head]
    blocks.append(claim_table(option))
    if option.synthesis.performance:
        blocks.append(performance_table(option))
    blocks += level_blocks(option)
    chart = response_chart(option)
    if chart is not None:
        blocks.append(FigureBlock(chart))
    if len(option.corners) > 1:
        blocks.append(corner_table(option))
    sections = [Section(option.label, anchor, 1, tuple(blocks), option.verdict)]
    for title, part, more in (
        ("Cost of damping", "budget", _budget(option)), ("Schedule", "schedule", _schedule(option)),
        ("Limits and manoeuvre", "mpc", _predictive(option)), ("The law in numbers", "gains", _gains(option)),
        ("Margins", "margins", _margins(option)), ("As a computer runs it", "sampled", _sampled(option)),
        ("Notes", "notes", _notes(option)),
    ):  # fmt: skip
        if more:
            sections.append(Section(f"{option.label}: {title}", f"{anchor}-{part}", 2, tuple(more)))
    return sections


def _budget(option: LawStudy) -> list[Block]:
    if option.budget is None:
        return []
    return [
        FigureBlock(budget_chart(option, option.budget, chosen=option.chosen)),
        budget_table(option.budget, option.chosen),
        *(Paragraph(_unproved_words(curve)) for curve in (option.budget.together, *option.budget.alone)
          if any(curve.reasons)),
    ]  # fmt: skip


def _unproved_words(curve: BudgetCurve) -> str:
    which = "With all places" if len(curve.places) > 1 else f"With {curve.places[0]} alone"
    missing = [k for k, reason in enumerate(curve.reasons) if reason]
    first = curve.reasons[missing[0]].partition("; ")[0]
    if len(missing) == len(curve.reasons):
        return f"{which} nothing was proved at any margin; at the smallest: {first}."
    margins = ", ".join(number(float(curve.margin[k])) for k in missing)
    return f"{which} the margins {margins} were not proved: {first}."


def _schedule(option: LawStudy) -> list[Block]:
    if option.schedule is None:
        return []
    schedule = option.schedule.schedule
    if schedule is None:
        return []
    scale, unit = _SCALES.get(schedule.parameter, (1.0, schedule.unit))
    limit = option.schedule.rate_limit
    words = f"What is carried: {option.schedule.guarantee}."
    if np.isfinite(limit):
        fastest = number(round_down(limit), f"{schedule.unit}/s", digits=4)
        words += f" The proof allows {schedule.parameter} to change by {fastest} at most."
    return [
        Paragraph(words), *([Paragraph(option.asked)] if option.asked else []),
        FigureBlock(schedule_chart(option, schedule, scale=scale, unit=unit)),
    ]  # fmt: skip


def _predictive(option: LawStudy) -> list[Block]:
    predictive = option.predictive
    if predictive is None:
        return []
    run, plain = predictive.with_prediction, predictive.saturated
    return [
        Bullets(tuple(gathered(words) for words in predictive.design.statements)),
        FigureBlock(manoeuvre_chart(option, predictive)),
        manoeuvre_table(predictive),
        Paragraph(
            f"{len(run.u)} steps: {len(run.fallback_steps)} fell back on the verified law, largest residual of the "
            f"optimality conditions {number(max((r for r in run.residuals if np.isfinite(r)), default=0.0))}. Cost "
            f"{number(run.cost)} with prediction, {number(plain.cost)} with the saturated law; it counts the weights "
            "alone, and keeping limits has its price."
        ),
    ]


def _notes(option: LawStudy) -> list[Block]:
    """Notes not told elsewhere on the page."""
    told = option.predictive.design.statements if option.predictive is not None else ()
    kept = tuple(gathered(note) for note in dict.fromkeys(option.notes) if note not in told)
    return [Bullets(kept)] if kept else []


def _gains(option: LawStudy) -> list[Block]:
    table = gain_table(option)
    return [] if table is None else [table]


def _margins(option: LawStudy) -> list[Block]:
    if option.margins is None:
        return [Paragraph(f"No margins: {option.margins_reason}")] if option.margins_reason else []
    return margin_blocks(option.margins, option.label)


def _sampled(option: LawStudy) -> list[Block]:
    if option.sampled is None:
        return []
    if option.sampled.loss is None:
        words = f"Sampled every {number(1e3 * option.sampled.period, 'ms')}: {option.sampled.reason}."
        if option.sampled.margins is not None:
            gain, phase, disk = smallest_margins(option.sampled.margins)
            words += (
                f" Smallest margins of the sampled loop, actuator delays left out: {number(gain, 'dB')}, "
                f"{number(phase, 'deg')}, disk margin {number(disk)}."
            )
        return [Paragraph(words)]
    return [sampled_table(option.sampled)]


def _method(study: DesignStudy) -> Section:
    rows = [row("scenario", study.scenario_path), row("scenario hash", study.scenario_hash),
            row("time", number(study.seconds, "s"))]  # fmt: skip
    rows += [row(name, version) for name, version in study.versions]
    return Section("Methods and versions", "methods", 1, (
        Bullets(METHOD), Table("Where the designs come from", ("Item", "Value"), tuple(rows), (1.0, 3.0)),
    ))  # fmt: skip
