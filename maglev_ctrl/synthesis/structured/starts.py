"""Where descents begin: zero, projections of state feedback, random gains; each made stabilising first."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.linalg import solve_continuous_are, solve_continuous_lyapunov, solve_discrete_are, solve_discrete_lyapunov

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.synthesis.structured.loop import Joined, gain_sizes
from maglev_ctrl.synthesis.structured.objective import Objective

_SCREENED = 40


def starting_points(objective: Objective, *, seed: int, count: int) -> Iterator[tuple[str, FloatArray]]:
    """Names and scaled parameters of `count` starts, the same for the same seed.

    Zero and least-squares projections of regulators K C2 ~ -F (weighted by the states' covariance), among them normal
    random gains of many sizes and large gains along one direction, of the sign that moves a pole to the left.
    """
    zero = objective.structure.parameters(objective.structure.base) / objective.size
    fixed: list[tuple[str, FloatArray]] = [("zero", zero)]
    if objective.structure.order == 0:
        for price in (1.0, 1e-2, 1e2):
            for own in (True, False):
                gain = projected_regulator(objective.plants[0], price, own_weights=own)
                if gain is not None:
                    label = f"projected regulator {price:g}{' of the given weights' if own else ''}"
                    fixed.append((label, objective.structure.parameters(gain) / objective.size))
    rng = np.random.default_rng(seed)
    n = objective.size.size
    for k in range(count):
        # Drawn whether used or not, so that start k does not depend on which projections exist.
        spread = 10.0 ** rng.uniform(-1.5, 1.0) * 10.0 ** rng.uniform(-0.5, 0.5, n)
        normal = rng.standard_normal(n)
        if k % 5 == 3 or (k % 5 != 4 and not fixed):
            yield f"random {k}", np.clip(spread * normal, objective.lower, objective.upper)
        elif k % 5 == 4:
            yield f"large gain {k}", _best_large(objective, rng)
        else:
            yield fixed.pop(0)


def _best_large(objective: Objective, rng: np.random.Generator) -> FloatArray:
    """The best of several large gains along one direction each: optima at (nearly) infinite gain are narrow."""
    best, chosen = np.inf, np.zeros(objective.size.size)
    stable = np.inf
    for _ in range(_SCREENED):
        large = 10.0 ** rng.uniform(1.0, 4.0) * _along(objective, rng) + 0.1 * rng.standard_normal(objective.size.size)
        point = np.clip(large, objective.lower, objective.upper)
        growth = objective.growth(point)
        if growth < 0.0:
            value = objective.value(point)[0]
            if value < stable:
                stable, chosen = value, point
        elif not np.isfinite(stable) and growth < best:
            best, chosen = growth, point
    return chosen


def _along(objective: Objective, rng: np.random.Generator) -> FloatArray:
    """Parameters of u v' with random directions, and the sign for which v' C2 B2 u, a fast pole, is negative."""
    plant = objective.plants[0]
    u, v = rng.standard_normal((plant.B2.shape[1],)), rng.standard_normal((plant.C2.shape[0],))
    u, v = u / np.linalg.norm(u), v / np.linalg.norm(v)
    weight = np.sum(objective.structure.basis**2, axis=(1, 2))
    sizes = gain_sizes(objective.plants)
    gain = (
        objective.structure.gain(np.tensordot(objective.structure.basis, np.outer(u, v) * sizes, axes=2) / weight)
        - objective.structure.base
    )
    fast = float(np.trace(plant.B2 @ gain @ plant.C2))
    sign = -1.0 if fast > 0.0 else 1.0
    return np.asarray(sign * np.tensordot(objective.structure.basis, gain, axes=2) / weight / objective.size)


def projected_regulator(plant: Joined, price: float, *, own_weights: bool) -> FloatArray | None:
    """Output feedback nearest to a linear-quadratic regulator: K = -F X C2' (C2 X C2')^-1, X the covariance.

    Levine & Athans, IEEE TAC 15 (1970) 44, first step. None where the regulator does not exist.
    """
    n, m = plant.B2.shape
    size = max(float(np.linalg.norm(plant.A, 2)), 1e-12)
    if own_weights:
        Q = plant.C1.T @ plant.C1
        Q = Q + 1e-6 * max(float(np.linalg.norm(Q, 2)), 1e-12) * np.eye(n)
        R = plant.D12.T @ plant.D12
        R = price * (R + 1e-3 * max(float(np.linalg.norm(R, 2)), float(np.linalg.norm(Q, 2)) * 1e-3) * np.eye(m))
    else:
        Q, R = np.eye(n), price * max(float(np.linalg.norm(plant.B2, 2)) / size, 1e-12) ** 2 * np.eye(m)
    try:
        if plant.dt is None:
            X = solve_continuous_are(plant.A, plant.B2, Q, R)
            F = np.linalg.solve(R, plant.B2.T @ X)
            S = solve_continuous_lyapunov(plant.A - plant.B2 @ F, -(plant.B1 @ plant.B1.T + 1e-6 * np.eye(n)))
        else:
            X = solve_discrete_are(plant.A, plant.B2, Q, R)
            F = np.linalg.solve(R + plant.B2.T @ X @ plant.B2, plant.B2.T @ X @ plant.A)
            S = solve_discrete_lyapunov(plant.A - plant.B2 @ F, plant.B1 @ plant.B1.T + 1e-6 * np.eye(n))
        gain = -np.linalg.lstsq(plant.C2 @ S @ plant.C2.T, plant.C2 @ S @ F.T, rcond=None)[0].T
    except (np.linalg.LinAlgError, ValueError):
        return None
    return np.asarray(gain) if np.all(np.isfinite(gain)) else None
