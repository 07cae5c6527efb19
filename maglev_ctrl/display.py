"""How records show themselves: one line where text is printed, tables and figures in a notebook."""

from __future__ import annotations

from enum import Enum
from importlib import import_module
from typing import Any, ClassVar, Final

import numpy as np

PAGES: Final = "maglev_ctrl.report.notebook"
"""Who draws. The name is looked up when a notebook asks, so that no record depends on tables and figures."""

_LONGEST: Final = 60  # letters of one text
_MOST: Final = 4  # entries of one tuple


class Shown:
    """A record with a short `repr` and, in a notebook, a page of tables and figures.

    `_told` names the fields and properties of the short form; all fields when it is empty.

    Examples
    --------
    >>> from dataclasses import dataclass
    >>> @dataclass(frozen=True, eq=False, slots=True, repr=False)
    ... class Pair(Shown):
    ...     name: str
    ...     values: object
    >>> Pair("front", np.zeros((6, 40)))
    Pair(name='front', values=<6 x 40>)
    """

    __slots__ = ()
    _told: ClassVar[tuple[str, ...]] = ()

    def __repr__(self) -> str:
        names = self._told or tuple(getattr(self, "__dataclass_fields__", ()))
        said = ((name, getattr(self, name)) for name in names)
        words = (f"{name}={brief(value)}" for name, value in said if not (isinstance(value, tuple) and not value))
        return f"{type(self).__name__}({', '.join(words)})"

    def _repr_html_(self) -> str | None:
        """The page a notebook shows; None for a record that has none."""
        page: str | None = import_module(PAGES).html(self)
        return page


def brief(value: Any) -> str:
    """A value in few letters: arrays by their size, long tuples by their first entries, records by their name.

    Examples
    --------
    >>> brief(np.zeros((3, 2))), brief(("heave", "pitch")), brief(0.123456789), brief(tuple(range(9)))
    ('<3 x 2>', "('heave', 'pitch')", '0.123457', '(0, 1, 2, 3, ... 9 in all)')
    """
    if isinstance(value, np.ndarray):
        return f"<{' x '.join(str(size) for size in value.shape)}>" if value.ndim else brief(value.item())
    if isinstance(value, np.generic):
        return brief(value.item())
    if isinstance(value, Enum):
        return brief(value.value)
    if isinstance(value, (float, complex)) and not isinstance(value, bool):
        return f"{value:.6g}"
    if isinstance(value, str):
        return repr(value if len(value) <= _LONGEST else f"{value[: _LONGEST - 4]} ...")
    if isinstance(value, tuple):
        shown = [brief(entry) for entry in value[:_MOST]]
        left = [f"... {len(value)} in all"] if len(value) > _MOST else []
        return f"({', '.join([*shown, *left])}{',' if len(value) == 1 else ''})"
    if value is None or isinstance(value, (bool, int)):
        return repr(value)
    name = getattr(value, "name", getattr(value, "channel", None))
    return f"<{type(value).__name__}{f' {brief(name)}' if isinstance(name, str) else ''}>"
