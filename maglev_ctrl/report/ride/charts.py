"""Figures of a ride: weighted acceleration along the car, spectra with their mask, worst numbers over speed."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final

import numpy as np

from maglev_ctrl.analysis.response.records import PassengerRide, RideResponse
from maglev_ctrl.analysis.response.weighting import COMFORT_BOUNDS, COMFORT_LOWER
from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.report.chart import Axis, Chart, Item, Line, Marks, Note, Panel, Rule, Span
from maglev_ctrl.report.charts_modes import DESIGN_LINE
from maglev_ctrl.report.labelled import Labelled
from maglev_ctrl.report.ride.summary import worst_numbers
from maglev_ctrl.report.ride.tables import axes_of, weighted_along
from maglev_ctrl.report.style import DASHES, FAIL_COLOUR, INK, SIGMA, Dash, Symbol, colour, curve_colour, number
from maglev_ctrl.study.records import OptionStudy
from maglev_ctrl.study.ride_records import MaskResult, RidePoint, RideStudy, SpanPassing

COMFORT_LIMIT: Final = COMFORT_BOUNDS[0][0]  # m/s^2: not uncomfortable below
_CLASS_WORDS: Final = (*(words for _, words in COMFORT_BOUNDS), "extremely uncomfortable")
_SHADE: Final = 0.06  # opacity of one class; where two overlap the shade is twice as dark
_SYMBOLS: Final[tuple[Symbol, ...]] = ("square", "triangle", "diamond")
_TOTAL: Final = "total"
_NAMES: Final = 7.0  # margins at the right that the names of the classes take
_MOST_SPECTRA: Final = 4  # passengers in one panel
_THIRD_OCTAVES: Final = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0)
_DECADES: Final = 7  # of density that one panel shows
_KILOMETRES_PER_HOUR: Final = 3.6


def along_the_car(option: Labelled, response: RideResponse) -> Chart | None:
    """Weighted acceleration against the place in the car, with the classes of comfort behind; None without passengers.

    Where several passengers sit abreast, the line follows the worst of them.
    """
    passengers = sorted(response.passengers, key=lambda p: p.x)
    known = [p.total for p in passengers if math.isfinite(p.total)]
    if not known:
        return None
    top = max(0.6, 1.35 * max(known))
    x = np.array([p.x for p in passengers])
    room = 0.06 * (float(x[-1] - x[0]) or 1.0)
    window = (float(x[0]) - room, float(x[-1]) + _NAMES * room)
    items: list[Item] = _classes(top, window[1] - 0.2 * room)
    axes = axes_of(response)
    for order, axis in enumerate(axes if len(axes) > 1 else ()):  # one axis alone is the total
        values = [weighted_along(p, axis) for p in passengers]
        items += _followed(passengers, values, axis, order)
    items += _followed(passengers, [p.total for p in passengers], _TOTAL, 0)
    worst = max((p for p in passengers if math.isfinite(p.total)), key=lambda p: p.total)
    known_only = "largest known total" if len(known) < len(passengers) else "largest total"
    words = f"{known_only} {number(worst.total, 'm/s²')} at {worst.name} ({worst.comfort})"
    return Chart(
        key=f"{option.name}-ride",
        caption=f"Frequency-weighted r.m.s. acceleration of {option.label} along the car at "
        f"{number(response.speed * _KILOMETRES_PER_HOUR, 'km/h')}: {words}. Shaded: the comfort classes of ISO 2631-1, "
        "which overlap (darker), each named at its lower end.",
        alt=f"Weighted acceleration of {option.label} along the car: "
        + ", ".join(f"{p.name} {number(p.total, 'm/s²')}" for p in reversed(passengers)) + ".",
        panels=(
            Panel(
                tuple(items), Axis("place in the car, forward of its centre (m)", window),
                Axis("weighted acceleration (m/s²)", limits=(0.0, top)),
            ),
        ),
        panel_height=2.4,
    )  # fmt: skip


def _followed(passengers: list[PassengerRide], values: list[float], label: str, order: int) -> list[Item]:
    """Marks for all passengers and a line through the worst at each place along the car."""
    x, y = np.array([p.x for p in passengers]), np.array(values)
    places = np.unique(x)
    worst = np.array([np.max(y[x == place]) for place in places])
    total = label == _TOTAL
    tint = INK if total else curve_colour(order)
    hover = tuple(f"{p.name}: {label} {number(v, 'm/s²')}" for p, v in zip(passengers, values, strict=True))
    symbol: Symbol = "circle" if total else _SYMBOLS[order % len(_SYMBOLS)]
    return [
        Line(places, worst, "", tint, "solid" if total else "dash", 1.6 if total else 1.0),
        Marks(x, y, symbol, label, tint, 5.0, hover),
    ]


def _classes(top: float, right: float) -> list[Item]:
    """The overlapping classes as bands, each named just above its lower end."""
    uppers = (*(upper for upper, _ in COMFORT_BOUNDS), math.inf)
    items: list[Item] = []
    for place, (low, high, words) in enumerate(zip(COMFORT_LOWER, uppers, _CLASS_WORDS, strict=True)):
        if low >= top:
            break
        if place:
            items.append(Span("y", low, min(high, top), FAIL_COLOUR, _SHADE))
        if top - low > 0.07 * top:
            items.append(Note(right, low + 0.035 * top, words, "right", "center", INK))
        if place:
            items.append(Rule("y", low, "", FAIL_COLOUR, "dot", 0.7))
    return items


def acceleration_spectra(option: OptionStudy, study: RideStudy, response: RideResponse) -> Chart | None:
    """Densities of the passengers' acceleration with the mask, one panel per axis; None without spectra."""
    axes = tuple(dict.fromkeys(s.axis for s in response.spectra))
    shown = _shown_spectra(response, {m.passenger for m in nearest_masks(study.masks)})
    panels = [_spectrum_panel(response, axis, shown, [m for m in study.masks if m.axis == axis]) for axis in axes]
    if not panels:
        return None
    told = " ".join(f"{mask_words(m)[0].upper()}{mask_words(m)[1:]}." for m in nearest_masks(study.masks))
    return Chart(
        key=f"{option.name}-spectra",
        caption=f"Power spectral density of the passengers' acceleration in {option.label} at "
        f"{number(response.speed * _KILOMETRES_PER_HOUR, 'km/h')}, not weighted. {told}".strip(),
        alt=f"Spectra of the acceleration in {option.label} for the axes {', '.join(axes)}. {told}".strip(),
        panels=tuple(panels),
        panel_height=1.9,
        share_x=True,
    )


