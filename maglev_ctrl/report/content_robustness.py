"""Worst cases of an option within the spreads of its parameters: what is proven, and what was found."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from maglev_ctrl.analysis.robustness.records import FactorBounds, WorstCase, WorstPoint
from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.errors import Agreement, Verdict
from maglev_ctrl.report.model import Banner, Block, Bullets, Paragraph, Table, row
from maglev_ctrl.report.style import ABSENT, ALPHA, number
from maglev_ctrl.study.records import OptionStudy

_MOST_PARAMETERS: Final = 16
_STABLE: Final[dict[Verdict, str]] = {
    Verdict.PASS: "Stability is proven for every combination of the parameters within their spreads",
    Verdict.FAIL: "A combination of the parameters within their spreads is unstable",
    Verdict.NOT_EVALUATED: "It is not known whether every combination of the parameters within their spreads is stable",
}


def robustness_blocks(option: OptionStudy) -> list[Block]:
    """The verdict, the factor from both sides, and the worst values found; nothing where no parameter is uncertain."""
    found = option.robustness
    if found is None:
        reason = option.robustness_reason
        return [Paragraph(f"Worst cases were not evaluated: {reason}")] if reason else []
    return worst_case_blocks(found, option.label)


def worst_case_blocks(found: WorstCase, label: str) -> list[Block]:
    """The same for worst cases on their own."""
    why = f": {found.reason}" if found.reason else ""
    blocks: list[Block] = [
        Banner(found.stable, f"{_STABLE[found.stable]}{why}."), Paragraph(factor_words(found.factor)),
        _value_table(label, found), _parameter_table(label, found),
    ]  # fmt: skip
    told = [f"{name}: {point.reason}" for name, point in _points(found) if point.reason]
    told += [f"With exact delays: {found.exact_delays}"] if found.exact_delays else []
    return [*blocks, Bullets(tuple(told))] if told else blocks


def factor_words(factor: FactorBounds) -> str:
    """By how much all spreads may grow: what is guaranteed and what was found."""
    guaranteed = (
        f"Guaranteed factor {number(factor.proven, digits=4)}: with all spreads times anything less, every combination "
        "of changes is stable (structured singular value"
        + (f", the box split into {factor.boxes} parts)" if factor.boxes > 1 else ")")
    )
    if not math.isfinite(factor.found):
        found = f"no unstable combination was found up to a factor of {number(factor.limit)}, where the search ended"
    else:
        at = number(factor.frequency / (2.0 * math.pi), "Hz")
        found = (
            f"Found factor {number(factor.found, digits=4)}: with all spreads times this a combination was found "
            f"that puts a pole on the axis at {at}; its replay leaves the pole "
            f"{number(factor.pole_distance, digits=1)} away (relative)"
        )
    found_one, agreed = math.isfinite(factor.found), factor.agreement is Agreement.AGREED
    between = " The two agree." if found_one else ""
    if not agreed:
        between = (
            " The two do not meet: the true factor lies between them" if found_one else " Between lies the unknown"
        )
        between += ", and only the guaranteed one may be relied on."
    return f"{guaranteed}. {found[0].upper()}{found[1:]}.{between}"


def _points(found: WorstCase) -> tuple[tuple[str, WorstPoint], ...]:
    return (
        ("Largest growth rate (1/s)", found.growth), ("Least damping ratio (%)", found.damping),
        (f"Smallest disk margin {ALPHA}, all channels", found.disk),
    )  # fmt: skip


def _value_table(label: str, found: WorstCase) -> Table:
    rows = []
    for name, point in _points(found):
        scale = 100.0 if point is found.damping else 1.0
        rows.append(
            row(
                name, number(scale * point.nominal), number(scale * point.value),
                number(point.frequency / (2.0 * math.pi), "Hz"), _confirmed(point),
            )
        )  # fmt: skip
    return Table(
        f"Worst values of {label} found within the spreads; the true worst may be worse still, never better",
        ("Quantity", "Nominal", "Worst found", "At", "Model assembled again"), tuple(rows), (2.2, 1.0, 1.1, 1.0, 1.5),
        right=(1, 2, 3),
    )  # fmt: skip


def _confirmed(point: WorstPoint) -> str:
    if math.isnan(point.value):
        return ABSENT
    return "same value" if point.verified else "not confirmed"


def _parameter_table(label: str, found: WorstCase) -> Table:
    """Each parameter with its spread and its change at every worst point, the widest spreads first."""
    edge = 100.0 * _sized(found.factor.changes, found.spreads) * found.spreads
    order = np.argsort(-found.spreads, kind="stable")[:_MOST_PARAMETERS]
    changes = [_sized(point.percent, found.spreads) for _, point in _points(found)]
    rows = tuple(
        row(
            found.names[k], f"± {number(100.0 * float(found.spreads[k]), '%')}",
            *(_signed(float(change[k])) for change in changes), _signed(float(edge[k])),
        )
        for k in order
    )  # fmt: skip
    count = len(found.names)
    more = f" (the {len(rows)} widest of {count} spreads)" if count > len(rows) else ""
    heads = ("Parameter", "Spread", "At the largest growth", "At the least damping", "At the smallest disk margin",
             "Where stability was lost")  # fmt: skip
    return Table(
        f"Uncertain parameters of {label}{more} and their changes at each worst point; stability is lost outside the "
        "spreads where the found factor is above 1",
        heads, rows, (2.2, 0.9, 1.1, 1.1, 1.2, 1.2), right=(1, 2, 3, 4, 5), small=True,
    )  # fmt: skip


def _sized(values: FloatArray, like: FloatArray) -> FloatArray:
    """Changes that were not computed come empty: NaN in their place."""
    return values if values.shape == like.shape else np.full(like.shape, np.nan)


def _signed(percent: float) -> str:
    text = number(percent, "%")
    return f"+{text}" if percent > 0.0 else text
