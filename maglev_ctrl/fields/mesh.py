"""Triangles of a guideway's cross-section and of the air around it, fine at the metal's corners and coarse far away."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.fields.delaunay import (
    POINTS,
    VERTEX,
    Cloud,
    IntArray,
    NotMeshed,
    refine,
    shapes_of,
    smooth,
)
from maglev_ctrl.fields.polygon import cross, edge_distances, inner_angles, inside, point_distances
from maglev_ctrl.fields.section import CrossSection

AIR = -1
"""Index of air in `Triangulation.conductor`."""
_SHRINKS = (1.0, 0.93, 0.85, 0.76)
STRAIGHT = np.radians(15.0)
"""A vertex that turns by less than this is part of a curved face, not a corner: the field has no peak there."""


@dataclass(frozen=True, eq=False, slots=True)
class Triangulation:
    """Conforming triangles of metal and air.

    Parameters
    ----------
    points : (2, N) vertices (y, z), m
    triangles : (3, T) vertices of each triangle, counter-clockwise
    conductor : (T,) index of the section's conductor, AIR = -1 outside
    """

    points: FloatArray
    triangles: NDArray[np.intp]
    conductor: NDArray[np.intp]

    def areas(self) -> FloatArray:
        """Area of each triangle, m^2."""
        a, b, c = (self.points[:, self.triangles[i]].T for i in range(3))
        return np.asarray(0.5 * cross(b - a, c - a))

    def smallest_angles(self) -> FloatArray:
        """Smallest angle of each triangle, rad."""
        return shapes_of(np.ascontiguousarray(self.points.T), self.triangles.T).smallest_angle


@dataclass(frozen=True, eq=False, slots=True)
class Spacing:
    """Edge length wanted: finest at corners, growing with distance from them, capped in metal, growing on in air.

    `local` is a further cap on it, where there is one; `shrink` is a factor on all of it.
    """

    section: CrossSection
    corners: FloatArray
    finest: float
    in_conductor: float
    growth: float
    air_growth: float
    coarsest: float
    local: Callable[[FloatArray], FloatArray] | None = None
    shrink: float = 1.0

    def __call__(self, points: FloatArray) -> FloatArray:
        """Edge length wanted at points (n, 2), m."""
        to_metal = np.maximum(self.section.distance(points), 0.0)
        wanted = np.full(len(points), self.in_conductor)
        if len(self.corners):
            away = np.min(np.hypot(*(points[:, None, :] - self.corners).transpose(2, 0, 1)), axis=1)
            wanted = np.minimum(
                self.finest + self.growth * away + (self.air_growth - self.growth) * to_metal,
                self.in_conductor + self.air_growth * to_metal,
            )
        else:
            wanted += self.air_growth * to_metal
        if self.local is not None:
            wanted = np.minimum(wanted, self.local(points))
        return np.asarray(self.shrink * np.minimum(wanted, self.coarsest))


def triangulate(
    section: CrossSection,
    *,
    finest: float,
    in_conductor: float,
    growth: float = 0.3,
    air_radius: float | None = None,
    air_growth: float | None = None,
    local: Callable[[FloatArray], FloatArray] | None = None,
) -> Triangulation:
    """Triangles of the section's conductors and of a disk of air about the middle of the section.

    Every edge of an outline is a chain of triangle edges. The same input gives the same mesh.

    Parameters
    ----------
    section : conductors
    finest : edge length at the conductors' corners, m
    in_conductor : largest edge length in metal and on its faces, m
    growth : how much the edge length grows per metre of distance from a corner
    air_radius : m; None for 0.5 m, or six times the section's size where that is more
    air_growth : how much it grows per metre of distance from metal, up to a sixth of the radius; None for twice
        `growth`, because the field is smooth there
    local : largest edge length (n,) at points (n, 2), m; it should not change faster than `growth`

    Raises
    ------
    ValueError : a length or growth that is not positive, finest above in_conductor, a disk that does not hold the
        section with room to spare, or a mesh that needs too many points

    Examples
    --------
    >>> guideway = CrossSection.l_shape(leg=76.2e-3, thickness=6.35e-3, conductivity=2.5e7)
    >>> mesh = triangulate(guideway, finest=1e-3, in_conductor=6e-3, growth=0.3)
    >>> metal = mesh.areas()[mesh.conductor == 0].sum()
    >>> bool(abs(metal / guideway.conductors[0].area - 1.0) < 1e-12)
    True
    """
    spacing, ring = _plan(section, finest, in_conductor, growth, air_radius, air_growth)
    for shrink in _SHRINKS:
        try:
            return _mesh(section, replace(spacing, local=local, shrink=shrink), ring)
        except NotMeshed:
            # Where points fall is a matter of luck at the limit of what fits; another size falls otherwise.
            if shrink == _SHRINKS[-1]:
                raise
    raise AssertionError("unreachable")


def _mesh(section: CrossSection, spacing: Spacing, ring: tuple[FloatArray, float]) -> Triangulation:
    cloud = _outlines(section, spacing, ring)
    smallest = min(0.05 * spacing.finest, 0.2 * _narrowest(section, spacing))
    refine(cloud, spacing, smallest=smallest, angle=0.0)
    smooth(cloud, spacing, steps=12)
    triangles = refine(cloud, spacing, smallest=smallest)
    return _labelled(section, cloud.points, triangles)


def _plan(
    section: CrossSection,
    finest: float,
    in_conductor: float,
    growth: float,
    air_radius: float | None,
    air_growth: float | None,
) -> tuple[Spacing, tuple[FloatArray, float]]:
    """The edge length wanted, and centre and radius of the disk."""
    in_air = 2.0 * growth if air_growth is None else air_growth
    lengths = {"finest": finest, "in_conductor": in_conductor, "growth": growth, "air_growth": in_air}
    for name, value in lengths.items():
        if not (np.isfinite(value) and value > 0.0):
            raise ValueError(f"{name}: expected a positive value, got {value}")
    if finest > in_conductor:
        raise ValueError(f"finest: expected at most in_conductor = {in_conductor} m, got {finest}")
    if in_air < growth:
        raise ValueError(f"air_growth: expected at least growth = {growth}, got {in_air}")
    low, high = section.bounds
    radius = max(0.5, 6.0 * section.size) if air_radius is None else float(air_radius)
    needed = float(np.hypot(*(high - low)))
    if not (np.isfinite(radius) and radius >= needed):
        raise ValueError(f"air_radius: expected at least the section's diagonal {needed:g} m, got {air_radius}")
    spacing = Spacing(section, _corners(section), finest, in_conductor, growth, in_air, radius / 6.0)
    return spacing, (0.5 * (low + high), radius)


def _outlines(section: CrossSection, spacing: Spacing, ring: tuple[FloatArray, float]) -> Cloud:
    """Points on the rim of the disk and on every edge of the conductors, at the spacing wanted."""
    centre, radius = ring
    rim = np.linspace(0.0, 2.0 * np.pi, 720, endpoint=False)
    local = spacing(centre + radius * np.stack([np.cos(rim), np.sin(rim)], axis=-1))
    count = max(12, int(np.ceil(2.0 * np.pi * radius * np.mean(1.0 / local))))
    turn = 2.0 * np.pi * np.arange(count) / count
    points = [centre + radius * np.stack([np.cos(turn), np.sin(turn)], axis=-1)]
    order = np.arange(count)
    segments = [np.stack([order, (order + 1) % count], axis=-1)]
    line = [np.zeros(count, dtype=np.intp)]
    rank = [np.zeros(count, dtype=np.intp)]
    total = count

    known: dict[tuple[float, float], int] = {}
    for one in section.conductors:
        for vertex in one.outline:
            if tuple(vertex.tolist()) not in known:
                known[tuple(vertex.tolist())] = total
                points.append(vertex[None, :])
                rank.append(np.full(1, VERTEX))
                total += 1
    edges: dict[tuple[int, int], int] = {}
    for one in section.conductors:
        for start, end in zip(one.outline, np.roll(one.outline, -1, axis=0), strict=True):
            first, last = known[tuple(start.tolist())], known[tuple(end.tolist())]
            if (last, first) in edges:
                continue
            edges[first, last] = len(edges) + 1
            share = _divisions(start, end, spacing)
            points.append(start + share[:, None] * (end - start))
            chain = np.concatenate([[first], total + np.arange(len(share)), [last]])
            segments.append(np.stack([chain[:-1], chain[1:]], axis=-1))
            line.append(np.full(len(chain) - 1, edges[first, last]))
            rank.append(np.full(len(share), edges[first, last]))
            total += len(share)
    cloud_points = np.concatenate(points)
    sharp, narrow = _sharp_corners(cloud_points, edges)
    return Cloud(
        points=cloud_points,
        segments=np.concatenate(segments),
        line=np.concatenate(line),
        rank=np.concatenate(rank),
        sharp=sharp,
        narrow=narrow,
        ring=ring,
    )


def _divisions(start: FloatArray, end: FloatArray, spacing: Spacing) -> FloatArray:
    """Shares (n,) of an edge at which to put points, so that neighbours are the wanted spacing apart."""
    length = float(np.hypot(*(end - start)))
    count = int(min(max(64, 8 * length / spacing.finest), 100_000))
    share = np.linspace(0.0, 1.0, count + 1)
    middle = 0.5 * (share[1:] + share[:-1])
    need = np.concatenate([[0.0], np.cumsum(length / count / spacing(start + middle[:, None] * (end - start)))])
    pieces = max(1, int(np.ceil(need[-1] - 0.25)))
    return np.asarray(np.interp(need[-1] * np.arange(1, pieces) / pieces, need, share))


def _narrowest(section: CrossSection, spacing: Spacing) -> float:
    """Width of the narrowest metal or gap between edges that do not meet, m; refuse what needs too many points."""
    start = np.concatenate([one.outline for one in section.conductors])
    end = np.concatenate([np.roll(one.outline, -1, axis=0) for one in section.conductors])
    ends = (start, end)
    apart = ~np.any([np.all(p[:, None] == q, axis=-1) for p in ends for q in ends], axis=0)
    share = (np.arange(64)[:, None] + 0.5) / 64
    needed = 0.0
    for i in np.flatnonzero(apart.any(axis=1)):
        along = start[i] + share * (end[i] - start[i])
        width = np.min(point_distances(along, start[apart[i]], end[apart[i]]), axis=1)
        needed += float(np.hypot(*(end[i] - start[i])) * np.mean(1.0 / np.minimum(width, spacing(along))))
    narrowest = float(np.min(np.where(apart, edge_distances(start, end, start, end), np.inf)))
    # Points follow the edges at the local width, and about as many again lie between them.
    if needed > 0.7 * POINTS:
        raise ValueError(
            f"the cross-section needs more than {POINTS} mesh points: its narrowest part or gap is {narrowest:g} m wide"
        )
    return narrowest


def _sharp_corners(
    points: FloatArray, edges: dict[tuple[int, int], int]
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Vertices where two lines meet at less than 60 degrees, and which pairs of lines do."""
    sharp = np.zeros(len(points), dtype=bool)
    narrow = np.zeros((len(edges) + 1, len(edges) + 1), dtype=bool)
    spokes: dict[int, list[tuple[int, FloatArray]]] = {}
    for (first, last), line in edges.items():
        along = (points[last] - points[first]) / np.hypot(*(points[last] - points[first]))
        spokes.setdefault(first, []).append((line, along))
        spokes.setdefault(last, []).append((line, -along))
    for vertex, around in spokes.items():
        for i, (line, way) in enumerate(around):
            for other, other_way in around[:i]:
                if way @ other_way > 0.5 + 1e-9:
                    sharp[vertex] = narrow[line, other] = narrow[other, line] = True
    return sharp, narrow


