"""The verb sweep: what it writes, what it says, how it ends."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from maglev_ctrl.cli import main
from maglev_ctrl.errors import ModelError
from maglev_ctrl.study.sweep import point as point_module
from maglev_ctrl.study.sweep import store as store_module
from maglev_ctrl.study.sweep.store import STORE, alone

GIRDER = "scenarios/periodic/girder_passing.toml"
SMALL = ["sweep", GIRDER, "--grid", "speed=40:100:3", "--option", "bare", "--compute", "modes", "--jobs", "1"]


def test_a_sweep_is_written_and_told(tmp_path, capsys):
    assert main([*SMALL, "--out", str(tmp_path / "out"), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["points"] == 3
    assert sum(told["options"][0]["states"].values()) == 3
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["sweep.html", "sweep.json", "sweep.nc"]


def test_points_without_an_answer_end_with_status_one_and_are_told(tmp_path, capsys):
    asked = ["--vary", "vehicle.car.mass=20t~150%", "--points", "30", "--option", "bare", "--compute", "modes"]
    assert main(["sweep", GIRDER, *asked, "--jobs", "1", "--out", str(tmp_path), "--json"]) == 1
    told = json.loads(capsys.readouterr().out)["options"][0]
    assert 0 < told["states"]["no_answer"] < 30
    assert told["states"]["no_answer"] == sum(one["points"] for one in told["remarks"])
    assert all("mass" in one["words"] for one in told["remarks"])


def test_a_sweep_without_one_answer_is_a_fault_and_leaves_nothing(tmp_path, capsys, monkeypatch):
    def refuse(*arguments: object) -> None:
        raise ModelError("no equilibrium at any height")

    monkeypatch.setattr(point_module, "settled_modes", refuse)
    assert main([*SMALL, "--out", str(tmp_path / "out")]) == 2
    assert "no point of the sweep could be computed: no equilibrium at any height" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([], "expected either --grid"),
        (["--grid", "spede=1:2:3"], 'did you mean "speed"'),
        (["--grid", "speed=40:100:3", "--points", "4"], "--points belongs to --vary"),
        (["--grid", "speed=40:100:3", "--option", "bar"], 'did you mean "bare"'),
        (["--grid", "speed=40:100:3", "--cluster", "localhost"], "expected an address such as tcp://"),
        (["--grid", "speed=40:100:3", "--compute", "everything"], 'unknown part "everything"'),
        (["--grid", "speed=40:100:3", "--compute", "modes,margns"], 'did you mean "margins"?'),
        (
            ["--grid", "speed=40:100:3", "--cluster", "tcp://127.0.0.1:1", "--jobs", "2"],
            "has no meaning with --cluster",
        ),
        (["--grid", "speed=40:100:3", "--seed", "1"], "--seed belongs to --vary"),
    ],
)
def test_wrong_input_is_one_sentence_and_status_two(tmp_path, capsys, arguments, words):
    out = tmp_path / "out"
    assert main(["sweep", GIRDER, *arguments, "--out", str(out)]) == 2
    said = capsys.readouterr().err
    assert words in said
    assert "Traceback" not in said
    assert not out.exists()


def test_a_missing_library_is_told_before_any_work(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(store_module, "_NEEDED", ("zarr_that_nobody_has",))
    assert main([*SMALL, "--out", str(tmp_path / "out")]) == 2
    assert 'pip install "maglev-ctrl[dist]"' in capsys.readouterr().err


def test_a_second_sweep_into_the_folder_is_refused(tmp_path, capsys):
    with alone(tmp_path):
        assert main([*SMALL, "--out", str(tmp_path)]) == 2
    assert "another sweep is writing into this folder" in capsys.readouterr().err


def test_another_sweep_in_the_folder_is_refused_until_restart(tmp_path, capsys, monkeypatch):
    from maglev_ctrl.report.sweep import folder as folder_module

    monkeypatch.setattr(folder_module, "html", lambda *arguments: (_ for _ in ()).throw(KeyboardInterrupt))
    assert main([*SMALL, "--out", str(tmp_path)]) == 130
    assert "100 % is kept" in capsys.readouterr().err
    assert (tmp_path / STORE).is_dir()
    monkeypatch.undo()
    other = [word.replace("40:100:3", "40:101:3") for word in SMALL]
    assert main([*other, "--out", str(tmp_path)]) == 2
    assert "differs in the points; choose another folder with --out, or --restart" in capsys.readouterr().err
    assert main([*other, "--out", str(tmp_path), "--restart"]) == 0
    assert not (tmp_path / STORE).exists()


def test_what_can_be_varied_is_listed(capsys):
    assert main(["sweep", GIRDER, "--list-quantities", "--quiet"]) == 0
    assert "vehicle.car.mass" in capsys.readouterr().out.splitlines()


def test_many_points_are_asked_for_twice(tmp_path, capsys):
    assert main(["sweep", GIRDER, "--grid", "speed=40:100:4000", "--grid", "payload=0:2t:4000", "--option", "bare",
                 "--compute", "modes", "--out", str(tmp_path / "out")]) == 2  # fmt: skip
    said = capsys.readouterr().err
    assert "16 000 000 points" in said
    assert "add --yes" in said
    assert not Path(tmp_path / "out").exists()
