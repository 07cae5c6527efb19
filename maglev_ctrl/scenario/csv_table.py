"""What all tables in CSV files share: rows with their line numbers, headers with units, cells that are numbers."""

from __future__ import annotations

import csv
import io
import math
import re

from maglev_ctrl.scenario.problems import Problem, ScenarioProblems

HEADER = re.compile(r"\s*([^\[\](]*?)\s*[\[(]\s*(.+?)\s*[\])]\s*")
"""A column's name and its unit in brackets."""


def read_rows(content: bytes, *, shown: str) -> list[tuple[int, list[str]]]:
    """Line number and cells of every row that is neither empty nor a comment.

    Parameters
    ----------
    content : the file's bytes
    shown : how messages call the file

    Raises
    ------
    ScenarioProblems : bytes that are no UTF-8 text, quotes that do not close
    """
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content[: error.start].count(b"\n") + 1
        raise ScenarioProblems(shown, [Problem(line, 1, "", "expected UTF-8 text")]) from None
    kept = []
    reader = csv.reader(io.StringIO(text), strict=True)
    try:
        for cells in reader:
            if any(cell.strip() for cell in cells) and not cells[0].lstrip().startswith("#"):
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
