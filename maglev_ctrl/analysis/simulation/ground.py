"""What the guideway does under every element of a vehicle at the times of an integration."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maglev_ctrl.analysis.simulation.records import Track
from maglev_ctrl.arrays import FloatArray, read_only_any
from maglev_ctrl.vehicle import Vehicle


@dataclass(frozen=True, eq=False, slots=True)
class Ground:
    """The guideway inputs of a linear model as functions of time; the place v t + x_i is under an element at x_i.

    The surge of the vehicle is left out of the place: it is small against the wavelengths of a guideway.

    `x`, `y` (nw,) m of the inputs' elements; `heave` (nw,) whether vertical; `tracks` one for all runs or one each.
    """

    speed: float
    x: FloatArray
    y: FloatArray
    heave: NDArray[np.bool_]
    tracks: tuple[Track, ...]

    @classmethod
    def of(cls, vehicle: Vehicle, names: Sequence[str], *, speed: float, tracks: Sequence[Track]) -> Ground:
        """The ground for guideway inputs such as "heave@front"."""
        places = {e.name: e.position for e in (*vehicle.magnets, *vehicle.links, *vehicle.sensors)}
        places |= {e.name: vehicle.body(e.body).position for e in vehicle.coefficient_elements}
        points = np.array([places[name.split("@", 1)[1]] for name in names]).reshape(-1, 3)
        return cls(
            speed=speed,
            x=read_only_any(points[:, 0]),
            y=read_only_any(points[:, 1]),
            heave=read_only_any(np.array([name.startswith("heave@") for name in names], dtype=bool)),
            tracks=tuple(tracks),
        )

    @property
    def responds(self) -> bool:
        """Whether the guideway gives way under the vehicle, so that it cannot be known beforehand."""
        return any(getattr(track, "responds", False) for track in self.tracks)

    def at(self, times: FloatArray, runs: NDArray[np.int64] | None = None) -> tuple[FloatArray, FloatArray]:
        """Displacements and their rates under the elements, (T, r, nw) each; (T, 1, nw) where all runs share a track.

        Parameters
        ----------
        times : (T,) s
        runs : (r,) which runs; all when left out
        """
        if not self.tracks:
            still = np.zeros((len(times), 1, len(self.x)))
            return still, still
        places = self.speed * times[:, None] + self.x
        aside = np.broadcast_to(self.y, places.shape)
        shared = len(self.tracks) == 1
        chosen = self.tracks if shared or runs is None else [self.tracks[run] for run in runs]
        values, rates = [], []
        for track in chosen:
            values.append(np.where(self.heave, *track.under(places, aside)))
            rates.append(self.speed * np.where(self.heave, *track.slopes(places, aside)))
        return np.stack(values, axis=1), np.stack(rates, axis=1)
