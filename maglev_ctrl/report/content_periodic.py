"""Floquet margins as a reader sees them: one table of brackets, each with its tongue and what the number is."""

from __future__ import annotations

import math
from typing import Final

from maglev_ctrl.analysis.first_instability import BoundKind, PeriodicMargin
from maglev_ctrl.analysis.floquet_margins import FloquetMargins
from maglev_ctrl.errors import Agreement
from maglev_ctrl.report.charts_periodic import tongue_words
from maglev_ctrl.report.map.tables import bracket_words
from maglev_ctrl.report.model import Block, Cell, Paragraph, Table, row
from maglev_ctrl.report.style import ABSENT, number

BOUNDS: Final[dict[BoundKind, str]] = {"exact": "exact", "lower": "at least", "upper": "at most"}
_KILOMETRES_PER_HOUR: Final = 3.6


def floquet_margin_blocks(
    label: str, margins: FloquetMargins | None, reason: str, *, expected_depth: float
) -> list[Block]:  # fmt: skip
    """The table of an option's Floquet margins, and what is missing."""
    if margins is None:
        return [Paragraph(f"Floquet margins of {label}: {reason}.")] if reason else []
    rows = [_margin_row("Depth of modulation", margins.depth, expected_depth)]
    for pair, what in ((margins.gain, "Gain factor"), (margins.speed, "Speed")):
        if pair is not None:
            rows += [_margin_row(f"{what} {way}", one, 0.0) for way, one in zip(("down", "up"), pair, strict=True)]
    heads = ("Changed", "A multiplier reaches 1 at", "Against the design", "Number is", "Tongue or reason",
             "Narrower may be missed")  # fmt: skip
    table = Table(
        f"Floquet margins of {label} about the design point, one quantity changed at a time; gain and speed at the "
        "expected depth. The error ± holds the bracket; both engines verified its ends",
        heads, tuple(rows), (1.3, 1.7, 1.1, 0.8, 2.6, 1.2), right=(1, 2, 5), small=True,
    )  # fmt: skip
    return [table, Paragraph(f"{reason[0].upper()}{reason[1:]}.")] if reason else [table]


def _margin_row(what: str, one: PeriodicMargin, expected_depth: float) -> tuple[Cell, ...]:
    missed = _width(one)
    if one.agreement is Agreement.UNRESOLVED:
        return row(what, "UNRESOLVED", ABSENT, ABSENT, one.reason, missed)
    cause = "unstable without modulation too" if one.unmodulated else tongue_words(one.tongue.name)
    match one.bound:
        case "exact":
            place, told = bracket_words(one, *_scale(one)), cause
        case "lower":
            place, told = f"none as far as {_value(one, one.safe)}", one.reason
        case "upper":
            place, told = f"{_value(one, one.unsafe)} at the latest", f"{cause}; {one.reason}"
    return row(what, place, _change(one, expected_depth), BOUNDS[one.bound], told, missed)


def _scale(one: PeriodicMargin) -> tuple[float, str]:
    """Factor from SI to what people read, and its unit."""
    return {"depth": (100.0, "%"), "gain factor": (1.0, "")}.get(one.quantity, (_KILOMETRES_PER_HOUR, "km/h"))


def _value(one: PeriodicMargin, value: float) -> str:
    scale, unit = _scale(one)
    return number(value * scale, unit)


def _change(one: PeriodicMargin, expected_depth: float) -> str:
    """The value against the design: a factor on the expected depth, decibels of gain, per cent of the speed."""
    if one.quantity == "depth":
        return f"factor {number(one.value / expected_depth)}" if expected_depth > 0.0 else ABSENT
    if one.quantity == "gain factor":
        return number(20.0 * math.log10(one.value), "dB")
    return number(100.0 * (one.value / one.nominal - 1.0), "%")


def _width(one: PeriodicMargin) -> str:
    """The widest interval that the scan could have stepped over where no tongue is predicted."""
    return ABSENT if math.isnan(one.missed_width) else _value(one, one.missed_width)
