"""Least cost of damping under a bound on every pole: sequential linear programmes with exact pole gradients.

d lambda / d c_j = -(w^H B_j)(R_j v) / (w^H v) with right and left eigenvectors v, w. Every pole of every vertex is a
constraint, so that the kinks where rightmost poles change roles are seen by the model; a trust region guards against
double poles, where the gradient has no bound. The result is the best point found, not a proven minimum.

A damping ratio is asked for by turning the poles: Re(s) cos(phi) + |Im(s)| sin(phi) <= 0 with sin(phi) the ratio.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linprog

from maglev_ctrl.arrays import ComplexArray, FloatArray
from maglev_ctrl.synthesis.damping.places import DampedFamily

STEPS = 60
PENALTIES = (100.0, 3e3, 1e5)
"""Prices of one unit of excess (scaled): the larger ones where damping moves the worst pole so little that leaving it
outside is cheaper at the smaller."""


@dataclass(frozen=True, eq=False, slots=True)
class Descent:
    """Where one start ended: damping c (k,), its cost, and the worst excess of a pole over the bound (<= 0: kept)."""

    c: FloatArray
    cost: float
    excess: float


@dataclass(frozen=True, slots=True)
class PoleBound:
    """All poles left of `abscissa` (scaled, negative) and of damping ratio `ratio` or more (0: none asked)."""

    abscissa: float
    ratio: float = 0.0


def excesses(family: DampedFamily, c: FloatArray, bound: PoleBound) -> float:
    """How far the worst pole of all vertices is outside the bound; at most 0 where all are inside."""
    values = np.linalg.eigvals(family.loops(c))
    return float(np.max(_outside(np.asarray(values), bound)))


def _outside(values: ComplexArray, bound: PoleBound) -> FloatArray:
    """(v, n), or (v, 2 n) with a damping ratio."""
    right = values.real - bound.abscissa
    if bound.ratio <= 0.0:
        return np.asarray(right)
    turned = values.real * np.sqrt(1.0 - bound.ratio**2) + np.abs(values.imag) * bound.ratio
    return np.concatenate([right, turned], axis=-1)


def pole_gradients(family: DampedFamily, c: FloatArray) -> tuple[ComplexArray, ComplexArray]:
    """All poles (v, n) and their gradients in the dampings (v, n, k).

    Examples
    --------
    >>> from maglev_ctrl.synthesis.damping.places import DampingPlace, damped_family
    >>> from maglev_ctrl.systems import SecondOrderSystem
    >>> mass = SecondOrderSystem.from_matrices([[2.0]], [[0.0]], [[8.0]])
    >>> family = damped_family([mass], [DampingPlace("leg", [1.0])])
    >>> pole_gradients(family, np.array([1.0]))[1][0, 0].real.round(12)  # Re s = -c / (2 m)
    array([-0.25])
    """
    values, right = np.linalg.eig(family.loops(c))
    with np.errstate(all="ignore"):
        try:
            left = np.linalg.inv(right)
        except np.linalg.LinAlgError:
            left = np.linalg.pinv(right)
        slopes = -(left @ family.B) * np.swapaxes(family.R @ right, -1, -2)
    return np.asarray(values), np.nan_to_num(np.asarray(slopes), nan=0.0, posinf=0.0, neginf=0.0)


def _model(family: DampedFamily, c: FloatArray, bound: PoleBound) -> tuple[FloatArray, FloatArray]:
    """Excess of every pole over the bound and its gradient; (rows,), (rows, k)."""
    values, slopes = pole_gradients(family, c)
    gradient = np.asarray(slopes.real)
    if bound.ratio > 0.0:
        turned = slopes.real * np.sqrt(1.0 - bound.ratio**2)
        turned = turned + np.sign(values.imag)[..., None] * slopes.imag * bound.ratio
        gradient = np.concatenate([gradient, turned], axis=-2)
    return _outside(values, bound).ravel(), gradient.reshape(-1, len(c))


def least_cost(
    family: DampedFamily, bound: PoleBound, starts: Iterable[FloatArray], *, steps: int = STEPS
) -> tuple[Descent, ...]:
    """Descents from every start with all poles inside the bound, best first; `family` scaled to order one."""
    found = []
    for start in starts:
        end = _descend(family, bound, np.clip(start, 0.0, family.limit), steps, PENALTIES[0])
        for price in PENALTIES[1:]:
            if end.excess <= 0.0:
                break
            end = _descend(family, bound, np.maximum(end.c, np.clip(start, 0.0, family.limit)), steps, price)
        found.append(end)
    return tuple(sorted(found, key=lambda x: (x.excess > 0.0, x.cost if x.excess <= 0.0 else x.excess)))


def starting_points(family: DampedFamily, count: int, seed: int = 5) -> list[FloatArray]:
    """Equal dampings, each place alone, then random ones over three decades (repeatable)."""
    k = len(family.cost)
    random = np.random.default_rng(seed)
    points = [np.full(k, 0.3), np.full(k, 0.03)]
    if k > 1:
        points += [np.where(np.arange(k) == j, 0.5, 1e-3) for j in range(min(k, 6))]
    while len(points) < count:
        points.append(10.0 ** random.uniform(-2.5, 0.5, k))
    return points[: max(count, 2)]


def trace_bound(family: DampedFamily, rate: float) -> float:
    """No damping cheaper than this decays at `rate`: the poles' real parts sum to the trace of A(c), linear in c.

    trace A_0 - sum c_j R_j B_j <= -n rate at every vertex; infinite where no damping within the limits does it.

    Examples
    --------
    >>> from maglev_ctrl.synthesis.damping.places import DampingPlace, damped_family
    >>> from maglev_ctrl.systems import SecondOrderSystem
    >>> mass = SecondOrderSystem.from_matrices([[2.0]], [[0.0]], [[8.0]])
    >>> trace_bound(damped_family([mass], [DampingPlace("leg", [1.0])]), 0.5)  # c = 2 m rate
    2.0
    """
    push = np.einsum("vnk,vkn->vk", family.B, family.R)
    need = np.trace(family.A, axis1=1, axis2=2) + family.A.shape[-1] * rate
    found = linprog(family.cost, A_ub=-push, b_ub=-need, bounds=_bounds(np.zeros(len(family.cost)), family.limit))
    if found.status == 0 and found.fun is not None:
        return max(float(found.fun), 0.0)
    return np.inf if found.status == 2 else 0.0


def _descend(family: DampedFamily, bound: PoleBound, start: FloatArray, steps: int, price: float) -> Descent:
    c, radius = start, 0.5
    outside, slopes = _model(family, c, bound)
    best: Descent | None = None
    for _ in range(steps):
        excess = float(np.max(outside))
        if excess <= 0.0 and (best is None or family.cost @ c < best.cost):
            best = Descent(c, float(family.cost @ c), excess)
        step, predicted = _linear_step(family, c, outside, slopes, radius, price)
        merit = family.cost @ c + price * max(excess, 0.0)
        if merit - predicted <= 1e-10 * (abs(merit) + 1e-3):
            break
        trial = np.clip(c + step, 0.0, family.limit)
        trial_outside, trial_slopes = _model(family, trial, bound)
        gain = merit - (family.cost @ trial + price * max(float(np.max(trial_outside)), 0.0))
        if gain > 0.1 * (merit - predicted):
            c, outside, slopes = trial, trial_outside, trial_slopes
            radius = min(2.0 * radius, 4.0) if gain > 0.7 * (merit - predicted) else radius
        else:
            radius *= 0.3
        if radius < 1e-9:
            break
    excess = float(np.max(outside))
    if excess > 0.0:
        c, excess = _repaired(family, bound, c, slopes[int(np.argmax(outside))], excess)
    last = Descent(c, float(family.cost @ c), excess)
    return last if best is None or (excess <= 0.0 and last.cost < best.cost) else best


def _repaired(
    family: DampedFamily, bound: PoleBound, c: FloatArray, slope: FloatArray, excess: float
) -> tuple[FloatArray, float]:
    """A hair's breadth outside is rounding of the last linear step: walk back along the worst pole's gradient."""
    if excess > 1e-5:
        return c, excess
    push = -slope / max(float(slope @ slope), 1e-300)
    for factor in (1.5, 3.0, 10.0):
        trial = np.clip(c + factor * excess * push, 0.0, family.limit)
        beyond = excesses(family, trial, bound)
        if beyond <= 0.0:
            return trial, beyond
    return c, excess


def _linear_step(
    family: DampedFamily, c: FloatArray, excess: FloatArray, slopes: FloatArray, radius: float, price: float
) -> tuple[FloatArray, float]:
    """min cost'(c + d) + price t with excess + slope'd <= t inside the trust region; (d, predicted merit)."""
    k = len(c)
    size = radius * np.maximum(c, 0.02)
    rows = np.hstack([slopes, -np.ones((excess.size, 1))])
    found = linprog(
        np.append(family.cost, price), A_ub=rows, b_ub=-excess,
        bounds=[*_bounds(np.maximum(-c, -size), np.minimum(family.limit - c, size)), (0.0, None)], method="highs",
    )  # fmt: skip
    if found.x is None or found.fun is None:
        return np.zeros(k), np.inf
    return np.asarray(found.x[:k]), float(family.cost @ c + found.fun)


def _bounds(low: FloatArray, high: FloatArray) -> list[tuple[float, float | None]]:
    return [(float(a), float(b) if np.isfinite(b) else None) for a, b in zip(low, high, strict=True)]
