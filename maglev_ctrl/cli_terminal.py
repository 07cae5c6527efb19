"""What every command shares on the terminal: exit status, interrupts, a console and a progress bar; rich comes late."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from rich.console import Console

PASSED, NOT_PASSED, BAD_INPUT, INTERRUPTED = 0, 1, 2, 130
UNDONE = "interrupted; nothing was written"


class Stopped(BaseException):
    """Ctrl-C, or a request to end; unlike KeyboardInterrupt it passes the command line library untouched."""

    def __init__(self, status: int = INTERRUPTED, message: str = UNDONE) -> None:
        super().__init__(message)
        self.status, self.message = status, message


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
