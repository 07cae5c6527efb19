"""The report as GitHub-flavoured Markdown: one text with tables and captions, the figures as SVG files beside it."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Final, assert_never

from maglev_ctrl.report.legible import legible
from maglev_ctrl.report.model import (
    SIGNS,
    Banner,
    Block,
    Bullets,
    Cell,
    Equation,
    FigureBlock,
    Listing,
    Paragraph,
    Passage,
    Report,
    Section,
    Table,
)
from maglev_ctrl.report.numbering import Numbering, Place, ended, numbered

FIGURES: Final = "report_figures"
"""The folder of the figures, beside the text."""
_MARKS: Final = re.compile(r"([\\`*_{}\[\]!|~$])")
_FIRST: Final = re.compile(r"^(?=[#+-])|(?<=^\d)(?=[.)])|(?<=^\d\d)(?=[.)])")  # marks only where a line begins
_SPACES: Final = re.compile(r"\s+")
_HEAD: Final = re.compile(r"<svg\b[^>]*>")


def markdown(report: Report, pictures: Mapping[str, str]) -> dict[str, bytes]:
    """The text "report.md" and its figures, "report_figures/NAME.svg", by file name.

    Nothing in a scenario acts as markup: every mark is escaped, and what looks like HTML is shown as text.

    Parameters
    ----------
    pictures : SVG text of every chart, by chart key
    """
    numbers = numbered(report)
    lines = [f"# {plain(report.title)}", "", *_wrapped(report.subtitle)]
    if report.cover is not None:
        lines += [_banner(report.cover.banner), ""]
        lines += [f"- {plain(name)}: {plain(value)}" for name, value in report.cover.facts] + [""]
        tiles = report.cover.tiles
        rows = tuple((Cell(t.label), Cell(t.value), Cell(t.detail), Cell(_verdict(t.verdict))) for t in tiles)
        lines += [*_rows(("Key figure", "Value", "Limit or place", "Verdict"), rows, (1,)), ""]
        if report.cover.picture is not None:
            lines += _block(report.cover.picture, numbers)
    short = plain(report.scenario_hash[:16])
    lines += [f"Created {plain(report.created)}, maglev-ctrl {plain(report.version)}, scenario {short}.", ""]
    lines += ["## Contents", "", *(_entry(section) for section in report.sections), ""]
    for section in report.sections:
        verdict = f" ({_verdict(section.verdict)})" if section.verdict is not None else ""
        heading = "#" * (section.level + 1)
        lines += [f'<a id="{section.anchor}"></a>', "", f"{heading} {plain(section.title)}{verdict}", ""]
        for block in section.blocks:
            lines += _block(block, numbers)
    made = {"report.md": legible("\n".join(lines).rstrip() + "\n").encode()}
    for chart in report.charts():
        place = numbers.targets[f"figure:{chart.key}"]
        made[_file(place)] = standalone(pictures[chart.key]).encode()
    return made


def plain(text: str) -> str:
    """Words that Markdown shows as they are.

    Examples
    --------
    >>> plain("<b> *x* | a_b")
    '&lt;b&gt; \\\\*x\\\\* \\\\| a\\\\_b'
    """
    flat = _SPACES.sub(" ", text).strip()
    escaped = _FIRST.sub(r"\\", _MARKS.sub(r"\\\1", flat.replace("&", "&amp;")))
    return escaped.replace("<", "&lt;").replace(">", "&gt;").replace("@", "&#64;")


def standalone(svg: str) -> str:
    """A figure as a file of its own: on white paper, whatever the colour of the page that shows it.

    Examples
    --------
    >>> standalone('<svg viewBox="0 0 1 1"></svg>')
    '<svg viewBox="0 0 1 1"><rect width="100%" height="100%" fill="#ffffff"/></svg>\\n'
    """
    paper = '<rect width="100%" height="100%" fill="#ffffff"/>'
    return _HEAD.sub(lambda head: head.group() + paper, svg, count=1) + "\n"


def _file(place: Place) -> str:
    return f"{FIGURES}/{place.anchor.removeprefix('figure-')}.svg"


def _entry(section: Section) -> str:
    verdict = f" {_verdict(section.verdict)}" if section.verdict is not None else ""
    return f"{'  ' * (section.level - 1)}- [{plain(section.title)}](#{section.anchor}){verdict}"


def _verdict(verdict: object) -> str:
    return next((f"{sign} {one.value}" for one, sign in SIGNS.items() if one is verdict), "")


def _banner(block: Banner) -> str:
    told = _verdict(block.verdict)
    return f"> **{told}** {plain(block.text)}" if told else f"> {plain(block.text)}"


def _wrapped(text: str) -> list[str]:
    lines: list[str] = []
    for part in text.split("\n\n"):
        lines += [plain(part), ""] if part.strip() else []
    return lines


def _see(places: tuple[Place, ...]) -> str:
    return f" See {', '.join(_link(one) for one in places)}." if places else ""


def _link(place: Place) -> str:
    return f"[{plain(place.words)}](#{place.anchor})"


def _block(block: Block, numbers: Numbering) -> list[str]:
    match block:
        case Paragraph():
            return _wrapped(block.text)
        case Passage():
            parts = [
                plain_part(part) if isinstance(part, str) else _link(numbers.to(part.target)) for part in block.parts
            ]
            return ["".join(parts).strip(), ""]
        case Bullets():
            return [*(f"- {plain(item)}" for item in block.items), ""]
        case Banner():
            return [_banner(block), ""]
        case Table():
            place = numbers.of(block)
            caption = f'<a id="{place.anchor}"></a>**{place.words}.** {plain(ended(block.caption))}'
            return [caption + _see(numbers.known(block.see)), "",
                    *_rows(block.columns, block.rows, block.right), ""]  # fmt: skip
        case FigureBlock():
            place, chart = numbers.of(block), block.chart
            caption = f"**{place.words}.** {plain(ended(chart.caption))}"
            return [f'<a id="{place.anchor}"></a>', "", f"![{plain(chart.alt)}]({_file(place)})", "",
                    caption + _see(numbers.known(block.see)), ""]  # fmt: skip
        case Equation():
            place = numbers.of(block)
            source = f" {plain(block.source)}" if block.source else ""
            return [f'<a id="{place.anchor}"></a>', "", "$$", block.formula.latex, "$$", "",
                    f"{place.words}{source}", ""]  # fmt: skip
        case Listing():
            fence = "`" * (1 + max([2, *(len(run) for run in re.findall("`+", block.text))]))
            return [fence, block.text.rstrip("\n"), fence, ""]
        case _:
            assert_never(block)


def plain_part(text: str) -> str:
    """Words beside a reference: the space at their ends is kept.

    Examples
    --------
    >>> plain_part("see ")
    'see '
    """
    inner = plain(text)
    return f"{' ' if text[:1].isspace() else ''}{inner}{' ' if text[-1:].isspace() and inner else ''}"


def _rows(heads: tuple[str, ...], rows: tuple[tuple[Cell, ...], ...], right: tuple[int, ...]) -> list[str]:
    marks = ("---:" if place in right else "---" for place in range(len(heads)))
    lines = [heads, *(tuple(one.text for one in cells) for cells in rows)]
    told = ["| " + " | ".join(plain(text) for text in texts) + " |" for texts in lines]
    return [told[0], "| " + " | ".join(marks) + " |", *told[1:]]
