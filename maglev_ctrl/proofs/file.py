"""A design as one self-contained document: plants, laws, claims and their matrices, to be proved again from it alone.

Plain dictionaries, lists, texts and numbers; JSON writes a float with digits enough to read the same float back.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from itertools import pairwise
from typing import Any, NoReturn

import numpy as np

from maglev_ctrl.arrays import FloatArray, read_only
from maglev_ctrl.errors import ModelError
from maglev_ctrl.proofs.claims import (
    Claim,
    DecayClaim,
    EllipsoidClaim,
    EnergyClaim,
    GainClaim,
    ParameterClaim,
    Proof,
    RegionClaim,
    SegmentClaim,
)
from maglev_ctrl.proofs.prove import prove
from maglev_ctrl.systems import Controller
from maglev_ctrl.systems.plant import Plant, plant_fields

FORMAT = "maglev_ctrl design 1"
LONGEST_NAME = 400
"""Letters of a name or any other text that is told in one line."""

KINDS: dict[str, type[Claim]] = {
    "decay": DecayClaim,
    "region": RegionClaim,
    "gain": GainClaim,
    "energy": EnergyClaim,
    "ellipsoid": EllipsoidClaim,
    "parameter": ParameterClaim,
    "segment": SegmentClaim,
}

_SIGNALS = ("states", "disturbances", "commands", "performance", "measured")


@dataclass(frozen=True, eq=False, slots=True)
class Schedule:
    """Values of an operating parameter at which the laws of a design stand, linearly blended between."""

    parameter: str
    unit: str
    nodes: tuple[float, ...]


@dataclass(frozen=True, eq=False, slots=True)
class DesignFile:
    """What a design document holds.

    `scenario` (text, hash and whatever names its origin), `performance` (one mapping per number: quantity, reported,
    recomputed, unit) and `extra` are kept as they are; no proof depends on them.
    """

    name: str
    law: str
    plants: tuple[Plant, ...]
    controllers: tuple[Controller, ...]
    claims: tuple[Claim, ...]
    created: str = ""
    versions: Mapping[str, str] = field(default_factory=dict)
    scenario: Mapping[str, Any] = field(default_factory=dict)
    schedule: Schedule | None = None
    performance: tuple[Mapping[str, Any], ...] = ()
    notes: tuple[str, ...] = ()
    extra: Mapping[str, Any] = field(default_factory=dict)


def recheck(design: DesignFile) -> tuple[Proof, ...]:
    """Every claim of a design proved again from its numbers; none is left out, and no solver is asked.

    Examples
    --------
    >>> plant = Plant.from_matrices([[1.0]], [[1.0]], [[1.0]], [[1.0]])
    >>> law = Controller.static([[-3.0]], measured=("x1",), commands=("u1",))
    >>> design = DesignFile("demo", "lqr", (plant,), (law,), (DecayClaim((0,), (0,), 1.0, np.ones((1, 1, 1))),))
    >>> [proof.holds for proof in recheck(from_document(to_document(design)))]
    [True]
    """
    return tuple(prove(claim, design.plants, design.controllers) for claim in design.claims)


def to_document(design: DesignFile) -> dict[str, Any]:
    """A design as dictionaries and lists; `json.dumps(..., allow_nan=False)` writes it without loss.

    Examples
    --------
    >>> to_document(DesignFile("demo", "lqr", (), (), ()))["format"]
    'maglev_ctrl design 1'
    """
    schedule = design.schedule
    return {
        "format": FORMAT,
        "name": design.name,
        "law": design.law,
        "created": design.created,
        "versions": dict(design.versions),
        "scenario": _plain(design.scenario),
        "plants": [_plant_out(plant) for plant in design.plants],
        "controllers": [_law_out(law) for law in design.controllers],
        "schedule": None if schedule is None else
        {"parameter": schedule.parameter, "unit": schedule.unit, "nodes": [float(x) for x in schedule.nodes]},
        "claims": [_claim_out(claim) for claim in design.claims],
        "performance": [_plain(one) for one in design.performance],
        "notes": list(design.notes),
        "extra": _plain(design.extra),
    }  # fmt: skip


def from_document(document: object) -> DesignFile:
    """The design a document holds, every key and size checked.

    Raises
    ------
    ModelError : a key is missing, unknown or of the wrong kind; the text names it

    Examples
    --------
    >>> from_document({"format": "something else"})
    Traceback (most recent call last):
    maglev_ctrl.errors.ModelError: format: expected 'maglev_ctrl design 1', got 'something else'
    """
    whole = _mapping(document, "the document")
    if whole.get("format") != FORMAT:
        _wrong("format", repr(FORMAT), whole.get("format"))
    keys = ("format", *(one.name for one in fields(DesignFile)))
    _keys(whole, keys, "the document")
    plants = tuple(_plant_in(one, f"plants[{i}]") for i, one in enumerate(_list(whole["plants"], "plants")))
    laws = tuple(_law_in(one, f"controllers[{i}]") for i, one in enumerate(_list(whole["controllers"], "controllers")))
    claims = tuple(
        _claim_in(one, f"claims[{i}]", len(plants), len(laws)) for i, one in enumerate(_list(whole["claims"], "claims"))
    )
    performance = _list(whole["performance"], "performance")
    return DesignFile(
        name=_line(whole["name"], "name"), law=_line(whole["law"], "law"), created=_line(whole["created"], "created"),
        plants=plants, controllers=laws, claims=claims, schedule=_schedule_in(whole["schedule"], len(laws)),
        versions={k: _line(v, f"versions[{k!r}]") for k, v in _mapping(whole["versions"], "versions").items()},
        scenario=_mapping(whole["scenario"], "scenario"), extra=_mapping(whole["extra"], "extra"),
        performance=tuple(_mapping(one, f"performance[{i}]") for i, one in enumerate(performance)),
        notes=tuple(_text(one, "notes") for one in _list(whole["notes"], "notes")),
    )  # fmt: skip


def _plant_out(plant: Plant) -> dict[str, Any]:
    arrays = {key: getattr(plant, key).tolist() for key in plant_fields()}
    names = {key: list(getattr(plant, key)) for key in _SIGNALS}
    return {"name": plant.name, "dt": plant.dt, **names, **arrays}


def _plant_in(value: object, where: str) -> Plant:
    given = _mapping(value, where)
    _keys(given, ("name", "dt", *_SIGNALS, *plant_fields()), where)
    names = {key: _texts(given[key], f"{where}.{key}") for key in _SIGNALS}
    for key, listed in names.items():
        if len(set(listed)) != len(listed):
            raise ModelError(f"{where}.{key}: a name stands twice")
    n, n_w, n_u, n_z, n_y = (len(names[key]) for key in _SIGNALS)
    sizes = {
        "A": (n, n), "B1": (n, n_w), "B2": (n, n_u), "C1": (n_z, n), "D11": (n_z, n_w), "D12": (n_z, n_u),
        "C2": (n_y, n), "D21": (n_y, n_w), "D22": (n_y, n_u),
    }  # fmt: skip
    arrays = {key: _array(given[key], sizes[key], f"{where}.{key}") for key in plant_fields()}
    held: dict[str, Any] = {**arrays, **names}
    return Plant(**held, dt=_period(given["dt"], where), name=_line(given["name"], f"{where}.name"))


def _law_out(law: Controller) -> dict[str, Any]:
    arrays = {key: getattr(law, key).tolist() for key in ("A", "B", "C", "D")}
    return {"name": law.name, "dt": law.dt, "measured": list(law.measured), "commands": list(law.commands), **arrays}


def _law_in(value: object, where: str) -> Controller:
    given = _mapping(value, where)
    _keys(given, ("name", "dt", "measured", "commands", "A", "B", "C", "D"), where)
    measured, commands = (_texts(given[key], f"{where}.{key}") for key in ("measured", "commands"))
    n, n_y, n_u = len(_list(given["A"], f"{where}.A")), len(measured), len(commands)
    sizes = {"A": (n, n), "B": (n, n_y), "C": (n_u, n), "D": (n_u, n_y)}
    arrays = {key: _array(given[key], size, f"{where}.{key}") for key, size in sizes.items()}
    name = _line(given["name"], f"{where}.name")
    return Controller(**arrays, measured=measured, commands=commands, name=name, dt=_period(given["dt"], where))


def _schedule_in(value: object, laws: int) -> Schedule | None:
    if value is None:
        return None
    given = _mapping(value, "schedule")
    _keys(given, ("parameter", "unit", "nodes"), "schedule")
    nodes = tuple(_number(x, "schedule.nodes") for x in _list(given["nodes"], "schedule.nodes"))
    if len(nodes) != laws or any(b <= a for a, b in pairwise(nodes)):
        raise ModelError(f"schedule.nodes: expected {laws} rising values, one for each law, got {len(nodes)}")
    return Schedule(_line(given["parameter"], "schedule.parameter"), _line(given["unit"], "schedule.unit"), nodes)


def _claim_out(claim: Claim) -> dict[str, Any]:
    kind = next(key for key, record in KINDS.items() if isinstance(claim, record))
    return {"kind": kind, **{one.name: _plain(getattr(claim, one.name)) for one in fields(claim)}}


def _claim_in(value: object, where: str, plants: int, laws: int) -> Claim:
    given = _mapping(value, where)
    kind = given.get("kind")
    if not isinstance(kind, str) or kind not in KINDS:
        _wrong(f"{where}.kind", f"one of {', '.join(KINDS)}", kind)
    record = KINDS[kind]
    _keys(given, ("kind", *(one.name for one in fields(record))), where)
    found: dict[str, Any] = {}
    for one in fields(record):
        place, entry = f"{where}.{one.name}", given[one.name]
        match one.name:
            case "plants" | "controllers":
                found[one.name] = _indices(entry, plants if one.name == "plants" else laws, place)
            case "P" | "X":
                stack = [_square(matrix, place) for matrix in _list(entry, place)]
                if not stack or len({len(matrix) for matrix in stack}) != 1:
                    raise ModelError(f"{place}: expected one or more square matrices of one size")
                found[one.name] = read_only(np.stack(stack), name=one.name)
            case "V" | "L" | "M":
                found[one.name] = _square(entry, place)
            case "limits":
                found[one.name] = tuple(_number(x, place) for x in _list(entry, place))
            case "disturbances" | "performance":
                found[one.name] = _texts(entry, place)
            case "region":
                found[one.name] = _line(entry, place)
            case "cross":
                if not isinstance(entry, bool):
                    _wrong(place, "true or false", entry)
                found[one.name] = entry
            case _:
                found[one.name] = _number(entry, place)
    if not found["plants"] or len(found["plants"]) != len(found["controllers"]):
        raise ModelError(f"{where}: expected as many plants as controllers, at least one")
    return record(**found)


def _plain(value: Any) -> Any:
    """Arrays and tuples as lists, numbers of numpy as Python's; what is not finite becomes null."""
    if isinstance(value, Mapping):
        return {str(key): _plain(one) for key, one in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return _plain(value.tolist())
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [_plain(one) for one in value]
    if isinstance(value, float) and not np.isfinite(value):
        return None
    return value


def _wrong(where: str, expected: str, got: object) -> NoReturn:
    shown = repr(got) if not isinstance(got, int) or abs(got) < 10**60 else ""  # its digits may be too many to write
    shown = shown or "a very large whole number"
    raise ModelError(f"{where}: expected {expected}, got {shown if len(shown) < 60 else type(got).__name__}")


def _mapping(value: object, where: str) -> dict[str, Any]:
    if not isinstance(value, Mapping):
        _wrong(where, "keys with values", value)
    return dict(value)


def _keys(given: Mapping[str, Any], wanted: Sequence[str], where: str) -> None:
    missing = [key for key in wanted if key not in given]
    unknown = [key for key in given if key not in wanted]
    if missing:
        raise ModelError(f"{where}: the key {missing[0]!r} is missing")
    if unknown:
        raise ModelError(f"{where}: the key {unknown[0][:60]!r} is unknown")


def _list(value: object, where: str) -> list[Any]:
    if not isinstance(value, list):
        _wrong(where, "a list", value)
    return value


def _text(value: object, where: str) -> str:
    if not isinstance(value, str):
        _wrong(where, "a text", value)
    return value


def _line(value: object, where: str) -> str:
    """A text that stands in tables and messages: one line, and not a page of it."""
    text = _text(value, where)
    if len(text) > LONGEST_NAME or not text.isprintable():
        _wrong(where, f"at most {LONGEST_NAME} letters in one line", value)
    return text


def _texts(value: object, where: str) -> tuple[str, ...]:
    return tuple(_line(one, where) for one in _list(value, where))


def _number(value: object, where: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        _wrong(where, "a number", value)
    try:
        found = float(value)
    except OverflowError:
        found = np.inf
    if not np.isfinite(found) or (isinstance(value, int) and int(found) != value):
        _wrong(where, "a finite double-precision number", value)
    return found


def _indices(value: object, count: int, where: str) -> tuple[int, ...]:
    listed = _list(value, where)
    for one in listed:
        if isinstance(one, bool) or not isinstance(one, int) or not 0 <= one < count:
            _wrong(where, f"whole numbers below {count}", one)
    return tuple(listed)


def _period(value: object, where: str) -> float | None:
    if value is None:
        return None
    found = _number(value, f"{where}.dt")
    if found <= 0.0:
        _wrong(f"{where}.dt", "a positive sampling period in s, or null", value)
    return found


def _array(value: object, size: tuple[int, int], where: str) -> FloatArray:
    rows = _list(value, where)
    if len(rows) != size[0] or any(len(_list(row, where)) != size[1] for row in rows):
        raise ModelError(f"{where}: expected {size[0]} rows of {size[1]} numbers")
    numbers = [_number(x, where) for row in rows for x in row]
    return read_only(np.reshape(np.array(numbers, dtype=np.float64), size), name=where)


def _square(value: object, where: str) -> FloatArray:
    return _array(value, (len(_list(value, where)),) * 2, where)
