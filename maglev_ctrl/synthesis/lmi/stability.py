"""Analysis: is a polytope of matrices stable, however fast its parameters vary, or where they are constant?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import solve_continuous_lyapunov

from maglev_ctrl.analysis.loops import state_scales
from maglev_ctrl.arrays import FloatArray, read_only
from maglev_ctrl.errors import Status
from maglev_ctrl.proofs.claims import DecayClaim, ParameterClaim, Proof
from maglev_ctrl.proofs.prove import prove
from maglev_ctrl.synthesis.lmi.dual import Refutation, refute_quadratic_stability
from maglev_ctrl.synthesis.lmi.session import Answer, Clock, Solver, solve_problem
from maglev_ctrl.systems import Controller
from maglev_ctrl.systems.plant import Plant, closed_channel

STEPS = 30
CONDITION = 1e8
"""Condition number allowed to a scaled Lyapunov matrix."""
TIMES = (4.0, 32.0, 1.0, 256.0, 0.125)
"""Units of time tried for the slack equation, in time constants of the fastest loop; powers of two."""
LEAST_MARGIN = 1e-8
"""Margin (slack of size one) above which a parameter-dependent certificate is worth proving."""
WIDTH = 1e-6
"""Relative width to which the largest rate is found."""


@dataclass(frozen=True, eq=False, slots=True)
class PolytopeStability:
    """What could be proved of a polytope of matrices.

    `stable` True where a certificate holds, False where its absence is proved (or a vertex is unstable), None where
    neither could be shown. `rate` (1/s) the largest decay rate proved, common to all blends; NaN where none.
    """

    kind: Literal["quadratic", "parameter-dependent"]
    stable: bool | None
    rate: float
    claim: DecayClaim | ParameterClaim | None
    proof: Proof | None
    refutation: Refutation | None
    status: Status
    message: str


def quadratic_stability(
    matrices: Sequence[ArrayLike], *, time_limit: float = 60.0, solver: Solver = "CLARABEL"
) -> PolytopeStability:
    """Whether one quadratic Lyapunov function serves all blends of the matrices, however fast they vary.

    Parameters
    ----------
    matrices : vertices A_i (n, n) of x' = A x; closed loops of plants and a law by `closed_loops`
    time_limit : s

    Raises
    ------
    ValueError : no matrix, or not square ones of one size

    Examples
    --------
    >>> quadratic_stability([[[-1.0, -1.0], [1.0, -1.0]], [[-1.0, -5.0], [0.2, -1.0]]]).stable
    True
    """
    loops = _checked(matrices)
    clock = Clock(time_limit)
    unstable = _unstable_vertex(loops)
    if unstable is not None:
        return _result("quadratic", False, Status.INFEASIBLE, unstable)
    found, status = _largest_rate(loops, clock, solver)
    if found is not None:
        rate, P = found
        for share in (1.0 - 1e-6, 1.0 - 1e-4, 0.9, 0.0):
            indices = tuple(range(len(loops)))
            claim = DecayClaim(indices, (0,) * len(loops), share * rate, P[None])
            proof = _prove(claim, loops)
            if proof.holds:
                return PolytopeStability(
                    "quadratic", True, share * rate, claim, proof, None, Status.SOLVED, proof.statement
                )  # fmt: skip
    if status is Status.TIME_LIMIT:
        return _result("quadratic", None, status, status.value)
    refutation = refute_quadratic_stability(loops, clock=clock, solver=solver)
    if refutation is not None:
        message = "no quadratic Lyapunov function is common to all vertices"
        return _result("quadratic", False, Status.INFEASIBLE, message, refutation)
    late = clock.left <= 0.0
    return _result("quadratic", None, Status.TIME_LIMIT if late else Status.NOT_VERIFIED, "neither side was proved")


def parameter_dependent_stability(
    matrices: Sequence[ArrayLike],
    *,
    rate: float = 0.0,
    time_limit: float = 60.0,
    solver: Solver = "CLARABEL",
) -> PolytopeStability:
    """Whether every constant blend of the matrices decays at `rate` (1/s) or faster, by P = sum of weights x P_i.

    Sufficient only: `stable` None means that this certificate was not found.

    Raises
    ------
    ValueError : no matrix, or not square ones of one size

    Examples
    --------
    >>> slow = parameter_dependent_stability([[[-1.0, -1.0], [1.0, -1.0]], [[-1.0, -8.0], [0.125, -1.0]]])
    >>> slow.stable  # constant blends only: with parameters that vary fast, no common function exists
    True
    """
    loops = _checked(matrices)
    clock = Clock(time_limit)
    shifted = [A + rate * np.eye(A.shape[0]) for A in loops]
    unstable = _unstable_vertex(shifted)
    if unstable is not None:
        return _result("parameter-dependent", False, Status.INFEASIBLE, unstable)
    claim, status = parameter_certificate(loops, rate, clock=clock, solver=solver)
    proof = None if claim is None else _prove(claim, loops)
    if claim is not None and proof is not None and proof.holds:
        return PolytopeStability(
            "parameter-dependent", True, rate, claim, proof, None, Status.SOLVED, proof.statement
        )  # fmt: skip
    reason = "no such certificate was found; another kind may exist"
    return _result("parameter-dependent", None, status if claim is None else Status.NOT_VERIFIED, reason)


def closed_loops(plants: Sequence[Plant], controller: Controller) -> tuple[FloatArray, ...]:
    """State matrices of the plants with one controller.

    Examples
    --------
    >>> plant = Plant.from_matrices([[1.0]], [[1.0]], [[1.0]], [[1.0]])
    >>> closed_loops([plant], Controller.static([[-3.0]], measured=("x1",), commands=("u1",)))
    (array([[-2.]]),)
    """
    return tuple(closed_channel(plant, controller)[0] for plant in plants)


def parameter_certificate(
    loops: Sequence[FloatArray], rate: float, *, clock: Clock, solver: Solver = "CLARABEL"
) -> tuple[ParameterClaim | None, Status]:
    """P_i and the slack matrix V of Apkarian, Tuan & Bernussou (2001), balanced; to be proved by the caller.

    Examples
    --------
    >>> claim, status = parameter_certificate([-np.eye(2), -2.0 * np.eye(2)], 0.5, clock=Clock(60.0))
    >>> claim.P.shape
    (2, 2, 2)
    """
    if clock.left <= 0.0:
        return None, Status.TIME_LIMIT
    import cvxpy as cp

    n, k = loops[0].shape[0], len(loops)
    scale = _scales(loops)
    eye = np.eye(n)
    balanced = [A * scale / scale[:, None] + rate * eye for A in loops]
    fastest = float(np.exp2(np.round(np.log2(max(float(np.linalg.norm(A, 2)) for A in balanced)))))
    V, margin = cp.Variable((n, n)), cp.Variable()
    P = [cp.Variable((n, n), symmetric=True) for _ in range(k)]
    scaled = [cp.Parameter((n, n)) for _ in range(k)]
    constraints: list[Any] = [V + V.T << eye]  # sets the size
    for A, P_i in zip(scaled, P, strict=True):
        side = V.T @ A + P_i
        block = cp.bmat([[-(V + V.T), side, V.T], [side.T, -P_i, np.zeros((n, n))], [V, np.zeros((n, n)), -P_i]])
        constraints.append(0.5 * (block + block.T) << -margin * np.eye(3 * n))
    problem = cp.Problem(cp.Maximize(margin), constraints)
    variables = {"V": V, "margin": margin} | {f"P{i}": one for i, one in enumerate(P)}
    answer = Answer(Status.INFEASIBLE, {})
    for units in TIMES:
        time = units / fastest
        for parameter, A in zip(scaled, balanced, strict=True):
            parameter.value = time * A
        answer = solve_problem(problem, variables, clock=clock, solver=solver, fresh=units == TIMES[0])
        if answer.usable and float(answer.values["margin"]) > LEAST_MARGIN:
            back = np.outer(1.0 / scale, 1.0 / scale)
            stack = read_only([_symmetric(answer.values[f"P{i}"]) * back for i in range(k)], name="P")
            slack = read_only(answer.values["V"] * back, name="V")
            return ParameterClaim(tuple(range(k)), (0,) * k, rate, stack, slack, time), answer.status
        if answer.status is Status.TIME_LIMIT:
            break
    return None, Status.INFEASIBLE if answer.usable else answer.status


def _largest_rate(
    loops: Sequence[FloatArray], clock: Clock, solver: Solver
) -> tuple[tuple[float, FloatArray] | None, Status]:
    """Largest r with A'P + P A + 2 r P <= 0 for one P, by bisection; every step a feasibility problem with a margin."""
    if clock.left <= 0.0:
        return None, Status.TIME_LIMIT
    if len(loops) == 1:
        return _one_loop(loops[0]), Status.SOLVED
    import cvxpy as cp

    n = loops[0].shape[0]
    scale = _scales(loops)
    balanced = [A * scale / scale[:, None] for A in loops]
    unit = max(float(np.linalg.norm(A, 2)) for A in balanced)
    P = cp.Variable((n, n), symmetric=True)
    margin, twice_rate = cp.Variable(), cp.Parameter()
    eye = np.eye(n)
    constraints = [P >> eye / CONDITION, P << eye]
    for A in balanced:
        S = P @ (A / unit)
        constraints.append(S + S.T + twice_rate * P << -margin * eye)
    problem = cp.Problem(cp.Maximize(margin), constraints)
    slowest = min(-float(np.max(np.linalg.eigvals(A).real)) for A in balanced) / unit
    low, high = 0.0, slowest

    def at(rate: float) -> Answer:
        twice_rate.value = 2.0 * rate
        return solve_problem(problem, {"P": P, "margin": margin}, clock=clock, solver=solver)

    best: FloatArray | None = None
    rate = low
    for _ in range(STEPS):
        answer = at(rate)
        if answer.status is Status.TIME_LIMIT:
            return (None if best is None else (low * unit, _back(best, scale))), Status.TIME_LIMIT
        inside = answer.usable and _holds(balanced, unit, rate, answer.values["P"])
        if inside:
            low, best = rate, answer.values["P"]
        elif best is None:
            return None, Status.INFEASIBLE if answer.usable else answer.status
        else:
            high = rate
        if high - low <= WIDTH * high:
            break
        rate = 0.5 * (low + high)
    return (None if best is None else (low * unit, _back(best, scale))), Status.SOLVED


