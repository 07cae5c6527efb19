"""One strict JSON document on every verb, faults with their place, quiet and verbose, progress for logs."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from maglev_ctrl import __version__, cli_terminal
from maglev_ctrl.cli import app, main
from maglev_ctrl.cli_output import Manner, answer, complain, conversation, finish, json_text, say
from maglev_ctrl.errors import ModelError, Verdict
from maglev_ctrl.scenario.starter import starter_text
from maglev_ctrl.study.records import RequirementResult

Capture = pytest.CaptureFixture[str]
ROOT = Path(__file__).resolve().parents[2]
DATA = str(ROOT / "scenarios/data/forced_oscillation.csv")


def strict(text: str) -> Any:
    """Exactly one JSON document; NaN and Infinity are no JSON."""
    return json.loads(text, parse_constant=lambda word: pytest.fail(f"{word} is no JSON"))


@pytest.fixture
def train(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    Path("train.toml").write_text(starter_text("Train"), encoding="utf-8")
    return tmp_path


@pytest.fixture
def studied(train: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The study and the report are stood in for; a library prints on the output meanwhile."""
    import maglev_ctrl.report
    import maglev_ctrl.study

    result = RequirementResult("stable", "growth_rate", "growth", "at_most", 0.0, float("nan"), "1/s",
                               Verdict.NOT_EVALUATED, float("nan"), "", "eigenvalues", "no equilibrium",
                               "exact")  # fmt: skip
    option = SimpleNamespace(name="bare", label="Bare [x]", kind="baseline", verdict=Verdict.NOT_EVALUATED, failure="",
                             requirements=(result,))  # fmt: skip
    made = SimpleNamespace(title="NaN", scenario_hash="1f", options=(option,), verdict=Verdict.NOT_EVALUATED,
                           tuning=None)  # fmt: skip

    def run(*_: object, progress: Any, **__: object) -> SimpleNamespace:
        print("a library speaks")
        for step in range(1001):
            progress(f"step {step}", step / 1000.0)
        return made

    monkeypatch.setattr(maglev_ctrl.study, "run", run)
    monkeypatch.setattr(maglev_ctrl.report, "write", lambda *_, **__: (Path("out/train/report.json"),))
    return ["report", "train.toml"]


def test_report(studied: list[str], capsys: Capture) -> None:
    for arguments in ([*studied, "--json"], ["--json", *studied], ["compare", "train.toml", "--json"]):
        assert main(arguments) == 1
        out, err = capsys.readouterr()
        found = strict(out)
        assert found["verb"] in ("report", "compare") and found["status"] == 1 and found["verdict"] == "NOT EVALUATED"
        assert found["title"] == "NaN" and found["written"] == ["out/train/report.json"]
        told = found["options"][0]["requirements"][0]
        assert told["value"] == {"value": None, "unit": "1/s"} and told["reason"] == "no equilibrium"
        assert "a library speaks" in err


CHEAP = [
    (["version"], 0, {"version": __version__}),
    (["check", "train.toml"], 0, {"valid": True}),
    (["new", "other"], 0, {"written": ["other.toml"]}),
    (["schema", "--out", "."], 0, {"written": ["scenario.schema.json"]}),
    (["completion", "bash"], 0, {"shell": "bash"}),
    (["help", "map"], 0, {"verb": "help"}),
    (["map", "train.toml", "--list-quantities"], 0, {"verb": "map"}),
    (["identify", DATA], 1, {"kind": "maglev-ctrl identification", "verb": "identify"}),
    (["complete", "--current", "repo"], 0, {"candidates": ["report"]}),
]


@pytest.mark.parametrize(("arguments", "status", "holds"), CHEAP, ids=lambda one: str(one)[:30])
def test_other_verbs(train: Path, capsys: Capture, arguments: list[str], status: int, holds: dict[str, Any]) -> None:
    assert main([*arguments, "--json"]) == status
    found = strict(capsys.readouterr().out)
    assert found["status"] == status and found | holds == found


def test_the_schema_is_the_document(capsys: Capture) -> None:
    assert main(["schema", "--json"]) == 0
    assert strict(capsys.readouterr().out)["properties"]["format"]["const"] == 1


