"""Words with markup of every kind in them (HTML, Typst, Markdown, LaTeX, spreadsheets, terminals) stay words."""

from __future__ import annotations

import csv
import io
import json
import re
import shutil
import subprocess
from html.parser import HTMLParser
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest
from test_design_file import written as design_written
from test_hostile_json import placed

from maglev_ctrl.errors import ModelError, Verdict
from maglev_ctrl.exchange.c_code import c_source
from maglev_ctrl.exchange.python_code import python_source
from maglev_ctrl.proofs.file import from_document
from maglev_ctrl.report import html as html_module
from maglev_ctrl.report import markdown as markdown_module
from maglev_ctrl.report.chart import Axis, Chart, Line, Marks, Note, Panel
from maglev_ctrl.report.html import html
from maglev_ctrl.report.identification_values import Result, to_csv
from maglev_ctrl.report.interactive import interactive
from maglev_ctrl.report.markdown import markdown
from maglev_ctrl.report.model import (
    Banner,
    Bullets,
    Cell,
    Cover,
    FigureBlock,
    Listing,
    Paragraph,
    Passage,
    Reference,
    Report,
    Section,
    Table,
    Tile,
)
from maglev_ctrl.report.pdf import pdf
from maglev_ctrl.report.vector import svg
from maglev_ctrl.scenario.oscillation import read_oscillations
from maglev_ctrl.scenario.reader import load_text
from maglev_ctrl.scenario.starter import starter_text
from maglev_ctrl.systems import Controller

HOSTILE = (
    "<script>alert(1)</script>", "<img src=x onerror=alert(1)>", "<svg/onload=alert(1)>",
    "</style><style>*{display:none}",
    "</title><base href=//evil.example>", '" onmouseover="alert(1)', "' onfocus='alert(1)' autofocus='",
    "</code></pre><b>",
    "</script><script>", "<!--", "]]>", "&lt;script&gt;", "javascript:alert(1)", "{{ 7*7 }}{% raw %}", "{# x #}",
    '#import "@preview/x:1.0.0": *', '#read("/etc/passwd")', "#eval(\"1\")", "#panic()", '#include "main.typ"',
    "@main <label>",
    "#set page(width: 1pt)", "[a](javascript:alert(1))", "![a](http://evil.example/x.png)", "<http://evil.example>",
    "http://evil.example/auto", "# heading", "- item", "1. item", "> quote", "```", "~~~", "***", "| a | b |",
    "[^1]: x",
    "$\\frac{$", "$$x$$", "\\input{/etc/passwd}", "\\write18{id}", "$x^2$", "_{", "%{x}", "%d%s%n", "\\u0041", "\\",
    "`", "::: div",
    "=cmd|' /C calc'!A0", "+1+1", "@SUM(1)", "[red]x[/red]", "[/]", "[link=http://evil.example]x[/link]",
    "\u202eabc\u202c", "\u2028",
    "\x1b[31m", "\x00", "\ufffe", "\U0001f600", "a\nb", "\t",
)  # fmt: skip
ALL = " ; ".join(HOSTILE)


def chart(words: str) -> Chart:
    at = np.array([0.0, 1.0])
    items = (Line(at, at, words), Marks(at, at, "circle", words, hover=(words, words)), Note(0.5, 0.5, words))
    axis = Axis(words, (0.0, 1.0), (0.0, 1.0), (words, words))
    return Chart("only", words, words, (Panel(items, axis, axis, words),))


def report(words: str, *, pictured: bool = True) -> Report:
    """A report with these words in every place that takes words."""
    figure = (FigureBlock(chart(words)),) if pictured else ()
    table = Table(words, (words, "value"), ((Cell(words), Cell(words, Verdict.FAIL)),), key="t")
    blocks = (
        Paragraph(words), Passage((words, Reference("table:t"), words)), Bullets((words, words)),
        Banner(Verdict.PASS, words),
        Banner(None, words), table, Listing(words), *figure,
    )  # fmt: skip
    cover = Cover(((words, words),), Banner(Verdict.FAIL, words), (Tile(words, words, words, Verdict.FAIL),))
    sections = (Section(words, "one", 1, blocks, Verdict.FAIL), Section(words, "two", 2, (Paragraph(words),)))
    return Report(words, words, words, words, words, sections, cover)