def _holds(loops: Sequence[FloatArray], unit: float, rate: float, P: FloatArray) -> bool:
    sums = [P @ A / unit + A.T @ P / unit + 2.0 * rate * P for A in loops]
    positive = float(np.linalg.eigvalsh(P)[0]) > 0.0
    return positive and all(float(np.linalg.eigvalsh(_symmetric(S))[-1]) < 0.0 for S in sums)


def _one_loop(A: FloatArray) -> tuple[float, FloatArray]:
    """A single loop needs no search: any rate short of its slowest pole has a Lyapunov matrix."""
    n = A.shape[0]
    rate = -float(np.max(np.linalg.eigvals(A).real)) * (1.0 - 1e-6)
    scale = state_scales(A, np.eye(n), np.eye(n))
    balanced = A * scale / scale[:, None] + rate * np.eye(n)
    P = np.asarray(solve_continuous_lyapunov(balanced.T, -np.eye(n)), dtype=np.float64)
    return rate, _back(P, scale)


def _back(P: FloatArray, scale: FloatArray) -> FloatArray:
    return read_only(_symmetric(P) / np.outer(scale, scale), name="P")


def _symmetric(P: FloatArray) -> FloatArray:
    return np.asarray(0.5 * (P + P.T), dtype=np.float64)


