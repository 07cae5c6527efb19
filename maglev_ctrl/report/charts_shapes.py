"""Mode shapes on the vehicle's own geometry."""

from __future__ import annotations

import textwrap

import numpy as np

from maglev_ctrl.analysis.modes import Modes
from maglev_ctrl.arrays import ComplexArray, FloatArray
from maglev_ctrl.report.chart import Area, Axis, Chart, Item, Line, Panel
from maglev_ctrl.report.charts_modes import worth_drawing
from maglev_ctrl.report.geometry import (
    AXES,
    Box,
    View,
    at_largest,
    best_view,
    bounds,
    boxes,
    corners,
    displacement,
    metre,
    motion,
)
from maglev_ctrl.report.style import FADED, INK, colour, number
from maglev_ctrl.study.records import OptionStudy
from maglev_ctrl.vehicle import Vehicle

MOST_SHAPES = 6
_AXIS_NAMES = {"side": ("x (m)", "z"), "front": ("y (m)", "z"), "top": ("x (m)", "y")}


def mode_shapes(option: OptionStudy) -> Chart | None:
    """The least stable modes that move the vehicle, drawn on its boxes; None when there are no modes."""
    if option.modes is None:
        return None
    chosen = _chosen(option.modes)
    if not chosen:
        return None
    outline = boxes(option.vehicle)
    panels = tuple(_panel(option.vehicle, option.modes, outline, k) for k in chosen)
    return Chart(
        key=f"{option.name}-shapes",
        caption=(
            f"Mode shapes of {option.label} at the design point, least stable first: solid, the instant of largest "
            "displacement; dotted, a quarter of a period later; grey, at rest. Lengths to scale, displacements and "
            "heights not."
        ),
        alt=f"Mode shapes of {option.label}: " + "; ".join(_title(option.modes, k) for k in chosen),
        panels=panels,
        columns=2,
        panel_height=0.95,
        legend="none",
    )


def _chosen(modes: Modes) -> list[int]:
    size = np.abs(modes.s)
    moves = np.max(np.abs(modes.shapes), axis=0) > 0.0
    moves &= worth_drawing(size, modes.s.real / np.maximum(size, 1e-300))
    order = np.argsort(-modes.s.real, kind="stable")
    oscillating = [int(k) for k in order if moves[k] and (modes.s[k].imag > 0.0 or modes.s[k].real > 0.0)]
    return oscillating[:MOST_SHAPES]


def _title(modes: Modes, k: int) -> str:
    frequency = number(float(modes.s[k].imag) / (2.0 * np.pi), "Hz")
    neutral = abs(modes.s[k].real) <= modes.error_bound[k]
    growth = "neutral" if neutral else f"growth {number(float(modes.s[k].real), '1/s')}"
    return f"{modes.labels[k]}: {frequency}, {growth}"


def _panel(vehicle: Vehicle, modes: Modes, outline: tuple[Box, ...], k: int) -> Panel:
    shape = modes.shapes[:, k]
    view = best_view(vehicle, outline, shape)
    shape = at_largest(vehicle, outline, shape, view)
    first, second = AXES[view]
    low, high = bounds(outline)
    span = high - low
    scale = np.zeros(3)
    scale[first], scale[second] = 0.05 * span[first], 0.16 * max(span[second], metre(low, high))
    items: list[Item] = [_rail(low, high, view)] if view != "top" else []
    for i, box in enumerate(outline):
        at_rest = corners(box, view)
        moved = displacement(box, at_rest, motion(vehicle, shape, box.body))
        items.append(Area(at_rest[:, first], at_rest[:, second], edge=FADED, width=0.6))
        now, later = at_rest + scale * moved.real, at_rest - scale * moved.imag
        if np.max(np.abs(moved.imag)) > 0.05:
            items.append(Area(later[:, first], later[:, second], edge=INK, dash="dot", width=0.7))
        items.append(Area(now[:, first], now[:, second], fill=colour(i + 1), opacity=0.35, edge=colour(i + 1)))
        items.extend(_magnets(vehicle, box, shape, view, scale, 0.35 * metre(low, high)))
    margin = 0.06 * span
    names = _AXIS_NAMES[view]
    title = "\n".join([textwrap.shorten(modes.labels[k], 44, placeholder=" ..."), _title(modes, k).rsplit(": ", 1)[1]])
    return Panel(
        items=tuple(items),
        x=Axis(names[0], limits=(float(low[first] - margin[first]), float(high[first] + margin[first]))),
        y=Axis(names[1], limits=_vertical(low, high, second, view), hidden=True),
        title=title,
    )


def _vertical(low: FloatArray, high: FloatArray, axis: int, view: View) -> tuple[float, float]:
    room = 0.2 * max(float(high[axis] - low[axis]), metre(low, high))
    return float(low[axis]) - room - (0.9 * metre(low, high) if view != "top" else 0.0), float(high[axis]) + room


def _rail(low: FloatArray, high: FloatArray, view: View) -> Line:
    first, second = AXES[view]
    margin = 0.06 * (high[first] - low[first])
    level = low[second] - 0.9 * metre(low, high)
    return Line(
        np.array([low[first] - margin, high[first] + margin]), np.array([level, level]), "", colour=INK, width=1.8
    )  # fmt: skip


def _magnets(
    vehicle: Vehicle, box: Box, shape: ComplexArray, view: View, scale: FloatArray, length: float
) -> list[Item]:
    """Short strokes below the box, moved with it; one broken line for all of them."""
    if not box.magnets.size or view == "top":
        return []
    first, second = AXES[view]
    points = np.unique(box.magnets[:, first])
    base = np.tile(box.centre, (points.size, 1))
    base[:, first], base[:, second] = points, box.centre[second] - box.half[second]
    moved = base + scale * displacement(box, base, motion(vehicle, shape, box.body)).real
    x = np.column_stack([moved[:, first], moved[:, first], np.full(points.size, np.nan)]).ravel()
    y = np.column_stack([moved[:, second], moved[:, second] - length, np.full(points.size, np.nan)]).ravel()
    return [Line(x, y, "", colour=INK, width=1.6)]
