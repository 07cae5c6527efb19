"""survey_design(scenario) -> DesignStudy: every law of a scenario made, proved and sampled, one option a task."""

from __future__ import annotations

import difflib
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from datetime import UTC, datetime
from functools import partial

from threadpoolctl import threadpool_limits

from maglev_ctrl.scenario import OptionRecord, Scenario
from maglev_ctrl.study.design.option import lost_law, study_law
from maglev_ctrl.study.design.records import DesignStudy, LawStudy
from maglev_ctrl.study.run import versions, with_forces
from maglev_ctrl.study.spread import one_blas_thread
from maglev_ctrl.study.workers import Lost, shared

Progress = Callable[[str, float], None]
SOLVERS = ("control", "cvxpy", "clarabel", "osqp")


def chosen_options(scenario: Scenario, names: Sequence[str]) -> tuple[OptionRecord, ...]:
    """The options that have something to design: a control law or a damping budget; only those named, if any are.

    Raises
    ------
    ValueError : a name is unknown or has nothing to design, or no option of the scenario has
    """
    designed = {o.name: o for o in scenario.options if o.control is not None or o.damping_budget is not None}
    if not designed:
        raise ValueError("no option has a control law or a damping budget: there is nothing to design")
    for name in names:
        if name in designed:
            continue
        known = {option.name for option in scenario.options}
        if name in known:
            raise ValueError(f'--option: "{name}" has neither a control law nor a damping budget')
        near = difflib.get_close_matches(name, designed, n=1)
        advice = f'did you mean "{near[0]}"?' if near else f"options with a law: {', '.join(designed)}"
        raise ValueError(f'--option: no option is called "{name}"; {advice}')
    return tuple(option for name, option in designed.items() if not names or name in names)


def survey_design(
    scenario: Scenario, options: Sequence[OptionRecord], *, jobs: int = 1, progress: Progress | None = None
) -> DesignStudy:
    """Design every option's law.

    Parameters
    ----------
    options : as `chosen_options` gives them
    jobs : processes; with more than one, call from under `if __name__ == "__main__":` as for any process pool
    progress : told what was done and the fraction of the whole, 0 to 1

    Raises
    ------
    ValueError : jobs is below one
    ModelError : the processes cannot start
    """
    if jobs < 1:
        raise ValueError(f"jobs: expected one or more, got {jobs}")
    started = time.perf_counter()
    scenario, tell = with_forces(scenario, jobs, progress or (lambda what, fraction: None))
    found: dict[str, LawStudy] = {}
    for one in _studied(scenario, options, min(jobs, len(options)), tell):
        found[one.name] = one
        tell(f"{one.label}: {one.verdict.value}", len(found) / len(options))
    return DesignStudy(
        name=scenario.name,
        title=scenario.title,
        description=scenario.description,
        scenario_path=str(scenario.path),
        scenario_text=scenario.text,
        scenario_hash=scenario.hash,
        sources=tuple(sorted(scenario.sources.items())),
        assumptions=scenario.assumptions,
        options=tuple(found[option.name] for option in options),
        versions=versions(SOLVERS),
        created=datetime.now(UTC).isoformat(timespec="seconds"),
        seconds=time.perf_counter() - started,
    )


def _studied(scenario: Scenario, options: Sequence[OptionRecord], workers: int, tell: Progress) -> Iterator[LawStudy]:
    if workers == 1:
        with threadpool_limits(limits=1):
            for i, option in enumerate(options):
                step = partial(_step, tell, option.label or option.name, i / len(options))
                yield study_law(scenario, option, step=step)
        return
    tell(f"{len(options)} laws on {workers} processes", 0.0)
    with one_blas_thread(), closing(shared(partial(study_law, scenario), options, workers=workers)) as results:
        for position, result in results:
            if isinstance(result, Lost):
                yield lost_law(scenario, options[position], result.reason)
            else:
                yield result


def _step(tell: Progress, label: str, fraction: float, words: str) -> None:
    tell(f"{label}: {words}", fraction)
