"""The command line: `maglev-ctrl report SCENARIO`. Everything heavy is loaded inside the command that needs it."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Annotated, Literal, NoReturn, cast

import typer

from maglev_ctrl.cli_design import design, export, verify
from maglev_ctrl.cli_diff import diff
from maglev_ctrl.cli_forces import forces
from maglev_ctrl.cli_identify import identify
from maglev_ctrl.cli_map import stability_map
from maglev_ctrl.cli_reproduce import reproduce
from maglev_ctrl.cli_simulate import simulate
from maglev_ctrl.cli_terminal import BAD_INPUT, NOT_PASSED, PASSED, Stopped, console, progress
from maglev_ctrl.cli_ui import ui

if TYPE_CHECKING:
    from rich.console import Console

    from maglev_ctrl.scenario import Scenario
    from maglev_ctrl.study import Comparison, OptionStudy, RequirementResult
    from maglev_ctrl.study.tuning.records import TuningStudy

_FORMATS = ("html", "pdf", "json")
_PLACED = ("gap_used", "stroke_used", "contact_probability", "force_used", "weighted_acceleration")
"""Quantities of which one magnet, stroke, actuator or passenger decides: it is named with the value."""
_STYLES = {"PASS": "green", "FAIL": "red", "NOT EVALUATED": "yellow"}

app = typer.Typer(
    name="maglev-ctrl",
    help="Stability of maglev vehicles: compare suspension options and report their margins.",
    epilog="Exit status: 0 every requirement passes, 1 some fail or could not be evaluated, 2 wrong input.",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,  # rich would double the time `--help` takes
    pretty_exceptions_enable=False,
)

ScenarioFile = Annotated[Path, typer.Argument(metavar="SCENARIO", help="Scenario file (TOML).", show_default=False)]
OutFolder = Annotated[
    Path | None, typer.Option("--out", "-o", metavar="DIR", help="Folder for the results.  [default: out/NAME]")
]
Jobs = Annotated[int, typer.Option("--jobs", "-j", min=1, max=256, help="Processes that share the work.")]


@app.command()
def report(
    scenario: ScenarioFile,
    out: OutFolder = None,
    jobs: Jobs = 2,
    formats: Annotated[
        str, typer.Option("--format", "-f", help="Any of html, pdf, json, by commas.")
    ] = "html,pdf,json",
) -> None:
    """Run the whole study of a scenario and write its report, which replaces an earlier one as a whole."""
    from maglev_ctrl.scenario import load

    _study_and_write(load(scenario), out, jobs=jobs, formats=_formats(formats))


@app.command()
def compare(
    scenario: ScenarioFile,
    out: OutFolder = None,
    jobs: Jobs = 2,
    formats: Annotated[str, typer.Option("--format", "-f", help="Any of html, pdf, json, by commas.")] = "html,json",
    as_written: Annotated[
        bool, typer.Option("--as-written", help="Leave the options as they are written; nothing is tuned.")
    ] = False,
) -> None:
    """Tune the options where the scenario says how, run the whole study on them, rank them, show them side by side.

    Writes report.html, report.json and, where something was tuned, tuned.toml: the scenario with the values chosen. An
    earlier report in the folder is replaced as a whole, its PDF included: it would contradict the new one.
    """
    from maglev_ctrl.scenario import load

    _study_and_write(
        load(scenario), out, jobs=jobs, formats=_formats(formats), values=True, tuned=not as_written
    )  # fmt: skip


app.command()(design)
app.command()(export)
app.command()(verify)
app.command()(diff)
app.command()(forces)
app.command()(identify)
app.command(name="map")(stability_map)
app.command()(reproduce)
app.command()(simulate)
app.command()(ui)


@app.command()
def check(
    files: Annotated[list[Path], typer.Argument(metavar="FILE...", help="Scenario files.", show_default=False)],
) -> None:
    """Say what is wrong with scenario files, with line and column; nothing is computed."""
    from maglev_ctrl.errors import MaglevError
    from maglev_ctrl.scenario import load
    from maglev_ctrl.scenario.tunes import tuned_quantities

    wrong = 0
    for file in files:
        try:
            scenario = load(file)
            for option in scenario.options:
                tuned_quantities(scenario, option)  # `load` reads what may be tuned, this looks it up
        except MaglevError as error:
            _complain(str(error))
            wrong += 1
        else:
            options, requirements = len(scenario.options), len(scenario.judged)
            typer.echo(f"{file}: valid; {options} option(s), {requirements} requirement(s)")
    if wrong:
        raise typer.Exit(BAD_INPUT)


@app.command()
def new(
    name: Annotated[str, typer.Argument(metavar="NAME", help="Name of the scenario.", show_default=False)],
    out: Annotated[
        Path, typer.Option("--out", "-o", metavar="DIR", help="Folder for the file, made if need be.")
    ] = Path(),
) -> None:
    """Write NAME.toml, a commented scenario to start from; an existing file is never touched."""
    from maglev_ctrl.scenario.starter import starter_text

    file = out / (name if name.endswith(".toml") else f"{name}.toml")
    title = file.stem.replace("_", " ").replace("-", " ").strip()
    if not title:
        raise typer.BadParameter(f"expected a name, got {name!r}")
    try:
        out.mkdir(parents=True, exist_ok=True)
        with file.open("x", encoding="utf-8", newline="\n") as stream:
            stream.write(starter_text(title[:1].upper() + title[1:]))
    except FileExistsError:
        _complain(f"{file}: there is a file of this name already; choose another name or delete it")
        raise typer.Exit(BAD_INPUT) from None
    except FileNotFoundError:
        _complain(f"{file}: the folder {file.parent} does not exist; make it first")
        raise typer.Exit(BAD_INPUT) from None
    # dev.py says how it was called: in a fresh clone there is no maglev-ctrl on PATH.
    command = os.environ.get("MAGLEV_CTRL_COMMAND", "maglev-ctrl")
    steps = "\n         ".join(f"{command} {verb} {file}" for verb in ("check", "report", "design"))
    typer.echo(f"written: {file}\nnext:    {steps}")


@app.command()
def schema(
    out: Annotated[
        Path | None, typer.Option("--out", "-o", metavar="DIR", help="Folder for scenario.schema.json; else printed.")
    ] = None,
) -> None:
    """The scenario format as a JSON Schema, for editors that complete and check as you type."""
    import json

    from maglev_ctrl.scenario import json_schema

    text = json.dumps(json_schema(), indent=2, ensure_ascii=False)
    if out is None:
        typer.echo(text)
        return
    out.mkdir(parents=True, exist_ok=True)
    file = out / "scenario.schema.json"
    file.write_text(text + "\n", encoding="utf-8", newline="\n")
    typer.echo(f"written: {file}")


@app.command()
def version() -> None:
    """Print the version."""
    from maglev_ctrl import __version__

    typer.echo(f"maglev-ctrl {__version__}")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command line (default: this process's) and return its exit status; faults end in one message, no traceback.

    Examples
    --------
    >>> main(["version"])
    maglev-ctrl ...
    0
    """
    from maglev_ctrl.errors import MaglevError

    try:
        with _stop_on_signals():
            app(args=None if arguments is None else list(arguments), prog_name="maglev-ctrl")
    except SystemExit as done:  # how typer ends every command, wrong usage included
        return done.code if isinstance(done.code, int) else PASSED
    except MaglevError as error:
        _complain(str(error))
    except Stopped as stop:
        _complain(stop.message)
        return stop.status
    except OSError as error:
        _complain(f"{error.filename or 'file'}: {error.strerror or error}")
    return BAD_INPUT


