"""What a study leaves behind: one record per option and one comparison, complete enough to write every report from."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

from maglev_ctrl.analysis.boundary import Boundaries
from maglev_ctrl.analysis.floquet import Floquet
from maglev_ctrl.analysis.floquet_margins import FloquetMargins
from maglev_ctrl.analysis.margin_sites import MarginSites
from maglev_ctrl.analysis.margins import Margins
from maglev_ctrl.analysis.modes import Modes
from maglev_ctrl.analysis.resonance_map import ResonanceMap
from maglev_ctrl.analysis.robustness.records import WorstCase
from maglev_ctrl.analysis.tracking import ModeTracks
from maglev_ctrl.arrays import ComplexArray, FloatArray
from maglev_ctrl.display import Shown
from maglev_ctrl.errors import Verdict
from maglev_ctrl.study.nonlinear.records import NonlinearStudy
from maglev_ctrl.study.ride_records import RideStudy
from maglev_ctrl.study.tuning.records import TuningStudy
from maglev_ctrl.synthesis.design import Design
from maglev_ctrl.systems import SecondOrderSystem
from maglev_ctrl.vehicle.operating import Equilibrium
from maglev_ctrl.vehicle.vehicle import Vehicle

SweepName = Literal["speed", "payload", "height", "gap", "lateral_offset"]


@dataclass(frozen=True, eq=False, slots=True, repr=False)
class RequirementResult(Shown):
    """One requirement judged for one option."""

    _told: ClassVar = ("name", "verdict", "value", "limit", "unit", "margin_percent", "hard")

    name: str
    quantity: str
    description: str  # in words, e.g. "largest growth rate over the speed sweep"
    sense: Literal["at_least", "at_most"]
    limit: float
    value: float  # NaN when not evaluated
    unit: str  # "" for ratios
    verdict: Verdict
    margin_percent: float  # positive = inside the limit; NaN when undefined
    worst_at: str  # the operating point that decides, e.g. "speed 153 km/h"
    method: str  # how it was computed and what confirmed it
    reason: str  # why it failed or could not be evaluated; for a bound that passes, what it is a bound of; else ""
    bound: Literal["exact", "lower", "upper"]  # "lower": the true value is at least `value`, e.g. where a sweep ended
    hard: bool = True  # False: a wish, whose missing is told but fails nothing


@dataclass(frozen=True, eq=False, slots=True, repr=False)
class Sweep(Shown):
    """Closed-loop eigenvalues along one operating parameter (SI), tracked and labelled."""

    _told: ClassVar = ("parameter", "values", "unit")

    parameter: SweepName
    unit: str  # display unit, e.g. "km/h"
    scale: float  # display value = SI value * scale
    values: FloatArray  # (p,) SI; points without an equilibrium carry NaN rows in `tracks`
    tracks: ModeTracks
    abscissa: FloatArray  # (p,) 1/s, NaN where not evaluated
    least_damping: FloatArray  # (p,) smallest damping ratio of the oscillating modes
    boundaries: Boundaries
    gaps: tuple[tuple[float, str], ...]  # (value, reason) of points that could not be evaluated


@dataclass(frozen=True, eq=False, slots=True)
class RootLocus:
    """Eigenvalues at the design point while the option's elements are faded in: 0 = bare vehicle, 1 = as designed."""

    gain: FloatArray  # (g,)
    s: ComplexArray  # (g, m)


@dataclass(frozen=True, eq=False, slots=True)
class NyquistCurve:
    """Return ratio of one channel with the other loops closed."""

    channel: str
    frequency: FloatArray  # (f,) rad/s
    response: ComplexArray  # (f,)


