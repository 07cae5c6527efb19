"""`simulate`: one call from a vehicle, its law and a track to the trajectories of many runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from maglev_ctrl.analysis.simulation.events import Bounds
from maglev_ctrl.analysis.simulation.ground import Ground
from maglev_ctrl.analysis.simulation.integrate import Integration, Outcome, Problem
from maglev_ctrl.analysis.simulation.loop import Law, Schedule
from maglev_ctrl.analysis.simulation.motion import Equations
from maglev_ctrl.analysis.simulation.records import Limits, Track, Trajectory
from maglev_ctrl.analysis.simulation.store import Store
from maglev_ctrl.arrays import FloatArray, read_only, read_only_any
from maglev_ctrl.guideway import Modulation
from maglev_ctrl.systems import Controller, SecondOrderSystem, close_loop
from maglev_ctrl.vehicle import Equilibrium, Vehicle, linearize

SAMPLING = 0.004
"""Interval of samples unless told otherwise, s: vibration counts up to 80 Hz, and 125 Hz is half the rate."""

STEP_TOLERANCE = 1e-4
"""Largest `step_error` that is accepted before the step is halved again."""

STEP_SHARE = 0.5
"""First step tried, times the magnitude of the fastest pole."""

MAXIMUM_HALVINGS = 5

CHECKED_SHARE = 0.1
CHECKED_STEPS = 40
"""How much of the duration, and at least how many steps, a run with half the step is compared over."""

STILL = 1e-12
"""Share of the reference height below which a coordinate counts as not moved, where steps are compared."""


def simulate(
    vehicle: Vehicle,
    equilibrium: Equilibrium,
    *,
    duration: float,
    controller: Controller | None = None,
    track: Track | Sequence[Track] | None = None,
    modulation: Modulation | None = None,
    start: Mapping[str, ArrayLike] | None = None,
    runs: int = 1,
    seed: int = 0,
    limits: Limits | None = None,
    sampling: float | None = None,
    computation: float = 0.0,
    noise: bool = True,
    signals: Sequence[str] | None = None,
    step: float | None = None,
) -> Trajectory:
    """The nonlinear motion of a vehicle about an equilibrium, many runs at a time.

    Parameters
    ----------
    duration : s
    controller : continuous, or sampled (`dt`): then its commands are held from sample to sample
    track : one for all runs or one for each; the place x = 0 is under the vehicle's origin at time 0
    modulation : of the magnets' stiffness along the track, as in `vehicle.stiffness_modulation`
    start : initial states by name as in `linearize(...).states`, increments from the equilibrium; a number or (runs,)
    runs : how many
    seed : of the sensors' noise, with the run's number
    sampling : s between samples that are kept, 4 ms when left out; with a sampled law a whole multiple or a whole part
        of its period, the one nearest to 4 ms when left out
    computation : s from a sample to the command that follows from it
    noise : whether sensors have theirs
    signals : which to keep; all of `Trajectory.signals` when left out
    step : s, largest; from the fastest pole of the linear model when left out

    Raises
    ------
    ValueError : a name that is unknown, a number out of range, sampling that does not fit the law's period

    Examples
    --------
    A weight on a spring, let go 10 mm from its equilibrium, after half a period:

    >>> from maglev_ctrl.vehicle import Body, OperatingPoint, SpringDamper, equilibrium
    >>> leg = SpringDamper("leg", "car", stiffness=4000.0)
    >>> cart = Vehicle("cart", (Body("car", 10.0),), connections=(leg,), reference_height=0.1)
    >>> rest = equilibrium(cart, OperatingPoint(0.0, 0.1))
    >>> found = simulate(cart, rest, duration=np.pi / 20.0, start={"car.heave": 0.01}, sampling=np.pi / 200.0)
    >>> round(float(found.of("car.heave")[0, -1]), 6), found.events
    (-0.01, ())
    """
    interval = _interval(controller) if sampling is None else sampling
    _check(duration=duration, sampling=interval, step=step)
    if runs < 1:
        raise ValueError(f"runs: expected at least 1, got {runs}")
    tracks = _tracks(track, runs)
    system = linearize(vehicle, equilibrium, pade_order=0)
    allowed = limits or Limits()
    equations = Equations.of(vehicle, equilibrium, system, commands=dict(allowed.commands))
    law = None
    if controller is not None:
        law = Law.of(vehicle, system, controller, computation=computation, noise=noise)
    problem = Problem(
        equations=equations,
        law=law,
        ground=Ground.of(vehicle, system.guideway, speed=equilibrium.at.speed, tracks=tracks),
        modulation=modulation,
        bounds=Bounds.of(vehicle, equations, allowed),
        start=_starting(system, start or {}, runs),
        seed=seed,
    )
    chosen = _first_step(system, law, controller, interval) if step is None else min(step, _shortest_delay(law))
    commands = () if controller is None else controller.commands

    def integrated(width: float, length: float, kept: Sequence[str] | None) -> tuple[Store, Outcome, Schedule]:
        schedule = Schedule.of(law, sampling=interval, step=width)
        frames = max(int(np.ceil(length / schedule.frame - 1e-9)), 1)
        frames = -(-frames // schedule.every) * schedule.every
        samples = frames // schedule.every * int(np.sum(schedule.kept)) + 1
        store = Store(vehicle, equations, runs=runs, samples=samples, signals=kept, commands=commands)
        return store, Integration(problem, schedule).run(store, frames), schedule

    responding = problem.ground.responds
    checked = min(duration, max(CHECKED_SHARE * duration, CHECKED_STEPS * chosen))
    error, coarse = np.nan, None
    for _ in range(0 if responding else MAXIMUM_HALVINGS):
        coarse = coarse or integrated(chosen, checked, system.dofs)
        fine = integrated(0.5 * chosen, checked, system.dofs)
        error = _difference(coarse[0], fine[0], STILL * vehicle.reference_height)
        if error <= STEP_TOLERANCE or step is not None:
            break
        chosen, coarse = 0.5 * chosen, fine
    store, outcome, schedule = integrated(chosen, duration, signals)
    scale = max(_largest(store.kinetic), _largest(store.work), 1e-300)
    change = store.kinetic - store.kinetic[:, :1] - store.work
    return Trajectory(
        time=read_only(interval * np.arange(store.kinetic.shape[1]), name="time"),
        signals=store.signals(),
        events=outcome.events,
        ends=read_only(outcome.ends, name="ends"),
        saturation={name: read_only_any(outcome.saturation[:, i]) for i, name in enumerate(system.inputs)},
        kinetic=read_only_any(store.kinetic),
        work=read_only_any(store.work),
        energy_error=_largest(change) / scale,
        step=float(np.max(schedule.widths)),
        step_error=error,
        checked=0.0 if responding else checked,
    )


def _interval(controller: Controller | None) -> float:
    period = None if controller is None else controller.dt
    if period is None:
        return SAMPLING
    return round(SAMPLING / period) * period if period <= SAMPLING else period / np.ceil(period / SAMPLING)


def _largest(values: FloatArray) -> float:
    """Largest modulus of what is known; 0 where every run ended at once."""
    known = np.abs(values[np.isfinite(values)])
    return float(np.max(known, initial=0.0))


def _check(*, duration: float, sampling: float, step: float | None) -> None:
    for name, value in (("duration", duration), ("sampling", sampling), ("step", 1.0 if step is None else step)):
        if not (np.isfinite(value) and value > 0.0):
            raise ValueError(f"{name}: expected a positive time in s, got {value}")


def _tracks(track: Track | Sequence[Track] | None, runs: int) -> tuple[Track, ...]:
    if track is None:
        return ()
    if isinstance(track, Sequence):
        if len(track) not in (1, runs):
            raise ValueError(f"track: expected one, or one for each of {runs} runs, got {len(track)}")
        given = tuple(track)
    else:
        given = (track,)
    if len(given) < runs and getattr(given[0], "responds", False):
        raise ValueError(f"track: expected one for each of {runs} runs, because it moves with the vehicle, got one")
    return given


def _starting(
    system: SecondOrderSystem, start: Mapping[str, ArrayLike], runs: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Initial positions, velocities and internal states, (r, *) each."""
    velocities = tuple(f"{name}.velocity" for name in system.dofs)
    groups = (system.dofs, velocities, system.internal)
    parts = tuple(np.zeros((runs, len(group))) for group in groups)
    for name, value in start.items():
        values = np.asarray(value, dtype=np.float64)
        if values.shape not in ((), (runs,)) or not np.all(np.isfinite(values)):
            raise ValueError(f"start[{name}]: expected a finite number or ({runs},) of them, got {value!r}")
        for part, group in zip(parts, groups, strict=True):
            if name in group:
                part[:, group.index(name)] = values
                break
        else:
            raise ValueError(f"start: {name!r} is no state; the states are {', '.join(sum(groups, ()))}")
    return parts[0], parts[1], parts[2]


