"""The ride of a candidate: as the full study computes it, but by one method, and the girders' sag by a short series."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Final

import numpy as np

from maglev_ctrl.analysis.girder.contacts import element_places
from maglev_ctrl.analysis.girder.passing import driven_system
from maglev_ctrl.analysis.girder.shapes import PieceShape
from maglev_ctrl.analysis.response.records import RideResponse
from maglev_ctrl.analysis.response.requests import Clearance, guideway_places
from maglev_ctrl.analysis.response.ride import ride_response
from maglev_ctrl.arrays import ComplexArray
from maglev_ctrl.errors import ModelError
from maglev_ctrl.guideway.correlation import track_inputs
from maglev_ctrl.scenario.track import track_spectra
from maglev_ctrl.study.passing import gap_outputs, girder_shape
from maglev_ctrl.study.ride import noises, passengers, ports
from maglev_ctrl.study.situation import OptionModel, Situation
from maglev_ctrl.systems import Controller, SecondOrderSystem, close_loop
from maglev_ctrl.vehicle import Equilibrium, Vehicle
from maglev_ctrl.vehicle.elements import GUIDEWAY

HARMONICS: Final = 32
"""Of a girder's sag; what lies above acts on gaps directly and is kept, the vehicle's answer to it is not."""
TIMES: Final = 192
"""Of one passage at which the motion is looked at."""


def quick_ride(model: OptionModel, controller: Controller | None, situation: Situation) -> RideResponse:
    """The response to the scenario's irregularity in one situation, for search loops.

    Raises
    ------
    ModelError : there is no equilibrium, or the scenario describes no irregularity
    OutOfDomain : the forces are not known there
    NotStable : the closed loop is not stable
    """
    irregularity = model.scenario.irregularity
    if irregularity is None:
        raise ModelError("the scenario describes no irregularity of the guideway")
    vehicle, balanced = model.balance(situation)
    plant, law = model.plant(situation), model.law_at(situation, controller)
    spectra, band = _spectra(irregularity), irregularity.band
    return ride_response(
        plant,
        law,
        track=track_inputs(plant.guideway, guideway_places(vehicle, plant.guideway), speed=situation.speed),
        speed=situation.speed,
        vertical=spectra.vertical,
        cross_level=spectra.cross_level,
        lateral=spectra.lateral,
        passengers=passengers(model, vehicle),
        clearances=_clearances(model, vehicle, balanced, plant, law, situation),
        ports=ports(vehicle, plant),
        noises=noises(vehicle, law),
        band=None if band is None else (band.low / (2.0 * np.pi), band.high / (2.0 * np.pi)),
        verified=False,
    )


_spectra = lru_cache(maxsize=8)(track_spectra)
"""One record for one irregularity, so that its shaping filters are worked out once for every speed."""


def _clearances(
    model: OptionModel, vehicle: Vehicle, balanced: Equilibrium, plant: SecondOrderSystem, law: Controller | None,
    situation: Situation,
) -> tuple[Clearance, ...]:  # fmt: skip
    """Gaps of the foremost and rearmost magnets, and strokes where they have stops."""
    ride = model.scenario.ride
    gaps = gap_outputs(vehicle, plant, ends=True)
    links = [link.name for link in vehicle.links if GUIDEWAY not in (link.body, link.to)]
    strokes = links if ride.largest_stroke is not None else []
    outputs = (*gaps, *(f"{name}.stroke" for name in strokes))
    shape = _shape(model)
    sag = dict.fromkeys(outputs, 0.0)
    if shape is not None and outputs:
        closed = plant if law is None else close_loop(plant, law)
        sag = largest_passing(closed, vehicle, shape, situation.speed, outputs)
    index = {magnet.name: i for i, magnet in enumerate(vehicle.magnets)}
    found: list[Clearance] = []
    for output in gaps:
        magnet, _, which = output.rpartition(".")
        level, least = (
            (balanced.magnet_heights, ride.smallest_height) if which == "gap"
            else (balanced.magnet_gaps, ride.smallest_gap)
        )  # fmt: skip
        nominal = float(level[index[magnet]])
        if nominal > least:
            room = nominal - least
            found.append(Clearance(output, "gap", output, nominal=nominal, clearance=room, sag=sag[output]))
    if ride.largest_stroke is not None:
        found += [
            Clearance(name, "stroke", f"{name}.stroke", nominal=0.0, clearance=ride.largest_stroke,
                      sag=sag[f"{name}.stroke"])
            for name in strokes
        ]  # fmt: skip
    return tuple(found)


def largest_passing(
    closed: SecondOrderSystem, vehicle: Vehicle, shape: PieceShape, speed: float, outputs: Sequence[str]
) -> dict[str, float]:
    """Largest steady change of outputs as girders pass, by a short Fourier series; to about one per cent.

    Raises
    ------
    NotStable : the loop has a root that does not decay
    """
    system = driven_system(closed, shape, speed=speed, places=element_places(vehicle), outputs=outputs)
    order = np.arange(1, HARMONICS + 1)
    s = 2j * np.pi * speed / shape.span * order
    met = _harmonics(shape)[:, None] * np.exp(2j * np.pi * np.outer(order, system.places) / shape.span)
    drive = np.einsum("nm,km->kn", system.E_w, met) + s[:, None] * np.einsum("nm,km->kn", system.E_v, met)
    size = len(system.A)
    state = np.linalg.solve(s[:, None, None] * np.eye(size) - system.A, drive[..., None])[..., 0]
    amplitudes = state @ system.C.T + s[:, None] * (met @ system.D_v.T)
    times = np.arange(TIMES) * (shape.span / speed / TIMES)
    moved = (np.exp(np.outer(times, s)) @ amplitudes).real
    felt = np.flatnonzero(np.any(system.D_w, axis=0))
    below = np.array([shape.at(speed * times + system.places[i]) for i in felt]).reshape(len(felt), TIMES)
    direct = below.T @ system.D_w[:, felt].T
    means = np.full(len(system.places), shape.mean)
    mean = -system.C @ np.linalg.solve(system.A, system.E_w @ means) if size else np.zeros(len(outputs))
    peaks = np.max(np.abs(moved + direct + mean), axis=0)
    return dict(zip(outputs, (float(peak) for peak in peaks), strict=True))


def _shape(model: OptionModel) -> PieceShape | None:
    """The girders' sag, one record for equal girders, so that its harmonics are worked out once."""
    record = model.scenario.irregularity
    girder = None if record is None else record.girder
    key = None if girder is None else (girder.span, girder.sag)
    if key not in _SHAPES:
        _SHAPES[key] = girder_shape(model)
    return _SHAPES[key]


_SHAPES: dict[tuple[float, float] | None, PieceShape | None] = {}


@lru_cache(maxsize=8)
def _harmonics(shape: PieceShape) -> ComplexArray:
    return shape.harmonics(HARMONICS)
