"""`{reliability} PART`: what the last run of a part of `dev.py hold` reached, as a table, with its day and commit."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util import logging
from sphinx.util.docutils import SphinxDirective

RECORD = Path(__file__).resolve().parents[1] / "_data" / "reliability.json"
LOGGER = logging.getLogger(__name__)
HEADS = ("what was done", "asked", "reached", "")


class Reliability(SphinxDirective):
    """The record of one part."""

    required_arguments = 1
    has_content = False

    def run(self) -> list[nodes.Node]:
        """Build the sentence, the table and the notes."""
        self.env.note_dependency(str(RECORD))
        known: dict[str, Any] = json.loads(RECORD.read_text(encoding="utf-8")) if RECORD.exists() else {}
        part = known.get(self.arguments[0])
        if part is None:
            LOGGER.warning("no record of the part: %s", self.arguments[0], location=self.get_location())
            return [nodes.paragraph("", "NOT EVALUATED: nothing has been recorded yet.")]
        found: list[nodes.Node] = [nodes.paragraph("", sentence(part)), table(part)]
        notes = [nodes.list_item("", nodes.paragraph("", words)) for words in part["notes"]]
        return [*found, nodes.bullet_list("", *notes)] if notes else found


def sentence(part: dict[str, Any]) -> str:
    """When, of what, on what and how long.

    Examples
    --------
    >>> sentence({"day": "2026-11-23", "commit": "abc", "machine": "2 processors", "seconds": 90.0})
    'Run on 2026-11-23, of commit abc, on 2 processors, in 1.5 minutes.'
    """
    minutes = part["seconds"] / 60.0
    return f"Run on {part['day']}, of commit {part['commit']}, on {part['machine']}, in {minutes:.2g} minutes."


def table(part: dict[str, Any]) -> nodes.table:
    """One row a figure; a missed one says so in words."""
    body = nodes.tbody()
    for one in part["figures"]:
        words = ("met", "passed") if one["met"] else ("MISSED", "failed")
        cells = [nodes.paragraph("", text) for text in (one["what"], one["asked"], one["reached"])]
        cells.append(nodes.paragraph("", "", nodes.inline("", words[0], classes=["result", words[1]])))
        body += nodes.row("", *(nodes.entry("", cell) for cell in cells))
    head = nodes.thead("", nodes.row("", *(nodes.entry("", nodes.paragraph("", words)) for words in HEADS)))
    group = nodes.tgroup("", *(nodes.colspec(colwidth=width) for width in (40, 20, 32, 8)), head, body, cols=len(HEADS))
    return nodes.table("", group, classes=["colwidths-given"])


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the directive."""
    app.add_directive("reliability", Reliability)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
