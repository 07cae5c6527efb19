"""Magnetic forces of one magnet over a guideway: image force, electromagnets, tables, matrices."""

from __future__ import annotations

from maglev_ctrl.forces.base import AbstractForceModel, Domain, MagnetDerivatives, MagnetForces
from maglev_ctrl.forces.coefficients import Coefficients, CoefficientTable
from maglev_ctrl.forces.corner_image import CornerImageForce
from maglev_ctrl.forces.electromagnet import Circuit, Electromagnet, circuit
from maglev_ctrl.forces.image import (
    ImageForce,
    characteristic_speed,
    drag_ratio,
    drag_ratio_slope,
    lift_ratio,
    lift_ratio_slope,
    receding_image_ratio,
)
from maglev_ctrl.forces.tabulated import FitQuality, TabulatedForce
from maglev_ctrl.forces.unsteady import OscillationCoefficients, coefficients_from_oscillation

__all__ = [
    "AbstractForceModel",
    "Circuit",
    "CoefficientTable",
    "Coefficients",
    "CornerImageForce",
    "Domain",
    "Electromagnet",
    "FitQuality",
    "ImageForce",
    "MagnetDerivatives",
    "MagnetForces",
    "OscillationCoefficients",
    "TabulatedForce",
    "characteristic_speed",
    "circuit",
    "coefficients_from_oscillation",
    "drag_ratio",
    "drag_ratio_slope",
    "lift_ratio",
    "lift_ratio_slope",
    "receding_image_ratio",
]
