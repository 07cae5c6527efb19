"""Worst cases under uncertainty of physical parameters: exact linear fractional forms, bounds from both sides."""

from maglev_ctrl.analysis.robustness.certificate import Proof, prove
from maglev_ctrl.analysis.robustness.factor import BoxProof, factor_bounds, prove_box
from maglev_ctrl.analysis.robustness.parameters import (
    ParameterKind,
    ParameterShare,
    UncertainParameter,
    parameter_share,
    perturbed_system,
)
from maglev_ctrl.analysis.robustness.records import FactorBounds, StabilityRange, WorstCase, WorstPoint
from maglev_ctrl.analysis.robustness.single import stability_range
from maglev_ctrl.analysis.robustness.uncertain_loop import UncertainLoop, uncertain_loop
from maglev_ctrl.analysis.robustness.worst_case import worst_case

__all__ = [
    "BoxProof",
    "FactorBounds",
    "ParameterKind",
    "ParameterShare",
    "Proof",
    "StabilityRange",
    "UncertainLoop",
    "UncertainParameter",
    "WorstCase",
    "WorstPoint",
    "factor_bounds",
    "parameter_share",
    "perturbed_system",
    "prove",
    "prove_box",
    "stability_range",
    "uncertain_loop",
    "worst_case",
]
