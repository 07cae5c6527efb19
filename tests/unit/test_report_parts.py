"""Cover, equations, references and the Markdown form of the report; what the PDF declares itself to be."""

from __future__ import annotations

import json
import re
import xml.etree.ElementTree as ElementTree
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import report_fixture

from maglev_ctrl.errors import Verdict
from maglev_ctrl.report import write
from maglev_ctrl.report.chart import Axis, Chart, Line, Panel, Span
from maglev_ctrl.report.content import report_model
from maglev_ctrl.report.content_cover import cover_tiles
from maglev_ctrl.report.content_worst import worst_blocks
from maglev_ctrl.report.html import html
from maglev_ctrl.report.interactive import interactive, unpacked, without_worker
from maglev_ctrl.report.markdown import FIGURES, markdown, plain
from maglev_ctrl.report.model import (
    Equation,
    FigureBlock,
    Listing,
    Paragraph,
    Passage,
    Reference,
    Report,
    Section,
    Tile,
)
from maglev_ctrl.report.model import Table as TableBlock
from maglev_ctrl.report.numbering import numbered
from maglev_ctrl.report.pdf import pdf
from maglev_ctrl.report.serialise import to_json
from maglev_ctrl.report.vector import relative, svg
from maglev_ctrl.study.records import Comparison, FloquetStudy, RequirementResult

SCRIPT = "<script>alert(1)</script>"


@pytest.fixture(scope="module")
def comparison() -> Comparison:
    return report_fixture.comparison(points=8, cells=12)


@pytest.fixture(scope="module")
def report(comparison: Comparison) -> Report:
    return report_model(comparison)


def _small(*blocks: object) -> Report:
    return Report("t", "s", "2026-01-02T03:04:05Z", "0" * 64, "1", (Section("S", "s", 1, tuple(blocks)),))  # type: ignore[arg-type]


def test_the_cover_tells_verdict_and_key_figures_of_the_option_shown_first(comparison: Comparison) -> None:
    asked = tuple(
        replace(o, requirements=(replace(o.requirements[0], quantity="growth_rate"), *o.requirements[1:]))
        for o in comparison.options
    )
    report = report_model(replace(comparison, options=asked))
    cover = report.cover
    assert cover is not None and cover.picture is not None
    assert 4 <= len(cover.tiles) <= 6
    tiles = {tile.label: tile for tile in cover.tiles}
    assert tiles["Options that pass"].value.endswith("of 3")
    assert tiles["Largest growth rate"].value.endswith("1/s") and "at most" in tiles["Largest growth rate"].detail
    assert dict(cover.facts)["Design speed"] == "500 km/h"
    assert next(iter(report.charts())).key == "cover"


def test_a_tile_without_a_requirement_has_no_verdict(comparison: Comparison) -> None:
    bare = replace(comparison, options=tuple(replace(o, requirements=()) for o in comparison.options))
    cover = report_model(bare).cover
    assert cover is not None
    judged = [tile for tile in cover.tiles if tile.detail.endswith("no limit is set")]
    assert judged and all(tile.verdict is None for tile in judged)
    assert all(tile.verdict is not Verdict.PASS for tile in cover.tiles)


def test_equations_are_well_formed_and_those_of_what_was_studied(report: Report, comparison: Comparison) -> None:
    found = [block for block in report.blocks() if isinstance(block, Equation)]
    keys = [block.key for block in found]
    assert keys == ["motion", "ledger", "shares", "lyapunov", "disk", "disk-peak", "floquet", "resonance"]
    for block in found:
        ElementTree.fromstring(f"<math>{block.formula.mathml}</math>")
        assert block.formula.latex.count("{") == block.formula.latex.count("}")
        assert len(block.formula.words) > 10 and block.source
    unforced = replace(comparison, options=tuple(replace(o, floquet=None, margins=None) for o in comparison.options))
    left = [block.key for block in report_model(unforced).blocks() if isinstance(block, Equation)]
    assert left == ["motion", "ledger", "shares", "lyapunov"]


