"""What every command shares on the terminal: exit status, interrupts, a console and a progress bar; rich comes late."""

from __future__ import annotations

import functools
import inspect
import math
import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, TextIO

import typer

from maglev_ctrl.cli_output import Manner, answer, answering, manner, say_quietly

if TYPE_CHECKING:
    from rich.console import Console

    from maglev_ctrl.report.model import Table
    from maglev_ctrl.scenario import Scenario

PASSED, NOT_PASSED, BAD_INPUT, INTERRUPTED, READER_GONE = 0, 1, 2, 130, 141
UNDONE = "interrupted; nothing was written"
VERDICT_STYLES: Final = {"PASS": "green", "FAIL": "red", "NOT EVALUATED": "yellow", "": "dim"}
"""Colours of verdicts in tables, "" where there is none."""
_SPARSE_SECONDS: Final = 10.0
_SPARSE_SHARE: Final = 0.1

ScenarioFile = Annotated[Path, typer.Argument(metavar="SCENARIO", help="Scenario file (TOML).", show_default=False)]
OutFolder = Annotated[
    Path | None, typer.Option("--out", "-o", metavar="DIR", help="Folder for the results.  [default: out/NAME]")
]
Jobs = Annotated[int, typer.Option("--jobs", "-j", metavar="N", min=1, max=256, help="Processes that share the work.")]
Options = Annotated[
    list[str] | None, typer.Option("--option", metavar="NAME", help="Only this option; may be repeated.")
]
AsJson = Annotated[bool, typer.Option("--json", help="Answer with one JSON document.")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="No tables, no progress.")]
Verbose = Annotated[bool, typer.Option("--verbose", "-v", help="Tell stages, versions, caches.")]


class Stopped(BaseException):
    """Ctrl-C, or a request to end; unlike KeyboardInterrupt it passes the command line library untouched."""

    def __init__(self, status: int = INTERRUPTED, message: str = UNDONE) -> None:
        super().__init__(message)
        self.status, self.message = status, message


def with_manner(function: Callable[..., None], verb: str) -> Callable[..., None]:
    """The same command with --json, --quiet and --verbose; a reader that goes away ends it without a word."""
    common = {"as_json": AsJson, "quiet": Quiet, "verbose": Verbose}

    @functools.wraps(function)
    def run(*arguments: Any, **options: Any) -> None:
        asked = Manner(*(bool(options.pop(name)) for name in common))
        try:
            with answering(verb, asked):
                function(*arguments, **options)
                sys.stdout.flush()
        except BrokenPipeError:
            raise Stopped(READER_GONE, "") from None
        except SystemExit as done:
            if isinstance(done.__context__, BrokenPipeError):  # how rich ends then
                raise Stopped(READER_GONE, "") from None
            raise

    signature = inspect.signature(function)
    extra = [
        inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=False, annotation=kind)
        for name, kind in common.items()
    ]
    hints = _annotations(function)
    own = [one.replace(annotation=hints[one.name]) for one in signature.parameters.values()]
    run.__signature__ = signature.replace(parameters=[*own, *extra])  # type: ignore[attr-defined]
    run.__annotations__ = {**hints, **common, "return": None}
    return run


def _annotations(function: Callable[..., None]) -> dict[str, Any]:
    return inspect.get_annotations(function, eval_str=True)


def on_terminal(stream: TextIO) -> bool:
    """Whether a person watches: a terminal that can move its cursor. FORCE_COLOR colours pipes, it moves nothing."""
    return stream.isatty() and os.environ.get("TERM", "") not in ("dumb", "unknown")


def console(*, stderr: bool = False) -> Console:
    """A console without guessed colours; it prints nothing where tables are not wanted.

    Colours: on terminals only, unless FORCE_COLOR is set; never with NO_COLOR or TERM=dumb.
    """
    from rich.console import Console

    stream = sys.stderr if stderr else sys.stdout
    plain = bool(os.environ.get("NO_COLOR")) or os.environ.get("TERM") in ("dumb", "unknown")
    silent = not stderr and (manner().quiet or manner().as_json)
    # Into a file or a pipe a table must not be folded at the 80 columns assumed there.
    width = None if stream.isatty() else 160
    return Console(
        stderr=stderr, highlight=False, width=width, quiet=silent, color_system=None if plain else "auto",
        force_terminal=None if stream.isatty() or os.environ.get("FORCE_COLOR") else False,
    )  # fmt: skip


