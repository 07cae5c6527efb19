"""Convex quadratic programs: OSQP, Clarabel after it, own refinement, and no answer that is not checked.

    minimise  x'P x / 2 + q'x   subject to  l <= A x <= u

A convex program with linear bounds has a solution, is infeasible, or falls for ever along a ray (Frank & Wolfe 1956);
each of the three is told only with its proof: multipliers, a Farkas vector, or the ray and a feasible point.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from maglev_ctrl.arrays import FloatArray, read_only, read_only_any
from maglev_ctrl.errors import Status
from maglev_ctrl.synthesis.predictive.kkt import (
    NO_BOUND,
    KktResidual,
    kkt_residual,
    largest_in_rows,
    proves_infeasible,
    proves_infeasible_exactly,
    proves_unbounded,
    termwise_residual,
)
from maglev_ctrl.synthesis.predictive.refine import LARGEST, active_set_steps, excluding_rows, refine
from maglev_ctrl.synthesis.predictive.solvers import (
    Candidate,
    ScaledProgram,
    clarabel_candidate,
    linprog,
    osqp_candidate,
    scaled_program,
    sparse,
)

TIGHT = 1e-8
"""Largest KKT residual, row by row, of a solution called SOLVED; up to `LOOSE` it is ALMOST_SOLVED."""
LOOSE = 1e-6
DWARFED = 1e4
"""Terms so many times as large as q may hide a ray of descent, which is then sought first."""
NO_RESIDUAL = KktResidual(np.inf, np.inf, np.inf)


@dataclass(frozen=True, eq=False, slots=True)
class QuadraticSolution:
    """Point `x`, multipliers `y` (positive at upper bounds), `objective` and the evidence; NaN where there is none.

    `certificate` proves INFEASIBLE (a Farkas vector, m) or UNBOUNDED (a ray, n), else it is empty.
    """

    x: FloatArray
    y: FloatArray
    objective: float
    residual: KktResidual
    status: Status
    message: str
    solver: str
    iterations: int
    certificate: FloatArray


@dataclass(frozen=True, eq=False, slots=True)
class QuadraticData:
    """Data of one program, checked: P, A sparse, bounds with infinities."""

    P: Any
    q: FloatArray
    A: Any
    lower: FloatArray
    upper: FloatArray

    @property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Lower and upper bounds together."""
        return self.lower, self.upper

    def residual(self, x: FloatArray, y: FloatArray) -> KktResidual:
        """KKT residual of a point and its multipliers."""
        return kkt_residual(self.P, self.q, self.A, self.bounds, x=x, y=y)

    def termwise(self, x: FloatArray, y: FloatArray) -> KktResidual:
        """KKT residual of each row and unknown relative to its own terms."""
        return termwise_residual(self.P, self.q, self.A, self.bounds, x=x, y=y)

    def objective(self, x: FloatArray) -> float:
        """The objective at x."""
        return float(0.5 * x @ (self.P @ x) + self.q @ x)


def quadratic_program(
    P: Any, q: ArrayLike, A: Any, lower: ArrayLike, upper: ArrayLike, *, time_limit: float = 60.0
) -> QuadraticSolution:
    """Solve and verify one convex quadratic program; what cannot be verified is NOT_VERIFIED, never a number to use.

    Parameters
    ----------
    P : (n, n) symmetric positive semidefinite, dense or sparse
    A : (m, n) dense or sparse
    lower, upper : (m,) bounds l and u; None, nan-free infinities and magnitudes of 1e20 or more mean no bound
    time_limit : s, for each solver

    SOLVED means every residual of `termwise_residual` is at most 1e-8: bounds that miss one another by less than
    1e-8 of themselves (1e-12 of the terms of their rows) count as met. ALMOST_SOLVED reaches down to 1e-6, and is not
    told where a certificate shows that there is no solution. Solvers see the program scaled; points are judged in its
    own units.

    Raises
    ------
    ValueError : shapes do not fit, P is not symmetric or not positive semidefinite, or an entry is not finite

    Examples
    --------
    >>> solution = quadratic_program([[4.0, 1.0], [1.0, 2.0]], [1.0, 1.0],
    ...                              [[1.0, 1.0], [1.0, 0.0], [0.0, 1.0]], [1.0, 0.0, 0.0], [1.0, 0.7, 0.7])
    >>> solution.status.name, round(solution.objective, 12), solution.x.round(12).tolist()
    ('SOLVED', 1.88, [0.3, 0.7])
    >>> quadratic_program([[0.0]], [-1.0], [[1.0]], [0.0], [None]).status.name
    'UNBOUNDED'
    """
    data = quadratic_data(P, q, A, lower, upper)
    crossed = np.flatnonzero(data.lower > data.upper)
    if crossed.size:
        row = int(crossed[0])
        message = f"the bounds of row {row} cross: {data.lower[row]:g} > {data.upper[row]:g}"
        return without_solution(data, Status.INFEASIBLE, message)
    best, best_residual, iterations = _best_point(data, time_limit, _solver_points)
    if best_residual.largest > TIGHT or _hides_slope(data, best):
        proved = _proved_without_solution(data)
        if proved is not None:
            return proved
    if best_residual.largest > TIGHT:
        other, other_residual, more = _best_point(data, time_limit, _active_set_points)
        iterations += more
        if other_residual.largest < best_residual.largest:
            best, best_residual = other, other_residual
    if best is None or best.x is None or best.y is None:
        return without_solution(data, Status.NUMERICAL_ERROR, "no solver gave a point, and none proved why")
    if best_residual.largest <= TIGHT:
        status, message = Status.SOLVED, ""
    elif best_residual.largest <= LOOSE:
        status, message = Status.ALMOST_SOLVED, f"KKT residual {best_residual.largest:.1e}"
    else:
        status = Status.NOT_VERIFIED
        message = f"the KKT residual of the solvers' best point is {best_residual.largest:.1e}, allowed {LOOSE:.0e}"
    return QuadraticSolution(
        x=read_only(best.x, name="x"), y=read_only(best.y, name="y"), objective=data.objective(best.x),
        residual=best_residual, status=status, message=message, solver=best.solver, iterations=iterations,
        certificate=read_only(np.zeros(0), name="certificate"),
    )  # fmt: skip


