"""How large, how deep and how full a scenario's text may be, and which signs it may hold."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Final

from maglev_ctrl.scenario.problems import KeyPath

SIZE_LIMIT: Final = 2**20
LINE_LIMIT: Final = 20_000
DEPTH_LIMIT: Final = 12
VALUE_LIMIT: Final = 50_000
"""Keys and entries of lists in a file, tables counted: every one is placed when a fault is told."""
# C0 without tab and line ends, C1, and what turns the direction of reading around
_CONTROL = re.compile(r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]")
_PARTS = re.compile(r"""(?<![\w-])(?:(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')[ \t]*+\.[ \t]*+){32}""")


def very_long_keys(text: str) -> bool:
    """Whether a key has so many parts that reading it would take long, for the TOML reader copies every beginning.

    Examples
    --------
    >>> very_long_keys("a.b.c = 1"), very_long_keys("a." * 40 + "b = 1")
    (False, True)
    """
    return _PARTS.search(text) is not None


def control_signs(value: object, path: KeyPath = ()) -> Iterator[tuple[KeyPath, str]]:
    """Texts with signs that move a terminal's cursor or turn the direction of reading around, and the first of them."""
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from control_signs(key, path)
            yield from control_signs(inner, (*path, key))
    elif isinstance(value, list):
        for place, inner in enumerate(value):
            yield from control_signs(inner, (*path, place))
    elif isinstance(value, str):
        found = _CONTROL.search(value)
        if found is not None:
            yield path, f"U+{ord(found[0]):04X}"


def huge_numbers(value: object, path: KeyPath = ()) -> Iterator[KeyPath]:
    """Whole numbers beyond 64 bits, which TOML does not have and no float may hold."""
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from huge_numbers(inner, (*path, key))
    elif isinstance(value, list):
        for place, inner in enumerate(value):
            yield from huge_numbers(inner, (*path, place))
    elif isinstance(value, int) and not -(2**63) <= value < 2**63:
        yield path


def depth_exceeds(data: object, limit: int) -> bool:
    """Whether tables and lists are nested deeper than a limit; walked layer by layer, so that no depth is too deep."""
    layer: list[object] = [data]
    for _ in range(limit):
        layer = [
            inner
            for value in layer
            if isinstance(value, dict | list)
            for inner in (value.values() if isinstance(value, dict) else value)
        ]
        if not layer:
            return False
    return any(isinstance(value, dict | list) for value in layer)


def values_in(data: object) -> int:
    """Keys and entries of lists, at any depth."""
    waiting, count = [data], 0
    while waiting:
        value = waiting.pop()
        if isinstance(value, dict | list):
            count += len(value)
            waiting.extend(value.values() if isinstance(value, dict) else value)
    return count
