"""One result as a piece of HTML for a notebook: no script, nothing fetched, legible on light and dark pages."""

from __future__ import annotations

from functools import cache
from importlib.resources import files
from typing import Any

from maglev_ctrl.report.model import SIGNS, SLUGS, FigureBlock
from maglev_ctrl.report.notebook import content_models, content_studies  # noqa: F401  they register their records
from maglev_ctrl.report.notebook.content import blocks_of
from maglev_ctrl.report.vector import svg, themed


def html(record: object) -> str | None:
    """Tables and figures of a result as HTML that can stand on any page; None for what has no page of its own.

    Words from scenario files are escaped. Colours follow the page: ink is the page's own, tints are see-through.

    Examples
    --------
    >>> from maglev_ctrl import SecondOrderSystem, modes
    >>> page = html(modes(SecondOrderSystem.from_matrices([[1.0]], [[0.2]], [[4.0]], dofs=("car.heave",))))
    >>> "Growth rate" in page, "<svg" in page, html(3.0) is None
    (True, True, True)
    """
    from markupsafe import Markup

    blocks = blocks_of(record)
    if not blocks:
        return None
    charts = [block.chart for block in blocks if isinstance(block, FigureBlock)]
    figures = {chart.key: Markup(themed(svg(chart), label=chart.alt)) for chart in charts}
    template, style_sheet = _template()
    page: str = template.render(
        blocks=blocks, figures=figures, signs=SIGNS, slug=lambda verdict: SLUGS[verdict],
        style_sheet=Markup(style_sheet), math=Markup,
    )  # fmt: skip
    return page


@cache
def _template() -> tuple[Any, str]:
    from jinja2 import Environment, StrictUndefined

    templates = files("maglev_ctrl.report").joinpath("templates")
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True)
    template = environment.from_string(templates.joinpath("notebook.html.j2").read_text(encoding="utf-8"))
    return template, templates.joinpath("notebook.css").read_text(encoding="utf-8")
