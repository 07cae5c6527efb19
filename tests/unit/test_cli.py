"""The command line: messages, exit status, and nothing written when the input is wrong."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from maglev_ctrl import __version__
from maglev_ctrl.cli import main
from maglev_ctrl.errors import ModelError, Verdict
from maglev_ctrl.scenario.starter import starter_text


@pytest.fixture
def scenario(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    file = tmp_path / "train.toml"
    file.write_text(starter_text("Train"), encoding="utf-8")
    return file


def comparison(verdict: Verdict) -> SimpleNamespace:
    result = SimpleNamespace(
        name="stable", quantity="growth_rate", sense="at_most", limit=0.0, value=-0.5, unit="1/s", verdict=verdict,
        reason="", hard=True,
    )  # fmt: skip
    option = SimpleNamespace(label="Bare [x]", kind="baseline", verdict=verdict, failure="", requirements=(result,))
    return SimpleNamespace(title="Train", options=(option,), verdict=verdict, tuning=None)


class Recorder:
    """Stands in for the study and the report; remembers what it was asked."""

    def __init__(self, verdict: Verdict = Verdict.PASS) -> None:
        self.verdict = verdict
        self.jobs = 0
        self.written: list[tuple[Path, tuple[str, ...]]] = []

    def run(self, scenario: object, *, jobs: int = 2, progress: object = None) -> SimpleNamespace:
        self.jobs = jobs
        assert callable(progress)
        progress("half", 0.5)
        return comparison(self.verdict)

    def write(self, made: object, folder: Path, *, formats: tuple[str, ...]) -> tuple[Path, ...]:
        self.written.append((Path(folder), tuple(formats)))
        return tuple(Path(folder) / f"report.{name}" for name in formats)


@pytest.fixture
def recorder(monkeypatch: pytest.MonkeyPatch) -> Recorder:
    import maglev_ctrl.report
    import maglev_ctrl.study

    made = Recorder()
    monkeypatch.setattr(maglev_ctrl.study, "run", made.run, raising=False)
    monkeypatch.setattr(maglev_ctrl.report, "write", made.write)
    return made


@pytest.mark.parametrize(("verdict", "status"), [(Verdict.PASS, 0), (Verdict.FAIL, 1), (Verdict.NOT_EVALUATED, 1)])
def test_report(
    scenario: Path, recorder: Recorder, capsys: pytest.CaptureFixture[str], verdict: Verdict, status: int
) -> None:
    recorder.verdict = verdict
    assert main(["report", str(scenario), "--jobs", "3"]) == status
    assert recorder.jobs == 3
    assert recorder.written == [(Path("out/train"), ("html", "pdf", "json"))]
    out = capsys.readouterr().out
    assert "Bare [x]" in out and verdict.value in out and "written: out/train/report.html" in out


def test_a_reason_shared_by_requirements_is_told_once() -> None:
    from maglev_ctrl.cli_report import _why

    def missed(name: str, reason: str) -> SimpleNamespace:
        return SimpleNamespace(name=name, verdict=Verdict.NOT_EVALUATED, reason=reason, hard=True)

    results = (missed("gain", "nothing to break"), missed("map", "no period"), missed("disk", "nothing to break"))
    option = SimpleNamespace(failure="", requirements=results)
    assert _why(option) == "gain, disk not evaluated (nothing to break); map not evaluated (no period)"  # type: ignore[arg-type]


def test_report_out_and_formats(scenario: Path, recorder: Recorder) -> None:
    assert main(["report", str(scenario), "--out", "here/there", "--format", "json, html"]) == 0
    assert recorder.written == [(Path("here/there"), ("json", "html"))]


def test_compare_prints_values_and_makes_no_pdf(
    scenario: Path, recorder: Recorder, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["compare", str(scenario), "--out", "side/by/side"]) == 0
    assert recorder.written == [(Path("side/by/side"), ("html", "json"))]
    assert "-0.5 1/s PASS" in capsys.readouterr().out


def test_progress_is_told_to_a_pipe(scenario: Path, recorder: Recorder, capsys: pytest.CaptureFixture[str]) -> None:
    main(["report", str(scenario)])
    assert "50 %  half" in capsys.readouterr().err


def test_new_and_schema_write_where_they_are_told(tmp_path: Path) -> None:
    folder = tmp_path / "a" / "b"
    assert main(["new", "demo", "--out", str(folder)]) == 0
    assert main(["check", str(folder / "demo.toml")]) == 0
    assert main(["schema", "--out", str(folder)]) == 0
    assert json.loads((folder / "scenario.schema.json").read_text(encoding="utf-8"))["title"] == "maglev-ctrl scenario"


def refused(arguments: list[str], capsys: pytest.CaptureFixture[str], folder: Path) -> str:
    """Standard error of a command that ends with 2 and leaves the folder as it was."""
    before = sorted(folder.rglob("*"))
    assert main(arguments) == 2
    captured = capsys.readouterr()
    assert "Traceback" not in captured.err and captured.out == ""
    assert sorted(folder.rglob("*")) == before
    return captured.err


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('mass = "20 t"', "mass = 20", r"train\.toml:\d+:8: vehicle\.car\.mass: .*did you mean"),
        ('mass = "20 t"', 'mass = "20 m"', r"vehicle\.car\.mass: expected a mass"),
        ('mass = "20 t"', 'masss = "20 t"', r'vehicle\.car\.masss: unknown key; did you mean "mass"'),
        ('mass = "20 t"', 'mass = "-1 t"', r"above zero"),
        ('["bogies", "guideway"]', '["bogi", "guideway"]', r'no body is called "bogi"'),
        ('name = "damper_windings"', 'name = "bare"', r"unique"),
        ("format = 1", "format = ", r"train\.toml:\d+:\d+: expected valid TOML"),
    ],
)
def test_wrong_scenarios_end_before_the_study(
    scenario: Path, recorder: Recorder, capsys: pytest.CaptureFixture[str], old: str, new: str, words: str
) -> None:
    scenario.write_text(scenario.read_text().replace(old, new, 1))
    for command in ("report", "compare", "check"):
        assert re.search(words, refused([command, str(scenario)], capsys, scenario.parent))
    assert recorder.jobs == 0


def test_a_missing_column_ends_before_the_study(
    scenario: Path, recorder: Recorder, capsys: pytest.CaptureFixture[str]
) -> None:
    start = 'model = "image"'
    image = scenario.read_text().split(start)[1].split("# model = ")[0]
    scenario.write_text(scenario.read_text().replace(start + image, 'model = "table"\nfile = "f.csv"\n'))
    (scenario.parent / "f.csv").write_text("height [m], speed [m/s], lift [N]\n0.1, 100, 5\n")
    error = refused(["report", str(scenario)], capsys, scenario.parent)
    assert "f.csv:1:1: drag: missing column" in error
    (scenario.parent / "f.csv").write_text("height [m], speed [m/s], lift [N], drag [N]\n0.1, 100, 5, nan\n")
    assert "f.csv:2:4: drag: expected a finite number, got nan" in refused(
        ["report", str(scenario)], capsys, scenario.parent
    )
    assert recorder.jobs == 0


@pytest.mark.parametrize("out", ["train.toml", "train.toml/deeper", "/proc/maglev/out"])
def test_an_unwritable_folder_is_found_before_the_study(
    scenario: Path, recorder: Recorder, capsys: pytest.CaptureFixture[str], out: str
) -> None:
    error = refused(["report", str(scenario), "--out", out], capsys, scenario.parent)
    assert out in error and "--out" in error
    assert recorder.jobs == 0


def test_faults_of_the_study_are_one_message(
    scenario: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    import maglev_ctrl.study

    def fails(*_: object, **__: object) -> None:
        raise ModelError("no equilibrium at 100 km/h")

    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(maglev_ctrl.study, "run", fails, raising=False)
    assert refused(["compare", str(scenario)], capsys, scenario.parent) == "no equilibrium at 100 km/h\n"
    monkeypatch.setattr(maglev_ctrl.study, "run", interrupted, raising=False)
    assert main(["compare", str(scenario)]) == 130


def test_check_reads_every_file(scenario: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", str(scenario)]) == 0
    assert "valid; 3 option(s), 6 requirement(s)" in capsys.readouterr().out
    assert main(["check", str(scenario), "nowhere.toml", str(scenario)]) == 2
    captured = capsys.readouterr()
    assert captured.out.count("valid") == 2 and "nowhere.toml: no such file" in captured.err


def test_new_writes_a_valid_file_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["new", "my_train"]) == 0
    assert 'title = "My train"' in Path("my_train.toml").read_text()
    assert main(["check", "my_train.toml"]) == 0
    Path("my_train.toml").write_text("mine")
    capsys.readouterr()
    assert "already" in refused(["new", "my_train.toml"], capsys, tmp_path)
    assert Path("my_train.toml").read_text() == "mine"
    assert "does not exist" in refused(["new", "nowhere/train"], capsys, tmp_path)


def test_new_tells_the_command_that_was_used(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("MAGLEV_CTRL_COMMAND", raising=False)
    assert main(["new", "one"]) == 0
    assert "next:    maglev-ctrl check one.toml" in capsys.readouterr().out
    monkeypatch.setenv("MAGLEV_CTRL_COMMAND", "python3 dev.py")
    assert main(["new", "two"]) == 0
    assert "python3 dev.py check two.toml\n         python3 dev.py report two.toml" in (told := capsys.readouterr().out)
    assert told.endswith("python3 dev.py design two.toml\n")


def test_schema_and_version(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["schema"]) == 0
    assert json.loads(capsys.readouterr().out)["properties"]["format"]["const"] == 1
    assert main(["version"]) == 0
    assert capsys.readouterr().out == f"maglev-ctrl {__version__}\n"


@pytest.mark.parametrize(
    "arguments", [["repot"], ["report"], ["report", "a.toml", "--jobs", "0"], ["report", "a.toml", "--format", "doc"]]
)
def test_wrong_usage_ends_with_2(arguments: list[str], capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert refused(arguments, capsys, tmp_path)


def test_help_loads_nothing_heavy() -> None:
    code = (
        "import sys; from maglev_ctrl.cli import main; status = main(['--help']); "
        "heavy = {'numpy', 'scipy', 'pydantic', 'pint', 'rich', 'control', 'cvxpy', 'matplotlib'} & set(sys.modules); "
        "print(heavy, file=sys.stderr); sys.exit(status or bool(heavy))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "report" in done.stdout and "compare" in done.stdout


@pytest.mark.parametrize("words, status", [("version", 0), ("nonsense", 2)])
@pytest.mark.parametrize("computing", [True, False])
def test_the_process_does_not_wait_for_threads_that_still_compute(computing: bool, words: str, status: int) -> None:
    thread = "threading.Thread(target=time.sleep, args=(600,), daemon=True).start(); " if computing else ""
    done = subprocess.run(
        [sys.executable, "-c", "import atexit, sys, threading, time; from maglev_ctrl.cli import command; "
         f"atexit.register(print, 'taken apart'); {thread}sys.argv = ['maglev-ctrl', {words!r}]; command()"],
        capture_output=True, text=True, timeout=60,
    )  # fmt: skip
    assert done.returncode == status
    told = done.stdout + done.stderr
    assert "maglev-ctrl" in told and ("taken apart" in told) == (not computing)
