"""Where the page looks: speed, modulation depth and picked mode, shared by all views in the browser and the server."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

from bokeh.models import ColumnDataSource

_NAMES: Final = ("speed", "depth", "mode")

MOVE: Final = """
const place = (changes) => {
  const now = cursor.data
  if (Object.entries(changes).every(([name, value]) => Number(now[name][0]) === value)) return
  const next = {speed: [...now.speed], depth: [...now.depth], mode: [...now.mode]}
  for (const [name, value] of Object.entries(changes)) next[name] = [value]
  cursor.data = next
}
"""
"""JavaScript that defines `place({speed, depth, mode})` over an argument `cursor`; nothing happens without a change."""


class Cursor:
    """Speed (m/s), modulation depth and index of the picked mode, in one source that browser and server share.

    A change made in the browser moves the markers of all views there at once; the server hears of it afterwards.

    Examples
    --------
    >>> cursor = Cursor(100.0, 0.1)
    >>> heard = []
    >>> cursor.on_change(lambda: heard.append(cursor.speed))
    >>> cursor.move(speed=120.0)
    >>> heard, cursor.depth, cursor.mode
    ([120.0], 0.1, 0)
    """

    def __init__(self, speed: float = 0.0, depth: float = 0.0, mode: int = 0) -> None:
        self.source = ColumnDataSource({"speed": [speed], "depth": [depth], "mode": [mode]}, name="cursor")
        self._labels: tuple[str, ...] = ()
        self._default = mode  # that was put there last; another one was picked

    @property
    def speed(self) -> float:
        """Speed looked at, m/s."""
        return self._value("speed")

    @property
    def depth(self) -> float:
        """Modulation depth looked at."""
        return self._value("depth")

    @property
    def mode(self) -> int:
        """Which of the shown modes is picked."""
        return int(self._value("mode"))

    def _value(self, name: str) -> float:
        """A value as the browser last sent it; a page that sends nonsense is not believed."""
        column = self.source.data.get(name)
        try:
            value = float(column[0])
        except (TypeError, ValueError, IndexError):
            return 0.0
        return value if math.isfinite(value) else 0.0

    def move(self, *, speed: float | None = None, depth: float | None = None, mode: int | None = None) -> None:
        """Set what is given; the views in the browser follow."""
        wanted = {"speed": speed, "depth": depth, "mode": mode}
        now = {"speed": self.speed, "depth": self.depth, "mode": self.mode}
        then = {name: now[name] if wanted[name] is None else wanted[name] for name in _NAMES}
        if then != now:
            self.source.data = {name: [value] for name, value in then.items()}

    def keep(self, labels: tuple[str, ...], default: int) -> None:
        """The modes that can be picked are now these: stay with the name that somebody picked; without one, or when it
        is not there any more, go to the default one."""
        chosen = self.mode != self._default and 0 <= self.mode < len(self._labels)
        picked = self._labels[self.mode] if chosen else None
        self._labels = labels
        if picked in labels:
            self.move(mode=labels.index(picked))
            self._default = -1
        else:
            self.move(mode=default)
            self._default = default

    def on_change(self, callback: Callable[[], None]) -> None:
        """Call back after every change, wherever it was made."""
        self.source.on_change("data", lambda attr, old, new: callback())

    def slider_code(self, name: str, factor: float = 1.0) -> str:
        """JavaScript for a slider of speed or depth: `cb_obj.value` times `factor` in SI, with the argument `cursor`.

        For `slider.jscallback(value=cursor.slider_code("speed", 1 / 3.6), args={"cursor": cursor.source})`.

        Raises
        ------
        ValueError : not a name of the cursor
        """
        if name not in _NAMES:
            raise ValueError(f"name: expected one of {', '.join(_NAMES)}, got {name!r}")
        return f"{MOVE}\nplace({{{name}: cb_obj.value * {factor!r}}})"
