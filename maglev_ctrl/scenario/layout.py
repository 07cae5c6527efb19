"""The names in a scenario: bodies, magnets, elements on every bogie, outputs; what refers to what."""

from __future__ import annotations

from dataclasses import dataclass
from typing import assert_never

from maglev_ctrl.scenario.force_schema import ElectromagnetForces
from maglev_ctrl.scenario.option_schema import ActuatorRecord, OptionRecord, SensorRecord, SpringDamperRecord
from maglev_ctrl.scenario.scenario_schema import Scenario
from maglev_ctrl.scenario.units import Dimensions, dimensions_of
from maglev_ctrl.scenario.vehicle_schema import (
    DoubleL,
    HeavePitchSurge,
    HeaveSurge,
    Magnets,
    SixDof,
    TwoStage,
    VehicleRecord,
)

CAR, BOGIES, GUIDEWAY = "car", "bogies", "guideway"
FREEDOMS = ("surge", "sway", "heave", "roll", "pitch", "yaw")


@dataclass(frozen=True, slots=True)
class MagnetPlace:
    """One magnet of the layout: where it acts, which wall it faces, and how many real magnets it stands for."""

    name: str
    body: str
    position: tuple[float, float, float]
    side: int
    count: float


@dataclass(frozen=True, slots=True)
class Placement:
    """One element of the option on one place: `to` is None for an absolute measurement.

    `magnet`: whose current is measured.
    """

    name: str
    body: str
    to: str | None
    x: float
    magnet: str | None = None


@dataclass(frozen=True, slots=True)
class Layout:
    """Bodies with their freedoms, bogies with their x, magnets and the secondary springs of the bare vehicle."""

    bodies: tuple[tuple[str, tuple[str, ...]], ...]
    bogies: tuple[tuple[str, float], ...]
    magnets: tuple[MagnetPlace, ...]
    springs: tuple[str, ...]

    @property
    def body_names(self) -> tuple[str, ...]:
        """Names of the bodies."""
        return tuple(name for name, _ in self.bodies)

    @property
    def has_walls(self) -> bool:
        """Whether a magnet faces a guidance wall."""
        return any(magnet.side for magnet in self.magnets)

    def x_of(self, body: str) -> float:
        """x of a body's centre, m."""
        return dict(self.bogies).get(body, 0.0)

    def ends(self) -> tuple[str, ...]:
        """Words an element may name as one of its ends."""
        return (*self.body_names, GUIDEWAY, *((BOGIES,) if self.bogies else ()))


def layout(vehicle: VehicleRecord) -> Layout:
    """The layout of a vehicle record."""
    match vehicle:
        case HeaveSurge():
            return _single(("surge", "heave"), (MagnetPlace("magnet", CAR, (0.0, 0.0, 0.0), 0, 1.0),))
        case HeavePitchSurge():
            half = vehicle.magnet_spacing / 2.0
            places = (("magnet_front", half), ("magnet_rear", -half))
            return _single(
                ("surge", "heave", "pitch"), tuple(MagnetPlace(n, CAR, (x, 0.0, 0.0), 0, 1.0) for n, x in places)
            )
        case DoubleL():
            b, z = vehicle.half_gauge, vehicle.car.centre_height - vehicle.magnet_depth
            return _single(
                ("sway", "heave", "roll"),
                (MagnetPlace("magnet_left", CAR, (0.0, b, z), 1, 1.0),
                 MagnetPlace("magnet_right", CAR, (0.0, -b, z), -1, 1.0)),
            )  # fmt: skip
        case SixDof():
            return _single(vehicle.freedom, _spread("magnet", CAR, 0.0, vehicle.magnets, vehicle.freedom))
        case TwoStage():
            bogies = tuple((bogie.name, bogie.position) for bogie in vehicle.bogies)
            magnets = tuple(
                magnet
                for bogie in vehicle.bogies
                for magnet in _spread(
                    f"{bogie.name}_magnet", bogie.name, bogie.position, vehicle.magnets, bogie.freedom
                )
            )
            bodies = ((CAR, vehicle.freedom), *((bogie.name, bogie.freedom) for bogie in vehicle.bogies))
            return Layout(bodies, bogies, magnets, tuple(spring for spring, _ in secondary_places(vehicle)))
        case _ as never:
            assert_never(never)


