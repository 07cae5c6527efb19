"""What is not random about the guideway: girders passed one after another, bending girders, a single step."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np
from scipy.optimize import minimize_scalar

from maglev_ctrl.analysis.girder.beam import Girder
from maglev_ctrl.analysis.girder.contacts import element_places, vehicle_on_guideway
from maglev_ctrl.analysis.girder.coupled import coupled_passage, static_midspan
from maglev_ctrl.analysis.girder.critical import CriticalSpeed, critical_speeds
from maglev_ctrl.analysis.girder.estimate import passing_estimate
from maglev_ctrl.analysis.girder.passing import passing_response
from maglev_ctrl.analysis.girder.shapes import PieceShape
from maglev_ctrl.analysis.girder.transient import step_response_peak
from maglev_ctrl.arrays import read_only_any
from maglev_ctrl.errors import Agreement, MaglevError
from maglev_ctrl.study.ride_records import FlexibleSpan, SpanPassing, StepPassing
from maglev_ctrl.study.situation import PADE_ORDER, OptionModel, Situation
from maglev_ctrl.study.sweeps import sweep_values, varied
from maglev_ctrl.systems import Controller, SecondOrderSystem, close_loop
from maglev_ctrl.vehicle import Vehicle
from maglev_ctrl.vehicle.guideway_sources import girder_bow

_FAULTS = (MaglevError, ValueError, ArithmeticError, np.linalg.LinAlgError)
SPEEDS, HARMONICS = 40, 4
"""Evenly spaced speeds of a scan, and harmonics of the span whose critical speeds stand beside them."""


def gap_outputs(vehicle: Vehicle, plant: SecondOrderSystem, *, ends: bool = False) -> tuple[str, ...]:
    """Outputs that tell the gaps of all magnets, each different one once; "<magnet>.gap", "<magnet>.guidance_gap".

    Magnets side by side on a body that does not roll have the same gap. With `ends` only the foremost and rearmost
    magnets of every body are kept.
    """
    names: list[str] = []
    for body in vehicle.bodies:
        own = [magnet for magnet in vehicle.magnets if magnet.body == body.name]
        if ends and own:
            reach = [magnet.position[0] for magnet in own]
            own = [magnet for magnet in own if magnet.position[0] in (min(reach), max(reach))]
        names += [f"{magnet.name}.{kind}" for magnet in own for kind in ("gap", "guidance_gap")]
    seen: set[bytes] = set()
    found = []
    places = element_places(vehicle)
    for name in (name for name in names if name in plant.outputs):
        i = plant.outputs.index(name)
        felt = np.flatnonzero(plant.H_w[i])
        # Equal rows over the coordinates at one place along the track meet the same guideway, cross level apart.
        where = [(places[plant.guideway[k].partition("@")[2]], plant.guideway[k].partition("@")[0]) for k in felt]
        key = plant.H_q[i].tobytes() + repr(where).encode()
        if key not in seen:
            seen.add(key)
            found.append(name)
    return tuple(found)


def girder_shape(model: OptionModel) -> PieceShape | None:
    """The sag of the scenario's girders; None where they do not sag."""
    record = model.scenario.irregularity
    if record is None or record.girder is None or record.girder.sag == 0.0:
        return None
    return _sagging(record.girder.span, record.girder.sag)


@lru_cache(maxsize=8)
def _sagging(span: float, sag: float) -> PieceShape:
    """One record for equal girders, so that its harmonics are worked out once."""
    return PieceShape.from_source(girder_bow("girder", span=span, rise=-sag))


def largest_gap_change(
    model: OptionModel,
    vehicle: Vehicle,
    plant: SecondOrderSystem,
    law: Controller | None,
    situation: Situation,
    outputs: Sequence[str],
) -> dict[str, float]:
    """Largest change (m) of gaps and strokes as the girders pass, zero without girders; by their first harmonics.

    `span_passing` says how near that is to the exact peaks at the design point.

    Raises
    ------
    NotStable : the closed loop is not stable
    """
    shape = girder_shape(model)
    if shape is None or not outputs:
        return dict.fromkeys(outputs, 0.0)
    closed = plant if law is None else close_loop(plant, law)
    found = passing_estimate(
        closed, shape, speed=situation.speed, places=element_places(vehicle), outputs=tuple(outputs)
    )  # fmt: skip
    return dict(zip(outputs, found.tolist(), strict=True))


