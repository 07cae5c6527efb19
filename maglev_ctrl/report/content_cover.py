"""The cover: what was studied, the verdict, key figures of the option shown first, all options in one picture."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from maglev_ctrl.errors import Verdict
from maglev_ctrl.report.charts_comparison import options_over_speed
from maglev_ctrl.report.charts_margins import disk_value, disk_words
from maglev_ctrl.report.findings import hard_ones, leading_option
from maglev_ctrl.report.model import Banner, Cover, FigureBlock, Tile
from maglev_ctrl.report.ride.summary import at_design, worst_passenger
from maglev_ctrl.report.style import ABSENT, ALPHA, number
from maglev_ctrl.report.values import value_words
from maglev_ctrl.study.records import Comparison, OptionStudy, RequirementResult

_KILOMETRES_PER_HOUR = 3.6
MOST_TILES = 6


def cover(comparison: Comparison, banner: Banner) -> Cover:
    """The cover of a study's report."""
    return Cover(_facts(comparison), banner, cover_tiles(comparison), _picture(comparison))


def _facts(comparison: Comparison) -> tuple[tuple[str, str], ...]:
    options = comparison.options
    facts = [
        ("Design speed", number(comparison.design_speed * _KILOMETRES_PER_HOUR, "km/h")),
        ("Design height", number(comparison.design_height * 1e3, "mm")),
    ]
    if options:
        vehicle = options[0].vehicle
        mass = sum(body.mass for body in vehicle.bodies)
        names = ", ".join(body.name for body in vehicle.bodies[:6]) + (" …" if len(vehicle.bodies) > 6 else "")
        magnets = sum(magnet.count for magnet in vehicle.magnets)
        made_of = f"{number(mass / 1e3, 't')}: {names}" + (
            f"; {magnets:g} {'magnet' if magnets == 1 else 'magnets'}" if magnets else ""
        )
        facts.insert(0, ("Vehicle", made_of))
        facts.append(("Options", str(len(options))))
        study = next((o.floquet for o in options if o.floquet is not None), None)
        if study is not None:
            facts.append(
                ("Periodic forcing", f"wavelength {number(study.wavelength, 'm')}, expected depth "
                 f"{number(100.0 * study.expected_depth, '%')}")
            )  # fmt: skip
    return tuple(facts)


def cover_tiles(comparison: Comparison) -> tuple[Tile, ...]:
    """Four to six key figures: the count of options that pass, then those of the option shown first."""
    options = comparison.options
    passed = sum(o.verdict is Verdict.PASS for o in options)
    best = leading_option(comparison)
    if best is None:
        return ()
    asked = len(hard_ones(best))
    count = f"all of {asked} requirements" if asked else "no requirement is set"
    # One verdict for all options would mislead where some pass: the count speaks for itself.
    together = comparison.verdict if passed in (0, len(options)) and asked else None
    tiles = [Tile("Options that pass", f"{passed} of {len(options)}", count, together)]
    if len(options) > 1:
        tiles.append(Tile("Shown first", best.label, "how it is chosen: see the summary", best.verdict))
    found = (_growth(best), _damping(best), _disk(best), _depth(best), _ride(best))
    tiles += [tile for tile in found if tile is not None]
    return tuple(tiles[:MOST_TILES])


def _judged(option: OptionStudy, *quantities: str) -> RequirementResult | None:
    """The option's requirement on the first of these quantities that has one, hard ones first: of several the one with
    the worst value, for a key figure is not to look better than the tables."""
    order = sorted(option.requirements, key=lambda r: not r.hard)
    for name in quantities:
        own = [r for r in order if r.quantity == name]
        alike = [r for r in own if (r.hard, r.sense) == (own[0].hard, own[0].sense) and math.isfinite(r.value)]
        if alike:
            return (max if own[0].sense == "at_most" else min)(alike, key=lambda r: r.value)
        if own:
            return own[0]
    return None


def _shown(result: RequirementResult | None) -> Verdict | None:
    """The verdict a tile shows: a wish that is missed fails nothing."""
    if result is None or (result.verdict is Verdict.FAIL and not result.hard):
        return None
    return result.verdict


