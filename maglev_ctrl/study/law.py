"""The control law of one option, designed at the design point and verified there and with finer delays."""

from __future__ import annotations

from maglev_ctrl.scenario import OptionRecord, Scenario, control_law
from maglev_ctrl.scenario.control_schema import Lqg, Lqr
from maglev_ctrl.scenario.control_schema import SkyHook as SkyHookRecord
from maglev_ctrl.study.situation import VERIFICATION_ORDER, OptionModel, Situation
from maglev_ctrl.synthesis.design import Design, verify
from maglev_ctrl.synthesis.gaussian import SensorNoise
from maglev_ctrl.synthesis.laws import design_lqg, design_lqr
from maglev_ctrl.synthesis.skyhook import SkyHook, sky_hook
from maglev_ctrl.synthesis.weights import InputWeight, OutputWeight


def design_law(scenario: Scenario, option: OptionRecord, model: OptionModel) -> Design | None:
    """The option's law, or None for a passive option.

    Laws are designed on the plant without actuator delays, because a delay's Pade states cannot be measured, and
    verified on the plant that has them.

    Raises
    ------
    ModelError : there is no equilibrium at the design point, or the law does not exist
    ValueError : a weight or sensor does not fit the plant
    """
    law = control_law(scenario, option)
    if law is None:
        return None
    design_point = Situation.of_design(scenario)
    plant = model.plant(design_point, pade_order=0)
    outputs = tuple(OutputWeight(name, allowed) for name, allowed in law.output_weights)
    inputs = tuple(InputWeight(name, allowed) for name, allowed in law.input_weights)
    record = law.record
    match record:
        case Lqr():
            return design_lqr(plant, outputs, inputs, name=option.name)
        case Lqg():
            noise = tuple(SensorNoise(name, density) for name, density in law.noise)
            return design_lqg(
                plant, outputs, inputs, sensors=noise, disturbance=record.disturbance, name=option.name
            )  # fmt: skip
        case SkyHookRecord():
            dampers = tuple(
                SkyHook(actuator, velocity, damping=record.damping)
                for actuator, velocity in zip(law.actuators, law.placed(record.sensor), strict=True)
            )
            return sky_hook(plant, dampers, name=option.name)
        case _:
            raise NotImplementedError(record.law)


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
