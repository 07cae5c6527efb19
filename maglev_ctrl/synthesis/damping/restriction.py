"""Linear matrix inequalities in the dampings themselves: a convex restriction, and the bilinear problem followed.

Second-order vertices: with P = [[P11, eps M], [eps M, M]] and a fixed scalar eps the condition A'P + P A + 2 rate P < 0

    [[-eps (K + K') + 2 rate P11,  P11 - eps D(c) - K' + 2 rate eps M], [.,  2 eps M - D(c) - D(c)' + 2 rate M]] < 0

is linear in P11 and c together, D(c) = C + sum c_j b_j b_j': the velocity block of P is the mass, so that
P B_j = [eps b; b] holds no unknown. K may be circulatory. For one mass eps = rate is exact: c = 2 m rate.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.synthesis.damping.lyapunov import common_lyapunov, solved
from maglev_ctrl.synthesis.damping.places import DampedFamily

STRICT = 1e-7
"""How far (scaled, order one) an inequality is kept from its edge."""
SHARES = (1.001, 1.02, 1.1, 1.3, 1.8, 3.0)
"""Candidates of eps, in parts of the decay rate; small parts of the fastest pole are tried as well."""


def restricted_damping(
    family: DampedFamily, rate: float, speed: float, *, common: bool = False
) -> tuple[FloatArray | None, str]:
    """Least-cost damping of the convex restriction over a list of eps, N s/m; None with the reason where there is none.

    Parameters
    ----------
    family : unscaled, with mass, damping and stiffness
    speed : rad/s, of the fastest pole
    common : one P11 for all vertices (equal masses), so that P proves stability for any variation

    Examples
    --------
    >>> from maglev_ctrl.synthesis.damping.places import DampingPlace, damped_family
    >>> from maglev_ctrl.systems import SecondOrderSystem
    >>> mass = SecondOrderSystem.from_matrices([[2.0]], [[0.0]], [[8.0]])
    >>> family = damped_family([mass], [DampingPlace("leg", [1.0])])
    >>> float(restricted_damping(family, 0.5, 2.0)[0][0].round(1))  # c = 2 m rate
    2.0
    """
    if family.mass is None:
        return None, "the vertices have internal states or are no second-order systems"
    if common and not np.allclose(family.mass, family.mass[0], rtol=1e-12, atol=0.0):
        return None, "the masses differ between vertices"
    best: FloatArray | None = None
    for epsilon in sorted({*(rate * x for x in SHARES), *(speed * x for x in (0.01, 0.03, 0.1, 0.3))}):
        if epsilon < rate or epsilon <= 0.0:
            continue
        c = _at_epsilon(family, rate, speed, epsilon, common)
        if c is not None and (best is None or family.cost @ c < family.cost @ best):
            best = c
    return best, "" if best is not None else "the restricted inequality has no solution"


def _at_epsilon(family: DampedFamily, rate: float, speed: float, epsilon: float, common: bool) -> FloatArray | None:
    import cvxpy as cp

    assert family.mass is not None and family.damping is not None
    assert family.stiffness is not None and family.directions is not None
    size = 1.0 / np.sqrt(np.mean(np.diagonal(family.mass, axis1=1, axis2=2), axis=0))
    scale = np.outer(size, size)
    b = family.directions * size[:, None]
    unit = speed / np.maximum(np.sum(b * b, axis=0), 1e-300)
    n, k = b.shape
    c, r, eps = cp.Variable(k, nonneg=True), rate / speed, epsilon / speed
    constraints: list[Any] = [c[j] <= family.limit[j] / unit[j] for j in range(k) if np.isfinite(family.limit[j])]
    added = sum(c[j] * (np.outer(b[:, j], b[:, j]) * unit[j] / speed) for j in range(k))
    shared = cp.Variable((n, n), symmetric=True)
    for mass, damping, stiffness in zip(family.mass, family.damping, family.stiffness, strict=True):
        M, C, K = mass * scale, damping * scale / speed, stiffness * scale / speed**2
        P11 = shared if common else cp.Variable((n, n), symmetric=True)
        D = C + added
        side = P11 - eps * D - K.T + 2.0 * r * eps * M
        block = cp.bmat([
            [-eps * (K + K.T) + 2.0 * r * P11, side], [side.T, 2.0 * eps * M - D - D.T + 2.0 * r * M]
        ])  # fmt: skip
        weight = np.kron(np.diag([1.0 / max(eps, 1e-6), 1.0]) ** 0.5, np.eye(n))  # the first row is of order eps
        constraints += [weight @ block @ weight << -STRICT * np.eye(2 * n)]
        constraints += [cp.bmat([[P11, eps * M], [eps * M, M]]) >> STRICT * np.eye(2 * n)]
    price = family.cost * unit
    if not solved(cp.Problem(cp.Minimize(price / np.sum(price) @ c), constraints)):
        return None
    return np.asarray(np.clip(c.value * unit, 0.0, family.limit))


def followed_damping(
    family: DampedFamily, rate: float, start: FloatArray, *, steps: int = 25
) -> tuple[FloatArray | None, str]:
    """Least-cost damping with one P for all vertices, by following the bilinear inequality (scaled family).

    Alternates the P of largest margin for the c at hand with a step of P and c together in which the product of both
    steps is left out (Hassibi, How & Boyd, Proc. ACC 1999, 1385), inside a trust region. First the margin is raised
    until it is positive, then the cost is lowered. The end is a local minimum at best.
    """
    T, k = np.ones(family.A.shape[-1]), len(family.cost)
    c = np.clip(start, 0.0, family.limit)
    P, margin = _best_matrix(family, c, rate, T)
    radius = 0.5
    kept: FloatArray | None = c if margin > STRICT else None
    for _ in range(steps):
        if P is None:
            return None, "the inequality for P has no solution"
        step = _joint_step(family, P, c, rate, radius, seek_margin=kept is None)
        if step is None:
            radius *= 0.4
        else:
            trial = np.clip(c + step, 0.0, family.limit)
            next_P, next_margin = _best_matrix(family, trial, rate, T)
            cheaper = family.cost @ (c - trial)
            better = next_margin > margin if kept is None else (next_margin > STRICT and cheaper > 0.0)
            if next_P is not None and better:
                done = kept is not None and cheaper < 1e-4 * family.cost @ c
                c, P, margin = trial, next_P, next_margin
                kept = c if margin > STRICT else None
                if done:
                    break
            else:
                radius *= 0.4
        if radius < 1e-4:
            break
    if kept is None or k == 0:
        return None, f"no common P was found (largest margin {margin:.1e})"
    return kept, ""


def _best_matrix(family: DampedFamily, c: FloatArray, rate: float, T: FloatArray) -> tuple[FloatArray | None, float]:
    """The P of largest margin, a negative one included: the path starts outside."""
    import cvxpy as cp

    loops, n = family.loops(c), len(T)
    P, margin = common_lyapunov(loops, rate, T)
    if P is not None:
        return P, margin
    matrix, t = cp.Variable((n, n), symmetric=True), cp.Variable()
    constraints: list[Any] = [cp.trace(matrix) == n, matrix >> 1e-3 * np.eye(n)]
    constraints += [A.T @ matrix + matrix @ A + 2.0 * rate * matrix << -t * np.eye(n) for A in loops]
    if not solved(cp.Problem(cp.Maximize(t), constraints)):
        return None, -np.inf
    return np.asarray(matrix.value), float(t.value)


def _joint_step(
    family: DampedFamily, P: FloatArray, c: FloatArray, rate: float, radius: float, *, seek_margin: bool
) -> FloatArray | None:
    import cvxpy as cp

    n, k = P.shape[0], len(c)
    dP, d, t = cp.Variable((n, n), symmetric=True), cp.Variable(k), cp.Variable()
    reach = radius * np.maximum(c, 0.02)
    constraints: list[Any] = [cp.trace(dP) == 0.0, P + dP >> 1e-4 * np.eye(n), c + d >= 0.0, cp.abs(d) <= reach]
    constraints += [d[j] <= family.limit[j] - c[j] for j in range(k) if np.isfinite(family.limit[j])]
    constraints += [cp.norm(dP, "fro") <= radius * float(np.linalg.norm(P))]
    for A, B, R in zip(family.loops(c), family.B, family.R, strict=True):
        moved = (P @ B) @ cp.diag(d) @ R
        value = A.T @ (P + dP) + (P + dP) @ A + 2.0 * rate * (P + dP) - moved - moved.T
        constraints.append(value << -t * np.eye(n))
    if seek_margin:
        objective = cp.Maximize(t)
    else:
        constraints.append(t >= 10.0 * STRICT)
        objective = cp.Minimize(family.cost @ d)
    return np.asarray(d.value) if solved(cp.Problem(objective, constraints)) else None
