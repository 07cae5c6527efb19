"""Keeping samples of a simulation: which signals there are, and where they come from."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from maglev_ctrl.analysis.simulation.loop import Readings
from maglev_ctrl.analysis.simulation.motion import Equations, Rates
from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.systems import SecondOrderSystem
from maglev_ctrl.vehicle import Vehicle


class Store:
    """Samples (r, s, signals), NaN where a run has ended; `chosen` are the columns kept of all `names`."""

    __slots__ = ("_chosen", "_outputs", "_places", "_strokes", "_values", "kinetic", "names", "work")

    def __init__(
        self,
        vehicle: Vehicle,
        equations: Equations,
        *,
        runs: int,
        samples: int,
        signals: Sequence[str] | None,
        commands: Sequence[str],
    ) -> None:
        system = equations.system
        outputs = _plain_outputs(system)
        self._outputs = Readings.of(system, outputs)
        links = [link.name for link in vehicle.links]
        names = [
            *system.dofs,
            *(f"{name}.velocity" for name in system.dofs),
            *(f"{name}.acceleration" for name in system.dofs),
            *system.internal,
            *outputs,
            *(f"{magnet.name}.height" for magnet in vehicle.magnets),
            *(f"{magnet.name}.clearance" for magnet in vehicle.magnets),
            *(f"{magnet.name}.lift" for magnet in vehicle.magnets),
            *(f"{name}.command" for name in commands),
            *(f"{name}.applied" for name in system.inputs),
        ]
        self._places = {f"{name}.stroke": i for i, name in enumerate(links)}
        self._strokes = [(names.index(name), self._places[name]) for name in outputs if name in self._places]
        for name in signals or ():
            if name not in names:
                raise ValueError(f"signals: there is no {name!r}; there are {', '.join(names)}")
        kept = list(dict.fromkeys(signals)) if signals is not None else _distinct(names)
        self.names = tuple(kept)
        self._chosen: NDArray[np.int64] = np.array([names.index(name) for name in kept], dtype=np.int64)
        self._values = np.full((runs, samples, len(kept)), np.nan)
        self.kinetic = np.full((runs, samples), np.nan)
        self.work = np.full((runs, samples), np.nan)

    def put(
        self,
        sample: int,
        rows: NDArray[np.int64],
        *,
        state: FloatArray,
        rates: Rates,
        ground: tuple[FloatArray, FloatArray] | None,
        command: FloatArray,
        mass: FloatArray,
        work: FloatArray,
    ) -> None:
        """Keep one sample of the runs `rows`; `state` (r, 2 n + n_xi) is [q, q', xi]."""
        if sample >= self.kinetic.shape[1]:
            return
        n = len(mass)
        v = state[:, n : 2 * n]
        outputs = self._outputs.still(state, ground) + rates.acceleration @ self._outputs.acceleration
        every = np.concatenate(
            [
                state[:, : 2 * n], rates.acceleration, state[:, 2 * n :], outputs,
                rates.places[:, 0], rates.places[:, 1], rates.lift, command, rates.applied,
            ],
            axis=1,
        )  # fmt: skip
        for column, link in self._strokes:
            every[:, column] = rates.strokes[:, link]
        self._values[rows, sample] = every[:, self._chosen]
        self.kinetic[rows, sample] = 0.5 * np.einsum("ri,ri->r", v @ mass, v)
        self.work[rows, sample] = work

    def signals(self) -> dict[str, FloatArray]:
        """Every signal kept, (r, s)."""
        found = {}
        for i, name in enumerate(self.names):
            values = np.ascontiguousarray(self._values[:, :, i])
            values.flags.writeable = False
            found[name] = values
        return found


def _plain_outputs(system: SecondOrderSystem) -> list[str]:
    """Outputs that are not a coordinate or its derivatives, nor an internal state, over again."""
    taken = {*system.internal}
    for name in system.dofs:
        taken |= {name, f"{name}.velocity", f"{name}.acceleration"}
    return [name for name in system.outputs if name not in taken]


def _distinct(names: list[str]) -> list[str]:
    return list(dict.fromkeys(names))
