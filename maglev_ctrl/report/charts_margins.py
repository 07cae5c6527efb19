"""Nyquist curves with the disk that must stay free, and every option's distance to every requirement."""

from __future__ import annotations

import math

import numpy as np

from maglev_ctrl.analysis.disk import DiskMargin
from maglev_ctrl.analysis.margins import Margins
from maglev_ctrl.arrays import ComplexArray
from maglev_ctrl.errors import Verdict
from maglev_ctrl.report.chart import Area, Axis, Bars, Chart, Item, Line, Marks, Note, Panel, Rule, Span
from maglev_ctrl.report.style import ABSENT, ALPHA, FADED, FAIL_COLOUR, INK, MINUS, UNKNOWN_COLOUR, colour, number
from maglev_ctrl.report.values import margin_sign, margin_words
from maglev_ctrl.study.records import Comparison, NyquistCurve, OptionStudy, RequirementResult

MOST_CHANNELS = 6
_LONGEST_BAR = 200.0  # percent
_ARROW = 14.0  # percent, the head of an arrow
_TICKS = (-100.0, 0.0, 100.0)  # none at the ends, where those of the neighbouring panel begin


def nyquist(option: OptionStudy) -> Chart | None:
    """Return ratio of each channel, other loops closed, with its disk margin drawn around -1; None without loops."""
    if not option.nyquist:
        return None
    curves = option.nyquist[:MOST_CHANNELS]
    disks = {c.channel: disk_alpha(option.margins, c.channel) for c in curves}
    columns = min(len(curves), 3)
    parts = ", ".join(f"{c.channel} {number(disks[c.channel])}" for c in curves)
    more = len(option.nyquist) - len(curves)
    return Chart(
        key=f"{option.name}-nyquist",
        caption=f"Nyquist curves of {option.label}, one channel at a time with the other loops closed, positive "
        "frequencies solid, negative dotted. The shaded disk is the one the disk margin keeps free; the cross is "
        f"{MINUS}1, the dotted circle has radius 1." + (f" {more} more channels are in report.json." if more else ""),
        alt=f"Nyquist curves of {option.label} with disk margins: {parts}.",
        panels=tuple(_nyquist_panel(c, disks[c.channel]) for c in curves),
        columns=columns,
        panel_height={1: 2.9, 2: 2.6, 3: 1.9}[columns],
        legend="none",
    )


def disk_alpha(margins: Margins | None, channel: str) -> float:
    """Disk margin of one channel; the proven lower bound where the two bounds differ, NaN when unknown."""
    for entry in margins.channels if margins is not None else ():
        if entry.channel == channel:
            return disk_value(entry.disk)
    return math.nan


def disk_value(disk: DiskMargin) -> float:
    """The disk margin where its two bounds agree, otherwise the proven lower bound."""
    return float(disk.alpha_proven if math.isnan(disk.alpha) else disk.alpha)


def exclusion_disk(alpha: float) -> tuple[float, float] | None:
    """Centre and radius of the disk around -1 that a balanced disk margin alpha < 2 keeps the Nyquist curve out of.

    Perturbations in the disk with real intercepts (2 - alpha)/(2 + alpha) and (2 + alpha)/(2 - alpha) are survived, so
    L stays out of minus their inverses: the disk with the same intercepts, mirrored (Seiler, Packard & Gahinet,
    IEEE Control Systems 40(5), 2020).

    Examples
    --------
    >>> [round(value, 6) for value in exclusion_disk(1.0) or ()]
    [-1.666667, 1.333333]
    """
    if not 0.0 < alpha < 2.0:
        return None
    near, far = (2.0 - alpha) / (2.0 + alpha), (2.0 + alpha) / (2.0 - alpha)
    return -(near + far) / 2.0, (far - near) / 2.0


def disk_words(disk: DiskMargin) -> str:
    """The disk margin in words; a bound is told as one where it is all that is known."""
    return ("≥ " if math.isnan(disk.alpha) else "") + number(disk_value(disk))


def _nyquist_panel(curve: NyquistCurve, alpha: float) -> Panel:
    angle = np.linspace(0.0, 2.0 * np.pi, 91)
    items: list[Item] = [Area(np.cos(angle[:-1]), np.sin(angle[:-1]), edge=FADED, dash="dot", width=0.8)]
    disk = exclusion_disk(alpha)
    half = 2.2
    if disk is not None:
        centre, radius = disk
        items.append(Area(centre + radius * np.cos(angle), radius * np.sin(angle), "", FAIL_COLOUR, 0.22, FAIL_COLOUR))
        half = min(4.0, max(half, 1.15 * radius + 0.8))
    response = _thinned(curve.response, half)
    items.append(Line(response.real, response.imag, "", colour(1), "solid", 1.3))
    items.append(Line(response.real, -response.imag, "", colour(1), "dot", 0.8))
    items.append(Marks(np.array([-1.0]), np.array([0.0]), "cross", "", INK, 6.0))
    return Panel(
        items=tuple(items),
        x=Axis(f"real part of L ({ABSENT})", limits=(-1.0 - half, -1.0 + half)),
        y=Axis(f"imaginary part of L ({ABSENT})", limits=(-half, half)),
        title=f"{curve.channel}: {ALPHA} = {number(alpha)}",
        equal=True,
    )


