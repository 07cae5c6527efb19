"""Directives that write the reference from the code.

`scenario-reference` (every table and key, from the JSON Schema), `requirement-packs` (every pack with the sources of
its limits) and `scenario-library` (every file).
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from math import degrees
from pathlib import Path
from typing import Any

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

from maglev_ctrl.scenario import json_schema, load
from maglev_ctrl.scenario.requirement_packs import SOURCES, pack_requirements

ROOT = Path(__file__).resolve().parents[2]

Schema = dict[str, Any]

TITLES = {
    "Operating": "[operating]",
    "Sweeps": "operating.sweep",
    "Periodic": "[periodic]",
    "PeriodicMap": "periodic.map",
    "OptionRecord": "[[option]]",
    "SpringDamperRecord": "[[option.spring_damper]]",
    "ActuatorRecord": "[[option.actuator]]",
    "Car": "[vehicle.car]",
    "Bogie": "[[vehicle.bogie]]",
    "Secondary": "[vehicle.secondary]",
    "Magnets": "[vehicle.magnets]",
    "Aerodynamics": "[vehicle.aerodynamics]",
    "Allowed": "option.control.allowed",
    "Amount": "option.control.integral, start, load",
    "Limit": "[[option.control.limit]]",
    "Corners": "corners",
    "DampingBudget": "[option.damping_budget]",
    "CoilRecord": "[[forces.coil]]",
    "Rectangle": "[[forces.guideway.plate]]",
    "Outline": "[[forces.guideway.conductor]]",
    "LengthRange": "forces.height_range, gap_range",
    "SpeedRange": "forces.velocity_range",
    "TuneRecord": "[[option.tune]]",
    "Irregularity": "[irregularity]",
    "Band": "irregularity.band",
    "Girder": "[irregularity.girder]",
    "FlexibleGirder": "[irregularity.girder.flexible]",
    "Step": "[irregularity.step]",
    "Ride": "[ride]",
    "Passenger": "[[ride.passenger]]",
    "Mask": "[[ride.mask]]",
    "MaskPoint": "[[ride.mask.point]]",
    "Uncertainty": "[uncertainty]",
    "Tuning": "[tuning]",
    "Simulation": "[simulation]",
}


class ScenarioReference(SphinxDirective):
    """Sections of tables, one per record of the schema, in the order in which a file meets them."""

    has_content = False

    def run(self) -> list[nodes.Node]:
        """Build the sections."""
        schema = json_schema()
        records = schema["$defs"]
        top = self.section("The file", schema, records)
        return [top, *(self.section(title(name, records[name]), records[name], records) for name in in_order(schema))]

    def section(self, heading: str, record: Schema, records: dict[str, Schema]) -> nodes.section:
        """One record: what it is, and a table of its keys."""
        anchor = nodes.make_id(f"scenario {heading}")
        section = nodes.section(ids=[anchor])
        of_the_file = "[" in heading or '"' in heading
        section += nodes.title(heading, "", nodes.literal(heading, heading) if of_the_file else nodes.Text(heading))
        self.state.document.note_implicit_target(section, section)
        for paragraph in record.get("description", "").split("\n\n"):
            if paragraph.strip():
                section += nodes.paragraph("", "", *words(paragraph.strip()))
        required = set(record.get("required", ()))
        rows = [
            (key, value_words(prop, records), "required" if key in required else default_words(prop), meaning(prop))
            for key, prop in record.get("properties", {}).items()
        ]
        section += key_table(rows)
        return section


class RequirementPacks(SphinxDirective):
    """A table of the packs: what each asks for, and where its limits come from."""

    has_content = False

    def run(self) -> list[nodes.Node]:
        """Build the table."""
        rows = []
        for pack, source in SOURCES.items():
            asked = "; ".join(
                f"`{one.quantity}` {one.sense.replace('_', ' ')} {limit_words(one.limit, one.unit)}"
                for one in pack_requirements(pack, swept=True)
            )
            rows.append((pack, asked, source))
        return [key_table(rows, heads=("Pack", "Asks for", "Source of the limits"), widths=(22, 38, 40))]


class ScenarioLibrary(SphinxDirective):
    """A table of the scenario files of the project, read by the project's own reader."""

    has_content = False

    def run(self) -> list[nodes.Node]:
        """Build the table."""
        rows = []
        for path in sorted((ROOT / "scenarios").rglob("*.toml")):
            self.env.note_dependency(str(path))
            scenario = load(path)
            about = " ".join(scenario.description.split())
            first = re.split(r"(?<!Eq\.)(?<!Eqs\.)(?<!Sec\.)(?<=[.;]) ", about, maxsplit=1)[0]
            kinds = ", ".join(dict.fromkeys(option.kind.replace("_", " ") for option in scenario.options))
            rows.append((path.relative_to(ROOT / "scenarios").as_posix(), scenario.title, kinds, first))
        return [key_table(rows, heads=("File", "Title", "Options", "About"), widths=(30, 26, 18, 26))]


