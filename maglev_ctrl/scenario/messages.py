"""From pydantic's findings to one clear sentence per fault."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Literal, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo

from maglev_ctrl.scenario.problems import Fault, KeyPath, near_match
from maglev_ctrl.scenario.scenario_schema import Scenario
from maglev_ctrl.scenario.units import Unit

_NOUNS = {
    "string_type": "a text in quotes", "bool_type": "true or false", "int_type": "a whole number",
    "int_from_float": "a whole number", "float_type": "a number", "tuple_type": "a list", "list_type": "a list",
    "dict_type": "a table", "model_type": "a table", "model_attributes_type": "a table", "finite_number":
    "a finite number",
}  # fmt: skip


MOST_FAULTS = 200
"""Findings that are put into words: each is looked up among the known keys, and nobody reads thousands."""


def faults_of(error: ValidationError, data: Mapping[str, Any]) -> list[Fault]:
    """Every finding as a fault with its path in the file, the first 200 of them."""
    items = [dict(item) for item in error.errors(include_url=False)]
    kept = [item for item in items if not _short_by_faults(item)] or items
    return [_fault(item, data) for item in kept[:MOST_FAULTS]]


def _short_by_faults(item: dict[str, Any]) -> bool:
    """Whether a list counts as too short only because its items have faults, which are told on their own."""
    got = item.get("input")
    return item["type"] == "too_short" and isinstance(got, list) and len(got) >= item["ctx"]["min_length"]


def _fault(item: dict[str, Any], data: Mapping[str, Any]) -> Fault:
    kind, location = str(item["type"]), tuple(item["loc"])
    path = _path_in(data, location, missing=kind == "missing")
    got = item.get("input")
    context = item.get("ctx", {})
    match kind:
        case "missing":
            return Fault(path, f"missing; expected {_expected(location)}")
        case "extra_forbidden":
            known = _keys(_model_at(location[:-1]))
            return Fault(path, f"unknown key{near_match(location[-1], known)}", at_key=True)
        case "union_tag_not_found" | "union_tag_invalid":
            discriminator = str(context["discriminator"]).strip("'")
            tags = [tag.strip(" '") for tag in _tags(location)]
            if kind == "union_tag_not_found":
                return Fault((*path, discriminator), f"missing; expected {_choice(tags)}")
            tag = str(context["tag"])
            return Fault((*path, discriminator), f'expected {_choice(tags)}, got "{tag}"{_near_only(tag, tags)}')
        case "literal_error":
            choices = [str(choice) for choice in _literals(location)] or [str(context.get("expected", ""))]
            shown = f'"{got}"' if isinstance(got, str) else _shown(got)
            return Fault(path, f"expected {_choice(choices)}, got {shown}{_near_only(got, choices)}")
        case "string_pattern_mismatch":
            return Fault(path, f'expected a name of lower-case letters, digits and underscores, got "{got}"')
        case "quantity" | "ratio" | "matrix":
            return Fault(path, str(item["msg"]))
        case _ if kind in _NOUNS:
            return Fault(path, f"expected {_NOUNS[kind]}, got {_shown(got)}")
        case "too_short" | "too_long":
            return Fault(path, _length_message(kind, context))
    message = str(item["msg"]).replace("Input should be", "expected").replace("String should", "expected a text to")
    return Fault(path, f"{message}, got {_shown(got)}")


def _length_message(kind: str, context: Mapping[str, Any]) -> str:
    if kind == "too_short":
        return f"expected at least {context['min_length']}, got {context['actual_length']}"
    return f"expected at most {context['max_length']}, got {context['actual_length']}"


def _path_in(data: Any, location: KeyPath, *, missing: bool) -> KeyPath:
    """The location without the names of union members, which are no keys of the file."""
    path: KeyPath = ()
    for position, part in enumerate(location):
        inside = (isinstance(data, dict) and part in data) or (
            isinstance(data, list) and isinstance(part, int) and part < len(data)
        )
        if inside:
            data, path = data[part], (*path, part)
        elif missing and position == len(location) - 1:
            path = (*path, part)
    return path


def _steps(location: KeyPath) -> Iterator[tuple[Any, FieldInfo | None]]:
    """The annotation, and the field it belongs to, at each step into the record."""
    annotation: Any = Scenario
    field: FieldInfo | None = None
    yield annotation, field
    for part in location:
        members = _members(annotation)
        if isinstance(part, int):
            annotation = next((get_args(m)[0] for m in members if get_origin(m) is tuple), None)
        else:
            models = [m for m in members if isinstance(m, type) and issubclass(m, BaseModel)]
            tagged = [m for m in models if part in _model_tags(m)] if len(models) > 1 else []
            if tagged:
                annotation = tagged[0]
            else:
                field = _field(models[0], part) if models else None
                annotation = _annotation(field)
        yield annotation, field


def _members(annotation: Any) -> list[Any]:
    """Members of a union, annotations and None stripped."""
    origin = get_origin(annotation)
    if origin is Annotated:
        return _members(get_args(annotation)[0])
    if origin is not None and origin is not tuple and origin is not Literal and get_args(annotation) and (
        str(origin) in ("typing.Union", "<class 'types.UnionType'>")
    ):  # fmt: skip
        return [inner for member in get_args(annotation) for inner in _members(member)]
    return [] if annotation is type(None) or annotation is None else [annotation]


def _field(model: type[BaseModel], key: str) -> FieldInfo | None:
    return next((f for n, f in model.model_fields.items() if (f.alias or n) == key), None)


def _annotation(field: FieldInfo | None) -> Any:
    return None if field is None else field.annotation


def _keys(model: type[BaseModel] | None) -> list[str]:
    return [] if model is None else [field.alias or name for name, field in model.model_fields.items()]


def _model_at(location: KeyPath) -> type[BaseModel] | None:
    *_, (annotation, _) = _steps(location)
    models = [m for m in _members(annotation) if isinstance(m, type) and issubclass(m, BaseModel)]
    return models[0] if models else None


def _model_tags(model: type[BaseModel]) -> tuple[Any, ...]:
    return tuple(
        tag
        for key in ("model", "law", "kind", "quantity", "shape", "form")
        if key in model.model_fields and get_origin(model.model_fields[key].annotation) is Literal
        for tag in get_args(model.model_fields[key].annotation)
    )


def _tags(location: KeyPath) -> list[str]:
    *_, (annotation, _) = _steps(location)
    return [str(tag) for member in _members(annotation) for tag in _model_tags(member)]


def _literals(location: KeyPath) -> tuple[Any, ...]:
    *_, (annotation, _) = _steps(location)
    return tuple(c for m in _members(annotation) if get_origin(m) is Literal for c in get_args(m))


def _expected(location: KeyPath) -> str:
    """What a missing field would hold, in words."""
    *_, (annotation, field) = _steps(location)
    if field is None:
        return "this key"
    unit = next((m for m in (*field.metadata, *_metadata(annotation)) if isinstance(m, Unit)), None)
    described = f" ({field.description})" if field.description else ""
    if unit is not None:
        return f"{unit.expected}{described}"
    literals = _literals(location)
    if literals:
        return _choice([str(choice) for choice in literals]) + described
    return field.description or "a table" if field.description or _model_at(location) else "this key"


def _metadata(annotation: Any) -> tuple[Any, ...]:
    if get_origin(annotation) is Annotated:
        return tuple(get_args(annotation)[1:])
    return tuple(inner for member in get_args(annotation) for inner in _metadata(member))


def _choice(choices: list[str]) -> str:
    quoted = [choice if choice.isdigit() else f'"{choice}"' for choice in choices]
    return quoted[0] if len(quoted) == 1 else f"{', '.join(quoted[:-1])} or {quoted[-1]}"


def _near_only(word: object, known: list[str]) -> str:
    text = near_match(word, known)
    return text if "did you mean" in text else ""


def _shown(value: object) -> str:
    match value:
        case bool():
            return "true" if value else "false"
        case str():
            return f'"{value[:40]}"'
        case dict():
            return "a table"
        case list():
            return "a list"
    return str(value)[:40]
