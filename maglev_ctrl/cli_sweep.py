"""`maglev-ctrl sweep`: every option at many points, here or on a cluster; everything heavy is loaded inside."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from maglev_ctrl.cli_output import answer, manner, say_quietly, say_written
from maglev_ctrl.cli_terminal import (
    NOT_PASSED,
    PASSED,
    Options,
    OutFolder,
    ScenarioFile,
    Stopped,
    console,
    duration,
    print_quantities,
    print_table,
    progress,
)

if TYPE_CHECKING:
    from maglev_ctrl.scenario import Scenario
    from maglev_ctrl.study.sweep.records import SweepStudy
    from maglev_ctrl.study.sweep.request import SweepRequest

MANY_POINTS = 5_000_000
"""Points, options counted, from which on --yes is asked for."""


class MethodWord(StrEnum):
    """How points are drawn."""

    latin = "latin"
    random = "random"


def sweep(
    scenario: ScenarioFile,
    grid: Annotated[
        list[str] | None,
        typer.Option("--grid", metavar="Q=FROM:TO:COUNT", help="A quantity and its steps; repeatable."),
    ] = None,
    vary: Annotated[
        list[str] | None,
        typer.Option("--vary", metavar="Q=FROM:TO", help="Drawn instead; or Q=MEAN~DEVIATION; repeatable."),
    ] = None,
    points: Annotated[int | None, typer.Option("--points", metavar="N", min=1, help="Points that are drawn.")] = None,
    method: Annotated[MethodWord | None, typer.Option("--method", help="How they are drawn.  [default: latin]")] = None,
    seed: Annotated[
        int | None, typer.Option("--seed", metavar="N", min=0, help="Of what is drawn.  [default: 0]")
    ] = None,
    compute: Annotated[
        list[str] | None,
        typer.Option(
            "--compute",
            metavar="PART,...",
            help="modes, floquet, margins, requirements.  [default: modes, and floquet where it applies]",
        ),
    ] = None,
    option: Options = None,
    out: OutFolder = None,
    jobs: Annotated[
        int | None,
        typer.Option("--jobs", "-j", metavar="N", min=1, max=256, help="Processes that share the work.  [default: 2]"),
    ] = None,
    cluster: Annotated[
        str | None,
        typer.Option("--cluster", metavar="ADDRESS", help="A Dask scheduler, tcp://HOST:PORT, instead of --jobs."),
    ] = None,
    block: Annotated[
        int | None,
        typer.Option("--block", metavar="N", min=1, help="Points of a block.  [default: about 0.7 s of work]"),
    ] = None,
    restart: Annotated[bool, typer.Option("--restart", help="Throw the part of an interrupted sweep away.")] = False,
    yes: Annotated[bool, typer.Option("--yes", help="Compute sweeps of more than 5 million points.")] = False,
    list_quantities: Annotated[
        bool, typer.Option("--list-quantities", help="Show what can be varied; nothing is computed.")
    ] = False,
) -> None:
    """Compute stability of each option at many points, and margins and requirements if asked: a grid, or a sample.

    Writes sweep.html, sweep.nc and sweep.json. An interrupted sweep goes on where it was when the same command is given
    again; a point that cannot be computed is told with its reason.
    """
    from maglev_ctrl.scenario import load

    read = load(scenario)
    if list_quantities:
        print_quantities(read)
        return

    from maglev_ctrl.errors import ScenarioError
    from maglev_ctrl.report.folder import require_writable
    from maglev_ctrl.study.sweep.request import sweep_request
    from maglev_ctrl.study.sweep.store import require_libraries

    try:
        request = sweep_request(
            read, grid=grid or (), vary=vary or (), points=points,
            method=None if method is None else method.value, seed=seed,
            options=option or (), parts=[part.strip() for text in compute or () for part in text.split(",")],
        )  # fmt: skip
    except ValueError as error:
        raise ScenarioError(f"{scenario}: {error}") from None
    require_libraries(*(("distributed",) if cluster else ()))
    if cluster is not None and "://" not in cluster:
        raise ScenarioError(f'--cluster: expected an address such as tcp://127.0.0.1:8786, got "{cluster}"')
    if cluster is not None and jobs is not None:
        raise ScenarioError("--jobs: has no meaning with --cluster, whose workers share the work; give one of them")
    jobs = jobs or 2
    folder = out if out is not None else Path("out") / read.name / "sweep"
    require_writable(folder, results="sweep")
    if request.points * len(request.options) > MANY_POINTS and not yes:
        raise ScenarioError(_many(read, request, jobs))
    _run(read, request, folder, jobs=jobs, cluster=cluster or "", block=block, restart=restart)


def _run(
    read: Scenario, request: SweepRequest, folder: Path, *, jobs: int, cluster: str, block: int | None, restart: bool
) -> None:
    from maglev_ctrl.errors import ModelError
    from maglev_ctrl.report.sweep import write_sweep
    from maglev_ctrl.study.sweep.run import no_answer, run_sweep
    from maglev_ctrl.study.sweep.store import STORE, alone, remove_store

    reached = 0.0
    try:
        with alone(folder):
            if restart:
                remove_store(folder)
            with progress(read.name) as tell:

                def told(what: str, fraction: float) -> None:
                    nonlocal reached
                    reached = fraction
                    tell(what, fraction)

                study, store = run_sweep(
                    read, request, folder, jobs=jobs, cluster=cluster, block=block, progress=told
                )  # fmt: skip
                nothing = no_answer(study)
                if nothing:
                    remove_store(folder)
                    raise ModelError(nothing)
                told("writing the page and the files", 1.0)
                paths = write_sweep(study, store, folder)
            remove_store(folder)
    except (KeyboardInterrupt, Stopped) as stop:
        ended = stop if isinstance(stop, Stopped) else Stopped()
        if not (folder / STORE).exists():
            raise ended from None
        share = f"{100.0 * reached:.0f} %"
        raise Stopped(
            ended.status, f"interrupted; {share} is kept in {folder / STORE}; the same command goes on from there"
        ) from None
    _print(study)
    if manner().as_json:
        import json

        from maglev_ctrl.report.sweep.folder import json_text

        answer(json.loads(json_text(study)))
    say_written(paths)
    raise typer.Exit(_exit_code(study))


def _exit_code(study: SweepStudy) -> int:
    """0 where every point of every option has an answer."""
    decided = all(
        not states.get("unresolved") and not states.get("no_answer")
        for option in study.options for states in (option.states, option.modulated or {})
    )  # fmt: skip
    return PASSED if decided else NOT_PASSED


def _many(read: Scenario, request: SweepRequest, jobs: int) -> str:
    """What a large sweep would take, in a sentence."""
    from maglev_ctrl.study.run import with_forces
    from maglev_ctrl.study.sweep.block import seconds_per_point

    solved, _ = with_forces(read, jobs, lambda what, fraction: None)
    seconds = seconds_per_point(solved, request) * request.points / jobs
    return (
        f"the sweep has {request.points:,} points: about {duration(seconds)} on {jobs} process(es); ask for fewer "
        "points, or add --yes"
    ).replace(",", " ", 3)


def _print(study: SweepStudy) -> None:
    from rich.markup import escape

    from maglev_ctrl.report.sweep.content import counts_table, remarks_table, verdict_table
    from maglev_ctrl.report.sweep.digest import share_words

    screen = console()
    screen.print(f"[bold]{escape(study.title)}[/]")
    found = [counts_table(study), remarks_table(study)]
    if any(option.verdicts is not None for option in study.options):
        found.insert(1, verdict_table(study))
    for one in found:
        if one is None:
            continue
        print_table(one)
    for words in study.notes:
        screen.print(f"- {escape(words)}")
    for option in study.options:
        say_quietly(f"{option.label}: {share_words(option, study.request.points)}")
