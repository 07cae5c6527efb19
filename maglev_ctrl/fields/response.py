"""What a conducting guideway answers to any coil in a region: its decaying current patterns.

For each wavenumber k along the track the eddy currents obey (K + i s N) u = -i s f with s = w + k v (w the frequency of
the coil's own motion, v its speed), K and N real, symmetric and not negative. A Galerkin basis turns this into current
patterns with time constants tau, each felt by a coil with its own weight g: T(s) = -(i s / mu_0) sum of
g^2 / (1 + i s tau). It is complex symmetric whatever the basis leaves out, so reciprocity holds exactly, and its error
is the square of the basis's.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from maglev_ctrl.arrays import ComplexArray, FloatArray
from maglev_ctrl.fields.discretize import MU_0

Region = tuple[tuple[float, float], tuple[float, float]]
"""((y0, y1), (z0, z1)) of a cross-section, m."""


@dataclass(frozen=True, eq=False, slots=True)
class GuidewayResponse:
    """Current patterns of a guideway, for coils whose lines stay inside given regions of its cross-section.

    Parameters
    ----------
    panels : (p + 1,) ends of the panels of wavenumbers, 1/m
    wavenumbers : (n,) Gauss points, the same number on every panel, 1/m
    samples : (2, m) points on the conductors' surface where a coil's potential is taken, m
    projections : (n, m, modes) weight g of each pattern from the samples; zero where a wavenumber has fewer patterns
    time_constants : (n, modes) s
    regions : where a coil's line may lie
    speeds : least and largest speed the basis was made for, m/s
    frequency : largest angular frequency of the coil's motion it was made for, rad/s
    """

    panels: FloatArray
    wavenumbers: FloatArray
    samples: FloatArray
    projections: FloatArray
    time_constants: FloatArray
    regions: tuple[Region, ...]
    speeds: tuple[float, float]
    frequency: float

    def weights(self, potential: FloatArray) -> FloatArray:
        """Weights g (..., n, modes) of every pattern for potentials (..., n, m) at the samples."""
        return np.asarray(np.matmul(potential[..., None, :], self.projections)[..., 0, :])

    def transfer(self, speed: ArrayLike, frequency: ArrayLike = 0.0) -> ComplexArray:
        """-(i s / mu_0) / (1 + i s tau) at s = frequency + k speed; complex frequencies allowed; (..., n, modes)."""
        i_s = self._rate(speed, frequency)
        return np.asarray(-i_s / (1.0 + i_s * self.time_constants) / MU_0)

    def transfer_slope(self, speed: ArrayLike, frequency: ArrayLike = 0.0) -> ComplexArray:
        """d transfer / d s, at the same arguments."""
        i_s = self._rate(speed, frequency)
        return np.asarray(-1j / (1.0 + i_s * self.time_constants) ** 2 / MU_0)

    def _rate(self, speed: ArrayLike, frequency: ArrayLike) -> ComplexArray:
        moved = np.asarray(speed)[..., None] * self.wavenumbers
        return np.asarray(1j * (np.asarray(frequency)[..., None] + moved)[..., None])
