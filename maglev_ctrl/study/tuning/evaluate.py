"""One candidate judged: objectives and missed requirements, the worst over the operating set.

Three stages, each dearer than the one before: poles at every situation, ride, margins. A candidate that is not stable
everywhere, or far outside a requirement, does not reach the next stage and counts as worse than all that do.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from maglev_ctrl.analysis.loops import Loop
from maglev_ctrl.analysis.margin_estimates import margin_estimates
from maglev_ctrl.arrays import ComplexArray, FloatArray
from maglev_ctrl.scenario import OptionRecord, RequirementRecord, Scenario
from maglev_ctrl.scenario.tunes import TunedQuantity, with_tuned
from maglev_ctrl.study.design.budget import with_budget
from maglev_ctrl.study.faults import sentence
from maglev_ctrl.study.loops import option_loops
from maglev_ctrl.study.ride import ride_at
from maglev_ctrl.study.situation import OptionModel, Situation
from maglev_ctrl.study.tuning.candidate import CandidateModel, Shared
from maglev_ctrl.study.tuning.figures import (
    IN_LOOP,
    LARGER_IS_BETTER,
    READS,
    STAGES,
    Stage,
    figure_name,
    margin_figures,
    relative_violation,
    ride_figures,
    worst_of,
)
from maglev_ctrl.study.tuning.law import quick_law
from maglev_ctrl.study.tuning.operating_set import operating_set
from maglev_ctrl.systems import Controller, loop_matrices

RESERVE: Final = 0.02
"""The loop asks for this much more than a limit: its situations are few, and its margins are estimates."""
FAR: Final = 0.5
"""Relative violation from which the dearer stages are not worth their time."""
STAGE_PENALTY: Final = 10.0
FAILED: Final = 1e3
"""Violation of a candidate without a model or a law: more than any other."""
NEUTRAL: Final = 1e-9
"""Poles nearer to the axis or to the real line than this share of the largest lie on it."""
PROBES: Final = 4
"""Candidates looked at everywhere before it is decided which situations the others are looked at."""
STABLE: Final = "stable over the operating set"
_RIDE_SCOPES: Final = ("nominal", "speed", "payload")
"""Where ride and margins are looked at, as in the full study."""


@dataclass(frozen=True, eq=False, slots=True)
class Assessment:
    """One candidate: objectives (k,) as they are (SI), requirements' worst values (r,), how far they are missed (r,).

    `score` (k,): the objectives with signs that make smaller better. Violations count from the limit and its reserve.

    `total` adds up the violations of all stages, 0 for a candidate that meets every requirement. `complete`: every
    figure was measured. `binding` is the requirement missed by most, `worst` by how much. `fault` says why there is
    no model or law.
    """

    objectives: FloatArray
    score: FloatArray
    values: FloatArray
    violations: FloatArray
    total: float
    complete: bool
    binding: str
    worst: float
    fault: str = ""


@dataclass(eq=False, slots=True)
class _Watched:
    """Which places of a stage are looked at: all at first, later those where something was worst."""

    every: tuple[int, ...]
    seen: int = 0
    worst: set[int] = field(default_factory=lambda: {0})

    def places(self, *, everywhere: bool) -> tuple[int, ...]:
        return self.every if everywhere or self.seen < PROBES else tuple(sorted(self.worst))

    def learn(self, figures: dict[int, dict[str, float]], names: Sequence[str]) -> None:
        if len(figures) < len(self.every):
            return
        self.seen += 1
        for name in names:
            order = [(one.get(name, math.nan), place) for place, one in figures.items()]
            sign = -1.0 if name in LARGER_IS_BETTER else 1.0
            known = [(sign * value, -place) for value, place in order if not math.isnan(value)]
            if known:
                self.worst.add(-max(known)[1])


class Judge:
    """Assesses candidates of one option; `judge(values)` with the variables' values in SI."""

    def __init__(self, scenario: Scenario, option: OptionRecord, tuned: Sequence[TunedQuantity]) -> None:
        assert scenario.tuning is not None
        self.scenario, self.option, self.tuned = scenario, option, tuple(tuned)
        self.objectives = scenario.tuning.objectives
        self._signs = np.array([-1.0 if READS[one] in LARGER_IS_BETTER else 1.0 for one in self.objectives])
        self.requirements = judged_in_loop(scenario)
        self.places = operating_set(scenario)
        self.shared = Shared(statics_fixed=not any(one.path[-1:] == ("stiffness",) for one in tuned))
        needed = {IN_LOOP[READS[one]] for one in self.objectives}
        self.stages = tuple(s for s in STAGES if s in needed | {IN_LOOP[r.quantity] for r in self.requirements})
        ridden = tuple(i for i, one in enumerate(self.places) if set(one.scopes) & set(_RIDE_SCOPES))
        outer = {i for i, place in enumerate(self.places) if not place.inner}
        margins = tuple(i for i in ridden if not self.places[i].inner)
        everything = tuple(range(len(self.places)))
        self._watched = {
            "poles": _Watched(everything, worst=outer), "ride": _Watched(ridden), "margins": _Watched(margins),
        }  # fmt: skip
        self._names = (
            *(READS[one] for one in self.objectives), *(figure_name(one) for one in self.requirements)
        )  # fmt: skip

    def __call__(self, values: Sequence[float], *, everywhere: bool = False) -> Assessment:
        """The candidate with these values; `everywhere` leaves no situation and, of a stable one, no stage out.

        A model or a law that does not exist is told in `fault`, never raised.
        """
        try:
            return self._assessed(values, everywhere)
        except Exception as fault:
            reason = sentence(fault)
            k, r = len(self.objectives), len(self.requirements)
            nothing = np.full(k, np.nan)
            return Assessment(
                nothing, nothing, np.full(r, np.nan), np.full(r, np.nan), FAILED, False, STABLE, FAILED, reason
            )

    def _assessed(self, values: Sequence[float], everywhere: bool) -> Assessment:
        option = with_tuned(self.option, self.tuned, values)
        model: OptionModel
        if option.damping_budget is None:
            model = CandidateModel(self.scenario, option, shared=self.shared)
        else:
            model = with_budget(self.scenario, option)
        model, controller = quick_law(self.scenario, option, model)
        measured: dict[str, dict[int, dict[str, float]]] = {}
        seen: dict[int, tuple[Loop | None, ComplexArray]] = {}
        missed: dict[str, float] = {}
        reached = 0
        for stage in self.stages:
            measured[stage] = self._measure(stage, model, controller, seen, everywhere)
            self._watched[stage].learn(measured[stage], (*self._names, "growth_rate"))
            reached += 1
            missed = self._violations(measured)
            if missed[STABLE] > 0.0 or (not everywhere and max(missed.values()) > FAR):
                break
        complete = reached == len(self.stages)
        return self._record(measured, missed, complete, STAGE_PENALTY * (len(self.stages) - reached))

    def _measure(
        self, stage: Stage, model: OptionModel, controller: Controller | None,
        seen: dict[int, tuple[Loop | None, ComplexArray]], everywhere: bool,
    ) -> dict[int, dict[str, float]]:  # fmt: skip
        watched = self._watched[stage].places(everywhere=everywhere)
        if stage == "poles":
            found = {}
            for i in watched:
                situation = self.places[i].situation
                loop = _open_loop(model, controller, situation)
                s = _poles(model, loop, situation)
                seen[i], found[i] = (loop, s), {"growth_rate": _growth(s), "damping_ratio": _damping(s)}
            return found
        if stage == "ride":
            return {i: _ride(model, controller, self.places[i].situation) for i in watched}
        return {i: _margins(model, seen[i][0], self.places[i].situation, seen[i][1]) for i in watched}

    def _violations(self, measured: dict[str, dict[int, dict[str, float]]]) -> dict[str, float]:
        """By requirement, what was measured so far; stability at every place is asked for always."""
        growth = max(one["growth_rate"] for one in measured["poles"].values())
        found = {STABLE: max(growth, 0.0)}
        for one in self.requirements:
            if IN_LOOP[one.quantity] in measured:
                found[one.name] = violation(one, self._value(one, measured))
        return found

    def _value(self, one: RequirementRecord, measured: dict[str, dict[int, dict[str, float]]]) -> float:
        figures = measured.get(IN_LOOP[one.quantity], {})
        scopes = {one.over} if IN_LOOP[one.quantity] != "margins" or one.over == "nominal" else set(_RIDE_SCOPES)
        inside = [f for i, f in figures.items() if i == 0 or scopes & set(self.places[i].scopes)]
        return worst_of(inside[:1] if one.over == "nominal" else inside, figure_name(one))

    def _record(
        self, measured: dict[str, dict[int, dict[str, float]]], missed: dict[str, float], complete: bool, penalty: float
    ) -> Assessment:
        objectives = np.array([worst_of(measured.get(IN_LOOP[READS[one]], {}).values(), READS[one])
                               for one in self.objectives])  # fmt: skip
        values = np.array([self._value(one, measured) for one in self.requirements])
        violations = np.array([missed.get(one.name, np.nan) for one in self.requirements])
        binding = STABLE if missed[STABLE] > 0.0 else max(missed, key=lambda name: missed[name])
        total = penalty + math.fsum(v / (1.0 + v) for v in missed.values())
        if complete and not np.all(np.isfinite(objectives)):
            total, complete = total + STAGE_PENALTY, False
        worst = missed[binding]
        if binding == STABLE:
            binding = next((r.name for r in self.requirements if r.quantity == "growth_rate"), STABLE)
        return Assessment(
            objectives=objectives, score=self._signs * objectives, values=values, violations=violations, total=total,
            complete=complete, binding=binding if total else "", worst=worst,
        )  # fmt: skip


