"""Sentences about stability maps, the same on the page, on paper and on the terminal."""

from __future__ import annotations

import math

import numpy as np

from maglev_ctrl.analysis.first_instability import PeriodicMargin
from maglev_ctrl.analysis.plane_records import NO_ANSWER, STABLE, UNRESOLVED, UNSTABLE, MapAxis, StabilityPlane
from maglev_ctrl.analysis.tongue_atlas import SpeedRange, TongueAtlas
from maglev_ctrl.analysis.tongue_table import TongueRow
from maglev_ctrl.errors import Agreement
from maglev_ctrl.report.charts_periodic import short_words, tongue_words
from maglev_ctrl.report.style import ABSENT, number
from maglev_ctrl.study.map.records import MapQuantity, MapStudy, OptionMap

HOW_TO_READ = (
    "How to read a map: every point is the vehicle at one pair of values; strong colours grow, faint blue decays, the "
    "black line lies between, and two thin lines cross at the scenario's own design. An unstable region is named by "
    "the modes that feed each other through the passing frequency: 2\N{NO-BREAK SPACE}w1 is mode 1 alone, w1 + w2 and "
    'w2 - w1 are two modes together, "/2" the same at half the passing frequency, "none" an instability that needs no '
    "modulation. Hatched and grey are not stable: there the methods do not decide, or the model has no answer."
)
VERDICTS = {"go": "go", "no-go": "no go", "unresolved": "UNRESOLVED"}


def percent(share: float) -> str:
    """A share in per cent that never rounds something to nothing or a part to all.

    Examples
    --------
    >>> percent(0.0), percent(1e-7), percent(0.254), percent(0.99999)
    ('0 %', 'less than 0.1 %', '25.4 %', 'more than 99.9 %')
    """
    if share in (0.0, 1.0):
        return number(100.0 * share, "%", digits=3)
    if share < 1e-3:
        return "less than 0.1 %"
    return "more than 99.9 %" if share > 0.999 else f"{100.0 * share:.1f} %"


def scan_words(plane: StabilityPlane) -> str:
    """How the map was scanned and what it could have missed."""
    filled = float(np.mean(plane.interpolated))
    words = f"{plane.state.shape[0]} x {plane.state.shape[1]} points, {plane.evaluated} computed"
    words += f", {percent(filled)} filled in between computed points of one state" if filled else ""
    words += f", {len(plane.checked)} decided again by Hill's method." if len(plane.checked) else "."
    return words


def missed_words(plane: StabilityPlane, x: MapQuantity) -> str:
    """What could lie between the points."""
    if math.isnan(plane.missed_width):
        return f"How narrow an unstable strip along {x.label} may be and still be missed is not bounded."
    width = number(plane.missed_width * x.scale, x.unit)
    return f"An unstable strip along {x.label} narrower than {width} may be missing."


def reasons(plane: StabilityPlane) -> str:
    """Why parts of the map have no answer."""
    return "; ".join(dict.fromkeys(fault.rstrip(".") for fault in plane.faults)) or "no reason was recorded"


def is_speed(quantity: MapQuantity) -> bool:
    """Whether a quantity is the vehicle's speed, told by its unit too: a speed of rotation is not one."""
    return "speed" in quantity.quantity.lower() and quantity.unit.replace(" ", "") in ("m/s", "km/h")


def is_depth(quantity: MapQuantity, axis: MapAxis) -> bool:
    """Whether a quantity is the depth of modulation."""
    return axis.linear or "depth" in f"{axis.name} {quantity.quantity} {quantity.label}".lower()


def depth_axis(plane: StabilityPlane, x: MapQuantity, y: MapQuantity) -> str | None:
    """Which axis is the depth of modulation: "x", "y" or None."""
    return "y" if is_depth(y, plane.y) else "x" if is_depth(x, plane.x) else None


