"""Quadratic programs in odd units: what is called solved, infeasible or unbounded is so, whatever the rows' sizes."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from scipy.sparse import csc_matrix

from maglev_ctrl.errors import Status
from maglev_ctrl.synthesis.predictive.kkt import (
    kkt_residual,
    proves_infeasible,
    proves_infeasible_exactly,
    proves_unbounded,
    termwise_residual,
)
from maglev_ctrl.synthesis.predictive.quadratic import LOOSE, TIGHT, quadratic_data, quadratic_program
from maglev_ctrl.synthesis.predictive.refine import active_set_steps, excluding_rows
from maglev_ctrl.synthesis.predictive.solvers import scaled_program

SEEDS = range(24)


def odd_program(seed):
    """A solvable program of four unknowns whose rows differ by ten decades, and its optimum by all sets of bounds."""
    generator = np.random.default_rng(seed)
    n, m = 4, 6
    L = generator.normal(size=(n, n))
    P, q, A = L @ L.T + 0.05 * np.eye(n), 10.0 * generator.normal(size=n), generator.normal(size=(m, n))
    inside = A @ generator.normal(size=n)
    lower, upper = inside - generator.uniform(0.05, 1.0, m), inside + generator.uniform(0.05, 1.0, m)
    best, least = np.full(n, np.nan), np.inf
    for count in range(n + 1):
        for rows in combinations(range(m), count):
            for sides in np.ndindex(*(2,) * count):
                active = list(rows)
                bound = np.where(np.array(sides, dtype=int) == 0, lower[active], upper[active])
                K = np.block([[P, A[active].T], [A[active], np.zeros((count, count))]])
                x = np.linalg.solve(K, np.concatenate([-q, bound]))[:n]
                value = 0.5 * x @ P @ x + q @ x
                if np.all(A @ x >= lower - 1e-9) and np.all(A @ x <= upper + 1e-9) and value < least:
                    best, least = x, value
    scales = 10.0 ** generator.uniform(-5.0, 5.0, m)
    return P, q, scales[:, None] * A, scales * lower, scales * upper, best


@pytest.mark.parametrize("seed", SEEDS)
def test_rows_of_any_size(seed):
    *program, best = odd_program(seed)
    found = quadratic_program(*program)
    assert found.status is Status.SOLVED and found.residual.largest <= 1e-12
    assert found.x == pytest.approx(best, abs=1e-9 * np.linalg.norm(best))


@pytest.mark.parametrize("seed", SEEDS)
def test_a_point_off_by_little_is_not_solved(seed):
    """A millionth off one active row, or off the whole point: caught whatever the size of the row."""
    P, q, A, lower, upper, _ = odd_program(seed)
    found = quadratic_program(P, q, A, lower, upper)
    judge = quadratic_data(P, q, A, lower, upper).termwise
    assert judge(found.x, found.y).largest <= 1e-12
    for row in np.flatnonzero(found.y):
        bound = upper[row] if found.y[row] > 0.0 else lower[row]
        outward = np.sign(found.y[row]) * A[row] / (A[row] @ A[row])
        assert judge(found.x + 1e-6 * abs(bound) * outward, found.y).primal > TIGHT
        flipped = found.y.copy()
        flipped[row] *= -1.0
        assert judge(found.x, flipped).largest > LOOSE
    assert judge(found.x * (1.0 + 1e-6), found.y).largest > TIGHT
    if np.any(found.y):
        assert judge(found.x, found.y * (1.0 + 1e-6)).largest > TIGHT


def test_a_large_row_does_not_hide_another():
    """A row missed by half its bound beside unknowns of a million: the residual of all terms together says nothing."""
    A, lower, upper = np.diag([1e-5, 1e4]), np.array([10.0, 1.0]), np.array([10.0, 1.0])
    args, x = (np.zeros((2, 2)), np.zeros(2), A, (lower, upper)), np.array([1e6, 1.5e-4])
    assert kkt_residual(*args, x=x, y=np.zeros(2)).largest < 1e-8
    for matrix in (A, csc_matrix(A)):
        assert termwise_residual(*args[:2], matrix, args[3], x=x, y=np.zeros(2)).primal == pytest.approx(0.5, rel=1e-3)


def test_small_terms_of_an_unknown_are_judged_by_themselves():
    P, q = np.diag([1.0, 1e-14]), np.array([-1e5, -1e-14])
    args = (P, q, np.zeros((0, 2)), (np.zeros(0), np.zeros(0)))
    assert termwise_residual(*args, x=np.array([1e5, 0.0]), y=np.zeros(0)).dual == pytest.approx(1.0)
    assert termwise_residual(*args, x=np.array([1e5, 1.0]), y=np.zeros(0)).largest <= 1e-15
    assert quadratic_program(*args[:3], [], []).x == pytest.approx([1e5, 1.0], rel=1e-9)


def test_a_slight_curvature_excuses_no_violation():
    """q / P is large where P is small, and is no measure of the rows."""
    args = (np.array([[1e-12]]), np.ones(1), np.eye(1), (np.array([1.0]), np.array([np.inf])))
    assert termwise_residual(*args, x=np.array([0.999]), y=np.array([-1.0])).primal > 1e-4


def copies(gap):
    """One row twice in other units, with bounds that miss one another by a part of their size, among larger bounds."""
    generator = np.random.default_rng(186)
    L, first = generator.normal(size=(6, 7)), generator.normal(size=7)
    A = np.vstack([4e4 * first, 5e4 * first / 1.1, 3e-5 * generator.normal(size=(2, 7)), generator.normal(size=(2, 7))])
    lower = np.array([4e4, -np.inf, 2.0, -2.2, -1.0, -1.0])
    upper = np.array([np.inf, 5e4 / 1.1 * (1.0 - gap), 2.0, -2.1, np.inf, np.inf])
    return 80.0 * L.T @ L, generator.normal(size=7), A, lower, upper


@pytest.mark.parametrize("gap", [1e-4, 1e-5, 1e-6])
def test_copies_of_a_row_that_exclude_one_another(gap):
    """Missed by a hundred thousandth of the bound, and by 1e-10 of the terms of the rows: there is no solution."""
    P, q, A, lower, upper = copies(gap)
    found = quadratic_program(P, q, A, lower, upper)
    assert found.status is Status.INFEASIBLE
    assert proves_infeasible(A, lower, upper, found.certificate)
    kept = copies(-gap)
    assert quadratic_program(*kept).status is Status.SOLVED
    assert not proves_infeasible(*kept[2:], found.certificate)


def test_the_rows_found_exclude_one_another():
    *_, A, lower, upper = copies(1e-5)
    assert np.flatnonzero(excluding_rows(A, (lower, upper))).tolist() == [0, 1]
    *_, A, lower, upper = copies(-1e-5)
    assert excluding_rows(A, (lower, upper)) is None
    *_, A, lower, upper, _ = odd_program(0)
    assert excluding_rows(A, (lower, upper)) is None


def test_exact_certificates():
    """x + y <= 1, x >= a, y >= b with a + b just above one: a proof without rounding, and none of what is not so."""
    A, y = np.array([[1.0, 1.0], [1.0, 0.0], [0.0, 1.0]]), np.array([1.0, -0.9, -1.1])
    upper, lower = np.array([1.0, np.inf, np.inf]), np.array([-np.inf, 0.75, 0.25 + 2.0**-50])
    assert proves_infeasible_exactly(A, lower, upper, y) == pytest.approx([1.0, -1.0, -1.0], abs=0.0)
    assert proves_infeasible_exactly(csc_matrix(A), lower, upper, y) is not None
    assert proves_infeasible_exactly(A, lower - 2.0**-49, upper, y) is None
    assert proves_infeasible_exactly(A, lower, upper, y * [1.0, 1.0, -1.0]) is None  # no bound on that side
    assert proves_infeasible_exactly(A, lower, upper, y * [1.0, 1.0, 0.0]) is None  # independent rows
    assert proves_infeasible_exactly(A, np.array([0.0, 0.75, 0.3]), upper, -y) is None
    assert proves_infeasible_exactly(np.vstack([A, A]), np.tile(lower, 2), np.tile(upper, 2), np.tile(y, 2)) is None


def test_a_shallow_ray_is_a_ray():
    """The objective falls by 1e-5 of a unit step's cost only, along a strip of rows in odd units: UNBOUNDED."""
    along = np.array([1.0, 2.0, -1.0, 1.5])
    basis = np.linalg.svd(along[None])[2][1:]
    A = np.array([5e-3, 1e-4, 3e4])[:, None] * basis
    slope = basis.T @ [0.3, -0.2, 0.4] - 1e-5 * along
    lower, upper = A @ [4.0, 1.0, 2.0, 3.0] - 0.1, A @ [4.0, 1.0, 2.0, 3.0] + 0.1
    found = quadratic_program(np.zeros((4, 4)), slope, A, lower, upper)
    assert found.status is Status.UNBOUNDED
    assert proves_unbounded(np.zeros((4, 4)), slope, A, (lower, upper), found.certificate)
    capped = quadratic_program(np.zeros((4, 4)), slope, np.vstack([A, along]), [*lower, -1e3], [*upper, 1e3])
    assert capped.status is Status.SOLVED and capped.residual.largest <= TIGHT
    flat = np.outer(basis[0], basis[0])
    assert quadratic_program(flat, slope, A, lower, upper).status is Status.UNBOUNDED


