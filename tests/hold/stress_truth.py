"""The truth of the stress set: polynomials and half planes in integers, without one rounding.

A floating-point number is an integer times a power of two, so the characteristic polynomial of given matrices is exact
(determinants at whole numbers, then interpolation), and Routh's table, in fractions, counts its roots right of the
axis. Nothing here is shared with the project: its own exact count is judged by this one too.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from itertools import pairwise
from math import gcd, lcm

import numpy as np
from numpy.typing import ArrayLike

Polynomial = list[Fraction]  # from the constant term up, the last one not zero
Matrix = list[list[Fraction]]


def fractions_of(matrix: ArrayLike) -> Matrix:
    """The entries as they are stored, exactly."""
    return [[Fraction(float(value)) for value in row] for row in np.atleast_2d(np.asarray(matrix, dtype=np.float64))]


def floats_of(matrix: Matrix) -> tuple[np.ndarray, bool]:
    """Nearest floating-point matrix, and whether it is the same one."""
    array = np.array([[float(value) for value in row] for row in matrix], dtype=np.float64)
    return array, fractions_of(array) == [list(row) for row in matrix]


def product(left: Matrix, right: Matrix) -> Matrix:
    """The product of two matrices."""
    columns = list(zip(*right, strict=True))
    return [[sum((a * b for a, b in zip(row, column, strict=True)), Fraction(0)) for column in columns] for row in left]


def pencil_polynomial(coefficients: Sequence[Matrix]) -> Polynomial:
    """det(sum_k coefficients[k] s^k) of square matrices; [] where it vanishes identically."""
    n = len(coefficients[0])
    scale = lcm(*(value.denominator for matrix in coefficients for row in matrix for value in row), 1)
    whole = [[[int(value * scale) for value in row] for row in matrix] for matrix in coefficients]
    degree = n * (len(coefficients) - 1)
    values = []
    for point in range(degree + 1):
        powers = [point**k for k in range(len(whole))]
        values.append(
            _determinant([
                [sum(p * matrix[i][j] for p, matrix in zip(powers, whole, strict=True)) for j in range(n)]
                for i in range(n)
            ])
        )  # fmt: skip
    return _interpolated(values)


def characteristic(A: Matrix) -> Polynomial:
    """det(s I - A)."""
    n = len(A)
    identity = [[Fraction(int(i == j)) for j in range(n)] for i in range(n)]
    return pencil_polynomial([[[-value for value in row] for row in A], identity])


def roots_right(polynomial: Polynomial) -> tuple[int, int]:
    """Number of roots with Re s > 0, and with Re s = 0, multiplicities counted; by Routh's table."""
    p = _trimmed(polynomial)
    if not p:
        raise ValueError("polynomial: expected one that is not zero")
    zeros = next(k for k, value in enumerate(p) if value != 0)
    p = p[zeros:]
    # What p(s) and p(-s) share is symmetric about the origin: roots on the axis, and mirrored ones.
    shared = _greatest_divisor(p, [value * (-1) ** k for k, value in enumerate(p)])
    rest = _quotient(p, shared)
    pairs = _symmetric(shared)
    right = _table(rest) + pairs[0]
    return right, zeros + pairs[1]


def growth_sign(polynomial: Polynomial) -> int:
    """-1 where every root lies left of the axis, 1 where one lies right of it, 0 where the rightmost lie on it."""
    right, axis = roots_right(polynomial)
    return 1 if right else (0 if axis else -1)


def roots_outside(polynomial: Polynomial) -> int:
    """-1, 0, 1 for the unit circle: the roots z = (1 + s) / (1 - s) mapped to the half plane."""
    p = _trimmed(polynomial)
    degree = len(p) - 1
    mapped = [Fraction(0)] * (degree + 1)
    for k, value in enumerate(p):
        term = [Fraction(1)]
        for _ in range(k):
            term = times(term, [Fraction(1), Fraction(1)])
        for _ in range(degree - k):
            term = times(term, [Fraction(1), Fraction(-1)])
        mapped = [a + value * b for a, b in zip(mapped, term, strict=True)]
    at_minus_one = degree + 1 - len(_trimmed(mapped))  # a lost degree is a root at z = -1, on the circle
    sign = growth_sign(_trimmed(mapped)) if len(_trimmed(mapped)) > 1 else -1
    return max(sign, 0) if at_minus_one else sign


