"""Key findings in words: what a hurried engineer must know, each sentence from the records, none from taste."""

from __future__ import annotations

import math

import numpy as np

from maglev_ctrl.analysis.modes import ModeKind
from maglev_ctrl.errors import Agreement, Verdict
from maglev_ctrl.report.charts_periodic import tongue_words
from maglev_ctrl.report.findings_ride import decided_by_ride, nonlinear_findings, ride_findings, tuning_findings
from maglev_ctrl.report.groups import largest_feeder
from maglev_ctrl.report.style import number
from maglev_ctrl.report.values import bound_words, exact_margins, known_bounds
from maglev_ctrl.study.records import Comparison, OptionStudy, RequirementResult

_KILOMETRES_PER_HOUR = 3.6
CHOICE = (
    "The leading option is chosen by its verdict (PASS before NOT EVALUATED before FAIL), then by the fewest failed "
    "requirements, then by the fewest missed wishes, then by the largest smallest margin in per cent; only margins "
    "known exactly count, bounds do not, nor do wishes."
)

CHOICE_OF_TUNED = (
    "The leading option is chosen by its verdict (PASS before NOT EVALUATED before FAIL), then by the fewest failed "
    "requirements, then by its place in the ranking of the tuned options."
)


def leading_option(comparison: Comparison) -> OptionStudy | None:
    """The option to show first, as `CHOICE` says, or `CHOICE_OF_TUNED` after tuning."""
    rank = {Verdict.PASS: 0, Verdict.NOT_EVALUATED: 1, Verdict.FAIL: 2}
    judged = [o for o in comparison.options if o.requirements and not o.failure]
    if not judged:
        return comparison.options[0] if comparison.options else None
    tuning = comparison.tuning
    place = {} if tuning is None else {entry.option: entry.place for entry in tuning.ranking}
    return min(
        judged,
        key=lambda o: (rank[o.verdict], len(failed(o)), place.get(o.name, 0), len(missed_wishes(o)), -_smallest(o)),
    )


def failed(option: OptionStudy) -> tuple[RequirementResult, ...]:
    """The hard requirements that an option fails."""
    return tuple(r for r in hard_ones(option) if r.verdict is Verdict.FAIL)


def missed_wishes(option: OptionStudy) -> tuple[RequirementResult, ...]:
    """The soft requirements that an option misses."""
    return tuple(r for r in option.requirements if not r.hard and r.verdict is Verdict.FAIL)


def hard_ones(option: OptionStudy) -> tuple[RequirementResult, ...]:
    """The requirements that decide an option's verdict."""
    return tuple(r for r in option.requirements if r.hard)


def _smallest(option: OptionStudy) -> float:
    return min((r.margin_percent for r in exact_margins(hard_ones(option))), default=-math.inf)


def tightest(option: OptionStudy) -> RequirementResult | None:
    """The hard requirement with the smallest exact margin; a bound tells only that the true margin lies elsewhere."""
    return min(exact_margins(hard_ones(option)), key=lambda r: r.margin_percent, default=None)


def key_findings(comparison: Comparison) -> tuple[str, ...]:
    """Sentences for page one."""
    options = comparison.options
    passed = [o.label for o in options if o.verdict is Verdict.PASS]
    asked = max((len(hard_ones(o)) for o in options), default=0)
    lead = (
        f"{len(passed)} of {len(options)} options meet all {asked} requirements: {'; '.join(passed)}."
        if passed
        else f"The scenario sets no requirements for its {len(options)} option(s): nothing passes or fails."
        if not asked
        else f"None of the {len(options)} options meets all {asked} requirements."
    )
    sentences = [lead, *_baseline(comparison)]
    best = leading_option(comparison)
    if best is not None:
        choice = "" if len(options) == 1 else CHOICE if comparison.tuning is None else CHOICE_OF_TUNED
        sentences += [*_leading(best, choice), *ride_findings(best), *_resonance(best)]
    sentences += [*decided_by_ride(comparison), *tuning_findings(comparison.tuning)]
    sentences += _wishes(comparison)
    sentences += [f"{o.label}: {warning}" for o in options if (warning := unforced_warning(o))]
    sentences += nonlinear_findings(comparison)
    open_questions = [
        o for o in options if o.failure or any(r.verdict is Verdict.NOT_EVALUATED for r in o.requirements)
    ]
    if open_questions:
        count = sum(r.verdict is Verdict.NOT_EVALUATED for o in options for r in o.requirements)
        sentences.append(
            f"{count} results could not be evaluated ({'; '.join(o.label for o in open_questions)}); none of them "
            "counts as passed, the reasons stand in the options' own tables."
        )
    doubtful = [o.label for o in options if o.modes is not None and o.modes.agreement is Agreement.UNRESOLVED]
    if doubtful:
        sentences.append(f"The two stability methods do not agree for {', '.join(doubtful)}: unresolved, not stable.")
    return tuple(sentences)


def _leading(best: OptionStudy, choice: str) -> list[str]:
    """How close the leading option is to its limits, and what of it is known only as a bound."""
    if not best.requirements:
        return []
    who = f"The leading option, {best.label}," if choice else best.label
    tight = tightest(best)
    if tight is None:
        said = [f"{who} has no exactly known margin in per cent: its values are bounds, their limits are zero, or they "
                "were not evaluated."]  # fmt: skip
    else:
        where = f" at {tight.worst_at}" if tight.worst_at else ""
        said = [f"{who} is closest to its limit on {tight.name}: {number(tight.value, tight.unit)} against "
                f"{_limit(tight)}, a margin of {number(tight.margin_percent, '%')}{where}."]  # fmt: skip
    bounds = known_bounds(best.requirements)
    if bounds:
        said.append(f"Known only as bounds for {best.label}: {'; '.join(bound_words(r) for r in bounds)}.")
    return [*said, choice] if choice else said


