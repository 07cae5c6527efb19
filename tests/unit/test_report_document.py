"""The written report: complete, offline, safe against hostile words, all or nothing."""

from __future__ import annotations

import json
import math
import re
import shutil
import subprocess
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest
import report_fixture

from maglev_ctrl.errors import Verdict
from maglev_ctrl.report import charts_modes, document, swap, write
from maglev_ctrl.report.content import report_model
from maglev_ctrl.report.interactive import unpacked
from maglev_ctrl.report.schema import SCHEMA
from maglev_ctrl.study.records import Comparison

HOSTILE = (
    '<script>alert("x")</script> #panic("p") $x^2$ *b* _i_ @ref [c] \\ `r` {{ 7*7 }} %{x} &'
    ' "q" style="} body { display: none } p {" \u2028'
)


@pytest.fixture(scope="session")
def comparison() -> Comparison:
    return report_fixture.comparison(points=8, cells=12)


@pytest.fixture(scope="session")
def written(comparison: Comparison, tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    folder = tmp_path_factory.mktemp("report") / "out"
    paths = write(comparison, folder)
    assert [p.name for p in paths] == ["report.html", "report.pdf", "report.json"]
    return {p.suffix: p.read_bytes() for p in paths}


class _Page(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.links: list[str] = []
        self.ids: list[str] = []
        self.images: list[dict[str, str | None]] = []
        self.figures = 0
        self.scripts = 0

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        self.links += [given[k] or "" for k in ("href", "src", "xlink:href", "action", "data") if k in given]
        if given.get("id"):
            self.ids.append(str(given["id"]))
        self.figures += tag == "figure"
        self.scripts += tag == "script"
        if tag in ("svg", "img"):
            self.images.append(given)


def _page(text: str) -> _Page:
    page = _Page()
    page.feed(text)
    return page


def test_page_asks_nothing_of_the_network(written: dict[str, bytes]) -> None:
    text = written[".html"].decode()
    assert all(link.startswith(("#", "data:")) for link in _page(text).links)
    assert not re.search(r"@import|url\(\s*['\"]?(?!#)[a-z]+:", text)
    assert "fetch(" not in text
    assert "XMLHttpRequest" not in text


def test_page_is_small_and_holds_the_library_once(written: dict[str, bytes]) -> None:
    text = written[".html"].decode()
    assert len(written[".html"]) < 3_000_000
    packed = re.findall(r'id="figure-library">([^<]*)</script>', text)
    assert len(packed) == 1
    assert b"plotly.js v" in unpacked(packed[0])[:200]


def test_nine_options_stay_below_three_megabytes(comparison: Comparison, tmp_path: Path) -> None:
    nine = tuple(replace(comparison.options[i % 3], name=f"option_{i}") for i in range(9))
    (path,) = write(replace(comparison, options=nine), tmp_path / "nine", formats=("html",))
    assert path.stat().st_size < 3_000_000


def test_every_figure_has_words_for_those_who_cannot_see_it(comparison: Comparison, written: dict[str, bytes]) -> None:
    page = _page(written[".html"].decode())
    expected = list(report_model(comparison).charts())
    assert page.figures == len(expected) == len(page.images)
    assert all(image["role"] == "img" and len(str(image["aria-label"])) > 30 for image in page.images)
    assert len(set(page.ids)) == len(page.ids)


def test_contents_lead_to_existing_headings(written: dict[str, bytes]) -> None:
    page = _page(written[".html"].decode())
    anchors = [
        link[1:] for link in page.links if link.startswith("#") and not re.match(r"#m[0-9a-f]{10}|#h[0-9a-f]+", link)
    ]
    assert set(anchors) <= set(page.ids)


def test_live_figures_are_valid_plotly(written: dict[str, bytes]) -> None:
    import plotly.graph_objects as go

    packed = re.findall(r'id="figure-data">([^<]*)</script>', written[".html"].decode())[0]
    specs = json.loads(unpacked(packed))
    assert "windings-nyquist" in specs
    for spec in specs.values():
        text = json.dumps(spec).replace("paper-colour", "white")
        assert go.Figure(json.loads(text)).data


def test_what_was_not_evaluated_is_said(written: dict[str, bytes]) -> None:
    text = written[".html"].decode()
    assert "? NOT EVALUATED" in text
    assert "the option adds no loop" in text
    assert text.count('class="unknown') >= 2


def test_pdf_is_a_titled_document_of_many_pages(comparison: Comparison, written: dict[str, bytes]) -> None:
    assert written[".pdf"].startswith(b"%PDF-1.7")
    pages = len(re.findall(rb"/Type\s*/Page\b", written[".pdf"]))
    assert pages >= 3 + 3 * len(comparison.options)
    assert b"Three ways to suspend a test train" in written[".pdf"]


def test_json_round_trip_keeps_units_and_verdicts(comparison: Comparison, written: dict[str, bytes]) -> None:
    data = json.loads(written[".json"])
    assert data["verdict"] == comparison.verdict.value
    assert data["design_speed"] == {"value": comparison.design_speed, "unit": "m/s"}
    for option, plain in zip(comparison.options, data["options"], strict=True):
        assert plain["verdict"] == option.verdict.value
        for judged, told in zip(option.requirements, plain["requirements"], strict=True):
            assert told["verdict"] == judged.verdict.value
            assert told["value"]["unit"] == judged.unit
            value = told["value"]["value"]
            assert value == judged.value or (value == "NaN" and math.isnan(judged.value)) or value == "Infinity"
    bare = data["options"][0]
    assert bare["modes"]["frequency"]["unit"] == "Hz"
    assert bare["requirements"][2]["value"] == {"value": "NaN", "unit": ""}
    assert data["options"][1]["margins"]["channels"][0]["phase"]["unit"] == "deg"


def test_json_obeys_its_schema_and_a_broken_one_does_not(written: dict[str, bytes]) -> None:
    data = json.loads(written[".json"])
    assert _faults(SCHEMA, data) == []
    data["options"][0]["requirements"][0]["verdict"] = "MAYBE"
    del data["design_speed"]["unit"]
    assert data["options"][1]["floquet"]["margins"]["speed"][1]["safe"]["unit"] == "m/s"
    data["options"][1]["floquet"]["margins"]["depth"]["bound"] = "exactly"
    assert len(_faults(SCHEMA, data)) == 3


def _faults(schema: dict[str, Any], value: Any, at: str = "$") -> list[str]:
    """The few words of JSON Schema that ours uses."""
    kinds = {"object": dict, "array": list, "string": str, "number": (int, float), "null": type(None),
             "boolean": bool}  # fmt: skip
    if "anyOf" in schema:
        return [] if any(not _faults(s, value, at) for s in schema["anyOf"]) else [at]
    if "enum" in schema:
        return [] if value in schema["enum"] else [at]
    if "const" in schema:
        return [] if value == schema["const"] else [at]
    if "type" in schema and not isinstance(value, kinds[schema["type"]]):
        return [at]
    found = [f"{at}.{key}" for key in schema.get("required", []) if key not in value]
    for key, inner in schema.get("properties", {}).items():
        if isinstance(value, dict) and key in value:
            found += _faults(inner, value[key], f"{at}.{key}")
    if "items" in schema:
        found += [fault for i, entry in enumerate(value) for fault in _faults(schema["items"], entry, f"{at}[{i}]")]
    return found


def test_failure_leaves_the_earlier_report_alone(
    comparison: Comparison, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "out"
    write(comparison, folder, formats=("json",))
    (folder / "report.html").write_text("earlier")
    (folder / "notes.txt").write_text("mine")
    before = {p.name: p.read_bytes() for p in folder.iterdir()}

    def broken(_chart: object) -> str:
        raise RuntimeError("a figure failed")

    monkeypatch.setattr(document, "svg", broken)
    with pytest.raises(RuntimeError, match="a figure failed"):
        write(comparison, folder)
    assert {p.name: p.read_bytes() for p in folder.iterdir()} == before
    assert [p.name for p in tmp_path.iterdir()] == ["out"]


def test_an_interrupt_while_moving_leaves_the_earlier_report_alone(
    comparison: Comparison, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "out"
    folder.mkdir()
    for name in ("report.html", "report.pdf"):
        (folder / name).write_text("earlier")

    def interrupted(self: Path, target: Path) -> Path:
        raise KeyboardInterrupt

    monkeypatch.setattr(swap, "_exchange", interrupted)
    monkeypatch.setattr(Path, "rename", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write(comparison, folder, formats=("json",))
    assert {p.name: p.read_text() for p in folder.iterdir()} == {"report.html": "earlier", "report.pdf": "earlier"}
    assert [p.name for p in tmp_path.iterdir()] == ["out"]


def test_a_new_report_replaces_the_old_and_keeps_other_files(comparison: Comparison, tmp_path: Path) -> None:
    folder = tmp_path / "out"
    folder.mkdir()
    (folder / "notes.txt").write_text("mine")
    (folder / "report.json").write_text("old")
    (folder / "report.pdf").write_text("of an earlier run, which the new report would contradict")
    write(comparison, folder, formats=("json",))
    assert sorted(p.name for p in folder.iterdir()) == ["notes.txt", "report.json"]
    assert (folder / "notes.txt").read_text() == "mine"
    assert json.loads((folder / "report.json").read_text())["format"] == 1
    assert [p.name for p in tmp_path.iterdir()] == ["out"]


@pytest.mark.parametrize("formats", [(), ("docx",), ("pdf", "pdf")])
def test_unknown_formats_are_refused(comparison: Comparison, tmp_path: Path, formats: tuple[str, ...]) -> None:
    with pytest.raises(ValueError, match="formats: expected"):
        write(comparison, tmp_path / "out", formats=formats)  # type: ignore[arg-type]


def _hostile(comparison: Comparison) -> Comparison:
    first = comparison.options[1]
    judged = replace(first.requirements[0], name=HOSTILE, worst_at=HOSTILE, reason=HOSTILE)
    option = replace(first, label=HOSTILE, name=HOSTILE, notes=(HOSTILE,), requirements=(judged,))
    return replace(comparison, title=HOSTILE, description=HOSTILE, scenario_text=HOSTILE, options=(option,))


def test_hostile_words_stay_words(comparison: Comparison, tmp_path: Path) -> None:
    html, pdf, data = write(_hostile(comparison), tmp_path / "out")
    text = html.read_text(encoding="utf-8")
    assert "<script>alert" not in text
    assert _page(text).scripts == 3
    assert "{{ 7*7 }}" in text
    assert "display: none }" not in "".join(re.findall(r"<style>(.*?)</style>", text, re.DOTALL))
    assert pdf.read_bytes().startswith(b"%PDF")
    assert json.loads(data.read_text(encoding="utf-8"))["title"] == HOSTILE


def test_hostile_words_reach_the_pdf_unchanged(comparison: Comparison, tmp_path: Path) -> None:
    tool = shutil.which("pdftotext")
    if tool is None:
        pytest.skip("pdftotext (poppler-utils) is not installed")
    (pdf,) = write(_hostile(comparison), tmp_path / "out", formats=("pdf",))
    told = subprocess.run([tool, str(pdf), "-"], check=True, capture_output=True).stdout.decode()
    assert '#panic("p")' in told
    assert "$x^2$" in told


def test_an_option_that_failed_still_has_its_page(comparison: Comparison, tmp_path: Path) -> None:
    failed = replace(
        comparison.options[0], failure="there is no equilibrium", equilibrium=None, system=None, open_system=None,
        modes=None, sweeps=(), locus=None, margins=None, margins_reason="no equilibrium", nyquist=(), floquet=None,
        floquet_reason="no equilibrium",
        requirements=tuple(replace(r, verdict=Verdict.NOT_EVALUATED, value=math.nan, margin_percent=math.nan)
                           for r in comparison.options[0].requirements),
    )  # fmt: skip
    paths = write(replace(comparison, options=(failed, comparison.options[1])), tmp_path / "out")
    assert "there is no equilibrium" in paths[0].read_text(encoding="utf-8")
    assert json.loads(paths[2].read_text())["options"][0]["modes"] is None


def test_ledger_rows_add_up_to_the_growth_rate(comparison: Comparison) -> None:
    from maglev_ctrl.report.chart import Bars, Marks

    for option in comparison.options:
        chart = charts_modes.energy_ledger(option)
        assert chart is not None
        items = chart.panels[0].items
        for mark in (m for m in items if isinstance(m, Marks)):
            row = float(mark.y[0])
            total = sum(float(b.length[0]) for b in items if isinstance(b, Bars) and b.position[0] == row)
            assert total == pytest.approx(float(mark.x[0]), abs=0.01)  # shares below 0.1 % of the row are not drawn
