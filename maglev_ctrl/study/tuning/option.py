"""One option tuned: its search, its front looked at everywhere, the candidate chosen."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from maglev_ctrl.arrays import FloatArray, read_only, read_only_any
from maglev_ctrl.scenario import OptionRecord, Scenario
from maglev_ctrl.scenario.tunes import TunedQuantity, decoded, encoded, is_integral, tuned_quantities
from maglev_ctrl.study.faults import sentence
from maglev_ctrl.study.tuning.evaluate import Assessment, Judge
from maglev_ctrl.study.tuning.knee import knee
from maglev_ctrl.study.tuning.records import TunedOption, TunedVariable
from maglev_ctrl.study.tuning.search import Search, non_dominated, search

Step = Callable[[str, float], None]
AT_BOUND: Final = 0.01
"""A value within this share of its range from an end counts as standing there."""


@dataclass(frozen=True, eq=False, slots=True)
class OptionSearch:
    """The record of an option's search, and what the ranking's sensitivity is worked out from.

    `score` (n, k) objectives, smaller better, and `values` (n, r) of the requirements judged in the loop: the front's
    rows first, then every other candidate of the search that was measured in full and does not better the front.
    `misses`: requirements that the best found misses, none where there is a front.
    """

    record: TunedOption
    score: FloatArray
    values: FloatArray
    misses: tuple[str, ...]


def tune_option(scenario: Scenario, option: OptionRecord, *, step: Step = lambda what, share: None) -> OptionSearch:
    """Search an option's design variables; one without any is judged as it is.

    Parameters
    ----------
    step : told what was done and the share of the search, 0 to 1

    Raises
    ------
    ScenarioProblems : a `[[option.tune]]` that cannot be
    """
    tuned = tuned_quantities(scenario, option)
    try:
        return _searched(scenario, option, tuned, step)
    except Exception as fault:  # whatever it is, the other options go on, and this one is judged as it is written
        return untuned(scenario, option, sentence(fault))


def _searched(
    scenario: Scenario, option: OptionRecord, tuned: Sequence[TunedQuantity], step: Step
) -> OptionSearch:  # fmt: skip
    started = time.perf_counter()
    tuning = scenario.tuning
    assert tuning is not None
    judge = Judge(scenario, option, tuned)
    if not tuned:
        only = judge((), everywhere=True)
        found = Search(np.zeros((1, 0)), (0,), 0, "no variables", 0.0)
        return _recorded(scenario, option, judge, found, [only], [()], started, confirmed={0})
    tried: list[tuple[float, ...]] = []
    assessments: list[Assessment] = []

    def assess(place: tuple[float, ...]) -> Assessment:
        values = tuple(decoded(one, x) for one, x in zip(tuned, place, strict=True))
        tried.append(values)
        assessments.append(judge(values))
        return assessments[-1]

    def tell(generation: int, evaluations: int) -> None:
        met = sum(one.total == 0.0 for one in assessments)
        words = f"generation {generation} of {tuning.generations}, {met} of {evaluations} candidates meet all"
        step(words, generation / tuning.generations)

    found = search(
        assess,
        upper=[one.upper - one.lower if is_integral(one) else 1.0 for one in tuned],
        integral=[is_integral(one) for one in tuned], objectives=len(tuning.objectives),
        population=tuning.population, generations=tuning.generations, seed=tuning.seed,
        start=[_first(one) for one in tuned], time_limit=tuning.time_limit, tell=tell,
    )  # fmt: skip
    return _recorded(scenario, option, judge, found, assessments, tried, started, confirmed=set())


def _first(one: TunedQuantity) -> float:
    """The file's own value on the scale searched on."""
    start = min(max(one.start, one.lower), one.upper)
    return encoded(one, start)


