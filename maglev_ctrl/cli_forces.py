"""`maglev-ctrl forces`: the forces of a scenario's magnets; everything heavy is loaded inside the command."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from maglev_ctrl.cli_output import answer, manner, say_written
from maglev_ctrl.cli_terminal import Jobs, OutFolder, ScenarioFile, console, progress

if TYPE_CHECKING:
    from maglev_ctrl.study.force_survey import ForceSurvey


class AccuracyWord(StrEnum):
    """How finely a guideway is solved."""

    draft = "draft"
    standard = "standard"
    reference = "reference"


def forces(
    scenario: ScenarioFile,
    out: OutFolder = None,
    jobs: Jobs = 2,
    accuracy: Annotated[
        AccuracyWord | None, typer.Option("--accuracy", "-a", help="Of eddy-current forces, instead of the file's.")
    ] = None,
) -> None:
    """Compute lift, guidance, drag, stiffness and damping of a scenario's magnets over height, gap and speed.

    Writes forces.html, forces.nc and forces.csv (a force table that `model = "table"` reads).
    """
    from maglev_ctrl.report.folder import require_writable
    from maglev_ctrl.report.force_survey import write_forces
    from maglev_ctrl.scenario import load
    from maglev_ctrl.study.force_survey import survey

    read = load(scenario)
    folder = out if out is not None else Path("out") / read.name
    require_writable(folder)
    with progress(read.name) as tell:
        found = survey(read, accuracy=None if accuracy is None else accuracy.value, jobs=jobs, progress=tell)
    paths = write_forces(found, folder)
    _print(found)
    if manner().as_json:
        answer(_body(found))
    say_written(paths)


def _body(found: ForceSurvey) -> dict[str, Any]:
    """The design point in SI units; the grid stands in the files."""
    from maglev_ctrl.report.force_survey import accuracy_words
    from maglev_ctrl.report.serialise import plain

    return {
        "scenario": found.name, "title": found.title, "model": found.model, "scenario_hash": found.scenario_hash,
        "height": _quantity(found.height, "m"), "gap": _quantity(found.gap, "m"),
        "speed": _quantity(found.speed, "m/s"), "forces": plain(found.forces),
        "drag_peak": _quantity(found.drag_peak, "m/s"), "heave_damping": _quantity(found.heave_damping, "N s/m"),
        "heave_changes": _quantity(list(found.heave_changes), "m/s"), "torque": _quantity(found.torque, "N m"),
        "relative_error": found.error, "facts": found.facts, "accuracy": accuracy_words(found),
        "assumptions": found.assumptions,
    }  # fmt: skip


def _quantity(value: float | list[float] | None, unit: str) -> dict[str, Any] | None:
    return None if value is None else {"value": value, "unit": unit}


def _print(found: ForceSurvey) -> None:
    from rich.markup import escape
    from rich.table import Table

    from maglev_ctrl.report.force_survey import accuracy_words, damping_words, design_rows

    screen = console()
    screen.print(f"[bold]{escape(found.title)}[/]")
    table = Table("one magnet", "value")
    for name, value in design_rows(found):
        table.add_row(escape(name), escape(value))
    screen.print(table)
    for words in (*found.facts, *accuracy_words(found)):
        screen.print(f"- {escape(words)}")
    if found.assumptions:
        screen.print("assumed:")
    for words in found.assumptions:
        screen.print(f"- {escape(words)}")
    if damping_words(found):
        screen.print(f"[bold]{escape(damping_words(found))}[/]")
