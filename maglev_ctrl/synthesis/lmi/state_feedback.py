"""Multi-objective state feedback for a polytope of plants: one law u = K x, every bound proved."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from maglev_ctrl.errors import Status
from maglev_ctrl.proofs.claims import Claim
from maglev_ctrl.synthesis.lmi.blends import vertex_claims
from maglev_ctrl.synthesis.lmi.candidates import Candidate, candidates, largest_energy, least_energy
from maglev_ctrl.synthesis.lmi.certify import (
    common_claims,
    outside_ellipsoid,
    recomputed,
    same_names,
    state_feedback,
)
from maglev_ctrl.synthesis.lmi.conditions import Lyapunov
from maglev_ctrl.synthesis.lmi.conflicts import conflict, contradicted, share_of_starts, suspected_conflict
from maglev_ctrl.synthesis.lmi.fastest import price_of_decay, without_limit
from maglev_ctrl.synthesis.lmi.optimise import BACK_OFF, optimise
from maglev_ctrl.synthesis.lmi.problem import Optimum, Problem, pose
from maglev_ctrl.synthesis.lmi.request import MultiObjective, check_request
from maglev_ctrl.synthesis.lmi.session import Clock, LmiSession, Solver
from maglev_ctrl.synthesis.result import Synthesis, proven, refused
from maglev_ctrl.systems.plant import Plant

LAW = "multi-objective state feedback"
AGREE = 1e-3
"""Relative difference allowed between two solvers' optima."""
WORDS = {"h2": "H2 norm", "h_infinity": "H-infinity norm", "decay": "decay rate", "gain": "gain of the law"}


def multi_objective(
    plants: Sequence[Plant],
    request: MultiObjective,
    *,
    lyapunov: Lyapunov = "common",
    solver: Solver = "CLARABEL",
    cross_check: bool = False,
    time_limit: float = 60.0,
    session: LmiSession | None = None,
) -> Synthesis:
    """One state feedback u = K x that meets every bound of the request at every vertex, with proofs.

    With `lyapunov` "common" the bounds hold for everything between the vertices: decay and peak gain however fast the
    parameters vary, H2 norm and pole region for constant ones. "parameter_dependent" is for constant parameters and
    less strict; stability is then proved for all blends, norms and regions at the vertices.

    Parameters
    ----------
    plants : vertices with the same names, every state measured, continuous
    solver : "CLARABEL", or "CVXOPT" or "SCS" where installed and asked for
    cross_check : solve again with CVXOPT and compare the optima
    time_limit : s, for everything; what was reached is handed out if it is proved, the status is else TIME_LIMIT
    session : keeps problems by shape; pass the same one for many operating points

    Raises
    ------
    ValueError : the request cannot be meant (see `check_request`)
    ModelError : the plants cannot be controlled as asked, whatever the law
    ModuleNotFoundError : the solver asked for is not installed

    Examples
    --------
    >>> plant = Plant.from_matrices([[0.0, 1.0], [4.0, 0.0]], [[0.0], [1.0]], [[0.0], [1.0]], [[1.0, 0.0]])
    >>> design = multi_objective([plant], MultiObjective("gain", decay_rate=1.0))
    >>> design.status.name, bool(np.max(np.linalg.eigvals(plant.A + plant.B2 @ design.controller.D).real) < -1.0)
    ('SOLVED', True)
    """
    clock = Clock(time_limit)
    check_request(plants, request)
    named = same_names(plants)
    if request.commands is not None and lyapunov != "common":
        raise ValueError("lyapunov: command limits need 'common', one ellipsoid for all vertices")
    if clock.left <= 0.0:
        return refused(LAW, named, Status.TIME_LIMIT, _late(clock))
    kept = session if session is not None else LmiSession()
    posed = pose(named, request, session=kept, clock=clock, solver=solver, lyapunov=lyapunov)
    try:
        return _best(posed, clock, cross_check)
    except np.linalg.LinAlgError as fault:  # from what a solver called a point no law can be formed
        return refused(LAW, named, Status.NOT_VERIFIED, f"the solver's point makes no law: {fault}")


def _best(posed: Problem, clock: Clock, cross_check: bool) -> Synthesis:
    """The first candidate that is proved, or why there is none."""
    named = posed.plants
    reached: list[str] = []
    design = refused(LAW, named, Status.NUMERICAL_ERROR, "nothing was tried")
    for one in candidates(posed):
        if not one.optimum.values:
            return _failed(replace(one.problem, clock=clock), one.optimum)
        design = _finished(one, cross_check)
        if design.controllers:
            return design
        reached.append(_reached(one, design))
    if design.status is Status.NOT_VERIFIED and clock.left <= 0.0:
        return refused(LAW, named, Status.TIME_LIMIT, f"{_late(clock)}; {'; '.join(reached)}")
    if design.status is Status.NOT_VERIFIED and (told := suspected_conflict(replace(posed, clock=clock))):
        return _infeasible(replace(posed, clock=clock), told)
    return design


