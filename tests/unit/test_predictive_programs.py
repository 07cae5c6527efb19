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


# P, q, A, lower, upper of programs whose rows are far from the size of one; optima from the equations of their bounds
FAR = {
    "bounds far from the origin": (
        [[8.638, 4.069, -0.1479, 0.7271, 1.554], [4.069, 21.69, -2.442, 3.38, 16.16],
         [-0.1479, -2.442, 26.48, -3.734, 2.299], [0.7271, 3.38, -3.734, 1.571, 3.454],
         [1.554, 16.16, 2.299, 3.454, 17.34]],
        [-0.2339, 0.9676, 0.6921, 0.0176, 0.1744],
        [[4.029e-06, -1.807e-05, -2.415e-05, -6.921e-06, 1.668e-06], [-8182.0, -7137.0, 5913.0, -4169.0, -4302.0],
         [-0.07398, -0.2474, 0.2034, 0.3344, 0.2446], [3.304e-05, -4.128e-05, 1.967e-05, -2.292e-06, 2.972e-05]],
        [-7.344, -6377.0, -4.419, -5.772], [-3.244, -6377.0, -3.046, -5.38],
    ),
    "one row of 1e-5": (
        [[20.87, 8.874, -5.354, -8.41], [8.874, 10.58, 10.22, -12.57], [-5.354, 10.22, 41.4, -15.67],
         [-8.41, -12.57, -15.67, 15.39]],
        [0.3768, -0.1308, 2.326, 0.4895],
        [[-203700.0, -50860.0, -154100.0, -88980.0], [-24.5, 23.19, -17.84, -38.53],
         [-4.529e-06, -8.313e-05, 2.748e-06, -3.162e-05], [-30.22, -8.591, -224.4, 949.6]],
        [386300.0, None, -3.59, None], [386300.0, -36.56, -3.577, 2613.0],
    ),
    "an equation of 1e4": (
        [[16.8278, -4.63188, 4.68764, 11.8007, -4.66877], [-4.63188, 30.9646, 3.34731, -24.2731, -0.423252],
         [4.68764, 3.34731, 2.95893, 3.58028, -1.26449], [11.8007, -24.2731, 3.58028, 36.9427, -0.897513],
         [-4.66877, -0.423252, -1.26449, -0.897513, 1.49243]],
        [0.920379, -1.27517, 1.15603, 0.612192, -0.943897],
        [[-0.177708, 0.408076, 0.229022, 0.257229, -0.106089], [-10946.5, 12994.7, 29696.3, -23766.1, 57443.9],
         [-7.0063e-05, 2.92591e-06, -1.9889e-05, -9.90823e-05, 4.26608e-06]],
        [None, 85822.7, -2.82061], [-0.26724, 85822.7, -2.81197],
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", FAR)
def test_programs_far_from_the_origin(name):
    """Solved, and no set of active bounds does better: the multipliers are those of an independent least squares."""
    P, q, A, lower, upper = FAR[name]
    found = quadratic_program(P, q, A, lower, upper)
    assert found.status is Status.SOLVED
    P, q, A = np.array(P), np.array(q), np.array(A)
    low, high = (np.array([none if v is None else v for v in b]) for b, none in ((lower, -np.inf), (upper, np.inf)))
    product, terms = A @ found.x, np.abs(A) @ np.abs(found.x)
    assert np.all(product >= low - 1e-12 * terms) and np.all(product <= high + 1e-12 * terms)
    active = np.flatnonzero((np.abs(product - low) <= 1e-11 * terms) | (np.abs(product - high) <= 1e-11 * terms))
    norms = np.linalg.norm(A[active], axis=1)
    slope = P @ found.x + q
    push = np.linalg.lstsq((A[active] / norms[:, None]).T, -slope, rcond=None)[0]
    assert np.linalg.norm(slope + (A[active] / norms[:, None]).T @ push) <= 1e-10 * np.linalg.norm(P) * np.linalg.norm(
        found.x
    )
    one_sided = low[active] < high[active]
    at_upper = np.abs(product - high)[active] <= 1e-11 * terms[active]
    assert np.all(np.where(at_upper, push, -push)[one_sided] >= 0.0)


def test_a_ray_is_told_from_a_distant_corner():
    """Two rows that are copies leave a ray; turned by a millionth they meet far away, and no ray is told."""
    A = np.array([
        [0.002409124528170691, 0.003339209631509323, 0.00290410845474306, 0.0017633663379615792],
        [-5.328723283916565e-05, 7.906956766012306e-05, 1.9630162579229152e-05, -4.1207030130826094e-06],
        [1136.1610385468339, -17941.289136256037, 22399.220428865672, 16390.270163040273],
        [-0.0008305676432270358, -0.005927432389074303, -8.100705575800138e-05, 0.0010998180120930037],
        [0.07673629842711095, 0.1063617026840663, 0.0925027039665216, 0.05616737697195297],
    ])  # fmt: skip
    q = [2.323147808746772, 0.7685283776585802, -0.5266794635700347, -0.4257074353911484]
    lower = [None, 0.19835090365972072, None, 0.19765562242188117, -0.21752235765414238]
    upper = [1.719864101574416, 0.31109860258925176, -34113.74949555386, 0.19765562242188117, -0.2149086881069497]
    found = quadratic_program(np.zeros((4, 4)), q, A, lower, upper)
    assert found.status is Status.UNBOUNDED
    d = found.certificate
    assert q @ d < 0.0 and np.max(np.abs(A[[1, 3, 4]] @ d) / np.linalg.norm(A[[1, 3, 4]], axis=1)) <= 1e-11
    turned = A.copy()
    turned[0, 3] *= 1.0 + 1e-6
    turned[4, 3] *= 1.0 - 1e-6
    free = np.array([-np.inf if v is None else v for v in lower]), np.array(upper)
    assert not proves_unbounded(np.zeros((4, 4)), np.array(q), turned, free, d)
    assert quadratic_program(np.zeros((4, 4)), q, turned, lower, upper).status is not Status.UNBOUNDED
