"""The JSON Schema and the starter teach the format."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

from maglev_ctrl.scenario import json_schema


def quantities(node: Any, path: str = "") -> Iterator[tuple[str, dict[str, Any]]]:
    if isinstance(node, dict):
        if "x-dimension" in node:
            yield path, node
        for key, value in node.items():
            yield from quantities(value, f"{path}/{key}")
    elif isinstance(node, list):
        for index, value in enumerate(node):
            yield from quantities(value, f"{path}/{index}")


def test_every_quantity_shows_dimension_and_example() -> None:
    found = dict(quantities(json_schema()))
    assert len(found) > 50
    for path, schema in found.items():
        assert schema["examples"] and schema["x-dimension"], path


def test_every_field_is_described_or_names_a_described_record() -> None:
    schema = json_schema()
    assert schema["$defs"]["Bogie"]["properties"]["mass"]["description"]
    for name, record in schema["$defs"].items():
        assert record["description"], name
        for key, field in record["properties"].items():
            described = "description" in field or "const" in field or "enum" in field or "$ref" in json.dumps(field)
            assert described, f"{name}.{key}"


def test_keys_are_those_of_the_file() -> None:
    schema = json_schema()
    assert {"option", "requirement", "vehicle", "forces"} <= set(schema["properties"])
    assert {"from", "to", "count"} == set(schema["$defs"]["SpeedSweep"]["properties"])
    assert schema["additionalProperties"] is False


def test_defaults_carry_their_unit() -> None:
    spring = json_schema()["$defs"]["SpringDamperRecord"]["properties"]
    assert spring["lag"]["default"] == "0 s"


def test_it_is_plain_json() -> None:
    assert json.loads(json.dumps(json_schema()))["$schema"].startswith("https://json-schema.org/")
