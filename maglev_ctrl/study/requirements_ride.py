"""Finders of the requirements on ride, gaps, strokes and actuators, and of those on worst cases."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Literal

from maglev_ctrl.analysis.response.records import RideResponse
from maglev_ctrl.analysis.robustness.records import WorstPoint
from maglev_ctrl.errors import Agreement, Verdict
from maglev_ctrl.study.evidence import Evidence
from maglev_ctrl.study.finding import Finding, missing
from maglev_ctrl.study.ride_records import RidePoint

TWO_INTEGRALS = "covariance equations and frequency integral agree"
BELOW_ONE = 1.0 - 1e-9
NO_GAP = "the vehicle has no magnet with a gap"
RIDE_OVER = ("nominal", "speed", "payload")
"""Where the ride is looked at: the design point, or the worst point of a sweep that includes it."""


@dataclass(frozen=True, slots=True)
class Candidate:
    """One value that may be the worst: NaN with a reason where it could not be computed."""

    value: float
    what: str
    reason: str = ""


Read = Callable[[RideResponse], Iterator[Candidate]]


def ride_finder(
    read: Read, nothing: str, *, zero: bool = True, touching: float | None = None
) -> Callable[[Evidence, str], Finding]:
    """The largest value over the operating points that `over` asks for; one that is missing leaves it open.

    Parameters
    ----------
    nothing : what to say where no point has such a value (no actuator, no stroke)
    zero : whether the value is zero then; else it is not evaluated
    touching : the value where a magnet touches at rest; None: there is none
    """

    def find(evidence: Evidence, over: str) -> Finding:
        if evidence.ride is None:
            return missing(evidence.ride_reason)
        points = points_over(evidence.ride.points, over)
        worst, where = -math.inf, ""
        for point in points:
            if point.touches and touching is not None:
                return Finding(touching, point.where, "equilibrium", point.reason)
            if point.response is None:
                return missing(f"at {point.where}: {point.reason}")
            for one in read(point.response):
                if math.isnan(one.value):
                    return missing(f"at {point.where}, {one.what}: {one.reason or 'no value'}")
                if one.value > worst:
                    worst, where = one.value, f"{point.where}, {one.what}"
        if math.isinf(worst) and worst < 0.0:
            return Finding(0.0, "every point", nothing) if zero else missing(nothing)
        return Finding(worst, where, TWO_INTEGRALS, f"largest for {where}")

    return find


def points_over(points: tuple[RidePoint, ...], over: str) -> tuple[RidePoint, ...]:
    """The design point, and the points of one sweep, which begin with its name."""
    return tuple(p for i, p in enumerate(points) if i == 0 or (over != "nominal" and p.where.startswith(over)))


def _acceleration(passenger: str | None) -> Read:
    def read(response: RideResponse) -> Iterator[Candidate]:
        for one in response.passengers:
            if passenger is None or one.name == passenger:
                agreed = one.agreement is Agreement.AGREED
                yield Candidate(one.total if agreed else math.nan, f"passenger {one.name}", one.reason)

    return read


def weighted_acceleration(passenger: str | None) -> Callable[[Evidence, str], Finding]:
    """Frequency-weighted acceleration of the worst passenger, or of one."""
    return ride_finder(_acceleration(passenger), "no passenger")


def _clearance(kind: str, field: str) -> Read:
    def read(response: RideResponse) -> Iterator[Candidate]:
        for one in response.clearances:
            if one.kind == kind or kind == "any":
                agreed = one.agreement is Agreement.AGREED
                yield Candidate(float(getattr(one, field)) if agreed else math.nan, one.name, one.reason)

    return read


def _force_used(response: RideResponse) -> Iterator[Candidate]:
    for one in response.actuators:
        agreed = one.agreement is Agreement.AGREED
        value = one.three_sigma_share if agreed else math.nan
        reason = one.reason or "the actuator has no force limit"
        yield Candidate(value, f"actuator {one.name}", reason)


def _supplied_power(response: RideResponse) -> Iterator[Candidate]:
    if response.actuators:
        agreed = all(one.agreement is Agreement.AGREED for one in response.actuators)
        total = math.fsum(one.supplied_power for one in response.actuators)
        reason = next((one.reason for one in response.actuators if one.reason), "")
        yield Candidate(total if agreed else math.nan, "all actuators together", reason)


def _force_rate(response: RideResponse) -> Iterator[Candidate]:
    for one in response.actuators:
        agreed = one.agreement is Agreement.AGREED
        yield Candidate(one.rate if agreed else math.nan, f"actuator {one.name}", one.reason)


def acceleration_mask(evidence: Evidence, over: str) -> Finding:
    """Largest ratio of a passenger's acceleration density to the mask, at the design point."""
    if evidence.ride is None:
        return missing(evidence.ride_reason)
    if not evidence.ride.masks:
        return missing("no acceleration could be held against a mask")
    worst = max(evidence.ride.masks, key=lambda one: math.inf if math.isnan(one.ratio) else one.ratio)
    where = f"design point, passenger {worst.passenger}, {worst.axis}, {worst.frequency:.3g} Hz"
    return Finding(worst.ratio, where, "density on a grid that resolves every mode", f"nearest at {where}")


