"""Linear and logarithmic axes: the range of the data, where ticks stand, and where a value stands along the axis."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.report.chart import Area, Bars, Heat, Line, Marks, Panel, Rule
from maglev_ctrl.report.style import number, tick_text

_STEPS = ((1.0, 2.0, 5.0), (1.0, 3.0), (1.0,))  # ticks of one decade, the finest first


def share(values: Any, limits: tuple[float, float], *, log: bool) -> Any:
    """Where values stand between the limits of an axis, 0 to 1; on a logarithmic axis NaN at and below zero.

    Examples
    --------
    >>> share([1.0, 10.0, 0.0], (0.1, 10.0), log=True).tolist()
    [0.5, 1.0, nan]
    """
    found = np.asarray(values, dtype=float)
    low, high = limits
    if not log:
        return (found - low) / (high - low)
    with np.errstate(invalid="ignore"):
        known = np.where(found > 0.0, found, np.nan)
    return np.log(known / low) / np.log(high / low)


def data_limits(panel: Panel, which: Literal["x", "y"]) -> tuple[float, float]:
    """Range of a panel's data along one axis with a little room; (0, 1) or one decade without data."""
    values: list[FloatArray] = []
    for item in panel.items:
        if isinstance(item, (Line, Marks, Area, Heat)):
            values.append(np.asarray(getattr(item, which), dtype=float).ravel())
        elif isinstance(item, Bars):
            ends = (item.start, item.start + item.length) if which == "x" else (item.position,)
            values.extend(np.asarray(end, dtype=float) for end in ends)
        elif isinstance(item, Rule) and item.axis == which:
            values.append(np.array([item.value]))
    known = np.concatenate(values) if values else np.zeros(0)
    known = known[np.isfinite(known)]
    if (panel.x if which == "x" else panel.y).log:
        known = known[known > 0.0]
        if not known.size:
            return 1.0, 10.0
        low, high = float(np.min(known)), float(np.max(known))
        room = (high / low) ** 0.05 if high > low else 2.0
        return low / room, high * room
    if not known.size:
        return 0.0, 1.0
    low, high = float(np.min(known)), float(np.max(known))
    room = 0.05 * (high - low) or 0.05 * abs(high) or 1.0
    return low - room, high + room


def even_ticks(low: float, high: float, *, count: int) -> tuple[FloatArray, list[str]]:
    """Positions of about `count` even steps inside the limits, and their texts.

    Examples
    --------
    >>> even_ticks(0.0, 1.0, count=4)[1]
    ['0.00', '0.25', '0.50', '0.75', '1.00']
    """
    from matplotlib.ticker import MaxNLocator

    places = np.asarray(MaxNLocator(nbins=count, steps=[1, 2, 2.5, 5, 10]).tick_values(low, high), dtype=float)
    inside = places[(places >= low - 1e-9 * (high - low)) & (places <= high + 1e-9 * (high - low))]
    step = float(places[1] - places[0]) if len(places) > 1 else 1.0
    return inside, [tick_text(float(place), step) for place in inside]


def log_ticks(low: float, high: float, *, count: int) -> tuple[FloatArray, list[str]]:
    """Positions on a logarithmic axis: 1, 2, 5 of every decade, fewer where many decades are shown.

    Examples
    --------
    >>> log_ticks(0.1, 10.0, count=8)[1]
    ['0.1', '0.2', '0.5', '1', '2', '5', '10']
    """
    first, last = int(np.floor(np.log10(low))), int(np.ceil(np.log10(high)))
    inside: list[float] = []
    for digits in _STEPS:
        places = [d * 10.0**k for k in range(first, last + 1) for d in digits]
        inside = [p for p in places if low * (1.0 - 1e-9) <= p <= high * (1.0 + 1e-9)]
        if len(inside) <= count:
            break
    inside = inside[:: -(-len(inside) // (count + 1)) or 1]
    return np.array(inside), [number(p, digits=1) for p in inside]