def span_passing(model: OptionModel, controller: Controller | None) -> SpanPassing | None:
    """Girders passed at the speeds of the sweep; None where they do not sag."""
    shape, record = girder_shape(model), model.scenario.irregularity
    if shape is None or record is None or record.girder is None:
        return None
    empty = read_only_any(np.zeros(0))
    blank = SpanPassing(
        span=record.girder.span, sag=record.girder.sag, speeds=empty, gap=empty, acceleration=empty,
        design_gap=np.nan, design_acceleration=np.nan, worst_speed=np.nan, worst_gap=np.nan, worst="",
        check=np.nan, reason="",
    )  # fmt: skip
    try:
        return _scanned(model, controller, shape, blank)
    except _FAULTS as fault:
        return replace(blank, reason=f"{fault}")


def _scanned(model: OptionModel, controller: Controller | None, shape: PieceShape, blank: SpanPassing) -> SpanPassing:
    """Scan and climb by the first harmonics; what they find is told by the exact method."""
    design = Situation.of_design(model.scenario)
    vehicle = model.vehicle()
    places = element_places(vehicle)

    def closed(speed: float) -> SecondOrderSystem:
        return model.closed_of(vehicle, varied(design, "speed", speed), controller)

    here = closed(design.speed)
    gaps = gap_outputs(vehicle, here, ends=True)
    felt = tuple(name for name in (f"{vehicle.bodies[0].name}.heave.acceleration",) if name in here.outputs)
    outputs = (*gaps, *felt)

    def peaks(speed: float) -> tuple[float, float]:
        found = passing_estimate(closed(speed), shape, speed=speed, places=places, outputs=outputs)
        return float(np.max(found[: len(gaps)])), float(found[-1]) if felt else float("nan")

    low, high = _range(model, design.speed)
    critical = critical_speeds(here, span=shape.span, speeds=(low, high), harmonics=HARMONICS)
    speeds = np.unique([*np.linspace(low, high, SPEEDS), *(one.speed for one in critical)])
    scanned, unstable = np.full((2, len(speeds)), np.nan), ""
    for i, speed in enumerate(speeds.tolist()):
        try:
            scanned[:, i] = peaks(speed)
        except MaglevError as fault:
            unstable = unstable or f"not at every speed: {speed * 3.6:.4g} km/h: {fault}"
    if np.all(np.isnan(scanned[0])):
        return replace(blank, reason=unstable)
    best = int(np.nanargmax(scanned[0]))
    bounds = float(speeds[max(best - 1, 0)]), float(speeds[min(best + 1, len(speeds) - 1)])
    climbed = minimize_scalar(
        lambda v: -peaks(float(v))[0], bounds=bounds, method="bounded", options={"xatol": 1e-3 * high, "maxiter": 12}
    )
    worst = float(climbed.x) if -float(climbed.fun) > scanned[0, best] else float(speeds[best])
    exact = [_exact(closed(v), shape, v, places, gaps, felt) for v in (design.speed, worst)]
    return replace(
        blank,
        speeds=read_only_any(speeds),
        gap=read_only_any(scanned[0]),
        acceleration=read_only_any(scanned[1]),
        design_gap=exact[0][0],
        design_acceleration=exact[0][1],
        worst_speed=worst,
        worst_gap=exact[1][0],
        worst=_words(worst, critical, at_limit=min(worst - low, high - worst) <= 1e-3 * high),
        check=max(one[2] for one in exact),
        reason="; ".join(dict.fromkeys(part for part in (*(one[3] for one in exact), unstable) if part)),
    )


def _range(model: OptionModel, speed: float) -> tuple[float, float]:
    """Speeds looked at: those of the sweep, or from half the design speed to a fifth more than it."""
    swept = dict(sweep_values(model.scenario)).get("speed")
    low, high = (0.5 * speed, 1.2 * speed) if swept is None else (float(swept[0]), float(swept[-1]))
    return max(low, 0.02 * high), high


