"""Polish where several smooth pieces meet: steps from a quadratic model of the largest of them.

Each step minimises max_i (f_i + g_i'd) + d'H^-1 d / 2 over the pieces known (active peaks at the point, and pieces seen
at failed trial points); Kiwiel, Methods of Descent for Nondifferentiable Optimization (1985); Apkarian & Noll,
IEEE TAC 51 (2006) 71, for the several peaks.
"""

from __future__ import annotations

import time

import numpy as np

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.synthesis.structured.objective import Objective

_DESCENT = 0.1
_MOST_PIECES = 60


def polish(
    objective: Objective,
    t: FloatArray,
    *,
    inverse: FloatArray | None = None,
    closeness: float = 0.05,
    steps: int = 40,
    deadline: float = np.inf,
    accuracy: float = 1e-6,
) -> tuple[FloatArray, float]:
    """Point and value after descent with several active pieces; never worse than `t`."""
    n = t.size
    H = np.eye(n) if inverse is None or not np.all(np.isfinite(inverse)) else 0.5 * (inverse + inverse.T)
    top = float(np.linalg.eigvalsh(H)[-1])
    H = H / top + 1e-8 * np.eye(n)
    H = H * max(float(np.linalg.norm(t)), 1e-3) ** 2
    pieces = objective.pieces(t, closeness)
    value = pieces[0].value
    if not np.isfinite(value):
        return t, value
    G = np.array([piece.gradient for piece in pieces])
    f = np.array([piece.value for piece in pieces]) - value
    scale = 1.0
    small = 0
    for _ in range(steps):
        if time.monotonic() > deadline:
            break
        weights = simplex_weights(scale * G @ H @ G.T, f)
        d = -scale * (H @ (weights @ G))
        d = np.clip(t + d, objective.lower, objective.upper) - t
        expected = float(np.max(f + G @ d))
        if not expected < -accuracy * 1e-2:
            scale *= 4.0
            small += 1
            if small > 3:
                break
            continue
        trial = objective.pieces(t + d, closeness)
        reached = trial[0].value
        if reached < value + _DESCENT * expected:
            small = small + 1 if value - reached < accuracy else 0
            t, value = t + d, reached
            G = np.array([piece.gradient for piece in trial])
            f = np.array([piece.value for piece in trial]) - value
            scale *= 2.0 if reached < value + 0.5 * expected else 1.0
            if small > 3:
                break
            continue
        if np.isfinite(reached):
            # The piece seen at the trial point, linearised to this one; it must not lie above what is known here.
            seen = [(piece.value - value - float(piece.gradient @ d), piece.gradient) for piece in trial[:3]]
            f = np.append(f, [min(level, 0.0) for level, _ in seen])[-_MOST_PIECES:]
            G = np.vstack([G, [gradient for _, gradient in seen]])[-_MOST_PIECES:]
        scale *= 0.4
        if scale < 1e-14:
            break
    return t, value


def simplex_weights(M: FloatArray, levels: FloatArray) -> FloatArray:
    """Weights p >= 0 of sum 1 that minimise p'M p / 2 - levels'p, M positive semidefinite; by active sets.

    Examples
    --------
    >>> simplex_weights(np.eye(2), np.zeros(2))
    array([0.5, 0.5])
    """
    m = levels.size
    scale = max(float(np.max(np.abs(np.diag(M)))), 1e-300)
    M = M / scale + 1e-12 * np.eye(m)
    levels = levels / scale
    p = np.zeros(m)
    p[int(np.argmin(0.5 * np.diag(M) - levels))] = 1.0
    active = p > 0.0
    for _ in range(20 * m):
        index = np.flatnonzero(active)
        system = np.zeros((index.size + 1, index.size + 1))
        system[:-1, :-1] = M[np.ix_(index, index)]
        system[:-1, -1] = system[-1, :-1] = 1.0
        solved = np.linalg.lstsq(system, np.append(levels[index], 1.0), rcond=None)[0]
        wanted = np.zeros(m)
        wanted[index] = solved[:-1]
        if np.min(wanted[index]) < -1e-12:
            falling = index[wanted[index] < p[index]]
            ratios = p[falling] / (p[falling] - wanted[falling])
            step = float(np.min(ratios))
            p = p + min(step, 1.0) * (wanted - p)
            active &= p > 1e-14
            p[~active] = 0.0
            if not np.any(active):
                break
            continue
        p = np.maximum(wanted, 0.0)
        slack = M @ p - levels + solved[-1]
        worst = int(np.argmin(np.where(active, np.inf, slack)))
        if active[worst] or slack[worst] >= -1e-10 * (1.0 + abs(float(solved[-1]))):
            break
        active[worst] = True
    return np.asarray(p / np.sum(p))
