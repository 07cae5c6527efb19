"""Tables of one option's map: tongues, speeds, margins, laws."""

from __future__ import annotations

import math

from maglev_ctrl.analysis.first_instability import PeriodicMargin
from maglev_ctrl.analysis.floquet_margins import FloquetMargins
from maglev_ctrl.analysis.tongue_atlas import TongueAtlas
from maglev_ctrl.analysis.tongue_removal import Removal
from maglev_ctrl.analysis.tongue_table import TongueRow
from maglev_ctrl.errors import Agreement
from maglev_ctrl.report.charts_periodic import short_words
from maglev_ctrl.report.map.words import VERDICTS, absent, bound_sentence, margin_words, span_words
from maglev_ctrl.report.model import Table, row
from maglev_ctrl.report.style import ABSENT, MINUS, number
from maglev_ctrl.study.map.records import OptionMap
from maglev_ctrl.synthesis.periodic_constant import PeriodicComparison

LOST_ITSELF = "unstable at the design point itself"
_MOST_FEEDERS = 3
_LEAST_SHARE = 0.005  # of the feeding: a smaller share is not told


def place_table(option: OptionMap, speed: tuple[float, str], depth_words: str) -> Table:
    """Where every tongue lies: first-order theory beside what was computed."""
    scale, unit = speed
    rows = tuple(
        row(
            short_words(one.resonance.name), one.resonance.kind,
            number(one.first_order_centre * scale, digits=5), number(2.0 * one.first_order_half_width * scale),
            number(one.computed_centre * scale, digits=5), number(2.0 * one.computed_half_width * scale),
            difference_words(one), number(100.0 * one.onset, "%") if math.isfinite(one.onset) else _onset(one.onset),
            number(one.peak_growth), "; ".join(part for part in (one.needs, one.reason) if part),
        )
        for one in option.tongues
        if not absent(one)
    )  # fmt: skip
    heads = (
        "Tongue", "Kind", "Hsu's centre", "Hsu's width", "Computed centre", "Computed width",
        "Widths differ by", "From depth", "Peak growth (1/s)", "Needs, or why missing",
    )  # fmt: skip
    caption = (
        f"Tongues of {option.label} over speed at {depth_words}: centres and full widths in {unit}, by Hsu's first-"
        "order theory and between the computed edges"
    )
    return Table(caption, heads, rows, (1.1, 1.0, 0.9, 0.9, 1.0, 1.0, 0.9, 0.9, 0.9, 2.2), (2, 3, 4, 5, 6, 7, 8), True)


def _onset(onset: float) -> str:
    return "none found" if onset == math.inf else ABSENT


def difference_words(one: TongueRow) -> str:
    """By how much the first-order width misses the computed one.

    A width that only one of the two has is told in words, for it has no per cent.
    """
    first, computed = one.first_order_half_width, one.computed_half_width
    if math.isnan(first) or math.isnan(computed) or math.isinf(first):
        return ABSENT
    if computed == 0.0 or first == 0.0:
        return "both 0" if first == computed else ("first order only" if first else "computed only")
    return f"{100.0 * (first - computed) / computed:+.1f} %".replace("-", MINUS)


def cure_table(option: OptionMap) -> Table:
    """What feeds every tongue that is there, and the damping that removes it."""
    rows = []
    for one in option.tongues:
        cure = one.removal
        if cure is None:
            continue
        others = ", ".join(short_words(name) for name in cure.crowd)
        if others and cure.equal.agreement is Agreement.UNRESOLVED:
            told = f"not by its own modes: {others} grows there too", ABSENT, f"overlaps {others}"
            rows.append(row(short_words(one.resonance.name), feeding_words(one), *told))
            continue
        alone = "; ".join(f"w{part.modes[0]}: {removal_words(part)}" for part in cure.alone)
        warnings = [w for w in (cure.equal.warning, *(part.warning for part in cure.alone)) if w]
        crowd = [f"beside {others}"] if others else []
        told = removal_words(cure.equal), alone or ABSENT, "; ".join((*warnings, *crowd))
        rows.append(row(short_words(one.resonance.name), feeding_words(one), *told))
    heads = ("Tongue", "Fed by", "Added damping ratio, equal", "On one mode alone", "Warning")
    caption = (
        f"What feeds the tongues of {option.label}, and the damping ratio that, added to its modes, removes each at "
        "every speed (a negative share works against the tongue)"
    )
    return Table(caption, heads, tuple(rows), (1.0, 2.2, 1.3, 1.6, 2.4), (), True)


def removal_words(one: Removal) -> str:
    """The damping that removes a tongue; an undecided or impossible one is told so.

    Between `unsafe` and `safe` both engines have seen the tongue go.
    """
    if one.agreement is Agreement.UNRESOLVED or math.isnan(one.safe):
        hint = f" (Hsu: {number(one.closed_form)})" if math.isfinite(one.closed_form) else ""
        return f"UNRESOLVED{hint}"
    if math.isinf(one.safe):
        return f"not by {number(one.unsafe)}" if math.isfinite(one.unsafe) else "no damping does it"
    return f"{number(one.safe)} (Hsu: {number(one.closed_form)})"


def feeding_words(one: TongueRow) -> str:
    """The elements of most share."""
    largest = sorted(one.feeding, key=lambda part: -abs(part[1]))
    told = [f"{name} {number(100.0 * part, '%', digits=2)}" for name, part in largest if abs(part) >= _LEAST_SHARE]
    more = f", {len(told) - _MOST_FEEDERS} more" if len(told) > _MOST_FEEDERS else ""
    return ", ".join(told[:_MOST_FEEDERS]) + more if told else ABSENT


