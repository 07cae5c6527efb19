"""The verbs `report` and `compare`: the whole study of a scenario; everything heavy is loaded inside."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, NoReturn, cast

import typer

from maglev_ctrl.cli_output import answer, manner, say_quietly, say_written
from maglev_ctrl.cli_terminal import (
    NOT_PASSED,
    PASSED,
    VERDICT_STYLES,
    Jobs,
    OutFolder,
    ScenarioFile,
    Stopped,
    console,
    progress,
)

if TYPE_CHECKING:
    from rich.console import Console

    from maglev_ctrl.scenario import Scenario
    from maglev_ctrl.study import Comparison, OptionStudy, RequirementResult
    from maglev_ctrl.study.tuning.records import TuningStudy

_FORMATS = ("html", "pdf", "json", "md")
_PLACED = ("gap_used", "stroke_used", "contact_probability", "force_used", "weighted_acceleration")
"""Quantities of which one magnet, stroke, actuator or passenger decides: it is named with the value."""


def report(
    scenario: ScenarioFile,
    out: OutFolder = None,
    jobs: Jobs = 2,
    formats: Annotated[
        str, typer.Option("--format", "-f", help="Any of html, pdf, json, md, by commas.")
    ] = "html,pdf,json",
) -> None:
    """Run the whole study of a scenario and write its report, which replaces an earlier one as a whole.

    With --json the answer has the verdict and every requirement of every option under the names of report.json.
    """
    from maglev_ctrl.scenario import load

    _study_and_write(load(scenario), out, jobs=jobs, formats=_formats(formats))


def compare(
    scenario: ScenarioFile,
    out: OutFolder = None,
    jobs: Jobs = 2,
    formats: Annotated[
        str, typer.Option("--format", "-f", help="Any of html, pdf, json, md, by commas.")
    ] = "html,json",
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


def _formats(text: str) -> tuple[Literal["html", "pdf", "json", "md"], ...]:
    names = tuple(dict.fromkeys(part.strip().lower() for part in text.split(",") if part.strip()))
    unknown = [name for name in names if name not in _FORMATS]
    if unknown or not names:
        got = repr(unknown[0]) if unknown else "nothing"
        raise typer.BadParameter(f"expected any of html, pdf, json, md, by commas, got {got}", param_hint="--format")
    return cast("tuple[Literal['html', 'pdf', 'json', 'md'], ...]", names)


def _study_and_write(
    scenario: Scenario,
    out: Path | None,
    *,
    jobs: int,
    formats: tuple[Literal["html", "pdf", "json", "md"], ...],
    values: bool = False,
    tuned: bool = False,
) -> NoReturn:
    """Study, write, print; exit status by verdict."""
    from maglev_ctrl.report.folder import require_writable

    folder = out if out is not None else Path("out") / scenario.name
    require_writable(folder, results="report")
    try:
        with progress(scenario.name) as tell:
            comparison = _run(scenario, jobs=jobs, tuned=tuned, tell=tell)
            tell("writing the report", 1.0)

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
        for option in comparison.options:
            say_quietly(f"{option.label}: {option.verdict.value}")
        if manner().as_json:
            answer(_body(comparison))
        say_written(paths)
    except Stopped as stop:
        raise Stopped(stop.status, f"interrupted; the report was written: {folder}") from None
    raise typer.Exit(_exit_code(comparison))


def _run(scenario: Scenario, *, jobs: int, tuned: bool, tell: Callable[[str, float], None]) -> Comparison:
    from maglev_ctrl import study

    if not tuned or scenario.tuning is None:
        return study.run(scenario, jobs=jobs, progress=tell)
    from maglev_ctrl.study.compare import compare as compare_options

    return compare_options(scenario, jobs=jobs, progress=tell)


def _body(comparison: Comparison) -> dict[str, Any]:
    """The verdicts under the names that report.json has."""
    from maglev_ctrl.report.serialise import plain

    body: dict[str, Any] = {
        "title": comparison.title, "scenario_hash": comparison.scenario_hash,
        "verdict": comparison.verdict.value,
        "options": [
            {"name": option.name, "label": option.label, "kind": option.kind, "verdict": option.verdict.value,
             "failure": option.failure, "requirements": plain(option.requirements)}
            for option in comparison.options
        ],
    }  # fmt: skip
    if comparison.tuning is not None:
        body["ranking"] = plain(comparison.tuning.ranking)
    return body


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
            escape(option.label), option.kind, f"[{VERDICT_STYLES[verdict]}]{verdict}[/]", escape(_why(option))
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
    return f"{escape(value)}[{VERDICT_STYLES[verdict]}]{verdict}[/]{wish}"


def _exit_code(comparison: Comparison) -> int:
    return PASSED if comparison.verdict.value == "PASS" else NOT_PASSED
