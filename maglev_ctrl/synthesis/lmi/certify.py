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
from maglev_ctrl.synthesis.result import Performance
from maglev_ctrl.systems import Controller
from maglev_ctrl.systems.plant import Plant, closed_channel

ROOM = 1e-6
"""Relative room above the level found, so that the strict inequality of the claim holds."""
ROOMS = (0.0, 1e-4, 1e-3, 5e-3)
"""Shares by which the level of an objective is raised, in turn, until it can be proved."""


SUBJECTS = {EnergyClaim: "the H2 norm", GainClaim: "the H-infinity norm", RegionClaim: "the region of poles"}
VERTEX_ROOM = 1e-3
"""Share by which a norm claimed at one vertex lies above its value there."""


def state_feedback(problem: Problem, gain: FloatArray, name: str) -> Controller:
    """The law u = K x."""
    plant = problem.plants[0]
    return Controller.static(gain, measured=plant.measured, commands=plant.commands, name=name)


def levels(problem: Problem, optimum: Optimum) -> tuple[float, float]:
    """Levels to claim of the H2 and the H-infinity norm; NaN where a norm is not wanted."""
    request, scaling, found = problem.request, problem.scaling, optimum.values
    two = infinity = np.nan
    if request.has_h2:
        if request.objective != "h2" and request.h2_below is not None:
            two = request.h2_below
        else:
            two = float(np.sqrt(max(float(found["energy"]), 0.0))) * scaling.h2 * (1.0 + ROOM)
    if request.has_h_infinity:
        if request.objective != "h_infinity" and request.h_infinity_below is not None:
            infinity = request.h_infinity_below
        else:
            infinity = float(found["gamma"]) * scaling.h_infinity * (1.0 + ROOM)
    return two, infinity


def common_claims(
    problem: Problem, optimum: Optimum, controller: Controller
) -> tuple[list[Claim], tuple[str, ...]]:  # fmt: skip
    """Claims that one Lyapunov matrix proves for all vertices and all that lies between, and notes about them.

    The matrix of the solver is X; where X is too rough for a claim, the same inequality is solved again for the law
    found, each claim with a matrix of its own. Where that fails too, norms and region are claimed at the vertices
    only, and a note says so; the decay of everything between is never given up.
    """
    request, count = problem.request, len(problem.plants)
    plants, laws = tuple(range(count)), (0,) * count
    X = _physical(problem, optimum.values["slack"])
    P = certificate(problem, optimum.values["slack"])
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
        P_infinity = read_only(P * problem.scaling.h_infinity * problem.scaling.balance, name="P")
        claim = GainClaim(plants, laws, infinity, P_infinity[None], names.disturbances, names.performance)
        wanted.append((claim, MultiObjective("h_infinity", h_infinity_channel=names)))
    claims: list[Claim] = []
    notes: list[str] = []
    for whole, alone in wanted:
        claim = supported(problem, whole, alone, controller)
        parts: list[Claim] = []
        retreat = count > 1 and not prove(claim, problem.plants, [controller]).holds
        if retreat and isinstance(claim, RegionClaim | EnergyClaim | GainClaim):
            parts = at_vertices(problem, claim, controller)
            notes.append(f"{SUBJECTS[type(claim)]} is claimed at the {count} vertices only, not between them")
        claims += parts or [claim]
    if request.commands is not None:
        claims.append(EllipsoidClaim(plants, laws, _fitted(problem, P)[None], request.commands.limits))
    return claims, tuple(notes)


def at_vertices(
    problem: Problem, claim: RegionClaim | EnergyClaim | GainClaim, controller: Controller
) -> list[Claim]:  # fmt: skip
    """The claim about each vertex alone; an objective at its own value there and a little room."""
    request = problem.request
    found: list[Claim] = []
    for i in range(len(problem.plants)):
        one: Claim
        match claim:
            case RegionClaim():
                alone = MultiObjective(region=request.region)
                one = replace(claim, plants=(i,), controllers=(0,))
            case EnergyClaim(level=level):
                alone = MultiObjective("h2", h2_channel=request.h2_channel)
                if request.objective == "h2" and request.h2_below is None:
                    level = _energy(problem, i, controller) * (1.0 + VERTEX_ROOM)
                one = replace(claim, plants=(i,), controllers=(0,), level=level)
            case GainClaim(gamma=gamma):
                alone = MultiObjective("h_infinity", h_infinity_channel=request.h_infinity_channel)
                if request.objective == "h_infinity" and request.h_infinity_below is None:
                    gamma = min(gamma, _peak(problem, i, controller) * (1.0 + VERTEX_ROOM))
                one = replace(claim, plants=(i,), controllers=(0,), gamma=gamma)
        found.append(supported(problem, one, alone, controller))
    return found