def tips(
    tongues: tuple[TongueRow, ...], plane: StabilityPlane, x: MapQuantity, y: MapQuantity
) -> tuple[tuple[float, float, str], ...]:
    """Speed (SI), onset depth and name of every tongue of the table on a map over speed and depth, lowest first.

    They were found on their own, so that a map that is too coarse for a narrow tongue is told so.
    """
    axis = depth_axis(plane, x, y)
    other, ends = (x, plane.x.values) if axis == "y" else (y, plane.y.values)
    if axis is None or not is_speed(other):
        return ()
    found = []
    for one in tongues:
        at = one.computed_centre if math.isfinite(one.computed_centre) else one.first_order_centre
        if math.isfinite(one.onset) and one.onset > 0.0 and ends[0] <= at <= ends[-1]:
            found.append((float(at), float(one.onset), one.resonance.name))
    return tuple(sorted(found, key=lambda tip: tip[1]))


def critical_depth_words(study: MapStudy, plane: StabilityPlane, tongues: tuple[TongueRow, ...] = ()) -> str:
    """Smallest depth at which the map loses what was stable at its first depth; what is undecided below comes first.

    A tongue that begins lower between the map's points takes its place.
    """
    axis = depth_axis(plane, study.x, study.y)
    if axis is None:
        return ABSENT
    depth, other = (study.y, study.x) if axis == "y" else (study.x, study.y)
    values, places = (plane.y.values, plane.x.values) if axis == "y" else (plane.x.values, plane.y.values)
    state = plane.state if axis == "y" else plane.state.T
    told = [number(float(value) * depth.scale, depth.unit) for value in values]
    before = state[:, 0] == UNSTABLE  # lost at the first depth of the map, which may be no modulation at all
    lost = _first((state == UNSTABLE) & ~before[:, None])
    words, thin = [], ""
    lowest = next(iter(tips(tongues, plane, study.x, study.y)), None)
    if lowest is not None and lowest[1] < (float(values[lost[1]]) if lost is not None else float(values[-1])):
        at = f"{number(lowest[0] * other.scale, other.unit)} ({short_words(lowest[2])})"
        onset = number(lowest[1] * depth.scale, depth.unit)
        if lost is None or onset != told[lost[1]]:
            thin = f"{onset} at {at}, narrower than the map's step; on the map "
    for value, text in ((UNRESOLVED, "UNRESOLVED from"), (NO_ANSWER, "no answer from")):
        found = _first((state == value) & ~before[:, None])
        if found is not None and (lost is None or found[1] <= lost[1]):
            words.append(f"{text} {told[found[1]]}")
    if lost is not None:
        words.append(f"{told[lost[1]]} at {number(float(places[lost[0]]) * other.scale, other.unit)}")
    elif not words and not before.all():
        words.append(f"none up to {told[-1]}")
    if before.any():
        where = "everywhere" if before.all() else f"on {percent(float(before.mean()))} of the {other.label} axis"
        words.append(f"unstable {'without modulation' if values[0] == 0.0 else f'from {told[0]} on'} {where}")
    return thin + "; ".join(words)


def _first(mask: np.ndarray[tuple[int, ...], np.dtype[np.bool_]]) -> tuple[int, int] | None:
    """Indices (other axis, depth) of the smallest depth that is marked."""
    depths = np.flatnonzero(mask.any(axis=0))
    if not depths.size:
        return None
    column = int(depths[0])
    return int(np.flatnonzero(mask[:, column])[0]), column


def ranges_words(atlas: TongueAtlas | None, speed: tuple[float, str], verdict: str) -> str:
    """The speeds of one verdict, as "100 to 200, 250 to 300 km/h"; `speed` is display over SI and the unit."""
    if atlas is None:
        return ABSENT
    told = [span_words(one, speed[0]) for one in atlas.ranges if one.verdict == verdict]
    return f"{', '.join(told)} {speed[1]}" if told else "none"


def span_words(one: SpeedRange, scale: float) -> str:
    """Both ends of a range, with as many digits as tell them apart."""
    low, high = one.lower * scale, one.upper * scale
    digits = 4
    while digits < 9 and number(low, digits=digits) == number(high, digits=digits):
        digits += 1
    return f"{number(low, digits=digits)} to {number(high, digits=digits)}"


