"""A scenario's option with some values of its file replaced: what maps and sweeps look at away from the file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from maglev_ctrl.errors import ModelError
from maglev_ctrl.scenario import Scenario
from maglev_ctrl.scenario.quantity_paths import WAVELENGTH, ScenarioQuantity, with_quantity
from maglev_ctrl.study.law import designed_option
from maglev_ctrl.study.situation import OptionModel
from maglev_ctrl.systems import Controller

Change = tuple[ScenarioQuantity, float]


def of_file(quantity: ScenarioQuantity) -> bool:
    """Whether a quantity changes what the file says, and not only where and how the vehicle runs."""
    return bool(quantity.path) or quantity.name == WAVELENGTH


def varied_option(
    model: OptionModel, controller: Controller | None, changes: Sequence[Change]
) -> tuple[OptionModel, Controller | None]:
    """The option with values (SI) of the file replaced; its law as it is, unless a value of the law itself changes.

    Raises
    ------
    ModelError : the scenario would not be valid, or the law does not exist
    """
    scenario, option = changed_scenario(model.scenario, changes), model.option
    if option is not None:
        option = next(record for record in scenario.options if record.name == option.name)
    try:
        if option is not None and any(quantity.of_law for quantity, _ in changes):
            made, design = designed_option(scenario, option)
            return made, None if design is None else design.controller
        return replace(model, scenario=scenario, option=option), controller
    except (ValueError, np.linalg.LinAlgError) as error:
        raise ModelError(str(error)) from None


def changed_scenario(scenario: Scenario, changes: Sequence[Change]) -> Scenario:
    """The scenario with values (SI) of its file replaced.

    Raises
    ------
    ModelError : it would not be valid
    """
    values = tuple(one for one in changes if one[0].path)
    if values:
        scenario = with_quantity(scenario, values)
    lengths = [value for quantity, value in changes if quantity.name == WAVELENGTH]
    if lengths and scenario.periodic is not None:
        periodic = scenario.periodic.model_copy(update={"wavelength": lengths[0]})
        scenario = scenario.model_copy(update={"periodic": periodic})
    return scenario
