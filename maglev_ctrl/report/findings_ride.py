"""Key findings about ride, gaps, power, tuning and the nonlinear check, each sentence from the records."""

from __future__ import annotations

import math
from typing import Final

from maglev_ctrl.errors import Agreement, Verdict
from maglev_ctrl.report.ride.summary import at_design, supplied_power, tightest_clearance, worst_passenger
from maglev_ctrl.report.style import number
from maglev_ctrl.report.values import with_prefix
from maglev_ctrl.study.records import Comparison, OptionStudy
from maglev_ctrl.study.tuning.records import TuningStudy

RIDE_QUANTITIES: Final = frozenset({
    "weighted_acceleration", "acceleration_mask", "gap_used", "stroke_used", "contact_probability", "force_used",
    "force_rate", "supplied_power",
})  # fmt: skip


def ride_findings(option: OptionStudy) -> list[str]:
    """Ride, tightest gap and power of the option shown first, at the design point."""
    response = at_design(option)
    if response is None:
        return []
    parts = []
    passenger, gap = worst_passenger(response), tightest_clearance(response, "gap")
    if passenger is not None:
        parts.append(
            f"the worst passenger ({passenger.name}) feels {number(passenger.total, 'm/s²')}, {passenger.comfort}"
        )
    if gap is not None:
        parts.append(f"the tightest gap ({gap.name}) uses {number(100.0 * gap.used, '%')} of its clearance")
    power = supplied_power(response)
    if math.isfinite(power):
        parts.append(f"all actuators draw {with_prefix(power, 'W')}")
    unknown = response.agreement is Agreement.UNRESOLVED
    doubt = ["the two methods do not agree everywhere, see its ride"] if unknown else []
    told = "; ".join(parts + doubt)
    return [f"Ride of {option.label} at the design point: {told}."] if told else []


def decided_by_ride(comparison: Comparison) -> list[str]:
    """Options that ride, gaps or power alone keep from passing."""
    sentences = []
    for option in comparison.options:
        lost = [r for r in option.requirements if r.hard and r.verdict is Verdict.FAIL]
        if lost and all(r.quantity in RIDE_QUANTITIES for r in lost):
            worst = "; ".join(
                f"{r.name} {number(r.value, r.unit)} against {number(r.limit, r.unit)}"
                + (f" at {r.worst_at}" if r.worst_at else "")
                for r in lost
            )
            sentences.append(f"{option.label} fails by its ride, gaps or power alone: {worst}.")
    return sentences


def tuning_findings(study: TuningStudy | None) -> list[str]:
    """Who ranks first and how firmly, and which options no tuning brings within the requirements."""
    if study is None or not study.ranking:
        return []
    first = min(study.ranking, key=lambda r: r.place)
    sentences = []
    if first.misses:
        sentences.append(f"After tuning no option meets every hard requirement; {first.label} comes nearest.")
    else:
        changed = sum(shift.first != first.option for shift in study.shifts)
        firm = (
            f" It keeps this place under all {len(study.shifts)} changes of limits and weights."
            if study.shifts and not changed
            else f" It loses this place under {changed} of {len(study.shifts)} changes of limits and weights."
            if study.shifts
            else ""
        )
        sentences.append(f"After tuning with equal budgets {first.label} ranks first.{firm}")
    lost = [f"{o.label} (misses {o.binding} most)" for o in study.options if not o.feasible and not o.reason]
    if lost:
        sentences.append(f"No tuning brought these within every hard requirement: {'; '.join(lost)}.")
    bound = [
        f"{o.label}: {v.label} at its {v.at_bound} bound" for o in study.options for v in o.variables if v.at_bound
    ]
    if bound:
        sentences.append(f"Ranges of tuning decide for {'; '.join(bound)}.")
    return sentences


def nonlinear_findings(comparison: Comparison) -> list[str]:
    """Contact, and linear numbers that the nonlinear vehicle does not confirm."""
    sentences = []
    for option in comparison.options:
        study = option.nonlinear
        if study is None:
            continue
        runs = {event.run for event in study.events if event.kind == "contact"}
        if runs:
            sentences.append(f"Nonlinear check of {option.label}: contact in {len(runs)} of {study.runs} runs.")
        differ = sum(c.agreement is not Agreement.AGREED for c in study.compared)
        if differ:
            sentences.append(
                f"Nonlinear check of {option.label}: {differ} of {len(study.compared)} numbers of the linear theory "
                "are not confirmed."
            )
    return sentences
