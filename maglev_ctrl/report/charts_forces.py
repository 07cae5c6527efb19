"""Figures of a magnet's forces: over height, gap and speed, stiffness, damping, torque, maps, and the cross-section."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.report.chart import Area, Axis, Chart, Heat, Item, Line, Marks, Note, Panel, Rule, Span
from maglev_ctrl.report.style import FADED, FAIL_COLOUR, PALETTE
from maglev_ctrl.study.force_survey import Damping, ForceSurvey, Geometry

_MM: Final = 1e3
_HEIGHT, _GAP, _SPEED = "height (mm)", "gap (mm)", "speed (m/s)"
_FORCES: Final = (("lift", "lift"), ("guidance", "guidance"), ("drag", "drag"))
_CURVES: Final = 5
_STIFFNESSES: Final = (
    ("lift by height", "by_height", "lift"), ("lift by gap", "by_gap", "lift"),
    ("guidance by height", "by_height", "guidance"), ("guidance by gap", "by_gap", "guidance"),
)  # fmt: skip


def charts(found: ForceSurvey) -> tuple[Chart, ...]:
    """Every figure the survey has something to draw for."""
    made = [None if found.geometry is None else section_chart(found, found.geometry), over_height(found)]
    made += [over_gap(found), over_speed(found), stiffness_chart(found), damping_chart(found), torque_chart(found)]
    made += [map_chart(found, name) for name in ("lift", "guidance")]
    return tuple(chart for chart in made if chart is not None)


def over_height(found: ForceSurvey) -> Chart:
    """Lift, guidance and drag over height, a curve for each of a few gaps."""
    picked = _picked(found.gaps, found.gap_index) if found.gap is not None else [0]
    panels = []
    for name, word in _kinds(found):
        values = getattr(found.table, name)[:, :, found.speed_index]
        lines = [
            Line(found.heights * _MM, values[:, j], _gap_label(found, j), colour=PALETTE[place % len(PALETTE)])
            for place, j in enumerate(picked)
        ]
        panels.append(Panel((*lines, Rule("x", found.height * _MM, "design")), Axis(_HEIGHT), Axis(f"{word} (N)")))
    return Chart(
        key="over-height",
        caption=f"Forces of one magnet over the levitation height at {found.speed:.4g} m/s.",
        alt="Lift, guidance and drag of one magnet over height", panels=tuple(panels), share_x=True, panel_height=1.6,
    )  # fmt: skip


def over_gap(found: ForceSurvey) -> Chart | None:
    """The same over the guidance gap, a curve for each of a few heights."""
    if found.gap is None:
        return None
    panels = []
    for name, word in _kinds(found):
        values = getattr(found.table, name)[:, :, found.speed_index]
        lines = [
            Line(found.gaps * _MM, values[i], f"height {found.heights[i] * _MM:.3g} mm", colour=PALETTE[place])
            for place, i in enumerate(_picked(found.heights, found.height_index))
        ]
        panels.append(Panel((*lines, Rule("x", found.gap * _MM, "design")), Axis(_GAP), Axis(f"{word} (N)")))
    return Chart(
        key="over-gap",
        caption=f"Forces of one magnet over the guidance gap at {found.speed:.4g} m/s.",
        alt="Lift, guidance and drag of one magnet over the gap", panels=tuple(panels), share_x=True, panel_height=1.6,
    )  # fmt: skip


def over_speed(found: ForceSurvey) -> Chart | None:
    """Forces and their slopes over speed, the drag peak marked."""
    line = found.over_speed
    if not found.domain.speed[1] > found.domain.speed[0]:
        return None
    forces: list[Item] = [
        Line(line.values, getattr(line.forces, name), word, colour=PALETTE[place])
        for place, (name, word) in enumerate(_kinds(found))
    ]
    slopes: list[Item] = [Rule("y", 0.0, dash="solid", width=0.7)]
    slopes += [
        Line(line.values, getattr(line.slopes.by_speed, name), "", colour=PALETTE[place])
        for place, (name, _) in enumerate(_kinds(found))
    ]
    words = " The drag has no peak inside the range."
    if found.drag_peak is not None:
        top = float(np.interp(found.drag_peak, line.values, line.forces.drag))
        forces.append(Marks(np.array([found.drag_peak]), np.array([top]), "diamond", "drag peak", colour=FAIL_COLOUR))
        forces.append(Rule("x", found.drag_peak, colour=FAIL_COLOUR, dash="dot"))
        slopes.append(Rule("x", found.drag_peak, colour=FAIL_COLOUR, dash="dot"))
        words = f" The drag is largest at {found.drag_peak:.4g} m/s; beyond, it falls and drives the surge."
    for items in (forces, slopes):
        items.append(Rule("x", found.speed, "design"))
    return Chart(
        key="over-speed",
        caption=f"Forces of one magnet over speed at {_place(found)}, and their slopes.{words}",
        alt="Lift, guidance and drag of one magnet over speed, with slopes",
        panels=(
            Panel(tuple(forces), Axis(_SPEED), Axis("force (N)")),
            Panel(tuple(slopes), Axis(_SPEED), Axis("dF/dv (N s/m)")),
        ),
        share_x=True, panel_height=1.7,
    )  # fmt: skip


def stiffness_chart(found: ForceSurvey) -> Chart:
    """Stiffness over height and over the gap."""

    def lines(x: FloatArray, cut: tuple[object, object]) -> list[Item]:
        kinds = _STIFFNESSES if found.gap is not None else _STIFFNESSES[:1]
        made: list[Item] = [Rule("y", 0.0, dash="solid", width=0.7)]
        for place, (word, way, name) in enumerate(kinds):
            values = getattr(getattr(found.slopes, way), name)[cut]
            dash = "dash" if word == "guidance by height" else "solid"  # equal to lift by gap where there is an energy
            made.append(Line(x, values, word, colour=PALETTE[place], dash=dash))  # type: ignore[arg-type]
        return made

    by_height = lines(found.heights * _MM, (slice(None), found.gap_index))
    panels = [
        Panel((*by_height, Rule("x", found.height * _MM, "design")), Axis(_HEIGHT), Axis("dF/dq (N/m)"))
    ]  # fmt: skip
    if found.gap is not None:
        by_gap = lines(found.gaps * _MM, (found.height_index, slice(None)))
        panels.append(Panel((*by_gap, Rule("x", found.gap * _MM, "design")), Axis(_GAP), Axis("dF/dq (N/m)")))
    return Chart(
        key="stiffness",
        caption=(
            f"Partials of the forces of one magnet at {found.speed:.4g} m/s; below zero on the diagonal (lift by "
            "height, guidance by gap) the force brings the magnet back. Cross terms that coincide make no flutter."
        ),
        alt="Stiffness of one magnet over height and gap", panels=tuple(panels), panel_height=1.8,
    )  # fmt: skip


def damping_chart(found: ForceSurvey) -> Chart | None:
    """Damping by slow motion over speed and height; what lies above zero feeds the motion."""
    panels = []
    for damping, factor, label, design in (
        (found.damping_over_speed, 1.0, _SPEED, found.speed),
        (found.damping_over_height, _MM, _HEIGHT, found.height * _MM),
    ):
        if damping is not None and len(damping.along) > 1:
            panels.append(_damping_panel(damping, factor, label, design, found))
    if not panels:
        return None
    changes = ", ".join(f"{speed:.4g}" for speed in found.heave_changes)
    words = f"The vertical damping changes its sign at {changes} m/s." if changes else (
        "The vertical damping keeps its sign over the whole range of speeds."
    )  # fmt: skip
    return Chart(
        key="damping",
        caption=(
            "Force on the magnet per velocity of its own slow motion, at 1 Hz where currents were computed. Above zero "
            f"(shaded) heave, sway or surge is fed: negative damping. {words}"
        ),
        alt="Damping of one magnet over speed and height", panels=tuple(panels), panel_height=1.8,
    )  # fmt: skip


def _damping_panel(damping: Damping, factor: float, label: str, design: float, found: ForceSurvey) -> Panel:
    kinds = [("heave, c_ll", damping.heave), ("surge, c_xx", damping.surge)]
    if found.gap is not None:
        kinds += [("sway, c_gg", damping.sway), ("sway by heave, c_gl", damping.sway_by_heave)]
    values = np.concatenate([one for _, one in kinds])
    low, high = float(min(values.min(), 0.0)), float(max(values.max(), 0.0))
    room = 0.08 * (high - low) or 1.0
    items: list[Item] = [Span("y", 0.0, high + room, FAIL_COLOUR, opacity=0.10, label="feeds the motion")]
    items.append(Rule("y", 0.0, dash="solid", width=0.7))
    items += [
        Line(damping.along * factor, one, word, colour=PALETTE[place]) for place, (word, one) in enumerate(kinds)
    ]  # fmt: skip
    items.append(Rule("x", design, "design"))
    return Panel(tuple(items), Axis(label), Axis("damping (N s/m)", limits=(low - room, high + room)))


def torque_chart(found: ForceSurvey) -> Chart | None:
    """Roll torque about the middle of the coil."""
    if found.torque_over_speed is None or found.torque_over_height is None:
        return None
    parts = [(found.heights * _MM, found.torque_over_height, _HEIGHT, found.height * _MM)]
    if len(found.speeds) > 1:
        parts.append((found.speeds, found.torque_over_speed, _SPEED, found.speed))
    panels = tuple(
        Panel(
            (Rule("y", 0.0, dash="solid", width=0.7), Line(x, y * 1e3), Rule("x", at, "design")),
            Axis(label), Axis("torque (mN m)"),
        )
        for x, y, label, at in parts
    )  # fmt: skip
    return Chart(
        key="torque",
        caption=f"Roll torque on one magnet about the middle of its coil, y towards z, at {_place(found)} otherwise.",
        alt="Roll torque on one magnet over height and speed", panels=panels, panel_height=1.5,
    )  # fmt: skip


def map_chart(found: ForceSurvey, name: str) -> Chart | None:
    """Lift or guidance over height and gap, with lines of equal force."""
    if found.gap is None or len(found.heights) < 2 or len(found.gaps) < 2:
        return None
    values = getattr(found.table, name)[:, :, found.speed_index]
    x, y = found.heights * _MM, found.gaps * _MM
    # Near contact the forces run away; colours are spent on where the vehicle is.
    low, high = float(values.min()), float(np.quantile(values, 0.97))
    if not high > low:
        return None
    levels = _levels(low, high)
    shades = Heat(x, y, np.clip(values, low, high).T, f"{name} (N)", low, high)
    items: list[Item] = [shades]
    for place, level in enumerate(levels):
        for piece in _contours(x, y, values.T, level):
            items.append(Line(piece[:, 0], piece[:, 1], colour="#ffffff", width=0.8))
        longest = max(_contours(x, y, values.T, level), key=len, default=None)
        if longest is not None and len(longest) > 6:
            at = longest[int(len(longest) * (0.2 + 0.15 * (place % 5)))]  # side by side they would cover each other
            items.append(Note(float(at[0]), float(at[1]), f"{level:g}", horizontal="center", boxed=True))
    items.append(Marks(np.array([found.height * _MM]), np.array([found.gap * _MM]), "diamond", colour=FAIL_COLOUR))
    edge = (float(x[0]), float(x[-1])), (float(y[0]), float(y[-1]))
    clipped = " Above the scale's end the colour stays the same." if values.max() > high else ""
    return Chart(
        key=f"map-{name}",
        caption=(
            f"{name.capitalize()} of one magnet at {found.speed:.4g} m/s; the diamond is the design point.{clipped}"
        ),
        alt=f"Map of the {name} over height and gap",
        panels=(Panel(tuple(items), Axis(_HEIGHT, limits=edge[0]), Axis(_GAP, limits=edge[1])),),
        panel_height=2.9, legend="none",
    )  # fmt: skip


def section_chart(found: ForceSurvey, geometry: Geometry) -> Chart:
    """The guideway with its mesh, the coils at the design point, height, gap and the least clearance."""
    mesh, low_high = geometry.mesh, geometry.section.bounds
    sides = np.concatenate(geometry.coils)
    low = np.minimum(low_high[0], sides.min(axis=0)) * _MM
    high = np.maximum(low_high[1], sides.max(axis=0)) * _MM
    room = 0.06 * float(np.max(high - low))
    outlines = [one.outline * _MM for one in geometry.section.conductors]
    items: list[Item] = [
        Area(one[:, 0], one[:, 1], "metal" if place == 0 else "", fill=PALETTE[6], opacity=0.45)
        for place, one in enumerate(outlines)
    ]
    items.append(_edges(mesh.points * _MM, mesh.triangles[:, mesh.conductor >= 0]))
    for place, ends in enumerate(one * _MM for one in geometry.coils):
        name = "coil" if place == 0 else ""
        items.append(Line(ends[:, 0], ends[:, 1], name, colour=FAIL_COLOUR, width=2.2))
        items.append(Marks(ends[:, 0], ends[:, 1], "circle", colour=FAIL_COLOUR, size=4.0))
    items += _dimensions(found, geometry)
    triangles = int(np.sum(mesh.conductor >= 0))
    words = f"{found.height * _MM:.4g} mm" + ("" if found.gap is None else f", gap {found.gap * _MM:.4g} mm")
    x = (float(low[0]) - room, float(high[0]) + room)
    y = (float(low[1]) - room, float(high[1]) + room)
    width_in = 4.3
    return Chart(
        key="section",
        caption=(
            f"Cross-section of the guideway with the magnet's coils at the design point: height {words}; the coils' "
            f"least clearance is {geometry.clearance * _MM:.4g} mm. Mesh: {triangles} triangles in metal, "
            f"{mesh.triangles.shape[1] - triangles} in air (not drawn)."
        ),
        alt="Cross-section of the guideway with coil and mesh",
        panels=(Panel(tuple(items), Axis("y (mm)", limits=x), Axis("z (mm)", limits=y), equal=True),),
        panel_height=float(np.clip(width_in * (y[1] - y[0]) / (x[1] - x[0]), 0.7, 3.6)),
    )  # fmt: skip


def _dimensions(found: ForceSurvey, geometry: Geometry) -> list[Item]:
    """Height and gap as they are measured: to the magnet's bottom and side face, from z = 0 and y = 0."""
    sides = np.concatenate(geometry.coils) * _MM
    middle, h = float(np.mean(sides[:, 0])), found.height * _MM
    across = np.array([middle, middle])
    items: list[Item] = [
        Line(across, np.array([0.0, h]), "height, gap", dash="dash", width=0.9),
        Note(middle, 0.5 * h, f" h = {h:.4g}"),
    ]
    if found.gap is not None:
        g, level = found.gap * _MM, float(np.mean(sides[:, 1]))
        items.append(Line(np.array([0.0, g]), np.array([level, level]), dash="dash", width=0.9))
        items.append(Note(0.5 * g, level, f"g = {g:.4g}", horizontal="center", vertical="bottom"))
    return items


