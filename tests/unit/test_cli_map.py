"""maglev-ctrl map: wrong input is one sentence and writes nothing, an interrupt keeps what is done, the exit status."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from maglev_ctrl import cli_map
from maglev_ctrl.analysis.plane_records import STABLE, UNRESOLVED
from maglev_ctrl.cli import main
from maglev_ctrl.study.map.store import FOLDER

ROOT = Path(__file__).resolve().parents[2]
GIRDER = str(ROOT / "scenarios/periodic/girder_passing.toml")
posix = pytest.mark.skipif(os.name == "nt", reason="these signals are POSIX")


@pytest.fixture
def small(small_text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    file = tmp_path / "small.toml"
    file.write_text(small_text, encoding="utf-8")
    return file


WRONG = [
    (["--x", "speed=600km/h:60km/h:9"], "--x: speed: expected the smaller end first and two different ends"),
    (["--x", "speed=60km/h:60km/h:9"], "--x: speed: expected the smaller end first and two different ends"),
    (["--y", "depth=0:0.5:1"], "--y: depth: expected 2 to 100000 points, got 1"),
    (["--y", "depth=0:0.5:0"], "--y: depth: expected 2 to 100000 points, got 0"),
    (["--y", "depth=0:0.5:2.5"], 'depth: expected a whole number of points, 2 or more, got "2.5"'),
    (["--y", "depth=0:0.5:-4"], "expected a whole number of points"),
    (["--y", "depth=0:0.5:1000000000"], "depth: expected 2 to 100000 points, got 1000000000"),
    (["--x", "speed=0:100:9"], "speed: expected values above zero, got 0: at rest nothing passes"),
    (["--x", "wavelength=0 m:30 m:9"], "wavelength: expected values above zero, got 0 m: a guideway without a period"),
    (["--x", "wavelength=-5 m:30 m:9"], "a guideway without a period has no passing frequency"),
    (["--x", "speed=nan:100:9"], 'speed: expected a finite number, got "nan"'),
    (["--x", "speed=10:inf:9"], 'speed: expected a finite number, got "inf"'),
    (["--x", "speed=10:1e999:9"], "which is not finite"),
    (["--x", "payload=0t:1t:4", "--y", "payload=0t:2t:4"], "--x and --y: expected different quantities"),
    (["--x", "periodic.depth=0:1:4", "--y", "depth=0:2:4"], "different quantities, got depth twice"),
    (["--y", "depth=0:50:9"], "depth: a bare number is a fraction, and 50 is 5000 %; for per cent write 50%"),
    (["--y", "depth=-0.1:0.5:9"], 'depth: expected 0 or more, got "-0.1"'),
    (["--option", "dampr"], 'unknown option "dampr"; did you mean "damper"?'),
    (["--x", "spede=1:2:3"], 'unknown quantity "spede"; did you mean "speed"? --list-quantities shows them all'),
    (["--x", "speed"], "--x: expected QUANTITY=FROM:TO:COUNT"),
    (["--x", "speed=1:2"], "--x: expected QUANTITY=FROM:TO:COUNT"),
    (["--x", "=1:2:3"], "--x: expected QUANTITY=FROM:TO:COUNT"),
    (["--x", "speed=1kg:2kg:3"], "speed: expected a speed with its unit"),
    (["--x", "speed=60km/h:100:3"], '"60km/h" has a unit and "100" has none'),
    (["--x", "vehicle.magnets.count=2:9:3"], "vehicle.magnets.count: expected whole numbers"),
    (["--x", "vehicle.magnets.count=1:9:9"], "vehicle.magnets.count: expected a multiple of 2, got 1 (at 1)"),
    (["--x", "gain=0.5:2:4", "--option", "bare"], "gain: it changes nothing in option bare, because it has no control"),
    (["--x", "option.damper.spring_damper.damper.damping=0:9kN*s/m:4", "--option", "bare"], "belongs to option damper"),
]  # fmt: skip


@pytest.mark.parametrize(("arguments", "said"), WRONG)
def test_wrong_input(
    small: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], said: str, tmp_path: Path
) -> None:
    assert main(["map", str(small), *arguments]) == 2
    out, err = capsys.readouterr()
    assert out == "" and said in err and err.count("\n") == 1
    assert list(tmp_path.iterdir()) == [small]


def test_nothing_periodic(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert main(["map", str(ROOT / "scenarios/paper/heave_surge.toml"), "--out", str(tmp_path / "out")]) == 2
    err = capsys.readouterr().err
    assert "the scenario describes no periodic forces; add a [periodic] table" in err and err.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_a_billion_points_are_refused_at_once(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    grid = ["--x", "speed=60km/h:600km/h:31623", "--y", "depth=0:0.5:31623", "--option", "bare"]
    assert main(["map", GIRDER, *grid, "--out", str(tmp_path / "out")]) == 2  # the import of numerics is not timed
    capsys.readouterr()
    started = time.perf_counter()
    assert main(["map", GIRDER, *grid, "--out", str(tmp_path / "out")]) == 2
    assert time.perf_counter() - started < 5.0
    err = capsys.readouterr().err
    assert err.startswith("the maps have 1 000 014 129 points: about ")
    assert " GiB of memory; ask for fewer points, or add --yes" in err and err.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_yes_lets_large_maps_through(small: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[int] = []
    monkeypatch.setattr(cli_map, "_map_and_write", lambda read, request, *rest: asked.append(request.points))
    assert main(["map", str(small), "--y", "depth=0:0.5:100000", "--x", "speed=10:100:90", "--yes"]) == 0
    assert asked == [3 * 90 * 100_000]


def test_a_backend_that_is_not_there(small: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch,
                                     tmp_path: Path) -> None:  # fmt: skip
    import maglev_ctrl.study.map.run as study_run
    from maglev_ctrl.errors import ModelError

    def refuse(name: str) -> None:
        raise ModelError(f"backend {name}: not installed")

    monkeypatch.setattr(study_run, "radius_engine", refuse)
    assert main(["map", str(small), "--backend", "fast"]) == 2
    assert capsys.readouterr().err == "backend fast: not installed\n"
    assert list(tmp_path.iterdir()) == [small]


def test_list_quantities(small: Path, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert main(["map", str(small), "--list-quantities"]) == 0
    out = capsys.readouterr().out
    for words in ("option.damper.spring_damper.damper.damping", "30 kN s/m", "factor on the gain", "300 km/h", "5 %",
                  "option.active.control.allowed[0].value"):  # fmt: skip
        assert words in out
    assert list(tmp_path.iterdir()) == [small]


@pytest.mark.parametrize(
    ("states", "status"), [([[STABLE, STABLE]], 0), ([[STABLE, UNRESOLVED]], 1), ([None], 1), ([[STABLE], None], 1)]
)
def test_exit_status(states: list[list[int] | None], status: int) -> None:
    options = [
        SimpleNamespace(plane=None if one is None else SimpleNamespace(share=lambda s, one=one: float(np.mean(
            np.array(one) == s
        ))))
        for one in states
    ]  # fmt: skip
    assert cli_map._exit_code(SimpleNamespace(options=options)) == status  # type: ignore[arg-type]


@pytest.mark.slow
def test_a_map_is_written_and_nothing_is_left(small: Path, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    grid = ["--x", "speed=20:100:9", "--y", "depth=0:1.2:7", "--option", "bare"]
    assert main(["map", str(small), *grid, "--jobs", "1"]) in (0, 1)
    out = capsys.readouterr().out
    assert "speed: 20 to 100 came without a unit and is read in m/s." in out
    assert "deeper than the stiffness it modulates" in out and "Not mapped: damper, active." in out
    written = [line.removeprefix("written: ") for line in out.splitlines() if line.startswith("written: ")]
    assert written and all((tmp_path / file).is_file() for file in written)
    assert "map.html" in {Path(file).name for file in written}
    assert not (tmp_path / "out" / "small" / FOLDER).exists()


SLOWLY = """
import sys, time
from maglev_ctrl.study.map.store import FolderStore
keep = FolderStore.put
def put(self, key, arrays):
    keep(self, key, arrays)
    print("kept", flush=True)
    time.sleep(60.0)
