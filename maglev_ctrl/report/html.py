"""The report as one HTML file: no network, light and dark, readable without scripts."""

from __future__ import annotations

import re
from collections.abc import Mapping
from importlib.resources import files

from maglev_ctrl.report.interactive import interactive, packed, plotly_script
from maglev_ctrl.report.model import SIGNS, SLUGS, FigureBlock, Report, Table
from maglev_ctrl.report.vector import TAG, themed

_STYLE = re.compile(r' style="([^"]*)"')


def html(report: Report, pictures: Mapping[str, str]) -> str:
    """The whole page.

    Parameters
    ----------
    pictures : SVG text of every chart, by chart key
    """
    from jinja2 import Environment, StrictUndefined
    from markupsafe import Markup

    templates = files("maglev_ctrl.report").joinpath("templates")
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True)
    template = environment.from_string(templates.joinpath("report.html.j2").read_text(encoding="utf-8"))
    charts = {chart.key: chart for chart in report.charts()}
    classes: dict[str, str] = {}
    figures = {key: Markup(_classed(themed(pictures[key], label=chart.alt), classes)) for key, chart in charts.items()}
    numbers = _numbers(report)
    return template.render(
        report=report,
        signs=SIGNS,
        slug=lambda verdict: SLUGS[verdict],
        number=lambda block: numbers[id(block)],
        figures=figures,
        style_sheet=Markup(templates.joinpath("report.css").read_text(encoding="utf-8")),
        figure_style=Markup("".join(f".{name}{{{style}}}" for style, name in classes.items())),
        figure_data=packed({key: interactive(chart) for key, chart in charts.items()}),
        figure_library=plotly_script(),
        script=Markup(templates.joinpath("report.js").read_text(encoding="utf-8")),
    )


def _classed(svg: str, classes: dict[str, str]) -> str:
    """Styles that repeat over all figures become classes of one style sheet: a third of the size."""

    def name(match: re.Match[str]) -> str:
        style = match.group(1)
        return f' class="{classes.setdefault(style, f"s{len(classes)}")}"'

    return TAG.sub(lambda tag: _STYLE.sub(name, tag.group()), svg)  # tags only: words may hold anything


def _numbers(report: Report) -> dict[int, int]:
    """Figures and tables numbered in reading order, by identity of their block."""
    numbers: dict[int, int] = {}
    counts = {FigureBlock: 0, Table: 0}
    for section in report.sections:
        for block in section.blocks:
            kind = type(block)
            if kind is FigureBlock or kind is Table:
                counts[kind] += 1
                numbers[id(block)] = counts[kind]
    return numbers
