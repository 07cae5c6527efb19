"""The format as a JSON Schema, for editors and other programs."""

from __future__ import annotations

from typing import Any

from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue
from pydantic_core import core_schema

from maglev_ctrl.scenario.scenario_schema import Scenario


class _WithUnits(GenerateJsonSchema):
    """Writes a default with its unit, as the file would."""

    def default_schema(self, schema: core_schema.WithDefaultSchema) -> JsonSchemaValue:
        """The schema of a field with a default."""
        written = super().default_schema(schema)
        unit, default = written.get("x-unit"), written.get("default")
        if unit is not None and isinstance(default, int | float):
            written["default"] = f"{default:g} {unit}"
        return written


def json_schema() -> dict[str, Any]:
    """JSON Schema of a scenario file; every quantity shows its dimension, its SI unit and an example.

    Examples
    --------
    >>> json_schema()["properties"]["format"]["const"]
    1
    """
    schema = Scenario.model_json_schema(by_alias=True, schema_generator=_WithUnits)
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "maglev-ctrl scenario",
        **{key: value for key, value in schema.items() if key != "title"},
    }