def _wishes(comparison: Comparison) -> list[str]:
    """Who misses which wish."""
    missed = [(o.label, missed_wishes(o)) for o in comparison.options]
    parts = [f"{label}: {', '.join(r.name for r in wishes)}" for label, wishes in missed if wishes]
    return [f"Wishes missed, which fails nothing: {'; '.join(parts)}."] if parts else []


def _limit(result: RequirementResult) -> str:
    word = "at least" if result.sense == "at_least" else "at most"
    return f"{word} {number(result.limit, result.unit)}"


def _baseline(comparison: Comparison) -> list[str]:
    """How the vehicle behaves without anything added."""
    base = next((o for o in comparison.options if o.kind == "baseline"), None)
    if base is None or base.modes is None:
        return []
    k = int(np.argmax(base.modes.s.real))
    growth = number(float(base.modes.s[k].real), "1/s")
    speed = number(comparison.design_speed * _KILOMETRES_PER_HOUR, "km/h")
    frequency = number(float(base.modes.frequency[k]), "Hz")
    if abs(base.modes.s[k].real) <= base.modes.error_bound[k]:
        return [f"{base.label} is {base.modes.verdict.value} at {speed}: {base.modes.labels[k]} at {frequency} neither "
                f"grows nor decays beyond the error of the computation.", *_elsewhere(base)]  # fmt: skip
    if base.modes.s[k].real <= 0.0 or base.modes.verdict.value != "unstable":
        return [f"{base.label} is {base.modes.verdict.value} at {speed}; its least stable mode is "
                f"{base.modes.labels[k]} at {frequency} with growth rate {growth}.", *_elsewhere(base)]  # fmt: skip
    feeder = largest_feeder(base.system, base.modes.ledger, mode=k) if base.system is not None else None
    fed = f", fed by the {feeder[0]}" if feeder else ""
    return [f"{base.label} is unstable at {speed}: {base.modes.labels[k]} grows at {growth} ({frequency}, "
            f"{base.modes.kind[k].value}){fed}."]  # fmt: skip


def _elsewhere(base: OptionStudy) -> list[str]:
    """Where along its sweeps a vehicle grows that does not at the design point."""
    said, still = [], {ModeKind.STABLE, ModeKind.NEUTRAL, None}
    for one in base.sweeps:
        # By kind, for a mode within its error of zero neither grows nor decays whatever its sign.
        growing = np.array([not still.issuperset(row) for row in one.tracks.kinds]) & (one.abscissa > 0.0)
        if np.any(growing):
            k = int(np.argmax(np.where(growing, one.abscissa, -np.inf)))
            most, at = number(float(one.abscissa[k]), "1/s"), number(one.scale * float(one.values[k]), one.unit)
            points = f"{int(np.sum(growing))} of {len(one.values)} points"
            said.append(f"Along {one.parameter.replace('_', ' ')} it grows at {points}, at most by {most} at {at}.")
    return said


def _resonance(option: OptionStudy) -> list[str]:
    study = option.floquet
    if study is None:
        return []
    if math.isnan(study.worst_depth):
        return [f"What guideway modulation {option.label} survives is UNRESOLVED: the two engines do not agree."]
    if not math.isfinite(study.worst_depth):
        return [f"{option.label} survives guideway modulation up to {number(100 * study.largest_depth, '%')} at every "
                "speed of the map that is stable without it."]  # fmt: skip
    ratio = study.worst_depth / study.expected_depth if study.expected_depth > 0.0 else math.inf
    where = number(study.worst_speed * _KILOMETRES_PER_HOUR, "km/h")
    sentence = (
        f"Guideway modulation: {option.label} first becomes unstable at {number(100 * study.worst_depth, '%')} depth, "
        f"{number(ratio)} times the expected depth, at {where} ({tongue_words(study.worst_resonance)})."
    )
    return [sentence]


def unforced_warning(option: OptionStudy) -> str:
    """That the map finds an option unstable without modulation although its growth rate over speed passes; else ''."""
    study, sweep = option.floquet, next((s for s in option.sweeps if s.parameter == "speed"), None)
    passes = any(
        r.quantity == "growth_rate" and r.verdict is Verdict.PASS and "speed" in r.description
        for r in option.requirements
    )
    if study is None or sweep is None or not passes or study.map.depths[0] != 0.0:
        return ""
    unstable = np.asarray(study.map.unstable[:, 0])
    if not unstable.any():
        return ""
    speeds = study.map.parameter
    edges = np.flatnonzero(np.diff(np.concatenate([[0], unstable.astype(int), [0]])))
    parts = [_speed_range(float(speeds[a]), float(speeds[b - 1])) for a, b in zip(edges[::2], edges[1::2], strict=True)]
    low, high = float(np.min(sweep.values)), float(np.max(sweep.values))
    beyond = bool(np.all((speeds[unstable] < low) | (speeds[unstable] > high)))
    which = "which reaches beyond the speed sweep," if beyond else "whose speeds differ from those of the sweep,"
    return f"The resonance map, {which} finds this option unstable without modulation at {' and '.join(parts)}."


def _speed_range(low: float, high: float) -> str:
    end = number(high * _KILOMETRES_PER_HOUR, "km/h")
    return end if high == low else f"{number(low * _KILOMETRES_PER_HOUR)} to {end}"
