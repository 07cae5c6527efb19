"""The validation page from real results: every table with a column "tests" gets what the tests said when last recorded.

A test that the page names and that is not there fails the build; so does a record of a failed test.
"""

from __future__ import annotations

import json
import re
from typing import Any

from docutils import nodes
from record_validation import RECORD, ROOT, Record, named_tests
from sphinx.application import Sphinx
from sphinx.util import logging
from sphinx.util.docutils import SphinxDirective

LOGGER = logging.getLogger(__name__)
COLUMN = "last run"


def missing_tests(named: list[tuple[str, str]]) -> list[str]:
    """Tests of a list that do not exist: files, and functions in them."""
    missing = []
    for file, test in named:
        path = ROOT / file
        if not path.is_file():
            missing.append(file)
        elif test and not re.search(rf"^\s*def {test}\(", path.read_text(encoding="utf-8"), re.MULTILINE):
            missing.append(f"{file}::{test}")
    return missing


def told(record: Record, named: list[tuple[str, str]]) -> tuple[str, str]:
    """What the record says of some tests, and a word for it: passed, failed or unknown."""
    counts: dict[str, int] = {}
    errors: list[list[float]] = []
    for file, test in named:
        kept = record.get(file)
        if kept is None or (test and test not in kept["tests"]):
            return "not recorded yet", "unknown"
        for name, outcomes in kept["tests"].items():
            if test in ("", name):
                for outcome, count in outcomes.items():
                    counts[outcome] = counts.get(outcome, 0) + count
                errors += [kept["errors"][name]] if name in kept["errors"] else []
    words = [f"{counts[kind]} {kind}" for kind in ("failed", "passed", "skipped") if kind in counts]
    if errors:
        found, allowed = max(errors, key=lambda pair: pair[0] / pair[1])
        words.append(f"largest error {found:.1g}, allowed {allowed:.1g}")
    if counts.get("failed"):
        return ", ".join(words), "failed"
    return ", ".join(words), "passed" if counts.get("passed") else "unknown"


def add_results(app: Sphinx, doctree: nodes.document) -> None:
    """Add the column to the tables of the validation page."""
    if app.env.docname != "validation":
        return
    app.env.note_dependency(str(RECORD))
    record: Record = json.loads(RECORD.read_text(encoding="utf-8")) if RECORD.exists() else {}
    for table in doctree.findall(nodes.table):
        head = next(iter(table.findall(nodes.thead))).children[0]
        if head.children[-1].astext().strip() != "tests":
            continue
        group = next(iter(table.findall(nodes.tgroup)))
        group["cols"] += 1
        group.insert(group.index(group.next_node(nodes.thead)), nodes.colspec(colwidth=12))
        head += nodes.entry("", nodes.paragraph("", COLUMN))
        for row in next(iter(table.findall(nodes.tbody))).children:
            named = named_tests("".join(f"`{one.astext()}`" for one in row.children[-1].findall(nodes.literal)))
            for name in missing_tests(named):
                LOGGER.warning("no such test: %s", name, location=row)
            words, verdict = told(record, named) if named else ("no test is named", "unknown")
            if verdict == "failed":
                LOGGER.warning("the record holds a failed test: %s", words, location=row)
            row += nodes.entry("", nodes.paragraph("", "", nodes.inline("", words, classes=["result", verdict])))


class ValidationRecord(SphinxDirective):
    """One sentence: how many tests the record holds, of which version and days, and what they said."""

    has_content = False

    def run(self) -> list[nodes.Node]:
        """Build the sentence."""
        self.env.note_dependency(str(RECORD))
        record: Record = json.loads(RECORD.read_text(encoding="utf-8")) if RECORD.exists() else {}
        return [nodes.paragraph("", summary(record))]


def summary(record: Record) -> str:
    """The record in one sentence."""
    if not record:
        return "Nothing has been recorded yet."
    counts: dict[str, int] = {}
    for kept in record.values():
        for outcomes in kept["tests"].values():
            for outcome, count in outcomes.items():
                counts[outcome] = counts.get(outcome, 0) + count
    days = sorted({kept["day"] for kept in record.values()})
    versions = " and ".join(sorted({f"{kept['version']} ({kept['commit']})" for kept in record.values()}))
    when = days[0] if len(days) == 1 else f"{days[0]} to {days[-1]}"
    seconds = sum(kept["seconds"] for kept in record.values())
    said = ", ".join(f"{counts[kind]} {kind}" for kind in ("passed", "skipped", "failed") if kind in counts)
    return (
        f"The record is of version {versions}, {when}: {sum(counts.values())} tests in {len(record)} files, {said}, "
        f"{seconds / 60.0:.0f} minutes of one processor core."
    )


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the transform and the directive."""
    app.add_directive("validation-record", ValidationRecord)
    app.connect("doctree-read", add_results)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