def test_reproduce_and_forces(train: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture) -> None:
    from maglev_ctrl.report import force_survey as pages
    from maglev_ctrl.report.paper import files
    from maglev_ctrl.study.paper import run
    from maglev_ctrl.study.paper.records import ClaimVerdict

    claim = SimpleNamespace(key="k", verdict=ClaimVerdict.UNRESOLVED, why="two ways")
    monkeypatch.setattr(run, "reproduce", lambda *_, **__: SimpleNamespace(claims=(), notes=("a",), quick=True))
    monkeypatch.setattr(files, "write_reproduction", lambda *_: (Path("out/r.html"),))
    assert main(["reproduce", "--quick", "--json"]) == 0
    assert strict(capsys.readouterr().out)["claims"] == []
    monkeypatch.setattr(run, "reproduce", lambda *_, **__: SimpleNamespace(claims=(claim,), notes=(), quick=True))
    assert main(["reproduce", "--quick", "--quiet"]) == 1
    out, err = capsys.readouterr()
    assert "UNRESOLVED: k: two ways" in out and err == ""
    monkeypatch.setattr(pages, "write_forces", lambda *_: (Path("out/f.html"),))
    assert main(["forces", "train.toml", "--json"]) == 0
    found = strict(capsys.readouterr().out)
    assert found["height"]["unit"] == "m" and found["forces"]["lift"]["value"] > 0.0


def test_every_verb_takes_the_common_options() -> None:
    import typer

    group: Any = typer.main.get_command(app)
    for name, command in group.commands.items():
        known = {word for one in command.params for word in one.opts}
        assert {"--json", "--quiet", "-q", "--verbose", "-v"} <= known, name


def test_faults_have_their_place(train: Path, capsys: Capture) -> None:
    text = Path("train.toml").read_text(encoding="utf-8")
    Path("bad.toml").write_text(text.replace('mass = "20 t"', "mass = 20", 1).replace("format = 1", "format = 2"))
    line = next(k for k, one in enumerate(text.splitlines(), 1) if one.startswith('mass = "20 t"'))
    assert main(["report", "bad.toml", "--json"]) == 2
    out, err = capsys.readouterr()
    found = strict(out)
    places = [(one["file"], one["line"], one["key"]) for one in found["error"]["faults"]]
    assert ("bad.toml", line, "vehicle.car.mass") in places and found["status"] == 2
    assert f"bad.toml:{line}:8: vehicle.car.mass:" in err and found["error"]["message"].strip() == err.strip()
    assert main(["check", "train.toml", "bad.toml", "nowhere.toml", "--json"]) == 2
    out, err = capsys.readouterr()
    found = strict(out)
    assert [one["valid"] for one in found["files"]] == [True, False, False] and "error" not in found
    assert found["files"][1]["faults"][-1]["line"] == line and "nowhere.toml: no such file" in err


@pytest.mark.parametrize(
    "arguments", [["repot"], ["report"], ["report", "train.toml", "--jobs", "0"], ["report", "nowhere.toml"],
                  ["new", "train"], ["report", "train.toml", "--format", "doc"], ["version", "-q", "-v"],
                  ["report", "train.toml", "--job", "2"]],
)  # fmt: skip
def test_wrong_usage_is_one_sentence(train: Path, capsys: Capture, arguments: list[str]) -> None:
    assert main(arguments) == 2
    out, err = capsys.readouterr()
    assert out == "" and err.count("\n") == 1
    assert main(["--json", *arguments]) == 2
    out, again = capsys.readouterr()
    assert again == err and strict(out)["error"]["message"] and strict(out)["status"] == 2


def test_misspelt_words_have_a_near_match(capsys: Capture) -> None:
    slips = ((["repot"], "report"), (["report", "a.toml", "--job", "2"], "--jobs"), (["help", "mpa"], "map"))
    for arguments, near in slips:
        assert main(arguments) == 2
        assert near in capsys.readouterr().err


def test_an_interrupt_is_an_error_in_json(train: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture) -> None:
    import maglev_ctrl.study

    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(maglev_ctrl.study, "run", interrupted)
    assert main(["report", "train.toml", "--json"]) == 130
    found = strict(capsys.readouterr().out)
    assert found["status"] == 130 and found["error"]["message"] == "interrupted; nothing was written"


def test_quiet(studied: list[str], capsys: Capture) -> None:
    for arguments in ([*studied, "-q"], ["--quiet", *studied]):
        assert main(arguments) == 1
        out, err = capsys.readouterr()
        assert out.splitlines() == ["a library speaks", "Bare [x]: NOT EVALUATED", "written: out/train/report.json"]
        assert err == ""
    assert main(["check", "train.toml", "-q"]) == 0
    assert capsys.readouterr() == ("", "")


def test_verbose(studied: list[str], capsys: Capture) -> None:
    assert main([*studied, "--verbose"]) == 1
    err = capsys.readouterr().err
    assert f"maglev-ctrl {__version__}, Python" in err and "numpy" in err and "report took" in err
    assert "s  step 7\n" in err
    assert main(["--verbose", "version"]) == 0
    assert "solved forces are kept in" in capsys.readouterr().err


def test_progress_in_a_log_is_sparse_and_has_the_time_left(studied: list[str], capsys: Capture) -> None:
    assert main(studied) == 1
    err = capsys.readouterr().err
    lines = err.splitlines()
    assert 11 <= len(lines) <= 12 and lines[-1].startswith("100 %  writing the report")
    assert "about 0 s left" in lines[5] and "\r" not in err and "\x1b" not in err


