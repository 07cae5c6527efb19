"""What every command shares on the terminal: a console and a progress bar, loaded only when used."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from rich.console import Console


def console(*, stderr: bool = False) -> Console:
    """A console without guessed colours."""
    from rich.console import Console

    found = Console(stderr=stderr, highlight=False)
    # Into a file or a pipe a table must not be folded at the 80 columns assumed there.
    return found if found.is_terminal else Console(stderr=stderr, highlight=False, width=160)


@contextmanager
def progress(name: str, *, time_left: bool = False) -> Iterator[Callable[[str, float], None]]:
    """What is being done and how much of it, on the error stream: a bar on a terminal, lines elsewhere.

    Parameters
    ----------
    time_left : for work of many small steps: show how long it still takes, and tell each step's name in a line once
    """
    from rich.progress import BarColumn, Progress, ProgressColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn

    columns: list[ProgressColumn] = [
        TextColumn("{task.description}"), BarColumn(), TextColumn("{task.percentage:>3.0f} %"), TimeElapsedColumn(),
    ]  # fmt: skip
    if time_left:
        columns += [TextColumn("left"), TimeRemainingColumn()]
    screen = console(stderr=True)
    with Progress(*columns, console=screen, transient=True, disable=not screen.is_terminal) as bar:
        task, last = bar.add_task(name, total=1.0), ""

        def tell(message: str, fraction: float) -> None:
            nonlocal last
            bar.update(task, description=message, completed=fraction)
            if not screen.is_terminal and not (time_left and message == last):
                typer.echo(f"{100.0 * fraction:3.0f} %  {message}", err=True)
            last = message

        yield tell
