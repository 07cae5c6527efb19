"""Riccati equations of many operating points at once: structured doubling, and one by one what it leaves open."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from maglev_ctrl.arrays import FloatArray, join_columns, read_only, read_only_any, transpose
from maglev_ctrl.errors import Status
from maglev_ctrl.synthesis.doubling import cayley_shift, doubled_solution, relative_residual, symmetric
from maglev_ctrl.synthesis.riccati import riccati_continuous

CHUNK = 200
Many = Callable[[FloatArray, FloatArray, FloatArray, float], tuple[FloatArray, FloatArray, FloatArray]]


@dataclass(frozen=True, eq=False, slots=True)
class RiccatiBatch:
    """Riccati solutions over leading batch axes.

    `P` (..., n, n), `gain` (..., m, n); `residual` (...,) relative to the size of the terms; `solved` (...,) true where
    the residual and the decay of the doubled powers vouch for a stabilising solution; `redone` (...,) true where the
    single-point solver had to step in. NaN where unsolved.
    """

    P: FloatArray
    gain: FloatArray
    residual: FloatArray
    solved: NDArray[np.bool_]
    redone: NDArray[np.bool_]


def riccati_batch(
    A: ArrayLike,
    B: ArrayLike,
    Q: ArrayLike,
    R: ArrayLike,
    N: ArrayLike | None = None,
    *,
    tolerance: float = 1e-11,
    backend: Literal["numpy", "fast"] = "numpy",
) -> RiccatiBatch:
    """Stabilising solutions of many continuous Riccati equations at once, for grids of operating points.

    Parameters
    ----------
    A, B, Q, R, N : as in `riccati_continuous`, with leading batch axes that broadcast
    tolerance : relative residual above which a point is solved again by `riccati_continuous`
    backend : "fast" needs the extra of that name (numba): the same method compiled, several times as fast

    Raises
    ------
    ValueError : shapes do not fit, or the backend is unknown
    ModelError : backend "fast" without numba

    Examples
    --------
    >>> many = riccati_batch([[[0.0]], [[1.0]]], [[1.0]], [[1.0]], [[1.0]])
    >>> [round(float(p), 9) for p in many.P[:, 0, 0]]
    [1.0, 2.414213562]
    """
    if backend not in ("numpy", "fast"):
        raise ValueError(f"backend: expected 'numpy' or 'fast', got {backend!r}")
    a = read_only(A, name="A", shape=(None, None))
    n = a.shape[-1]
    b = read_only(B, name="B", shape=(n, None))
    m = b.shape[-1]
    q, r = read_only(Q, name="Q", shape=(n, n)), read_only(R, name="R", shape=(m, m))
    cross = read_only(np.zeros((n, m)) if N is None else N, name="N", shape=(n, m))
    batch = np.broadcast_shapes(*(x.shape[:-2] for x in (a, b, q, r, cross)))
    a, b, q, r, cross = (np.broadcast_to(x, batch + x.shape[-2:]) for x in (a, b, q, r, cross))
    weighted = np.linalg.solve(r, join_columns([transpose(b), transpose(cross)]))
    A_bare = a - b @ weighted[..., n:]
    G, Q_bare = symmetric(b @ weighted[..., :n]), symmetric(q - cross @ weighted[..., n:])
    P, residual, solved = _in_chunks(A_bare, G, Q_bare, tolerance, backend)
    redone = ~solved
    for index in zip(*np.nonzero(redone), strict=True):
        P[index], residual[index], solved[index] = _one_by_one(a[index], b[index], q[index], r[index], cross[index])
    gain = np.linalg.solve(r, transpose(b) @ P + transpose(cross))
    return RiccatiBatch(*(read_only_any(x) for x in (P, gain, residual, solved, redone)))


def _in_chunks(
    A: FloatArray, G: FloatArray, Q: FloatArray, tolerance: float, backend: str
) -> tuple[FloatArray, FloatArray, NDArray[np.bool_]]:
    """Chunk by chunk, so that the matrices in work stay in the cache."""
    n = A.shape[-1]
    flat = [x.reshape(-1, n, n) for x in (A, G, Q)]
    chunk = CHUNK if backend == "numpy" else max(flat[0].shape[0], 1)
    many = _compiled if backend == "fast" else _plain
    with np.errstate(all="ignore"):
        parts = [
            _doubled_batch(*(x[start : start + chunk] for x in flat), tolerance=tolerance, many=many)
            for start in range(0, flat[0].shape[0], chunk)
        ]
    if not parts:
        return np.zeros(A.shape), np.zeros(A.shape[:-2]), np.zeros(A.shape[:-2], dtype=bool)
    P, residual, solved = (np.concatenate(part) for part in zip(*parts, strict=True))
    return P.reshape(A.shape), residual.reshape(A.shape[:-2]), solved.reshape(A.shape[:-2])


def _doubled_batch(
    A: FloatArray, G: FloatArray, Q: FloatArray, *, tolerance: float, many: Many
) -> tuple[FloatArray, FloatArray, NDArray[np.bool_]]:
    """Doubling for all points, then with moved shifts for those whose residual is not small."""
    P, residual, solved = np.full(A.shape, np.nan), np.full(A.shape[:-2], np.inf), np.zeros(A.shape[:-2], dtype=bool)
    for factor in (1.0, 2.3, 0.43):
        left = ~solved
        if not np.any(left):
            break
        found, size, rest = _around_singular(many, (A[left], G[left], Q[left]), factor)
        good = (size <= tolerance) & (rest <= 1e-3)  # the doubled powers of a stable loop vanish
        P[left], residual[left], solved[left] = found, size, good
    return P, residual, solved


def _around_singular(
    many: Many, data: tuple[FloatArray, FloatArray, FloatArray], factor: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """One point that meets a singular matrix fails alone: the others are solved in halves of the batch."""
    count = len(data[0])
    try:
        return many(*data, factor)
    except np.linalg.LinAlgError:
        if count == 1:
            return np.full(data[0].shape, np.nan), np.full(1, np.inf), np.full(1, np.inf)
    halves = [
        _around_singular(many, (data[0][part], data[1][part], data[2][part]), factor)
        for part in (slice(count // 2), slice(count // 2, count))
    ]
    found, size, rest = (np.concatenate(both) for both in zip(*halves, strict=True))
    return found, size, rest


def _plain(A: FloatArray, G: FloatArray, Q: FloatArray, factor: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    found, rest = doubled_solution(A, G, Q, factor * cayley_shift(A, G, Q))
    return found, relative_residual(A, G, Q, found), rest


def _compiled(A: FloatArray, G: FloatArray, Q: FloatArray, factor: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    from maglev_ctrl.kernels.riccati_lanes import many_by_doubling  # loads numba

    return many_by_doubling(A, G, Q, factor)


def _one_by_one(
    A: FloatArray, B: FloatArray, Q: FloatArray, R: FloatArray, N: FloatArray
) -> tuple[FloatArray, float, bool]:

    solution = riccati_continuous(A, B, Q, R, N)
    return solution.P, solution.residual, solution.status is Status.SOLVED
