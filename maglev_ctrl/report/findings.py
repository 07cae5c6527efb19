"""Key findings in words: what a hurried engineer must know, each sentence from the records, none from taste."""

from __future__ import annotations

import math

import numpy as np

from maglev_ctrl.errors import Agreement, Verdict
from maglev_ctrl.report.charts_periodic import tongue_words
from maglev_ctrl.report.groups import largest_feeder
from maglev_ctrl.report.style import number
from maglev_ctrl.study.records import Comparison, OptionStudy, RequirementResult

_KILOMETRES_PER_HOUR = 3.6


def leading_option(comparison: Comparison) -> OptionStudy | None:
    """The option to show first: verdict PASS before NOT EVALUATED before FAIL, then the largest smallest margin."""
    rank = {Verdict.PASS: 0, Verdict.NOT_EVALUATED: 1, Verdict.FAIL: 2}
    judged = [o for o in comparison.options if o.requirements and not o.failure]
    if not judged:
        return comparison.options[0] if comparison.options else None
    return min(judged, key=lambda o: (rank[o.verdict], _failed(o), -_smallest(o)))


def _failed(option: OptionStudy) -> int:
    return sum(r.verdict is Verdict.FAIL for r in option.requirements)


def _smallest(option: OptionStudy) -> float:
    known = [r.margin_percent for r in option.requirements if not math.isnan(r.margin_percent)]
    return min(known, default=-math.inf)


def tightest(option: OptionStudy) -> RequirementResult | None:
    """The evaluated requirement with the smallest margin."""
    known = [r for r in option.requirements if not math.isnan(r.margin_percent)]
    return min(known, key=lambda r: r.margin_percent, default=None)


def key_findings(comparison: Comparison) -> tuple[str, ...]:
    """Sentences for page one."""
    options = comparison.options
    passed = [o.label for o in options if o.verdict is Verdict.PASS]
    asked = max((len(o.requirements) for o in options), default=0)
    lead = (
        f"{len(passed)} of {len(options)} options meet all {asked} requirements: {', '.join(passed)}."
        if passed
        else f"None of the {len(options)} options meets all {asked} requirements."
    )
    sentences = [lead, *_baseline(comparison)]
    best = leading_option(comparison)
    if best is not None and (tight := tightest(best)) is not None:
        sentences.append(
            f"The leading option, {best.label}, is closest to its limit on {tight.name}: "
            f"{number(tight.value, tight.unit)} against {_limit(tight)}, a margin of "
            f"{number(tight.margin_percent, '%')}" + (f" at {tight.worst_at}." if tight.worst_at else ".")
        )
    if best is not None:
        sentences += _resonance(best)
    open_questions = [
        o for o in options if o.failure or any(r.verdict is Verdict.NOT_EVALUATED for r in o.requirements)
    ]
    if open_questions:
        count = sum(r.verdict is Verdict.NOT_EVALUATED for o in options for r in o.requirements)
        sentences.append(
            f"{count} results could not be evaluated ({', '.join(o.label for o in open_questions)}); none of them "
            "counts as passed, the reasons stand in the options' own tables."
        )
    doubtful = [o.label for o in options if o.modes is not None and o.modes.agreement is Agreement.UNRESOLVED]
    if doubtful:
        sentences.append(f"The two stability methods do not agree for {', '.join(doubtful)}: unresolved, not stable.")
    return tuple(sentences)


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
    if base.modes.s[k].real <= 0.0:
        return [f"{base.label} is {base.modes.verdict.value} at {speed}; its least stable mode is "
                f"{base.modes.labels[k]} at {frequency} with growth rate {growth}."]  # fmt: skip
    feeder = largest_feeder(base.system, base.modes.ledger, mode=k) if base.system is not None else None
    fed = f", fed by the {feeder[0]}" if feeder else ""
    return [f"{base.label} is unstable at {speed}: {base.modes.labels[k]} grows at {growth} ({frequency}, "
            f"{base.modes.kind[k].value}){fed}."]  # fmt: skip


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
