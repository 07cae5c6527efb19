"""What all tables in CSV files share: rows with their line numbers, headers with units, cells that are numbers."""

from __future__ import annotations

import csv
import io
import math
import re

from maglev_ctrl.scenario.problems import Problem, ScenarioProblems

HEADER = re.compile(r"\s*([^\[\](]*?)\s*[\[(]\s*(.+?)\s*[\])]\s*")
"""A column's name and its unit in brackets."""
COLUMN_LIMIT = 64
CELL_LIMIT = 500
"""Letters of one cell: names and numbers are short, and what is longer is no table."""
_UNSEEN = re.compile(r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]")


def read_rows(content: bytes, *, shown: str) -> list[tuple[int, list[str]]]:
    """Line number and cells of every row that is neither empty nor a comment.

    Parameters
    ----------
    content : the file's bytes
    shown : how messages call the file

    Raises
    ------
    ScenarioProblems : bytes that are no UTF-8 text, control signs, quotes that do not close, cells or rows that are too
        long
    """
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content[: error.start].count(b"\n") + 1
        raise ScenarioProblems(shown, [Problem(line, 1, "", "expected UTF-8 text")]) from None
    unseen = _UNSEEN.search(text)
    if unseen is not None:
        line = text.count("\n", 0, unseen.start()) + 1
        said = f"expected text without control signs, got U+{ord(unseen[0]):04X}"
        raise ScenarioProblems(shown, [Problem(line, 1, "", said)])
    kept = []
    reader = csv.reader(io.StringIO(text), strict=True)
    try:
        for cells in reader:
            if any(cell.strip() for cell in cells) and not cells[0].lstrip().startswith("#"):
                if len(cells) > COLUMN_LIMIT:
                    said = f"expected at most {COLUMN_LIMIT} columns, got {len(cells)}"
                    raise ScenarioProblems(shown, [Problem(reader.line_num, 1, "", said)])
                if max(map(len, cells)) > CELL_LIMIT:
                    said = f"expected cells of at most {CELL_LIMIT} letters"
                    raise ScenarioProblems(shown, [Problem(reader.line_num, 1, "", said)])
                kept.append((reader.line_num, cells))
    except csv.Error as error:
        raise ScenarioProblems(shown, [Problem(1, 1, "", f"expected a CSV table; {error}")]) from None
    return kept


def number(cell: str) -> tuple[float, str]:
    """The number in a cell, or 0 and what is wrong with it."""
    got = cell.strip()[:40]
    try:
        value = float(got)
    except ValueError:
        return 0.0, f'expected a number, got "{got}"' if got else "expected a number, got nothing"
    if not math.isfinite(value):
        return 0.0, f"expected a finite number, got {got}"
    return value, ""
