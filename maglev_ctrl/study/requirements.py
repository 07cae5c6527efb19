"""Requirements judged on evidence: PASS, FAIL, or NOT EVALUATED with the reason, never dropped."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from maglev_ctrl.analysis.boundary import margin_to_boundary
from maglev_ctrl.analysis.margins import Margins
from maglev_ctrl.analysis.modes import Modes, StabilityVerdict
from maglev_ctrl.errors import Verdict
from maglev_ctrl.scenario import RequirementRecord
from maglev_ctrl.scenario.requirement_schema import RIDE_QUANTITIES, ROBUST_QUANTITIES, AccelerationRequirement
from maglev_ctrl.study.evidence import Evidence, SweepCheck
from maglev_ctrl.study.finding import Finding, missing
from maglev_ctrl.study.records import RequirementResult, Sweep
from maglev_ctrl.study.requirements_periodic import floquet_gain, floquet_speed, modulation
from maglev_ctrl.study.requirements_ride import RIDE_FINDERS, RIDE_OVER, weighted_acceleration
from maglev_ctrl.study.sweeps import least_damping, place

ROUNDING = 1e-12
FROM_THE_DESIGN = (
    "speed_margin", "payload_margin", "height_margin", "gap_margin", "floquet_gain_margin", "floquet_speed_margin",
)  # fmt: skip
EIGENVALUES = "eigenvalues with error bounds, confirmed by Lyapunov inertia"


def judge(requirement: RequirementRecord, evidence: Evidence) -> RequirementResult:
    """One requirement against one option's evidence."""
    finding = _found(requirement, evidence)
    limit, sense = requirement.limit, requirement.sense
    unit, scale = SHOWN.get(requirement.quantity, ("", 1.0))
    verdict, reason = _decide(finding, limit, sense)
    return RequirementResult(
        name=requirement.name,
        quantity=requirement.quantity,
        description=f"{DESCRIPTIONS[requirement.quantity]}, {_scope(requirement)}",
        sense=sense,
        limit=shown(limit * scale),
        value=finding.value * scale,
        unit=unit,
        verdict=verdict,
        margin_percent=_margin_percent(finding.value, limit, sense),
        worst_at=finding.where,
        method=finding.method,
        reason=reason,
        bound=finding.bound,
        hard=requirement.hard,
    )


def _found(requirement: RequirementRecord, evidence: Evidence) -> Finding:
    if isinstance(requirement, AccelerationRequirement) and requirement.passenger is not None:
        return weighted_acceleration(requirement.passenger)(evidence, requirement.over)
    return FINDERS[requirement.quantity](evidence, requirement.over)


def not_evaluated(requirement: RequirementRecord, reason: str) -> RequirementResult:
    """A requirement of an option that could not be studied at all."""
    return RequirementResult(
        name=requirement.name, quantity=requirement.quantity,
        description=f"{DESCRIPTIONS[requirement.quantity]}, {_scope(requirement)}",
        sense=requirement.sense,
        limit=shown(requirement.limit * SHOWN.get(requirement.quantity, ("", 1.0))[1]),
        value=math.nan, unit=SHOWN.get(requirement.quantity, ("", 1.0))[0],
        verdict=Verdict.NOT_EVALUATED, margin_percent=math.nan, worst_at="", method="", reason=reason, bound="exact",
        hard=requirement.hard,
    )  # fmt: skip


def shown(limit: float) -> float:
    """A limit without the rounding of its unit: 30 deg is 30, not 29.999999999999996."""
    return float(f"{limit:.12g}")


def _scope(requirement: RequirementRecord) -> str:
    if requirement.quantity in FROM_THE_DESIGN:
        return "from the design point"
    if requirement.quantity in ("modulation_ratio", "modulation_depth"):
        return "over the map's speeds"
    if requirement.quantity in ROBUST_QUANTITIES:
        return "over all uncertain parameters at the design point"
    if requirement.quantity == "acceleration_mask":
        return "at the design point"
    if requirement.quantity in RIDE_QUANTITIES:
        worst = requirement.over if requirement.over in RIDE_OVER else "nominal"
        return "at the design point" if worst == "nominal" else f"worst of the design point and the {worst} sweep"
    if requirement.quantity in ("gain_margin", "phase_margin", "delay_margin", "disk_margin", "sensitivity_peak"):
        return (
            "at the design point"
            if requirement.over == "nominal"
            else "worst of the design point and the ends of the speed and payload sweeps"
        )
    return "at the design point" if requirement.over == "nominal" else f"worst over the {requirement.over} sweep"


