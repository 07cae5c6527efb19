"""Numbers of figures, tables and equations, and where a reference leads: the same on the page, on paper and in text."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from maglev_ctrl.report.model import Equation, FigureBlock, Passage, Report, Table

_KINDS: Final = {FigureBlock: ("figure", "Figure {}"), Table: ("table", "Table {}"), Equation: ("equation", "Eq. ({})")}
_UNSAFE: Final = re.compile(r"[^A-Za-z0-9]+")


@dataclass(frozen=True, eq=False, slots=True)
class Place:
    """Where a reference leads: the anchor and the words it is told in, such as "Figure 4"."""

    anchor: str
    words: str
    number: int = 0


@dataclass(frozen=True, eq=False, slots=True)
class Numbering:
    """Places by target of a reference, and by identity of the numbered block."""

    targets: dict[str, Place]
    blocks: dict[int, Place]

    def of(self, block: object) -> Place:
        """The place of a figure, table or equation of the report."""
        return self.blocks[id(block)]

    def known(self, targets: Sequence[str]) -> tuple[Place, ...]:
        """The places of those targets that the report has."""
        return tuple(self.targets[target] for target in targets if target in self.targets)

    def to(self, target: str) -> Place:
        """Where a reference in a passage leads.

        Raises
        ------
        ValueError : nothing in the report has that name
        """
        if target not in self.targets:
            raise ValueError(f"reference: expected something of the report, got {target!r}")
        return self.targets[target]


def numbered(report: Report) -> Numbering:
    """Figures, tables and equations numbered in reading order; anchors are unique and hold letters and digits only.

    Raises
    ------
    ValueError : a passage refers to what the report has not
    """
    targets: dict[str, Place] = {}
    blocks: dict[int, Place] = {}
    taken = {section.anchor for section in report.sections}
    for section in report.sections:
        targets.setdefault(f"section:{section.anchor}", Place(section.anchor, section.title))
    counts = dict.fromkeys(_KINDS, 0)
    for block in report.blocks():
        if not isinstance(block, (FigureBlock, Table, Equation)):
            continue
        kind, words = _KINDS[type(block)]
        counts[type(block)] += 1
        number = counts[type(block)]
        key = block.chart.key if isinstance(block, FigureBlock) else block.key
        anchor = f"{kind}-{slug(key) or number}"
        while anchor in taken:
            anchor += f"-{number}"
        taken.add(anchor)
        blocks[id(block)] = place = Place(anchor, words.format(number), number)
        if key:
            targets.setdefault(f"{kind}:{key}", place)
    found = Numbering(targets, blocks)
    for block in report.blocks():
        if isinstance(block, Passage):
            for part in block.parts:
                if not isinstance(part, str):
                    found.to(part.target)
    return found


def slug(key: str) -> str:
    """A key as an anchor: letters, digits and single hyphens.

    Examples
    --------
    >>> slug("winding_a <b>-nyquist")
    'winding-a-b-nyquist'
    """
    return _UNSAFE.sub("-", key).strip("-")


def ended(caption: str) -> str:
    """A caption as a whole sentence, so that another may follow.

    Examples
    --------
    >>> ended("Modes of a car"), ended("All options.")
    ('Modes of a car.', 'All options.')
    """
    return caption if caption.rstrip().endswith((".", "?", "!")) else f"{caption.rstrip()}."
