"""`maglev-ctrl map`: where a vehicle is stable over any two quantities; everything heavy is loaded inside."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from maglev_ctrl.cli_output import answer, manner, say_quietly, say_written
from maglev_ctrl.cli_terminal import (
    NOT_PASSED,
    Jobs,
    Options,
    OutFolder,
    ScenarioFile,
    Stopped,
    console,
    duration,
    print_quantities,
    print_table,
    progress,
)  # fmt: skip

if TYPE_CHECKING:
    from maglev_ctrl.scenario import Scenario
    from maglev_ctrl.study.map.records import MapStudy, OptionMap
    from maglev_ctrl.study.map.request import MapRequest
    from maglev_ctrl.study.map.store import MapFolder

MANY_POINTS = 20_000_000
"""Points, options counted, from which on --yes is asked for."""


class BackendWord(StrEnum):
    """What computes the multipliers."""

    numpy = "numpy"
    fast = "fast"
    gpu = "gpu"


class CoverageWord(StrEnum):
    """Which points are computed."""

    auto = "auto"
    every = "every"
    adaptive = "adaptive"


def stability_map(
    scenario: ScenarioFile,
    x: Annotated[
        str | None, typer.Option("--x", metavar="Q=FROM:TO:COUNT", help="A quantity and its range.  [default: speed]")
    ] = None,
    y: Annotated[
        str | None, typer.Option("--y", metavar="Q=FROM:TO:COUNT", help="Another one.  [default: depth]")
    ] = None,
    option: Options = None,
    out: OutFolder = None,
    jobs: Jobs = 2,
    yes: Annotated[bool, typer.Option("--yes", help="Compute maps of more than 20 million points.")] = False,
    backend: Annotated[BackendWord, typer.Option("--backend", help="What computes the multipliers.")] = (
        BackendWord.numpy
    ),
    coverage: Annotated[CoverageWord, typer.Option("--coverage", help="Which points are computed.")] = (
        CoverageWord.auto
    ),
    periodic_law: Annotated[
        bool, typer.Option("--periodic-law", help="Also design a periodic law for each option and map it.")
    ] = False,
    map_only: Annotated[
        bool, typer.Option("--map-only", help="Leave out tongues, speed ranges and margins, which take longer.")
    ] = False,
    merge_delays: Annotated[
        bool, typer.Option("--merge-delays", help="Delay and bandwidth of an actuator as one lag: faster, not exact.")
    ] = False,
    list_quantities: Annotated[
        bool, typer.Option("--list-quantities", help="Show what --x and --y can be; nothing is computed.")
    ] = False,
) -> None:
    """Map where each option is stable over any two quantities, with every resonance tongue named.

    Writes map.html, map.pdf, map.nc, map.json and ranges.csv. An interrupted map goes on where it was when the same
    command is given again.
    """
    from maglev_ctrl.scenario import load

    read = load(scenario)
    if list_quantities:
        print_quantities(read)
        return

    from maglev_ctrl.errors import ScenarioError
    from maglev_ctrl.report.folder import require_writable
    from maglev_ctrl.study.map.request import map_request
    from maglev_ctrl.study.map.store import MapFolder

    try:
        request = map_request(
            read, x=x, y=y, options=option or (), backend=backend.value, coverage=coverage.value,
            periodic_law=periodic_law, tables=not map_only, merge_delays=merge_delays,
        )  # fmt: skip
    except ValueError as error:
        raise ScenarioError(f"{scenario}: {error}") from None
    folder = out if out is not None else Path("out") / read.name
    require_writable(folder, results="maps")
    if request.points > MANY_POINTS and not yes:
        raise ScenarioError(_many(read, request, jobs))
    _map_and_write(read, request, folder, MapFolder.of(folder, read, request), jobs)


def _map_and_write(read: Scenario, request: MapRequest, folder: Path, kept: MapFolder, jobs: int) -> None:
    from maglev_ctrl.report.map import write_map
    from maglev_ctrl.study.map.run import survey_map

    try:
        with progress(read.name) as tell:
            study = survey_map(read, request, jobs=jobs, progress=tell, store_folder=folder)
        paths = write_map(study, folder)
    except KeyboardInterrupt:
        raise _interrupted(Stopped(), kept) from None
    except Stopped as stop:
        raise _interrupted(stop, kept) from None
    try:
        kept.remove()
        _print(study)
        for option in study.options:
            say_quietly(f"{option.label}: {_in_short(option)}")
        if manner().as_json:
            import json

            from maglev_ctrl.report.map.data import json_text

            answer(json.loads(json_text(study)))
        say_written(paths)
    except Stopped as stop:
        raise Stopped(stop.status, f"interrupted; the maps were written: {folder}") from None
    raise typer.Exit(_exit_code(study))


def _interrupted(stop: Stopped, kept: MapFolder) -> Stopped:
    """The interrupt with what is kept."""
    if not kept.root.exists():
        return stop
    share = f"{100.0 * kept.reached():.0f} %"
    return Stopped(stop.status, f"interrupted; {share} is kept in {kept.root}; the same command goes on from there")


def _in_short(option: OptionMap) -> str:
    """One option's map in a line."""
    from maglev_ctrl.analysis.plane_records import UNRESOLVED, UNSTABLE

    if option.plane is None:
        return option.failure or "no map"
    doubt = option.plane.share(UNRESOLVED)
    return f"unstable {100.0 * option.plane.share(UNSTABLE):.4g} %, UNRESOLVED {100.0 * doubt:.4g} %"


def _exit_code(study: MapStudy) -> int:
    from maglev_ctrl.analysis.plane_records import UNRESOLVED

    maps = [option.plane for option in study.options]
    decided = all(plane is not None and not plane.share(UNRESOLVED) for plane in maps)
    return 0 if decided else NOT_PASSED


def _many(read: Scenario, request: MapRequest, jobs: int) -> str:
    """What a large map would take, in a sentence."""
    from maglev_ctrl.study.map.run import survey_estimate

    found, points = survey_estimate(read, request, jobs=jobs), f"{request.points:,}".replace(",", " ")
    return (
        f"the maps have {points} points: about {duration(found.seconds)} and {_size(found.bytes)} of memory; ask for "
        "fewer points, or add --yes"
    )


def _size(count: float) -> str:
    return f"{count / 2**30:.3g} GiB" if count >= 2**30 else f"{count / 2**20:.3g} MiB"


def _print(study: MapStudy) -> None:
    from rich.markup import escape

    from maglev_ctrl.report.map.content import comparison_table

    screen = console()
    screen.print(f"[bold]{escape(study.title)}[/]")
    print_table(comparison_table(study))
    for words in study.notes:
        screen.print(f"- {escape(words)}")
    for option in study.options:
        for words in (option.failure, *option.notes):
            if words:
                screen.print(f"- {escape(option.label)}: {escape(words)}")
