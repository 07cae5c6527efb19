"""Linear matrix inequalities in the dampings themselves: a convex restriction of the bilinear problem.

Second-order vertices: with P = [[P11, eps M], [eps M, M]] and a fixed scalar eps the condition A'P + P A + 2 rate P < 0

    [[-eps (K + K') + 2 rate P11,  P11 - eps D(c) - K' + 2 rate eps M], [.,  2 eps M - D(c) - D(c)' + 2 rate M]] < 0

is linear in P11 and c together, D(c) = C + sum c_j b_j b_j': the velocity block of P is the mass, so that
P B_j = [eps b; b] holds no unknown. K may be circulatory. For one mass eps = rate is exact: c = 2 m rate.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.synthesis.damping.lyapunov import solved
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
    solve = _Restriction(family, rate, speed, common)
    for epsilon in sorted({*(rate * x for x in SHARES), *(speed * x for x in (0.01, 0.03, 0.1, 0.3))}):
        c = solve(epsilon) if epsilon >= rate and epsilon > 0.0 else None
        if c is not None and (best is None or family.cost @ c < family.cost @ best):
            best = c
    return best, "" if best is not None else "the restricted inequality has no solution"


class _Restriction:
    """The inequality for all vertices, built once; eps is a number in it. Scaled by masses and the fastest pole."""

    def __init__(self, family: DampedFamily, rate: float, speed: float, common: bool) -> None:
        import cvxpy as cp

        assert family.mass is not None and family.damping is not None
        assert family.stiffness is not None and family.directions is not None
        size = 1.0 / np.sqrt(np.mean(np.diagonal(family.mass, axis1=1, axis2=2), axis=0))
        scale = np.outer(size, size)
        b = family.directions * size[:, None]
        self._unit = speed / np.maximum(np.sum(b * b, axis=0), 1e-300)
        self._limit, self._rate, self._speed = family.limit, rate / speed, speed
        n, k = b.shape
        self._c = c = cp.Variable(k, nonneg=True)
        # The first row of the inequality is of order eps: divided by its root, eps enters in these four numbers.
        self._eps, self._root, self._inverse, self._share = (cp.Parameter(nonneg=True) for _ in range(4))
        top = family.limit / self._unit
        constraints: list[Any] = [c[j] <= top[j] for j in range(k) if np.isfinite(top[j])]
        added = sum(c[j] * (np.outer(b[:, j], b[:, j]) * self._unit[j] / speed) for j in range(k))
        shared, r = cp.Variable((n, n), symmetric=True), self._rate
        for mass, damping, stiffness in zip(family.mass, family.damping, family.stiffness, strict=True):
            M, C, K = mass * scale, damping * scale / speed, stiffness * scale / speed**2
            P11 = shared if common else cp.Variable((n, n), symmetric=True)
            D = C + added
            first = -(K + K.T) + 2.0 * self._share * P11
            side = self._inverse * (P11 - K.T) - self._root * (D - 2.0 * r * M)
            last = 2.0 * self._eps * M - D - D.T + 2.0 * r * M
            constraints.append(cp.bmat([[first, side], [side.T, last]]) << -STRICT * np.eye(2 * n))
            constraints.append(cp.bmat([[P11, self._eps * M], [self._eps * M, M]]) >> STRICT * np.eye(2 * n))
        price = family.cost * self._unit
        self._problem = cp.Problem(cp.Minimize(price / np.sum(price) @ c), constraints)

    def __call__(self, epsilon: float) -> FloatArray | None:
        eps = epsilon / self._speed
        self._eps.value, self._root.value = eps, np.sqrt(eps)
        self._inverse.value, self._share.value = 1.0 / np.sqrt(eps), self._rate / eps
        if not solved(self._problem):
            return None
        return np.asarray(np.clip(self._c.value * self._unit, 0.0, self._limit))
