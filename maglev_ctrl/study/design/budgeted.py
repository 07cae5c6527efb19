"""The study of an option whose dampers its budget chooses: the whole curve, the chosen point, and what it does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from maglev_ctrl.analysis.margins import Margins, loop_margins
from maglev_ctrl.errors import MaglevError, ModelError
from maglev_ctrl.scenario import OptionRecord, Scenario
from maglev_ctrl.study.design.budget import chosen_model, problem_of, whole_budget
from maglev_ctrl.study.design.corners import corners_of, systems_at
from maglev_ctrl.study.design.evaluate import poles
from maglev_ctrl.study.design.records import CornerPoles, LawStudy
from maglev_ctrl.study.loops import option_loops
from maglev_ctrl.study.situation import OptionModel, Situation
from maglev_ctrl.systems import Controller


def budgeted(scenario: Scenario, option: OptionRecord, blank: LawStudy) -> LawStudy:
    """The budget's curve and the dampers it chose.

    Raises
    ------
    ModelError : the chosen decay rate was not proved, or a damper of the budget has a lag
    """
    record = option.damping_budget
    assert record is not None
    bare = OptionModel(scenario, option)
    budget = whole_budget(bare)
    design = budget.designs[int(np.argmin(np.abs(budget.together.margin - record.choose)))]
    blank = replace(blank, budget=budget, chosen=record.choose)
    try:
        model = chosen_model(bare, design)
    except ModelError as fault:  # the curve is worth seeing all the same
        return replace(blank, failure=f"{fault}", status=design.synthesis.status)
    opened, _ = problem_of(bare)
    closed = systems_at(model, corners_of(model, record.corners))
    margins, reason = design_margins(model, None)
    return replace(
        blank,
        status=design.synthesis.status,
        synthesis=design.synthesis,
        corners=tuple(
            CornerPoles(corner.name, poles(system.state_matrix()), poles(other.state_matrix()))
            for (corner, system), (_, other) in zip(opened, closed, strict=True)
        ),
        margins=margins,
        margins_reason=reason,
        notes=(
            *(f"{name}: {value / 1e3:.4g} kN s/m" for name, value in model.dampings),
            *design.synthesis.notes,
        ),
    )


def design_margins(model: OptionModel, controller: Controller | None) -> tuple[Margins | None, str]:
    """Margins at the design point with exact delays, or why there are none."""
    try:
        loops = option_loops(model, Situation.of_design(model.scenario), controller)
        return (loop_margins(loops.loop()), "") if loops else (None, "there is no loop to break")
    except (MaglevError, np.linalg.LinAlgError) as fault:
        return None, f"{fault}"
