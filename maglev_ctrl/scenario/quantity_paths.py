"""Any quantity of a scenario by name: where it runs ("speed"), or a value of its file ("vehicle.car.mass")."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final, Literal, get_args, get_origin

from maglev_ctrl.scenario.control_schema import Predictive, Scheduled
from maglev_ctrl.scenario.guideway_schema import EddyCurrentForces
from maglev_ctrl.scenario.problems import KeyPath, key_text, near_match
from maglev_ctrl.scenario.reader import raw_data, with_values
from maglev_ctrl.scenario.records import Record
from maglev_ctrl.scenario.scenario_schema import Scenario
from maglev_ctrl.scenario.units import (
    ANY_SPEED,
    KINDS,
    LENGTH,
    PAYLOAD,
    POSITIVE_LENGTH,
    Dimensions,
    Quantity,
    Unit,
    dimensions_of,
)

DEPTH: Final = "depth"
WAVELENGTH: Final = "wavelength"
GAIN: Final = "gain"
SPEED: Final = "speed"
SITUATION: Final = (SPEED, "height", "gap", "lateral_offset", "payload")

_IDLE = (
    ("format",), ("sources",), ("requirement",), ("operating", "sweep"), ("periodic", "map"), ("irregularity",),
    ("ride",), ("uncertainty",), ("tuning",), ("simulation",),
)  # fmt: skip
_IDLE_IN_OPTIONS = ("tune",)
"""Parts of a file that change no motion a map shows."""
_SEARCHES = ("time_limit", "starts", "seed")
_SHOWN = ("sampling_period", "fastest_change")
_OF_MPC = ("horizon", "limit", "start", "load", "duration")
"""Keys of [option.control] that change no loop a map shows."""
_OF_SOURCES = (("periodic", "source_harmonics"), ("periodic", "magnet_length"))
_OF_PATTERN = (("periodic", "wavelength"), ("periodic", "depth"), ("periodic", "harmonics"))
"""Parts of [periodic] that only one of the two ways of writing it has."""
_ALIASES = {"periodic.depth": DEPTH, "periodic.wavelength": WAVELENGTH}
_SAME: Final = {
    SPEED: "operating.speed", "height": "operating.height", "gap": "operating.gap",
    "lateral_offset": "operating.lateral_offset", "payload": "vehicle.car.payload",
}  # fmt: skip
"""Where and how the vehicle runs, and the value of the file that says it: two names of one thing."""
_ABSENT = {
    GAIN: "no option has a control law",
    "gap": "no magnet faces a guidance wall",
    "height": 'with hold = "strength" it follows from the magnets; vary operating.height, at which they are sized',
    DEPTH: "it describes no periodic forces",
    WAVELENGTH: "its periods are those of its sources, such as periodic.source[0].span",
}
"""Why a quantity that other scenarios have may be missing."""
_BASE_UNITS = {"[mass]": "kg", "[length]": "m", "[time]": "s", "[current]": "A"}
_NOT_FINITE = re.compile(r"\s*[+-]?(nan|inf|infinity)\b.*", re.IGNORECASE | re.DOTALL)
_PLAIN = re.compile(r"\s*([+-]?(?:\d[\d_]*\.?\d*|\.\d+)(?:[eE][+-]?\d{1,3})?)\s*(%?)\s*")


@dataclass(frozen=True, slots=True)
class ScenarioQuantity:
    """A quantity that can be varied.

    `name` as people write it, `label` in words, SI `unit` ("" for a ratio), the scenario's own `value` (NaN: not set).
    `path` in the file, () for a quantity of where and how the vehicle runs. `kind` reads its text, None for a plain
    number; `whole` numbers only.
    """

    name: str
    label: str
    unit: str
    value: float
    path: KeyPath = ()
    kind: Unit | None = None
    whole: bool = False
    least: float = -math.inf  # the smallest value of a plain number

    @property
    def option(self) -> int | None:
        """Position of the only option it changes; None where it changes every one."""
        return int(self.path[1]) if self.path[:1] == ("option",) else None

    @property
    def of_law(self) -> bool:
        """Whether it belongs to a control law."""
        return self.option is not None and self.path[2] == "control"

    def read(self, text: str) -> tuple[float, bool]:
        """The SI value of a text, and whether it came without its unit (taken as SI).

        Raises
        ------
        ValueError : not a number, another dimension, or a sign that is not allowed

        Examples
        --------
        >>> ScenarioQuantity("speed", "speed", "m/s", 100.0, kind=ANY_SPEED).read("36 km/h")
        (10.0, False)
        """
        if _NOT_FINITE.fullmatch(text):
            raise ValueError(f'{self.name}: expected a finite number, got "{text.strip()}"')
        number = _PLAIN.fullmatch(text)
        bare = number is not None and not number[2]
        try:
            if self.kind is not None:
                return self.kind.read(f"{text} {self.kind.unit}" if bare else text), bare and self.kind is not None
            return self._ratio(text, number), False
        except ValueError as error:
            raise ValueError(f"{self.name}: {error}") from None

    def _ratio(self, text: str, number: re.Match[str] | None) -> float:
        if number is None:
            raise ValueError(f'expected a plain number, got "{text.strip()}"')
        value = float(number[1]) * (0.01 if number[2] else 1.0)
        if not math.isfinite(value):
            raise ValueError(f'expected a finite number, got "{text.strip()}"')
        if value < self.least:
            raise ValueError(f'expected {self.least:g} or more, got "{text.strip()}"')
        return value

    def written(self, value: float) -> object:
        """A value as it stands in the file."""
        if self.whole:
            return round(value)
        return float(value) if not self.unit else f"{float(value)!r} {self.unit}"


def scenario_quantities(scenario: Scenario) -> tuple[ScenarioQuantity, ...]:
    """Everything of a scenario that can be varied: where and how the vehicle runs first, then the values of the file.

    Examples
    --------
    >>> from maglev_ctrl.scenario import load
    >>> scenario = load("scenarios/periodic/girder_passing.toml")
    >>> found = {q.name: q for q in scenario_quantities(scenario)}
    >>> found["option.windings.spring_damper.winding.damping"].value, found["vehicle.secondary.stiffness"].unit
    (10000.0, 'N/m')
    """
    inside = (q for q in _inside(scenario, scenario) if q.name not in _ALIASES)
    return (*_running(scenario), *(quantity for quantity in inside if not _fixed(scenario, quantity.path)))


def find_quantity(scenario: Scenario, name: str) -> ScenarioQuantity:
    """The quantity of a name.

    Raises
    ------
    ValueError : there is none of this name, it changes no motion, or it would change forces that take long to solve
    """
    known = {quantity.name: quantity for quantity in scenario_quantities(scenario)}
    found = known.get(_ALIASES.get(name, name))
    if found is None:
        if name in _ABSENT:
            raise ValueError(f"{name}: there is none in this scenario: {_ABSENT[name]}")
        reason = next((_fixed(scenario, one.path) for one in _inside(scenario, scenario) if one.name == name), "")
        if reason:
            raise ValueError(f"{name}: {reason}")
        near = _near(name, known)
        near += " " if near.endswith("?") else "; "
        raise ValueError(f'unknown quantity "{name}"{near}--list-quantities shows them all')
    if found.path[:1] == ("forces",) and isinstance(scenario.forces, EddyCurrentForces):
        raise ValueError(
            f"{name}: eddy-current forces would have to be solved anew at every value; vary a quantity outside [forces]"
        )
    return found


def require_different(quantities: Sequence[ScenarioQuantity]) -> None:
    """Refuse quantities of which one would be without effect beside another.

    Raises
    ------
    ValueError : one is given twice, or under both of its names
    """
    names = [one.name for one in quantities]
    for name in names:
        if names.count(name) > 1:
            raise ValueError(f"expected different quantities, got {name} twice")
        if _SAME.get(name) in names:
            raise ValueError(f"expected different quantities; {name} and {_SAME[name]} are one: give one of them")


def _fixed(scenario: Scenario, path: KeyPath) -> str:
    """Why a value of an option cannot be varied along a map; '' where it can."""
    if path[:1] != ("option",) or len(path) < 4:
        return ""
    option, part, key = scenario.options[int(path[1])], path[2], path[3]
    if part == "damping_budget":
        return "a damping budget is not chosen anew along a map; vary the damping of an option without one"
    if part == "spring_damper" and path[-1] in ("damping", "lag") and option.damping_budget is not None:
        return "the option's damping_budget chooses the damping; vary it in an option without one"
    if part != "control" or option.control is None:
        return ""
    if key in _SEARCHES:
        return "it only says how long and from where the law is searched for"
    if key in _SHOWN:
        return "it changes nothing of the continuous law a map shows"
    if option.control.law == "h2" and key == "back_off":
        return "an H2 law has no gamma to back off from"
    if isinstance(option.control, Predictive) and key in _OF_MPC:
        return "a map shows predictive control where no limit is active, and this changes nothing there"
    if isinstance(option.control, Scheduled) and key == "nodes":
        return "the nodes of a schedule have to rise and belong together; vary speed, height, gap or payload instead"
    return ""


def with_quantity(scenario: Scenario, values: tuple[tuple[ScenarioQuantity, float], ...]) -> Scenario:
    """The scenario with values (SI) of its file replaced and everything checked again.

    Raises
    ------
    ModelError : the scenario would not be valid
    """
    return with_values(scenario, {quantity.path: quantity.written(value) for quantity, value in values})


def display_unit(quantity: ScenarioQuantity, largest: float) -> tuple[str, float]:
    """The unit people read a quantity in, for values up to `largest` (SI), and the factor from SI to it.

    Examples
    --------
    >>> display_unit(ScenarioQuantity("speed", "speed", "m/s", 100.0), 150.0)
    ('km/h', 3.6)
    """
    if quantity.name == DEPTH:
        return "%", 100.0
    if quantity.kind is not None and quantity.kind.angular:
        return "Hz", 0.5 / math.pi
    for unit, scale, least, below in _DISPLAY.get(quantity.unit, ()):
        if least <= abs(largest) < below:
            return unit, scale
    return quantity.unit.replace("*", " "), 1.0


_DISPLAY: Final[dict[str, tuple[tuple[str, float, float, float], ...]]] = {
    "m/s": (("km/h", 3.6, 0.0, math.inf),),
    "m": (("mm", 1e3, 0.0, 1.0),),
    "kg": (("t", 1e-3, 1e3, math.inf),),
    "kg*m^2": (("t m^2", 1e-3, 1e3, math.inf),),
    "s": (("ms", 1e3, 0.0, 1.0),),
    "N": (("kN", 1e-3, 1e3, math.inf),),
    "N/m": (("kN/m", 1e-3, 1e3, 1e7), ("MN/m", 1e-6, 1e7, math.inf)),
    "N*s/m": (("kN s/m", 1e-3, 1e3, math.inf),),
    "rad": (("deg", 180.0 / math.pi, 0.0, math.inf),),
    "A": (("kA", 1e-3, 1e3, math.inf),),
    "S/m": (("MS/m", 1e-6, 1e5, math.inf),),
}  # fmt: skip
"""By SI unit: unit to read, factor to it, and the largest values (SI) from and below which it is used."""


def _running(scenario: Scenario) -> Iterator[ScenarioQuantity]:
    operating, periodic = scenario.operating, scenario.periodic
    yield ScenarioQuantity(SPEED, "speed", "m/s", operating.speed, kind=ANY_SPEED)
    if operating.hold == "height":
        yield ScenarioQuantity("height", "levitation height", "m", operating.height, kind=POSITIVE_LENGTH)
    if operating.gap is not None:
        yield ScenarioQuantity("gap", "guidance gap", "m", operating.gap, kind=POSITIVE_LENGTH)
    yield ScenarioQuantity("lateral_offset", "lateral offset", "m", operating.lateral_offset, kind=LENGTH)
    yield ScenarioQuantity("payload", "payload", "kg", scenario.vehicle.car.payload, kind=PAYLOAD)
    if periodic is not None:
        # What sources make of the depth takes the vehicle: the study knows it.
        depth = math.nan if periodic.depth is None else periodic.depth
        yield ScenarioQuantity(DEPTH, "depth of modulation", "", depth, least=0.0)
        if periodic.wavelength is not None:
            yield ScenarioQuantity(WAVELENGTH, "period of the guideway", "m", periodic.wavelength, kind=LENGTH)
    if any(option.control is not None for option in scenario.options):
        yield ScenarioQuantity(GAIN, "factor on the gain of the control law", "", 1.0)


def _inside(scenario: Scenario, record: Record, names: KeyPath = (), path: KeyPath = ()) -> Iterator[ScenarioQuantity]:
    """Every number of a record and of those in it; `names` has items of lists by their name, `path` by position."""
    sources = scenario.periodic is not None and bool(scenario.periodic.sources)
    left_out = (*_IDLE, *(_OF_PATTERN if sources else _OF_SOURCES))
    for field, info in type(record).model_fields.items():
        key = info.alias or field
        here, place = (*names, key), (*path, key)
        idle = any(place[: len(part)] == part for part in left_out) or place[2:] == _IDLE_IN_OPTIONS
        if idle or get_origin(info.annotation) is Literal:
            continue
        value: Any = getattr(record, field)
        if isinstance(value, Record):
            yield from _inside(scenario, value, here, place)
        elif isinstance(value, tuple) and value and isinstance(value[0], Record):
            for index, item in enumerate(value):
                yield from _inside(scenario, item, (*here, getattr(item, "name", None) or index), (*place, index))
        elif isinstance(value, tuple) and value and isinstance(value[0], Quantity):
            for index, item in enumerate(value):
                yield _measured(item, (*here, index), (*place, index))
        elif isinstance(value, tuple):
            yield from _listed(_raw(scenario, place), _unit_in(info), here, place)
        elif isinstance(value, Quantity):
            yield _measured(value, here, place)
        elif not isinstance(value, bool | str):
            reads = _unit_in(info)
            if reads is not None or isinstance(value, int | float):
                number, whole = (
                    float("nan") if value is None else float(value),
                    reads is None and isinstance(value, int),
                )
                unit = "" if reads is None else reads.unit
                yield ScenarioQuantity(_name(here), _words(here), unit, number, place, reads, whole)


def _measured(value: Quantity, names: KeyPath, path: KeyPath) -> ScenarioQuantity:
    """A value whose dimension another field decides."""
    unit = _unit_of(value.dimensions, angle=value.written == "angle")
    kind = Unit("a value", unit, f"{value.value:g} {unit}", "positive")
    return ScenarioQuantity(_name(names), _words(names), unit, value.value, path, kind)


def _listed(raw: object, kind: Unit | None, names: KeyPath, path: KeyPath) -> Iterator[ScenarioQuantity]:
    """Numbers in a list, and in the lists in it, as they stand in the file."""
    if not isinstance(raw, list):
        return
    for index, item in enumerate(raw):
        here, place = (*names, index), (*path, index)
        if isinstance(item, list):
            yield from _listed(item, kind, here, place)
        elif isinstance(item, int | float) and not isinstance(item, bool):
            yield ScenarioQuantity(_name(here), _words(here), "", float(item), place)
        elif isinstance(item, str) and kind is not None:
            yield ScenarioQuantity(_name(here), _words(here), kind.unit, kind.read(item), place, kind)


def _raw(scenario: Scenario, path: KeyPath) -> object:
    data: Any = raw_data(scenario)
    for part in path:
        if isinstance(data, dict) and part not in data:
            return None
        data = data[part]
    return data


def _unit_in(info: Any) -> Unit | None:
    """The unit a field is annotated with, at any depth of the annotation."""
    waiting: list[Any] = [*getattr(info, "metadata", ()), getattr(info, "annotation", None)]
    while waiting:
        part = waiting.pop()
        kind = getattr(part, "reads", part)
        if isinstance(kind, Unit):
            return kind
        waiting += get_args(part)
    return None


def _unit_of(dimensions: Dimensions, *, angle: bool) -> str:
    if angle:
        return "rad"
    known = next((kind.unit for kind in KINDS if dimensions_of(kind.unit) == dimensions), None)
    powers = (f"{_BASE_UNITS[name]}^{power:g}" if power != 1.0 else _BASE_UNITS[name] for name, power in dimensions)
    return known or "*".join(powers)


def _name(names: KeyPath) -> str:
    """The dotted name; a position in a list in brackets, counted from zero as in messages about files."""
    return key_text(names)


def _words(names: KeyPath) -> str:
    """A name in words: what it is, and of what."""
    last = len(names) - 1
    while isinstance(names[last], int) and last:
        last -= 1
    what = key_text(names[last:]).replace("_", " ")
    owner = [str(part).replace("_", " ") for part in names[:last]]
    if owner[:1] == ["option"]:
        inner = " ".join(owner[2:])
        return f"{what} of {inner} in option {owner[1]}" if inner else f"{what} of option {owner[1]}"
    return f"{what} of {' '.join(owner[1:] if len(owner) > 1 else owner)}" if owner else what


def _near(name: str, known: dict[str, ScenarioQuantity]) -> str:
    """The nearest name, also by its last part alone; nothing where none is near (the list would be long)."""
    suggestion = near_match(name, known)
    if "did you mean" in suggestion:
        return suggestion
    ends = [one for one in known if one.rpartition(".")[2] == name.rpartition(".")[2]]
    return f"; did you mean {' or '.join(ends[:3])}?" if ends else ""
