"""Which bounds of a request a law meets, by its closed loops and not by the inequalities it was found with."""

from __future__ import annotations

import numpy as np

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.synthesis.lmi.certify import recomputed, state_feedback
from maglev_ctrl.synthesis.lmi.problem import Problem
from maglev_ctrl.synthesis.lmi.regions import contains
from maglev_ctrl.synthesis.lmi.request import requirements

PROVABLE = 1e-4
"""Share by which a bound must be met for it to count as met."""


def violated(problem: Problem, gain: FloatArray) -> set[str]:
    """Names of the bounds that the law u = `gain` x does not meet at some vertex, or not by enough to prove it."""
    request = problem.request
    law = state_feedback(problem, gain, "law")
    told = recomputed(problem, law)
    slowest, norms, peaks = (
        [one.recomputed for one in told if one.quantity.startswith(start)]
        for start in ("decay rate", "H2 norm", "H-infinity norm")
    )
    if min(slowest) <= 0.0:
        return {name for name, _ in requirements(request)}
    found: set[str] = set()
    if request.decay_rate is not None and min(slowest) < request.decay_rate * (1.0 + PROVABLE):
        found.add("decay_rate")
    if request.h2_below is not None and max(norms) > request.h2_below * (1.0 - PROVABLE):
        found.add("h2_below")
    if request.h_infinity_below is not None and max(peaks) > request.h_infinity_below * (1.0 - PROVABLE):
        found.add("h_infinity_below")
    if request.gain_below is not None and float(np.linalg.norm(gain, 2)) >= request.gain_below:
        found.add("gain_below")
    if request.region is not None:
        K = problem.scaled(gain)
        poles = [problem.scaling.rate * np.linalg.eigvals(v.A + v.B @ K) for v in problem.vertices]
        if not all(np.all(contains(request.region, some)) for some in poles):
            found.add("region")
    return found