def quadratic_data(P: Any, q: ArrayLike, A: Any, lower: ArrayLike, upper: ArrayLike) -> QuadraticData:
    """Data of one program with shapes, symmetry and convexity checked.

    Parameters
    ----------
    P, q, A, lower, upper : as in `quadratic_program`

    Raises
    ------
    ValueError : shapes do not fit, P is not symmetric or not positive semidefinite, or an entry is not finite
    """
    slope = read_only(q, name="q", shape=(None,))
    n = slope.size
    weight, rows = (_sparse(value, name, n) for name, value in (("P", P), ("A", A)))
    if weight.shape[0] != n:
        raise ValueError(f"P: expected shape ({n}, {n}), got {weight.shape}")
    m = rows.shape[0]
    size = float(np.max(np.abs(weight.data))) if weight.nnz else 0.0
    skew = weight - weight.T
    if skew.nnz and float(np.max(np.abs(skew.data))) > 1e-10 * size:
        raise ValueError("P: expected a symmetric matrix; both halves must be given")
    if n <= 1000 and weight.nnz:
        smallest = float(np.linalg.eigvalsh(weight.toarray())[0])
        if smallest < -1e-10 * n * size:
            raise ValueError(
                f"P: expected a positive semidefinite matrix (a convex problem), got the eigenvalue {smallest:.3g}"
            )
    low, high = _bound(lower, "lower", m, -np.inf), _bound(upper, "upper", m, np.inf)
    return QuadraticData(P=sparse.csc_matrix(0.5 * (weight + weight.T)), q=slope, A=rows, lower=low, upper=high)


def refined(data: QuadraticData, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray, KktResidual]:
    """The point, or a better one from the linear equations of its active bounds, with the residual.

    Parameters
    ----------
    x, y : point and multipliers
    """
    residual = data.termwise(x, y)
    for _ in range(3):
        if residual.largest <= 1e-14:
            break
        better = refine(data.P, data.q, data.A, data.bounds, x=x, y=y)
        if better is None:
            break
        found = data.termwise(*better)
        if not found.largest < 0.5 * residual.largest:
            break
        (x, y), residual = better, found
    return x, y, residual


def _best_point(
    data: QuadraticData, time_limit: float, source: Callable[[QuadraticData, float], Iterator[Candidate]]
) -> tuple[Candidate | None, KktResidual, int]:
    """The best of the points found for the scaled program, refined, and judged in the program's own units."""
    best, least, iterations = None, NO_RESIDUAL, 0
    seen: list[ScaledProgram] = []
    for lengths in (True, False):
        scaled = scaled_program(data.P, data.q, data.A, data.bounds, lengths=lengths)
        if seen and np.array_equal(scaled.columns, seen[0].columns):
            break
        seen.append(scaled)
        within = QuadraticData(scaled.P, scaled.q, scaled.A, *scaled.bounds)
        for found in source(within, time_limit):
            iterations += found.iterations
            if found.x is None or found.y is None:
                continue
            x, y, _ = refined(within, found.x, found.y)
            # a rest of rounding where an unknown is zero
            for point in (x, np.where(np.abs(x) > 1e-13, x, 0.0)):
                restored = scaled.restored(point, y)
                residual = data.termwise(*restored)
                if best is None or residual.largest < least.largest:
                    best, least = Candidate(found.solver, *restored, found.iterations), residual
            if least.largest <= TIGHT:
                return best, least, iterations
    return best, least, iterations


