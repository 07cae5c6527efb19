"""What the page tells the browser, as plain values for JSON: the browser shows every text as text."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from maglev_ctrl.report.model import SIGNS, SLUGS
from maglev_ctrl.workbench.jobs import JobView
from maglev_ctrl.workbench.sources import Sources

if TYPE_CHECKING:
    from collections.abc import Iterable

    from maglev_ctrl.scenario import Scenario
    from maglev_ctrl.scenario.problems import Problem
    from maglev_ctrl.study.live.records import LiveQuantity, LiveView

Event = dict[str, Any]
_DESIGN = {"speed": "speed", "height": "height", "gap": "gap"}


def sources_event(sources: Sources) -> Event:
    """The list of scenarios to choose from."""
    listed = [{"key": one.key, "label": one.path.stem.replace("_", " "), "group": one.group} for one in sources.listed]
    return {"kind": "sources", "listed": listed, "words": sources.words}


def opened_event(scenario: Scenario, option: str, quantities: Iterable[LiveQuantity]) -> Event:
    """The scenario shown, its options, and the sliders of the one looked at."""
    return {
        "kind": "opened",
        "title": scenario.title,
        "description": scenario.description,
        "options": [{"name": one.name, "label": one.label or one.name} for one in scenario.options],
        "option": option,
        "quantities": [_quantity(one) for one in quantities],
    }


def _quantity(one: LiveQuantity) -> Event:
    return {
        "name": one.name, "label": one.label, "unit": one.unit, "scale": one.scale, "value": one.value,
        "low": one.low, "high": one.high, "group": one.group, "logarithmic": one.logarithmic,
    }  # fmt: skip


def view_event(view: LiveView, scenario: Scenario, seconds: float) -> Event:
    """Verdict, words and notes of a view; its figures get theirs by themselves."""
    return {
        "kind": "view",
        "settled": view.settled,
        "following": view.following,
        "failure": view.failure,
        "verdict": view.verdict.value,
        "slug": SLUGS[view.verdict],
        "sign": SIGNS[view.verdict],
        "words": view.failure or view.verdict_words,
        "notes": list(view.notes),
        "away": _away(view, scenario),
        "speed": view.speed,
        "depth": view.depth,
        "seconds": seconds,
    }


def _away(view: LiveView, scenario: Scenario) -> str:
    """Where the law was designed, and where one looks, when these are two points; "" when they are one."""
    moved = []
    for one in view.values:
        own = getattr(scenario.operating, _DESIGN[one.name], None) if one.name in _DESIGN else None
        if one.name == "payload" and scenario.operating.hold == "strength":  # the magnets are designed for it
            own = getattr(getattr(scenario.vehicle, "car", None), "payload", None)
        if own is not None and not math.isclose(own, one.value, rel_tol=1e-6):
            name = "" if one.name == "speed" else f"{one.label} "
            moved.append((f"{name}{own * one.scale:.4g} {one.unit}", f"{name}{one.value * one.scale:.4g} {one.unit}"))
    if not moved:
        return ""
    there, here = (", ".join(pair[side] for pair in moved) for side in (0, 1))
    option = next((one for one in scenario.options if one.name == view.option), None)
    designed = "The law was designed" if option is not None and option.control is not None else "The design point is"
    return f"{designed} at {there}; you look at {here}."


def problems_event(problems: Iterable[Problem], count: int) -> Event:
    """What is wrong with a text, for the list beside it; `count` says which check this answers."""
    listed = [
        {"line": one.line, "column": one.column, "key": one.key, "words": one.message, "file": one.file}
        for one in problems
    ]
    return {"kind": "problems", "listed": listed, "count": count}


def job_event(job: JobView) -> Event:
    """The report of the scenario as it stands."""
    return {
        "kind": "job", "status": job.status, "words": job.words, "fraction": job.fraction,
        "left": None if job.left is None else round(job.left), "folder": job.folder, "files": list(job.files),
    }  # fmt: skip
