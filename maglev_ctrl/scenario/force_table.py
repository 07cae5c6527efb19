"""Reading a force table: CSV with units in the header, SI arrays out."""

from __future__ import annotations

import math
from dataclasses import dataclass

from maglev_ctrl.arrays import FloatArray, read_only
from maglev_ctrl.scenario.csv_table import HEADER, number, read_rows
from maglev_ctrl.scenario.problems import Problem, ScenarioProblems, near_match
from maglev_ctrl.scenario.units import Unit, unit_factor

SIZE_LIMIT = 16 * 2**20
_NEWTON = Unit("a force", "N", "10 kN")
_METRE = Unit("a length", "m", "20 mm")
COLUMNS = {
    "height": _METRE, "gap": _METRE, "speed": Unit("a speed", "m/s", "30 m/s"),
    "lift": _NEWTON, "guidance": _NEWTON, "drag": _NEWTON,
}  # fmt: skip
_OPTIONAL = ("gap", "guidance")


@dataclass(frozen=True, eq=False, slots=True)
class ForceSamples:
    """Samples of one magnet's forces, (N,) each, SI; gap and guidance are None where the table leaves them out."""

    height: FloatArray
    gap: FloatArray | None
    speed: FloatArray
    lift: FloatArray
    guidance: FloatArray | None
    drag: FloatArray


def read_force_table(content: bytes, *, shown: str) -> ForceSamples:
    """Samples of a CSV table.

    Parameters
    ----------
    content : the file's bytes
    shown : how messages call the file

    Raises
    ------
    ScenarioProblems : a missing, doubled or unknown column, a header without a unit, a cell that is no finite number
    """
    numbered = read_rows(content, shown=shown)
    if len(numbered) < 2:
        raise ScenarioProblems(shown, [Problem(1, 1, "", "expected a header and at least one row of numbers")])
    (header_line, header), *rows = numbered
    names, factors = _columns(header, shown=shown, line=header_line)
    columns: dict[str, list[float]] = {name: [] for name in names}
    problems: list[Problem] = []
    for line, cells in rows:
        if len(cells) != len(names):
            problems.append(Problem(line, 1, "", f"expected {len(names)} cells as in the header, got {len(cells)}"))
            continue
        for name, factor, cell in zip(names, factors, cells, strict=True):
            value, fault = number(cell)
            columns[name].append(value * factor)
            if not math.isfinite(value * factor):
                fault = f"expected a number that is finite in SI, got {cell.strip()}"
            if fault:
                problems.append(Problem(line, 1 + names.index(name), name, fault))
        if len(problems) >= 20:
            break
    if problems:
        raise ScenarioProblems(shown, problems)
    arrays = {name: read_only(values, name=name) for name, values in columns.items()}
    return ForceSamples(
        height=arrays["height"], gap=arrays.get("gap"), speed=arrays["speed"],
        lift=arrays["lift"], guidance=arrays.get("guidance"), drag=arrays["drag"],
    )  # fmt: skip


def _columns(header: list[str], *, shown: str, line: int) -> tuple[list[str], list[float]]:
    names: list[str] = []
    factors: list[float] = []
    problems: list[Problem] = []
    for column, cell in enumerate(header, start=1):
        match = HEADER.fullmatch(cell)
        name = (match[1] if match else cell).strip().casefold()
        if name not in COLUMNS:
            problems.append(Problem(line, column, name, f"unknown column{near_match(name, COLUMNS)}"))
        elif name in names:
            problems.append(Problem(line, column, name, "column given twice"))
        elif match is None:
            example = COLUMNS[name].example.split()[1]
            problems.append(
                Problem(line, column, name, f'expected a unit in the header, for example "{name} [{example}]"')
            )
        else:
            try:
                factors.append(unit_factor(match[2], kind=COLUMNS[name]))
            except ValueError as error:
                problems.append(Problem(line, column, name, str(error)))
        names.append(name)
    for name in COLUMNS:
        # gap and guidance belong together: a table has both or neither
        needed = name not in _OPTIONAL or any(other in names for other in _OPTIONAL)
        if name not in names and needed:
            example = COLUMNS[name].example.split()[1]
            problems.append(Problem(line, 1, name, f'missing column; expected a column "{name} [{example}]"'))
    if problems:
        raise ScenarioProblems(shown, problems)
    return names, factors
