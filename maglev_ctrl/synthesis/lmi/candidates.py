"""Laws to be proved, best first: of a common matrix, of a matrix for each vertex, of another solver."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from importlib.util import find_spec

import numpy as np
from scipy.linalg import LinAlgError, solve_continuous_are, solve_continuous_lyapunov

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.errors import Status
from maglev_ctrl.synthesis.lmi.bounds import violated
from maglev_ctrl.synthesis.lmi.fastest import shifted_regulator, without_limit
from maglev_ctrl.synthesis.lmi.optimise import HARD, optimise
from maglev_ctrl.synthesis.lmi.problem import PRICED, Optimum, Problem, pose
from maglev_ctrl.synthesis.lmi.request import requirements

SLACKS = (0.2, 0.03)
"""Scaled time constants tried for the slack equation; towards zero a common matrix is the special case."""
NEAR = 1.02
"""Ratio of the H2 norm at the worst vertex to the least that any law has there, at which the search stops."""
SHARE = 0.7
"""Share of the time left that one search may take; the rest is for its proof."""
HARDER = 1.1
"""Ratio of the decay rate asked to the rate claimed, where the latter was not proved at first."""
MORE = 1.02
"""The same ratio for one matrix."""
SECOND_SOLVER_LEAST, SECOND_SOLVER_STATES = 10.0, 12
"""Seconds that must be left, and most states, for a solver that knows no time limit."""


@dataclass(frozen=True, eq=False, slots=True)
class Candidate:
    """An optimum and the problem it belongs to; `note` on how it was come by."""

    problem: Problem
    optimum: Optimum
    note: str = ""
    source: Problem | None = None

    @property
    def searched(self) -> Problem:
        """The problem whose optimum it is, where claims are made for another."""
        return self.source or self.problem


def candidates(problem: Problem) -> Iterator[Candidate]:
    """Candidates, the best first; the last one tells why where there is none with values.

    Examples
    --------
    >>> from maglev_ctrl.synthesis.lmi.problem import pose
    >>> from maglev_ctrl.synthesis.lmi.request import MultiObjective
    >>> from maglev_ctrl.synthesis.lmi.session import Clock, LmiSession
    >>> from maglev_ctrl.systems.plant import Plant
    >>> plant = Plant.from_matrices([[1.0]], [[1.0]], [[1.0]], [[1.0]])
    >>> posed = pose((plant,), MultiObjective("gain"), session=LmiSession(), clock=Clock(60.0))
    >>> [one.optimum.status.name for one in candidates(posed)]
    ['SOLVED']
    """
    if without_limit(problem):
        yield Candidate(problem, Optimum(Status.UNBOUNDED, {}))
        return
    if problem.lyapunov == "common":
        yield from _of_one_matrix(problem)
        return
    found = _vertexwise(problem)
    useful = [one for one in found if one.optimum.values]
    if not useful:
        yield from found[-1:]
    for one in sorted(useful, key=_worth):
        yield one
        # Asked for more: the candidate was not proved. A decay rate that came by itself may have too little room.
        if one.searched.request.decay_rate is None and one.problem.request.decay_rate is not None:
            again = _demanding(one.problem)
            if again.optimum.values:
                yield again


def _of_one_matrix(problem: Problem) -> Iterator[Candidate]:
    """Without the bounds that are slack; with all; with a little more decay, where what was asked is not proved."""
    request = problem.request
    slack = without_slack_bounds(problem)
    if slack is not None and slack.optimum.certain:
        yield slack
        slack = None
    first = _fastest(problem) if request.objective == "decay" else _common(problem)
    if first.optimum.values or slack is None:
        yield first
    if request.decay_rate is not None and request.objective != "decay" and first.optimum.values:
        again = _demanding(problem, MORE)
        if again.optimum.values:
            yield again
    if slack is not None:
        yield slack


def _common(problem: Problem) -> Candidate:
    """The optimum for one matrix; in plain coordinates, and by CVXOPT, where there is none and there is time."""
    first = _candidate(problem)
    if not first.optimum.values and first.optimum.status not in HARD and not problem.plain:
        first = _candidate(problem.in_plain_coordinates())
    stumbled = first.optimum.status in (Status.NUMERICAL_ERROR, Status.ITERATION_LIMIT)
    if not stumbled or problem.solver != "CLARABEL" or find_spec("cvxopt") is None:
        return first
    if problem.clock.left < SECOND_SOLVER_LEAST or len(problem.scaling.states) > SECOND_SOLVER_STATES:
        return first
    other = replace(problem, solver="CVXOPT")
    note = f"CLARABEL ended with {first.optimum.status.name}; the answer is CVXOPT's"
    second = _candidate(other, note)
    return second if second.optimum.values else first


def _fastest(problem: Problem) -> Candidate:
    """The largest decay rate by the inequality; or of a regulator, where the test of the gain is too strict for it."""
    found = _common(problem)
    least = max(found.optimum.objective if found.optimum.values else 0.0, problem.request.decay_rate or 0.0)
    if problem.request.commands is not None or problem.clock.left <= 0.0:
        return found
    other = shifted_regulator(problem, lambda gain: not violated(problem, gain))
    if other is None or other.problem is None or other.rate <= least:
        return found
    note = f"the inequalities, whose test of the gain is sufficient only, found {least:.6g} 1/s"
    return Candidate(other.problem, replace(other, solves=found.optimum.solves), note)


def _vertexwise(problem: Problem) -> list[Candidate]:
    """A common matrix first, which is a special case and quick; then a matrix for each vertex, as time allows."""
    request, clock = problem.request, problem.clock
    common = replace(problem, lyapunov="common", clock=clock.part(SHARE))
    found = [replace(_common(common), note="the law of a common matrix, which serves constant parameters as well")]
    if found[0].optimum.values:
        found[0] = replace(found[0], source=found[0].problem, problem=problem)
    least = least_energy(problem) if request.objective == "h2" else np.nan
    for slack in SLACKS:
        best = min((_worth(one) for one in found if one.optimum.values), default=np.inf)
        if best <= NEAR * least or (request.objective == "feasible" and np.isfinite(best)):
            break
        trial = replace(problem, slack=slack, clock=clock.part(SHARE))
        if trial.clock.left <= 0.0:
            break
        found.append(_relaxed(trial))
        found[-1] = replace(found[-1], problem=replace(found[-1].problem, clock=clock))
        if found[-1].optimum.status is Status.TIME_LIMIT:
            break
    if found[-1].optimum.status is Status.TIME_LIMIT or clock.left <= 0.0:
        words = "; the time was up before the search was at its end"
        found = [replace(one, note=one.note + words, optimum=replace(one.optimum, certain=False)) for one in found]
    return found


def _relaxed(problem: Problem) -> Candidate:
    """A matrix for each vertex and a slack; a decay rate that a law of small norm has anyway is not asked for.

    That halves the problem. The rate is among the claims all the same.
    """
    request = problem.request
    note = f"matrices of the vertices with a slack of {problem.slack:g} scaled time constants"
    if request.decay_rate is not None and request.objective in ("h2", "h_infinity"):
        free = problem.with_request(replace(request, decay_rate=None))
        optimum = optimise(free)
        if optimum.values and _slowest(problem, optimum) > request.decay_rate:
            return Candidate(problem, replace(optimum, rate=request.decay_rate), note, free)
        if not optimum.values:
            return Candidate(problem, optimum, note)
    return _candidate(problem, note)


def _candidate(problem: Problem, note: str = "") -> Candidate:
    """The optimum of a problem, and the problem in the coordinates the optimum is told in."""
    optimum = optimise(problem)
    return Candidate(optimum.problem or problem, optimum, note)


def without_slack_bounds(problem: Problem) -> Candidate | None:
    """The optimum of a norm with only those bounds that it does not meet by itself; None where that is all of them.

    Each bound is a matrix inequality that shares the matrix of the objective: one that is slack costs performance, and
    numbers. Bounds the law of the rest breaks are added, until none is broken.
    """
    request = problem.request
    names = [name for name, _ in requirements(request) if name != "commands"]
    if request.objective not in ("h2", "h_infinity") or not names:
        return None
    kept: set[str] = set()
    while len(kept) < len(names) and problem.clock.left > 0.0:
        fewer = replace(request, **{name: None for name in names if name not in kept})  # type: ignore[arg-type]
        posed = pose(
            problem.plants, fewer, session=problem.session, clock=problem.clock.part(SHARE), solver=problem.solver
        )
        found = optimise(posed)
        if not found.values:
            return None
        broken = violated(problem, posed.gain(found.values))
        if not broken:
            dropped = [words for name, words in requirements(request) if name in names and name not in kept]
            note = f"met by the optimum without asking for it: {', '.join(dropped)}"
            whole = replace(posed, request=request, clock=problem.clock)
            return Candidate(whole, replace(found, rate=request.decay_rate or 0.0), note, posed)
        if broken <= kept:
            return None
        kept |= broken
    return None


def _demanding(problem: Problem, share: float = HARDER) -> Candidate:
    """With the decay rate among the inequalities, and a little more than the rate that is to be proved."""
    rate = problem.request.decay_rate or 0.0
    more = share * rate
    harder = replace(problem.with_request(replace(problem.request, decay_rate=more)), clock=problem.clock.part(SHARE))
    note = f"with {more:.6g} 1/s asked for, to have room to prove {rate:g} 1/s"
    if problem.lyapunov != "common":
        note = f"matrices of the vertices with a slack of {problem.slack:g} scaled time constants, {note}"
    return Candidate(problem, replace(optimise(harder), rate=rate), note, harder)


def _worth(one: Candidate) -> float:
    """What a candidate is judged by, small is good: its H2 norm at the worst vertex, or the solver's objective."""
    request, optimum = one.problem.request, one.optimum
    if request.objective == "h2":
        return largest_energy(one.problem, optimum)
    if np.isnan(optimum.objective):
        return 0.0
    return -optimum.objective if request.objective == "decay" else optimum.objective


