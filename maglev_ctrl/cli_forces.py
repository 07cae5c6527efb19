"""`maglev-ctrl forces`: the forces of a scenario's magnets; everything heavy is loaded inside the command."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from maglev_ctrl.cli_terminal import console, progress

if TYPE_CHECKING:
    from maglev_ctrl.study.force_survey import ForceSurvey


class AccuracyWord(StrEnum):
    """How finely a guideway is solved."""

    draft = "draft"
    standard = "standard"
    reference = "reference"


def forces(
    scenario: Annotated[Path, typer.Argument(metavar="SCENARIO", help="Scenario file (TOML).", show_default=False)],
    out: Annotated[
        Path | None, typer.Option("--out", "-o", metavar="DIR", help="Folder for the results.  [default: out/NAME]")
    ] = None,
    jobs: Annotated[int, typer.Option("--jobs", "-j", min=1, max=256, help="Processes that share the work.")] = 2,
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
    with progress(read.name, time_left=True) as tell:
        found = survey(read, accuracy=None if accuracy is None else accuracy.value, jobs=jobs, progress=tell)
    paths = write_forces(found, folder)
    _print(found)
    for path in paths:
        typer.echo(f"written: {path}")


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
