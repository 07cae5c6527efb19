"""Delayed commands of a continuous law: cubics through the nodes of uniform steps, from the first command on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maglev_ctrl.arrays import FloatArray

ON_GRID = 1e-6
"""Share of a step within which a time counts as a node."""

POINTS = 4
"""Nodes that a cubic goes through."""


@dataclass(frozen=True, eq=False, slots=True)
class _Line:
    """One delay: `lag` in steps, its commands' columns, and for each half step where the cubic and the straight line
    begin, counted from the step's node, with the cubic's weights and how much those of the line differ from them."""

    lag: float
    columns: slice | NDArray[np.int64]
    starts: tuple[int, ...]
    cubic: tuple[FloatArray, ...]
    bent: tuple[FloatArray, ...]

    @property
    def arrival(self) -> int:
        """The step within which, or at whose start, the first command arrives."""
        return int(np.floor(self.lag + ON_GRID))

    @property
    def share(self) -> float:
        """Where in a step what was commanded at a node arrives."""
        share = self.lag - self.arrival
        return share if share > ON_GRID else 0.0


class Past:
    """Commands of a continuous law as they arrive at the inputs, within `low` and `high` (c,).

    A step is no longer than the shortest delay, so that every cubic goes through known nodes. Noise that is held over
    steps makes commands jump and bend at nodes; what it does is known exactly and is kept out of the cubics.

    Before time 0 nothing was commanded: the first command arrives as a jump. A Runge-Kutta step that a jump falls into
    is given values with the jump's integral and first moment, without which its impulse would be wrong by up to a step.

    Parameters
    ----------
    delays : (c,) s
    step : s

    Raises
    ------
    ValueError : a step longer than a delay

    Examples
    --------
    >>> past = Past(np.array([0.015]), step=0.01, runs=1)
    >>> for node in range(6):
    ...     past.put(node, np.array([[(0.01 * node) ** 3]]))
    >>> bool(abs(past.at(5, 1)[0, 0] - 0.04**3) < 1e-15)           # 0.05 s + half a step - 15 ms
    True
    """

    __slots__ = ("_bend", "_high", "_jump", "_length", "_lines", "_low", "_noisy", "_smooth", "_step")

    def __init__(
        self,
        delays: FloatArray,
        *,
        step: float,
        runs: int,
        low: FloatArray | None = None,
        high: FloatArray | None = None,
    ) -> None:
        lags = np.asarray(delays, dtype=np.float64) / step
        if np.any(lags < 1.0 - ON_GRID):
            raise ValueError(f"step: expected at most the shortest delay {float(np.min(delays)):g} s, got {step:g}")
        distinct = np.unique(lags)
        self._lines = tuple(
            _line(float(lag), slice(None) if len(distinct) == 1 else np.flatnonzero(lags == lag)) for lag in distinct
        )
        self._length = int(np.ceil(float(np.max(lags)))) + POINTS + 1
        # Every node twice, so that the nodes of a cubic stand side by side.
        shape = (2 * self._length, runs, len(lags))
        self._smooth, self._bend, self._jump = np.zeros(shape), np.zeros(shape), np.zeros(shape)
        self._noisy, self._step = False, step
        self._low = np.full(len(lags), -np.inf) if low is None else low
        self._high = np.full(len(lags), np.inf) if high is None else high

    def put(self, node: int, command: FloatArray, noise: tuple[FloatArray, FloatArray] | None = None) -> None:
        """The command (r, c) at a node; what held noise has in it, and in its rate, from this node to the next."""
        place = node % self._length
        if noise is None:
            self._smooth[place] = self._smooth[place + self._length] = command
            return
        self._noisy = True
        jump, rate = noise
        self._smooth[place] = self._smooth[place + self._length] = command - jump
        self._jump[place] = self._jump[place + self._length] = jump
        # The integral of the rates up to the next node; only its bends matter.
        following = (node + 1) % self._length
        self._bend[following] = self._bend[following + self._length] = self._bend[place] + self._step * rate

    def at(self, node: int, half: int) -> FloatArray:
        """Delayed commands (r, c) `half` half steps after a node; all nodes up to this one are known."""
        if len(self._lines) == 1:
            return self._arrived(self._lines[0], node, half)
        found = np.empty(self._smooth.shape[1:])
        for line in self._lines:
            found[:, line.columns] = self._arrived(line, node, half)
        return found

    def _arrived(self, line: _Line, node: int, half: int) -> FloatArray:
        columns, first = line.columns, node + line.starts[half]
        if first < 0 and node < line.arrival:
            return np.zeros(self._smooth.shape[1:])[:, columns]
        if first < 0 and node == line.arrival and line.share:
            return self._begun(1.0 - line.share, half)[:, columns]
        cubic, bent = line.cubic[half], line.bent[half]
        if first < 0:
            first, count = 0, min(node + 1, POINTS)
            place = node + 0.5 * half - line.lag
            cubic = _weights(place, count)
            bent = _straight(place, count) - cubic
        found = _blend(self._smooth, first % self._length, cubic)
        if self._noisy:
            found += _blend(self._bend, first % self._length, bent)
            found += self._jumped(line, node, half)
        found = found[:, columns]
        return np.asarray(np.minimum(np.maximum(found, self._low[columns]), self._high[columns]))

    def _jumped(self, line: _Line, node: int, half: int) -> FloatArray:
        """The jumping part: that of the node whose command arrives in this step, and of the one before it."""
        new = self._jump[(node - line.arrival) % self._length]
        if not line.share:
            return np.asarray(new)
        old = self._jump[(node - line.arrival - 1) % self._length]
        return np.asarray(old + _late(1.0 - line.share, half) * (new - old))

    def _begun(self, share: float, half: int) -> FloatArray:
        """The first commands arrive in the last `share` of a step."""
        begin, end = (
            np.minimum(np.maximum(self._smooth[node] + self._jump[0], self._low), self._high) for node in (0, 1)
        )
        return np.asarray(_late(share, half) * begin + _late_ramp(share, half) * (end - begin))

    def keep(self, rows: NDArray[np.bool_]) -> None:
        """Only some of the runs go on."""
        self._smooth, self._bend, self._jump = self._smooth[:, rows], self._bend[:, rows], self._jump[:, rows]


def _line(lag: float, columns: slice | NDArray[np.int64]) -> _Line:
    starts, cubic, bent = [], [], []
    for half in (0, 1, 2):
        place = 0.5 * half - lag
        first = min(int(np.floor(place + ON_GRID)) - 1, 1 - POINTS)
        starts.append(first)
        cubic.append(_weights(place - first, POINTS))
        bent.append(_straight(place - first, POINTS) - cubic[-1])
    return _Line(lag, columns, tuple(starts), tuple(cubic), tuple(bent))


def _blend(values: FloatArray, place: int, weights: FloatArray) -> FloatArray:
    _, runs, count = values.shape
    window = values[place : place + len(weights)].reshape(len(weights), -1)
    return np.asarray((weights @ window).reshape(runs, count))


def _late(share: float, half: int) -> float:
    """Values at a step's start, middle and end that act as 1 in its last `share`, and 0 before, does.

    Simpson's rule with 0, f1, f2 has the integral (4 f1 + f2) / 6 and, towards the end, the moment f1 / 3.
    """
    return (0.0, 1.5 * share**2, 6.0 * share - 6.0 * share**2)[half]


def _late_ramp(share: float, half: int) -> float:
    """As `_late`, of a ramp that rises from 0 by 1 in a step."""
    return (0.0, 0.5 * share**3, 3.0 * share**2 - 2.0 * share**3)[half]


def _weights(place: float, count: int) -> FloatArray:
    """Weights of values at 0, 1, ... count - 1 in the polynomial through them, at a place."""
    nodes = np.arange(count, dtype=np.float64)
    weights = np.ones(count)
    for i in range(count):
        others = np.delete(nodes, i)
        weights[i] = np.prod((place - others) / (i - others))
    return weights


def _straight(place: float, count: int) -> FloatArray:
    """Weights in the straight lines from each value to the next."""
    weights = np.zeros(count)
    if count == 1:
        weights[0] = 1.0
        return weights
    below = min(max(int(np.floor(place + ON_GRID)), 0), count - 2)
    weights[below], weights[below + 1] = 1.0 + below - place, place - below
    return weights
