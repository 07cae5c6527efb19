"""The `[[option]]` parts of a scenario file: what is added to the bare vehicle, and the control law."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

from pydantic import Field
from pydantic_core import PydanticCustomError, core_schema

from maglev_ctrl.scenario.control_schema import ControlRecord, DampingBudget
from maglev_ctrl.scenario.records import Many, Name, Record
from maglev_ctrl.scenario.tuning_schema import TuneRecord
from maglev_ctrl.scenario.units import (
    LENGTH,
    AccelerationNoise,
    Bandwidth,
    CurrentNoise,
    Damping,
    Force,
    Length,
    LengthNoise,
    SpeedNoise,
    Stiffness,
    Time,
    Unit,
)

if TYPE_CHECKING:
    from pydantic import GetCoreSchemaHandler, GetJsonSchemaHandler

OptionKind = Literal[
    "baseline", "passive_primary", "active_primary", "passive_secondary", "active_secondary", "combined"
]
Direction = Literal["vertical", "lateral"]
Ends = Annotated[Many[Name], Field(min_length=2, max_length=2)]
_BETWEEN = 'two ends out of "car", a bogie, "guideway", or "bogies" for one such element on every bogie'


class SpringDamperRecord(Record):
    """A spring and damper in parallel; with a lag it is an eddy-current or shorted-coil damper."""

    name: Name = Field(description='unique name; with "bogies" the elements are called <name>_<bogie>')
    between: Ends = Field(description=_BETWEEN)
    stiffness: Stiffness = Field(0.0, description="stiffness; positive restores")
    damping: Damping = Field(0.0, description="damping; positive dissipates")
    lag: Time = Field(0.0, description="time constant L/R of the damper")
    at: Length | None = Field(None, description="x where it acts; left out: at the bogie, or at the body's centre")
    direction: Direction = Field("vertical", description="direction of the force")


class ActuatorRecord(Record):
    """A force actuator; positive force pushes the first end up (or to the left)."""

    name: Name = Field(description='unique name; with "bogies" the actuators are called <name>_<bogie>')
    between: Ends = Field(description=_BETWEEN)
    force_limit: Force | None = Field(None, description="largest force")
    bandwidth: Bandwidth | None = Field(None, description="bandwidth of the first-order lag from command to force")
    delay: Time = Field(0.0, description="delay from command to force")
    at: Length | None = Field(None, description="x where it acts; left out: at the bogie, or at the body's centre")
    direction: Direction = Field("vertical", description="direction of the force")


@dataclass(frozen=True, slots=True)
class _Where:
    """Annotation of a place along the vehicle: a length, or the word "bogies"."""

    reads: ClassVar[Unit] = LENGTH

    def _validate(self, value: object) -> float | str:
        if value == "bogies":
            return "bogies"
        try:
            return self.reads.read(value)
        except ValueError as error:
            reason = f'{error}, or the word "bogies"'
            raise PydanticCustomError("quantity", "{reason}", {"reason": reason}) from None

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> core_schema.CoreSchema:
        return core_schema.no_info_plain_validator_function(self._validate)

    def __get_pydantic_json_schema__(
        self, schema: core_schema.CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        return {"type": "string", "examples": ["bogies", "3.5 m"], "x-dimension": "length, or the word bogies"}


Where = Annotated[float | Literal["bogies"], _Where()]


class _SensorBase(Record):
    name: Name = Field(description="unique name; where there is one per bogie they are called <name>_<bogie>")
    on: Name = Field(description='body that carries it: "car", a bogie, or "bogies" for one on each')
    at: Where | None = Field(
        None, description='x where it measures: a length, or "bogies" for one at each bogie; default the body\'s centre'
    )
    direction: Direction = Field("vertical", description="direction it measures")


class GapSensor(_SensorBase):
    """Distance to the guideway; under a rail it shrinks where the vehicle rises."""

    kind: Literal["gap"]
    noise: LengthNoise | None = Field(None, description="noise density; the LQG filter needs it")


class StrokeSensor(_SensorBase):
    """Distance to another body."""

    kind: Literal["stroke"]
    to: Name = Field(description='the other body; "bogies" for the bogie under it')
    noise: LengthNoise | None = Field(None, description="noise density; the LQG filter needs it")


class VelocitySensor(_SensorBase):
    """Absolute velocity."""

    kind: Literal["velocity"]
    noise: SpeedNoise | None = Field(None, description="noise density; the LQG filter needs it")


class AccelerationSensor(_SensorBase):
    """Absolute acceleration."""

    kind: Literal["acceleration"]
    noise: AccelerationNoise | None = Field(None, description="noise density; the LQG filter needs it")


class CurrentSensor(_SensorBase):
    """Current of each electromagnet on a body, driven by voltage; one per magnet, called <name>_<magnet>."""

    kind: Literal["current"]
    noise: CurrentNoise | None = Field(None, description="noise density; the LQG filter needs it")


SensorRecord = Annotated[
    GapSensor | StrokeSensor | VelocitySensor | AccelerationSensor | CurrentSensor, Field(discriminator="kind")
]


class OptionRecord(Record):
    """One suspension option: the elements added to the bare vehicle, and the control law of its actuators."""

    later_keys: ClassVar[frozenset[str]] = frozenset({"damping_budget", "tunes"})

    name: Name = Field(description="unique name")
    label: str = Field("", max_length=80, description="name in tables and figures; left out: the name")
    description: str = Field("", max_length=4000, description="a remark for the report")
    kind: OptionKind = Field(description="which of the suspension families it belongs to")
    spring_dampers: Many[SpringDamperRecord] = Field(
        (), alias="spring_damper", max_length=100, description="passive elements"
    )
    actuators: Many[ActuatorRecord] = Field((), alias="actuator", max_length=100, description="active elements")
    sensors: Many[SensorRecord] = Field((), alias="sensor", max_length=200, description="what the control law measures")
    control: ControlRecord | None = Field(None, description="the law that drives the actuators")
    damping_budget: DampingBudget | None = Field(
        None, description="choose the damping of the option's spring_dampers instead of prescribing it"
    )
    tunes: Many[TuneRecord] = Field((), alias="tune", max_length=12, description="values that tuning chooses")