@contextmanager
def _stop_on_signals() -> Iterator[None]:
    """SIGINT and SIGTERM raise Stopped, so that workers end and temporary files go; handlers are put back after."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def stop(number: int, frame: FrameType | None) -> None:
        raise Stopped(128 + number)  # 130 and 143, as shells have it

    before = {number: signal.signal(number, stop) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _complain(message: str) -> None:
    typer.echo(message, err=True)


def _formats(text: str) -> tuple[Literal["html", "pdf", "json"], ...]:
    names = tuple(dict.fromkeys(part.strip().lower() for part in text.split(",") if part.strip()))
    unknown = [name for name in names if name not in _FORMATS]
    if unknown or not names:
        got = repr(unknown[0]) if unknown else "nothing"
        raise typer.BadParameter(f"expected any of html, pdf, json, by commas, got {got}", param_hint="--format")
    return cast("tuple[Literal['html', 'pdf', 'json'], ...]", names)


def _study_and_write(
    scenario: Scenario,
    out: Path | None,
    *,
    jobs: int,
    formats: tuple[Literal["html", "pdf", "json"], ...],
    values: bool = False,
    tuned: bool = False,
) -> NoReturn:
    """Study, write, print; exit status by verdict."""
    from maglev_ctrl.report.folder import require_writable

    folder = out if out is not None else Path("out") / scenario.name
    require_writable(folder, results="report")
    try:
        comparison = _run(scenario, jobs=jobs, tuned=tuned)

        from maglev_ctrl.report import write

        paths = write(comparison, folder, formats=formats)
    except KeyboardInterrupt:
        raise Stopped() from None
    try:
        screen = console()
        if values:
            _print_values(screen, comparison)
        if comparison.tuning is not None:
            _print_ranking(screen, comparison.tuning)
        _print_verdicts(screen, comparison)
        for path in paths:
            typer.echo(f"written: {path}")
    except Stopped as stop:
        raise Stopped(stop.status, f"interrupted; the report was written: {folder}") from None
    raise typer.Exit(_exit_code(comparison))


def _run(scenario: Scenario, *, jobs: int, tuned: bool) -> Comparison:
    """The study, with its progress on the terminal's error stream."""
    from maglev_ctrl import study

    with progress(scenario.name, time_left=tuned and scenario.tuning is not None) as tell:
        if not tuned or scenario.tuning is None:
            return study.run(scenario, jobs=jobs, progress=tell)
        from maglev_ctrl.study.compare import compare as compare_options

        return compare_options(scenario, jobs=jobs, progress=tell)


