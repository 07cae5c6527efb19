"""Faults inside one option's control law and damping budget: names, dimensions, and requirements that cannot be."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from typing import assert_never

from maglev_ctrl.scenario.checks_values import product, time_faults, unit_faults
from maglev_ctrl.scenario.control_schema import (
    Amount,
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
from maglev_ctrl.scenario.layout import Layout, outputs_of, place_element, place_sensor
from maglev_ctrl.scenario.option_schema import OptionRecord, SensorRecord
from maglev_ctrl.scenario.problems import Fault, KeyPath, near_match
from maglev_ctrl.scenario.units import Dimensions, Quantity, dimensions_of

Commands = Mapping[str, tuple[Dimensions, tuple[str, ...]]]
Outputs = Mapping[str, tuple[Dimensions, tuple[str, ...]]]
Weighted = Lqr | Lqi | Lqg | RiccatiLaw | MultiObjective | OutputFeedback | Scheduled | Predictive
_SECOND = dimensions_of("s")
_SPEED, _ACCELERATION, _RATE, _ANGULAR = (dimensions_of(unit) for unit in ("m/s", "m/s^2", "rad/s", "rad/s^2"))
_NOISE_EXAMPLES = {"velocity": "1 mm/s/Hz^0.5", "acceleration": "0.01 m/s^2/Hz^0.5"}
STEP_LIMIT = 20_000
"""Largest number of steps of the manoeuvre predictive control is shown by."""


def control_faults(option: OptionRecord, here: Layout, commands: Commands, *, path: KeyPath) -> Iterator[Fault]:
    """Every fault of an option's law.

    Parameters
    ----------
    commands : electromagnets a law may drive besides the option's own actuators
    path : of the option
    """
    law, place = option.control, (*path, "control")
    assert law is not None
    outputs = outputs_of(option, here)
    yield from time_faults(law, "sampling_period", "time_limit", "duration", path=place)
    match law:
        case SkyHook():
            yield from _hook_faults(option, law.sensor, here, path=(*place, "sensor"))
            if law.damping <= 0.0:
                yield Fault((*place, "damping"), "expected a damping above zero")
            return
        case HookedLaw():
            yield from _damping_faults(option, law, path=place)
            return
        case Lqr() | Lqg() | MultiObjective() | Scheduled():
            pass
        case Lqi():
            yield from _integral_faults(option, law, here, (outputs, commands), path=place)
        case RiccatiLaw():
            if option.sensors and "feedback" not in law.model_fields_set:
                yield Fault(
                    (*place, "feedback"),
                    'missing; the option has sensors: expected feedback = "sensors" to measure with them or '
                    'feedback = "states" to leave them aside',
                )
            if law.feedback == "states" and law.guideway is not None:
                yield Fault(
                    (*place, "guideway"), 'expected feedback = "sensors": the guideway\'s states are not measured'
                )
            if law.back_off <= 1.0:
                yield Fault((*place, "back_off"), f"expected a factor above 1, got {law.back_off:g}")
            for key in ("back_off", "gain_bound"):
                if law.law == "h2" and key in law.model_fields_set:
                    yield Fault((*place, key), f"an H2 law has no gamma that {key} could move; remove it", at_key=True)
        case OutputFeedback():
            yield from _link_faults(option, law, here, commands, path=place)
            if law.objective == "h2" and law.order == 0:
                reason = "white sensor noise through constant gains makes the H2 norm infinite; expected h_infinity, "
                yield Fault((*place, "objective"), f"{reason}decay_rate or damping_ratio, or order = 1 or more")
        case Predictive():
            for index, limit in enumerate(law.limits):
                yield from _amount_faults(limit.output, limit.value, outputs, path=(*place, "limit", index))
            yield from _twice(
                [(item.output, _members(item.output, outputs)) for item in law.limits],
                "already has a limit", path=(*place, "limit"),
            )  # fmt: skip
            yield from _manoeuvre_faults(law, here, path=place)
        case _ as never:
            assert_never(never)
    yield from _weight_faults(option, law, outputs, commands, path=place)
    senses = isinstance(law, Lqg | OutputFeedback) or (isinstance(law, RiccatiLaw) and law.feedback == "sensors")
    if senses:
        yield from _noise_faults(option, law.law, path=path)
    if isinstance(law, MultiObjective):
        yield from _requirement_faults(law, path=place)
        yield from _hold_faults(option, law, here, path=place)


def budget_faults(option: OptionRecord, *, path: KeyPath) -> Iterator[Fault]:
    """Every fault of an option's damping budget."""
    budget, place = option.damping_budget, (*path, "damping_budget")
    if budget is None:
        return
    if not option.spring_dampers:
        yield Fault(place, "expected at least one [[option.spring_damper]] whose damping is to be chosen", at_key=True)
        return
    if any(b <= a for a, b in pairwise(budget.decay_rates)):
        yield Fault((*place, "decay_rates"), "expected rising decay rates")
    if budget.decay_rates[0] <= 0.0:
        yield Fault((*place, "decay_rates", 0), "expected a decay rate above zero")
    if budget.choose not in budget.decay_rates:
        yield Fault((*place, "choose"), "expected one of the decay_rates")
    if budget.costs and len(budget.costs) != len(option.spring_dampers):
        yield Fault(
            (*place, "costs"),
            f"expected one cost per spring_damper: {len(option.spring_dampers)}, got {len(budget.costs)}",
        )
    if budget.largest is not None and budget.largest <= 0.0:
        yield Fault((*place, "largest"), "expected a damping above zero")
    yield from time_faults(budget, "time_limit", path=place)
    if option.control is not None:
        yield Fault(
            place, "expected either a control law or a damping budget; give the chosen dampers to another option",
            at_key=True,
        )  # fmt: skip
    for index, element in enumerate(option.spring_dampers):
        if element.lag:
            yield Fault((*path, "spring_damper", index, "lag"), "a damping_budget chooses dampers without a lag only")


