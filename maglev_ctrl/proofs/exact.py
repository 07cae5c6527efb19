"""Exact matrices: whole numbers over one denominator, and the sign of their eigenvalues without rounding."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.proofs.enclosure import EPSILON, TINY, Enclosure, definite

LARGEST = 120
"""Rows above which exact arithmetic is not tried."""

ELIMINATED = 24
"""Rows up to which an undecided sign is settled by elimination without fractions."""

Whole = NDArray[Any]


@dataclass(frozen=True, eq=False, slots=True)
class Exact:
    """The matrix `numerator / denominator`, Python's whole numbers over one positive whole number.

    Every float is m 2^e exactly, so that sums and products of floats are computed without any error.

    Examples
    --------
    >>> rest = Exact.of([[0.1]]) @ Exact.of([[10.0]]) - Exact.of([[1.0]])
    >>> rest.numerator[0, 0] / rest.denominator == 2.0**-54
    True
    """

    numerator: Whole
    denominator: int

    @classmethod
    def of(cls, array: ArrayLike) -> Self:
        """The matrix whose entries are exactly the given floats."""
        given = np.asarray(array, dtype=np.float64)
        ratios = [float(x).as_integer_ratio() for x in given.ravel()]
        denominator = max((q for _, q in ratios), default=1)
        return cls(_whole([p * (denominator // q) for p, q in ratios], (given.shape[0], given.shape[1])), denominator)

    @classmethod
    def of_fractions(cls, rows: Sequence[Sequence[Fraction]]) -> Self:
        """The matrix of given fractions."""
        denominator = math.lcm(*(x.denominator for row in rows for x in row))
        flat = [x.numerator * (denominator // x.denominator) for row in rows for x in row]
        return cls(_whole(flat, (len(rows), len(rows[0]) if rows else 0)), denominator)

    @classmethod
    def blocks(cls, rows: Sequence[Sequence[Self]]) -> Self:
        """One matrix from blocks."""
        common = math.lcm(*(x.denominator for row in rows for x in row))
        return cls(np.concatenate([np.concatenate([x._over(common) for x in row], axis=1) for row in rows]), common)

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        rows, columns = self.numerator.shape
        return rows, columns

    @property
    def T(self) -> Self:
        """Transpose."""
        return type(self)(self.numerator.T, self.denominator)

    def _over(self, denominator: int) -> Whole:
        factor = denominator // self.denominator
        return self.numerator if factor == 1 else self.numerator * factor

    def __neg__(self) -> Self:
        return type(self)(-self.numerator, self.denominator)

    def __add__(self, other: Self) -> Self:
        common = math.lcm(self.denominator, other.denominator)
        return type(self)(self._over(common) + other._over(common), common)

    def __sub__(self, other: Self) -> Self:
        return self + (-other)

    def __matmul__(self, other: Self) -> Self:
        rows, inner = self.shape
        columns = other.shape[1]
        if 0 in (rows, inner, columns):
            return type(self)(_whole([0] * (rows * columns), (rows, columns)), 1)
        return type(self)(self.numerator @ other.numerator, self.denominator * other.denominator)

    def times(self, scalar: float) -> Self:
        """The matrix times the exact value of a float."""
        above, below = float(scalar).as_integer_ratio()
        return type(self)(self.numerator * above, self.denominator * below)

    def over(self, count: int) -> Self:
        """The matrix divided by a whole number."""
        return type(self)(self.numerator, self.denominator * count)

    def take(self, rows: Sequence[int]) -> Self:
        """Some of the rows."""
        return type(self)(self.numerator[list(rows)], self.denominator)

    def fractions(self) -> list[list[Fraction]]:
        """The entries as fractions."""
        return [[Fraction(x, self.denominator) for x in row] for row in self.numerator.tolist()]

    def inverse(self) -> Self:
        """Inverse by Gauss and Jordan; ZeroDivisionError where singular."""
        n = self.shape[0]
        rows = [[*row, *(Fraction(i == j) for j in range(n))] for i, row in enumerate(self.fractions())]
        for k in range(n):
            pivot = next((i for i in range(k, n) if rows[i][k] != 0), None)
            if pivot is None:
                raise ZeroDivisionError("the matrix is singular")
            rows[k], rows[pivot] = rows[pivot], rows[k]
            rows[k] = [x / rows[k][k] for x in rows[k]]
            for i in range(n):
                if i != k and rows[i][k] != 0:
                    factor = rows[i][k]
                    rows[i] = [x - factor * y for x, y in zip(rows[i], rows[k], strict=True)]
        return self.of_fractions([row[n:] for row in rows])

    @property
    def is_zero(self) -> bool:
        """Every entry is exactly zero."""
        return not any(x != 0 for x in self.numerator.ravel())


def _whole(flat: list[int], shape: tuple[int, int]) -> Whole:
    array = np.empty(len(flat), dtype=object)
    array[:] = flat
    return array.reshape(shape)


def exactly_definite(matrix: Exact) -> tuple[bool | None, float]:
    """Whether an exact symmetric matrix is positive definite, None where the size forbids to tell; a rough margin.

    The margin is the smallest eigenvalue of the matrix with a diagonal near one, rounded: a number to read, no proof.

    In turn: a diagonal entry or x'S x <= 0 refutes; S rounded once may be provable; S in coordinates where it is near
    the identity (W'S W > 0 proves S > 0, whatever W, which only has to be stored exactly) is again rounded once;
    elimination without fractions gives the signs of the leading minors (Bareiss, Math. Comp. 22 (1968) 565).

    Examples
    --------
    >>> [exactly_definite(Exact.of([[1.0, 1.0], [1.0, corner]]))[0] for corner in (1.0, 1.0 + 2.0**-52)]
    [False, True]
    """
    n = matrix.shape[0]
    if n == 0:
        return True, np.inf
    if n > LARGEST:
        return None, np.nan
    margin = np.nan
    for _ in range(4):
        if any(matrix.numerator[i, i] <= 0 for i in range(n)):
            return False, 0.0 if np.isnan(margin) else min(margin, 0.0)
        matrix = _scaled(matrix)
        try:
            middle = _rounded(matrix)
        except OverflowError:  # with a diagonal near one such an entry makes a minor of two rows negative
            return False, -np.inf
        proved, value, _ = definite(Enclosure(middle, EPSILON * np.abs(middle) + TINY))
        margin = value if np.isnan(margin) else margin
        if proved:
            return True, margin
        values, vectors = np.linalg.eigh(middle)
        direction = Exact.of(vectors[:, :1])
        if (direction.T @ matrix @ direction).numerator[0, 0] <= 0:
            return False, min(margin, 0.0)
        if n <= ELIMINATED and matrix.denominator.bit_length() * n < 40000:
            return _minors_positive(matrix), margin
        near = vectors / np.sqrt(np.maximum(values, 0.25 * EPSILON * n))
        basis = Exact.of(near.astype(np.float32))  # short numbers: only nearness matters, not accuracy
        matrix = basis.T @ matrix @ basis
    return None, margin


def _scaled(matrix: Exact) -> Exact:
    """Congruent by powers of two: a diagonal near the denominator."""
    n, size = matrix.shape[0], matrix.denominator.bit_length()
    power = [(size - int(matrix.numerator[i, i]).bit_length()) // 2 for i in range(n)]
    lift = max(0, -min(power))  # whole numbers only: everything is lifted, and the denominator with it
    shift = [p + lift for p in power]
    scaled = [int(matrix.numerator[i, j]) << (shift[i] + shift[j]) for i in range(n) for j in range(n)]
    denominator = matrix.denominator << (2 * lift)
    common = math.gcd(denominator, *scaled)
    return Exact(_whole([x // common for x in scaled], (n, n)), denominator // common)


def _rounded(matrix: Exact) -> FloatArray:
    """Every entry to the nearest float."""
    below = matrix.denominator
    return np.array([[int(x) / below for x in row] for row in matrix.numerator], dtype=np.float64)


def _minors_positive(matrix: Exact) -> bool:
    """Every leading minor of a symmetric matrix is positive."""
    n = matrix.shape[0]
    rows = [[int(x) for x in row] for row in matrix.numerator]
    before = 1
    for k in range(n):
        pivot = rows[k][k]
        if pivot <= 0:
            return False
        for i in range(k + 1, n):
            for j in range(k + 1, i + 1):
                rows[i][j] = (pivot * rows[i][j] - rows[i][k] * rows[j][k]) // before
        before = pivot
    return True


def decay_factor(rate: float, dt: float) -> float:
    """A float that is at most exp(-2 rate dt), and near it: a series in whole numbers, every step rounded down.

    Examples
    --------
    >>> decay_factor(0.0, 0.1)
    1.0
    >>> abs(decay_factor(0.5, 0.01) - math.exp(-0.01)) < 1e-15
    True
    """
    exponent = 2 * Fraction(rate) * Fraction(dt)
    if exponent == 0:
        return 1.0
    if abs(exponent) > 600:
        return 0.0 if exponent > 0 else 2.0**865
    halvings = max(0, math.ceil(math.log2(abs(exponent) + 1))) + 2
    small = exponent / 2**halvings
    total, term = Fraction(0), Fraction(1)
    for k in range(1, 33):  # ends after an odd power: below the sum where signs alternate, and where all are positive
        total += term
        term = -term * small / k
    unit = 1 << 1000
    found = math.floor(total * unit)
    for _ in range(halvings):
        found = found * found // unit
    value = found / unit
    return value if Fraction(value) <= Fraction(found, unit) else math.nextafter(value, -math.inf)
