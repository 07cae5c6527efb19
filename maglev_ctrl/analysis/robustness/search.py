"""The other side of the proof: the smallest box in which an unstable combination of parameters is found.

Corners of the box first, those among them that the slope of each pole points to, then ascent of the growth rate inside
the box from the worst of them, then back along the ray to where the pole crosses the axis; repeated, also from all
neighbours of the best corner, until the box shrinks no more. What is found is certain, that nothing smaller exists is
not. Every count is fixed and every draw seeded: the search ends at the same point on every machine.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from itertools import product

import numpy as np
import scipy.optimize

from maglev_ctrl.analysis.robustness.uncertain_loop import UncertainLoop
from maglev_ctrl.analysis.robustness.work import Work
from maglev_ctrl.arrays import ComplexArray, FloatArray

_ALL_CORNERS = 6
_SOME_CORNERS = 64
_ROUNDS = 12
_STARTS = 4
_SIZES = 9
_NEIGHBOURS = 4
_DRAWN = 3
_GAIN = 1e-4
SEED = 11
_STILL = 1e-9


@dataclass(frozen=True, eq=False, slots=True)
class Crossing:
    """Changes (p,) in units of the spreads that put a pole on the axis at `frequency`, rad/s; `size` the largest."""

    changes: FloatArray
    size: float
    frequency: float


def growth_rates(loop: UncertainLoop, changes: FloatArray) -> FloatArray:
    """Largest real part of the closed-loop poles at changes (N, p); (N,); inf where the loop is ill posed.

    Examples
    --------
    >>> loop = UncertainLoop.from_affine([[-1.0]], [[[1.0]]])
    >>> growth_rates(loop, np.array([[0.0], [1.5]])).tolist()
    [-1.0, 0.5]
    """
    try:
        return np.asarray(np.max(np.linalg.eigvals(loop.state_matrix(changes)).real, axis=-1), dtype=np.float64)
    except np.linalg.LinAlgError:
        if len(changes) == 1:
            return np.full(1, np.inf)
        return np.concatenate([growth_rates(loop, one[None]) for one in changes])


def corners(count: int, *, seed: int = SEED) -> FloatArray:
    """Corners of the box (all of them, or a fixed choice where there are many), and single parameters; (N, p)."""
    if count <= _ALL_CORNERS:
        signs = np.array(list(product((-1.0, 1.0), repeat=count)))
    else:
        signs = np.random.default_rng(seed).choice([-1.0, 1.0], (_SOME_CORNERS, count))
    if count == 1:
        return signs
    return np.vstack([signs, np.eye(count), -np.eye(count)])


def poles_with_slopes(loop: UncertainLoop, changes: FloatArray) -> tuple[ComplexArray, ComplexArray]:
    """Poles (n,) at one point of the box and their slopes (n, p) by every change.

    d lambda = y* B (I - Delta D)^-1 dDelta (I - D Delta)^-1 C x with y* x = 1.
    """
    values, vectors = np.linalg.eig(loop.state_matrix(changes))
    left = np.linalg.pinv(vectors)
    d = loop.diagonal(changes)
    r = d.size
    out = np.linalg.solve(np.eye(r) - loop.D * d, loop.C @ vectors)
    into = np.linalg.solve(np.eye(r) - loop.D.T * d, loop.B.T @ left.T)
    starts = np.concatenate([[0], np.cumsum(loop.blocks)[:-1]]).astype(int)
    return np.asarray(values + 0j), np.asarray(np.add.reduceat(into * out, starts, axis=0).T + 0j)


def fastest_growth(loop: UncertainLoop, start: FloatArray, *, size: float = 1.0) -> tuple[float, FloatArray]:
    """Local ascent of the growth rate from `start` inside the box of half width `size`."""

    def descent(changes: FloatArray) -> tuple[float, FloatArray]:
        try:
            values, slopes = poles_with_slopes(loop, changes)
        except np.linalg.LinAlgError:
            return 0.0, np.zeros_like(changes)
        top = int(np.argmax(values.real))
        return -float(values[top].real), -slopes[top].real

    unit = 1.0 / max(abs(descent(start)[0]), 1e-12)

    def even(changes: FloatArray) -> tuple[float, FloatArray]:
        value, slope = descent(changes)
        return unit * value, unit * slope

    found = scipy.optimize.minimize(
        even, start, jac=True, method="L-BFGS-B", bounds=[(-size, size)] * start.size, options={"maxiter": 25}
    )
    return -float(found.fun) / unit, np.asarray(found.x, dtype=np.float64)


def smallest_crossing(
    loop: UncertainLoop, *, limit: float, safe: float = 0.0, work: Work | None = None, also: FloatArray | None = None,
    seed: int = SEED,
) -> Crossing | None:  # fmt: skip
    """The smallest box found, up to `limit`, with a pole on the axis in it; None where no unstable point was found.

    Parameters
    ----------
    safe : size up to which the box is known to be stable
    work : asked only whether its emergency stop has struck; the search is bounded by counts of its own
    also : changes (p,) known to be unstable, to start from
    seed : of the corners and starts that are drawn

    Examples
    --------
    >>> loop = UncertainLoop.from_affine(np.diag([-1.0, -2.0]), [np.diag([1.0, 0.0]), np.diag([0.0, 1.0])])
    >>> round(smallest_crossing(loop, limit=10.0).size, 9)
    1.0
    """
    budget = Work() if work is None else work
    rng = np.random.default_rng(seed)
    lowest = max(safe, 1e-3 * limit)
    sizes = np.geomspace(lowest, limit, _SIZES) if lowest < limit else np.array([limit])
    directions = np.unique(np.vstack([corners(len(loop.blocks), seed=seed), modal_corners(loop, sizes[::2])]), axis=0)
    best: Crossing | None = None
    if also is not None:
        best = _shrunk(loop, also, limit, safe, None)
    for size in sizes:
        if budget.late() or (best is not None and size > best.size):
            break
        rates = growth_rates(loop, size * directions)
        starts = [size * directions[k] for k in np.argsort(-rates, kind="stable")[:_STARTS]]
        if size == limit:
            starts += [size * one for one in rng.uniform(-1.0, 1.0, (_DRAWN, len(loop.blocks)))]
        if size in (lowest, limit) or np.any(rates >= 0.0):
            for start in starts:
                best = _shrunk(loop, start, size, safe, best)
        if best is not None:
            break
    for _ in range(_ROUNDS):
        if best is None or budget.late():
            break
        before = best.size
        best = _improved(loop, best, directions, safe, rng)
        if best.size > before * (1.0 - _GAIN):
            break
    return best


def modal_corners(loop: UncertainLoop, sizes: FloatArray) -> FloatArray:
    """Corners (N, p) that each pole's slope points to, followed as the box grows through `sizes`.

    The fastest pole at nominal is seldom the first one to cross; so every pole gets a corner of its own.

    Examples
    --------
    >>> loop = UncertainLoop.from_affine(np.diag([-1.0, -9.0]), [np.diag([1.0, 0.0]), np.diag([0.0, -1.0])])
    >>> modal_corners(loop, np.array([0.5])).tolist()
    [[1.0, 1.0], [1.0, -1.0]]
    """
    nominal, slopes = poles_with_slopes(loop, np.zeros(len(loop.blocks)))
    found: list[FloatArray] = []
    for k in np.flatnonzero(nominal.imag >= 0.0):
        pole, slope = nominal[k], slopes[k]
        for size in sizes:
            corner = np.where(slope.real >= 0.0, 1.0, -1.0)
            found.append(corner)
            try:
                poles, by_change = poles_with_slopes(loop, size * corner)
            except np.linalg.LinAlgError:
                break
            nearest = int(np.argmin(np.abs(poles - pole)))
            pole, slope = poles[nearest], by_change[nearest]
    return np.array(found)


def _improved(
    loop: UncertainLoop, best: Crossing, directions: FloatArray, safe: float, rng: np.random.Generator
) -> Crossing:
    """The best crossing after a look at its neighbours: one or two parameters turned round, every pole's slope."""
    size, at, p = best.size, best.changes, best.changes.size
    near = [at * one for one in _flips(p)] + [np.where(np.arange(p) == k, -size, at) for k in range(p)]
    near += [np.where(np.arange(p) == k, size, at) for k in range(p)]
    with suppress(np.linalg.LinAlgError):
        _, slopes = poles_with_slopes(loop, at)
        near += [size * np.where(slope.real >= 0.0, 1.0, -1.0) for slope in slopes]
    points = np.clip(np.vstack([np.array(near), size * directions]), -size, size)
    rates = growth_rates(loop, points)
    starts = [points[k] for k in np.argsort(-rates, kind="stable")[:_NEIGHBOURS]]
    starts += [size * one for one in rng.uniform(-1.0, 1.0, (_DRAWN, p))]
    for start in starts:
        best = _shrunk(loop, start, size, safe, best) or best
    return best


