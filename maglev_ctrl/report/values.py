"""A requirement's value and margin in words: what is only a bound never reads like an exact number."""

from __future__ import annotations

import math
from typing import Literal

from maglev_ctrl.errors import Verdict
from maglev_ctrl.report.model import SIGNS, Cell, cell
from maglev_ctrl.report.style import number
from maglev_ctrl.study.records import RequirementResult

Sign = Literal["", "≥ ", "≤ "]
_SIGNS: dict[str, Sign] = {"exact": "", "lower": "≥ ", "upper": "≤ "}

_WISHES: dict[Verdict, str] = {
    Verdict.PASS: "a wish that is met", Verdict.FAIL: "a wish that is missed",
    Verdict.NOT_EVALUATED: "a wish that was not evaluated",
}  # fmt: skip


def value_words(result: RequirementResult) -> str:
    """The value with its unit, as "≥ 80 mm" where the true value is at least that, "≤ ..." where at most."""
    known = not math.isnan(result.value)
    return (_SIGNS[result.bound] if known else "") + number(result.value, result.unit)


def judged_cell(result: RequirementResult) -> Cell:
    """The verdict as a cell; a wish is told as one, and one that is missed is not told like a failure."""
    if result.hard:
        return cell(result.verdict)
    met = result.verdict is Verdict.PASS
    return Cell(f"{SIGNS[result.verdict]} wish", Verdict.PASS if met else None)


def with_prefix(value: float, unit: str) -> str:
    """A quantity that spans decades, told in thousands or millions of its unit where it is large.

    Examples
    --------
    >>> with_prefix(25300.0, "N"), with_prefix(-3.1e6, "W"), with_prefix(2.5, "W")
    ('25.3 kN', '−3.10 MW', '2.50 W')
    """
    for factor, prefix in ((1e6, "M"), (1e3, "k")):
        if factor <= abs(value) < math.inf:
            return number(value / factor, f"{prefix}{unit}")
    return number(value, unit)


def margin_sign(result: RequirementResult) -> Sign:
    """Which way the margin is bounded: a value that can only be larger widens a limit from below."""
    if result.bound == "exact" or math.isnan(result.margin_percent):
        return ""
    return "≥ " if (result.bound == "lower") == (result.sense == "at_least") else "≤ "


def margin_words(result: RequirementResult) -> str:
    """The margin in per cent of the limit, with its sign where it is only a bound."""
    return margin_sign(result) + number(result.margin_percent, "%")


def bound_words(result: RequirementResult) -> str:
    """What a bound is a bound of, e.g. "height_margin ≥ 80 mm (no instability found up to height 280 mm)"."""
    reason = f" ({result.reason})" if result.reason else ""
    return f"{result.name} {value_words(result)}{reason}"


def reason_words(result: RequirementResult) -> str:
    """Why a requirement failed, was not evaluated, or what the bound it passes on is a bound of."""
    judged = result.verdict.value if result.hard else _WISHES[result.verdict]
    if result.bound == "exact" or math.isnan(result.value) or result.verdict is Verdict.NOT_EVALUATED:
        return f"{result.name}, {judged}: {result.reason}"
    side = "lower" if result.bound == "lower" else "upper"
    return f"{result.name}, {judged} with {value_words(result)}, a {side} bound: {result.reason}"


def exact_margins(results: tuple[RequirementResult, ...]) -> tuple[RequirementResult, ...]:
    """The results whose margin is a known, finite number and no bound."""
    return tuple(r for r in results if r.bound == "exact" and math.isfinite(r.margin_percent))


def known_bounds(results: tuple[RequirementResult, ...]) -> tuple[RequirementResult, ...]:
    """The results whose value is only a bound."""
    return tuple(r for r in results if r.bound != "exact" and not math.isnan(r.value))


def breakable(name: str) -> str:
    """A requirement's name that may break after its underscores.

    Examples
    --------
    >>> len(breakable("gain_margin")) - len("gain_margin")
    1
    """
    return name.replace("_", "_\N{ZERO WIDTH SPACE}")
