"""SVG of charts: compact, safe to inline many times in one page, aware of light and dark."""

from __future__ import annotations

import io
import re
from html import escape
from typing import Final

from maglev_ctrl.report.chart import Chart
from maglev_ctrl.report.draw import draw
from maglev_ctrl.report.style import FADED, GRID, INK, PAPER, RC

_HEADER = re.compile(r"<\?xml.*?<svg", re.DOTALL)
_METADATA = re.compile(r"<metadata>.*?</metadata>|<!--.*?-->", re.DOTALL)
_GROUP_ID = re.compile(r'<g id="[^"]*"')
_DECIMALS = re.compile(r"(\d\.\d{2})\d+")
_SPACES = re.compile(r"\n\s*")
_PATH_STYLE = re.compile(r"-miterlimit: 100000; ?")


def svg(chart: Chart) -> str:
    """The chart as a compact SVG text: no XML header, no metadata, identifiers unique to the chart's key."""
    import matplotlib

    figure = draw(chart)
    stream = io.StringIO()
    with matplotlib.rc_context({**RC, "svg.hashsalt": chart.key}):
        figure.savefig(stream, format="svg", metadata={"Date": None, "Creator": None, "Format": None, "Type": None})
    text = _METADATA.sub("", _HEADER.sub("<svg", stream.getvalue(), count=1))
    text = _SPACES.sub("\n", _GROUP_ID.sub("<g", text))
    head, *rest = re.split(r"(<image.*?/>|<text.*?</text>)", text, flags=re.DOTALL)
    parts = [part if part.startswith(("<image", "<text")) else _DECIMALS.sub(r"\1", part) for part in (head, *rest)]
    return "".join(parts).strip()


_FILL_INK: Final = ((INK, "--ink"), (GRID, "--grid"), (PAPER, "--paper"), (FADED, "--faded"))


def themed(text: str, *, label: str) -> str:
    """An SVG for inlining in HTML: named for screen readers, ink and paper taken from the page's theme."""
    for value, variable in _FILL_INK:
        text = re.sub(rf"(fill|stroke): {value}", rf"\1: var({variable}, {value})", text)
    text = re.sub("<svg ", f'<svg role="img" aria-label="{escape(label, quote=True)}" ', text, count=1)
    return re.sub(r'(<svg[^>]*?) (?:width|height)="[^"]*pt"', r"\1", text, count=1)
