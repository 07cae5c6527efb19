"""The report as PDF: the model handed to a Typst template as data, figures as vector graphics.

The file conforms to PDF/A-2a (kept for decades, tagged) and PDF/UA-1 (read aloud): the compiler refuses to write one
that does not, as far as it checks.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import datetime
from importlib.resources import files
from typing import Any, Final, assert_never

from maglev_ctrl.report.legible import boxed, in_all, legible
from maglev_ctrl.report.model import (
    SIGNS,
    SLUGS,
    Banner,
    Block,
    Bullets,
    Cell,
    Cover,
    Equation,
    FigureBlock,
    Listing,
    Paragraph,
    Passage,
    Reference,
    Report,
    Table,
)
from maglev_ctrl.report.numbering import Numbering, ended, numbered

STANDARDS: Final = ("a-2a", "ua-1")
_PAGE: Final = 700.0  # pt, the room of a figure with its caption
_CAPTION: Final = 11.0, 100  # pt a line, letters in it
_HEIGHT: Final = re.compile(r'<svg\b[^>]*?\bheight="([0-9.]+)pt"')
_UNKNOWN: Final = datetime(1970, 1, 1)  # an archive asks for a date: where none is known, the clock's beginning


def pdf(report: Report, pictures: Mapping[str, str]) -> bytes:
    """The whole document; fonts come with matplotlib, nothing is fetched.

    Parameters
    ----------
    pictures : SVG text of every chart, by chart key
    """
    import matplotlib
    import typst

    drawings = {
        chart.key: Drawing(f"figure-{place + 1}.svg", _height(pictures[chart.key], chart.caption))
        for place, chart in enumerate(report.charts())
    }
    document = in_all(_document(report, drawings), legible)
    texts = {drawings[key].file: pictures[key] for key in drawings}
    fonts = f"{matplotlib.get_data_path()}/fonts/ttf"

    def compiled_with(letters: Callable[[str], str]) -> Any:
        sources: Any = {name: letters(text).encode() for name, text in texts.items()}
        sources["main.typ"] = files("maglev_ctrl.report").joinpath("templates", "report.typ").read_bytes()
        sources["model.json"] = json.dumps(in_all(document, letters), ensure_ascii=False).encode()
        return typst.compile(sources, font_paths=[fonts], ignore_system_fonts=True, pdf_standards=list(STANDARDS))

    try:
        compiled = compiled_with(str)
    except typst.TypstError as fault:
        # The standards refuse some letters that only the font of last resort draws: then all of those become boxes.
        if "PDF/" not in str(fault):
            raise
        compiled = compiled_with(boxed)
    if not isinstance(compiled, bytes):
        raise TypeError(f"typst: expected one PDF as bytes, got {type(compiled).__name__}")
    return compiled


@dataclass(frozen=True, eq=False, slots=True)
class Drawing:
    """A figure's file and the height it is drawn at in pt; 0 for its own."""

    file: str
    height: float


def _height(picture: str, caption: str) -> float:
    """Zero where figure and caption fit on a page, else the height that leaves room for the caption."""
    line, letters = _CAPTION
    room = max(0.3 * _PAGE, _PAGE - line * (1 + len(caption) // letters))
    found = _HEIGHT.search(picture)
    return room if found is not None and float(found.group(1)) > room else 0.0


def _document(report: Report, names: Mapping[str, Drawing]) -> dict[str, Any]:
    numbers = numbered(report)
    short = report.title if len(report.title) <= 80 else report.title[:78].rstrip() + " …"
    day = _date(report.created)
    return {
        "title": report.title,
        "short_title": short,
        "subtitle": report.subtitle,
        "created": report.created,
        "day": [day.year, day.month, day.day, day.hour, day.minute, day.second],
        "version": report.version,
        "scenario_hash": report.scenario_hash,
        "cover": None if report.cover is None else _cover(report.cover, names, numbers),
        "sections": [
            {
                "title": s.title, "level": s.level, "anchor": s.anchor,
                "verdict": None if s.verdict is None else SLUGS[s.verdict],
                "blocks": [_block(block, names, numbers) for block in s.blocks],
            }
            for s in report.sections
        ],
    }  # fmt: skip


def _date(created: str) -> datetime:
    try:
        return datetime.fromisoformat(created)
    except ValueError:
        return _UNKNOWN


def _cover(cover: Cover, names: Mapping[str, Drawing], numbers: Numbering) -> dict[str, Any]:
    return {
        "facts": [list(fact) for fact in cover.facts],
        "banner": _block(cover.banner, names, numbers),
        "tiles": [
            {
                "label": tile.label, "value": tile.value, "detail": tile.detail,
                "tone": "neutral" if tile.verdict is None else SLUGS[tile.verdict],
                "sign": "" if tile.verdict is None else f"{SIGNS[tile.verdict]} {tile.verdict.value}",
            }
            for tile in cover.tiles
        ],
        "picture": None if cover.picture is None else _block(cover.picture, names, numbers),
    }  # fmt: skip


def _see(targets: tuple[str, ...], numbers: Numbering) -> list[dict[str, str]]:
    return [{"words": place.words, "anchor": place.anchor} for place in numbers.known(targets)]


def _part(part: str | Reference, numbers: Numbering) -> dict[str, str]:
    if isinstance(part, str):
        return {"words": part, "anchor": ""}
    place = numbers.to(part.target)
    return {"words": place.words, "anchor": place.anchor}


def _block(block: Block, names: Mapping[str, Drawing], numbers: Numbering) -> dict[str, Any]:
    match block:
        case Paragraph():
            return {"kind": "Paragraph", "text": block.text}
        case Passage():
            return {"kind": "Passage", "parts": [_part(part, numbers) for part in block.parts]}
        case Equation():
            formula = block.formula
            return {
                "kind": "Equation", "anchor": numbers.of(block).anchor, "math": formula.typst, "words": formula.words,
                "source": block.source,
            }  # fmt: skip
        case Bullets():
            return {"kind": "Bullets", "items": list(block.items)}
        case Banner():
            verdict = block.verdict
            sign = "" if verdict is None else f"{SIGNS[verdict]} {verdict.value}"
            tone = "neutral" if verdict is None else SLUGS[verdict]
            return {"kind": "Banner", "verdict": tone, "sign": sign, "text": block.text}
        case Table():
            return {
                "kind": "Table", "caption": ended(block.caption), "columns": list(block.columns), "small": block.small,
                "widths": list(block.widths or (1.0,) * len(block.columns)), "right": list(block.right),
                "rows": [[_cell(c) for c in cells] for cells in block.rows],
                "anchor": numbers.of(block).anchor, "see": _see(block.see, numbers),
            }  # fmt: skip
        case FigureBlock():
            chart = block.chart
            return {
                "kind": "Figure", "file": names[chart.key].file, "height": names[chart.key].height, "alt": chart.alt,
                "caption": ended(chart.caption), "anchor": numbers.of(block).anchor, "see": _see(block.see, numbers),
            }  # fmt: skip
        case Listing():
            return {"kind": "Listing", "text": block.text}
        case _:
            assert_never(block)


def _cell(cell: Cell) -> dict[str, Any]:
    return {"text": cell.text, "verdict": None if cell.verdict is None else SLUGS[cell.verdict]}
