"""From a solution of the inequalities to claims about the closed loops, in physical units."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import product

import numpy as np
from scipy.linalg import LinAlgError, solve_continuous_are, solve_continuous_lyapunov

from maglev_ctrl.analysis.hamiltonian import h_infinity_norm
from maglev_ctrl.arrays import FloatArray, read_only
from maglev_ctrl.errors import NotStable
from maglev_ctrl.proofs.claims import Claim, DecayClaim, EllipsoidClaim, EnergyClaim, GainClaim, RegionClaim
from maglev_ctrl.proofs.prove import prove
from maglev_ctrl.synthesis.lmi.problem import USUAL, Optimum, Problem
from maglev_ctrl.synthesis.lmi.request import MultiObjective, channel_indices
from maglev_ctrl.synthesis.lmi.stability import closed_loops, parameter_certificate, quadratic_stability
from maglev_ctrl.synthesis.result import Performance
from maglev_ctrl.systems import Controller
from maglev_ctrl.systems.plant import Plant, closed_channel

ROOM = 1e-6
"""Relative room above the level found, so that the strict inequality of the claim holds."""
ROOMS = (0.0, 1e-4, 1e-3, 5e-3)
"""Shares by which the level of an objective is raised, in turn, until it can be proved."""


def state_feedback(problem: Problem, gain: FloatArray, name: str) -> Controller:
    """The law u = K x."""
    plant = problem.plants[0]
    return Controller.static(gain, measured=plant.measured, commands=plant.commands, name=name)


def levels(problem: Problem, optimum: Optimum) -> tuple[float, float]:
    """Levels to claim of the H2 and the H-infinity norm; NaN where a norm is not wanted."""
    request, scaling, found = problem.request, problem.scaling, optimum.values
    two = infinity = np.nan
    if request.has_h2:
        two = float(np.sqrt(max(float(found["energy"]), 0.0))) * scaling.h2 * (1.0 + ROOM)
        if request.objective != "h2" and request.h2_below is not None:
            two = request.h2_below
    if request.has_h_infinity:
        infinity = float(found["gamma"]) * scaling.h_infinity * (1.0 + ROOM)
        if request.objective != "h_infinity" and request.h_infinity_below is not None:
            infinity = request.h_infinity_below
    return two, infinity


def common_claims(problem: Problem, optimum: Optimum, controller: Controller) -> list[Claim]:
    """Claims that one Lyapunov matrix proves for all vertices and all that lies between.

    The matrix of the solver is X; where X is too rough for a claim, the same inequality is solved again for the law
    found, each claim with a matrix of its own.
    """
    request, count = problem.request, len(problem.plants)
    plants, laws = tuple(range(count)), (0,) * count
    X = _physical(problem, optimum.values["slack"])
    P = _inverse(X)
    two, infinity = levels(problem, optimum)
    wanted: list[tuple[Claim, MultiObjective]] = [
        (DecayClaim(plants, laws, optimum.rate, P[None]), MultiObjective(decay_rate=optimum.rate or None))
    ]
    if request.region is not None:
        region = request.region
        claim: Claim = RegionClaim(plants, laws, region.label, region.L, region.M, X[None])
        wanted.append((claim, MultiObjective(region=region)))
    if request.has_h2:
        names = request.h2_channel
        P_2 = read_only(P * problem.scaling.h2**2 / problem.scaling.rate, name="P")
        claim = EnergyClaim(plants, laws, two, P_2[None], names.disturbances, names.performance)
        wanted.append((claim, MultiObjective("h2", h2_channel=names)))
    if request.has_h_infinity:
        names = request.h_infinity_channel
        P_infinity = read_only(P * problem.scaling.h_infinity, name="P")
        claim = GainClaim(plants, laws, infinity, P_infinity[None], names.disturbances, names.performance)
        wanted.append((claim, MultiObjective("h_infinity", h_infinity_channel=names)))
    claims = [_supported(problem, claim, alone, controller) for claim, alone in wanted]
    if request.commands is not None:
        claims.append(EllipsoidClaim(plants, laws, _fitted(problem, P)[None], request.commands.limits))
    return claims


def vertex_claims(problem: Problem, optimum: Optimum, controller: Controller) -> tuple[list[Claim], str]:
    """Claims for constant parameters: stability of every blend, norms and regions vertex by vertex."""
    request = problem.request
    loops = closed_loops(problem.plants, controller)
    claims: list[Claim] = []
    blends = _blends(problem, loops, optimum.rate)
    if blends is None:
        return [], "no parameter-dependent certificate was found for the law"
    claims.append(blends)
    two, infinity = levels(problem, optimum)
    for i, plant in enumerate(problem.plants):
        blank = np.eye(len(plant.states))[None]
        if request.region is not None:
            region = request.region
            claim: Claim = RegionClaim((i,), (0,), region.label, region.L, region.M, blank)
            claims.append(_supported(problem, claim, MultiObjective(region=region), controller))
        if request.has_h2:
            names = request.h2_channel
            claim = EnergyClaim((i,), (0,), two, blank, names.disturbances, names.performance)
            claims.append(_supported(problem, claim, MultiObjective("h2", h2_channel=names), controller))
        if request.has_h_infinity:
            names = request.h_infinity_channel
            claim = GainClaim((i,), (0,), infinity, blank, names.disturbances, names.performance)
            alone = MultiObjective("h_infinity", h_infinity_channel=names)
            claims.append(_supported(problem, claim, alone, controller))
    return claims, ""


def _blends(problem: Problem, loops: Sequence[FloatArray], rate: float) -> Claim | None:
    """Decay of every blend: by one matrix for each vertex or, where that fails, by a common one.

    Conditions for a law (on A') and for the law found (on A) are both sufficient only, so that a decay rate found by
    the first may have to be lowered for the second; not below what is asked.
    """
    shares = (1.0, 0.995, 0.98, 0.95, 0.9) if problem.request.objective == "decay" else (1.0,)
    for share in shares:
        slower = max(share * rate, problem.request.decay_rate or 0.0)
        claim, _ = parameter_certificate(loops, slower, clock=problem.clock, solver=problem.solver)
        if claim is not None:
            return claim
    common = quadratic_stability(loops, time_limit=problem.clock.left, solver=problem.solver)
    least = (problem.request.decay_rate or 0.0) if problem.request.objective == "decay" else rate
    if common.stable and isinstance(common.claim, DecayClaim) and common.rate >= least:
        return common.claim
    return None


def recomputed(problem: Problem, controller: Controller) -> tuple[Performance, ...]:
    """Norms, slowest pole and gain of every closed loop, by Lyapunov equation and Hamiltonian, not by the solver."""
    request = problem.request
    found: list[Performance] = []
    for plant in problem.plants:
        at = f" at {plant.name}" if len(problem.plants) > 1 else ""
        A, B, C, D = closed_channel(plant, controller)
        slowest = -float(np.max(np.linalg.eigvals(A).real))
        found.append(Performance(f"decay rate{at}", np.nan, slowest, "1/s"))
        if request.has_h2 and slowest > 0.0:
            columns, rows = channel_indices(plant, request.h2_channel, "h2")
            W = solve_continuous_lyapunov(A, -B[:, columns] @ B[:, columns].T)
            energy = float(np.trace(C[rows] @ W @ C[rows].T))
            found.append(Performance(f"H2 norm{at}", np.nan, float(np.sqrt(max(energy, 0.0)))))
        if request.has_h_infinity and slowest > 0.0:
            columns, rows = channel_indices(plant, request.h_infinity_channel, "h_infinity")
            try:
                peak = h_infinity_norm(A, B[:, columns], C[rows], D[np.ix_(rows, columns)]).lower
            except NotStable:
                peak = np.inf
            found.append(Performance(f"H-infinity norm{at}", np.nan, peak))
    found.append(Performance("gain of the law", np.nan, float(np.linalg.norm(controller.D, 2))))
    return tuple(found)


def outside_ellipsoid(request: MultiObjective, claims: Sequence[Claim]) -> str:
    """Why the ellipsoid claimed does not hold the initial states; empty where it does."""
    commands = request.commands
    for claim in claims:
        if commands is not None and isinstance(claim, EllipsoidClaim):
            worst = max(float(x @ claim.P[0] @ x) for x in _initial(request))
            if worst > 1.0:
                return f"an initial state lies outside the ellipsoid: x'P x = {worst:.6g}"
    return ""


def _physical(problem: Problem, X: FloatArray) -> FloatArray:
    T = problem.scaling.states
    return read_only(0.5 * (X + X.T) * np.outer(T, T), name="X")


def _inverse(X: FloatArray) -> FloatArray:
    scale = 1.0 / np.sqrt(np.diag(X))
    P = np.linalg.inv(X * np.outer(scale, scale)) * np.outer(scale, scale)
    return read_only(0.5 * (P + P.T), name="P")


def _supported(problem: Problem, claim: Claim, alone: MultiObjective, controller: Controller) -> Claim:
    """The claim with a matrix that proves it, where one is found.

    A norm that is the objective has no level to keep to: what cannot be proved at the level the solver found is tried a
    little above it, and that is then what is claimed.
    """
    objective = problem.request.objective
    for room in ROOMS:
        raised = claim
        if room and isinstance(claim, EnergyClaim) and objective == "h2":
            raised = replace(claim, level=_raised(claim.level, room, problem.request.h2_below))
        elif room and isinstance(claim, GainClaim) and objective == "h_infinity":
            raised = replace(claim, gamma=_raised(claim.gamma, room, problem.request.h_infinity_below))
        elif room:
            break
        if prove(raised, problem.plants, [controller]).holds:
            return raised
        raised = _polished(problem, raised, alone, controller)
        if prove(raised, problem.plants, [controller]).holds:
            return raised
    return claim


def _raised(level: float, room: float, bound: float | None) -> float:
    return min(level * (1.0 + room), np.inf if bound is None else bound)


def _polished(problem: Problem, claim: Claim, alone: MultiObjective, controller: Controller) -> Claim:
    """The claim with a matrix found for the law as it is: of one loop directly, of several by the inequality again."""
    if len(claim.plants) == 1:
        direct = _direct(problem, claim, controller)
        if prove(direct, problem.plants, [controller]).holds:
            return direct
    return _solved_again(problem, claim, alone, controller)


def _direct(problem: Problem, claim: Claim, controller: Controller) -> Claim:
    """Certificate of one closed loop without a semidefinite problem: Lyapunov or Riccati equation, or eigenvectors."""
    T = problem.scaling.states
    A, B, C, D = closed_channel(problem.plants[claim.plants[0]], controller)
    A, B, C = A * T / T[:, None], B / T[:, None], C * T

    def back(P: FloatArray) -> FloatArray:
        return read_only((0.5 * (P + P.T) / np.outer(T, T))[None], name="P")

    match claim:
        case DecayClaim():
            shifted = A + claim.rate * np.eye(A.shape[0])
            P = np.asarray(solve_continuous_lyapunov(shifted.T, -np.eye(A.shape[0])), dtype=np.float64)
            return replace(claim, P=back(P))
        case RegionClaim():
            # X = V V* turns the inequality into that of the poles, one block for each.
            V = np.linalg.eig(A)[1]
            X = np.asarray((V @ np.conj(V.T)).real, dtype=np.float64)
            return replace(claim, X=read_only((0.5 * (X + X.T) * np.outer(T, T))[None], name="X"))
        case EnergyClaim():
            columns, rows = channel_indices(problem.plants[0], problem.request.h2_channel, "h2")
            return replace(claim, P=back(_energy_matrix(A, B[:, columns], C[rows], claim.level)))
        case GainClaim():
            columns, rows = channel_indices(problem.plants[0], problem.request.h_infinity_channel, "h_infinity")
            through = D[np.ix_(rows, columns)]
            return replace(claim, P=back(_gain_matrix(A, B[:, columns], C[rows], through, claim.gamma)))
        case _:
            return claim


def _solved_again(problem: Problem, claim: Claim, alone: MultiObjective, controller: Controller) -> Claim:
    """The inequality once more for this claim alone, with A + B K for A and no B."""
    chosen = tuple(problem.plants[i] for i in claim.plants)
    scaling = problem.scaling
    law = scaling.states * controller.D / scaling.commands[:, None]
    vertices = []
    for i in claim.plants:
        v = problem.vertices[i]
        two, infinity = v.h2, v.h_infinity
        vertices.append(replace(
            v, A=v.A + v.B @ law, B=0.0 * v.B, h2=(two[0], two[1] + two[2] @ law, 0.0 * two[2]),
            h_infinity=(infinity[0], infinity[1] + infinity[2] @ law, 0.0 * infinity[2], infinity[3]),
        ))  # fmt: skip
    fixed = replace(problem, plants=chosen, vertices=tuple(vertices), request=alone, lyapunov="common")
    # Nothing to make best: any point inside will do, and the solver stops in the middle of what is left.
    bounds: dict[str, float] = {"weigh_trace": 0.0}
    if isinstance(claim, EnergyClaim):
        bounds["energy_most"] = (claim.level / scaling.h2) ** 2 * (1.0 - ROOM)
    if isinstance(claim, GainClaim):
        bounds["gamma_most"] = claim.gamma / scaling.h_infinity * (1.0 - ROOM)
    answer = fixed.solve(USUAL, **bounds)
    if not answer.usable:
        return claim
    values: Mapping[str, FloatArray] = answer.values
    X = _physical(problem, values["slack"])
    match claim:
        case RegionClaim():
            return replace(claim, X=X[None])
        case EnergyClaim():
            return replace(claim, P=read_only(_inverse(X)[None] * scaling.h2**2 / scaling.rate, name="P"))
        case GainClaim():
            return replace(claim, P=read_only(_inverse(X)[None] * scaling.h_infinity, name="P"))
        case DecayClaim():
            return replace(claim, P=_inverse(X)[None])
        case _:
            return claim


def _energy_matrix(A: FloatArray, B: FloatArray, C: FloatArray, level: float) -> FloatArray:
    """Observability Gramian with as much extra weight as half the room below the level allows."""
    n = A.shape[0]
    P = solve_continuous_lyapunov(A.T, -C.T @ C)
    extra = solve_continuous_lyapunov(A.T, -np.eye(n))
    room, price = level**2 - float(np.trace(B.T @ P @ B)), float(np.trace(B.T @ extra @ B))
    share = 0.5 * room / price if room > 0.0 and price > 0.0 else 0.0
    P = P + share * extra
    return read_only(0.5 * (P + P.T), name="P")


def _gain_matrix(A: FloatArray, B: FloatArray, C: FloatArray, D: FloatArray, level: float) -> FloatArray:
    """Stabilising solution of the bounded-real Riccati equation with a little more output, so that it is strict."""
    n, m = A.shape[0], B.shape[1]
    size = max(float(np.linalg.norm(C, 2)) ** 2 / level, 1e-300)
    for share in (1e-4, 1e-6, 1e-8, 1e-10):
        Q = C.T @ C / level + share * size * np.eye(n)
        R = D.T @ D / level - level * np.eye(m)
        try:
            P = np.asarray(solve_continuous_are(A, B, Q, R, s=C.T @ D / level), dtype=np.float64)
        except (LinAlgError, ValueError):
            continue
        if float(np.linalg.eigvalsh(0.5 * (P + P.T))[0]) > 0.0:
            return read_only(0.5 * (P + P.T), name="P")
    return read_only(np.eye(n), name="P")


def _initial(request: MultiObjective) -> FloatArray:
    """Initial states to be held; of a box its corners, one of each mirrored pair."""
    commands = request.commands
    assert commands is not None
    if commands.initial_states is not None:
        return np.asarray(commands.initial_states, dtype=np.float64)
    allowed = np.asarray(commands.allowed, dtype=np.float64)
    present = np.flatnonzero(allowed)
    corners = np.array(list(product((-1.0, 1.0), repeat=len(present) - 1)), dtype=np.float64)
    states = np.zeros((len(corners), len(allowed)))
    states[:, present] = np.hstack([np.ones((len(corners), 1)), corners.reshape(len(corners), -1)])
    return np.asarray(states * allowed, dtype=np.float64)


def _fitted(problem: Problem, P: FloatArray) -> FloatArray:
    """The ellipsoid shrunk or grown until it just holds every initial state."""
    worst = max(float(x @ P @ x) for x in _initial(problem.request))
    return read_only(P / (worst * (1.0 + 1e-12)), name="P")


def same_names(plants: Sequence[Plant]) -> tuple[Plant, ...]:
    """Vertices with names of their own, for sentences about them."""
    if len({plant.name for plant in plants}) == len(plants):
        return tuple(plants)
    return tuple(replace(plant, name=f"{plant.name} {i + 1}") for i, plant in enumerate(plants))
