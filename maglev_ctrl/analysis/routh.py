"""Routh's problem in exact arithmetic: how many roots left of, on and right of the imaginary axis.

Floating-point numbers are rationals, so the characteristic polynomial of given matrices and the Sturm chain of its
real and imaginary parts on the axis can be formed without any rounding. Slow and exact: an oracle for small systems
(about ten states), not a tool for sweeps.

Reference: Gantmacher, The Theory of Matrices, vol. 2, ch. XV (Cauchy index, singular cases included).
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise

import numpy as np

from maglev_ctrl.analysis.spectrum import descriptor_pencil
from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.errors import ModelError
from maglev_ctrl.systems import SecondOrderSystem

Polynomial = list[Fraction]  # coefficients from the constant term up; the last one is not zero; [] is zero
Matrix = list[list[Fraction]]


@dataclass(frozen=True, eq=False, slots=True)
class RootCount:
    """Exact numbers of roots with Re s < 0, = 0 and > 0, multiplicities counted."""

    left: int
    axis: int
    right: int


def exact_root_count(system: SecondOrderSystem) -> RootCount:
    """Exact count of the system's eigenvalues left of, on and right of the imaginary axis.

    Raises
    ------
    ModelError : the mass matrix is singular

    Examples
    --------
    >>> exact_root_count(SecondOrderSystem.from_matrices([[1.0]], [[0.0]], [[4.0]])).axis
    2
    """
    E, A = descriptor_pencil(system)
    return root_count(characteristic_polynomial(_solve(_rational(E), _rational(A))))


def root_count(polynomial: Polynomial) -> RootCount:
    """Roots of a real polynomial (coefficients from the constant term up) by half plane, exactly.

    Raises
    ------
    ValueError : the polynomial is zero

    Examples
    --------
    >>> count = root_count([Fraction(2), Fraction(1), Fraction(2), Fraction(1)])  # (s + 2)(s^2 + 1)
    >>> count.left, count.axis, count.right
    (1, 2, 0)
    """
    p = _trim(polynomial)
    if not p:
        raise ValueError("polynomial: expected one that is not zero")
    degree = len(p) - 1
    # On s = i w the polynomial is U(w) + i V(w).
    U = _trim([c * (1, 0, -1, 0)[k % 4] for k, c in enumerate(p)])
    V = _trim([c * (0, 1, 0, -1)[k % 4] for k, c in enumerate(p)])
    chain = _sturm_chain(U, V) if degree % 2 == 0 else _sturm_chain(V, U)
    index = _variations(chain, -1) - _variations(chain, +1)
    left_minus_right = -index if degree % 2 == 0 else index
    axis = _real_roots(chain[-1])
    right = (degree - axis - left_minus_right) // 2
    return RootCount(degree - axis - right, axis, right)


def characteristic_polynomial(A: Matrix) -> Polynomial:
    """det(s I - A) from the constant term up, by Faddeev-LeVerrier in rationals.

    Examples
    --------
    >>> [int(c) for c in characteristic_polynomial([[Fraction(0), Fraction(1)], [Fraction(-4), Fraction(-1)]])]
    [4, 1, 1]
    """
    n = len(A)
    coefficients = [Fraction(1)]
    product: Matrix = [[Fraction(0)] * n for _ in range(n)]
    for k in range(1, n + 1):
        for i in range(n):
            product[i][i] += coefficients[-1]
        columns = list(zip(*product, strict=True))
        product = [[sum((a * b for a, b in zip(row, col, strict=True)), Fraction(0)) for col in columns] for row in A]
        coefficients.append(-sum((product[i][i] for i in range(n)), Fraction(0)) / k)
    return coefficients[::-1]


def _rational(matrix: FloatArray) -> Matrix:
    if matrix.ndim != 2:
        raise ValueError(f"system: expected one system without batch axes, got matrices of shape {matrix.shape}")
    return [[Fraction(float(value)) for value in row] for row in np.asarray(matrix)]


def _solve(E: Matrix, A: Matrix) -> Matrix:
    """E^-1 A by Gauss-Jordan."""
    n = len(E)
    rows = [list(e) + list(a) for e, a in zip(E, A, strict=True)]
    for k in range(n):
        pivot = next((i for i in range(k, n) if rows[i][k] != 0), None)
        if pivot is None:
            raise ModelError("mass matrix: singular, so accelerations are not determined")
        rows[k], rows[pivot] = rows[pivot], rows[k]
        rows[k] = [value / rows[k][k] for value in rows[k]]
        for i in range(n):
            if i != k and rows[i][k] != 0:
                factor = rows[i][k]
                rows[i] = [a - factor * b for a, b in zip(rows[i], rows[k], strict=True)]
    return [row[n:] for row in rows]


def _trim(polynomial: Polynomial) -> Polynomial:
    end = len(polynomial)
    while end and polynomial[end - 1] == 0:
        end -= 1
    return list(polynomial[:end])


def _remainder(a: Polynomial, b: Polynomial) -> Polynomial:
    rest = list(a)
    while len(rest) >= len(b):
        factor, offset = rest[-1] / b[-1], len(rest) - len(b)
        for k, c in enumerate(b):
            rest[offset + k] -= factor * c
        rest = _trim(rest[:-1])
    return rest


def _sturm_chain(first: Polynomial, second: Polynomial) -> list[Polynomial]:
    """Signed remainders down to the greatest common divisor (the last entry)."""
    chain = [_trim(first)]
    following = _trim(second)
    while following:
        chain.append([c / abs(following[-1]) for c in following])  # a positive factor keeps every sign
        following = [-c for c in _remainder(chain[-2], chain[-1])]
    return chain


def _variations(chain: list[Polynomial], side: int) -> int:
    """Sign changes of the chain at w = -infinity (side -1) or +infinity (+1)."""
    signs = [(1 if p[-1] > 0 else -1) * (side if (len(p) - 1) % 2 else 1) for p in chain]
    return sum(1 for a, b in pairwise(signs) if a != b)


def _real_roots(polynomial: Polynomial) -> int:
    """Number of real roots with multiplicity: distinct roots of p, of gcd(p, p'), and so on."""
    total, p = 0, polynomial
    while len(p) > 1:
        chain = _sturm_chain(p, _trim([k * c for k, c in enumerate(p)][1:]))
        total += _variations(chain, -1) - _variations(chain, +1)
        p = chain[-1]
    return total
