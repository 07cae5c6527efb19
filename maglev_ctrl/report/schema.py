"""JSON Schema (draft 2020-12) of report.json: what a program may rely on in every format 1 file."""

from __future__ import annotations

from typing import Any, Final

from maglev_ctrl.report.schema_ride import OPTION_PARTS, TUNING, quantity

_VERDICT: Final = {"enum": ["PASS", "FAIL", "NOT EVALUATED"]}


_REQUIREMENT: Final = {
    "type": "object",
    "required": ["name", "quantity", "description", "sense", "limit", "value", "verdict", "margin_percent", "worst_at",
                 "method", "reason", "bound"],
    "properties": {
        "sense": {"enum": ["at_least", "at_most"]},
        "limit": quantity("the limit asked for"),
        "value": quantity("the value found; NaN when not evaluated"),
        "margin_percent": quantity("distance inside the limit, per cent of the limit"),
        "verdict": _VERDICT,
        "worst_at": {"type": "string", "description": "operating point that decides"},
        "reason": {"type": "string", "description": "why it failed or could not be evaluated, or what a "
                   "passing bound is a bound of; otherwise empty"},
        "bound": {"enum": ["exact", "lower", "upper"], "description": "lower: the true value is at least `value`"},
        "hard": {"type": "boolean", "description": "false: a wish, whose missing fails nothing; absent in files of "
                 "earlier versions, where all are hard"},
    },
}  # fmt: skip

_PERIODIC_MARGIN: Final = {
    "type": "object",
    "description": "how far one quantity may go before a Floquet multiplier reaches one; `safe` and `unsafe` are the "
    "ends of the bracket, verified by both engines, NaN where there is none",
    "required": ["quantity", "nominal", "limit", "safe", "unsafe", "bound", "agreement", "tongue", "unmodulated",
                 "missed_width", "sought", "reason"],
    "properties": {
        "quantity": {"enum": ["depth", "gain factor", "speed"]},
        "nominal": quantity("the design's own value"),
        "limit": quantity("where the search ended"),
        "safe": quantity("stable as far as this"),
        "unsafe": quantity("unstable here"),
        "bound": {"enum": ["exact", "lower", "upper"], "description": "lower: stable as far as `safe` at least; upper: "
                  "lost at `unsafe` at the latest"},
        "agreement": {"enum": ["AGREED", "UNRESOLVED"]},
        "missed_width": quantity("an unstable interval narrower than this may be missed unless it is one of `sought`; "
                                  "a ratio - 1 for the gain factor"),
        "reason": {"type": "string"},
    },
}  # fmt: skip
_BOTH_WAYS: Final = {
    "anyOf": [{"type": "null"}, {"type": "array", "items": _PERIODIC_MARGIN}],
    "description": "down, up",
}
_MARGINS: Final = {
    "type": "object",
    "required": ["depth", "gain", "speed"],
    "properties": {"depth": _PERIODIC_MARGIN, "gain": _BOTH_WAYS, "speed": _BOTH_WAYS},
}
_FLOQUET: Final = {
    "type": "object",
    "properties": {
        "margins": {"anyOf": [{"type": "null"}, _MARGINS]},
        "margins_reason": {"type": "string", "description": "why there are no margins, or what is missing among them"},
    },
}

SCHEMA: Final[dict[str, Any]] = {
    "$schema": "https://json-schema.org/draft/2020-12/schema",
    "title": "maglev-ctrl comparison, format 1",
    "description": "Quantities with a unit are {value, unit}; complex numbers and arrays are {re, im}; arrays are "
    "nested lists in row order; fields that could not be computed are null and the record says why.",
    "type": "object",
    "required": ["format", "kind", "title", "verdict", "scenario_hash", "versions", "created", "options",
                 "design_speed",
                 "design_height"],
    "properties": {
        "format": {"const": 1},
        "kind": {"const": "maglev-ctrl comparison"},
        "verdict": _VERDICT,
        "scenario_hash": {"type": "string"},
        "scenario_text": {"type": "string"},
        "versions": {"type": "array", "items": {"type": "array", "items": {"type": "string"}}},
        "created": {"type": "string", "description": "ISO 8601, UTC"},
        "design_speed": quantity("design speed"),
        "design_height": quantity("levitation height at the design point"),
        "tuning": TUNING,
        "options": {
            "type": "array",
            "items": {
                "type": "object",
                "required": ["name", "label", "kind", "verdict", "failure", "requirements", "modes", "margins",
                             "floquet",
                             "sweeps"],
                "properties": {
                    "verdict": _VERDICT, "requirements": {"type": "array", "items": _REQUIREMENT},
                    "floquet": {"anyOf": [{"type": "null"}, _FLOQUET]}, **OPTION_PARTS,
                },
            },
        },
    },
}  # fmt: skip