def _thinned(response: ComplexArray, half: float) -> ComplexArray:
    """The part of the curve near the window, points closer than a hair apart left out."""
    near = (np.abs(response.real + 1.0) < 3.0 * half) & (np.abs(response.imag) < 3.0 * half)
    kept = np.where(near, response, np.nan + 0j)
    out: list[complex] = []
    for value in kept:
        if out and math.isnan(value.real) and math.isnan(out[-1].real):
            continue
        if out and abs(value - out[-1]) < 0.004 * half:
            continue
        out.append(complex(value))
    return np.array(out, dtype=complex)


def margin_bars(comparison: Comparison) -> Chart | None:
    """Distance to every requirement as a percentage of its limit, option beside option; None without requirements."""
    names = requirement_names(comparison)
    options = comparison.options
    if not names or not options:
        return None
    columns = 2 if len(names) <= 6 else 3
    panels = tuple(_margin_panel(comparison, name, first=i % columns == 0) for i, name in enumerate(names))
    return Chart(
        key="margins",
        caption=f"Distance of every option to every requirement, per cent of the limit (cut at ±{_LONGEST_BAR:g} %): "
        "bars to the right of zero are inside the limit, hatched bars miss it, open arrows with ≥ or ≤ are bounds and "
        "no exact margins; words where nothing was computed.",
        alt="Margins to the requirements. " + " ".join(_words(comparison, name) for name in names),
        panels=panels,
        columns=columns,
        panel_height=max(0.8, 0.14 * len(options) + 0.12),
        legend="none",
    )


def requirement_names(comparison: Comparison) -> tuple[str, ...]:
    """Requirements in order of first appearance over all options."""
    seen: dict[str, None] = {}
    for option in comparison.options:
        seen |= dict.fromkeys(r.name for r in option.requirements)
    return tuple(seen)


def _words(comparison: Comparison, name: str) -> str:
    parts = []
    for option in comparison.options:
        found = next((r for r in option.requirements if r.name == name), None)
        parts.append(f"{option.label} {margin_words(found) if found else 'not asked'}")
    return f"{name}: {', '.join(parts)}."


def _margin_panel(comparison: Comparison, name: str, *, first: bool) -> Panel:
    options = comparison.options
    items: list[Item] = [Span("x", -_LONGEST_BAR, 0.0, FAIL_COLOUR, 0.07)]
    unit, limit, sense, wished = "", math.nan, "at_least", ""
    for row, option in enumerate(options):
        at = -float(row)
        found = next((r for r in option.requirements if r.name == name), None)
        if found is None:
            continue
        unit, limit, sense = found.unit, found.limit, found.sense
        wished = "" if found.hard else " (a wish)"
        if found.verdict is Verdict.NOT_EVALUATED or math.isnan(found.margin_percent):
            word = "not evaluated" if found.verdict is Verdict.NOT_EVALUATED else found.verdict.value
            items.append(Note(4.0, at, word, "left", "center", UNKNOWN_COLOUR, True))
            continue
        if found.bound != "exact":
            items += _bound_arrow(found, at, colour(row))
            continue
        cut = float(np.clip(found.margin_percent, -_LONGEST_BAR, _LONGEST_BAR))
        value = f"{option.label}: {number(found.value, unit)}, {number(found.margin_percent, '%')}"
        items.append(
            Bars(
                np.array([at]),
                np.zeros(1),
                np.array([cut]),
                0.66,
                "",
                colour(row),
                found.verdict is Verdict.FAIL,
                (value,),
            )
        )
        if abs(found.margin_percent) > _LONGEST_BAR:
            items.append(
                Note(math.copysign(0.97 * _LONGEST_BAR, cut), at, "»" if cut > 0 else "«", "center", colour=FADED)
            )
    items.append(Rule("x", 0.0, "", INK, "solid", 0.9))
    word = "at least" if sense == "at_least" else "at most"
    return Panel(
        items=tuple(items),
        x=Axis(
            "margin (% of limit)",
            limits=(-_LONGEST_BAR, _LONGEST_BAR),
            ticks=_TICKS,
            tick_labels=tuple(f"{t:g}".replace("-", MINUS) for t in _TICKS),
        ),
        y=Axis(
            "",
            limits=(0.6 - len(options), 0.6),
            ticks=tuple(-float(i) for i in range(len(options))),
            tick_labels=tuple(_short(o.label) for o in options) if first else tuple("" for _ in options),
        ),
        title=f"{_short(name)}{wished}\n{word} {number(limit, unit)}",
    )


def _bound_arrow(found: RequirementResult, at: float, tint: str) -> list[Item]:
    """A margin that is only a bound: an open arrow from zero to the bound, pointing to where the true margin lies."""
    sign = margin_sign(found).strip()
    end = float(np.clip(found.margin_percent, -_LONGEST_BAR, _LONGEST_BAR))
    reach = math.copysign(max(abs(end), _ARROW), end)
    neck = reach - math.copysign(_ARROW, reach)
    outline = Area(
        np.array([0.0, neck, reach, neck, 0.0]), at + np.array([-0.33, -0.33, 0.0, 0.33, 0.33]), edge=tint, width=1.1
    )
    roomy = abs(neck) > 4.0 * _ARROW
    place = 0.45 * neck if roomy else reach + math.copysign(0.9 * _ARROW, reach)
    return [outline, Note(place, at, sign, "center", "center", INK)]


def _short(label: str) -> str:
    return label if len(label) <= 24 else f"{label[:11].rstrip()} … {label[-10:].lstrip()}"
