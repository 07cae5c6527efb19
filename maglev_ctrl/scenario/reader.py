"""Reading a scenario file, and reading it again with other values: the only way in from TOML."""

from __future__ import annotations

import hashlib
import json
import os
import re
import tomllib
from collections.abc import Iterator, Mapping
from copy import deepcopy
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel, ValidationError

from maglev_ctrl.errors import ModelError, OutOfDomain
from maglev_ctrl.scenario.build import build_option, build_vehicle
from maglev_ctrl.scenario.checks import faults_in, table_faults
from maglev_ctrl.scenario.checks_points import domain_faults
from maglev_ctrl.scenario.control_schema import HookedLaw
from maglev_ctrl.scenario.force_schema import TableForces
from maglev_ctrl.scenario.force_table import SIZE_LIMIT as TABLE_LIMIT
from maglev_ctrl.scenario.force_table import ForceSamples, read_force_table
from maglev_ctrl.scenario.layout import layout
from maglev_ctrl.scenario.limits import (
    DEPTH_LIMIT,
    LINE_LIMIT,
    SIZE_LIMIT,
    VALUE_LIMIT,
    control_signs,
    depth_exceeds,
    huge_numbers,
    values_in,
    very_long_keys,
)
from maglev_ctrl.scenario.messages import faults_of
from maglev_ctrl.scenario.problems import Fault, KeyPath, Problem, ScenarioProblems
from maglev_ctrl.scenario.scenario_schema import Origin, Scenario, with_origin, with_solved_force
from maglev_ctrl.scenario.units import Quantity

_AT = re.compile(r"\s*\(at line (\d+), column (\d+)\)")


def load(path: str | Path) -> Scenario:
    """The scenario in a TOML file, checked as a whole.

    Parameters
    ----------
    path : the file; data files it names are looked for in its folder

    Raises
    ------
    ScenarioProblems : a ScenarioError with every fault found, one line each: file:line:column: key: what was expected
    """
    file, shown = Path(path), str(path)
    text = _text(file, shown=shown)
    return _checked(_parse(text, shown=shown), file, text, shown=shown)


def load_text(text: str, path: str | Path) -> Scenario:
    """The scenario a text would be as the file at a path, checked as `load` does; the file need not exist.

    Parameters
    ----------
    path : names the scenario; data files are looked for in its folder, and told faults show its last part only

    Raises
    ------
    ScenarioProblems : every fault found, one line each

    Examples
    --------
    >>> load_text("format = 1", "nowhere/mine.toml")
    Traceback (most recent call last):
        ...
    maglev_ctrl.scenario.problems.ScenarioProblems: mine.toml:1:1: forces: missing; expected a table
    ...
    """
    file = Path(path)
    content = text.encode(errors="surrogatepass")
    checked = _text_of(content, shown=file.name)
    return _checked(_parse(checked, shown=file.name), file, checked, shown=file.name)


def with_values(scenario: Scenario, values: Mapping[KeyPath, object]) -> Scenario:
    """The scenario with values of its file replaced, as they would be written there, and checked again as a whole.

    Parts that do nothing are allowed. Data files are not read again and solved forces are kept. Its hash is not that of
    a file that says the same.

    Raises
    ------
    ModelError : the scenario would not be valid, in one sentence with the key

    Examples
    --------
    >>> scenario = load("scenarios/periodic/girder_passing.toml")
    >>> with_values(scenario, {("vehicle", "car", "mass"): "20 t"}).vehicle.car.mass
    20000.0
    """
    origin = scenario.origin
    data = deepcopy(_parsed(origin.text))
    for path, value in values.items():
        _put(data, path, value)
    try:
        made = _checked(data, origin.path, origin.text, shown=str(origin.path), read=origin)
    except ScenarioProblems as error:
        first = error.problems[0]
        raise ModelError(f"{first.key}: {first.message}" if first.key else first.message) from None
    return made if scenario.solved_force is None else with_solved_force(made, scenario.solved_force)


def from_text(text: str, like: Scenario) -> Scenario:
    """The scenario a text would give in the place of another one's file; solved forces are kept.

    Raises
    ------
    ModelError : the text is no valid scenario, in one sentence with the key
    """
    origin = like.origin
    try:
        made = _checked(_parse(text, shown=str(origin.path)), origin.path, text, shown=str(origin.path))
    except ScenarioProblems as error:
        first = error.problems[0]
        raise ModelError(f"{first.key}: {first.message}" if first.key else first.message) from None
    return made if like.solved_force is None else with_solved_force(made, like.solved_force)


@lru_cache(maxsize=4)
def _parsed(text: str) -> dict[str, Any]:
    return tomllib.loads(text)


def raw_data(scenario: Scenario) -> dict[str, Any]:
    """What the scenario's file says, as TOML gives it; not to be changed."""
    return _parsed(scenario.text)


def _put(data: Any, path: KeyPath, value: object) -> None:
    *parents, last = path
    for part in parents:
        data = data.setdefault(part, {}) if isinstance(data, dict) else data[part]
    data[last] = value