def _recorded(
    scenario: Scenario, option: OptionRecord, judge: Judge, found: Search, assessments: list[Assessment],
    tried: Sequence[tuple[float, ...]], started: float, *, confirmed: set[int],
) -> OptionSearch:  # fmt: skip
    tuning = scenario.tuning
    assert tuning is not None
    front = _front(judge, found, assessments, tried, confirmed)
    feasible = bool(front)
    if not feasible:
        best = min(range(len(assessments)), key=lambda i: assessments[i].total)
        if best not in confirmed and not assessments[best].fault:
            assessments[best] = judge(tried[best], everywhere=True)
        front = [best]
    chosen_one = assessments[front[0]]
    reason = f"no candidate has a model and a law: {chosen_one.fault}" if chosen_one.fault else ""
    k, r, v = len(tuning.objectives), len(judge.requirements), len(judge.tuned)
    front = [] if reason else sorted(front, key=lambda i: float(assessments[i].objectives[0]))
    objectives = np.array([assessments[i].objectives for i in front]).reshape(len(front), k)
    score = np.array([assessments[i].score for i in front]).reshape(len(front), k)
    bent = chosen = 0 if front else -1
    if front and np.all(np.isfinite(score)):
        bent = knee(score)
        chosen = bent if tuning.choose == "knee" else int(np.argmin(score[:, tuning.objectives.index(tuning.choose)]))
    failing = min((assessments[i] for i in front), key=lambda one: one.total, default=chosen_one)
    record = TunedOption(
        option=option.name, label=option.label or option.name, kind=option.kind,
        variables=tuple(_variable(one, tried[front[chosen]][j]) for j, one in enumerate(judge.tuned)) if front else (),
        front=read_only_any(objectives),
        front_variables=read_only(np.array([tried[i] for i in front]).reshape(len(front), v), name="front_variables"),
        chosen=chosen, knee=bent, feasible=feasible, binding="" if feasible else failing.binding,
        violation=0.0 if feasible else failing.worst, evaluations=len(assessments),
        failures=sum(bool(one.fault) for one in assessments), generations=found.generations, stopped=found.stopped,
        seed=tuning.seed, seconds=time.perf_counter() - started, reason=reason,
    )  # fmt: skip
    rows = [*(front if feasible else ()), *_others(assessments, front if feasible else [])]
    return OptionSearch(
        record,
        read_only(np.array([assessments[i].score for i in rows]).reshape(len(rows), k), name="score"),
        read_only_any(np.array([assessments[i].values for i in rows]).reshape(len(rows), r)),
        () if feasible else _missed(judge, failing),
    )


def _front(
    judge: Judge, found: Search, assessments: list[Assessment], tried: Sequence[tuple[float, ...]], confirmed: set[int]
) -> list[int]:
    """The survivors that nothing betters, each looked at in every situation; the whole search where none is left."""
    for pool in (found.population, tuple(range(len(assessments)))):
        while True:
            met = [i for i in pool if assessments[i].total == 0.0]
            front = [met[i] for i in non_dominated(np.array([assessments[i].score for i in met]))] if met else []
            doubtful = [i for i in front if i not in confirmed]
            if not doubtful:
                break
            for i in doubtful:
                assessments[i] = judge(tried[i], everywhere=True)
                confirmed.add(i)
        if front:
            return front
    return []


def _others(assessments: Sequence[Assessment], front: Sequence[int]) -> list[int]:
    """Candidates measured in full that miss a requirement or that a candidate of the front betters."""
    scores = np.array([assessments[i].score for i in front])
    kept: list[int] = []
    for i, one in enumerate(assessments):
        if i in front or not one.complete:
            continue
        if one.total > 0.0 or (len(front) and np.any(np.all(scores <= one.score, axis=1))):
            kept.append(i)
    return kept


def _missed(judge: Judge, best: Assessment) -> tuple[str, ...]:
    """Requirements missed as far as they were measured, that missed by most first."""
    if best.fault:
        return (best.binding,)
    pairs = sorted(zip(best.violations, (one.name for one in judge.requirements), strict=True), reverse=True)
    return tuple(dict.fromkeys((best.binding, *(name for beyond, name in pairs if beyond > 0.0))))


def _variable(one: TunedQuantity, value: float) -> TunedVariable:
    unit, scale = one.display
    place = -1.0 if is_integral(one) else encoded(one, value)
    at_bound = "lower" if 0.0 <= place <= AT_BOUND else "upper" if place >= 1.0 - AT_BOUND else ""
    return TunedVariable(
        name=one.name, label=one.label, unit=unit, scale=scale, lower=one.lower, upper=one.upper, value=value,
        text=one.text(value), at_bound=at_bound,
    )  # fmt: skip


def untuned(scenario: Scenario, option: OptionRecord, reason: str) -> OptionSearch:
    """The record of an option that was lost with its process, or whose search failed."""
    tuning = scenario.tuning
    assert tuning is not None
    k = len(tuning.objectives)
    record = TunedOption(
        option=option.name, label=option.label or option.name, kind=option.kind, variables=(),
        front=read_only(np.zeros((0, k)), name="front"),
        front_variables=read_only(np.zeros((0, 0)), name="front_variables"), chosen=-1, knee=-1, feasible=False,
        binding="", violation=float("nan"), evaluations=0, failures=0, generations=0, stopped="", seed=tuning.seed,
        seconds=0.0, reason=reason,
    )  # fmt: skip
    return OptionSearch(record, np.zeros((0, k)), np.zeros((0, 0)), (reason,))
