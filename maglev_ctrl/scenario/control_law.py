"""An option's control law with "bogies" and "magnet_gap" spelled out: names as the linear model has them, in SI."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from maglev_ctrl.scenario.control_schema import WEIGHTED, ControlRecord, HookedLaw, OutputFeedback, SkyHook
from maglev_ctrl.scenario.layout import command_dimensions, layout, outputs_of, place_element, place_sensor
from maglev_ctrl.scenario.option_schema import OptionRecord
from maglev_ctrl.scenario.scenario_schema import Scenario

Named = tuple[tuple[str, float], ...]


@dataclass(frozen=True, eq=False, slots=True)
class ControlLaw:
    """A law's record and the names it means.

    Parameters
    ----------
    record : the law as the file gives it
    actuators, sensors : the option's actuators and sensors, in the order of the file, bogies front to rear
    output_weights : outputs with the largest acceptable value
    input_weights : actuators with the largest acceptable command, N (V or A for electromagnets)
    noise : sensors with their noise density; 0 where the file gives none
    links : pairs (sensor, actuator) that a structured law may use; empty = all
    """

    record: ControlRecord
    actuators: tuple[str, ...]
    sensors: tuple[str, ...]
    output_weights: Named
    input_weights: Named
    noise: Named
    links: tuple[tuple[str, str], ...]
    groups: Mapping[str, tuple[str, ...]]

    def placed(self, name: str | None) -> tuple[str, ...]:
        """What a sensor, actuator or output of the file stands for; empty for None.

        Raises
        ------
        KeyError : nothing is called so
        """
        return () if name is None else self.groups[name]


def control_law(scenario: Scenario, option: OptionRecord) -> ControlLaw | None:
    """The option's control law; None for a passive option."""
    if option.control is None:
        return None
    here = layout(scenario.vehicle)
    record = option.control
    driven = {a.name: tuple(place.name for place in place_element(a, here)) for a in option.actuators}
    driven |= {name: members for name, (_, members) in command_dimensions(scenario).items()}
    placed = {sensor.name: tuple(place.name for place in place_sensor(sensor, here)) for sensor in option.sensors}
    density = {sensor.name: sensor.noise or 0.0 for sensor in option.sensors}
    outputs = {name: members for name, (_, members) in outputs_of(option, here).items()}
    used = _used(record, option, driven)
    weights = record.allowed if isinstance(record, WEIGHTED) else ()
    return ControlLaw(
        record=record,
        actuators=tuple(name for given in used for name in driven[given]),
        sensors=tuple(name for names in placed.values() for name in names),
        output_weights=tuple(
            (name, item.value.value) for item in weights if item.output is not None for name in outputs[item.output]
        ),
        input_weights=tuple(
            (name, item.value.value) for item in weights if item.actuator is not None for name in driven[item.actuator]
        ),
        noise=tuple((name, density[given]) for given, names in placed.items() for name in names),
        links=_links(record, placed, driven),
        groups=outputs | placed | driven,
    )


def _used(record: ControlRecord, option: OptionRecord, driven: Mapping[str, tuple[str, ...]]) -> Iterable[str]:
    """Actuators of the option; electromagnets only where a weight names them."""
    if isinstance(record, SkyHook | HookedLaw):
        return tuple(actuator.name for actuator in option.actuators)
    named = [item.actuator for item in record.allowed if item.actuator is not None]
    return [name for name in driven if name in named]


def _links(
    record: ControlRecord, placed: Mapping[str, tuple[str, ...]], driven: Mapping[str, tuple[str, ...]]
) -> tuple[tuple[str, str], ...]:
    """Pairs; two groups of equal size (one per bogie each) are joined member by member: each place its own sensor."""
    if not isinstance(record, OutputFeedback):
        return ()
    pairs: list[tuple[str, str]] = []
    for sensor, actuator in record.links:
        seen, moved = placed[sensor], driven[actuator]
        if len(seen) == len(moved):
            pairs += list(zip(seen, moved, strict=True))
        else:
            pairs += [(one, other) for one in seen for other in moved]
    return tuple(pairs)
