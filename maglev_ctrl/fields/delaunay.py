"""Delaunay refinement: points are added until every triangle is small enough and well shaped.

Off-centres after A. Uengoer (2009) at the spacing wanted, so that a front of nearly equilateral triangles grows from
the finest edges outwards; segments that block a point are halved (P. Chew 1993). Points are added in batches that keep
their distance from one another. Nothing is random: the same input gives the same mesh.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import Delaunay, cKDTree

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.fields.polygon import BoolArray, cross

IntArray = NDArray[np.intp]
Spacing = Callable[[FloatArray], FloatArray]

ROUNDS = 200
POINTS = 20_000
LARGE = 1.6
"""A triangle is too large when its circumradius exceeds this times an equilateral one's of the spacing wanted."""
NEAR = 0.8
"""Points added are at least this share of the spacing wanted apart."""
ANGLE = np.radians(25.0)
"""Smallest angle aimed at, where the outline itself has no smaller one."""
EDGE, VERTEX, FREE = 0, -1, -2


class NotMeshed(ValueError):
    """The refinement ended without a mesh that fits the outlines; a slightly other edge length may do."""


@dataclass(slots=True)
class Cloud:
    """Points (N, 2) being refined, and the segments (S, 2) between them that the triangles must not cross.

    `line` says for each segment which straight edge or ring it is part of, `rank` for each point: the line it lies on,
    VERTEX or FREE. `sharp` are vertices where two lines meet at less than 60 degrees, `narrow` (L, L) which lines do.
    `ring` is the centre and radius of the circle that line 0 runs round.
    """

    points: FloatArray
    segments: IntArray
    line: IntArray
    rank: IntArray
    sharp: BoolArray
    narrow: BoolArray
    ring: tuple[FloatArray, float]


@dataclass(frozen=True, eq=False, slots=True)
class Shapes:
    """Triangles with their circumcentres (T, 2), circumradii, shortest edges (T,) and the corners opposite these."""

    triangles: IntArray
    middle: FloatArray
    circumcentre: FloatArray
    circumradius: FloatArray
    shortest: FloatArray
    apex: IntArray

    @property
    def smallest_angle(self) -> FloatArray:
        """Smallest angle of each triangle, rad."""
        return np.asarray(np.arcsin(np.minimum(0.5 * self.shortest / self.circumradius, 1.0)))


def triangles_of(points: FloatArray) -> IntArray:
    """Delaunay triangles (T, 3) of points (N, 2), counter-clockwise."""
    # Qhull's tolerances are absolute in places: unit size keeps them small.
    low = points.min(axis=0)
    scaled = (points - low) / np.max(np.ptp(points, axis=0))
    triangles = np.asarray(Delaunay(scaled).simplices, dtype=np.intp)
    a, b, c = (points[triangles[:, i]] for i in range(3))
    turned = cross(b - a, c - a) < 0.0
    triangles[turned] = triangles[turned][:, [0, 2, 1]]
    return triangles


def shapes_of(points: FloatArray, triangles: IntArray) -> Shapes:
    """Circumcircles and shortest edges of triangles (T, 3)."""
    corners = points[triangles]
    a, b, c = (corners[:, i] for i in range(3))
    ab, ac = b - a, c - a
    twice = 2.0 * cross(ab, ac)
    ab2, ac2 = np.sum(ab * ab, axis=-1), np.sum(ac * ac, axis=-1)
    twice = np.where(np.abs(twice) > 1e-14 * (ab2 + ac2), twice, 1e-14 * (ab2 + ac2))
    offset = np.stack([ac[:, 1] * ab2 - ab[:, 1] * ac2, ab[:, 0] * ac2 - ac[:, 0] * ab2], axis=-1) / twice[:, None]
    opposite = np.stack([np.hypot(*(c - b).T), np.sqrt(ac2), np.sqrt(ab2)], axis=-1)
    apex = np.argmin(opposite, axis=-1)
    return Shapes(
        triangles=triangles,
        middle=corners.mean(axis=1),
        circumcentre=a + offset,
        circumradius=np.hypot(*offset.T),
        shortest=np.min(opposite, axis=-1),
        apex=apex,
    )


def missing_segments(cloud: Cloud, triangles: IntArray) -> BoolArray:
    """Which segments are not edges of any triangle."""
    count = len(cloud.points)
    ring = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    return ~np.isin(_keys(cloud.segments, count), _keys(ring, count))


