"""Vehicles: bodies, magnets and connections, their equilibrium and their linear models."""

from maglev_ctrl.vehicle import models
from maglev_ctrl.vehicle.assembly import ElementModulation, element_modulation, linearize, stiffness_modulation
from maglev_ctrl.vehicle.circuits import magnet_circuits
from maglev_ctrl.vehicle.elements import (
    DOF_NAMES,
    GUIDEWAY,
    Actuator,
    Aerodynamics,
    Body,
    CoefficientElement,
    Magnet,
    Sensor,
    SpringDamper,
)
from maglev_ctrl.vehicle.loads import generalized_force
from maglev_ctrl.vehicle.operating import Equilibrium, OperatingPoint
from maglev_ctrl.vehicle.passive import as_feedback
from maglev_ctrl.vehicle.statics import equilibrium
from maglev_ctrl.vehicle.vehicle import Vehicle

__all__ = [
    "DOF_NAMES",
    "GUIDEWAY",
    "Actuator",
    "Aerodynamics",
    "Body",
    "CoefficientElement",
    "ElementModulation",
    "Equilibrium",
    "Magnet",
    "OperatingPoint",
    "Sensor",
    "SpringDamper",
    "Vehicle",
    "as_feedback",
    "element_modulation",
    "equilibrium",
    "generalized_force",
    "linearize",
    "magnet_circuits",
    "models",
    "stiffness_modulation",
]