def violation(one: RequirementRecord, value: float, *, factor: float = 1.0) -> float:
    """How far a value is beyond a requirement's limit and the reserve, relative to it; `factor` is put on the limit."""
    limit = factor * one.limit
    if one.quantity == "contact_probability":
        return relative_violation(value, limit, one.sense, probability=True)
    slack = RESERVE * abs(limit) * (1.0 if one.sense == "at_least" else -1.0)
    return relative_violation(value, limit + slack, one.sense)


def judged_in_loop(scenario: Scenario) -> tuple[RequirementRecord, ...]:
    """The hard requirements that the loop can judge."""
    return tuple(one for one in scenario.judged if one.hard and one.quantity in IN_LOOP and _swept(scenario, one))


def judged_after(scenario: Scenario) -> tuple[str, ...]:
    """Names of the hard requirements that only the full study judges."""
    inside = {one.name for one in judged_in_loop(scenario)}
    return tuple(one.name for one in scenario.judged if one.hard and one.name not in inside)


def _swept(scenario: Scenario, one: RequirementRecord) -> bool:
    """Whether the sweep a requirement asks for exists; without it the full study says what is missing."""
    margins = IN_LOOP[one.quantity] == "margins"
    return one.over == "nominal" or margins or getattr(scenario.operating.sweep, one.over) is not None


