"""Short constructors of the usual vehicles; all of them go through the one assembly."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass
from typing import Literal

import numpy as np

from maglev_ctrl.errors import ModelError
from maglev_ctrl.forces.base import AbstractForceModel
from maglev_ctrl.forces.coefficients import CoefficientTable
from maglev_ctrl.vehicle.elements import Aerodynamics, Body, CoefficientElement, Magnet, SpringDamper
from maglev_ctrl.vehicle.vehicle import Kinematics, Vehicle

CAR = "car"
STANDARD_GRAVITY = 9.80665
SIDEWAYS = (0.0, 1.0, 0.0)
FORWARD = (1.0, 0.0, 0.0)


def heave_surge(
    mass: float,
    *,
    force: AbstractForceModel,
    reference_height: float,
    drag_factor: float = 0.0,
    gravity: float = STANDARD_GRAVITY,
) -> Vehicle:
    """Heave and surge of a body over one magnet (Sec. 4.2 of the paper, Eqs. 16-27).

    Parameters
    ----------
    mass : kg
    force : of the one magnet, which carries everything
    reference_height : m
    drag_factor : K_a of the air drag K_a v^2, kg/m

    Examples
    --------
    >>> from maglev_ctrl.forces import ImageForce
    >>> coil = ImageForce(1e5, 1.0, 2.5e7, 0.02, 1.0)
    >>> heave_surge(20e3, force=coil, reference_height=0.1).dofs
    ('car.surge', 'car.heave')
    """
    return Vehicle(
        "heave-surge",
        (Body(CAR, mass, dofs=("surge", "heave")),),
        magnets=(Magnet("magnet", CAR, force=force),),
        aerodynamics=_air(drag_factor),
        reference_height=reference_height,
        gravity=gravity,
    )


def heave_pitch_surge(
    mass: float,
    *,
    pitch_inertia: float,
    spacing: float,
    force: AbstractForceModel,
    reference_height: float,
    rear_force: AbstractForceModel | None = None,
    depth: float = 0.0,
    drag_factor: float = 0.0,
    gravity: float = STANDARD_GRAVITY,
) -> Vehicle:
    """Heave, pitch and surge of a body over two magnets in line (Sec. 4.3 of the paper, Eqs. 28-35).

    Our pitch is nose down; the paper's theta is nose up. The paper puts drag and thrust at the centre of mass:
    leave `depth` at zero for that. (Front and rear drags that differ still add -(L/2)(D1 - D2) to the pitch stiffness,
    as forces with turning levers do; without geometric stiffness that term is out.)

    Parameters
    ----------
    mass, pitch_inertia : kg, kg m^2 about the centre of mass
    spacing : from the front magnet to the rear one, m
    force, rear_force : of each magnet; the rear one is like the front one when left out
    depth : of the magnets below the centre of mass, m

    Examples
    --------
    >>> from maglev_ctrl.forces import ImageForce
    >>> coil = ImageForce(1e5, 1.0, 2.5e7, 0.02, 1.0)
    >>> heave_pitch_surge(20e3, pitch_inertia=1e5, spacing=6.0, force=coil, reference_height=0.1).dofs
    ('car.surge', 'car.heave', 'car.pitch')
    """
    return Vehicle(
        "heave-pitch-surge",
        (Body(CAR, mass, inertia=(0.0, pitch_inertia, 0.0), dofs=("surge", "heave", "pitch")),),
        magnets=(
            Magnet("magnet_front", CAR, force=force, position=(spacing / 2.0, 0.0, -depth)),
            Magnet("magnet_rear", CAR, force=rear_force or force, position=(-spacing / 2.0, 0.0, -depth)),
        ),
        aerodynamics=_air(drag_factor),
        reference_height=reference_height,
        gravity=gravity,
    )


@dataclass(frozen=True, eq=False, slots=True)
class MagnetRow:
    """Magnets of one body, at the middles of equal shares of a length, on both sides.

    Parameters
    ----------
    force : of one magnet
    count : both sides together, even
    length : over which they are spread, m
    half_gauge : lateral distance from the centre line, m
    guidance : whether each faces a wall on its side
    height : of the magnets in the vehicle frame, m
    """

    force: AbstractForceModel
    count: int
    _: KW_ONLY
    length: float
    half_gauge: float = 0.0
    guidance: bool = False
    height: float = 0.0

    def __post_init__(self) -> None:
        if self.count < 2 or self.count % 2:
            raise ValueError(f"count: expected an even number of magnets, got {self.count}")
        if not self.length > 0.0:
            raise ValueError(f"length: expected a positive length, got {self.length}")

    def place(self, body: Body, *, name: str = "magnet") -> tuple[Magnet, ...]:
        """The magnets under a body, about its own x: "<name>_<station>", with "_left" or "_right" where it matters.

        Magnets that differ in nothing (no wall, no roll or yaw) are one magnet that counts twice.
        """
        split = self.guidance or (self.half_gauge != 0.0 and bool({"roll", "yaw"} & set(body.dofs)))
        sides: tuple[tuple[str, Literal[-1, 1]], ...] = (("_left", 1), ("_right", -1))
        stations = self.count // 2
        magnets = []
        for station in range(stations):
            x = body.position[0] + self.length * (0.5 - (station + 0.5) / stations)
            label = f"{name}_{station + 1}"
            if not split:
                magnets.append(Magnet(label, body.name, force=self.force, position=(x, 0.0, self.height), count=2.0))
                continue
            for word, side in sides:
                magnets.append(
                    Magnet(
                        label + word, body.name, force=self.force,
                        position=(x, side * self.half_gauge, self.height), side=side if self.guidance else 0,
                    )
                )  # fmt: skip
        return tuple(magnets)


def corner_magnets(
    force: AbstractForceModel, *, half_length: float, half_gauge: float, depth: float, guidance: bool = True
) -> tuple[Magnet, ...]:
    """Four magnets at (+-half_length, +-half_gauge, -depth) with walls beyond +-y (Sec. 2.3 of the theory)."""
    row = MagnetRow(
        force, 4, length=4.0 * half_length, half_gauge=half_gauge, guidance=guidance, height=-depth
    )  # fmt: skip
    return row.place(Body(CAR, 1.0, dofs=("roll", "yaw")))


def six_dof(
    mass: float,
    *,
    inertia: Sequence[float],
    reference_height: float,
    magnets: Sequence[Magnet] = (),
    coefficients: CoefficientTable | None = None,
    dofs: tuple[str, ...] = ("surge", "sway", "heave", "roll", "pitch", "yaw"),
    centre_height: float = 0.0,
    reference_gap: float | None = None,
    drag_factor: float = 0.0,
    gravity: float = STANDARD_GRAVITY,
) -> Vehicle:
    """One rigid body, named "car", in up to six freedoms over any magnets or measured coefficients (Sec. 2.3).

    Parameters
    ----------
    inertia : (3,) about the centre of mass, kg m^2
    magnets : on the body "car", such as `corner_magnets(...)` or `MagnetRow(...).place(...)`
    coefficients : measured matrices about the centre of mass
    centre_height : z of the centre of mass in the vehicle frame, m
    """
    body = Body(CAR, mass, inertia=tuple(inertia), dofs=dofs, position=(0.0, 0.0, centre_height))
    elements = () if coefficients is None else (CoefficientElement("coefficients", CAR, table=coefficients),)
    return Vehicle(
        "six freedoms",
        (body,),
        magnets=tuple(magnets),
        coefficient_elements=elements,
        aerodynamics=_air(drag_factor),
        reference_height=reference_height,
        reference_gap=reference_gap,
        gravity=gravity,
    )


def double_l_geometry(gap: float) -> tuple[float, float, float, float]:
    """W, H, a, b (m) of the double-L vehicle at a guidance gap g0 (m), Sec. 4.4 of the paper.

    Body width and height, depth of the magnets below the centre of mass, their lateral distance from it.

    Raises
    ------
    ValueError : a gap that leaves no vehicle between the guideways

    Examples
    --------
    >>> [round(length, 5) for length in double_l_geometry(0.0127)]
    [0.2032, 0.18288, 0.09144, 0.0889]
    """
    width = 0.2286 - 2.0 * gap
    if not (gap > 0.0 and width > 0.0254):
        raise ValueError(f"gap: expected a gap between 0 and 0.1016 m, got {gap}")
    height = 0.9 * width
    return width, height, 0.5 * height, 0.5 * (width - 0.0254)


def double_l(
    force: AbstractForceModel,
    *,
    height: float,
    speed: float,
    gap: float = 0.0127,
    mass: float | None = None,
    roll_inertia: float | None = None,
    half_gauge: float | None = None,
    depth: float | None = None,
    damping: tuple[float, float, float] = (0.0, 0.0, 0.0),
    kinematics: Kinematics = "consistent",
    geometric_stiffness: bool = True,
    drag_direction: bool = False,
    force_right: AbstractForceModel | None = None,
    gravity: float = STANDARD_GRAVITY,
) -> Vehicle:
    """Sway, heave and roll between two L-shaped guideways (Sec. 4.4 of the paper, Eqs. 38-51; corrected, Sec. 2.4).

    kinematics="paper" with geometric_stiffness=False is the paper's model (P), "consistent" without geometric
    stiffness is model C, with it CG: the recommended default. Side 1 is at +y.

    Parameters
    ----------
    force : of one magnet, lift and guidance over height and gap
    height, speed, gap : h0, v0, g0 at which the two magnets carry the weight, m, m/s, m
    mass : kg; 2 F_L(h0, g0) / g when left out (Eq. 40)
    roll_inertia : kg m^2; m (W^2 + H^2) / 12 of the geometry at g0 when left out
    half_gauge, depth : b and a, m; of the geometry at g0 when left out
    damping : C, E, D of heave, roll and sway: N s/m, N m s/rad, N s/m
    drag_direction : whether drag adds lateral damping D/v0
    force_right : another model at -y

    Raises
    ------
    ModelError : no mass was given and the magnets do not lift
    """
    width, body_height, a, b = double_l_geometry(gap)
    a, b = a if depth is None else depth, b if half_gauge is None else half_gauge
    carried = _carried_mass(force, force_right or force, height=height, gap=gap, speed=speed, gravity=gravity)
    mass = carried if mass is None else mass
    if mass <= 0.0:
        raise ModelError(f"no equilibrium: the two magnets lift {mass * gravity:.6g} N at height {height:.6g} m")
    inertia = mass * (width**2 + body_height**2) / 12.0 if roll_inertia is None else roll_inertia
    return Vehicle(
        "double L",
        (Body(CAR, mass, inertia=(inertia, 0.0, 0.0), dofs=("sway", "heave", "roll")),),
        magnets=(
            Magnet("magnet_left", CAR, force=force, position=(0.0, b, -a), side=1),
            Magnet("magnet_right", CAR, force=force_right or force, position=(0.0, -b, -a), side=-1),
        ),
        connections=_given_damping(damping),
        reference_height=height,
        reference_gap=gap,
        gravity=gravity,
        geometric_stiffness=geometric_stiffness,
        drag_direction=drag_direction,
        kinematics=kinematics,
    )


@dataclass(frozen=True, eq=False, slots=True)
class Secondary:
    """Secondary suspension between the car and each bogie.

    Parameters
    ----------
    stiffness, damping : vertical, N/m and N s/m of one bogie
    lateral_stiffness, lateral_damping : N/m and N s/m of one bogie
    half_spacing : half the lateral distance of two vertical units that share stiffness and damping; 0 = one unit
    height : of the suspension in the vehicle frame, m
    """

    stiffness: float
    damping: float = 0.0
    _: KW_ONLY
    lateral_stiffness: float = 0.0
    lateral_damping: float = 0.0
    half_spacing: float = 0.0
    height: float = 0.0

    def place(self, car: Body, bogie: Body) -> tuple[SpringDamper, ...]:
        """The units between the car and one bogie: "secondary_<bogie>", "..._left", "..._right", "..._lateral"."""
        x, name = bogie.position[0], f"secondary_{bogie.name}"
        sides = (("_left", self.half_spacing), ("_right", -self.half_spacing)) if self.half_spacing else (("", 0.0),)
        units = [
            SpringDamper(
                name + word, car.name, to=bogie.name, position=(x, y, self.height),
                stiffness=self.stiffness / len(sides), damping=self.damping / len(sides),
            )
            for word, y in sides
        ]  # fmt: skip
        if self.lateral_stiffness or self.lateral_damping:
            units.append(
                SpringDamper(
                    f"{name}_lateral", car.name, to=bogie.name, position=(x, 0.0, self.height), direction=SIDEWAYS,
                    stiffness=self.lateral_stiffness, damping=self.lateral_damping,
                )
            )  # fmt: skip
        return tuple(units)


def two_stage(
    car: Body,
    bogies: Sequence[Body],
    *,
    secondary: Secondary,
    reference_height: float,
    magnets: MagnetRow | None = None,
    coefficients: CoefficientTable | None = None,
    reference_gap: float | None = None,
    drag_factor: float = 0.0,
    gravity: float = STANDARD_GRAVITY,
) -> Vehicle:
    """A car on levitated bogies: primary (magnetic) and secondary suspension.

    Parameters
    ----------
    car, bogies : bodies with any of the six freedoms
    magnets : of each bogie, spread about its centre: "<bogie>_magnet_1", ...
    coefficients : measured matrices of each bogie ("<bogie>_coefficients") in place of magnets
    drag_factor : K_a of the air drag on the car, kg/m

    Examples
    --------
    >>> from maglev_ctrl.forces import ImageForce
    >>> coil = ImageForce(6e5, 1.5, 2.5e7, 0.02, 1.0)
    >>> train = two_stage(
    ...     Body("car", 108e3, inertia=(0.0, 2.8e7, 0.0), dofs=("heave", "pitch")),
    ...     [Body("front", 13.5e3, position=(14.0, 0.0, 0.0)), Body("rear", 13.5e3, position=(-14.0, 0.0, 0.0))],
    ...     magnets=MagnetRow(coil, 10, length=24.0, half_gauge=1.35), secondary=Secondary(1.36e6),
    ...     reference_height=0.2)
    >>> train.dofs, len(train.magnets)
    (('car.heave', 'car.pitch', 'front.heave', 'rear.heave'), 10)
    """
    placed = () if magnets is None else tuple(m for b in bogies for m in magnets.place(b, name=f"{b.name}_magnet"))
    elements: tuple[CoefficientElement, ...] = ()
    if coefficients is not None:
        elements = tuple(CoefficientElement(f"{b.name}_coefficients", b.name, table=coefficients) for b in bogies)
    return Vehicle(
        "two stages",
        (car, *bogies),
        magnets=placed,
        coefficient_elements=elements,
        connections=tuple(unit for bogie in bogies for unit in secondary.place(car, bogie)),
        aerodynamics=() if drag_factor == 0.0 else (Aerodynamics(car.name, drag_factor),),
        reference_height=reference_height,
        reference_gap=reference_gap,
        gravity=gravity,
    )


def _air(drag_factor: float) -> tuple[Aerodynamics, ...]:
    return () if drag_factor == 0.0 else (Aerodynamics(CAR, drag_factor),)


def _carried_mass(
    left: AbstractForceModel, right: AbstractForceModel, *, height: float, gap: float, speed: float, gravity: float
) -> float:
    lift = sum(float(np.asarray(model.forces(height, gap, speed).lift)) for model in (left, right))
    return lift / gravity


def _given_damping(damping: tuple[float, float, float]) -> tuple[SpringDamper, ...]:
    """C, E, D of Eq. 38 as dampers to the guideway at the centre of mass."""
    heave, roll, sway = damping
    dampers = (
        SpringDamper("heave_damper", CAR, damping=heave),
        SpringDamper("roll_damper", CAR, direction=FORWARD, damping=roll, angular=True),
        SpringDamper("sway_damper", CAR, direction=SIDEWAYS, damping=sway),
    )
    return tuple(damper for damper in dampers if damper.damping != 0.0)
