"""One option's loop over speed: assembled at a few speeds, a verified Chebyshev series everywhere between them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.errors import MaglevError
from maglev_ctrl.kernels.plane_series import Direction
from maglev_ctrl.study.forcing import slowed_vehicle
from maglev_ctrl.study.live.designed import FAULTS, Designed
from maglev_ctrl.study.live.level_magnets import LevelMagnets
from maglev_ctrl.study.situation import PADE_ORDER, Situation
from maglev_ctrl.systems import SecondOrderSystem, close_loop
from maglev_ctrl.vehicle import Equilibrium, Vehicle, linearize
from maglev_ctrl.vehicle.loads import MagnetField

COUNTS = (6, 11, 21)
"""Speeds assembled; from one count to the next those known are used again."""
TOLERANCE = 1e-5
"""Largest error of a matrix entry, relative to the largest that the entry takes over speed; tongues move by as much."""
_ABSENT = 1e-9  # of the largest entry of its kind: entries below are rounding of what cancels


@dataclass(frozen=True, eq=False, slots=True)
class Loops:
    """State matrices at speeds (V,), 1/s: `full` (V, n, n) of the whole loop; of the map's loop `mean` (V, m, m) and,
    at unit depth, `cosine`, `sine` (V, H, m, m); without periodic forces the latter are empty. `answered` (V,): where
    there is an equilibrium; NaN elsewhere."""

    full: FloatArray
    mean: FloatArray
    cosine: FloatArray
    sine: FloatArray
    answered: NDArray[np.bool_]


@dataclass(frozen=True, eq=False, slots=True)
class _Shapes:
    """How the matrices of one speed are laid out in one row of numbers."""

    full: int
    slow: int
    harmonics: int

    def joined(self, parts: tuple[FloatArray, ...]) -> FloatArray:
        return np.concatenate([part.ravel() for part in parts])

    def split(self, rows: FloatArray, answered: NDArray[np.bool_]) -> Loops:
        n, m, h, count = self.full, self.slow, self.harmonics, len(rows)
        ends = np.cumsum([n * n, m * m, h * m * m, h * m * m])
        full, mean, cosine, sine = np.split(rows, ends[:-1], axis=1)
        return Loops(
            full.reshape(count, n, n), mean.reshape(count, m, m), cosine.reshape(count, h, m, m),
            sine.reshape(count, h, m, m), answered,
        )  # fmt: skip

    @property
    def kinds(self) -> list[slice]:
        """The parts whose entries are of one kind."""
        ends = np.cumsum([0, self.full**2, self.slow**2, 2 * self.harmonics * self.slow**2])
        return [slice(int(a), int(b)) for a, b in pairwise(ends) if b > a]


class OverSpeed:
    """The loop of an option at one height, gap and payload, at any speed of a range.

    `smooth`: from a series whose tail has fallen and which a speed that is no node confirms; otherwise every speed
    that is asked for is assembled.
    """

    def __init__(self, designed: Designed, situation: Situation, low: float, high: float) -> None:
        self._source = _Source(designed, situation)
        self._along = Direction(low, high, reciprocal=low > 0.0)
        self._known: dict[float, FloatArray | None] = {}
        self._coefficients = self._fitted() if high > low else None

    @property
    def smooth(self) -> bool:
        """Whether there is a series."""
        return self._coefficients is not None

    @property
    def template(self) -> SecondOrderSystem:
        """The whole loop at the situation's own speed: names of states and freedoms."""
        return self._source.closed

    def at(self, speeds: FloatArray) -> Loops:
        """State matrices at speeds (V,) within the range."""
        if self._coefficients is not None:
            rows = self._along.basis(speeds, len(self._coefficients)) @ self._coefficients
            return self._source.shapes.split(rows, np.ones(len(speeds), dtype=np.bool_))
        found = [self._assembled(float(v)) for v in speeds]
        size = len(self._source.own)
        rows = np.stack([np.full(size, np.nan) if one is None else one for one in found])
        return self._source.shapes.split(rows, np.array([one is not None for one in found]))

    def _assembled(self, speed: float) -> FloatArray | None:
        if speed not in self._known:
            try:
                self._known[speed] = self._source(speed)
            except FAULTS:
                self._known[speed] = None
        return self._known[speed]

    def _fitted(self) -> FloatArray | None:
        for count in COUNTS:
            nodes = [self._assembled(float(v)) for v in self._along.points(count)]
            if any(one is None for one in nodes):
                return None
            values = np.stack([one for one in nodes if one is not None])
            allowed = self._allowed(values)
            coefficients = self._along.coefficients(values)
            tail = np.abs(coefficients[-1]) + np.abs(coefficients[-2])
            if np.all(tail <= allowed):
                return coefficients if self._confirmed(coefficients, allowed) else None
        return None

    def _allowed(self, values: FloatArray) -> FloatArray:
        largest = np.max(np.abs(values), axis=0)
        for kind in self._source.shapes.kinds:
            largest[kind] = np.maximum(largest[kind], _ABSENT * np.max(largest[kind]) / TOLERANCE)
        return np.asarray(TOLERANCE * largest)

    def _confirmed(self, coefficients: FloatArray, allowed: FloatArray) -> bool:
        """Whether the loop assembled in full at a speed that is no node is that of the series."""
        points = self._along.points(2 * len(coefficients) - 1)
        probe = float(points[1] if self._along.reciprocal else points[len(points) // 2 - 1])
        try:
            exact = self._source.exact(probe)
        except FAULTS:
            return False
        value = self._along.basis(np.array([probe]), len(coefficients))[0] @ coefficients
        return bool(np.all(np.abs(value - exact) <= 2.0 * allowed))


class _Source:
    """Assembles the loop at a speed. Over speed the magnets change stiffness and damping and nothing else of a linear
    model with a fixed law; what that shortcut gives is compared with the whole assembly by whoever uses it."""

    def __init__(self, designed: Designed, situation: Situation) -> None:
        self._designed, self._situation = designed, situation
        at = designed.at(situation)
        held, balanced, plant = at.held, at.balanced, at.plant
        self.closed = at.closed
        self._rest = self.closed.C - plant.C, self.closed.K - plant.K
        self._slow = self.closed
        if designed.merged:
            self._slow = self._closed(linearize(self._slow_vehicle(held), balanced, pade_order=PADE_ORDER), situation)
        self._fixed = designed.model.schedule is None
        self._level = self._own_magnets(held, balanced, plant)
        K = self._stiffness(held, balanced)
        slow = len(self._slow.state_matrix()) if len(K) else 0
        self.shapes = _Shapes(len(self.closed.state_matrix()), slow, len(K) // 2)
        self.own = self._matrices(self.closed, self._slow, K)

    def __call__(self, speed: float) -> FloatArray:
        """The matrices at a speed in one row; Raises as `OptionModel.closed_of`."""
        if not self._fixed:
            return self.exact(speed)
        found = None if self._level is None else self._level(speed)
        if found is None:
            held, balanced = self._balance(speed)
            plant = linearize(held, balanced, pade_order=PADE_ORDER)
            C, K, modulated = plant.C, plant.K, self._stiffness(held, balanced)
        else:
            C, K, fields = found
            assert self._level is not None
            modulated = self._stiffness(self._level.vehicle, self._level.balanced, fields)
        C, K = C + self._rest[0], K + self._rest[1]
        closed = replace(self.closed, C=C, K=K)
        slow = closed if self._slow is self.closed else replace(self._slow, C=C, K=K)
        return self._matrices(closed, slow, modulated)

    def exact(self, speed: float) -> FloatArray:
        """The same by the whole assembly."""
        situation = replace(self._situation, speed=speed)
        held, balanced = self._balance(speed)
        closed = self._closed(linearize(held, balanced, pade_order=PADE_ORDER), situation)
        slow = closed
        if self._designed.merged:
            slow = self._closed(linearize(self._slow_vehicle(held), balanced, pade_order=PADE_ORDER), situation)
        row = self._matrices(closed, slow, self._stiffness(held, balanced))
        if row.shape != self.own.shape:
            raise MaglevError("the model has another number of states there")
        return row

    def _slow_vehicle(self, held: Vehicle) -> Vehicle:
        """The map's vehicle; kept where the balance left the vehicle as it was, because its skeleton is."""
        payload = self._situation.payload
        return self._designed.slowed(payload) if held is self._designed.vehicle(payload) else slowed_vehicle(held)

    def _balance(self, speed: float) -> tuple[Vehicle, Equilibrium]:
        situation = replace(self._situation, speed=speed)
        return self._designed.model.balance_of(self._designed.vehicle(situation.payload), situation)

    def _closed(self, plant: SecondOrderSystem, situation: Situation) -> SecondOrderSystem:
        law = self._designed.model.law_at(situation, self._designed.controller)
        return plant if law is None else close_loop(plant, law)

    def _own_magnets(self, held: Vehicle, balanced: Equilibrium, plant: SecondOrderSystem) -> LevelMagnets | None:
        """The magnets alone over speed, where nothing else of the vehicle feels it."""
        modulation = self._designed.modulation
        prescribed = modulation is None or modulation.pattern is None
        return LevelMagnets.of(held, balanced, plant) if prescribed else None

    def _stiffness(self, held: Vehicle, balanced: Equilibrium, fields: MagnetField | None = None) -> FloatArray:
        """K_cos, K_sin (2 H, n, n) at unit depth; none without periodic forces."""
        if self._designed.modulation is None:
            return np.empty((0, len(held.dofs), len(held.dofs)))
        return np.concatenate(self._designed.modulation(held, balanced, fields=fields))

    def _matrices(self, closed: SecondOrderSystem, slow: SecondOrderSystem, K: FloatArray) -> FloatArray:
        parts = [closed.state_matrix().ravel()]
        if len(K):
            parts.append(slow.state_matrix().ravel())
            parts += [slow.modulated_state_matrix(one).ravel() for one in K]
        return np.concatenate(parts)