def _open_loop(model: OptionModel, controller: Controller | None, situation: Situation) -> Loop | None:
    """The return ratio at the actuators' commands, delays in their Pade form; None for a passive option."""
    law = model.law_at(situation, controller)
    if law is None:
        return None
    return Loop(*loop_matrices(model.plant(situation), law), law.commands)


def _poles(model: OptionModel, loop: Loop | None, situation: Situation) -> ComplexArray:
    if loop is None:
        return np.asarray(np.linalg.eigvals(model.plant(situation).state_matrix()), dtype=np.complex128)
    inside = np.linalg.solve(np.eye(len(loop.channels)) + loop.D, loop.C)
    return np.asarray(np.linalg.eigvals(loop.A - loop.B @ inside), dtype=np.complex128)


def _growth(s: ComplexArray) -> float:
    """Largest real part; a pole on the axis within rounding, as of a free drift, does not grow."""
    return max((float(x) for x in s.real if abs(x) > NEUTRAL * float(np.max(np.abs(s)))), default=0.0)


def _damping(s: ComplexArray) -> float:
    """Least damping ratio; of a divergence -1, 1 where nothing oscillates."""
    size = NEUTRAL * float(np.max(np.abs(s), initial=0.0))
    oscillating = s.imag > size
    if np.any(s.real[(s.imag >= 0.0) & ~oscillating] > size):
        return -1.0
    ratios = -s.real[oscillating] / np.abs(s[oscillating])
    return float(np.min(ratios, initial=1.0))


def _ride(model: OptionModel, controller: Controller | None, situation: Situation) -> dict[str, float]:
    return ride_figures(ride_at(model, controller, situation, quick=True))


def _margins(model: OptionModel, loop: Loop | None, situation: Situation, poles: ComplexArray) -> dict[str, float]:
    if loop is None:
        loops = option_loops(model, situation, None)
        loop = None if loops is None else loops.loop()
    return margin_figures(None if loop is None else margin_estimates(loop, poles[poles.real < 0.0]))