def _weight_faults(
    option: OptionRecord, law: Weighted, outputs: Outputs, commands: Commands, *, path: KeyPath
) -> Iterator[Fault]:
    newton = dimensions_of("N")
    driven = {actuator.name: newton for actuator in option.actuators}
    driven |= {name: dimensions for name, (dimensions, _) in commands.items()}
    weighted: set[str] = set()
    named: list[tuple[str, tuple[str, ...]]] = []
    for index, item in enumerate(law.allowed):
        place: KeyPath = (*path, "allowed", index)
        named.append((item.output or item.actuator or "", ()))
        if (item.output is None) == (item.actuator is None):
            weighted |= {item.actuator or ""}
            yield Fault(place, "expected exactly one of output and actuator")
            continue
        name = item.output or item.actuator or ""
        if item.actuator is not None:
            weighted.add(item.actuator)
            if item.actuator not in driven:
                weighted |= set(driven)  # which one was meant is not known
                yield Fault((*place, "actuator"), f'no actuator is called "{name}"{near_match(name, driven)}')
                continue
            dimensions = driven[item.actuator]
        else:
            if item.output not in outputs:
                yield Fault((*place, "output"), f'no output is called "{name}"{_near_output(name, outputs)}')
                continue
            dimensions = outputs[name][0]
        members = _members(name, outputs) if item.output else commands[name][1] if name in commands else (name,)
        named[-1] = (name, members)
        yield from unit_faults(name, item.value, dimensions, path=(*place, "value"))
    yield from _twice(named, "already has a weight", path=(*path, "allowed"))
    for missing in sorted({actuator.name for actuator in option.actuators} - weighted):
        yield Fault((*path, "allowed"), f'expected a weight {{ actuator = "{missing}", value = ... }} as well')
    if not option.actuators and not weighted:
        near = ", ".join(list(driven)[:3])
        yield Fault((*path, "allowed"), f"expected at least one {{ actuator = ..., value = ... }}, out of {near}")
    if all(item.output is None for item in law.allowed):
        yield Fault((*path, "allowed"), "expected at least one { output = ..., value = ... }")


def _members(name: str, outputs: Outputs) -> tuple[str, ...]:
    return outputs[name][1] if name in outputs else ()


def _twice(named: Sequence[tuple[str, tuple[str, ...]]], told: str, *, path: KeyPath) -> Iterator[Fault]:
    """Names that mean something an earlier one of the list already means."""
    owners: dict[str, str] = {}
    for index, (name, members) in enumerate(named):
        shared = next((member for member in members if member in owners), None)
        if shared is not None:
            by = "" if owners[shared] == name else f' by "{owners[shared]}"'
            yield Fault((*path, index), f'"{name if not by else shared}" {told}{by}')
        owners |= dict.fromkeys(members, name)


