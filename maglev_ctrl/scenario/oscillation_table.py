"""Reading forced-oscillation data: CSV with units in the header, either over frequency or as records over time."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Literal

import numpy as np

from maglev_ctrl.scenario.csv_table import HEADER, number, read_rows
from maglev_ctrl.scenario.problems import Problem, ScenarioProblems, near_match
from maglev_ctrl.scenario.units import Dimensions, Unit, dimensions_of, unit_factor

SIZE_LIMIT = 64 * 2**20
MOST_PROBLEMS = 20
_LEAST, _MOST = 1e-20, 1e20  # beyond them the fourth powers of the fit leave the number range
_LONGEST_NAME = 80
Layout = Literal["frequency", "time"]

_STIFFNESSES = (
    Unit("a force per displacement", "N/m", "1 kN/m"),
    Unit("a force per angle", "N", "1 kN/rad"),
    Unit("a moment per angle", "N*m", "1 kN*m/rad"),
)
_ANGLE = Unit("an angle", "rad", "175 deg")
_TEXT: tuple[Unit, ...] = ()
COLUMNS: dict[Layout, dict[str, tuple[Unit, ...]]] = {
    "frequency": {
        "frequency": (Unit("a frequency", "rad/s", "5 Hz", angular=True),), "force": _TEXT, "motion": _TEXT,
        "amplitude": _STIFFNESSES, "phase": (_ANGLE,), "amplitude error": _STIFFNESSES, "phase error": (_ANGLE,),
        "static stiffness": _STIFFNESSES, "static stiffness error": _STIFFNESSES,
    },
    "time": {
        "time": (Unit("a time", "s", "1 ms"),), "displacement": (Unit("a length", "m", "1 mm"), _ANGLE),
        "force": (Unit("a force", "N", "1 N"), Unit("a moment", "N*m", "1 N*m")), "record": _TEXT,
        "force name": _TEXT, "motion name": _TEXT,
        "static stiffness": _STIFFNESSES, "static stiffness error": _STIFFNESSES,
    },
}  # fmt: skip
NEEDED: dict[Layout, tuple[str, ...]] = {
    "frequency": ("frequency", "force", "motion", "amplitude", "phase"),
    "time": ("time", "displacement", "force"),
}
MAY_BE_EMPTY = ("static stiffness", "static stiffness error")


@dataclass(frozen=True, eq=False, slots=True)
class Column:
    """One column: where it stands (from 1), its unit as written and in SI, and its cells; NaN where a cell is empty."""

    place: int
    unit: str
    dimensions: Dimensions
    numbers: np.ndarray[tuple[int], np.dtype[np.float64]]
    texts: tuple[str, ...]


@dataclass(frozen=True, eq=False, slots=True)
class OscillationTable:
    """Cells of one file, checked one by one, SI; `lines` are the file's line numbers of the rows."""

    shown: str
    layout: Layout
    header_line: int
    lines: tuple[int, ...]
    columns: dict[str, Column]

    def place(self, row: int, name: str, message: str) -> Problem:
        """A fault in one cell; of an absent column, in the row."""
        column = self.columns[name].place if name in self.columns else 1
        return Problem(self.lines[row], column, name, message)

    def texts(self, name: str, default: str) -> tuple[str, ...]:
        """Cells of a column of names, or the default throughout."""
        return self.columns[name].texts if name in self.columns else (default,) * len(self.lines)


def read_oscillation_table(content: bytes, *, shown: str) -> OscillationTable:
    """Cells of a forced-oscillation file; which layout it has is told by its columns.

    Parameters
    ----------
    content : the file's bytes
    shown : how messages call the file

    Raises
    ------
    ScenarioProblems : no table, a missing, doubled or unknown column, a wrong unit, a cell that is no finite number
    """
    if len(content) > SIZE_LIMIT:
        raise ScenarioProblems(shown, [Problem(0, 0, "", f"expected at most {SIZE_LIMIT // 2**20} MiB")])
    numbered = read_rows(content, shown=shown)
    if len(numbered) < 2:
        got = "an empty file" if not numbered else "a header alone"
        raise ScenarioProblems(shown, [Problem(1, 1, "", f"expected a header and at least one row, got {got}")])
    (header_line, header), *rows = numbered
    layout, heads = _heads(header, shown=shown, line=header_line)
    cells, lines = _cells(rows, heads, shown=shown)
    columns = {
        head.name: Column(
            place, head.unit, dimensions_of(head.kind.unit) if head.kind else (),
            np.array(values if head.kind else [], dtype=np.float64), tuple(texts),
        )
        for place, (head, (values, texts)) in enumerate(zip(heads, cells, strict=True), start=1)
    }  # fmt: skip
    return OscillationTable(shown, layout, header_line, tuple(lines), columns)