@contextmanager
def progress(name: str) -> Iterator[Callable[[str, float], None]]:
    """What is being done, how much of it and how long it still takes, on the error stream.

    A bar that goes when done on a terminal; elsewhere lines, one every ten seconds or tenth of the work; nothing with
    --quiet; with --verbose every stage with the time since the start.
    """
    asked = manner()
    if asked.quiet:
        yield lambda message, fraction: None
    elif on_terminal(sys.stderr):
        with _bar(name, verbose=asked.verbose) as tell:
            yield tell
    else:
        yield _lines(verbose=asked.verbose)


@contextmanager
def _bar(name: str, *, verbose: bool) -> Iterator[Callable[[str, float], None]]:
    from rich.markup import escape
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
    from rich.table import Column

    words = Column(ratio=1, no_wrap=True, overflow="ellipsis")
    screen = console(stderr=True)
    with Progress(
        TextColumn("{task.description}", markup=False, table_column=words), BarColumn(bar_width=20),
        TextColumn("{task.percentage:>3.0f} %"), TimeElapsedColumn(), TextColumn("left"), TimeRemainingColumn(),
        console=screen, transient=True, expand=True,
    ) as bar:  # fmt: skip
        task, last, start = bar.add_task(name, total=1.0), "", time.perf_counter()

        def tell(message: str, fraction: float) -> None:
            nonlocal last
            bar.update(task, description=message, completed=fraction)
            if verbose and message != last:
                bar.console.print(f"{time.perf_counter() - start:8.2f} s  {escape(message)}")
            last = message

        yield tell


def _lines(*, verbose: bool) -> Callable[[str, float], None]:
    """Progress for a log: few lines, no carriage returns."""
    start = time.perf_counter()
    last, told_at, told_share, begun = "", -_SPARSE_SECONDS, -_SPARSE_SHARE, 0.0

    def tell(message: str, fraction: float) -> None:
        nonlocal last, told_at, told_share, begun
        elapsed = time.perf_counter() - start
        if fraction <= 0.0:
            begun = elapsed  # what comes before the work says nothing of how long it takes
        if verbose:
            if message != last:
                typer.echo(f"{elapsed:8.2f} s  {message}", err=True)
            last = message
            return
        due = elapsed - told_at >= _SPARSE_SECONDS or fraction - told_share >= _SPARSE_SHARE
        if not due and not (fraction >= 1.0 and message != last):
            return
        told_at, told_share, last = elapsed, fraction, message
        left = f", about {_span((elapsed - begun) * (1.0 / fraction - 1.0))} left" if 0.02 < fraction < 1.0 else ""
        typer.echo(f"{100.0 * fraction:3.0f} %  {message}  ({_span(elapsed)}{left})", err=True)

    return tell


def _span(seconds: float) -> str:
    if seconds >= 3600.0:
        return f"{seconds // 3600:.0f} h {seconds % 3600 // 60:.0f} min"
    return f"{seconds // 60:.0f} min {seconds % 60:.0f} s" if seconds >= 100.0 else f"{seconds:.0f} s"


def duration(seconds: float) -> str:
    """A time as people say it."""
    for unit, length in (("days", 86400.0), ("hours", 3600.0), ("minutes", 60.0)):
        if seconds >= 2.0 * length:
            return f"{seconds / length:.2g} {unit}" if seconds < 1e2 * length else f"{seconds / length:.0f} {unit}"
    return f"{seconds:.2g} seconds"


def print_quantities(read: Scenario) -> None:
    """Every quantity with its own value; written out plainly, so that names can be copied."""
    from rich.markup import escape
    from rich.table import Table

    from maglev_ctrl.scenario.quantity_paths import DEPTH, display_unit, scenario_quantities

    table = Table("quantity", "own value", "what it is")
    found = scenario_quantities(read)
    for quantity in found:
        unit, scale = display_unit(quantity, quantity.value)
        value = f"{quantity.value * scale:.6g} {unit}".rstrip()
        if math.isnan(quantity.value):
            value = "from the sources" if quantity.name == DEPTH else "not set"
        table.add_row(escape(quantity.name), value, escape(quantity.label))
    console().print(table)
    for quantity in found:
        say_quietly(quantity.name)
    answer({
        "quantities": [{"name": one.name, "label": one.label, "unit": one.unit, "value": one.value} for one in found]
    })  # fmt: skip


def print_table(shown: Table) -> None:
    """A table of a report on the terminal."""
    from rich import table as rich_table
    from rich.markup import escape

    made = rich_table.Table(title=escape(shown.caption), title_justify="left")
    for heading in shown.columns:
        made.add_column(escape(heading), overflow="fold")
    for cells in shown.rows:
        made.add_row(*(escape(cell.text) for cell in cells))
    console().print(made)
