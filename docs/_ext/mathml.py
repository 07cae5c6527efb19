"""Mathematics as MathML at build time: no script, no network, no LaTeX."""

from __future__ import annotations

import re
from typing import Any

from docutils import nodes
from latex2mathml.converter import convert
from sphinx.application import Sphinx
from sphinx.errors import ExtensionError
from sphinx.util import logging
from sphinx.util.math import get_node_equation_number

LOGGER = logging.getLogger(__name__)

BARS = re.compile(r"<mo>(&#x0007C;|&#x02016;|&#x02225;)</mo>")
PLUS_MINUS = re.compile(r"<mi>(&#x000B1;|&#x02213;)</mi>")
ALPHABET = re.compile(r"\\(mathcal|mathbf|mathbb|mathfrak) ([A-Za-z])(?![A-Za-z])")
ALIGNED = re.compile(r"\\(begin|end)\{(?:aligned|split|align\*?)\}")


def to_mathml(latex: str, *, display: str) -> str:
    """MathML of a LaTeX formula; aligned equations become a table of a right and a left column."""
    text = ALIGNED.sub(lambda found: r"\begin{array}{rlrl}" if found[1] == "begin" else r"\end{array}", latex)
    text = ALPHABET.sub(r"\\\1{\2}", text)  # without braces it becomes an attribute that browsers ignore
    markup = convert(text.strip(), display=display)
    markup = PLUS_MINUS.sub(r"<mo>\1</mo>", markup)
    # Bars grow with whatever stands beside them, and browsers align cells by style only.
    markup = BARS.sub(r'<mo stretchy="false" lspace="0" rspace="0">\1</mo>', markup)
    markup = re.sub(r'columnalign="(left|right|center)"', r'style="text-align: \1"', markup)
    return markup.replace("<mtable", '<mtable displaystyle="true"') if display == "block" else markup


def converted(node: nodes.Element, *, display: str) -> str:
    """MathML of a node; a formula that cannot be read is a warning, and so an error of the build."""
    latex = node.astext()
    try:
        markup = to_mathml(latex, display=display)
    except Exception as error:
        LOGGER.warning("formula cannot be read (%s): %s", error, latex, location=node)
        return f"<code>{latex}</code>"
    leftover = re.search(r"<mi>(\\\w+|&)</mi>", markup)
    if leftover:
        LOGGER.warning("formula is only half read (%s): %s", leftover[1], latex, location=node)
    return markup


def visit_inline(self: Any, node: nodes.math) -> None:
    """An inline formula."""
    self.body.append(converted(node, display="inline"))
    raise nodes.SkipNode


def visit_block(self: Any, node: nodes.math_block) -> None:
    """A formula on its own, with its number where it has one."""
    wrapped = set(node["ids"]) <= set(node.parent.get("ids", ()))
    opened = node.copy() if wrapped else node
    if wrapped:
        opened["ids"] = []
    self.body.append(self.starttag(opened, "div", CLASS="math notranslate nohighlight"))
    if node["number"]:
        number = get_node_equation_number(self, node)
        self.body.append(f'<span class="eqno">({number})')
        self.add_permalink_ref(node, "Link to this equation")
        self.body.append("</span>")
    self.body.append(converted(node, display="block"))
    self.body.append("</div>\n")
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the renderer."""
    try:
        app.add_html_math_renderer("mathml", (visit_inline, None), (visit_block, None))
    except ExtensionError as error:
        raise ExtensionError(f"mathml: {error}") from error
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
