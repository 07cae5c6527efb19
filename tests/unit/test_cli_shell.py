"""Completion in real shells, help that fits eighty columns with examples that parse, and how fast it answers."""

from __future__ import annotations

import os
import shlex
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import typer

from maglev_ctrl.cli import app, main
from maglev_ctrl.cli_completion import SCRIPTS, candidates
from maglev_ctrl.cli_help import VERBS
from maglev_ctrl.scenario.starter import starter_text

Capture = pytest.CaptureFixture[str]
VISIBLE = [one.name for one in app.registered_commands if not one.hidden]


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    Path("train.toml").write_text(starter_text("Train"), encoding="utf-8")
    Path("a folder").mkdir()
    Path("a folder/x.toml").touch()
    Path("rig.csv").touch()
    Path("design.json").touch()
    return tmp_path


CASES = [
    (["re"], ["report", "reproduce"]),
    (["--j"], ["--json"]),
    (["report", ""], ["a folder/", "train.toml"]),
    (["report", "a folder/"], ["a folder/x.toml"]),
    (["identify", "r"], ["rig.csv"]),
    (["verify", "d"], ["design.json"]),
    (["report", "train.toml", "--for"], ["--format"]),
    (["report", "train.toml", "--format", "html,p"], ["html,pdf"]),
    (["report", "train.toml", "--format", "=", "p"], ["pdf"]),
    (["report", "train.toml", "--format=html,p"], ["--format=html,pdf"]),
    (["map", "train.toml", "--backend", ""], ["numpy", "fast", "gpu"]),
    (["map", "train.toml", "--option", "da"], ["damper_windings"]),
    (["map", "train.toml", "--x", "spee"], ["speed="]),
    (["map", "train.toml", "--x", "speed=1"], []),
    (["forces", "train.toml", "-a", "d"], ["draft"]),
    (["export", "design.json", "--to", ""], ["mat", "json", "c", "python"]),
    (["report", "train.toml", "--out", ""], ["a folder/"]),
    (["report", "--jobs", "2", "t"], ["train.toml"]),
    (["completion", "p"], ["powershell"]),
    (["help", "ma"], ["map"]),
    (["map", "nowhere.toml", "--option", ""], []),
    (["nonsense", ""], []),
    (["new", ""], []),
]


@pytest.mark.parametrize(("words", "expected"), CASES, ids=lambda one: " ".join(one))
def test_candidates(here: Path, words: list[str], expected: list[str]) -> None:
    _, found = candidates(typer.main.get_command(app), words)
    assert [text for text, _ in found] == expected


def test_options_given_already_are_left_out(here: Path) -> None:
    _, found = candidates(typer.main.get_command(app), ["map", "train.toml", "--option", "bare", "--yes", "--"])
    names = [text for text, _ in found]
    assert "--option" in names and "--yes" not in names and "--help" in names


def shell(name: str, script: str, here: Path) -> str:
    program = shutil.which(name)
    if program is None:
        pytest.skip(f"{name} is not installed")
    folder = Path(sys.executable).parent
    if not (folder / "maglev-ctrl").exists():
        pytest.skip("the command is not installed beside this Python")
    environment = {**os.environ, "PATH": f"{folder}{os.pathsep}{os.environ['PATH']}"}
    done = subprocess.run(
        [program, "-c", script], capture_output=True, text=True, check=False, cwd=here, env=environment
    )
    assert done.stderr == "" and done.returncode == 0, done.stderr
    return done.stdout


def test_bash(here: Path) -> None:
    script = """source <(maglev-ctrl completion bash)
    compopt() { :; }
    try() { COMP_WORDS=("$@"); COMP_CWORD=$(($# - 1)); "$handler" "$1"; printf '<%s>' "${COMPREPLY[@]}"; echo; }
    handler=$(complete -p maglev-ctrl | sed 's/.*-F \\([^ ]*\\).*/\\1/')
    try maglev-ctrl repo
    try maglev-ctrl report a
    try maglev-ctrl map train.toml --option bare --option da"""
    assert shell("bash", script, here).splitlines() == ["<report>", "<a folder>", "<damper_windings>"]


def test_fish(here: Path) -> None:
    script = "maglev-ctrl completion fish | source; complete -C 'maglev-ctrl map train.toml --backend '"
    assert sorted(shell("fish", script, here).split()) == ["fast", "gpu", "numpy"]


@pytest.mark.parametrize("name", ["bash", "zsh", "fish"])
def test_scripts_are_read_by_their_shell(here: Path, name: str) -> None:
    file = here / f"script.{name}"
    file.write_text(SCRIPTS[name], encoding="utf-8")  # type: ignore[index]
    program = shutil.which(name)
    if program is None:
        pytest.skip(f"{name} is not installed")
    done = subprocess.run([program, "-n", str(file)], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


def test_every_verb_has_help(capsys: Capture) -> None:
    assert set(VISIBLE) == set(VERBS)
    assert main(["--help"]) == 0
    text = capsys.readouterr().out
    assert all(f"  {name} " in text for name in VISIBLE) and "..." not in text.split("Options:")[1]


@pytest.mark.parametrize("name", [None, *VERBS])
def test_help_fits_eighty_columns(name: str | None, capsys: Capture, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    assert main([name, "--help"] if name else ["--help"]) == 0
    text = capsys.readouterr().out
    wide = [line for line in text.splitlines() if len(line) > 80]
    assert not wide, wide
    assert "Exit status:" in text and "130" in text and "143" in text
    if name:
        assert "Examples:" in text
        assert main(["help", name]) == 0
        assert capsys.readouterr().out == text


@pytest.mark.parametrize(
    ("name", "example"), [(name, one) for name, verb in VERBS.items() for one in verb.examples if "eval" not in one]
)
def test_examples_parse(name: str, example: str, monkeypatch: pytest.MonkeyPatch) -> None:
    words = shlex.split(example.split(" | ")[0].split(" > ")[0].split(" && ")[0])
    assert words[0] == name
    group: Any = typer.main.get_command(app)
    group.get_command(typer.Context(group), name).make_context(name, words[1:])
    for word in words[1:]:
        if word.startswith("scenarios/"):
            assert list(Path(__file__).resolve().parents[2].glob(word)), word


@pytest.mark.skipif(os.name == "nt", reason="the time of ended processes is POSIX")
def test_help_is_fast() -> None:
    def once() -> float:
        before = os.times()
        subprocess.run([sys.executable, "-m", "maglev_ctrl", "--help"], capture_output=True, check=True)
        after = os.times()
        return after.children_user + after.children_system - before.children_user - before.children_system

    assert min(once() for _ in range(3)) < 0.5  # 0.25 s on a machine at rest; others slow this one down