@pytest.mark.parametrize("seed", range(6))
def test_own_active_sets_solve_without_the_solvers(seed):
    P, q, A, lower, upper, best = odd_program(seed)
    data = quadratic_data(P, q, A, lower, upper)
    scaled = scaled_program(data.P, data.q, data.A, data.bounds)
    *_, last = active_set_steps(scaled.P, scaled.q, scaled.A, scaled.bounds, x=np.zeros(4))
    x, y = scaled.restored(*last)
    assert x == pytest.approx(best, abs=1e-6 * np.linalg.norm(best))
    assert data.residual(x, y).dual <= 1e-6


def test_scaling_is_exact():
    P, q, A, lower, upper, _ = odd_program(3)
    data = quadratic_data(P, q, A, lower, upper)
    scaled = scaled_program(data.P, data.q, data.A, data.bounds)
    back = np.diag(1.0 / scaled.rows) @ scaled.A.toarray() @ np.diag(1.0 / scaled.columns)
    assert np.array_equal(back, A) and np.array_equal(scaled.bounds[0] / scaled.rows, lower)
    assert np.array_equal(scaled.cost * scaled.q / scaled.columns, q)
    x, y = np.arange(1.0, 5.0), np.arange(-2.0, 4.0)
    inner = scaled.P @ x + scaled.q + scaled.A.T @ y
    there = scaled.restored(x, y)
    outer = data.P @ there[0] + q + A.T @ there[1]
    assert scaled.columns * outer / scaled.cost == pytest.approx(inner, rel=1e-12, abs=1e-12)
