"""The matrix inequalities of every claim, written once for rounding-bounded and for exact arithmetic.

Each function yields (where, matrix): the claim holds if every matrix is symmetric positive definite.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.proofs.claims import (
    Claim,
    DecayClaim,
    EllipsoidClaim,
    EnergyClaim,
    GainClaim,
    ParameterClaim,
    RegionClaim,
    SegmentClaim,
)
from maglev_ctrl.proofs.exact import decay_factor
from maglev_ctrl.proofs.loops import Loop, M, Mismatch

Condition = tuple[str, M]


def symmetric_part(kind: type[M], P: FloatArray) -> M:
    """Symmetric part of a certificate matrix, without an error that is not accounted for.

    Examples
    --------
    >>> from maglev_ctrl.proofs.exact import Exact
    >>> symmetric_part(Exact, np.array([[1.0, 2.0], [3.0, 1.0]])).fractions()[0][1]
    Fraction(5, 2)
    """
    matrix = kind.of(P)
    return matrix if np.array_equal(P, P.T) else (matrix + matrix.T).times(0.5)


def conditions(
    claim: Claim,
    kind: type[M],
    loops: Sequence[Loop[M]],
    dt: float | None,
    disturbances: Sequence[int],
    performance: Sequence[int],
) -> Iterator[Condition[M]]:
    """Matrices that have to be positive definite for the claim to hold on `loops`.

    `disturbances`, `performance` : columns of B and rows of C meant by the claim.

    Examples
    --------
    >>> from maglev_ctrl.proofs.enclosure import Enclosure
    >>> one = Enclosure.of([[-1.0]])
    >>> claim = DecayClaim((0,), (0,), 0.5, np.ones((1, 1, 1)))
    >>> [where for where, _ in conditions(claim, Enclosure, [Loop(one, one, one, one, one)], None, [0], [0])]
    ['P > 0', 'the decay inequality']
    """  # fmt: skip
    match claim:
        case DecayClaim():
            yield from _decay(claim, kind, loops, dt)
        case RegionClaim():
            yield from _region(claim, kind, loops)
        case GainClaim():
            yield from _gain(claim, kind, loops, dt, disturbances, performance)
        case EnergyClaim():
            yield from _energy(claim, kind, loops, dt, disturbances, performance)
        case EllipsoidClaim():
            yield from _ellipsoid(claim, kind, loops, dt)
        case ParameterClaim():
            yield from _parameter(claim, kind, loops)
        case SegmentClaim():
            yield from _segment(claim, kind, loops)


def _stack(kind: type[M], P: FloatArray, count: int) -> list[M]:
    """The certificate matrix of every loop."""
    found = [symmetric_part(kind, one) for one in P]
    return found * count if len(found) == 1 else found


def _positive(matrices: Sequence[M], letter: str) -> Iterator[Condition[M]]:
    for i, one in enumerate(matrices):
        yield (f"{letter} > 0" if len(matrices) == 1 else f"{letter}[{i}] > 0"), one


def _where(text: str, loops: Sequence[Loop[M]], i: int) -> str:
    return text if len(loops) == 1 else f"{text} of loop {i + 1}"


def _quadratic(kind: type[M], A: M, P: M, factor: float | None) -> M:
    """-(A'P + P A), or factor P - A'P A of a sampled loop."""
    half = P @ A
    return -(half + half.T) if factor is None else P.times(factor) - A.T @ half


def _decay(claim: DecayClaim, kind: type[M], loops: Sequence[Loop[M]], dt: float | None) -> Iterator[Condition[M]]:
    matrices = _stack(kind, claim.P, len(loops))
    yield from _positive(matrices[: len(claim.P)], "P")
    factor = None if dt is None else decay_factor(claim.rate, dt)
    for i, (loop, P) in enumerate(zip(loops, matrices, strict=True)):
        S = _quadratic(kind, loop.A, P, factor)
        yield _where("the decay inequality", loops, i), S - P.times(2.0 * claim.rate) if dt is None else S


def _region(claim: RegionClaim, kind: type[M], loops: Sequence[Loop[M]]) -> Iterator[Condition[M]]:
    matrices = _stack(kind, claim.X, len(loops))
    yield from _positive(matrices[: len(claim.X)], "X")
    size = range(len(claim.L))
    for i, (loop, X) in enumerate(zip(loops, matrices, strict=True)):
        moved = loop.A @ X
        back = moved.T

        def block(j: int, k: int, X: M = X, moved: M = moved, back: M = back) -> M:
            return -(X.times(claim.L[j, k]) + moved.times(claim.M[j, k]) + back.times(claim.M[k, j]))

        yield _where("the region's inequality", loops, i), kind.blocks([[block(j, k) for k in size] for j in size])


def _gain(
    claim: GainClaim, kind: type[M], loops: Sequence[Loop[M]], dt: float | None, disturbances: Sequence[int],
    performance: Sequence[int],
) -> Iterator[Condition[M]]:  # fmt: skip
    matrices = _stack(kind, claim.P, len(loops))
    yield from _positive(matrices[: len(claim.P)], "P")
    level_w = kind.of(claim.gamma * np.eye(len(disturbances)))
    level_z = kind.of(claim.gamma * np.eye(len(performance)))
    for i, (loop, P) in enumerate(zip(loops, matrices, strict=True)):
        B, C, D = loop.B.T.take(disturbances).T, loop.C.take(performance), _selected(loop.D, performance, disturbances)
        top = _quadratic(kind, loop.A, P, None if dt is None else 1.0)
        corner = P @ B
        side = -(corner if dt is None else loop.A.T @ corner)
        middle = level_w if dt is None else level_w - B.T @ corner
        yield (
            _where("the bounded-real inequality", loops, i),
            kind.blocks([[top, side, -C.T], [side.T, middle, -D.T], [-C, -D, level_z]]),
        )


def _selected(matrix: M, rows: Sequence[int], columns: Sequence[int]) -> M:
    return matrix.take(rows).T.take(columns).T


def _energy(
    claim: EnergyClaim, kind: type[M], loops: Sequence[Loop[M]], dt: float | None, disturbances: Sequence[int],
    performance: Sequence[int],
) -> Iterator[Condition[M]]:  # fmt: skip
    matrices = _stack(kind, claim.P, len(loops))
    yield from _positive(matrices[: len(claim.P)], "P")
    level = kind.of([[claim.level]])
    for i, (loop, P) in enumerate(zip(loops, matrices, strict=True)):
        B, C, D = loop.B.T.take(disturbances).T, loop.C.take(performance), _selected(loop.D, performance, disturbances)
        if dt is None and not _is_zero(D):
            raise Mismatch("the loop passes disturbances straight through (D is not zero): its H2 norm is infinite")
        # by Schur's complement, so that no rounding of C'C stands in the way: -(A'P + P A) - C'C > 0
        top = _quadratic(kind, loop.A, P, None if dt is None else 1.0)
        one = kind.of(np.eye(len(performance)))
        yield _where("the observability inequality", loops, i), kind.blocks([[top, C.T], [C, one]])
        squares = B.T @ (P @ B) if dt is None else B.T @ (P @ B) + D.T @ D
        yield _where("the bound on trace B'P B", loops, i), level @ level - _trace(kind, squares)


def _is_zero(D: M) -> bool:
    """Structurally zero: the only D that rounding leaves exactly zero; exact arithmetic sees every other."""
    numerator = getattr(D, "numerator", None)
    if numerator is not None:
        return not any(x != 0 for x in numerator.ravel())
    return not np.any(getattr(D, "middle")) and getattr(D, "radius") is None  # noqa: B009


def _trace(kind: type[M], square: M) -> M:
    size = square.shape[0]
    total = kind.of([[0.0]])
    for i in range(size):
        total = total + _selected(square, [i], [i])
    return total


def _ellipsoid(
    claim: EllipsoidClaim, kind: type[M], loops: Sequence[Loop[M]], dt: float | None
) -> Iterator[Condition[M]]:
    matrices = _stack(kind, claim.P, len(loops))
    yield from _positive(matrices[: len(claim.P)], "P")
    for i, (loop, P) in enumerate(zip(loops, matrices, strict=True)):
        yield (
            _where("the decay inequality", loops, i),
            _quadratic(kind, loop.A, P, None if dt is None else 1.0),
        )
        for j, limit in enumerate(claim.limits):
            row, bound = loop.U.take([j]), kind.of([[limit]])
            yield (
                _where(f"the bound on command {j + 1}", loops, i),
                kind.blocks([[bound @ bound, row], [row.T, P]]),
            )


def _parameter(claim: ParameterClaim, kind: type[M], loops: Sequence[Loop[M]]) -> Iterator[Condition[M]]:
    matrices = _stack(kind, claim.P, len(loops))
    V = kind.of(claim.V)
    n = claim.V.shape[0]
    zero, one = kind.of(np.zeros((n, n))), kind.of(np.eye(n))
    for i, (loop, P) in enumerate(zip(loops, matrices, strict=True)):
        side = -(V.T @ (loop.A + one.times(claim.rate)).times(claim.time) + P)
        yield (
            _where("the slack inequality", loops, i),
            kind.blocks([[V + V.T, side, -V.T], [side.T, P, zero], [-V, zero, P]]),
        )


def _segment(claim: SegmentClaim, kind: type[M], loops: Sequence[Loop[M]]) -> Iterator[Condition[M]]:
    """Bernstein coefficients of width (A'P + P A) +- speed_limit (P1 - P0), times degree + 1.

    A(l) has the coefficients a_0 .. a_d (d = 1, 2, 3), P(l) = (1 - l) P0 + l P1; the coefficient m of their product is
    ((d + 1 - m) L(a_m, P0) + m L(a_(m-1), P1)) / (d + 1) with L(a, P) = a'P + P a.
    """
    first, last = symmetric_part(kind, claim.P[0]), symmetric_part(kind, claim.P[1])
    yield from _positive([first, last], "P")
    degree = len(loops) - 1
    drift = (last - first).times(claim.speed_limit).times(float(degree + 1))
    zero = first - first
    for m in range(degree + 2):
        low = _quadratic(kind, loops[m].A, first, None).times(float(degree + 1 - m)) if m <= degree else zero
        high = _quadratic(kind, loops[m - 1].A, last, None).times(float(m)) if m else zero
        S = (low + high).times(claim.width)
        yield f"coefficient {m + 1} of {degree + 2} while the parameter rises", S - drift
        if claim.speed_limit:
            yield f"coefficient {m + 1} of {degree + 2} while the parameter falls", S + drift