def _flips(count: int) -> FloatArray:
    """Sign changes (N, p) of one parameter or of two."""
    signs = [np.where(np.isin(np.arange(count), (i, j)), -1.0, 1.0) for i in range(count) for j in range(i, count)]
    return np.array(signs)


def _shrunk(loop: UncertainLoop, start: FloatArray, size: float, safe: float, best: Crossing | None) -> Crossing | None:
    """Ascend in the box, go back along the ray to the axis, shrink the box to that, and again."""
    point = start
    for _ in range(_ROUNDS):
        if best is not None:
            size = min(size, best.size)
        point = np.clip(point, -size, size)
        rate, point = fastest_growth(loop, point, size=size)
        if rate < 0.0 or not np.any(point):
            break
        found = first_crossing(loop, point, safe=safe)
        if found is None:
            break
        gained = best is None or found.size < best.size * (1.0 - 1e-6)
        if gained:
            best = found
        else:
            break
        point = found.changes
    return best


def first_crossing(loop: UncertainLoop, point: FloatArray, *, safe: float = 0.0) -> Crossing | None:
    """The first place on the ray from nominal to an unstable `point` where a pole reaches the axis."""
    reach = float(np.max(np.abs(point)))
    low = min(safe / reach, 1.0 - 1e-9)

    def rate(share: float) -> float:
        return float(growth_rates(loop, (share * point)[None])[0])

    shares = np.linspace(low, 1.0, 10)
    rates = growth_rates(loop, shares[:, None] * point)
    unstable = np.flatnonzero(rates >= 0.0)
    if not unstable.size:
        return None
    first = int(unstable[0])
    if first == 0 or not np.isfinite(rates[first]):
        return None
    share = float(scipy.optimize.brentq(rate, shares[first - 1], shares[first], xtol=1e-15, rtol=1e-13))
    changes = share * point
    poles = np.linalg.eigvals(loop.state_matrix(changes))
    return Crossing(changes, float(np.max(np.abs(changes))), float(abs(poles[np.argmax(poles.real)].imag)))


