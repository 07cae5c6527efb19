"""Tables of a ride: passengers, gaps and strokes, actuators, operating points, girders and steps."""

from __future__ import annotations

import math
from typing import Final

from maglev_ctrl.analysis.response.records import ActuatorDemand, ClearanceStatistics, PassengerRide, RideResponse
from maglev_ctrl.report.model import Cell, Table, row
from maglev_ctrl.report.ride.summary import worst_numbers
from maglev_ctrl.report.style import ABSENT, SIGMA, number
from maglev_ctrl.report.values import with_prefix
from maglev_ctrl.study.ride_records import FlexibleSpan, RideStudy, SpanPassing, StepPassing

MOST_ROWS: Final = 12
_KILOMETRES_PER_HOUR: Final = 3.6
_SECONDS_PER_HOUR: Final = 3600.0
_NEVER: Final = 1e-12  # a probability below this is beyond what normal distributions can tell


def axes_of(response: RideResponse) -> tuple[str, ...]:
    """Axes of all passengers in order of first appearance."""
    return tuple(dict.fromkeys(axis for passenger in response.passengers for axis in passenger.axes))


def weighted_along(passenger: PassengerRide, axis: str) -> float:
    """Weighted acceleration along one axis, m/s^2; NaN where the passenger has none."""
    return float(passenger.weighted[passenger.axes.index(axis)]) if axis in passenger.axes else math.nan


def passenger_table(response: RideResponse, label: str) -> Table:
    """Every position in the car from front to rear, with the words of the standard."""
    axes = axes_of(response)
    sideways = len({p.y for p in response.passengers}) > 1
    rows = []
    for passenger in sorted(response.passengers, key=lambda p: (-p.x, -p.y)):
        place = [number(passenger.x, "m"), *([number(passenger.y, "m")] if sideways else [])]
        along = [number(weighted_along(passenger, axis)) for axis in axes]
        rows.append(row(passenger.name, *place, *along, number(passenger.total), passenger.comfort or ABSENT))
    places = ("x", "y") if sideways else ("x",)
    heads = ("Passenger", *places, *(axis.capitalize() for axis in axes), "Total", "Comfort (ISO 2631-1)")
    return Table(
        f"Ride of {label} by place in the car, front to rear: frequency-weighted r.m.s. acceleration in m/s², total "
        "as vector sum of the axes; x forward, y left of the car's centre of mass",
        heads, tuple(rows), (1.7, *(0.7 for _ in places), *(0.9 for _ in axes), 0.8, 2.2),
        right=tuple(range(1, 2 + len(places) + len(axes))), small=len(heads) > 7,
    )  # fmt: skip


def clearance_table(response: RideResponse, label: str) -> Table:
    """Gaps and strokes, the tightest first."""
    ranked = sorted(response.clearances, key=lambda c: -math.inf if math.isnan(c.used) else -c.used)
    rows = tuple(_clearance_row(one) for one in ranked[:MOST_ROWS])
    heads = (
        "Gap or stroke",
        "Kind",
        "Nominal",
        "Clearance",
        "Sag",
        f"3 {SIGMA}",
        "Used",
        "Crossings",
        "Contact in 1 h",
    )
    return Table(
        f"Gaps and strokes of {label}, tightest first{_left_out(len(ranked))}: share of the clearance that 3 "
        f"{SIGMA} and the sag of the girders use, level crossings by Rice's formula, and the probability "
        "of contact in one hour",
        heads, rows, (1.9, 0.7, 0.9, 0.9, 0.8, 0.9, 0.8, 1.0, 1.1), right=(2, 3, 4, 5, 6, 7, 8), small=True,
    )  # fmt: skip


def _clearance_row(one: ClearanceStatistics) -> tuple[Cell, ...]:
    return row(
        one.name, one.kind, number(1e3 * one.nominal, "mm"), number(1e3 * one.clearance, "mm"),
        number(1e3 * one.sag, "mm"), number(1e3 * one.three_sigma, "mm"), number(100.0 * one.used, "%"),
        _rare(one.crossing_rate * _SECONDS_PER_HOUR, "1/h"), _rare(one.contact_per_hour, ""),
    )  # fmt: skip


def _rare(value: float, unit: str) -> str:
    """A probability or a rate; below what normal distributions can tell only that it is."""
    return f"< {number(_NEVER, unit, digits=1)}" if 0.0 <= value < _NEVER else number(value, unit, digits=2)


def actuator_table(response: RideResponse, label: str) -> Table:
    """What every actuator has to give, the most powerful first, and all together."""
    ranked = sorted(response.actuators, key=lambda a: math.inf if math.isnan(a.force) else -a.force)
    rows = [_actuator_row(one) for one in ranked[:MOST_ROWS]]
    if len(ranked) > 1:
        parts = [sum(getattr(a, name) for a in ranked) for name in ("mean_power", "supplied_power", "energy_per_hour")]
        units = zip(parts, ("W", "W", "J"), strict=True)
        rows.append(row("All together", *(ABSENT for _ in range(6)), *(with_prefix(v, u) for v, u in units), ABSENT))
    heads = ("Actuator", "Force r.m.s.", f"3 {SIGMA}", "Limit", f"3 {SIGMA} / limit", "Rate r.m.s.", "Velocity r.m.s.",
             "Mean power", "Supplied", "Energy in 1 h", "At limit")  # fmt: skip
    return Table(
        f"Actuators of {label}{_left_out(len(ranked))}: mean power is given to the vehicle (negative: taken from it), "
        "supplied power is the mean of its positive part (no recuperation), at limit the share of time at which the "
        "linear force would exceed the limit",
        heads, tuple(rows), (1.5, 0.95, 0.95, 0.95, 0.75, 1.0, 1.05, 1.0, 0.95, 1.0, 1.1),
        right=tuple(range(1, 11)), small=True,
    )  # fmt: skip


