"""All options of a scenario at one operating point."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from maglev_ctrl.analysis.modes import Modes
from maglev_ctrl.arrays import read_only_any
from maglev_ctrl.errors import Verdict
from maglev_ctrl.scenario import Scenario
from maglev_ctrl.study.live.designed import FAULTS
from maglev_ctrl.study.live.records import LiveComparison
from maglev_ctrl.study.live.study import LiveStudy
from maglev_ctrl.study.sweeps import least_damping

CANCELLED = "not computed: cancelled"


def compare_options(
    scenario: Scenario, values: Mapping[str, float], cancelled: Callable[[], bool] = lambda: False
) -> LiveComparison:
    """Every option at values (SI) by name; a value that an option has no slider for is its own."""
    rows: list[tuple[float, float, float, float, Verdict, str]] = []
    for option in scenario.options:
        rows.append(_row(scenario, option.name, values, cancelled))
    growth, damping, periodic, disk, verdicts, reasons = zip(*rows, strict=True)
    return LiveComparison(
        options=tuple(one.name for one in scenario.options),
        labels=tuple(one.label or one.name for one in scenario.options),
        growth=read_only_any(growth), least_damping=read_only_any(damping), periodic_growth=read_only_any(periodic),
        disk_margin=read_only_any(disk), verdicts=verdicts, reasons=reasons,
    )  # fmt: skip


def _row(
    scenario: Scenario, name: str, values: Mapping[str, float], cancelled: Callable[[], bool]
) -> tuple[float, float, float, float, Verdict, str]:
    nothing = (np.nan, np.nan, np.nan, np.nan, Verdict.NOT_EVALUATED)
    if cancelled():
        return (*nothing, CANCELLED)
    try:
        study = LiveStudy(scenario, name)
        known = {one.name for one in study.quantities()}
        view = study.settle(study.point({k: v for k, v in values.items() if k in known}), cancelled)
    except FAULTS as fault:
        return (*nothing, f"{fault}")
    if view.failure or view.modes is None:
        return (*nothing, view.failure)
    if not view.settled:
        return (*nothing, CANCELLED)
    found = view.modes
    disk = np.nan
    if view.margins is not None:
        disk = min([one.disk.alpha for one in view.margins.channels] + [view.margins.multi_loop.alpha])
    why = view.margins_reason or (view.verdict_words if view.verdict is Verdict.NOT_EVALUATED else "")
    return (
        found.spectral_abscissa, _damping(found), view.floquet.growth_rate if view.floquet else np.nan, disk,
        view.verdict, why,
    )  # fmt: skip


def _damping(found: Modes) -> float:
    """Least damping ratio; a mode that grows without oscillating counts with -1, as in the requirements."""
    growing = found.s.real > found.error_bound
    return -1.0 if np.any(growing & (found.s.imag <= found.error_bound)) else least_damping(found)
