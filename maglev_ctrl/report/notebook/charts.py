"""Figures of single results, where the report draws the same only for a whole option."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from maglev_ctrl.analysis.floquet import Floquet
from maglev_ctrl.analysis.plane_records import MapAxis, StabilityPlane
from maglev_ctrl.analysis.resonance_map import ResonanceMap
from maglev_ctrl.analysis.simulation.records import Trajectory
from maglev_ctrl.analysis.tracking import ModeTracks
from maglev_ctrl.arrays import ComplexArray, FloatArray
from maglev_ctrl.report.chart import Area, Axis, Chart, Item, Line, Marks, Panel, Rule, Span
from maglev_ctrl.report.charts_modes import slowest_tracks, worth_drawing
from maglev_ctrl.report.charts_periodic import MAP_SIZE, growth_items, name_items, tip_items, unresolved_items
from maglev_ctrl.report.labels import Anchor, Room, placed
from maglev_ctrl.report.map.chart import map_chart
from maglev_ctrl.report.style import FADED, FAIL_COLOUR, INK, colour, curve_colour, dash, number
from maglev_ctrl.study.map.records import MapQuantity, OptionMap

_MOST_SIGNALS = 4
_MOST_NAMES = 12
_CELLS = (20, 40)
_MOST_SAMPLES = 1500
_PLANE_SIZE = (5.2, 2.6)  # in
_QUANTITIES = {  # how the names of parameters are told: words, display unit, display value over SI
    "speed": ("speed", "km/h", 3.6), "depth": ("modulation depth", "%", 100.0), "height": ("height", "mm", 1e3),
    "gap": ("gap", "mm", 1e3), "payload": ("payload", "t", 1e-3),
}  # fmt: skip


def eigenvalue_chart(s: ComplexArray, labels: tuple[str, ...], *, key: str, what: str) -> Chart:
    """Eigenvalues (m,) 1/s of the upper half plane, those worth drawing named where there are labels."""
    size = np.abs(s)
    shown = worth_drawing(size, s.real / np.maximum(size, 1e-300)) & (s.imag >= 0.0)
    shown = shown if shown.any() else s.imag >= 0.0
    at, names = s[shown], [label for label, kept in zip(labels, shown, strict=False) if kept]
    hertz = at.imag / (2.0 * np.pi)
    left = min(1.12 * float(np.min(at.real)), -1e-9)
    right = max(1.3 * float(np.max(at.real)), 0.12 * abs(left), 1e-6)
    top = 1.2 * max(float(np.max(hertz)), 0.05 * abs(left), 1e-6)
    limits = (left - 0.02 * (right - left), right), (-0.04 * top, top)
    growing = at.real > 0.0
    hover = tuple(names)
    items: list[Item] = [Span("x", 0.0, right, FAIL_COLOUR, 0.10, label="unstable"), Rule("x", 0.0, "", INK, "solid")]
    if not growing.all():
        quiet = tuple(name for name, bad in zip(hover, growing, strict=False) if not bad)
        items.append(Marks(at.real[~growing], hertz[~growing], "circle", "decays", colour(1), 5.0, quiet))
    if growing.any():
        loud = tuple(name for name, bad in zip(hover, growing, strict=False) if bad)
        items.append(Marks(at.real[growing], hertz[growing], "diamond", "grows", FAIL_COLOUR, 6.0, loud))
    anchors = [Anchor(float(x), float(y), name) for x, y, name in zip(at.real, hertz, names, strict=False)]
    items += placed(anchors[:_MOST_NAMES], Room(*limits, _PLANE_SIZE, _busy(at.real, hertz, limits)))[0]
    gone = int(np.sum(s.imag >= 0.0)) - len(at)
    more = f" {gone} faster, well damped ones lie outside." if gone else ""
    return Chart(
        key=f"{key}-eigenvalues",
        caption=f"Eigenvalues of {what}, upper half plane; to the right of zero a motion grows.{more}",
        alt=f"Eigenvalues of {what}: the largest growth rate is {number(float(np.max(s.real)), '1/s')}.",
        panels=(Panel(tuple(items), Axis("growth rate (1/s)", limits[0]), Axis("frequency (Hz)", limits[1])),),
        panel_height=_PLANE_SIZE[1], legend="bottom",
    )  # fmt: skip


def _busy(x: FloatArray, y: FloatArray, limits: tuple[tuple[float, float], tuple[float, float]]) -> NDArray[np.bool_]:
    """Cells with an eigenvalue in them, which names leave free."""
    cells = np.zeros(_CELLS, dtype=bool)
    rows = np.clip((y - limits[1][0]) / (limits[1][1] - limits[1][0]) * _CELLS[0], 0, _CELLS[0] - 1).astype(int)
    columns = np.clip((x - limits[0][0]) / (limits[0][1] - limits[0][0]) * _CELLS[1], 0, _CELLS[1] - 1).astype(int)
    cells[rows, columns] = True
    return cells


def track_chart(tracks: ModeTracks) -> Chart:
    """Frequency and growth rate of every followed mode over the parameter, SI."""
    frequency: list[Item] = []
    growth: list[Item] = [Rule("y", 0.0, "", INK, "solid", 0.7)]
    for order, k in enumerate(slowest_tracks(tracks.s)):
        name, tint, style = tracks.labels[k], colour(order + 1), dash(order + 1)
        frequency.append(Line(tracks.parameter, tracks.s[:, k].imag / (2.0 * np.pi), name, tint, style))
        growth.append(Line(tracks.parameter, tracks.s[:, k].real, name, tint, style))
    axis = Axis("parameter (SI)")
    return Chart(
        key="tracks", caption="Eigenvalues followed along the parameter, named by participation.",
        alt=f"Frequency and growth rate of {', '.join(tracks.labels)} along the parameter.",
        panels=(Panel(tuple(frequency), axis, Axis("frequency (Hz)")),
                Panel(tuple(growth), axis, Axis("growth rate (1/s)"))),
        panel_height=1.6, share_x=True,
    )  # fmt: skip


def multiplier_chart(found: Floquet) -> Chart:
    """Floquet multipliers beside the unit circle."""
    angle = np.linspace(0.0, 2.0 * np.pi, 181)
    at = found.multipliers
    out = np.abs(at) > 1.0
    reach = 1.15 * max(1.0, float(np.max(np.abs(at))))
    items: list[Item] = [Area(np.cos(angle), np.sin(angle), edge=FADED, dash="dash")]
    if not out.all():
        items.append(Marks(at.real[~out], at.imag[~out], "circle", "decays", colour(1), 5.0))
    if out.any():
        items.append(Marks(at.real[out], at.imag[out], "diamond", "grows", FAIL_COLOUR, 6.0))
    return Chart(
        key="multipliers", caption="Floquet multipliers; outside the unit circle (dashed) a motion grows.",
        alt=f"Floquet multipliers: the largest modulus is {number(found.spectral_radius, digits=5)}.",
        panels=(Panel(tuple(items), Axis("real part", (-reach, reach)), Axis("imaginary part", (-reach, reach)),
                      equal=True),),
        panel_height=2.6, legend="bottom",
    )  # fmt: skip


def resonance_chart(found: ResonanceMap) -> Chart:
    """Growth rate over parameter and depth, tongues named."""
    words, unit, scale = _QUANTITIES.get(found.parameter_name, (found.parameter_name, "SI", 1.0))
    x, depth = found.parameter * scale, 100.0 * found.depths
    items = growth_items(found, x, depth) + unresolved_items(found, x, depth)
    if found.parameter_name == "speed":
        items += tip_items(found)
    items += name_items(found, x, depth)
    share = float(np.mean(found.unstable))
    return Chart(
        key="resonance",
        caption="Resonance map: colour is the growth rate of unstable tongues, blank is stable, ? is UNRESOLVED. "
        f"Method: {found.method}.",
        alt=f"Resonance map over {words} and depth: {number(100.0 * share, '%')} of the points are unstable.",
        panels=(Panel(tuple(items), Axis(f"{words} ({unit})", limits=(float(x[0]), float(x[-1]))),
                      Axis("modulation depth (%)", limits=(0.0, float(depth[-1])))),),
        row_heights=(MAP_SIZE[1],), legend="bottom",
    )  # fmt: skip


def plane_chart(plane: StabilityPlane) -> Chart:
    """The stability map of a plane that belongs to no option."""
    alone = OptionMap(
        name="plane", label="the system", kind="", summary=(), failure="", plane=plane, tongues=(), atlas=None,
        atlas_reason="", margins=None, margins_reason="", law=None, notes=(), seconds=0.0,
    )  # fmt: skip
    return map_chart(alone, plane, axis_quantity(plane.x), axis_quantity(plane.y))


def axis_quantity(axis: MapAxis) -> MapQuantity:
    """An axis as it is shown; names without a display unit of their own are shown in SI."""
    words, unit, scale = _QUANTITIES.get(axis.name, (axis.name, "SI", 1.0))
    return MapQuantity(axis.name, words, unit, scale, axis.values, float("nan"))


def motion_chart(trajectory: Trajectory) -> Chart | None:
    """The coordinates that come first, of the first run; None without samples."""
    names = [name for name in trajectory.signals if name.count(".") == 1 and "command" not in name][:_MOST_SIGNALS]
    step = max(1, len(trajectory.time) // _MOST_SAMPLES)
    if not names or not trajectory.time.size:
        return None
    panels = tuple(
        Panel((Line(trajectory.time[::step], _first(trajectory, name)[::step], "", curve_colour(order)),),
              Axis("time (s)"), Axis(name))
        for order, name in enumerate(names)
    )  # fmt: skip
    return Chart(
        key="motion", caption="The first signals of the first run, SI, increments from the equilibrium.",
        alt=f"Motion over time of {', '.join(names)}.", panels=panels, panel_height=1.0, legend="none", share_x=True,
    )  # fmt: skip


def _first(trajectory: Trajectory, name: str) -> FloatArray:
    return np.asarray(np.atleast_2d(trajectory.signals[name])[0], dtype=np.float64)
