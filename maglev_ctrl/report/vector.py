"""SVG of charts: compact, safe to inline many times in one page, aware of light and dark."""

from __future__ import annotations

import io
import re
import warnings
from html import escape
from typing import Final

from maglev_ctrl.report.chart import Chart
from maglev_ctrl.report.draw import draw
from maglev_ctrl.report.legible import legible
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
_LONG = 120
_NUMBER: Final = r"-?\d+(?:\.\d+)?"
_STRAIGHT: Final = re.compile(rf"(?:M{_NUMBER} {_NUMBER}(?:L{_NUMBER} {_NUMBER})*z?)+")
_POINT: Final = re.compile(rf"(?:([ML])({_NUMBER}) ({_NUMBER})|(z))")
_TWINS = re.compile(r'<path d="([^"]*)" (style="[^"]*")/>\n<path d="([^"]*)" \2/>')


def svg(chart: Chart) -> str:
    """The chart as a compact SVG text: no XML header, no metadata, identifiers unique to the chart's key."""
    import matplotlib

    stream = io.StringIO()
    with matplotlib.rc_context({**RC, "svg.hashsalt": chart.key}), warnings.catch_warnings():
        # Letters stay text in the file, so whoever shows it brings the fonts that our own lacks.
        warnings.filterwarnings("ignore", r"Glyph \d+ .*missing from font")
        figure = draw(chart)
        figure.savefig(stream, format="svg", metadata={"Date": None, "Creator": None, "Format": None, "Type": None})
    text = _METADATA.sub("", _HEADER.sub("<svg", legible(stream.getvalue()), count=1))
    text = _joined(without_empty_groups(TAG.sub(_compact, text)))
    return TAG.sub(lambda tag: _PATH.sub(_straight_path, tag.group()), text)


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


def _straight_path(match: re.Match[str]) -> str:
    """A path of straight lines by its steps, any other as it is."""
    return f' d="{relative(match.group(1))}"' if _STRAIGHT.fullmatch(match.group(1)) else match.group()


def relative(path: str) -> str:
    """A path of straight lines told by steps of tenths of a point: half as long, and no error adds up.

    Examples
    --------
    >>> relative("M10.04 5L10.31 5.22L9 6zM1 1L2.5 1")
    'M10 5l.3.2-1.3.8zM1 1h1.5'
    """
    out: list[str] = []
    last = (0, 0)
    for command, x, y, end in _POINT.findall(path):
        if end:
            out.append("z")
            continue
        at = round(10.0 * float(x)), round(10.0 * float(y))
        if command == "M":
            out.append(f"M{_tenths(at[0])} {_tenths(at[1])}")
        elif at != last:
            dx, dy = at[0] - last[0], at[1] - last[1]
            out.append(f"h{_tenths(dx)}" if dy == 0 else f"v{_tenths(dy)}" if dx == 0 else _step(dx, dy, after=out[-1]))
        last = at
    return "".join(out)


def _step(dx: int, dy: int, *, after: str) -> str:
    """A step in both directions, with no more signs between its numbers and the one before than are needed."""
    first, second = _tenths(dx), _tenths(dy)
    word = f"{first}{'' if second[0] == '-' or (second[0] == '.' and '.' in first) else ' '}{second}"
    if after[0] in "Mzhv":
        return f"l{word}"
    last = re.split("[ l-]", after)[-1]
    return word if word[0] == "-" or (word[0] == "." and "." in last) else f" {word}"


def _tenths(value: int) -> str:
    sign, (whole, tenth) = "-" if value < 0 else "", divmod(abs(value), 10)
    return f"{sign}{whole or ('' if tenth else 0)}{f'.{tenth}' if tenth else ''}"


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
    named = f'<svg role="img" aria-label="{escape(label, quote=True)}" '
    text = text.replace("<svg ", named, 1)  # not a pattern: words may hold backslashes
    return re.sub(r'(<svg[^>]*?) (?:width|height)="[^"]*pt"', r"\1", text, count=1)