def _checked(data: dict[str, Any], file: Path, text: str, *, shown: str, read: Origin | None = None) -> Scenario:
    """A scenario from its data, checked as a whole; `read`: where its data file was read before."""
    try:
        scenario = Scenario.model_validate(data)
    except ValidationError as error:
        raise _placed(shown, text, faults_of(error, data)) from None
    faults = [fault for fault in faults_in(scenario) if read is None or not fault.idle]
    content, samples = (b"", None) if read is None else (read.hash.encode(), read.force_samples)
    elsewhere: list[Problem] = []
    if isinstance(scenario.forces, TableForces) and samples is None:
        try:
            content, samples = _force_table(scenario.forces, file)
        except ValueError as error:
            faults.append(Fault(("forces", "file"), str(error)))
        except ScenarioProblems as error:
            elsewhere = [replace(problem, file=error.file) for problem in error.problems]
    if isinstance(scenario.forces, TableForces) and samples is not None:
        faults.extend(table_faults(scenario, layout(scenario.vehicle), has_gap=samples.gap is not None))
    if faults or elsewhere:
        raise _placed(shown, text, faults, elsewhere)
    scenario = with_origin(scenario, Origin(file, text, _fingerprint(scenario, content), samples))
    faults = list(_build_faults(scenario))
    if faults:
        raise _placed(shown, text, faults)
    return scenario


def _build_faults(scenario: Scenario) -> Iterator[Fault]:
    """What only shows when the vehicle is built: a table that cannot be fitted, a design point outside the forces."""
    try:
        with np.errstate(all="ignore"):  # what overflows is found out by its result
            found = list(_faults_of_building(scenario))
        yield from found
    except ArithmeticError:  # sizes that no vehicle has leave the range of numbers somewhere
        yield Fault(
            ("vehicle",), "these values leave the range of numbers when the vehicle is built; check their units"
        )


def _faults_of_building(scenario: Scenario) -> Iterator[Fault]:
    try:
        vehicle = build_vehicle(scenario)
        for element in vehicle.coefficient_elements:
            element.table.at(scenario.operating.speed)
    except OutOfDomain as error:
        quantity = str(error).partition(" ")[0]
        path = ("operating", quantity) if quantity in ("height", "gap", "speed") else ("operating",)
        yield Fault(path, f"the design point has to lie inside the force data: {error}")
        return
    except (ValueError, ModelError) as error:
        key = "file" if isinstance(scenario.forces, TableForces) else "model"
        yield Fault(("forces", key), str(error))
        return
    for index, option in enumerate(scenario.options):
        try:
            built = build_option(scenario, option, vehicle)
        except ValueError as error:
            yield Fault(("option", index), str(error))
            continue
        yield from domain_faults(scenario, option, vehicle, path=("option", index))
        if isinstance(option.control, HookedLaw):
            from maglev_ctrl.scenario.hooks import hooked_dampers

            try:
                hooked_dampers(built, option.control)
            except ModelError as error:
                yield Fault(("option", index, "control"), str(error), at_key=True)


def _placed(shown: str, text: str, faults: list[Fault], elsewhere: list[Problem] | None = None) -> ScenarioProblems:
    from maglev_ctrl.scenario.locate import place_faults

    return ScenarioProblems(shown, [*place_faults(text, faults), *(elsewhere or [])])


def _text(file: Path, *, shown: str) -> str:
    try:
        if file.is_dir():
            raise ScenarioProblems(shown, [Problem(0, 0, "", "expected a scenario file, got a folder")])
        with file.open("rb") as stream:
            content = stream.read(SIZE_LIMIT + 1)
    except FileNotFoundError:
        raise ScenarioProblems(
            shown, [Problem(0, 0, "", f"no such file{_near_file(file, '.toml') or _start()}")]
        ) from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise ScenarioProblems(shown, [Problem(0, 0, "", f"cannot be read: {reason}")]) from None
    return _text_of(content, shown=shown)


def _text_of(content: bytes, *, shown: str) -> str:
    if len(content) > SIZE_LIMIT:
        raise ScenarioProblems(shown, [Problem(0, 0, "", "expected at most 1 MiB of text")])
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        before = content[: error.start]
        line, column = before.count(b"\n") + 1, error.start - before.rfind(b"\n")
        raise ScenarioProblems(shown, [Problem(line, column, "", "expected UTF-8 text")]) from None
    for number, line_text in enumerate(text.splitlines(), start=1):
        if len(line_text) > LINE_LIMIT:
            raise ScenarioProblems(
                shown, [Problem(number, 1, "", f"expected lines of at most {LINE_LIMIT} characters")]
            )
    return text