def _limit(result: RequirementResult) -> str:
    wished = "" if result.hard else " (a wish)"
    return f"{'at least' if result.sense == 'at_least' else 'at most'} {number(result.limit, result.unit)}{wished}"


def _tile(label: str, result: RequirementResult | None, value: str, place: str) -> Tile | None:
    """The requirement's own value where there is one, else what the study found at that place, without a verdict."""
    if result is not None:
        where = f"; worst at {result.worst_at}" if result.worst_at else ""
        return Tile(label, value_words(result), f"{_limit(result)}{where}", _shown(result))
    return Tile(label, value, f"{place}; no limit is set") if value not in ("", ABSENT) else None


def _growth(option: OptionStudy) -> Tile | None:
    modes = option.modes
    own = "" if modes is None else number(modes.spectral_abscissa, "1/s")
    if modes is not None and abs(modes.spectral_abscissa) <= float(np.max(modes.error_bound)):
        own = "0 within error"
    return _tile("Largest growth rate", _judged(option, "growth_rate"), own, "at the design point")


def _damping(option: OptionStudy) -> Tile | None:
    least = [float(np.nanmin(s.least_damping)) for s in option.sweeps if np.isfinite(s.least_damping).any()]
    own = number(100.0 * min(least), "%") if least else ""
    return _tile("Least damping ratio", _judged(option, "damping_ratio"), own, "over the sweeps")


def _disk(option: OptionStudy) -> Tile | None:
    margins = option.margins
    disks = [] if margins is None else [*(c.disk for c in margins.channels), margins.multi_loop]
    known = bool(disks) and not any(math.isnan(disk_value(disk)) for disk in disks)
    own = disk_words(min(disks, key=disk_value)) if known else ""
    return _tile(f"Smallest disk margin {ALPHA}", _judged(option, "disk_margin"), own, "at the design point")


def _depth(option: OptionStudy) -> Tile | None:
    study = option.floquet
    if study is None:
        return None
    result = _judged(option, "modulation_depth", "modulation_ratio")
    if math.isnan(study.worst_depth):
        return Tile("Smallest critical depth", "UNRESOLVED", "the two engines do not agree", Verdict.NOT_EVALUATED)
    if bool(np.all(study.map.unstable[:, 0])) and study.map.depths[0] == 0.0:
        return Tile("Smallest critical depth", ABSENT, "unstable without modulation", _shown(result))
    bound = math.isinf(study.worst_depth)
    sign = "≤ " if np.any(study.map.unresolved) else ""  # where the engines disagree it may be smaller
    value = f"> {number(100.0 * study.largest_depth, '%')}" if bound else sign + number(100.0 * study.worst_depth, "%")
    where = "" if bound else f" at {number(study.worst_speed * _KILOMETRES_PER_HOUR, 'km/h')}"
    told = f"expected {number(100.0 * study.expected_depth, '%')}{where}"
    if result is not None:
        times = " times the expected depth" if result.quantity == "modulation_ratio" else ""
        told = f"{_limit(result)}{times}; {told}"
    return Tile("Smallest critical depth", value, told, _shown(result))


def _ride(option: OptionStudy) -> Tile | None:
    response = at_design(option)
    passenger = None if response is None else worst_passenger(response)
    own = "" if passenger is None else number(passenger.total, "m/s²")
    return _tile("Ride, worst passenger", _judged(option, "weighted_acceleration"), own, "at the design point")


def _picture(comparison: Comparison) -> FigureBlock | None:
    """Growth rate and, where it was studied, critical depth of all options against speed, side by side."""
    chart = options_over_speed(comparison)
    if chart is None:
        return None
    second = chart.panels[-1]
    words = "critical modulation depth" if len(chart.panels) > 2 else "least damping ratio"
    names = ", ".join(option.label for option in comparison.options)
    told = f"largest growth rate (negative is stable) and {words}"
    return FigureBlock(
        replace(
            chart, key="cover", panels=(chart.panels[0], second), columns=2, panel_height=1.9, legend="bottom",
            share_x=False, caption=f"All options against speed: {told}.", alt=f"Against speed for {names}: {told}.",
        )
    )  # fmt: skip