def _solver_points(data: QuadraticData, time_limit: float) -> Iterator[Candidate]:
    for solver in (osqp_candidate, clarabel_candidate, _linear_candidate):
        yield solver(data.P, data.q, data.A, data.bounds, time_limit=time_limit)


def _active_set_points(data: QuadraticData, time_limit: float) -> Iterator[Candidate]:
    for x, y in active_set_steps(data.P, data.q, data.A, data.bounds, x=np.zeros(data.q.size)):
        yield Candidate("active sets", x, y, 1)


def _hides_slope(data: QuadraticData, found: Candidate | None) -> bool:
    """Whether the terms at the point dwarf q, so that a slope that falls for ever would pass as rounding."""
    if found is None or found.x is None or found.y is None:
        return True
    pulls = np.abs(data.q) + np.asarray(abs(data.P) @ np.abs(found.x) + abs(data.A).T @ np.abs(found.y)).ravel()
    return float(np.max(pulls, initial=0.0)) > DWARFED * float(np.max(np.abs(data.q), initial=0.0)) > 0.0


def without_solution(
    data: QuadraticData, status: Status, message: str, *, certificate: FloatArray | None = None, solver: str = "none"
) -> QuadraticSolution:
    """A result without a point.

    Parameters
    ----------
    status, message : why
    certificate : what proves it
    """
    return QuadraticSolution(
        x=read_only_any(np.full(data.q.size, np.nan)), y=read_only_any(np.full(data.lower.size, np.nan)),
        objective={Status.INFEASIBLE: np.inf, Status.UNBOUNDED: -np.inf}.get(status, np.nan),
        residual=NO_RESIDUAL, status=status, message=message, solver=solver, iterations=0,
        certificate=read_only(np.zeros(0) if certificate is None else certificate, name="certificate"),
    )  # fmt: skip


def _linear_candidate(
    P: Any, q: FloatArray, A: Any, bounds: tuple[FloatArray, FloatArray], *, time_limit: float
) -> Candidate:
    """A linear program (P = 0) by the simplex method, whose vertices are exact."""
    if P.nnz and np.any(P.data):
        return Candidate("HiGHS", None, None, 0)
    lower, upper = bounds
    sides, limits, pick = _one_sided(A, lower, upper)
    found = linprog(q, A_ub=sides, b_ub=limits, bounds=(None, None), method="highs", options={"time_limit": time_limit})
    if found.status != 0:
        return Candidate("HiGHS", None, None, int(found.nit))
    y = np.zeros(A.shape[0])
    for (row, sign), push in zip(pick, -found.ineqlin.marginals, strict=True):
        y[row] += sign * push
    return Candidate("HiGHS", np.asarray(found.x, dtype=float), y, int(found.nit))


def _proved_without_solution(data: QuadraticData) -> QuadraticSolution | None:
    """INFEASIBLE or UNBOUNDED with its certificate; None where neither is proved."""
    farkas = farkas_vector(data)
    if farkas is not None:
        names = np.flatnonzero(farkas)
        message = f"rows {', '.join(map(str, names[:8]))}{' ...' if names.size > 8 else ''} exclude one another"
        return without_solution(data, Status.INFEASIBLE, message, certificate=farkas, solver="Farkas certificate")
    ray = _ray(data)
    if ray is None:
        return None
    nowhere = np.zeros((data.q.size, data.q.size))
    feasible = quadratic_program(nowhere + np.eye(data.q.size), np.zeros(data.q.size), data.A, *data.bounds)
    if feasible.status not in (Status.SOLVED, Status.ALMOST_SOLVED):
        return None
    message = "the objective falls for ever along the certificate"
    return without_solution(data, Status.UNBOUNDED, message, certificate=ray, solver="ray")


