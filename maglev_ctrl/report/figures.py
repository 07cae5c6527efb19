"""One function per figure: a record in, a matplotlib figure out, None where the record has nothing to draw.

The charts behind them (`charts_*`) are the same ones the live page draws.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from maglev_ctrl.report import charts_comparison, charts_margins, charts_modes, charts_periodic, charts_shapes
from maglev_ctrl.report.chart import Chart
from maglev_ctrl.report.draw import draw
from maglev_ctrl.study.records import Comparison, OptionStudy

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def eigenvalues_over_speed(option: OptionStudy, *, design_speed: float) -> Figure | None:
    """Frequency, growth rate and damping ratio of the tracked modes; `design_speed` in m/s."""
    return _drawn(charts_modes.speed_chart(option, design_speed=design_speed))


def other_sweeps(option: OptionStudy) -> Figure | None:
    """Stability against payload, height and gap."""
    return _drawn(charts_modes.other_sweeps(option))


def root_locus(option: OptionStudy) -> Figure | None:
    """Eigenvalues while the option's elements are faded in."""
    return _drawn(charts_modes.root_locus(option))


def mode_shapes(option: OptionStudy) -> Figure | None:
    """The least stable modes on the vehicle's geometry."""
    return _drawn(charts_shapes.mode_shapes(option))


def energy_ledger(option: OptionStudy) -> Figure | None:
    """What feeds and what damps each mode."""
    return _drawn(charts_modes.energy_ledger(option))


def nyquist(option: OptionStudy) -> Figure | None:
    """Return ratios with their disk margins."""
    return _drawn(charts_margins.nyquist(option))


def resonance_map(option: OptionStudy, *, design_speed: float) -> Figure | None:
    """Unstable tongues over speed and depth; `design_speed` in m/s."""
    return _drawn(charts_periodic.resonance_chart(option, design_speed=design_speed))


def options_over_speed(comparison: Comparison) -> Figure | None:
    """All options on common axes."""
    return _drawn(charts_comparison.options_over_speed(comparison))


def margins_to_requirements(comparison: Comparison) -> Figure | None:
    """Distance of every option to every requirement."""
    return _drawn(charts_margins.margin_bars(comparison))


def _drawn(chart: Chart | None) -> Figure | None:
    return None if chart is None else draw(chart)