def _parse(text: str, *, shown: str) -> dict[str, Any]:
    if very_long_keys(text):
        raise ScenarioProblems(shown, [_too_deep()])
    try:
        data = tomllib.loads(text)
    except RecursionError:
        raise ScenarioProblems(shown, [_too_deep()]) from None
    except ValueError as error:
        raise ScenarioProblems(shown, [_syntax_problem(str(error), text)]) from None
    if not data:
        raise ScenarioProblems(shown, [Problem(0, 0, "", f"{_nothing_in(text)}{_start()}")])
    if depth_exceeds(data, DEPTH_LIMIT):
        raise ScenarioProblems(shown, [_too_deep()])
    values = values_in(data)
    if values > VALUE_LIMIT:
        said = f"expected at most {VALUE_LIMIT} keys and entries of lists, got {values}"
        raise ScenarioProblems(shown, [Problem(0, 0, "", said)])
    unseen = [Fault(path, f"expected text without control signs, got {sign}") for path, sign in control_signs(data)]
    unseen += [Fault(path, "expected a whole number of at most 64 bits") for path in huge_numbers(data)]
    if unseen:
        raise _placed(shown, text, unseen)
    return data


def _nothing_in(text: str) -> str:
    return "the file holds nothing but comments" if text.strip() else "the file is empty"


def _too_deep() -> Problem:
    return Problem(0, 0, "", f"expected tables and lists nested at most {DEPTH_LIMIT} deep")


def _syntax_problem(message: str, text: str) -> Problem:
    match = _AT.search(message)
    lines = text.split("\n")
    line, column = (int(match[1]), int(match[2])) if match else (len(lines), len(lines[-1]) + 1)
    reason = _AT.sub("", message).replace(" (at end of document)", "")
    if "Illegal character '\\n'" in message or "Unterminated string" in message:
        return Problem(
            line, column, "", "expected valid TOML: a text is not closed; its last quotation mark is missing"
        )
    hint = "; the file ends too early" if "end of document" in message else ""
    if "Invalid value" in message:
        hint = '; a quantity is a text in quotes, for example "0.2 m"'
    return Problem(line, column, "", f"expected valid TOML: {reason[:1].lower()}{reason[1:]}{hint}")


def _force_table(forces: TableForces, scenario_file: Path) -> tuple[bytes, ForceSamples]:
    """Content and samples of the table; the file has to lie in the scenario's folder or below it.

    Raises
    ------
    ValueError : the file is missing, elsewhere, or too large
    ScenarioProblems : the table itself is wrong
    """
    wanted = Path(forces.file)
    try:
        folder = scenario_file.resolve().parent
        target = (folder / wanted).resolve()
        if wanted.is_absolute() or not target.is_relative_to(folder):
            raise ValueError(f'expected a file in the scenario\'s folder or below it, got "{forces.file}"')
        if not target.is_file():  # folders, devices and pipes, which may have no end, are none
            raise ValueError(f'no file "{forces.file}" beside the scenario{_near_file(target, ".csv")}')
        with target.open("rb") as stream:
            content = stream.read(TABLE_LIMIT + 1)
    except (OSError, RuntimeError) as error:  # links that lead in a circle are a RuntimeError up to Python 3.12
        raise ValueError(f'"{forces.file}" cannot be read: {getattr(error, "strerror", None) or error}') from None
    if len(content) > TABLE_LIMIT:
        raise ValueError(f'"{forces.file}": expected at most 16 MiB')
    return content, read_force_table(content, shown=str(scenario_file.parent / wanted))


def _near_file(target: Path, suffix: str) -> str:
    """`; did you mean "x"?` when a file of a similar name lies in the same folder."""
    from difflib import get_close_matches

    try:
        names = sorted(path.name for path in target.parent.glob(f"*{suffix}"))
    except OSError:
        return ""
    near = get_close_matches(target.name, names, n=1) or [name for name in names if name == target.name + suffix]
    return f'; did you mean "{near[0]}"?' if near else ""


def _start() -> str:
    command = os.environ.get("MAGLEV_CTRL_COMMAND", "maglev-ctrl")  # dev.py says how it was called
    return f"; `{command} new NAME` writes one to start from"


def _fingerprint(scenario: Scenario, content: bytes) -> str:
    """SHA-256 of the values in SI (12 digits: the choice of unit leaves rounding) and of the data file's bytes."""
    canonical = json.dumps(_canonical(scenario), sort_keys=True, ensure_ascii=False, separators=(",", ":"))
    return hashlib.sha256(canonical.encode() + b"\0" + hashlib.sha256(content).digest()).hexdigest()


def _canonical(value: object) -> object:
    match value:
        case BaseModel():
            return dict(_fields(value))
        case Quantity():
            return _canonical(value.value)
        case dict():
            return {str(key): _canonical(inner) for key, inner in value.items()}
        case tuple() | list():
            return [_canonical(inner) for inner in value]
        case float():
            return f"{value:.12g}"
    return value


def _fields(record: BaseModel) -> Iterator[tuple[str, object]]:
    later: frozenset[str] = getattr(record, "later_keys", frozenset())
    for name in type(record).model_fields:
        if name not in later or name in record.model_fields_set:
            yield name, _canonical(getattr(record, name))
