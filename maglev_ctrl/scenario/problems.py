"""What is wrong with a file: every fault with its place, in one exception."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, replace
from difflib import get_close_matches
from pathlib import Path as FilePath
from typing import Final

from maglev_ctrl.errors import ScenarioError

KeyPath = tuple[str | int, ...]
"""Where a value stands in a file: table names, keys, and positions in lists counted from zero."""

MOST_TOLD: Final = 100
"""Faults of one file that are listed at most; of the others their number is told."""
_ROOM: Final = 16_000  # letters of all that are listed
_LONGEST: Final = 600  # letters of one message
_LONGEST_KEY: Final = 120
# C0 and C1, what turns the direction of reading around, the ends of lines, and halves of letters
_UNSEEN: Final = re.compile(r"[\x00-\x1f\x7f-\x9f\u2028-\u202e\u2066-\u2069\ud800-\udfff]")


@dataclass(frozen=True, slots=True, order=True)
class Problem:
    """One fault: where it is (counted from 1; 0 = the whole file), which key, and what was expected."""

    line: int
    column: int
    key: str
    message: str
    file: str = ""  # "" = the scenario file; otherwise a data file it names


@dataclass(frozen=True, slots=True)
class Fault:
    """A fault whose position is not known yet; `at_key` asks for the key's position rather than the value's.

    `idle`: a part that does nothing. In a file it is a slip of the pen, among the values of a range it is one end.
    """

    path: KeyPath
    message: str
    at_key: bool = False
    idle: bool = False


class ScenarioProblems(ScenarioError):
    """Every fault of one file, sorted by position; the text has one line for each, at most 100 of them.

    `more` counts the faults that are not listed.

    Examples
    --------
    >>> print(ScenarioProblems("eds.toml", [Problem(3, 8, "vehicle.car.mass", "expected a mass")]))
    eds.toml:3:8: vehicle.car.mass: expected a mass
    """

    def __init__(self, file: str | FilePath, problems: Iterable[Problem], more: int = 0) -> None:
        self.file = str(file)
        found = sorted(map(_legible, set(problems)), key=lambda problem: (problem.file, problem))
        lines: list[str] = []
        room = _ROOM
        for line in map(self._line, found[:MOST_TOLD]):
            room -= len(line)
            if room < 0 and lines:
                break
            lines.append(line)
        self.problems = tuple(found[: len(lines)])
        self.more = more + len(found) - len(lines)
        if self.more:
            lines.append(f"{self.file}: {self.more} more faults are not listed")
        super().__init__("\n".join(lines))

    def __reduce__(self) -> tuple[type[ScenarioProblems], tuple[str, tuple[Problem, ...], int]]:
        return (ScenarioProblems, (self.file, self.problems, self.more))

    def _line(self, problem: Problem) -> str:
        place = f":{problem.line}:{problem.column}" if problem.line else ""
        key = f"{problem.key}: " if problem.key else ""
        return f"{problem.file or self.file}{place}: {key}{problem.message}"


def _legible(problem: Problem) -> Problem:
    """The problem with nothing in its words that steers a terminal, makes a line of its own or has no end."""
    key = legible(problem.key, most=_LONGEST_KEY)
    message = legible(problem.message, most=_LONGEST)
    if (key, message) == (problem.key, problem.message):
        return problem
    return replace(problem, key=key, message=message)


def legible(text: str, *, most: int = _LONGEST) -> str:
    """A text of a file as a message may repeat it: signs that are not seen by their numbers, the middle left out.

    Examples
    --------
    >>> legible("red\\x1b[31m"), legible("a" * 1000, most=20)
    ('red\\\\x1b[31m', 'aaaaaaaa ... aaaaaaa')
    """
    if len(text) > most:
        half = (most - 4) // 2
        text = f"{text[:half]} ... {text[-(most - 5 - half) :]}"
    return _UNSEEN.sub(lambda sign: sign[0].encode("unicode_escape").decode("ascii"), text)


def key_text(path: KeyPath) -> str:
    """The dotted key of a path, list positions in brackets.

    Examples
    --------
    >>> key_text(("option", 2, "name"))
    'option[2].name'
    """
    text = ""
    for part in path:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else part
    return text


def near_match(word: object, known: Iterable[str]) -> str:
    """`; did you mean "x"?` when something near is known, otherwise the list of what is known.

    Examples
    --------
    >>> near_match("lenght", ["length", "mass"])
    '; did you mean "length"?'
    """
    names = list(dict.fromkeys(known))
    near = get_close_matches(
        str(word)[:_LONGEST_KEY].casefold(), {name.casefold(): name for name in names}, n=1, cutoff=0.6
    )
    if near:
        return f'; did you mean "{next(name for name in names if name.casefold() == near[0])}"?'
    return f"; known here: {', '.join(names)}" if names else ""
