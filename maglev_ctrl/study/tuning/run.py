"""tune(scenario) -> the tuned scenario and the record: every option by the same method, one option a task."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import closing
from functools import partial
from typing import Any, Final

from threadpoolctl import threadpool_limits

from maglev_ctrl.scenario import OptionRecord, Scenario
from maglev_ctrl.scenario.problems import KeyPath
from maglev_ctrl.scenario.rewrite import rewritten
from maglev_ctrl.scenario.tunes import file_values, tuned_quantities
from maglev_ctrl.study.run import with_forces
from maglev_ctrl.study.spread import one_blas_thread
from maglev_ctrl.study.tuning.evaluate import RESERVE, judged_after, judged_in_loop
from maglev_ctrl.study.tuning.figures import objective_axis
from maglev_ctrl.study.tuning.operating_set import operating_set
from maglev_ctrl.study.tuning.option import OptionSearch, tune_option, untuned
from maglev_ctrl.study.tuning.ranking import ranked, shifts
from maglev_ctrl.study.tuning.records import TuningStudy
from maglev_ctrl.study.workers import Lost, shared

Progress = Callable[[str, float], None]
METHOD: Final = "NSGA-II (pymoo), requirements by feasibility rules"


def tune(scenario: Scenario, *, jobs: int = 1, progress: Progress | None = None) -> tuple[Scenario, TuningStudy]:
    """Tune every option of a scenario by the same method, against the same objectives, with the same budget and seed.

    The scenario that comes back has each option's chosen values in it, as its file would have them, for `study.run` to
    judge in full: the laws of the search are not proved, and requirements that only a whole study can judge are not in
    its loop.

    Parameters
    ----------
    scenario : with the table [tuning], as read by `scenario.load`
    jobs : processes; with more than one, call from under `if __name__ == "__main__":` as for any process pool
    progress : told what was done and the fraction of the whole, 0 to 1

    Raises
    ------
    ValueError : jobs is below one, or the scenario has no table [tuning]
    ScenarioProblems : a `[[option.tune]]` that cannot be
    ModelError : the processes cannot start

    Examples
    --------
    >>> from maglev_ctrl.scenario import load
    >>> tuned, study = tune(load("scenarios/compare/four_options.toml"))   # doctest: +SKIP
    >>> study.ranking[0].option                                            # doctest: +SKIP
    'active_secondary'
    """
    if jobs < 1:
        raise ValueError(f"jobs: expected one or more, got {jobs}")
    tuning = scenario.tuning
    if tuning is None:
        raise ValueError("scenario: expected the table [tuning]")
    for option in scenario.options:
        tuned_quantities(scenario, option)  # every fault of the file before any work
    started = time.perf_counter()
    scenario, tell = with_forces(scenario, jobs, progress or (lambda what, fraction: None))
    # The longest searches first: those with a law to be made for every candidate.
    order = sorted(scenario.options, key=lambda one: (not one.tunes, one.control is None))
    workers = min(jobs, len(order))
    found = _serial(scenario, order, tell) if workers == 1 else _parallel(scenario, order, workers, tell)
    searches = [found[option.name] for option in scenario.options]
    requirements = judged_in_loop(scenario)
    axes = tuple(objective_axis(one) for one in tuning.objectives)
    budget = f"{tuning.population} candidates x {tuning.generations} generations"
    study = TuningStudy(
        method=f"{METHOD} with {100.0 * RESERVE:g} % in reserve; {budget}, seed {tuning.seed}",
        in_loop=tuple(one.name for one in requirements),
        after=judged_after(scenario),
        objectives=axes,
        situations=tuple(place.name for place in operating_set(scenario)),
        options=tuple(one.record for one in searches),
        ranking=ranked(searches),
        shifts=shifts(searches, requirements, axes, choose=tuning.choose),
        seconds=time.perf_counter() - started,
    )
    return tuned_scenario(scenario, searches), study


def tuned_scenario(scenario: Scenario, searches: list[OptionSearch]) -> Scenario:
    """The scenario with every option's chosen values in it; options without a result stay as they are.

    Raises
    ------
    ModelError : a chosen value does not fit the file
    """
    values: dict[KeyPath, Any] = {}
    for option, one in zip(scenario.options, searches, strict=True):
        record = one.record
        if record.variables:
            chosen = [float(x) for x in record.front_variables[record.chosen]]
            values |= file_values(tuned_quantities(scenario, option), chosen)
    return rewritten(scenario, values) if values else scenario


def _serial(scenario: Scenario, options: list[OptionRecord], tell: Progress) -> dict[str, OptionSearch]:
    found: dict[str, OptionSearch] = {}
    count = len(options)
    with threadpool_limits(limits=1):
        for i, option in enumerate(options):

            def step(what: str, share: float, name: str = option.label or option.name, done: int = i) -> None:
                tell(f"{name}: {what}", (done + share) / count)

            found[option.name] = tune_option(scenario, option, step=step)
            tell(f"{option.label or option.name}: {_told(found[option.name])}", (i + 1) / count)
    return found


def _parallel(scenario: Scenario, options: list[OptionRecord], workers: int, tell: Progress) -> dict[str, OptionSearch]:
    """One option a task; each worker keeps to one BLAS thread."""
    found: dict[str, OptionSearch] = {}
    tell(f"{len(options)} options on {workers} processes", 0.0)
    with one_blas_thread(), closing(shared(partial(tune_option, scenario), options, workers=workers)) as results:
        for position, result in results:
            option = options[position]
            found[option.name] = untuned(scenario, option, result.reason) if isinstance(result, Lost) else result
            tell(f"{option.label or option.name}: {_told(found[option.name])}", len(found) / len(options))
    return found


def _told(one: OptionSearch) -> str:
    record = one.record
    if record.reason:
        return f"not tuned: {record.reason}"
    if not record.feasible:
        return f"no candidate of {record.evaluations} meets every requirement; {record.binding} is missed by most"
    return f"{record.evaluations} candidates, {len(record.front)} on the front"
