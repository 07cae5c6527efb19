"""One option simulated with the full force map, and its linear verdicts held against what happens there."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from maglev_ctrl.analysis.simulation.cycles import limit_cycle
from maglev_ctrl.analysis.simulation.records import Event, Limits, Trajectory
from maglev_ctrl.analysis.simulation.run import simulate
from maglev_ctrl.arrays import FloatArray, read_only_any
from maglev_ctrl.scenario import OptionRecord, Scenario
from maglev_ctrl.scenario.tuning_schema import Simulation
from maglev_ctrl.study.law import designed_option
from maglev_ctrl.study.nonlinear.compared import compared_growth, compared_spreads, compared_tongue
from maglev_ctrl.study.nonlinear.edges import compared_boundaries, returned_starts
from maglev_ctrl.study.nonlinear.records import Compared, NonlinearStudy, SimulatedEvent, SimulatedSignal
from maglev_ctrl.study.nonlinear.tracks import SimulatedTracks, simulated_tracks
from maglev_ctrl.study.situation import OptionModel, Situation
from maglev_ctrl.synthesis.discretise import discretise
from maglev_ctrl.systems import Controller
from maglev_ctrl.vehicle import Equilibrium, Vehicle
from maglev_ctrl.vehicle.elements import GUIDEWAY

Step = Callable[[str], None]
SAMPLING = 0.004
"""s between the samples kept; a sampled law has its own."""
SHOWN = 1200
"""Samples of a run that a figure shows."""
DECAYS = 4.0
"""A run's start has decayed after so many time constants of the slowest mode."""
LONGEST_SETTLING = 3.0
"""Times the duration that a start may be given to decay."""


@dataclass(frozen=True, eq=False, slots=True)
class SimulatedOption:
    """An option ready to be simulated: its vehicle at an equilibrium, its law as it runs."""

    model: OptionModel
    vehicle: Vehicle
    balanced: Equilibrium
    continuous: Controller | None
    controller: Controller | None
    situation: Situation
    request: Simulation

    @classmethod
    def of(
        cls, model: OptionModel, controller: Controller | None, request: Simulation, *, speed: float | None = None
    ) -> SimulatedOption:
        """The option at the design point, or at another speed (m/s).

        Raises
        ------
        ModelError : there is no equilibrium, or the law cannot be sampled
        OutOfDomain : the forces are not known there
        """
        design = Situation.of_design(model.scenario)
        situation = design if speed is None else replace(design, speed=speed)
        vehicle, balanced = model.balance(situation)
        law = model.law_at(situation, controller)
        period = request.sampling_period
        runs = law if law is None or period is None else discretise(law, period)
        return cls(model, vehicle, balanced, law, runs, situation, request)

    @property
    def limits(self) -> Limits:
        """What ends a run: magnets that touch, strokes at their stops."""
        ride = self.model.scenario.ride
        strokes = {}
        if ride.largest_stroke is not None:
            between = [link.name for link in self.vehicle.links if GUIDEWAY not in (link.body, link.to)]
            strokes = dict.fromkeys(between, ride.largest_stroke)
        return Limits(ride.smallest_height, ride.smallest_gap, strokes=strokes)

    @property
    def sampling(self) -> float:
        """s between samples that are kept."""
        period = self.request.sampling_period
        return SAMPLING if period is None else max(round(SAMPLING / period), 1) * period


def simulate_option(
    scenario: Scenario,
    option: OptionRecord,
    request: Simulation,
    *,
    speed: float | None = None,
    step: Step = lambda what: None,
    everything: bool = True,
) -> tuple[NonlinearStudy, Trajectory]:
    """Design an option, simulate it, and compare.

    Parameters
    ----------
    speed : m/s, in place of the design speed
    step : told what is being done
    everything : False leaves out boundaries, tongue and region of attraction, which take longest

    Raises
    ------
    ModelError : there is no equilibrium, or the law does not exist
    OutOfDomain : the forces are not known there
    """
    step("control law")
    model, design = designed_option(scenario, option)
    controller = None if design is None else design.controller
    return nonlinear_study(model, controller, request, speed=speed, step=step, everything=everything)


