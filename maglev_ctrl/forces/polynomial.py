"""Least-squares polynomial through scattered force samples, on scaled variables."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.polynomial import chebyshev

from maglev_ctrl.arrays import FloatArray


@dataclass(frozen=True, eq=False, slots=True)
class PolynomialSurface:
    """Polynomial of several values in Chebyshev products of variables scaled to [-1, 1].

    `powers` (terms, d) are the degrees of each term; a variable with one sampled value has only degree 0.
    """

    middle: FloatArray
    half_width: FloatArray
    powers: tuple[tuple[int, ...], ...]
    coefficients: FloatArray

    def value(self, points: FloatArray, *, derivative: int | None = None) -> FloatArray:
        """Values (..., r) at points (..., d), or their partial by coordinate `derivative`."""
        return np.asarray(self.terms(points, derivative=derivative) @ self.coefficients)

    def terms(self, points: FloatArray, *, derivative: int | None = None) -> FloatArray:
        """Each term (..., terms) at the points, or its partial by coordinate `derivative`."""
        scaled = (points - self.middle) / self.half_width
        powers = np.array(self.powers)
        result = np.ones((*points.shape[:-1], len(self.powers)))
        for axis in range(powers.shape[1]):
            top = int(powers[:, axis].max())
            basis = chebyshev.chebvander(scaled[..., axis], top).reshape(*points.shape[:-1], top + 1)
            if axis == derivative:
                # column p of the slopes: coefficients of T_p' in T_0, T_1, ...
                slopes = np.zeros((top + 1, top + 1))
                for power in range(1, top + 1):
                    slopes[:power, power] = chebyshev.chebder(np.eye(top + 1)[power])[:power]
                basis = basis @ slopes / self.half_width[axis]
            result = result * basis[..., powers[:, axis]]
        return result


def fit_polynomial(points: FloatArray, values: FloatArray, *, degree: int) -> tuple[PolynomialSurface, FloatArray]:
    """Least-squares polynomial of total degree `degree`, and its leave-one-out errors (N, r) from the hat matrix.

    In each variable the degree is at most one less than the number of different values sampled.

    Parameters
    ----------
    points : (N, d)
    values : (N, r)
    degree : total degree, at least 1

    Raises
    ------
    ValueError : fewer samples than the terms need, or samples that do not determine every term

    Examples
    --------
    >>> x = np.linspace(0.0, 2.0, 6)[:, None]
    >>> surface, errors = fit_polynomial(x, x**2, degree=2)
    >>> round(float(surface.value(np.array([1.5]), derivative=0)[0]), 12), bool(np.abs(errors).max() < 1e-12)
    (3.0, True)
    """
    if degree < 1:
        raise ValueError(f"degree: expected at least 1, got {degree}")
    lower, upper = points.min(axis=0), points.max(axis=0)
    half_width = np.where(upper > lower, (upper - lower) / 2.0, 1.0)
    most = [min(degree, np.unique(column).size - 1) for column in points.T]
    powers = tuple(p for p in product(*(range(top + 1) for top in most)) if sum(p) <= degree)
    if len(points) <= len(powers):
        raise ValueError(
            f"samples: a polynomial of degree {degree} has {len(powers)} terms here and needs at least "
            f"{len(powers) + 1} samples, got {len(points)}"
        )
    blank = PolynomialSurface((lower + upper) / 2.0, half_width, powers, np.zeros((len(powers), values.shape[1])))
    design = blank.terms(points)
    orthogonal, triangle = np.linalg.qr(design)
    pivots = np.abs(np.diag(triangle))
    leverage = np.sum(orthogonal**2, axis=1)
    if pivots.min() <= 1e-10 * pivots.max() or leverage.max() >= 1.0 - 1e-9:
        raise ValueError(
            f"samples: they do not determine every term of a polynomial of degree {degree}; "
            "lower the degree or add samples"
        )
    coefficients = np.linalg.solve(triangle, orthogonal.T @ values)
    surface = PolynomialSurface(blank.middle, half_width, powers, coefficients)
    errors = (values - design @ coefficients) / (1.0 - leverage)[:, None]
    return surface, np.asarray(errors)
