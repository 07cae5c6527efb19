"""Legends as words of the page: they wrap where it is narrow, follow its theme, and are read aloud."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from bokeh.models import Div, InlineStyleSheet

from maglev_ctrl.workbench.style import FONT, LIGHT
from maglev_ctrl.workbench.views.table import escaped

INK: Final = f"var(--wb-ink, {LIGHT.ink})"
ON_PAPER: Final = f"var(--wb-faded, {LIGHT.faded})"
_WIDE, _HIGH = 22, 13  # px of a sign
_STYLE: Final = f"""
:host {{ font-family: {FONT}; font-size: 12px; line-height: 1.3; color: {INK}; }}
.bk-clearfix {{ display: block; width: 100%; font-family: {FONT}; }}
ul {{ list-style: none; margin: 0; padding: 0; display: flex; flex-wrap: wrap; gap: 0.1rem 1rem; }}
li {{ display: inline-flex; align-items: center; gap: 0.4rem; min-width: 0; overflow-wrap: anywhere; }}
svg {{ flex: none; overflow: hidden; }}
"""
_STAR: Final = "M11 1L12.4 5.1L16.8 5.2L13.3 7.8L14.6 12L11 9.5L7.4 12L8.7 7.8L5.2 5.2L9.6 5.1Z"
_MARKERS: Final = {
    "circle": '<circle cx="11" cy="6.5" r="5"/>', "square": '<rect x="6.5" y="2" width="9" height="9"/>',
    "diamond": '<path d="M11 .5L15.5 6.5L11 12.5L6.5 6.5Z"/>', "triangle": '<path d="M11 1L16.5 11H5.5Z"/>',
    "inverted_triangle": '<path d="M11 12L16.5 2H5.5Z"/>', "star": f'<path d="{_STAR}"/>',
    "hex": '<path d="M8.3 1.8H13.7L16.4 6.5L13.7 11.2H8.3L5.6 6.5Z"/>',
    "plus": '<path d="M9.3 1H12.7V4.8H16.5V8.2H12.7V12H9.3V8.2H5.5V4.8H9.3Z"/>',
    "x": '<path fill="none" d="M6.5 2L15.5 11M15.5 2L6.5 11"/>',
    "cross": '<path fill="none" d="M11 1V12M5.5 6.5H16.5"/>',
    "asterisk": '<path fill="none" d="M11 1V12M5.5 6.5H16.5M7.2 2.7L14.8 10.3M14.8 2.7L7.2 10.3"/>',
    "circle_dot": '<circle cx="11" cy="6.5" r="5" fill="none"/><circle cx="11" cy="6.5" r="1.4"/>',
    "circle_cross": '<circle cx="11" cy="6.5" r="5" fill="none"/><path fill="none" d="M11 1V12M5.5 6.5H16.5"/>',
}  # fmt: skip
_HATCHES: Final = {
    "right_diagonal_line": '<path fill="none" d="M0 9L9 0M4 13L17 0M13 13L22 4"/>',
    "criss_cross": '<path fill="none" d="M0 9L9 0M4 13L17 0M13 13L22 4M0 4L9 13M5 0L18 13M13 0L22 9"/>',
    "dot": "".join(f'<circle cx="{x}" cy="{y}" r="1"/>' for x in (4, 11, 18) for y in (4, 9)),
}


def tint_of(place: int) -> str:
    """The colour of a mode or a body by its place in the palette, in whichever theme the page has.

    Examples
    --------
    >>> tint_of(0)
    'var(--wb-tint-0, #0072b2)'
    """
    k = place % len(LIGHT.palette)
    return f"var(--wb-tint-{k}, {LIGHT.palette[k]})"


def marker_sign(marker: str, tint: str, edge: str = INK) -> str:
    """A marker as the figures draw it; those made of strokes have the colour of their edge."""
    stroke = tint if 'fill="none"' in _MARKERS[marker] else edge
    return _svg(f'<g style="fill:{tint};stroke:{stroke}" stroke-width="1.1">{_MARKERS[marker]}</g>')


def line_sign(width: float, tint: str = INK) -> str:
    """A line of so many pixels."""
    return _svg(f'<path style="stroke:{tint}" stroke-width="{width}" d="M1 6.5H21"/>')


def box_sign(tint: str, hatch: str = "", hatch_tint: str = INK) -> str:
    """A box with a face and perhaps a hatch."""
    drawn = (
        f'<g style="fill:{hatch_tint};stroke:{hatch_tint}" stroke-width="0.9">{_HATCHES[hatch]}</g>' if hatch else ""
    )
    return _svg(
        f'<rect width="22" height="13" style="fill:{tint}"/>{drawn}'
        f'<rect x=".5" y=".5" width="21" height="12" fill="none" style="stroke:{ON_PAPER}"/>'
    )


def legend_block(name: str, entries: Sequence[tuple[str, str]] = ()) -> Div:
    """A legend below a figure, with its entries (sign, words)."""
    return Div(
        text=legend_html(entries), name=name, disable_math=True, sizing_mode="stretch_width", margin=(2, 5, 4, 5),
        stylesheets=[InlineStyleSheet(css=_STYLE)],
    )  # fmt: skip


def legend_html(entries: Sequence[tuple[str, str]]) -> str:
    """Signs, which this module has made, and words, which are shown as words.

    Examples
    --------
    >>> legend_html([(line_sign(2.0, "red"), "a < b")])[-25:]
    'a &lt; b</span></li></ul>'
    """
    if not entries:
        return ""
    items = "".join(f"<li>{sign}<span>{escaped(words)}</span></li>" for sign, words in entries)
    return f'<ul aria-label="Legend">{items}</ul>'


def _svg(inner: str) -> str:
    return f'<svg width="{_WIDE}" height="{_HIGH}" viewBox="0 0 {_WIDE} {_HIGH}" aria-hidden="true">{inner}</svg>'
