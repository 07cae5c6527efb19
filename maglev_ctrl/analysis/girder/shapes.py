"""Shapes of a guideway in smooth pieces: exact Fourier coefficients, periodic integrals and bounds on the tail.

Every piece is a polynomial in Legendre form. Its Fourier integral is closed,

    Int_-1^1 P_n(x) exp(-i q x) dx = 2 (-i)^n j_n(q)        (DLMF 18.17.19)

with the spherical Bessel functions j_n, so a coefficient is exact to rounding at any order.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import pi

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import ArrayLike, NDArray
from scipy.special import spherical_jn

from maglev_ctrl.arrays import ComplexArray, FloatArray, read_only
from maglev_ctrl.vehicle.guideway_sources import DisplacedGuideway, require_length

NODES = 28
"""Gauss positions in a smooth piece: enough for a half sine to rounding."""
UNRESOLVED = 1e-11  # of the largest coefficient: what the last two may hold
ROUNDING = 1e-13  # of the largest coefficient: a step below it is none


@dataclass(frozen=True, eq=False, slots=True)
class PieceShape:
    """Displacement of a guideway by pieces of polynomials, once (`periodic` false) or repeated with every span.

    `breaks` (b + 1,) m, ascending; `coefficients` (b, d + 1) m, Legendre form of each piece. A shape that is not
    periodic keeps its first value before its pieces and its last value after them. Built by `from_source`, `polyline`
    or `step`.
    """

    breaks: FloatArray
    coefficients: FloatArray
    periodic: bool = True

    @classmethod
    def from_source(cls, source: DisplacedGuideway, *, lateral: bool = False) -> PieceShape:
        """The rise (or the narrowing) of a displaced guideway about its mean, as a periodic shape.

        Raises
        ------
        ValueError : the source's profile is not smooth between its breaks

        Examples
        --------
        >>> from maglev_ctrl.vehicle.guideway_sources import girder_bow
        >>> sag = PieceShape.from_source(girder_bow("girder", span=25.0, rise=-0.004))
        >>> abs(sag.harmonics(3)[0] - 0.004 * 4 / (3 * pi)) < 1e-16       # the closed form 4/pi/(4 k^2 - 1)
        np.True_
        """
        node, weight = legendre.leggauss(NODES)
        low, width = source.breaks[:-1, None], np.diff(source.breaks)[:, None]
        value = source.displaced(low + 0.5 * width * (1.0 + node))[1 if lateral else 0]
        found = _projected(value, node, weight)
        size = float(np.max(np.abs(found)))
        if np.max(np.abs(found[:, -2:])) > UNRESOLVED * size:
            raise ValueError(f"{source.name}: expected a profile that is smooth between its breaks")
        return cls(read_only(source.breaks + source.offset, name="breaks"), _trimmed(found))

    @classmethod
    def polyline(cls, positions: ArrayLike, heights: ArrayLike, *, periodic: bool = True) -> PieceShape:
        """Straight lines between points; a position given twice is a step there.

        Parameters
        ----------
        positions : (p,) m, ascending; a periodic shape runs from the first to the last
        heights : (p,) m

        Raises
        ------
        ValueError : fewer than two points, or positions that fall

        Examples
        --------
        >>> ramp = PieceShape.polyline([0.0, 1.0], [0.0, 0.002], periodic=False)
        >>> ramp.at([-1.0, 0.5, 3.0]).tolist()
        [0.0, 0.001, 0.002]
        """
        at, height = read_only(positions, name="positions"), read_only(heights, name="heights")
        if at.ndim != 1 or at.shape != height.shape or at.size < 2 or np.any(np.diff(at) < 0.0):
            raise ValueError(
                f"positions, heights: expected as many of each, at least two, ascending; got shapes {at.shape} and "
                f"{height.shape}"
            )
        wide = np.flatnonzero(np.diff(at) > 0.0)
        if not wide.size:
            raise ValueError(f"positions: expected a length between the first and the last, got {at.tolist()}")
        left, right = height[wide], height[wide + 1]
        coefficients = np.stack([0.5 * (left + right), 0.5 * (right - left)], axis=-1)
        return cls(
            read_only(np.append(at[wide], at[wide[-1] + 1]), name="breaks"),
            read_only(coefficients, name="coefficients"),
            periodic,
        )

    @classmethod
    def step(cls, height: float, *, length: float) -> PieceShape:
        """One step up by `height` (m), drawn out evenly over a `length` (m, positive) from position zero.

        Raises
        ------
        ValueError : a length that is not positive
        """
        require_length(length, "length")
        return cls.polyline([0.0, length], [0.0, height], periodic=False)

    @property
    def span(self) -> float:
        """Length of all pieces, m: the period of a periodic shape."""
        return float(self.breaks[-1] - self.breaks[0])

    @property
    def mean(self) -> float:
        """Mean over the pieces, m."""
        return float(np.diff(self.breaks) @ self.coefficients[:, 0] / self.span)

    @property
    def jumps(self) -> FloatArray:
        """Steps at the breaks, (b,) m; the last break of a periodic shape is its first."""
        return self._jumps(self.coefficients)

    @property
    def jump_positions(self) -> FloatArray:
        """Where they are, (b,) m."""
        return self.breaks[:-1] if self.periodic else self.breaks[1:]

    def at(self, positions: ArrayLike) -> FloatArray:
        """Displacement at positions (...), m; at a step the value after it."""
        return self._valued(self.coefficients, positions, beyond=True)

    def slope(self, positions: ArrayLike) -> FloatArray:
        """Slope at positions (...), without the infinite one of a step."""
        return self._valued(self._derived(), positions, beyond=False)

    def on(self, low: float, high: float) -> FloatArray:
        """Legendre coefficients (d + 1,) on a part [low, high] that no break divides."""
        middle, half = 0.5 * (low + high), 0.5 * (high - low)
        degree = self.coefficients.shape[1] - 1
        node, weight = legendre.leggauss(degree + 1)
        place, x, outside = self._located(np.asarray(middle))
        if outside:
            return np.append(self.at(middle), np.zeros(degree))
        width = float(np.diff(self.breaks)[place])
        values = legendre.legval(x + 2.0 * half * node / width, self.coefficients[place])
        return _projected(np.asarray(values), np.asarray(node), np.asarray(weight))

    def harmonics(self, count: int) -> ComplexArray:
        """c_1 .. c_count (m) of w(s) = mean + Re sum of c_k exp(2 pi i k s / span)."""
        order = np.arange(1, count + 1)
        wavenumber = 2.0 * pi * order / self.span
        half, middle = 0.5 * np.diff(self.breaks), 0.5 * (self.breaks[1:] + self.breaks[:-1])
        total = np.zeros(count, dtype=np.complex128)
        for a, h, m in zip(self.coefficients, half, middle, strict=True):
            turned = np.exp(-1j * wavenumber * m)
            for n in np.flatnonzero(a):
                total += a[n] * 2.0 * h * (-1j) ** int(n) * spherical_jn(int(n), wavenumber * h) * turned
        return np.asarray(2.0 / self.span * total)

    def tail(self) -> tuple[float, float]:
        """a, b (m) with |c_k| <= a/k + b/k^2 for every k: steps give a, kinks and curvature b."""
        kinks = float(np.sum(np.abs(self._jumps(self._derived()))))
        n = np.arange(self.coefficients.shape[1])
        # Int |P_n''| <= 2 P_n''(1); every derivative brings 2/width, the integral takes one back.
        curved = np.abs(self.coefficients) @ ((n - 1.0) * n * (n + 1.0) * (n + 2.0) / 4.0)
        curvature = float(np.sum(curved * 2.0 / np.diff(self.breaks)))
        by_parts = self.span / (2.0 * pi)
        a = 2.0 / self.span * float(np.sum(np.abs(self.jumps))) * by_parts
        return a, 2.0 / self.span * (kinks + curvature) * by_parts**2

    def integral(self) -> PieceShape:
        """The periodic integral, of mean zero, of a periodic shape less its mean; m^2."""
        less = self.coefficients.copy()
        less[:, 0] -= self.mean
        half = 0.5 * np.diff(self.breaks)
        grown = half[:, None] * legendre.legint(less, lbnd=-1, axis=1)
        area = 2.0 * half * less[:, 0]
        grown[:, 0] += np.concatenate([[0.0], np.cumsum(area)[:-1]])
        grown[:, 0] -= 2.0 * half @ grown[:, 0] / self.span
        return PieceShape(self.breaks, read_only(grown, name="coefficients"), self.periodic)

    def _derived(self) -> FloatArray:
        if self.coefficients.shape[1] == 1:
            return np.zeros_like(self.coefficients)
        scale = 2.0 / np.diff(self.breaks)
        return np.asarray(scale[:, None] * legendre.legder(self.coefficients, axis=1))

    def _jumps(self, coefficients: FloatArray) -> FloatArray:
        sign = (-1.0) ** np.arange(coefficients.shape[1])
        start, end = coefficients @ sign, np.sum(coefficients, axis=1)
        if self.periodic:
            jump = start - np.roll(end, 1)
            return np.where(np.abs(jump) > ROUNDING * np.max(np.abs(coefficients), initial=0.0), jump, 0.0)
        # What is constant before and after the pieces meets them without a step of its own.
        return np.append(start[1:] - end[:-1], 0.0)

    def _located(self, positions: FloatArray) -> tuple[NDArray[np.intp], FloatArray, NDArray[np.bool_]]:
        """Piece, place within it (-1..1), and whether a position is outside all pieces."""
        start = self.breaks[0]
        s = start + np.mod(positions - start, self.span) if self.periodic else positions
        outside = np.asarray((s < start) | (s > self.breaks[-1]))
        piece = np.clip(np.searchsorted(self.breaks, s, side="right") - 1, 0, len(self.coefficients) - 1)
        width = np.diff(self.breaks)[piece]
        x = 2.0 * (s - self.breaks[piece]) / width - 1.0
        return piece, np.clip(x, -1.0, 1.0), outside

    def _valued(self, coefficients: FloatArray, positions: ArrayLike, *, beyond: bool) -> FloatArray:
        piece, x, outside = self._located(np.asarray(positions, dtype=np.float64))
        value = legendre.legval(x, np.moveaxis(coefficients[piece], -1, 0), tensor=False)
        return np.asarray(value if beyond else np.where(outside, 0.0, value))


def joint_shape(span: float, *, step: float, length: float) -> PieceShape:
    """Segments laid aslant whose step at every joint is ground down over a length about it; mean zero.

    Parameters
    ----------
    span, step : m
    length : over which the step is drawn out, m

    Raises
    ------
    ValueError : a length that is not positive or not below the span

    Examples
    --------
    >>> joint_shape(10.0, step=0.002, length=0.5).at([0.0, 0.25, 5.0]).round(6).tolist()
    [0.0, 0.001, 0.0]
    """
    require_length(span, "span")
    if not (np.isfinite(length) and 0.0 < length < span):
        raise ValueError(f"length: expected a length above zero and below {span:g} m, got {length}")
    half = 0.5 * length
    return PieceShape.polyline([-half, half, span - half], [-0.5 * step, 0.5 * step, -0.5 * step])


def shifted_breaks(shapes: Sequence[PieceShape], places: FloatArray, *, speed: float) -> FloatArray:
    """Times (s) of one period at which any element at `places` (m) meets a break, from 0 to the period, ascending."""
    span = shapes[0].span
    period = span / speed
    times = [np.mod(one.breaks[:-1] - x, span) / speed for one, x in zip(shapes, places, strict=True)]
    inner = np.unique(np.concatenate([np.zeros(1), *times]))
    kept = [0.0]
    for time in inner[1:]:
        if time - kept[-1] > 1e-12 * period and period - time > 1e-12 * period:
            kept.append(float(time))
    return np.append(kept, period)


def _projected(values: FloatArray, node: FloatArray, weight: FloatArray) -> FloatArray:
    """Legendre coefficients (..., n) of values (..., n) at Gauss positions."""
    order = np.arange(len(node))
    return np.asarray((order + 0.5) * ((values * weight) @ legendre.legvander(node, len(node) - 1)))


def _trimmed(coefficients: FloatArray) -> FloatArray:
    # What rounding leaves at high degrees would be blown up by powers of the position.
    size = float(np.max(np.abs(coefficients)))
    held = np.flatnonzero(np.max(np.abs(coefficients), axis=0) > 1e-14 * size)
    last = int(held[-1]) if held.size else 0
    return read_only(coefficients[:, : last + 1], name="coefficients")
