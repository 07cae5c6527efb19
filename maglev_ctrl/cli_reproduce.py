"""`maglev-ctrl reproduce`: the whole paper from geometry alone; everything heavy is loaded inside the command."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer

ALL_RESOLVED, SOMETHING_UNRESOLVED = 0, 1


def reproduce(
    out: Annotated[
        Path, typer.Option("--out", "-o", metavar="DIR", help="Folder for the page, its JSON and its data.")
    ] = Path("out/reproduction"),
    jobs: Annotated[int, typer.Option("--jobs", "-j", min=1, max=256, help="Processes that share the work.")] = 2,
    quick: Annotated[bool, typer.Option("--quick", help="Leave the sensitivity to the assumptions out.")] = False,
) -> None:
    """Compute every figure and table of the paper from geometry alone and judge every claim.

    Writes reproduction.html, reproduction.json and reproduction_data/*.csv, which replace earlier ones as a whole.
    Exit status 1 when a claim stays UNRESOLVED: two ways to its numbers disagree.
    """
    from maglev_ctrl.report.paper.files import require_writable, write_reproduction
    from maglev_ctrl.study.paper.cases import eddy_current
    from maglev_ctrl.study.paper.records import ClaimVerdict
    from maglev_ctrl.study.paper.run import reproduce as run

    require_writable(out)
    with _progress() as tell:
        found = run(eddy_current, quick=quick, jobs=jobs, progress=tell)
    paths = write_reproduction(found, out)
    counts = Counter(claim.verdict for claim in found.claims)
    for verdict in ClaimVerdict:
        if counts[verdict]:
            typer.echo(f"{counts[verdict]:3d}  {verdict.value}")
    for claim in found.claims:
        if claim.verdict is ClaimVerdict.UNRESOLVED:
            typer.echo(f"UNRESOLVED: {claim.key}: {claim.why}")
    for note in found.notes:
        typer.echo(note)
    for path in paths:
        typer.echo(f"written: {path}")
    raise typer.Exit(SOMETHING_UNRESOLVED if counts[ClaimVerdict.UNRESOLVED] else ALL_RESOLVED)


@contextmanager
def _progress() -> Iterator[Callable[[str, float], None]]:
    """What is being done, on the error stream: a bar on a terminal, lines elsewhere."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    console = Console(stderr=True, highlight=False)
    columns = (
        TextColumn("{task.description}"), BarColumn(), TextColumn("{task.percentage:>3.0f} %"), TimeElapsedColumn(),
    )  # fmt: skip
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task("reproduce", total=1.0)

        def tell(message: str, fraction: float) -> None:
            bar.update(task, description=message, completed=fraction)
            if not console.is_terminal:
                typer.echo(f"{100.0 * fraction:3.0f} %  {message}", err=True)

        yield tell
