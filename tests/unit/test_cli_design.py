"""The verbs design, export and verify: files made and proved again, one sentence for what is wrong, exit statuses."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
from design_fixture import ACTUATOR, ALLOWED, H_INFINITY, LQR, VEHICLE, small_study

from maglev_ctrl import cli_design
from maglev_ctrl.cli import main
from maglev_ctrl.study.design import run

Capture = pytest.CaptureFixture[str]


@pytest.fixture(scope="module")
def designed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with a scenario and its designs in out/small."""
    folder = tmp_path_factory.mktemp("cli")
    (folder / "small.toml").write_text(VEHICLE + LQR + H_INFINITY, encoding="utf-8")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        assert main(["design", "small.toml", "--jobs", "1"]) == 0
    return folder


@pytest.fixture
def here(designed: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(designed)
    return designed


def test_design_writes_its_files(here: Path) -> None:
    made = here / "out/small"
    assert sorted(path.name for path in made.iterdir()) == ["design.html", "design.json", "design.pdf", "export"]
    assert sorted(path.name for path in (made / "export").iterdir()) == [
        "lqr.c", "lqr.h", "lqr.json", "lqr.mat", "lqr.py", "lqr_sampled.py", "worst.json", "worst.mat", "worst.py",
    ]  # fmt: skip
    page = (made / "design.html").read_text(encoding="utf-8")
    assert "<title>Designs: Small</title>" in page and "Every claim is proved" in page
    assert (made / "design.pdf").read_bytes().startswith(b"%PDF")
    assert sorted(path.name for path in here.iterdir()) == ["out", "small.toml"]  # nothing temporary is left


def test_the_terminal_tells_what_is_proved(here: Path, capsys: Capture) -> None:
    assert main(["design", "small.toml", "--option", "lqr", "--out", "again"]) == 0
    out, err = capsys.readouterr()
    assert "PASS" in out and "every pole of the closed loop decays at" in out and "written: again/design.html" in out
    assert "LQR: designing" in err and "writing the page" in err


def test_the_table_is_legible_at_a_hundred_columns(capsys: Capture, monkeypatch: pytest.MonkeyPatch) -> None:
    from rich.console import Console

    monkeypatch.setattr(cli_design, "console", lambda: Console(width=100, highlight=False))
    cli_design._print(small_study())
    out = capsys.readouterr().out
    assert max(map(len, out.splitlines())) <= 100
    words = " ".join(line.split("│")[-2].strip() for line in out.splitlines() if line.count("│") > 2)
    assert "the loop is stable everywhere between 3 nodes while the parameter moves at" in words
    assert "acceptable:" not in out and "conj(s)" not in out


def test_verify_proves_it_again(here: Path, capsys: Capture) -> None:
    assert main(["verify", "out/small/design.json"]) == 0
    out, err = capsys.readouterr()
    assert out.rstrip().endswith("proved") and out.count("yes") == 3 and "NOT PROVED" not in out and err == ""


def flipped(document: dict) -> None:
    law = document["designs"][0]["controllers"][0]
    law["D"] = [[-value for value in row] for row in law["D"]]


def swapped(document: dict) -> None:
    rows = document["designs"][0]["plants"][0]["A"]
    rows[0], rows[-1] = rows[-1], rows[0]


def bolder(document: dict) -> None:
    document["designs"][0]["claims"][0]["rate"] *= 1.5


def less(document: dict) -> None:
    document["designs"][0]["claims"][0]["P"][0][0][0] *= -1.0


@pytest.mark.parametrize("change", [flipped, swapped, bolder, less])
def test_verify_catches_what_was_tampered_with(here: Path, capsys: Capture, tmp_path: Path, change) -> None:
    document = json.loads((here / "out/small/design.json").read_text(encoding="utf-8"))
    change(document)
    file = tmp_path / "design.json"
    file.write_text(json.dumps(document), encoding="utf-8")
    assert main(["verify", str(file)]) == 1
    out = capsys.readouterr().out
    row = next(line for line in out.splitlines() if "no: " in line)
    assert "every pole of the closed loop" in row and out.rstrip().endswith("NOT PROVED")
    assert out.count("yes") == 2  # the other design is untouched
    assert main(["export", str(file), "--to", "mat", "--option", "lqr"]) == 2
    assert "lqr is not proved and is not exported: every pole" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == [file]


def test_a_design_without_claims_proves_nothing(here: Path, capsys: Capture, tmp_path: Path) -> None:
    document = json.loads((here / "out/small/design.json").read_text(encoding="utf-8"))
    document["designs"] = document["designs"][:1]
    document["designs"][0]["claims"] = []
    (tmp_path / "bare.json").write_text(json.dumps(document), encoding="utf-8")
    assert main(["verify", str(tmp_path / "bare.json")]) == 1
    assert "the file makes no claim" in capsys.readouterr().out
    assert main(["export", str(tmp_path / "bare.json"), "--to", "json"]) == 2
    assert "lqr is not proved and is not exported: the file makes no claim" in capsys.readouterr().err


WRONG = [
    ("{}", 'expected a file made by `design` (format "maglev_ctrl designs 1")'),
    ("{", "expected JSON as `design` writes it"),
    ("[1, 2]", "expected a file made by `design`"),
    ('{"format": "maglev_ctrl designs 1", "designs": []}', "the file holds no design"),
    ('{"format": "maglev_ctrl designs 1", "designs": [{}]}', "designs[0]: format: expected 'maglev_ctrl design 1'"),
]


@pytest.mark.parametrize(("text", "said"), WRONG)
@pytest.mark.parametrize("verb", [["verify"], ["export", "--to", "c"]])
def test_a_wrong_file_is_one_sentence(capsys: Capture, tmp_path: Path, verb: list[str], text: str, said: str) -> None:
    file = tmp_path / "wrong.json"
    file.write_text(text, encoding="utf-8")
    assert main([*verb, str(file)]) == 2
    out, err = capsys.readouterr()
    assert out == "" and said in err and "wrong.json" in err and err.count("\n") == 1


def test_missing_files_and_names(here: Path, capsys: Capture) -> None:
    for arguments, said in (
        (["verify", "out/small/desing.json"], 'no such file; did you mean "design.json"?'),
        (["export", "out/small/design.json", "--to", "c"], "several designs; choose one with --option: lqr, worst"),
        (["export", "out/small/design.json", "--to", "c", "--option", "wrost"], 'did you mean "worst"?'),
        (["export", "out/small/design.json", "--to", "c", "--option", "worst"], 'give one, e.g. --period "2 ms"'),
        (["export", "out/small/design.json", "--to", "c", "--option", "worst", "--period", "2 m"], "--period: "),
        (["export", "out/small/design.json", "--to", "c", "--option", "worst", "--period", "0 ms"], "--period: "),
        (["export", "out/small/design.json", "--to", "c", "--option", "worst", "--period", "0.5 s"], "not stable"),
        (["design", "small.toml", "--option", "lqg"], 'no option is called "lqg"; did you mean "lqr"?'),
        (["design", "small.toml", "--option", "bare"], '"bare" has neither a control law nor a damping budget'),
        (["design", "small.tom"], "small.tom"),
    ):
        assert main(arguments) == 2, arguments
        out, err = capsys.readouterr()
        assert out == "" and said in err and err.count("\n") == 1, err
    assert sorted(path.name for path in (here / "out/small").iterdir())[:2] == ["design.html", "design.json"]


def test_export_to_every_target(here: Path, capsys: Capture, tmp_path: Path) -> None:
    for target, names in (
        ("mat", ["worst.mat"]), ("json", ["worst.json"]), ("c", ["worst.c", "worst.h"]),
        ("python", ["worst.py", "worst_sampled.py"]),
    ):  # fmt: skip
        where = tmp_path / target
        given = ["export", "out/small/design.json", "--to", target, "--option", "worst", "--period", "1 ms"]
        assert main([*given, "--out", str(where)]) == 0
        assert sorted(path.name for path in where.iterdir()) == names
        assert all(f"written: {where / name}" in capsys.readouterr().out for name in names[:1])


def test_a_law_that_does_not_exist_ends_with_one(here: Path, capsys: Capture, tmp_path: Path) -> None:
    hopeless = (
        ACTUATOR.format(name="limited", label="Limited")
        + '[option.control]\nlaw = "mpc"\nsampling_period = "20 ms"\nhorizon = 5\n'
        'start = [{ output = "car.heave", value = "1 mm" }]\nduration = "0.1 s"' + ALLOWED
        + '[[option.control.limit]]\noutput = "cylinder.stroke"\nvalue = "20 mm"\n'
    )  # fmt: skip
    file = tmp_path / "some.toml"
    file.write_text(VEHICLE + hopeless + LQR, encoding="utf-8")
    with pytest.MonkeyPatch.context() as patch:
        from maglev_ctrl.errors import ModelError
        from maglev_ctrl.study.design import option

        made = option.make_law

        def no_set(scenario, one, model):
            if one.name == "limited":
                raise ModelError("no terminal set was found within 200 steps")
            return made(scenario, one, model)

        patch.setattr(option, "make_law", no_set)
        assert main(["design", str(file), "--jobs", "1", "--out", str(tmp_path / "out")]) == 1
    out = capsys.readouterr().out
    assert "NOT" in out and "no terminal set was found within 200 steps" in out and "PASS" in out
    assert len(json.loads((tmp_path / "out/design.json").read_text(encoding="utf-8"))["designs"]) == 1


def test_an_interrupt_leaves_what_was_there(here: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch) -> None:
    before = {path: path.read_bytes() for path in sorted((here / "out/small").rglob("*")) if path.is_file()}

    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(run, "study_law", interrupted)
    assert main(["design", "small.toml", "--jobs", "1"]) == 130
    assert "interrupted; nothing was written" in capsys.readouterr().err
    assert {path: path.read_bytes() for path in sorted((here / "out/small").rglob("*")) if path.is_file()} == before


def test_help_tells_the_verbs_and_loads_nothing_heavy() -> None:
    script = (
        "import sys; from maglev_ctrl.cli import main; status = main(['VERB', '--help'] if 'VERB' else ['--help']); "
        "heavy = {'numpy', 'scipy', 'pint', 'rich', 'cvxpy', 'osqp', 'matplotlib'} & set(sys.modules); "
        "print(heavy, file=sys.stderr); sys.exit(status or bool(heavy))"
    )
    for verb, said in (("", ("design", "export", "verify")), ("design", ("--option", "--jobs")),
                       ("export", ("--period", "--to")), ("verify", ("DESIGN.json",))):  # fmt: skip
        done = subprocess.run(
            [sys.executable, "-c", script.replace("VERB", verb)], capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr
        assert all(word in done.stdout for word in said)


def test_a_changed_text_is_told_and_not_exported(here: Path, capsys: Capture, tmp_path: Path) -> None:
    document = json.loads((here / "out/small/design.json").read_text(encoding="utf-8"))
    document["designs"][0]["scenario"]["text"] += "\n# another vehicle"
    (tmp_path / "changed.json").write_text(json.dumps(document), encoding="utf-8")
    assert main(["verify", str(tmp_path / "changed.json")]) == 1
    told = capsys.readouterr().out
    assert "not as it was written" in told and told.endswith("NOT PROVED\n")
    name = document["designs"][0]["name"]
    assert main(["export", str(tmp_path / "changed.json"), "--to", "json", "--option", name]) == 2
    assert "nothing is exported: the file is not as it was written" in capsys.readouterr().err


def test_design_verify_and_export_answer_in_json(here: Path, capsys: Capture) -> None:
    made = str(here / "out/small/design.json")
    assert main(["verify", made, "--json"]) == 0
    found = json.loads(capsys.readouterr().out, parse_constant=pytest.fail)
    assert found["proved"] and [one["name"] for one in found["designs"]] == ["lqr", "worst"]
    assert all(claim["proved"] for one in found["designs"] for claim in one["claims"])
    assert main(["export", made, "--option", "lqr", "--to", "python", "--out", "json", "--json"]) == 0
    found = json.loads(capsys.readouterr().out, parse_constant=pytest.fail)
    assert found["to"] == "python" and [Path(one).name for one in found["written"]][:1] == ["lqr.py"]
    assert main(["design", "small.toml", "--option", "lqr", "--out", "again", "--json"]) == 0
    found = json.loads(capsys.readouterr().out, parse_constant=pytest.fail)
    assert [one["verdict"] for one in found["options"]] == ["PASS"] and found["options"][0]["claims"]