def _finished(one: Candidate, cross_check: bool) -> Synthesis:
    problem, optimum = one.problem, one.optimum
    notes = _notes(problem, optimum, one.searched.regular) + ((one.note,) if one.note else ())
    if cross_check:
        disagreement = _second_opinion(one.searched, optimum)
        if disagreement:
            return refused(LAW, problem.plants, Status.NOT_VERIFIED, disagreement)
        notes += ("CVXOPT finds the same optimum",)
    return _released(problem, optimum, notes)


def _reached(one: Candidate, design: Synthesis) -> str:
    """What there was of a law that is not handed out."""
    worst = f" (H2 norm {largest_energy(one.problem, one.optimum):.6g})" if one.problem.request.has_h2 else ""
    return f"a law was found{worst} and not proved: {design.message}"


def _released(problem: Problem, optimum: Optimum, notes: tuple[str, ...]) -> Synthesis:
    """Through the gate, with what the claims do not say checked here."""
    request = problem.request
    controller = state_feedback(problem, problem.gain(optimum.values), "state feedback")
    claims: list[Claim]
    missing = ""
    if problem.lyapunov == "common":
        claims, told = common_claims(problem, optimum, controller)
        notes += told
    else:
        claims, missing = vertex_claims(problem, optimum, controller)
    size = float(np.linalg.norm(controller.D, 2))
    if request.gain_below is not None and not size < request.gain_below:
        missing = f"the gain is {size:.6g}, not below {request.gain_below:g}"
    missing = missing or outside_ellipsoid(request, claims)
    if missing:
        return refused(LAW, problem.plants, Status.NOT_VERIFIED, missing)
    return proven(
        LAW, problem.plants, [controller], claims=claims, performance=recomputed(problem, controller), notes=notes,
        status=Status.SOLVED if optimum.certain else Status.ALMOST_SOLVED,
    )  # fmt: skip


def _notes(problem: Problem, optimum: Optimum, regular: bool) -> tuple[str, ...]:
    objective = problem.request.objective
    found = [f"{optimum.solves} semidefinite problems solved by {problem.solver}"]
    if objective == "decay" and optimum.ended:
        found.append(
            f"fastest decay found {optimum.objective:.6g} 1/s, which is no limit: the search ended because "
            f"{optimum.ended}; more may be possible, at more gain"
        )
    elif objective in WORDS:
        given = "room to prove it" if regular else "a smaller gain"
        found.append(
            f"best bound on the {WORDS[objective]} {optimum.objective:.6g}; up to {BACK_OFF:.1%} of it given up for "
            f"{given}"
        )
    if objective == "h2" and len(problem.plants) > 1 and not np.isnan(least := least_energy(problem)):
        worst = largest_energy(problem, optimum)
        found.append(f"H2 norm at the worst vertex {worst:.6g}; no one law stays below {least:.6g} at every vertex")
    if not optimum.certain and not (optimum.ended and problem.clock.left > 0.0):
        late = " (the time was up)" if problem.clock.left <= 0.0 else ""
        found.append(f"the search stopped before its end{late}, or the solver was not sure: a better law may exist")
    if problem.lyapunov != "common":
        found.append("stability is proved for every constant blend of the vertices; norms and regions at the vertices")
    return tuple(found)


def _second_opinion(problem: Problem, optimum: Optimum) -> str:
    """Why another solver's optimum speaks against this one; empty where it does not."""
    other = optimise(replace(problem, solver="CVXOPT"))
    if not other.values:
        return f"CVXOPT does not confirm the optimum: {other.status.value}"
    if np.isnan(optimum.objective):
        return ""
    if abs(other.objective - optimum.objective) > AGREE * abs(optimum.objective):
        return f"two solvers disagree: {problem.solver} found {optimum.objective:.6g}, CVXOPT {other.objective:.6g}"
    return ""


def _failed(problem: Problem, optimum: Optimum) -> Synthesis:
    status, plants = optimum.status, problem.plants
    match status:
        case Status.TIME_LIMIT:
            return refused(LAW, plants, status, _late(problem.clock))
        case Status.INFEASIBLE:
            return _infeasible(problem, conflict(problem))
        case Status.UNBOUNDED:
            message = _unbounded(problem)
        case _:
            message = suspected_conflict(problem)
            if message:
                return _infeasible(problem, message)
            message = share_of_starts(problem) or (
                "the solver stopped without an answer, and no requirement was found that cannot be met: relax the one "
                "nearest its limit"
            )
    return refused(LAW, plants, status, message)


def _infeasible(problem: Problem, message: str) -> Synthesis:
    """No law, by the word of the solver, unless a law made without it does what the solver says none can."""
    if contradicted(problem):
        told = "the solver says that no law exists, yet one made without it is proved to do what is asked: do not use"
        return refused(LAW, problem.plants, Status.NUMERICAL_ERROR, told)
    return refused(LAW, problem.plants, Status.INFEASIBLE, message)


def _unbounded(problem: Problem) -> str:
    message = "the decay rate can be made as large as wanted: bound the gain, the commands or the region of poles"
    if without_limit(problem) and (examples := price_of_decay(problem)):
        message += f" (each gain allows a rate of its own: {examples})"
    return message


def _late(clock: Clock) -> str:
    return f"not finished within {clock.limit:g} s"
