"""The worst case of one option over the uncertain parameters of its scenario."""

from __future__ import annotations

import numpy as np

from maglev_ctrl.analysis.robustness.exact_delays import DelayedPlant
from maglev_ctrl.analysis.robustness.parameters import UncertainParameter
from maglev_ctrl.analysis.robustness.records import WorstCase
from maglev_ctrl.analysis.robustness.worst_case import worst_case
from maglev_ctrl.errors import ModelError
from maglev_ctrl.study.loops import option_loops
from maglev_ctrl.study.situation import OptionModel, Situation
from maglev_ctrl.systems import Controller
from maglev_ctrl.vehicle import Vehicle


def uncertain_parameters(model: OptionModel, vehicle: Vehicle) -> tuple[UncertainParameter, ...]:
    """Each body, magnet family, spring, damper and actuator that the scenario's spreads are about, one parameter each.

    The magnets share one parameter: it is their force model that is uncertain, not one magnet against another.
    """
    record = model.scenario.uncertainty
    if record is None:
        return ()
    found: list[UncertainParameter] = []
    if record.magnetic_force and (vehicle.magnets or vehicle.coefficient_elements):
        found.append(UncertainParameter("magnetic force", "magnetic_force", record.magnetic_force))
    for body in vehicle.bodies:
        if record.mass:
            found.append(UncertainParameter(f"mass of {body.name}", "mass", record.mass, (body.name,)))
        if record.inertia and any(dof in ("roll", "pitch", "yaw") for dof in body.dofs):
            found.append(UncertainParameter(f"inertia of {body.name}", "inertia", record.inertia, (body.name,)))
    for link in vehicle.connections:
        if record.stiffness and link.stiffness:
            found.append(UncertainParameter(f"stiffness of {link.name}", "stiffness", record.stiffness, (link.name,)))
        if record.damping and link.damping:
            found.append(UncertainParameter(f"damping of {link.name}", "damping", record.damping, (link.name,)))
    for actuator in vehicle.actuators:
        if record.lag and actuator.bandwidth is not None:
            found.append(UncertainParameter(f"lag of {actuator.name}", "actuator_lag", record.lag, (actuator.name,)))
        if record.delay and actuator.delay:
            found.append(
                UncertainParameter(f"delay of {actuator.name}", "actuator_delay", record.delay, (actuator.name,))
            )
    return tuple(found)


def robustness_study(model: OptionModel, controller: Controller | None) -> WorstCase:
    """The worst case at the design point.

    Raises
    ------
    ModelError : there is no equilibrium, or nothing in the vehicle is uncertain
    """
    point = Situation.of_design(model.scenario)
    vehicle = model.vehicle()
    parameters = uncertain_parameters(model, vehicle)
    if not parameters:
        raise ModelError("the vehicle has none of the parameters that [uncertainty] is about")
    law = model.law_at(point, controller)
    loops = option_loops(model, point, controller) if law is not None else None
    delayed = DelayedPlant(loops.plant, loops.delays) if loops is not None and np.any(loops.delays > 0.0) else None
    return worst_case(model.plant(point), law, parameters, delayed=delayed)