def test_a_slow_step_is_told_after_ten_seconds(monkeypatch: pytest.MonkeyPatch, capsys: Capture) -> None:
    now = [0.0]
    monkeypatch.setattr(cli_terminal, "time", SimpleNamespace(perf_counter=lambda: now[0]))
    with cli_terminal.progress("slow") as tell:
        for second in range(0, 41, 4):
            now[0] = float(second)
            tell("the same", 0.04 + second / 1000.0)
    lines = capsys.readouterr().err.splitlines()
    assert lines[1] == "  5 %  the same  (12 s, about 3 min 39 s left)"
    assert [one.split("(")[1].split(" s")[0] for one in lines] == ["0", "12", "24", "36"]


def test_a_text_called_nan_stays() -> None:
    assert strict(json_text({"name": "NaN", "values": ["NaN", float("-inf")]})) == {
        "name": "NaN", "values": [None, "-Infinity"],
    }  # fmt: skip


def test_a_conversation_ends(capsys: Capture) -> None:
    with conversation(Manner(as_json=True)):
        say("not shown")
        complain(ModelError("a\nb"))
        finish(2)
    assert strict(capsys.readouterr().out)["error"]["message"] == "a\nb"
    answer({"nobody": "listens"})
    say("shown")
    assert capsys.readouterr().out == "shown\n"


TABLE = "from maglev_ctrl.cli_terminal import console\nconsole().print('[bold green]PASS[/] ' + '│' * 120)"


def test_pipes_have_no_colour_unless_forced() -> None:
    def shown(**how: str) -> str:
        kept = {name: value for name, value in os.environ.items() if name not in ("NO_COLOR", "FORCE_COLOR", "TERM")}
        done = subprocess.run([sys.executable, "-X", "utf8", "-c", TABLE], capture_output=True, check=True,
                              env={**kept, **how})  # fmt: skip
        return done.stdout.decode("utf-8")

    assert shown().rstrip() == "PASS " + "│" * 120
    assert "\x1b[" in shown(FORCE_COLOR="1")
    assert "\x1b" not in shown(FORCE_COLOR="1", NO_COLOR="1")


@pytest.mark.skipif(os.name == "nt", reason="pseudo-terminals are POSIX")
@pytest.mark.parametrize(("how", "coloured"), [({}, True), ({"NO_COLOR": "1"}, False), ({"TERM": "dumb"}, False)])
def test_terminals_have_colour_and_a_bar_that_goes(how: dict[str, str], coloured: bool) -> None:
    out = on_terminal(
        "from maglev_ctrl.cli_terminal import console, progress\nimport time\n"
        "with progress('work') as tell:\n    tell('half [x]', 0.5)\n    time.sleep(0.3)\n"
        "console().print('[bold green]PASS[/]')\n",
        how,
    )
    assert "half [x]" in out and "PASS" in out
    assert ("\x1b[1;32m" in out) is coloured
    if "TERM" in how:
        assert "\x1b" not in out and " 50 %  half [x]" in out
    else:
        assert "50 %" in out and "left" in out and "\x1b[2K" in out  # the bar's line is erased
        assert out.rindex("\x1b[2K") < out.index("PASS")


def on_terminal(code: str, how: dict[str, str]) -> str:
    """What a program shows on a pseudo-terminal."""
    import pty

    ours, theirs = pty.openpty()
    kept = {name: value for name, value in os.environ.items() if name not in ("NO_COLOR", "FORCE_COLOR")}
    with subprocess.Popen([sys.executable, "-c", code], stdin=theirs, stdout=theirs, stderr=theirs,
                          env={**kept, "TERM": "xterm", "COLUMNS": "80", **how}) as process:  # fmt: skip
        os.close(theirs)
        found = b""
        end = time.monotonic() + 30.0
        while time.monotonic() < end:
            try:
                piece = os.read(ours, 65536)
            except OSError:
                break
            if not piece:
                break
            found += piece
        process.wait(timeout=10)
    os.close(ours)
    return found.decode("utf-8", errors="replace")


@pytest.mark.skipif(os.name == "nt", reason="pipes of a POSIX shell")
@pytest.mark.parametrize("arguments", [["completion", "bash"], ["--help"], ["version", "--json"], ["table"]])
def test_a_reader_that_goes_away_ends_it_without_a_word(arguments: list[str]) -> None:
    code = (
        "import sys; from maglev_ctrl import cli\n"
        "def table() -> None:\n"
        "    from maglev_ctrl.cli_terminal import console\n"
        "    console().print('wide')\n"
        "cli._add(table)\n"
        f"sys.exit(cli.main({arguments!r}))"
    )
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout is not None and process.stderr is not None
        process.stdout.close()
        assert process.stderr.read() == b""
        assert process.wait(timeout=60) == 141