class Seen(HTMLParser):
    """Every tag and attribute of a page."""

    def __init__(self) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.told: list[tuple[str, str]] = []
        self.targets: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        for name, value in attrs:
            self.told.append((tag, name))
            if name in ("href", "src", "action", "data", "xlink:href", "srcdoc", "formaction"):
                self.targets.append(value or "")


def seen(page: str) -> Seen:
    found = Seen()
    found.feed(page)
    return found


def pictures(made: Report) -> dict[str, str]:
    return {one.key: svg(one) for one in made.charts()}


@pytest.fixture(scope="module")
def pages() -> tuple[str, str]:
    """A page with harmless words everywhere, and the same with hostile ones."""
    made = []
    for words in ("harmless", ALL):
        one = report(words)
        made.append(html(one, pictures(one)))
    return made[0], made[1]


def test_hostile_words_add_no_tag_and_no_attribute_to_a_page(pages: tuple[str, str]) -> None:
    plain, hostile = (seen(page) for page in pages)
    outside = {"path", "g", "use", "defs", "rect", "text", "tspan", "clippath", "style"}  # letters are drawn one by one
    assert [tag for tag in plain.tags if tag not in outside] == [tag for tag in hostile.tags if tag not in outside]
    assert plain.tags.count("style") == hostile.tags.count("style")
    assert not any(name.startswith("on") for _, name in hostile.told)
    assert all(target.startswith(("#", "data:,")) for target in hostile.targets), set(hostile.targets)
    assert "\x1b" not in pages[1] and "\x00" not in pages[1]


def test_without_escaping_they_would(monkeypatch: pytest.MonkeyPatch) -> None:
    import jinja2

    given = jinja2.Environment

    def careless(**how: object) -> jinja2.Environment:
        return given(**{**how, "autoescape": False})  # type: ignore[arg-type]

    monkeypatch.setattr(jinja2, "Environment", careless)
    made = report(ALL, pictured=False)
    assert any(name.startswith("on") for _, name in seen(html_module.html(made, {})).told)


def test_figures_hold_no_markup_for_the_live_page() -> None:
    shown = json.dumps([
        {key: value for key,
        value in trace.items() if key != "legendgroup"} for trace in interactive(chart(ALL))["data"]
    ] + [interactive(chart(ALL))["layout"]])  # fmt: skip  # a group's name is compared, never shown
    assert not re.search(r"<(?!br>|/?extra>)[a-zA-Z/!]", shown) and "&lt;script&gt;" in shown
    drawn = svg(chart(ALL))
    assert "<script" not in drawn and "onerror" not in re.sub(r">[^<]*<", "><", drawn)


def rendered(text: str) -> str:
    markdown_it = pytest.importorskip("markdown_it")
    return str(markdown_it.MarkdownIt("commonmark", {"html": True}).enable("table").render(text))


@pytest.mark.parametrize("words", [*(one for one in HOSTILE if one.strip()), ALL], ids=lambda words: f"{len(words)}")
def test_hostile_words_are_no_markdown(words: str) -> None:
    made = markdown(report(words, pictured=False), {})["report.md"].decode()
    plain = markdown(report("harmless", pictured=False), {})["report.md"].decode()
    found, expected = seen(rendered(made)), seen(rendered(plain))
    skipped = ("p", "br") if "\n" in words else ()
    assert [tag for tag in found.tags if tag not in skipped] == [tag for tag in expected.tags if tag not in skipped]
    assert all(target.startswith("#") for target in found.targets), found.targets