def test_numbers_follow_reading_order_and_anchors_are_unique(report: Report) -> None:
    numbers = numbered(report)
    for kind in (FigureBlock, TableBlock, Equation):
        places = [numbers.of(block) for block in report.blocks() if isinstance(block, kind)]
        assert [place.number for place in places] == list(range(1, len(places) + 1))
    anchors = [place.anchor for place in numbers.blocks.values()] + [section.anchor for section in report.sections]
    assert len(set(anchors)) == len(anchors)
    assert all(re.fullmatch("[A-Za-z0-9-]+", anchor) for anchor in anchors)


def test_a_reference_to_nothing_is_a_fault_and_see_tells_only_what_is_there() -> None:
    with pytest.raises(ValueError, match="equation:none"):
        numbered(_small(Passage(("see ", Reference("equation:none")))))
    table = TableBlock("c", ("a",), (), key="one", see=("equation:none", "table:one"))
    assert [place.words for place in numbered(_small(table)).known(table.see)] == ["Table 1"]


def test_the_ledger_leads_to_its_equation_on_page_and_in_text(comparison: Comparison, tmp_path: Path) -> None:
    page, text, folder = write(comparison, tmp_path / "out", formats=("html", "md"))[:3]
    told = page.read_text(encoding="utf-8")
    ledger = re.search(r"<figcaption>(?:(?!</figcaption>).)*ledger of(?:(?!</figcaption>).)*", told, re.DOTALL)
    assert ledger is not None and '<a href="#equation-ledger">Eq. (2)</a>' in ledger.group()
    assert 'id="equation-ledger"' in told
    lines = text.read_text(encoding="utf-8").splitlines()
    assert any("ledger of" in line and "](#equation-ledger)" in line for line in lines)
    links = set(re.findall(r"\]\(#([^)]+)\)", "\n".join(lines)))
    assert links <= set(re.findall(r'<a id="([^"]+)"></a>', "\n".join(lines)))
    shown = re.findall(rf"\]\(({FIGURES}/[^)]+)\)", "\n".join(lines))
    assert sorted(shown) == sorted(f"{FIGURES}/{path.name}" for path in folder.iterdir())
    for path in folder.iterdir():
        ElementTree.parse(path)
    heads = [line.count(" | ") for line in lines if line.startswith("| ") and "\\|" not in line]
    assert heads and min(heads) >= 1


def test_a_report_without_text_takes_the_old_figures_with_it(comparison: Comparison, tmp_path: Path) -> None:
    write(comparison, tmp_path / "out", formats=("md",))
    assert {p.name for p in (tmp_path / "out").iterdir()} == {"report.md", FIGURES}
    write(comparison, tmp_path / "out", formats=("json",))
    assert [p.name for p in (tmp_path / "out").iterdir()] == ["report.json"]


def _scripted(comparison: Comparison) -> Comparison:
    first = comparison.options[1]
    judged = replace(first.requirements[0], name=SCRIPT, worst_at=SCRIPT, reason=SCRIPT)
    option = replace(first, label=SCRIPT, notes=(SCRIPT,), requirements=(judged, *first.requirements[1:]))
    return replace(
        comparison, title=SCRIPT, description=SCRIPT, scenario_text=SCRIPT, scenario_path=SCRIPT, created=SCRIPT,
        sources=((SCRIPT, SCRIPT),), assumptions=(SCRIPT,), options=(option,),
    )  # fmt: skip


