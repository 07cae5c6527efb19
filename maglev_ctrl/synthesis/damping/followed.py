"""One P for all vertices and the dampings together: the bilinear inequality, followed step by step."""

from __future__ import annotations

from typing import Any

import numpy as np

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.synthesis.damping.lyapunov import solved
from maglev_ctrl.synthesis.damping.places import DampedFamily

STRICT = 1e-7
"""How far (scaled, order one) the inequality is kept from its edge."""


def followed_damping(
    family: DampedFamily, rate: float, start: FloatArray, *, steps: int = 25
) -> tuple[FloatArray | None, str]:
    """Least-cost damping with one P for all vertices, by following the bilinear inequality (scaled family).

    Alternates the P of largest margin for the c at hand with a step of P and c together in which the product of both
    steps is left out (Hassibi, How & Boyd, Proc. ACC 1999, 1385), inside a trust region. First the margin is raised
    until it is positive, then the cost is lowered. The end is a local minimum at best.
    """
    steps_of = _Bilinear(family, rate)
    c = np.clip(start, 0.0, family.limit)
    P, margin = steps_of.matrix(c)
    radius = 0.5
    kept: FloatArray | None = c if margin > STRICT else None
    for _ in range(steps):
        if P is None:
            return None, "the inequality for P has no solution"
        step = steps_of.step(P, c, radius, seek_margin=kept is None)
        if step is None:
            radius *= 0.4
        else:
            trial = np.clip(c + step, 0.0, family.limit)
            next_P, next_margin = steps_of.matrix(trial)
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
    if kept is None:
        return None, f"no common P was found (largest margin {margin:.1e})"
    return kept, ""


class _Bilinear:
    """The two problems of a step, built once for a family; loops, P, c and the trust region are numbers in them."""

    def __init__(self, family: DampedFamily, rate: float) -> None:
        import cvxpy as cp

        self._family, count, n, k = family, len(family.A), family.A.shape[-1], len(family.cost)
        self._one, self._shift = np.eye(n), rate * np.eye(n)
        self._loops = [cp.Parameter((n, n)) for _ in range(count)]
        self._P, self._t = cp.Variable((n, n), symmetric=True), cp.Variable()
        constraints: list[Any] = [cp.trace(self._P) == n, self._P >> 1e-5 * self._one, self._t <= 1.0]
        constraints += [A.T @ self._P + self._P @ A << -self._t * self._one for A in self._loops]
        self._matrix = cp.Problem(cp.Maximize(self._t), constraints)

        self._next, self._d, self._s = cp.Variable((n, n), symmetric=True), cp.Variable(k), cp.Variable()
        self._now, self._pushed = cp.Parameter((n, n)), [cp.Parameter((n, k)) for _ in range(count)]
        self._low, self._high, self._radius = cp.Parameter(k), cp.Parameter(k), cp.Parameter(nonneg=True)
        shared: list[Any] = [cp.trace(self._next) == n, self._next >> 1e-5 * self._one]
        shared += [self._d >= self._low, self._d <= self._high, cp.norm(self._next - self._now, "fro") <= self._radius]
        for A, push, R in zip(self._loops, self._pushed, family.R, strict=True):
            moved = push @ cp.diag(self._d) @ R
            shared.append(A.T @ self._next + self._next @ A - moved - moved.T << -self._s * self._one)
        self._raise = cp.Problem(cp.Maximize(self._s), shared)
        self._lower = cp.Problem(cp.Minimize(family.cost @ self._d), [*shared, self._s >= 10.0 * STRICT])

    def _take(self, c: FloatArray) -> None:
        for parameter, A in zip(self._loops, self._family.loops(c), strict=True):
            parameter.value = A + self._shift

    def matrix(self, c: FloatArray) -> tuple[FloatArray | None, float]:
        """The P (trace n) of largest margin for dampings c, a negative margin included: the path starts outside."""
        self._take(c)
        if not solved(self._matrix):
            return None, -np.inf
        return np.asarray(self._P.value), float(self._t.value)

    def step(self, P: FloatArray, c: FloatArray, radius: float, *, seek_margin: bool) -> FloatArray | None:
        """The change of c in the inequality without the product of both changes."""
        self._take(c)
        reach = radius * np.maximum(c, 0.02)
        self._low.value, self._high.value = np.maximum(-c, -reach), np.minimum(self._family.limit - c, reach)
        self._now.value, self._radius.value = P, radius * float(np.linalg.norm(P))
        for parameter, B in zip(self._pushed, self._family.B, strict=True):
            parameter.value = P @ B
        return np.asarray(self._d.value) if solved(self._raise if seek_margin else self._lower) else None
