"""The report as a tree of blocks, before it becomes a page: both HTML and PDF are written from this one model."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from maglev_ctrl.errors import Verdict
from maglev_ctrl.report.chart import Chart

SIGNS = {Verdict.PASS: "✓", Verdict.FAIL: "✗", Verdict.NOT_EVALUATED: "?"}
SLUGS = {Verdict.PASS: "pass", Verdict.FAIL: "fail", Verdict.NOT_EVALUATED: "unknown"}


@dataclass(frozen=True, eq=False, slots=True)
class Cell:
    """One cell of a table; a verdict is told by sign, word and colour."""

    text: str
    verdict: Verdict | None = None


@dataclass(frozen=True, eq=False, slots=True)
class Paragraph:
    """Plain words."""

    text: str


@dataclass(frozen=True, eq=False, slots=True)
class Bullets:
    """A list of plain sentences."""

    items: tuple[str, ...]


@dataclass(frozen=True, eq=False, slots=True)
class Banner:
    """A verdict that cannot be overlooked; without one (options that differ) the words stand in a neutral tone."""

    verdict: Verdict | None
    text: str


@dataclass(frozen=True, eq=False, slots=True)
class Table:
    """Rows under column heads; `widths` are relative column widths, numbers stand right where `right` says so."""

    caption: str
    columns: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    widths: tuple[float, ...] = ()
    right: tuple[int, ...] = ()
    small: bool = False


@dataclass(frozen=True, eq=False, slots=True)
class FigureBlock:
    """A chart with its caption."""

    chart: Chart


@dataclass(frozen=True, eq=False, slots=True)
class Listing:
    """A text shown as it is, such as the scenario file."""

    text: str


Block = Paragraph | Bullets | Banner | Table | FigureBlock | Listing


@dataclass(frozen=True, eq=False, slots=True)
class Section:
    """A heading (level 1 or 2) and its blocks."""

    title: str
    anchor: str
    level: int
    blocks: tuple[Block, ...]
    verdict: Verdict | None = None


@dataclass(frozen=True, eq=False, slots=True)
class Report:
    """Title page data and sections in reading order."""

    title: str
    subtitle: str
    created: str
    scenario_hash: str
    version: str
    sections: tuple[Section, ...]

    def charts(self) -> Iterator[Chart]:
        """Every chart, in reading order."""
        for section in self.sections:
            for block in section.blocks:
                if isinstance(block, FigureBlock):
                    yield block.chart


def cell(value: str | Verdict) -> Cell:
    """A cell of words, or of a verdict.

    Examples
    --------
    >>> cell(Verdict.FAIL).text
    '✗ FAIL'
    """
    if isinstance(value, Verdict):
        return Cell(f"{SIGNS[value]} {value.value}", value)
    return Cell(value)


def row(*values: str | Verdict) -> tuple[Cell, ...]:
    """A row of cells."""
    return tuple(cell(value) for value in values)
