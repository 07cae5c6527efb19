"""A force model as a map that answers in microseconds: Chebyshev series of the logarithms of energy and drag.

At a fixed speed lift and guidance are the gradient of one energy W < 0 (reciprocity of currents in a conductor), so the
map keeps W and not the two forces: whatever its error, dF_lift/dgap = dF_guidance/dheight holds exactly. W and the drag
fall over orders of magnitude; their logarithms over the logarithms of height, gap and speed are nearly straight.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from maglev_ctrl.arrays import FloatArray, read_only
from maglev_ctrl.fields.spread import Progress, Spread, in_order, one_by_one
from maglev_ctrl.forces.base import (
    AbstractForceModel,
    Domain,
    MagnetDerivatives,
    MagnetForces,
    checked_factor,
    no_forces,
)
from maglev_ctrl.kernels.chebyshev import chebyshev_points, chebyshev_series

FIRST, LARGEST = (16, 18, 8), (28, 32, 14)
"""Points along height, gap and speed tried first, and at most."""
CHECKS = 24
"""Points held back to find the residual."""


class EnergyModel(Protocol):
    """A force model that knows its energy; all of `EddyCurrentForce` a map is made from."""

    @property
    def domain(self) -> Domain:
        """Where it is defined."""
        ...

    def energy(self, height: ArrayLike, gap: ArrayLike | None, speed: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """W (J) and drag (N)."""
        ...

    def forces(self, height: ArrayLike, gap: ArrayLike | None, speed: ArrayLike) -> MagnetForces:
        """Lift, guidance, drag."""
        ...

    def derivatives(self, height: ArrayLike, gap: ArrayLike | None, speed: ArrayLike) -> MagnetDerivatives:
        """Partials."""
        ...


@dataclass(frozen=True, eq=False, slots=True)
class MapQuality:
    """Largest differences between a map and its model at points held back, relative.

    `forces` to the larger of lift and guidance (drag: to itself); `stiffness` to the largest of the four stiffnesses;
    `checks` points; `nodes` along height, gap, speed.
    """

    forces: float
    drag: float
    stiffness: float
    checks: int
    nodes: tuple[int, int, int]

    @property
    def worst(self) -> float:
        """The largest of all."""
        return max(self.forces, self.drag, self.stiffness)


@dataclass(frozen=True, eq=False, slots=True)
class LogAxis:
    """One argument q as x = ln(q + shift) mapped to -1..1; a single value is the middle of nothing."""

    low: float
    high: float
    shift: float

    def nodes(self, count: int) -> FloatArray:
        """Where a series of `count` terms is found from, ascending; (count,)."""
        x = chebyshev_points(count, lower=-1.0, upper=1.0)
        return np.asarray(np.clip(np.exp(self._middle + self._half * x) - self.shift, self.low, self.high))

    @property
    def _middle(self) -> float:
        return 0.5 * float(np.log(self.low + self.shift) + np.log(self.high + self.shift))

    @property
    def _half(self) -> float:
        return 0.5 * float(np.log(self.high + self.shift) - np.log(self.low + self.shift))

    @property
    def fixed(self) -> bool:
        """Whether the range is a single value."""
        return not self.high > self.low

    def basis(self, q: FloatArray, count: int, order: int) -> list[FloatArray]:
        """Chebyshev polynomials of x and their derivatives by q up to an order; (points, count) each."""
        if self.fixed:
            return [np.ones((len(q), 1)), *(np.zeros((len(q), 1)) for _ in range(order))]
        angle = np.arccos(np.clip((np.log(q + self.shift) - self._middle) / self._half, -1.0, 1.0))
        n = np.arange(count)
        value = np.cos(angle[:, None] * n)
        found = [value]
        if order >= 1:
            # T_n' = n U_(n-1); the sum form is exact at the ends too.
            matrix = _derivative_matrix(count)
            slope = value @ matrix
            rate = 1.0 / (self._half * (q + self.shift))[:, None]
            found.append(slope * rate)
        if order >= 2:
            found.append((slope @ matrix) * rate**2 - slope * rate / (q + self.shift)[:, None])
        return found


def _derivative_matrix(count: int) -> FloatArray:
    """D with (T_0 .. T_(n-1))' = (T_0 ..) D, column n the series of T_n'."""
    D = np.zeros((count, count))
    for n in range(1, count):
        D[n - 1 :: -2, n] = 2.0 * n
        if n % 2:
            D[0, n] = n
    return D


@dataclass(frozen=True, eq=False, slots=True)
class ForceMap(AbstractForceModel):
    """Lift, guidance and drag from Chebyshev series of ln(-W) and ln(drag); refuses points outside. Build with `of`."""

    domain: Domain = field()  # field() hides the property of the base, which would count as a default
    axes: tuple[LogAxis, LogAxis, LogAxis]
    log_energy: FloatArray
    log_drag: FloatArray
    quality: MapQuality
    strength: FloatArray = field(default_factory=lambda: read_only(1.0, name="strength"))

    @classmethod
    def of(
        cls,
        model: EnergyModel,
        *,
        tolerance: float = 1e-2,
        spread: Spread = one_by_one,
        progress: Progress | None = None,
    ) -> ForceMap:
        """Map a model over its whole domain.

        Parameters
        ----------
        tolerance : relative; nodes are added until the points held back agree to it or get no better; the residual
            reached is in `quality` whatever it is
        spread : shares the positions out over processes
        progress : told the fraction done of each attempt

        Examples
        --------
        >>> class Source:
        ...     domain = Domain(height=(0.01, 0.03), gap=None, speed=(10.0, 20.0))
        ...     def energy(self, h, g, v):
        ...         return -v / (h * h), v**-1.0 + 0.0 * h
        ...     def forces(self, h, g, v):
        ...         return MagnetForces(lift=2.0 * v / h**3, guidance=0.0, drag=v**-1.0)
        ...     def derivatives(self, h, g, v):
        ...         rise = MagnetForces(lift=-6.0 * v / h**4, guidance=0.0, drag=0.0)
        ...         rest = no_forces(rise.lift.shape)
        ...         return MagnetDerivatives(rise, rest, rest, rest, rest)
        >>> swift = ForceMap.of(Source())
        >>> round(float(swift.forces(0.02, None, 15.0).lift), 3)
        3750000.0
        """
        domain = model.domain
        gap = domain.gap or (1.0, 1.0)
        # The shifts make the logarithms of energy and drag nearly straight; tried on the corner of an L.
        axes = (
            LogAxis(*domain.height, 0.5 * (domain.height[1] - domain.height[0])),
            LogAxis(*gap, gap[0]),
            LogAxis(*domain.speed, 0.0),
        )
        counts, best = FIRST, None
        while True:
            nodes = tuple(1 if axis.fixed else count for axis, count in zip(axes, counts, strict=True))
            found = cls._through(model, axes, nodes, spread, progress)
            # More nodes also pass on more of the model's own roughness: the best is kept, not the last.
            if best is not None and found.quality.worst >= best.quality.worst:
                return best
            best = found
            larger = tuple(min(round(1.35 * n), most) for n, most in zip(counts, LARGEST, strict=True))
            if best.quality.worst <= tolerance or larger == counts:
                return best
            counts = larger  # type: ignore[assignment]

    @classmethod
    def _through(
        cls,
        model: EnergyModel,
        axes: tuple[LogAxis, LogAxis, LogAxis],
        nodes: tuple[int, ...],
        spread: Spread,
        progress: Progress | None,
    ) -> ForceMap:
        heights, gaps, speeds = (
            axis.nodes(count) if count > 1 else np.array([axis.low]) for axis, count in zip(axes, nodes, strict=True)
        )
        row = partial(_row, model, gaps=None if model.domain.gap is None else gaps[:, None], speeds=speeds)
        rows = in_order(row, heights.tolist(), spread=spread, progress=progress)
        energy, drag = (np.stack([found[i] for found in rows]).reshape(nodes) for i in range(2))
        blank = MapQuality(np.nan, np.nan, np.nan, 0, (nodes[0], nodes[1], nodes[2]))
        found = cls(model.domain, axes, _coefficients(np.log(-energy)), _coefficients(np.log(drag)), blank)
        return replace(found, quality=_quality(found, model))

    def forces(self, height: ArrayLike, gap: ArrayLike | None, speed: ArrayLike) -> MagnetForces:
        """Lift, guidance and drag of one magnet.

        Raises
        ------
        OutOfDomain : a point outside `domain`
        """
        (u, d), shape = self._series(height, gap, speed, order=1, wanted=((0, 0, 0), (1, 0, 0), (0, 1, 0)), drags=1)
        W = -np.exp(u[0])
        parts = (W * u[1], W * u[2], np.exp(d[0]))
        lift, guidance, drag = (self.strength * part.reshape(shape) for part in parts)
        return MagnetForces(lift=lift, guidance=guidance, drag=drag)

    def derivatives(self, height: ArrayLike, gap: ArrayLike | None, speed: ArrayLike) -> MagnetDerivatives:
        """Analytic partials of the map; quasi-static, so none by vertical or lateral velocity."""
        wanted = (
            (0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (2, 0, 0), (1, 1, 0), (0, 2, 0), (1, 0, 1), (0, 1, 1),
        )  # fmt: skip
        (u, d), shape = self._series(height, gap, speed, order=2, wanted=wanted, drags=4)
        W, drag = -np.exp(u[0]), np.exp(d[0])
        h, g, v = u[1], u[2], u[3]

        def part(lift: FloatArray, guidance: FloatArray, slope: FloatArray) -> MagnetForces:
            parts = (W * lift, W * guidance, drag * slope)
            lift, guidance, slope = (self.strength * one.reshape(shape) for one in parts)
            return MagnetForces(lift=lift, guidance=guidance, drag=slope)

        nothing = no_forces(np.broadcast_shapes(shape, self.strength.shape))
        return MagnetDerivatives(
            by_height=part(u[4] + h * h, u[5] + h * g, d[1]),
            by_gap=part(u[5] + h * g, u[6] + g * g, d[2]),
            by_speed=part(u[7] + h * v, u[8] + g * v, d[3]),
            by_vertical_velocity=nothing,
            by_lateral_velocity=nothing,
        )

    def scaled(self, factor: ArrayLike) -> ForceMap:
        """The same map with every force times `factor`."""
        return replace(self, strength=read_only(self.strength * checked_factor(factor), name="strength"))

    def _series(
        self,
        height: ArrayLike,
        gap: ArrayLike | None,
        speed: ArrayLike,
        *,
        order: int,
        wanted: tuple[tuple[int, int, int], ...],
        drags: int,
    ) -> tuple[tuple[list[FloatArray], list[FloatArray]], tuple[int, ...]]:
        """The derivatives `wanted` of ln(-W), and the first `drags` of them of ln(drag), at the points in a row."""
        self.domain.require(height, gap, speed)
        beside = np.asarray(1.0 if self.domain.gap is None else gap, dtype=np.float64)
        points = np.broadcast_arrays(np.asarray(height, dtype=np.float64), beside, np.asarray(speed, dtype=np.float64))
        shape = points[0].shape
        bases = []
        for axis, q, count in zip(self.axes, points, self.log_energy.shape, strict=True):
            bases.append(axis.basis(np.clip(q.ravel(), axis.low, axis.high), count, order))
        return (_contracted(self.log_energy, bases, wanted), _contracted(self.log_drag, bases, wanted[:drags])), shape


def _row(
    model: EnergyModel, height: float, *, gaps: FloatArray | None, speeds: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Energy and drag (gaps, speeds) at one height."""
    return model.energy(height, gaps, speeds[None, :])


