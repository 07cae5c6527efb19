"""The study of an option whose dampers its budget chooses: the whole curve, the chosen point, and what it does."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from typing import Final

import numpy as np

from maglev_ctrl.analysis.margins import Margins, loop_margins
from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.errors import MaglevError, ModelError
from maglev_ctrl.scenario import OptionRecord, Scenario
from maglev_ctrl.study.design.budget import NOTHING, chosen_damping, chosen_model, problem_of, whole_budget
from maglev_ctrl.study.design.corners import corners_of, systems_at
from maglev_ctrl.study.design.evaluate import poles
from maglev_ctrl.study.design.records import CornerPoles, LawStudy
from maglev_ctrl.study.loops import option_loops
from maglev_ctrl.study.situation import OptionModel, Situation
from maglev_ctrl.systems import Controller

Step = Callable[[str], None]
_NEWTONS: Final = re.compile(r"([\d.]+(?:e[+-]?\d+)?) N s/m")
_COSTS: Final = re.compile(r"(cost|less than) ([\d.]+(?:e[+-]?\d+)?)")


def budgeted(scenario: Scenario, option: OptionRecord, blank: LawStudy, *, step: Step | None = None) -> LawStudy:
    """The budget's curve and the dampers it chose.

    Parameters
    ----------
    step : told what is being done, before every point of the curve

    Raises
    ------
    ModelError : the chosen decay rate was not proved, or a damper of the budget has a lag
    """
    record = option.damping_budget
    assert record is not None
    bare = OptionModel(scenario, option)
    budget = whole_budget(bare, step=step)
    design = budget.designs[int(np.argmin(np.abs(budget.together.margin - record.choose)))]
    if design.certified:
        if step is not None:
            step(f"dampers for {record.choose:g} 1/s, between the operating points too")
        design = chosen_damping(bare)
    blank = replace(blank, budget=budget, chosen=record.choose)
    try:
        model = chosen_model(bare, design)
    except ModelError as fault:  # the curve is worth seeing all the same
        return replace(blank, failure=f"{fault}", status=design.synthesis.status)
    opened, _ = problem_of(bare)
    closed = systems_at(model, corners_of(model, record.corners))
    margins, reason = design_margins(model, None)
    named = tuple(replace(plant, name=corner.name) for plant, (corner, _) in zip(
        design.synthesis.plants, opened, strict=True))  # fmt: skip
    synthesis = replace(design.synthesis, plants=named)  # "vertex" tells nobody which operating point is meant
    return replace(
        blank,
        status=design.synthesis.status,
        synthesis=synthesis,
        corners=tuple(
            CornerPoles(corner.name, poles(system.state_matrix()), poles(other.state_matrix()))
            for (corner, system), (_, other) in zip(opened, closed, strict=True)
        ),
        margins=margins,
        margins_reason=reason,
        notes=(
            *(f"{name}: {value / 1e3:.4g} kN s/m" for name, value in zip(
                design.places, shown_damping(design.damping), strict=True)),
            *(in_kilonewtons(note) for note in design.synthesis.notes),
        ),
    )  # fmt: skip


def shown_damping(damping: FloatArray) -> FloatArray:
    """Dampings (..., k) with what is below `NOTHING` of the largest of a row as 0.

    Examples
    --------
    >>> shown_damping(np.array([5e4, 2e-11]))
    array([50000.,     0.])
    """
    largest = np.max(np.abs(damping), axis=-1, keepdims=True, initial=0.0)
    return np.where(np.abs(damping) < NOTHING * largest, 0.0, damping)


def in_kilonewtons(note: str) -> str:
    """A note on dampers with its N s/m as kN s/m, and its costs too.

    Examples
    --------
    >>> in_kilonewtons("descent: leg 5.181e+04 N s/m; cost 5.181e+04, no damping costs less than 1.291e+04")
    'descent: leg 51.81 kN s/m; cost 51.81, no damping costs less than 12.91 (weighted kN s/m)'
    """
    told = _NEWTONS.sub(lambda found: f"{float(found[1]) / 1e3:.4g} kN s/m", note)
    found = _COSTS.sub(lambda one: f"{one[1]} {float(one[2]) / 1e3:.4g}", told)
    return found if found == told else f"{found} (weighted kN s/m)"


def design_margins(model: OptionModel, controller: Controller | None) -> tuple[Margins | None, str]:
    """Margins at the design point with exact delays, or why there are none."""
    try:
        loops = option_loops(model, Situation.of_design(model.scenario), controller)
        return (loop_margins(loops.loop()), "") if loops else (None, "there is no loop to break")
    except (MaglevError, np.linalg.LinAlgError) as fault:
        return None, f"{fault}"
