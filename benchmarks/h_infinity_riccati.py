"""Cost of the H-infinity infimum over state feedback: Riccati bisection against a semidefinite program.

Ours: bisection on gamma with one Schur form of the Hamiltonian each, from a cold start, to 2e-7. Theirs: the
bounded-real inequality in Q > 0 and L = K Q, solved once by Clarabel through cvxpy (no bisection needed), with and
without the time cvxpy takes to build the problem. Random plants with n states, n/2 disturbances, n/4 + 1 commands.
The exit status is 0 if both infima agree to 1e-4. Run with one thread:

    OMP_NUM_THREADS=1 python benchmarks/h_infinity_riccati.py
"""

from __future__ import annotations

import os
import sys
import time

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("RAYON_NUM_THREADS", "1")

import cvxpy
import numpy as np

from maglev_ctrl.synthesis.h_infinity_laws import state_problem
from maglev_ctrl.synthesis.h_infinity_search import infimum
from maglev_ctrl.systems.plant import Plant

STATES = (6, 10, 20)
REPEATS = 7
LARGEST_DIFFERENCE = 1e-4
TARGET = 20.0


def random_plant(n: int) -> Plant:
    """A plant with its largest pole at +0.5, every state and every command weighed."""
    draw = np.random.default_rng(n).standard_normal
    w, u = n // 2, n // 4 + 1
    A = draw((n, n)) / np.sqrt(n)
    A += (0.5 - float(np.max(np.linalg.eigvals(A).real))) * np.eye(n)
    C1 = np.vstack([draw((n // 2, n)), np.zeros((u, n))])
    D12 = np.vstack([np.zeros((n // 2, u)), np.eye(u)])
    return Plant.from_matrices(A, draw((n, w)), draw((n, u)), C1, D12=D12)


def ours(plant: Plant) -> tuple[float, float, int]:
    """Processor seconds (least of some runs), infimum, and number of Schur forms."""
    best, value, trials = np.inf, np.nan, 0
    for _ in range(REPEATS):
        start = time.process_time()
        problem = state_problem(plant)
        found = infimum(problem.trial, floor=problem.floor, scale=problem.scale)
        best = min(best, time.process_time() - start)
        if found is not None:
            value, trials = found.upper, found.trials
    return best, value, trials


def theirs(plant: Plant) -> tuple[float, float, float]:
    """Processor seconds with and without building the problem, and the infimum."""
    n, m = plant.B1.shape
    p = plant.C1.shape[0]
    start = time.process_time()
    Q, L = cvxpy.Variable((n, n), symmetric=True), cvxpy.Variable((plant.B2.shape[1], n))
    level = cvxpy.Variable()
    move, out = plant.A @ Q + plant.B2 @ L, plant.C1 @ Q + plant.D12 @ L
    matrix = cvxpy.bmat([
        [-(move + move.T), -plant.B1, -out.T],
        [-plant.B1.T, level * np.eye(m), -plant.D11.T],
        [-out, -plant.D11, level * np.eye(p)],
    ])  # fmt: skip
    problem = cvxpy.Problem(cvxpy.Minimize(level), [0.5 * (matrix + matrix.T) >> 0, Q >> 0])
    problem.solve(solver="CLARABEL", max_threads=1)
    return time.process_time() - start, float(problem.solver_stats.solve_time), float(level.value)


def main() -> int:
    """Print the table; the exit status tells whether both found the same infimum."""
    print(f"{'states':>6} {'ours':>10} {'trials':>6} {'program':>10} {'solver':>10} {'ratio':>6} {'solver':>6} "
          f"{'infimum':>10} {'difference':>10}")  # fmt: skip
    worst = 0.0
    for n in STATES:
        plant = random_plant(n)
        mine, value, trials = ours(plant)
        whole, solver, other = theirs(plant)
        difference = abs(value - other) / value
        worst = max(worst, difference)
        print(f"{n:6d} {1e3 * mine:7.1f} ms {trials:6d} {1e3 * whole:7.0f} ms {1e3 * solver:7.0f} ms "
              f"{whole / mine:6.1f} {solver / mine:6.1f} {value:10.5f} {difference:10.1e}")  # fmt: skip
    print(f"target ratio {TARGET:g} at {STATES[-1]} states; largest difference {worst:.1e}, "
          f"allowed {LARGEST_DIFFERENCE:.0e}")  # fmt: skip
    return 0 if worst <= LARGEST_DIFFERENCE else 1


if __name__ == "__main__":
    sys.exit(main())
