"""What requirements are judged on: every computed quantity of one option, with where it was found."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from maglev_ctrl.analysis.margins import Margins
from maglev_ctrl.analysis.modes import Modes
from maglev_ctrl.analysis.robustness.records import WorstCase
from maglev_ctrl.study.records import FloquetStudy, Sweep
from maglev_ctrl.study.ride_records import RideStudy


@dataclass(frozen=True, eq=False, slots=True)
class MarginPoint:
    """Margins at one operating point, or why there are none."""

    where: str
    margins: Margins | None
    reason: str


@dataclass(frozen=True, eq=False, slots=True)
class SweepCheck:
    """A point that may decide, examined by several methods; `doubt` says what speaks against its modes."""

    where: str
    modes: Modes
    doubt: str


@dataclass(frozen=True, eq=False, slots=True)
class Evidence:
    """All that was computed for one option.

    `design` is the design point; `sweep_checks` holds, by parameter, the places of largest growth and least damping.
    """

    design: SweepCheck
    sweeps: Mapping[str, Sweep]
    sweep_checks: Mapping[str, tuple[SweepCheck, ...]]
    margin_points: tuple[MarginPoint, ...]
    has_loops: bool
    floquet: FloquetStudy | None
    floquet_reason: str
    design_values: Mapping[str, float]
    ride: RideStudy | None = None
    ride_reason: str = "the scenario describes no irregularity"
    robustness: WorstCase | None = None
    robustness_reason: str = "the scenario describes no uncertainty"
