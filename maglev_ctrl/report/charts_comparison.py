"""Options on common axes."""

from __future__ import annotations

import numpy as np

from maglev_ctrl.report.chart import Axis, Chart, Item, Line, Panel, Rule, Span
from maglev_ctrl.report.charts_modes import DESIGN_LINE
from maglev_ctrl.report.style import FAIL_COLOUR, INK, colour, dash
from maglev_ctrl.study.records import Comparison


def options_over_speed(comparison: Comparison) -> Chart | None:
    """Largest growth rate, least damping ratio and critical modulation depth of all options against speed."""
    growth: list[Item] = []
    damping: list[Item] = []
    depth: list[Item] = []
    expected: float | None = None
    for order, option in enumerate(comparison.options):
        tint, style = colour(order), dash(order)
        for sweep in (s for s in option.sweeps if s.parameter == "speed"):
            x = sweep.values * 3.6
            growth.append(Line(x, sweep.abscissa, option.label, tint, style))
            damping.append(Line(x, 100.0 * sweep.least_damping, option.label, tint, style))
        if option.floquet is not None:
            critical = np.where(np.isfinite(option.floquet.critical_depth), option.floquet.critical_depth, np.nan)
            depth.append(Line(option.floquet.map.parameter * 3.6, 100.0 * critical, option.label, tint, style))
            expected = option.floquet.expected_depth
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
    return Chart(
        key="comparison-speed",
        caption="All options against speed on common axes: largest growth rate (negative is stable), least damping "
        "ratio of the oscillating modes, and the smallest depth of guideway modulation that makes the option unstable "
        "(no line: stable up to the largest depth of the map).",
        alt=f"Largest growth rate, least damping ratio and critical modulation depth against speed for {names}.",
        panels=tuple(panels),
        panel_height=1.75,
        share_x=True,
    )


def _window(lines: list[Item]) -> tuple[float, float]:
    known = np.concatenate([line.y[np.isfinite(line.y)] for line in lines if isinstance(line, Line)])
    if not known.size:
        return -1.0, 1.0
    low, high = min(float(np.min(known)), 0.0), max(float(np.max(known)), 0.0)
    room = 0.08 * (high - low) or 0.1
    return low - room, high + max(room, 0.1 * abs(low))
