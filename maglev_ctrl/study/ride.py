"""The ride of one option: random guideway at the design point and over its sweeps, girders, a step, masks."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import lru_cache

import numpy as np

from maglev_ctrl.analysis.response.channels import Noise
from maglev_ctrl.analysis.response.records import PsdMask, RideResponse
from maglev_ctrl.analysis.response.requests import Clearance, Passenger, Port, guideway_places, link_port
from maglev_ctrl.analysis.response.ride import ride_response
from maglev_ctrl.arrays import read_only_any
from maglev_ctrl.errors import MaglevError, ModelError
from maglev_ctrl.guideway.correlation import track_inputs
from maglev_ctrl.scenario.track import seats, track_spectra
from maglev_ctrl.study.passing import flexible_span, gap_outputs, largest_gap_change, span_passing, step_passing
from maglev_ctrl.study.ride_records import MaskResult, RidePoint, RideStudy, SpanPassing
from maglev_ctrl.study.situation import OptionModel, Situation
from maglev_ctrl.study.sweeps import DISPLAY, sweep_values, varied
from maglev_ctrl.systems import Controller, SecondOrderSystem
from maglev_ctrl.vehicle import Equilibrium, Vehicle
from maglev_ctrl.vehicle.elements import GUIDEWAY

SPEEDS = 7
"""Operating points along the speed sweep; other sweeps are looked at at their ends."""
RIDE_SWEEPS = ("speed", "payload")


_spectra = lru_cache(maxsize=8)(track_spectra)
"""One record for one irregularity, so that its shaping filters are worked out once for every speed."""


class Touches(ModelError):
    """A magnet stands where it touches already: there is no ride, and no clearance to use."""


def ride_at(
    model: OptionModel, controller: Controller | None, situation: Situation, *, quick: bool = False
) -> RideResponse:
    """The response to the scenario's irregularity in one situation, sensor noise included.

    Parameters
    ----------
    quick : for search loops: the second method, spectra and masks are left out, and of every body the foremost and
        the rearmost magnet alone are watched

    Raises
    ------
    ModelError : there is no equilibrium, or the scenario describes no irregularity
    Touches : a magnet stands no higher than where it touches
    OutOfDomain : the forces are not known there
    NotStable : the closed loop is not stable
    """
    irregularity = model.scenario.irregularity
    if irregularity is None:
        raise MaglevError("the scenario describes no irregularity of the guideway")
    vehicle, balanced = model.balance(situation)
    plant, law = model.plant(situation), model.law_at(situation, controller)
    spectra = _spectra(irregularity)
    band = irregularity.band
    return ride_response(
        plant,
        law,
        track=track_inputs(plant.guideway, guideway_places(vehicle, plant.guideway), speed=situation.speed),
        speed=situation.speed,
        vertical=spectra.vertical,
        cross_level=spectra.cross_level,
        lateral=spectra.lateral,
        passengers=passengers(model, vehicle),
        clearances=clearances(model, vehicle, balanced, plant, situation, law, quick=quick),
        ports=ports(vehicle, plant),
        masks=() if quick else masks(model),
        noises=noises(vehicle, law),
        band=None if band is None else (band.low / (2.0 * np.pi), band.high / (2.0 * np.pi)),
        verified=not quick,
    )


def ride_study(model: OptionModel, controller: Controller | None) -> RideStudy:
    """Everything about the ride of an option; what has no answer carries its reason.

    Raises
    ------
    ModelError : there is no equilibrium at the design point
    """
    irregularity = model.scenario.irregularity
    if irregularity is None:
        raise MaglevError("the scenario describes no irregularity of the guideway")
    passing = span_passing(model, controller)
    looked = dict([*ride_situations(model), *_worst_passing(model, passing)])
    points = tuple(_point(model, controller, where, situation) for where, situation in looked.items())
    return RideStudy(
        points=points,
        masks=_mask_results(model, points[0].response),
        passing=passing,
        flexible=flexible_span(model, controller),
        step=step_passing(model, controller),
        spectrum=track_spectra(irregularity).words,
    )


def ride_situations(model: OptionModel) -> Iterator[tuple[str, Situation]]:
    """The design point, then speeds over their sweep, then the ends of the payload sweep."""
    design = Situation.of_design(model.scenario)
    yield "design point", design
    own = {"speed": design.speed, "payload": model.scenario.vehicle.car.payload}
    for name, values in sweep_values(model.scenario):
        if name not in RIDE_SWEEPS:
            continue
        unit, scale = DISPLAY[name]
        chosen = np.linspace(values[0], values[-1], SPEEDS if name == "speed" else 2)
        for value in chosen.tolist():
            if value != own[name] and (name != "speed" or value > 0.0):
                yield f"{name} {value * scale:.4g} {unit}", varied(design, name, value)


def _worst_passing(model: OptionModel, passing: SpanPassing | None) -> Iterator[tuple[str, Situation]]:
    """Where girders move the gaps most, between the speeds of the sweep."""
    swept = model.scenario.operating.sweep.speed is not None
    if swept and passing is not None and np.isfinite(passing.worst_speed):
        unit, scale = DISPLAY["speed"]
        where = f"speed {passing.worst_speed * scale:.4g} {unit}"
        yield where, varied(Situation.of_design(model.scenario), "speed", passing.worst_speed)


def passengers(model: OptionModel, vehicle: Vehicle) -> tuple[Passenger, ...]:
    """The scenario's passengers on the vehicle's car."""
    car = vehicle.bodies[0].name
    return tuple(Passenger(one.name, one.x, one.y, z=one.z, body=car) for one in seats(model.scenario))


def clearances(
    model: OptionModel,
    vehicle: Vehicle,
    balanced: Equilibrium,
    plant: SecondOrderSystem,
    situation: Situation,
    law: Controller | None,
    *,
    quick: bool,
) -> tuple[Clearance, ...]:
    """Gaps of magnets and strokes between bodies, with what girders use up of them."""
    ride = model.scenario.ride
    watched = gap_outputs(vehicle, plant, ends=quick)
    strokes = [link for link in vehicle.links if GUIDEWAY not in (link.body, link.to)]
    strokes = strokes if ride.largest_stroke is not None else []
    outputs = [*watched, *(f"{link.name}.stroke" for link in strokes)]
    sag = largest_gap_change(model, vehicle, plant, law, situation, outputs)
    places = {magnet.name: i for i, magnet in enumerate(vehicle.magnets)}
    found: list[Clearance] = []
    for output in watched:
        magnet, _, which = output.rpartition(".")
        heights = balanced.magnet_heights if which == "gap" else balanced.magnet_gaps
        nominal = float(heights[places[magnet]])
        least = ride.smallest_height if which == "gap" else ride.smallest_gap
        if nominal <= least:
            raise Touches(
                f"{magnet} touches at rest: it stands at {1e3 * nominal:.4g} mm, contact is {1e3 * least:.4g} mm"
            )
        found.append(
            Clearance(magnet if which == "gap" else f"{magnet} (wall)", "gap", output, nominal=nominal,
                      clearance=nominal - least, sag=sag[output])
        )  # fmt: skip
    for link in strokes:
        assert ride.largest_stroke is not None
        output = f"{link.name}.stroke"
        found.append(Clearance(link.name, "stroke", output, nominal=0.0, clearance=ride.largest_stroke,
                               sag=sag[output]))  # fmt: skip
    return tuple(found)


def ports(vehicle: Vehicle, plant: SecondOrderSystem) -> tuple[Port, ...]:
    """Where actuators give power to the vehicle."""
    return tuple(link_port(plant, actuator.name, limit=actuator.force_limit) for actuator in vehicle.actuators)


def noises(vehicle: Vehicle, law: Controller | None) -> tuple[Noise, ...]:
    """Noise of the sensors that the law measures with."""
    if law is None:
        return ()
    return tuple(Noise(one.name, one.noise) for one in vehicle.sensors if one.noise > 0.0 and one.name in law.measured)


def masks(model: OptionModel) -> tuple[PsdMask, ...]:
    """The scenario's acceleration masks."""
    return tuple(
        PsdMask(
            f"mask {i + 1}",
            record.axis,
            frequency=read_only_any(np.array([one.frequency / (2.0 * np.pi) for one in record.points])),
            density=read_only_any(np.array([one.density for one in record.points])),
        )
        for i, record in enumerate(model.scenario.ride.masks)
    )


def _mask_results(model: OptionModel, response: RideResponse | None) -> tuple[MaskResult, ...]:
    if response is None:
        return ()
    known = {one.name: one for one in masks(model)}
    return tuple(
        MaskResult(
            passenger=one.passenger, axis=one.axis, ratio=one.worst, frequency=one.frequency,
            mask_frequency=np.asarray(known[one.mask].frequency, dtype=np.float64),
            mask_density=np.asarray(known[one.mask].density, dtype=np.float64),
        )
        for one in response.masks
    )  # fmt: skip


def _point(model: OptionModel, controller: Controller | None, where: str, situation: Situation) -> RidePoint:
    payload = model.scenario.vehicle.car.payload if situation.payload is None else situation.payload
    blank = RidePoint(where=where, speed=situation.speed, payload=payload, response=None, reason="")
    try:
        return replace(blank, response=ride_at(model, controller, situation))
    except Touches as fault:
        return replace(blank, reason=f"{fault}", touches=True)
    except (MaglevError, ValueError, ArithmeticError, np.linalg.LinAlgError) as fault:
        return replace(blank, reason=f"{fault}")
