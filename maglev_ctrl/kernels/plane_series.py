"""Chebyshev series of an array-valued function of two variables on a rectangle, with the tail in each direction.

Either variable may enter by its reciprocal: a propagator over one period is entire in the period, so in 1/speed.
A map is evaluated row by row: one product contracts the first direction, a second one per row the other direction.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.kernels.chebyshev import chebyshev_points, chebyshev_series


@dataclass(frozen=True, slots=True)
class Direction:
    """One variable from `lower` to `upper`, entering by its reciprocal where `reciprocal`.

    Examples
    --------
    >>> Direction(1.0, 2.0, True).points(3)
    array([1.        , 1.33333333, 2.        ])
    """

    lower: float
    upper: float
    reciprocal: bool = False

    def points(self, count: int) -> FloatArray:
        """Chebyshev points, ascending in the variable itself."""
        low, high = self._ends()
        inner = chebyshev_points(count, lower=low, upper=high)
        if not self.reciprocal:
            return inner
        found = 1.0 / inner[::-1]
        found[[0, -1]] = self.lower, self.upper  # the reciprocal of a reciprocal may leave the range by rounding
        return np.asarray(found)

    def basis(self, points: FloatArray, count: int) -> FloatArray:
        """Chebyshev polynomials at `points` (p,): (p, count).

        Raises
        ------
        ValueError : a point outside lower..upper
        """
        values = np.asarray(points, dtype=np.float64)
        slack = 1e-12 * max(abs(self.lower), abs(self.upper))
        if np.any(values < self.lower - slack) or np.any(values > self.upper + slack):
            raise ValueError(f"points: expected values within {self.lower:g}..{self.upper:g}")
        low, high = self._ends()
        inner = 1.0 / values if self.reciprocal else values
        unit = (2.0 * inner - low - high) / (high - low)
        angle = np.arccos(np.clip(unit, -1.0, 1.0))
        return np.asarray(np.cos(angle[:, None] * np.arange(count)))

    def coefficients(self, values: FloatArray) -> FloatArray:
        """Chebyshev coefficients along the first axis of values at `points`."""
        low, high = self._ends()
        ordered = values[::-1] if self.reciprocal else values
        return chebyshev_series(ordered, lower=low, upper=high).coefficients

    def _ends(self) -> tuple[float, float]:
        return (1.0 / self.upper, 1.0 / self.lower) if self.reciprocal else (self.lower, self.upper)


@dataclass(frozen=True, eq=False, slots=True)
class PlaneSeries:
    """Sum over k, l of coefficients[k, l] T_k(x) T_l(y); `coefficients` (m_x, m_y, ...).

    `error` bounds the Frobenius norm of what was cut off: the tails in both directions times the largest coefficient.
    """

    coefficients: FloatArray
    x: Direction
    y: Direction
    error: float

    def rows(self, points: FloatArray) -> FloatArray:
        """Coefficients in y alone at each x of `points` (p,): (p, m_y, ...)."""
        basis = self.x.basis(points, len(self.coefficients))
        flat = basis @ self.coefficients.reshape(len(self.coefficients), -1)
        return np.asarray(flat.reshape(len(points), *self.coefficients.shape[1:]))

    def y_basis(self, points: FloatArray) -> FloatArray:
        """Polynomials in y at `points` (q,): (q, m_y); times one of `rows` they give the values of that row."""
        return self.y.basis(points, self.coefficients.shape[1])

    def grid(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Values on the grid of `x` (p,) and `y` (q,): (p, q, ...).

        Examples
        --------
        >>> x, y = Direction(0.0, 1.0), Direction(1.0, 2.0, reciprocal=True)
        >>> values = np.exp(np.subtract.outer(x.points(12), 1.0 / y.points(12)))
        >>> series = plane_series(values, x=x, y=y)
        >>> bool(abs(series.grid(np.array([0.3]), np.array([1.7]))[0, 0] - np.exp(0.3 - 1 / 1.7)) < 1e-11)
        True
        """
        flat = self.rows(x).reshape(len(x), self.coefficients.shape[1], -1)
        values = self.y_basis(y) @ flat
        return np.asarray(values.reshape(len(x), len(y), *self.coefficients.shape[2:]))

    def points(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Values at pairs of `x` and `y` (p,): (p, ...)."""
        flat = self.rows(x).reshape(len(x), self.coefficients.shape[1], -1)
        values = np.einsum("pl,plz->pz", self.y_basis(y), flat)
        return np.asarray(values.reshape(len(x), *self.coefficients.shape[2:]))


@dataclass(frozen=True, slots=True)
class Tails:
    """Norms of the coefficients of the last two slices in each direction, added up, and those of the largest slice."""

    x: float
    y: float
    largest: float


def tails(coefficients: FloatArray) -> Tails:
    """How far the series has fallen in either direction.

    For an entire function the coefficients fall faster than geometrically, so the last two kept ones exceed the sum of
    those left out once they fall at all.
    """
    norms = _norms(coefficients)
    along_x, along_y = np.sum(norms, axis=1), np.sum(norms, axis=0)
    largest = float(np.max(along_x))
    return Tails(float(np.sum(along_x[-2:])), float(np.sum(along_y[-2:])), largest)


def _norms(coefficients: FloatArray) -> FloatArray:
    """Frobenius norm of each coefficient (m_x, m_y); their sum bounds the sum of the terms, as |T_k T_l| <= 1."""
    flat = coefficients.reshape(*coefficients.shape[:2], -1)
    return np.asarray(np.sqrt(np.einsum("klz,klz->kl", flat, flat)))


def plane_series(values: FloatArray, *, x: Direction, y: Direction) -> PlaneSeries:
    """The interpolating series through `values` (m_x, m_y, ...) at the points of `x` and `y`."""
    across = x.coefficients(values)
    both = np.moveaxis(y.coefficients(np.ascontiguousarray(np.moveaxis(across, 1, 0))), 0, 1)
    end = tails(both)
    return PlaneSeries(np.ascontiguousarray(both), x, y, end.x + end.y)


def shortened(series: PlaneSeries, *, allowed: float) -> PlaneSeries:
    """The series without trailing terms whose norms add up to at most `allowed`; `error` grows by what they add up to.

    Examples
    --------
    >>> unit = Direction(-1.0, 1.0)
    >>> series = PlaneSeries(np.array([[1.0, 1e-13], [1e-14, 0.0]]), unit, unit, 0.0)
    >>> shortened(series, allowed=1e-12).coefficients.shape
    (1, 1)
    """
    kept, dropped = series.coefficients, 0.0
    for axis in (0, 1):
        behind = np.cumsum(np.sum(_norms(kept), axis=1 - axis)[::-1])[::-1]
        keep = max(1, int(np.count_nonzero(behind > 0.5 * allowed)))
        dropped += float(behind[keep]) if keep < len(behind) else 0.0
        kept = kept[:keep] if axis == 0 else kept[:, :keep]
    return replace(series, coefficients=np.ascontiguousarray(kept), error=series.error + dropped)