def _shown_spectra(response: RideResponse, asked: set[str]) -> tuple[str, ...]:
    """Passengers shown in every panel: those nearest to a mask, then those shaken most, in their own order."""
    peaks = {s.passenger: 0.0 for s in response.spectra}
    for one in response.spectra:
        peaks[one.passenger] = max(peaks[one.passenger], float(np.nanmax(one.density, initial=0.0)))
    ranked = sorted(peaks, key=lambda name: (name not in asked, -peaks[name]))[:_MOST_SPECTRA]
    return tuple(name for name in peaks if name in ranked)


def _spectrum_panel(response: RideResponse, axis: str, shown: tuple[str, ...], masks: list[MaskResult]) -> Panel:
    items: list[Item] = [
        Line(s.frequency, s.density, s.passenger, curve_colour(place), DASHES[place % len(DASHES)], 1.2)
        for place, name in enumerate(shown)
        for s in response.spectra
        if (s.passenger, s.axis) == (name, axis)
    ]
    nearest = nearest_masks(tuple(masks))
    for place, mask in enumerate(nearest):
        label = "mask" if place == 0 else f"mask {place + 1}"
        items.append(Line(mask.mask_frequency, mask.mask_density, label, FAIL_COLOUR, DASHES[place % len(DASHES)], 1.8))
    for mask in nearest:
        if math.isfinite(mask.ratio):
            height = float(np.exp(np.interp(math.log(mask.frequency), np.log(mask.mask_frequency),
                                            np.log(mask.mask_density))))  # fmt: skip
            words = (f"{mask.passenger}: {number(mask.ratio)} times the mask at {number(mask.frequency, 'Hz')}",)
            at, up = np.array([mask.frequency]), np.array([height * mask.ratio])
            items.append(Marks(at, up, "open_circle", "nearest to the mask", INK, 6.0, words))
    curves = [item for item in items if isinstance(item, Line)]
    limits, low, high = _density_limits(curves), *_frequencies(curves)
    ticks = tuple(f for f in _THIRD_OCTAVES if low <= f <= high)
    return Panel(
        tuple(items), Axis("frequency (Hz)", (low, high), ticks, tuple(f"{t:g}" for t in ticks), log=True),
        Axis("PSD ((m/s²)²/Hz)", limits, log=True), title=axis,
    )  # fmt: skip


