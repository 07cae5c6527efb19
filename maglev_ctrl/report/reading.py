"""A written report.json read back: what a comparison of two reports needs, checked, with NaN and infinities as numbers.

Everything of an option that has no record here is kept as it stands in `OptionRead.sections`.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal, cast

from maglev_ctrl.errors import ScenarioError, Verdict
from maglev_ctrl.report.serialise import FORMAT
from maglev_ctrl.scenario.json_text import SIZE_LIMIT, parse_json
from maglev_ctrl.scenario.problems import legible

FILE: Final = "report.json"
KIND: Final = "maglev-ctrl comparison"
MAKE_ONE: Final = "`maglev-ctrl report SCENARIO` writes report.json"

Bound = Literal["exact", "lower", "upper"]

_OTHERS: Final = {
    "design.json": "designs", "map.json": "stability maps", "identify.json": "an identification",
    "reproduction.json": "a reproduction of the paper", "forces.nc": "forces",
}  # fmt: skip
_WORDS: Final = {"NaN": math.nan, "Infinity": math.inf, "-Infinity": -math.inf}
_READ: Final = frozenset({
    "format", "kind", "verdict", "title", "description", "scenario_path", "scenario_text", "scenario_hash", "sources",
    "assumptions", "forces", "design_speed", "design_height", "options", "versions", "created", "seconds",
})  # fmt: skip
_READ_OF_OPTION: Final = frozenset({
    "name", "label", "kind", "summary", "failure", "verdict", "requirements", "modes", "margins", "seconds",
})  # fmt: skip


@dataclass(frozen=True, eq=False, slots=True)
class RequirementRead:
    """A judged requirement of a written report; numbers in the unit told."""

    name: str
    quantity: str
    description: str
    sense: Literal["at_least", "at_most"]
    limit: float
    value: float  # NaN when not evaluated
    unit: str
    verdict: Verdict
    worst_at: str
    reason: str
    bound: Bound
    hard: bool = True  # False: a wish, whose missing fails nothing


@dataclass(frozen=True, eq=False, slots=True)
class NumberRead:
    """A number of an option at the design point, with the error it may have."""

    name: str
    value: float
    unit: str
    error: float = 0.0


@dataclass(frozen=True, eq=False, slots=True)
class OptionRead:
    """An option of a written report.

    Parameters
    ----------
    numbers : growth rate and damping ratio of the modes, and the margins, all at the design point
    eigenvalue_error : 1/s, the largest error bound of its modes; 0 where it has none
    damping_error : the same of a damping ratio
    sections : every other field, as JSON has it
    """

    name: str
    label: str
    kind: str
    summary: tuple[str, ...]
    failure: str
    verdict: Verdict
    requirements: tuple[RequirementRead, ...]
    numbers: tuple[NumberRead, ...]
    eigenvalue_error: float
    damping_error: float
    sections: Mapping[str, Any]


@dataclass(frozen=True, eq=False, slots=True)
class ReportRead:
    """A written report."""

    title: str
    verdict: Verdict
    scenario_text: str
    scenario_hash: str
    versions: tuple[tuple[str, str], ...]
    design_point: tuple[NumberRead, ...]
    options: tuple[OptionRead, ...]
    sections: Mapping[str, Any]  # every field that has no record here, as JSON has it


def read_report(place: Path) -> ReportRead:
    """The report in a folder, or in a file of any name.

    Raises
    ------
    ScenarioError : nothing there, no report, broken JSON, a format of another version; one sentence with the file
    OSError : the file cannot be read

    Examples
    --------
    >>> read_report(Path("nowhere"))
    Traceback (most recent call last):
    maglev_ctrl.errors.ScenarioError: nowhere: expected a folder with report.json, or that file; there is nothing here
    """
    file = _file(place)
    with file.open("rb") as stream:
        content = stream.read(SIZE_LIMIT + 1)
    try:
        data = parse_json(content)
    except json.JSONDecodeError as error:
        raise ScenarioError(f"{file}:{error.lineno}:{error.colno}: expected JSON: {error.msg}") from None
    except RecursionError:
        raise ScenarioError(f"{file}: expected a report, got JSON nested too deeply") from None
    except ValueError as error:
        raise ScenarioError(f"{file}: {error}") from None
    try:
        return report_of(data)
    except ValueError as error:
        raise ScenarioError(f"{file}: {error}") from None


def report_of(data: Any) -> ReportRead:
    """Parsed JSON as a report.

    Raises
    ------
    ValueError : it is not one; names the place in the file, what was expected and what was got

    Examples
    --------
    >>> report_of({"kind": "maglev-ctrl stability maps", "format": 1})
    Traceback (most recent call last):
    ValueError: not a report but maglev-ctrl stability maps; `maglev-ctrl report SCENARIO` writes report.json
    """
    if not isinstance(data, Mapping) or data.get("kind") != KIND:
        said = data.get("kind", data.get("format")) if isinstance(data, Mapping) else None
        what = f"not a report but {legible(said, most=80)}" if isinstance(said, str) and said else "not a report"
        raise ValueError(f"{what}; {MAKE_ONE}")
    if data.get("format") != FORMAT:
        raise ValueError(f"format: this version reads reports of format {FORMAT}, got {_shown(data.get('format'))}")
    options = tuple(_option(one, f"options[{k}]") for k, one in enumerate(_list(data, "options", "")))
    _require_different([option.name for option in options], "options")
    pairs = [_strings(pair, f"versions[{k}]") for k, pair in enumerate(_list(data, "versions", ""))]
    for k, pair in enumerate(pairs):
        if len(pair) != 2:
            raise ValueError(f"versions[{k}]: expected a name and a version, got {len(pair)} entries")
    return ReportRead(
        _text(data, "title", ""), _verdict(data, ""), _text(data, "scenario_text", "", default=""),
        _text(data, "scenario_hash", ""), tuple((name, version) for name, version in pairs),
        tuple(
            NumberRead(words, *_quantity(_get(data, key, ""), key))
            for key, words in (("design_speed", "design speed"), ("design_height", "design height"))
        ),
        options, {key: value for key, value in data.items() if key not in _READ},
    )  # fmt: skip


def number_of(value: Any) -> float | None:
    """A number of the file, its words for NaN and the infinities too; None for anything else.

    Examples
    --------
    >>> number_of("-Infinity"), number_of(2), number_of(True), number_of("stable")
    (-inf, 2.0, None, None)
    """
    if isinstance(value, str):
        return _WORDS.get(value)
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return None
    try:
        return float(value)
    except OverflowError:  # a whole number of more than 308 digits
        return math.inf if value > 0 else -math.inf


def _file(place: Path) -> Path:
    if place.is_file():
        return place
    if not place.exists():
        raise ScenarioError(f"{place}: expected a folder with {FILE}, or that file; there is nothing here")
    if (place / FILE).exists():
        return place / FILE
    other = next((name for name in _OTHERS if (place / name).exists()), None)
    if other is not None:
        raise ScenarioError(f"{place}: not a report but {_OTHERS[other]} ({other}); {MAKE_ONE}")
    if any((place / f"report.{other}").exists() for other in ("html", "pdf", "md")):
        raise ScenarioError(f"{place}: the report there has no {FILE}; write it again with --format html,pdf,json")
    raise ScenarioError(f"{place}: no {FILE} in this folder; {MAKE_ONE}")


def _option(data: Any, where: str) -> OptionRead:
    record = _mapping(data, where)
    requirements = tuple(
        _requirement(one, f"{where}.requirements[{k}]") for k, one in enumerate(_list(record, "requirements", where))
    )
    _require_different([one.name for one in requirements], f"{where}.requirements")
    modes, errors = _modes(record.get("modes"), f"{where}.modes")
    return OptionRead(
        _text(record, "name", where), _text(record, "label", where), _text(record, "kind", where),
        _strings(record.get("summary", []), f"{where}.summary"), _text(record, "failure", where),
        _verdict(record, where), requirements, (*modes, *_margins(record.get("margins"), f"{where}.margins")),
        *errors, {key: value for key, value in record.items() if key not in _READ_OF_OPTION},
    )  # fmt: skip


def _requirement(data: Any, where: str) -> RequirementRead:
    record = _mapping(data, where)
    limit, unit = _quantity(_get(record, "limit", where), f"{where}.limit")
    value, _ = _quantity(_get(record, "value", where), f"{where}.value")
    sense, bound = _text(record, "sense", where), _text(record, "bound", where, default="exact")
    _require_one_of(sense, ("at_least", "at_most"), f"{where}.sense")
    _require_one_of(bound, ("exact", "lower", "upper"), f"{where}.bound")
    hard = record.get("hard", True)
    if not isinstance(hard, bool):
        raise ValueError(f"{where}.hard: expected true or false, got {_shown(hard)}")
    return RequirementRead(
        _text(record, "name", where), _text(record, "quantity", where), _text(record, "description", where),
        cast("Literal['at_least', 'at_most']", sense), limit, value, unit, _verdict(record, where),
        _text(record, "worst_at", where), _text(record, "reason", where), cast("Bound", bound), hard,
    )  # fmt: skip


def _modes(data: Any, where: str) -> tuple[tuple[NumberRead, ...], tuple[float, float]]:
    """Growth rate and least damping ratio at the design point, and the largest errors of the two."""
    if data is None:
        return (), (0.0, 0.0)
    record = _mapping(data, where)
    s = _mapping(_get(_mapping(_get(record, "s", where), f"{where}.s"), "value", f"{where}.s"), f"{where}.s.value")
    real, imaginary = (_numbers(_get(s, part, f"{where}.s.value"), f"{where}.s.value.{part}") for part in ("re", "im"))
    bounds = _mapping(record.get("error_bound", {"value": []}), f"{where}.error_bound").get("value", [])
    errors = _numbers(bounds, f"{where}.error_bound.value") or (0.0,) * len(real)
    damping = _numbers(record.get("damping_ratio", []), f"{where}.damping_ratio")
    if not real or not len(real) == len(imaginary) == len(errors):
        raise ValueError(f"{where}: expected an eigenvalue and an error bound for each mode")
    growth, error = max(zip(real, errors, strict=True))
    found = [NumberRead("largest growth rate", growth, "1/s", error)]
    # The error of a damping ratio is that of the eigenvalue in units of its size.
    sizes = [math.hypot(*pair) for pair in zip(real, imaginary, strict=True)]
    ratios = [e / size if size > 0.0 else 0.0 for e, size in zip(errors, sizes, strict=True)]
    swinging = [k for k, part in enumerate(imaginary) if part > errors[k]]
    if swinging and len(damping) == len(real):
        least = min(swinging, key=lambda k: damping[k])
        found.append(NumberRead("least damping ratio", damping[least], "", ratios[least]))
    return tuple(found), (max(errors), max(ratios))


def _margins(data: Any, where: str) -> tuple[NumberRead, ...]:
    """The margins told in the report's tables, one loop at a time and all at once."""
    if data is None:
        return ()
    record, found = _mapping(data, where), []
    for k, one in enumerate(_list(record, "channels", where)):
        place = f"{where}.channels[{k}]"
        channel = _mapping(one, place)
        name = _text(channel, "channel", place)
        for key, words, unit in (
            ("gain_reduction", "gain reduction", ""), ("gain_increase", "gain increase", ""),
            ("phase", "phase margin", "deg"), ("delay", "delay margin", "s"), ("modulus", "modulus margin", ""),
        ):  # fmt: skip
            if channel.get(key) is not None:
                value, _ = _quantity(channel[key], f"{place}.{key}")
                found.append(NumberRead(f"{words}, {name}", value, unit))
        found += _disk(channel.get("disk"), f"disk margin, {name}", f"{place}.disk")
    found += _disk(record.get("multi_loop"), "disk margin, all loops", f"{where}.multi_loop")
    return tuple(found)


