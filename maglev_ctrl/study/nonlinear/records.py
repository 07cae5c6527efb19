"""What the nonlinear check of one option leaves behind."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from maglev_ctrl.analysis.simulation.records import Trajectory
from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.display import Shown
from maglev_ctrl.errors import Agreement, Verdict


@dataclass(frozen=True, eq=False, slots=True)
class Compared:
    """One number of the linear theory beside that of the nonlinear vehicle, both in `unit`.

    `low`, `high`: the confidence band of the nonlinear one (equal where it has none); `agreement` AGREED, or
    UNRESOLVED with the reason where they differ by more than the band or the tolerance named in `reason`.
    """

    name: str
    unit: str
    linear: float
    nonlinear: float
    low: float
    high: float
    agreement: Agreement
    reason: str


@dataclass(frozen=True, eq=False, slots=True)
class SimulatedEvent:
    """Something that ended a run: contact, or forces left their data."""

    run: int
    time: float
    kind: str  # "contact", "outside the force data", "diverged"
    element: str  # magnet, spring or actuator
    value: float  # closing speed at contact, m/s; NaN otherwise
    words: str


@dataclass(frozen=True, eq=False, slots=True)
class SimulatedSignal:
    """One signal of one run, thinned for a figure."""

    name: str
    unit: str
    values: FloatArray


@dataclass(frozen=True, eq=False, slots=True)
class NonlinearStudy:
    """The nonlinear check of one option."""

    runs: int
    duration: float
    seed: int
    step: float
    step_error: float
    speed: float
    compared: tuple[Compared, ...]
    events: tuple[SimulatedEvent, ...]
    saturated: tuple[tuple[str, float], ...]  # actuator, share of time at its limit
    limit_cycle: str  # in words; "" where the motion is not periodic
    attraction: tuple[tuple[str, float, int, int], ...]  # coordinate, size of the start, returned, tried
    time: FloatArray  # (t,) s, of the signals shown
    signals: tuple[SimulatedSignal, ...]
    assumptions: tuple[str, ...]
    seconds: float


@dataclass(frozen=True, eq=False, slots=True, repr=False)
class SimulationStudy(Shown):
    """One option simulated on request: the check, and every signal of every run."""

    _told: ClassVar = ("title", "option", "verdict", "study", "trajectory")

    title: str
    name: str  # of the scenario
    scenario_hash: str
    scenario_text: str
    option: str
    label: str
    summary: tuple[str, ...]
    study: NonlinearStudy
    trajectory: Trajectory
    versions: tuple[tuple[str, str], ...]
    created: str  # ISO 8601, UTC

    @property
    def verdict(self) -> Verdict:
        """FAIL where a run touched or ended early, NOT EVALUATED where a comparison does not agree, else PASS."""
        if self.study.events:
            return Verdict.FAIL
        agreed = all(one.agreement is Agreement.AGREED for one in self.study.compared)
        return Verdict.PASS if agreed else Verdict.NOT_EVALUATED