FolderStore.put = put
if __name__ == "__main__":
    from maglev_ctrl.cli import main
    sys.exit(main(sys.argv[1:]))
"""
"""The command line with a pause after every part that is kept; its processes run it too."""


@posix
@pytest.mark.parametrize(("options", "jobs"), [(["bare"], "2"), (["bare", "damper"], "1"), (["bare", "damper"], "2")])
def test_an_interrupt_keeps_what_is_done(small: Path, tmp_path: Path, options: list[str], jobs: str) -> None:
    script = tmp_path / "slowly.py"
    script.write_text(SLOWLY, encoding="utf-8")
    process = subprocess.Popen(
        [sys.executable, str(script), "map", str(small), "--jobs", jobs, *(f"--option={name}" for name in options)],
        cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
    )  # fmt: skip
    try:
        assert process.stdout is not None
        assert process.stdout.readline() == "kept\n"
        os.killpg(process.pid, signal.SIGINT)
        _, err = process.communicate(timeout=20.0)
        assert process.returncode == 130
        (line,) = [line for line in err.splitlines() if line.startswith("interrupted")]
        (kept,) = (tmp_path / "out" / "small" / FOLDER).iterdir()
        assert line == f"interrupted; 0 % is kept in {kept.relative_to(tmp_path)}; the same command goes on from there"
        assert list(kept.rglob("*.npz")) and [file.name for file in (tmp_path / "out" / "small").iterdir()] == [FOLDER]
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
            process.communicate()
