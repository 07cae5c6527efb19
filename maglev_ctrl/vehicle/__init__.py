"""Vehicles: bodies, magnets and connections, their equilibrium and their linear models."""

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
from maglev_ctrl.vehicle.vehicle import Vehicle

__all__ = [
    "DOF_NAMES",
    "GUIDEWAY",
    "Actuator",
    "Aerodynamics",
    "Body",
    "CoefficientElement",
    "Magnet",
    "Sensor",
    "SpringDamper",
    "Vehicle",
]