def recomputed(problem: Problem, controller: Controller) -> tuple[Performance, ...]:
    """Norms, slowest pole and gain of every closed loop, by Lyapunov equation and Hamiltonian, not by the solver."""
    request = problem.request
    found: list[Performance] = []
    for i, plant in enumerate(problem.plants):
        at = f" at {plant.name}" if len(problem.plants) > 1 else ""
        slowest = -float(np.max(np.linalg.eigvals(_balanced(problem, plant, controller)[0]).real))
        found.append(Performance(f"decay rate{at}", np.nan, slowest, "1/s"))
        if request.has_h2 and slowest > 0.0:
            found.append(Performance(f"H2 norm{at}", np.nan, _energy(problem, i, controller)))
        if request.has_h_infinity and slowest > 0.0:
            found.append(Performance(f"H-infinity norm{at}", np.nan, _peak(problem, i, controller)))
    found.append(Performance("gain of the law", np.nan, float(np.linalg.norm(controller.D, 2))))
    return tuple(found)


def _energy(problem: Problem, vertex: int, controller: Controller) -> float:
    """H2 norm of one closed loop by its controllability Gramian."""
    plant = problem.plants[vertex]
    A, B, C, _ = _balanced(problem, plant, controller)
    columns, rows = channel_indices(plant, problem.request.h2_channel, "h2")
    W = solve_continuous_lyapunov(A, -B[:, columns] @ B[:, columns].T)
    return float(np.sqrt(max(float(np.trace(C[rows] @ W @ C[rows].T)), 0.0)))


def _peak(problem: Problem, vertex: int, controller: Controller) -> float:
    """H-infinity norm of one closed loop by Hamiltonian bisection; infinite where it is not stable."""
    plant = problem.plants[vertex]
    A, B, C, D = _balanced(problem, plant, controller)
    columns, rows = channel_indices(plant, problem.request.h_infinity_channel, "h_infinity")
    try:
        return h_infinity_norm(A, B[:, columns], C[rows], D[np.ix_(rows, columns)]).lower
    except NotStable:
        return np.inf


def _balanced(
    problem: Problem, plant: Plant, controller: Controller
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """The closed loop in the coordinates of the problem: in newtons and metres a Gramian can lose every digit."""
    T = problem.transformation
    A, B, C, D = closed_channel(plant, controller)
    inner, entry = (np.asarray(np.linalg.solve(T, one), dtype=np.float64) for one in (A @ T, B))
    return inner, entry, C @ T, D


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
    T = problem.transformation
    full = T @ (0.5 * (X + X.T)) @ T.T
    return read_only(0.5 * (full + full.T), name="X")


def certificate(problem: Problem, X: FloatArray) -> FloatArray:
    """P in physical units, inverted where X is near the identity."""
    back = np.linalg.inv(problem.transformation)
    P = back.T @ np.linalg.inv(0.5 * (X + X.T)) @ back
    return read_only(0.5 * (P + P.T), name="P")


def supported(problem: Problem, claim: Claim, alone: MultiObjective, controller: Controller) -> Claim:
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
    T = problem.transformation
    A, B, C, D = _balanced(problem, problem.plants[claim.plants[0]], controller)

    def back(P: FloatArray) -> FloatArray:
        inverse = np.linalg.inv(T)
        P = inverse.T @ P @ inverse
        return read_only(0.5 * (P + P.T)[None], name="P")

    match claim:
        case DecayClaim():
            shifted = A + claim.rate * np.eye(A.shape[0])
            if float(np.max(np.linalg.eigvals(shifted).real)) >= 0.0:
                return claim
            P = np.asarray(solve_continuous_lyapunov(shifted.T, -np.eye(A.shape[0])), dtype=np.float64)
            return replace(claim, P=back(P))
        case RegionClaim():
            # X = V V* turns the inequality into that of the poles, one block for each.
            V = np.linalg.eig(A)[1]
            return replace(claim, X=_physical(problem, np.asarray((V @ np.conj(V.T)).real, dtype=np.float64))[None])
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
    law = problem.scaled(controller.D)
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
    answer = fixed.solve(USUAL, bounds)
    if not answer.usable:
        return claim
    values: Mapping[str, FloatArray] = answer.values
    X, P = _physical(problem, values["slack"]), certificate(problem, values["slack"])
    match claim:
        case RegionClaim():
            return replace(claim, X=X[None])
        case EnergyClaim():
            return replace(claim, P=read_only(P[None] * scaling.h2**2 / scaling.rate, name="P"))
        case GainClaim():
            return replace(claim, P=read_only(P[None] * scaling.h_infinity * scaling.balance, name="P"))
        case DecayClaim():
            return replace(claim, P=P[None])
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
