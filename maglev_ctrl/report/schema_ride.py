"""JSON Schema of ride, worst cases, nonlinear check and tuning in report.json."""

from __future__ import annotations

from typing import Any, Final

NUMBER: Final[dict[str, Any]] = {
    "anyOf": [{"type": "number"}, {"enum": ["NaN", "Infinity", "-Infinity"]}],
    "description": "a finite number, or the word for one that is not finite",
}


def quantity(words: str) -> dict[str, Any]:
    """A number with its unit.

    Examples
    --------
    >>> quantity("design speed")["required"]
    ['value', 'unit']
    """
    return _with_unit(words, NUMBER)


def _with_unit(words: str, value: dict[str, Any]) -> dict[str, Any]:
    return {
        "type": "object",
        "description": words,
        "required": ["value", "unit"],
        "properties": {"value": value, "unit": {"type": "string"}},
    }


def _numbers(words: str) -> dict[str, Any]:
    """A list of numbers with one unit."""
    return _with_unit(words, {"type": "array", "items": NUMBER})


def _record(words: str, properties: dict[str, Any]) -> dict[str, Any]:
    """An object with at least these fields."""
    return {"type": "object", "description": words, "required": list(properties), "properties": properties}


def _list(entry: dict[str, Any]) -> dict[str, Any]:
    return {"type": "array", "items": entry}


def _or_null(record: dict[str, Any]) -> dict[str, Any]:
    return {"anyOf": [{"type": "null"}, record]}


_TEXT: Final[dict[str, Any]] = {"type": "string"}
_VERDICT: Final[dict[str, Any]] = {"enum": ["PASS", "FAIL", "NOT EVALUATED"]}
_AGREEMENT: Final[dict[str, Any]] = {"enum": ["AGREED", "UNRESOLVED"]}

_PASSENGER: Final = _record("one place in the car", {
    "name": _TEXT, "x": quantity("forward of the car's centre of mass"), "y": quantity("left of it"),
    "axes": _list(_TEXT), "weighted": _numbers("frequency-weighted r.m.s. acceleration by axis"),
    "total": quantity("vector sum of the axes"), "comfort": _TEXT, "agreement": _AGREEMENT, "reason": _TEXT,
})  # fmt: skip
_CLEARANCE: Final = _record("a gap or a stroke", {
    "name": _TEXT, "kind": {"enum": ["gap", "stroke"]}, "nominal": quantity("at equilibrium"),
    "clearance": quantity("what it may use up"), "sag": quantity("what the girders use up already"),
    "three_sigma": quantity("three standard deviations"), "used": NUMBER,
    "crossing_rate": quantity("level crossings by Rice's formula"), "contact_per_hour": NUMBER,
    "agreement": _AGREEMENT, "reason": _TEXT,
})  # fmt: skip
_ACTUATOR: Final = _record("what an actuator has to give", {
    "name": _TEXT, "force": quantity("standard deviation"), "rate": quantity("standard deviation"),
    "mean_power": quantity("given to the vehicle"), "supplied_power": quantity("mean of the positive part"),
    "energy_per_hour": quantity("of the supplied power"), "limit": quantity("NaN without one"),
    "three_sigma_share": NUMBER, "saturated": NUMBER, "agreement": _AGREEMENT, "reason": _TEXT,
})  # fmt: skip
_RESPONSE: Final = _record("response to the random guideway at one speed", {
    "speed": quantity("speed"), "passengers": _list(_PASSENGER), "clearances": _list(_CLEARANCE),
    "actuators": _list(_ACTUATOR), "spectra": _list({"type": "object"}), "agreement": _AGREEMENT,
    "largest_difference": NUMBER, "reason": _TEXT,
})  # fmt: skip
_RIDE: Final = _record("ride of the option; `points` begin with the design point", {
    "points": _list(_record("an operating point", {
        "where": _TEXT, "speed": quantity("speed"), "payload": quantity("payload"), "response": _or_null(_RESPONSE),
        "reason": _TEXT,
    })),
    "masks": _list({"type": "object"}), "passing": _or_null({"type": "object"}),
    "flexible": _or_null({"type": "object"}), "step": _or_null({"type": "object"}), "spectrum": _TEXT,
})  # fmt: skip

