"""The `[[requirement]]` parts of a scenario file: what a suspension option has to reach."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from maglev_ctrl.scenario.records import Name, Record
from maglev_ctrl.scenario.units import Angle, Decibel, Payload, PositiveLength, Rate, Ratio, Time

Over = Literal["nominal", "speed", "payload", "height", "gap", "lateral_offset"]
_AT_LEAST = "smallest value that passes"
_AT_MOST = "largest value that passes"

FLOQUET_MARGINS = ("floquet_gain_margin", "floquet_speed_margin")
"""Quantities that ask for a search along gain and speed under the expected modulation."""

PERIODIC_QUANTITIES = ("modulation_ratio", "modulation_depth", *FLOQUET_MARGINS)
"""Quantities that need the table [periodic]."""


class _RequirementBase(Record):
    name: Name = Field(description="unique name")
    over: Over = Field("speed", description="judged at the design point (nominal) or at the worst point of a sweep")

    at_least: float | None
    at_most: float | None
    quantity: str

    @property
    def sense(self) -> Literal["at_least", "at_most"]:
        """On which side of the limit values pass."""
        return "at_most" if self.at_least is None else "at_least"

    @property
    def limit(self) -> float:
        """The limit: SI, decibels for gains."""
        limit = self.at_most if self.at_least is None else self.at_least
        assert limit is not None  # a cross-check of the file asks for exactly one limit
        return limit

    @property
    def unit(self) -> str:
        """Unit of `limit`; "" for ratios."""
        return ""


class RateRequirement(_RequirementBase):
    """Growth rate: the largest real part of the closed-loop eigenvalues."""

    quantity: Literal["growth_rate"]
    at_least: Rate | None = Field(None, description=_AT_LEAST)
    at_most: Rate | None = Field(None, description=_AT_MOST)

    @property
    def unit(self) -> str:
        """Unit of `limit`."""
        return "1/s"


class RatioRequirement(_RequirementBase):
    """Damping ratio, disk margin, and margins that are fractions of their expected or design value."""

    quantity: Literal[
        "damping_ratio", "disk_margin", "modulation_ratio", "modulation_depth", "floquet_speed_margin", "speed_margin"
    ]
    at_least: Ratio | None = Field(None, description=_AT_LEAST)
    at_most: Ratio | None = Field(None, description=_AT_MOST)


class GainRequirement(_RequirementBase):
    """Gain margin, the smaller of gain reduction and gain increase; the Floquet one under the expected modulation."""

    quantity: Literal["gain_margin", "floquet_gain_margin"]
    at_least: Decibel | None = Field(None, description=_AT_LEAST)
    at_most: Decibel | None = Field(None, description=_AT_MOST)

    @property
    def unit(self) -> str:
        """Unit of `limit`."""
        return "dB"


class AngleRequirement(_RequirementBase):
    """Phase margin."""

    quantity: Literal["phase_margin"]
    at_least: Angle | None = Field(None, description=_AT_LEAST)
    at_most: Angle | None = Field(None, description=_AT_MOST)

    @property
    def unit(self) -> str:
        """Unit of `limit`."""
        return "rad"


class TimeRequirement(_RequirementBase):
    """Delay margin: how much more delay the loop survives."""

    quantity: Literal["delay_margin"]
    at_least: Time | None = Field(None, description=_AT_LEAST)
    at_most: Time | None = Field(None, description=_AT_MOST)

    @property
    def unit(self) -> str:
        """Unit of `limit`."""
        return "s"


class MassRequirement(_RequirementBase):
    """Payload margin: how far the payload may change from the design point before stability is lost."""

    quantity: Literal["payload_margin"]
    at_least: Payload | None = Field(None, description=_AT_LEAST)
    at_most: Payload | None = Field(None, description=_AT_MOST)

    @property
    def unit(self) -> str:
        """Unit of `limit`."""
        return "kg"


class LengthRequirement(_RequirementBase):
    """Height or gap margin: how far it may change from the design point before stability is lost."""

    quantity: Literal["height_margin", "gap_margin"]
    at_least: PositiveLength | None = Field(None, description=_AT_LEAST)
    at_most: PositiveLength | None = Field(None, description=_AT_MOST)

    @property
    def unit(self) -> str:
        """Unit of `limit`."""
        return "m"


RequirementRecord = Annotated[
    RateRequirement
    | RatioRequirement
    | GainRequirement
    | AngleRequirement
    | TimeRequirement
    | MassRequirement
    | LengthRequirement,
    Field(discriminator="quantity"),
]
