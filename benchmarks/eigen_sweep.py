"""Cost of an eigenvalue sweep over speed per point against a loop of the python-control library, at equal accuracy.

Ours: the state matrices of the whole sweep and their eigenvalues in one batch, in one thread (processor time) and in
two (wall time; a Python loop gains nothing from a second). Theirs: `control.ss(...).poles()` for each speed, the
matrices given. Batching saves what surrounds the eigenvalues; the eigenvalues themselves are LAPACK's in both, and are
all of our time. The exit status is 0 if the eigenvalues of both agree to 1e-9 of the largest.

The vehicles: the double-L vehicle (3 freedoms) with its corner images, linearised at every speed; and the vehicle with
measured coefficients (6 freedoms), whose magnetic stiffness and damping follow v^2 / (v^2 + w^2) here, because they
were measured at one speed. Run with one thread in BLAS:

    OMP_NUM_THREADS=1 python benchmarks/eigen_sweep.py
"""

from __future__ import annotations

import os
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import control
import numpy as np

from maglev_ctrl.arrays import ComplexArray
from maglev_ctrl.scenario import load
from maglev_ctrl.study.situation import OptionModel, Situation
from maglev_ctrl.systems import SecondOrderSystem

SCENARIOS = Path(__file__).resolve().parents[1] / "scenarios" / "paper"
POINTS = 400
REPEATS = 5
THREADS = 2
LARGEST_DIFFERENCE = 1e-9
TARGET = 8.0
CHARACTERISTIC_SPEED = 10.0  # m/s, w above


def three_freedoms() -> SecondOrderSystem:
    """The double-L vehicle over half to one and a half times its design speed, interpolated between 40 speeds."""
    scenario = load(SCENARIOS / "double_l_corner_image.toml")
    model, design = OptionModel(scenario, None), Situation.of_design(scenario)
    nodes = np.linspace(0.5 * design.speed, 1.5 * design.speed, 40)
    plants = [model.plant(replace(design, speed=float(v))) for v in nodes]
    at = np.linspace(nodes[0], nodes[-1], POINTS)
    place = np.clip(np.searchsorted(nodes, at) - 1, 0, len(nodes) - 2)
    weight = ((at - nodes[place]) / (nodes[place + 1] - nodes[place]))[:, None, None]
    stacks = (np.stack([getattr(p, name) for p in plants]) for name in ("M", "C", "K"))
    M, C, K = (y[place] + weight * (y[place + 1] - y[place]) for y in stacks)
    return SecondOrderSystem.from_matrices(M, C, K)


def six_freedoms() -> SecondOrderSystem:
    """The measured vehicle over 10 to 100 m/s."""
    scenario = load(SCENARIOS / "six_dof.toml")
    design = Situation.of_design(scenario)
    plant = OptionModel(scenario, None).plant(design)
    speeds = np.linspace(10.0, 100.0, POINTS)
    share = speeds**2 / (speeds**2 + CHARACTERISTIC_SPEED**2)
    share *= 1.0 + (CHARACTERISTIC_SPEED / design.speed) ** 2
    return SecondOrderSystem.from_matrices(
        np.broadcast_to(plant.M, (POINTS, 6, 6)), share[:, None, None] * plant.C, share[:, None, None] * plant.K
    )


def ours(system: SecondOrderSystem) -> ComplexArray:
    """Eigenvalues of the whole sweep."""
    return np.asarray(np.linalg.eigvals(system.state_matrix()), dtype=np.complex128)


def ours_in_threads(system: SecondOrderSystem, pool: ThreadPoolExecutor) -> float:
    """Wall seconds with the sweep cut in two."""
    start = time.perf_counter()
    list(pool.map(np.linalg.eigvals, np.array_split(system.state_matrix(), THREADS)))
    return time.perf_counter() - start


def theirs(system: SecondOrderSystem) -> tuple[float, ComplexArray]:
    """Seconds and eigenvalues, speed by speed; the state matrices are not counted."""
    matrices = system.state_matrix()
    n = matrices.shape[-1]
    inputs, outputs, through = np.ones((n, 1)), np.ones((1, n)), np.zeros((1, 1))
    start = time.process_time()
    poles = [control.ss(A, inputs, outputs, through).poles() for A in matrices]
    return time.process_time() - start, np.array(poles, dtype=np.complex128)


def apart(found: ComplexArray, exact: ComplexArray) -> float:
    """Largest distance of an eigenvalue from the nearest one of the other set, relative to the largest of all."""
    distance = np.abs(found[:, :, None] - exact[:, None, :])
    nearest = np.maximum(np.max(np.min(distance, axis=2), axis=1), np.max(np.min(distance, axis=1), axis=1))
    return float(np.max(nearest / np.max(np.abs(exact), axis=1)))


def row(system: SecondOrderSystem, pool: ThreadPoolExecutor) -> tuple[float, float, float, float]:
    """Time per point in s (the best of some runs): ours, ours in threads, theirs; and the largest difference."""
    best_ours, best_threads, best_theirs, difference = np.inf, np.inf, np.inf, 0.0
    for _ in range(REPEATS):
        start = time.process_time()
        found = ours(system)
        best_ours = min(best_ours, time.process_time() - start)
        best_threads = min(best_threads, ours_in_threads(system, pool))
        seconds, poles = theirs(system)
        best_theirs = min(best_theirs, seconds)
        difference = max(difference, apart(found, poles))
    return best_ours / POINTS, best_threads / POINTS, best_theirs / POINTS, difference


def main() -> int:
    """Print the table; the exit status tells whether the accuracy was equal."""
    print(f"{'freedoms':>8} {'states':>6} {'ours':>12} {'two threads':>12} {'control loop':>12} {'ratio':>6} "
          f"{'two threads':>11} {'difference':>10}")  # fmt: skip
    worst = 0.0
    with ThreadPoolExecutor(THREADS) as pool:
        for system in (three_freedoms(), six_freedoms()):
            mine, threads, other, difference = row(system, pool)
            worst = max(worst, difference)
            print(f"{system.M.shape[-1]:8d} {system.state_matrix().shape[-1]:6d} {1e6 * mine:9.1f} us "
                  f"{1e6 * threads:9.1f} us {1e6 * other:9.1f} us {other / mine:6.1f} {other / threads:11.1f} "
                  f"{difference:10.1e}")  # fmt: skip
    print(f"target ratio {TARGET:g}; largest difference {worst:.1e}, allowed {LARGEST_DIFFERENCE:.0e}")
    return 0 if worst <= LARGEST_DIFFERENCE else 1


if __name__ == "__main__":
    sys.exit(main())
