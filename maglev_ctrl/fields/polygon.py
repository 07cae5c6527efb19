"""Plane geometry of outlines: distances to straight edges, points inside, edges that cross."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from maglev_ctrl.arrays import FloatArray

BoolArray = NDArray[np.bool_]


def cross(u: FloatArray, v: FloatArray) -> FloatArray:
    """u_y v_z - u_z v_y over the last axis: twice the signed area that two vectors span."""
    return np.asarray(u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0])


def signed_area(outline: FloatArray) -> float:
    """Area inside an outline (n, 2), m^2; positive when it runs counter-clockwise.

    Examples
    --------
    >>> signed_area(np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [0.0, 1.0]]))
    2.0
    """
    # From the first vertex: an outline far from the origin keeps its digits.
    spokes = outline[1:] - outline[0]
    return float(0.5 * np.sum(cross(spokes[:-1], spokes[1:])))


def inner_angles(outline: FloatArray) -> FloatArray:
    """Angle inside a counter-clockwise outline (n, 2) at each vertex, rad, 0 to 2 pi.

    Examples
    --------
    >>> np.degrees(inner_angles(np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]))).round(6).tolist()
    [90.0, 45.0, 45.0]
    """
    ahead = np.roll(outline, -1, axis=0) - outline
    back = np.roll(outline, 1, axis=0) - outline
    return np.asarray(np.arctan2(cross(ahead, back), np.sum(ahead * back, axis=-1)) % (2.0 * np.pi))


def point_distances(points: FloatArray, start: FloatArray, end: FloatArray) -> FloatArray:
    """Distance of each point (N, 2) to each straight edge from start (S, 2) to end (S, 2), m: shape (N, S).

    Examples
    --------
    >>> point_distances(np.array([[0.5, 2.0], [4.0, 4.0]]), np.array([[0.0, 0.0]]), np.array([[1.0, 0.0]])).tolist()
    [[2.0], [5.0]]
    """
    along = end - start
    away = points[:, None, :] - start
    length_squared = np.sum(along * along, axis=-1)
    # An edge may be a single point; the share then does not matter.
    share = np.clip(np.sum(away * along, axis=-1) / np.where(length_squared > 0.0, length_squared, 1.0), 0.0, 1.0)
    rest = away - share[..., None] * along
    return np.asarray(np.hypot(rest[..., 0], rest[..., 1]))


def edge_distances(start: FloatArray, end: FloatArray, other_start: FloatArray, other_end: FloatArray) -> FloatArray:
    """Shortest distance of each edge (M, 2) to each of the other edges (S, 2), m: shape (M, S); zero where they cross.

    Examples
    --------
    >>> a, b = np.array([[0.0, 0.0]]), np.array([[2.0, 0.0]])
    >>> edge_distances(a, b, np.array([[1.0, -1.0], [3.0, 0.0]]), np.array([[1.0, 1.0], [3.0, 1.0]])).tolist()
    [[0.0, 1.0]]
    """
    nearest = np.minimum(
        np.minimum(point_distances(start, other_start, other_end), point_distances(end, other_start, other_end)),
        np.minimum(point_distances(other_start, start, end).T, point_distances(other_end, start, end).T),
    )
    first, second = (end - start)[:, None, :], other_end - other_start
    offset = other_start - start[:, None, :]
    turn = cross(first, second)
    with np.errstate(divide="ignore", invalid="ignore"):
        s, t = cross(offset, second) / turn, cross(offset, first) / turn
        crossing = (turn != 0.0) & (s >= 0.0) & (s <= 1.0) & (t >= 0.0) & (t <= 1.0)
    return np.where(crossing, 0.0, nearest)


def inside(points: FloatArray, outline: FloatArray) -> BoolArray:
    """Which points (N, 2) lie inside an outline (n, 2), by counting crossings; on the outline itself either answer.

    Examples
    --------
    >>> inside(np.array([[0.2, 0.2], [1.0, 1.0]]), np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])).tolist()
    [True, False]
    """
    start, end = outline, np.roll(outline, -1, axis=0)
    y, z = points[:, None, 0], points[:, None, 1]
    spans = (start[:, 1] > z) != (end[:, 1] > z)
    rise = np.where(end[:, 1] == start[:, 1], 1.0, end[:, 1] - start[:, 1])
    meets = start[:, 0] + (z - start[:, 1]) / rise * (end[:, 0] - start[:, 0])
    return np.asarray(np.sum(spans & (y < meets), axis=1) % 2 == 1)