def _integral_faults(
    option: OptionRecord, law: Lqi, here: Layout, known: tuple[Outputs, Commands], *, path: KeyPath
) -> Iterator[Fault]:
    """Integrals of what has no steady value, of what nothing weighs, or of more than can be steered."""
    outputs, commands = known
    freedoms = {f"{body}.{freedom}" for body, names in here.bodies for freedom in names}
    weighted = {member for item in law.allowed if item.output for member in _members(item.output, outputs)}
    still = {_SPEED, _ACCELERATION, _RATE, _ANGULAR}
    wanted: list[tuple[str, tuple[str, ...]]] = []
    for index, item in enumerate(law.integral):
        place: KeyPath = (*path, "integral", index)
        yield from _amount_faults(item.output, item.value, outputs, path=place, times=_SECOND)
        members = _members(item.output, outputs)
        wanted.append((item.output, members))
        if item.output not in outputs:
            continue
        if outputs[item.output][0] in still and not item.output.endswith("surge.velocity"):
            yield Fault((*place, "output"), f"{item.output} has no steady error; expected a position, gap or stroke")
        elif not set(members) <= freedoms | weighted and not item.output.endswith("surge.velocity"):
            yield Fault((*place, "output"), f"expected a freedom or an output with a weight in allowed: {item.output}")
    yield from _twice(wanted, "already has an integral", path=(*path, "integral"))
    count = sum(len(members) for _, members in wanted)
    driven = {item.actuator for item in law.allowed if item.actuator}
    steered = sum(len(members) for name, members in _driven(option, here, commands).items() if name in driven)
    if count > steered > 0:
        yield Fault(
            (*path, "integral"), f"expected at most as many integrals as there are commands: {steered}, got {count}"
        )


def _driven(option: OptionRecord, here: Layout, commands: Commands) -> dict[str, tuple[str, ...]]:
    """Names of actuators and windings, and the inputs each stands for."""
    found = {actuator.name: tuple(one.name for one in place_element(actuator, here)) for actuator in option.actuators}
    return found | {name: members for name, (_, members) in commands.items()}


def _amount_faults(
    name: str, value: Quantity, outputs: Outputs, *, path: KeyPath, times: Dimensions = ()
) -> Iterator[Fault]:
    """A named output and a value of it, `times` further dimensions."""
    if name not in outputs:
        yield Fault((*path, "output"), f'no output is called "{name}"{_near_output(name, outputs)}')
        return
    yield from unit_faults(name, value, product(outputs[name][0], times), path=(*path, "value"), plain=bool(times))


def _near_output(name: str, outputs: Mapping[str, object]) -> str:
    text = near_match(name, outputs)
    if "did you mean" in text:
        return text
    return "; examples are " + ", ".join(list(outputs)[:6])


def _noise_faults(option: OptionRecord, law: str, *, path: KeyPath) -> Iterator[Fault]:
    if not option.sensors:
        yield Fault((*path, "control"), f"the law {law} measures with sensors; expected at least one [[option.sensor]]")
    for index, sensor in enumerate(option.sensors):
        if sensor.noise is None:
            unit = _NOISE_EXAMPLES.get(sensor.kind, "0.01 mm/Hz^0.5")
            yield Fault(
                (*path, "sensor", index, "noise"),
                f'missing; the law {law} needs a noise density, for example "{unit}"',
            )


def _hook_faults(option: OptionRecord, name: str, here: Layout, *, path: KeyPath) -> Iterator[Fault]:
    """A sensor of velocity, one measurement per actuator."""
    if not option.actuators:
        yield Fault(path[:-1], "expected at least one [[option.actuator]] for the law to drive", at_key=True)
        return
    sensors: dict[str, SensorRecord] = {sensor.name: sensor for sensor in option.sensors}
    sensor = sensors.get(name)
    if sensor is None:
        yield Fault(path, f'no sensor is called "{name}"{near_match(name, sensors)}')
        return
    if sensor.kind not in ("velocity", "acceleration"):
        yield Fault(path, f"expected a sensor of velocity or acceleration, got one of kind {sensor.kind}")
    driven = sum(len(place_element(actuator, here)) for actuator in option.actuators)
    measured = len(place_sensor(sensor, here))
    if driven != measured:
        yield Fault(path, f"expected one velocity per actuator: {driven} actuators, {measured} measurements")


def _damping_faults(option: OptionRecord, law: HookedLaw, *, path: KeyPath) -> Iterator[Fault]:
    """Signs; which sensors are missing only the built vehicle can tell."""
    if not option.actuators:
        yield Fault(path, "expected at least one [[option.actuator]] for the law to drive", at_key=True)
    given = {key: getattr(law, key) for key in ("sky", "ground", "relative", "gap_rate")}
    if not any(given.values()):
        yield Fault(path, "expected at least one of sky, ground, relative and gap_rate", at_key=True)
    for key, value in given.items():
        if value < 0.0:
            yield Fault((*path, key), "expected a damping that is not negative")


