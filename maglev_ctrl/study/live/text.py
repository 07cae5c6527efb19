"""A scenario's own text with the sliders' values written into it."""

from __future__ import annotations

from collections.abc import Mapping

from maglev_ctrl.errors import ModelError
from maglev_ctrl.scenario import Scenario
from maglev_ctrl.scenario.locate import Place, key_places
from maglev_ctrl.scenario.problems import KeyPath, key_text
from maglev_ctrl.scenario.quantity_paths import DEPTH, ScenarioQuantity, display_unit
from maglev_ctrl.scenario.reader import from_text
from maglev_ctrl.scenario.rewrite import rewritten_text, toml
from maglev_ctrl.study.live.quantities import PLACES

_DIGITS = 12


def scenario_text(scenario: Scenario, values: Mapping[ScenarioQuantity, float]) -> str:
    """The scenario's text with some values written into it, comments kept, read back before it is given away.

    A depth that the guideway's sources decide cannot be written; a comment at the top tells it.

    Parameters
    ----------
    values : SI, of quantities that differ from the file

    Raises
    ------
    ModelError : the new text would not be a valid scenario
    """
    text, note = scenario.text, ""
    for quantity, value in values.items():
        path = quantity.path or PLACES[quantity.name]
        if quantity.name == DEPTH and scenario.periodic is not None and scenario.periodic.sources:
            note = (
                f"# Looked at with a modulation depth of {100.0 * value:.4g} %; the sources below decide their own.\n"
            )
            continue
        text = _written(text, path, _in_file(quantity, value))
    text = note + text
    from_text(text, scenario)
    return text


def _in_file(quantity: ScenarioQuantity, value: float) -> str | float:
    """A value in the unit people read it in."""
    unit, scale = display_unit(quantity, abs(value))
    if not quantity.unit or unit == "%":
        return float(f"{value:.{_DIGITS}g}")
    return f"{value * scale:.{_DIGITS}g} {unit.replace(' ', '*')}"


def _written(text: str, path: KeyPath, value: str | float) -> str:
    """The text with a value at a key: in place of the one there, or beside its neighbours."""
    places = key_places(text)
    if path in places:
        return rewritten_text(text, {path: value})
    beside = [(key, place) for key, place in places.items() if key[:-1] == path[:-1] and place.span != (0, 0)]
    if not beside:
        raise ModelError(f"{key_text(path)}: the file has no table to write it into")
    key, place = min(beside, key=lambda one: one[1].span)
    return _inserted(text, place, str(key[-1]), f"{path[-1]}", toml(value))


def _inserted(text: str, place: Place, known: str, name: str, value: str) -> str:
    """The text with a key before a neighbour: on a line of its own, or inside the braces of an inline table."""
    source = text.encode()
    line = source.rfind(b"\n", 0, place.span[0]) + 1
    head = source[line : place.span[0]].decode()
    inside = max(head.rfind("{"), head.rfind(",")) + 1
    spelled = head[inside:].partition("=")[0]
    if known not in spelled:
        raise ModelError(f"{name}: it cannot be written beside {known}")
    before = spelled[: spelled.rfind(known)]  # indentation, and the part of a dotted key that both share
    at = line + len(head[:inside].encode())
    pair = f"{before}{name} = {value}{',' if inside else chr(10)}"
    return (source[:at] + pair.encode() + source[at:]).decode()
