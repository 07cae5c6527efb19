"""The control loop of a simulation: what a law reads, when its commands arrive, and the noise of its sensors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maglev_ctrl.arrays import FloatArray, read_only_any
from maglev_ctrl.systems import Controller, SecondOrderSystem
from maglev_ctrl.vehicle import Vehicle

ON_GRID = 1e-6
"""Share of a sampling period within which a time counts as one of its nodes."""


@dataclass(frozen=True, eq=False, slots=True)
class Readings:
    """y = H_q q + H_v q' + H_a q'' + H_xi xi + H_w w + H_wv w' of named outputs or states; matrices (*, y).

    `motion`: of [q, q', xi] side by side; `ground`, `ground_rate` of w and w', None where nothing reads them.
    """

    names: tuple[str, ...]
    motion: FloatArray
    acceleration: FloatArray
    ground: FloatArray | None
    ground_rate: FloatArray | None

    @classmethod
    def of(cls, system: SecondOrderSystem, names: Sequence[str]) -> Readings:
        """The rows of outputs or states.

        Raises
        ------
        ValueError : a name is neither
        """
        sizes = (len(system.dofs),) * 3 + (len(system.internal),) + (len(system.guideway),) * 2
        parts = [np.zeros((size, len(names))) for size in sizes]
        velocities = tuple(f"{name}.velocity" for name in system.dofs)
        for column, name in enumerate(names):
            if name in system.outputs:
                i = system.outputs.index(name)
                rows = (system.H_q, system.H_v, system.H_a, system.H_internal, system.H_w, system.H_wv)
                for part, row in zip(parts, rows, strict=True):
                    part[:, column] = row[i]
            elif name in system.dofs:
                parts[0][system.dofs.index(name), column] = 1.0
            elif name in velocities:
                parts[1][velocities.index(name), column] = 1.0
            elif name in system.internal:
                parts[3][system.internal.index(name), column] = 1.0
            else:
                raise ValueError(f"measured: {name!r} is neither an output nor a state of the vehicle")
        position, velocity, acceleration, internal, ground, rate = parts
        return cls(
            names=tuple(names),
            motion=read_only_any(np.concatenate([position, velocity, internal])),
            acceleration=read_only_any(acceleration),
            ground=read_only_any(ground) if np.any(ground) else None,
            ground_rate=read_only_any(rate) if np.any(rate) else None,
        )

    def still(self, x: FloatArray, ground: tuple[FloatArray, FloatArray] | None) -> FloatArray:
        """Everything but the accelerations' part, (r, y), of [q, q', xi] (r, 2 n + n_xi) over w, w' (r or 1, nw)."""
        found = x @ self.motion
        if ground is not None and self.ground is not None:
            found += ground[0] @ self.ground
        if ground is not None and self.ground_rate is not None:
            found += ground[1] @ self.ground_rate
        return np.asarray(found)