def refine(cloud: Cloud, spacing: Spacing, *, smallest: float, angle: float = ANGLE) -> IntArray:
    """Add points to the cloud until its Delaunay triangles hold every segment, obey the spacing and are well shaped.

    Parameters
    ----------
    cloud : changed in place
    spacing : edge length wanted at points (n, 2), m
    smallest : no edge shorter than this is made for shape's sake, m
    angle : smallest angle aimed at, rad

    Raises
    ------
    ValueError : more than POINTS points needed
    """
    for _ in range(ROUNDS):
        if len(cloud.points) > POINTS:
            raise ValueError(f"the cross-section needs more than {POINTS} mesh points: choose larger edge lengths")
        triangles = triangles_of(cloud.points)
        missing = missing_segments(cloud, triangles)
        if missing.any():
            _halve(cloud, missing)
            continue
        added, blocked = _wanted(cloud, shapes_of(cloud.points, triangles), spacing, smallest, angle)
        if blocked.any():
            _halve(cloud, blocked)
        if len(added):
            _append(cloud, added, np.full(len(added), FREE))
        elif not blocked.any():
            return triangles
    raise NotMeshed("the cross-section could not be meshed: its outline has parts too narrow for the mesh size")


def _wanted(
    cloud: Cloud, shapes: Shapes, spacing: Spacing, smallest: float, angle: float
) -> tuple[FloatArray, BoolArray]:
    """Points to add now, and the segments that block others and must be halved first."""
    h = spacing(shapes.middle)
    large = shapes.circumradius > LARGE * h / np.sqrt(3.0)
    skinny = (shapes.smallest_angle < angle) & ~_excused(cloud, shapes) & (shapes.circumradius > smallest)
    # A front first; what it cannot mend (points that would fall on the rim) must not hide the rest.
    for chosen in (large & (shapes.shortest < 1.5 * h), large, skinny):
        added, blocked = _batch(cloud, shapes, np.flatnonzero(chosen), h, spacing, smallest)
        if len(added) or blocked.any():
            return added, blocked
    return np.empty((0, 2)), np.zeros(len(cloud.segments), dtype=bool)


def _batch(
    cloud: Cloud, shapes: Shapes, index: IntArray, h: FloatArray, spacing: Spacing, smallest: float
) -> tuple[FloatArray, BoolArray]:
    """Points for as many of the chosen triangles as keep their distance, worst first, and the segments in the way."""
    none = np.zeros(len(cloud.segments), dtype=bool)
    if not index.size:
        return np.empty((0, 2)), none
    index = index[np.lexsort((index, -(shapes.circumradius / h)[index]))]
    at = _sites(cloud, shapes, index, h)
    # In narrow parts the points already there are nearer than the spacing wanted, and so may the new ones be.
    apart = np.minimum(NEAR * spacing(at), cKDTree(cloud.points).query(at)[0])
    number, segment = _in_the_way(cloud, at, smallest)
    blocked = np.isin(np.arange(len(at)), number)
    centre, radius = cloud.ring
    outside = np.hypot(*(at - centre).T) > 0.98 * radius
    keep = _spread(at, apart, ~blocked & ~outside)
    none[segment[np.isin(number, _spread(at, apart, blocked))]] = True
    return at[keep], none


def _in_the_way(cloud: Cloud, at: FloatArray, smallest: float) -> tuple[IntArray, IntArray]:
    """Pairs of a point of `at` and a segment too near to it: seen at more than 120 degrees, triangles would be flat."""
    a, b = cloud.points[cloud.segments[:, 0]], cloud.points[cloud.segments[:, 1]]
    length = np.hypot(*(b - a).T)
    near = cKDTree(at).query_ball_point(0.5 * (a + b), 0.5 * length, return_sorted=True)
    segment = np.repeat(np.arange(len(a)), [len(one) for one in near])
    number = np.concatenate([np.asarray(one, dtype=np.intp) for one in near])
    to_a, to_b = a[segment] - at[number], b[segment] - at[number]
    wide = np.sum(to_a * to_b, axis=-1) < -0.5 * np.hypot(*to_a.T) * np.hypot(*to_b.T)
    wide &= length[segment] > 2.0 * smallest
    return number[wide], segment[wide]


