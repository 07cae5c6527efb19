"""Faults of what a comparison adds: irregularity, ride, packs, uncertainty, tuning, simulation."""

from __future__ import annotations

from collections.abc import Iterator

from maglev_ctrl.scenario.problems import Fault, KeyPath, near_match
from maglev_ctrl.scenario.requirement_packs import pack_requirements
from maglev_ctrl.scenario.requirement_schema import (
    PERIODIC_QUANTITIES,
    RIDE_QUANTITIES,
    ROBUST_QUANTITIES,
    AccelerationRequirement,
    RequirementRecord,
)
from maglev_ctrl.scenario.scenario_schema import Scenario
from maglev_ctrl.scenario.track import roughness, seats
from maglev_ctrl.scenario.track_schema import Federal, Irregularity, Ride
from maglev_ctrl.scenario.tuning_schema import Uncertainty

_OF_RIDE = ("ride", "gap", "stroke", "power", "force")
_TABLE = (
    (RIDE_QUANTITIES, "irregularity"),
    (ROBUST_QUANTITIES, "uncertainty"),
    (PERIODIC_QUANTITIES, "periodic"),
)


def comparison_faults(scenario: Scenario) -> Iterator[Fault]:
    """Every fault of the tables a comparison adds, looked at together."""
    if scenario.irregularity is not None:
        yield from _irregularity_faults(scenario.irregularity)
    yield from _ride_faults(scenario.ride)
    yield from _room_faults(scenario)
    yield from _pack_faults(scenario)
    yield from _contradictions(scenario)
    for index, requirement in enumerate(scenario.requirements):
        path: KeyPath = ("requirement", index)
        yield from _needs(scenario, requirement, path=(*path, "quantity"))
        if isinstance(requirement, AccelerationRequirement) and requirement.passenger is not None:
            known = [seat.name for seat in seats(scenario)]
            if requirement.passenger not in known:
                yield Fault(
                    (*path, "passenger"),
                    f'there is no passenger "{requirement.passenger}"{near_match(requirement.passenger, known)}',
                )
    if scenario.uncertainty is not None:
        yield from _uncertainty_faults(scenario.uncertainty)
    yield from _tuning_faults(scenario)
    simulation = scenario.simulation
    if simulation is not None and simulation.settle >= 0.5 * simulation.duration:
        yield Fault(("simulation", "settle"), "expected less than half of the duration, so that something is left")


def _irregularity_faults(record: Irregularity) -> Iterator[Fault]:
    spectra = {name: getattr(record, name) for name in ("vertical", "lateral", "cross_level")}
    if not any(spectra.values()):
        yield Fault(("irregularity",), "expected at least one spectrum: vertical, lateral or cross_level")
    for name, spectrum in spectra.items():
        if spectrum is None:
            continue
        path: KeyPath = ("irregularity", name)
        if isinstance(spectrum, Federal) and (spectrum.amplitude is None) == (spectrum.track_class is None):
            yield Fault(path, "expected an amplitude or a track_class, one of the two")
            continue
        try:
            found = roughness(spectrum)
        except ValueError as error:
            yield Fault(path, str(error))
            continue
        if found.poles_at_zero > 1:
            yield Fault(
                path,
                f"the spectrum grows as W^-{2 * found.poles_at_zero} towards W = 0: even the slope of the guideway has "
                "infinite variance then, at the LOW end; expected no more than W^-2",
            )
    if (record.cross_level is None) != (record.cross_level_base is None):
        missing = "cross_level_base" if record.cross_level_base is None else "cross_level"
        yield Fault(("irregularity",), f"{missing} is missing; cross_level and cross_level_base belong together")
    if record.band is not None and not record.band.low < record.band.high:
        yield Fault(("irregularity", "band", "to"), 'expected a frequency above that of "from"')
    girder = record.girder
    if girder is not None and girder.sag == 0.0 and girder.flexible is None:
        yield Fault(("irregularity", "girder"), "expected a sag, or the table flexible; this girder does nothing")


def _ride_faults(record: Ride) -> Iterator[Fault]:
    names = [one.name for one in record.passengers]
    for index, name in enumerate(names):
        if name in names[:index]:
            yield Fault(("ride", "passenger", index, "name"), f'an earlier passenger is called "{name}" too')
    for index, mask in enumerate(record.masks):
        for place, (one, after) in enumerate(zip(mask.points, mask.points[1:], strict=False)):
            if after.frequency <= one.frequency:
                yield Fault(("ride", "mask", index, "point", place + 1, "frequency"), "expected rising frequencies")