def title(name: str, record: Schema) -> str:
    """Heading of a record: the table it stands for in the file, with the choice that selects it."""
    if name in TITLES:
        return TITLES[name]
    properties = record.get("properties", {})
    if "quantity" in properties:
        chosen = properties["quantity"]
        values = [chosen["const"]] if "const" in chosen else chosen["enum"]
        return f"[[requirement]] quantity = {', '.join(values)}"
    for key in ("model", "law", "kind", "shape", "form"):
        chosen = properties.get(key, {})
        values = [chosen["const"]] if "const" in chosen else chosen.get("enum", [])
        if values:
            if name.endswith("Source"):
                return f'[[periodic.source]] {key} = "{values[0]}"'
            table = {
                "law": "[option.control]", "kind": "[[option.sensor]]", "shape": "[forces.guideway]",
                "form": "irregularity.vertical, lateral, cross_level:",
            }.get(key, "[forces]" if name.endswith("Forces") else "[vehicle]")  # fmt: skip
            return f"{table} {key} = {' or '.join(literal(value) for value in values)}"
    return re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name)


def in_order(schema: Schema) -> list[str]:
    """Names of the records, depth first from the top of the file."""
    found: list[str] = []

    def walk(part: Schema) -> None:
        for name in references(part):
            if name not in found:
                found.append(name)
                walk(schema["$defs"][name])

    walk({key: value for key, value in schema.items() if key != "$defs"})
    return found


def references(part: object) -> Iterator[str]:
    """Names of the records a part of the schema refers to, in order."""
    if isinstance(part, dict):
        for key, value in part.items():
            if key == "$ref":
                yield value.rsplit("/", 1)[-1]
            elif key != "discriminator":
                yield from references(value)
    elif isinstance(part, list):
        for item in part:
            yield from references(item)


def value_words(prop: Schema, records: dict[str, Schema]) -> str:
    """What a key holds, in words."""
    if "$ref" in prop:
        name = prop["$ref"].rsplit("/", 1)[-1]
        return f"table `{title(name, records[name])}`"
    if "anyOf" in prop or "oneOf" in prop:
        choices = [c for c in prop.get("anyOf", prop.get("oneOf", [])) if c.get("type") != "null"]
        if len(choices) > 1 and all("$ref" in choice for choice in choices):
            return "table, one of the kinds below"
        return " or ".join(dict.fromkeys(value_words(choice, records) for choice in choices))
    if "const" in prop:
        return f"`{literal(prop['const'])}`"
    if "enum" in prop:
        return ", ".join(f"`{literal(value)}`" for value in prop["enum"])
    if "x-dimension" in prop:
        example = f", such as `{literal(prop['examples'][0])}`" if prop.get("examples") else ""
        return f"{prop['x-dimension']}{example}"
    if prop.get("type") == "array":
        return f"list of: {value_words(prop.get('items', {}), records)}"
    if isinstance(prop.get("additionalProperties"), dict):
        return "table of texts"
    return {"string": "text", "integer": "whole number", "number": "number", "boolean": "`true` or `false`"}.get(
        prop.get("type", ""), "value"
    )


def default_words(prop: Schema) -> str:
    """The default of a key, or that it may be left out."""
    default = prop.get("default")
    if default in (None, [], (), "", {}):
        return "may be left out"
    return f"`{literal(default)}`"


def meaning(prop: Schema) -> str:
    """The description of a key with its limits."""
    limits = [
        f"{word} {prop[key]:g}"
        for key, word in (("minimum", "at least"), ("exclusiveMinimum", "above"), ("maximum", "at most"))
        if key in prop
    ]
    return "; ".join([prop.get("description", ""), *limits] if prop.get("description") else limits)


def literal(value: object) -> str:
    """A value as the file writes it."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return f'"{value}"'
    if isinstance(value, list):
        return "[" + ", ".join(literal(item) for item in value) + "]"
    return str(value)


def words(text: str) -> list[nodes.Node]:
    """Text with `code` in backquotes."""
    parts: list[nodes.Node] = []
    for place, piece in enumerate(text.split("`")):
        if piece:
            parts.append(nodes.literal(piece, piece) if place % 2 else nodes.Text(piece))
    return parts


def limit_words(limit: float, unit: str) -> str:
    """A limit as people write it: angles in degrees, short times in milliseconds."""
    scale, unit = {"rad": (degrees(1.0), "deg"), "s": (1e3, "ms")}.get(unit, (1.0, unit))
    return f"{scale * limit:g} {unit}".rstrip()


def key_table(
    rows: Sequence[tuple[str, ...]],
    *,
    heads: tuple[str, ...] = ("Key", "Value", "Default", "Meaning"),
    widths: tuple[int, ...] = (16, 34, 18, 32),
) -> nodes.table:
    """A table whose first column is literal text."""
    group = nodes.tgroup(cols=len(widths))
    for width in widths:
        group += nodes.colspec(colwidth=width)
    head, body = nodes.thead(), nodes.tbody()
    head += row_of([nodes.paragraph("", label) for label in heads])
    for key, *told in rows:
        cells = [nodes.paragraph("", "", nodes.literal(key, key))]
        cells += [nodes.paragraph("", "", *words(text)) for text in told]
        body += row_of(cells)
    group += [head, body]
    return nodes.table("", group)


def row_of(cells: list[nodes.paragraph]) -> nodes.row:
    """A table row."""
    row = nodes.row()
    for cell in cells:
        row += nodes.entry("", cell)
    return row


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the directive."""
    app.add_directive("scenario-reference", ScenarioReference)
    app.add_directive("requirement-packs", RequirementPacks)
    app.add_directive("scenario-library", ScenarioLibrary)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
