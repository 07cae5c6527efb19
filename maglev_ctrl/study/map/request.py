"""What is asked of a map: two quantities of the scenario with their ranges, the options, and how it is computed."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np

from maglev_ctrl.analysis.plane_records import Coverage, MapAxis
from maglev_ctrl.arrays import FloatArray, read_only_any
from maglev_ctrl.errors import ModelError
from maglev_ctrl.scenario import OptionRecord, Scenario
from maglev_ctrl.scenario.problems import near_match
from maglev_ctrl.scenario.quantity_paths import (
    DEPTH,
    GAIN,
    SPEED,
    WAVELENGTH,
    ScenarioQuantity,
    display_unit,
    find_quantity,
    require_different,
    with_quantity,
)
from maglev_ctrl.scenario.scenario_schema import Periodic
from maglev_ctrl.study.map.records import MapQuantity

Backend = Literal["numpy", "fast", "gpu"]

FINE_SPEEDS, FINE_DEPTHS = 361, 201
"""Least points of a map whose axes were not asked for: its points cost little, its tongues are narrow."""
DEEPEST_BARE: Final = 3.0
"""A depth beyond this, written without a unit, is taken for a slip: per cent were meant."""
LARGEST_COUNT: Final = 100_000
"""Points along one axis; no screen and no printer shows more."""
SHAPE = "QUANTITY=FROM:TO:COUNT, for example speed=100km/h:600km/h:200"
_COUNT = re.compile(r"\s*[+]?\d{1,18}\s*")
_NO_PERIOD = {
    SPEED: "at rest nothing passes, and there is no passing frequency",
    WAVELENGTH: "a guideway without a period has no passing frequency",
}


@dataclass(frozen=True, slots=True)
class AxisRange:
    """`count` evenly spaced values (SI) of a quantity; `bare`: given without a unit and read as SI."""

    quantity: ScenarioQuantity
    first: float
    last: float
    count: int
    bare: bool = False

    def axis(self) -> MapAxis:
        """The axis as the numerics know it."""
        name = self.quantity.name
        return MapAxis(name, self.values(), reciprocal=name == SPEED, linear=name == DEPTH)

    def values(self) -> FloatArray:
        """All values, ascending."""
        return read_only_any(np.linspace(self.first, self.last, self.count))

    def shown(self) -> MapQuantity:
        """The axis as people read it."""
        quantity = self.quantity
        unit, scale = display_unit(quantity, max(abs(self.first), abs(self.last)))
        return MapQuantity(quantity.name, quantity.label, unit, scale, self.values(), quantity.value)


@dataclass(frozen=True, slots=True)
class MapRequest:
    """Two axes, the names of the options, and how the map is computed."""

    x: AxisRange
    y: AxisRange
    options: tuple[str, ...]
    coverage: Coverage = "auto"
    backend: Backend = "numpy"
    periodic_law: bool = False
    tables: bool = True  # tongues, speed ranges and margins beside the map
    merge_delays: bool = False  # delay and bandwidth of an actuator as one lag, where they are short against every mode

    @property
    def points(self) -> int:
        """Points of all maps together."""
        return self.x.count * self.y.count * len(self.options)

    @property
    def axes(self) -> tuple[AxisRange, AxisRange]:
        """Both axes."""
        return self.x, self.y

    def axis_of(self, name: str) -> AxisRange | None:
        """The axis of a quantity; None where neither is."""
        return next((one for one in self.axes if one.quantity.name == name), None)


def map_request(
    scenario: Scenario, *, x: str | None = None, y: str | None = None, options: Sequence[str] = (),
    coverage: Coverage = "auto", backend: Backend = "numpy", periodic_law: bool = False,
    tables: bool = True, merge_delays: bool = False,
) -> MapRequest:  # fmt: skip
    """A request from what people write, checked as far as it can be without computing.

    Parameters
    ----------
    x, y : "QUANTITY=FROM:TO:COUNT"; left out: speed and depth over the scenario's own grid
    options : names; none: all that the quantities change
    tables : whether tongues, speed ranges and margins are computed, which takes longer than the map
    merge_delays : one lag for delay and bandwidth of an actuator where they are short; faster, and no longer exact

    Raises
    ------
    ValueError : what is wrong, in one sentence

    Examples
    --------
    >>> from maglev_ctrl.scenario import load
    >>> scenario = load("scenarios/periodic/girder_passing.toml")
    >>> request = map_request(scenario, y="vehicle.secondary.damping=0:20kN*s/m:60")
    >>> request.x.quantity.name, request.y.last, request.options[:2]
    ('speed', 20000.0, ('bare', 'weak_windings'))
    """
    periodic = scenario.periodic
    if periodic is None:
        raise ValueError(
            "the scenario describes no periodic forces; add a [periodic] table with its wavelength, depth and map"
        )
    first = None if x is None else _told("--x", scenario, x)
    second = None if y is None else _told("--y", scenario, y)
    across, along = _defaults(scenario, periodic)
    if first is None and second is not None and second.quantity.name == SPEED:
        across, along = along, across
    if second is None and first is not None and first.quantity.name == DEPTH:
        across, along = along, across
    request = MapRequest(
        first or across, second or along, chosen_options(scenario, options),
        coverage=coverage, backend=backend, periodic_law=periodic_law, tables=tables, merge_delays=merge_delays,
    )  # fmt: skip
    try:
        require_different([one.quantity for one in request.axes])
    except ValueError as error:
        raise ValueError(f"--x and --y: {error}") from None
    for one in request.axes:
        request = _fitting(scenario, request, one.quantity, asked=bool(options))
    for one in request.axes:
        _check_ends(scenario, one)
    return request


def read_range(scenario: Scenario, text: str) -> AxisRange:
    """A range from "QUANTITY=FROM:TO:COUNT".

    Raises
    ------
    ValueError : what is wrong, in one sentence
    """
    name, separator, rest = text.partition("=")
    parts = rest.split(":")
    if not separator or len(parts) != 3 or not all(part.strip() for part in (name, *parts)):
        raise ValueError(f'expected {SHAPE}, got "{text}"')
    quantity = find_quantity(scenario, name.strip())
    low, high, amount = (part.strip() for part in parts)
    if not _COUNT.fullmatch(amount):
        raise ValueError(f'{quantity.name}: expected a whole number of points, 2 or more, got "{amount}"')
    count = int(amount)
    if not 2 <= count <= LARGEST_COUNT:
        raise ValueError(f"{quantity.name}: expected 2 to {LARGEST_COUNT} points, got {count}")
    (first, first_bare), (last, last_bare) = quantity.read(low), quantity.read(high)
    if first_bare != last_bare and (first if first_bare else last) != 0.0:
        united, bare = (high, low) if first_bare else (low, high)
        raise ValueError(f'{quantity.name}: "{united}" has a unit and "{bare}" has none; write both with their units')
    if quantity.name == DEPTH and last > DEEPEST_BARE and "%" not in high:
        raise ValueError(
            f"depth: a bare number is a fraction, and {last:g} is {100.0 * last:g} %; for per cent write {last:g}%"
        )
    if not first < last:
        raise ValueError(f"{quantity.name}: expected the smaller end first and two different ends, got {low} to {high}")
    if quantity.name in _NO_PERIOD and first <= 0.0:
        raise ValueError(f"{quantity.name}: expected values above zero, got {low}: {_NO_PERIOD[quantity.name]}")
    return AxisRange(quantity, first, last, count, bare=first_bare and last_bare)


def _told(flag: str, scenario: Scenario, text: str) -> AxisRange:
    try:
        return read_range(scenario, text)
    except ValueError as error:
        raise ValueError(f"{flag}: {error}") from None


def _defaults(scenario: Scenario, periodic: Periodic) -> tuple[AxisRange, AxisRange]:
    """Speed and depth over the ranges of the scenario, no coarser than a picture shows."""
    speed, depth = periodic.map.speed, periodic.map.depth
    return (
        AxisRange(find_quantity(scenario, SPEED), speed.first, speed.last, max(speed.count, FINE_SPEEDS)),
        AxisRange(find_quantity(scenario, DEPTH), depth.first, depth.last, max(depth.count, FINE_DEPTHS)),
    )


def chosen_options(scenario: Scenario, names: Sequence[str]) -> tuple[str, ...]:
    """Names of the options asked for, in the file's order; none: all.

    Raises
    ------
    ValueError : there is no option of a name
    """
    known = [option.name for option in scenario.options]
    for name in names:
        if name not in known:
            raise ValueError(f'unknown option "{name}"{near_match(name, known)}')
    return tuple(name for name in known if not names or name in names)


def _fitting(scenario: Scenario, request: MapRequest, quantity: ScenarioQuantity, *, asked: bool) -> MapRequest:
    """The request with the options that a quantity changes; those asked for by name have to be among them."""
    changed = [
        record.name for index, record in enumerate(scenario.options)
        if (quantity.option is None or quantity.option == index) and (quantity.name != GAIN or _has_law(record))
    ]  # fmt: skip
    kept = tuple(name for name in request.options if name in changed)
    if kept == request.options or (kept and not asked):
        return replace(request, options=kept)
    idle = next(name for name in request.options if name not in changed)
    why = "it has no control law" if quantity.name == GAIN else f"it belongs to {_names(changed)}"
    raise ValueError(f"{quantity.name}: it changes nothing in option {idle}, because {why}")


def _has_law(record: OptionRecord) -> bool:
    return record.control is not None


def _names(names: Sequence[str]) -> str:
    return ", ".join(f"option {name}" for name in names)


def _check_ends(scenario: Scenario, one: AxisRange) -> None:
    """Both ends of an axis have to give a valid scenario."""
    quantity = one.quantity
    if quantity.whole and not np.array_equal(one.values(), np.round(one.values())):
        raise ValueError(f"{quantity.name}: expected whole numbers; choose COUNT so that every step is a whole number")
    if quantity.path:
        require_valid(scenario, quantity, (one.first, one.last))


def require_valid(scenario: Scenario, quantity: ScenarioQuantity, values: Sequence[float]) -> None:
    """Refuse values (SI) of the file that make no valid scenario.

    Raises
    ------
    ValueError : one does not, in one sentence with the value
    """
    for value in values:
        try:
            with_quantity(scenario, ((quantity, value),))
        except ModelError as error:
            shown = f"{value:g} {quantity.unit}".rstrip()
            told = str(error) if quantity.name in str(error) else f"{quantity.name}: {error}"
            raise ValueError(f"{told} (at {shown})") from None
