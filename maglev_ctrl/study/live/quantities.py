"""The sliders of one option: which of a scenario's quantities, in which range, under which name."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

from maglev_ctrl.errors import ModelError
from maglev_ctrl.scenario import OptionRecord, Scenario, build_vehicle
from maglev_ctrl.scenario.control_schema import Allowed
from maglev_ctrl.scenario.problems import KeyPath
from maglev_ctrl.scenario.quantity_paths import (
    DEPTH,
    GAIN,
    SITUATION,
    SPEED,
    ScenarioQuantity,
    display_unit,
    scenario_quantities,
)
from maglev_ctrl.scenario.reader import with_values
from maglev_ctrl.study.live.records import LiveQuantity, SliderGroup

PLACES: dict[str, KeyPath] = {
    SPEED: ("operating", "speed"),
    "height": ("operating", "height"),
    "gap": ("operating", "gap"),
    "payload": ("vehicle", "car", "payload"),
    DEPTH: ("periodic", "depth"),
}
"""Where the file has what says where and how the vehicle runs."""
MOST = 14
"""Sliders at most: more than these nobody finds his way through."""
_FACTOR = 10.0  # a damping or a weight runs from its own value over this to its own value times this
_GRAVITY = 9.81
_SLOWEST = 1.0  # m/s: lowest speed of a slider; a guideway needs to pass for a frequency to exist
_SHARES = (1.0, 0.8, 0.6, 0.4, 0.2)  # of a range that are tried where its end makes no valid file
_SIDEWAYS = ("sway", "roll", "yaw")
_DAMPINGS = ("damping", "lateral_damping")
_HOOKS = {
    "damping": "damping of the law",
    "sky": "sky-hook damping",
    "ground": "ground-hook damping",
    "relative": "damping of the stroke by the law",
    "gap_rate": "damping of the gap by the law",
}


@dataclass(frozen=True, eq=False, slots=True)
class Slider:
    """A slider and the quantity of the scenario it moves."""

    shown: LiveQuantity
    quantity: ScenarioQuantity


def sliders(scenario: Scenario, option: OptionRecord, *, depth: float | None) -> tuple[Slider, ...]:
    """The sliders of an option, the most useful first.

    Parameters
    ----------
    depth : the expected depth of modulation; None without periodic forces

    Examples
    --------
    >>> from maglev_ctrl.scenario import load
    >>> scenario = load("scenarios/periodic/girder_passing.toml")
    >>> [one.shown.name for one in sliders(scenario, scenario.options[1], depth=0.1)][:3]
    ['speed', 'depth', 'height']
    """
    known = {one.name: one for one in scenario_quantities(scenario)}
    position = next(i for i, one in enumerate(scenario.options) if one.name == option.name)
    found = [*_operating(scenario, known, depth), *_of_option(scenario, option, position)]
    found += [_damping(scenario, one, f"{_words(one)} of the {one.path[1]} suspension", "vehicle")
              for one in known.values() if _moves_something(scenario, one)]  # fmt: skip
    return tuple(found[:MOST])


def _operating(
    scenario: Scenario, known: dict[str, ScenarioQuantity], depth: float | None
) -> Iterator[Slider]:  # fmt: skip
    for name in (SPEED, DEPTH, "height", "gap", "payload"):
        quantity = known.get(name)
        if quantity is None or (name == DEPTH and depth is None):
            continue
        if name == DEPTH and depth is not None:
            assert scenario.periodic is not None
            highest = max(scenario.periodic.map.depth.last, depth)
            yield _slider(replace(quantity, value=depth), (0.0, highest), "modulation")
        else:
            low, high = _range(scenario, name, quantity.value)
            ends = _accepted(scenario, name, quantity, low), _accepted(scenario, name, quantity, high)
            yield _slider(quantity, ends, "operating")


def _range(scenario: Scenario, name: str, own: float) -> tuple[float, float]:
    """The scenario's own sweep and map; without them about the design point, as far as the forces are known."""
    spans = []
    sweep = getattr(scenario.operating.sweep, name)
    if sweep is not None:
        spans.append((sweep.first, sweep.last))
    if name == SPEED and scenario.periodic is not None:
        spans.append((scenario.periodic.map.speed.first, scenario.periodic.map.speed.last))
    if name == "payload":
        most = max(2.0 * own, 0.5 * scenario.vehicle.car.mass)
        low, high = _hull(spans, own) if spans else (0.0, most)
        return max(low, 0.0), high
    if spans:
        low, high = _hull(spans, own)
    else:
        low, high = (0.2 * own, 1.5 * own) if name == SPEED and own > 0.0 else (0.5 * own, 1.5 * own)
        high = max(high, 10.0 * _SLOWEST) if name == SPEED else high
    least, most = _domain(scenario, name)
    low, high = max(low, least), min(high, most)
    if name == SPEED:
        low = min(max(low, _SLOWEST), own) if own > 0.0 else 0.0
    return min(low, own), max(high, own)


