"""An option in words: one line per element and one for the law."""

from __future__ import annotations

import math
from typing import assert_never

from maglev_ctrl.scenario.control_schema import (
    ControlRecord,
    Corners,
    DampingBudget,
    HookedLaw,
    Lqg,
    Lqi,
    Lqr,
    MultiObjective,
    OutputFeedback,
    Predictive,
    RiccatiLaw,
    Scheduled,
    SkyHook,
)
from maglev_ctrl.scenario.layout import CAR, Layout, layout, place_element, place_sensor
from maglev_ctrl.scenario.option_schema import (
    ActuatorRecord,
    OptionRecord,
    SensorRecord,
    SpringDamperRecord,
)
from maglev_ctrl.scenario.scenario_schema import Scenario


def describe_option(scenario: Scenario, option: OptionRecord) -> tuple[str, ...]:
    """The option's elements and law, one line each; a single line for an option without any."""
    here = layout(scenario.vehicle)
    lines = [
        *(_spring(spring, here, chosen=option.damping_budget is not None) for spring in option.spring_dampers),
        *(_actuator(actuator, here) for actuator in option.actuators),
        *(_sensor(sensor, here) for sensor in option.sensors),
        *([_budget(option.damping_budget)] if option.damping_budget is not None else []),
        *([_law(option.control)] if option.control is not None else []),
    ]
    return tuple(lines) or ("nothing added to the bare vehicle",)


def _times(count: int) -> str:
    return "" if count == 1 else f"{count} x "


def _spring(spring: SpringDamperRecord, here: Layout, *, chosen: bool) -> str:
    parts = []
    if spring.stiffness:
        parts.append(f"{spring.stiffness / 1e3:g} kN/m")
    if chosen:
        parts.append("damping to be chosen")
    elif spring.damping:
        parts.append(f"{spring.damping / 1e3:g} kN s/m")
    if spring.lag:
        parts.append(f"lag {spring.lag * 1e3:g} ms")
    ends = " to ".join(spring.between)
    return f"{_times(len(place_element(spring, here)))}{spring.name}, {spring.direction}, {ends}: {', '.join(parts)}"


def _actuator(actuator: ActuatorRecord, here: Layout) -> str:
    parts = []
    if actuator.force_limit is not None:
        parts.append(f"{actuator.force_limit / 1e3:g} kN")
    if actuator.bandwidth is not None:
        parts.append(f"{actuator.bandwidth / (2.0 * math.pi):g} Hz")
    if actuator.delay:
        parts.append(f"delay {actuator.delay * 1e3:g} ms")
    what = ", ".join(parts) or "ideal"
    ends = " to ".join(actuator.between)
    return f"{_times(len(place_element(actuator, here)))}actuator {actuator.name}, {actuator.direction}, {ends}: {what}"


def _sensor(sensor: SensorRecord, here: Layout) -> str:
    places = place_sensor(sensor, here)
    on = "the car" if sensor.on == CAR else sensor.on
    return f"{_times(len(places))}{sensor.kind} sensor {sensor.name} on {on}"


def _budget(budget: DampingBudget) -> str:
    parts = [f"damping chosen: the cheapest proved to decay at {budget.choose:g} 1/s"]
    if budget.costs:
        parts.append(f"prices {' : '.join(f'{cost:g}' for cost in budget.costs)}")
    if budget.largest is not None:
        parts.append(f"at most {budget.largest / 1e3:g} kN s/m at one place")
    return ", ".join(parts) + _at_corners(budget.corners)


def _at_corners(corners: Corners | None) -> str:
    return "" if corners is None else ", at every corner"


def _law(law: ControlRecord) -> str:
    match law:
        case SkyHook():
            return f"sky-hook damping {law.damping / 1e3:g} kN s/m of {law.sensor}"
        case HookedLaw():
            given = {
                "sky-hook": law.sky, "ground-hook": law.ground, "relative": law.relative, "gap-rate": law.gap_rate
            }  # fmt: skip
            return "damping: " + ", ".join(f"{kind} {value / 1e3:g} kN s/m" for kind, value in given.items() if value)
        case Lqr():
            name = "LQR"
        case Lqi():
            name = f"LQR with integrals of {', '.join(item.output for item in law.integral)}"
        case Lqg():
            name = f"LQG, disturbance {law.disturbance:g} m/s^2 per sqrt(Hz)"
        case RiccatiLaw():
            rough = ", rough guideway" if law.guideway is not None else ""
            name = f"{'H2' if law.law == 'h2' else 'H-infinity'} feedback of the {law.feedback}{rough}"
        case MultiObjective():
            name = f"multi-objective LMI, {_objective(law.objective)}{_bounds(law)}"
        case OutputFeedback():
            kind = "constant gains" if law.order == 0 else f"a law of order {law.order}"
            pairs = "".join(f", {sensor} to {actuator}" for sensor, actuator in law.links)
            name = f"output feedback, {kind}{pairs}, {_objective(law.objective)}{_at_corners(law.corners)}"
        case Scheduled():
            ends = f"{law.nodes[0].text} to {law.nodes[-1].text}"
            name = f"gains scheduled over {law.over}, {law.method}, {len(law.nodes)} nodes from {ends}"
        case Predictive():
            within = "".join(f", {limit.output} within {limit.value.text}" for limit in law.limits)
            name = f"predictive control, {law.horizon} steps of {law.sampling_period * 1e3:g} ms{within}"
        case _ as never:
            assert_never(never)
    weights = ", ".join(f"{item.output or item.actuator} {item.value.text}" for item in law.allowed)
    return f"{name}; acceptable: {weights}"


def _objective(objective: str) -> str:
    words = {
        "h2": "least H2 norm", "h_infinity": "least H-infinity norm", "decay_rate": "fastest decay",
        "damping_ratio": "largest damping ratio", "gain": "least gain", "none": "no objective",
    }  # fmt: skip
    return words[objective]


def _bounds(law: MultiObjective) -> str:
    given = [
        ("H2 norm below {:g}", law.h2_below), ("H-infinity norm below {:g}", law.h_infinity_below),
        ("decay rate {:g} 1/s", law.decay_rate), ("damping ratio {:g}", law.damping_ratio),
        ("poles within {:g} 1/s", law.fastest), ("gain below {:g}", law.gain_below),
    ]  # fmt: skip
    words = "".join(f", {text.format(value)}" for text, value in given if value is not None)
    if law.hold_from:
        words += ", commands within their limits from " + " and ".join(
            f"{item.output} {item.value.text}" for item in law.hold_from
        )
    if law.corners is None:
        return words
    matrices = "one Lyapunov matrix" if law.lyapunov == "common" else "a Lyapunov matrix for each"
    return f"{words}, at every corner, {matrices}"