@dataclass(frozen=True, eq=False, slots=True)
class Law:
    """A controller in its vehicle: `columns` of its commands among the inputs, `delays` (c,) s from sample to force.

    `immediate` (c,): without a delay; `prompt` their columns. `unlooped` (c, c) solves the loop through measured
    accelerations that immediate commands change; None where there is none. `noise` (y,) standard deviation of a reading
    for a bandwidth of 1 Hz.
    """

    controller: Controller
    readings: Readings
    columns: NDArray[np.int64]
    delays: FloatArray
    immediate: NDArray[np.bool_]
    prompt: NDArray[np.int64]
    unlooped: FloatArray | None
    accelerates: bool
    noise: FloatArray

    @classmethod
    def of(
        cls, vehicle: Vehicle, system: SecondOrderSystem, controller: Controller, *, computation: float, noise: bool
    ) -> Law:
        """The law of a controller.

        Raises
        ------
        ValueError : a command or measurement that the vehicle does not have, a negative computation time
        """
        if not (np.isfinite(computation) and computation >= 0.0):
            raise ValueError(f"computation: expected a time in s that is not negative, got {computation}")
        unknown = [name for name in controller.commands if name not in system.inputs]
        if unknown:
            raise ValueError(f"command: {unknown[0]!r} is not an input; the inputs are {', '.join(system.inputs)}")
        own = {actuator.name: actuator.delay for actuator in vehicle.actuators}
        delays = np.array([computation + own.get(name, 0.0) for name in controller.commands])
        columns = np.array([system.inputs.index(name) for name in controller.commands], dtype=np.int64)
        readings = Readings.of(system, controller.measured)
        immediate = (delays == 0.0) & (controller.dt is None)
        direct = controller.D @ readings.acceleration.T @ np.linalg.solve(system.M, system.B[:, columns])
        loop = np.eye(len(columns)) - direct * immediate
        sensors = {sensor.name: sensor.noise for sensor in vehicle.sensors}
        density = np.array([sensors.get(name, 0.0) if noise else 0.0 for name in controller.measured])
        return cls(
            controller=controller,
            readings=readings,
            columns=read_only_any(columns),
            delays=read_only_any(delays),
            immediate=read_only_any(immediate),
            prompt=read_only_any(columns[immediate]),
            unlooped=read_only_any(np.linalg.inv(loop)) if np.any(direct[:, immediate]) else None,
            accelerates=bool(np.any(readings.acceleration)),
            noise=read_only_any(density),
        )

    @property
    def sampled(self) -> bool:
        """Whether commands are held from sample to sample."""
        return self.controller.dt is not None

    def command(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """u = C x + D y, (r, c)."""
        return np.asarray(x @ self.controller.C.T + y @ self.controller.D.T)

    def change(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """A x + B y: the states' rate, or their next value, (r, states)."""
        return np.asarray(x @ self.controller.A.T + y @ self.controller.B.T)


@dataclass(frozen=True, eq=False, slots=True)
class Schedule:
    """The steps of one frame, repeated over the whole run.

    A frame is a sampled law's period, or the interval between kept samples. `offsets` (J + 1,) s of its nodes; `kept`
    (J,) whether a sample is kept at a node; `every` frames. `lags` (J, c): how many periods ago the command was
    computed that acts in a step, exact for any delay because the nodes hold the times at which commands arrive.
    """

    frame: float
    offsets: FloatArray
    kept: NDArray[np.bool_]
    every: int
    lags: NDArray[np.int64]

    @property
    def widths(self) -> FloatArray:
        """Steps, (J,) s."""
        return np.diff(self.offsets)

    @classmethod
    def of(cls, law: Law | None, *, sampling: float, step: float) -> Schedule:
        """The schedule of a law (None: no law).

        Parameters
        ----------
        sampling : s between kept samples
        step : largest, s

        Raises
        ------
        ValueError : sampling is neither a whole multiple nor a whole part of the law's period

        Examples
        --------
        >>> Schedule.of(None, sampling=0.01, step=0.004).offsets.round(5).tolist()
        [0.0, 0.00333, 0.00667, 0.01]
        """
        if law is None or law.controller.dt is None:
            count = max(int(np.ceil(sampling / step - ON_GRID)), 1)
            kept = np.arange(count) == 0
            none = np.zeros((count, 0), dtype=np.int64)
            return cls(sampling, np.linspace(0.0, sampling, count + 1), read_only_any(kept), 1, none)
        period = law.controller.dt
        many, parts = sampling / period, period / sampling
        whole = round(many) if many >= 1.0 else round(parts)
        if abs((many if many >= 1.0 else parts) - whole) > ON_GRID * whole:
            raise ValueError(
                f"sampling: expected a whole multiple or a whole part of the law's period {period:g} s, got {sampling}"
            )
        ago = np.floor(law.delays / period + ON_GRID).astype(np.int64)
        late = np.maximum(law.delays - ago * period, 0.0)
        late[late < ON_GRID * period] = 0.0
        marks = np.arange(whole) * sampling if many < 1.0 else np.zeros(1)
        nodes = [0.0]
        for mark in sorted([*marks.tolist(), *late.tolist(), period]):
            wide = mark - nodes[-1]
            if wide > ON_GRID * period:
                count = max(int(np.ceil(wide / step - ON_GRID)), 1)
                nodes += (nodes[-1] + wide * np.arange(1, count + 1) / count).tolist()
        offsets = np.array(nodes)
        starts = offsets[:-1]
        return cls(
            frame=period,
            offsets=read_only_any(offsets),
            kept=read_only_any(np.min(np.abs(starts[:, None] - marks), axis=1) <= ON_GRID * period),
            every=whole if many >= 1.0 else 1,
            lags=read_only_any(ago + (starts[:, None] < late - ON_GRID * period)),
        )