def _decide(finding: Finding, limit: float, sense: str) -> tuple[Verdict, str]:
    if math.isnan(finding.value):
        return Verdict.NOT_EVALUATED, finding.reason or "no value could be computed"
    slack = ROUNDING * abs(limit)  # units are converted on the way in; a limit met exactly is met
    inside = finding.value >= limit - slack if sense == "at_least" else finding.value <= limit + slack
    proves = {"exact": True, "lower": inside == (sense == "at_least"), "upper": inside == (sense == "at_most")}
    if not proves[finding.bound]:
        return Verdict.NOT_EVALUATED, f"only a {finding.bound} bound is known: {finding.reason}"
    if not inside:
        return Verdict.FAIL, finding.reason
    return Verdict.PASS, "" if finding.bound == "exact" else finding.reason


def _margin_percent(value: float, limit: float, sense: str) -> float:
    """How far inside the limit, per cent of the limit; NaN where that means nothing."""
    if math.isnan(value) or limit == 0.0 or math.isinf(limit):
        return math.nan
    distance = value - limit if sense == "at_least" else limit - value
    return 100.0 * distance / abs(limit)


def _resolved(check: SweepCheck) -> str:
    """Why the verdict at this point is not certain; '' when all methods agree."""
    unresolved = check.modes.verdict is StabilityVerdict.UNRESOLVED
    doubt = check.modes.verdict.value if unresolved else check.doubt
    return f"at {check.where}: {doubt}" if doubt else ""


def _growth_rate(evidence: Evidence, over: str) -> Finding:
    if over == "nominal":
        return _growth_of(evidence.design)
    sweep = evidence.sweeps.get(over)
    if sweep is None:
        return missing(f"the scenario has no {over} sweep")
    worst = _worst_check(evidence, over, lambda m: m.spectral_abscissa)
    if worst is None:
        return missing(_holes(sweep) or "no point of the sweep could be evaluated")
    finding = _growth_of(worst)
    return missing(_holes(sweep)) if _holes(sweep) and not finding.value >= 0.0 else finding


def _growth_of(check: SweepCheck) -> Finding:
    doubt = _resolved(check)
    found = check.modes
    return missing(doubt) if doubt else Finding(found.spectral_abscissa, check.where, EIGENVALUES, _cause(found))


def _damping_ratio(evidence: Evidence, over: str) -> Finding:
    if over == "nominal":
        return _damping_of(evidence.design)
    sweep = evidence.sweeps.get(over)
    if sweep is None:
        return missing(f"the scenario has no {over} sweep")
    worst = _worst_check(evidence, over, lambda m: -_damping_or_divergence(m))
    if worst is None:
        return missing(_holes(sweep) or "no point of the sweep could be evaluated")
    finding = _damping_of(worst)
    return missing(_holes(sweep)) if _holes(sweep) and not finding.value <= 0.0 else finding


def _damping_of(check: SweepCheck) -> Finding:
    """Least damping ratio at one point; where eigenvalues cannot be told from the axis, the most it can be."""
    found, doubt = check.modes, _resolved(check)
    if not doubt:
        return Finding(_damping_or_divergence(found), check.where, EIGENVALUES, _cause(found))
    oscillating = found.s.imag > found.error_bound
    if check.doubt or not np.any(oscillating):
        return missing(doubt)
    most = (found.error_bound - found.s.real)[oscillating] / np.abs(found.s[oscillating])
    reason = f"not distinguishable from undamped within the error bound ({found.labels[found.critical]})"
    return Finding(float(np.min(most)), check.where, EIGENVALUES, reason, bound="upper")


def _damping_or_divergence(found: Modes) -> float:
    """Least damping ratio; a divergence counts as -1, its damping ratio as a real root."""
    if np.any(found.s.real[found.s.imag <= found.error_bound] > 0.0):
        return -1.0
    value = least_damping(found)
    return 1.0 if math.isnan(value) else value


