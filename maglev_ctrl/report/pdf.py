"""The report as PDF: the model handed to a Typst template as data, figures as vector graphics."""

from __future__ import annotations

import json
from collections.abc import Mapping
from importlib.resources import files
from typing import Any, assert_never

from maglev_ctrl.report.model import (
    SIGNS,
    SLUGS,
    Banner,
    Block,
    Bullets,
    Cell,
    FigureBlock,
    Listing,
    Paragraph,
    Report,
    Table,
)


def pdf(report: Report, pictures: Mapping[str, str]) -> bytes:
    """The whole document; fonts come with matplotlib, nothing is fetched.

    Parameters
    ----------
    pictures : SVG text of every chart, by chart key
    """
    import matplotlib
    import typst

    sources: dict[str, bytes] = {}
    names: dict[str, str] = {}
    for place, chart in enumerate(report.charts()):
        names[chart.key] = f"figure-{place + 1}.svg"
        sources[names[chart.key]] = pictures[chart.key].encode()
    template = files("maglev_ctrl.report").joinpath("templates", "report.typ").read_bytes()
    sources["main.typ"] = template
    sources["model.json"] = json.dumps(_document(report, names), ensure_ascii=False).encode()
    fonts = f"{matplotlib.get_data_path()}/fonts/ttf"
    inputs: Any = sources  # a dictionary of files: taken by the library, not yet in its type hints
    compiled = typst.compile(inputs, font_paths=[fonts], ignore_system_fonts=True)
    if not isinstance(compiled, bytes):
        raise TypeError(f"typst: expected one PDF as bytes, got {type(compiled).__name__}")
    return compiled


def _document(report: Report, names: Mapping[str, str]) -> dict[str, Any]:
    short = report.title if len(report.title) <= 80 else report.title[:78].rstrip() + " …"
    return {
        "title": report.title,
        "short_title": short,
        "subtitle": report.subtitle,
        "created": report.created,
        "version": report.version,
        "scenario_hash": report.scenario_hash,
        "sections": [
            {"title": s.title, "level": s.level, "blocks": [_block(block, names) for block in s.blocks]}
            for s in report.sections
        ],
    }


def _block(block: Block, names: Mapping[str, str]) -> dict[str, Any]:
    match block:
        case Paragraph():
            return {"kind": "Paragraph", "text": block.text}
        case Bullets():
            return {"kind": "Bullets", "items": list(block.items)}
        case Banner():
            verdict = block.verdict
            sign = "" if verdict is None else f"{SIGNS[verdict]} {verdict.value}"
            tone = "neutral" if verdict is None else SLUGS[verdict]
            return {"kind": "Banner", "verdict": tone, "sign": sign, "text": block.text}
        case Table():
            return {
                "kind": "Table", "caption": block.caption, "columns": list(block.columns), "small": block.small,
                "widths": list(block.widths or (1.0,) * len(block.columns)), "right": list(block.right),
                "rows": [[_cell(c) for c in cells] for cells in block.rows],
            }  # fmt: skip
        case FigureBlock():
            chart = block.chart
            return {"kind": "Figure", "file": names[chart.key], "alt": chart.alt, "caption": chart.caption}
        case Listing():
            return {"kind": "Listing", "text": block.text}
        case _:
            assert_never(block)


def _cell(cell: Cell) -> dict[str, Any]:
    return {"text": cell.text, "verdict": None if cell.verdict is None else SLUGS[cell.verdict]}
