"""Stability maps over a parameter (speed) and the modulation depth, every unstable region named.

Per column the monodromy matrix is a Chebyshev series in the depth, the multipliers are batched; sampled points are
checked against Hill's method in the frequency domain; tongues narrower than the grid step are sought where resonance
says they are.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from maglev_ctrl.analysis.critical_depth import (
    CriticalDepth,
    CriticalDepthCurve,
    critical_depth,
    critical_depth_curve,
    name_at,
)
from maglev_ctrl.analysis.depth_surrogate import DepthSurrogate, depth_surrogate
from maglev_ctrl.analysis.region_naming import HILL_AGREEMENT, check_points, hill_difference, name_regions
from maglev_ctrl.analysis.resonance import Resonance
from maglev_ctrl.analysis.resonance_seeds import SeededTongue, SeedInput, seed_tongues
from maglev_ctrl.arrays import ComplexArray, FloatArray, read_only, read_only_any
from maglev_ctrl.display import Shown

__all__ = [
    "CriticalDepth",
    "CriticalDepthCurve",
    "ResonanceMap",
    "SeededTongue",
    "critical_depth",
    "critical_depth_curve",
    "resonance_map",
]


@dataclass(frozen=True, eq=False, slots=True, repr=False)
class ResonanceMap(Shown):
    """Stability over `parameter` (V,) and `depths` (E,).

    `spectral_radius`, `growth_rate` (1/s), `unstable`, `unresolved`, `tongue_index` are (V, E); `tongue_index` is -1
    where stable, else an index into `tongues`. `error_bound` (V,) 1/s bounds the error of the growth rate in each
    column. `checked` (K, 2) are the points compared with Hill's method, `check_difference` (K,) 1/s the differences;
    a column with a point that disagrees is `unresolved`. `seeded` are the tongues sought between columns.
    """

    _told: ClassVar = ("parameter_name", "parameter", "depths", "growth_rate", "tongues")

    parameter_name: str
    parameter: FloatArray
    depths: FloatArray
    spectral_radius: FloatArray
    growth_rate: FloatArray
    unstable: NDArray[np.bool_]
    unresolved: NDArray[np.bool_]
    tongue_index: NDArray[np.int64]
    tongues: tuple[Resonance, ...]
    error_bound: FloatArray
    checked: NDArray[np.int64]
    check_difference: FloatArray
    seeded: tuple[SeededTongue, ...]
    method: str


def resonance_map(
    A_0: FloatArray, A_cos: FloatArray, A_sin: FloatArray, frequency: FloatArray, depths: FloatArray, *,
    parameter: FloatArray, parameter_name: str = "speed", states: tuple[str, ...] = (),
    labels: tuple[str, ...] | None = None, checks: int = 24, max_order: int = 2, seeds: bool = True,
) -> ResonanceMap:  # fmt: skip
    """Stability map of x' = [A_0 + depth sum_k (A_cos[k] cos k W t + A_sin[k] sin k W t)] x.

    Parameters
    ----------
    A_0 : (V, n, n); A_cos, A_sin : (V, H, n, n) at unit depth, 1/s
    frequency : (V,) rad/s
    depths : (E,) not negative, ascending
    parameter : (V,) ascending, for instance speed in m/s
    states, labels : names for the modes, see `state_modes`
    checks : points compared with Hill's method
    max_order : largest order k of the tongues sought between columns
    seeds : whether to look between columns

    Raises
    ------
    ValueError : a shape does not fit, or depths or parameter do not ascend

    Examples
    --------
    >>> speed = np.linspace(1.5, 2.5, 21)
    >>> A_0 = np.broadcast_to(np.array([[0.0, 1.0], [-1.0, -0.02]]), (21, 2, 2))
    >>> A_1 = np.broadcast_to(np.array([[0.0, 0.0], [-1.0, 0.0]]), (21, 1, 2, 2))
    >>> atlas = resonance_map(A_0, A_1, 0 * A_1, speed, np.linspace(0.0, 0.2, 11), parameter=speed)
    >>> [t.name for t in atlas.tongues], bool(atlas.unstable[10, -1]), bool(atlas.unstable[0, -1])
    (['2 w1/1'], True, False)
    """
    grid, levels = _checked(A_0, A_cos, A_sin, frequency, depths, parameter)
    columns, leading = _columns(grid, levels)
    period = 2.0 * np.pi / grid.frequency
    radius = np.abs(leading)
    growth = np.log(np.maximum(radius, 1e-300)) / period[:, None]
    unstable = growth > np.array([max(c.threshold, 0.0) for c in columns])[:, None]
    index, tongues = name_regions(
        growth, unstable, lambda v, e: name_at(columns[v], float(levels[e]), states=states, labels=labels)
    )
    points = check_points(growth, unstable, checks)
    difference = np.array([_hill_difference(columns[v], float(levels[e]), leading[v, e]) for v, e in points])
    unresolved = np.zeros(growth.shape, dtype=bool)
    for (v, _), apart in zip(points, difference, strict=True):
        if not apart <= HILL_AGREEMENT * grid.frequency[v]:
            unresolved[v] = True
    found = seed_tongues(grid, max_order=max_order, states=states, labels=labels) if seeds else []
    direct = sum(c.series is None for c in columns)
    nodes = max(c.nodes for c in columns)
    return ResonanceMap(
        parameter_name=parameter_name, parameter=grid.parameter, depths=levels,
        spectral_radius=read_only_any(radius), growth_rate=read_only_any(growth),
        unstable=read_only_any(unstable), unresolved=read_only_any(unresolved),
        tongue_index=read_only_any(index), tongues=tongues,
        error_bound=read_only_any([c.growth_error() for c in columns]),
        checked=read_only_any(points), check_difference=read_only_any(difference),
        seeded=tuple(_seen(seed, column, index, tongues) for column, seed in found),
        method=f"Taylor propagators, Chebyshev in depth (up to {nodes} nodes, {direct} columns direct), "
               f"{len(points)} points checked by Hill's method",
    )  # fmt: skip


def _checked(
    A_0: FloatArray, A_cos: FloatArray, A_sin: FloatArray, frequency: FloatArray, depths: FloatArray,
    parameter: FloatArray,
) -> tuple[SeedInput, FloatArray]:  # fmt: skip
    """The inputs with shapes and order checked."""
    values = read_only(parameter, name="parameter", shape=(None,))
    levels = read_only(depths, name="depths", shape=(None,))
    matrices = read_only(A_0, name="A_0", shape=(len(values), None, None))
    n = matrices.shape[-1]
    matrices = read_only(matrices, name="A_0", shape=(len(values), n, n))
    cosine = read_only(A_cos, name="A_cos", shape=(len(values), None, n, n))
    sine = read_only(A_sin, name="A_sin", shape=cosine.shape)
    omega = read_only(frequency, name="frequency", shape=(len(values),))
    if np.any(np.diff(values) <= 0.0):
        raise ValueError("parameter: expected ascending values")
    if len(levels) == 0 or np.any(np.diff(levels) <= 0.0) or levels[0] < 0.0 or levels[-1] <= 0.0:
        raise ValueError("depths: expected ascending values, not negative, the last one positive")
    if np.any(omega <= 0.0):
        raise ValueError("frequency: expected a positive angular frequency in rad/s")
    return SeedInput(matrices, cosine, sine, omega, values, float(levels[-1])), levels


def _columns(grid: SeedInput, depths: FloatArray) -> tuple[list[DepthSurrogate], ComplexArray]:
    """Surrogate of every column and the leading multiplier at every depth (V, E)."""
    columns: list[DepthSurrogate] = []
    leading = np.empty((len(grid.parameter), len(depths)), dtype=complex)
    nodes = 9
    for v in range(len(grid.parameter)):
        column = depth_surrogate(
            grid.A_0[v], grid.A_cos[v], grid.A_sin[v], frequency=float(grid.frequency[v]),
            depth_max=grid.depth_max, first_nodes=nodes,
        )  # fmt: skip
        nodes = column.needed
        columns.append(column)
        leading[v] = column.leading(depths)
    return columns, leading


def _hill_difference(column: DepthSurrogate, depth: float, multiplier: complex) -> float:
    """Distance of the leading exponent to the nearest eigenvalue of the Hill matrix, 1/s; inf when none is near."""
    return hill_difference(
        column.A_0, depth * column.A_cos, depth * column.A_sin, frequency=column.frequency, multiplier=multiplier
    )


def _seen(seed: SeededTongue, column: int, index: NDArray[np.int64], tongues: tuple[Resonance, ...]) -> SeededTongue:
    """The seed with the verdict whether the columns on either side show a tongue of that name."""
    beside = np.unique(index[column : column + 2])
    shown = any(k >= 0 and tongues[k].name == seed.name for k in beside)
    return SeededTongue(seed.parameter, seed.threshold, seed.name, bool(shown))
