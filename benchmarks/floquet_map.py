"""Cost of a stability map per point against a general-purpose integrator, at equal accuracy.

Ours: `resonance_map` over 60 speeds and 100 depths. Theirs: the matrix differential equation by scipy's DOP853 at
rtol 1e-9 and the eigenvalues of its end value, at a few points of the same map. Both are compared with a solution at
rtol 1e-12; a row counts only if our leading multiplier is right to 1e-8. Run with one thread:

    OMP_NUM_THREADS=1 python benchmarks/floquet_map.py
"""

from __future__ import annotations

import os
import sys
import time

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from scipy.integrate import solve_ivp

from maglev_ctrl.analysis.depth_surrogate import depth_surrogate
from maglev_ctrl.analysis.resonance_map import resonance_map
from maglev_ctrl.arrays import FloatArray

SIZES = (4, 6, 12, 20)
SPEEDS, DEPTHS = 60, 100
SAMPLES = 4
LARGEST_ERROR = 1e-8


def system(n: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """A chain of n/2 damped masses (1 to 8 Hz), the stiffness of the outer ones modulated with a phase between them."""
    half = n // 2
    frequency = 2.0 * np.pi * np.linspace(1.0, 8.0, half)
    coupling = 0.1 * np.diag(frequency[1:] * frequency[:-1], 1) if half > 1 else np.zeros((half, half))
    stiffness = np.diag(frequency**2) - coupling - coupling.T
    A_0 = np.zeros((n, n))
    A_0[:half, half:] = np.eye(half)
    A_0[half:, :half], A_0[half:, half:] = -stiffness, -np.diag(0.04 * frequency)
    cosine, sine = np.zeros((1, n, n)), np.zeros((1, n, n))
    for mass, angle in ((0, 0.0), (half - 1, 0.9)):
        cosine[0, half + mass, mass] -= frequency[mass] ** 2 * np.cos(angle)
        sine[0, half + mass, mass] -= frequency[mass] ** 2 * np.sin(angle)
    return A_0, cosine, sine


def integrated(A_0: FloatArray, cosine: FloatArray, sine: FloatArray, frequency: float, rtol: float) -> complex:
    """Leading multiplier by DOP853 over one period."""
    n = len(A_0)

    def rate(t: float, x: FloatArray) -> FloatArray:
        A = A_0 + cosine[0] * np.cos(frequency * t) + sine[0] * np.sin(frequency * t)
        return np.asarray((A @ x.reshape(n, n)).ravel())

    end = solve_ivp(rate, (0.0, 2 * np.pi / frequency), np.eye(n).ravel(), method="DOP853", rtol=rtol, atol=1e-3 * rtol)
    values = np.linalg.eigvals(end.y[:, -1].reshape(n, n))
    return complex(values[int(np.argmax(np.abs(values)))])


def apart(found: complex, exact: complex) -> float:
    """Relative distance of a multiplier, or of its conjugate, from the exact one."""
    return min(abs(found - exact), abs(found.conjugate() - exact)) / abs(exact)


def row(n: int) -> tuple[float, float, float, float]:
    """Time per point ours and theirs in s, and the largest relative errors of the leading multiplier."""
    A_0, cosine, sine = system(n)
    speeds, depths = np.linspace(20.0, 150.0, SPEEDS), np.linspace(0.0, 0.4, DEPTHS)
    omega = 2.0 * np.pi * speeds / 25.0
    constant, cosines, sines = (np.broadcast_to(m, (SPEEDS, *m.shape)) for m in (A_0, cosine, sine))
    start = time.process_time()
    atlas = resonance_map(constant, cosines, sines, omega, depths, parameter=speeds, seeds=False)
    ours = (time.process_time() - start) / (SPEEDS * DEPTHS)
    theirs, our_error, their_error = 0.0, 0.0, 0.0
    for k in range(SAMPLES):
        v, e = int((k + 0.5) / SAMPLES * SPEEDS), int(((k + 1) * 0.618 % 1.0) * DEPTHS)
        modulated = A_0, depths[e] * cosine, depths[e] * sine, float(omega[v])
        start = time.process_time()
        found = integrated(*modulated, 1e-9)
        theirs += (time.process_time() - start) / SAMPLES
        exact = integrated(*modulated, 1e-12)
        column = depth_surrogate(A_0, cosine, sine, frequency=float(omega[v]), depth_max=float(depths[-1]))
        same = complex(column.leading(depths[e : e + 1])[0])
        our_error = max(our_error, apart(same, exact), abs(atlas.spectral_radius[v, e] - abs(exact)) / abs(exact))
        their_error = max(their_error, apart(found, exact))
    return ours, theirs, our_error, their_error


def main() -> int:
    """Print the table; the exit status tells whether the accuracy was equal."""
    print(f"{'states':>6} {'ours':>12} {'DOP853':>12} {'ratio':>8} {'our error':>10} {'their error':>11}")
    worst = 0.0
    for n in SIZES:
        ours, theirs, our_error, their_error = row(n)
        worst = max(worst, our_error)
        print(f"{n:6d} {1e6 * ours:9.1f} us {1e6 * theirs:9.0f} us {theirs / ours:8.0f} "
              f"{our_error:10.1e} {their_error:11.1e}")  # fmt: skip
    print(f"largest error of our multipliers {worst:.1e}, allowed {LARGEST_ERROR:.0e}")
    return 0 if worst <= LARGEST_ERROR else 1


if __name__ == "__main__":
    sys.exit(main())
