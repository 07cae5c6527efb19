"""What designing the laws of a scenario leaves behind: one record per option, complete enough for page and files."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from maglev_ctrl.analysis.margins import Margins
from maglev_ctrl.arrays import ComplexArray, FloatArray
from maglev_ctrl.display import Shown
from maglev_ctrl.errors import Status, Verdict
from maglev_ctrl.synthesis.damping.budget import DampingBudget
from maglev_ctrl.synthesis.design import Design
from maglev_ctrl.synthesis.discretise import DiscretisationLoss
from maglev_ctrl.synthesis.lmi.regions import Region
from maglev_ctrl.synthesis.predictive.design import PredictiveDesign
from maglev_ctrl.synthesis.predictive.simulate import PredictiveRun
from maglev_ctrl.synthesis.result import Synthesis
from maglev_ctrl.synthesis.scheduling.records import ScheduledDesign
from maglev_ctrl.systems import Controller


@dataclass(frozen=True, eq=False, slots=True)
class CornerPoles:
    """Poles (1/s) of the open and the closed loop at one operating point, actuator delays left out."""

    name: str
    open_loop: ComplexArray
    closed_loop: ComplexArray


@dataclass(frozen=True, eq=False, slots=True)
class GainCurve:
    """Largest gain from all disturbances to all performance outputs over frequency, without and with the law.

    `level` is what the design proves it stays below, NaN where it claims nothing.
    """

    frequency: FloatArray  # (f,) rad/s
    open_loop: FloatArray
    closed_loop: FloatArray
    level: float


@dataclass(frozen=True, eq=False, slots=True)
class Level:
    """Root mean square of a weighted output or command under the law's own disturbance, beside its acceptable value.

    SI; the worst of the law's operating points, at `where`.
    """

    name: str
    unit: str
    root_mean_square: float
    allowed: float
    where: str


@dataclass(frozen=True, eq=False, slots=True)
class SampledLaw:
    """The law as a computer runs it: sampled every `period` s, and what that costs."""

    period: float
    controllers: tuple[Controller, ...]  # one, or one per node of a schedule
    loss: DiscretisationLoss | None
    margins: Margins | None  # of the sampled loop, where the law was designed for samples
    reason: str  # why there is no loss to tell


@dataclass(frozen=True, eq=False, slots=True)
class Signal:
    """One limited output or command over the samples of a manoeuvre, SI; `limit` NaN where it has none."""

    name: str
    unit: str  # display unit
    scale: float  # display value = SI value * scale
    limit: float
    predicted: FloatArray  # (k,)
    saturated: FloatArray  # (k,)


@dataclass(frozen=True, eq=False, slots=True)
class PredictiveStudy:
    """Predictive control and the manoeuvre it is shown by, beside the saturated law that takes over where it fails."""

    design: PredictiveDesign
    time: FloatArray  # (k,) s
    signals: tuple[Signal, ...]
    with_prediction: PredictiveRun
    saturated: PredictiveRun


@dataclass(frozen=True, eq=False, slots=True, repr=False)
class LawStudy(Shown):
    """One option's law: designed, proved, sampled. `failure` says in a sentence why there is none."""

    _told: ClassVar = ("name", "law", "verdict", "status", "failure")

    name: str
    label: str
    kind: str
    summary: tuple[str, ...]
    law: str  # in words
    failure: str
    status: Status
    design: Design | None
    synthesis: Synthesis | None
    corners: tuple[CornerPoles, ...]
    region: Region | None
    gain: GainCurve | None  # None where the law names no disturbance of its own
    levels: tuple[Level, ...]  # empty where the law names no disturbance of its own
    margins: Margins | None
    margins_reason: str
    delays: str  # "" where the loop with its actuator delays is stable too, else what is not
    sampled: SampledLaw | None
    schedule: ScheduledDesign | None
    asked: str  # what the schedule was asked for against what is proved, "" without a question
    budget: DampingBudget | None
    chosen: float  # decay rate the dampers were chosen for, 1/s; NaN without a budget
    predictive: PredictiveStudy | None
    document: dict[str, Any] | None  # the self-contained design, as `maglev-ctrl verify` reads it
    notes: tuple[str, ...]
    seconds: float

    @property
    def verdict(self) -> Verdict:
        """PASS where every claim was proved and the loop with its delays is stable; without a law nothing is judged."""
        if self.failure or self.synthesis is None or not self.synthesis.proofs:
            return Verdict.NOT_EVALUATED
        proved = all(proof.holds for proof in self.synthesis.proofs) and not self.delays
        return Verdict.PASS if proved else Verdict.FAIL


@dataclass(frozen=True, eq=False, slots=True, repr=False)
class DesignStudy(Shown):
    """Every law of a scenario."""

    _told: ClassVar = ("title", "verdict", "options")

    name: str
    title: str
    description: str
    scenario_path: str
    scenario_text: str
    scenario_hash: str
    sources: tuple[tuple[str, str], ...]
    assumptions: tuple[str, ...]
    options: tuple[LawStudy, ...]
    versions: tuple[tuple[str, str], ...]
    created: str
    seconds: float

    @property
    def verdict(self) -> Verdict:
        """The worst of the options': a law that is not proved fails, one that does not exist is not evaluated."""
        found = {option.verdict for option in self.options}
        for verdict in (Verdict.FAIL, Verdict.NOT_EVALUATED):
            if verdict in found:
                return verdict
        return Verdict.PASS if found else Verdict.NOT_EVALUATED