def robust_factor(evidence: Evidence, over: str) -> Finding:
    """By what factor the spreads may grow: the guaranteed one, or the one found where that already decides."""
    found = evidence.robustness
    if found is None:
        return missing(evidence.robustness_reason)
    factor = found.factor
    if found.stable is Verdict.FAIL:
        words = found.reason or "a combination within the spreads is unstable"
        least = min(factor.found, BELOW_ONE)  # it lies inside the spreads
        return Finding(least, "design point", "pole replayed on the perturbed loop", words, bound="upper")
    if math.isnan(factor.proven):
        return missing(found.reason or "no guaranteed factor")
    words = f"guaranteed for every combination up to this factor; {_beyond(factor.found)}"
    # Proven in parts of the box, stability holds for all of it whatever the factor of one piece says.
    proven = max(factor.proven, 1.0) if found.stable is Verdict.PASS else factor.proven
    return Finding(proven, "design point", "structured singular value, upper bound", words, bound="lower")


def _beyond(found: float) -> str:
    return "no combination that loses stability was found" if math.isinf(found) else f"lost at {found:.4g}"


def worst_growth(evidence: Evidence, over: str) -> Finding:
    """Largest growth rate over the uncertain parameters: found, or proven negative."""
    found = evidence.robustness
    if found is None:
        return missing(evidence.robustness_reason)
    if found.stable is Verdict.PASS:
        words = f"proven negative for every combination; the largest found is {found.growth.value:.4g} 1/s"
        return Finding(0.0, "design point", "structured singular value, upper bound", words, bound="upper")
    return _worst_found(found.growth, "lower")


def worst_damping(evidence: Evidence, over: str) -> Finding:
    """Least damping ratio found over the uncertain parameters: the true one is at most this."""
    found = evidence.robustness
    return missing(evidence.robustness_reason) if found is None else _worst_found(found.damping, "upper")


def _worst_found(point: WorstPoint, bound: Literal["lower", "upper"]) -> Finding:
    if not point.verified:
        return missing(point.reason or "the worst case could not be replayed")
    return Finding(
        point.value, "design point, worst parameters found", "optimisation over the box, replayed",
        "the worst combination found; a worse one is not excluded", bound=bound,
    )  # fmt: skip


RIDE_FINDERS: dict[str, Callable[[Evidence, str], Finding]] = {
    "weighted_acceleration": weighted_acceleration(None),
    "acceleration_mask": acceleration_mask,
    "gap_used": ride_finder(
        _clearance("gap", "used"), "the vehicle has no magnet with a gap", zero=False, touching=math.inf
    ),
    "stroke_used": ride_finder(_clearance("stroke", "used"), "the vehicle has no suspension stroke", zero=False),
    "contact_probability": ride_finder(_clearance("any", "contact_per_hour"), NO_GAP, zero=False, touching=1.0),
    "force_used": ride_finder(_force_used, "no actuator"),
    "supplied_power": ride_finder(_supplied_power, "no actuator"),
    "force_rate": ride_finder(_force_rate, "no actuator"),
    "robust_factor": robust_factor,
    "worst_case_growth": worst_growth,
    "worst_case_damping": worst_damping,
}
"""By quantity, what finds it."""