def range_table(option: OptionMap, atlas: TongueAtlas, speed: tuple[float, str], depth_words: str) -> Table:
    """Go and no-go speeds."""
    rows = tuple(
        row(
            span_words(one, speed[0]), VERDICTS[one.verdict], ", ".join(short_words(name) for name in one.tongues),
            number(one.growth), one.reason,
        )
        for one in atlas.ranges
    )  # fmt: skip
    heads = (f"Speed ({speed[1]})", "Verdict", "Tongues", "Largest growth (1/s)", "Reason")
    caption = f"Go and no-go speeds of {option.label} at {depth_words}"
    if math.isfinite(atlas.missed_width):
        caption += (
            f"; scanned in steps of {number(atlas.scan_step * speed[0], speed[1])} at most, and down to "
            f"{number(atlas.missed_width * speed[0], speed[1])} wherever two Floquet multipliers meet, at any order"
        )
    return Table(caption, heads, rows, (1.4, 0.9, 2.6, 1.0, 2.0), (3,))


def margin_table(option: OptionMap, margins: FloquetMargins, speed: tuple[float, str], *, depth: float) -> Table:
    """Floquet margins about the design point, each with its bracket."""
    cases: list[tuple[str, PeriodicMargin | None, float, str]] = [("depth", margins.depth, 100.0, "%")]
    for name, pair, scale, unit in (("gain", margins.gain, 1.0, ""), ("speed", margins.speed, *speed)):
        down, up = pair if pair is not None else (None, None)
        cases += [(f"{name}, down", down, scale, unit), (f"{name}, up", up, scale, unit)]
    rows = []
    for name, one, scale, unit in cases:
        cells = _margin_cells(one, scale, unit, _why_none(option, margins))
        rows.append(row(name, number(100.0 * depth, "%") if name == "depth" else cells[0], *cells[1:]))
    heads = ("Margin", "Design", "Lost at", "Bracket", "Tongue", "What kind of bound", "Strip that may be missed")
    caption = f"Floquet margins of {option.label}: how far one quantity may go alone until a motion grows"
    return Table(caption, heads, tuple(rows), (1.0, 0.8, 1.0, 1.5, 1.4, 2.2, 1.0), (1, 2), True)


def _why_none(option: OptionMap, margins: FloquetMargins) -> str:
    """Why there is no margin of gain or speed: neither where the loop is lost itself, else what the study says."""
    if margins.gain is None and margins.speed is None:
        return LOST_ITSELF
    return option.margins_reason or "not asked"


def _margin_cells(one: PeriodicMargin | None, scale: float, unit: str, why: str) -> tuple[str, ...]:
    if one is None:
        return ABSENT, ABSENT, ABSENT, ABSENT, why, ABSENT
    undecided = one.agreement is Agreement.UNRESOLVED
    tongue = "unstable without modulation" if one.unmodulated else short_words(one.tongue.name)
    return (
        number(one.nominal * scale, unit), margin_words(one, scale, unit, digits=4),
        ABSENT if undecided else bracket_words(one, scale, unit),
        ABSENT if undecided or one.bound == "lower" else tongue, bound_sentence(one),
        number(one.missed_width * scale, unit),
    )  # fmt: skip


def bracket_words(one: PeriodicMargin, scale: float, unit: str) -> str:
    """The bracket as the middle with half its width as error; the one known end where there is only one.

    The digits of the value end where its error begins, as in "12.3401 ± 0.0002 %".
    """
    safe, unsafe = one.safe * scale, one.unsafe * scale
    if math.isnan(safe) or math.isnan(unsafe):
        known = unsafe if math.isnan(safe) else safe
        return ABSENT if math.isnan(known) else f"{'unstable' if math.isnan(safe) else 'stable'} at " + number(
            known, unit, digits=4
        )  # fmt: skip
    middle, half = 0.5 * (safe + unsafe), 0.5 * abs(unsafe - safe)
    if half == 0.0:
        return number(middle, unit, digits=6)
    decimals = max(0, -math.floor(math.log10(half) + 1e-9))
    shown, step = round(middle, decimals), 10.0**-decimals
    reach = max(abs(shown - safe), abs(shown - unsafe))  # from the rounded middle: what is told holds the bracket
    error = math.ceil(reach / step - 1e-6) * step
    return f"{shown:.{decimals}f} ± {error:.{decimals}f} {unit}".replace("-", MINUS).rstrip()


def law_table(option: OptionMap, found: PeriodicComparison) -> Table:
    """The periodic law and the constant ones, rated on the same problem."""
    rows = tuple(
        row(
            law.name, "stable" if law.stable else "unstable", number(law.spectral_radius, digits=4),
            number(law.mean_cost_ratio, digits=4), number(law.worst_cost_ratio, digits=4), number(law.peak_command),
            number(float(law.peak_gain.max())),
        )
        for law in (found.periodic, *found.constants)
    )  # fmt: skip
    heads = ("Law", "At the design point", "Largest multiplier", "Mean cost", "Worst cost", "Peak command", "Peak gain")
    caption = (
        f"Laws for {option.label} at the design point: cost over the best periodic law's, peak command in units of its "
        "weight"
    )
    return Table(caption, heads, rows, (2.0, 1.1, 1.0, 1.0, 1.0, 1.0, 1.0), (2, 3, 4, 5, 6))
