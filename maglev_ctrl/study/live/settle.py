"""The slow part of a live view: the checked map, Floquet, margins, requirements and the verdict."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

from maglev_ctrl.analysis.floquet import Floquet, floquet
from maglev_ctrl.analysis.margins import Margins, loop_margins
from maglev_ctrl.analysis.modes import ModeKind, Modes
from maglev_ctrl.errors import Agreement, Verdict
from maglev_ctrl.scenario import RequirementRecord, Scenario
from maglev_ctrl.study.delays import settled_modes
from maglev_ctrl.study.evidence import Evidence, MarginPoint, SweepCheck
from maglev_ctrl.study.live.designed import FAULTS, Designed
from maglev_ctrl.study.live.fast_map import MERGED, map_of, plane_of
from maglev_ctrl.study.live.records import LiveMap, LiveView
from maglev_ctrl.study.loops import option_loops
from maglev_ctrl.study.records import RequirementResult
from maglev_ctrl.study.requirements import DESCRIPTIONS, judge, not_evaluated
from maglev_ctrl.study.situation import Situation

CHECKS = 24
IN_THE_REPORT = "computed in the report"
LATER = "it is judged in the report"
HERE = "operating point"
NO_LOOPS = "the option adds no element and no loop: there is nothing to break"
_AT_THE_POINT = (
    "growth_rate", "damping_ratio", "gain_margin", "phase_margin", "delay_margin", "disk_margin", "sensitivity_peak",
)  # fmt: skip
"""Quantities of requirements that are known at one operating point."""


def settled(
    view: LiveView, designed: Designed, situation: Situation, depth: float, cancelled: Callable[[], bool]
) -> LiveView:  # fmt: skip
    """The view with everything slow in it; unchanged when `cancelled` says so."""
    started = time.perf_counter()
    atlas, reason = _checked_map(view, designed, situation)
    if cancelled():
        return view
    multipliers = _floquet(designed, situation, depth)
    if cancelled():
        return view
    margins, margins_reason = _margins(designed, situation)
    if cancelled():
        return view
    try:
        found, doubt = settled_modes(
            designed.model, designed.vehicle(situation.payload), situation, designed.controller
        )  # fmt: skip
    except FAULTS as fault:
        assert view.modes is not None
        found, doubt = view.modes, f"{fault}"
    check = SweepCheck(HERE, found, doubt)
    requirements = judged(designed.model.scenario, check, MarginPoint(HERE, margins, margins_reason))
    words = verdict_words(check, multipliers, depth, requirements)
    stable = stable_at(check, multipliers, periodic=designed.modulation is not None and situation.speed > 0.0)
    return replace(
        view, map=atlas, map_reason=reason, floquet=multipliers, margins=margins, margins_reason=margins_reason,
        requirements=requirements, verdict=verdict_of(requirements, stable), verdict_words=words, settled=True,
        seconds=view.seconds + time.perf_counter() - started,
    )  # fmt: skip


def judged(scenario: Scenario, check: SweepCheck, margins: MarginPoint) -> tuple[RequirementResult, ...]:
    """Every requirement: at the operating point where it is about one, else NOT EVALUATED."""
    evidence = _evidence(check, margins)
    return tuple(_judged(one, evidence) for one in scenario.judged)


def judged_here(scenario: Scenario, check: SweepCheck, margins: MarginPoint) -> tuple[RequirementResult, ...]:
    """The requirements that are about one operating point, as if they were asked of this one alone."""
    evidence = _evidence(check, margins)
    return tuple(
        judge(one.model_copy(update={"over": "nominal"}), evidence)
        for one in scenario.judged if one.quantity in _AT_THE_POINT
    )  # fmt: skip


def _evidence(check: SweepCheck, margins: MarginPoint) -> Evidence:
    return Evidence(
        design=check, sweeps={}, sweep_checks={}, margin_points=(margins,), has_loops=margins.reason != NO_LOOPS,
        floquet=None, floquet_reason=IN_THE_REPORT, design_values={},
    )  # fmt: skip


def _judged(requirement: RequirementRecord, evidence: Evidence) -> RequirementResult:
    """A requirement over a sweep can be missed at this one point, but not met: that takes the sweep."""
    if requirement.quantity not in _AT_THE_POINT:
        return not_evaluated(requirement, IN_THE_REPORT)
    found = judge(requirement.model_copy(update={"over": "nominal"}), evidence)
    found = replace(found, description=f"{DESCRIPTIONS[requirement.quantity]}, at the {HERE}")
    if requirement.over == "nominal" or found.verdict is not Verdict.PASS:
        return found
    return replace(found, verdict=Verdict.NOT_EVALUATED, reason=f"met at this point; over {requirement.over} {LATER}")


def stable_at(check: SweepCheck, multipliers: Floquet | None, *, periodic: bool) -> bool | None:
    """Whether the operating point is stable, modulation included; None where it is not decided.

    Examples
    --------
    >>> from maglev_ctrl.analysis.modes import modes
    >>> from maglev_ctrl.systems import SecondOrderSystem
    >>> grows = modes(SecondOrderSystem.from_matrices([[1.0]], [[-0.2]], [[4.0]]))
    >>> stable_at(SweepCheck("here", grows, ""), None, periodic=False)
    False
    """
    found = check.modes
    if check.doubt or found.agreement is Agreement.UNRESOLVED:
        return None
    if not found.stable or not periodic:
        return found.stable
    return None if multipliers is None else multipliers.stable


def verdict_of(requirements: tuple[RequirementResult, ...], stable: bool | None) -> Verdict:
    """PASS only where the point is stable and every hard requirement passes, FAIL as soon as one fails or it grows."""
    verdicts = [one.verdict for one in requirements if one.hard]
    if stable is False or Verdict.FAIL in verdicts:
        return Verdict.FAIL
    if stable is None or not verdicts or Verdict.NOT_EVALUATED in verdicts:
        return Verdict.NOT_EVALUATED
    return Verdict.PASS


def verdict_words(
    check: SweepCheck, multipliers: Floquet | None, depth: float, requirements: tuple[RequirementResult, ...]
) -> str:  # fmt: skip
    """One sentence: stable or not and why, what fails, what only the report judges."""
    found = check.modes
    if check.doubt:
        head = f"UNRESOLVED: {check.doubt}"
    elif found.agreement is Agreement.UNRESOLVED:
        head = f"UNRESOLVED: the growth of {found.labels[found.critical]} is too near to zero to tell"
    elif not found.stable:
        head = _growing(found)
    elif multipliers is not None and multipliers.stable is None:
        head = f"Stable without modulation, UNRESOLVED at {100.0 * depth:.3g} % of it"
    elif multipliers is not None and multipliers.stable is False:
        head = f"Unstable under modulation: grows at {multipliers.growth_rate:.2g} 1/s at {100.0 * depth:.3g} % of it"
    else:
        head = "Stable"
    failed = [one.name.replace("_", " ") for one in requirements if one.verdict is Verdict.FAIL]
    later = sum(one.verdict is Verdict.NOT_EVALUATED and _later(one) for one in requirements)
    unknown = sum(one.verdict is Verdict.NOT_EVALUATED for one in requirements) - later
    parts = [head]
    if failed:
        parts.append(f"not met: {', '.join(failed)}")
    if unknown:
        parts.append(f"{_count(unknown)} could not be evaluated")
    if later:
        parts.append(f"{_count(later)} {'is' if later == 1 else 'are'} only judged in the report")
    return f"{'; '.join(parts)}."


def _later(one: RequirementResult) -> bool:
    return one.reason == IN_THE_REPORT or one.reason.endswith(LATER)


def _count(number: int) -> str:
    return "1 requirement" if number == 1 else f"{number} requirements"


def _growing(found: Modes) -> str:
    k = found.critical
    head = f"Unstable: {found.labels[k]} grows at {found.s[k].real:.2g} 1/s"
    if found.kind[k] is ModeKind.DIVERGENCE:
        return f"{head} without oscillating"
    feeding = [(name, a + b) for name, a, b in found.ledger.ranked(k) if a + b > 0.0]
    return f"{head}, fed most by {feeding[0][0].replace('_', ' ')}" if feeding else head


def _checked_map(view: LiveView, designed: Designed, situation: Situation) -> tuple[LiveMap | None, str]:
    if view.map is None:
        return None, view.map_reason
    try:
        plane = plane_of(designed, situation, view.map.speed, view.map.depth, checks=CHECKS)
    except FAULTS as fault:
        return None, f"{fault}"
    return map_of(plane, checked=True, note=MERGED if designed.merged else ""), ""


def _floquet(designed: Designed, situation: Situation, depth: float) -> Floquet | None:
    if designed.modulation is None or situation.speed <= 0.0:
        return None
    try:
        return floquet(designed.periodic(situation, depth, full=True))
    except FAULTS:
        return None


def _margins(designed: Designed, situation: Situation) -> tuple[Margins | None, str]:
    try:
        loops = option_loops(designed.model, situation, designed.controller)
        return (None, NO_LOOPS) if loops is None else (loop_margins(loops.loop()), "")
    except FAULTS as fault:
        return None, f"{fault}"
