"""`maglev-ctrl simulate`: one option with its full force map; everything heavy is loaded inside."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from maglev_ctrl.cli_output import answer, manner, say_quietly, say_written
from maglev_ctrl.cli_terminal import NOT_PASSED, PASSED, Jobs, ScenarioFile, Stopped, console, progress

if TYPE_CHECKING:
    from maglev_ctrl.scenario import Scenario
    from maglev_ctrl.scenario.tuning_schema import Simulation
    from maglev_ctrl.study.nonlinear.records import SimulationStudy


def simulate(
    scenario: ScenarioFile,
    option: Annotated[
        str | None, typer.Option("--option", metavar="NAME", help="Which option; needed where there are several.")
    ] = None,
    duration: Annotated[
        str | None, typer.Option("--duration", metavar="TIME", help='Of one run, e.g. "20 s".  [default: the file\'s]')
    ] = None,
    runs: Annotated[
        int | None,
        typer.Option("--runs", metavar="N", min=2, max=200, help="How many guideways.  [default: the file's]"),
    ] = None,
    seed: Annotated[
        int | None, typer.Option("--seed", metavar="N", min=0, help="Of the first.  [default: the file's]")
    ] = None,
    speed: Annotated[
        str | None, typer.Option("--speed", metavar="SPEED", help='E.g. "400 km/h".  [default: the design speed]')
    ] = None,
    sampling_period: Annotated[
        str | None,
        typer.Option("--sampling-period", metavar="TIME", help='Of the law, e.g. "2 ms".  [default: the file\'s]'),
    ] = None,
    runs_only: Annotated[
        bool, typer.Option("--runs-only", help="Leave out boundaries, tongue and region of attraction.")
    ] = False,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", metavar="DIR", help="Folder for the results.  [default: out/NAME/simulate_OPTION]"),
    ] = None,
    jobs: Jobs = 2,
) -> None:
    """Simulate one option with its full force map and hold the linear theory against it.

    Writes simulation.html, simulation.pdf, simulation.json and trajectory.nc. A contact is a result: when, which
    magnet, how fast.
    """
    from maglev_ctrl.errors import ScenarioError
    from maglev_ctrl.report.folder import require_writable
    from maglev_ctrl.scenario import load
    from maglev_ctrl.scenario.units import ANY_SPEED
    from maglev_ctrl.study.nonlinear.survey import chosen_option, survey_simulation

    read = load(scenario)
    try:
        chosen = chosen_option(read, option)
        asked = _asked(read, duration=duration, runs=runs, seed=seed, sampling_period=sampling_period)
        at = None if speed is None else _value("--speed", ANY_SPEED.read, speed)
        if at is not None and at <= 0.0:
            raise ValueError(f'--speed: expected a speed above zero, got "{speed}"')
    except ValueError as error:
        raise ScenarioError(f"{scenario}: {error}") from None
    folder = out if out is not None else Path("out") / read.name / f"simulate_{chosen.name}"
    require_writable(folder, results="simulation")
    try:
        with progress(read.name) as tell:
            study = survey_simulation(
                read, chosen, asked, speed=at, everything=not runs_only, jobs=jobs, progress=tell
            )  # fmt: skip
            tell("writing the page and the files", 1.0)

            from maglev_ctrl.report.simulation import write_simulation

            paths = write_simulation(study, folder)
    except KeyboardInterrupt:
        raise Stopped() from None
    _print(study)
    say_quietly(_verdict(study))
    if manner().as_json:
        import json

        from maglev_ctrl.report.simulation.folder import json_text

        answer(json.loads(json_text(study)))
    say_written(paths)
    raise typer.Exit(PASSED if study.verdict.value == "PASS" else NOT_PASSED)


def _asked(
    read: Scenario, *, duration: str | None, runs: int | None, seed: int | None, sampling_period: str | None
) -> Simulation:
    """The file's [simulation], with what the command line says instead."""
    from maglev_ctrl.scenario.tuning_schema import Simulation
    from maglev_ctrl.scenario.units import POSITIVE_TIME

    base = read.simulation or Simulation()
    changed: dict[str, float | int] = {}
    for key, text in (("duration", duration), ("sampling_period", sampling_period)):
        if text is not None:
            changed[key] = _value(f"--{key.replace('_', '-')}", POSITIVE_TIME.read, text)
    changed |= {key: number for key, number in (("runs", runs), ("seed", seed)) if number is not None}
    made = base.model_copy(update=changed)
    if duration is not None and made.settle >= 0.5 * made.duration:
        made = made.model_copy(update={"settle": 0.2 * made.duration})
    return made


def _value(name: str, read: object, text: str) -> float:
    try:
        return float(read(text))  # type: ignore[operator]
    except ValueError as error:
        raise ValueError(f"{name}: {error}") from None


def _verdict(study: SimulationStudy) -> str:
    from maglev_ctrl.report.simulation.folder import verdict_words

    return verdict_words(study)


def _print(study: SimulationStudy) -> None:
    from rich.markup import escape
    from rich.table import Table

    screen = console()
    screen.print(f"[bold]{escape(study.title)}: {escape(study.label)}[/]")
    table = Table()
    for heading in ("number", "linear", "nonlinear", "band", "unit", "agreement"):
        table.add_column(heading, overflow="fold")
    for one in study.study.compared:
        table.add_row(
            escape(one.name), f"{one.linear:.4g}", f"{one.nonlinear:.4g}", f"{one.low:.4g} to {one.high:.4g}", one.unit,
            escape(one.agreement.value + (f": {one.reason}" if one.reason else "")),
        )  # fmt: skip
    screen.print(table)
    for event in study.study.events:
        speed = "" if event.value != event.value else f" at {event.value:.3g} m/s"
        screen.print(f"run {event.run + 1}, {event.time:.4g} s: {event.kind} of {escape(event.element)}{speed}")
    screen.print(escape(_verdict(study)))
