"""Operating points that control laws and damping budgets of a scenario name: corners, and nodes of schedules."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from maglev_ctrl.scenario.control_schema import Corners, MultiObjective, OutputFeedback, Scheduled
from maglev_ctrl.scenario.option_schema import OptionRecord
from maglev_ctrl.scenario.problems import KeyPath
from maglev_ctrl.scenario.scenario_schema import Scenario

PARAMETERS = {"speed": "m/s", "payload": "kg", "height": "m", "gap": "m"}
"""What a point may change about the design point, with its SI unit."""


@dataclass(frozen=True, slots=True)
class NamedPoint:
    """One value (SI) of one parameter, and where the file gives it."""

    key: str
    value: float
    path: KeyPath


def corners_in(option: OptionRecord) -> Iterator[tuple[Corners, KeyPath]]:
    """The corners of an option's law and of its damping budget, with their path inside the option."""
    if isinstance(option.control, MultiObjective | OutputFeedback) and option.control.corners is not None:
        yield option.control.corners, ("control", "corners")
    if option.damping_budget is not None and option.damping_budget.corners is not None:
        yield option.damping_budget.corners, ("damping_budget", "corners")


def points_of(option: OptionRecord, *, path: KeyPath) -> Iterator[NamedPoint]:
    """Every value an option names, one parameter at a time.

    Parameters
    ----------
    path : of the option
    """
    for corners, place in corners_in(option):
        for key in PARAMETERS:
            for index, value in enumerate(getattr(corners, key)):
                yield NamedPoint(key, value, (*path, *place, key, index))
    law = option.control
    if isinstance(law, Scheduled):
        for index, node in enumerate(law.nodes):
            yield NamedPoint(law.over, node.value, (*path, "control", "nodes", index))


def values_named(scenario: Scenario, key: str) -> list[float]:
    """Every value of one parameter that any option names.

    Examples
    --------
    >>> from maglev_ctrl.scenario import load
    >>> values_named(load("scenarios/design/damping_budget.toml"), "payload")
    [0.0, 5000.0]
    """
    named = (point for option in scenario.options for point in points_of(option, path=()))
    return [point.value for point in named if point.key == key]
