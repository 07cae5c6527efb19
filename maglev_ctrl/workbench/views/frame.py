"""An empty figure as every view begins: quiet axes, few tools, no logo, no word that is read as a formula or markup."""

from __future__ import annotations

from typing import Any

from bokeh.models import (
    BoxZoomTool,
    CustomJSTickFormatter,
    Div,
    HoverTool,
    InlineStyleSheet,
    LinearColorMapper,
    PanTool,
    ResetTool,
    WheelZoomTool,
)
from bokeh.plotting import figure

from maglev_ctrl.report.style import MINUS
from maglev_ctrl.workbench.style import FONT, FONT_SIZE, LIGHT

_TICK = f"return `${{Number(tick.toPrecision(8))}}`.replace('-', '{MINUS}')"
WORDS_STYLE = f"""
:host {{ font-family: {FONT}; font-size: 13px; line-height: 1.35; color: var(--wb-ink, {LIGHT.ink}); }}
.bk-clearfix {{ font-family: {FONT}; }}
p {{ margin: 0.2em 0; }}
.quiet {{ color: var(--wb-faded, {LIGHT.faded}); }}
.checked {{ font-weight: 600; }}
"""

TELL = """
const tell = (block, html) => {
  if (block.text === html) return
  const held = block.view_of?.markup_el?.isConnected ? block.view_of : Bokeh.index.find_one(block)
  block.view_of = held
  if (!held?.markup_el) { block.setv({text: html}, {sync: false}); return }
  block.setv({text: html}, {silent: true})
  held.markup_el.innerHTML = html
}
"""
"""JavaScript that defines `tell(block, html)`: new words in a block without laying out the figures around it again."""

_WIDGET_STYLE = f"""
:host {{ color: var(--wb-ink, {LIGHT.ink}); }}
.bk-input, .bk-btn, label {{ font-family: {FONT}; font-size: 13px; }}
.bk-input, .bk-btn, .bk-btn:hover, .bk-btn.bk-active {{ background-color: var(--wb-paper, {LIGHT.paper});
  color: var(--wb-ink, {LIGHT.ink}); border-color: var(--wb-faded, {LIGHT.faded}); }}
.bk-btn.bk-active {{ border-width: 2px; font-weight: 600; }}
"""


def frame(name: str, words: str, *, x_label: str, y_label: str, height: int = 340, zoom: bool = True) -> Any:
    """A dressed, empty figure.

    Parameters
    ----------
    name : of the model, for the page and its tests
    words : title; shown as it is
    zoom : whether it can be moved and zoomed; the wheel zooms only after it is chosen, so that the page scrolls

    Examples
    --------
    >>> drawn = frame("plane", "Eigenvalues", x_label="growth rate (1/s)", y_label="frequency (Hz)")
    >>> drawn.title.text, drawn.toolbar.logo
    ('Eigenvalues', None)
    """
    tools = [PanTool(), WheelZoomTool(), BoxZoomTool(), ResetTool()] if zoom else []
    drawn = figure(
        name=name, x_axis_label=x_label, y_axis_label=y_label, height=height, min_width=260, tools=tools,
        toolbar_location="above" if zoom else None, sizing_mode="stretch_width", background_fill_color=None,
        border_fill_color=None, lod_threshold=None,
    )  # fmt: skip
    drawn.title = title_model(words)
    drawn.toolbar.logo = None
    drawn.toolbar.autohide = True
    for axis in (*drawn.xaxis, *drawn.yaxis):
        axis.axis_label_text_font = axis.major_label_text_font = FONT
        axis.axis_label_text_font_size = axis.major_label_text_font_size = FONT_SIZE
        axis.axis_label_text_font_style = "normal"
        axis.minor_tick_line_color = None
        axis.formatter = CustomJSTickFormatter(code=_TICK)
    drawn.outline_line_width = 1
    return drawn


def title_model(words: str) -> Any:
    """A title in the page's own type."""
    from bokeh.models import Title

    return Title(text=words_only(words), text_font=FONT, text_font_size="14px", text_font_style="bold")


def words_only(words: str) -> str:
    """Words that no part of a figure takes for a formula: signs that begin one are kept apart by nothing to be seen.

    Examples
    --------
    >>> words_only("$$x$$") == "$$x$$", len(words_only("$$x$$"))
    (False, 7)
    """
    kept = "\N{ZERO WIDTH SPACE}"
    for sign in ("$$", "\\[", "\\("):
        words = words.replace(sign, sign[0] + kept + sign[1])
    return words


def shortened(words: str, most: int) -> str:
    """Words of at most so many characters; the middle gives way to an ellipsis, a number at the end stays.

    Examples
    --------
    >>> shortened("front heave / rear heave (1)", 16)
    'front hea… (1)'
    """
    return words if len(words) <= most else f"{words[: most - 7].rstrip()}…{words[-4:]}"


def palette_mapper() -> LinearColorMapper:
    """Colours of modes and bodies by their place in the palette, see `style.dress`."""
    count = len(LIGHT.palette)
    return LinearColorMapper(palette=list(LIGHT.palette), low=-0.5, high=count - 0.5, tags=["themed"])


def hover(renderers: list[Any], rows: list[tuple[str, str]]) -> HoverTool:
    """A pointer that tells rows of names and columns; Bokeh escapes what stands in the columns."""
    return HoverTool(renderers=renderers, tooltips=rows, visible=False)


def words_block(name: str, html: str = "") -> Div:
    """A block of HTML that this package has written and escaped; never read as formulas."""
    return Div(
        text=html, name=name, disable_math=True, sizing_mode="stretch_width", margin=(0, 5, 2, 5),
        stylesheets=[InlineStyleSheet(css=WORDS_STYLE)],
    )  # fmt: skip


def widget_style() -> InlineStyleSheet:
    """Inputs in the colours of the page's theme."""
    return InlineStyleSheet(css=_WIDGET_STYLE)
