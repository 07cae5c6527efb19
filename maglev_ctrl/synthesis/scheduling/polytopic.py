"""State feedback that blends vertex gains by the parameter's weights, with one Lyapunov matrix: any variation.

X > 0 and Y_i with, for every coefficient of the closed loop in the weights (vertices, and pairs where B2 varies),

    [[A_i X + B_i Y_j + (.)' + 2 rate X, (C_i X + D_i Y_j)'], [., -I]] < 0   and   [[Z_i, B1_i'], [., X]] > 0,

K_i = Y_i X^-1 bounds the H2 norm by max trace Z_i; the bounded-real inequality bounds the peak gain likewise (Becker &
Packard, Systems & Control Letters 23 (1994) 205; Apkarian, Gahinet & Becker, Automatica 31 (1995) 1251).
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations_with_replacement
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from maglev_ctrl.analysis.norms import h2_norm, h_infinity_norm
from maglev_ctrl.arrays import FloatArray, read_only
from maglev_ctrl.errors import ModelError, Status
from maglev_ctrl.proofs.claims import Claim, DecayClaim, EnergyClaim, GainClaim
from maglev_ctrl.synthesis.channels import require_reachable
from maglev_ctrl.synthesis.lmi.request import MultiObjective
from maglev_ctrl.synthesis.lmi.scaling import ScaledVertex, Scaling, find_scaling, scale_vertex
from maglev_ctrl.synthesis.lmi.session import Answer, Clock, solve_problem
from maglev_ctrl.synthesis.neutral import hidden_modes
from maglev_ctrl.synthesis.result import Performance, Synthesis, proven, refused
from maglev_ctrl.synthesis.scheduling.records import ScheduledDesign, is_box, no_design
from maglev_ctrl.synthesis.scheduling.regulators import shared_regulators
from maglev_ctrl.systems import Controller
from maglev_ctrl.systems.plant import Plant, closed_channel
from maglev_ctrl.systems.scheduled import ScheduledController

LAW = "polytopic state feedback"
STRICT = 1e-7
"""How far (scaled, order one) an inequality is kept from its edge."""
IN_HAND = 1e-6
"""Relative distance of a claimed level from what the matrices give."""
Posed = Literal["h2", "h_infinity", "decay"]
Objective = Literal["regulator", "h2", "h_infinity", "decay"]


def polytopic_lpv(
    plants: Sequence[Plant],
    corners: ArrayLike,
    *,
    objective: Objective = "h2",
    rate: float = 0.0,
    parameter: str = "parameter",
    unit: str = "",
    time_limit: float = 60.0,
) -> ScheduledDesign:
    """K(theta) = sum of weights x K_i with one P for all blends of the vertices, however fast theta moves.

    Over one parameter the vertices may be more than two (a chain of nodes); over k parameters they are the 2^k corners
    of a box, blended multilinearly. What lies outside the blends of the vertices is not covered.

    Parameters
    ----------
    plants, corners : vertices, continuous and all states measured; their parameter values (v,) or (v, k)
    objective : "regulator" (the vertices' linear-quadratic regulators where one P serves all their blends, else as
        "h2"), "h2" (least guaranteed quadratic cost), "h_infinity" (least guaranteed peak gain), or "decay" (any law
        with the decay `rate`)
    rate : 1/s, decay of every loop between the vertices
    time_limit : s, for the solver

    Raises
    ------
    ValueError : numbers of plants and corners differ, states that are not measured, an unknown objective, a negative
        rate
    ModelError : a mode that is not stable cannot be moved (it is named)

    Examples
    --------
    >>> plants = [Plant.from_matrices([[a]], [[1.0]], [[1.0]], [[1.0], [0.0]], D12=[[0.0], [1.0]]) for a in (0.0, 1.0)]
    >>> design = polytopic_lpv(plants, [20.0, 40.0], parameter="speed", unit="m/s")
    >>> design.guarantee, bool(design.schedule.at(30.0).D[0, 0] < -0.5)
    ('polytopic: any variation', True)
    """
    values = read_only(corners, name="corners")
    values = values[:, None] if values.ndim == 1 else values
    _check(plants, values, objective, rate)
    unmoved = _unmoved_halfway(plants)
    if unmoved:
        return no_design(refused(LAW, plants, Status.INFEASIBLE, unmoved), values)
    notes = ["one P for every blend of the vertices and laws, at any rate of change"]
    if objective == "regulator":
        shared = _by_regulators(plants, values, rate, (parameter, unit), notes)
        if shared is not None:
            return shared
        notes.append("one P does not serve the regulators of the vertices: gains of least guaranteed cost instead")
    norm_of: Literal["h2", "h_infinity"] = "h_infinity" if objective == "h_infinity" else "h2"
    request = MultiObjective(norm_of, decay_rate=rate or None)
    scaling = find_scaling(plants, request)
    vertices = [scale_vertex(plant, request, scaling) for plant in plants]
    answer, pairs = _solve(vertices, _posed(objective), rate / scaling.rate, Clock(time_limit))
    if not answer.usable:
        reason = "no common Lyapunov matrix was found" if answer.status is Status.INFEASIBLE else answer.status.value
        wanted = f" with a decay of {rate:g} 1/s" if rate else ""
        return no_design(refused(LAW, plants, answer.status, f"{reason}{wanted}"), values)
    X = 0.5 * (answer.values["X"] + answer.values["X"].T)
    laws = _laws(plants, answer, X, scaling, values, (parameter, unit))
    inner = np.linalg.inv(X) / scaling.states[:, None] / scaling.states
    P = 0.5 * (inner + inner.T)
    crossed = any(i != j for i, j in pairs)
    every = tuple(range(len(plants)))
    claims: list[Claim] = [DecayClaim(every, every, rate, P[None], cross=crossed)]
    performance, level = _claims_of_level(claims, plants, laws, P, scaling, _posed(objective), answer)
    if np.isfinite(level):
        norm = "H2 norm" if objective == "h2" else "peak gain"
        notes.append(f"{norm} proved below {level:.4g} {'at the vertices' if crossed else 'for every blend'}")
    synthesis = proven(LAW, plants, laws, claims=claims, performance=performance, status=answer.status, notes=notes)
    return _design(synthesis, values, laws, (parameter, unit))


def _by_regulators(
    plants: Sequence[Plant], values: FloatArray, rate: float, label: tuple[str, str], notes: Sequence[str]
) -> ScheduledDesign | None:
    """The regulators of the vertices with their common proof; None where there is none."""
    first = plants[0]
    varies = any(not np.array_equal(plant.B2, first.B2) for plant in plants)
    shared = shared_regulators(plants, _pairs(len(plants), varies), rate)
    if shared is None:
        return None
    gains, P = shared
    laws = tuple(_law(first, gain, place, label) for gain, place in zip(gains, values, strict=True))
    every = tuple(range(len(plants)))
    closed = [closed_channel(plant, law) for plant, law in zip(plants, laws, strict=True)]
    poles = max(float(np.max(np.linalg.eigvals(loop[0]).real)) for loop in closed)
    synthesis = proven(
        LAW, plants, laws, claims=[DecayClaim(every, every, rate, P[None], cross=varies)],
        performance=[Performance("least decay rate at the vertices", np.nan, -poles, "1/s")],
        notes=(*notes, "the gains are those of the vertices' linear-quadratic regulators"),
    )  # fmt: skip
    return _design(synthesis, values, laws, label) if synthesis.controllers else None


def _design(
    synthesis: Synthesis, values: FloatArray, laws: tuple[Controller, ...], label: tuple[str, str]
) -> ScheduledDesign:
    parameter, unit = label
    if not synthesis.controllers:
        return no_design(synthesis, values)
    schedule = ScheduledController.from_nodes(parameter, unit, values[:, 0], laws) if values.shape[1] == 1 else None
    return ScheduledDesign(
        synthesis, schedule, "polytopic: any variation", float("inf"),
        np.full(len(values) - 1 if values.shape[1] == 1 else 0, np.inf), values,
    )  # fmt: skip


def _check(plants: Sequence[Plant], corners: FloatArray, objective: str, rate: float) -> None:
    if corners.ndim != 2 or len(corners) != len(plants) or len(plants) < 2:
        raise ValueError(
            f"corners: expected one row for each of {len(plants)} plants (at least two), got {len(corners)}"
        )
    if corners.shape[1] == 1 and np.any(np.diff(corners[:, 0]) <= 0.0):
        raise ValueError(f"corners: expected rising values, got {corners[:, 0].tolist()}")
    if corners.shape[1] > 1 and not is_box(corners):
        raise ValueError(f"corners: expected the 2^k corners of a box of {corners.shape[1]} parameters")
    if objective not in ("regulator", "h2", "h_infinity", "decay"):
        raise ValueError(f"objective: expected 'regulator', 'h2', 'h_infinity' or 'decay', got {objective!r}")
    if not (np.isfinite(rate) and rate >= 0.0):
        raise ValueError(f"rate: expected a decay rate of at least 0 1/s, got {rate!r}")
    first = plants[0]
    for plant in plants:
        if plant.dt is not None or not plant.measures_states:
            raise ValueError(f"plants: {plant.name!r}: expected a continuous plant that measures every state")
        for key in ("states", "disturbances", "commands", "performance"):
            if getattr(plant, key) != getattr(first, key):
                raise ValueError(f"plants: {plant.name!r} has other {key} than the first")
        if _posed(objective) == "h2" and np.any(plant.D11):
            raise ModelError(f"{plant.name!r} passes disturbances straight through (D11): its H2 norm is infinite")
        require_reachable(plant)


def _posed(objective: str) -> Posed:
    """What the inequality is posed for: regulators fall back on the least guaranteed cost."""
    return "h_infinity" if objective == "h_infinity" else "decay" if objective == "decay" else "h2"


def _unmoved_halfway(plants: Sequence[Plant]) -> str:
    """The mean of the vertices is one of the blends: a mode no command moves there cannot be held by any law."""
    A, B = (np.mean([getattr(p, key) for p in plants], axis=0) for key in ("A", "B2"))
    hidden = hidden_modes(A.T, B.T, plants[0].states)
    return f"in the mean of the vertices the commands cannot move {hidden[0].label}: no law holds it" if hidden else ""


def _pairs(count: int, varies: bool) -> list[tuple[int, int]]:
    """Products of plant and law that occur in the blends: all pairs where the input side varies."""
    return list(combinations_with_replacement(range(count), 2)) if varies else [(i, i) for i in range(count)]


def _solve(
    vertices: Sequence[ScaledVertex], objective: Posed, rate: float, clock: Clock
) -> tuple[Answer, list[tuple[int, int]]]:
    """The inequality over vertices, and over pairs where the input side varies; its answer and those pairs."""
    import cvxpy as cp

    first = vertices[0]
    n, m = first.B.shape
    X, level = cp.Variable((n, n), symmetric=True), cp.Variable(nonneg=True)
    Y = [cp.Variable((m, n)) for _ in vertices]
    channel = {"h2": [v.h2 for v in vertices], "h_infinity": [v.h_infinity[:3] for v in vertices]}
    parts = channel["h_infinity" if objective == "h_infinity" else "h2"]
    varies = any(
        not (np.array_equal(v.B, first.B) and np.array_equal(part[2], parts[0][2]))
        for v, part in zip(vertices, parts, strict=True)
    )
    count = len(vertices)
    pairs = _pairs(count, varies)
    constraints: list[Any] = [X >> STRICT * np.eye(n)]
    for i, j in pairs:
        moved = 0.5 * sum(vertices[a].A @ X + vertices[a].B @ Y[b] for a, b in ((i, j), (j, i)))
        seen = 0.5 * sum(parts[a][1] @ X + parts[a][2] @ Y[b] for a, b in ((i, j), (j, i)))
        constraints.append(moved + moved.T + 2.0 * rate * X << -STRICT * np.eye(n))
        if objective == "h2":
            block = cp.bmat([[moved + moved.T, seen.T], [seen, -np.eye(len(parts[0][1]))]])
            constraints.append(block << -STRICT * np.eye(block.shape[0]))
        elif objective == "h_infinity":
            B_w = 0.5 * (parts[i][0] + parts[j][0])
            through = 0.5 * (vertices[i].h_infinity[3] + vertices[j].h_infinity[3])
            n_w, n_z = B_w.shape[1], through.shape[0]
            block = cp.bmat([
                [moved + moved.T, B_w, seen.T],
                [B_w.T, -level * np.eye(n_w), through.T],
                [seen, through, -level * np.eye(n_z)],
            ])  # fmt: skip
            constraints.append(block << -STRICT * np.eye(n + n_w + n_z))
    if objective == "h2":
        for B_w, _, _ in parts:
            Z = cp.Variable((B_w.shape[1], B_w.shape[1]), symmetric=True)
            constraints += [cp.bmat([[Z, B_w.T], [B_w, X]]) >> 0.0, cp.trace(Z) <= level]
    elif objective == "decay":  # small gains and a well-scaled X among the many answers
        constraints += [X << level * np.eye(n), X >> np.eye(n)]
        constraints += [cp.norm(one, "fro") <= level for one in Y]
    variables = {"X": X, "level": level, **{f"Y{i}": one for i, one in enumerate(Y)}}
    return solve_problem(cp.Problem(cp.Minimize(level), constraints), variables, clock=clock), pairs


def _laws(
    plants: Sequence[Plant], answer: Answer, X: FloatArray, scaling: Scaling, corners: FloatArray,
    label: tuple[str, str],
) -> tuple[Controller, ...]:  # fmt: skip
    laws = []
    for i, values in enumerate(corners):
        K = np.linalg.solve(X, answer.values[f"Y{i}"].T).T
        laws.append(_law(plants[0], scaling.commands[:, None] * K / scaling.states, values, label))
    return tuple(laws)


def _law(plant: Plant, gain: FloatArray, values: FloatArray, label: tuple[str, str]) -> Controller:
    name = f"{label[0]} {', '.join(f'{x:g}' for x in values)} {label[1]}".strip()
    return Controller.static(gain, measured=plant.measured, commands=plant.commands, name=name)


def _claims_of_level(
    claims: list[Claim], plants: Sequence[Plant], laws: Sequence[Controller], P: FloatArray, scaling: Scaling,
    objective: Posed, answer: Answer,
) -> tuple[list[Performance], float]:  # fmt: skip
    """Add the claim of the guaranteed level; what it is worth is told beside the worst vertex."""
    every = tuple(range(len(plants)))
    closed = [closed_channel(plant, law) for plant, law in zip(plants, laws, strict=True)]
    if objective == "h2":
        scaled_P = P * scaling.h2**2 / scaling.rate
        level = float(np.sqrt(max(np.trace(B.T @ scaled_P @ B) for _, B, _, _ in closed))) * (1.0 + IN_HAND)
        claims.append(EnergyClaim(every, every, level, scaled_P[None]))
        worst = max(h2_norm(*loop).value for loop in closed)
        return [Performance("H2 norm at the worst vertex", np.nan, worst)], level
    if objective == "h_infinity":
        gamma = float(answer.values["level"]) * scaling.h_infinity * (1.0 + IN_HAND)
        claims.append(GainClaim(every, every, gamma, scaling.h_infinity * P[None]))
        worst = max(h_infinity_norm(*loop).value for loop in closed)
        return [Performance("peak gain at the worst vertex", np.nan, worst)], gamma
    poles = max(float(np.max(np.linalg.eigvals(loop[0]).real)) for loop in closed)
    return [Performance("least decay rate at the vertices", np.nan, -poles, "1/s")], np.nan