def least_damped(poles: ComplexArray) -> tuple[float, float]:
    """Smallest damping ratio -Re s / |s| of oscillating poles, and that mode's frequency in rad/s; NaN without any.

    Examples
    --------
    >>> least_damped(np.array([-0.1 + 1j, -0.1 - 1j, -5.0]))[1]
    1.0
    """
    oscillating = poles[np.abs(poles.imag) > _STILL * np.max(np.abs(poles), initial=0.0)]
    if not oscillating.size:
        return np.nan, np.nan
    ratios = -oscillating.real / np.abs(oscillating)
    k = int(np.argmin(ratios))
    return float(ratios[k]), float(abs(oscillating[k].imag))


def least_damping_ratios(loop: UncertainLoop, changes: FloatArray) -> FloatArray:
    """Smallest damping ratio of an oscillating mode at changes (N, p); (N,), NaN where no mode oscillates."""
    poles = np.linalg.eigvals(loop.state_matrix(changes))
    return np.array([least_damped(one)[0] for one in poles])


def smallest_damping(loop: UncertainLoop, start: FloatArray, *, size: float = 1.0) -> tuple[float, FloatArray]:
    """Local descent of the least damping ratio from `start` inside the box of half width `size`."""

    def descent(changes: FloatArray) -> tuple[float, FloatArray]:
        poles, slopes = poles_with_slopes(loop, changes)
        moduli = np.abs(poles)
        oscillating = np.abs(poles.imag) > _STILL * np.max(moduli)
        if not np.any(oscillating):
            return 1.0, np.zeros_like(changes)
        ratios = np.where(oscillating, -poles.real / np.maximum(moduli, 1e-300), np.inf)
        k = int(np.argmin(ratios))
        s, slope = poles[k], slopes[k]
        along = np.real(np.conj(s) * slope) / moduli[k]
        return float(ratios[k]), -slope.real / moduli[k] + s.real * along / moduli[k] ** 2

    found = scipy.optimize.minimize(
        descent, start, jac=True, method="L-BFGS-B", bounds=[(-size, size)] * start.size, options={"maxiter": 25}
    )
    return float(found.fun), np.asarray(found.x, dtype=np.float64)