def farkas_vector(data: QuadraticData) -> FloatArray | None:
    """A vector that proves there is no feasible point, checked; None where there is none or it cannot be proved.

    minimise u'y+ - l'y-  subject to  A'(y+ - y-) = 0,  0 <= y <= 1.
    """
    m, n = data.A.shape
    if not m:
        return None
    among = excluding_rows(data.A, data.bounds)
    if among is not None:
        if proves_infeasible(data.A, data.lower, data.upper, among):
            return among
        exact = proves_infeasible_exactly(data.A, data.lower, data.upper, among)
        if exact is not None:
            return exact
    rows = largest_in_rows(data.A)
    scaled = sparse.diags_array(1.0 / rows) @ data.A
    lower, upper = data.lower / rows, data.upper / rows
    finite = np.concatenate([np.abs(lower[lower > -NO_BOUND]), np.abs(upper[upper < NO_BOUND])])
    size = float(np.max(finite)) if finite.size and np.any(finite) else 1.0
    above, below = upper < NO_BOUND, lower > -NO_BOUND
    cost = np.concatenate([np.where(above, upper, 0.0), np.where(below, -lower, 0.0)]) / size
    caps = [(0.0, 1.0 if free else 0.0) for free in np.concatenate([above, below])]
    equal = sparse.csc_matrix(sparse.hstack([scaled.T, -scaled.T]))
    found = linprog(cost, A_eq=equal, b_eq=np.zeros(n), bounds=caps, method="highs")
    if found.status != 0 or found.x is None:
        return None
    y = np.asarray(found.x[:m] - found.x[m:], dtype=float)
    support = np.flatnonzero(np.abs(y) > 1e-9)
    if not support.size:
        return None
    dense = scaled[support].toarray()
    cleaned = np.zeros(m)
    cleaned[support] = y[support] - np.linalg.lstsq(dense.T, dense.T @ y[support], rcond=None)[0]
    for vector in (cleaned / rows, np.where(np.abs(y) > 1e-9, y, 0.0) / rows):
        if proves_infeasible(data.A, data.lower, data.upper, vector):
            return vector
    return proves_infeasible_exactly(data.A, data.lower, data.upper, np.where(np.abs(y) > 1e-9, y, 0.0))


def _ray(data: QuadraticData) -> FloatArray | None:
    n = data.q.size
    rows = largest_in_rows(data.A)
    scaled = sparse.csc_matrix(sparse.diags_array(1.0 / rows) @ data.A) if data.A.shape[0] else data.A
    above, below = data.upper < NO_BOUND, data.lower > -NO_BOUND
    sides = sparse.csc_matrix(sparse.vstack([scaled[above], -scaled[below]])) if data.A.shape[0] else None
    flat = sparse.csc_matrix(sparse.diags_array(1.0 / largest_in_rows(data.P)) @ data.P)
    found = linprog(
        data.q / (float(np.max(np.abs(data.q))) or 1.0),
        A_ub=sides, b_ub=None if sides is None else np.zeros(sides.shape[0]),
        A_eq=flat, b_eq=np.zeros(n), bounds=(-1.0, 1.0), method="highs",
    )  # fmt: skip
    if found.status != 0 or found.x is None:
        return None
    d = np.where(np.abs(found.x) > 1e-9, found.x, 0.0)
    if n + rows.size <= LARGEST:
        # the tolerance of the linear program is taken out, so that nearly parallel rows are told from parallel
        moved = np.asarray(scaled @ d).ravel()
        along = (np.abs(moved) < 1e-6) & (above | below)
        still = sparse.vstack([flat, scaled[np.flatnonzero(along)]]).toarray()
        for _ in range(2):
            d = d - np.linalg.lstsq(still, still @ d, rcond=1e-12)[0]
    return d if proves_unbounded(data.P, data.q, data.A, data.bounds, d) else None


def _one_sided(A: Any, lower: FloatArray, upper: FloatArray) -> tuple[Any, FloatArray, list[tuple[int, float]]]:
    above, below = np.flatnonzero(upper < NO_BOUND), np.flatnonzero(lower > -NO_BOUND)
    sides = sparse.csc_matrix(sparse.vstack([A[above], -A[below]]))
    pick = [(int(i), 1.0) for i in above] + [(int(i), -1.0) for i in below]
    return sides, np.concatenate([upper[above], -lower[below]]), pick


def _sparse(value: Any, name: str, columns: int) -> Any:
    if sparse.issparse(value):
        matrix = sparse.csc_matrix(value, dtype=float)
    else:
        dense = np.asarray(value, dtype=float)
        matrix = sparse.csc_matrix(dense.reshape(0, columns) if not dense.size else dense)
    if matrix.shape[1] != columns:
        raise ValueError(f"{name}: expected {columns} columns, got shape {matrix.shape}")
    if not np.all(np.isfinite(matrix.data)):
        raise ValueError(f"{name}: every entry must be finite")
    matrix.eliminate_zeros()
    return matrix


def _bound(value: ArrayLike, name: str, count: int, none: float) -> FloatArray:
    listed: Any = value
    given = np.array([none if one is None else one for one in listed], dtype=float)
    if given.shape != (count,):
        raise ValueError(f"{name}: expected shape ({count},), got {given.shape}")
    if np.any(np.isnan(given)) or np.any(given == -none):
        raise ValueError(f"{name}: expected numbers or {none:g}, got {given}")
    given[np.abs(given) >= NO_BOUND] = none
    given.flags.writeable = False
    return given
