"""What the loop measures of a candidate at one situation, and which requirements and objectives read it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Final, Literal

from maglev_ctrl.analysis.margin_estimates import LARGEST_DISK, MarginEstimates
from maglev_ctrl.analysis.response.records import RideResponse
from maglev_ctrl.scenario import RequirementRecord
from maglev_ctrl.scenario.tuning_schema import Objective
from maglev_ctrl.study.tuning.records import ObjectiveAxis

Stage = Literal["poles", "ride", "margins"]
STAGES: Final[tuple[Stage, ...]] = ("poles", "ride", "margins")
"""In the order of their cost; a candidate that is not stable does not reach the later ones."""

IN_LOOP: Final[dict[str, Stage]] = {
    "growth_rate": "poles", "damping_ratio": "poles",
    "weighted_acceleration": "ride", "gap_used": "ride", "stroke_used": "ride", "contact_probability": "ride",
    "force_used": "ride", "supplied_power": "ride", "force_rate": "ride",
    "gain_margin": "margins", "phase_margin": "margins", "delay_margin": "margins", "disk_margin": "margins",
    "sensitivity_peak": "margins",
}  # fmt: skip
"""Quantities of requirements that the loop can judge, and the stage that measures them."""

READS: Final[dict[Objective, str]] = {
    "ride": "weighted_acceleration", "gap": "gap_used", "stroke": "stroke_used", "power": "supplied_power",
    "force": "force_used", "margin": "disk_margin", "damping": "damping_ratio",
}  # fmt: skip
"""The quantity behind each objective."""

LARGER_IS_BETTER: Final = ("damping_ratio", "gain_margin", "phase_margin", "delay_margin", "disk_margin")

_AXES: Final[dict[Objective, tuple[str, str, float]]] = {
    "ride": ("weighted acceleration of the worst passenger", "m/s^2", 1.0),
    "gap": ("largest share of a gap used", "%", 100.0),
    "stroke": ("largest share of a stroke used", "%", 100.0),
    "power": ("power supplied to all actuators", "kW", 1e-3),
    "force": ("largest share of a force limit used", "%", 100.0),
    "margin": ("least disk margin", "", 1.0),
    "damping": ("least damping ratio", "", 1.0),
}


def objective_axis(objective: Objective) -> ObjectiveAxis:
    """The axis of an objective: label, display unit and sense."""
    label, unit, scale = _AXES[objective]
    larger = READS[objective] in LARGER_IS_BETTER
    return ObjectiveAxis(objective, label, unit, scale, "larger" if larger else "smaller")


def figure_name(requirement: RequirementRecord) -> str:
    """The name of the figure a requirement reads: its quantity, of one passenger where it names one."""
    passenger = getattr(requirement, "passenger", None)
    return requirement.quantity if passenger is None else f"{requirement.quantity} of {passenger}"


def ride_figures(response: RideResponse) -> dict[str, float]:
    """Figures of the ride; without an actuator force and power are zero, without a stroke nothing of it is used."""
    found = {f"weighted_acceleration of {one.name}": one.total for one in response.passengers}
    found["weighted_acceleration"] = _largest(one.total for one in response.passengers)
    for kind in ("gap", "stroke"):
        found[f"{kind}_used"] = _largest(one.used for one in response.clearances if one.kind == kind)
    found["contact_probability"] = _largest(one.contact_per_hour for one in response.clearances)
    found["force_used"] = _largest(one.three_sigma_share for one in response.actuators)
    found["supplied_power"] = math.fsum(one.supplied_power for one in response.actuators)
    found["force_rate"] = _largest(one.rate for one in response.actuators)
    return found


def margin_figures(found: MarginEstimates | None) -> dict[str, float]:
    """Figures of the margins; an option without a loop has nothing to break."""
    if found is None:
        found = MarginEstimates(math.inf, math.inf, math.inf, LARGEST_DISK, 0.0)
    return {
        "gain_margin": found.gain, "phase_margin": found.phase, "delay_margin": found.delay, "disk_margin": found.disk,
        "sensitivity_peak": found.sensitivity_peak,
    }  # fmt: skip


def worst_of(figures: Iterable[Mapping[str, float]], name: str) -> float:
    """The worst value of a figure over several situations; NaN where one has none."""
    values = [one.get(name, math.nan) for one in figures]
    if not values or any(math.isnan(value) for value in values):
        return math.nan
    return min(values) if name in LARGER_IS_BETTER else max(values)


def relative_violation(value: float, limit: float, sense: str, *, probability: bool = False) -> float:
    """How far a value is beyond its limit, relative to the limit; 0 where it is met, 1 where there is no value.

    A limit of zero counts as one (SI). Of a probability the logarithms are compared, for it runs over many decades.

    Examples
    --------
    >>> relative_violation(0.03, 0.04, "at_least"), relative_violation(1e-3, 1e-6, "at_most", probability=True)
    (0.25, 0.5)
    """
    if math.isnan(value):
        return 1.0
    if probability and 0.0 < limit < 1.0 and value > 0.0:
        value, limit = math.log(value), math.log(limit)
    beyond = limit - value if sense == "at_least" else value - limit
    if beyond <= 0.0:
        return 0.0
    return round(beyond / (abs(limit) or 1.0), 12)


def _largest(values: Iterable[float]) -> float:
    found = list(values)
    if any(math.isnan(value) for value in found):
        return math.nan
    return max(found, default=0.0)
