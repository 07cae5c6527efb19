"""The verb `identify`: forced-oscillation data in, m, c, k with their uncertainty out."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from maglev_ctrl.cli_output import answer, manner, say_quietly, say_written
from maglev_ctrl.cli_terminal import NOT_PASSED, console

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.table import Table

    from maglev_ctrl.report.identification_values import Result


def identify(
    files: Annotated[list[Path], typer.Argument(metavar="FILE...", help="Data (CSV).", show_default=False)],
    out: Annotated[
        Path | None, typer.Option("--out", "-o", metavar="DIR", help="Folder for identify.html, .csv and .json.")
    ] = None,
) -> None:
    """Find m, c, k from forced oscillations, with 95 % intervals; says whether they are constant at all.

    Data are amplitude and phase over frequency, or displacement and force over time; several files are put together.
    """
    from maglev_ctrl.errors import ScenarioError
    from maglev_ctrl.report.identification_values import Result
    from maglev_ctrl.scenario.oscillation import read_oscillations

    if out is not None:
        from maglev_ctrl.report.folder import require_writable

        require_writable(out, results="results")
    results = []
    for series in read_oscillations(files):
        try:
            results.append(Result(series, series.identify()))
        except ValueError as error:
            raise ScenarioError(f"{files[0]}: {series.force} by {series.motion}: {error}") from None
    _print(results)
    for result in results:
        say_quietly(f"{result.label}: {result.words()[0]}")
    if manner().as_json:
        import hashlib
        import json

        from maglev_ctrl.report.identification_values import to_json

        digests = {str(file): hashlib.sha256(file.read_bytes()).hexdigest() for file in files}
        answer(json.loads(to_json(results, files=digests)))
    if out is not None:
        from maglev_ctrl.report.identification import write_identification

        say_written(write_identification(results, out, files=files))
    if not all(result.identified for result in results):
        raise typer.Exit(NOT_PASSED)


def _by_frequency(result: Result) -> Table:
    """What was measured at each frequency, which holds where constants do not."""
    from rich.table import Table

    from maglev_ctrl.report.identification_values import frequency_columns, frequency_rows

    table = Table()
    for heading in frequency_columns(result):
        table.add_column(heading, justify="right")
    for row in frequency_rows(result):
        table.add_row(*row)
    return table


def _print(results: Sequence[Result]) -> None:
    from rich.markup import escape
    from rich.table import Table

    from maglev_ctrl.report.identification_values import SIGNS, interval_words, opposite, value_words
    from maglev_ctrl.report.style import ABSENT

    screen = console()
    table = Table()
    for heading in ("force by motion", "", "value ± 95 %", "95 % interval", "unit", "left-hand side", "why not"):
        right = heading in ("value ± 95 %", "95 % interval", "left-hand side")
        table.add_column(heading, overflow="fold", justify="right" if right else "left")
    for result in results:
        for place, (symbol, unit, estimate) in enumerate(result.quantities()):
            turned = value_words(opposite(estimate)) if len(symbol) == 1 else ABSENT
            table.add_row(
                escape(result.label) if place == 0 else "", symbol, value_words(estimate), interval_words(estimate),
                unit, turned, escape(estimate.reason), end_section=place == len(result.quantities()) - 1,
            )  # fmt: skip
    screen.print(table)
    for result in results:
        verdict, *words = result.words()
        colour = "green" if result.identified else "yellow"
        screen.print(f"[bold]{escape(result.label)}[/]: [{colour}]{escape(verdict)}[/]")
        for sentence in words:
            screen.print(f"  - {escape(sentence)}")
        if not result.identified:
            screen.print(_by_frequency(result))
    screen.print(escape(SIGNS))