def _symmetric(p: Polynomial) -> tuple[int, int]:
    """Roots right of and on the axis of an even polynomial, by the derivative that replaces Routh's row of zeros."""
    right = axis = 0
    while len(p) > 1:
        derivative = [k * value for k, value in enumerate(p)][1:]
        repeated = _greatest_divisor(p, derivative)
        simple = _quotient(p, repeated)  # every root once; the repeated ones come again below
        derivative = [k * value for k, value in enumerate(simple)][1:]
        crossed = _table([a + b for a, b in zip(simple, [*derivative, Fraction(0)], strict=True)])
        right += crossed
        axis += len(simple) - 1 - 2 * crossed
        p = repeated
    return right, axis


def _table(p: Polynomial) -> int:
    """Sign changes in the first column of Routh's table of a polynomial without symmetric roots."""
    if len(p) < 2:
        return 0
    for shift in range(50):  # a zero that opens a row goes away with another factor (s + a), a > 0
        column = _first_column(p if not shift else times(p, [Fraction(2 * shift + 1), Fraction(1)]))
        if column is not None:
            return sum(1 for a, b in pairwise(column) if (a > 0) != (b > 0))
    raise ArithmeticError("Routh's table stays singular")


def _first_column(p: Polynomial) -> list[Fraction] | None:
    upper, lower = p[::-1][0::2], p[::-1][1::2]
    column = [upper[0]]
    while lower:
        if lower[0] == 0:
            return None
        column.append(lower[0])
        ratio = upper[0] / lower[0]
        padded = [*lower, *[Fraction(0)] * (len(upper) - len(lower))]
        following = [a - ratio * b for a, b in zip(upper[1:], padded[1:], strict=True)]
        # a positive factor keeps every sign and the numbers short
        upper, lower = lower, _shortened(following)
    return column


def _shortened(row: list[Fraction]) -> list[Fraction]:
    size = gcd(*(value.numerator for value in row)) if any(row) else 1
    scale = lcm(*(value.denominator for value in row), 1)
    return [value * scale / size for value in row]


def _determinant(rows: list[list[int]]) -> int:
    """Bareiss: every division is exact."""
    rows, sign, last = [list(row) for row in rows], 1, 1
    n = len(rows)
    for k in range(n - 1):
        pivot = next((i for i in range(k, n) if rows[i][k]), None)
        if pivot is None:
            return 0
        if pivot != k:
            rows[k], rows[pivot], sign = rows[pivot], rows[k], -sign
        top, lead = rows[k], rows[k][k]
        for i in range(k + 1, n):
            row, first = rows[i], rows[i][k]
            rows[i] = [0] * (k + 1) + [(lead * row[j] - first * top[j]) // last for j in range(k + 1, n)]
        last = lead
    return sign * rows[-1][-1]


def _interpolated(values: list[int]) -> Polynomial:
    """The polynomial through (0, values[0]), (1, values[1]), ... by Newton's differences."""
    differences, table = [Fraction(values[0])], [Fraction(v) for v in values]
    for order in range(1, len(values)):
        table = [(b - a) / order for a, b in pairwise(table)]
        differences.append(table[0])
    p: Polynomial = [Fraction(0)]
    for k in reversed(range(len(differences))):
        p = times(p, [Fraction(-k), Fraction(1)])
        p[0] += differences[k]
    return _trimmed(p)


def times(a: Polynomial, b: Polynomial) -> Polynomial:
    """The product of two polynomials."""
    result = [Fraction(0)] * (len(a) + len(b) - 1)
    for i, x in enumerate(a):
        for j, y in enumerate(b):
            result[i + j] += x * y
    return result


def _trimmed(p: Sequence[Fraction]) -> Polynomial:
    end = len(p)
    while end and p[end - 1] == 0:
        end -= 1
    return list(p[:end])


def _divided(a: Polynomial, b: Polynomial) -> tuple[Polynomial, Polynomial]:
    rest, quotient = list(a), [Fraction(0)] * max(len(a) - len(b) + 1, 1)
    while len(rest) >= len(b):
        factor, offset = rest[-1] / b[-1], len(rest) - len(b)
        quotient[offset] = factor
        for k, value in enumerate(b):
            rest[offset + k] -= factor * value
        rest = _trimmed(rest[:-1])
    return _trimmed(quotient), rest


def _quotient(a: Polynomial, b: Polynomial) -> Polynomial:
    return _divided(a, b)[0]


def _greatest_divisor(a: Polynomial, b: Polynomial) -> Polynomial:
    first, second = _trimmed(a), _trimmed(b)
    while second:
        rest = _divided(first, second)[1] if len(first) >= len(second) else first
        first, second = second, _shortened(rest) if rest else []
    return [value / first[-1] for value in first]
