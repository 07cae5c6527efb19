"""Faults inside one option's control law and damping budget: names, dimensions, and requirements that cannot be."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import pairwise
from typing import assert_never

from maglev_ctrl.scenario.control_schema import (
    Corners,
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
from maglev_ctrl.scenario.units import Dimensions, Quantity, describe, dimensions_of

Commands = Mapping[str, tuple[Dimensions, tuple[str, ...]]]
Outputs = Mapping[str, tuple[Dimensions, tuple[str, ...]]]
Weighted = Lqr | Lqi | Lqg | RiccatiLaw | MultiObjective | OutputFeedback | Scheduled | Predictive
_SECOND = dimensions_of("s")
_NOISE_EXAMPLES = {"velocity": "1 mm/s/Hz^0.5", "acceleration": "0.01 m/s^2/Hz^0.5"}
_PARAMETERS = {"speed": "m/s", "height": "m", "gap": "m", "payload": "kg"}


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
    match law:
        case SkyHook():
            yield from _hook_faults(option, law.sensor, here, path=(*place, "sensor"))
            if law.damping <= 0.0:
                yield Fault((*place, "damping"), "expected a damping above zero")
            return
        case HookedLaw():
            yield from _damping_faults(option, law, path=place)
            return
        case Lqr() | Lqg() | MultiObjective():
            pass
        case Lqi():
            for index, item in enumerate(law.integral):
                yield from _amount_faults(
                    item.output, item.value, outputs, path=(*place, "integral", index), times=_SECOND
                )
        case RiccatiLaw():
            if law.feedback == "states" and law.guideway is not None:
                yield Fault(
                    (*place, "guideway"), 'expected feedback = "sensors": the guideway\'s states are not measured'
                )
            if law.back_off < 1.0:
                yield Fault((*place, "back_off"), f"expected 1 or more, got {law.back_off:g}")
        case OutputFeedback():
            yield from _link_faults(option, law, commands, path=place)
        case Scheduled():
            yield from _schedule_faults(law, path=place)
        case Predictive():
            for index, limit in enumerate(law.limits):
                yield from _amount_faults(limit.output, limit.value, outputs, path=(*place, "limit", index))
            if law.sampling_period <= 0.0:
                yield Fault((*place, "sampling_period"), "expected a time above zero")
            yield from _manoeuvre_faults(law, here, path=place)
        case _ as never:
            assert_never(never)
    yield from _weight_faults(option, law, outputs, commands, path=place)
    senses = isinstance(law, Lqg | OutputFeedback) or (isinstance(law, RiccatiLaw) and law.feedback == "sensors")
    if senses:
        yield from _noise_faults(option, law.law, path=path)
    if isinstance(law, MultiObjective | OutputFeedback):
        yield from _corner_faults(law.corners, path=(*place, "corners"))
    if isinstance(law, MultiObjective):
        yield from _requirement_faults(law, path=place)


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
    yield from _corner_faults(budget.corners, path=(*place, "corners"))


def _weight_faults(
    option: OptionRecord, law: Weighted, outputs: Outputs, commands: Commands, *, path: KeyPath
) -> Iterator[Fault]:
    newton = dimensions_of("N")
    driven = {actuator.name: newton for actuator in option.actuators}
    driven |= {name: dimensions for name, (dimensions, _) in commands.items()}
    weighted: set[str] = set()
    named: list[str] = []
    for index, item in enumerate(law.allowed):
        place: KeyPath = (*path, "allowed", index)
        if (item.output is None) == (item.actuator is None):
            yield Fault(place, "expected exactly one of output and actuator")
            continue
        name = item.output or item.actuator or ""
        if item.actuator is not None:
            weighted.add(item.actuator)
            if item.actuator not in driven:
                yield Fault((*place, "actuator"), f'no actuator is called "{name}"{near_match(name, driven)}')
                continue
            dimensions = driven[item.actuator]
        else:
            if item.output not in outputs:
                yield Fault((*place, "output"), f'no output is called "{name}"{_near_output(name, outputs)}')
                continue
            dimensions = outputs[name][0]
        if name in named:
            yield Fault(place, f'"{name}" already has a weight')
        named.append(name)
        yield from _unit_faults(name, item.value, dimensions, path=(*place, "value"))
    for missing in sorted({actuator.name for actuator in option.actuators} - weighted):
        yield Fault((*path, "allowed"), f'expected a weight {{ actuator = "{missing}", value = ... }} as well')
    if not option.actuators and not weighted:
        near = ", ".join(list(driven)[:3])
        yield Fault((*path, "allowed"), f"expected at least one {{ actuator = ..., value = ... }}, out of {near}")
    if all(item.output is None for item in law.allowed):
        yield Fault((*path, "allowed"), "expected at least one { output = ..., value = ... }")


def _amount_faults(
    name: str, value: Quantity, outputs: Outputs, *, path: KeyPath, times: Dimensions = ()
) -> Iterator[Fault]:
    """A named output and a value of it, `times` further dimensions."""
    if name not in outputs:
        yield Fault((*path, "output"), f'no output is called "{name}"{_near_output(name, outputs)}')
        return
    yield from _unit_faults(name, value, _product(outputs[name][0], times), path=(*path, "value"), plain=bool(times))


def _unit_faults(
    name: str, value: Quantity, dimensions: Dimensions, *, path: KeyPath, plain: bool = False
) -> Iterator[Fault]:
    if value.dimensions == dimensions and (dimensions or plain or value.written == "angle"):
        return
    example = describe(dimensions) if dimensions else "an angle"
    got = f'{describe(value.dimensions)}: "{value.text}"'
    yield Fault(path, f"expected {example} with its unit for {name}, got {got}")


def _product(first: Dimensions, second: Dimensions) -> Dimensions:
    powers = dict(first)
    for name, power in second:
        powers[name] = powers.get(name, 0.0) + power
    return tuple(sorted((name, power) for name, power in powers.items() if power))


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


def _link_faults(option: OptionRecord, law: OutputFeedback, commands: Commands, *, path: KeyPath) -> Iterator[Fault]:
    sensors = {sensor.name for sensor in option.sensors}
    driven = {actuator.name for actuator in option.actuators} | set(commands)
    for index, (sensor, actuator) in enumerate(law.links):
        place: KeyPath = (*path, "links", index)
        if sensor not in sensors:
            yield Fault((*place, 0), f'no sensor is called "{sensor}"{near_match(sensor, sensors)}')
        if actuator not in driven:
            yield Fault((*place, 1), f'no actuator is called "{actuator}"{near_match(actuator, driven)}')
    if law.links:
        for deaf in sorted({a.name for a in option.actuators} - {actuator for _, actuator in law.links}):
            yield Fault((*path, "links"), f'the actuator "{deaf}" sees no sensor')


def _schedule_faults(law: Scheduled, *, path: KeyPath) -> Iterator[Fault]:
    wanted = dimensions_of(_PARAMETERS[law.over])
    for index, node in enumerate(law.nodes):
        yield from _unit_faults(law.over, node, wanted, path=(*path, "nodes", index))
    values = [node.value for node in law.nodes]
    if any(b <= a for a, b in pairwise(values)):
        yield Fault((*path, "nodes"), "expected rising values")
    if law.fastest_change is not None:
        per_second = _product(wanted, (("[time]", -1.0),))
        yield from _unit_faults(
            f"the change of {law.over}", law.fastest_change, per_second, path=(*path, "fastest_change")
        )


def _manoeuvre_faults(law: Predictive, here: Layout, *, path: KeyPath) -> Iterator[Fault]:
    turning = ("roll", "pitch", "yaw")
    freedoms = {f"{body}.{freedom}": freedom in turning for body, names in here.bodies for freedom in names}
    for key, units in (("start", ("m", "rad")), ("load", ("m/s^2", "rad/s^2"))):
        for index, item in enumerate(getattr(law, key)):
            place: KeyPath = (*path, key, index)
            if item.output not in freedoms:
                yield Fault(
                    (*place, "output"), f'no freedom is called "{item.output}"{near_match(item.output, freedoms)}'
                )
                continue
            wanted = dimensions_of(units[freedoms[item.output]])
            yield from _unit_faults(item.output, item.value, wanted, path=(*place, "value"))


def _corner_faults(corners: Corners | None, *, path: KeyPath) -> Iterator[Fault]:
    if corners is None:
        return
    values = [getattr(corners, key) for key in ("speed", "payload", "height", "gap", "magnetic_stiffness")]
    if not any(values):
        yield Fault(path, "expected at least one list of values: speed, payload, height, gap or magnetic_stiffness")
    count = 1
    for found in values:
        count *= max(1, len(found))
    if count > 32:
        yield Fault(path, f"expected at most 32 combinations, got {count}")


def _requirement_faults(law: MultiObjective, *, path: KeyPath) -> Iterator[Fault]:
    """Requirements that cannot be met together whatever the plant."""
    if law.damping_ratio is not None and law.damping_ratio >= 1.0:
        yield Fault((*path, "damping_ratio"), f"expected a damping ratio below 1, got {law.damping_ratio:g}")
    for key in ("decay_rate", "fastest"):
        value = getattr(law, key)
        if value is not None and value <= 0.0:
            yield Fault((*path, key), "expected a rate above zero")
    if law.decay_rate is not None and law.fastest is not None and law.decay_rate >= law.fastest:
        yield Fault(
            (*path, "decay_rate"),
            f"a decay of {law.decay_rate:g} 1/s and no pole beyond {law.fastest:g} 1/s contradict each other",
        )
    bounded = (law.h2_below, law.h_infinity_below, law.decay_rate, law.damping_ratio, law.fastest, law.gain_below)
    if law.objective == "none" and all(bound is None for bound in bounded):
        yield Fault((*path, "objective"), "expected an objective or at least one requirement")
