"""Taylor propagators of x' = [A_0 + depth * sum_k (A_cos[k] cos k W t + A_sin[k] sin k W t)] x over one period.

Many segments and depths of one system are values of one polynomial (see `segments`). Where that would need too many
terms they are integrated together: the Taylor recurrence needs one tall matrix product [A_0, A_cos, A_sin] (n, 3 n)
times (3 n, depths * segments * n) per order, with only the columns of the state that the modulation reads. Order and
segment count follow from a scalar majorant, so the truncation error is known beforehand.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.kernels.checks import check_periodic
from maglev_ctrl.kernels.segments import count_monomials, degree_for, monomials, segment_coefficients

_STEP = 4.0  # norm of the generator times the segment length: larger costs digits, smaller costs segments
_MAX_ORDER = 48
_WORTHWHILE = 0.7  # an expansion in the modulation may have this many terms per propagator wanted
_CHUNK = 1024  # columns integrated at once, so that the Taylor history stays in the cache


@dataclass(frozen=True, slots=True)
class TaylorPlan:
    """Segments per period, Taylor order, and a bound on the truncation error of each segment's propagator.

    Half of `truncation` belongs to the series in time, half to one in the modulation where that is used.
    """

    segments: int
    order: int
    truncation: float


def taylor_plan(
    norm_0: float, norms: FloatArray, *, frequency: float, tolerance: float = 1e-16, min_segments: int = 1
) -> TaylorPlan:
    """Segments and order such that a majorant of the Taylor tail is below `tolerance`.

    Parameters
    ----------
    norm_0 : norm of A_0, 1/s
    norms : (H,) norm of depth * (|A_cos| + |A_sin|) per harmonic, 1/s
    frequency : W, rad/s

    Examples
    --------
    >>> taylor_plan(1.0, np.array([0.1]), frequency=2.0).truncation < 1e-16
    True
    """
    period = 2.0 * np.pi / frequency
    total = norm_0 + float(np.sum(norms))
    least = max(min_segments, int(np.ceil(total * period / _STEP)), int(np.ceil(len(norms) * 2.0 * np.pi / _STEP)))
    plans: list[TaylorPlan] = []
    while not plans or plans[-1].truncation > tolerance or len(plans) < 4:
        segments = int(np.ceil(least * 1.4 ** len(plans)))
        plans.append(_plan(norm_0, norms, frequency=frequency, segments=segments, tolerance=tolerance))
    return min((p for p in plans if p.truncation <= tolerance), key=lambda p: p.segments * (p.order + 4))


def _plan(norm_0: float, norms: FloatArray, *, frequency: float, segments: int, tolerance: float) -> TaylorPlan:
    """Lowest order at a segment count whose majorant tail fits, or the highest order tried."""
    h = 2.0 * np.pi / (frequency * segments)
    harmonics = np.arange(1, len(norms) + 1)
    # |cos(k(a + W h u))| <= exp(k W h u): coefficients of the majorant generator
    powers = np.arange(_MAX_ORDER + 1)
    factorials = np.cumprod(np.concatenate([[1.0], np.arange(1.0, _MAX_ORDER + 1.0)]))
    generator = h * np.sum(norms[:, None] * (harmonics[:, None] * frequency * h) ** powers, axis=0) / factorials
    generator[0] += h * norm_0
    coefficients = np.zeros(_MAX_ORDER + 1)
    coefficients[0] = 1.0
    for m in range(_MAX_ORDER):
        coefficients[m + 1] = generator[: m + 1] @ coefficients[m::-1] / (m + 1)
    tails = np.cumsum(coefficients[::-1])[::-1]
    fits = np.nonzero(2.0 * tails[1:] <= tolerance)[0]
    order = max(4, int(fits[0])) if len(fits) else _MAX_ORDER - 1
    return TaylorPlan(segments, order, float(2.0 * tails[order + 1]))


def propagators_over_depths(
    A_0: FloatArray, A_cos: FloatArray, A_sin: FloatArray, *, frequency: float, depths: FloatArray, plan: TaylorPlan
) -> FloatArray:
    """Segment propagators for each depth: (D, S, n, n), segment s maps x(s T/S) to x((s+1) T/S).

    Parameters
    ----------
    A_0 : (n, n); A_cos, A_sin : (H, n, n) at unit depth, 1/s
    frequency : rad/s
    depths : (D,)

    Examples
    --------
    >>> plan = taylor_plan(1.0, np.array([0.0]), frequency=1.0)
    >>> X = propagators_over_depths(np.array([[-1.0]]), np.zeros((1, 1, 1)), np.zeros((1, 1, 1)),
    ...                             frequency=1.0, depths=np.array([0.0]), plan=plan)
    >>> bool(abs(np.prod(X) - np.exp(-2 * np.pi)) < 1e-15)
    True
    """
    check_periodic(A_0, A_cos, A_sin, frequency)
    depths = np.asarray(depths, dtype=np.float64)
    jobs = len(depths) * plan.segments
    step = 2.0 * np.pi / (frequency * plan.segments)
    largest = float(np.max(np.abs(depths), initial=0.0))
    degree = degree_for(A_0, A_cos, A_sin, step=step, depth=largest, tolerance=0.5 * plan.truncation)
    if degree is None or count_monomials(2 * len(A_cos), degree) > _WORTHWHILE * jobs:
        return _one_by_one(A_0, A_cos, A_sin, frequency=frequency, depths=depths, plan=plan)
    n, basis = A_0.shape[-1], monomials(2 * len(A_cos), degree)
    coefficients = segment_coefficients(
        A_0, A_cos, A_sin, basis, step=step, frequency=frequency, order=plan.order
    )  # fmt: skip
    angle = 2.0 * np.pi * np.arange(plan.segments)[:, None] / plan.segments * np.arange(1, len(A_cos) + 1)
    turning = np.stack([np.cos(angle), np.sin(angle)], axis=-1).reshape(plan.segments, -1)
    values = basis.values((depths[:, None, None] * turning).reshape(jobs, -1))
    joined = values @ coefficients.reshape(len(coefficients), -1)
    return np.asarray(joined.reshape(len(depths), plan.segments, n, n))


def _one_by_one(
    A_0: FloatArray, A_cos: FloatArray, A_sin: FloatArray, *, frequency: float, depths: FloatArray, plan: TaylorPlan
) -> FloatArray:
    """The propagators where every segment and depth is integrated for itself."""
    n, count, segments = A_0.shape[-1], len(depths), plan.segments
    stacked, read_cos, read_sin = _stack(A_0, A_cos, A_sin)
    start = 2.0 * np.pi * np.arange(segments) / segments
    jobs = count * segments
    depth_of = np.repeat(np.asarray(depths, dtype=np.float64), segments)
    phase_of = np.tile(start, count)
    result = np.empty((jobs, n, n))
    width = max(1, _CHUNK // n)
    for first in range(0, jobs, width):
        part = slice(first, min(first + width, jobs))
        columns = _integrate(
            stacked, read_cos, read_sin, n, len(A_cos),
            depth=np.repeat(depth_of[part], n), phase=np.repeat(phase_of[part], n),
            step=2.0 * np.pi / (frequency * segments), frequency=frequency, order=plan.order,
        )  # fmt: skip
        result[part] = columns.reshape(n, -1, n).transpose(1, 0, 2)
    return result.reshape(count, segments, n, n)


def _stack(
    A_0: FloatArray, A_cos: FloatArray, A_sin: FloatArray
) -> tuple[FloatArray, list[NDArray[np.intp]], list[NDArray[np.intp]]]:
    """[A_0, columns of A_cos that are not zero, those of A_sin] and which states those columns read, per harmonic."""
    blocks = [A_0]
    read_cos: list[NDArray[np.intp]] = []
    read_sin: list[NDArray[np.intp]] = []
    for cosine, sine in zip(A_cos, A_sin, strict=True):
        for matrix, reads in ((cosine, read_cos), (sine, read_sin)):
            columns = np.nonzero(np.any(matrix != 0.0, axis=0))[0]
            reads.append(columns)
            blocks.append(matrix[:, columns])
    return np.concatenate(blocks, axis=1), read_cos, read_sin


def _integrate(
    stacked: FloatArray, read_cos: list[NDArray[np.intp]], read_sin: list[NDArray[np.intp]], n: int, harmonics: int,
    *, depth: FloatArray, phase: FloatArray, step: float, frequency: float, order: int,
) -> FloatArray:  # fmt: skip
    """Sum of the Taylor series at the end of the segment for all columns at once: (n, columns)."""
    columns = len(depth)
    used = np.unique(np.concatenate([*read_cos, *read_sin])).astype(int)
    place = {int(state): row for row, state in enumerate(used)}
    rows_cos = [np.array([place[int(c)] for c in read], dtype=int) for read in read_cos]
    rows_sin = [np.array([place[int(c)] for c in read], dtype=int) for read in read_sin]
    cosines = [depth * np.cos(k * phase) for k in range(1, harmonics + 1)]
    sines = [depth * np.sin(k * phase) for k in range(1, harmonics + 1)]
    angle = np.asarray(frequency * step * np.arange(1, harmonics + 1), dtype=np.float64)
    factors = _trigonometric_coefficients(angle, order)
    # newest coefficient first in memory, so that the convolution runs over ascending addresses
    history = np.empty((order + 1, len(used), columns))
    current = np.tile(np.eye(n), (1, columns // n))
    total = current.copy()
    combined = np.empty((stacked.shape[1], columns))
    for m in range(order):
        history[order - m] = current[used]
        combined[:n] = current
        row = n
        for k in range(harmonics):
            even, odd = _convolve(history, factors[k], order - m, m)
            for rows, first, second in ((rows_cos[k], cosines[k], -sines[k]), (rows_sin[k], sines[k], cosines[k])):
                if len(rows):
                    every = len(rows) == len(used)
                    target = combined[row : row + len(rows)]
                    np.multiply(even if every else even[rows], first, out=target)
                    target += second * (odd if every else odd[rows])
                    row += len(rows)
        np.matmul(stacked, combined, out=current)
        current *= step / (m + 1)
        total += current
    return total


def _trigonometric_coefficients(angle: FloatArray, order: int) -> FloatArray:
    """(H, order + 1): (-1)^(j // 2) angle^j / j!, the even ones of the cosine and the odd ones of the sine."""
    j = np.arange(order + 1)
    factorials = np.cumprod(np.concatenate([[1.0], np.arange(1.0, order + 1.0)]))
    return np.asarray((-1.0) ** (j // 2) * angle[:, None] ** j / factorials)


def _convolve(history: FloatArray, factors: FloatArray, newest: int, m: int) -> tuple[FloatArray, FloatArray]:
    """Taylor coefficient m of cos(k W h u) x and of sin(k W h u) x."""
    shape = history.shape[1:]
    rows = history.reshape(len(history), -1)
    even = factors[0 : m + 1 : 2] @ rows[newest::2]
    if m == 0:
        return even.reshape(shape), np.zeros(shape)
    odd = factors[1 : m + 1 : 2] @ rows[newest + 1 :: 2]
    return even.reshape(shape), odd.reshape(shape)


def tree_product(factors: FloatArray) -> FloatArray:
    """factors[S-1] ... factors[1] factors[0] over the third-last axis, pairwise: (..., n, n).

    Examples
    --------
    >>> tree_product(np.array([[[2.0]], [[3.0]], [[5.0]]]))
    array([[30.]])
    """
    while factors.shape[-3] > 1:
        pairs = factors.shape[-3] // 2
        product = factors[..., 1 : 2 * pairs : 2, :, :] @ factors[..., 0 : 2 * pairs : 2, :, :]
        if factors.shape[-3] % 2:
            product = np.concatenate([product, factors[..., -1:, :, :]], axis=-3)
        factors = product
    return np.asarray(factors[..., 0, :, :])


def monodromy_over_depths(
    A_0: FloatArray, A_cos: FloatArray, A_sin: FloatArray, *, frequency: float, depths: FloatArray, plan: TaylorPlan
) -> FloatArray:
    """Propagator over one period for each depth: (D, n, n)."""
    return tree_product(propagators_over_depths(A_0, A_cos, A_sin, frequency=frequency, depths=depths, plan=plan))
