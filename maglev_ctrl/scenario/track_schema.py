"""The `[irregularity]` and `[ride]` parts of a scenario file: how rough the guideway is, and who rides on it."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from maglev_ctrl.scenario.records import Many, Name, Record
from maglev_ctrl.scenario.units import (
    AccelerationDensity,
    Bandwidth,
    BendingStiffness,
    Length,
    LineMass,
    NonnegativeLength,
    PositiveLength,
    PositiveRatio,
    Ratio,
    RoughnessAmplitude,
    WaveNumber,
)


class InverseSquare(Record):
    """S = A / W^2 over the wave number W: the form of the early maglev studies."""

    form: Literal["inverse_square"]
    amplitude: RoughnessAmplitude = Field(description="A of the displacement spectrum A / W^2, one-sided, W in rad/m")


class SinglePole(Record):
    """S = A / (W0^2 + W^2): as the inverse square, levelling off for long waves."""

    form: Literal["single_pole"]
    amplitude: RoughnessAmplitude = Field(description="A of the displacement spectrum A / (W0^2 + W^2), one-sided")
    corner: WaveNumber = Field(description="W0, where it levels off")


class Federal(Record):
    """S = k A Wc^2 / ((W^2 + Wc^2) W^2), k = 0.25, Wc = 0.8245 rad/m: classes of railway track."""

    form: Literal["federal_railroad"]
    amplitude: RoughnessAmplitude | None = Field(None, description="A; left out: that of the class")
    track_class: Literal[5, 6] | None = Field(None, description="class of track, in place of the amplitude")


class RationalSpectrum(Record):
    """S = P(W^2) / Q(W^2) with coefficients of your own: any measured spectrum fitted by a rational function."""

    form: Literal["rational"]
    numerator: Many[Ratio] = Field(min_length=1, max_length=10, description="P, highest power of W^2 first, SI")
    denominator: Many[Ratio] = Field(min_length=1, max_length=10, description="Q, highest power of W^2 first, SI")


SpectrumRecord = Annotated[InverseSquare | SinglePole | Federal | RationalSpectrum, Field(discriminator="form")]


class Band(Record):
    """A band of frequencies."""

    low: Bandwidth = Field(alias="from", description="lowest frequency")
    high: Bandwidth = Field(alias="to", description="highest frequency")


class FlexibleGirder(Record):
    """The girder as a bending beam on two supports that the magnets' forces bend."""

    line_mass: LineMass = Field(description="mass per length")
    bending_stiffness: BendingStiffness = Field(description="E I")
    damping_ratio: PositiveRatio = Field(0.01, description="of every bending mode")
    modes: int = Field(3, ge=1, le=20, description="bending modes kept")


class Girder(Record):
    """Spans that sag under the vehicle: passed one after another, they shake it at v / span."""

    span: PositiveLength = Field(description="from support to support")
    sag: NonnegativeLength = Field(0.0, description="static deflection at mid-span under the vehicle; a half sine")
    flexible: FlexibleGirder | None = Field(
        None,
        description="a girder that bends by itself, computed together with the vehicle; the sag is not added to it",
    )


class Step(Record):
    """One vertical step of the guideway, passed once."""

    height: Length = Field(description="how far the surface jumps up")
    ramp: PositiveLength = Field(description="length over which it does; the magnets average over their own length")


class Irregularity(Record):
    """How far the guideway is from straight: random in height, sideways and in twist, and what repeats or jumps."""

    vertical: SpectrumRecord | None = Field(None, description="spectrum of the height")
    lateral: SpectrumRecord | None = Field(None, description="spectrum of the lateral place")
    cross_level: SpectrumRecord | None = Field(None, description="spectrum of the height difference left to right")
    cross_level_base: PositiveLength | None = Field(
        None, description="lateral distance over which cross_level is the difference"
    )
    band: Band | None = Field(
        None, description="only waves met in this band count; left out: all, in a simulated guideway those up to 50 Hz"
    )
    girder: Girder | None = Field(None, description="spans between supports")
    step: Step | None = Field(None, description="a single step")


class Passenger(Record):
    """A place in the car where ride is judged."""

    name: Name = Field(description="unique name")
    x: Length = Field(description="forward of the car's centre")
    y: Length = Field(0.0, description="left of the car's centre")
    z: Length = Field(0.0, description="above the car's centre of mass")


class MaskPoint(Record):
    """A corner of an acceleration mask; straight between the corners on logarithmic axes."""

    frequency: Bandwidth = Field(description="of the corner")
    density: AccelerationDensity = Field(description="per hertz")


class Mask(Record):
    """The largest power spectral density of a passenger's acceleration."""

    axis: Literal["vertical", "lateral"] = "vertical"
    points: Many[MaskPoint] = Field(alias="point", min_length=2, max_length=60, description="corners by frequency")


class Ride(Record):
    """Who rides, how far gaps and strokes may close."""

    passengers: Many[Passenger] = Field(
        (), alias="passenger", max_length=40, description="left out: the car's centre and the places over its bogies"
    )
    smallest_height: NonnegativeLength = Field(0.0, description="levitation height at which a magnet touches")
    smallest_gap: NonnegativeLength = Field(0.0, description="guidance gap at which a magnet touches")
    largest_stroke: PositiveLength | None = Field(None, description="way of the secondary suspension to either stop")
    masks: Many[Mask] = Field((), alias="mask", max_length=4, description="acceleration masks")
