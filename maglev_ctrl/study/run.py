"""run(scenario) -> Comparison: the one recipe of the whole flow, one option a task."""

from __future__ import annotations

import multiprocessing
import os
import platform
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version

from threadpoolctl import threadpool_limits

from maglev_ctrl._version import __version__
from maglev_ctrl.scenario import OptionRecord, Scenario, build_vehicle
from maglev_ctrl.study.forces import describe_forces
from maglev_ctrl.study.option import study_option
from maglev_ctrl.study.records import Comparison, OptionStudy

Progress = Callable[[str, float], None]
PACKAGES = ("numpy", "scipy", "matplotlib", "pydantic", "pint", "plotly", "typst")
BLAS_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")


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
        assumptions=tuple(scenario.assumptions),
        forces=describe_forces(scenario, build_vehicle(scenario)),
        design_speed=scenario.operating.speed,
        design_height=scenario.operating.height,
        options=tuple(studies[option.name] for option in options),
        versions=_versions(),
        created=datetime.now(UTC).isoformat(timespec="seconds"),
        seconds=time.perf_counter() - started,
    )


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
    context = multiprocessing.get_context("spawn")
    tell(f"{len(scenario.options)} options on {workers} processes", 0.0)
    with _one_blas_thread(), ProcessPoolExecutor(max_workers=workers, mp_context=context) as pool:
        tasks = {pool.submit(_task, scenario, option): option for option in scenario.options}
        try:
            for task in as_completed(tasks):
                option = tasks[task]
                found[option.name] = task.result()
                tell(f"{option.label or option.name}: done", len(found) / len(tasks))
        except BaseException:
            # Ctrl-C or a failed worker: what has not begun is not begun.
            pool.shutdown(wait=False, cancel_futures=True)
            raise
    return found


def _task(scenario: Scenario, option: OptionRecord) -> OptionStudy:
    return study_option(scenario, option)


@contextmanager
def _one_blas_thread() -> Iterator[None]:
    """Environment for new processes, put back afterwards."""
    before = {name: os.environ.get(name) for name in BLAS_THREADS}
    os.environ.update(dict.fromkeys(BLAS_THREADS, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


def _versions() -> tuple[tuple[str, str], ...]:
    found = [("maglev_ctrl", __version__), ("Python", platform.python_version()), ("platform", sys.platform)]
    for package in PACKAGES:
        try:
            found.append((package, version(package)))
        except PackageNotFoundError:
            found.append((package, "not installed"))
    return tuple(found)
