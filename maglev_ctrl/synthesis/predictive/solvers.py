"""OSQP and Clarabel on one quadratic program: points for others to check; nothing a solver says is believed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.optimize
import scipy.sparse

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.synthesis.predictive.kkt import NO_BOUND
from maglev_ctrl.synthesis.predictive.refine import LARGEST

sparse: Any = scipy.sparse
"""SciPy's sparse matrices, whose many types say nothing here."""
_SENSELESS = 1e150
"""Numbers whose squares overflow are no point of any program."""
linprog: Any = scipy.optimize.linprog
"""SciPy's linear programs (HiGHS)."""
OSQP_SETTINGS: dict[str, Any] = {
    "verbose": False, "eps_abs": 1e-9, "eps_rel": 1e-9, "eps_prim_inf": 1e-9, "eps_dual_inf": 1e-9,
    "polish_refine_iter": 5, "max_iter": 4000, "check_termination": 25,
    # counted in iterations, not in seconds, so that a run can be repeated
    "adaptive_rho": 1, "adaptive_rho_interval": 50,
}  # fmt: skip


@dataclass(frozen=True, eq=False, slots=True)
class Candidate:
    """What a solver left: a point and multipliers, None where it left none."""

    solver: str
    x: FloatArray | None
    y: FloatArray | None
    iterations: int


