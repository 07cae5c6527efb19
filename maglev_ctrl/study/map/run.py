"""survey_map(scenario, request) -> MapStudy: the maps of a scenario's options over the same two quantities."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from maglev_ctrl.analysis.stability_plane import MapEstimate, estimate
from maglev_ctrl.guideway import Modulation
from maglev_ctrl.kernels.radius_engines import radius_engine
from maglev_ctrl.scenario import Scenario
from maglev_ctrl.scenario.quantity_paths import DEPTH
from maglev_ctrl.study.eddy_current import solve_forces
from maglev_ctrl.study.law import designed_option
from maglev_ctrl.study.map.family import OptionFamily
from maglev_ctrl.study.map.option import PLANE_SHARE, option_map, unmapped
from maglev_ctrl.study.map.records import MapQuantity, MapStudy, OptionMap
from maglev_ctrl.study.map.request import AxisRange, MapRequest
from maglev_ctrl.study.map.store import FolderStore, MapFolder
from maglev_ctrl.study.modulation import ScenarioModulation, describe_periodicity, modulation_of
from maglev_ctrl.study.run import versions, with_forces
from maglev_ctrl.study.spread import one_blas_thread
from maglev_ctrl.study.workers import Lost, shared

Progress = Callable[[str, float], None]
_LOOK = 0.5  # s between two looks at how far the processes are


def survey_map(
    scenario: Scenario, request: MapRequest, *, jobs: int = 1, progress: Progress | None = None,
    store_folder: Path | None = None,
) -> MapStudy:  # fmt: skip
    """Map every option of a request.

    Several options share processes; the threads of a process share its plane. What is finished is kept below
    `store_folder`, and the same call goes on from there; the caller removes it (`MapFolder.remove`).

    Parameters
    ----------
    request : from `map_request`
    jobs : processes and threads together; with more than one, call from under `if __name__ == "__main__":`
    progress : told what was done and the fraction of the whole, 0 to 1
    store_folder : folder of the results; None keeps nothing

    Raises
    ------
    ValueError : jobs is below one
    ModelError : the backend is not there, the forces cannot be solved, the sources modulate nothing, or the processes
        cannot start

    Examples
    --------
    >>> from maglev_ctrl.scenario import load
    >>> from maglev_ctrl.study.map.request import map_request
    >>> scenario = load("scenarios/periodic/girder_passing.toml")
    >>> study = survey_map(scenario, map_request(scenario, options=["bare"]))    # doctest: +SKIP
    >>> study.options[0].plane.state.shape                                       # doctest: +SKIP
    (361, 201)
    """
    if jobs < 1:
        raise ValueError(f"jobs: expected one or more, got {jobs}")
    started, tell = time.perf_counter(), _rising(progress or (lambda what, fraction: None))
    radius_engine(request.backend)  # what is not installed is told before anything is computed
    scenario, tell = with_forces(scenario, jobs, tell)
    modulation = modulation_of(scenario)
    sources = describe_periodicity(scenario)
    kept = None if store_folder is None else MapFolder.of(store_folder, scenario, request)
    workers = min(jobs, len(request.options))
    options = (
        _serial(scenario, request, jobs, kept, tell) if workers == 1
        else _parallel(scenario, request, workers, jobs // workers, kept, tell)
    )  # fmt: skip
    return MapStudy(
        title=scenario.title, scenario_path=str(scenario.path), scenario_hash=scenario.hash, name=scenario.name,
        sources=sources, wavelength=modulation.wavelength, depth=modulation.depth,
        x=_shown(request.x, modulation), y=_shown(request.y, modulation), options=options, backend=request.backend,
        notes=_notes(scenario, request, modulation), versions=versions(),
        created=datetime.now(UTC).isoformat(timespec="seconds"), seconds=time.perf_counter() - started,
    )  # fmt: skip


def survey_estimate(scenario: Scenario, request: MapRequest, *, jobs: int = 1) -> MapEstimate:
    """Time and memory the maps of a request would take, from a few points of its first option; nothing is allocated.

    Raises
    ------
    ModelError : there is no equilibrium at the design point, or the option has no law
    OutOfDomain : the forces are not known there
    """
    radius_engine(request.backend)
    scenario = solve_forces(scenario, jobs=jobs)
    record = next(option for option in scenario.options if option.name == request.options[0])
    model, design = designed_option(scenario, record)
    family = OptionFamily.of(model, None if design is None else design.controller, request)
    with threadpool_limits(limits=1):
        one = estimate(
            family, request.x.axis(), request.y.axis(), coverage=request.coverage, threads=1, backend=request.backend
        )  # fmt: skip
    count = len(request.options)
    shared_by = min(jobs, count * max(1, jobs // count))
    return replace(one, seconds=one.seconds * count / shared_by, bytes=one.bytes * count, points=one.points * count)


def _rising(tell: Progress) -> Progress:
    """Progress that never runs backwards; processes and this one may tell of it together."""
    lock, reached = threading.Lock(), 0.0

    def told(what: str, fraction: float) -> None:
        nonlocal reached
        with lock:
            reached = max(reached, fraction)
            tell(what, reached)

    return told


def _serial(
    scenario: Scenario, request: MapRequest, threads: int, kept: MapFolder | None, tell: Progress
) -> tuple[OptionMap, ...]:
    found: list[OptionMap] = []
    with threadpool_limits(limits=1):
        for position, name in enumerate(request.options):
            store = None if kept is None else kept.store(name)
            found.append(option_map(
                scenario, request, name, threads=threads, store=store,
                tell=_noting(store, tell, position, len(request.options)),
            ))  # fmt: skip
    return tuple(found)


def _noting(store: FolderStore | None, tell: Progress, position: int, count: int) -> Progress:
    """Progress of one of several options, also noted where it is kept."""

    def told(what: str, fraction: float) -> None:
        if store is not None:
            store.reach(min(fraction, PLANE_SHARE))  # what follows the plane is not kept
        tell(what, (position + fraction) / count)

    return told


@dataclass(frozen=True, slots=True)
class _Task:
    """The map of one option, for a process."""

    scenario: Scenario
    request: MapRequest
    threads: int
    kept: MapFolder | None

    def __call__(self, name: str) -> OptionMap:
        store = None if self.kept is None else self.kept.store(name)
        return option_map(
            self.scenario, self.request, name, threads=self.threads, store=store,
            tell=_noting(store, lambda what, fraction: None, 0, 1),
        )  # fmt: skip


def _parallel(
    scenario: Scenario, request: MapRequest, workers: int, threads: int, kept: MapFolder | None, tell: Progress
) -> tuple[OptionMap, ...]:
    """One option a task; each process keeps to one BLAS thread."""
    names, found = request.options, dict[str, OptionMap]()
    labels = {option.name: option.label or option.name for option in scenario.options}
    tell(f"{len(names)} options on {workers} processes", 0.0)
    task = _Task(scenario, request, threads, kept)
    with one_blas_thread(), _watched(kept, names, tell), closing(shared(task, names, workers=workers)) as results:
        for position, result in results:
            name, lost = names[position], isinstance(result, Lost)
            found[name] = unmapped(scenario, name, result.reason) if isinstance(result, Lost) else result
            tell(f"{labels[name]}: {'not mapped' if lost else 'done'}", len(found) / len(names))
    return tuple(found[name] for name in names)


@contextmanager
def _watched(kept: MapFolder | None, names: tuple[str, ...], tell: Progress) -> Iterator[None]:
    """While the block runs, told what share of the whole the processes have reached."""
    if kept is None:
        yield
        return
    over = threading.Event()

    def watch() -> None:
        last = 0.0
        while not over.wait(_LOOK):
            reached = kept.reached()
            if reached >= last + 0.01:
                last = reached
                tell(f"{len(names)} options", reached)

    watcher = threading.Thread(target=watch, daemon=True)
    watcher.start()
    try:
        yield
    finally:
        over.set()
        watcher.join()


def _shown(axis: AxisRange, modulation: ScenarioModulation) -> MapQuantity:
    """The axis as people read it; the depth's own value is what the guideway's sources make of it."""
    shown = axis.shown()
    return replace(shown, design=modulation.depth) if axis.quantity.name == DEPTH else shown


def _notes(scenario: Scenario, request: MapRequest, modulation: ScenarioModulation) -> tuple[str, ...]:
    """What the reader must know about the axes."""
    notes: list[str] = []
    for one in request.axes:
        quantity = one.quantity
        if one.bare:
            notes.append(
                f"{quantity.name}: {one.first:g} to {one.last:g} came without a unit and is read in {quantity.unit}."
            )
    chosen = [option for option in scenario.options if option.name in request.options]
    controlled = any(option.control is not None for option in chosen)
    paths = [one.quantity for one in request.axes if one.quantity.path]
    stays = ", ".join(quantity.name for quantity in paths if not quantity.of_law)
    if stays and controlled:
        notes.append(
            f"Control laws stay as designed at the scenario's own values; {stays} changes only what they meet."
        )
    anew = ", ".join(quantity.name for quantity in paths if quantity.of_law)
    if anew:
        notes.append(f"The control law is designed anew at every value of {anew}.")
    left_out = [option.name for option in scenario.options if option.name not in request.options]
    if left_out:
        notes.append(f"Not mapped: {', '.join(left_out)}.")
    return (*notes, *_too_deep(request, modulation), *_off_the_map(request, modulation))


def _off_the_map(request: MapRequest, modulation: ScenarioModulation) -> tuple[str, ...]:
    """Whether the expected depth lies beyond the map's depths."""
    axis = request.axis_of(DEPTH)
    if axis is None or axis.first <= modulation.depth <= axis.last:
        return ()
    return (
        f"The expected depth of modulation, {100.0 * modulation.depth:.3g} %, is not on the map, which runs from "
        f"{100.0 * axis.first:.3g} to {100.0 * axis.last:.3g} %.",
    )


def _too_deep(request: MapRequest, modulation: ScenarioModulation) -> tuple[str, ...]:
    """Whether the map goes to depths at which the stiffness changes its sign within a period."""
    if modulation.pattern is not None:
        limit = 1.0  # unit depth is where the largest harmonic equals the mean
    else:
        wave = Modulation(modulation.wavelength, 1.0, modulation.harmonics)
        along = wave.at(np.linspace(0.0, modulation.wavelength, 64 * len(modulation.harmonics), endpoint=False))
        limit = 1.0 / float(np.max(1.0 - along)) if np.max(1.0 - along) > 0.0 else np.inf
    axis = request.axis_of(DEPTH)
    deepest = max(modulation.depth, 0.0 if axis is None else axis.last)
    if deepest <= limit:
        return ()
    return (
        f"Above a depth of {limit:.3g} the modulation is deeper than the stiffness it modulates: within every period "
        "the magnetic stiffness changes its sign.",
    )
