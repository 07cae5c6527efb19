"""The `[[requirement]]` parts of a scenario file: what a suspension option has to reach."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from maglev_ctrl.scenario.records import Name, Record
from maglev_ctrl.scenario.units import (
    Acceleration,
    Angle,
    Decibel,
    ForceRate,
    Payload,
    PositiveLength,
    Power,
    Rate,
    Ratio,
    Time,
)

Over = Literal["nominal", "speed", "payload", "height", "gap", "lateral_offset"]
_AT_LEAST = "smallest value that passes"
_AT_MOST = "largest value that passes"

FLOQUET_MARGINS = ("floquet_gain_margin", "floquet_speed_margin")
"""Quantities that ask for a search along gain and speed under the expected modulation."""

PERIODIC_QUANTITIES = ("modulation_ratio", "modulation_depth", *FLOQUET_MARGINS)
"""Quantities that need the table [periodic]."""


RIDE_QUANTITIES = (
    "weighted_acceleration", "acceleration_mask", "gap_used", "stroke_used", "contact_probability", "force_used",
    "supplied_power", "force_rate",
)  # fmt: skip
"""Quantities that need the table [irregularity]."""

ROBUST_QUANTITIES = ("robust_factor", "worst_case_growth", "worst_case_damping")
"""Quantities that need the table [uncertainty]."""


class _RequirementBase(Record):
    later_keys: ClassVar[frozenset[str]] = frozenset({"hard", "passenger"})

    name: Name = Field(description="unique name")
    hard: bool = Field(True, description="false: a wish; missing it is told, but does not fail the option")
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
    """Growth rate: the largest real part of the closed-loop eigenvalues; also over the uncertain parameters."""

    quantity: Literal["growth_rate", "worst_case_growth"]
    at_least: Rate | None = Field(None, description=_AT_LEAST)
    at_most: Rate | None = Field(None, description=_AT_MOST)

    @property
    def unit(self) -> str:
        """Unit of `limit`."""
        return "1/s"


class RatioRequirement(_RequirementBase):
    """Ratios: damping, disk margin, sensitivity peak, margins relative to their expected or design value, and shares of
    a clearance, a limit or a mask that are used up.
    """

    quantity: Literal[
        "damping_ratio", "disk_margin", "modulation_ratio", "modulation_depth", "floquet_speed_margin", "speed_margin",
        "sensitivity_peak", "robust_factor", "worst_case_damping", "acceleration_mask", "gap_used", "stroke_used",
        "contact_probability", "force_used",
    ]  # fmt: skip
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


class AccelerationRequirement(_RequirementBase):
    """Ride comfort: frequency-weighted r.m.s. acceleration of the worst passenger, or of one."""

    quantity: Literal["weighted_acceleration"]
    passenger: Name | None = Field(None, description="one passenger; left out: the worst")
    at_least: Acceleration | None = Field(None, description=_AT_LEAST)
    at_most: Acceleration | None = Field(None, description=_AT_MOST)

    @property
    def unit(self) -> str:
        """Unit of `limit`."""
        return "m/s^2"


class PowerRequirement(_RequirementBase):
    """Power that all actuators together draw without recuperation."""

    quantity: Literal["supplied_power"]
    at_least: Power | None = Field(None, description=_AT_LEAST)
    at_most: Power | None = Field(None, description=_AT_MOST)

    @property
    def unit(self) -> str:
        """Unit of `limit`."""
        return "W"


class ForceRateRequirement(_RequirementBase):
    """Rate of the largest actuator force, r.m.s."""

    quantity: Literal["force_rate"]
    at_least: ForceRate | None = Field(None, description=_AT_LEAST)
    at_most: ForceRate | None = Field(None, description=_AT_MOST)

    @property
    def unit(self) -> str:
        """Unit of `limit`."""
        return "N/s"


RequirementRecord = Annotated[
    RateRequirement
    | AccelerationRequirement
    | PowerRequirement
    | ForceRateRequirement
    | RatioRequirement
    | GainRequirement
    | AngleRequirement
    | TimeRequirement
    | MassRequirement
    | LengthRequirement,
    Field(discriminator="quantity"),
]
