"""What a page shows, as a value: scenario text, option, sliders; with its undo and redo."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

_STEPS = 200
_CHARACTERS = 32 * 2**20
NAME_LIMIT = 120
VALUES_LIMIT = 400


@dataclass(frozen=True, slots=True)
class PageState:
    """A page's whole state; `source` is the key of the file it began with, "" for a text that was brought.

    `values`: sliders that were moved, SI, by name. `edited`: the text is not the source's own any more.
    """

    source: str
    name: str
    text: str
    option: str = ""  # "": the scenario's first
    values: tuple[tuple[str, float], ...] = ()
    edited: bool = False


class History:
    """States a page went through, with the place in them; what belongs to one gesture is one step.

    Examples
    --------
    >>> first = PageState("", "car", "format = 1")
    >>> history = History(first)
    >>> for speed in (10.0, 20.0, 30.0):
    ...     history.put(with_value(first, {"speed": speed}), gesture="drag 1")
    >>> history.undo() == first, history.redo().values
    (True, (('speed', 30.0),))
    """

    def __init__(self, first: PageState) -> None:
        self._states = [first]
        self._gestures: list[str] = [""]
        self._at = 0

    @property
    def now(self) -> PageState:
        """The state shown."""
        return self._states[self._at]

    @property
    def can_undo(self) -> bool:
        """Whether there is a state before."""
        return self._at > 0

    @property
    def can_redo(self) -> bool:
        """Whether there is a state after."""
        return self._at + 1 < len(self._states)

    def put(self, state: PageState, *, gesture: str = "") -> None:
        """A new state; one of the same gesture (a drag, keys held down) takes the place of the one before."""
        if state == self.now:
            return
        del self._states[self._at + 1 :], self._gestures[self._at + 1 :]
        if gesture and gesture == self._gestures[-1]:
            self._states[-1] = state
        else:
            self._states.append(state)
            self._gestures.append(gesture)
        self._trim()
        self._at = len(self._states) - 1

    def undo(self) -> PageState:
        """The state before, or the first one; a gesture does not go on after it."""
        self._at = max(0, self._at - 1)
        self._gestures[self._at] = ""
        return self.now

    def redo(self) -> PageState:
        """The state after, or the last one."""
        self._at = min(len(self._states) - 1, self._at + 1)
        self._gestures[self._at] = ""
        return self.now

    def _trim(self) -> None:
        while len(self._states) > 2 and (len(self._states) > _STEPS or self._characters() > _CHARACTERS):
            del self._states[0], self._gestures[0]

    def _characters(self) -> int:
        texts = {id(state.text): len(state.text) for state in self._states}
        return sum(texts.values())


def with_value(state: PageState, values: Mapping[str, float]) -> PageState:
    """The state with sliders moved, in order of their names."""
    merged = {**dict(state.values), **values}
    return PageState(
        state.source, state.name, state.text, state.option, tuple(sorted(merged.items())), state.edited
    )  # fmt: skip


def read_values(found: object) -> dict[str, float]:
    """Slider values out of what a browser or an address sent.

    Raises
    ------
    ValueError : not names with finite numbers

    Examples
    --------
    >>> read_values({"speed": 100})
    {'speed': 100.0}
    """
    if not isinstance(found, dict) or len(found) > VALUES_LIMIT:
        raise ValueError("expected names with numbers")
    values: dict[str, float] = {}
    for name, value in found.items():
        if not isinstance(name, str) or len(name) > NAME_LIMIT or isinstance(value, bool):
            raise ValueError("expected names with numbers")
        if not isinstance(value, int | float) or abs(value) > 1e300 or not math.isfinite(value):
            raise ValueError(f"{name[:40]}: expected a finite number")
        values[name] = float(value)
    return values


def kept_values(state: PageState, known: Iterable[str]) -> PageState:
    """The state without values of sliders there are none of."""
    names = set(known)
    left = tuple(one for one in state.values if one[0] in names)
    return PageState(state.source, state.name, state.text, state.option, left, state.edited)