def _sites(cloud: Cloud, shapes: Shapes, index: IntArray, h: FloatArray) -> FloatArray:
    """Where to add points: at the wanted spacing from the shortest edge, or at the circumcentre if that is nearer."""
    centre, short = shapes.circumcentre[index], shapes.shortest[index]
    corner = shapes.triangles[index]
    apex = shapes.apex[index]
    row = np.arange(len(index))
    p, q = (cloud.points[corner[row, (apex + k) % 3]] for k in (1, 2))
    foot = 0.5 * (p + q)
    way = centre - foot
    reach = np.hypot(*way.T)
    wish = np.sqrt(np.maximum(h[index] ** 2 - 0.25 * short**2, 0.75 * short**2))
    off = foot + way * np.minimum(wish / np.maximum(reach, 1e-300), 1.0)[:, None]
    tree = cKDTree(cloud.points)
    crowded = tree.query(off)[0] < NEAR * h[index]
    return np.where(crowded[:, None], centre, off)


def _spread(at: FloatArray, apart: FloatArray, allowed: BoolArray) -> IntArray:
    """Greedy choice, in the order given, of allowed points that keep `apart` from one another."""
    open_ = allowed.copy()
    taken = []
    for i in range(len(at)):
        if open_[i]:
            taken.append(i)
            open_ &= np.hypot(at[:, 0] - at[i, 0], at[:, 1] - at[i, 1]) >= apart[i]
    return np.asarray(taken, dtype=np.intp)


def _excused(cloud: Cloud, shapes: Shapes) -> BoolArray:
    """Triangles in a corner of the outline that is itself sharp: splitting cannot mend them."""
    row = np.arange(len(shapes.triangles))
    apex = shapes.triangles[row, shapes.apex]
    p, q = (cloud.rank[shapes.triangles[row, (shapes.apex + k) % 3]] for k in (1, 2))
    on_lines = (p >= EDGE) & (q >= EDGE)
    return cloud.sharp[apex] | (on_lines & cloud.narrow[np.maximum(p, 0), np.maximum(q, 0)])


def _halve(cloud: Cloud, which: BoolArray) -> None:
    """Split segments in two; next to a sharp vertex on circles about it, so that the halves do not block each other."""
    index = np.flatnonzero(which)
    ends = cloud.segments[index]
    a, b = cloud.points[ends[:, 0]], cloud.points[ends[:, 1]]
    share = np.full(len(index), 0.5)
    length = np.hypot(*(b - a).T)
    round_ = 2.0 ** np.round(np.log2(0.5 * length)) / length
    first, last = cloud.sharp[ends[:, 0]], cloud.sharp[ends[:, 1]]
    share = np.where(first & ~last, round_, np.where(last & ~first, 1.0 - round_, share))
    middle = a + share[:, None] * (b - a)
    centre, radius = cloud.ring
    on_ring = cloud.line[index] == 0
    away = middle - centre
    middle[on_ring] = (centre + away * (radius / np.hypot(*away.T))[:, None])[on_ring]
    new = len(cloud.points) + np.arange(len(index))
    _append(cloud, middle, cloud.line[index])
    cloud.segments = np.concatenate([cloud.segments, np.stack([new, ends[:, 1]], axis=-1)])
    cloud.segments[index, 1] = new
    cloud.line = np.concatenate([cloud.line, cloud.line[index]])


def _append(cloud: Cloud, points: FloatArray, rank: IntArray) -> None:
    cloud.points = np.concatenate([cloud.points, points])
    cloud.rank = np.concatenate([cloud.rank, rank])
    cloud.sharp = np.concatenate([cloud.sharp, np.zeros(len(points), dtype=bool)])


def _keys(pairs: IntArray, count: int) -> IntArray:
    low, high = np.minimum(pairs[:, 0], pairs[:, 1]), np.maximum(pairs[:, 0], pairs[:, 1])
    return np.asarray(low * count + high)


def smooth(cloud: Cloud, spacing: Spacing, *, steps: int) -> None:
    """Move the free points of the cloud towards the weighted centres of their triangles; shapes become more even."""
    free = cloud.rank == FREE
    for _ in range(steps):
        triangles = triangles_of(cloud.points)
        corners = cloud.points[triangles]
        area = 0.5 * cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        middle = corners.mean(axis=1)
        weight = area / spacing(middle) ** 3
        total = np.bincount(triangles.ravel(), np.repeat(weight, 3), len(cloud.points))
        pull = np.stack(
            [np.bincount(triangles.ravel(), np.repeat(weight * middle[:, k], 3), len(cloud.points)) for k in (0, 1)],
            axis=-1,
        )
        target = pull / total[:, None]
        moved = cloud.points.copy()
        moved[free] += 0.8 * (target - cloud.points)[free]
        before = cloud.points
        cloud.points = moved
        if missing_segments(cloud, triangles_of(moved)).any():
            cloud.points = before
            return