def _scales(loops: Sequence[FloatArray]) -> FloatArray:
    n = loops[0].shape[0]
    mean = np.mean(np.abs(loops), axis=0)
    return state_scales(mean, np.eye(n), np.eye(n))


def _prove(claim: DecayClaim | ParameterClaim, loops: Sequence[FloatArray]) -> Proof:
    """The claim about matrices as one about plants under a law that does nothing."""
    n = loops[0].shape[0]
    plants = [Plant.from_matrices(A, np.zeros((n, 1)), np.zeros((n, 1)), np.zeros((1, n))) for A in loops]
    idle = Controller.static(np.zeros((1, n)), measured=plants[0].measured, commands=plants[0].commands)
    return prove(claim, plants, [idle])


def _unstable_vertex(loops: Sequence[FloatArray]) -> str | None:
    for i, A in enumerate(loops):
        worst = float(np.max(np.linalg.eigvals(A).real))
        if worst >= 0.0:
            return f"vertex {i + 1} itself does not decay so fast: a pole lies {worst:.3g} 1/s beyond"
    return None


def _checked(matrices: Sequence[ArrayLike]) -> list[FloatArray]:
    loops = [read_only(A, name="matrices", shape=(None, None)) for A in matrices]
    if not loops:
        raise ValueError("matrices: expected at least one vertex, got none")
    if any(A.shape != (loops[0].shape[0],) * 2 for A in loops):
        raise ValueError(f"matrices: expected square matrices of one size, got {[A.shape for A in loops]}")
    return loops


def _result(
    kind: Literal["quadratic", "parameter-dependent"], stable: bool | None, status: Status, message: str,
    refutation: Refutation | None = None,
) -> PolytopeStability:  # fmt: skip
    return PolytopeStability(kind, stable, np.nan, None, None, refutation, status, message)
