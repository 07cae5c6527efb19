"""Cost of a Riccati equation per operating point of a grid against `control.lqr`, in one thread, at equal accuracy.

Ours: `riccati_batch` over all points, with NumPy and with the compiled engine of the `fast` extra (processor time, the
best of some runs). Theirs: `control.lqr` point by point on a subsample. The vehicles: 3 and 6 freedoms (n = 6 and 12)
whose stiffness and damping change with speed and gap. The exit status is 0 if the largest residual (relative to the
terms of the equation) is at most 1e-11 and the gains of both agree. Run with one thread in BLAS:

    OMP_NUM_THREADS=1 python benchmarks/care_grid.py
"""

from __future__ import annotations

import os
import sys
import time

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import control
import numpy as np

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.synthesis.riccati_batch import RiccatiBatch, riccati_batch

POINTS = 10_000
SUBSAMPLE = 200
REPEATS = 5
LARGEST_RESIDUAL = 1e-11
LARGEST_DIFFERENCE = 1e-8
TARGETS = {6: 50.0, 12: 15.0}


def grid(freedoms: int) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """State matrices (points, n, n) over speed and gap, input matrix and weights; some freedoms are unstable."""
    rng = np.random.default_rng(freedoms)
    side = round(np.sqrt(POINTS))
    speed, gap = (x.ravel() for x in np.meshgrid(np.linspace(0.1, 2.0, side), np.linspace(0.5, 2.0, side)))
    shape = rng.standard_normal((freedoms, freedoms)) / np.sqrt(freedoms)
    stiffness = 40.0 * np.eye(freedoms) + 10.0 * (shape + shape.T)
    magnetic = 60.0 * np.diag(rng.uniform(0.2, 1.5, freedoms))
    drag = rng.standard_normal((freedoms, freedoms))
    share = speed**2 / (1.0 + speed**2)
    K = stiffness - (np.exp(-gap) * share)[:, None, None] * magnetic
    C = 0.5 * np.eye(freedoms) + (share / (1.0 + speed))[:, None, None] * drag
    A = np.zeros((len(speed), 2 * freedoms, 2 * freedoms))
    A[:, :freedoms, freedoms:], A[:, freedoms:, :freedoms], A[:, freedoms:, freedoms:] = np.eye(freedoms), -K, -C
    B = np.vstack([np.zeros((freedoms, freedoms)), np.eye(freedoms)])
    return A, B, np.diag(np.repeat([100.0, 1.0], freedoms)), 0.1 * np.eye(freedoms)


def ours(data: tuple[FloatArray, ...], backend: str) -> tuple[float, RiccatiBatch]:
    """Seconds per point, the best of some runs, and the solutions."""
    best = np.inf
    for _ in range(REPEATS):
        start = time.process_time()
        found = riccati_batch(*data, backend=backend)
        best = min(best, time.process_time() - start)
    return best / len(data[0]), found


def theirs(data: tuple[FloatArray, ...], found: RiccatiBatch) -> tuple[float, float]:
    """Seconds per point on a subsample, the best of three runs, and the largest difference of the gains."""
    A, B, Q, R = data
    at = np.linspace(0, len(A) - 1, SUBSAMPLE).astype(int)
    best = np.inf
    for _ in range(3):
        start = time.process_time()
        gains = [control.lqr(A[i], B, Q, R)[0] for i in at]
        best = min(best, time.process_time() - start)
    difference = max(
        float(np.linalg.norm(gain - found.gain[i]) / np.linalg.norm(gain)) for i, gain in zip(at, gains, strict=True)
    )
    return best / SUBSAMPLE, difference


def main() -> int:
    """Print the table; the exit status tells whether the accuracy was reached."""
    print(f"{'n':>3} {'backend':>8} {'ours':>10} {'control.lqr':>12} {'ratio':>6} {'target':>6} {'residual':>9} "
          f"{'redone':>6} {'difference':>10}")  # fmt: skip
    accurate = True
    for freedoms in (3, 6):
        data = grid(freedoms)
        riccati_batch(data[0][:100], *data[1:], backend="fast")  # compile
        rows = [(backend, *ours(data, backend)) for backend in ("numpy", "fast")]
        for backend, mine, found in rows:
            other, difference = theirs(data, found)
            residual = float(np.max(found.residual))
            accurate &= bool(np.all(found.solved)) and residual <= LARGEST_RESIDUAL and difference <= LARGEST_DIFFERENCE
            n = 2 * freedoms
            print(f"{n:3d} {backend:>8} {1e6 * mine:7.1f} us {1e6 * other:9.1f} us {other / mine:6.1f} "
                  f"{TARGETS[n]:6.0f} {residual:9.1e} {int(np.sum(found.redone)):6d} {difference:10.1e}")  # fmt: skip
    return 0 if accurate else 1


if __name__ == "__main__":
    sys.exit(main())
