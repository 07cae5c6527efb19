"""From `[irregularity]` and `[ride]` records to what the numerics take: spectra, passengers, words."""

from __future__ import annotations

from dataclasses import dataclass
from typing import assert_never

from maglev_ctrl.guideway.spectra import Roughness, federal_railroad, inverse_square, rational, single_pole
from maglev_ctrl.scenario.layout import CAR, layout
from maglev_ctrl.scenario.scenario_schema import Scenario
from maglev_ctrl.scenario.track_schema import (
    Federal,
    InverseSquare,
    Irregularity,
    RationalSpectrum,
    SinglePole,
    SpectrumRecord,
)


@dataclass(frozen=True, slots=True)
class Seat:
    """A place in the car: m from the car's centre (z from its centre of mass)."""

    name: str
    x: float
    y: float
    z: float


@dataclass(frozen=True, eq=False, slots=True)
class TrackSpectra:
    """Spectra of a scenario's guideway; `cross_level` of the angle (rad), not of the height difference."""

    vertical: Roughness | None
    lateral: Roughness | None
    cross_level: Roughness | None
    words: str


def roughness(record: SpectrumRecord) -> Roughness:
    """The spectrum of a record.

    Raises
    ------
    ValueError : coefficients that make no spectrum
    """
    match record:
        case InverseSquare():
            return inverse_square(record.amplitude)
        case SinglePole():
            return single_pole(record.amplitude, corner=record.corner)
        case Federal():
            return federal_railroad(record.track_class or 0, amplitude=record.amplitude)
        case RationalSpectrum():
            return rational(record.numerator, record.denominator)
        case _ as never:
            assert_never(never)


def track_spectra(irregularity: Irregularity) -> TrackSpectra:
    """All spectra of a scenario's guideway.

    Raises
    ------
    ValueError : coefficients that make no spectrum
    """
    vertical, lateral, cross = (
        None if one is None else roughness(one)
        for one in (irregularity.vertical, irregularity.lateral, irregularity.cross_level)
    )
    if cross is not None and irregularity.cross_level_base is not None:
        cross = cross.scaled(irregularity.cross_level_base**-2)
    told = [
        f"{what}: {one.name}" + (f" ({one.source})" if one.source else "")
        for what, one in (("vertical", vertical), ("lateral", lateral), ("cross level", cross))
        if one is not None
    ]
    return TrackSpectra(vertical, lateral, cross, "; ".join(told))


def seats(scenario: Scenario) -> tuple[Seat, ...]:
    """The passengers of a scenario; where it names none, the car's centre and the places over its bogies."""
    if scenario.ride.passengers:
        return tuple(Seat(one.name, one.x, one.y, one.z) for one in scenario.ride.passengers)
    here = layout(scenario.vehicle)
    centre = Seat("centre", 0.0, 0.0, 0.0)
    return (centre, *(Seat(f"over_{name}", x, 0.0, 0.0) for name, x in here.bogies if name != CAR and x != 0.0))
