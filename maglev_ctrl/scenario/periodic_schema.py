"""The `[[periodic.source]]` parts of a scenario file: what makes the guideway periodic."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from maglev_ctrl.scenario.records import Many, Name, Record
from maglev_ctrl.scenario.units import Length, NonnegativeLength, PositiveLength, PositiveRatio, Ratio


class _SourceBase(Record):
    name: Name | None = Field(None, description="unique name; left out: its kind, numbered where there are several")
    offset: Length = Field(0.0, description="where along the track its support, joint or first coil lies")


class GirderSource(_SourceBase):
    """Girders between supports: they sag under the vehicle in a half sine, and they give way."""

    kind: Literal["girder"]
    span: PositiveLength = Field(description="from support to support")
    sag: NonnegativeLength = Field(0.0, description="static deflection at mid-span under the vehicle, downwards")
    camber: Length = Field(0.0, description="bow built into the girder at mid-span, upwards; the same half sine")
    softness: Ratio = Field(
        0.0, description="fraction by which the magnetic stiffness felt at mid-span is below that over a support"
    )


class JointSource(_SourceBase):
    """Joints between conductors: an opening without conductor, or a step in height."""

    kind: Literal["joint"]
    spacing: PositiveLength = Field(description="from joint to joint")
    opening: PositiveLength | None = Field(None, description="length without conductor; its edges count as sharp")
    step: Length | None = Field(
        None, description="how far the surface jumps up at a joint; over the segment it falls back evenly"
    )


class SegmentSource(_SourceBase):
    """Guideway segments with a profile of height or of gap, by evenly spaced samples over one period."""

    kind: Literal["segment"]
    spacing: PositiveLength = Field(description="length of a segment, one period")
    heights: Many[Length] = Field(
        (), max_length=500, description="how far the surface stands up, from the joint on; lines between the samples"
    )
    gaps: Many[Length] = Field((), max_length=500, description="how far each guidance wall stands towards its magnets")


class PitchSource(_SourceBase):
    """Coils or poles of the guideway: a ripple of the magnetic stiffness with their pitch."""

    kind: Literal["pitch"]
    spacing: PositiveLength = Field(description="from coil to coil, or from pole to pole")
    ripple: PositiveRatio = Field(description="amplitude of the ripple, a fraction of the magnetic stiffness")
    harmonics: Many[Ratio] = Field((1.0,), min_length=1, max_length=20, description="relative size of its harmonics")
    basis: Literal["measured", "assumed"] = Field(description="where the ripple comes from; it is told in the report")


SourceRecord = Annotated[GirderSource | JointSource | SegmentSource | PitchSource, Field(discriminator="kind")]