def secondary_places(vehicle: TwoStage) -> tuple[tuple[str, tuple[str, float, float]], ...]:
    """Names of the secondary springs with their bogie, x and y; one per bogie, two with a lateral spacing."""
    half = vehicle.secondary.half_spacing
    sides = (("_left", half), ("_right", -half)) if half else (("", 0.0),)
    return tuple(
        (f"secondary_{bogie.name}{side}", (bogie.name, bogie.position, y))
        for bogie in vehicle.bogies
        for side, y in sides
    )


def _single(freedoms: tuple[str, ...], magnets: tuple[MagnetPlace, ...]) -> Layout:
    return Layout(((CAR, freedoms),), (), magnets, ())


def _spread(
    name: str, body: str, centre: float, magnets: Magnets | None, freedoms: tuple[str, ...]
) -> tuple[MagnetPlace, ...]:
    """Magnets at the middles of equal shares of the length; both sides in one where the side makes no difference."""
    if magnets is None:
        return ()
    stations = magnets.count // 2
    # A magnet's offset from the centre line only matters to roll and yaw, and to a guidance wall.
    split = magnets.guidance or (magnets.half_gauge != 0.0 and bool({"roll", "yaw"} & set(freedoms)))
    places = []
    for station in range(stations):
        x = centre + magnets.length * (0.5 - (station + 0.5) / stations)
        if split:
            for side, word in ((1, "left"), (-1, "right")):
                wall = side if magnets.guidance else 0
                y = side * magnets.half_gauge
                places.append(MagnetPlace(f"{name}_{station + 1}_{word}", body, (x, y, 0.0), wall, 1.0))
        else:
            places.append(MagnetPlace(f"{name}_{station + 1}", body, (x, 0.0, 0.0), 0, 2.0))
    return tuple(places)


def place_element(element: SpringDamperRecord | ActuatorRecord, here: Layout) -> tuple[Placement, ...]:
    """Where an element stands; one per bogie when it names "bogies". A first end "guideway" is turned round."""
    first, second = element.between
    if first == GUIDEWAY:
        first, second = second, first
    if BOGIES not in (first, second):
        body = next((end for end in (first, second) if end in dict(here.bogies)), first)
        x = here.x_of(body) if element.at is None else element.at
        return (Placement(element.name, first, second, x),)
    return tuple(
        Placement(
            f"{element.name}_{bogie}",
            bogie if first == BOGIES else first,
            bogie if second == BOGIES else second,
            x if element.at is None else element.at,
        )
        for bogie, x in here.bogies
    )


def place_sensor(sensor: SensorRecord, here: Layout) -> tuple[Placement, ...]:
    """Where a sensor stands; one per bogie when it is on, at, or measures to "bogies", one per magnet for currents."""
    if sensor.kind == "current":
        carriers = tuple(dict(here.bogies)) if sensor.on == BOGIES else (sensor.on,)
        return tuple(
            Placement(f"{sensor.name}_{magnet.name}", magnet.body, None, magnet.position[0], magnet.name)
            for magnet in here.magnets
            if magnet.body in carriers
        )
    target = sensor.to if sensor.kind == "stroke" else GUIDEWAY if sensor.kind == "gap" else None
    place = sensor.at
    if BOGIES in (sensor.on, sensor.at, target):
        return tuple(
            Placement(
                f"{sensor.name}_{bogie}",
                bogie if sensor.on == BOGIES else sensor.on,
                bogie if target == BOGIES else target,
                place if isinstance(place, float) else x,
            )
            for bogie, x in here.bogies
        )
    x = place if isinstance(place, float) else here.x_of(sensor.on)
    return (Placement(sensor.name, sensor.on, target, x),)