def _print_ranking(screen: Console, tuning: TuningStudy) -> None:
    """Who is first, and what was chosen for each."""
    from rich.markup import escape
    from rich.table import Table

    table = Table(title="Ranking of the tuned options")
    for heading in ("place", "option", "misses", "chosen values"):
        table.add_column(heading, overflow="fold")
    found = {option.option: option for option in tuning.options}
    for ranked in tuning.ranking:
        variables = found[ranked.option].variables
        chosen = "; ".join(f"{one.name} {one.text}" + (" (at its bound)" if one.at_bound else "") for one in variables)
        table.add_row(str(ranked.place), escape(ranked.label), escape(", ".join(ranked.misses)), escape(chosen))
    screen.print(table)


def _print_verdicts(screen: Console, comparison: Comparison) -> None:
    from rich.markup import escape
    from rich.table import Table

    screen.print(f"[bold]{escape(comparison.title)}[/]")
    table = Table()
    for heading in ("option", "kind", "verdict", "why"):
        table.add_column(heading, overflow="fold")
    for option in comparison.options:
        verdict = option.verdict.value
        table.add_row(
            escape(option.label), option.kind, f"[{_STYLES[verdict]}]{verdict}[/]", escape(_why(option))
        )  # fmt: skip
    screen.print(table)


def _why(option: OptionStudy) -> str:
    """What keeps an option from passing, in a line."""
    if option.failure:
        return option.failure
    if not option.requirements:
        return "the scenario sets no requirements"
    missed = [result for result in option.requirements if result.verdict.value != "PASS" and result.hard]
    names: dict[str, list[str]] = {}  # what is said of several requirements alike is said once
    for result in missed:
        names.setdefault(_shown(result), []).append(result.name)
    return "; ".join(f"{', '.join(alike)} {said}" for said, alike in names.items())


def _shown(result: RequirementResult) -> str:
    if result.verdict.value == "NOT EVALUATED":
        return f"not evaluated ({result.reason})" if result.reason else "not evaluated"
    sign = ">=" if result.sense == "at_least" else "<="
    unit = f" {result.unit}" if result.unit else ""
    where = f" at {result.worst_at}" if result.quantity in _PLACED else ""
    return f"{result.value:.4g}{unit} (needs {sign} {result.limit:.4g}{unit}){where}"


def _print_values(screen: Console, comparison: Comparison) -> None:
    """One row per requirement, one column per option."""
    from rich.markup import escape
    from rich.table import Table

    table = Table()
    table.add_column("requirement", overflow="fold")
    for option in comparison.options:
        table.add_column(escape(option.label), overflow="fold")
    names = dict.fromkeys(result.name for option in comparison.options for result in option.requirements)
    for name in names:
        cells = []
        for option in comparison.options:
            result = next((r for r in option.requirements if r.name == name), None)
            cells.append("" if result is None else _cell(result))
        table.add_row(name, *cells)
    screen.print(table)


def _cell(result: RequirementResult) -> str:
    from rich.markup import escape

    verdict = result.verdict.value
    value = "" if verdict == "NOT EVALUATED" else f"{result.value:.4g} {result.unit}".rstrip() + " "
    wish = "" if result.hard else " (a wish)"
    return f"{escape(value)}[{_STYLES[verdict]}]{verdict}[/]{wish}"


def _exit_code(comparison: Comparison) -> int:
    return PASSED if comparison.verdict.value == "PASS" else NOT_PASSED


if __name__ == "__main__":
    sys.exit(main())
