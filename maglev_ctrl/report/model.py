"""The report as a tree of blocks, before it becomes a page: both HTML and PDF are written from this one model."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from maglev_ctrl.errors import Verdict
from maglev_ctrl.report.chart import Chart
from maglev_ctrl.report.formula import Formula

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
class Reference:
    """A place where more is told: "figure:KEY", "table:KEY", "equation:KEY" or "section:ANCHOR".

    It is shown as "Figure 4", "Table 2", "Eq. (3)" or the section's title, as a link, with the number that the thing
    has in this report.
    """

    target: str


@dataclass(frozen=True, eq=False, slots=True)
class Passage:
    """Words with references among them; a reference to what the report has not is a fault of who wrote it."""

    parts: tuple[str | Reference, ...]


@dataclass(frozen=True, eq=False, slots=True)
class Equation:
    """A numbered equation and where it comes from."""

    key: str
    formula: Formula
    source: str = ""


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
    """Rows under column heads; `widths` are relative column widths, numbers stand right where `right` says so.

    `key` : for references; `see` : targets of references told after the caption, those that the report has.
    """

    caption: str
    columns: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    widths: tuple[float, ...] = ()
    right: tuple[int, ...] = ()
    small: bool = False
    key: str = ""
    see: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False, slots=True)
class FigureBlock:
    """A chart with its caption; `see`: targets of references told after it, those that the report has."""

    chart: Chart
    see: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False, slots=True)
class Listing:
    """A text shown as it is, such as the scenario file."""

    text: str


Block = Paragraph | Passage | Bullets | Banner | Table | FigureBlock | Equation | Listing


@dataclass(frozen=True, eq=False, slots=True)
class Section:
    """A heading (level 1 or 2) and its blocks."""

    title: str
    anchor: str
    level: int
    blocks: tuple[Block, ...]
    verdict: Verdict | None = None


@dataclass(frozen=True, eq=False, slots=True)
class Tile:
    """A key figure of the cover: what it is, its value with unit, the limit or place behind it, and its verdict."""

    label: str
    value: str
    detail: str
    verdict: Verdict | None = None


@dataclass(frozen=True, eq=False, slots=True)
class Cover:
    """What stands before everything else: what was studied, the verdict, key figures and one picture."""

    facts: tuple[tuple[str, str], ...]
    banner: Banner
    tiles: tuple[Tile, ...]
    picture: FigureBlock | None = None


@dataclass(frozen=True, eq=False, slots=True)
class Report:
    """Title page data and sections in reading order; with a cover it also has a page of contents."""

    title: str
    subtitle: str
    created: str
    scenario_hash: str
    version: str
    sections: tuple[Section, ...]
    cover: Cover | None = None

    def blocks(self) -> Iterator[Block]:
        """Every block, in reading order; a picture on the cover comes first."""
        if self.cover is not None and self.cover.picture is not None:
            yield self.cover.picture
        for section in self.sections:
            yield from section.blocks

    def charts(self) -> Iterator[Chart]:
        """Every chart, in reading order."""
        return (block.chart for block in self.blocks() if isinstance(block, FigureBlock))


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