def _contracted(
    coefficients: FloatArray, bases: list[list[FloatArray]], wanted: tuple[tuple[int, int, int], ...]
) -> list[FloatArray]:
    """Sums over a tensor of coefficients, speed first, then gap, then height, each partial sum found once."""
    a, b, c = coefficients.shape
    by_speed: dict[Any, FloatArray] = {}
    by_gap: dict[Any, FloatArray] = {}
    found = []
    for i, j, k in wanted:
        if k not in by_speed:
            by_speed[k] = (bases[2][k] @ coefficients.reshape(a * b, c).T).reshape(-1, a, b)
        if (j, k) not in by_gap:
            by_gap[j, k] = np.matmul(by_speed[k], bases[1][j][:, :, None])[..., 0]
        found.append(np.asarray(np.sum(by_gap[j, k] * bases[0][i], axis=1)))
    return found


def _coefficients(values: FloatArray) -> FloatArray:
    """Chebyshev coefficients along all three axes."""
    for axis in range(3):
        if values.shape[axis] > 1:
            turned = np.moveaxis(values, axis, 0)
            values = np.moveaxis(chebyshev_series(turned, lower=-1.0, upper=1.0).coefficients, 0, axis)
    return read_only(values, name="coefficients")


def _quality(found: ForceMap, model: EnergyModel) -> MapQuality:
    """Compare with the model at points of a fixed sequence, the ends of every axis included."""
    places = np.random.default_rng(20).random((3, CHECKS))
    places[:, :6] = np.round(places[:, :6])
    h, g, v = (
        np.exp((1.0 - t) * np.log(axis.low) + t * np.log(axis.high)).clip(axis.low, axis.high)
        for axis, t in zip(found.axes, places, strict=True)
    )
    beside = None if found.domain.gap is None else g
    true, got = model.forces(h, beside, v), found.forces(h, beside, v)
    scale = np.maximum(np.abs(true.lift), np.abs(true.guidance))
    forces = max(float(np.max(np.abs(getattr(got, n) - getattr(true, n)) / scale)) for n in ("lift", "guidance"))
    slopes, mapped = model.derivatives(h, beside, v), found.derivatives(h, beside, v)
    pairs = [(way, name) for way in ("by_height", "by_gap") for name in ("lift", "guidance")]
    exact = np.stack([getattr(getattr(slopes, way), name) for way, name in pairs])
    near = np.stack([getattr(getattr(mapped, way), name) for way, name in pairs])
    return MapQuality(
        forces=forces,
        drag=float(np.max(np.abs(got.drag / true.drag - 1.0))),
        stiffness=float(np.max(np.abs(near - exact) / np.max(np.abs(exact), axis=0))),
        checks=CHECKS,
        nodes=found.quality.nodes,
    )
