"""The predictive problem as one sparse program for OSQP: every limit, set up once, only vectors change per sample.

Half the cost is minimised. Unknowns, each in a unit of its own: states x_1 .. x_N, commands u_0 .. u_(N-1), and the
amounts s by which soft limits are broken, all measured from the steady target. Rows: the plant, command limits, output
limits, rates, terminal set.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from maglev_ctrl.arrays import FloatArray, read_only, read_only_any
from maglev_ctrl.errors import Status
from maglev_ctrl.synthesis.predictive.condensed import command_scale
from maglev_ctrl.synthesis.predictive.kkt import KktResidual, proves_infeasible
from maglev_ctrl.synthesis.predictive.problem import PredictiveProblem
from maglev_ctrl.synthesis.predictive.quadratic import LOOSE, QuadraticData, farkas_vector
from maglev_ctrl.synthesis.predictive.solvers import OSQP_SETTINGS, clarabel_candidate, sparse
from maglev_ctrl.synthesis.predictive.terminal import TerminalSet

ACCEPTED = 1e-6
"""Largest KKT residual of a move that is applied."""


@dataclass(frozen=True, eq=False, slots=True)
class Now:
    """What the sample brings: deviation x0 of the state (n,) from the target, the target's command and outputs, the
    command applied last (nu,), and the share of the terminal set that is inside the limits around the target."""

    x0: FloatArray
    command: FloatArray
    outputs: FloatArray
    last: FloatArray
    share: float = 1.0


@dataclass(frozen=True, eq=False, slots=True)
class SparseProgram:
    """Data of the program: constant P, q, A, and bounds l + by_x0 x0 and so on; `names` of the rows, for people.

    `units` of the unknowns; bounds of the rows at the origin `lower`, `upper`, which move by `by_state` x0,
    `by_command` u_s, `by_output` y_s and `by_last` u_-1; the rows `terminal` are scaled by the share. A terminal set
    whose share is not positive is left out.
    """

    P: Any
    q: FloatArray
    A: Any
    lower: FloatArray
    upper: FloatArray
    by_state: Any
    by_command: Any
    by_output: Any
    by_last: Any
    terminal: slice
    units: FloatArray
    names: tuple[str, ...]
    sizes: tuple[int, int, int]

    def bounds(self, now: Now) -> tuple[FloatArray, FloatArray]:
        """Bounds of the rows at this sample."""
        moved = self.by_state @ now.x0 + self.by_command @ now.command
        moved += self.by_output @ now.outputs + self.by_last @ now.last
        lower, upper = self.lower + moved, self.upper + moved
        upper[self.terminal] = now.share if now.share > 0.0 else np.inf
        return lower, upper

    def unknowns(self, states: FloatArray, moves: FloatArray) -> FloatArray:
        """The vector of unknowns of states (N n,) and moves (N nu,) in physical units, nothing broken."""
        count = self.units.size
        point = np.zeros(count)
        point[: states.size] = states
        point[states.size : states.size + moves.size] = moves
        return point / self.units

    def admits(self, point: FloatArray, now: Now, *, tolerance: float = 1e-9) -> bool:
        """Whether every row holds."""
        lower, upper = self.bounds(now)
        product = self.A @ point
        return bool(np.all(product >= lower - tolerance) and np.all(product <= upper + tolerance))


@dataclass(frozen=True, eq=False, slots=True)
class PlanSolution:
    """Moves (N, nu) and states (N, n) from the target, broken amounts (soft limits x samples), and the evidence."""

    moves: FloatArray
    states: FloatArray
    broken: FloatArray
    multipliers: FloatArray
    residual: KktResidual
    status: Status
    message: str
    solver: str
    iterations: int


def sparse_program(
    problem: PredictiveProblem, P: FloatArray, K: FloatArray, terminal: TerminalSet | None
) -> SparseProgram:
    """The problem as one sparse program.

    Parameters
    ----------
    P, K : terminal cost and the regulator's gain (u = -K x after the horizon)
    terminal : set for the last state; None for its cost alone

    Examples
    --------
    >>> from maglev_ctrl.synthesis.predictive.problem import predictive_problem
    >>> from maglev_ctrl.systems.plant import Plant
    >>> plant = Plant.from_matrices([[1.0]], [[1.0]], [[1.0]], [[1.0]], dt=0.1)
    >>> problem = predictive_problem(plant, horizon=5, Q=[[1.0]], R=[[1.0]], command_limits=([-1.0], [2.0]))
    >>> sparse_program(problem, np.eye(1), np.eye(1), None).A.shape
    (10, 10)
    """
    A, B, N = problem.plant.A, problem.plant.B2, problem.horizon
    (n, n_u), soft = B.shape, [i for i, limit in enumerate(problem.output_limits) if limit.soft]
    cost, x_unit, u_unit = _units(problem, P)
    widths = np.array([min(limit.upper, -limit.lower) for limit in problem.output_limits])
    s_unit = np.tile(widths[soft], N)
    units = np.concatenate([np.tile(x_unit, N), np.tile(u_unit, N), s_unit])
    n_x, n_m, n_s = N * n, N * n_u, s_unit.size
    quadratic = np.array([problem.output_limits[i].quadratic for i in soft])
    linear = np.array([problem.output_limits[i].linear for i in soft])
    # states one sample later than commands: x_k'N u_k pairs block k - 1 of the states with block k of the commands
    cross = sparse.kron(sparse.eye_array(N, k=-1).T, sparse.csc_matrix(problem.N))
    state_cost = sparse.block_diag([*([sparse.csc_matrix(problem.Q)] * (N - 1)), sparse.csc_matrix(P)])
    command_cost = sparse.kron(sparse.eye_array(N), sparse.csc_matrix(problem.R))
    weight = sparse.block_diag([
        sparse.vstack([sparse.hstack([state_cost, cross]), sparse.hstack([cross.T, command_cost])]),
        sparse.coo_matrix((n_s, n_s)) if not n_s else sparse.kron(sparse.eye_array(N), np.diag(quadratic)),
    ])  # fmt: skip
    scaled = sparse.csc_matrix(weight).multiply(cost * np.outer(units, units))
    rows = _Rows(n_x, n_m, n_s, (n, n_u, len(problem.output_limits)))
    for k in range(N):
        rows.add(f"the plant from sample {k}", np.zeros(n), np.zeros(n), x_unit,
                 x={k: A, k + 1: -np.eye(n)}, u={k: B})  # fmt: skip
    for k in range(N):
        rows.add(f"command limits at sample {k}", problem.command_lower, problem.command_upper, u_unit,
                 u={k: np.eye(n_u)}, command=-np.eye(n_u))  # fmt: skip
    for i, limit in enumerate(problem.output_limits):
        C, D = problem.output_rows[i : i + 1], problem.output_through[i : i + 1]
        direct, slack = bool(np.any(D)), soft.index(i) if limit.soft else None
        for k in range(0 if direct else 1, N if direct else N + 1):
            _add_output(rows, limit.name, (limit.lower, limit.upper), (C, D), k=k, i=i, unit=widths[i],
                        slack=None if slack is None else (k if direct else k - 1) * len(soft) + slack)  # fmt: skip
    if n_s:
        rows.add("amounts broken", np.zeros(n_s), np.full(n_s, np.inf), s_unit, s=(slice(0, n_s), np.eye(n_s)))
    if np.any(np.isfinite(problem.rate)):
        rows.add("rates at sample 0", -problem.rate, problem.rate, u_unit, u={0: np.eye(n_u)},
                 command=-np.eye(n_u), last=np.eye(n_u))  # fmt: skip
        for k in range(1, N):
            rows.add(f"rates at sample {k}", -problem.rate, problem.rate, u_unit,
                     u={k: np.eye(n_u), k - 1: -np.eye(n_u)})  # fmt: skip
        rows.add(f"rates at sample {N}", -problem.rate, problem.rate, u_unit,
                 x={N: -K}, u={N - 1: -np.eye(n_u)})  # fmt: skip
    first = rows.count
    if terminal is not None:
        m = len(terminal.rows)
        rows.add("the terminal set", np.full(m, -np.inf), np.ones(m), np.ones(m), x={N: terminal.rows})
    q = np.concatenate([np.zeros(n_x + n_m), 0.5 * np.tile(linear, N) * s_unit * cost])
    return rows.program(sparse.csc_matrix(scaled), q, units, slice(first, rows.count), (n_x, n_m, n_s))


class GeneralSolver:
    """OSQP on one sparse program, warm from sample to sample; what it says is checked, Clarabel asked next."""

    def __init__(self, program: SparseProgram, *, time_limit: float = 1.0) -> None:
        """Set up; the matrices are factored once.

        Parameters
        ----------
        time_limit : s per sample and solver
        """
        import osqp

        self._program, self._time_limit = program, time_limit
        self._solver = osqp.OSQP()
        self._solver.setup(
            program.P, np.array(program.q), program.A, np.maximum(program.lower, -1e30),
            np.minimum(program.upper, 1e30), time_limit=time_limit, polishing=True,
            **{**OSQP_SETTINGS, "eps_abs": 1e-8, "eps_rel": 1e-8},
        )  # fmt: skip

    def solve(self, now: Now, *, guess: tuple[FloatArray, FloatArray] | None = None) -> PlanSolution:
        """The plan at this sample, verified, or why there is none.

        Parameters
        ----------
        guess : unknowns and multipliers to start from; the last solution's when left out
        """
        program = self._program
        lower, upper = program.bounds(now)
        data = QuadraticData(program.P, program.q, program.A, lower, upper)
        self._solver.update(l=np.maximum(lower, -1e30), u=np.minimum(upper, 1e30))
        if guess is not None:
            self._solver.warm_start(x=guess[0], y=guess[1])
        found = self._solver.solve(raise_error=False)
        iterations = int(found.info.iter)
        if found.x is not None and np.all(np.isfinite(found.x)) and np.all(np.isfinite(found.y)):
            residual = data.residual(found.x, found.y)
            if residual.largest <= ACCEPTED:
                return self._told(np.array(found.x), np.array(found.y), residual, "OSQP", iterations)
        proof = found.prim_inf_cert
        if proof is not None and proves_infeasible(program.A, lower, upper, np.nan_to_num(np.asarray(proof))):
            return self._infeasible(np.asarray(proof), "OSQP", iterations)
        other = clarabel_candidate(program.P, program.q, program.A, (lower, upper), time_limit=self._time_limit)
        if other.x is not None and other.y is not None:
            residual = data.residual(other.x, other.y)
            if residual.largest <= ACCEPTED:
                return self._told(other.x, other.y, residual, "Clarabel", iterations + other.iterations)
        farkas = farkas_vector(data)
        if farkas is not None:
            return self._infeasible(farkas, "Farkas certificate", iterations)
        return self._nothing(
            Status.NOT_VERIFIED, f"no solver reached a KKT residual of {ACCEPTED:.0e} (loosest useful {LOOSE:.0e})",
            "none", iterations,
        )  # fmt: skip

    def _told(self, x: FloatArray, y: FloatArray, residual: KktResidual, solver: str, iterations: int) -> PlanSolution:
        n_x, n_m, n_s = self._program.sizes
        physical = x * self._program.units
        horizon = max(n_m // max(self._program.by_command.shape[1], 1), 1)
        return PlanSolution(
            moves=read_only(physical[n_x : n_x + n_m].reshape(horizon, -1), name="moves"),
            states=read_only(physical[:n_x].reshape(horizon, -1), name="states"),
            broken=read_only(physical[n_x + n_m :].reshape(horizon, -1) if n_s else np.zeros((horizon, 0)), name="s"),
            multipliers=read_only(y, name="multipliers"), residual=residual, status=Status.SOLVED, message="",
            solver=solver, iterations=iterations,
        )  # fmt: skip

    def _infeasible(self, farkas: FloatArray, solver: str, iterations: int) -> PlanSolution:
        weight = np.abs(farkas)
        heavy = np.flatnonzero(weight > 1e-3 * np.max(weight))
        kinds = dict.fromkeys(self._program.names[i].split(" at sample ")[0] for i in heavy)
        names = [name for name in kinds if not name.startswith("the plant from")]
        told = f"from this state the plant cannot keep all of: {', '.join(names)}"
        return self._nothing(Status.INFEASIBLE, told, solver, iterations)

    def _nothing(self, status: Status, message: str, solver: str, iterations: int) -> PlanSolution:
        nothing = read_only_any(np.full((0, 0), np.nan))
        return PlanSolution(
            moves=nothing, states=nothing, broken=nothing, multipliers=nothing,
            residual=KktResidual(np.inf, np.inf, np.inf), status=status, message=message, solver=solver,
            iterations=iterations,
        )  # fmt: skip


class _Rows:
    """Rows collected block by block, each divided by its unit."""

    def __init__(self, n_x: int, n_m: int, n_s: int, sizes: tuple[int, int, int]) -> None:
        self.width, self.starts, self.sizes, self.count = n_x + n_m + n_s, (0, n_x, n_x + n_m), sizes, 0
        self.blocks: list[tuple[FloatArray, Any, FloatArray]] = []
        self.moving: dict[str, list[FloatArray]] = {"x0": [], "command": [], "output": [], "last": []}
        self.lower: list[FloatArray] = []
        self.upper: list[FloatArray] = []
        self.names: list[str] = []

    def add(
        self, name: str, lower: FloatArray, upper: FloatArray, unit: FloatArray, *,
        x: dict[int, FloatArray] | None = None, u: dict[int, FloatArray] | None = None,
        s: tuple[slice, FloatArray] | None = None, command: FloatArray | None = None,
        output: FloatArray | None = None, last: FloatArray | None = None,
    ) -> None:  # fmt: skip
        m, (n, n_u, n_o) = lower.size, self.sizes
        block, x0 = np.zeros((m, self.width)), np.zeros((m, n))
        for k, matrix in (x or {}).items():
            if k == 0:
                x0 -= matrix  # known: to the other side
            else:
                block[:, (k - 1) * n : k * n] += matrix
        for k, matrix in (u or {}).items():
            start = self.starts[1] + k * n_u
            block[:, start : start + n_u] += matrix
        if s is not None:
            block[:, self.starts[2] + s[0].start : self.starts[2] + s[0].stop] += s[1]
        over = 1.0 / unit[:, None]
        self.blocks.append((lower, sparse.csr_matrix(block * over), upper))
        for key, given, columns in (("x0", x0, n), ("command", command, n_u), ("output", output, n_o),
                                    ("last", last, n_u)):  # fmt: skip
            self.moving[key].append((np.zeros((m, columns)) if given is None else given) * over)
        self.lower.append(lower / unit)
        self.upper.append(upper / unit)
        self.names += [name] * m
        self.count += m

    def program(
        self, P: Any, q: FloatArray, units: FloatArray, terminal: slice, sizes: tuple[int, int, int]
    ) -> SparseProgram:
        A = sparse.csc_matrix(sparse.vstack([block for _, block, _ in self.blocks]).multiply(units[None, :]))
        moving = {key: sparse.csr_matrix(np.vstack(parts)) for key, parts in self.moving.items()}
        return SparseProgram(
            P=P, q=read_only(q, name="q"), A=A, lower=read_only_any(np.concatenate(self.lower)),
            upper=read_only_any(np.concatenate(self.upper)),
            by_state=moving["x0"], by_command=moving["command"], by_output=moving["output"], by_last=moving["last"],
            terminal=terminal, units=read_only(units, name="units"), names=tuple(self.names), sizes=sizes,
        )  # fmt: skip


def _add_output(
    rows: _Rows, name: str, limits: tuple[float, float], matrices: tuple[FloatArray, FloatArray], *,
    k: int, i: int, unit: float, slack: int | None,
) -> None:  # fmt: skip
    C, D = matrices
    shift = np.zeros((1, rows.sizes[2]))
    shift[0, i] = -1.0
    u = {k: D} if np.any(D) else None
    sides = [(limits[0], limits[1], 0.0)]
    if slack is not None:
        sides = [(limits[0], np.inf, 1.0), (-np.inf, limits[1], -1.0)]
    for lower, upper, sign in sides:
        if np.isfinite(lower) or np.isfinite(upper):
            rows.add(
                f"{name} at sample {k}", np.array([lower]), np.array([upper]), np.array([unit]), x={k: C}, u=u,
                s=None if slack is None else (slice(slack, slack + 1), np.array([[sign]])), output=shift,
            )  # fmt: skip


def _units(problem: PredictiveProblem, P: FloatArray) -> tuple[float, FloatArray, FloatArray]:
    """Cost factor and units of states and commands: commands at their limits, states where they cost as much."""
    u_unit = command_scale(problem)
    cost = 1.0 / float(np.max(u_unit**2 * np.diag(problem.R)))
    diagonal = np.diag(P) * cost
    least = np.max(diagonal, initial=0.0) * 1e-16
    return cost, 1.0 / np.sqrt(np.where(diagonal > least, diagonal, max(least, 1e-300))), u_unit
