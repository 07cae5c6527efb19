"""Tensor-product spline through forces measured on a regular grid."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import NdBSpline, make_interp_spline

from maglev_ctrl.arrays import FloatArray

LARGEST_DEGREE = 3


@dataclass(frozen=True, eq=False, slots=True)
class SplineSurface:
    """Interpolating spline of several values over a grid; cubic where an axis has four points, lower where fewer.

    An axis with a single point is left out: the surface is constant along it.
    """

    axes: tuple[FloatArray, ...]
    spline: NdBSpline | None
    level: FloatArray

    @property
    def active(self) -> tuple[int, ...]:
        """The axes along which the surface changes."""
        return tuple(i for i, axis in enumerate(self.axes) if axis.size > 1)

    def value(self, points: FloatArray, *, derivative: int | None = None) -> FloatArray:
        """Values (..., r) at points (..., d), or their partial by coordinate `derivative`."""
        shape = (*points.shape[:-1], self.level.size)
        active = self.active
        if derivative is not None and derivative not in active:
            return np.zeros(shape)
        if self.spline is None:
            return np.broadcast_to(self.level, shape).copy()
        order = [int(axis == derivative) for axis in active]
        return np.asarray(self.spline(points[..., list(active)], nu=order), dtype=np.float64)


def fit_spline(axes: tuple[FloatArray, ...], values: FloatArray) -> SplineSurface:
    """The tensor spline through `values` (n_1, ..., n_d, r) on strictly increasing `axes` (n_i,).

    Examples
    --------
    >>> x = np.linspace(0.0, 1.0, 5)
    >>> surface = fit_spline((x, np.array([2.0])), (x**3)[:, None, None])
    >>> round(float(surface.value(np.array([0.3, 2.0]), derivative=0)[0]), 12)     # 3 x^2
    0.27
    """
    many = [i for i, axis in enumerate(axes) if axis.size > 1]
    coefficients = values.reshape(*(axes[i].size for i in many), values.shape[-1])
    if not many:
        return SplineSurface(axes=axes, spline=None, level=coefficients)
    knots, degrees = [], []
    for position, i in enumerate(many):
        degree = min(LARGEST_DEGREE, axes[i].size - 1)
        line = make_interp_spline(axes[i], coefficients, k=degree, axis=position)
        # make_interp_spline moves the axis it worked on to the front
        coefficients = np.moveaxis(line.c, 0, position)
        knots.append(line.t)
        degrees.append(degree)
    spline = NdBSpline(tuple(knots), np.ascontiguousarray(coefficients), tuple(degrees), extrapolate=False)
    return SplineSurface(axes=axes, spline=spline, level=np.zeros(values.shape[-1]))


def halved_grid_errors(axes: tuple[FloatArray, ...], values: FloatArray) -> FloatArray | None:
    """Errors (N, r) at the points left out by a spline through every second grid line (both ends kept).

    An honest upper estimate of the interpolation error; None when no axis has a line to spare.
    """
    kept = [np.unique(np.append(np.arange(0, axis.size, 2), axis.size - 1)) for axis in axes]
    if all(lines.size == axis.size for lines, axis in zip(kept, axes, strict=True)):
        return None
    coarse = fit_spline(
        tuple(axis[lines] for axis, lines in zip(axes, kept, strict=True)), np.ascontiguousarray(values[np.ix_(*kept)])
    )
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    left_out = np.ones(points.shape[:-1], dtype=bool)
    left_out[np.ix_(*kept)] = False
    return np.asarray(coarse.value(points[left_out]) - values[left_out])
