"""The `[vehicle]` part of a scenario file: one record per model of the vehicle."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from maglev_ctrl.scenario.records import Many, Name, Record
from maglev_ctrl.scenario.units import Damping, Drag, Inertia, Length, Mass, Payload, PositiveLength, Speed, Stiffness

Freedom = Literal["surge", "sway", "heave", "roll", "pitch", "yaw"]


class Car(Record):
    """The car body, or the whole vehicle where there are no bogies; its name in the rest of the file is "car"."""

    mass: Mass = Field(description="mass without payload")
    payload: Payload = Field(0.0, description="payload at the design point; a payload sweep replaces it")
    roll_inertia: Inertia | None = Field(None, description="moment of inertia about the forward axis, at the CM")
    pitch_inertia: Inertia | None = Field(None, description="moment of inertia about the lateral axis, at the CM")
    yaw_inertia: Inertia | None = Field(None, description="moment of inertia about the vertical axis, at the CM")
    centre_height: Length = Field(
        0.0, description="height of the CM above the secondary suspension plane (above the magnets without bogies)"
    )


class Bogie(Record):
    """A bogie (levitation chassis) under the car; the bogie's magnets are spread about its centre."""

    name: Name = Field(description="unique name of the bogie")
    mass: Mass = Field(description="mass of the bogie with its magnets")
    position: Length = Field(description="x of the bogie centre from the car's centre, forward positive")
    freedom: Many[Freedom] = Field(("heave",), min_length=1, description="free coordinates of the bogie")
    roll_inertia: Inertia | None = Field(None, description="moment of inertia about the forward axis")
    pitch_inertia: Inertia | None = Field(None, description="moment of inertia about the lateral axis")
    yaw_inertia: Inertia | None = Field(None, description="moment of inertia about the vertical axis")


class Secondary(Record):
    """Secondary suspension present in every option: one per bogie, named "secondary_<bogie>"."""

    stiffness: Stiffness = Field(description="vertical stiffness between the car and one bogie")
    damping: Damping = Field(0.0, description="vertical damping between the car and one bogie")
    lateral_stiffness: Stiffness = Field(0.0, description="lateral stiffness between the car and one bogie")
    lateral_damping: Damping = Field(0.0, description="lateral damping between the car and one bogie")
    half_spacing: Length = Field(
        0.0, description="half the lateral distance of the springs; above zero it gives the springs a roll stiffness"
    )


class Magnets(Record):
    """Magnets of one bogie (of the vehicle without bogies), evenly spaced on both sides."""

    count: int = Field(gt=0, le=400, multiple_of=2, description="number of magnets, both sides together")
    length: PositiveLength = Field(description="length over which they are spread")
    half_gauge: Length = Field(0.0, description="lateral distance of the magnets from the centre line")
    guidance: bool = Field(False, description="whether the magnets also face a guidance wall on their side")


class Aerodynamics(Record):
    """Aerodynamic drag, growing with the square of the speed; it acts at the car's centre of mass."""

    drag: Drag = Field(description="drag at `drag_speed`")
    drag_speed: Speed = Field(description="speed at which `drag` was found")


class HeaveSurge(Record):
    """Two freedoms: surge and heave, one magnet under the centre of mass."""

    model: Literal["heave_surge"]
    car: Car
    aerodynamics: Aerodynamics | None = None


class HeavePitchSurge(Record):
    """Three freedoms: surge, heave and pitch, two magnets in line."""

    model: Literal["heave_pitch_surge"]
    car: Car
    magnet_spacing: PositiveLength = Field(description="distance from the front magnet to the rear magnet")
    aerodynamics: Aerodynamics | None = None


class SixDof(Record):
    """One rigid body with up to six freedoms."""

    model: Literal["six_dof"]
    freedom: Many[Freedom] = Field(
        ("surge", "sway", "heave", "roll", "pitch", "yaw"), min_length=1, description="free coordinates"
    )
    car: Car
    magnets: Magnets | None = Field(None, description="left out where the forces are measured coefficients")
    aerodynamics: Aerodynamics | None = None


class DoubleL(Record):
    """Heave, roll and sway of a body between two L-shaped guideways, one magnet at each side."""

    model: Literal["double_l"]
    car: Car
    half_gauge: PositiveLength = Field(description="b: lateral distance of each magnet from the centre of mass")
    magnet_depth: Length = Field(description="a: depth of the magnets below the centre of mass")
    kinematics: Literal["consistent", "paper"] = Field(
        "consistent", description="paper: the guidance gap ignores roll, as Eq. 43 does; consistent: it does not"
    )
    geometric_stiffness: bool = Field(True, description="whether static forces at turning magnets add stiffness")


class TwoStage(Record):
    """A car on bogies: primary (magnetic) and secondary suspension."""

    model: Literal["two_stage"]
    freedom: Many[Freedom] = Field(("heave",), min_length=1, description="free coordinates of the car body")
    car: Car
    bogies: Many[Bogie] = Field(alias="bogie", min_length=1, max_length=40, description="the bogies, front to rear")
    secondary: Secondary
    magnets: Magnets | None = Field(None, description="of each bogie; left out with measured coefficients")
    aerodynamics: Aerodynamics | None = None


VehicleRecord = Annotated[HeaveSurge | HeavePitchSurge | SixDof | DoubleL | TwoStage, Field(discriminator="model")]
