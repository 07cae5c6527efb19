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
TAG = re.compile(r"<[^<>]*>")  # words between tags are escaped, so a tag ends where it seems to end
_GROUP_ID = re.compile(r'^<g id="[^"]*"')
_UNTURNED = re.compile(r' transform="rotate\(-0 [^)]*\)"')
_PATH = re.compile(r' d="([^"]*)"')
_STEP = re.compile(r"\s*([MLCQz])\s*")
_DECIMALS = re.compile(r"(\d\.\d{2})\d+")
_LONG_DECIMALS = re.compile(r"(\d\.\d)\d+")
_LONG = 200
_TWINS = re.compile(r'<path d="([^"]*)" (style="[^"]*")/>\n<path d="([^"]*)" \2/>')


def svg(chart: Chart) -> str:
    """The chart as a compact SVG text: no XML header, no metadata, identifiers unique to the chart's key."""
    import matplotlib

    figure = draw(chart)
    stream = io.StringIO()
    with matplotlib.rc_context({**RC, "svg.hashsalt": chart.key}):
        figure.savefig(stream, format="svg", metadata={"Date": None, "Creator": None, "Format": None, "Type": None})
    text = _METADATA.sub("", _HEADER.sub("<svg", stream.getvalue(), count=1))
    return _joined(without_empty_groups(TAG.sub(_compact, text)))


def _compact(tag: re.Match[str]) -> str:
    """One tag without needless identifiers, turns by nothing, and digits no eye can see."""
    text = tag.group()
    if text.startswith("<image"):
        return text
    text = _UNTURNED.sub("", _GROUP_ID.sub("<g", text))
    text = _PATH.sub(_short_path, text)
    return _DECIMALS.sub(r"\1", text)


def _short_path(match: re.Match[str]) -> str:
    path = _STEP.sub(r"\1", match.group(1)).strip()
    short = _LONG_DECIMALS.sub(r"\1", path) if len(path) > _LONG else path
    return f' d="{short}"'


def without_empty_groups(text: str) -> str:
    """Groups that carry nothing taken away, whatever stood in them kept."""
    out: list[str] = []
    open_groups: list[bool] = []
    last = 0
    for tag in TAG.finditer(text):
        word = tag.group()
        if word == "<g/>":
            dropped = True
        elif word.startswith("<g") and not word.endswith("/>"):
            open_groups.append(word == "<g>")
            dropped = open_groups[-1]
        elif word == "</g>":
            dropped = open_groups.pop()
        else:
            continue
        out.append(text[last : tag.start()] + ("" if dropped else word))
        last = tag.end()
    out.append(text[last:])
    return re.sub(r"\s*\n\s*", "\n", "".join(out)).strip()


def _joined(text: str) -> str:
    """Neighbouring strokes of one style (ticks, grid lines) as one path."""
    while True:
        joined = _TWINS.sub(r'<path d="\1\3" \2/>', text)
        if joined == text:
            return text
        text = joined


_FILL_INK: Final = ((INK, "--ink"), (GRID, "--grid"), (PAPER, "--paper"), (FADED, "--faded"))


def themed(text: str, *, label: str) -> str:
    """An SVG for inlining in HTML: named for screen readers, ink and paper taken from the page's theme."""
    for value, variable in _FILL_INK:
        text = re.sub(rf"(fill|stroke): {value}", rf"\1: var({variable}, {value})", text)
    text = re.sub("<svg ", f'<svg role="img" aria-label="{escape(label, quote=True)}" ', text, count=1)
    return re.sub(r'(<svg[^>]*?) (?:width|height)="[^"]*pt"', r"\1", text, count=1)
