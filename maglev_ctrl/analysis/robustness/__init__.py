"""Worst cases under uncertainty of physical parameters: exact linear fractional forms, bounds from both sides."""

from maglev_ctrl.analysis.robustness.certificate import Proof, prove
from maglev_ctrl.analysis.robustness.exact_delays import DelayedPlant, delayed_loop, stable_with_exact_delays
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
from maglev_ctrl.analysis.robustness.work import Work
from maglev_ctrl.analysis.robustness.worst_case import worst_case

__all__ = [
    "BoxProof",
    "DelayedPlant",
    "FactorBounds",
    "ParameterKind",
    "ParameterShare",
    "Proof",
    "StabilityRange",
    "UncertainLoop",
    "UncertainParameter",
    "Work",
    "WorstCase",
    "WorstPoint",
    "delayed_loop",
    "factor_bounds",
    "parameter_share",
    "perturbed_system",
    "prove",
    "prove_box",
    "stability_range",
    "stable_with_exact_delays",
    "uncertain_loop",
    "worst_case",
]
