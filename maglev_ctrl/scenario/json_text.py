"""JSON that somebody else may have written: bounded in size, depth and number of values, and strict."""

from __future__ import annotations

import json
import re
from typing import Any, Final, NoReturn

SIZE_LIMIT: Final = 64 * 2**20
VALUE_LIMIT: Final = 4_000_000
"""Commas and brackets of a file: each stands for a value that takes memory."""
DEPTH_LIMIT: Final = 100
_DEEP: Final = f"JSON nested more than {DEPTH_LIMIT} deep"
_UNSEEN: Final = re.compile(r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069\ud800-\udfff]")
_ESCAPED: Final = re.compile(rb"\\u(?:00[0189]|007[fF]|202|206|[dD][89a-fA-F])|\\[bf]")


def parse_json(content: bytes) -> Any:
    """What a JSON file holds.

    Raises
    ------
    json.JSONDecodeError : no JSON, with line and column
    RecursionError : nested too deeply
    ValueError : in a sentence: too large, no UTF-8, NaN or an infinity for a number, a key that stands twice,
        a text with control signs or half a letter

    Examples
    --------
    >>> parse_json(b'{"gap": [1.5, null]}')
    {'gap': [1.5, None]}
    >>> parse_json(b'{"gap": 1, "gap": 2}')
    Traceback (most recent call last):
    ValueError: expected JSON: the key "gap" stands twice in one record
    """
    if len(content) > SIZE_LIMIT:
        raise ValueError(f"expected at most {SIZE_LIMIT // 2**20} MiB")
    if sum(content.count(sign) for sign in (b",", b"[", b"{")) > VALUE_LIMIT:
        raise ValueError(f"expected at most {VALUE_LIMIT} values")
    try:
        text = content.decode("utf-8")
    except UnicodeDecodeError:
        raise ValueError("expected JSON in UTF-8, got other bytes") from None
    try:
        data = json.loads(text, parse_constant=_no_number, parse_int=_whole, object_pairs_hook=_record)
    except json.JSONDecodeError:
        raise
    except RecursionError:
        raise RecursionError(_DEEP) from None
    except ValueError as error:
        raise ValueError(f"expected JSON: {error}") from None
    _require_flat(data)
    if _UNSEEN.search(text) or _ESCAPED.search(content):  # only then it is worth looking at every text
        _require_seen(data)
    return data


def _no_number(word: str) -> NoReturn:
    raise ValueError(f"{word} is no JSON number")


def _whole(digits: str) -> int:
    if len(digits) > 400:
        raise ValueError(f"a whole number of {len(digits)} digits")
    return int(digits)


def _record(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) != len(pairs):
        names = [name for name, _ in pairs]
        twice = next(name for name in found if names.count(name) > 1)
        raise ValueError(f"the key {json.dumps(twice[:40])} stands twice in one record")
    return found


def _require_flat(data: object) -> None:
    """Layer by layer, for what is deep would break whatever walks it later."""
    layer = [data]
    for _ in range(DEPTH_LIMIT + 1):
        layer = [
            inner
            for value in layer
            if isinstance(value, dict | list)
            for inner in (value.values() if isinstance(value, dict) else value)
            if isinstance(inner, dict | list)
        ]
        if not layer:
            return
    raise RecursionError(_DEEP)


def _require_seen(data: object) -> None:
    waiting = [data]
    while waiting:
        value = waiting.pop()
        if isinstance(value, dict):
            waiting += (*value, *value.values())
        elif isinstance(value, list):
            waiting += value
        elif isinstance(value, str):
            sign = _UNSEEN.search(value)
            if sign is not None:
                raise ValueError(f"expected texts without control signs, got U+{ord(sign[0]):04X}")