@dataclass(frozen=True, slots=True)
class _Head:
    name: str
    kind: Unit | None  # None: a column of names
    factor: float = 1.0
    unit: str = ""


def _heads(header: list[str], *, shown: str, line: int) -> tuple[Layout, list[_Head]]:
    parts = [(HEADER.fullmatch(cell), cell) for cell in header]
    names = [" ".join((m[1] if m else cell).replace("_", " ").split()).casefold() for m, cell in parts]
    if len(header) == 1 and ";" in header[0]:
        raise ScenarioProblems(shown, [Problem(line, 1, "", "expected commas between the columns, got semicolons")])
    layout = _layout(names)
    known = COLUMNS[layout]
    heads: list[_Head] = []
    problems: list[Problem] = []
    for place, (name, (match, _)) in enumerate(zip(names, parts, strict=True), start=1):
        head = _Head(name, None)
        if name not in known:
            problems.append(Problem(line, place, name, f"unknown column{near_match(name, known)}"))
        elif name in names[: place - 1]:
            problems.append(Problem(line, place, name, "column given twice"))
        elif not known[name] and match is not None:
            problems.append(Problem(line, place, name, "expected a column of names, which has no unit"))
        elif known[name]:
            try:
                head = _with_unit(name, match[2] if match else "", known[name])
            except ValueError as error:
                problems.append(Problem(line, place, name, str(error)))
        heads.append(head)
    meant = {near for name in names if name not in known for near in get_close_matches(name, known, n=1, cutoff=0.6)}
    for name in NEEDED[layout]:
        if name not in names and name not in meant:  # a misspelt one is told once
            problems.append(Problem(line, 1, name, f'missing column; expected a column "{_example(name, known)}"'))
    if problems:
        raise ScenarioProblems(shown, problems)
    return layout, heads


def _layout(names: Iterable[str]) -> Layout:
    """By the column that only one layout has; a misspelt header goes where more of it is nearly known."""
    names = list(names)
    if "time" in names or "frequency" in names:
        return "time" if "time" in names else "frequency"

    def score(layout: Layout) -> int:
        return sum(bool(get_close_matches(name, COLUMNS[layout], n=1, cutoff=0.6)) for name in names)

    return "time" if score("time") > score("frequency") else "frequency"


def _example(name: str, known: dict[str, tuple[Unit, ...]]) -> str:
    kinds = known[name]
    return f"{name} [{kinds[0].example.split()[1]}]" if kinds else name


def _with_unit(name: str, unit: str, kinds: tuple[Unit, ...]) -> _Head:
    if not unit:
        raise ValueError(f'expected a unit in the header, for example "{name} [{kinds[0].example.split()[1]}]"')
    for kind in kinds[1:]:
        try:
            return _Head(name, kind, unit_factor(unit, kind=kind), unit)
        except ValueError:  # not this kind; the first one's message is the one to show
            continue
    return _Head(name, kinds[0], unit_factor(unit, kind=kinds[0]), unit)


def _cells(
    rows: list[tuple[int, list[str]]], heads: list[_Head], *, shown: str
) -> tuple[list[tuple[list[float], list[str]]], list[int]]:
    """Numbers (SI) and texts column by column, and the line of each row."""
    cells: list[tuple[list[float], list[str]]] = [([], []) for _ in heads]
    problems: list[Problem] = []
    for line, row in rows:
        if len(row) != len(heads):
            problems.append(Problem(line, 1, "", f"expected {len(heads)} cells as in the header, got {len(row)}"))
        else:
            for place, (head, cell, (values, texts)) in enumerate(zip(heads, row, cells, strict=True), start=1):
                fault = ""
                if head.kind is None:
                    texts.append(cell.strip(" \t\"'").casefold())
                    fault = "" if texts[-1] else "expected a name, got nothing"
                    if not texts[-1].isprintable() or len(texts[-1]) > _LONGEST_NAME:
                        fault = f"expected a name of at most {_LONGEST_NAME} letters in one line"
                elif not cell.strip() and head.name in MAY_BE_EMPTY:
                    values.append(math.nan)
                else:
                    value, fault = number(cell)
                    values.append(value * head.factor)
                    if value != 0.0 and not _LEAST <= abs(values[-1]) <= _MOST:
                        fault = f"expected zero or a size between {_LEAST:g} and {_MOST:g} in SI, got {cell.strip()}"
                if fault:
                    problems.append(Problem(line, place, head.name, fault))
        if len(problems) >= MOST_PROBLEMS:
            break
    if problems:
        raise ScenarioProblems(shown, problems)
    return cells, [line for line, _ in rows]