def _slowest(problem: Problem, optimum: Optimum) -> float:
    """Decay rate of the slowest pole of all vertices, 1/s."""
    K = _law(optimum)
    return problem.scaling.rate * min(-float(np.max(np.linalg.eigvals(v.A + v.B @ K).real)) for v in problem.vertices)


def largest_energy(problem: Problem, optimum: Optimum) -> float:
    """H2 norm at the worst vertex, by Lyapunov equation; infinite where a vertex is not stable."""
    K, worst = _law(optimum), 0.0
    for v in problem.vertices:
        closed, C = v.A + v.B @ K, v.h2[1] + v.h2[2] @ K
        if np.max(np.linalg.eigvals(closed).real) >= 0.0:
            return np.inf
        P = solve_continuous_lyapunov(closed.T, -C.T @ C)
        worst = max(worst, float(np.trace(v.h2[0].T @ P @ v.h2[0])))
    return float(np.sqrt(worst)) * problem.scaling.h2


def least_energy(problem: Problem) -> float:
    """H2 norm below which no law stays at every vertex: the largest of the vertices' own regulators.

    NaN where no vertex prices all its commands, so that its regulator has no equation.
    """
    worst = 0.0
    for v in problem.vertices:
        B, C, D = v.h2
        if float(np.linalg.eigvalsh(D.T @ D)[0]) < PRICED:
            continue
        try:
            P = solve_continuous_are(v.A, v.B, C.T @ C, D.T @ D, s=C.T @ D)
        except (LinAlgError, ValueError):
            continue
        worst = max(worst, float(np.trace(B.T @ P @ B)))
    return float(np.sqrt(worst)) * problem.scaling.h2 if worst > 0.0 else np.nan


def _law(optimum: Optimum) -> FloatArray:
    return np.asarray(np.linalg.solve(optimum.values["slack"].T, optimum.values["Y"].T).T, dtype=np.float64)