def _room_faults(scenario: Scenario) -> Iterator[Fault]:
    """A place of contact that the magnets do not reach even at the design point."""
    operating, ride = scenario.operating, scenario.ride
    for key, least, own, what in (
        ("smallest_height", ride.smallest_height, operating.height, "levitation height"),
        ("smallest_gap", ride.smallest_gap, operating.gap, "guidance gap"),
    ):
        if least > 0.0 and own is not None and least >= own:
            yield Fault(("ride", key), f"expected less than the {what} of the design point, {1e3 * own:.4g} mm")


def _needs(scenario: Scenario, requirement: RequirementRecord, *, path: KeyPath) -> Iterator[Fault]:
    for quantities, table in _TABLE:
        if requirement.quantity in quantities and getattr(scenario, table) is None and table != "periodic":
            yield Fault(path, f"{requirement.quantity} needs the table [{table}]")
    if requirement.quantity == "stroke_used" and scenario.ride.largest_stroke is None:
        yield Fault(path, "stroke_used needs ride.largest_stroke")
    if requirement.quantity == "acceleration_mask" and not scenario.ride.masks:
        yield Fault(path, "acceleration_mask needs a [[ride.mask]]")


def _pack_faults(scenario: Scenario) -> Iterator[Fault]:
    for index, pack in enumerate(scenario.packs):
        path: KeyPath = ("packs", index)
        if pack in scenario.packs[:index]:
            yield Fault(path, f'the pack "{pack}" is asked for twice')
            continue
        for requirement in pack_requirements(pack, swept=scenario.operating.sweep.speed is not None):
            faults = list(_needs(scenario, requirement, path=path))
            if requirement.quantity in PERIODIC_QUANTITIES and scenario.periodic is None:
                faults.append(Fault(path, f'the pack "{pack}" needs the table [periodic]'))
            yield from faults[:1]


def _contradictions(scenario: Scenario) -> Iterator[Fault]:
    """Two hard requirements of one quantity that no value can meet."""
    judged, written = scenario.judged, len(scenario.requirements)
    for index, one in enumerate(judged):
        for place, earlier in enumerate(judged[:index]):
            if (one.quantity, one.over) != (earlier.quantity, earlier.over) or one.sense == earlier.sense:
                continue
            least, most = (one, earlier) if one.sense == "at_least" else (earlier, one)
            if one.hard and earlier.hard and least.limit > most.limit:
                other = earlier if index < written else one
                path: KeyPath = ("requirement", index if index < written else place) if place < written else ("packs",)
                limits = f"at least {least.limit:g} and at most {most.limit:g} {one.unit}".rstrip()
                yield Fault(path, f'contradicts the requirement "{other.name}": no {one.quantity} is {limits}')


def _uncertainty_faults(record: Uncertainty) -> Iterator[Fault]:
    spreads = {name: getattr(record, name) for name in Uncertainty.model_fields}
    if not any(spreads.values()):
        yield Fault(("uncertainty",), f"expected a spread above zero of one of {', '.join(spreads)}")
    for name, spread in spreads.items():
        if spread >= 1.0:
            yield Fault(("uncertainty", name), "expected a spread below 1: at 100 % the parameter could vanish")


def _tuning_faults(scenario: Scenario) -> Iterator[Fault]:
    tuning = scenario.tuning
    tuned = [index for index, option in enumerate(scenario.options) if option.tunes]
    if tuning is None:
        for index in tuned:
            yield Fault(
                ("option", index, "tune"), "needs the table [tuning]: method, budget and objectives", at_key=True
            )
        return
    if not tuned:
        yield Fault(("tuning",), "no option has a [[option.tune]]: there is nothing to tune", at_key=True)
    for index, objective in enumerate(tuning.objectives):
        path: KeyPath = ("tuning", "objectives", index)
        if objective in tuning.objectives[:index]:
            yield Fault(path, f'"{objective}" is named twice')
        if objective in _OF_RIDE and scenario.irregularity is None:
            yield Fault(path, f'"{objective}" needs the table [irregularity]')
        if objective == "stroke" and scenario.ride.largest_stroke is None:
            yield Fault(path, '"stroke" needs ride.largest_stroke')
    if tuning.choose != "knee" and tuning.choose not in tuning.objectives:
        yield Fault(("tuning", "choose"), f'expected "knee" or one of the objectives, got "{tuning.choose}"')
