"""The control law of one option, designed at the design point and verified there and with finer delays."""

from __future__ import annotations

from dataclasses import replace

from maglev_ctrl.scenario import OptionRecord, Scenario
from maglev_ctrl.study.design.budget import with_budget
from maglev_ctrl.study.design.make import make_law
from maglev_ctrl.study.situation import VERIFICATION_ORDER, OptionModel, Situation
from maglev_ctrl.synthesis.design import Design, verify


def designed_option(scenario: Scenario, option: OptionRecord) -> tuple[OptionModel, Design | None]:
    """The option's model with everything designed that its file leaves open: its dampers, its law, its schedule.

    Raises
    ------
    ModelError : there is no equilibrium at the design point, or the law or the dampers do not exist
    OutOfDomain : the forces are not known at a corner
    ValueError : a weight or sensor does not fit the plant
    """
    model = with_budget(scenario, option)
    design = design_law(scenario, option, model)
    if design is not None and design.schedule is not None:
        model = replace(model, schedule=design.schedule)
    return model, design


def design_law(scenario: Scenario, option: OptionRecord, model: OptionModel) -> Design | None:
    """The option's law, or None for a passive option.

    Laws are designed on the plant without actuator delays, because a delay's Pade states cannot be measured, and
    verified on the plant that has them.

    Raises
    ------
    ModelError : there is no equilibrium at the design point, or the law does not exist
    OutOfDomain : the forces are not known at a corner
    ValueError : a weight or sensor does not fit the plant
    """
    made = make_law(scenario, option, model)
    return None if made is None else made.design


def delayed_certificate(model: OptionModel, design: Design) -> str:
    """Verify a design on the plant with its actuator delays; '' when it holds, else what does not.

    Raises
    ------
    ModelError : there is no equilibrium at the design point
    """
    point = Situation.of_design(model.scenario)
    plant = model.plant(point)
    certificate = verify(
        plant, design.controller, refined=model.plant(point, pade_order=VERIFICATION_ORDER)
    )  # fmt: skip
    return "" if certificate.stable else "; ".join(certificate.disagreements) or "the closed loop is not stable"
