"""Matrix arithmetic with about twice the working precision, for residuals that must not drown in rounding.

A matrix is held as an unevaluated sum high + low. Products split both factors into slices short enough for the
ordinary matrix product of two slices to be exact (error-free transformation of Ozaki, Ogita, Oishi and Rump,
Numerical Algorithms 59 (2012) 95), so the work stays in BLAS and the result does not depend on a long double type.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import lu_factor, lu_solve

from maglev_ctrl.arrays import FloatArray

SLICES = 5
"""Slices per factor: at 22 to 26 bits each they cover the 106 bits of a pair."""


@dataclass(frozen=True, eq=False, slots=True)
class Extended:
    """The matrix `high` + `low`, with `low` below one unit in the last place of `high`."""

    high: FloatArray
    low: FloatArray

    @classmethod
    def of(cls, matrix: FloatArray) -> Extended:
        """An ordinary matrix as a pair."""
        return cls(matrix, np.zeros_like(matrix))

    @property
    def T(self) -> Extended:
        """Transpose."""
        return Extended(self.high.T, self.low.T)

    def __neg__(self) -> Extended:
        return Extended(-self.high, -self.low)

    def __add__(self, other: Extended) -> Extended:
        total, error = two_sum(self.high, other.high)
        return Extended(*two_sum(total, error + (self.low + other.low)))

    def __sub__(self, other: Extended) -> Extended:
        return self + (-other)

    def __matmul__(self, other: Extended) -> Extended:
        left = _slices(self, axis=1)
        right = _slices(other, axis=0)
        shape = (self.high.shape[0], other.high.shape[1])
        total, error = np.zeros(shape), np.zeros(shape)
        pairs = [(i, j) for i in range(len(left)) for j in range(len(right)) if i + j < SLICES]
        for i, j in sorted(pairs, key=lambda pair: -(pair[0] + pair[1])):
            total, lost = two_sum(total, left[i] @ right[j])
            error = error + lost
        return Extended(*two_sum(total, error))

    def symmetric(self) -> Extended:
        """Symmetric part (the halving is exact)."""
        doubled = self + self.T
        return Extended(0.5 * doubled.high, 0.5 * doubled.low)


def two_sum(a: FloatArray, b: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Rounded sum and its exact rounding error (Knuth, The Art of Computer Programming 2, sec. 4.2.2).

    Examples
    --------
    >>> total, error = two_sum(np.array(1.0), np.array(1e-20))
    >>> float(total), float(error)
    (1.0, 1e-20)
    """
    total = a + b
    part = total - a
    return total, (a - (total - part)) + (b - part)


def extended_solve(matrix: FloatArray | Extended, right: Extended, *, steps: int = 4) -> Extended:
    """Solution of matrix X = right by iterative refinement with residuals in extended precision."""
    exact = matrix if isinstance(matrix, Extended) else Extended.of(matrix)
    factors = lu_factor(exact.high)
    solution = Extended.of(lu_solve(factors, right.high))
    for _ in range(steps):
        rest = right - exact @ solution
        solution = solution + Extended.of(lu_solve(factors, rest.high))
    return solution


def _slices(matrix: Extended, *, axis: int) -> list[FloatArray]:
    """Leading bits first; every entry of a slice fits (53 - log2 n)/2 bits relative to its row or column."""
    terms = matrix.high.shape[axis]
    shift = int(np.ceil((53.0 + np.log2(max(terms, 1))) / 2.0))
    high, low = matrix.high, matrix.low
    slices: list[FloatArray] = []
    for _ in range(SLICES):
        largest = np.max(np.abs(high), axis=axis, keepdims=True, initial=0.0)
        if not np.any(largest):
            break
        _, exponent = np.frexp(largest)
        anchor = np.ldexp(0.75, exponent + shift)
        part = np.where(largest > 0.0, (high + anchor) - anchor, 0.0)
        slices.append(part)
        high, low = two_sum(high - part, low)
    return slices
