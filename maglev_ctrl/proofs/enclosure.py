"""Matrices with rounding bounds: a midpoint and a radius that holds the exact result, entry by entry."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, Self

import numpy as np
from numpy.typing import ArrayLike

from maglev_ctrl.arrays import FloatArray

EPSILON = 2.0**-52
"""Twice the largest relative error of one rounded operation: every bound below has a factor of two to spare."""

TINY = 2.0**-1022
"""Smallest normal number: bounds what underflow may lose, also where subnormal numbers are flushed to zero."""


class NotDecided(Exception):
    """Rounded arithmetic cannot tell; exact arithmetic may."""


class Matrix(Protocol):
    """What the inequalities are written in: matrices with rounding bounds, or exact ones."""

    @classmethod
    def of(cls, array: ArrayLike) -> Self:
        """The matrix whose entries are exactly the given floats."""
        ...

    @classmethod
    def blocks(cls, rows: Sequence[Sequence[Self]]) -> Self:
        """One matrix from blocks."""
        ...

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        ...

    @property
    def T(self) -> Self:
        """Transpose."""
        ...

    def __add__(self, other: Self) -> Self: ...

    def __sub__(self, other: Self) -> Self: ...

    def __neg__(self) -> Self: ...

    def __matmul__(self, other: Self) -> Self: ...

    def times(self, scalar: float) -> Self:
        """The matrix times the exact value of a float."""
        ...

    def over(self, count: int) -> Self:
        """The matrix divided by a whole number."""
        ...

    def take(self, rows: Sequence[int]) -> Self:
        """Some of the rows."""
        ...

    def inverse(self) -> Self:
        """Inverse; ZeroDivisionError where singular, NotDecided where rounding hides it."""
        ...


@dataclass(frozen=True, eq=False, slots=True)
class Enclosure:
    """All matrices whose entries differ from `middle` by at most `radius` (None: exactly `middle`).

    Errors of sums and products of any order of summation, with or without fused multiplication: Rump, Acta Numerica
    19 (2010) 287, section 9; Higham, Accuracy and Stability of Numerical Algorithms (2002), section 3.

    Examples
    --------
    >>> third = Enclosure.of([[1.0]]).over(3)
    >>> bool(abs(third.middle[0, 0] * 3 - 1) < 1e-15), bool(third.radius[0, 0] > 0)
    (True, True)
    """

    middle: FloatArray
    radius: FloatArray | None = None

    @classmethod
    def of(cls, array: ArrayLike) -> Self:
        """The matrix whose entries are exactly the given floats."""
        return cls(np.asarray(array, dtype=np.float64))

    @classmethod
    def blocks(cls, rows: Sequence[Sequence[Self]]) -> Self:
        """One matrix from blocks."""
        middle = np.concatenate([np.concatenate([x.middle for x in row], axis=1) for row in rows])
        if all(x.radius is None for row in rows for x in row):
            return cls(middle)
        return cls(middle, np.concatenate([np.concatenate([x.spread for x in row], axis=1) for row in rows]))

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        rows, columns = self.middle.shape
        return rows, columns

    @property
    def spread(self) -> FloatArray:
        """The radius as an array."""
        return np.zeros(self.middle.shape) if self.radius is None else self.radius

    @property
    def T(self) -> Self:
        """Transpose."""
        return type(self)(self.middle.T, None if self.radius is None else self.radius.T)

    def __neg__(self) -> Self:
        return type(self)(-self.middle, self.radius)

    def __add__(self, other: Self) -> Self:
        return self._rounded(self.middle + other.middle, self.radius, other.radius)

    def __sub__(self, other: Self) -> Self:
        return self._rounded(self.middle - other.middle, self.radius, other.radius)

    def _rounded(self, middle: FloatArray, first: FloatArray | None, second: FloatArray | None) -> Self:
        radius = EPSILON * np.abs(middle) + TINY
        for part in (first, second):
            if part is not None:
                radius = radius + part
        return type(self)(middle, radius * (1.0 + 8.0 * EPSILON))

    def __matmul__(self, other: Self) -> Self:
        terms = self.middle.shape[1]
        size, other_size = np.abs(self.middle), np.abs(other.middle)
        # |fl(XY) - XY| <= k u / (1 - k u) |X||Y|; the same sums bound |X||Y| itself from below by their own rounding
        radius = (terms + 2) * EPSILON * (size @ other_size)
        if other.radius is not None:
            radius += size @ other.radius
            other_size = other_size + other.radius
        if self.radius is not None:
            radius += self.radius @ other_size
        radius = radius * (1.0 + 4.0 * (terms + 4) * EPSILON) + 8.0 * (terms + 1) * TINY
        return type(self)(self.middle @ other.middle, radius)

    def times(self, scalar: float) -> Self:
        """The matrix times the exact value of a float."""
        middle = self.middle * scalar
        radius = EPSILON * np.abs(middle) + TINY
        if self.radius is not None:
            radius = radius + self.radius * abs(scalar) + TINY
        return type(self)(middle, radius * (1.0 + 8.0 * EPSILON))

    def over(self, count: int) -> Self:
        """The matrix divided by a whole number."""
        if count == 1:
            return self
        middle = self.middle / count
        radius = EPSILON * np.abs(middle) + TINY
        if self.radius is not None:
            radius = radius + self.radius / count + TINY
        return type(self)(middle, radius * (1.0 + 8.0 * EPSILON))

    def take(self, rows: Sequence[int]) -> Self:
        """Some of the rows."""
        index = list(rows)
        return type(self)(self.middle[index], None if self.radius is None else self.radius[index])

    def inverse(self) -> Self:
        """Inverse with a bound: with Y near it and E = I - Y M, |M^-1 - Y| <= e / (1 - e) max |Y|, e = |E| < 1."""
        try:
            near = np.linalg.inv(self.middle)
        except np.linalg.LinAlgError as singular:
            raise NotDecided("the midpoint is singular") from singular
        kind = type(self)
        rest = kind.of(np.eye(self.shape[0])) - kind.of(near) @ self
        size = float(np.max(np.sum(np.abs(rest.middle) + rest.spread, axis=1), initial=0.0))
        size *= 1.0 + 4.0 * (self.shape[0] + 4) * EPSILON
        if not size < 0.5:
            raise NotDecided("the matrix may be singular")
        factor = size / (1.0 - size) * (1.0 + 16.0 * EPSILON)
        largest = np.max(np.abs(near), axis=0, initial=0.0)
        radius: FloatArray = np.zeros(near.shape) + (factor * largest * (1.0 + 8.0 * EPSILON) + TINY)
        return kind(np.asarray(near, dtype=np.float64), radius)


def definite(matrix: Enclosure) -> tuple[bool, float, bool]:
    """Whether every symmetric matrix of an enclosure is positive definite, by one Cholesky factorisation.

    Returns (proved, smallest eigenvalue of the scaled midpoint, hopeless). Rows and columns are scaled by powers of
    two so that the diagonal is near one. If the rounded factorisation of S - diag(r) - c I runs to its end, then S > 0:
    the factor's product differs from it by at most phi trace S, phi = (n + 1) u / (1 - 2 (n + 1) u), and row sums r of
    the radius cover the enclosure. c is four times that, which leaves room for factorisations that multiply by
    reciprocals (Rump, BIT 46 (2006) 433; Demmel, LAPACK working note 14).

    Examples
    --------
    >>> definite(Enclosure.of([[1.0, 0.0], [0.0, 1e-30]]))[0], definite(Enclosure.of([[1.0, 1.0], [1.0, 1.0]]))[0]
    (True, False)
    """
    n = matrix.shape[0]
    if n == 0:
        return True, np.inf, False
    middle, radius = matrix.middle, matrix.spread
    if not (middle == middle.T).all():  # the exact matrix is symmetric: either half encloses both
        middle = np.tril(middle) + np.tril(middle, -1).T
    radius = np.maximum(radius, radius.T)
    if not (np.isfinite(middle).all() and np.isfinite(radius).all()):
        return False, -np.inf, False
    diagonal = np.diag(middle)
    size = np.where(diagonal == 0.0, np.max(np.abs(middle), initial=TINY) or 1.0, np.abs(diagonal))
    power = -(np.frexp(size)[1] // 2)
    middle = np.ldexp(np.ldexp(middle, power[:, None]), power)
    radius = np.ldexp(np.ldexp(radius, power[:, None]), power) + 4.0 * TINY
    if not (np.isfinite(middle).all() and np.isfinite(radius).all()):
        return False, -np.inf, False
    margin = float(np.linalg.eigvalsh(middle)[0])
    diagonal = np.diag(middle)
    spread = np.sum(radius, axis=1) * (1.0 + 2.0 * (n + 2) * EPSILON)
    factor_error = (2 * n + 8) * EPSILON * float(np.sum(np.abs(diagonal))) * 1.01 + 2.0**-900
    shift = (spread + factor_error + 2.0 * EPSILON * np.abs(diagonal)) * (1.0 + 8.0 * EPSILON)
    hopeless = margin < -1e-9 - 4.0 * float(np.max(shift))
    if not (n * EPSILON < 1e-3 and np.all(diagonal > shift)):
        return False, margin, hopeless
    shifted = middle.copy()
    shifted[np.arange(n), np.arange(n)] = diagonal - shift
    try:
        factor = np.linalg.cholesky(shifted)
    except np.linalg.LinAlgError:
        return False, margin, hopeless
    proved = bool(np.isfinite(factor).all() and np.all(np.diag(factor) > 0.0))
    return proved, margin, hopeless and not proved
