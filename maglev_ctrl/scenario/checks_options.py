"""Faults inside one suspension option: what its elements join, and what its control law may name."""

from __future__ import annotations

from collections.abc import Iterator

from maglev_ctrl.scenario.checks_control import Commands, budget_faults, control_faults
from maglev_ctrl.scenario.electromagnet import current_sensor_faults
from maglev_ctrl.scenario.layout import (
    BOGIES,
    GUIDEWAY,
    Layout,
    place_element,
    place_sensor,
)
from maglev_ctrl.scenario.option_schema import ActuatorRecord, OptionRecord, SpringDamperRecord
from maglev_ctrl.scenario.problems import Fault, KeyPath, near_match

# kind: (may have passive elements, may have actuators, every element's attachment)
NEGATIVE_DAMPING = "expected a damping that is not negative; an actuator can add energy, a damper cannot"
_KINDS: dict[str, tuple[bool, bool, str]] = {
    "baseline": (False, False, "any"),
    "passive_primary": (True, False, "primary"),
    "active_primary": (False, True, "primary"),
    "passive_secondary": (True, False, "secondary"),
    "active_secondary": (False, True, "secondary"),
    "combined": (True, True, "any"),
}


def option_faults(option: OptionRecord, here: Layout, *, commands: Commands, path: KeyPath) -> Iterator[Fault]:
    """Every fault of one option; names are checked before what builds on them.

    Parameters
    ----------
    commands : what a law may drive besides the option's actuators: the electromagnets of the vehicle
    """
    ends = list(_end_faults(option, here, path=path))
    yield from ends
    yield from _kind_faults(option, commands, path=path)
    if ends:
        return
    yield from _name_faults(option, here, commands, path=path)
    yield from current_sensor_faults(option, commands, path=path)
    yield from _effect_faults(option, path=path)
    yield from budget_faults(option, path=path)
    if option.control is None:
        if option.actuators:
            yield Fault(
                (*path, "control"), "missing; expected a control law ([option.control]) that drives the actuators"
            )
        return
    if not option.actuators and not commands:
        yield Fault((*path, "control"), "expected at least one [[option.actuator]] for the law to drive", at_key=True)
        return
    yield from control_faults(option, here, commands, path=path)


def _elements(option: OptionRecord) -> Iterator[tuple[str, int, SpringDamperRecord | ActuatorRecord]]:
    for index, spring in enumerate(option.spring_dampers):
        yield "spring_damper", index, spring
    for index, actuator in enumerate(option.actuators):
        yield "actuator", index, actuator


def _end_faults(option: OptionRecord, here: Layout, *, path: KeyPath) -> Iterator[Fault]:
    for key, index, element in _elements(option):
        place: KeyPath = (*path, key, index, "between")
        for position, end in enumerate(element.between):
            if end not in here.ends():
                yield Fault((*place, position), f'no body is called "{end}"{near_match(end, here.ends())}')
        if element.between[0] == element.between[1]:
            yield Fault(place, "expected two different ends")
        elif BOGIES in element.between and set(element.between) & set(dict(here.bogies)):
            yield Fault(place, 'expected "bogies" together with "car" or "guideway", not with one bogie')
    carriers = tuple(end for end in here.ends() if end != GUIDEWAY)
    for index, sensor in enumerate(option.sensors):
        spot: KeyPath = (*path, "sensor", index)
        if sensor.on not in carriers:
            yield Fault((*spot, "on"), f'no body is called "{sensor.on}"{near_match(sensor.on, carriers)}')
        if sensor.at == BOGIES and not here.bogies:
            yield Fault((*spot, "at"), "this vehicle has no bogies; expected a length")
        if sensor.kind == "stroke" and sensor.to not in carriers:
            yield Fault((*spot, "to"), f'no body is called "{sensor.to}"{near_match(sensor.to, carriers)}')
        elif sensor.kind == "stroke" and sensor.to == sensor.on:
            yield Fault((*spot, "to"), "expected another body than the one it is on")


def _kind_faults(option: OptionRecord, commands: Commands, *, path: KeyPath) -> Iterator[Fault]:
    passive, active, attachment = _KINDS[option.kind]
    if option.spring_dampers and not passive:
        yield Fault(
            (*path, "spring_damper"), f'a "{option.kind}" option has no spring_damper; did you mean "combined"?'
        )
    if option.actuators and not active:
        yield Fault((*path, "actuator"), f'a "{option.kind}" option has no actuator; did you mean "combined"?')
    driven = bool(commands) and option.control is not None
    if driven and not option.actuators and (not active or attachment == "secondary"):
        yield Fault((*path, "kind"), f'a "{option.kind}" option drives no magnet; did you mean "active_primary"?')
    elif (passive or active) and not (option.spring_dampers or option.actuators or driven):
        wanted = "spring_damper" if passive else "actuator"
        yield Fault((*path, wanted), f'missing; a "{option.kind}" option expects at least one')
    for key, index, element in _elements(option):
        primary = GUIDEWAY in element.between
        if attachment != "any" and primary != (attachment == "primary"):
            expected = 'one end "guideway"' if attachment == "primary" else "two bodies"
            yield Fault((*path, key, index, "between"), f'expected {expected} in a "{option.kind}" option')


def _name_faults(option: OptionRecord, here: Layout, commands: Commands, *, path: KeyPath) -> Iterator[Fault]:
    used: dict[str, str] = dict.fromkeys(here.body_names, "a body")
    used |= dict.fromkeys((*(magnet.name for magnet in here.magnets), *commands), "a magnet")
    used |= dict.fromkeys((*here.springs, "secondary"), "the secondary suspension")
    used |= dict.fromkeys(("aerodynamics", "magnet_gap", "geometry", GUIDEWAY, BOGIES), "a built-in part")
    placed = [
        *(((key, index), e.name, place_element(e, here)) for key, index, e in _elements(option)),
        *((("sensor", index), s.name, place_sensor(s, here)) for index, s in enumerate(option.sensors)),
    ]
    for (key, index), name, places in placed:
        names = {name, *(place.name for place in places)}
        taken = sorted(names & set(used))
        if taken:
            yield Fault(
                (*path, key, index, "name"),
                f'expected a unique name; {used[taken[0]]} of this option is called "{taken[0]}" too',
            )
        used |= dict.fromkeys(names, "another element")


def _effect_faults(option: OptionRecord, *, path: KeyPath) -> Iterator[Fault]:
    for index, spring in enumerate(option.spring_dampers):
        if spring.stiffness == 0.0 and spring.damping == 0.0 and option.damping_budget is None:
            here = (*path, "spring_damper", index)
            yield Fault(here, "expected a stiffness or a damping other than zero", idle=True)
        if spring.damping < 0.0:
            yield Fault((*path, "spring_damper", index, "damping"), NEGATIVE_DAMPING)
