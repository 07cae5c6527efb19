"""Worst cases under uncertainty of physical parameters: exact linear fractional forms, bounds from both sides."""

from maglev_ctrl.analysis.robustness.parameters import (
    ParameterKind,
    ParameterShare,
    UncertainParameter,
    parameter_share,
    perturbed_system,
)
from maglev_ctrl.analysis.robustness.records import FactorBounds, StabilityRange, WorstCase, WorstPoint
from maglev_ctrl.analysis.robustness.uncertain_loop import UncertainLoop, uncertain_loop

__all__ = [
    "FactorBounds",
    "ParameterKind",
    "ParameterShare",
    "StabilityRange",
    "UncertainLoop",
    "UncertainParameter",
    "WorstCase",
    "WorstPoint",
    "parameter_share",
    "perturbed_system",
    "uncertain_loop",
]