def _disk(data: Any, words: str, where: str) -> list[NumberRead]:
    if data is None:
        return []
    value = number_of(_get(_mapping(data, where), "alpha", where))
    if value is None:
        raise ValueError(f"{where}.alpha: expected a number")
    return [NumberRead(words, value, "")]


def _get(record: Mapping[str, Any], key: str, where: str) -> Any:
    if key not in record:
        raise ValueError(f"{_joined(where, key)}: missing")
    return record[key]


def _mapping(data: Any, where: str) -> Mapping[str, Any]:
    if not isinstance(data, Mapping):
        raise ValueError(f"{where}: expected a record, got {_shown(data)}")
    return data


def _list(record: Mapping[str, Any], key: str, where: str) -> list[Any]:
    found = _get(record, key, where)
    if not isinstance(found, list):
        raise ValueError(f"{_joined(where, key)}: expected a list, got {_shown(found)}")
    return found


def _text(record: Mapping[str, Any], key: str, where: str, *, default: str | None = None) -> str:
    found = _get(record, key, where) if default is None else record.get(key, default)
    if not isinstance(found, str):
        raise ValueError(f"{_joined(where, key)}: expected a text, got {_shown(found)}")
    return found


def _strings(data: Any, where: str) -> tuple[str, ...]:
    if not isinstance(data, list) or not all(isinstance(entry, str) for entry in data):
        raise ValueError(f"{where}: expected a list of texts, got {_shown(data)}")
    return tuple(data)


