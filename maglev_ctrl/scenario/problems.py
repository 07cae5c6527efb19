"""What is wrong with a file: every fault with its place, in one exception."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path as FilePath

from maglev_ctrl.errors import ScenarioError

KeyPath = tuple[str | int, ...]
"""Where a value stands in a file: table names, keys, and positions in lists counted from zero."""


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
    """Every fault of one file, sorted by position; the text has one line for each.

    Examples
    --------
    >>> print(ScenarioProblems("eds.toml", [Problem(3, 8, "vehicle.car.mass", "expected a mass")]))
    eds.toml:3:8: vehicle.car.mass: expected a mass
    """

    def __init__(self, file: str | FilePath, problems: Iterable[Problem]) -> None:
        self.file = str(file)
        self.problems = tuple(sorted(set(problems), key=lambda problem: (problem.file, problem)))
        super().__init__("\n".join(self._line(problem) for problem in self.problems))

    def __reduce__(self) -> tuple[type[ScenarioProblems], tuple[str, tuple[Problem, ...]]]:
        return (ScenarioProblems, (self.file, self.problems))

    def _line(self, problem: Problem) -> str:
        place = f":{problem.line}:{problem.column}" if problem.line else ""
        key = f"{problem.key}: " if problem.key else ""
        return f"{problem.file or self.file}{place}: {key}{problem.message}"


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
    near = get_close_matches(str(word).casefold(), {name.casefold(): name for name in names}, n=1, cutoff=0.6)
    if near:
        return f'; did you mean "{next(name for name in names if name.casefold() == near[0])}"?'
    return f"; known here: {', '.join(names)}" if names else ""