def _accepted(scenario: Scenario, name: str, quantity: ScenarioQuantity, end: float) -> float:
    """The end of a range, or the nearest one towards the own value that makes a valid file."""
    own = quantity.value
    for share in _SHARES:
        value = own + share * (end - own)
        try:
            with_values(scenario, {PLACES[name]: quantity.written(value)})
        except ModelError:
            continue
        return value
    return own


def _hull(spans: list[tuple[float, float]], own: float) -> tuple[float, float]:
    return min(own, *(min(span) for span in spans)), max(own, *(max(span) for span in spans))


def _domain(scenario: Scenario, name: str) -> tuple[float, float]:
    """Where every magnet's forces are known."""
    low, high = 0.0, math.inf
    for magnet in build_vehicle(scenario).magnets:
        span = getattr(magnet.force.domain, name)
        if span is not None:
            low, high = max(low, span[0]), min(high, span[1])
    return low, high


def _of_option(
    scenario: Scenario, option: OptionRecord, position: int
) -> Iterator[Slider]:  # fmt: skip
    own = [one for one in scenario_quantities(scenario) if one.option == position]
    for one in own:
        if not one.of_law and _is_damping(one):
            yield _damping(scenario, one, f"damping of {_owner(one)}", "option")
    for one in own:
        if one.of_law and one.name != GAIN and len(one.path) == 4 and one.path[3] in _HOOKS and one.value > 0.0:
            yield _damping(scenario, one, _HOOKS[str(one.path[3])], "law")
    for one in own:
        if one.of_law and one.path[3:4] == ("allowed",) and one.path[-1] == "value" and one.value > 0.0:
            record = getattr(option.control, "allowed")[one.path[4]]  # noqa: B009
            yield _slider(one, (one.value / _FACTOR, one.value * _FACTOR), "law",
                          label=f"allowed {_weighed(record)}", logarithmic=True)  # fmt: skip


def _is_damping(one: ScenarioQuantity) -> bool:
    return bool(one.path) and one.path[-1] in _DAMPINGS and not one.of_law and not math.isnan(one.value)


def _moves_something(scenario: Scenario, one: ScenarioQuantity) -> bool:
    """Whether it is a damping of the vehicle that acts on one of its freedoms."""
    if not _is_damping(one) or one.path[0] != "vehicle":
        return False
    sideways = any(dof.rpartition(".")[2] in _SIDEWAYS for dof in build_vehicle(scenario).dofs)
    return sideways or one.path[-1] != "lateral_damping"


def _damping(scenario: Scenario, one: ScenarioQuantity, label: str, group: SliderGroup) -> Slider:
    if one.value > 0.0:
        ends = one.value / _FACTOR, one.value * _FACTOR
        return _slider(one, ends, group, label=label, logarithmic=True)
    # Nothing is there: up to what damps the heave of the whole train on its magnets (m g / height) by about a half.
    car = scenario.vehicle.car
    mass = car.mass + car.payload + sum(bogie.mass for bogie in getattr(scenario.vehicle, "bogies", ()))
    return _slider(one, (0.0, mass * math.sqrt(_GRAVITY / scenario.operating.height)), group, label=label)


def _slider(
    quantity: ScenarioQuantity, ends: tuple[float, float], group: SliderGroup, *, label: str = "",
    logarithmic: bool = False,
) -> Slider:  # fmt: skip
    unit, scale = display_unit(quantity, max(abs(ends[0]), abs(ends[1])))
    shown = LiveQuantity(
        quantity.name, label or quantity.label, unit, scale, quantity.value, *ends, group, logarithmic
    )  # fmt: skip
    return Slider(shown, quantity)


def _words(one: ScenarioQuantity) -> str:
    return str(one.path[-1]).replace("_", " ")


def _owner(one: ScenarioQuantity) -> str:
    """The element a damping belongs to."""
    return one.name.split(".")[3].replace("_", " ")


def _weighed(record: Allowed) -> str:
    name = record.output or (f"force of {record.actuator}" if record.actuator else "value")
    return name.replace(".", " ").replace("_", " ")


def is_situation(name: str) -> bool:
    """Whether a quantity moves the operating point alone."""
    return name in SITUATION or name == DEPTH