def _first_step(system: SecondOrderSystem, law: Law | None, controller: Controller | None, sampling: float) -> float:
    """A step that resolves the fastest pole of the linear model, and the shortest delay of a continuous law."""
    closed = system
    if law is not None and not law.sampled and controller is not None:
        closed = close_loop(system, controller)
    fastest = float(np.max(np.abs(np.linalg.eigvals(closed.state_matrix())), initial=0.0))
    chosen = min(sampling, STEP_SHARE / fastest if fastest > 0.0 else sampling)
    return min(chosen, _shortest_delay(law))


def _shortest_delay(law: Law | None) -> float:
    """Longest step with which the commands of a continuous law that arrive within it are known; infinite without."""
    if law is None or law.sampled:
        return np.inf
    return float(np.min(law.delays[~law.immediate], initial=np.inf))


def _difference(coarse: Store, fine: Store, still: float) -> float:
    """Largest difference of a coordinate between two runs, relative to its largest displacement in any run."""
    worst = 0.0
    one, other = coarse.signals(), fine.signals()
    for name, values in other.items():
        both = np.isfinite(values) & np.isfinite(one[name])
        size = float(np.max(np.abs(values[both]), initial=0.0))
        if size > still:
            worst = max(worst, float(np.max(np.abs(values - one[name])[both])) / size)
    return worst
