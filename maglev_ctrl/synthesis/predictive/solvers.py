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
    return array if np.all(np.isfinite(array)) else None
