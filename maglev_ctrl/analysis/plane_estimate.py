"""What a stability map will cost, from a few systems integrated and a few pixels evaluated."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from maglev_ctrl.analysis.floquet import scaled_coefficients
from maglev_ctrl.analysis.plane_panels import bessel_terms
from maglev_ctrl.analysis.plane_records import MapAxis, PeriodicFamily
from maglev_ctrl.errors import ModelError, OutOfDomain
from maglev_ctrl.kernels.spectral_radius import RadiusEngine
from maglev_ctrl.kernels.taylor_many import monodromy_many
from maglev_ctrl.systems import PeriodicSystem

_PIXELS = 256
_BYTES_PER_PIXEL = 120.0  # the map's own arrays, and those that naming its regions needs
_FIXED_BYTES = 64e6
_SHARE = 0.25  # of the pixels that are computed where not all are


@dataclass(frozen=True, slots=True)
class MapEstimate:
    """Expected time in `seconds`, largest memory in `bytes` (both rough), and the number of `points` of the map."""

    seconds: float
    bytes: float
    points: int


def rough_estimate(
    family: PeriodicFamily, x: MapAxis, y: MapAxis, *, adaptive: bool, threads: int, engine: RadiusEngine
) -> MapEstimate:
    """The cost of a map by timing the family at its corners and centre, one integration and a few hundred pixels."""
    points = len(x.values) * len(y.values)
    places = [(a, b) for a in (0, len(x.values) // 2, -1) for b in (0, len(y.values) // 2, -1)]
    start = time.perf_counter()
    systems = [s for s in (_tried(family, float(x.values[a]), float(y.values[b])) for a, b in places) if s is not None]
    build = (time.perf_counter() - start) / len(places)
    memory = _FIXED_BYTES + _BYTES_PER_PIXEL * points
    if not systems:
        return MapEstimate(build * points, memory, points)
    longest = min(systems, key=lambda s: float(s.frequency))
    A_0, A_cos, A_sin = (m[None] for m in scaled_coefficients(longest.A_0, longest.A_cos, longest.A_sin))
    start = time.perf_counter()
    matrix = monodromy_many(A_0, A_cos, A_sin, frequency=longest.frequency.reshape(1)).matrices[0]
    integration = time.perf_counter() - start
    basis = np.linspace(0.9, 1.0, _PIXELS)[:, None]
    engine.moduli(matrix, basis[:1])  # what the engine compiles once is not the map's cost
    start = time.perf_counter()
    engine.moduli(matrix, basis)
    pixel = 1.3 * (time.perf_counter() - start) / _PIXELS + 1e-6
    phases = [2.0 * np.pi / float(s.frequency) * np.max(np.abs(np.linalg.eigvals(s.A_0).imag)) for s in systems]
    nodes_x = bessel_terms(0.5 * float(np.ptp(phases))) if x.reciprocal else 25
    columns = nodes_x * (1 if y.linear or x.linear else 25)
    nodes = min(columns, points) * (build + integration)
    evaluated = points * (_SHARE * 2.5 if adaptive else 1.0)
    n = longest.A_0.shape[-1]
    memory += threads * 16.0 * 8.0 * n * n * max(len(x.values), len(y.values))
    return MapEstimate(nodes + evaluated * pixel / max(1, threads), memory, points)


def _tried(family: PeriodicFamily, x: float, y: float) -> PeriodicSystem | None:
    try:
        return family(x, y)
    except (ModelError, OutOfDomain):
        return None
