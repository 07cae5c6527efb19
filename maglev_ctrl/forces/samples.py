"""Force tables as given: rows or a grid, checked, in one shape."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from maglev_ctrl.arrays import FloatArray

Axis = Literal["height", "gap", "speed"]
AXES: tuple[Axis, ...] = ("height", "gap", "speed")


@dataclass(frozen=True, eq=False, slots=True)
class Samples:
    """Rows of a force table: `points` (N, 3) height, gap, speed and `values` (N, 3) lift, guidance, drag.

    Without a gap in the table its column is zero and `has_gap` is false.
    """

    points: FloatArray
    values: FloatArray
    has_gap: bool


def as_samples(
    height: ArrayLike,
    gap: ArrayLike | None,
    speed: ArrayLike,
    *,
    lift: ArrayLike,
    guidance: ArrayLike | None,
    drag: ArrayLike,
) -> Samples:
    """Checked rows from rows (N,) or from a grid (H, G, V) with its axes.

    Raises
    ------
    ValueError : shapes that do not match, NaN, heights that are not positive, doubled or unsorted points

    Examples
    --------
    >>> as_samples([0.01, 0.02], None, 30.0, lift=[2.0, 1.0], guidance=None, drag=[1.0, 0.5]).points.tolist()
    [[0.01, 0.0, 30.0], [0.02, 0.0, 30.0]]
    """
    if guidance is not None and gap is None:
        raise ValueError("gap: a table with guidance needs the gap it was measured at, got None")
    places = [np.atleast_1d(np.asarray(one, dtype=np.float64)) for one in (height, 0.0 if gap is None else gap, speed)]
    lifts = np.asarray(lift, dtype=np.float64)
    rest = {"guidance": np.zeros_like(lifts) if guidance is None else guidance, "drag": drag}
    forces = [lifts, *(_like(lifts, value, name=name) for name, value in rest.items())]
    if lifts.ndim == 3:
        columns = _grid_columns(places, shape=lifts.shape)
    else:
        columns = [_row_column(place, name=name, rows=lifts.shape) for place, name in zip(places, AXES, strict=True)]
    points = np.stack([column.ravel() for column in columns], axis=-1)
    values = np.stack([force.ravel() for force in forces], axis=-1)
    _require_sound(points, values)
    return Samples(points=points, values=values, has_gap=gap is not None)


def as_grid(samples: Samples) -> tuple[tuple[FloatArray, ...], FloatArray]:
    """Axes (H,), (G,), (V,) and values (H, G, V, 3) of rows that fill a regular grid.

    Raises
    ------
    ValueError : a combination is missing

    Examples
    --------
    >>> rows = as_samples([0.02, 0.01], None, 30.0, lift=[1.0, 2.0], guidance=None, drag=[0.5, 1.0])
    >>> axes, values = as_grid(rows)
    >>> axes[0].tolist(), values[:, 0, 0, 0].tolist()
    ([0.01, 0.02], [2.0, 1.0])
    """
    found = [np.unique(column, return_inverse=True) for column in samples.points.T]
    axes = tuple(axis for axis, _ in found)
    shape = tuple(axis.size for axis in axes)
    if len(samples.points) != np.prod(shape):
        raise ValueError(
            f"samples: a spline needs every combination of {shape[0]} heights, {shape[1]} gaps and {shape[2]} speeds, "
            f"{np.prod(shape)} samples, got {len(samples.points)}; use method 'polynomial' for scattered samples"
        )
    values = np.empty((*shape, samples.values.shape[1]))
    values[tuple(places.ravel() for _, places in found)] = samples.values
    return axes, values


def _like(lifts: FloatArray, value: ArrayLike, *, name: str) -> FloatArray:
    force = np.asarray(value, dtype=np.float64)
    if force.shape != lifts.shape:
        raise ValueError(f"{name}: expected the shape of lift, {lifts.shape}, got {force.shape}")
    return force


def _grid_columns(places: list[FloatArray], *, shape: tuple[int, ...]) -> list[FloatArray]:
    for place, name, count in zip(places, AXES, shape, strict=True):
        if place.shape != (count,):
            raise ValueError(f"{name}: expected an axis of shape ({count},) for forces {shape}, got {place.shape}")
        if np.any(np.diff(place) <= 0.0):
            raise ValueError(f"{name}: expected a strictly increasing axis, got {place.tolist()}")
    return list(np.meshgrid(*places, indexing="ij"))


def _row_column(place: FloatArray, *, name: Axis, rows: tuple[int, ...]) -> FloatArray:
    if len(rows) != 1:
        raise ValueError(f"lift: expected rows (N,) or a grid (H, G, V), got shape {rows}")
    if place.shape not in (rows, (1,)):
        raise ValueError(f"{name}: expected {rows[0]} rows like lift, got shape {place.shape}")
    return np.broadcast_to(place, rows)


def _require_sound(points: FloatArray, values: FloatArray) -> None:
    if len(points) == 0:
        raise ValueError("samples: expected at least one sample, got none")
    for name, column in zip((*AXES, "lift", "guidance", "drag"), [*points.T, *values.T], strict=True):
        if not np.all(np.isfinite(column)):
            row = int(np.flatnonzero(~np.isfinite(column))[0])
            raise ValueError(f"{name}: expected finite numbers, got {column[row]} in row {row + 1}")
    if np.any(points[:, 0] <= 0.0):
        raise ValueError(f"height: expected positive heights, got {points[:, 0].min():.6g} m")
    places, counts = np.unique(points, axis=0, return_counts=True)
    if len(places) < len(points):
        height, gap, speed = places[np.argmax(counts)]
        raise ValueError(f"samples: height {height:.6g} m, gap {gap:.6g} m, speed {speed:.6g} m/s is given twice")