def nearest_masks(masks: tuple[MaskResult, ...]) -> tuple[MaskResult, ...]:
    """Of every mask the passenger who comes nearest to it; one whose ratio is unknown comes before all."""
    found: dict[tuple[str, bytes, bytes], MaskResult] = {}
    for mask in masks:
        key = (mask.axis, mask.mask_frequency.tobytes(), mask.mask_density.tobytes())
        known = found.get(key)
        if known is None or math.isnan(mask.ratio) or mask.ratio > known.ratio:
            found[key] = mask
    return tuple(found.values())


def _density_limits(curves: list[Line]) -> tuple[float, float] | None:
    """From the largest density down to where curves matter no more."""
    known = np.concatenate([c.y[np.isfinite(c.y) & (c.y > 0.0)] for c in curves]) if curves else np.zeros(0)
    if not known.size:
        return None
    top = 10.0 ** np.ceil(np.log10(float(np.max(known)) * 1.2))
    return float(max(top * 10.0**-_DECADES, 10.0 ** np.floor(np.log10(float(np.min(known)))))), float(top)


def _frequencies(curves: list[Line]) -> tuple[float, float]:
    known = np.concatenate([c.x[c.x > 0.0] for c in curves])
    return max(float(np.min(known)), _THIRD_OCTAVES[0]), min(float(np.max(known)), _THIRD_OCTAVES[-1])


def mask_words(mask: MaskResult) -> str:
    """How far a passenger's spectrum is from the mask."""
    if math.isnan(mask.ratio):
        return f"{mask.passenger}, {mask.axis}: the mask was not evaluated"
    verb = "exceeds the mask" if mask.ratio > 1.0 else "stays below the mask"
    return (
        f"{mask.passenger}, {mask.axis}, {verb}: largest ratio of densities {number(mask.ratio)} at "
        f"{number(mask.frequency, 'Hz')}"
    )


def over_speed(option: OptionStudy, study: RideStudy, *, design_speed: float) -> Chart | None:
    """Worst ride, largest use of gaps and strokes, power, over speed; None where one speed only was looked at."""
    families = _families(study.points)
    if not families:
        return None
    draws = [worst_numbers(p.response)[3] for p in study.points]
    unit, scale = ("kW", 1e-3) if np.nanmax(np.array([*draws, 0.0])) >= 1e3 else ("W", 1.0)
    ride: list[Item] = [Rule("y", COMFORT_LIMIT, "not uncomfortable below", FAIL_COLOUR, "dashdot", 1.0)]
    used: list[Item] = [Rule("y", 100.0, "whole clearance", FAIL_COLOUR, "solid", 1.0)]
    power: list[Item] = []
    for order, (name, points) in enumerate(families):
        x = np.array([p.speed * _KILOMETRES_PER_HOUR for p in points])
        numbers = np.array([worst_numbers(p.response) for p in points])
        several = len(families) > 1
        ride += _curve(x, numbers[:, 0], name if several else "", order)
        used += _curve(x, 100.0 * numbers[:, 1], name if several else "gap", order)
        used += _curve(x, 100.0 * numbers[:, 2], f"{name}, stroke" if several else "stroke", order, style="dash")
        power += _curve(x, scale * numbers[:, 3], name if several else "", order)
    design = Rule("x", design_speed * _KILOMETRES_PER_HOUR, DESIGN_LINE, INK, "dot", 1.0)
    axis = Axis("speed (km/h)")
    again = replace(design, label="")
    panels = [
        Panel((*ride, design), axis, Axis("worst ride (m/s²)", (0.0, _top_of(ride, 1.1 * COMFORT_LIMIT)))),
        Panel((*used, again), axis, Axis("clearance used (%)", (0.0, _top_of(used, 110.0)))),
    ]
    if power:
        panels.append(Panel((*power, again), axis, Axis(f"supplied power ({unit})", (0.0, _top_of(power, 1e-9)))))
    words = (
        "weighted acceleration of the worst passenger, largest share of a gap and of a stroke (dashed) "
        f"that 3 {SIGMA} and sag use"
    )
    words += ", mean power supplied to all actuators" if power else ""
    return Chart(
        key=f"{option.name}-ride-speed",
        caption=f"Ride of {option.label} over speed: {words}. A gap in a curve is where one of the numbers is unknown.",
        alt=f"Ride of {option.label} over speed: {words}.",
        panels=tuple(panels),
        panel_height=1.5,
        share_x=True,
    )