def _numbers(data: Any, where: str) -> tuple[float, ...]:
    found = [number_of(entry) for entry in data] if isinstance(data, list) else [None]
    if any(entry is None for entry in found):
        raise ValueError(f"{where}: expected a list of numbers, got {_shown(data)}")
    return tuple(entry for entry in found if entry is not None)


def _quantity(data: Any, where: str) -> tuple[float, str]:
    record = _mapping(data, where)
    value = number_of(_get(record, "value", where))
    if value is None:
        raise ValueError(f"{where}.value: expected a number, got {_shown(record['value'])}")
    return value, _text(record, "unit", where)


def _verdict(record: Mapping[str, Any], where: str) -> Verdict:
    word = _text(record, "verdict", where)
    _require_one_of(word, tuple(verdict.value for verdict in Verdict), _joined(where, "verdict"))
    return Verdict(word)


def _require_one_of(word: str, words: tuple[str, ...], where: str) -> None:
    if word not in words:
        raise ValueError(f"{where}: expected one of {', '.join(words)}, got {_shown(word)}")


def _require_different(names: list[str], where: str) -> None:
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise ValueError(f"{where}: {_shown(twice)} stands there twice")


def _joined(where: str, key: str) -> str:
    return f"{where}.{key}" if where else key


def _shown(value: Any) -> str:
    text = json.dumps(value, ensure_ascii=True, default=str)
    return text if len(text) <= 40 else f"{text[:37]}..."
