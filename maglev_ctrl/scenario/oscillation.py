"""Forced-oscillation files gathered by force and motion, ready to be identified (Eqs. 6-9)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from maglev_ctrl.arrays import ComplexArray, FloatArray
from maglev_ctrl.forces.complex_stiffness import response_from_polar
from maglev_ctrl.forces.identification import Identification, identify_constants
from maglev_ctrl.forces.sine_fit import SineFit, first_uneven_step, fit_sine
from maglev_ctrl.scenario.oscillation_table import (
    MOST_PROBLEMS,
    SIZE_LIMIT,
    OscillationTable,
    read_oscillation_table,
)
from maglev_ctrl.scenario.problems import Problem, ScenarioProblems
from maglev_ctrl.scenario.units import Dimensions, dimensions_of

ROTATIONS = ("roll", "pitch", "yaw")
TRANSLATIONS = ("surge", "sway", "heave")
UNNAMED = "motion"
_UNITS = {
    dimensions_of("N/m"): ("N/m", "N*s/m", "kg"),
    dimensions_of("N"): ("N", "N*s", "kg*m"),
    dimensions_of("N*m"): ("N*m/rad", "N*m*s/rad", "kg*m^2"),
}
_WHOLE_TURN = 2.0 * math.pi * (1.0 + 1e-9)


@dataclass(frozen=True, eq=False, slots=True)
class RecordFit:
    """The sine fit of one record over time, its name, and where it begins."""

    name: str
    source: str
    fit: SineFit


@dataclass(frozen=True, eq=False, slots=True)
class OscillationSeries:
    """All that was measured of one force under one motion; `units` are those of k, c and m."""

    force: str
    motion: str
    units: tuple[str, str, str]
    frequency: FloatArray
    response: ComplexArray
    covariance: FloatArray | None
    degrees: float
    static: float | None
    static_error: float | None
    records: tuple[RecordFit, ...]
    notes: tuple[str, ...]

    @property
    def direct(self) -> bool:
        """Whether force and motion are along the same coordinate."""
        return self.force == self.motion

    def identify(self) -> Identification:
        """Constant m, c, k of this series, tested."""
        return identify_constants(
            self.frequency, self.response, covariance=self.covariance, degrees=self.degrees,
            static_stiffness=self.static, static_error=self.static_error,
        )  # fmt: skip


@dataclass(frozen=True, eq=False, slots=True)
class _Piece:
    """What one file says of one pair."""

    file: str
    line: int
    dimensions: Dimensions
    frequency: FloatArray
    response: ComplexArray
    covariance: FloatArray | None
    degrees: float
    static: float
    static_error: float
    static_line: int
    records: tuple[RecordFit, ...] = ()
    notes: tuple[str, ...] = ()


def read_oscillations(paths: Sequence[str | Path]) -> tuple[OscillationSeries, ...]:
    """Series of every force and motion in some files, in order of first appearance.

    Parameters
    ----------
    paths : CSV files, over frequency or over time

    Raises
    ------
    ScenarioProblems : every fault of a file with line and column, or files that contradict one another
    """
    pieces: dict[tuple[str, str], list[_Piece]] = {}
    seen: set[Path] = set()
    for path in paths:
        shown, file = str(path), Path(path)
        try:
            place = file.resolve()
        except RuntimeError:  # links that lead in a circle, up to Python 3.12
            raise ScenarioProblems(shown, [Problem(0, 0, "", "cannot be read: links that lead in a circle")]) from None
        if place in seen:
            raise ScenarioProblems(shown, [Problem(0, 0, "", "file given twice")])
        seen.add(place)
        if not file.is_file():
            got = "a folder" if file.is_dir() else "nothing"
            raise ScenarioProblems(shown, [Problem(0, 0, "", f"expected a CSV file, got {got}")])
        with file.open("rb") as stream:
            table = read_oscillation_table(stream.read(SIZE_LIMIT + 1), shown=shown)
        read = _over_frequency(table) if table.layout == "frequency" else _over_time(table)
        for pair, piece in read.items():
            pieces.setdefault(pair, []).append(piece)
    return tuple(_joined(pair, parts) for pair, parts in pieces.items())


def _pairs(table: OscillationTable, force: str, motion: str) -> dict[tuple[str, str], list[int]]:
    """Rows of every (force, motion)."""
    rows: dict[tuple[str, str], list[int]] = {}
    names = zip(table.texts(force, UNNAMED), table.texts(motion, UNNAMED), strict=True)
    for row, pair in enumerate(names):
        rows.setdefault(pair, []).append(row)
    return rows


def _over_frequency(table: OscillationTable) -> dict[tuple[str, str], _Piece]:
    columns = table.columns
    problems = _cell_faults(table) + _unit_faults(table, columns["amplitude"].dimensions)
    if ("amplitude error" in columns) != ("phase error" in columns):
        lone, other = ("amplitude", "phase") if "amplitude error" in columns else ("phase", "amplitude")
        message = f"expected {other} errors beside the {lone} errors, or neither"
        problems.append(Problem(table.header_line, columns[f"{lone} error"].place, f"{lone} error", message))
    _raise(table, problems)
    found = {}
    for pair, rows in _pairs(table, "force", "motion").items():
        problems += _pair_faults(table, pair, rows)
        static, static_error, static_row = _static(table, rows, problems)
        _raise(table, problems)
        dynamic = [row for row in rows if columns["frequency"].numbers[row] > 0.0]
        if not dynamic:
            _raise(table, [table.place(rows[0], "frequency", "expected a row above zero frequency for this pair")])
        errors = [columns[n].numbers[dynamic] if n in columns else None for n in ("amplitude error", "phase error")]
        response, covariance = response_from_polar(
            columns["amplitude"].numbers[dynamic], columns["phase"].numbers[dynamic],
            amplitude_error=errors[0], phase_error=errors[1],
        )  # fmt: skip
        found[pair] = _Piece(
            table.shown, table.lines[rows[0]], columns["amplitude"].dimensions, columns["frequency"].numbers[dynamic],
            response, covariance, math.inf, static, static_error, table.lines[static_row],
            notes=_small_phases(table, dynamic),
        )  # fmt: skip
    return found


def _cell_faults(table: OscillationTable) -> list[Problem]:
    """Signs and ranges, cell by cell."""
    columns, problems = table.columns, []
    for row in range(len(table.lines)):
        if columns["frequency"].numbers[row] < 0.0:
            problems.append(table.place(row, "frequency", "expected a value above zero, or 0 for a static stiffness"))
        if columns["amplitude"].numbers[row] < 0.0:
            message = "expected an amplitude of zero or more; a force against the displacement has a phase of 180 deg"
            problems.append(table.place(row, "amplitude", message))
        known = {problem.key for problem in problems}  # a wrong unit is wrong in every row: told once
        problems += [fault for fault in _phase_faults(table, row) if fault.key not in known]
        for name in ("amplitude error", "phase error"):
            if name in columns and columns[name].numbers[row] <= 0.0:
                problems.append(table.place(row, name, "expected a standard error above zero"))
        if (
            "amplitude error" in columns
            and columns["amplitude"].numbers[row] == 0.0 < columns["frequency"].numbers[row]
        ):
            problems.append(table.place(row, "amplitude", "expected a value above zero: zero has no phase to err in"))
        if len(problems) >= MOST_PROBLEMS:
            break
    return problems


def _phase_faults(table: OscillationTable, row: int) -> list[Problem]:
    problems = []
    phase, error = table.columns["phase"], table.columns.get("phase error")
    value = float(phase.numbers[row])
    if abs(value) > _WHOLE_TURN:
        message = f"expected a phase within one turn, got {value:.6g} rad ({math.degrees(value):.6g} deg)"
        if phase.unit.startswith("rad"):
            message = (
                f"expected radians, as the header says, within -2 pi ... 2 pi, got {value:.6g}; if these are degrees, "
                'write "phase [deg]" in the header'
            )
        problems.append(table.place(row, "phase", message))
    if error is not None and error.numbers[row] > 0.5 * math.pi:
        message = f"expected a phase error below a quarter of a turn, got {float(error.numbers[row]):.6g} rad"
        if error.unit.startswith("rad"):
            message += '; if these are degrees, write "phase error [deg]" in the header'
        problems.append(table.place(row, "phase error", message))
    return problems


def _pair_faults(table: OscillationTable, pair: tuple[str, str], rows: list[int]) -> list[Problem]:
    """Doubled frequencies, static rows with a phase, units that do not belong to the coordinates."""
    columns = table.columns
    problems = []
    wanted = _unit_of(pair)
    if wanted and columns["amplitude"].dimensions != dimensions_of(wanted):
        message = f"{pair[0]} by {pair[1]} is measured in {wanted}, the header says {columns['amplitude'].unit}"
        problems.append(table.place(rows[0], "amplitude", message + "; give it a file of its own"))
    first: dict[float, int] = {}
    for row in rows:
        frequency = float(columns["frequency"].numbers[row])
        at = float(f"{frequency:.9g}")
        if at in first:
            message = (
                f"{pair[0]} by {pair[1]} has this frequency on line {first[at]} already; put repeats in another file"
            )
            problems.append(table.place(row, "frequency", message))
        first.setdefault(at, table.lines[row])
        if frequency == 0.0 and abs(math.sin(columns["phase"].numbers[row])) > 1e-6:
            problems.append(table.place(row, "phase", "expected 0 or 180 deg at zero frequency (a static stiffness)"))
    return problems


def _unit_of(pair: tuple[str, str]) -> str:
    """Unit of the stiffness where both coordinates are known by name."""
    if any(name not in ROTATIONS + TRANSLATIONS for name in pair):
        return ""
    return ("N/m", "N", "N*m")[sum(name in ROTATIONS for name in pair)]


def _static(table: OscillationTable, rows: list[int], problems: list[Problem]) -> tuple[float, float, int]:
    """Static stiffness of a pair, its standard error (NaN = none) and the row it stands in."""
    columns = table.columns
    value, error, place = math.nan, math.nan, rows[0]
    column, spread = columns.get("static stiffness"), columns.get("static stiffness error")
    if column is not None:
        given = [row for row in rows if not math.isnan(column.numbers[row])]
        for row in given:
            if column.numbers[row] != column.numbers[given[0]] or (
                spread is not None and not _same(float(spread.numbers[row]), float(spread.numbers[given[0]]))
            ):
                message = f"expected one value for a force and motion, as on line {table.lines[given[0]]}"
                problems.append(table.place(row, "static stiffness", message))
                break
        if given:
            place, value = given[0], float(column.numbers[given[0]])
            error = math.nan if spread is None else float(spread.numbers[place])
            if error <= 0.0:
                problems.append(table.place(place, "static stiffness error", "expected a standard error above zero"))
    elif spread is not None:
        problems.append(Problem(table.header_line, spread.place, "static stiffness error", "without static stiffness"))
    if table.layout == "frequency":
        for row in rows:
            if columns["frequency"].numbers[row] == 0.0:
                if not math.isnan(value):
                    message = "expected one static stiffness, got a row at zero frequency and a column"
                    problems.append(table.place(row, "frequency", message))
                value = float(columns["amplitude"].numbers[row] * math.cos(columns["phase"].numbers[row]))
                place = row
                error = float(columns["amplitude error"].numbers[row]) if "amplitude error" in columns else math.nan
    needs = table.layout == "time" or "amplitude error" in columns
    if needs and not math.isnan(value) and math.isnan(error):
        message = 'expected a standard error beside it, in a column "static stiffness error [N/m]"'
        problems.append(table.place(place, "static stiffness", message))
    return value, error, place


def _unit_faults(table: OscillationTable, dimensions: Dimensions) -> list[Problem]:
    """Columns that measure the same thing must do so in units of one kind."""
    return [
        Problem(table.header_line, column.place, name, f"{column.unit} does not fit the other columns' units")
        for name, column in table.columns.items()
        if name in ("amplitude error", "static stiffness", "static stiffness error") and column.dimensions != dimensions
    ]


def _same(one: float, other: float) -> bool:
    return one == other or (math.isnan(one) and math.isnan(other))


def _small_phases(table: OscillationTable, rows: list[int]) -> tuple[str, ...]:
    phase = table.columns["phase"]
    largest = float(np.max(np.abs(phase.numbers[rows])))
    if phase.unit.startswith("deg") and 0.0 < math.degrees(largest) <= math.pi:
        return (f"every phase is within {math.degrees(largest):.3g} deg of zero: if these are radians, write [rad]",)
    return ()


def _over_time(table: OscillationTable) -> dict[tuple[str, str], _Piece]:
    dimensions = _stiffness_dimensions(table)
    problems = _unit_faults(table, dimensions)
    found = {}
    for pair, rows in _pairs(table, "force name", "motion name").items():
        wanted = _unit_of(pair)
        if wanted and dimensions != dimensions_of(wanted):
            message = f"{pair[0]} by {pair[1]} is measured in {wanted}, force and displacement are in other units"
            problems.append(table.place(rows[0], "displacement", message))
        records: dict[str, list[int]] = {}
        names = table.texts("record", "1")
        for row in rows:
            records.setdefault(names[row], []).append(row)
        fits = [fit for name, part in records.items() if (fit := _record(table, name, part, problems)) is not None]
        static, static_error, static_row = _static(table, rows, problems)
        if not fits:
            continue
        found[pair] = _Piece(
            table.shown, table.lines[rows[0]], dimensions, np.array([r.fit.frequency for r in fits]),
            np.array([r.fit.response for r in fits]), np.stack([r.fit.covariance for r in fits]),
            min(r.fit.degrees for r in fits), static, static_error, table.lines[static_row], tuple(fits),
            tuple(f"{r.source}: {note}" for r in fits for note in r.fit.notes),
        )  # fmt: skip
    _raise(table, problems)
    return found


def _stiffness_dimensions(table: OscillationTable) -> Dimensions:
    """Dimensions of force by displacement; an angle has none."""
    return next(
        kind for kind in _UNITS
        if kind == _quotient(table.columns["force"].dimensions, table.columns["displacement"].dimensions)
    )  # fmt: skip


def _quotient(top: Dimensions, bottom: Dimensions) -> Dimensions:
    powers = dict(top)
    for name, power in bottom:
        powers[name] = powers.get(name, 0.0) - power
    return tuple(sorted((name, power) for name, power in powers.items() if power))


def _record(table: OscillationTable, name: str, rows: list[int], problems: list[Problem]) -> RecordFit | None:
    columns = table.columns
    time = columns["time"].numbers[rows]
    place = first_uneven_step(time) if time.size > 2 else None
    if place is not None:
        backwards = np.flatnonzero(np.diff(time) < 0.0)  # a row out of place leaves a gap before it: name the row
        place = int(backwards[0]) + 1 if backwards.size else place
        step = float(time[place] - time[place - 1])
        why = "time runs backwards" if step < 0.0 else "the same time again" if step == 0.0 else "a sample is missing"
        if 0.0 < step < float(np.median(np.diff(time))):
            why = "the step is shorter"
        message = f"expected even steps of {float(np.median(np.diff(time))):.6g} s, got {step:.6g} s: {why}"
        problems.append(table.place(rows[place], "time", message))
        return None
    try:
        fit = fit_sine(time, columns["displacement"].numbers[rows], columns["force"].numbers[rows])
    except ValueError as error:
        key, _, message = str(error).partition(": ")
        label = f'record "{name}": ' if "record" in columns else ""
        problems.append(table.place(rows[0], key, label + message))
        return None
    source = f"{table.shown}:{table.lines[rows[0]]}"
    return RecordFit(name, source, fit)


def _raise(table: OscillationTable, problems: list[Problem]) -> None:
    if problems:
        raise ScenarioProblems(table.shown, problems)


def _joined(pair: tuple[str, str], parts: list[_Piece]) -> OscillationSeries:
    """The parts of one pair from several files; they must not contradict one another."""
    head = parts[0]
    label = f"{pair[0]} by {pair[1]}"
    for part in parts[1:]:
        if part.dimensions != head.dimensions:
            message = f"{label} is in other units than in {head.file}"
        elif (part.covariance is None) != (head.covariance is None):
            message = f"{label} has errors here or in {head.file} but not in both; give all or none"
        else:
            continue
        raise ScenarioProblems(part.file, [Problem(part.line, 1, "", message)])
    known = [part for part in parts if not math.isnan(part.static)]
    for part in known[1:]:
        if part.static != known[0].static or not _same(part.static_error, known[0].static_error):
            message = f"{label} has another static stiffness in {known[0].file}"
            raise ScenarioProblems(part.file, [Problem(part.static_line, 1, "static stiffness", message)])
    if head.covariance is not None and known and math.isnan(known[0].static_error):
        message = 'expected a standard error beside it, in a column "static stiffness error [N/m]"'
        raise ScenarioProblems(known[0].file, [Problem(known[0].static_line, 1, "static stiffness", message)])
    given = [part.covariance for part in parts if part.covariance is not None]
    static, static_error = (known[0].static, known[0].static_error) if known else (None, math.nan)
    return OscillationSeries(
        force=pair[0], motion=pair[1], units=_UNITS[head.dimensions],
        frequency=np.concatenate([p.frequency for p in parts]), response=np.concatenate([p.response for p in parts]),
        covariance=np.concatenate(given) if given else None,
        degrees=min(p.degrees for p in parts),
        static=static, static_error=None if math.isnan(static_error) else static_error,
        records=tuple(record for p in parts for record in p.records),
        notes=tuple(note for p in parts for note in p.notes),
    )  # fmt: skip
