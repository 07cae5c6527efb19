"""Proof that no common quadratic Lyapunov function exists: a multiplier of the inequalities, in rational arithmetic.

If Z_i >= 0, not all zero, have sum(A_i Z_i + Z_i A_i') >= 0, then trace(P sum) >= 0 for every P > 0 while
A_i'P + P A_i < 0 for all i would make it negative (Boyd et al. 1994, section 2.2): no such P exists.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from maglev_ctrl.arrays import FloatArray, read_only
from maglev_ctrl.synthesis.lmi.session import Clock, Solver, solve_problem


@dataclass(frozen=True, eq=False, slots=True)
class Refutation:
    """Multipliers Z (k, n, n), checked in rational arithmetic: no P > 0 serves all k vertices."""

    Z: FloatArray


def refute_quadratic_stability(
    loops: Sequence[FloatArray], *, clock: Clock, solver: Solver = "CLARABEL"
) -> Refutation | None:
    """Multipliers that exclude a common quadratic Lyapunov function, or None where none was found and checked.

    Examples
    --------
    >>> turning = [np.array([[-1.0, -1.0], [1.0, -1.0]]), np.array([[-1.0, -8.0], [0.125, -1.0]])]
    >>> refute_quadratic_stability(turning, clock=Clock(60.0)) is not None
    True
    """
    if clock.left <= 0.0:
        return None
    import cvxpy as cp

    n = loops[0].shape[0]
    unit = max(float(np.linalg.norm(A, 2)) for A in loops)
    Z = [cp.Variable((n, n), symmetric=True) for _ in loops]
    margin, inside = cp.Variable(), cp.Variable()
    total = sum(A / unit @ Z_i + Z_i @ A.T / unit for A, Z_i in zip(loops, Z, strict=True))
    size = sum(cp.trace(Z_i) for Z_i in Z)
    eye = np.eye(n)
    constraints = [total >> margin * eye, size == 1.0, *(Z_i >> inside * eye for Z_i in Z)]
    # Both margins positive is what survives rounding; `inside` may be as small as it likes.
    problem = cp.Problem(cp.Maximize(margin + 1e-3 * inside), [*constraints, inside >= 0.0])
    answer = solve_problem(problem, {f"Z{i}": one for i, one in enumerate(Z)}, clock=clock, solver=solver)
    if not answer.usable:
        return None
    found = [0.5 * (answer.values[f"Z{i}"] + answer.values[f"Z{i}"].T) for i in range(len(Z))]
    # A little of the identity makes rounded multipliers definite; the margin pays for it.
    for lift in (0.0, 1e-12, 1e-10, 1e-8, 1e-6):
        stack = np.array([one + lift * eye for one in found])
        if refutes(stack, loops):
            return Refutation(read_only(stack, name="Z"))
    return None


def refutes(Z: FloatArray, loops: Sequence[FloatArray]) -> bool:
    """Whether the multipliers prove that there is no common Lyapunov matrix, for the numbers as they are stored.

    Examples
    --------
    >>> refutes(np.eye(2)[None], [np.array([[1.0, 0.0], [0.0, 2.0]])])
    True
    >>> refutes(np.eye(2)[None], [-np.eye(2)])
    False
    """
    n = loops[0].shape[0]
    total = [[Fraction(0)] * n for _ in range(n)]
    for A, Z_i in zip(loops, Z, strict=True):
        a, z = _fractions(A), _fractions(Z_i)
        if not np.array_equal(Z_i, Z_i.T) or not _positive(z):
            return False
        for i in range(n):
            for j in range(n):
                total[i][j] += sum((a[i][k] * z[k][j] + z[i][k] * a[j][k] for k in range(n)), Fraction(0))
    return _positive(total)


def _fractions(matrix: FloatArray) -> list[list[Fraction]]:
    return [[Fraction(float(x)) for x in row] for row in matrix]


def _positive(matrix: list[list[Fraction]]) -> bool:
    """Positive definite: every pivot of symmetric elimination is positive."""
    rows = [list(row) for row in matrix]
    n = len(rows)
    for k in range(n):
        if rows[k][k] <= 0:
            return False
        for i in range(k + 1, n):
            factor = rows[i][k] / rows[k][k]
            for j in range(k + 1, n):
                rows[i][j] -= factor * rows[k][j]
    return True
