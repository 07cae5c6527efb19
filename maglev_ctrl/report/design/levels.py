"""What a law's own disturbance leaves of every weighted output and command, beside what was called acceptable."""

from __future__ import annotations

from collections.abc import Sequence

from maglev_ctrl.report.design.words import gathered
from maglev_ctrl.report.model import Block, Paragraph, Table, row
from maglev_ctrl.report.style import number
from maglev_ctrl.study.design.records import LawStudy, Level

MOST_ROWS = 12
SAME = 1e-6


def level_blocks(option: LawStudy) -> list[Block]:
    """Root mean squares under the law's disturbance; nothing where the law names none."""
    if not option.levels:
        return []
    ranked = sorted(option.levels, key=lambda one: -one.root_mean_square / one.allowed)
    several = len(option.corners) > 1
    rows = tuple(
        row(gathered(", ".join(each.name for each in alike)), number(one.root_mean_square, one.unit),
            number(one.allowed, one.unit), number(100.0 * one.root_mean_square / one.allowed, "%"),
            *([one.where] if several else []))
        for alike in _alike(ranked)[:MOST_ROWS]
        for one in alike[:1]
    )  # fmt: skip
    worst = ranked[0]
    ratio = worst.root_mean_square / worst.allowed
    words = (
        f"{worst.name} comes closest to what was called acceptable, with {number(100.0 * ratio, '%')} of it."
        if ratio <= 1.0
        else f"{worst.name} exceeds what was called acceptable, {number(ratio)} times: the disturbance is too strong "
        "for it, or its weight too light beside the others'."
    )
    caption = (
        "Root mean squares while the law's own disturbance and sensor noise act, white and all the time, beside the "
        "acceptable values the law was weighed with; an acceleration's direct share of the disturbance is left out"
    )
    heads = ("Signal", "Root mean square", "Acceptable", "Share", *(["Worst at"] if several else []))
    widths = (2.2, 1.1, 1.1, 0.8, *([2.4] if several else []))
    return [Table(caption, heads, rows, widths, (1, 2, 3), True), Paragraph(words)]


def _alike(ranked: Sequence[Level]) -> list[list[Level]]:
    """Neighbours whose numbers differ by rounding only, such as those of magnets side by side."""
    groups: list[list[Level]] = []
    for one in ranked:
        first = groups[-1][0] if groups else None
        told = first is not None and (first.unit, first.allowed, first.where) == (one.unit, one.allowed, one.where)
        if (
            first is not None
            and told
            and first.root_mean_square - one.root_mean_square <= SAME * first.root_mean_square
        ):
            groups[-1].append(one)
        else:
            groups.append([one])
    return [sorted(group, key=lambda one: (len(one.name), one.name)) for group in groups]