def test_a_script_in_any_text_is_shown_as_text_in_all_formats(comparison: Comparison, tmp_path: Path) -> None:
    paths = write(_scripted(comparison), tmp_path / "out", formats=("html", "pdf", "json", "md"))
    page, paper, _, text, folder = paths
    told = page.read_text(encoding="utf-8")
    assert SCRIPT not in told and told.count("&lt;script&gt;") > 8
    assert paper.read_bytes().startswith(b"%PDF-1.7")
    outside = re.sub(r"^(```+)\n.*?^\1$", "", text.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
    assert SCRIPT not in outside and "<script" not in outside and outside.count("&lt;script&gt;") > 8
    assert all("<script" not in path.read_text(encoding="utf-8") for path in folder.iterdir())


def test_marks_of_markdown_do_nothing() -> None:
    told = plain("# a *b* [c](d) `e` | f <g> @h $i$ ~~j~~ !k")
    assert not re.search(r"(?<!\\)[*\[\]`|$~!#]", told.replace("&#64;", ""))
    assert "<" not in told and "@" not in told


def test_a_fence_in_the_scenario_does_not_end_the_listing(tmp_path: Path) -> None:
    text = markdown(_small(Listing("a\n````\n# not a heading")), {})["report.md"].decode()
    assert text.count("\n`````\n") == 2


def test_the_pdf_says_that_it_is_for_archives_and_for_readers_aloud() -> None:
    made = pdf(_small(Paragraph("words")), {})
    packet = re.search(rb"<x:xmpmeta.*?</x:xmpmeta>", made, re.DOTALL)
    assert packet is not None
    tree = ElementTree.fromstring(packet.group())
    told = {tag.tag: tag.text for tag in tree.iter()} | {k: v for tag in tree.iter() for k, v in tag.attrib.items()}
    assert told["{http://www.aiim.org/pdfa/ns/id/}part"] == "2"
    assert told["{http://www.aiim.org/pdfa/ns/id/}conformance"] == "A"
    assert told["{http://www.aiim.org/pdfua/ns/id/}part"] == "1"
    assert "2026-01-02T03:04:05" in packet.group().decode()
    assert b"/Lang" in made and b"/StructTreeRoot" in made
    assert made == pdf(_small(Paragraph("words")), {})


def test_straight_paths_by_steps_stay_within_a_twentieth_of_a_point() -> None:
    points = [(10.0 + 0.317 * k, 50.0 + 20.0 * ((7 * k) % 13) / 13.0) for k in range(400)]
    path = relative("M" + "L".join(f"{x:.3f} {y:.3f}" for x, y in points))
    numbers = [float(v) for v in re.findall(r"-?(?:\d+\.?\d*|\.\d+)", path)]
    x, y, seen = numbers[0], numbers[1], [(numbers[0], numbers[1])]
    for dx, dy in zip(numbers[2::2], numbers[3::2], strict=True):
        x, y = x + dx, y + dy
        seen.append((x, y))
    assert not set("hv") & set(path), "the walk below knows slanted steps only"
    assert len(seen) == len(points)
    assert max(abs(a - c) + abs(b - d) for (a, b), (c, d) in zip(seen, points, strict=True)) < 0.11


def test_only_the_worker_of_geographic_maps_is_left_out_of_the_library() -> None:
    library = b"x.exports='short';y.exports='it\\'s maplibre-gl-worker';z.exports='kept'"
    assert without_worker(library) == b"x.exports='short';y.exports='';z.exports='kept'"


def test_the_page_reads_back_what_it_packs(report: Report) -> None:
    chart = next(iter(report.charts()))
    made = html(_small(FigureBlock(chart)), {chart.key: svg(chart)})
    told = re.findall(r'id="figure-(?:data|library)">([^<]*)</script>', made)
    assert list(json.loads(unpacked(told[0]))) == [chart.key] and b"plotly.js v" in unpacked(told[1])[:200]
    without = re.findall(r'id="figure-(?:data|library)">([^<]*)</script>', html(_small(), {}))
    assert without[1] == "", "a page without figures carries no library"


def test_the_worst_perturbation_is_the_one_that_was_replayed(comparison: Comparison) -> None:
    margins = comparison.options[1].margins
    assert margins is not None
    blocks = worst_blocks(margins, "Damper windings", key="windings")
    words = "".join(part for part in blocks[0].parts if isinstance(part, str))  # type: ignore[union-attr]
    assert "puts a pole on the axis" in words and "no replay" not in words
    first = replace(margins.channels[0], disk=replace(margins.channels[0].disk, verified=False))
    doubt = worst_blocks(replace(margins, channels=(first,)), "x", key="k")
    assert "which no replay confirmed" in "".join(p for p in doubt[0].parts if isinstance(p, str))  # type: ignore[union-attr]


def test_json_holds_hostile_words_unchanged(comparison: Comparison) -> None:
    assert json.loads(to_json(_scripted(comparison)))["title"] == SCRIPT


def _labelled(words: str) -> tuple[Report, dict[str, str]]:
    line = Line(np.array([0.0, 1.0]), np.array([0.0, 1.0]), words)
    chart = Chart("k", words, words, (Panel((line,), Axis("t"), Axis(words)),))
    return replace(_small(FigureBlock(chart), Paragraph(words)), title=words), {"k": svg(chart)}


@pytest.mark.parametrize(
    "words",
    [
        r"a \1 \g<0> \e", "bell \x07 and \x00", "own \ue000 sign", "\ufeffmark", "\ufffe", "磁悬浮列车", "קרון",
        "a\u0308\u0308\u0308 \ufdfd", "🚄", "W" * 300, "word " * 90, r"$\bad{", "#let x = 1",
    ],
)  # fmt: skip
def test_odd_letters_break_no_format(words: str) -> None:
    report, pictures = _labelled(words)
    page = html(report, pictures)
    ElementTree.fromstring(pictures["k"])
    assert not re.search("[\x00-\x08\x0b\x0c\x0e-\x1f]", page + markdown(report, pictures)["report.md"].decode())
    if "\\" in words:
        assert f'aria-label="{words.replace("<", "&lt;").replace(">", "&gt;")}"' in page
    assert pdf(report, pictures).startswith(b"%PDF-1.7")


def test_a_page_that_would_be_too_large_keeps_its_last_figures_still_and_says_so(report: Report) -> None:
    pictures = {chart.key: svg(chart) for chart in report.charts()}
    keys = [chart.key for chart in report.charts()]
    whole = html(report, pictures)
    assert re.findall('data-chart="([^"]*)"', whole) == keys and "still pictures" not in whole
    fewer = html(report, pictures, largest=len(whole.encode()) - 4000)
    live = re.findall('data-chart="([^"]*)"', fewer)
    assert len(fewer.encode()) <= len(whole.encode()) - 4000
    assert live == keys[: len(live)] and 0 < len(live) < len(keys)
    assert f"The last {len(keys) - len(live)} of the figures are still pictures" in fewer
    assert fewer.count("<figure") == len(keys)
    none = html(report, pictures, largest=1_000_000)
    assert "All figures are still pictures" in none and len(none.encode()) <= 1_000_000
    assert "data-chart=" not in none and 'id="live"' not in none


def test_a_tile_never_shows_more_than_its_requirement(comparison: Comparison) -> None:
    option = comparison.options[1]
    assert option.floquet is not None
    asked = replace(
        option.requirements[0], quantity="modulation_ratio", limit=2.0, unit="", sense="at_least", hard=True,
        verdict=Verdict.NOT_EVALUATED,
    )  # fmt: skip
    quantities = ("growth_rate", "damping_ratio", "disk_margin", "weighted_acceleration")
    doubtful = (asked, *(replace(asked, quantity=quantity, value=float("nan")) for quantity in quantities))

    def tiles(requirements: tuple[RequirementResult, ...], floquet: FloquetStudy | None = option.floquet) -> list[Tile]:
        one = replace(option, requirements=requirements, floquet=floquet)
        return list(cover_tiles(replace(comparison, options=(one,))))

    found = tiles(doubtful)
    assert len(found) == 6 and all(tile.verdict is Verdict.NOT_EVALUATED for tile in found)
    missed = tuple(replace(r, hard=False, verdict=Verdict.FAIL) for r in doubtful)
    wishes = tiles(missed)[1:]
    assert all(tile.verdict is None and "a wish" in tile.detail for tile in wishes)
    (depth,) = (tile for tile in found if tile.label == "Smallest critical depth")
    assert "at least 2.00 times the expected depth" in depth.detail and not depth.value.startswith("≤")
    unsure = replace(option.floquet.map, unresolved=np.ones_like(option.floquet.map.unresolved))
    (depth,) = (t for t in tiles(doubtful, replace(option.floquet, map=unsure)) if t.label == "Smallest critical depth")
    assert depth.value.startswith("≤ ")


def test_a_disk_margin_that_is_a_bound_is_told_as_one(comparison: Comparison) -> None:
    margins = comparison.options[1].margins
    assert margins is not None
    first = margins.channels[0]
    bound = replace(first, disk=replace(first.disk, alpha=float("nan"), alpha_proven=0.25))
    told = worst_blocks(replace(margins, channels=(bound, *margins.channels[1:])), "x", key="k")
    words = "".join(p for p in told[0].parts if isinstance(p, str))  # type: ignore[union-attr]
    assert "≥ 0.250" in words and "= 0.250" not in words
    lost = replace(first, disk=replace(first.disk, perturbation=np.array([complex("nan")])))
    told = worst_blocks(replace(margins, channels=(lost, *margins.channels[1:])), "x", key="k")
    words = "".join(p for p in told[0].parts if isinstance(p, str))  # type: ignore[union-attr]
    assert f"{len(margins.channels) - 1} of {len(margins.channels)} single channels" in words


def test_a_panel_of_bands_alone_has_a_trace_for_its_axes() -> None:
    line = Line(np.array([0.0, 1.0]), np.array([0.0, 1.0]))
    band = Span("x", 0.2, 0.4, "#ff0000")
    panels = tuple(Panel((item,), Axis("a"), Axis("b")) for item in (line, band))
    data = interactive(Chart("k", "c", "a", panels))["data"]
    assert [trace["xaxis"] for trace in data] == ["x", "x2"]


def test_a_figure_higher_than_a_page_is_made_to_fit_with_its_caption() -> None:
    from maglev_ctrl.report.pdf import _height

    tall, low = '<svg width="480pt" height="720.5pt">', '<svg width="480pt" height="400pt">'
    assert _height(low, "words") == 0.0
    assert 600.0 < _height(tall, "words" * 100) < _height(tall, "words") < 720.0


def test_every_section_is_a_heading_of_its_level_in_the_text(report: Report) -> None:
    pictures = {chart.key: "<svg></svg>" for chart in report.charts()}
    lines = markdown(report, pictures)["report.md"].decode().splitlines()
    heads = [line for line in lines if re.match("#+ ", line)]
    assert heads[0] == f"# {plain(report.title)}" and heads[1] == "## Contents"
    expected = [f"{'#' * (section.level + 1)} {plain(section.title)}" for section in report.sections]
    assert len(heads) == 2 + len(expected)
    assert all(head.startswith(start) for head, start in zip(heads[2:], expected, strict=True))


def test_numbers_in_words_are_the_numbers_of_the_captions_in_every_form(report: Report) -> None:
    numbers = numbered(report)
    pictures = {chart.key: "<svg></svg>" for chart in report.charts()}
    page, text = html(report, pictures), markdown(report, pictures)["report.md"].decode()
    for target, place in numbers.targets.items():
        if not target.startswith("equation:"):
            continue
        assert place.words == f"Eq. ({place.number})"
        assert re.search(rf'id="{place.anchor}".*?<span class="tag">\({place.number}\)</span>', page), target
        shown = re.search(rf'<a id="{place.anchor}"></a>\n\n\$\$\n.*\n\$\$\n\nEq\. \((\d+)\)', text)
        assert shown is not None and int(shown.group(1)) == place.number, target