@dataclass(frozen=True, eq=False, slots=True, repr=False)
class FloquetStudy(Shown):
    """Periodic forcing of one option."""

    _told: ClassVar = ("at_design", "worst_depth", "worst_speed", "worst_resonance")

    wavelength: float  # m
    expected_depth: float
    at_design: Floquet  # closed loop at the design speed and expected depth
    open_loop: Floquet | None  # the same vehicle without the option's elements
    map: ResonanceMap
    critical_depth: FloatArray  # (V,) smallest unstable depth at each map speed; inf = none up to the map's largest
    largest_depth: float
    worst_depth: float  # smallest critical depth over the map's stable speeds
    worst_speed: float  # m/s, where
    worst_resonance: str  # the tongue that decides, named
    go_ranges: tuple[tuple[float, float], ...]  # speed ranges (m/s) stable at the expected depth
    no_go_ranges: tuple[tuple[float, float, str], ...]  # (from, to, tongue)
    margins: FloquetMargins | None  # about the design point at the expected depth, on the full model
    margins_reason: str  # why there are none, or what is missing among them; "" otherwise


@dataclass(frozen=True, eq=False, slots=True, repr=False)
class OptionStudy(Shown):
    """Everything computed for one suspension option."""

    _told: ClassVar = ("name", "verdict", "modes", "margins", "failure")

    name: str
    label: str
    kind: str
    summary: tuple[str, ...]  # the option's elements and law in words, one line each
    vehicle: Vehicle
    failure: str  # why the option could not be studied at all; "" otherwise
    equilibrium: Equilibrium | None
    system: SecondOrderSystem | None  # closed loop at the design point
    open_system: SecondOrderSystem | None  # the same vehicle with the loops open
    modes: Modes | None  # of `system`
    design: Design | None  # active options
    sweeps: tuple[Sweep, ...]
    locus: RootLocus | None
    margins: Margins | None
    margins_reason: str  # why there are no margins; "" otherwise
    nyquist: tuple[NyquistCurve, ...]
    floquet: FloquetStudy | None
    floquet_reason: str
    requirements: tuple[RequirementResult, ...]
    notes: tuple[str, ...]
    seconds: float
    ride: RideStudy | None = None
    ride_reason: str = ""
    robustness: WorstCase | None = None
    robustness_reason: str = ""
    nonlinear: NonlinearStudy | None = None
    nonlinear_reason: str = ""
    margin_sites: MarginSites | None = None  # of laws with few sensors: broken at commands, at sensors, and at both

    @property
    def verdict(self) -> Verdict:
        """PASS only when every hard requirement passes; FAIL as soon as one fails; NOT EVALUATED otherwise."""
        verdicts = [r.verdict for r in self.requirements if r.hard]
        if self.failure or Verdict.FAIL in verdicts:
            return Verdict.FAIL if Verdict.FAIL in verdicts else Verdict.NOT_EVALUATED
        if not verdicts or Verdict.NOT_EVALUATED in verdicts:
            return Verdict.NOT_EVALUATED
        return Verdict.PASS


@dataclass(frozen=True, eq=False, slots=True, repr=False)
class Comparison(Shown):
    """A scenario's options side by side."""

    _told: ClassVar = ("title", "verdict", "options")

    title: str
    description: str
    scenario_path: str
    scenario_text: str
    scenario_hash: str
    sources: tuple[tuple[str, str], ...]  # key, citation
    assumptions: tuple[str, ...]
    forces: tuple[str, ...]  # the force model in words, with the residuals of a fitted table
    design_speed: float  # m/s
    design_height: float  # m
    options: tuple[OptionStudy, ...]
    versions: tuple[tuple[str, str], ...]
    created: str  # ISO 8601, UTC
    seconds: float
    tuning: TuningStudy | None = None

    @property
    def verdict(self) -> Verdict:
        """PASS when every option passes, FAIL when one fails; see each option's own verdict."""
        verdicts = [o.verdict for o in self.options]
        if verdicts and all(v is Verdict.PASS for v in verdicts):
            return Verdict.PASS
        return Verdict.FAIL if Verdict.FAIL in verdicts else Verdict.NOT_EVALUATED
