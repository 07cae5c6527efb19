"""The one recipe of the whole flow: a scenario in, a comparison of its suspension options out."""

from maglev_ctrl.study.eddy_current import solve_forces
from maglev_ctrl.study.records import (
    Comparison,
    FloquetStudy,
    NyquistCurve,
    OptionStudy,
    RequirementResult,
    RootLocus,
    Sweep,
)
from maglev_ctrl.study.run import run

__all__ = [
    "Comparison",
    "FloquetStudy",
    "NyquistCurve",
    "OptionStudy",
    "RequirementResult",
    "RootLocus",
    "Sweep",
    "run",
    "solve_forces",
]