_WORST_POINT: Final = _record("worst value found of one quantity, in `unit`", {
    "nominal": NUMBER, "value": NUMBER, "changes": _list(NUMBER), "percent": _numbers("changes of the parameters"),
    "frequency": quantity("of the mode or of the margin"), "verified": {"type": "boolean"}, "reason": _TEXT,
    "unit": _TEXT,
})  # fmt: skip
_ROBUSTNESS: Final = _record("worst cases within the spreads of the parameters", {
    "names": _list(_TEXT), "spreads": _list(NUMBER), "stable": _VERDICT,
    "factor": _record("factor on all spreads: guaranteed and found", {
        "proven": NUMBER, "found": NUMBER, "changes": _list(NUMBER), "frequency": quantity("of the pole"),
        "agreement": _AGREEMENT, "reason": _TEXT,
    }),
    "growth": _WORST_POINT, "damping": _WORST_POINT, "disk": _WORST_POINT, "agreement": _AGREEMENT, "reason": _TEXT,
})  # fmt: skip

_NONLINEAR: Final = _record("the nonlinear vehicle on several random guideways", {
    "runs": {"type": "number"}, "duration": quantity("of a run"), "speed": quantity("speed"),
    "compared": _list(_record("linear beside nonlinear, with the confidence band of the latter", {
        "name": _TEXT, "linear": quantity("linear theory"), "nonlinear": quantity("nonlinear vehicle"),
        "low": quantity("band"), "high": quantity("band"), "agreement": _AGREEMENT, "reason": _TEXT,
    })),
    "events": _list(_record("what ended a run", {
        "run": {"type": "number"}, "time": quantity("after the start"), "kind": _TEXT, "element": _TEXT,
        "value": quantity("closing speed at contact; NaN otherwise"), "words": _TEXT,
    })),
    "limit_cycle": _TEXT, "assumptions": _list(_TEXT),
})  # fmt: skip

OPTION_PARTS: Final[dict[str, Any]] = {
    part: schema
    for name, record in (("ride", _RIDE), ("robustness", _ROBUSTNESS), ("nonlinear", _NONLINEAR))
    for part, schema in ((name, _or_null(record)), (f"{name}_reason", {"type": "string"}))
}
"""Parts of an option that a scenario may ask for; absent in files of earlier versions."""

TUNING: Final[dict[str, Any]] = _or_null(_record("all options' searches; null where nothing was tuned", {
    "method": _TEXT,
    "objectives": _list(_record("SI values times `scale` are in `unit`", {
        "name": _TEXT, "label": _TEXT, "unit": _TEXT, "scale": NUMBER, "sense": {"enum": ["smaller", "larger"]},
    })),
    "situations": _list(_TEXT),
    "options": _list(_record("one search; columns of `front` in the order of `objectives`", {
        "option": _TEXT, "label": _TEXT,
        "variables": _list(_record("SI values times `scale` are in `unit`", {
            "name": _TEXT, "label": _TEXT, "unit": _TEXT, "scale": NUMBER, "lower": quantity("range"),
            "upper": quantity("range"), "value": quantity("chosen"), "text": _TEXT,
            "at_bound": {"enum": ["", "lower", "upper"]},
        })),
        "front": _with_unit("objectives, one row a candidate", _list(_list(NUMBER))),
        "chosen": {"type": "number"}, "knee": {"type": "number"}, "feasible": {"type": "boolean"}, "binding": _TEXT,
        "violation": NUMBER, "seed": {"type": "number"}, "reason": _TEXT,
    })),
    "ranking": _list(_record("an option's place", {
        "option": _TEXT, "place": {"type": "number"}, "distance": NUMBER, "misses": _list(_TEXT),
    })),
    "shifts": _list(_record("the ranking with one limit or weight changed", {
        "what": _TEXT, "factor": NUMBER, "places": _list({"type": "number"}), "first": _TEXT,
        "changed": {"type": "boolean"},
    })),
}))  # fmt: skip