def nonlinear_study(
    model: OptionModel,
    controller: Controller | None,
    request: Simulation,
    *,
    speed: float | None = None,
    step: Step = lambda what: None,
    everything: bool = True,
) -> tuple[NonlinearStudy, Trajectory]:
    """The nonlinear check of an option whose law is known; see `simulate_option`."""
    started = time.perf_counter()
    one = SimulatedOption.of(model, controller, request, speed=speed)
    step("small motions")
    growth, decay = compared_growth(one)
    rough = model.scenario.irregularity is not None
    settle = _settling(decay, request)
    step(f"{request.runs} runs of {settle + request.duration:.4g} s")
    tracks = _tracks(one, settle + request.duration) if rough else None
    found = simulate(
        one.vehicle, one.balanced, duration=settle + request.duration, controller=one.controller,
        track=None if tracks is None else tracks.tracks, start=None if rough else _push(one), runs=request.runs,
        seed=request.seed, limits=one.limits, sampling=one.sampling, computation=request.computing_delay,
    )  # fmt: skip
    rows: list[Compared] = [growth]
    if tracks is not None and decay < 0.0:
        step("standard deviations")
        rows += compared_spreads(one, found, tracks, discard=settle)
    attraction: tuple[tuple[str, float, int, int], ...] = ()
    if everything:
        if model.scenario.periodic is not None:
            step("parametric tongue")
            rows += compared_tongue(one)
        step("stability boundaries")
        rows += compared_boundaries(one)
        if decay < 0.0:
            step("region of attraction")
            attraction = returned_starts(one, decay)
    names = _shown(one, found)
    every = max(int(np.ceil(len(found.time) / SHOWN)), 1)
    study = NonlinearStudy(
        runs=request.runs, duration=request.duration, seed=request.seed, step=found.step, step_error=found.step_error,
        speed=one.situation.speed, compared=tuple(rows),
        events=tuple(_event(event) for event in found.events),
        saturated=tuple(
            (actuator.name, float(np.mean(found.saturation[actuator.name])))
            for actuator in one.vehicle.actuators if actuator.force_limit is not None
        ),
        limit_cycle=_cycle(found, names[0][0], decay), attraction=attraction,
        time=read_only_any(found.time[::every]),
        signals=tuple(SimulatedSignal(name, unit, _thinned(found, name, every)) for name, unit in names),
        assumptions=_assumptions(one, tracks, settle), seconds=time.perf_counter() - started,
    )  # fmt: skip
    return study, found


def _settling(decay: float, request: Simulation) -> float:
    """Time after which a start has decayed, within bounds."""
    if decay >= 0.0:
        return request.settle
    return float(np.clip(DECAYS / -decay, request.settle, LONGEST_SETTLING * request.duration))


def _tracks(one: SimulatedOption, duration: float) -> SimulatedTracks:
    return simulated_tracks(
        one.model, one.vehicle, speed=one.situation.speed, duration=duration, runs=one.request.runs,
        seed=one.request.seed,
    )  # fmt: skip


def _push(one: SimulatedOption) -> dict[str, FloatArray]:
    """Without a rough guideway: a start a hundredth of the height away, other in every run."""
    heave = [name for name in one.vehicle.dofs if name.endswith((".heave", ".sway"))]
    random = np.random.default_rng(one.request.seed)
    size = 0.01 * one.vehicle.reference_height
    return {name: size * random.standard_normal(one.request.runs) for name in heave}


def _event(event: Event) -> SimulatedEvent:
    kind = {"contact": "contact", "data": "outside the force data", "diverged": "diverged"}[event.kind]
    return SimulatedEvent(event.run, event.time, kind, event.element, event.speed, event.reason)


def _shown(one: SimulatedOption, found: Trajectory) -> list[tuple[str, str]]:
    """Signals for the figure: the car, the foremost gap, one stroke, the first actuator."""
    car = one.vehicle.bodies[0].name
    magnets = sorted(one.vehicle.magnets, key=lambda magnet: -magnet.position[0])
    wanted = [
        *((f"{magnets[0].name}.height", "m") for _ in magnets[:1]),
        *((f"{magnet.name}.clearance", "m") for magnet in magnets[:1] if magnet.side),
        (f"{car}.heave.acceleration", "m/s^2"), (f"{car}.sway.acceleration", "m/s^2"),
        *((f"{actuator.name}.applied", "N") for actuator in one.vehicle.actuators[:1]),
    ]  # fmt: skip
    kept = [(name, unit) for name, unit in wanted if name in found.signals]
    return kept or [(name, "m") for name in one.vehicle.dofs[:1]]


def _thinned(found: Trajectory, name: str, every: int) -> FloatArray:
    return read_only_any(np.asarray(found.signals[name])[0, ::every])


def _cycle(found: Trajectory, name: str, decay: float) -> str:
    if decay < 0.0:
        return ""
    cycle = limit_cycle(found, name)
    if not cycle.periodic:
        return f"no limit cycle: {cycle.reason}" if cycle.reason else ""
    hertz = cycle.frequency / (2.0 * np.pi)
    return f"limit cycle of {name}: {hertz:.4g} Hz, amplitude {1e3 * cycle.amplitude:.4g} mm"


def _assumptions(one: SimulatedOption, tracks: SimulatedTracks | None, settle: float) -> tuple[str, ...]:
    period = one.request.sampling_period
    law = "there is no law" if one.controller is None else (
        "the law runs in continuous time" if period is None else f"the law is sampled every {1e3 * period:.4g} ms"
    )  # fmt: skip
    rough = "the guideway is smooth; runs start off the equilibrium" if tracks is None else tracks.words
    return (
        f"Guideway: {rough}.",
        f"The first {settle:.4g} s of every run are left out of its statistics.",
        f"Control: {law}; delays are exact, forces end at their limits, sensors have their noise.",
        "Magnet forces follow the full force map with every magnet's own height, gap and speed; rotations are finite.",
    )
