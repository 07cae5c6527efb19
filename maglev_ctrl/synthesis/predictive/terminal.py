"""Where the regulator alone keeps every limit for ever: an ellipsoid and the maximal polyhedron, checked.

With u = -K x every limit is a bound on rows of the state, G x <= 1. The maximal admissible set
{x : G A_c^t x <= 1 for all t} is a polyhedron of finitely many rows (Gilbert & Tan, IEEE TAC 36 (1991) 1008).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from maglev_ctrl.arrays import FloatArray, read_only
from maglev_ctrl.synthesis.predictive.problem import PredictiveProblem
from maglev_ctrl.synthesis.predictive.solvers import linprog

ROWS_AT_MOST = 600
STEPS_AT_MOST = 400
SLACK = 1e-9
"""A row counts as implied by others if they let it exceed its bound by no more."""


@dataclass(frozen=True, eq=False, slots=True)
class TerminalSet:
    """Polyhedron rows x <= 1 (m, n), invariant under the regulator and inside every limit.

    `samples` t until no new row is needed; `multipliers` Y >= 0 (m, m) prove invariance: Y rows = rows A_c, Y 1 <= 1,
    up to `excess`, the largest amount by which the next state may exceed a bound, found from Y and not from a solver.
    `kind` "maximal admissible set" or "box inside the ellipsoid".
    """

    rows: FloatArray
    samples: int
    multipliers: FloatArray
    excess: float
    kind: str

    def holds(self, x: FloatArray, *, share: float = 1.0, tolerance: float = 1e-9) -> bool:
        """Whether `x` lies in the set scaled by `share`."""
        return bool(np.all(self.rows @ x <= share + tolerance))


def limit_rows(problem: PredictiveProblem, K: FloatArray) -> FloatArray:
    """Rows G (m, n) with G x <= 1: every limit of commands, outputs and rates under u = -K x.

    Soft outputs count as well: inside the set nothing is broken.

    Examples
    --------
    >>> from maglev_ctrl.synthesis.predictive.problem import predictive_problem
    >>> from maglev_ctrl.systems.plant import Plant
    >>> plant = Plant.from_matrices([[1.0]], [[1.0]], [[1.0]], [[1.0]], dt=0.1)
    >>> problem = predictive_problem(plant, horizon=5, Q=[[1.0]], R=[[1.0]], command_limits=([-1.0], [2.0]))
    >>> limit_rows(problem, np.array([[0.5]])).ravel().tolist()
    [-0.25, 0.5]
    """
    closed = problem.plant.A - problem.plant.B2 @ K
    outputs = problem.output_rows - problem.output_through @ K
    pairs = [
        (-K, problem.command_upper), (K, -problem.command_lower),
        (outputs, np.array([limit.upper for limit in problem.output_limits])),
        (-outputs, -np.array([limit.lower for limit in problem.output_limits])),
        (-K @ (closed - np.eye(len(closed))), problem.rate), (K @ (closed - np.eye(len(closed))), problem.rate),
    ]  # fmt: skip
    found = [rows[np.isfinite(h)] / h[np.isfinite(h), None] for rows, h in pairs if rows.size]
    stacked = np.vstack(found) if found else np.zeros((0, closed.shape[0]))
    return read_only(stacked[np.any(stacked != 0.0, axis=1)], name="rows")


def ellipsoid_level(P: FloatArray, rows: FloatArray) -> float:
    """Largest alpha with {x'P x <= alpha} inside rows x <= 1: the least 1 / (g P^-1 g'); infinite without rows.

    Examples
    --------
    >>> ellipsoid_level(np.eye(1), np.array([[0.5]]))
    4.0
    """
    if not len(rows):
        return np.inf
    return float(1.0 / np.max(np.einsum("ij,ji->i", rows, np.linalg.solve(P, rows.T))))


def terminal_set(problem: PredictiveProblem, P: FloatArray, K: FloatArray) -> TerminalSet:
    """The maximal admissible set; where that is too big, a box inside the ellipsoid with the images it needs.

    Parameters
    ----------
    P : (n, n) positive definite, A_c'P A_c < P
    K : (nu, n) regulator u = -K x

    Examples
    --------
    >>> from maglev_ctrl.synthesis.predictive.problem import predictive_problem
    >>> from maglev_ctrl.systems.plant import Plant
    >>> plant = Plant.from_matrices([[1.0]], [[1.0]], [[1.0]], [[1.0]], dt=0.1)
    >>> problem = predictive_problem(plant, horizon=5, Q=[[1.0]], R=[[1.0]], command_limits=([-1.0], [2.0]))
    >>> found = terminal_set(problem, np.eye(1), np.array([[0.5]]))
    >>> sorted(found.rows.ravel().tolist()), found.samples, found.excess
    ([-0.25, 0.5], 0, 0.0)
    """
    closed = problem.plant.A - problem.plant.B2 @ K
    # coordinates in which the ellipsoid is a ball: the programs are well scaled
    factor = np.linalg.cholesky(P).T
    loop = factor @ closed @ np.linalg.inv(factor)
    limits = np.linalg.solve(factor.T, limit_rows(problem, K).T).T
    found = _maximal(limits, loop)
    kind = "maximal admissible set"
    if found is None:
        radius = np.sqrt(ellipsoid_level(np.eye(len(loop)), limits))
        edge = np.vstack([np.eye(len(loop)), -np.eye(len(loop))]) * (np.sqrt(len(loop)) / radius)
        found = _maximal(edge, loop)
        kind = "box inside the ellipsoid"
    if found is None:
        return TerminalSet(
            rows=read_only(np.zeros((0, len(loop))), name="rows"), samples=STEPS_AT_MOST,
            multipliers=read_only(np.zeros((0, 0)), name="multipliers"), excess=np.inf, kind="none found",
        )  # fmt: skip
    rows, samples = found
    multipliers, excess = invariance(rows, loop)
    return TerminalSet(
        rows=read_only(rows @ factor, name="rows"), samples=samples,
        multipliers=read_only(multipliers, name="multipliers"), excess=excess, kind=kind,
    )  # fmt: skip


def invariance(rows: FloatArray, closed: FloatArray) -> tuple[FloatArray, float]:
    """Multipliers Y >= 0 with Y rows = rows A_c and Y 1 <= 1 where the set is invariant, and the excess they leave.

    Largest of rows A_c x over rows x <= 1, by linear programming; the excess counts what the solver left open: the
    rest of the equation times the largest |x| of the set (its bounding box).

    Parameters
    ----------
    rows : (m, n), the set is rows x <= 1
    closed : (n, n)

    Examples
    --------
    >>> rows = np.array([[1.0], [-1.0]])
    >>> invariance(rows, np.array([[0.5]]))[1], round(invariance(rows, np.array([[1.5]]))[1], 9)
    (0.0, 0.5)
    """
    m = len(rows)
    if not m:
        return np.zeros((0, 0)), 0.0
    reach = _reach(rows)
    Y, worst = np.zeros((m, m)), 0.0
    for i, target in enumerate(rows @ closed):
        Y[i] = _largest(rows, target)[1]
        rest = np.abs(Y[i] @ rows - target)
        open_rest = 0.0 if not np.any(rest > 0.0) else float(rest @ np.where(rest > 0.0, reach, 0.0))
        worst = max(worst, float(np.sum(Y[i])) + open_rest - 1.0)
    return Y, max(worst, 0.0)


def _maximal(limits: FloatArray, closed: FloatArray) -> tuple[FloatArray, int] | None:
    """Rows added sample by sample until the next ones are implied; None where they grow too many."""
    rows = _without_redundant(limits)
    newest = rows
    for t in range(STEPS_AT_MOST):
        image = newest @ closed
        fresh = image[[not _implied(rows, target) for target in image]]
        if not len(fresh):
            return _without_redundant(rows), t
        rows, newest = np.vstack([rows, fresh]), fresh
        if len(rows) > ROWS_AT_MOST:
            return None
    return None


def _without_redundant(rows: FloatArray) -> FloatArray:
    kept = list(range(len(rows)))
    for i in range(len(rows) - 1, -1, -1):
        others = [k for k in kept if k != i]
        if others and _implied(rows[others], rows[i]):
            kept = others
    return rows[kept]


def _implied(rows: FloatArray, target: FloatArray) -> bool:
    if not np.any(np.abs(target) > 1e-14 * np.max(np.abs(rows), initial=1e-300)):
        return True
    return _largest(rows, target)[0] <= 1.0 + SLACK


def _largest(rows: FloatArray, target: FloatArray) -> tuple[float, FloatArray]:
    """Largest target x over rows x <= 1, from its dual: least 1'y with rows'y = target, y >= 0."""
    found = linprog(np.ones(len(rows)), A_eq=rows.T, b_eq=target, bounds=(0.0, None), method="highs")
    if found.status != 0 or found.x is None:
        return np.inf, np.zeros(len(rows))
    y = np.maximum(found.x, 0.0)
    support = np.flatnonzero(y > 1e-12)
    if support.size:  # a vertex: solve its equations again, to rounding
        better = np.linalg.lstsq(rows[support].T, target, rcond=None)[0]
        if np.all(better >= 0.0):
            y = np.zeros(len(rows))
            y[support] = better
    return float(np.sum(y)), y


def _reach(rows: FloatArray) -> FloatArray:
    """Largest |x_j| in the set; infinite where it is not bounded."""
    n = rows.shape[1]
    return np.array([max(_largest(rows, e)[0], _largest(rows, -e)[0]) for e in np.eye(n)])