def _link_faults(
    option: OptionRecord, law: OutputFeedback, here: Layout, commands: Commands, *, path: KeyPath
) -> Iterator[Fault]:
    sensors = {sensor.name for sensor in option.sensors}
    driven = _driven(option, here, commands)
    for index, (sensor, actuator) in enumerate(law.links):
        place: KeyPath = (*path, "links", index)
        if sensor not in sensors:
            yield Fault((*place, 0), f'no sensor is called "{sensor}"{near_match(sensor, sensors)}')
        if actuator not in driven:
            yield Fault((*place, 1), f'no actuator is called "{actuator}"{near_match(actuator, driven)}')
    if not law.links:
        return
    if law.order > 0:
        told = "a law with states of its own passes every sensor on to every actuator; expected order = 0 with links"
        yield Fault((*path, "order"), told)
    reached = {member for _, actuator in law.links for member in driven.get(actuator, ())}
    used = {item.actuator for item in law.allowed if item.actuator in driven} | {a.name for a in option.actuators}
    for name in sorted(used):
        if not set(driven[name]) <= reached:
            yield Fault((*path, "links"), f'the actuator "{name}" sees no sensor')


def start_units(here: Layout) -> tuple[dict[str, str], dict[str, str]]:
    """Freedoms and velocities a vehicle may start with, and freedoms an acceleration may load, with their units."""
    turning = ("roll", "pitch", "yaw")
    kinds = {f"{body}.{one}": "rad" if one in turning else "m" for body, names in here.bodies for one in names}
    start = kinds | {f"{name}.velocity": f"{unit}/s" for name, unit in kinds.items()}
    return start, {name: f"{unit}/s^2" for name, unit in kinds.items()}


def _state_faults(items: Sequence[Amount], known: Mapping[str, str], noun: str, *, path: KeyPath) -> Iterator[Fault]:
    """Unknown or doubled names, positions along a uniform guideway, and units."""
    seen: list[str] = []
    for index, item in enumerate(items):
        place: KeyPath = (*path, index)
        if item.output not in known:
            yield Fault((*place, "output"), f'no {noun} is called "{item.output}"{near_match(item.output, known)}')
            continue
        if item.output in seen:
            yield Fault(place, f'"{item.output}" is named twice')
        seen.append(item.output)
        if path[-1] != "load" and item.output.endswith(".surge"):
            told = "nothing depends on surge along a uniform guideway; expected another freedom"
            yield Fault((*place, "output"), told)
        yield from unit_faults(item.output, item.value, dimensions_of(known[item.output]), path=(*place, "value"))


def _hold_faults(option: OptionRecord, law: MultiObjective, here: Layout, *, path: KeyPath) -> Iterator[Fault]:
    if not law.hold_from:
        return
    yield from _state_faults(law.hold_from, start_units(here)[0], "freedom or velocity", path=(*path, "hold_from"))
    for actuator in option.actuators:
        if actuator.force_limit is None:
            reason = f'hold_from needs a force_limit of the actuator "{actuator.name}"'
            yield Fault((*path, "hold_from"), reason, at_key=True)
    if law.lyapunov != "common":
        yield Fault((*path, "hold_from"), 'expected lyapunov = "common" with it', at_key=True)


def _manoeuvre_faults(law: Predictive, here: Layout, *, path: KeyPath) -> Iterator[Fault]:
    start, load = start_units(here)
    for key, known, noun in (("start", start, "freedom or velocity"), ("load", load, "freedom")):
        yield from _state_faults(getattr(law, key), known, noun, path=(*path, key))
    if law.sampling_period > 0.0:
        steps = law.duration / law.sampling_period
        if law.duration > 0.0 and not 1.0 <= steps <= STEP_LIMIT:
            yield Fault((*path, "duration"), f"expected 1 to {STEP_LIMIT} sampling periods, got {steps:.6g}")


def _requirement_faults(law: MultiObjective, *, path: KeyPath) -> Iterator[Fault]:
    """Requirements that cannot be met together whatever the plant."""
    if law.damping_ratio is not None and law.damping_ratio >= 1.0:
        yield Fault((*path, "damping_ratio"), f"expected a damping ratio below 1, got {law.damping_ratio:g}")
    for key in ("decay_rate", "fastest"):
        value = getattr(law, key)
        if value is not None and value <= 0.0:
            yield Fault((*path, key), "expected a rate above zero")
    if law.decay_rate is not None and law.fastest is not None and law.decay_rate >= law.fastest > 0.0:
        yield Fault(
            (*path, "decay_rate"),
            f"a decay of {law.decay_rate:g} 1/s and no pole beyond {law.fastest:g} 1/s contradict each other",
        )
    bounded = (law.h2_below, law.h_infinity_below, law.decay_rate, law.damping_ratio, law.fastest, law.gain_below)
    if law.objective == "none" and all(bound is None for bound in bounded):
        yield Fault((*path, "objective"), "expected an objective or at least one requirement")
