"""A page's state in its address: names for shipped scenarios, the packed text behind # for others."""

from __future__ import annotations

import base64
import binascii
import json
import zlib
from urllib.parse import parse_qsl, urlencode

from maglev_ctrl.scenario.limits import SIZE_LIMIT
from maglev_ctrl.workbench.state import NAME_LIMIT, PageState, read_values

ADDRESS_LIMIT = 65_536
"""Characters of an address beyond which programs that pass it on begin to cut it."""
_UNPACKED_LIMIT = SIZE_LIMIT + 2**18
_QUERY_LIMIT = 8192
_KEYS = ("scenario", "option")
_BROKEN = "the address holds a state that cannot be read; it was cut or changed on the way"


def address_of(state: PageState) -> str | None:
    """Query and fragment that bring the state back; None where it is too long for an address.

    Examples
    --------
    >>> address_of(PageState("paper/double_l", "double_l", "...", option="passive", values=(("speed", 100.0),)))
    '?scenario=paper%2Fdouble_l&option=passive&speed=100'
    """
    if state.source and not state.edited:
        pairs = [("scenario", state.source), *([("option", state.option)] if state.option else [])]
        return "?" + urlencode([*pairs, *((name, f"{value:.12g}") for name, value in state.values)])
    text = packed(state)
    return text if len(text) <= ADDRESS_LIMIT else None


def packed(state: PageState) -> str:
    """The whole state, its text included, as the fragment of an address."""
    told = {"source": state.source, "name": state.name, "text": state.text, "option": state.option}
    content = zlib.compress(json.dumps({**told, "values": dict(state.values)}).encode(), 9)
    return "#s=" + base64.urlsafe_b64encode(content).decode().rstrip("=")


def state_of(search: str, fragment: str, *, limit: int = ADDRESS_LIMIT) -> PageState | None:
    """The state an address asks for, its text "" where it is a shipped scenario's own; None where it asks for nothing.

    Parameters
    ----------
    limit : characters of a fragment; more than an address has only for what the browser kept itself

    Raises
    ------
    ValueError : why it cannot be read, in words
    """
    if fragment.startswith("#s="):
        return _unpacked(fragment.removeprefix("#s="), limit)
    if len(search) > _QUERY_LIMIT:
        raise ValueError("the address is too long to be read")
    pairs = dict(parse_qsl(search.removeprefix("?"), max_num_fields=500))
    if not pairs:
        return None
    if "scenario" not in pairs:
        raise ValueError(f"the address sets {', '.join(pairs)[:80]} and names no scenario; expected scenario=...")
    values = {}
    for name, text in pairs.items():
        if name in _KEYS:
            continue
        try:
            values[name] = float(text)
        except ValueError:
            raise ValueError(f'the address gives {name[:40]} as "{text[:40]}"; expected a number in SI') from None
    key, moved = pairs["scenario"][:NAME_LIMIT], tuple(sorted(read_values(values).items()))
    return PageState(key, key.rpartition("/")[2], "", pairs.get("option", "")[:NAME_LIMIT], moved)


def _unpacked(text: str, limit: int) -> PageState:
    """The state packed into a fragment; unpacking stops at what a scenario may have."""
    if len(text) > limit:
        raise ValueError("the address is too long to be read")
    try:
        raw = base64.b64decode(text + "=" * (-len(text) % 4), altchars=b"-_", validate=True)
        reader = zlib.decompressobj()
        content = reader.decompress(raw, _UNPACKED_LIMIT)
        if not reader.eof or reader.unused_data:  # more than a state can hold, or not all of it
            raise ValueError(_BROKEN)
        told = json.loads(content)
    except (binascii.Error, zlib.error, ValueError, RecursionError):
        raise ValueError(_BROKEN) from None
    if not isinstance(told, dict) or not all(isinstance(told.get(key), str) for key in ("source", "name", "text")):
        raise ValueError(_BROKEN)
    if len(told["text"].encode(errors="replace")) > SIZE_LIMIT:
        raise ValueError("the address holds a scenario of more than 1 MiB")
    option = told.get("option")
    values = read_values(told.get("values", {}))
    return PageState(
        told["source"][:NAME_LIMIT], told["name"][:NAME_LIMIT], told["text"],
        option[:NAME_LIMIT] if isinstance(option, str) else "", tuple(sorted(values.items())), edited=True,
    )  # fmt: skip
