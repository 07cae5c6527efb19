"""Cost of one step of predictive control with limited commands against OSQP, at no less accuracy.

Ours: the condensed program by active sets, warm from the step before, its optimality conditions checked by other code
in every step (that is in the time); with NumPy alone, with the extra `fast`, and the whole `step` of the law with its
record. Theirs: OSQP on the usual sparse program, set up once, warm, at its tolerances 1e-4 (the peer by which the
target is set) and 1e-6; and a cvxpy program with parameters (DPP), as one would write it by hand.

All see the same states, those of our closed loop, in which limits are active. Errors are the largest difference of the
whole plan from OSQP's at 1e-10, polished, in units of the limit. Processor time in one thread. The exit status is 0 if
our error is at most 1e-6. Run with one thread in BLAS:

    OMP_NUM_THREADS=1 python benchmarks/mpc_step.py
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import cvxpy
import numpy as np
import osqp
from scipy.sparse import block_diag, csc_matrix, eye_array, hstack, kron, vstack

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.synthesis.predictive.condensed import Backend, shifted, solve_box
from maglev_ctrl.synthesis.predictive.controller import PredictiveController
from maglev_ctrl.synthesis.predictive.design import PredictiveDesign, design_predictive
from maglev_ctrl.synthesis.predictive.problem import predictive_problem
from maglev_ctrl.systems.plant import Plant

STEPS = 60
REPEATS = 5
HORIZON = 30
LARGEST_ERROR = 1e-6
TARGET = 20.0


@dataclass
class Row:
    """What one method took and how far it was off."""

    name: str
    seconds: float
    error: float


def vehicle(commands: int) -> Plant:
    """Five masses on springs, lightly damped, with forces on some of them."""
    masses = 5
    K = 2.0 * np.eye(masses) - np.eye(masses, k=1) - np.eye(masses, k=-1)
    A = np.block([[np.zeros((masses, masses)), np.eye(masses)], [-K, -0.02 * K]])
    B = np.zeros((2 * masses, commands))
    for j, mass in enumerate((0, 4, 2)[:commands]):
        B[masses + mass, j] = 1.0
    return Plant.from_matrices(A, B, B, np.eye(2 * masses), name="train of masses")


def design_of(commands: int) -> PredictiveDesign:
    """The predictive design: 10 states, limits on the commands alone."""
    limit = np.ones(commands)
    return design_predictive(
        predictive_problem(
            vehicle(commands), horizon=HORIZON, dt=0.3, Q=np.diag([10.0] * 5 + [1.0] * 5), R=0.1 * np.eye(commands),
            command_limits=(-limit, limit), terminal="cost",
        )
    )  # fmt: skip


def trajectory(design: PredictiveDesign) -> FloatArray:
    """States of the closed loop: a start far out, noise, and gusts of five samples, stronger than the commands."""
    generator = np.random.default_rng(0)
    plant, law = design.problem.plant, PredictiveController(design)
    x, states = 2.0 * generator.normal(size=10), []
    gust = np.zeros(plant.B1.shape[1])
    for k in range(STEPS):
        if k % 5 == 0:
            gust = 1.5 * generator.uniform(-1.0, 1.0, size=gust.size) * (k % 15 == 0)
        states.append(x)
        x = plant.A @ x + plant.B2 @ law.step(x).command + plant.B1 @ gust + 0.02 * generator.normal(size=10)
    return np.array(states)


def sparse_program(design: PredictiveDesign) -> tuple[csc_matrix, csc_matrix]:
    """Cost and rows of the usual sparse form, written independently of the package: plant, then limits."""
    problem, N = design.problem, HORIZON
    A, B = problem.plant.A, problem.plant.B2
    n, n_u = B.shape
    P = block_diag([kron(eye_array(N - 1), problem.Q), design.P, kron(eye_array(N), problem.R)], format="csc")
    plant = hstack([kron(eye_array(N, k=-1), A) - eye_array(N * n), kron(eye_array(N), B)])
    return csc_matrix(P), csc_matrix(vstack([plant, hstack([csc_matrix((N * n_u, N * n)), eye_array(N * n_u)])]))


def by_osqp(design: PredictiveDesign, states: FloatArray, eps: float, polish: bool = False) -> tuple[float, FloatArray]:
    """Seconds a step and plans of OSQP, warm; only the bounds change."""
    P, A = sparse_program(design)
    n = design.problem.plant.A.shape[0]
    limits = np.tile(design.problem.command_upper, HORIZON)
    lower = np.concatenate([np.zeros(HORIZON * n), -limits])
    upper = -lower
    solver = osqp.OSQP()
    solver.setup(P, np.zeros(P.shape[0]), A, lower, upper, verbose=False, eps_abs=eps, eps_rel=eps, polishing=polish,
                 max_iter=200_000)  # fmt: skip
    plans, spent = [], 0.0
    for x in states:
        start = time.process_time()
        lower[:n] = upper[:n] = -design.problem.plant.A @ x
        solver.update(l=lower, u=upper)
        found = solver.solve()
        spent += time.process_time() - start
        plans.append(found.x[HORIZON * n :].copy())
    return spent / len(states), np.array(plans)


def by_cvxpy(design: PredictiveDesign, states: FloatArray) -> tuple[float, FloatArray]:
    """Seconds a step and plans of a cvxpy program with the state as parameter, solved by OSQP at its defaults."""
    problem = design.problem
    n, n_u = problem.plant.B2.shape
    X, U, now = cvxpy.Variable((HORIZON + 1, n)), cvxpy.Variable((HORIZON, n_u)), cvxpy.Parameter(n)
    rows = [X[0] == now, X[1:] == X[:-1] @ problem.plant.A.T + U @ problem.plant.B2.T, cvxpy.abs(U) <= 1.0]
    cost = sum(cvxpy.quad_form(X[k], cvxpy.psd_wrap(problem.Q)) for k in range(1, HORIZON))
    cost += cvxpy.quad_form(X[HORIZON], cvxpy.psd_wrap(design.P)) + 0.1 * cvxpy.sum_squares(U)
    program = cvxpy.Problem(cvxpy.Minimize(cost), rows)
    plans, spent = [], 0.0
    for k, x in enumerate(states):
        start = time.process_time()
        now.value = x
        program.solve(solver=cvxpy.OSQP, warm_start=True)
        if k:  # the first one compiles
            spent += time.process_time() - start
        plans.append(np.ravel(U.value))
    return spent / (len(states) - 1), np.array(plans)


def by_us(design: PredictiveDesign, states: FloatArray, backend: Backend) -> tuple[float, FloatArray]:
    """Seconds a step and plans of the condensed program, check included."""
    n_u = design.problem.plant.B2.shape[1]
    upper = np.tile(design.problem.command_upper, HORIZON) / design.condensed.scale
    solve_box(design.condensed, states[0], -upper, upper, backend=backend)  # compiled before the clock starts
    active, plans = None, []
    start = time.process_time()
    for x in states:
        found = solve_box(design.condensed, x, -upper, upper, active=active, backend=backend)
        active = shifted(found.active, n_u)
        plans.append(found.plan * design.condensed.scale)
    return (time.process_time() - start) / len(states), np.array(plans)


def by_the_law(design: PredictiveDesign, states: FloatArray, backend: Backend) -> tuple[float, FloatArray]:
    """Seconds a step and plans of the law itself, with its record."""
    law = PredictiveController(design, backend=backend)
    start = time.process_time()
    plans = [law.step(x).moves.ravel() for x in states]
    return (time.process_time() - start) / len(states), np.array(plans)


def rows_of(design: PredictiveDesign, states: FloatArray) -> list[Row]:
    """Every method on the same states, the best of some runs."""
    _, exact = by_osqp(design, states, 1e-10, polish=True)
    methods: list[tuple[str, Callable[[], tuple[float, FloatArray]], int]] = [
        ("condensed, numpy", lambda: by_us(design, states, "numpy"), REPEATS),
        ("law's step, numpy", lambda: by_the_law(design, states, "numpy"), REPEATS),
        ("OSQP 1e-4, warm", lambda: by_osqp(design, states, 1e-4), REPEATS),
        ("OSQP 1e-6, warm", lambda: by_osqp(design, states, 1e-6), REPEATS),
        ("cvxpy DPP (OSQP)", lambda: by_cvxpy(design, states), 1),
    ]
    try:
        import numba  # noqa: F401

        methods[1:1] = [("condensed, fast", lambda: by_us(design, states, "fast"), REPEATS)]
        methods[3:3] = [("law's step, fast", lambda: by_the_law(design, states, "fast"), REPEATS)]
    except ImportError:
        pass
    best = {name: Row(name, np.inf, 0.0) for name, _, _ in methods}
    for turn in range(REPEATS):
        for name, method, turns in methods:
            if turn < turns:
                seconds, plans = method()
                row = best[name]
                row.seconds, row.error = min(row.seconds, seconds), max(row.error, float(np.max(np.abs(plans - exact))))
    return list(best.values())


def main() -> int:
    """Print the table; the exit status tells whether we were accurate."""
    worst = 0.0
    for commands in (2, 3):
        design = design_of(commands)
        states = trajectory(design)
        _, plans = by_us(design, states, "numpy")
        active = np.abs(plans) >= 1.0 - 1e-9
        print(f"10 states, {commands} commands, {HORIZON} samples ahead, {STEPS} steps; limits active in "
              f"{np.mean(np.any(active, axis=1)):.0%} of the plans, {np.mean(active):.0%} of the commands")  # fmt: skip
        rows = rows_of(design, states)
        peer = next(row.seconds for row in rows if row.name.startswith("OSQP 1e-4"))
        for row in rows:
            print(f"  {row.name:18s} {1e6 * row.seconds:10.1f} us a step {peer / row.seconds:8.1f} times OSQP 1e-4 "
                  f"   error {row.error:.1e}")  # fmt: skip
        worst = max(worst, *(row.error for row in rows if "numpy" in row.name or "fast" in row.name))
    print(f"target ratio {TARGET:g}; our largest error {worst:.1e} of the limit, allowed {LARGEST_ERROR:.0e}")
    return 0 if worst <= LARGEST_ERROR else 1


if __name__ == "__main__":
    sys.exit(main())
