"""Terminal sets, the condensed solver and the checks of a quadratic program, against one another and by sampling."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import linprog
from scipy.sparse import csc_matrix

from maglev_ctrl.errors import Status
from maglev_ctrl.synthesis.predictive.condensed import (
    CondensedProblem,
    _projected_newton,
    condense,
    shifted,
    solve_box,
)
from maglev_ctrl.synthesis.predictive.controller import PredictiveController
from maglev_ctrl.synthesis.predictive.design import design_predictive
from maglev_ctrl.synthesis.predictive.kkt import box_residual, kkt_residual, proves_infeasible, proves_unbounded
from maglev_ctrl.synthesis.predictive.problem import OutputLimit, predictive_problem
from maglev_ctrl.synthesis.predictive.quadratic import quadratic_program
from maglev_ctrl.synthesis.predictive.terminal import invariance, limit_rows, terminal_set
from maglev_ctrl.synthesis.riccati_discrete import riccati_discrete
from maglev_ctrl.systems.plant import Plant


def chain(masses=3, *, stiffness=1.0, horizon=15, bound=0.5, unstable=0.0, **given):
    """Masses between springs, a force on the first and the last; optionally one with negative stiffness."""
    K = stiffness * (2.0 * np.eye(masses) - np.eye(masses, k=1) - np.eye(masses, k=-1))
    K[0, 0] -= unstable
    A = np.block([[np.zeros((masses, masses)), np.eye(masses)], [-K, -0.05 * K]])
    B = np.zeros((2 * masses, 2))
    B[masses, 0] = B[-1, 1] = 1.0
    plant = Plant.from_matrices(A, B, B, np.eye(2 * masses))
    return predictive_problem(
        plant, dt=0.3, horizon=horizon, Q=np.eye(2 * masses), R=0.1 * np.eye(2),
        command_limits=([-bound, -bound], [bound, 2.0 * bound]), **given,
    )  # fmt: skip


def condensed_of(problem):
    solved = riccati_discrete(problem.plant.A, problem.plant.B2, problem.Q, problem.R, problem.N)
    return condense(problem, solved.P, solved.gain)


# --- terminal sets


@pytest.fixture(scope="module")
def design():
    return design_predictive(chain(output_limits=(OutputLimit("x2", -0.6, 0.4),)))


def test_the_terminal_set_is_invariant_by_its_multipliers(design):
    """Y >= 0, Y rows = rows A_c, Y 1 <= 1: what a linear program says, checked by multiplication."""
    rows, Y = design.terminal.rows, design.terminal.multipliers
    closed = design.problem.plant.A - design.problem.plant.B2 @ design.gain
    assert np.all(Y >= 0.0)
    assert np.max(np.abs(Y @ rows - rows @ closed)) <= 1e-12 * np.max(np.abs(rows))
    assert np.max(np.sum(Y, axis=1)) <= 1.0 + 1e-9
    assert design.terminal.excess <= 1e-9


def test_the_terminal_set_is_invariant_by_sampling(design):
    generator = np.random.default_rng(3)
    rows = design.terminal.rows
    closed = design.problem.plant.A - design.problem.plant.B2 @ design.gain
    limits = limit_rows(design.problem, design.gain)
    for direction in generator.normal(size=(300, rows.shape[1])):
        x = direction / np.max(rows @ direction)  # on the border
        assert design.terminal.holds(x)
        for _ in range(40):
            assert np.max(limits @ x) <= 1.0 + 1e-9
            x = closed @ x
            assert design.terminal.holds(x)


def test_the_terminal_set_is_the_largest(design):
    """Just outside, the regulator meets a limit sooner or later; no row can be left out."""
    generator = np.random.default_rng(4)
    rows = design.terminal.rows
    closed = design.problem.plant.A - design.problem.plant.B2 @ design.gain
    limits = limit_rows(design.problem, design.gain)
    for direction in generator.normal(size=(100, rows.shape[1])):
        x, worst = 1.001 * direction / np.max(rows @ direction), 0.0
        for _ in range(design.terminal.samples + 1):
            worst, x = max(worst, float(np.max(limits @ x))), closed @ x
        assert worst > 1.0
    for i in range(len(rows)):
        others = np.delete(rows, i, axis=0)
        found = linprog(-rows[i], A_ub=others, b_ub=np.ones(len(others)), bounds=(None, None))
        assert found.status == 3 or -found.fun > 1.0 + 1e-10  # unbounded or beyond


def test_a_set_that_is_not_invariant_is_told(design):
    closed = design.problem.plant.A - design.problem.plant.B2 @ design.gain
    assert invariance(limit_rows(design.problem, design.gain), closed)[1] > 1e-3
    assert invariance(design.terminal.rows, 1.2 * closed)[1] > 1e-3


def test_the_ellipsoid_is_inside_every_limit(design):
    generator = np.random.default_rng(5)
    closed = design.problem.plant.A - design.problem.plant.B2 @ design.gain
    limits, E = limit_rows(design.problem, design.gain), design.ellipsoid
    touched = 0.0
    for direction in generator.normal(size=(200, len(E))):
        x = direction / np.sqrt(direction @ E @ direction)
        assert (closed @ x) @ E @ (closed @ x) <= 1.0
        assert design.terminal.holds(x)
        touched = max(touched, float(np.max(limits @ x)))
    assert touched <= 1.0 + 1e-12
    assert np.max(np.einsum("ij,ji->i", limits, np.linalg.solve(E, limits.T))) == pytest.approx(1.0, abs=1e-9)


def test_where_the_set_is_too_big_a_smaller_one_is_stated(monkeypatch):
    problem = chain(masses=2)
    design = design_predictive(replace(problem, terminal="cost"))
    monkeypatch.setattr("maglev_ctrl.synthesis.predictive.terminal._maximal", _second_time())
    found = terminal_set(problem, design.ellipsoid, design.gain)
    assert found.kind == "box inside the ellipsoid" and found.excess <= 1e-9
    limits = limit_rows(problem, design.gain)
    for target in limits:  # inside every limit
        reached = linprog(-target, A_ub=found.rows, b_ub=np.ones(len(found.rows)), bounds=(None, None))
        assert -reached.fun <= 1.0 + 1e-9


def _second_time():
    from maglev_ctrl.synthesis.predictive import terminal

    calls, original = [], terminal._maximal

    def maximal(limits, closed):
        calls.append(1)
        return None if len(calls) == 1 else original(limits, closed)

    return maximal


# --- the condensed solver


@pytest.mark.parametrize("backend", ["numpy", "fast"])
@pytest.mark.parametrize("unstable", [0.0, 3.0])
def test_condensed_plans_are_optimal(unstable, backend):
    if backend == "fast":
        pytest.importorskip("numba")
    problem = chain(unstable=unstable, terminal="cost")
    condensed = condensed_of(problem)
    generator = np.random.default_rng(6)
    size = condensed.scale.size
    lower, upper = -np.ones(size) * 2.0 / 3.0, np.ones(size) * 4.0 / 3.0
    some_active, active = 0, None
    for _ in range(25):
        x = generator.normal(size=problem.plant.A.shape[0]) * 10.0 ** generator.uniform(-1.5, 1.0)
        found = solve_box(condensed, x, lower, upper, active=active, backend=backend)
        again = solve_box(condensed, x, lower, upper)
        reference = quadratic_program(condensed.H, condensed.F @ x, np.eye(size), lower, upper)
        assert reference.status is Status.SOLVED
        assert np.max(np.abs(found.plan - reference.x)) <= 1e-8
        assert np.max(np.abs(found.plan - again.plan)) <= 1e-10
        assert found.residual <= 1e-10
        assert np.array_equal(found.active != 0, (found.plan == lower) | (found.plan == upper))
        some_active += bool(np.any(found.active))
        active = shifted(found.active, 2)
    assert some_active > 10


def test_the_method_that_cannot_cycle_agrees():
    problem = chain(terminal="cost")
    condensed = condensed_of(problem)
    size = condensed.scale.size
    lower, upper = -np.ones(size), np.ones(size)
    for x in np.random.default_rng(7).normal(size=(10, 6)) * 3.0:
        newton, done = np.clip(condensed.free @ x, lower, upper), False
        while not done:
            newton, _, done = _projected_newton(condensed, x, lower, upper, newton)
        assert np.max(np.abs(newton - solve_box(condensed, x, lower, upper).plan)) <= 1e-8


def test_where_active_sets_cycle_newton_takes_over():
    """A Hessian far from diagonal dominance, on which primal-dual active sets run in a circle."""
    generator = np.random.default_rng(8)
    taken = 0
    for _ in range(20):
        n = 30
        L = generator.normal(size=(n, n))
        H = L @ L.T + 1e-3 * np.eye(n)
        condensed = CondensedProblem(H, np.eye(n), np.linalg.inv(H), -np.linalg.inv(H), np.ones(n), H, H)
        x = generator.normal(size=n)
        found = solve_box(condensed, x, -np.ones(n), np.ones(n))
        reference = quadratic_program(H, x, np.eye(n), -np.ones(n), np.ones(n))
        assert np.max(np.abs(found.plan - reference.x)) <= 1e-7
        taken += found.iterations > 8
    assert taken > 0


def test_the_regulators_factors_invert_the_predictions():
    """H from predictions, its inverse from the regulator: two derivations of one matrix, cross weights included."""
    weights = {"Q": np.eye(6), "R": 0.1 * np.eye(2), "N": 0.05 * np.ones((6, 2))}
    base = chain(terminal="cost", unstable=2.5)
    problem = predictive_problem(base.plant, horizon=10, **weights, command_limits=([-1.0, -1.0], [1.0, 1.0]))
    condensed = condensed_of(problem)
    assert np.max(np.abs(condensed.H @ condensed.inverse - np.eye(20))) <= 1e-9
    assert np.max(np.abs(condensed.H @ condensed.free + condensed.F)) <= 1e-9 * np.max(np.abs(condensed.F))


# --- the checks themselves


def test_residuals_catch_what_is_wrong():
    generator = np.random.default_rng(9)
    L = generator.normal(size=(5, 5))
    P, q, A = L @ L.T, generator.normal(size=5), generator.normal(size=(7, 5))
    bounds = (-0.1 * np.ones(7), 0.1 * np.ones(7))
    found = quadratic_program(P, q, A, *bounds)
    args = (P, q, A, bounds)
    assert kkt_residual(*args, x=found.x, y=found.y).largest <= 1e-12
    assert kkt_residual(csc_matrix(P), q, csc_matrix(A), bounds, x=found.x, y=found.y).largest <= 1e-12
    assert kkt_residual(P, -q, A, bounds, x=found.x, y=found.y).dual > 1e-2
    assert kkt_residual(*args, x=found.x, y=-found.y).largest > 1e-2
    assert kkt_residual(*args, x=1.01 * found.x, y=found.y).largest > 1e-4
    assert kkt_residual(*args, x=np.full(5, np.nan), y=found.y).largest == np.inf
    swapped = found.y[[1, 0, 2, 3, 4, 5, 6]] if np.any(found.y[:2]) else found.y[[0, 1, 3, 2, 4, 6, 5]]
    assert kkt_residual(*args, x=found.x, y=swapped).largest > 1e-3


def test_the_box_residual_catches_what_is_wrong():
    H, f = np.array([[2.0, 0.5], [0.5, 1.0]]), np.array([-4.0, 0.3])
    lower, upper = -np.ones(2), np.ones(2)
    x = np.array([1.0, -0.8])
    assert box_residual(H, H @ x + f, lower, upper, x) <= 1e-15
    assert box_residual(H, -(H @ x + f), lower, upper, x) > 0.1
    assert box_residual(H, H @ np.array([0.9, -0.8]) + f, lower, upper, np.array([0.9, -0.8])) > 0.05
    assert box_residual(H, np.full(2, np.nan), lower, upper, x) == np.inf


def test_certificates_are_not_taken_on_trust():
    A, lower, upper = np.eye(2), np.array([1.0, -np.inf]), np.array([np.inf, 0.0])
    assert not proves_infeasible(A, lower, upper, np.array([-1.0, 1.0]))  # A'y is not zero
    assert not proves_infeasible(A, lower, upper, np.array([1.0, 0.0]))  # pushes where there is no bound
    assert not proves_infeasible(A, lower, upper, np.zeros(2))
    flat = np.diag([0.0, 1.0])
    free = (np.full(2, -np.inf), np.full(2, np.inf))
    assert proves_unbounded(flat, np.array([1.0, 0.0]), A, free, np.array([-1.0, 0.0]))
    assert not proves_unbounded(flat, np.array([0.0, 1.0]), A, free, np.array([0.0, -1.0]))  # it bends
    assert not proves_unbounded(flat, np.array([1.0, 0.0]), A, (np.zeros(2), free[1]), np.array([-1.0, 0.0]))


def test_programs_of_every_outcome():
    none = [None, None]
    assert quadratic_program(np.eye(2), [0.0, 0.0], np.eye(2), [1.0, 0.0], [0.0, 1.0]).status is Status.INFEASIBLE
    plane = quadratic_program(np.zeros((2, 2)), [1.0, 1.0], [[1.0, 1.0], [1.0, -1.0]], [2.0, None], [None, None])
    assert plane.status is Status.SOLVED and plane.objective == pytest.approx(2.0, abs=1e-12)
    both = quadratic_program(np.zeros((2, 2)), [-1.0, 0.0], [[0.0, 1.0], [0.0, 1.0]], [1.0, None], [None, 0.0])
    assert both.status is Status.INFEASIBLE and both.objective == np.inf  # the ray alone says nothing
    assert quadratic_program(np.zeros((1, 1)), [0.0], [[1.0]], [-1.0], [1.0]).status is Status.SOLVED
    free = quadratic_program(np.eye(2), [1.0, -2.0], np.zeros((0, 2)), [], [])
    assert free.x == pytest.approx([-1.0, 2.0], abs=1e-12)
    ridge = quadratic_program([[1.0, 1.0], [1.0, 1.0]], [1.0, 1.0], np.eye(2), none, none)
    assert ridge.status is Status.SOLVED and ridge.objective == pytest.approx(-0.5, abs=1e-12)
    valley = quadratic_program([[1.0, 1.0], [1.0, 1.0]], [1.0, 0.0], np.eye(2), none, none)
    assert valley.status is Status.UNBOUNDED and valley.objective == -np.inf


def test_programs_that_are_none():
    with pytest.raises(ValueError, match="positive semidefinite"):
        quadratic_program([[-1.0]], [0.0], [[1.0]], [0.0], [1.0])
    with pytest.raises(ValueError, match="symmetric"):
        quadratic_program([[1.0, 1.0], [0.0, 1.0]], [0.0, 0.0], np.eye(2), [0.0, 0.0], [1.0, 1.0])
    with pytest.raises(ValueError, match="lower: expected shape"):
        quadratic_program([[1.0]], [0.0], [[1.0]], [0.0, 0.0], [1.0])
    with pytest.raises(ValueError, match="A: expected 1 columns"):
        quadratic_program([[1.0]], [0.0], [[1.0, 2.0]], [0.0], [1.0])


# --- what the statements promise


@pytest.mark.parametrize("seed", range(4))
def test_a_plan_is_followed_by_a_plan(seed):
    """Recursive feasibility and a falling cost, on plants in odd units: hard output, command and rate limits."""
    generator = np.random.default_rng(seed)
    n = 3
    A, B = generator.normal(size=(n, n)), generator.normal(size=(n, 1))
    A *= 1.2 / np.max(np.abs(np.linalg.eigvals(A)))
    units, force = 10.0 ** generator.integers(-4, 5, size=n), 10.0 ** generator.integers(-2, 4)
    A, B = A * units[:, None] / units, B * units[:, None] / force
    plant = Plant.from_matrices(A, B, B, np.diag(1.0 / units), dt=0.1, performance=("z1", "z2", "z3"))
    problem = predictive_problem(
        plant, horizon=10, Q=np.diag(1.0 / units**2), R=[[0.1 / force**2]], command_limits=([-force], [force]),
        rate_limits=[0.8 * force], output_limits=(OutputLimit("z1", -1.0, 0.7),),
    )  # fmt: skip
    design = design_predictive(problem)
    assert design.synthesis.controllers, design.synthesis.message
    planned = 0
    for start in generator.normal(size=(4, n)) * [0.3, 0.7, 0.7]:
        x, law, last = start * units, PredictiveController(design), np.inf
        for _ in range(20):
            record = law.step(x)
            assert record.status in (Status.SOLVED, Status.INFEASIBLE)
            if record.fallback:
                assert last == np.inf  # never once there was a plan
            else:
                cost = plan_cost(design, record)
                assert cost <= last * (1.0 + 1e-7) + 1e-9
                last, planned = cost, planned + 1
                assert abs(x[0] / units[0]) <= 1.0 + 1e-6 or last == np.inf or planned == 1
            x = A @ x + B @ record.command
    assert planned > 20


def plan_cost(design, record):
    stages = zip(record.states[:-1], record.moves, strict=True)
    total = sum(x @ design.problem.Q @ x + u @ design.problem.R @ u for x, u in stages)
    return float(total + record.states[-1] @ design.P @ record.states[-1])


def test_hock_schittkowski_268():
    """Optimum zero at (1, 2, -1, 3, -4) as the difference of terms of 14463 (Schittkowski 1987, problem 268)."""
    D = [[10197, -12454, -1013, 1948, 329], [-12454, 20909, -1733, -4914, -186], [-1013, -1733, 1755, 1089, -174],
         [1948, -4914, 1089, 1515, -22], [329, -186, -174, -22, 27]]  # fmt: skip
    A = [[-1, -1, -1, -1, -1], [10, 10, -3, 5, 4], [-8, 1, -2, -5, 3], [8, -1, 2, 5, -3], [-4, -2, 3, -5, 1]]
    slope = -2.0 * np.array([-9170.0, 17099.0, -2271.0, -4336.0, -43.0])
    found = quadratic_program(2.0 * np.array(D), slope, A, [-5, 20, -40, 11, -30], [None] * 5)
    assert found.status is Status.SOLVED
    assert found.x == pytest.approx([1.0, 2.0, -1.0, 3.0, -4.0], abs=1e-9)
    assert found.objective + 14463.0 == pytest.approx(0.0, abs=1e-9)


def test_hock_schittkowski_118():
    """Fifteen variables, 29 rows and bounds on all, a vertex with many active: 664.82045 (problem 118)."""
    P, q = np.diag(np.tile([2e-4, 2e-4, 3e-4], 5)), np.tile([2.3, 1.7, 2.2], 5)
    rows = [np.eye(15)[3 * k + j] - np.eye(15)[3 * k + j - 3] for k in range(1, 5) for j in range(3)]
    rows += [np.repeat(np.eye(5)[k], 3) for k in range(5)]
    lower = [-7.0, -7.0, -7.0] * 4 + [60.0, 50.0, 70.0, 85.0, 100.0] + [8.0, 43.0, 3.0] + [0.0] * 12
    upper = [6.0, 7.0, 6.0] * 4 + [None] * 5 + [21.0, 57.0, 16.0] + [90.0, 120.0, 60.0] * 4
    found = quadratic_program(P, q, np.vstack([rows, np.eye(15)]), lower, upper)
    assert found.status is Status.SOLVED
    assert found.objective == pytest.approx(664.82045, abs=5e-9 * 664.0)
