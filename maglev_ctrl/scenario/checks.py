"""What no single field can know: sweeps, forces, requirements and the vehicle looked at together."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from maglev_ctrl.scenario.checks_comparison import comparison_faults
from maglev_ctrl.scenario.checks_options import NEGATIVE_DAMPING, option_faults
from maglev_ctrl.scenario.checks_points import point_faults
from maglev_ctrl.scenario.eddy_current import eddy_current_faults
from maglev_ctrl.scenario.electromagnet import electromagnet_faults
from maglev_ctrl.scenario.force_schema import (
    CoefficientForces,
    CornerImageForces,
    ElectromagnetForces,
    ImageForces,
    TableForces,
)
from maglev_ctrl.scenario.guideway_schema import EddyCurrentForces
from maglev_ctrl.scenario.layout import BOGIES, CAR, GUIDEWAY, Layout, command_dimensions, layout
from maglev_ctrl.scenario.periodic_sources import periodic_faults
from maglev_ctrl.scenario.problems import Fault, KeyPath
from maglev_ctrl.scenario.requirement_schema import PERIODIC_QUANTITIES
from maglev_ctrl.scenario.scenario_schema import AnySweep, Scenario
from maglev_ctrl.scenario.vehicle_schema import Bogie, Car, DoubleL, SixDof, TwoStage, VehicleRecord

MAP_LIMIT = 250_000
MAGNET_LIMIT = 4_000
"""Magnets of all bogies together; a train of ten cars has some hundreds."""
_MARGIN_SWEEPS = {
    "speed_margin": "speed", "payload_margin": "payload", "height_margin": "height", "gap_margin": "gap",
}  # fmt: skip
_INERTIAS = {"roll": "roll_inertia", "pitch": "pitch_inertia", "yaw": "yaw_inertia"}


def faults_in(scenario: Scenario) -> list[Fault]:
    """Every fault that takes more than one field to see."""
    here = layout(scenario.vehicle)
    faults = [
        *_vehicle_faults(scenario.vehicle),
        *_force_faults(scenario, here),
        *_operating_faults(scenario, here),
        *_map_faults(scenario),
        *periodic_faults(scenario, here),
        *_requirement_faults(scenario),
        *comparison_faults(scenario),
        *doubled(("option",), [option.name for option in scenario.options], noun="option"),
    ]
    commands = command_dimensions(scenario)
    for index, option in enumerate(scenario.options):
        faults.extend(option_faults(option, here, commands=commands, path=("option", index)))
        faults.extend(point_faults(scenario, option, path=("option", index)))
    return faults


def doubled(path: KeyPath, names: Sequence[str], *, noun: str) -> Iterator[Fault]:
    """A fault for each name that an earlier item of the same list already has."""
    for index, name in enumerate(names):
        if name in names[:index]:
            yield Fault((*path, index, "name"), f'expected a unique name; an earlier {noun} is called "{name}" too')


def _vehicle_faults(vehicle: VehicleRecord) -> Iterator[Fault]:
    car_freedoms = dict(layout(vehicle).bodies)[CAR]
    yield from _inertia_faults(vehicle.car, car_freedoms, path=("vehicle", "car"))
    if isinstance(vehicle, SixDof | TwoStage):
        yield from _freedom_faults(vehicle.freedom, path=("vehicle", "freedom"))
    if not isinstance(vehicle, TwoStage):
        return
    yield from doubled(("vehicle", "bogie"), [bogie.name for bogie in vehicle.bogies], noun="bogie")
    for index, bogie in enumerate(vehicle.bogies):
        path: KeyPath = ("vehicle", "bogie", index)
        if bogie.name in (CAR, GUIDEWAY, BOGIES):
            yield Fault((*path, "name"), f'expected a name other than "{bogie.name}", which has a meaning of its own')
        yield from _freedom_faults(bogie.freedom, path=(*path, "freedom"))
        yield from _inertia_faults(bogie, bogie.freedom, path=path)
    magnets = 0 if vehicle.magnets is None else vehicle.magnets.count * len(vehicle.bogies)
    if magnets > MAGNET_LIMIT:
        said = f"expected at most {MAGNET_LIMIT} magnets on all bogies together, got {magnets}"
        yield Fault(("vehicle", "magnets", "count"), said)
    if vehicle.secondary.half_spacing < 0.0:
        yield Fault(("vehicle", "secondary", "half_spacing"), "expected a length of zero or more")
    for key in ("damping", "lateral_damping"):
        if getattr(vehicle.secondary, key) < 0.0:
            yield Fault(("vehicle", "secondary", key), NEGATIVE_DAMPING)


def _freedom_faults(freedoms: tuple[str, ...], *, path: KeyPath) -> Iterator[Fault]:
    for index, freedom in enumerate(freedoms):
        if freedom in freedoms[:index]:
            yield Fault((*path, index), f'"{freedom}" is named twice')


def _inertia_faults(body: Car | Bogie, freedoms: tuple[str, ...], *, path: KeyPath) -> Iterator[Fault]:
    for freedom, key in _INERTIAS.items():
        if freedom in freedoms and getattr(body, key) is None:
            yield Fault(
                (*path, key),
                f'missing; expected a moment of inertia with its unit, for example "2.8e7 kg*m^2", '
                f'because {freedom} is free',
            )  # fmt: skip


def _force_faults(scenario: Scenario, here: Layout) -> Iterator[Fault]:
    forces, vehicle = scenario.forces, scenario.vehicle
    if not isinstance(forces, CoefficientForces) and not here.magnets:
        yield Fault(
            ("vehicle", "magnets"),
            f'missing; expected the magnets\' count and length, because forces.model is "{forces.model}"',
        )
    match forces:
        case ImageForces():
            if forces.vertical_velocity == "receding_image" and forces.exponent != 1.0:
                yield Fault(("forces", "exponent"), f'expected 1 with "receding_image", got {forces.exponent:g}')
            if (forces.current is None) != (forces.length is None):
                key = "length" if forces.length is None else "current"
                yield Fault(("forces", key), "missing; current and length belong together")
            if isinstance(vehicle, DoubleL):
                yield Fault(
                    ("forces", "model"),
                    'expected "corner_image", "eddy_current", "table" or "coefficients": a double_l needs guidance '
                    "forces, and image forces have none",
                )
        case CoefficientForces():
            yield from _matrix_faults(forces)
        case CornerImageForces():
            if not here.has_walls:
                yield Fault(("forces", "model"), "corner_image forces need magnets that face a guidance wall")
        case EddyCurrentForces():
            yield from eddy_current_faults(scenario, here)
        case ElectromagnetForces():
            yield from electromagnet_faults(scenario)
        case TableForces():
            pass


def _matrix_faults(forces: CoefficientForces) -> Iterator[Fault]:
    expected = len(forces.speeds) or 1
    for key in ("mass", "damping", "stiffness"):
        got = len(getattr(forces, key))
        if got != expected:
            why = "one per speed" if forces.speeds else "because no speeds are given"
            yield Fault(("forces", key), f"expected {expected} matrix(es), {why}, got {got}")
    for index, (one, after) in enumerate(zip(forces.speeds, forces.speeds[1:], strict=False)):
        if after <= one:
            yield Fault(("forces", "speeds", index + 1), "expected increasing speeds")


def _operating_faults(scenario: Scenario, here: Layout) -> Iterator[Fault]:
    operating = scenario.operating
    sweeps: dict[str, AnySweep | None] = {
        name: getattr(operating.sweep, name) for name in type(operating.sweep).model_fields
    }
    for name, sweep in sweeps.items():
        if sweep is not None:
            yield from _sweep_faults(sweep, path=("operating", "sweep", name))
    if here.has_walls and operating.gap is None:
        yield Fault(
            ("operating", "gap"),
            'missing; expected a length with its unit, for example "12.7 mm", because magnets face a guidance wall',
        )
    if not here.has_walls:
        needless: list[tuple[KeyPath, bool]] = [
            (("operating", "gap"), operating.gap is not None),
            (("operating", "sweep", "gap"), operating.sweep.gap is not None),
        ]
        for path, given in needless:
            if given and not isinstance(scenario.forces, CoefficientForces | TableForces):
                yield Fault(path, "no magnet faces a guidance wall, so there is no gap; remove it", at_key=True)


def _sweep_faults(sweep: AnySweep, *, path: KeyPath) -> Iterator[Fault]:
    if not sweep.first < sweep.last:
        yield Fault((*path, "to"), 'expected a value above that of "from"; an empty sweep has nothing to show')


def _map_faults(scenario: Scenario) -> Iterator[Fault]:
    periodic = scenario.periodic
    if periodic is None:
        return
    grid = periodic.map
    for name, sweep in (("speed", grid.speed), ("depth", grid.depth)):
        yield from _sweep_faults(sweep, path=("periodic", "map", name))
    if grid.speed.count * grid.depth.count > MAP_LIMIT:
        yield Fault(
            ("periodic", "map"), f"expected at most {MAP_LIMIT} points, got {grid.speed.count * grid.depth.count}"
        )


def _requirement_faults(scenario: Scenario) -> Iterator[Fault]:
    requirements, sweep = scenario.requirements, scenario.operating.sweep
    yield from doubled(("requirement",), [requirement.name for requirement in requirements], noun="requirement")
    for index, requirement in enumerate(requirements):
        path: KeyPath = ("requirement", index)
        given = [key for key in ("at_least", "at_most") if getattr(requirement, key) is not None]
        if len(given) != 1:
            got = "both" if given else "none"
            yield Fault(path, f"expected exactly one limit, at_least or at_most, got {got}")
        if requirement.quantity in PERIODIC_QUANTITIES and scenario.periodic is None:
            yield Fault((*path, "quantity"), f"{requirement.quantity} needs the table [periodic]")
        along = _MARGIN_SWEEPS.get(requirement.quantity)
        if along is not None and getattr(sweep, along) is None:
            yield Fault((*path, "quantity"), f"{requirement.quantity} needs operating.sweep.{along}")
        swept = requirement.quantity in ("growth_rate", "damping_ratio")
        if swept and requirement.over != "nominal" and getattr(sweep, requirement.over) is None:
            given_over = "over" in requirement.model_fields_set
            yield Fault(
                (*path, "over") if given_over else path,
                f'judged over "{requirement.over}", but operating.sweep.{requirement.over} is missing; '
                'add the sweep, or write over = "nominal"',
            )


def table_faults(scenario: Scenario, here: Layout, *, has_gap: bool) -> Iterator[Fault]:
    """Faults between a force table, already read, and the vehicle that uses it."""
    if here.has_walls and not has_gap:
        yield Fault(("forces", "file"), "expected columns gap and guidance, because magnets face a guidance wall")
    elif has_gap and scenario.operating.gap is None:
        yield Fault(("operating", "gap"), "missing; expected the gap at which the force table is read")
