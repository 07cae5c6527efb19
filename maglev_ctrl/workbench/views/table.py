"""Tables as HTML in which every word from a scenario is a word."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import Final

from maglev_ctrl.errors import Verdict
from maglev_ctrl.report.model import SLUGS, Cell
from maglev_ctrl.workbench.style import FONT, LIGHT

TABLE_STYLE: Final = f"""
:host {{ font-family: {FONT}; font-size: 13px; line-height: 1.35; color: var(--wb-ink, {LIGHT.ink}); }}
.bk-clearfix {{ display: block; width: 100%; font-family: {FONT}; }}
.scroll {{ overflow-x: auto; background:
  linear-gradient(to left, var(--wb-paper, {LIGHT.paper}) 40%, transparent) right / 3em 100% no-repeat local,
  linear-gradient(to left, rgb(110 110 110 / 0.45), transparent) right / 0.8em 100% no-repeat scroll; }}
table {{ border-collapse: collapse; width: 100%; margin: 0.2em 0 0.9em; }}
td:last-child:not(.right) {{ min-width: 13em; }}
caption {{ text-align: left; font-weight: 600; padding: 0.3em 0; }}
th, td {{ text-align: left; padding: 0.28em 0.7em 0.28em 0; border-bottom: 1px solid var(--wb-grid, {LIGHT.grid});
  vertical-align: top; }}
th {{ color: var(--wb-faded, {LIGHT.faded}); font-weight: 500; }}
td.right, th.right {{ text-align: right; font-variant-numeric: tabular-nums; white-space: nowrap; }}
.pass {{ color: var(--wb-good, {LIGHT.good}); font-weight: 600; white-space: nowrap; }}
.fail {{ color: var(--wb-bad, {LIGHT.bad}); font-weight: 600; white-space: nowrap; }}
.unknown {{ color: var(--wb-faded, {LIGHT.faded}); font-weight: 600; white-space: nowrap; }}
.verdict {{ font-size: 15px; padding: 0.5em 0.7em; border-left: 5px solid currentColor; margin: 0 0 0.6em; }}
.verdict.pass, .verdict.fail, .verdict.unknown {{ white-space: normal; }}
.verdict span {{ color: var(--wb-ink, {LIGHT.ink}); font-weight: 400; }}
p {{ margin: 0.3em 0; }}
.quiet {{ color: var(--wb-faded, {LIGHT.faded}); }}
"""


def escaped(words: str) -> str:
    """Words as HTML text.

    Examples
    --------
    >>> escaped("<script>alert(1)</script>")
    '&lt;script&gt;alert(1)&lt;/script&gt;'
    """
    return escape(words, quote=True)


def table_html(caption: str, heads: Sequence[str], rows: Sequence[Sequence[Cell]], *, right: Sequence[int] = ()) -> str:
    """A table with a caption and named columns; verdicts carry sign, word and colour.

    Examples
    --------
    >>> print(table_html("Margins", ("Loop",), ((Cell("a < b"),),)))
    <div class="scroll" tabindex="0" role="region" aria-label="Margins"><table><caption>Margins</caption><thead><tr><th
    scope="col">Loop</th></tr></thead><tbody><tr><td>a &lt; b</td></tr></tbody></table></div>
    """

    def place(column: int) -> str:
        return ' class="right"' if column in right else ""

    head = "".join(f'<th scope="col"{place(k)}>{escaped(words)}</th>' for k, words in enumerate(heads))
    body = "".join(
        "<tr>" + "".join(f"<td{place(k)}>{_cell(one)}</td>" for k, one in enumerate(row)) + "</tr>" for row in rows
    )
    return (
        f'<div class="scroll" tabindex="0" role="region" aria-label="{escaped(caption)}"><table>'
        f"<caption>{escaped(caption)}</caption><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>"
    )


def verdict_html(verdict: Verdict, sign_and_word: str, words: str) -> str:
    """The verdict above everything else, then what it means."""
    return f'<p class="verdict {SLUGS[verdict]}">{escaped(sign_and_word)} <span>{escaped(words)}</span></p>'


def _cell(one: Cell) -> str:
    words = escaped(one.text)
    return words if one.verdict is None else f'<span class="{SLUGS[one.verdict]}">{words}</span>'
