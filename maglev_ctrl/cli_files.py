"""The verbs `check`, `new` and `schema`: scenario files before any study; everything heavy is loaded inside."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated, Any

import typer

from maglev_ctrl.cli_output import answer, complain, faults, manner, say, say_written
from maglev_ctrl.cli_terminal import BAD_INPUT


def check(
    files: Annotated[list[Path], typer.Argument(metavar="FILE...", help="Scenario files.", show_default=False)],
) -> None:
    """Say what is wrong with scenario files, with line and column; nothing is computed.

    With --quiet only faults are told.
    """
    from maglev_ctrl.errors import MaglevError
    from maglev_ctrl.scenario import load
    from maglev_ctrl.scenario.tunes import tuned_quantities

    found: list[dict[str, Any]] = []
    wrong: list[MaglevError] = []
    for file in files:
        one: dict[str, Any] = {"file": str(file), "valid": True, "faults": []}
        try:
            scenario = load(file)
            for option in scenario.options:
                tuned_quantities(scenario, option)  # `load` reads what may be tuned, this looks it up
        except MaglevError as error:
            wrong.append(error)
            one |= {"valid": False, "faults": faults(error)}
            typer.echo(str(error), err=True)
        else:
            one |= {"options": len(scenario.options), "requirements": len(scenario.judged)}
            if not manner().quiet:
                say(f"{file}: valid; {one['options']} option(s), {one['requirements']} requirement(s)")
        found.append(one)
    answer({"valid": not wrong, "files": found})
    if wrong:
        raise typer.Exit(BAD_INPUT)


def new(
    name: Annotated[str, typer.Argument(metavar="NAME", help="Name of the scenario.", show_default=False)],
    out: Annotated[
        Path, typer.Option("--out", "-o", metavar="DIR", help="Folder for the file, made if need be.")
    ] = Path(),
) -> None:
    """Write NAME.toml, a commented scenario to start from; an existing file is never touched."""
    from maglev_ctrl.files import put_new_file
    from maglev_ctrl.scenario.starter import starter_text

    file = out / (name if name.endswith(".toml") else f"{name}.toml")
    title = file.stem.replace("_", " ").replace("-", " ").strip()
    if not title:
        raise typer.BadParameter(f"expected a name, got {name!r}")
    try:
        out.mkdir(parents=True, exist_ok=True)
        put_new_file(file, starter_text(title[:1].upper() + title[1:]).encode())
    except FileExistsError:
        complain(f"{file}: there is a file of this name already; choose another name or delete it")
        raise typer.Exit(BAD_INPUT) from None
    except FileNotFoundError:
        complain(f"{file}: the folder {file.parent} does not exist; make it first")
        raise typer.Exit(BAD_INPUT) from None
    # dev.py says how it was called: in a fresh clone there is no maglev-ctrl on PATH.
    command = os.environ.get("MAGLEV_CTRL_COMMAND", "maglev-ctrl")
    steps = [f"{command} {verb} {file}" for verb in ("check", "report", "design")]
    say_written([file])
    answer({"next": steps})
    if not manner().quiet:
        say("next:    " + "\n         ".join(steps))


def schema(
    out: Annotated[
        Path | None, typer.Option("--out", "-o", metavar="DIR", help="Folder for scenario.schema.json; else printed.")
    ] = None,
) -> None:
    """The scenario format as a JSON Schema, for editors that complete and check as you type.

    It is one JSON document with or without --json.
    """
    import json

    from maglev_ctrl.files import put_file
    from maglev_ctrl.scenario import json_schema

    found = json_schema()
    text = json.dumps(found, indent=2, ensure_ascii=False)
    if out is None:
        answer(found, whole=True)
        say(text)
        return
    file = out / "scenario.schema.json"
    put_file(file, (text + "\n").encode())
    say_written([file])