def _edges(points: FloatArray, triangles: NDArray[np.intp]) -> Line:
    """Every edge once, broken by NaN."""
    pairs = np.sort(np.concatenate([triangles[[0, 1]], triangles[[1, 2]], triangles[[2, 0]]], axis=1), axis=0)
    pairs = np.unique(pairs, axis=1)
    gap = np.full((2, pairs.shape[1]), np.nan)
    broken = np.stack([points[:, pairs[0]], points[:, pairs[1]], gap], axis=-1).reshape(2, -1)
    return Line(broken[0], broken[1], "mesh", colour=FADED, width=0.3)


def _contours(x: FloatArray, y: FloatArray, z: FloatArray, level: float) -> list[FloatArray]:
    from contourpy import contour_generator

    return [np.asarray(one) for one in contour_generator(x, y, z).lines(level)]


def _levels(low: float, high: float) -> list[float]:
    from matplotlib.ticker import MaxNLocator

    return [float(v) for v in MaxNLocator(nbins=8).tick_values(low, high) if low < v < high]


def _picked(values: FloatArray, design: int) -> list[int]:
    """A few places over the range, the design point among them."""
    spread = np.linspace(0.06, 0.94, _CURVES) * (len(values) - 1)
    return sorted({*np.rint(spread).astype(int).tolist(), design})


def _kinds(found: ForceSurvey) -> tuple[tuple[str, str], ...]:
    """Forces the model has: a guideway without a wall guides nothing, a perfect conductor has no drag."""
    return tuple(kind for kind in _FORCES if np.any(getattr(found.table, kind[0])))


def _gap_label(found: ForceSurvey, j: int) -> str:
    return "" if found.gap is None else f"gap {found.gaps[j] * _MM:.3g} mm"


def _place(found: ForceSurvey) -> str:
    gap = "" if found.gap is None else f" and gap {found.gap * _MM:.4g} mm"
    return f"height {found.height * _MM:.4g} mm{gap}"
