"""An option's law as the search makes it: the same equations, without the proofs that the full study adds."""

from __future__ import annotations

from dataclasses import replace

from maglev_ctrl.scenario import OptionRecord, Scenario, control_law
from maglev_ctrl.scenario.control_schema import HookedLaw, Lqg, Lqr, Predictive, SkyHook
from maglev_ctrl.scenario.hooks import hooked_dampers
from maglev_ctrl.study.design.make import Task, make_law
from maglev_ctrl.study.situation import OptionModel
from maglev_ctrl.synthesis.damping.hooked import HookedDamper, Opposed, hooked_controller
from maglev_ctrl.synthesis.unproved import lqg_controller, lqr_controller
from maglev_ctrl.systems import Controller


def quick_law(scenario: Scenario, option: OptionRecord, model: OptionModel) -> tuple[OptionModel, Controller | None]:
    """The option's law at the design point, and the model with its schedule where it has one.

    Linear-quadratic, sky-hook and damping laws are made without their proofs; of predictive control the linear law it
    equals while no limit is active. Laws by other syntheses are made as the study makes them, which takes its time.

    Raises
    ------
    ModelError : there is no equilibrium at the design point, or no such law
    OutOfDomain : the forces are not known at a corner
    ValueError : a weight or sensor does not fit the plant
    """
    law = control_law(scenario, option)
    if law is None:
        return model, None
    task = Task(option.name, law, model)
    match law.record:
        case Lqr() | Predictive():
            return model, lqr_controller(task.system(), task.outputs, task.inputs, name=task.name)
        case Lqg() as record:
            return model, lqg_controller(
                task.system(), task.outputs, task.inputs,
                sensors=task.sensors, disturbance=record.disturbance, name=task.name,
            )  # fmt: skip
        case SkyHook() as record:
            dampers = [
                HookedDamper(actuator, (Opposed(velocity),), record.damping)
                for actuator, velocity in zip(law.actuators, law.placed(record.sensor), strict=True)
            ]
            return model, hooked_controller(task.system(), dampers, name=task.name)
        case HookedLaw() as record:
            return model, hooked_controller(task.system(), hooked_dampers(model.vehicle(), record), name=task.name)
    made = make_law(scenario, option, model)
    assert made is not None
    design = made.design
    if design.schedule is not None:
        model = replace(model, schedule=design.schedule)
    return model, design.controller