@dataclass(frozen=True, eq=False, slots=True)
class ScaledProgram:
    """A program in units that suit the solvers, all powers of two: x = columns * x', y = rows * y' * cost.

    Rows of A have norm one within sqrt(2), unknowns and bounds are of order one, and so are the entries of P and q.
    """

    P: Any
    q: FloatArray
    A: Any
    bounds: tuple[FloatArray, FloatArray]
    rows: FloatArray
    columns: FloatArray
    cost: float

    def restored(self, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Point and multipliers in the units of the program that was scaled.

        Parameters
        ----------
        x, y : point and multipliers of the scaled program
        """
        return self.columns * x, self.rows * y * self.cost


def scaled_program(
    P: Any, q: FloatArray, A: Any, bounds: tuple[FloatArray, FloatArray], *, lengths: bool = True
) -> ScaledProgram:
    """The program with rows, unknowns and cost scaled by powers of two, hence without rounding (Ruiz 2001).

    Parameters
    ----------
    P, A : sparse
    bounds : l, u (m,)
    lengths : also measure all unknowns in the largest distance of a bound from the origin

    Examples
    --------
    >>> A = sparse.csc_matrix([[1e5, 0.0], [0.0, 3e-4]])
    >>> one = scaled_program(sparse.csc_matrix(np.eye(2)), np.ones(2), A, (np.zeros(2), np.array([1e5, np.inf])))
    >>> float(abs(one.A).max()) <= 1.5, bool(np.all(np.log2(one.rows) % 1.0 == 0.0)), float(one.bounds[1][1])
    (True, True, inf)
    """
    n, m = q.size, A.shape[0]
    columns, rows = np.ones(n), np.ones(m)
    bend, size = abs(P), float(np.max(np.abs(P.data))) if P.nnz else 1.0
    for _ in range(8):
        held = sparse.diags_array(rows) @ abs(A) @ sparse.diags_array(columns)
        rows = rows / _positive(np.sqrt(np.asarray(held.power(2).sum(axis=1)).ravel()))
        held = sparse.diags_array(rows) @ abs(A) @ sparse.diags_array(columns)
        bent = (sparse.diags_array(columns) @ bend @ sparse.diags_array(columns)) / size
        reach = np.maximum(_most(held, n), _most(bent, n))
        columns = columns / np.sqrt(_positive(reach))
    columns = _power_of_two(columns)
    held = A @ sparse.diags_array(columns)
    rows = _power_of_two(1.0 / _positive(np.sqrt(np.asarray(held.power(2).sum(axis=1)).ravel())))
    sides = np.concatenate([np.abs(rows * side)[np.abs(side) < NO_BOUND] for side in bounds])
    if lengths and np.any(sides):
        length = float(_power_of_two(np.array([np.max(sides)]))[0])
        columns, rows = columns * length, rows / length
    weight = sparse.csc_matrix(sparse.diags_array(columns) @ P @ sparse.diags_array(columns))
    slope = columns * q
    steep = max(float(np.max(np.abs(weight.data))) if weight.nnz else 0.0, float(np.max(np.abs(slope), initial=0.0)))
    cost = float(_power_of_two(np.array([steep]))[0]) if steep > 0.0 else 1.0
    return ScaledProgram(
        P=weight / cost, q=slope / cost,
        A=sparse.csc_matrix(sparse.diags_array(rows) @ A @ sparse.diags_array(columns)),
        bounds=(rows * bounds[0], rows * bounds[1]), rows=rows, columns=columns, cost=cost,
    )  # fmt: skip


def osqp_candidate(
    P: Any, q: FloatArray, A: Any, bounds: tuple[FloatArray, FloatArray], *, time_limit: float
) -> Candidate:
    """OSQP (Stellato et al. 2020) at tight tolerances; polished by it only where `refine` does not, above its size.

    (Polishing prints a line where no bound is active, silent or not.)

    Examples
    --------
    >>> one = sparse.csc_matrix(np.eye(1))
    >>> found = osqp_candidate(one, -np.ones(1), one, (-np.ones(1), 0.5 * np.ones(1)), time_limit=10.0)
    >>> [round(float(x), 9) for x in (found.x[0], found.y[0])]
    [0.5, 0.5]
    """
    import osqp

    solver = osqp.OSQP()
    rows = A if A.shape[0] else None
    sides = (np.maximum(bounds[0], -1e30), np.minimum(bounds[1], 1e30)) if A.shape[0] else (None, None)
    solver.setup(
        sparse.csc_matrix(sparse.triu(P)), np.array(q), rows, *sides, time_limit=time_limit,
        polishing=q.size + A.shape[0] > LARGEST, **OSQP_SETTINGS,
    )  # fmt: skip
    found = solver.solve(raise_error=False)
    return Candidate("OSQP", _point(found.x), _point(found.y), int(found.info.iter))


def clarabel_candidate(
    P: Any, q: FloatArray, A: Any, bounds: tuple[FloatArray, FloatArray], *, time_limit: float
) -> Candidate:
    """Clarabel (Goulart & Chen 2024), an interior-point method: equal bounds as equations, the others one-sided.

    Examples
    --------
    >>> one = sparse.csc_matrix(np.eye(1))
    >>> found = clarabel_candidate(one, -np.ones(1), one, (-np.ones(1), 0.5 * np.ones(1)), time_limit=10.0)
    >>> [round(float(x), 6) for x in (found.x[0], found.y[0])]
    [0.5, 0.5]
    """
    import clarabel  # type: ignore[import-untyped]

    lower, upper = bounds
    equal = np.flatnonzero(lower == upper)
    above = np.flatnonzero((upper < NO_BOUND) & (lower != upper))
    below = np.flatnonzero((lower > -NO_BOUND) & (lower != upper))
    rows = sparse.csc_matrix(sparse.vstack([A[equal], A[above], -A[below]])) if A.shape[0] else A
    sides = np.concatenate([upper[equal], upper[above], -lower[below]])
    cones = [clarabel.ZeroConeT(equal.size), clarabel.NonnegativeConeT(above.size + below.size)]
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.time_limit = time_limit
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-10
    try:
        found = clarabel.DefaultSolver(
            sparse.csc_matrix(sparse.triu(P)), np.array(q), rows, sides, cones, settings
        ).solve()
    except BaseException as error:  # Clarabel's panics are not ordinary exceptions
        if isinstance(error, (KeyboardInterrupt, SystemExit)):
            raise
        return Candidate("Clarabel", None, None, 0)
    x, z = _point(found.x), _point(found.z)
    if x is None or z is None:
        return Candidate("Clarabel", None, None, int(found.iterations))
    y = np.zeros(A.shape[0])
    y[equal] = z[: equal.size]
    y[above] += z[equal.size : equal.size + above.size]
    y[below] -= z[equal.size + above.size :]
    return Candidate("Clarabel", x, y, int(found.iterations))


def _point(values: Any) -> FloatArray | None:
    if values is None:
        return None
    array = np.asarray(values, dtype=float)
    return array if np.all(np.abs(array) < _SENSELESS) else None  # false for NaN, too


def _most(matrix: Any, n: int) -> FloatArray:
    """Largest entry of each column, zero where there is none."""
    return np.asarray(matrix.max(axis=0).toarray(), dtype=float).ravel() if matrix.shape[0] else np.zeros(n)


def _positive(values: FloatArray) -> FloatArray:
    return np.where(values > 0.0, values, 1.0)


def _power_of_two(values: FloatArray) -> FloatArray:
    return np.asarray(np.exp2(np.round(np.log2(np.clip(values, 1e-100, 1e100)))), dtype=float)
