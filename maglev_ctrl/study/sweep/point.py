"""One option at any point of a sweep: its figures there, or why there are none."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from maglev_ctrl.analysis.floquet import Floquet, floquet
from maglev_ctrl.analysis.floquet_margins import scaled_controller
from maglev_ctrl.analysis.margins import Margins, loop_margins
from maglev_ctrl.analysis.modes import StabilityVerdict
from maglev_ctrl.errors import MaglevError, ModelError, NotStable, Verdict
from maglev_ctrl.scenario import Scenario
from maglev_ctrl.scenario.quantity_paths import DEPTH, GAIN, SITUATION, ScenarioQuantity
from maglev_ctrl.study.delays import settled_modes
from maglev_ctrl.study.evidence import MarginPoint, SweepCheck
from maglev_ctrl.study.forcing import periodic_system
from maglev_ctrl.study.law import designed_option
from maglev_ctrl.study.live.settle import HERE, NO_LOOPS, judged_here, stable_at, verdict_of
from maglev_ctrl.study.loops import option_loops
from maglev_ctrl.study.modulation import ScenarioModulation, modulation_of
from maglev_ctrl.study.requirements import MARGINS
from maglev_ctrl.study.situation import OptionModel, Situation
from maglev_ctrl.study.sweep.records import (
    COMPLETE,
    FAILED,
    INCOMPLETE,
    NO_ANSWER,
    STABLE,
    UNRESOLVED,
    UNSTABLE,
)
from maglev_ctrl.study.sweep.request import Part
from maglev_ctrl.study.sweeps import least_damping
from maglev_ctrl.study.variants import of_file, varied_option
from maglev_ctrl.systems import Controller, at_depth

_FAULTS = (MaglevError, ValueError, ArithmeticError, np.linalg.LinAlgError)
_VERDICTS: Final = {Verdict.PASS: 1.0, Verdict.FAIL: -1.0, Verdict.NOT_EVALUATED: 0.0}
_STATES: Final = {
    StabilityVerdict.STABLE: STABLE, StabilityVerdict.UNSTABLE: UNSTABLE, StabilityVerdict.UNRESOLVED: UNRESOLVED,
}  # fmt: skip
_KEPT = 16  # variants of the file; neighbouring points of a grid share them

Values = tuple[tuple[ScenarioQuantity, float], ...]


@dataclass(frozen=True, eq=False, slots=True)
class _Variant:
    """The option with some values of its file replaced; `modulation` is a reason where there is none."""

    model: OptionModel
    controller: Controller | None
    modulation: ScenarioModulation | str


@dataclass(frozen=True, eq=False, slots=True)
class OptionPoint:
    """One option of a scenario at any values of its quantities.

    Its law is designed once, at the scenario's own values; only a quantity of the law designs it anew, as on a map.

    Raises
    ------
    ModelError : the law or the dampers do not exist
    OutOfDomain : the forces are not known where the law is designed
    """

    model: OptionModel
    controller: Controller | None
    parts: tuple[Part, ...]
    _variants: OrderedDict[tuple[float, ...], _Variant] = field(default_factory=OrderedDict)

    @classmethod
    def of(cls, scenario: Scenario, option_name: str, parts: tuple[Part, ...]) -> OptionPoint:
        """The option of a name, its law designed."""
        option = next(one for one in scenario.options if one.name == option_name)
        try:
            model, design = designed_option(scenario, option)
        except (ValueError, ArithmeticError, np.linalg.LinAlgError) as fault:
            raise ModelError(f"{fault}") from None
        return cls(model, None if design is None else design.controller, parts)

    @np.errstate(over="ignore", invalid="ignore", divide="ignore")  # what overflows has no answer, and says so
    def figures(self, values: Values) -> tuple[dict[str, float], str]:
        """Figures by column at values (SI), and a remark; of what could not be computed there is none, and the remark
        says why. A fault of one point is never that of another: whatever goes wrong is told here.
        """
        try:
            return self._figures(values)
        except _FAULTS as fault:
            return {"status": FAILED}, f"{fault}"
        except MemoryError:
            return {"status": FAILED}, "the memory was not enough"
        except Exception as fault:  # a fault of this program; the other points do not pay for it
            return {"status": FAILED}, f"unexpected {type(fault).__name__}: {fault}"

    def _figures(self, values: Values) -> tuple[dict[str, float], str]:
        variant = self._variant(values)
        situation = _situation(variant.model, values)
        model, law = variant.model, variant.controller
        gain = next((value for quantity, value in values if quantity.name == GAIN), 1.0)
        if law is not None and gain != 1.0:
            model, law = model.with_gain(gain), scaled_controller(law, gain)
        found, doubt = settled_modes(model, model.vehicle(situation.payload), situation, law)
        k = found.critical
        figures = {
            "status": COMPLETE, "state": UNRESOLVED if doubt else _STATES[found.verdict],
            "growth": found.spectral_abscissa, "growth_bound": float(found.error_bound[k]),
            "least_damping": least_damping(found), "frequency": float(abs(found.s[k].imag) / (2.0 * np.pi)),
        }  # fmt: skip
        remarks, periodic = [doubt], None
        if "floquet" in self.parts:
            periodic, told, reason = self._periodic(replace(variant, model=model, controller=law), values, situation)
            figures |= told
            remarks.append(reason)
            figures["status"] = INCOMPLETE if reason else figures["status"]
        if "margins" in self.parts or "requirements" in self.parts:
            margins, reason, missing = _margins(model, situation, law)
            if "margins" in self.parts:
                figures |= _margin_figures(margins)
            remarks.append(reason if missing else "")
            figures["status"] = INCOMPLETE if missing else figures["status"]
            if "requirements" in self.parts:
                check = SweepCheck(HERE, found, doubt)
                stable = stable_at(check, periodic, periodic="floquet" in self.parts)
                results = judged_here(model.scenario, check, MarginPoint(HERE, margins, reason))
                figures["requirements"] = _VERDICTS[verdict_of(results, stable)]
        return figures, "; ".join(dict.fromkeys(one for one in remarks if one))

    def _periodic(
        self, variant: _Variant, values: Values, situation: Situation
    ) -> tuple[Floquet | None, dict[str, float], str]:
        """Floquet analysis at the depth of the point, its figures, and why there are none."""
        nothing = {"modulated_state": NO_ANSWER}
        modulation = variant.modulation
        if isinstance(modulation, str):
            return None, nothing, modulation
        depth = next((value for quantity, value in values if quantity.name == DEPTH), modulation.depth)
        model = variant.model
        try:
            vehicle = model.vehicle(situation.payload)
            unit = periodic_system(model, vehicle, situation, variant.controller, modulation)
            found = floquet(at_depth(unit, depth))
        except _FAULTS as fault:
            return None, nothing, f"under modulation: {fault}"
        state = UNRESOLVED if found.stable is None else STABLE if found.stable else UNSTABLE
        told = {
            "modulated_state": state, "modulated_growth": found.growth_rate,
            "modulated_growth_bound": found.growth_error,
        }  # fmt: skip
        return found, told, ""

    def _variant(self, values: Values) -> _Variant:
        """The option with values of the file replaced, as far as they change it."""
        changes = tuple(
            one for one in values
            if of_file(one[0]) and one[0].option in (None, self._position())
        )  # fmt: skip
        key = tuple(value for _, value in changes)
        found = self._variants.get(key)
        if found is None:
            model, law = varied_option(self.model, self.controller, changes) if changes else (
                self.model, self.controller
            )  # fmt: skip
            found = _Variant(model, law, self._modulation(model.scenario))
            while len(self._variants) >= _KEPT:
                self._variants.popitem(last=False)
            self._variants[key] = found
        return found

    def _position(self) -> int | None:
        """Where the option stands in its scenario."""
        name = "" if self.model.option is None else self.model.option.name
        return next((k for k, one in enumerate(self.model.scenario.options) if one.name == name), None)

    def _modulation(self, scenario: Scenario) -> ScenarioModulation | str:
        if "floquet" not in self.parts:
            return "not asked for"
        try:
            return modulation_of(scenario)
        except _FAULTS as fault:
            return f"{fault}"


def _situation(model: OptionModel, values: Values) -> Situation:
    moved: Mapping[str, float] = {q.name: value for q, value in values if q.name in SITUATION}
    return replace(Situation.of_design(model.scenario), **moved)


def _margins(
    model: OptionModel, situation: Situation, controller: Controller | None
) -> tuple[Margins | None, str, bool]:
    """Margins, why there are none, and whether that is a fault: an unstable loop has none, and nothing is missing."""
    try:
        loops = option_loops(model, situation, controller)
        return (None, NO_LOOPS, False) if loops is None else (loop_margins(loops.loop()), "", False)
    except NotStable as fault:
        return None, f"{fault}", False
    except _FAULTS as fault:
        return None, f"margins: {fault}", True


def _margin_figures(margins: Margins | None) -> dict[str, float]:
    return {} if margins is None else {name: read(margins)[0] for name, read in MARGINS.items()}