def _worst_check(evidence: Evidence, over: str, badness: Callable[[Modes], float]) -> SweepCheck | None:
    """The worst point of a sweep; one that is in doubt goes before all others."""
    checks = evidence.sweep_checks.get(over, ())
    return max(checks, key=lambda check: (bool(check.doubt), badness(check.modes)), default=None)


def _cause(found: Modes) -> str:
    """What grows and why, in words; '' when nothing grows."""
    k = found.critical
    if found.s[k].real <= 0.0:
        return f"least stable: {found.labels[k]}"
    return f"{found.kind[k].value} of {found.labels[k]}, {abs(found.s[k].imag) / (2.0 * math.pi):.3g} Hz"


def _holes(sweep: Sweep) -> str:
    if not sweep.gaps:
        return ""
    value, why = sweep.gaps[0]
    count = len(sweep.gaps)
    return f"{count} of {len(sweep.values)} sweep points could not be evaluated, first {place(sweep, value)}: {why}"


def _boundary_margin(parameter: str, *, relative: bool) -> Callable[[Evidence, str], Finding]:
    def find(evidence: Evidence, over: str) -> Finding:
        sweep = evidence.sweeps.get(parameter)
        if sweep is None:
            return missing(f"the scenario has no {parameter} sweep")
        value = evidence.design_values[parameter]
        if not sweep.boundaries.lower <= value <= sweep.boundaries.upper:
            return missing(f"the design {parameter} lies outside its sweep")
        doubt = _resolved(evidence.design)
        if doubt:
            return missing(doubt)
        if not evidence.design.modes.stable:
            return Finding(0.0, "design point", EIGENVALUES, "not stable at the design point")
        margin = margin_to_boundary(sweep.boundaries, value)
        found = margin.relative if relative else margin.distance
        where = place(sweep, margin.at)
        if margin.kind == "boundary":
            return Finding(found, where, "bisection of the stability boundary", f"stability is lost at {where}")
        why = f"no instability found up to {where} ({margin.reason})"
        return Finding(found, where, "search of the whole sweep for stability boundaries", why, bound="lower")

    return find


def _from_margins(
    read: Callable[[Margins], tuple[float, str]], what: str, *, largest: bool = False
) -> Callable[[Evidence, str], Finding]:
    sign = -1.0 if largest else 1.0

    def find(evidence: Evidence, over: str) -> Finding:
        if not evidence.has_loops:
            return missing("the option adds no element and no loop: there is nothing to break")
        points = evidence.margin_points[:1] if over == "nominal" else evidence.margin_points
        worst = Finding(sign * math.inf)
        for point in points:
            if point.margins is None:
                return missing(f"at {point.where}: {point.reason}")
            value, where = read(point.margins)
            if math.isnan(value):
                return missing(f"at {point.where}: the {what} could not be verified ({where})")
            if sign * value < sign * worst.value or not worst.where:
                worst = Finding(value, f"{point.where}, {where}", f"{what} re-verified by a pole on the axis", where)
        return worst

    return find


def _gain(margins: Margins) -> tuple[float, str]:
    return _smallest([
        (abs(value.decibel), channel.channel)
        for channel in margins.channels
        for value in (channel.gain_reduction, channel.gain_increase)
    ])  # fmt: skip


def _phase(margins: Margins) -> tuple[float, str]:
    return _smallest([(math.radians(channel.phase.value), channel.channel) for channel in margins.channels])


def _delay(margins: Margins) -> tuple[float, str]:
    return _smallest([(channel.delay.value, channel.channel) for channel in margins.channels])


def _disk(margins: Margins) -> tuple[float, str]:
    channels = [(channel.disk.alpha, channel.channel) for channel in margins.channels]
    return _smallest([*channels, (margins.multi_loop.alpha, "all loops at once")])


def _sensitivity(margins: Margins) -> tuple[float, str]:
    """Largest |S| of single loops, as ISO 14839-3 measures it: one over the smallest modulus margin."""
    pairs = [(channel.modulus.value, channel.channel) for channel in margins.channels]
    value, name = _smallest(pairs)
    return (math.inf if value == 0.0 else 1.0 / value), name


