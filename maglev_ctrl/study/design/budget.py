"""The damping budget of an option: dampers at its places, chosen as cheap as a proof of the wanted decay allows."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Final

import numpy as np

from maglev_ctrl.errors import ModelError
from maglev_ctrl.scenario import OptionRecord, Scenario
from maglev_ctrl.scenario.layout import layout, place_element
from maglev_ctrl.study.design.corners import Corner, corners_of, systems_at
from maglev_ctrl.study.situation import OptionModel
from maglev_ctrl.synthesis.damping.budget import DampingBudget, damping_budget
from maglev_ctrl.synthesis.damping.minimum import DampingDesign, minimum_damping
from maglev_ctrl.synthesis.damping.places import DampingPlace
from maglev_ctrl.synthesis.result import Refused
from maglev_ctrl.systems import SecondOrderSystem

GUARANTEE: Final = "each vertex"
"""What every point of the curve has to carry."""
NOTHING: Final = 1e-9
"""Dampers below this share of the largest are what the search left of zero."""
BETWEEN: Final = "every constant blend"
"""What is asked of the chosen dampers first: speeds and payloads that do not change within a second or two."""


def with_budget(scenario: Scenario, option: OptionRecord) -> OptionModel:
    """The option's model with its dampers as its budget chooses them; as the file gives them without a budget.

    Raises
    ------
    ModelError : no damping was proved to reach the wanted decay rate, or a damper of the budget has a lag
    """
    model = OptionModel(scenario, option)
    if option.damping_budget is None:
        return model
    return chosen_model(model, chosen_damping(model))


def chosen_damping(model: OptionModel) -> DampingDesign:
    """The cheapest dampers proved to reach the budget's chosen decay rate, if possible between the corners too.

    Raises
    ------
    ModelError : a damper of the budget has a lag, or there is no equilibrium at a corner
    """
    vertices, places = problem_of(model)
    budget = _record(model).damping_budget
    assert budget is not None
    systems = [system for _, system in vertices]
    between = minimum_damping(systems, places, rate=budget.choose, guarantee=BETWEEN)
    return between if between.certified else minimum_damping(systems, places, rate=budget.choose, guarantee=GUARANTEE)


def whole_budget(model: OptionModel, *, step: Callable[[str], None] | None = None) -> DampingBudget:
    """Cost against decay rate, all places together and each alone, as far as the budget's time limit allows.

    Parameters
    ----------
    step : told before every point what it is

    Raises
    ------
    ModelError : a damper of the budget has a lag, or there is no equilibrium at a corner
    """
    vertices, places = problem_of(model)
    budget = _record(model).damping_budget
    assert budget is not None
    return damping_budget(
        [system for _, system in vertices], places,
        margins=budget.decay_rates, guarantee=GUARANTEE, time_limit=budget.time_limit, step=step,
    )  # fmt: skip


def chosen_model(model: OptionModel, design: DampingDesign) -> OptionModel:
    """The model with the design's dampers.

    Raises
    ------
    ModelError : nothing was proved
    """
    if not design.certified:
        raise Refused(f"damping budget: {design.reason or design.synthesis.message}", design.synthesis.status)
    least = NOTHING * float(np.max(design.damping, initial=0.0))
    kept = (float(c) if c > least else 0.0 for c in design.damping)
    return replace(model, dampings=tuple(zip(design.places, kept, strict=True)))


def problem_of(model: OptionModel) -> tuple[list[tuple[Corner, SecondOrderSystem]], tuple[DampingPlace, ...]]:
    """The vehicle at every corner without the budget's dampers, and the places where they sit.

    Raises
    ------
    ModelError : a damper of the budget has a lag, or there is no equilibrium at a corner
    """
    option = _record(model)
    budget = option.damping_budget
    assert budget is not None
    here = layout(model.scenario.vehicle)
    costs = budget.costs or tuple(1.0 for _ in option.spring_dampers)
    placed: dict[str, float] = {}
    for element, cost in zip(option.spring_dampers, costs, strict=True):
        if element.lag:
            raise ModelError(f"damping budget: {element.name!r} has a lag; only dampers without one can be chosen")
        placed |= {place.name: cost for place in place_element(element, here)}
    without = replace(model, dampings=tuple((name, 0.0) for name in placed))
    vertices = list(systems_at(without, corners_of(without, budget.corners)))
    first = vertices[0][1]
    places = tuple(
        DampingPlace(
            name,
            first.H_v[first.outputs.index(f"{name}.stroke.velocity")],
            cost=cost,
            limit=np.inf if budget.largest is None else budget.largest,
        )
        for name, cost in placed.items()
    )
    return vertices, places


def _record(model: OptionModel) -> OptionRecord:
    assert model.option is not None and model.option.damping_budget is not None
    return model.option