def _curve(x: FloatArray, y: FloatArray, label: str, order: int, *, style: Dash = "solid") -> list[Item]:
    if not np.isfinite(y).any():
        return []
    tint = curve_colour(order)
    return [Line(x, y, label, tint, style, 1.4), Marks(x, y, "circle", "", tint, 2.5)]


def _top_of(items: list[Item], least: float) -> float:
    """Upper end of an axis from zero that holds every curve."""
    return max([least, *(1.08 * float(np.nanmax(item.y)) for item in items if isinstance(item, Line))])


def _families(points: tuple[RidePoint, ...]) -> list[tuple[str, list[RidePoint]]]:
    """Points of equal payload in order of speed, where there are at least two speeds."""
    found: list[tuple[str, list[RidePoint]]] = []
    for payload in sorted({p.payload for p in points}):
        members = {p.speed: p for p in reversed(points) if p.payload == payload}
        if len(members) > 1:
            name = f"payload {number(payload / 1e3, 't')}"
            found.append((name, [members[speed] for speed in sorted(members)]))
    return found


def girder_passing(option: OptionStudy, passing: SpanPassing, *, design_speed: float) -> Chart | None:
    """Peaks of gap and acceleration over speed while girders are passed; None where there are none."""
    if not np.isfinite(passing.gap).any():
        return None
    x = passing.speeds * _KILOMETRES_PER_HOUR
    rules = [Rule("x", design_speed * _KILOMETRES_PER_HOUR, DESIGN_LINE, INK, "dot", 1.0)]
    if math.isfinite(passing.worst_speed):
        worst = passing.worst_speed * _KILOMETRES_PER_HOUR
        rules.append(Rule("x", worst, "worst speed", FAIL_COLOUR, "dash", 1.0))
    again = [replace(rule, label="") for rule in rules]
    axis = Axis("speed (km/h)", (float(x[0]), float(x[-1])))
    gap, shake = 1e3 * passing.gap, passing.acceleration
    words = f"girders of {number(passing.span, 'm')} span with {number(1e3 * passing.sag, 'mm')} sag"
    return Chart(
        key=f"{option.name}-girders",
        caption=f"{option.label} passing {words}, one after another: largest change of a magnet's gap and largest "
        "vertical acceleration of the car in the steady motion, by the first harmonics (the numbers told for single "
        f"speeds are exact). Worst: {passing.worst}.",
        alt=f"Peaks over speed of {option.label} passing {words}; worst at "
        f"{number(passing.worst_speed * _KILOMETRES_PER_HOUR, 'km/h')}.",
        panels=(
            Panel((Line(x, gap, "", colour(1)), *rules), axis, Axis("change of gap (mm)", _from_zero(gap))),
            Panel((Line(x, shake, "", colour(1)), *again), axis, Axis("acceleration (m/s²)", _from_zero(shake))),
        ),
        panel_height=1.5,
        share_x=True,
    )  # fmt: skip


def _from_zero(values: FloatArray) -> tuple[float, float]:
    top = float(np.nanmax(values, initial=0.0))
    return 0.0, 1.08 * top or 1.0
