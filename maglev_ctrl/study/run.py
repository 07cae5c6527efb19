"""run(scenario) -> Comparison: the one recipe of the whole flow, one option a task."""

from __future__ import annotations

import platform
import sys
import time
from collections.abc import Callable
from contextlib import closing
from datetime import UTC, datetime
from functools import partial
from importlib.metadata import PackageNotFoundError, version

from threadpoolctl import threadpool_limits

from maglev_ctrl._version import __version__
from maglev_ctrl.errors import ModelError, OutOfDomain
from maglev_ctrl.scenario import OptionRecord, Scenario, build_vehicle, describe_option
from maglev_ctrl.study.eddy_current import solve_forces
from maglev_ctrl.study.forces import describe_forces
from maglev_ctrl.study.modulation import describe_periodicity
from maglev_ctrl.study.option import study_option
from maglev_ctrl.study.records import Comparison, OptionStudy
from maglev_ctrl.study.requirements import not_evaluated
from maglev_ctrl.study.situation import OptionModel
from maglev_ctrl.study.spread import one_blas_thread
from maglev_ctrl.study.workers import Lost, shared

Progress = Callable[[str, float], None]
PACKAGES = ("numpy", "scipy", "matplotlib", "pydantic", "pint", "plotly", "typst")
_SOLVING = 0.4
"""Share of the progress that goes to eddy-current forces not solved before."""


def run(scenario: Scenario, *, jobs: int = 1, progress: Progress | None = None) -> Comparison:
    """Study every option of a scenario against its requirements.

    Parameters
    ----------
    scenario : as read by `scenario.load`
    jobs : processes; with more than one, call from under `if __name__ == "__main__":` as for any process pool
    progress : told what was done and the fraction of the whole, 0 to 1

    Raises
    ------
    ValueError : jobs is below one
    ModelError : the processes cannot start

    Examples
    --------
    >>> from maglev_ctrl.scenario import load
    >>> comparison = run(load("scenarios/paper/heave_surge.toml"))   # doctest: +SKIP
    >>> [option.verdict.value for option in comparison.options]      # doctest: +SKIP
    ['PASS']
    """
    if jobs < 1:
        raise ValueError(f"jobs: expected one or more, got {jobs}")
    started = time.perf_counter()
    tell = progress or (lambda what, fraction: None)
    scenario, tell = with_forces(scenario, jobs, tell)
    options = scenario.options
    workers = min(jobs, len(options))
    studies = _serial(scenario, tell) if workers == 1 else _parallel(scenario, workers, tell)
    return Comparison(
        title=scenario.title,
        description=scenario.description,
        scenario_path=str(scenario.path),
        scenario_text=scenario.text,
        scenario_hash=scenario.hash,
        sources=tuple(sorted(scenario.sources.items())),
        assumptions=(*scenario.assumptions, *_periodicity(scenario)),
        forces=describe_forces(scenario, build_vehicle(scenario)),
        design_speed=scenario.operating.speed,
        design_height=scenario.operating.height,
        options=tuple(studies[option.name] for option in options),
        versions=versions(),
        created=datetime.now(UTC).isoformat(timespec="seconds"),
        seconds=time.perf_counter() - started,
    )


def _periodicity(scenario: Scenario) -> tuple[str, ...]:
    """What the guideway's sources make of the forces, where the file gives sources; why it cannot be told."""
    if scenario.periodic is None or not scenario.periodic.sources:
        return ()
    try:
        return describe_periodicity(scenario)
    except (ModelError, OutOfDomain) as fault:
        return (f"Periodic forces: not evaluated: {fault}.",)


def with_forces(scenario: Scenario, jobs: int, tell: Progress) -> tuple[Scenario, Progress]:
    """The scenario with eddy-current forces solved, and where the rest of the study's progress is told."""
    reached = 0.0

    def solving(what: str, fraction: float) -> None:
        nonlocal reached
        if _SOLVING * fraction >= reached + 0.05:  # a line now and then is enough
            reached = _SOLVING * fraction
            tell(f"forces: {what}", reached)

    solved = solve_forces(scenario, jobs=jobs, progress=solving)
    if reached == 0.0:
        return solved, tell
    return solved, lambda what, fraction: tell(what, _SOLVING + (1.0 - _SOLVING) * fraction)


def _serial(scenario: Scenario, tell: Progress) -> dict[str, OptionStudy]:
    found: dict[str, OptionStudy] = {}
    count = len(scenario.options)
    with threadpool_limits(limits=1):
        for i, option in enumerate(scenario.options):

            def step(what: str, name: str = option.label or option.name, done: float = i / count) -> None:
                tell(f"{name}: {what}", done)

            found[option.name] = study_option(scenario, option, step=step)
            tell(f"{option.label or option.name}: done", (i + 1) / count)
    return found


def _parallel(scenario: Scenario, workers: int, tell: Progress) -> dict[str, OptionStudy]:
    """One option a task; each worker keeps to one BLAS thread."""
    found: dict[str, OptionStudy] = {}
    options = scenario.options
    tell(f"{len(options)} options on {workers} processes", 0.0)
    with one_blas_thread(), closing(shared(partial(study_option, scenario), options, workers=workers)) as results:
        for position, result in results:
            option = options[position]
            lost = isinstance(result, Lost)
            found[option.name] = _unstudied(scenario, option, result.reason) if isinstance(result, Lost) else result
            tell(f"{option.label or option.name}: {'not studied' if lost else 'done'}", len(found) / len(options))
    return found


def _unstudied(scenario: Scenario, option: OptionRecord, reason: str) -> OptionStudy:
    """The record of an option that was lost with its process."""
    return OptionStudy(
        name=option.name, label=option.label or option.name, kind=option.kind,
        summary=describe_option(scenario, option), vehicle=OptionModel(scenario, option).vehicle(), failure=reason,
        equilibrium=None, system=None, open_system=None, modes=None, design=None, sweeps=(), locus=None, margins=None,
        margins_reason="", nyquist=(), floquet=None, floquet_reason="",
        requirements=tuple(not_evaluated(requirement, reason) for requirement in scenario.judged), notes=(),
        seconds=0.0,
    )  # fmt: skip


def versions(further: tuple[str, ...] = ()) -> tuple[tuple[str, str], ...]:
    """Name and version of everything a result depends on, `further` packages included."""
    found = [("maglev_ctrl", __version__), ("Python", platform.python_version()), ("platform", sys.platform)]
    for package in (*PACKAGES, *further):
        try:
            found.append((package, version(package)))
        except PackageNotFoundError:
            found.append((package, "not installed"))
    return tuple(found)
