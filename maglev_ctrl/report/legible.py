"""Characters that pages, figures or archive PDFs refuse, told by one sign that all of them can show."""

from __future__ import annotations

import re
from functools import lru_cache
from typing import Any, Final
from unicodedata import category, normalize

REPLACED: Final = "\N{REPLACEMENT CHARACTER}"
BOX: Final = "\N{WHITE SQUARE}"
_REFUSED: Final = re.compile(
    "[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\ud800-\udfff\ue000-\uf8ff\ufdd0-\ufdef\ufeff\ufff9-\ufffb\ufffe\uffff"
    + "".join(f"{chr(plane + 0xFFFE)}{chr(plane + 0xFFFF)}" for plane in range(0x10000, 0xF0000, 0x10000))
    + "\U000f0000-\U0010ffff]"
)


def legible(text: str) -> str:
    """Control characters, private use, noncharacters and lone halves of pairs as one sign; lines and tabs are kept.

    Examples
    --------
    >>> legible("a\\x07b\\ue000\\n") == "a\N{REPLACEMENT CHARACTER}b\N{REPLACEMENT CHARACTER}\\n"
    True
    """
    return _REFUSED.sub(REPLACED, text)


def boxed(text: str) -> str:
    """What the printed report's font has not, as empty boxes; marks on letters only where one letter has them.

    Examples
    --------
    >>> boxed("α \u78c1 a\u0308\u0308")
    'α □ ä'
    """
    known = _letters()
    one_each = (letter for letter in normalize("NFC", text) if not category(letter).startswith("M"))
    return "".join(letter if letter in "\n\t" or ord(letter) in known else BOX for letter in one_each)


@lru_cache(maxsize=1)
def _letters() -> frozenset[int]:
    """Code points of the printed report's font, which comes with matplotlib."""
    import matplotlib
    from matplotlib.ft2font import FT2Font

    return frozenset(FT2Font(f"{matplotlib.get_data_path()}/fonts/ttf/DejaVuSans.ttf").get_charmap())


def in_all(value: Any, change: Any) -> Any:
    """Plain JSON values with `change` applied to every text in them.

    Examples
    --------
    >>> in_all({"a": ["b", 1]}, str.upper)
    {'a': ['B', 1]}
    """
    if isinstance(value, str):
        return change(value)
    if isinstance(value, dict):
        return {key: in_all(inner, change) for key, inner in value.items()}
    if isinstance(value, list):
        return [in_all(inner, change) for inner in value]
    return value
