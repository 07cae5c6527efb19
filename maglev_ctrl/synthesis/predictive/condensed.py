"""The predictive problem in its commands alone, and its solution on their box by active sets.

With the cost-to-go P of the regulator as terminal cost, every plan U costs

    x0'P x0 + sum of v_k'S v_k,   v_k = u_k + K x_k,   S = R + B'P B,

and v = M U + W x0 with M unit lower block triangular. So H = M'S M (2 U'.. halves as below), and H^-1 = M^-1 S^-1 M^-T
where M^-1 is the response of the *stable* closed loop: both are accurate, however unstable the plant. The unconstrained
plan is that of the regulator itself. With limits W active at their values b the multipliers solve the small system
(H^-1)_WW y = (U_free - b)_W, and U = U_free - (H^-1)_W y; the active set is changed until all signs are right (primal-
dual active set, Hintermueller, Ito & Kunisch, SIAM J. Optim. 13 (2002) 865). Where that cycles, projected Newton
steps (Bertsekas, SIAM J. Control Optim. 20 (1982) 221), which cannot, bring it to a better start.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dposv

from maglev_ctrl.arrays import FloatArray, read_only
from maglev_ctrl.synthesis.predictive.kkt import box_residual
from maglev_ctrl.synthesis.predictive.problem import PredictiveProblem

Signs = NDArray[np.int8]
Backend = Literal["numpy", "fast"]
SWEEPS = 8
NEWTON, ROUNDS = 3, 60


@dataclass(frozen=True, eq=False, slots=True)
class CondensedProblem:
    """U'H U / 2 + x0'F'U in units of `scale` per command (N nu), and the maps that solve it without limits.

    `H`, `F` are made of predictions (the check uses them), `inverse` and `free` (U_free = free x0) of the regulator's
    factors (the solver uses them); `states` (N n, n) and `response` (N n, N nu) predict x_1 .. x_N, commands in
    physical units.
    """

    H: FloatArray
    F: FloatArray
    inverse: FloatArray
    free: FloatArray
    scale: FloatArray
    states: FloatArray
    response: FloatArray

    def gradient(self, x0: FloatArray, scaled: FloatArray) -> FloatArray:
        """Gradient at a scaled plan."""
        return self.H @ scaled + self.F @ x0


@dataclass(frozen=True, eq=False, slots=True)
class BoxSolution:
    """Scaled plan (N nu,), active limits (-1 lower, 1 upper), sweeps taken, and the residual by independent code."""

    plan: FloatArray
    active: Signs
    iterations: int
    residual: float


def condense(problem: PredictiveProblem, P: FloatArray, K: FloatArray) -> CondensedProblem:
    """The problem in its commands.

    Parameters
    ----------
    P, K : solution and gain (u = -K x) of the discrete Riccati equation of the same weights

    Examples
    --------
    >>> from maglev_ctrl.synthesis.predictive.problem import predictive_problem
    >>> from maglev_ctrl.synthesis.riccati_discrete import riccati_discrete
    >>> from maglev_ctrl.systems.plant import Plant
    >>> plant = Plant.from_matrices([[1.2]], [[1.0]], [[1.0]], [[1.0]], dt=0.1)
    >>> problem = predictive_problem(plant, horizon=3, Q=[[1.0]], R=[[1.0]], command_limits=([-1.0], [1.0]))
    >>> solved = riccati_discrete(plant.A, plant.B2, problem.Q, problem.R)
    >>> condensed = condense(problem, solved.P, solved.gain)
    >>> bool(np.allclose(condensed.H @ condensed.inverse, np.eye(3)))
    True
    """
    A, B, count = problem.plant.A, problem.plant.B2, problem.horizon
    n, n_u = B.shape
    states, response = predictions(A, B, count)
    scale = np.tile(command_scale(problem), count)
    # by predictions: sum of x_k'Q x_k, k = 1 .. N-1, x_N'P x_N, u_k'R u_k, 2 x_k'N u_k
    weighted, weighted_states = np.empty_like(response), np.empty_like(states)
    for k in range(count):
        rows = slice(k * n, (k + 1) * n)
        weight = P if k == count - 1 else problem.Q
        weighted[rows], weighted_states[rows] = weight @ response[rows], weight @ states[rows]
    H = response.T @ weighted + np.kron(np.eye(count), problem.R)
    F = response.T @ weighted_states
    for k in range(count):
        columns, before = slice(k * n_u, (k + 1) * n_u), slice((k - 1) * n, k * n)
        if k == 0:
            F[columns] += problem.N.T
            continue
        cross = problem.N.T @ response[before]
        H[columns] += cross
        H[:, columns] += cross.T
        F[columns] += problem.N.T @ states[before]
    # by the regulator: U = M^-1 v, response of the closed loop to v
    S = problem.R + B.T @ P @ B
    closed = A - B @ K
    loop_states, loop_response = predictions(closed, B, count)
    back = np.eye(count * n_u)
    free = np.empty((count * n_u, n))
    free[:n_u] = -K
    for k in range(1, count):
        columns, before = slice(k * n_u, (k + 1) * n_u), slice((k - 1) * n, k * n)
        back[columns] -= K @ loop_response[before]
        free[columns] = -K @ loop_states[before]
    inverse = back @ np.kron(np.eye(count), np.linalg.inv(0.5 * (S + S.T))) @ back.T
    H, inverse = H * np.outer(scale, scale), inverse / np.outer(scale, scale)
    return CondensedProblem(
        H=read_only(0.5 * (H + H.T), name="H"), F=read_only(F * scale[:, None], name="F"),
        inverse=read_only(0.5 * (inverse + inverse.T), name="inverse"),
        free=read_only(free / scale[:, None], name="free"), scale=read_only(scale, name="scale"),
        states=read_only(states, name="states"), response=read_only(response, name="response"),
    )  # fmt: skip


def predictions(A: FloatArray, B: FloatArray, count: int) -> tuple[FloatArray, FloatArray]:
    """States x_1 .. x_N by the first state (N n, n) and by the commands u_0 .. u_(N-1) (N n, N nu).

    Examples
    --------
    >>> predictions(np.array([[2.0]]), np.array([[1.0]]), 2)[1].tolist()
    [[1.0, 0.0], [2.0, 1.0]]
    """
    n, n_u = B.shape
    states, response = np.empty((count * n, n)), np.zeros((count * n, count * n_u))
    power, column = np.eye(n), np.empty((count * n, n_u))
    for k in range(count):
        column[k * n : (k + 1) * n] = power @ B
        power = A @ power
        states[k * n : (k + 1) * n] = power
    for k in range(count):
        response[k * n :, k * n_u : (k + 1) * n_u] = column[: (count - k) * n]
    return states, response


def command_scale(problem: PredictiveProblem) -> FloatArray:
    """A size for each command (nu,): half the width of its box, or what its weight says where it has none."""
    width = 0.5 * (problem.command_upper - problem.command_lower)
    return np.where(np.isfinite(width), width, 1.0 / np.sqrt(np.diag(problem.R)))


def solve_box(
    condensed: CondensedProblem,
    x0: FloatArray,
    lower: FloatArray,
    upper: FloatArray,
    *,
    active: Signs | None = None,
    backend: Backend = "numpy",
) -> BoxSolution:
    """Least U'H U / 2 + x0'F'U with lower <= U <= upper (all scaled), from a guess of the active limits.

    Parameters
    ----------
    x0 : (n,) state
    lower, upper : (N nu,) scaled limits
    active : guess (N nu,): -1 at the lower, 1 at the upper limit, 0 free
    backend : "numpy", or "fast" (numba; the extra `fast`)

    Raises
    ------
    ValueError : the backend is unknown
    ModelError : numba is asked for and not installed

    Examples
    --------
    >>> one = np.eye(1)
    >>> condensed = CondensedProblem(one, one, one, -one, np.ones(1), one, one)
    >>> found = solve_box(condensed, np.array([3.0]), -np.ones(1), np.ones(1))
    >>> found.plan.tolist(), found.active.tolist(), found.residual
    ([-1.0], [-1], 0.0)
    """
    plan, signs, iterations, settled = _settle(condensed, x0, (lower, upper), active, backend)
    rounds = 0
    while not settled and rounds < ROUNDS:
        rounds += 1
        start = np.minimum(np.maximum(np.nan_to_num(plan), lower), upper)
        plan, steps, done = _newton(condensed, x0, (lower, upper), start, backend)
        signs = (plan >= upper).astype(np.int8) - (plan <= lower).astype(np.int8)
        iterations += steps
        if done:
            break
        tried, guess, sweeps, settled = _settle(condensed, x0, (lower, upper), signs, backend)
        iterations += sweeps
        if settled:
            plan, signs = tried, guess
    residual = box_residual(condensed.H, condensed.gradient(x0, plan), lower, upper, plan)
    return BoxSolution(plan, signs, iterations, residual)


def shifted(active: Signs, commands: int) -> Signs:
    """The active limits one sample on, the last one repeated.

    Examples
    --------
    >>> shifted(np.array([1, 0, -1], dtype=np.int8), 1).tolist()
    [0, -1, -1]
    """
    return np.concatenate([active[commands:], active[-commands:]])


def _settle(
    condensed: CondensedProblem,
    x0: FloatArray,
    bounds: tuple[FloatArray, FloatArray],
    active: Signs | None,
    backend: Backend,
) -> tuple[FloatArray, Signs, int, bool]:
    """Active-set sweeps by the chosen backend."""
    if backend == "numpy":
        return _active_sets(condensed, x0, *bounds, active)
    from maglev_ctrl.synthesis.predictive.box_compiled import require_numba, sweeps

    if backend != "fast":
        raise ValueError(f"backend: expected 'numpy' or 'fast', got {backend!r}")
    require_numba()
    guess = np.zeros(bounds[0].size, dtype=np.int8) if active is None else active
    matrices = (condensed.H, condensed.inverse, condensed.free, condensed.F)
    return sweeps(matrices, x0, *bounds, guess, SWEEPS)


def _newton(
    condensed: CondensedProblem,
    x0: FloatArray,
    bounds: tuple[FloatArray, FloatArray],
    start: FloatArray,
    backend: Backend,
) -> tuple[FloatArray, int, bool]:
    """Projected Newton steps by the chosen backend."""
    if backend == "numpy":
        return _projected_newton(condensed, x0, *bounds, start)
    from maglev_ctrl.synthesis.predictive.box_compiled import newton_steps

    return newton_steps(condensed.H, condensed.F @ x0, *bounds, start, NEWTON)


def _active_sets(
    condensed: CondensedProblem, x0: FloatArray, lower: FloatArray, upper: FloatArray, active: Signs | None
) -> tuple[FloatArray, Signs, int, bool]:
    """Plan, active limits, sweeps and whether the sets settled; the smaller of the two linear systems is solved."""
    H, inverse = condensed.H, condensed.inverse
    free = condensed.free @ x0
    signs = np.zeros(free.size, dtype=np.int8) if active is None else active
    plan, push, slope, fewest = free, free[:0], None, free.size + 1
    for sweep in range(1, SWEEPS + 1):
        at = signs.nonzero()[0]
        if at.size:
            held = signs[at]
            bound = np.where(held > 0, upper[at], lower[at])
            if 2 * at.size <= free.size:
                rows = inverse[at]
                _, push, info = dposv(rows[:, at], free[at] - bound)
                plan = free - push @ rows
            else:
                slope = condensed.F @ x0 if slope is None else slope
                loose = (signs == 0).nonzero()[0]
                plan = np.zeros(free.size)
                plan[at] = bound
                rest = H @ plan
                rest += slope
                rows = H[loose]
                info = 0
                if loose.size:
                    _, step, info = dposv(rows[:, loose], rest[loose])
                    plan[loose] = -step
                    rest -= step @ rows
                push = -rest[at]
            if info != 0:
                return free, signs, sweep, False
            plan[at] = bound
        else:
            plan = free
        changed = (plan > upper).astype(np.int8)
        changed -= plan < lower
        if at.size:
            changed[at] = np.where(push * held >= 0.0, held, 0)
        changes = int(np.count_nonzero(changed != signs))
        if not changes:
            return plan, signs, sweep, True
        signs = changed
        if changes >= fewest:
            return plan, signs, sweep, False
        fewest = changes
    return plan, signs, SWEEPS, False


def _projected_newton(
    condensed: CondensedProblem, x0: FloatArray, lower: FloatArray, upper: FloatArray, start: FloatArray
) -> tuple[FloatArray, int, bool]:
    """A few Newton steps on the free entries along the projection arc, downhill only; whether none is left to take."""
    H, slope, plan = condensed.H, condensed.F @ x0, start
    gradient, diagonal = H @ plan + slope, H.diagonal()
    value = 0.5 * float(plan @ (gradient + slope))
    for sweep in range(1, NEWTON + 1):
        residual = plan - np.minimum(np.maximum(plan - gradient / diagonal, lower), upper)
        near = min(float(np.linalg.norm(residual)), 1e-3)
        if float(np.max(np.abs(residual))) <= 1e-13 * max(1.0, float(np.max(np.abs(plan)))):
            return plan, sweep, True
        held = ((plan <= lower + near) & (gradient > 0.0)) | ((plan >= upper - near) & (gradient < 0.0))
        loose = (~held).nonzero()[0]
        direction = -gradient / diagonal
        if loose.size:
            _, step, info = dposv(H[loose][:, loose], gradient[loose])
            if info != 0:
                return plan, sweep, True
            direction[loose] = -step
        length = 1.0
        while length > 1e-12:
            trial = np.minimum(np.maximum(plan + length * direction, lower), upper)
            ahead = H @ trial + slope
            reached = 0.5 * float(trial @ (ahead + slope))
            expected = -length * float(gradient[loose] @ direction[loose]) if loose.size else 0.0
            expected += float(gradient[held] @ (plan - trial)[held])
            if reached <= value - 1e-4 * expected + 1e-14 * abs(value):
                break
            length *= 0.5
        else:
            return plan, sweep, True
        plan, value, gradient = trial, reached, ahead
    return plan, NEWTON, False
