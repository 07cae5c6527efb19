"""What requirements are judged on: every computed quantity of one option, with where it was found."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from maglev_ctrl.analysis.margins import Margins
from maglev_ctrl.analysis.modes import Modes
from maglev_ctrl.study.records import FloquetStudy, Sweep


@dataclass(frozen=True, eq=False, slots=True)
class MarginPoint:
    """Margins at one operating point, or why there are none."""

    where: str
    margins: Margins | None
    reason: str


@dataclass(frozen=True, eq=False, slots=True)
class SweepCheck:
    """The worst point of a sweep, examined again with error bounds and a second method."""

    where: str
    modes: Modes


@dataclass(frozen=True, eq=False, slots=True)
class Evidence:
    """All that was computed for one option.

    `sweep_checks` holds, by parameter, the modes at the sweep point of largest growth and at that of least damping.
    """

    modes: Modes
    sweeps: Mapping[str, Sweep]
    sweep_checks: Mapping[str, tuple[SweepCheck, ...]]
    margin_points: tuple[MarginPoint, ...]
    has_loops: bool
    floquet: FloquetStudy | None
    floquet_reason: str
    design_values: Mapping[str, float]
