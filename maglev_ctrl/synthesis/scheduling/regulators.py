"""The regulators of the vertices, if one Lyapunov matrix serves them all: any variation, with a regulator's margins.

A law of least guaranteed cost may spend its gain where no disturbance of the model reaches, and keeps no margin there.
The regulators of the vertices are optimal from every state; where the blends of their loops share a Lyapunov matrix
they are the better law, and the inequality that finds gains need not be solved.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.synthesis.damping.lyapunov import common_lyapunov
from maglev_ctrl.synthesis.riccati_batch import riccati_batch
from maglev_ctrl.synthesis.scheduling.segments import scales
from maglev_ctrl.systems.plant import Plant


def shared_regulators(
    plants: Sequence[Plant], pairs: Sequence[tuple[int, int]], rate: float
) -> tuple[FloatArray, FloatArray] | None:
    """Gains K (v, m, n), u = K x, of the vertices' regulators and one P (n, n) for all their blends; None without.

    Parameters
    ----------
    pairs : vertices (i, j) whose products plant i with law j occur in the blends, i = j among them
    rate : 1/s, decay asked of every blend

    Examples
    --------
    >>> plants = [Plant.from_matrices([[a]], [[1.0]], [[1.0]], [[1.0], [0.0]], D12=[[0.0], [1.0]]) for a in (0.0, 1.0)]
    >>> K, P = shared_regulators(plants, [(0, 0), (1, 1)], 0.0)
    >>> K[:, 0, 0].round(3)
    array([-1.   , -2.414])
    """
    A, B, C, D = (np.stack([getattr(p, key) for p in plants]) for key in ("A", "B2", "C1", "D12"))
    C_t, D_t = np.swapaxes(C, -1, -2), np.swapaxes(D, -1, -2)
    if np.min(np.linalg.svd(D, compute_uv=False)) <= 1e-12 * np.max(np.abs(D), initial=0.0):
        return None  # a command without a price has no regulator
    found = riccati_batch(A, B, C_t @ C, D_t @ D, C_t @ D)
    if not np.all(found.solved):
        return None
    K = -found.gain
    loops = np.stack([0.5 * (A[i] + B[i] @ K[j] + A[j] + B[j] @ K[i]) for i, j in pairs])
    T = scales(loops)
    mean = np.mean(found.P, axis=0)  # the cost to go of one vertex often serves its neighbours
    if _falls(loops, mean, rate, T):
        return K, mean
    P, _ = common_lyapunov(loops, rate, T)
    return None if P is None else (K, P)


def _falls(loops: FloatArray, P: FloatArray, rate: float, T: FloatArray) -> bool:
    """Whether x'Px falls at `rate` along every loop with room for rounding, in scaled states."""
    scaled, weight = loops * T / T[:, None], P * np.outer(T, T)
    forward = weight @ scaled
    fall = -(forward + np.swapaxes(forward, -1, -2)) - 2.0 * rate * weight
    size = np.linalg.norm(forward, axis=(-2, -1))
    return bool(np.all(np.linalg.eigvalsh(fall)[:, 0] > 1e-10 * size))
