"""The time-varying linear system of a vehicle on equal bending girders, over one span."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, pi

import numpy as np
from numpy.typing import NDArray

from maglev_ctrl.analysis.girder.beam import Girder
from maglev_ctrl.analysis.girder.contacts import VehicleOnGuideway
from maglev_ctrl.analysis.girder.shapes import PieceShape
from maglev_ctrl.arrays import FloatArray


@dataclass(frozen=True, eq=False, slots=True)
class MovingSystem:
    """z' = (A + terms of the places) z + b(t) over one span: z = [x, spans from the newest, each q then q'].

    `spans` are under the vehicle during one period; `rigid` of them, the oldest, do not bend. `breaks` are the times
    (s) at which an element crosses a support or a corner of the shape.
    """

    vehicle: VehicleOnGuideway
    girder: Girder
    speed: float
    shape: PieceShape | None
    spans: int
    rigid: int
    rows: tuple[FloatArray, FloatArray, FloatArray]
    front: float
    breaks: FloatArray

    @property
    def size(self) -> int:
        """Number of states."""
        return len(self.vehicle.closed.states) + 2 * self.girder.modes * self.spans

    @property
    def kept(self) -> int:
        """Number of states that go over into the next span."""
        return self.size - 2 * self.girder.modes

    def surface(self, time: float, *, middle: float) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """w and w' of every guideway input: matrices (n_w, girder states), and what the shape adds (n_w,).

        `middle` is a time of the same piece: it says on which span an element stands.
        """
        on = self.vehicle
        W, w = self._over(on.input_places, time, middle)
        R, r = self._over_rate(on.input_places, time, middle)
        return on.rises[:, None] * W, on.rises * w, on.rises[:, None] * R, on.rises * r

    def joined(self, time: float, *, middle: float) -> FloatArray:
        """The matrix of [z, 1] at a time, (size + 1, size + 1)."""
        on, n, N = self.vehicle, len(self.vehicle.closed.states), self.girder.modes
        E_w, E_v = self.rows[1], self.rows[2]
        W, w, R, r = self.surface(time, middle=middle)
        total = np.zeros((self.size + 1, self.size + 1))
        total[:n, :n] = self.rows[0]
        total[:n, n:-1] = E_w @ W + E_v @ R
        total[:n, -1] = E_w @ w + E_v @ r
        force = np.zeros((len(on.places), self.size + 1))
        force[:, :n] = on.by_state
        force[:, n:-1] = on.by_guideway @ W + on.by_rate @ R
        force[:, -1] = on.weight + on.by_guideway @ w + on.by_rate @ r
        # The contact's own shape vector is that of the surface under it, with the sign of a deflection.
        phi, _ = self._over(on.places, time, middle)
        frequencies, ratio = self.girder.frequencies, self.girder.damping_ratio
        for j in range(self.spans):
            q, rate = slice(n + 2 * N * j, n + 2 * N * j + N), slice(n + 2 * N * j + N, n + 2 * N * (j + 1))
            total[q, rate] = np.eye(N)
            total[rate, q] = -np.diag(frequencies**2)
            total[rate, rate] = -np.diag(2.0 * ratio * frequencies)
            if j < self.spans - self.rigid:
                own = -phi[:, 2 * N * j : 2 * N * j + N]
                total[rate] += self.girder.mobility * own.T @ force
        return total

    def placed(self, places: FloatArray, time: float, middle: float) -> tuple[NDArray[np.int64], FloatArray]:
        """Span (0: the newest) and place on it (m) of elements at a time."""
        L = self.girder.span
        at, mid = self.speed * time + places - self.front, self.speed * middle + places - self.front
        index = np.maximum(np.ceil(-mid / L), 0.0).astype(np.int64)
        return index, at + index * L

    def _over(self, places: FloatArray, time: float, middle: float) -> tuple[FloatArray, FloatArray]:
        index, s = self.placed(places, time, middle)
        N = self.girder.modes
        W = np.zeros((len(places), 2 * N * self.spans))
        phi = np.sin(pi * self.girder.orders * s[:, None] / self.girder.span)
        for i, j in enumerate(index):
            W[i, 2 * N * j : 2 * N * j + N] = -phi[i]
        return W, np.zeros(len(places)) if self.shape is None else self.shape.at(s)

    def _over_rate(self, places: FloatArray, time: float, middle: float) -> tuple[FloatArray, FloatArray]:
        index, s = self.placed(places, time, middle)
        N, wave = self.girder.modes, pi * self.girder.orders / self.girder.span
        R = np.zeros((len(places), 2 * N * self.spans))
        for i, j in enumerate(index):
            R[i, 2 * N * j : 2 * N * j + N] = -self.speed * wave * np.cos(wave * s[i])
            R[i, 2 * N * j + N : 2 * N * (j + 1)] = -np.sin(wave * s[i])
        return R, np.zeros(len(places)) if self.shape is None else self.speed * self.shape.slope(s)


def moving_system(
    vehicle: VehicleOnGuideway, girder: Girder, *, speed: float, shape: PieceShape | None = None, rigid: int = 0
) -> MovingSystem:
    """The periodic system of a vehicle on girders.

    Parameters
    ----------
    speed : m/s
    shape : of the unloaded surface (camber, sag, joints), of the girder's span; it starts at the supports
    rigid : how many of the oldest spans under the vehicle do not bend

    Raises
    ------
    ValueError : a speed that is not positive, a shape of another span or with abrupt steps, no contact
    """
    if not (np.isfinite(speed) and speed > 0.0):
        raise ValueError(f"speed: expected a positive speed in m/s, got {speed}")
    if not len(vehicle.places):
        raise ValueError("vehicle: expected at least one element that presses on the guideway")
    if shape is not None and (not shape.periodic or abs(shape.span / girder.span - 1.0) > 1e-12):
        raise ValueError(f"shape: expected a periodic shape of span {girder.span:g} m, got {shape.span:g} m")
    if shape is not None and np.any(shape.jumps):
        raise ValueError("shape: expected no abrupt step; draw it out over a length")
    everything = np.concatenate([vehicle.places, vehicle.input_places[vehicle.rises > 0.0]])
    front, L = float(np.max(everything)), girder.span
    behind = front - everything
    spans = 1 + ceil(float(np.max(behind)) / L - 1e-12)
    corners = np.zeros(1) if shape is None else np.append(shape.breaks[:-1], 0.0)
    times = np.mod((behind[:, None] + corners).ravel(), L) / speed
    period = L / speed
    inner = np.unique(times[(times > 1e-10 * period) & (times < (1.0 - 1e-10) * period)])
    distinct = inner[np.append(True, np.diff(inner) > 1e-10 * period)] if inner.size else inner
    A, E, n_w = vehicle.closed.state_matrix(), vehicle.closed.guideway_matrix(), len(vehicle.closed.guideway)
    return MovingSystem(
        vehicle, girder, float(speed), shape, spans, rigid, (A, E[:, :n_w], E[:, n_w:]), front,
        np.concatenate([[0.0], distinct, [period]]),
    )  # fmt: skip
