"""Panels of a stability map: rectangles of pixels on which the monodromy matrix is one verified Chebyshev series.

A panel is halved until the tails of its series fall; where it holds no more pixels than the series would need nodes,
or the model has no answer at a node, its pixels are computed one by one. A tail is only an estimate, so every series is
compared with propagators integrated at points that are no nodes.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from scipy import special

from maglev_ctrl.analysis.plane_records import MapAxis, MapStore, PeriodicFamily
from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.errors import ModelError, OutOfDomain
from maglev_ctrl.kernels import balance, rescale
from maglev_ctrl.kernels.plane_series import Direction, PlaneSeries, plane_series, shortened, tails
from maglev_ctrl.kernels.taylor_many import monodromy_many
from maglev_ctrl.systems import PeriodicSystem

_TOLERANCE = 1e-11  # tail in each direction, relative to the largest coefficient
_LEAST = 5
_MOST_X, _MOST_Y = 65, 49
_PROBES = 6  # points where a series is compared with integration
_SMALLEST_RADIUS = 1e-9  # error allowed relative to the leading multiplier at any node


@dataclass(frozen=True, slots=True)
class Rectangle:
    """Pixels first_row <= i < last_row (x), first_column <= j < last_column (y)."""

    first_row: int
    last_row: int
    first_column: int
    last_column: int

    @property
    def pixels(self) -> int:
        """How many pixels it holds."""
        return (self.last_row - self.first_row) * (self.last_column - self.first_column)

    @property
    def name(self) -> str:
        """A stable name for the store."""
        return f"{self.first_row}-{self.last_row}-{self.first_column}-{self.last_column}"


@dataclass(frozen=True, eq=False, slots=True)
class Panel:
    """One rectangle; `series` of the monodromy matrix in balanced coordinates, None: pixel by pixel.

    `period` (s) and `mean` (A_0, 1/s) are series over the same rectangle. `strength` 1/s bounds what the modulation
    can add to a growth rate; `integrated` counts the systems integrated.
    """

    rectangle: Rectangle
    series: PlaneSeries | None
    period: PlaneSeries | None
    mean: PlaneSeries | None
    strength: float
    integrated: int


class _NoSeries(Exception):
    """A node without an answer, or systems that do not belong together."""


@dataclass(frozen=True, eq=False, slots=True)
class _Nodes:
    """Values on a grid of nodes: `monodromy` (m_x, m_y, n, n), `period` (m_x, m_y), `mean` (m_x, m_y, n, n)."""

    monodromy: FloatArray
    period: FloatArray
    mean: FloatArray
    rounding: float
    strength: float


def build_panels(family: PeriodicFamily, x: MapAxis, y: MapAxis, *, store: MapStore, prefix: str) -> Iterator[Panel]:
    """All panels of a map, each as soon as it is known; finished ones come from `store`."""
    waiting = [Rectangle(0, len(x.values), 0, len(y.values))]
    while waiting:
        place = waiting.pop()
        key = f"{prefix}-panel-{place.name}"
        kept = store.get(key)
        if kept is None:
            kept = _work_out(family, x, y, place)
            store.put(key, kept)
        split = int(kept["split"][0])
        if split >= 0:
            waiting += list(reversed(_halves(place, x, y, split)))
            continue
        yield _restored(place, kept)


def _halves(place: Rectangle, x: MapAxis, y: MapAxis, direction: int) -> list[Rectangle]:
    """Two rectangles cut across a direction, in the middle of the variable that enters."""
    first, last = (
        (place.first_row, place.last_row) if direction == 0 else (place.first_column, place.last_column)
    )  # fmt: skip
    axis = x if direction == 0 else y
    inner = 1.0 / axis.values[first:last] if axis.reciprocal else axis.values[first:last]
    middle = 0.5 * (inner[0] + inner[-1])
    beyond = np.nonzero((inner < middle) if axis.reciprocal else (inner > middle))[0]
    cut = int(np.clip(first + beyond[0], first + 1, last - 1))
    if direction == 0:
        return [Rectangle(first, cut, place.first_column, place.last_column),
                Rectangle(cut, last, place.first_column, place.last_column)]  # fmt: skip
    return [Rectangle(place.first_row, place.last_row, first, cut),
            Rectangle(place.first_row, place.last_row, cut, last)]  # fmt: skip


_DIRECT: dict[str, FloatArray] = {"split": np.array([-1.0])}


def _work_out(family: PeriodicFamily, x: MapAxis, y: MapAxis, place: Rectangle) -> Mapping[str, FloatArray]:
    """What the store keeps of a rectangle: a direction to cut it, nothing but -1 (pixel by pixel), or its series."""
    rows, columns = place.last_row - place.first_row, place.last_column - place.first_column
    if rows < 2 or columns < 2 or place.pixels <= _LEAST * _LEAST:
        return _DIRECT
    along_x = Direction(float(x.values[place.first_row]), float(x.values[place.last_row - 1]), x.reciprocal)
    along_y = Direction(float(y.values[place.first_column]), float(y.values[place.last_column - 1]), y.reciprocal)
    longer = 0 if rows >= columns else 1
    try:
        found = _fitted(family, along_x, along_y, linear=y.linear, pixels=place.pixels)
    except _NoSeries:
        return {"split": np.array([float(longer)])}
    return found


def _restored(place: Rectangle, kept: Mapping[str, FloatArray]) -> Panel:
    if "monodromy" not in kept:
        return Panel(place, None, None, None, float("inf"), 0)
    numbers = kept["numbers"]
    along_x = Direction(float(numbers[0]), float(numbers[1]), bool(numbers[2]))
    along_y = Direction(float(numbers[3]), float(numbers[4]), bool(numbers[5]))
    return Panel(
        place, PlaneSeries(kept["monodromy"], along_x, along_y, float(numbers[6])),
        PlaneSeries(kept["period"], along_x, along_y, float(numbers[7])),
        PlaneSeries(kept["mean"], along_x, along_y, float(numbers[8])), float(numbers[9]), int(numbers[10]),
    )  # fmt: skip


def _fitted(
    family: PeriodicFamily, x: Direction, y: Direction, *, linear: bool, pixels: int
) -> Mapping[str, FloatArray]:
    """The series of a rectangle, or how to go on without one."""
    source = _Source(family, x, y, linear=linear)
    if source.guess[0] > _MOST_X or source.guess[1] > _MOST_Y:
        wanted = np.array(source.guess) / (_MOST_X, _MOST_Y)
        return {"split": np.array([float(np.argmax(wanted))])}
    counts = [max(_LEAST, source.guess[0]), max(_LEAST, source.guess[1])]
    if counts[0] * counts[1] >= pixels and not linear:
        return _DIRECT if pixels <= 400 else {"split": np.array([float(np.argmax(counts))])}
    nodes: _Nodes | None = None
    while True:
        nodes = source.nodes(counts[0], counts[1], nodes)
        series = plane_series(nodes.monodromy, x=x, y=y)
        end = tails(series.coefficients)
        allowed = _TOLERANCE * end.largest
        failing = [k for k, tail in enumerate((end.x, end.y)) if tail > allowed]
        if not failing:
            break
        grown = [2 * counts[k] - 1 if k in failing else counts[k] for k in (0, 1)]
        beyond = [k for k in failing if grown[k] > (_MOST_X, _MOST_Y)[k]]
        if beyond:
            return {"split": np.array([float(beyond[0])])}
        if grown[0] * (1 if linear else grown[1]) > pixels:
            return _DIRECT
        counts = grown
    rounding = nodes.rounding * float(np.max(np.linalg.norm(nodes.monodromy, axis=(2, 3))))
    short = shortened(series, allowed=0.1 * allowed)
    claimed = 2.0 * short.error + rounding
    period = plane_series(nodes.period, x=x, y=y)
    # the mean system often depends on one direction only, or on none: one term there, evaluated once
    mean = plane_series(nodes.mean, x=x, y=y)
    mean = shortened(mean, allowed=1e-12 * tails(mean.coefficients).largest)
    worst = 0 if counts[0] >= counts[1] else 1
    radius = np.max(
        np.abs(np.linalg.eigvals(nodes.monodromy[:: max(1, counts[0] // 6), :: max(1, counts[1] // 4)])), -1
    )
    too_wide = claimed > _SMALLEST_RADIUS * float(np.min(radius)) and pixels > 4 * counts[0] * counts[1]
    if too_wide or not source.verified(short, period, claimed):
        return {"split": np.array([float(worst)])}
    numbers = [x.lower, x.upper, float(x.reciprocal), y.lower, y.upper, float(y.reciprocal), claimed,
               period.error, mean.error, nodes.strength, float(source.integrated)]  # fmt: skip
    return {
        "split": np.array([-1.0]), "monodromy": short.coefficients, "period": period.coefficients,
        "mean": mean.coefficients, "numbers": np.array(numbers),
    }  # fmt: skip


class _Source:
    """Systems of one rectangle in the balanced coordinates of its centre."""

    def __init__(self, family: PeriodicFamily, x: Direction, y: Direction, *, linear: bool) -> None:
        self._family, self._x, self._y = family, x, y
        self._deepest = y.upper if abs(y.upper) >= abs(y.lower) else y.lower
        self._linear = linear and self._deepest != 0.0
        self.integrated = 0
        ends = [self._system(a, b) for a in (x.lower, x.upper) for b in (y.lower, y.upper)]
        centre = self._system(float(x.points(3)[1]), float(y.points(3)[1]))
        magnitude = np.abs(centre.A_0) + np.sum(np.abs(centre.A_cos) + np.abs(centre.A_sin), axis=0)
        self._scale = balance(magnitude)
        self._shape = centre.A_0.shape, centre.A_cos.shape
        self.guess = self._guessed(ends)

    def _system(self, x: float, y: float) -> PeriodicSystem:
        try:
            return self._family(x, y)
        except (ModelError, OutOfDomain) as fault:
            raise _NoSeries from fault

    def _guessed(self, ends: list[PeriodicSystem]) -> tuple[int, int]:
        """Nodes that resolve the phases that the modes of the mean system turn through over the rectangle."""
        phases = [2.0 * np.pi / float(s.frequency) * np.max(np.abs(np.linalg.eigvals(s.A_0).imag)) for s in ends]
        across_x = max(abs(phases[2] - phases[0]), abs(phases[3] - phases[1]))
        across_y = max(abs(phases[1] - phases[0]), abs(phases[3] - phases[2]))
        count_x = bessel_terms(0.5 * across_x)
        if not self._linear:
            return count_x, bessel_terms(0.5 * across_y)
        probes = self._columns(np.array([self._x.lower, self._x.upper]), self._y.points(33)).monodromy
        coefficients = self._y.coefficients(np.ascontiguousarray(np.moveaxis(probes, 1, 0)))
        norms = np.sqrt(np.sum(coefficients.reshape(33, -1) ** 2, axis=1))
        if not np.all(np.isfinite(norms)):
            raise _NoSeries
        above = np.nonzero(norms > 0.1 * _TOLERANCE * np.max(norms))[0]
        return count_x, int(above[-1]) + 3

    def nodes(self, count_x: int, count_y: int, known: _Nodes | None) -> _Nodes:
        """Values on count_x by count_y nodes, those of `known` reused where its nodes are every other one."""
        xs, ys = self._x.points(count_x), self._y.points(count_y)
        if known is None:
            return self._columns(xs, ys)
        step_x = (count_x - 1) // (len(known.period) - 1)
        step_y = (count_y - 1) // (known.period.shape[1] - 1)
        if self._linear and step_y > 1:
            return self._columns(xs, ys)
        n = known.monodromy.shape[-1]
        new = _Nodes(np.empty((count_x, count_y, n, n)), np.empty((count_x, count_y)),
                     np.empty((count_x, count_y, n, n)), known.rounding, known.strength)  # fmt: skip
        parts = [(slice(1, None, 2), slice(None))] if step_x > 1 else []
        parts += [(slice(None, None, step_x), slice(1, None, 2))] if step_y > 1 else []
        for target, source in ((new.monodromy, known.monodromy), (new.period, known.period), (new.mean, known.mean)):
            target[::step_x, ::step_y] = source
        rounding, strength = known.rounding, known.strength
        for part in parts:
            added = self._columns(xs[part[0]], ys[part[1]])
            new.monodromy[part], new.period[part], new.mean[part] = added.monodromy, added.period, added.mean
            rounding, strength = max(rounding, added.rounding), max(strength, added.strength)
        return _Nodes(new.monodromy, new.period, new.mean, rounding, strength)

    def _columns(self, xs: FloatArray, ys: FloatArray) -> _Nodes:
        """Values on the grid of some nodes; a linear direction shares one system per x."""
        places = [(a, b) for a in xs for b in ([self._deepest] if self._linear else ys)]
        systems = [self._system(float(a), float(b)) for a, b in places]
        A_0, A_cos, A_sin, omega = self._stacked(systems)
        depth = ys / self._deepest if self._linear else None
        found = monodromy_many(A_0, A_cos, A_sin, frequency=omega, depths=depth)
        self.integrated += found.matrices.shape[0] * found.matrices.shape[1]
        if not np.all(np.isfinite(found.matrices)):
            raise _NoSeries
        n, shape = A_0.shape[-1], (len(xs), len(ys))
        period = np.broadcast_to((2.0 * np.pi / omega).reshape(len(xs), -1), shape)
        mean = np.broadcast_to(A_0.reshape(len(xs), -1, n, n), (*shape, n, n))
        size = np.sum(np.linalg.norm(A_cos, 2, axis=(2, 3)) + np.linalg.norm(A_sin, 2, axis=(2, 3)), axis=1)
        return _Nodes(
            found.matrices.reshape(*shape, n, n), np.array(period), np.array(mean), float(np.max(found.error)),
            0.5 * float(np.max(size)),
        )  # fmt: skip

    def _stacked(self, systems: list[PeriodicSystem]) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        if any((s.A_0.shape, s.A_cos.shape) != self._shape for s in systems):
            raise _NoSeries
        A_0, A_cos, A_sin = (
            rescale(np.stack([getattr(s, name) for s in systems]), self._scale) for name in ("A_0", "A_cos", "A_sin")
        )
        return A_0, A_cos, A_sin, np.array([float(s.frequency) for s in systems])

    def verified(self, series: PlaneSeries, period: PlaneSeries, claimed: float) -> bool:
        """Whether integration at points that are no nodes confirms the claimed error."""
        rng = np.random.default_rng(len(series.coefficients))
        x = self._x.lower + (self._x.upper - self._x.lower) * rng.uniform(size=_PROBES)
        y = self._y.lower + (self._y.upper - self._y.lower) * rng.uniform(size=_PROBES)
        systems = [self._system(float(a), float(b)) for a, b in zip(x, y, strict=True)]
        A_0, A_cos, A_sin, omega = self._stacked(systems)
        exact = monodromy_many(A_0, A_cos, A_sin, frequency=omega).matrices[:, 0]
        self.integrated += _PROBES
        apart = float(np.max(np.linalg.norm(series.points(x, y) - exact, axis=(1, 2))))
        T = 2.0 * np.pi / omega
        return apart <= claimed and bool(np.all(np.abs(period.points(x, y) - T) <= 1e-9 * T))


def bessel_terms(phase: float) -> int:
    """Chebyshev terms of cos(phase u) on -1..1 until they fall below the tolerance: J_k(phase).

    Examples
    --------
    >>> bessel_terms(1.0), bessel_terms(20.0) < 50
    (15, True)
    """
    count = int(min(phase, 1e4))
    while abs(float(special.jv(count, phase))) > 0.1 * _TOLERANCE:
        count += 1
    return count + 3
