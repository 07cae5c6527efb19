"""Linear matrix inequalities: state feedback with several objectives for a polytope of plants, and its analysis."""

from maglev_ctrl.synthesis.lmi.regions import Region, contains, damping, disk, half_plane, intersection, strip
from maglev_ctrl.synthesis.lmi.request import Channel, CommandLimits, MultiObjective
from maglev_ctrl.synthesis.lmi.session import LmiSession
from maglev_ctrl.synthesis.lmi.stability import (
    PolytopeStability,
    closed_loops,
    parameter_dependent_stability,
    quadratic_stability,
)
from maglev_ctrl.synthesis.lmi.state_feedback import multi_objective

__all__ = [
    "Channel", "CommandLimits", "LmiSession", "MultiObjective", "PolytopeStability", "Region", "closed_loops",
    "contains", "damping", "disk", "half_plane", "intersection", "multi_objective", "parameter_dependent_stability",
    "quadratic_stability", "strip",
]  # fmt: skip
