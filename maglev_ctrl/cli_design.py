"""The verbs `design`, `export` and `verify`: laws made, proved, written down, and proved again from the file alone."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from maglev_ctrl.cli_output import answer, say, say_quietly, say_written
from maglev_ctrl.cli_terminal import (
    NOT_PASSED,
    PASSED,
    VERDICT_STYLES,
    Jobs,
    Options,
    OutFolder,
    ScenarioFile,
    Stopped,
    console,
    progress,
)  # fmt: skip

if TYPE_CHECKING:
    from maglev_ctrl.study.design.records import DesignStudy


class Target(StrEnum):
    """What a design is exported to."""

    mat = "mat"
    json = "json"
    c = "c"
    python = "python"


def design(
    scenario: ScenarioFile,
    option: Options = None,
    out: OutFolder = None,
    jobs: Jobs = 2,
) -> None:
    """Design the control law of every option, prove it without trusting the solver, and export it.

    Writes design.html, design.pdf, design.json (self-contained, for `verify` and `export`) and the folder export with
    MATLAB, C, Python and JSON files.
    """
    from maglev_ctrl.errors import ScenarioError
    from maglev_ctrl.report.folder import require_writable
    from maglev_ctrl.scenario import load
    from maglev_ctrl.study.design.run import chosen_options, survey_design

    read = load(scenario)
    try:
        chosen = chosen_options(read, option or ())
    except ValueError as error:
        raise ScenarioError(f"{scenario}: {error}") from None
    folder = out if out is not None else Path("out") / read.name
    require_writable(folder, results="designs")
    try:
        with progress(read.name) as tell:
            study = survey_design(read, chosen, jobs=jobs, progress=tell)
            tell("writing the page and the files", 1.0)

            from maglev_ctrl.report.design import write_design

            paths = write_design(study, folder)
    except KeyboardInterrupt:
        raise Stopped() from None
    try:
        _print(study)
        for one in study.options:
            say_quietly(f"{one.label}: {one.verdict.value}")
        answer(_body(study))
        say_written(paths)
    except Stopped as stop:
        raise Stopped(stop.status, f"interrupted; the designs were written: {folder}") from None
    raise typer.Exit(PASSED if study.verdict.value == "PASS" else NOT_PASSED)


def export(
    file: Annotated[Path, typer.Argument(metavar="DESIGN.json", help="Made by `design`.", show_default=False)],
    to: Annotated[Target, typer.Option("--to", help="What to write.")],
    option: Annotated[
        str | None, typer.Option("--option", metavar="NAME", help="Which design, where the file holds several.")
    ] = None,
    period: Annotated[
        str | None,
        typer.Option("--period", metavar="TIME", help='Sampling period, e.g. "2 ms".  [default: that of the design]'),
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", metavar="DIR", help="Folder for the files.  [default: beside FILE]")
    ] = None,
) -> None:
    """Write a design's controller for MATLAB, C, Python or as JSON, with the source that made it.

    The design is proved again first; one that is not proved is not exported. C and sampled JSON need a sampling period.
    """
    from maglev_ctrl.errors import ModelError
    from maglev_ctrl.report.design.exports import export_design
    from maglev_ctrl.report.folder import require_writable, write_whole
    from maglev_ctrl.scenario.units import Unit
    from maglev_ctrl.study.design.document import changed_since, load_designs, pick, prove_again

    found = pick(load_designs(file), option, file=file)
    seconds = None
    if period is not None:
        try:
            seconds = Unit("a time", "s", "2 ms", "positive").read(period)
        except ValueError as error:
            raise ModelError(f"--period: {error}") from None
    again = prove_again(found)
    if not again.proved:
        why = [*(proof.statement for proof in again.proofs if not proof.holds), *again.doubts]
        raise ModelError(f"{file}: {found.name} is not proved and is not exported: {why[0]}")
    changed = changed_since(file)
    if changed:
        raise ModelError(f"{file}: nothing is exported: {changed}")
    folder = out if out is not None else file.parent
    require_writable(folder, results="exports")
    try:
        made = export_design(found, to.value, period=seconds)
    except ValueError as error:
        raise ModelError(f"{file}: {error}") from None
    paths = write_whole(made, folder)
    answer({"design": found.name, "to": to.value})
    say_written(paths)


def verify(
    file: Annotated[Path, typer.Argument(metavar="DESIGN.json", help="Made by `design`.", show_default=False)],
) -> None:
    """Prove every claim of a design file again, from the file alone and without a solver.

    Every plant and every law the file holds must be spoken of by a claim of stability, and sampled laws must be what
    sampling makes of the proved ones. Other texts and numbers of the file (names of laws, performance, notes) prove
    nothing; a digest tells whether the file is as it was written.
    """
    from rich.markup import escape
    from rich.table import Table

    from maglev_ctrl.study.design.document import changed_since, load_designs, prove_again

    screen, proved = console(), True
    told: list[dict[str, Any]] = []
    for found in load_designs(file):
        again = prove_again(found)
        table = Table(title=f"{found.name}: {found.law}", title_justify="left")
        for heading in ("claim", "of", "proved", "margin", "by"):
            table.add_column(heading, overflow="fold")
        for proof, place in zip(again.proofs, again.places, strict=True):
            word = "[green]yes[/]" if proof.holds else f"[red]no[/]: {escape(proof.reason)}"
            table.add_row(escape(proof.statement), escape(place), word, f"{proof.margin:.3g}", escape(proof.method))
        proved = proved and again.proved
        told.append({
            "name": found.name, "law": found.law, "proved": again.proved, "doubts": again.doubts,
            "claims": [
                {"claim": proof.statement, "of": place, "proved": proof.holds, "margin": proof.margin,
                 "by": proof.method, "reason": proof.reason}
                for proof, place in zip(again.proofs, again.places, strict=True)
            ],
        })  # fmt: skip
        screen.print(table)
        for doubt in again.doubts:
            say(f"{found.name}: {doubt}")
    changed = changed_since(file)
    if changed:
        say(f"{file}: {changed}")
    proved = proved and not changed
    answer({"file": str(file), "proved": proved, "changed": changed, "designs": told})
    say("proved" if proved else "NOT PROVED")
    raise typer.Exit(PASSED if proved else NOT_PASSED)


def _body(study: DesignStudy) -> dict[str, Any]:
    """Every law with what is proved of it; the laws themselves stand in design.json."""
    return {
        "scenario": study.name, "title": study.title, "scenario_hash": study.scenario_hash,
        "verdict": study.verdict.value,
        "options": [
            {"name": one.name, "label": one.label, "kind": one.kind, "law": one.law, "verdict": one.verdict.value,
             "failure": one.failure, "delays": one.delays,
             "claims": [] if one.synthesis is None else [
                 {"claim": proof.statement, "proved": proof.holds, "margin": proof.margin, "by": proof.method,
                  "reason": proof.reason}
                 for proof in one.synthesis.proofs
             ]}
            for one in study.options
        ],
    }  # fmt: skip


def _print(study: DesignStudy) -> None:
    from rich.markup import escape
    from rich.table import Table

    from maglev_ctrl.report.design.content import THIN_GAIN, THIN_PHASE
    from maglev_ctrl.report.design.tables import smallest_margins
    from maglev_ctrl.report.design.words import claim_units, claims_in_short

    screen = console()
    screen.print(f"[bold]{escape(study.title)}[/]")
    table = Table(show_lines=True)
    table.add_column("option", overflow="fold", max_width=36)
    table.add_column("verdict", overflow="fold", max_width=9)
    table.add_column("what is proved", overflow="fold")
    for option in study.options:
        verdict = option.verdict.value
        law = option.law.partition("; acceptable")[0]
        name = f"{escape(option.label)}\n[dim]{escape(law)}[/]" if law != option.label else escape(option.label)
        said = [option.failure] if option.failure else []
        if option.synthesis is not None and not option.failure:
            said += claims_in_short(option.synthesis, claim_units(option))
        said += [f"with actuator delays: {option.delays}"] if option.delays else []
        gain, phase, _ = smallest_margins(option.margins)
        if gain < THIN_GAIN or phase < THIN_PHASE:
            said.append(f"but margins are thin: {gain:.3g} dB, {phase:.3g} deg")
        table.add_row(name, f"[{VERDICT_STYLES[verdict]}]{verdict}[/]", escape("\n".join(said)))
    screen.print(table)
