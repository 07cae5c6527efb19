"""maglev-ctrl diff: exit status by verdicts, one sentence for wrong input, tables that name what changed."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from test_report_difference import option, report, requirement

from maglev_ctrl.cli import main
from maglev_ctrl.report.style import MINUS


def written(folder: Path, *options: dict[str, Any], **other: Any) -> Path:
    folder.mkdir()
    (folder / "report.json").write_text(json.dumps(report(*options, **other)), encoding="utf-8")
    return folder


@pytest.fixture
def pair(tmp_path: Path) -> tuple[Path, Path]:
    """A report, and one in which a requirement of an option fails, with more said of it."""
    good = option("bare", requirement(), requirement("damping", value=0.1, unit="", sense="at_least"))
    bad = option("bare", requirement(verdict="FAIL", value=0.25, worst_at="speed 200 km/h"),
                 requirement("damping", value=0.2, unit="", sense="at_least", limit=0.05), verdict="FAIL")  # fmt: skip
    calm = option("calm", requirement(), kind="other")
    return (
        written(tmp_path / "a", calm, good),
        written(tmp_path / "b", calm, bad, scenario_text="a = 2 # [x]\n", scenario_hash="2f"),
    )


def test_nothing_changed(pair: tuple[Path, Path], capsys: pytest.CaptureFixture[str]) -> None:
    for one in pair:
        assert main(["diff", str(one), str(one / "report.json")]) == 0
        out = capsys.readouterr().out
        assert out.splitlines()[1:] == [
            "no difference: 2 option(s) in both reports with 3 requirement(s), no verdict changed"
        ]


def test_worse_is_1_and_the_exchange_is_0(pair: tuple[Path, Path], capsys: pytest.CaptureFixture[str]) -> None:
    before, after = map(str, pair)
    assert main(["diff", before, after]) == 1
    out = capsys.readouterr().out
    for words in ("Bare: PASS → FAIL", "-a = 1", "+a = 2 # [x]",
                  f"{MINUS}0.500 1/s", "0.250 1/s", "+0.750 1/s (+150 %), worse",
                  "speed 100 km/h → speed 200 km/h", "limit ≥ 0 → 0.0500, tighter", "stable: too fast",
                  "without a difference: Calm", "NOT AS GOOD: 2 option(s)", "1 worse; Bare: stable"):  # fmt: skip
        assert words in out, words
    assert main(["diff", after, before]) == 0
    out = capsys.readouterr().out
    assert (
        "at least as good: 2 option(s)" in out
        and "1 better" in out
        and f"{MINUS}0.750 1/s ({MINUS}300 %), better" in out
    )


def test_json(pair: tuple[Path, Path], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["diff", str(pair[0]), str(pair[1]), "--json"]) == 1
    found = json.loads(capsys.readouterr().out)
    assert (found["kind"], found["format"], found["at_least_as_good"]) == ("maglev-ctrl difference", 1, False)
    first = found["options"][0]
    assert (first["name_after"], first["standing"], first["counted"]) == ("bare", "both", ["stable"])
    assert first["requirements"][0]["value"]["absolute"] == 0.75
    assert first["requirements"][0]["outcome"] == "worse" and first["requirements"][0]["verdict_before"] == "PASS"


def test_tolerance(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    one, two = (str(written(tmp_path / f"{v}", option("bare", requirement(value=v)))) for v in (-0.5, -0.501))
    assert main(["diff", one, two]) == 0
    assert f"{MINUS}0.00100 1/s" in capsys.readouterr().out
    assert main(["diff", one, two, "--tolerance", "0.01"]) == 0
    assert "no difference" in capsys.readouterr().out
    for wrong in ("-1", "1", "nan"):
        assert main(["diff", one, two, "--tolerance", wrong]) == 2
        assert "expected at least 0 and below 1" in capsys.readouterr().err


def test_gone_new_and_not_evaluated(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    missing = requirement("height", "NOT EVALUATED", "NaN", reason="no [equilibrium]")
    before = written(tmp_path / "a", option("bare", requirement()), option("coil", requirement(), kind="active"))
    after = written(tmp_path / "b", option("bare", missing), option("rail", requirement(verdict="FAIL"), kind="rail"))
    assert main(["diff", str(before), str(after)]) == 1
    out = capsys.readouterr().out
    for words in ("Coil: gone: PASS", "Rail: new: PASS", "PASS → gone", "not asked → NOT EVALUATED",
                  "1 gone, 1 new, not passed; 1 option(s) gone; 1 option(s) new; Bare: stable, height"):  # fmt: skip
        assert words in out, words


def test_wrong_input(tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    written(tmp_path / "good", option())
    for folder, name, content in (
        ("maps", "map.json", b"{}"), ("laws", "design.json", b"{}"), ("page", "report.html", b""), ("empty", None, b""),
        ("broken", "report.json", b'{\n "format": 1,\n'), ("number", "report.json", b"3"),
        ("nan", "report.json", b"[NaN]"),
        ("bytes", "report.json", b"\xff\xfe{"), ("deep", "report.json", b"[" * 100_000),
        ("law", "report.json", b'{"format": "d"}'),
        ("later", "report.json", json.dumps(report() | {"format": 2}).encode()),
    ):  # fmt: skip
        (tmp_path / folder).mkdir()
        if name is not None:
            (tmp_path / folder / name).write_bytes(content)
    for argument, said in (
        ("nowhere", "nowhere: expected a folder with report.json, or that file; there is nothing here"),
        ("maps", "maps: not a report but stability maps (map.json); `maglev-ctrl report SCENARIO` writes report.json"),
        ("laws", "laws: not a report but designs (design.json); `maglev-ctrl report SCENARIO` writes report.json"),
        ("page", "page: the report there has no report.json; write it again with --format html,pdf,json"),
        ("empty", "empty: no report.json in this folder; `maglev-ctrl report SCENARIO` writes report.json"),
        ("broken", "broken/report.json:3:1: expected JSON: Expecting property name enclosed in double quotes"),
        ("number", "number/report.json: not a report; `maglev-ctrl report SCENARIO` writes report.json"),
        ("nan", "nan/report.json: expected JSON: NaN is no JSON number"),
        ("bytes", "bytes/report.json: expected JSON in UTF-8, got other bytes"),
        ("deep", "deep/report.json: expected a report, got JSON nested too deeply"),
        ("law", "law/report.json: not a report but d; `maglev-ctrl report SCENARIO` writes report.json"),
        ("later", "later/report.json: format: this version reads reports of format 1, got 2"),
    ):
        for pair in ((argument, "good"), ("good", argument)):
            assert main(["diff", *pair]) == 2
            out, err = capsys.readouterr()
            assert out == "" and err == f"{said}\n"
    assert main(["diff", "good"]) == 2
