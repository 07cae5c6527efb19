"""Chebyshev interpolation of array-valued functions, with the tail of the series as error estimate."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from maglev_ctrl.arrays import FloatArray


@dataclass(frozen=True, eq=False, slots=True)
class ChebyshevSeries:
    """Sum over k of coefficients[k] T_k(x), x = `lower`..`upper` mapped to -1..1; `coefficients` (m, ...)."""

    coefficients: FloatArray
    lower: float
    upper: float

    @property
    def tail(self) -> float:
        """Norm of the last two coefficient arrays over the largest: the relative size of what was cut off.

        For an entire function the coefficients fall faster than geometrically, so the last two kept ones exceed the
        sum of those left out once they fall at all.
        """
        norms = np.sqrt(np.sum(self.coefficients.reshape(len(self.coefficients), -1) ** 2, axis=1))
        largest = float(np.max(norms))
        return float(norms[-1] + norms[-2]) / largest if largest > 0.0 else 0.0

    def __call__(self, points: FloatArray) -> FloatArray:
        """Values at `points` (p,): (p, ...).

        Raises
        ------
        ValueError : a point outside lower..upper
        """
        x = np.asarray(points, dtype=np.float64)
        slack = 1e-12 * max(abs(self.lower), abs(self.upper))
        if np.any(x < self.lower - slack) or np.any(x > self.upper + slack):
            raise ValueError(f"points: expected values within {self.lower:g}..{self.upper:g}")
        basis = _basis(_to_unit(x, self.lower, self.upper), len(self.coefficients))
        flat = basis @ self.coefficients.reshape(len(self.coefficients), -1)
        return np.asarray(flat.reshape(x.shape + self.coefficients.shape[1:]))


def chebyshev_points(count: int, *, lower: float, upper: float) -> FloatArray:
    """`count` extreme points of T_(count-1), ascending; the points of 2 count - 1 contain them.

    Examples
    --------
    >>> chebyshev_points(3, lower=0.0, upper=1.0)
    array([0. , 0.5, 1. ])
    """
    unit = -np.cos(np.pi * np.arange(count) / (count - 1))
    unit[[0, -1]] = -1.0, 1.0
    if count % 2:
        unit[count // 2] = 0.0
    return np.asarray(0.5 * (lower + upper) + 0.5 * (upper - lower) * unit)


def chebyshev_series(values: FloatArray, *, lower: float, upper: float) -> ChebyshevSeries:
    """The interpolating series through `values` (m, ...) at `chebyshev_points(m)`.

    Examples
    --------
    >>> x = chebyshev_points(12, lower=0.0, upper=2.0)
    >>> series = chebyshev_series(np.exp(x), lower=0.0, upper=2.0)
    >>> bool(abs(series(np.array([1.3]))[0] - np.exp(1.3)) < 1e-9)
    True
    """
    count = len(values)
    k = np.arange(count)
    weights = np.ones(count)
    weights[[0, -1]] = 0.5
    # T_k at -cos(pi j/(m-1)) is (-1)^k cos(pi j k/(m-1)): a cosine transform of type I
    transform = np.cos(np.pi * np.outer(k, k) / (count - 1)) * weights * weights[:, None] * 2.0 / (count - 1)
    transform *= ((-1.0) ** k)[:, None]
    flat = transform @ np.asarray(values, dtype=np.float64).reshape(count, -1)
    return ChebyshevSeries(flat.reshape(values.shape), lower, upper)


def _to_unit(x: FloatArray, lower: float, upper: float) -> FloatArray:
    return np.asarray((2.0 * x - lower - upper) / (upper - lower))


def _basis(unit: FloatArray, count: int) -> FloatArray:
    angle = np.arccos(np.clip(unit, -1.0, 1.0))
    return np.asarray(np.cos(angle[..., None] * np.arange(count)))
