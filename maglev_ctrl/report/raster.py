"""Planes of any size as pictures of bounded size, and cells of pictures as outlines."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from maglev_ctrl.arrays import FloatArray


def even_cells(values: FloatArray, *, most: int) -> tuple[FloatArray, tuple[NDArray[np.int64], ...]]:
    """Centres of at most `most` even cells over ascending `values`, and which of the values each cell stands for.

    Every value belongs to a cell, so that nothing narrow is lost; a cell without one stands for the nearest.

    Parameters
    ----------
    values : (p,) ascending
    most : largest number of cells

    Examples
    --------
    >>> centres, members = even_cells(np.array([0.0, 1.0, 4.0]), most=5)
    >>> centres.tolist(), [m.tolist() for m in members]
    ([0.0, 1.0, 2.0, 3.0, 4.0], [[0], [1], [1], [2], [2]])
    """
    if len(values) == 1:
        return values, (np.zeros(1, dtype=np.int64),)
    span = float(values[-1] - values[0])
    count = int(np.clip(round(span / float(np.min(np.diff(values)))) + 1, len(values), max(most, 2)))
    centres = np.linspace(values[0], values[-1], count)
    # Centres stand on the first and last value: the outer cells reach half a cell beyond them.
    place = np.clip(np.rint((values - values[0]) / span * (count - 1)).astype(np.int64), 0, count - 1)
    members = []
    for k in range(count):
        own = np.flatnonzero(place == k)
        members.append(own if own.size else np.array([int(np.abs(values - centres[k]).argmin())]))
    return centres, tuple(members)


def worst_members(
    priority: NDArray[Any], columns: tuple[NDArray[np.int64], ...], rows: tuple[NDArray[np.int64], ...]
) -> NDArray[np.int64]:
    """Flat index (ny, nx) of the point of largest `priority` (p, q) among those that each cell stands for.

    Examples
    --------
    >>> worst_members(np.array([[0, 7], [3, 1]]), (np.array([0, 1]),), (np.array([0]), np.array([1])))
    array([[2],
           [1]])
    """
    p, q = priority.shape
    if len(columns) == p and len(rows) == q and all(len(one) == 1 for one in (*columns, *rows)):
        chosen = np.arange(p * q).reshape(p, q)
        return np.asarray(chosen[np.ix_([c[0] for c in columns], [r[0] for r in rows])].T)
    order = np.argsort(priority, axis=None, kind="stable")
    rank = np.empty(p * q, dtype=np.int64)
    rank[order] = np.arange(p * q)
    places = rank.reshape(p, q)
    strips = np.stack([places[c].max(axis=0) for c in columns])
    cells = np.stack([strips[:, r].max(axis=1) for r in rows])
    return np.asarray(order[cells])


def outer_edges(centres: FloatArray) -> tuple[float, float]:
    """Where the first and the last of even cells end.

    Examples
    --------
    >>> outer_edges(np.array([0.0, 1.0, 2.0]))
    (-0.5, 2.5)
    """
    step = float(centres[-1] - centres[0]) / max(1, len(centres) - 1) or 1.0
    return float(centres[0] - step / 2), float(centres[-1] + step / 2)


def rectangles(x: FloatArray, y: FloatArray, mask: NDArray[Any]) -> list[tuple[float, float, float, float]]:
    """The cells of a mask (ny, nx) as few rectangles (left, right, low, high): runs along x, equal runs stacked.

    Examples
    --------
    >>> rectangles(np.array([0.0, 1.0, 2.0]), np.array([0.0, 1.0]), np.array([[0, 1, 1], [0, 1, 1]]))
    [(0.5, 2.5, -0.5, 1.5)]
    """
    left, low = outer_edges(x)[0], outer_edges(y)[0]
    wide, tall = (outer_edges(x)[1] - left) / len(x), (outer_edges(y)[1] - low) / len(y)
    found: list[tuple[float, float, float, float]] = []
    open_runs: dict[tuple[int, int], int] = {}
    for row in range(len(y) + 1):
        line = np.zeros(len(x), dtype=np.int8) if row == len(y) else np.asarray(mask[row], dtype=np.int8)
        steps = np.diff(np.concatenate([[0], line, [0]]))
        runs = set(zip(np.flatnonzero(steps == 1).tolist(), np.flatnonzero(steps == -1).tolist(), strict=True))
        for ended in sorted(set(open_runs) - runs):
            a, b = ended
            found.append((left + a * wide, left + b * wide, low + open_runs.pop(ended) * tall, low + row * tall))
        for begun in sorted(runs - set(open_runs)):
            open_runs[begun] = row
    return found
