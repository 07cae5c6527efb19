"""The few numbers by which a ride is told: the worst passenger, the tightest gap, the power supplied."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np

from maglev_ctrl.analysis.response.records import ClearanceStatistics, PassengerRide, RideResponse
from maglev_ctrl.study.records import OptionStudy
from maglev_ctrl.study.ride_records import RideStudy


def at_design(option: OptionStudy) -> RideResponse | None:
    """The ride at the design point; None where there is none."""
    points = option.ride.points if option.ride is not None else ()
    return points[0].response if points else None


def worst_passenger(response: RideResponse) -> PassengerRide | None:
    """The passenger with the largest weighted acceleration; None where one of them could not be computed.

    An unknown passenger may be the worst one: then no other is told to be.
    """
    if not response.passengers or any(math.isnan(p.total) for p in response.passengers):
        return None
    return max(response.passengers, key=lambda p: p.total)


def tightest_clearance(response: RideResponse, kind: Literal["gap", "stroke"]) -> ClearanceStatistics | None:
    """The gap or stroke that uses the largest share of its clearance; None without one or where one is unknown."""
    found = [c for c in response.clearances if c.kind == kind]
    if not found or any(math.isnan(c.used) for c in found):
        return None
    return max(found, key=lambda c: c.used)


def supplied_power(response: RideResponse) -> float:
    """W that all actuators draw together without recuperation; NaN where one is unknown or there is none."""
    return float(np.sum([a.supplied_power for a in response.actuators])) if response.actuators else math.nan


def worst_numbers(response: RideResponse | None) -> tuple[float, float, float, float]:
    """Largest weighted acceleration (m/s^2), gap use and stroke use (shares), supplied power (W); NaN where unknown.

    Examples
    --------
    >>> worst_numbers(None)
    (nan, nan, nan, nan)
    """
    if response is None:
        return math.nan, math.nan, math.nan, math.nan
    passenger = worst_passenger(response)
    gap, stroke = tightest_clearance(response, "gap"), tightest_clearance(response, "stroke")
    return (
        math.nan if passenger is None else passenger.total,
        math.nan if gap is None else gap.used,
        math.nan if stroke is None else stroke.used,
        supplied_power(response),
    )


def unresolved(study: RideStudy) -> tuple[str, ...]:
    """What of the design point the two methods do not agree on, or could not be computed, with the reasons."""
    response = study.points[0].response if study.points else None
    if response is None:
        return ()
    told = [(p.name, p.reason) for p in response.passengers]
    told += [(c.name, c.reason) for c in response.clearances]
    told += [(a.name, a.reason) for a in response.actuators]
    return tuple(f"{name}: {reason}" for name, reason in told if reason)
