"""The largest decay rate: where there is none, and regulators of the shifted plant, which need no inequality.

The regulator of A + r I whose states cost little moves every mode slower than r to its mirror image about -r, so that
the loop decays at up to 2 r (Anderson & Moore 1990, section 3.5). A plant without uncontrollable modes has one for
every r: its decay rate has no largest value, only one for each gain.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.errors import ModelError, Status
from maglev_ctrl.proofs.makers import decay_claim
from maglev_ctrl.proofs.prove import prove
from maglev_ctrl.synthesis.lmi.certify import state_feedback
from maglev_ctrl.synthesis.lmi.coordinates import distinct
from maglev_ctrl.synthesis.lmi.problem import Optimum, Problem
from maglev_ctrl.synthesis.lmi.request import requirements
from maglev_ctrl.synthesis.neutral import hidden_modes

FARTHEST, WIDTH = 2.0**8, 1e-3
"""Largest shift tried, in scaled rates, and the relative width of the search for the largest that serves."""
EXAMPLES = (0.0625, 0.25, 1.0, 4.0)
"""Scaled shifts of which the gain is told where the decay rate has no largest value."""
ROOM = 2e-3
"""Share of the decay rate of the law that is not claimed."""


def without_limit(problem: Problem) -> bool:
    """Whether any decay rate can be had: one plant, every mode controllable, and nothing that bounds the law.

    Examples
    --------
    >>> from maglev_ctrl.synthesis.lmi.problem import pose
    >>> from maglev_ctrl.synthesis.lmi.request import MultiObjective
    >>> from maglev_ctrl.synthesis.lmi.session import Clock, LmiSession
    >>> from maglev_ctrl.systems.plant import Plant
    >>> plant = Plant.from_matrices([[1.0]], [[1.0]], [[1.0]], [[1.0]])
    >>> without_limit(pose((plant,), MultiObjective("decay"), session=LmiSession(), clock=Clock(9.0)))
    True
    """
    bounds = {name for name, _ in requirements(problem.request)} - {"decay_rate"}
    return problem.request.objective == "decay" and not bounds and _movable(problem)


def price_of_decay(problem: Problem) -> str:
    """Gains that some decay rates take, each proved: "4 1/s takes a gain of 1.3e+06, ..."."""
    told: list[str] = []
    for shift in EXAMPLES:
        law = state_feedback(problem, _gain(problem, shift * problem.scaling.rate), "regulator")
        try:
            claim = decay_claim(problem.plants[:1], [law])
        except ModelError:
            continue
        if prove(claim, problem.plants[:1], [law]).holds:
            takes = "takes a gain of" if not told else "one of"
            told.append(f"{claim.rate:.3g} 1/s {takes} {float(np.linalg.norm(law.D, 2)):.3g}")
    return ", ".join(told)


def shifted_regulator(problem: Problem, serves: Callable[[FloatArray], bool]) -> Optimum | None:
    """The regulator of the largest shift whose gain `serves`; None where there is none or it has no meaning.

    Only for one plant: the decay of several under one law has to be found by the inequality.
    """
    if len(distinct(problem.vertices)) > 1:
        return None
    unit, low, high = problem.scaling.rate, 0.0, 0.0
    shift = 1.0 / 16.0
    while shift <= FARTHEST and problem.clock.left > 0.0:
        if not serves(_gain(problem, shift * unit)):
            high = shift
            if low > 0.0:
                break
        else:
            low = shift
        shift *= 2.0
    if low == 0.0 or high < low:
        return None
    while high - low > WIDTH * high and problem.clock.left > 0.0:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if serves(_gain(problem, middle * unit)) else (low, middle)
    there = problem.around(low * unit)
    v = there.vertices[0]
    rate = -float(np.max(np.linalg.eigvals(v.A - v.B @ v.B.T).real)) * unit
    values = {"slack": np.eye(len(v.A)), "Y": np.asarray(-v.B.T, dtype=np.float64)}
    ended = "regulators of the shifted plant, which are not every law, serve up to there"
    return Optimum(Status.ALMOST_SOLVED, values, rate, (1.0 - ROOM) * rate, 0, False, there, ended)


def _gain(problem: Problem, shift: float) -> FloatArray:
    """K of the regulator of A + shift I: -B' where its certificate is the identity."""
    there = problem.around(shift)
    v = there.vertices[0]
    return there.gain({"slack": np.eye(len(v.A)), "Y": np.asarray(-v.B.T, dtype=np.float64)})


def _movable(problem: Problem) -> bool:
    if len(distinct(problem.vertices)) > 1:
        return False
    v = problem.vertices[0]
    shift = 2.0 * float(np.max(np.abs(np.linalg.eigvals(v.A)))) + 1.0
    return not hidden_modes((v.A + shift * np.eye(len(v.A))).T, v.B.T, problem.plants[0].states)