def worst_tongue(option: OptionMap) -> str:
    """What grows most at the design depth: where the speed ranges are known theirs, else the largest of the table.

    The ranges count first: both engines have decided them, whichever pair of modes a tongue belongs to.
    """
    if option.atlas is not None:
        lost, doubt = option.atlas.of("no-go"), option.atlas.of("unresolved")
        also = "; some speeds UNRESOLVED" if doubt else ""
        if not lost:
            return f"none where decided{also}" if doubt else "none at this depth"
        worst = max(lost, key=lambda one: -math.inf if math.isnan(one.growth) else one.growth)
        names = ", ".join(tongue_words(short_words(name)) for name in worst.tongues)
        return f"{names}, {number(worst.growth, '1/s')}{also}"
    rows = [one for one in option.tongues if math.isfinite(one.peak_growth) and one.peak_growth > 0.0]
    if rows:
        worst_row = max(rows, key=lambda one: one.peak_growth)
        return f"{short_words(worst_row.resonance.name)}, {number(worst_row.peak_growth, '1/s')}"
    if option.tongues and all(one.onset == 0.0 for one in option.tongues):
        return "unstable without modulation"
    open_ones = [one for one in option.tongues if undecided(one)]
    if open_ones:
        return f"none found; not told apart: {', '.join(short_words(one.resonance.name) for one in open_ones)}"
    return "none at this depth" if option.tongues else ABSENT


def undecided(one: TongueRow) -> bool:
    """Whether it is open that a tongue is there at the depth of its row: no edges, and no onset above that depth."""
    return not (
        math.isfinite(one.computed_half_width) or one.onset > one.depth or one.onset == 0.0 or one.removal is not None
    )


def absent(one: TongueRow) -> bool:
    """Whether a row has no place in a table of tongues: none found up to the largest depth, or a mode grows anyway."""
    return math.isnan(one.computed_half_width) and (one.onset == math.inf or one.onset == 0.0)


def absent_words(option: OptionMap) -> tuple[str, ...]:
    """The crossings without a tongue of their own, told together by reason."""
    told: dict[str, list[str]] = {}
    for one in option.tongues:
        if absent(one):
            told.setdefault(one.reason or "none found", []).append(short_words(one.resonance.name))
    return tuple(f"{reason[:1].upper()}{reason[1:]}: {', '.join(names)}." for reason, names in told.items())


def margin_words(margin: PeriodicMargin | None, scale: float, unit: str, *, digits: int = 3) -> str:
    """The margin with what kind of bound it is; never a number where nothing was decided."""
    if margin is None:
        return ABSENT
    if margin.agreement is Agreement.UNRESOLVED or math.isnan(margin.value):
        return "UNRESOLVED"
    # The search may run up or down: "as far as" is then at least or at most the value.
    upwards = margin.limit > margin.nominal
    sign = {"exact": "", "lower": "≥ " if upwards else "≤ ", "upper": "≤ " if upwards else "≥ "}[margin.bound]
    return sign + number(margin.value * scale, unit, digits=digits)


def bound_sentence(margin: PeriodicMargin) -> str:
    """What kind of bound a margin is."""
    if margin.agreement is Agreement.UNRESOLVED:
        return f"UNRESOLVED: {margin.reason or 'no reason was recorded'}"
    words = {
        "exact": "lost inside the bracket, nothing nearer found",
        "lower": "stable as far as searched",
        "upper": "lost there at the latest, a nearer place is undecided",
    }[margin.bound]
    return f"{words}: {margin.reason}" if margin.reason and margin.bound != "exact" else words


def share(option: OptionMap, state: int) -> str:
    """The share of an option's map in a state."""
    return ABSENT if option.plane is None else percent(option.plane.share(state))


def option_sentence(option: OptionMap) -> str:
    """What a hurried reader takes from an option's map."""
    plane = option.plane
    if option.failure or plane is None:
        reason = option.failure or "no reason was recorded"
        return f"{option.label}: no map, {reason.rstrip('.')}."
    words = f"{option.label}: {percent(plane.share(UNSTABLE))} of the map is unstable"
    if plane.share(UNRESOLVED):
        words += f", {percent(plane.share(UNRESOLVED))} UNRESOLVED"
    if plane.share(NO_ANSWER):
        words += f", {percent(plane.share(NO_ANSWER))} without an answer"
    return f"{words}, {percent(plane.share(STABLE))} stable."
