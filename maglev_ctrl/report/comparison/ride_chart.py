"""The ride of all options side by side: comfort, gap, power and robustness on one page."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.report.chart import Axis, Bars, Chart, Item, Note, Panel, Rule
from maglev_ctrl.report.charts_margins import disk_value
from maglev_ctrl.report.ride.charts import COMFORT_LIMIT
from maglev_ctrl.report.ride.summary import at_design, worst_numbers
from maglev_ctrl.report.style import ALPHA, FAIL_COLOUR, SIGMA, UNKNOWN_COLOUR, colour, number
from maglev_ctrl.study.records import Comparison, OptionStudy

_COMFORT: Final = "Comfort, smaller is better"
_GAP: Final = "Gap used, smaller is better"
_POWER: Final = "Power, smaller is better"
_ROBUSTNESS: Final = "Robustness, larger is better"
_MOST_LABEL: Final = 34  # characters of an option's name beside its bars


def ride_side_by_side(comparison: Comparison) -> Chart | None:
    """Bars of worst ride, gap used, supplied power and disk margin, option below option; None without any ride."""
    options = comparison.options
    if not any(at_design(option) is not None for option in options):
        return None
    numbers = np.array([worst_numbers(at_design(option)) for option in options])
    disk = np.array([_disk(option) for option in options])
    kilowatts = 1e-3 * numbers[:, 3]
    scale, unit = (1e3, "W") if not np.nanmax(kilowatts, initial=0.0) >= 1.0 else (1.0, "kW")
    panels = [
        _panel(options, numbers[:, 0], "m/s²", "worst ride (m/s²)", _COMFORT, limit=COMFORT_LIMIT),
        _panel(options, 100.0 * numbers[:, 1], "%", f"3 {SIGMA} and sag (% of clearance)", _GAP, limit=100.0),
        _panel(options, scale * kilowatts, unit, f"supplied power ({unit})", _POWER),
    ]  # fmt: skip
    if np.isfinite(disk).any():
        panels.append(_panel(options, disk, "", f"disk margin {ALPHA}, all loops", _ROBUSTNESS))
    words = (
        "frequency-weighted acceleration of the worst passenger (the line: 0.315 m/s², not uncomfortable below), "
        f"largest share of a gap used by 3 {SIGMA} and sag (the line: all of it), mean power supplied to all "
        "actuators"
    )
    words += f", disk margin {ALPHA} of all loops at once" if len(panels) == 4 else ""
    told = "; ".join(_words(option, numbers[k], disk[k]) for k, option in enumerate(options))
    return Chart(
        key="comparison-ride",
        caption=f"Ride of all options at the design point: {words}.",
        alt=f"Ride of all options at the design point. {told}.",
        panels=tuple(panels),
        columns=2,
        panel_height=max(0.8, 0.2 * len(options) + 0.1),
        legend="none",
    )


def _disk(option: OptionStudy) -> float:
    return math.nan if option.margins is None else disk_value(option.margins.multi_loop)


def _panel(
    options: tuple[OptionStudy, ...], values: FloatArray, unit: str, label: str, title: str, *,
    limit: float | None = None,
) -> Panel:  # fmt: skip
    top = max([float(np.nanmax(values, initial=0.0)), limit or 0.0]) or 1.0
    items: list[Item] = []
    for order, value in enumerate(values):
        at = -float(order)
        if not math.isfinite(value):
            word = "unlimited" if value > 0.0 else _absence(options[order], title)
            items.append(Note(0.02 * top, at, word, "left", "center", UNKNOWN_COLOUR, True))
            continue
        told = number(float(value), unit)
        hover = (f"{options[order].label}: {told}",)
        items.append(Bars(np.array([at]), np.zeros(1), np.array([value]), 0.62, "", colour(order), False, hover))
        items.append(Note(float(value) + 0.02 * top, at, told, "left", "center", boxed=True))
    if limit is not None:
        items.append(Rule("x", limit, "", FAIL_COLOUR, "dash", 1.1))
    ticks = tuple(-float(order) for order in range(len(options)))
    names = tuple(_short(option.label) if title in (_COMFORT, _POWER) else "" for option in options)
    return Panel(
        tuple(items), Axis(label, (0.0, 1.32 * top)), Axis("", (0.6 - len(options), 0.6), ticks, names), title=title
    )


def _absence(option: OptionStudy, title: str) -> str:
    """Why a bar is missing: no actuators and no loops are no failure to compute."""
    response = at_design(option)
    if title == _POWER and response is not None and not response.actuators:
        return "no actuators"
    if title == _ROBUSTNESS and option.margins is None:
        return "no margins"
    return "not evaluated"


def _words(option: OptionStudy, numbers: FloatArray, disk: float) -> str:
    return (
        f"{option.label}: worst ride {number(float(numbers[0]), 'm/s²')}, "
        f"gap used {number(100.0 * float(numbers[1]), '%')}, "
        f"supplied power {number(float(numbers[3]), 'W')}, disk margin {number(disk)}"
    )


def _short(label: str) -> str:
    return label if len(label) <= _MOST_LABEL else f"{label[:17].rstrip()} … {label[-14:].lstrip()}"