def _actuator_row(one: ActuatorDemand) -> tuple[Cell, ...]:
    return row(
        one.name, with_prefix(one.force, "N"), with_prefix(3.0 * one.force, "N"), with_prefix(one.limit, "N"),
        number(100.0 * one.three_sigma_share, "%"), with_prefix(one.rate, "N/s"), number(one.velocity, "m/s"),
        with_prefix(one.mean_power, "W"), with_prefix(one.supplied_power, "W"), with_prefix(one.energy_per_hour, "J"),
        _rare(100.0 * one.saturated, "%"),
    )  # fmt: skip


def _left_out(count: int) -> str:
    return f" (first {MOST_ROWS} of {count})" if count > MOST_ROWS else ""


def point_table(study: RideStudy, label: str) -> Table | None:
    """The operating points looked at, the worst ride first; None where only the design point was looked at."""
    if len(study.points) < 2:
        return None
    told = [(point, worst_numbers(point.response)) for point in study.points]
    ranked = sorted(told, key=lambda entry: -math.inf if math.isnan(entry[1][0]) else -entry[1][0])
    rows = tuple(
        row(
            point.where, number(ride), number(100.0 * gap, "%"), number(100.0 * stroke, "%"), with_prefix(power, "W"),
            point.reason or (point.response.reason if point.response is not None else "") or ABSENT,
        )
        for point, (ride, gap, stroke, power) in ranked[:MOST_ROWS]
    )  # fmt: skip
    heads = ("Operating point", "Worst ride (m/s²)", "Gap used", "Stroke used", "Supplied", "Remark")
    return Table(
        f"Ride of {label} at every operating point looked at, without an answer first, then the worst"
        f"{_left_out(len(ranked))}",
        heads, rows, (1.7, 1.4, 0.9, 0.9, 0.9, 2.2), right=(1, 2, 3, 4), small=True,
    )  # fmt: skip


def single_passings(study: RideStudy, label: str) -> Table | None:
    """Girders, rigid and as moving beams, and a single step, at the design speed; None without any."""
    rows: list[tuple[Cell, ...]] = []
    if study.passing is not None:
        rows.append(_rigid_row(study.passing))
    if study.flexible is not None:
        rows.append(_flexible_row(study.flexible))
    if study.step is not None:
        rows.append(_step_row(study.step))
    if not rows:
        return None
    heads = ("Passed at the design speed", "Shape", "Change of a gap", "Acceleration", "Remark")
    return Table(
        f"Girders and steps under {label}: largest change of a magnet's gap, largest vertical acceleration of the "
        "car",
        heads, tuple(rows), (1.4, 2.2, 0.9, 1.0, 2.6), right=(2, 3), small=True,
    )  # fmt: skip


def _rigid_row(one: SpanPassing) -> tuple[Cell, ...]:
    shape = f"spans of {number(one.span, 'm')}, sag {number(1e3 * one.sag, 'mm')}"
    check = "" if math.isnan(one.check) else f"second method differs by {number(one.check, digits=1)}"
    return row(
        "Girders, rigid", shape, number(1e3 * one.design_gap, "mm"), number(one.design_acceleration, "m/s²"),
        "; ".join(words for words in (check, one.reason) if words) or ABSENT,
    )  # fmt: skip


def _flexible_row(one: FlexibleSpan) -> tuple[Cell, ...]:
    shape = (
        f"first bending {number(one.frequency, 'Hz')}, speed ratio {number(one.speed_ratio)}, mid-span "
        f"{number(1e3 * one.deflection, 'mm')} (at rest {number(1e3 * one.static_deflection, 'mm')})"
    )
    remark = "; ".join(words for words in (one.stable, one.reason) if words)
    return row(
        "Girders, moving beams", shape, number(1e3 * one.gap, "mm"), number(one.acceleration, "m/s²"), remark or ABSENT
    )


def _step_row(one: StepPassing) -> tuple[Cell, ...]:
    shape = f"{number(1e3 * one.height, 'mm')} high over a ramp of {number(one.ramp, 'm')}"
    return row(
        "A single step", shape, number(1e3 * one.gap, "mm"), number(one.acceleration, "m/s²"), one.reason or ABSENT
    )


def worst_speed_words(passing: SpanPassing) -> str:
    """At which speed girders are worst, and why."""
    why = passing.reason.rstrip(".")
    if math.isnan(passing.worst_speed):
        return f"Girder passing was not evaluated: {why or 'no worst speed was found'}."
    at = number(passing.worst_speed * _KILOMETRES_PER_HOUR, "km/h")
    size = number(1e3 * passing.worst_gap, "mm")
    told = f"Girders of {number(passing.span, 'm')} change a gap most at {at}, by {size}: {passing.worst}."
    return f"{told} {why[0].upper()}{why[1:]}." if why else told
