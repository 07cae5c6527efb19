"""Paths that lead elsewhere, have no end or are no files: what a scenario names, and where results go."""

from __future__ import annotations

import os
import sys
import threading
from pathlib import Path

import pytest

from maglev_ctrl.cli import main
from maglev_ctrl.scenario import ScenarioProblems, load
from maglev_ctrl.scenario.oscillation import read_oscillations

TABLE = "height [m],speed [m/s],lift [N],drag [N]\n" + "".join(
    f"{h},{v},{98066.5 * 0.05 / h},{1e5 / v}\n" for h in (0.04, 0.05, 0.06) for v in (80, 100, 120)
)
SCENARIO = """format = 1
title = "Table"
[vehicle]
model = "heave_surge"
car.mass = "10 t"
[forces]
model = "table"
file = "{file}"
method = "polynomial"
degree = 1
[operating]
speed = "100 m/s"
height = "50 mm"
[[option]]
name = "bare"
kind = "baseline"
"""
LINKS = pytest.mark.skipif(os.name == "nt", reason="links need rights there")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "secret.csv").write_text(TABLE)
    home = tmp_path / "home"
    home.mkdir()
    return home


def loaded(folder: Path, file: str, name: str = "mine.toml") -> str:
    """What loading a scenario that names this table says; '' where it is read."""
    place = folder / name
    place.write_text(SCENARIO.format(file=file.replace("\\", "\\\\")), encoding="utf-8")
    outcome: list[str] = []

    def work() -> None:
        try:
            load(place)
            outcome.append("")
        except ScenarioProblems as error:
            outcome.append(str(error))

    thread = threading.Thread(target=work, daemon=True)  # a file without an end must not hold the tests
    thread.start()
    thread.join(30.0)
    assert outcome, "loading does not end"
    return outcome[0]


def test_a_table_beside_the_scenario_or_below_it_is_read(folder: Path) -> None:
    (folder / "below").mkdir()
    for name in ("t.csv", "below/t.csv", "below/../t.csv"):
        (folder / name).write_text(TABLE)
        assert loaded(folder, name) == ""


@pytest.mark.parametrize(
    "file",
    [
        "../secret.csv", "./../secret.csv", "below/../../secret.csv", "/etc/passwd", "/dev/zero", "/dev/stdin", "..",
        "../",
        "/proc/self/environ", "/proc/self/fd/0", "~/secret.csv", "//host/share/x.csv",
    ],
)  # fmt: skip
def test_a_table_elsewhere_is_refused_and_nothing_of_it_is_told(folder: Path, file: str) -> None:
    said = loaded(folder, file)
    assert "expected a file in the scenario's folder or below it" in said or "no file" in said
    assert "root:" not in said and "98066" not in said


@pytest.mark.parametrize(
    "file",
    [
        "\\\\host\\share\\x.csv",
        "C:\\x.csv",
        "CON",
        "nul.csv",
        "com1",
        "a" * 190,
        "\u4e2d" * 190,
        ".",
        "",
        "t.csv/x",
        "*",
    ],
)
def test_names_that_are_no_file_are_told_in_a_sentence(folder: Path, file: str) -> None:
    (folder / "t.csv").write_text(TABLE)
    said = loaded(folder, file)
    assert said and len(said) < 2000 and "Traceback" not in said


@LINKS
def test_links_out_of_the_folder_are_not_followed(folder: Path) -> None:
    (folder / "link.csv").symlink_to(folder.parent / "secret.csv")
    (folder / "door").symlink_to(folder.parent)
    (folder / "in.csv").write_text(TABLE)
    (folder / "inside.csv").symlink_to(folder / "in.csv")
    for name in ("link.csv", "door/secret.csv"):
        assert "expected a file in the scenario's folder or below it" in loaded(folder, name)
    assert loaded(folder, "inside.csv") == ""


@LINKS
def test_links_in_a_circle_are_told(folder: Path) -> None:
    (folder / "a.csv").symlink_to("b.csv")
    (folder / "b.csv").symlink_to("a.csv")
    assert "a.csv" in loaded(folder, "a.csv")
    with pytest.raises(ScenarioProblems):
        read_oscillations([folder / "a.csv"])
    assert main(["check", str(folder / "a.csv")]) == 2
    assert main(["identify", str(folder / "a.csv")]) == 2


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no such pipes there")
def test_a_pipe_and_a_folder_beside_the_scenario_are_no_tables(folder: Path) -> None:
    os.mkfifo(folder / "pipe.csv")
    (folder / "folder.csv").mkdir()
    for name in ("pipe.csv", "folder.csv"):
        assert f'no file "{name}"' in loaded(folder, name)


def test_what_an_opened_pipe_would_do_is_seen(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The test above sees the guard gone: without it the pipe is opened, and nothing ever comes."""
    if not hasattr(os, "mkfifo"):
        pytest.skip("no such pipes there")
    os.mkfifo(folder / "pipe.csv")
    monkeypatch.setattr(Path, "is_file", lambda self: True)
    monkeypatch.setattr(
        threading.Thread, "join", lambda self, timeout=None, join=threading.Thread.join: join(self, 0.5)
    )
    with pytest.raises(AssertionError, match="does not end"):
        loaded(folder, "pipe.csv")


@pytest.mark.parametrize(
    ("name", "wanted"),
    [("...toml", "scenario"), ("..toml", "scenario"), (" .toml", "scenario"), ("x..toml", "x"), ("a.toml", "a")],
)
def test_results_go_into_a_folder_of_the_scenarios_name_and_nowhere_else(folder: Path, name: str, wanted: str) -> None:
    (folder / "t.csv").write_text(TABLE)
    place = folder / name
    place.write_text(SCENARIO.format(file="t.csv"))
    found = load(place).name
    assert found == wanted and Path("out", found).resolve().parent == Path("out").resolve()


@pytest.mark.parametrize("verb", ["new", "identify", "schema"])
def test_an_out_that_is_a_file_is_refused_and_stays(
    folder: Path, verb: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    data = str(Path("scenarios/data/forced_oscillation.csv").resolve())
    monkeypatch.chdir(folder)
    out = folder / "out"
    out.write_text("mine")
    words = {"new": ["new", "x"], "identify": ["identify", data], "schema": ["schema"]}[verb]
    assert main([*words, "--out", str(out)]) == 2
    assert out.read_text() == "mine" and list(folder.iterdir()) == [out]
    said = capsys.readouterr().err
    assert said.strip() and "Traceback" not in said


@LINKS
def test_new_does_not_write_through_a_link(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    target = folder.parent / "target.toml"
    (folder / "x.toml").symlink_to(target)  # leads to nothing yet
    assert main(["new", "x", "--out", str(folder)]) == 2
    assert not target.exists() and (folder / "x.toml").is_symlink()
    target.write_text("mine")
    assert main(["new", "x", "--out", str(folder)]) == 2
    assert target.read_text() == "mine"
    assert "a file of this name" in capsys.readouterr().err


@pytest.mark.skipif(sys.platform == "win32", reason="no such devices there")
def test_a_device_without_an_end_is_no_scenario(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", "/dev/zero"]) == 2
    assert "at most 1 MiB" in capsys.readouterr().err
    assert main(["verify", "/dev/zero"]) == 2
    assert "at most 64 MiB" in capsys.readouterr().err
    assert main(["identify", "/dev/zero"]) == 2
    assert main(["diff", "/dev/zero", "/dev/zero"]) == 2
    assert "Traceback" not in capsys.readouterr().err
