"""The report as one HTML file: no network, light and dark, readable without scripts."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from importlib.resources import files
from typing import Final

from maglev_ctrl.report.interactive import interactive, packed, plotly_script
from maglev_ctrl.report.legible import legible
from maglev_ctrl.report.model import SIGNS, SLUGS, Report, Section
from maglev_ctrl.report.numbering import ended, numbered
from maglev_ctrl.report.vector import TAG, themed

LARGEST: Final = 3_000_000
"""Bytes of a page: where live figures would need more, the last of them stand still."""
_WORDS: Final = 1_000  # bytes of what is told about figures that stand still
_STYLE = re.compile(r' style="([^"]*)"')


def html(report: Report, pictures: Mapping[str, str], *, largest: int = LARGEST) -> str:
    """The whole page.

    Where it would be larger than `largest` bytes the last of its figures stand still, and the page says how many:
    figures stay live in reading order, the cover and the comparison before one option after the other. Where none can
    be live the library is left out; what is larger even then (words, tables, still figures) is written whole.

    Parameters
    ----------
    pictures : SVG text of every chart, by chart key
    """
    charts = {chart.key: chart for chart in report.charts()}
    page = _written(report, pictures, tuple(charts))
    if len(page.encode()) <= largest or not charts:
        return page
    # Figures packed together take less than one by one, so the room is enough.
    room = largest - len(_written(report, pictures, ()).encode()) - len(plotly_script()) - _WORDS
    live: list[str] = []
    for key, chart in charts.items():
        room -= len(packed({key: interactive(chart)}))
        if room < 0:
            break
        live.append(key)
    return _written(report, pictures, tuple(live))


def _written(report: Report, pictures: Mapping[str, str], live: tuple[str, ...]) -> str:
    """The page with these figures live."""
    from jinja2 import Environment, StrictUndefined
    from markupsafe import Markup

    templates = files("maglev_ctrl.report").joinpath("templates")
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True)
    template = environment.from_string(templates.joinpath("report.html.j2").read_text(encoding="utf-8"))
    charts = {chart.key: chart for chart in report.charts()}
    classes: dict[str, str] = {}
    figures = {key: Markup(_classed(themed(pictures[key], label=chart.alt), classes)) for key, chart in charts.items()}
    numbers = numbered(report)
    page = template.render(
        report=report,
        signs=SIGNS,
        slug=lambda verdict: SLUGS[verdict],
        numbers=numbers,
        ended=ended,
        chapters=_chapters(report.sections),
        math=Markup,
        figures=figures,
        live=frozenset(live),
        still=len(charts) - len(live),
        style_sheet=Markup(templates.joinpath("report.css").read_text(encoding="utf-8")),
        figure_style=Markup("".join(f".{name}{{{style}}}" for style, name in classes.items())),
        figure_data=Markup(packed({key: interactive(charts[key]) for key in live})),
        figure_library=Markup(plotly_script() if live else ""),
        script=Markup(templates.joinpath("report.js").read_text(encoding="utf-8")),
    )
    return legible(page)


def _classed(svg: str, classes: dict[str, str]) -> str:
    """Styles that repeat over all figures become classes of one style sheet: a third of the size."""

    def name(match: re.Match[str]) -> str:
        style = match.group(1)
        return f' class="{classes.setdefault(style, f"s{len(classes)}")}"'

    return TAG.sub(lambda tag: _STYLE.sub(name, tag.group()), svg)  # tags only: words may hold anything


def _chapters(sections: Sequence[Section]) -> list[tuple[Section, list[Section]]]:
    """Sections of the first level, each with those of the second that follow it."""
    chapters: list[tuple[Section, list[Section]]] = []
    for section in sections:
        if section.level == 1 or not chapters:
            chapters.append((section, []))
        else:
            chapters[-1][1].append(section)
    return chapters