MARGINS: dict[str, Callable[[Margins], tuple[float, str]]] = {
    "gain_margin": _gain, "phase_margin": _phase, "delay_margin": _delay, "disk_margin": _disk,
    "sensitivity_peak": _sensitivity,
}  # fmt: skip
"""The least margin of all channels (SI, gain in dB; NaN: UNRESOLVED) and whose it is."""


def _smallest(pairs: list[tuple[float, str]]) -> tuple[float, str]:
    for value, name in pairs:
        if math.isnan(value):
            return value, name
    return min(pairs, key=lambda pair: pair[0])


FINDERS: dict[str, Callable[[Evidence, str], Finding]] = {
    "growth_rate": _growth_rate,
    "damping_ratio": _damping_ratio,
    "gain_margin": _from_margins(_gain, "gain margin"),
    "phase_margin": _from_margins(_phase, "phase margin"),
    "delay_margin": _from_margins(_delay, "delay margin"),
    "disk_margin": _from_margins(_disk, "disk margin"),
    "sensitivity_peak": _from_margins(_sensitivity, "sensitivity peak", largest=True),
    **RIDE_FINDERS,
    "modulation_ratio": modulation(ratio=True),
    "modulation_depth": modulation(ratio=False),
    "floquet_gain_margin": floquet_gain,
    "floquet_speed_margin": floquet_speed,
    "speed_margin": _boundary_margin("speed", relative=True),
    "payload_margin": _boundary_margin("payload", relative=False),
    "height_margin": _boundary_margin("height", relative=False),
    "gap_margin": _boundary_margin("gap", relative=False),
}

SHOWN: dict[str, tuple[str, float]] = {
    "growth_rate": ("1/s", 1.0),
    "worst_case_growth": ("1/s", 1.0),
    "weighted_acceleration": ("m/s^2", 1.0),
    "supplied_power": ("kW", 1e-3),
    "force_rate": ("kN/s", 1e-3),
    "gain_margin": ("dB", 1.0),
    "floquet_gain_margin": ("dB", 1.0),
    "phase_margin": ("deg", 180.0 / math.pi),
    "delay_margin": ("ms", 1e3),
    "payload_margin": ("t", 1e-3),
    "height_margin": ("mm", 1e3),
    "gap_margin": ("mm", 1e3),
}
"""Unit a quantity is shown in and the factor from SI; ratios are left out."""

DESCRIPTIONS = {
    "growth_rate": "largest growth rate",
    "damping_ratio": "smallest damping ratio",
    "gain_margin": "smallest gain margin (up or down)",
    "phase_margin": "smallest phase margin",
    "delay_margin": "smallest delay margin",
    "disk_margin": "smallest disk margin, single and multi-loop",
    "sensitivity_peak": "largest sensitivity of a single loop",
    "weighted_acceleration": "frequency-weighted acceleration of the worst passenger",
    "acceleration_mask": "largest ratio of an acceleration density to its mask",
    "gap_used": "largest share of a gap's clearance used by 3 sigma and girder sag",
    "stroke_used": "largest share of a stroke's clearance used by 3 sigma and girder sag",
    "contact_probability": "largest probability of a contact in an hour",
    "force_used": "largest 3 sigma of an actuator's force over its limit",
    "supplied_power": "power drawn by all actuators, without recuperation",
    "force_rate": "largest rate of an actuator's force, r.m.s.",
    "robust_factor": "factor by which all spreads may grow",
    "worst_case_growth": "largest growth rate found",
    "worst_case_damping": "least damping ratio found",
    "modulation_ratio": "modulation depth survived over the expected depth",
    "modulation_depth": "modulation depth survived",
    "floquet_gain_margin": "smallest gain change (up or down) to instability under the expected modulation",
    "floquet_speed_margin": "speed change to instability under the expected modulation, fraction of the design speed",
    "speed_margin": "distance to instability in speed, fraction of the design speed",
    "payload_margin": "distance to instability in payload",
    "height_margin": "distance to instability in height",
    "gap_margin": "distance to instability in guidance gap",
}
