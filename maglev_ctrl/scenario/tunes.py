"""The `[[option.tune]]` parts resolved: which value of the file, in which range, and how a choice is put in."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final

from maglev_ctrl.errors import ModelError
from maglev_ctrl.scenario.control_schema import ControlRecord
from maglev_ctrl.scenario.locate import key_places, place_faults
from maglev_ctrl.scenario.option_schema import OptionRecord
from maglev_ctrl.scenario.problems import Fault, KeyPath, ScenarioProblems, near_match
from maglev_ctrl.scenario.quantity_paths import ScenarioQuantity, display_unit, find_quantity, scenario_quantities
from maglev_ctrl.scenario.reader import raw_data, with_values
from maglev_ctrl.scenario.records import Record
from maglev_ctrl.scenario.scenario_schema import Scenario
from maglev_ctrl.scenario.tuning_schema import TuneRecord
from maglev_ctrl.scenario.units import Quantity

CONTROL: Final = "control"
"""The one value of an option that is chosen among tables."""


@dataclass(frozen=True, eq=False, slots=True)
class TunedQuantity:
    """One design variable of an option.

    `lower` and `upper` (SI) bound it, `start` is the file's own value; `logarithmic`: its logarithm is what is
    spread evenly. Where it is chosen among tables, `choices` holds the control laws they describe, `written` the
    tables, and the value is a position in the list, as a float (`start` -1: the file's own law is none of them).
    """

    name: str
    label: str
    unit: str  # SI; "" for ratios and choices
    lower: float
    upper: float
    start: float
    logarithmic: bool
    path: KeyPath
    quantity: ScenarioQuantity | None
    choices: tuple[ControlRecord, ...] = ()
    written: tuple[dict[str, Any], ...] = ()

    @property
    def display(self) -> tuple[str, float]:
        """Unit people read it in and the factor from SI to it."""
        return ("", 1.0) if self.quantity is None else display_unit(self.quantity, self.upper)

    def text(self, value: float) -> str:
        """A value as people read it, unit included."""
        if self.quantity is None:
            chosen = self.choices[round(value)]
            return f"{chosen.law.replace('_', ' ')} (choice {round(value) + 1})"
        unit, scale = self.display
        return f"{value * scale:.4g} {unit}".rstrip()

    def in_file(self, value: float) -> Any:
        """A value as it stands in the file."""
        return self.written[round(value)] if self.quantity is None else self.quantity.written(value)


def tuned_quantities(scenario: Scenario, option: OptionRecord) -> tuple[TunedQuantity, ...]:
    """Every design variable of an option, in the order of the file but choices first: they are put in first.

    Raises
    ------
    ScenarioProblems : a value that is not in the option, a range that is none, or an end that the format refuses

    Examples
    --------
    >>> from maglev_ctrl.scenario import load
    >>> scenario = load("scenarios/periodic/girder_passing.toml")
    >>> tuned_quantities(scenario, scenario.options[0])
    ()
    """
    found: list[TunedQuantity] = []
    faults: list[Fault] = []
    position = next(i for i, one in enumerate(scenario.options) if one.name == option.name)
    names = [tune.value for tune in option.tunes]
    order = sorted(range(len(names)), key=lambda index: not option.tunes[index].choices)
    for index in order:
        path: KeyPath = ("option", position, "tune", index)
        tune = option.tunes[index]
        if tune.value in names[:index]:
            faults.append(Fault((*path, "value"), f'"{tune.value}" is tuned twice in this option'))
            continue
        try:
            found.append(_chosen(scenario, position, tune, path) if tune.choices or tune.value == CONTROL
                         else _ranged(scenario, option, position, tune, path))  # fmt: skip
        except _Fault as problem:
            faults.extend(problem.faults)
    if not faults:
        faults = [*_clashes(scenario, position, found, option), *_unwritten(scenario, position, found)]
    if faults:
        raise ScenarioProblems(str(scenario.path), place_faults(scenario.text, faults))
    return tuple(found)


def _unwritten(scenario: Scenario, position: int, found: Sequence[TunedQuantity]) -> Iterator[Fault]:
    """Variables whose value does not stand in the file as one: there the chosen one could not be written."""
    places = key_places(scenario.text)
    whole = [one.path for one in found if one.quantity is None]
    for one in found:
        inside = any(one.path != path and one.path[: len(path)] == path for path in whole)
        place = places.get(one.path)
        if inside or (place is not None and place.span != (0, 0)):
            continue
        name = ".".join(str(part) for part in one.path[2:])
        advice = (
            'write it in one line, control = { law = "...", ... }' if one.quantity is None
            else "write it with the value it starts from"
        )  # fmt: skip
        yield Fault(("option", position, *one.path[2:3]), f"{name} is tuned, so it has to stand in the file; {advice}")


def with_tuned(option: OptionRecord, tuned: Sequence[TunedQuantity], values: Sequence[float]) -> OptionRecord:
    """The option with values (SI; a choice by its position) of its design variables put in, not checked again.

    The values must lie in the variables' ranges, whose ends were checked as the file's. The record is the same as
    that of a file with these values, and made a hundred times faster.
    """
    for one, value in zip(tuned, values, strict=True):
        new: object = one.choices[round(value)] if one.quantity is None else float(value)
        if one.quantity is not None and one.quantity.whole:
            new = round(value)
        option = _put(option, one.path[2:], new, one.quantity)
    return option


def file_values(tuned: Sequence[TunedQuantity], values: Sequence[float]) -> dict[KeyPath, Any]:
    """The values as they stand in the file, by key; those inside a chosen table are put into that table."""
    found: dict[KeyPath, Any] = {}
    for one, value in zip(tuned, values, strict=True):
        table = next((path for path in found if one.path[: len(path)] == path), None)
        if table is None:
            found[one.path] = _copied(one.in_file(value))
            continue
        *parents, last = one.path[len(table) :]
        inside: Any = found[table]
        for part in parents:
            inside = inside[part]
        inside[last] = one.in_file(value)
    return found


class _Fault(Exception):
    """Faults of one `[[option.tune]]`."""

    def __init__(self, *faults: Fault) -> None:
        self.faults = faults
        super().__init__()


def _ranged(scenario: Scenario, option: OptionRecord, position: int, tune: TuneRecord, path: KeyPath) -> TunedQuantity:
    """A variable with a range."""
    quantity = _quantity(scenario, option, tune, path)
    missing = [key for key, end in (("from", tune.low), ("to", tune.high)) if end is None]
    if missing:
        raise _Fault(Fault((*path, missing[0]), "missing; expected the end of the range, with its unit"))
    lower, upper = (_end(quantity, end, (*path, key)) for key, end in (("from", tune.low), ("to", tune.high)))
    if not lower < upper:
        raise _Fault(Fault((*path, "to"), f"expected more than the smallest value {_read(quantity, lower)}"))
    if tune.scale == "logarithmic" and lower <= 0.0:
        raise _Fault(
            Fault(
                (*path, "from"), 'expected a value above zero on a logarithmic scale; for zero write scale = "linear"'
            )
        )
    for key, end in (("from", lower), ("to", upper)):
        try:
            with_values(scenario, {quantity.path: quantity.written(end)})
        except ModelError as error:
            raise _Fault(Fault((*path, key), f"the option would not be valid there: {error}")) from None
    inside = ".".join(quantity.name.split(".")[2:])
    return TunedQuantity(
        inside, quantity.label.rpartition(" in option ")[0] or quantity.label.rpartition(" of option ")[0],
        quantity.unit, lower, upper, quantity.value, tune.scale == "logarithmic", quantity.path, quantity,
    )  # fmt: skip


def _quantity(scenario: Scenario, option: OptionRecord, tune: TuneRecord, path: KeyPath) -> ScenarioQuantity:
    """The value of the file that a tune means."""
    prefix = f"option.{option.name}."
    known = [one.name.removeprefix(prefix) for one in scenario_quantities(scenario) if one.name.startswith(prefix)]
    known = [name for name in known if not name.startswith("tune")]
    if tune.value not in known:
        try:
            find_quantity(scenario, prefix + tune.value)
            reason = "it is no value that tuning may choose"
        except ValueError as error:
            reason = str(error)
        if "unknown quantity" in reason:
            ends = [name for name in known if name.rpartition(".")[2] == tune.value.rpartition(".")[2]]
            near = near_match(tune.value, known)
            near = near if "did you mean" in near or not ends else f"; did you mean {' or '.join(ends[:3])}?"
            reason = f'this option has no value "{tune.value}"{near}'
        raise _Fault(Fault((*path, "value"), reason.replace(prefix, "")))
    quantity = find_quantity(scenario, prefix + tune.value)
    if not _stands(scenario, quantity.path):
        raise _Fault(
            Fault((*path, "value"), f'"{tune.value}" is left out in this option; write the value to start from')
        )
    return quantity


def _stands(scenario: Scenario, path: KeyPath) -> bool:
    """Whether the file itself gives a value."""
    data: Any = raw_data(scenario)
    for part in path:
        if part not in (range(len(data)) if isinstance(data, list) else data):
            return False
        data = data[part]
    return True


def _end(quantity: ScenarioQuantity, end: str | float | None, path: KeyPath) -> float:
    """One end of a range in SI."""
    assert end is not None
    if not isinstance(end, str):
        if quantity.unit:
            raise _Fault(Fault(path, f'expected a value with its unit, such as "{end:g} {quantity.unit}"'))
        end = repr(float(end))
    try:
        value, bare = quantity.read(end)
    except ValueError as error:
        raise _Fault(Fault(path, str(error).removeprefix(f"{quantity.name}: "))) from None
    if bare:
        raise _Fault(Fault(path, f'expected a value with its unit, such as "{end} {quantity.unit}"'))
    return value


def _read(quantity: ScenarioQuantity, value: float) -> str:
    unit, scale = display_unit(quantity, value)
    return f"{value * scale:.6g} {unit}".rstrip()


def _chosen(scenario: Scenario, position: int, tune: TuneRecord, path: KeyPath) -> TunedQuantity:
    """A control law chosen among tables."""
    if tune.value != CONTROL:
        raise _Fault(Fault((*path, "choices"), 'choices are tables for "control"; other values have a range'))
    if tune.low is not None or tune.high is not None:
        raise _Fault(Fault((*path, "choices"), "expected choices or a range, not both"))
    if len(tune.choices) < 2:
        raise _Fault(Fault((*path, "choices"), "expected two control laws or more to choose from"))
    place: KeyPath = ("option", position, CONTROL)
    found: list[ControlRecord] = []
    for index, table in enumerate(tune.choices):
        try:
            made = with_values(scenario, {place: table}).options[position].control
        except ModelError as error:
            raise _Fault(Fault((*path, "choices", index), f"not a control law of this option: {error}")) from None
        assert made is not None
        if made in found:
            raise _Fault(Fault((*path, "choices", index), "the same law as an earlier choice"))
        found.append(made)
    own = scenario.options[position].control
    start = float(found.index(own)) if own in found else -1.0
    return TunedQuantity(
        CONTROL, "control law", "", 0.0, len(found) - 1.0, start, False, place, None, tuple(found),
        tuple(dict(table) for table in tune.choices),
    )  # fmt: skip


def _clashes(
    scenario: Scenario, position: int, found: Sequence[TunedQuantity], option: OptionRecord
) -> Iterator[Fault]:
    """Values inside the control law that not every choice of the law has."""
    law = next((one for one in found if one.quantity is None), None)
    if law is None:
        return
    for one in found:
        if one.quantity is None or one.path[2] != CONTROL:
            continue
        for number, table in enumerate(law.written):
            data: Any = table
            try:
                for part in one.path[3:]:
                    data = data[part]
            except (KeyError, IndexError, TypeError):
                index = [tune.value for tune in option.tunes].index(one.name)
                yield Fault(
                    ("option", position, "tune", index, "value"),
                    f'choice {number + 1} of the control law has no "{one.name}"; tune what every choice has',
                )
                break


def _put(record: Any, path: KeyPath, value: object, quantity: ScenarioQuantity | None) -> Any:
    """A record with one value inside replaced; records and tuples on the way are copied."""
    if not path:
        if isinstance(record, Quantity):
            assert quantity is not None and isinstance(value, float)
            return Quantity(value, record.dimensions, str(quantity.written(value)), _hertz_free(record))
        return value
    first, rest = path[0], path[1:]
    if isinstance(record, tuple):
        assert isinstance(first, int)
        return (*record[:first], _put(record[first], rest, value, quantity), *record[first + 1 :])
    assert isinstance(record, Record)
    name = next(field for field, info in type(record).model_fields.items() if (info.alias or field) == first)
    return record.model_copy(update={name: _put(getattr(record, name), rest, value, quantity)})


def _hertz_free(record: Quantity) -> Any:
    """How a value is written in SI: angles stay angles, hertz become 1/s."""
    return "angle" if record.written == "angle" else ""


def _copied(value: Any) -> Any:
    """A table or list that may be changed."""
    if isinstance(value, dict):
        return {key: _copied(inner) for key, inner in value.items()}
    return [_copied(inner) for inner in value] if isinstance(value, list | tuple) else value


def is_integral(tuned: TunedQuantity) -> bool:
    """Whether only whole numbers make sense: choices, and values of the file that are counted."""
    return tuned.quantity is None or tuned.quantity.whole


def encoded(tuned: TunedQuantity, value: float) -> float:
    """A value on the scale it is searched on, 0 at the lower and 1 at the upper end; a choice as it is."""
    if is_integral(tuned):
        return value
    if tuned.logarithmic:
        return math.log(value / tuned.lower) / math.log(tuned.upper / tuned.lower)
    return (value - tuned.lower) / (tuned.upper - tuned.lower)


def decoded(tuned: TunedQuantity, place: float) -> float:
    """The value (SI) of a place on the scale it is searched on.

    Examples
    --------
    >>> drag = TunedQuantity("damping", "damping", "N*s/m", 1e3, 1e5, 1e4, True, (), None)
    >>> round(_spread(drag, 0.5))
    10000
    """
    return float(round(place)) if is_integral(tuned) else _spread(tuned, place)


def _spread(tuned: TunedQuantity, place: float) -> float:
    place = min(max(place, 0.0), 1.0)
    if tuned.logarithmic:
        value = tuned.lower * math.pow(tuned.upper / tuned.lower, place)
    else:
        value = tuned.lower + (tuned.upper - tuned.lower) * place
    return min(max(value, tuned.lower), tuned.upper)