def outputs_of(option: OptionRecord, here: Layout) -> dict[str, tuple[Dimensions, tuple[str, ...]]]:
    """Every output a weight may name, with its dimensions and the system's outputs it stands for."""
    length, speed, acceleration = (dimensions_of(unit) for unit in ("m", "m/s", "m/s^2"))
    angle, rate, angular, force = (dimensions_of(unit) for unit in ("rad", "rad/s", "rad/s^2", "N"))
    known: dict[str, tuple[Dimensions, tuple[str, ...]]] = {}
    for body, freedoms in here.bodies:
        for freedom in freedoms:
            turning = freedom in ("roll", "pitch", "yaw")
            name = f"{body}.{freedom}"
            if freedom != "surge":  # along a uniform guideway nothing depends on surge: it is no output
                known[name] = (angle if turning else length, (name,))
            known[f"{name}.velocity"] = (rate if turning else speed, (f"{name}.velocity",))
            known[f"{name}.acceleration"] = (angular if turning else acceleration, (f"{name}.acceleration",))
    if here.magnets:
        known["magnet_gap"] = (length, tuple(f"{magnet.name}.gap" for magnet in here.magnets))
        known |= {f"{magnet.name}.gap": (length, (f"{magnet.name}.gap",)) for magnet in here.magnets}
    groups = {"secondary": here.springs} if here.springs else {}
    groups |= {e.name: tuple(p.name for p in place_element(e, here)) for e in option.spring_dampers}
    groups |= {e.name: tuple(p.name for p in place_element(e, here)) for e in option.actuators}
    ideal = {e.name for e in option.actuators if e.bandwidth is None}  # their force is the command itself
    for group, members in groups.items():
        endings = [("stroke", length), ("stroke.velocity", speed)]
        endings += [] if group in ideal else [("force", force)]
        for ending, dimensions in endings:
            for name, meant in ((group, members), *((member, (member,)) for member in members)):
                known[f"{name}.{ending}"] = (dimensions, tuple(f"{one}.{ending}" for one in meant))
    for sensor in option.sensors:
        dimensions = {"velocity": speed, "acceleration": acceleration, "current": dimensions_of("A")}.get(
            sensor.kind, length
        )
        members = tuple(placement.name for placement in place_sensor(sensor, here))
        for name, meant in ((sensor.name, members), *((member, (member,)) for member in members)):
            known[name] = (dimensions, meant)
    return known


def design_mass(scenario: Scenario, *, payload: float | None = None) -> float:
    """Mass of all bodies with a payload (None = the design payload), kg."""
    car = scenario.vehicle.car
    bogies = sum(b.mass for b in scenario.vehicle.bogies) if isinstance(scenario.vehicle, TwoStage) else 0.0
    return car.mass + (car.payload if payload is None else payload) + bogies


def command_dimensions(scenario: Scenario) -> dict[str, tuple[Dimensions, tuple[str, ...]]]:
    """Commands of the bare vehicle's electromagnets: names a law may drive, their dimensions, and the inputs meant.

    "magnet" stands for all of them, "<bogie>_magnet" for those of a bogie; empty without electromagnets.
    """
    forces, vehicle = scenario.forces, scenario.vehicle
    if not isinstance(forces, ElectromagnetForces):
        return {}
    dimensions = dimensions_of("V" if forces.drive == "voltage" else "A")
    magnets = layout(vehicle).magnets
    groups = {"magnet": magnets}
    if isinstance(vehicle, TwoStage):
        groups |= {
            f"{bogie.name}_magnet": tuple(magnet for magnet in magnets if magnet.body == bogie.name)
            for bogie in vehicle.bogies
        }
    groups |= {magnet.name: (magnet,) for magnet in magnets}
    return {
        name: (dimensions, tuple(f"{magnet.name}.{forces.drive}" for magnet in members))
        for name, members in groups.items()
    }