def _exact(
    closed: SecondOrderSystem, shape: PieceShape, speed: float, places: Mapping[str, float], gaps: tuple[str, ...],
    felt: tuple[str, ...],
) -> tuple[float, float, float, str]:  # fmt: skip
    """Largest gap change and acceleration by two methods, their difference, and what speaks against them."""
    found = passing_estimate(closed, shape, speed=speed, places=places, outputs=gaps)
    worst = gaps[int(np.argmax(found))]
    told = passing_response(closed, shape, speed=speed, places=places, outputs=(worst, *felt))
    doubts = [one.reason for one in told.peaks if one.agreement is Agreement.UNRESOLVED]
    acceleration = told.peaks[-1].peak if felt else float("nan")
    return told.of(worst).peak, acceleration, max(one.difference for one in told.peaks), "; ".join(doubts)


def _words(speed: float, critical: Sequence[CriticalSpeed], *, at_limit: bool) -> str:
    near = min(critical, key=lambda one: abs(one.speed - speed), default=None)
    if near is None or abs(near.speed / speed - 1.0) > 0.1:
        return "no mode is met there" + (", the end of the range" if at_limit else "")
    order = {1: "the girders meet", 2: "the second harmonic of the girders meets"}
    name = order.get(near.order, f"harmonic {near.order} of the girders meets")
    return f"{name} the mode of {near.frequency:.3g} Hz"


def flexible_span(model: OptionModel, controller: Controller | None) -> FlexibleSpan | None:
    """The vehicle on girders that bend under it, at the design speed; None where the scenario has none."""
    record = model.scenario.irregularity
    if record is None or record.girder is None or record.girder.flexible is None:
        return None
    beam = record.girder.flexible
    girder = Girder(
        record.girder.span, bending_stiffness=beam.bending_stiffness, mass_per_length=beam.line_mass,
        damping_ratio=beam.damping_ratio, modes=beam.modes,
    )  # fmt: skip
    speed = model.scenario.operating.speed
    ratio = speed / (2.0 * girder.first_frequency * girder.span)
    nothing = float("nan")
    try:
        design = Situation.of_design(model.scenario)
        vehicle, balanced = model.balance(design)
        law = model.law_at(design, controller)
        on = vehicle_on_guideway(vehicle, balanced, controller=law, pade_order=PADE_ORDER)
        gaps = gap_outputs(vehicle, on.closed)
        felt = f"{vehicle.bodies[0].name}.heave.acceleration"
        outputs = (*gaps, felt) if felt in on.closed.outputs else gaps
        # The sag is the girder bent under the vehicle: here it bends by itself.
        found = coupled_passage(on, girder, speed=speed, outputs=outputs)
        words = {True: "stable", False: "not stable", None: "unresolved: within the error of the multipliers"}
        return FlexibleSpan(
            frequency=girder.first_frequency, speed_ratio=ratio, deflection=found.deflection,
            static_deflection=static_midspan(on, girder), gap=float(np.max(found.peaks[: len(gaps)])),
            acceleration=float(found.peaks[-1]) if felt in outputs else nothing, stable=words[found.stable],
            reason=found.reason,
        )  # fmt: skip
    except _FAULTS as fault:
        return FlexibleSpan(
            girder.first_frequency, ratio, nothing, nothing, nothing, nothing, "not evaluated", f"{fault}"
        )  # fmt: skip


def step_passing(model: OptionModel, controller: Controller | None) -> StepPassing | None:
    """A single step passed at the design speed; None where the scenario has none."""
    record = model.scenario.irregularity
    if record is None or record.step is None:
        return None
    nothing = float("nan")
    blank = StepPassing(record.step.height, record.step.ramp, nothing, nothing, "")
    try:
        design = Situation.of_design(model.scenario)
        vehicle = model.vehicle()
        closed = model.closed_of(vehicle, design, controller)
        gaps = gap_outputs(vehicle, closed)
        felt = tuple(n for n in (f"{vehicle.bodies[0].name}.heave.acceleration",) if n in closed.outputs)
        found = step_response_peak(
            closed, height=record.step.height, length=record.step.ramp, speed=design.speed,
            places=element_places(vehicle), outputs=(*gaps, *felt),
        )  # fmt: skip
        peaks = np.array([one.peak for one in found.peaks])
        return replace(
            blank, gap=float(np.max(peaks[: len(gaps)])), acceleration=float(peaks[-1]) if felt else nothing
        )  # fmt: skip
    except _FAULTS as fault:
        return replace(blank, reason=f"{fault}")
