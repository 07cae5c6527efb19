"""The `[forces]` part of a scenario file: where the magnetic forces come from."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import Field
from pydantic_core import PydanticCustomError, core_schema

from maglev_ctrl.scenario.guideway_schema import EddyCurrentForces
from maglev_ctrl.scenario.records import Many, Record
from maglev_ctrl.scenario.units import (
    Area,
    Conductivity,
    Current,
    FluxDensity,
    Inductance,
    NonnegativeLength,
    PositiveLength,
    PositiveRatio,
    Resistance,
    Speed,
)

if TYPE_CHECKING:
    from pydantic import GetCoreSchemaHandler, GetJsonSchemaHandler

Row = tuple[float, ...]
Matrix = tuple[Row, ...]


@dataclass(frozen=True, slots=True)
class _Matrices:
    """Annotation of one 6 x 6 matrix of numbers, or a list of them; the record always keeps a list of matrices."""

    def _validate(self, value: object) -> tuple[Matrix, ...]:
        if isinstance(value, list) and value:
            matrices = value if isinstance(value[0], list) and value[0] and isinstance(value[0][0], list) else [value]
            if all(_is_matrix(matrix) for matrix in matrices):
                return tuple(tuple(tuple(float(x) for x in row) for row in matrix) for matrix in matrices)
        raise PydanticCustomError(
            "matrix", "expected 6 rows of 6 finite numbers, or a list of such matrices, one per speed"
        )

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> core_schema.CoreSchema:
        return core_schema.no_info_plain_validator_function(self._validate)

    def __get_pydantic_json_schema__(
        self, schema: core_schema.CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        row = {"type": "array", "items": {"type": "number"}, "minItems": 6, "maxItems": 6}
        matrix = {"type": "array", "items": row, "minItems": 6, "maxItems": 6}
        return {"anyOf": [matrix, {"type": "array", "items": matrix, "minItems": 1}]}


def _is_matrix(value: object) -> bool:
    return isinstance(value, list) and len(value) == 6 and all(
        isinstance(row, list) and len(row) == 6 and all(_is_number(x) for x in row) for row in value
    )  # fmt: skip


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


Matrices = Annotated[tuple[Matrix, ...], _Matrices()]


class ImageForces(Record):
    """Image force over a thin conducting sheet; the current follows from the weight at the design point."""

    model: Literal["image"]
    exponent: PositiveRatio = Field(
        description="n of the lift ratio 1 - (1 + (v/w)^2)^-n: 1 for a wide sheet, 1/2, 1/3, 1/5 for narrow coils"
    )
    thickness: PositiveLength = Field(description="thickness of the conducting sheet")
    conductivity: Conductivity = Field(description="conductivity of the sheet; 2.5e7 S/m is aluminium")
    vertical_velocity: Literal["none", "receding_image"] = Field(
        "none", description="receding_image: lift also depends on the vertical velocity; exponent 1 only"
    )
    current: Current | None = Field(None, description="current of one magnet; left out, it lifts the weight")
    length: PositiveLength | None = Field(None, description="effective length of one magnet; needed with `current`")


class CornerImageForces(Record):
    """Coil in the corner of a perfectly conducting L-shaped guideway: lift and guidance at infinite speed, no drag."""

    model: Literal["corner_image"]
    coil_length: PositiveLength = Field(description="length of the coil along the track")
    coil_width: PositiveLength = Field(description="width of the coil across the track")
    coil_thickness: PositiveLength = Field(description="thickness of the magnet the coil stands for")
    current: Current | None = Field(None, description="current of one magnet; left out, it lifts the weight")


class TableForces(Record):
    """Measured or computed forces of one magnet in a CSV file beside the scenario.

    Columns height, gap, speed, lift, guidance, drag with the unit in the header: `height [mm], speed [m/s], ...`.
    """

    model: Literal["table"]
    file: str = Field(min_length=1, max_length=200, description="CSV file in the scenario's folder or below it")
    method: Literal["spline", "polynomial"] = Field(
        "spline", description="spline: a regular grid of points; polynomial: least squares through scattered points"
    )
    degree: int = Field(3, ge=1, le=9, description="degree of the polynomial")
    trim_to_weight: bool = Field(True, description="scale all forces so that the magnets lift the weight")


class ElectromagnetForces(Record):
    """Attractive electromagnets that hang under a rail (EMS): unstable until a control law drives them.

    operating.height is their air gap, from pole face to rail; it closes when the vehicle rises.
    """

    model: Literal["electromagnet"]
    turns: int = Field(gt=0, le=100_000, description="turns of one winding")
    pole_area: Area = Field(description="area of one pole face; the flux crosses two of them")
    resistance: Resistance = Field(description="resistance of one winding")
    leakage: Inductance = Field(0.0, description="inductance of the flux that misses the rail; it adds no force")
    iron_gap: NonnegativeLength = Field(
        0.0, description="length of the flux path in iron over the iron's relative permeability"
    )
    flux_limit: FluxDensity | None = Field(
        None, description="flux density in the gap at which the iron saturates; above it the study refuses"
    )
    drive: Literal["voltage", "current"] = Field(
        "voltage", description="what a control law commands: the voltage of a winding, or its current"
    )
    count: int = Field(1, gt=0, le=1000, description="electromagnets in one magnet of the vehicle, wired alike")
    current: Current | None = Field(None, description="standing current of a winding; left out, it lifts the weight")


class CoefficientForces(Record):
    """Measured matrices of mass, damping and stiffness of one body's six freedoms, about its CM, in SI units."""

    model: Literal["coefficients"]
    speeds: Many[Speed] = Field(
        (), description="speed of each matrix, increasing; left out, one matrix of each kind holds at every speed"
    )
    mass: Matrices = Field(description="6 x 6, order surge, sway, heave, roll, pitch, yaw")
    damping: Matrices = Field(description="6 x 6, same order")
    stiffness: Matrices = Field(description="6 x 6, same order")
    units: Literal["SI"] = Field(description="SI: kg, N s/m, N/m and their rotational kin")
    convention: Literal["left_hand_side", "force_on_vehicle"] = Field(
        description="left_hand_side: positive stiffness restores; force_on_vehicle: derivatives of the force, opposite"
    )


ForceRecord = Annotated[
    ImageForces | CornerImageForces | EddyCurrentForces | ElectromagnetForces | TableForces | CoefficientForces,
    Field(discriminator="model"),
]
