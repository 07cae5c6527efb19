"""Monodromy matrices of many periodic systems at once, each over the same depths of modulation.

The Taylor recurrences of `taylor` and `segments` in dimensionless time: with the segment as unit of time the factors of
the modulation depend on the number of segments alone, so systems with different matrices and frequencies share every
step and differ only in the matrices that are multiplied. Systems are grouped by the segments they need.
"""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.kernels.segments import Monomials, count_monomials, degree_for, monomials, trigonometric
from maglev_ctrl.kernels.taylor import TaylorPlan, taylor_plan, tree_product

_ALIKE = 2.0  # systems of one group differ by at most this in (norm times period)
_TRIES = 3  # segment counts tried, each twice the one before
_PER_OCTAVE = 32  # norms are rounded up to this many steps per factor of two, so that plans can be used again
_HISTORY = 1 << 17  # numbers per Taylor order kept at once, so that the history stays in the cache


@dataclass(frozen=True, eq=False, slots=True)
class ManyMonodromies:
    """`matrices` (B, D, n, n) and a bound on the relative rounding and truncation error of each system, (B,)."""

    matrices: FloatArray
    error: FloatArray


def monodromy_many(
    A_0: FloatArray, A_cos: FloatArray, A_sin: FloatArray, *, frequency: FloatArray, depths: FloatArray | None = None,
    tolerance: float = 1e-14, threads: int = 1,
) -> ManyMonodromies:  # fmt: skip
    """Propagators over one period of x' = [A_0 + depth sum_k (A_cos[k] cos k W t + A_sin[k] sin k W t)] x.

    Parameters
    ----------
    A_0 : (B, n, n); A_cos, A_sin : (B, H, n, n) at unit depth, 1/s
    frequency : (B,) rad/s
    depths : (D,), the same for all systems; depth 1 when left out
    tolerance : largest truncation error per segment
    threads : that share the work

    Examples
    --------
    >>> A_0 = np.array([[[0.0, 1.0], [-1.0, 0.0]]] * 2)
    >>> none = np.zeros((2, 1, 2, 2))
    >>> found = monodromy_many(A_0, none, none, frequency=np.array([1.0, 2.0])).matrices[:, 0]
    >>> np.round(found, 12).tolist() == [[[1.0, 0.0], [0.0, 1.0]], [[-1.0, 0.0], [0.0, -1.0]]]
    True
    """
    levels = np.ones(1) if depths is None else np.asarray(depths, dtype=np.float64)
    omega = np.asarray(frequency, dtype=np.float64)
    count, n = len(A_0), A_0.shape[-1]
    period = (2.0 * np.pi / omega)[:, None, None]
    constant = A_0 * period
    cosine, sine = A_cos * period[:, None], A_sin * period[:, None]
    norm_0 = np.linalg.norm(constant, 2, axis=(1, 2))
    norms = np.linalg.norm(cosine, 2, axis=(2, 3)) + np.linalg.norm(sine, 2, axis=(2, 3))
    deepest = float(np.max(np.abs(levels), initial=0.0))
    size = norm_0 + deepest * np.sum(norms, axis=1)
    result, error = np.empty((count, len(levels), n, n)), np.empty(count)

    def work(group: NDArray[np.intp]) -> None:
        worst = deepest * np.max(norms[group], axis=0)
        plan, basis = _cheapest(
            _rounded_up(float(np.max(norm_0[group]))), tuple(_rounded_up(float(one)) for one in worst),
            levels=len(levels), n=n, tolerance=tolerance,
        )  # fmt: skip
        step = 1.0 / plan.segments
        terms = len(basis.powers) if basis is not None else len(levels) * plan.segments
        width = max(1, _HISTORY // (n * n * terms))
        for first in range(0, len(group), width):
            part = group[first : first + width]
            scaled = constant[part] * step, cosine[part] * step, sine[part] * step
            if basis is not None:
                factors = _expanded(*scaled, basis, levels=levels, plan=plan)
            else:
                factors = _one_by_one(*scaled, levels=levels, plan=plan)
            result[part] = tree_product(factors)
        error[group] = plan.segments * plan.truncation + 1e-14 * np.sqrt(plan.segments)

    groups = _groups(size)
    if threads > 1 and len(groups) > 1:
        told = np.geterr()  # which a thread does not inherit

        def quietly(group: NDArray[np.intp]) -> None:
            with np.errstate(**told):
                work(group)

        with ThreadPoolExecutor(max_workers=threads) as pool:
            list(pool.map(quietly, reversed(groups)))  # the longest first
    else:
        for one in groups:
            work(one)
    return ManyMonodromies(result, error)


def _rounded_up(norm: float) -> float:
    """A norm rounded up a little: a plan made for more is good for less."""
    if not 0.0 < norm < math.inf:
        return norm
    return max(norm, float(2.0 ** (math.ceil(math.log2(norm) * _PER_OCTAVE) / _PER_OCTAVE)))


@lru_cache(maxsize=4096)
def _cheapest(
    norm_0: float, norms: tuple[float, ...], *, levels: int, n: int, tolerance: float
) -> tuple[TaylorPlan, Monomials | None]:
    """Segments and order by counted multiplications: shorter segments need fewer terms of the modulation.

    Norms are those of the generator times the period, the modulation at its largest depth. None instead of monomials:
    integrate one by one.
    """
    found: list[tuple[float, TaylorPlan, int | None]] = []
    unknowns, least, strength = 2 * len(norms), 1, np.array(norms)
    for _ in range(_TRIES):
        plan = taylor_plan(norm_0, strength, frequency=2.0 * np.pi, tolerance=tolerance, min_segments=least)
        jobs = levels * plan.segments
        choices: list[tuple[float, int | None]] = [(float(plan.order * jobs * (1 + unknowns) * n + jobs * n), None)]
        degree = degree_for(
            np.array([[norm_0]]), strength[:, None, None], np.zeros((len(norms), 1, 1)), step=1.0 / plan.segments,
            depth=1.0, tolerance=0.5 * plan.truncation,
        )  # fmt: skip
        if degree is not None:
            terms = count_monomials(unknowns, degree)
            choices.append((float(plan.order * terms * (1 + unknowns) * n + jobs * (terms + n)), degree))
        cost, chosen = min(choices, key=lambda choice: choice[0])
        found.append((cost, plan, chosen))
        least = 2 * plan.segments
    _, plan, chosen = min(found, key=lambda one: one[0])
    return plan, None if chosen is None else monomials(unknowns, chosen)


def _groups(size: FloatArray) -> list[NDArray[np.intp]]:
    """Indices of systems that need about as many segments as one another."""
    order = np.argsort(size, kind="stable")
    groups: list[list[int]] = []
    for k in order:
        if groups and size[k] <= _ALIKE * max(size[groups[-1][0]], 4.0):
            groups[-1].append(int(k))
        else:
            groups.append([int(k)])
    return [np.array(group, dtype=np.intp) for group in groups]


def _expanded(
    A_0: FloatArray, A_cos: FloatArray, A_sin: FloatArray, basis: Monomials, *, levels: FloatArray, plan: TaylorPlan
) -> FloatArray:
    """Segment propagators (B, D, S, n, n) as values of one polynomial in the modulation per system."""
    count, n = len(A_0), A_0.shape[-1]
    coefficients = _segment_coefficients(A_0, A_cos, A_sin, basis, segments=plan.segments, order=plan.order)
    angle = 2.0 * np.pi * np.arange(plan.segments)[:, None] / plan.segments * np.arange(1, A_cos.shape[1] + 1)
    turning = np.stack([np.cos(angle), np.sin(angle)], axis=-1).reshape(plan.segments, -1)
    jobs = len(levels) * plan.segments
    values = basis.values((levels[:, None, None] * turning).reshape(jobs, -1))
    joined = np.matmul(values, coefficients.reshape(count, len(basis.powers), -1))
    return np.asarray(joined.reshape(count, len(levels), plan.segments, n, n))


def _segment_coefficients(
    A_0: FloatArray, A_cos: FloatArray, A_sin: FloatArray, basis: Monomials, *, segments: int, order: int
) -> FloatArray:
    """`segments.segment_coefficients` for many systems, their time in units of the segment: (B, monomials, n, n)."""
    many, harmonics, n = A_cos.shape[:3]
    read = np.nonzero(np.any((A_cos != 0.0) | (A_sin != 0.0), axis=(0, 1, 2)))[0]
    rows, count = len(read), len(basis.powers)
    stacked = np.concatenate(
        [A_0, *(m[:, k][:, :, read] for k in range(harmonics) for m in (A_cos, A_sin))], axis=2
    )  # fmt: skip
    # only monomials below the top degree feed others; the column block behind them stands for "no parent" and is zero
    feeding = int(np.max(basis.parents, initial=-1)) + 1
    cosines, sines = trigonometric(2.0 * np.pi / segments * np.arange(1.0, harmonics + 1.0), order)
    history = np.zeros((order + 1, many, rows, feeding * n))
    current = np.zeros((many, n, count, n))
    current[:, :, 0] = np.eye(n)
    total = current.copy()
    combined = np.zeros((many, stacked.shape[2], count, n))
    padded = np.zeros((2, many, rows, feeding + 1, n))
    for m in range(order):
        history[order - m] = current[:, read, :feeding].reshape(many, rows, feeding * n)
        combined[:, :n] = current
        newest = history[order - m :].reshape(m + 1, -1)
        for k in range(harmonics):
            padded[0, :, :, :-1] = (cosines[k, : m + 1 : 2] @ newest[::2]).reshape(many, rows, feeding, n)
            if m:
                padded[1, :, :, :-1] = (sines[k, 1 : m + 1 : 2] @ newest[1::2]).reshape(many, rows, feeding, n)
            even, odd = padded
            by_cosine, by_sine = basis.parents[2 * k], basis.parents[2 * k + 1]
            at = n + 2 * k * rows
            np.subtract(even[:, :, by_cosine], odd[:, :, by_sine], out=combined[:, at : at + rows])
            np.add(odd[:, :, by_cosine], even[:, :, by_sine], out=combined[:, at + rows : at + 2 * rows])
        np.matmul(stacked, combined.reshape(many, stacked.shape[2], -1), out=current.reshape(many, n, -1))
        current *= 1.0 / (m + 1)
        total += current
    return np.ascontiguousarray(total.transpose(0, 2, 1, 3))


def _one_by_one(
    A_0: FloatArray, A_cos: FloatArray, A_sin: FloatArray, *, levels: FloatArray, plan: TaylorPlan
) -> FloatArray:
    """Segment propagators (B, D, S, n, n) with every segment and depth integrated for itself."""
    many, harmonics, n = A_cos.shape[:3]
    segments, order = plan.segments, plan.order
    jobs = len(levels) * segments
    read = np.nonzero(np.any((A_cos != 0.0) | (A_sin != 0.0), axis=(0, 1, 2)))[0]
    rows = len(read)
    stacked = np.concatenate(
        [A_0, *(m[:, k][:, :, read] for k in range(harmonics) for m in (A_cos, A_sin))], axis=2
    )  # fmt: skip
    angle = np.arange(1.0, harmonics + 1.0)[:, None] * (2.0 * np.pi * np.arange(segments) / segments)
    first = np.repeat((levels[:, None] * np.cos(angle)[:, None]).reshape(harmonics, jobs), n, axis=1)
    second = np.repeat((levels[:, None] * np.sin(angle)[:, None]).reshape(harmonics, jobs), n, axis=1)
    cosines, sines = trigonometric(2.0 * np.pi / segments * np.arange(1.0, harmonics + 1.0), order)
    history = np.zeros((order + 1, many, rows, jobs * n))
    current = np.array(np.broadcast_to(np.tile(np.eye(n), (1, jobs)), (many, n, jobs * n)))
    total = current.copy()
    combined = np.empty((many, stacked.shape[2], jobs * n))
    for m in range(order):
        history[order - m] = current[:, read]
        combined[:, :n] = current
        newest = history[order - m :].reshape(m + 1, -1)
        for k in range(harmonics):
            even = (cosines[k, : m + 1 : 2] @ newest[::2]).reshape(many, rows, jobs * n)
            at = n + 2 * k * rows
            np.multiply(even, first[k], out=combined[:, at : at + rows])
            np.multiply(even, second[k], out=combined[:, at + rows : at + 2 * rows])
            if m:
                odd = (sines[k, 1 : m + 1 : 2] @ newest[1::2]).reshape(many, rows, jobs * n)
                combined[:, at : at + rows] -= second[k] * odd
                combined[:, at + rows : at + 2 * rows] += first[k] * odd
        np.matmul(stacked, combined, out=current)
        current *= 1.0 / (m + 1)
        total += current
    return np.ascontiguousarray(total.reshape(many, n, jobs, n).transpose(0, 2, 1, 3)).reshape(
        many, len(levels), segments, n, n
    )