def _corners(section: CrossSection) -> FloatArray:
    """Vertices (n, 2) at which an outline turns."""
    return np.concatenate(
        [one.outline[np.abs(inner_angles(one.outline) - np.pi) >= STRAIGHT] for one in section.conductors]
    )


def _labelled(section: CrossSection, points: FloatArray, triangles: IntArray) -> Triangulation:
    """Triangles with the conductor that each lies in."""
    middle = points[triangles].mean(axis=1)
    conductor = np.full(len(triangles), AIR, dtype=np.intp)
    for i, one in enumerate(section.conductors):
        conductor[inside(middle, one.outline)] = i
    arrays = np.ascontiguousarray(points.T), np.ascontiguousarray(triangles.T), conductor
    for array in arrays:
        array.flags.writeable = False
    mesh = Triangulation(*arrays)
    areas = mesh.areas()
    metal = [float(areas[conductor == i].sum()) for i in range(len(section.conductors))]
    # Qhull promises less than this needs where many points lie on one circle; a broken mesh must not go unseen.
    if np.any(areas <= 0.0) or not np.allclose(metal, [one.area for one in section.conductors], rtol=1e-9, atol=0.0):
        raise NotMeshed("the cross-section could not be meshed: its triangles do not fill the conductors")
    return mesh
