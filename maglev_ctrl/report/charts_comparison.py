"""Options on common axes."""

from __future__ import annotations

import numpy as np

from maglev_ctrl.report.chart import Axis, Chart, Item, Line, Marks, Panel, Rule, Span
from maglev_ctrl.report.charts_modes import DESIGN_LINE
from maglev_ctrl.report.charts_periodic import critical_curve, tips_below_curve
from maglev_ctrl.report.style import FAIL_COLOUR, INK, Dash, colour, dash, number
from maglev_ctrl.study.records import Comparison, FloquetStudy


def options_over_speed(comparison: Comparison) -> Chart | None:
    """Largest growth rate, least damping ratio and critical modulation depth of all options against speed."""
    growth: list[Item] = []
    damping: list[Item] = []
    depth: list[Item] = []
    expected: float | None = None
    largest = 0.0
    for order, option in enumerate(comparison.options):
        tint, style = colour(order), dash(order)
        for sweep in (s for s in option.sweeps if s.parameter == "speed"):
            x = sweep.values * 3.6
            growth.append(Line(x, sweep.abscissa, option.label, tint, style))
            damping.append(Line(x, 100.0 * sweep.least_damping, option.label, tint, style))
        if option.floquet is not None:
            depth += _critical_depth(option.floquet, option.label, tint, style)
            expected, largest = option.floquet.expected_depth, option.floquet.largest_depth
    if not growth:
        return None
    design = Rule("x", comparison.design_speed * 3.6, DESIGN_LINE, INK, "dot", 1.0)
    window = _window(growth)
    growth.append(Span("y", 0.0, window[1], FAIL_COLOUR, 0.10, label="unstable"))
    axis = Axis("speed (km/h)")
    panels = [
        Panel((*growth, design), axis, Axis("largest growth rate (1/s)", limits=window)),
        Panel((*damping, design), axis, Axis("least damping ratio (%)")),
    ]
    if depth:
        if expected is not None:
            depth.append(Rule("y", 100.0 * expected, "expected depth", FAIL_COLOUR, "dash", 1.0))
        panels.append(Panel((*depth, design), axis, Axis("critical depth (%)")))
    names = ", ".join(option.label for option in comparison.options)
    words = "largest growth rate (negative is stable), least damping ratio of the oscillating modes"
    if depth:
        words += (
            ", and the smallest depth of guideway modulation that makes the option unstable (circles: a single speed "
            "of the map; triangles: the tip of a tongue found between the map's speeds; no line or marker: stable up "
            f"to {number(100.0 * largest, '%')}, the largest depth of the map)"
        )
    return Chart(
        key="comparison-speed",
        caption=f"All options against speed on common axes: {words}.",
        alt=f"Against speed for {names}: {words}.",
        panels=tuple(panels),
        panel_height=1.75,
        share_x=True,
    )


def _critical_depth(study: FloquetStudy, label: str, tint: str, style: Dash) -> list[Item]:
    """The critical depth as a line, single columns as circles, tips the line passes over as triangles."""
    x = study.map.parameter * 3.6
    items: list[Item] = list(critical_curve(x, study.critical_depth, label, ("", "circle"), tint, style))
    tips = tips_below_curve(study)
    if tips:
        at = np.array([tip.parameter * 3.6 for tip in tips])
        y = np.array([100.0 * tip.threshold for tip in tips])
        words = tuple(f"{label}: {tip.name} from {number(float(low), '%')}" for tip, low in zip(tips, y, strict=True))
        items.append(Marks(at, y, "triangle", "", tint, 4.0, words))
    return items


def _window(lines: list[Item]) -> tuple[float, float]:
    known = np.concatenate([line.y[np.isfinite(line.y)] for line in lines if isinstance(line, Line)])
    if not known.size:
        return -1.0, 1.0
    low, high = min(float(np.min(known)), 0.0), max(float(np.max(known)), 0.0)
    room = 0.08 * (high - low) or 0.1
    return low - room, high + max(room, 0.1 * abs(low))
