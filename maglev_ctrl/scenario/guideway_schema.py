"""The guideway and the coils of `[forces] model = "eddy_current"`."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from maglev_ctrl.scenario.records import Many, Name, Record
from maglev_ctrl.scenario.units import (
    Angle,
    AnySpeed,
    Conductivity,
    Length,
    PositiveLength,
    PositiveRatio,
    SignedCurrent,
)

Vertex = Annotated[tuple[Length, Length], Field(strict=False)]
"""["y", "z"] in the file."""


class LShape(Record):
    """An L: lateral leg and lift leg in one piece; y = 0 is the lateral leg's inner face, z = 0 the lift leg's top."""

    shape: Literal["l_shape"]
    leg: PositiveLength = Field(description="length of either leg")
    thickness: PositiveLength = Field(description="thickness of either leg")
    conductivity: Conductivity = Field(description="conductivity of the metal; 2.5e7 S/m is 6061-T6 aluminium")
    outside: bool = Field(True, description="true: the leg is measured on the outside; false: on its inner face")


class Plate(Record):
    """A flat plate with its top face at z = 0."""

    shape: Literal["plate"]
    width: PositiveLength = Field(description="across the track")
    thickness: PositiveLength = Field(description="of the plate")
    conductivity: Conductivity = Field(description="conductivity of the metal")
    centre: Length = Field(0.0, description="y of its middle")


class Channel(Record):
    """A U in one piece: inner faces at y = 0 and y = width, top face of the floor at z = 0."""

    shape: Literal["channel"]
    width: PositiveLength = Field(description="between the inner faces of the walls")
    wall: PositiveLength = Field(description="height of the walls above the floor")
    thickness: PositiveLength = Field(description="of walls and floor")
    conductivity: Conductivity = Field(description="conductivity of the metal")


class Rectangle(Record):
    """One of several plates with upright and level faces."""

    left: Length = Field(description="y of its left face")
    right: Length = Field(description="y of its right face")
    bottom: Length = Field(description="z of its bottom face")
    top: Length = Field(description="z of its top face")
    conductivity: Conductivity = Field(description="conductivity of the metal")


class Plates(Record):
    """Several plates: a split sheet, or legs that are not joined. A gap insulates; whole shared faces join."""

    shape: Literal["plates"]
    plates: Many[Rectangle] = Field(alias="plate", min_length=1, max_length=40, description="the plates")


class Outline(Record):
    """One conductor of any outline."""

    name: Name = Field(description="unique name of the conductor")
    vertices: Many[Vertex] = Field(
        min_length=3, max_length=200, description='corners [["y", "z"], ...] in order, such as [["0 mm", "0 mm"], ...]'
    )
    conductivity: Conductivity = Field(description="conductivity of the metal")


class Polygon(Record):
    """Conductors of any outline. Where two share whole edges, vertex on vertex, current crosses; a gap insulates."""

    shape: Literal["polygon"]
    conductors: Many[Outline] = Field(alias="conductor", min_length=1, max_length=40, description="the conductors")


GuidewayRecord = Annotated[LShape | Plate | Channel | Plates | Polygon, Field(discriminator="shape")]


class CoilRecord(Record):
    """A rectangular coil of the magnet; a permanent magnet is given by its equivalent current at mid-height."""

    length: PositiveLength = Field(description="along the track")
    width: PositiveLength = Field(description="across the track, in the coil's own plane")
    current: SignedCurrent | None = Field(
        None, description="of one turn; the sign is its sense. Left out in every coil, the magnets lift the weight"
    )
    turns: PositiveRatio = Field(1.0, description="how many turns carry it")
    lateral: Length = Field(
        0.0, description="of the coil's centre from the magnet's side face; y of the centre where there is no wall"
    )
    height: Length = Field(0.0, description="of the coil's centre above the magnet's bottom face")
    roll: Angle = Field(0.0, description='of its plane; "0 deg" lies flat, "90 deg" stands upright')
    forward: Length = Field(0.0, description="of its centre; a set of coils must look the same both ways")


class LengthRange(Record):
    """A range of lengths."""

    low: PositiveLength = Field(alias="from", description="smallest")
    high: PositiveLength = Field(alias="to", description="largest")


class SpeedRange(Record):
    """A range of speeds above zero."""

    low: AnySpeed = Field(alias="from", description="lowest; at rest there are no currents and no forces")
    high: AnySpeed = Field(alias="to", description="highest")


class EddyCurrentForces(Record):
    """Forces of coils over a conducting guideway of any cross-section, computed from its eddy currents.

    The guideway is solved by finite elements when a study needs the forces, once: the result is kept on disk.
    """

    model: Literal["eddy_current"]
    guideway: GuidewayRecord
    coils: Many[CoilRecord] = Field(alias="coil", min_length=1, max_length=40, description="the coils of one magnet")
    accuracy: Literal["draft", "standard", "reference"] = Field(
        "draft", description="draft 0.3 % of a force, standard 0.02 %; the largest error found stands in the report"
    )
    height_range: LengthRange | None = Field(
        None, description="heights to solve for; left out, those of the study and 10 % more"
    )
    gap_range: LengthRange | None = Field(None, description="gaps to solve for; left out, as the heights")
    velocity_range: SpeedRange | None = Field(None, description="speeds to solve for; left out, as the heights")
    trim_to_weight: bool = Field(
        False, description="scale all forces so that the magnets lift the weight; always where no current is given"
    )

    @property
    def absolute(self) -> bool:
        """Whether the forces are those of the given currents, not scaled to the weight."""
        return self.coils[0].current is not None and not self.trim_to_weight
