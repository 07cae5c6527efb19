"""A scenario's own text with some of its values replaced: what tuning chose, as a file that stands for itself."""

from __future__ import annotations

from collections.abc import Mapping

from maglev_ctrl.errors import ModelError
from maglev_ctrl.scenario.locate import key_places
from maglev_ctrl.scenario.problems import KeyPath, key_text
from maglev_ctrl.scenario.reader import from_text
from maglev_ctrl.scenario.scenario_schema import Scenario

Written = str | float | int | bool | list[object] | dict[str, object]


def rewritten_text(text: str, values: Mapping[KeyPath, Written]) -> str:
    """The text with the values at some keys replaced; everything else, comments too, stays as it is.

    Raises
    ------
    ValueError : a key that does not stand in the text as a value, or a value inside another that is replaced too

    Examples
    --------
    >>> rewritten_text('[a]  # kept\\nb = "1 m"  # old', {("a", "b"): "2 m"})
    '[a]  # kept\\nb = "2 m"  # old'
    """
    places, source = key_places(text), text.encode()
    spans: list[tuple[int, int, bytes]] = []
    for path, value in values.items():
        place = places.get(path)
        if place is None or place.span == (0, 0):
            raise ValueError(f"{key_text(path)}: expected a value that stands in the file")
        spans.append((*place.span, toml(value).encode()))
    end = len(source) + 1
    for start, stop, new in sorted(spans, reverse=True):
        if stop > end:
            raise ValueError("a value inside another one that is replaced too")
        source, end = source[:start] + new + source[stop:], start
    return source.decode()


def rewritten(scenario: Scenario, values: Mapping[KeyPath, Written]) -> Scenario:
    """The scenario its own file would give with some values replaced; its text and hash are those of the new file.

    Forces that were solved stay. Tables (a control law chosen whole) replace tables that are written inline.

    Raises
    ------
    ModelError : a key does not stand in the file, or the new file would not be valid
    """
    try:
        text = rewritten_text(scenario.text, values)
    except ValueError as fault:
        raise ModelError(f"{scenario.path}: {fault}") from None
    return from_text(text, scenario)


def toml(value: object) -> str:
    """A value as TOML writes it.

    Examples
    --------
    >>> toml({"law": "lqr", "allowed": [{"output": "car.heave", "value": "2 mm"}]})
    '{ law = "lqr", allowed = [{ output = "car.heave", value = "2 mm" }] }'
    """
    match value:
        case bool():
            return "true" if value else "false"
        case int():
            return str(value)
        case float():
            return repr(value)
        case str():
            escaped = value.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")
            return f'"{escaped}"'
        case list() | tuple():
            return f"[{', '.join(toml(item) for item in value)}]"
        case dict():
            inside = ", ".join(f"{key} = {toml(item)}" for key, item in value.items())
            return f"{{ {inside} }}"
        case _:
            raise ValueError(f"expected a text, a number, a list or a table, got {type(value).__name__}")