def test_without_escaping_markdown_would(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(markdown_module, "plain", lambda text: text)
    made = markdown_module.markdown(report(ALL, pictured=False), {})["report.md"].decode()
    assert "script" in seen(rendered(made)).tags


def test_typst_takes_words_as_words(tmp_path: Path) -> None:
    """One document with all of them: it is written, and the words stand in it as they are."""
    made = report(ALL)
    content = pdf(made, pictures(made))
    assert content.startswith(b"%PDF") and len(content) < 5_000_000
    tool = shutil.which("pdftotext")
    if tool is not None:
        (tmp_path / "a.pdf").write_bytes(content)
        told = subprocess.run([tool, str(tmp_path / "a.pdf"), "-"], check=True, capture_output=True).stdout.decode()
        flat = re.sub(r"\s+", "", told)
        for words in ('#read("/etc/passwd")', "#panic()", "$x^2$", "[/]"):
            assert words in flat
        assert "root:" not in told


def test_the_template_runs_formulas_only() -> None:
    """Typst's `eval` is called once, on the program's own formulas; every other text is data."""
    source = files("maglev_ctrl.report").joinpath("templates", "report.typ").read_text(encoding="utf-8")
    code = re.sub(r"//.*", "", source)
    assert re.findall(r"\beval\([^)]*\)", code) == ['eval(block.math, mode: "math")']
    assert re.findall(r"\b(?:read|plugin|include|import|csv|yaml|toml|xml|cbor)\b\s*[(\"]", code) == []
    assert re.findall(r"\bjson\([^)]*\)", code) == ['json("model.json")']


# Files for other programs ------------------------------------------------------------------------------------------


def test_names_of_data_are_no_formulas_in_a_spreadsheet(tmp_path: Path) -> None:
    file = tmp_path / "a.csv"
    rows = "".join(f"{f},=cmd|x,@sum(1),{3.0 + 0.1 * f},{10.0 + f}\n" for f in (1, 2, 3, 4, 5))
    file.write_text("frequency [Hz],force,motion,amplitude [N/m],phase [deg]\n" + rows)
    results = [Result(one, one.identify()) for one in read_oscillations([file])]
    cells = [cell for row in list(csv.reader(io.StringIO(to_csv(results))))[1:] for cell in row]
    assert "'=cmd|x" in cells and "'@sum(1)" in cells
    assert not any(cell.startswith(("=", "@", "+", "\t", "\r")) for cell in cells)


def test_names_of_a_law_stay_in_their_comments_and_texts() -> None:
    evil = '*/ int evil; /* """ + evil + """ \' \\ ??/ \n evil = 1 #evil'
    law = Controller.static([[-3.0]], measured=("gap",), commands=("force",), dt=0.001, name=evil)
    header, source = c_source(law, "hover", comment=evil, origin=evil, units={"gap": evil})
    for text in (header, source):
        assert "evil" not in re.sub(r"/\*.*?\*/", "", text.replace("\\\n", ""), flags=re.DOTALL)
    import ast

    tree = ast.parse(python_source(law, origin=evil))
    names = {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}
    assert "evil" not in names and not any(isinstance(node, ast.FunctionDef) for node in ast.walk(tree))
    assert [node.module if isinstance(node, ast.ImportFrom) else node.names[0].name for node in ast.walk(tree)
            if isinstance(node, ast.Import | ast.ImportFrom)] == ["control", "numpy"]  # fmt: skip


@pytest.mark.parametrize(
    "name", ["../../x", "a/b", "con", "\u4e2d" * 90, "x" * 400, ".", "..", "-rf", "C:\\x", "$(id)", "a b"]
)
def test_files_of_an_export_stay_in_their_folder(name: str) -> None:
    from maglev_ctrl.report.design.exports import TARGETS, export_design

    design = from_document(placed(design_written(), ("name",), name))
    for target in TARGETS:
        try:
            made = export_design(design, target)
        except (ModelError, ValueError):
            continue
        for file in made:
            assert re.fullmatch(r"[A-Za-z][A-Za-z0-9_]{0,80}\.[a-z]+", file), file


# Terminal ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("words", ["\x1b[31m", "\x9b2J", "\x07", "\u202e", "\x7f"])
@pytest.mark.parametrize("key", ["title", "description", "sources.x", "option.label"])
def test_signs_that_steer_a_terminal_are_refused_wherever_they_stand(words: str, key: str) -> None:
    escaped = json.dumps(f"a{words}b")
    text = starter_text("Steered")
    if key == "option.label":
        text = text.replace("[[option]]\n", f"[[option]]\nlabel = {escaped}\n", 1)
    elif key == "sources.x":
        text = re.sub(r"^\[sources\]\n", "", text, flags=re.MULTILINE) + f"\n[sources]\nx = {escaped}\n"
    else:
        text = re.sub(rf"^{key} = .*$", "", text, count=1, flags=re.MULTILINE)
        text = text.replace("format = 1\n", f"format = 1\n{key} = {escaped}\n", 1)
    with pytest.raises(Exception, match=r"without control signs|expected valid TOML|cannot") as told:
        load_text(text, "steered.toml")
    assert all(sign.isprintable() or sign == "\n" for sign in str(told.value))
