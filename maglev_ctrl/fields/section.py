"""Cross-section of a guideway: conductors of any outline, uniform along the track.

Axes: y across the track, z up, m. With a lateral leg, y = 0 is its inner face and y > 0 lies towards the magnet; z = 0
is the top face of the lift leg. Conductors that share whole edges are in electrical contact; a gap insulates.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import ArrayLike

from maglev_ctrl.arrays import FloatArray, read_only
from maglev_ctrl.fields.polygon import BoolArray, cross, edge_distances, inside, point_distances, signed_area

COINCIDENT = 1e-9
"""Points nearer than this share of the section's size are one point: far above rounding, far below any real gap."""


@dataclass(frozen=True, eq=False, slots=True)
class Conductor:
    """One solid piece of metal of the guideway.

    Parameters
    ----------
    name : for messages and tables
    outline : (n, 2) vertices (y, z), m, closed implicitly; a clockwise outline is turned round
    conductivity : S/m

    Raises
    ------
    ValueError : fewer than three vertices, a vertex that is repeated or not finite, no area, an outline that crosses
        or touches itself, or a conductivity that is not positive and finite

    Examples
    --------
    >>> wedge = Conductor("wedge", [[0.0, 0.0], [0.0, 0.01], [0.03, 0.0]], 2.5e7)
    >>> wedge.outline.tolist(), round(wedge.area * 1e6, 6)     # mm^2
    ([[0.03, 0.0], [0.0, 0.01], [0.0, 0.0]], 150.0)
    """

    name: str
    outline: FloatArray
    conductivity: float

    def __post_init__(self) -> None:
        label = f"conductor '{self.name}'"
        outline = read_only(self.outline, name=f"{label}: outline", shape=(None, 2))
        if outline.ndim != 2 or len(outline) < 3:
            raise ValueError(f"{label}: an outline needs at least 3 vertices (y, z), got {len(outline)}")
        if not (np.isfinite(self.conductivity) and self.conductivity > 0.0):
            raise ValueError(f"{label}: expected a positive conductivity in S/m, got {self.conductivity}")
        _require_simple(outline, label)
        if signed_area(outline) < 0.0:
            outline = read_only(outline[::-1], name=label)
        object.__setattr__(self, "outline", outline)
        object.__setattr__(self, "conductivity", float(self.conductivity))

    @property
    def area(self) -> float:
        """Area of the metal, m^2."""
        return signed_area(self.outline)


@dataclass(frozen=True, eq=False, slots=True)
class CrossSection:
    """The guideway's conductors in the plane across the track.

    Outlines may share whole edges: the vertices of both must then coincide, and current flows across the edge. Vertices
    that differ by rounding only are made equal.

    Parameters
    ----------
    conductors : at least one

    Raises
    ------
    ValueError : no conductor, conductors that overlap, or that touch otherwise than along whole shared edges

    Examples
    --------
    >>> guideway = CrossSection.l_shape(leg=76.2e-3, thickness=6.35e-3, conductivity=2.5e7)
    >>> guideway.distance([[0.01, 0.02], [-1e-3, -1e-3]]).round(6).tolist()
    [0.01, -0.001414]
    """

    conductors: tuple[Conductor, ...]

    def __post_init__(self) -> None:
        conductors = tuple(self.conductors)
        if not conductors:
            raise ValueError("conductors: a cross-section needs at least one conductor")
        tolerance = COINCIDENT * _extent(np.concatenate([one.outline for one in conductors]))
        conductors = _with_common_vertices(conductors, tolerance)
        for first, second in combinations(conductors, 2):
            _require_apart(first, second, tolerance)
        object.__setattr__(self, "conductors", conductors)

    @classmethod
    def l_shape(cls, *, leg: float, thickness: float, conductivity: float, outside: bool = True) -> CrossSection:
        """An L: lateral leg at y in [-d, 0], lift leg at z in [-d, 0], electrically one piece.

        Parameters
        ----------
        leg : length of either leg, m; measured on the outside (inner faces leg - d), or on the inside
        thickness : d, m
        conductivity : S/m
        outside : how the leg is measured

        Raises
        ------
        ValueError : a length or conductivity that is not positive, or an outside leg no longer than the thickness
        """
        _require_lengths(leg=leg, thickness=thickness)
        if outside and leg <= thickness:
            raise ValueError(f"leg: an outside length must exceed the thickness {thickness} m, got {leg}")
        d, face = thickness, leg - thickness if outside else leg
        outline = [[-d, -d], [face, -d], [face, 0.0], [0.0, 0.0], [0.0, face], [-d, face]]
        return cls((Conductor("L", np.array(outline), conductivity),))

    @classmethod
    def plate(cls, *, width: float, thickness: float, conductivity: float, centre: float = 0.0) -> CrossSection:
        """A flat plate with its top face at z = 0.

        Parameters
        ----------
        width : across the track, m
        thickness : m
        conductivity : S/m
        centre : y of the middle, m

        Raises
        ------
        ValueError : a length or conductivity that is not positive
        """
        _require_lengths(width=width, thickness=thickness)
        left, right = centre - 0.5 * width, centre + 0.5 * width
        return cls((_rectangle("plate", (left, right, -thickness, 0.0), conductivity),))

    @classmethod
    def channel(cls, *, width: float, wall: float, thickness: float, conductivity: float) -> CrossSection:
        """A U, electrically one piece: inner faces y = 0 and y = width, top face of the floor z = 0.

        Parameters
        ----------
        width : between the inner faces of the walls, m
        wall : height of the walls above the floor, m
        thickness : of walls and floor, m
        conductivity : S/m

        Raises
        ------
        ValueError : a length or conductivity that is not positive
        """
        _require_lengths(width=width, wall=wall, thickness=thickness)
        d, w = thickness, width
        outer = [[-d, wall], [-d, -d], [w + d, -d], [w + d, wall]]
        inner = [[w, wall], [w, 0.0], [0.0, 0.0], [0.0, wall]]
        return cls((Conductor("channel", np.array(outer + inner), conductivity),))

    @classmethod
    def plates(
        cls, rectangles: Sequence[tuple[float, float, float, float]], *, conductivity: float | Sequence[float]
    ) -> CrossSection:
        """Several upright rectangles: a split sheet, or legs that are not joined.

        Parameters
        ----------
        rectangles : (left, right, bottom, top) of each, m
        conductivity : S/m, one for all or one each

        Raises
        ------
        ValueError : a rectangle that is not left < right and bottom < top, a wrong count of conductivities, or
            conductors that overlap

        Examples
        --------
        >>> split = CrossSection.plates([(0.0, 0.05, -2e-3, 0.0), (0.051, 0.1, -2e-3, 0.0)], conductivity=3.5e7)
        >>> [one.name for one in split.conductors]
        ['plate 1', 'plate 2']
        """
        values = np.asarray(conductivity, dtype=np.float64)
        if values.shape not in ((), (len(rectangles),)):
            raise ValueError(f"conductivity: expected one value or {len(rectangles)}, got shape {values.shape}")
        each = np.broadcast_to(values, (len(rectangles),)).tolist()
        return cls(
            tuple(_rectangle(f"plate {i + 1}", box, each[i]) for i, box in enumerate(rectangles)),
        )

    @property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Lowest and highest (y, z) of the metal, m."""
        corners = np.concatenate([one.outline for one in self.conductors])
        return corners.min(axis=0), corners.max(axis=0)

    @property
    def size(self) -> float:
        """The larger of width and height of the whole section, m."""
        low, high = self.bounds
        return float(np.max(high - low))

    def faces(self) -> tuple[FloatArray, FloatArray]:
        """Start and end (S, 2) of every edge between metal and air, m; edges that two conductors share are inside."""
        start, end, shared = self._edges()
        return start[~shared], end[~shared]

    def _edges(self) -> tuple[FloatArray, FloatArray, BoolArray]:
        start = np.concatenate([one.outline for one in self.conductors])
        end = np.concatenate([np.roll(one.outline, -1, axis=0) for one in self.conductors])
        shared = np.asarray((_same(start, end) & _same(end, start)).any(axis=1))
        return start, end, shared

    def contains(self, points: ArrayLike) -> BoolArray:
        """Which points (..., 2) lie in metal; on a face either answer."""
        at = read_only(points, name="points", shape=(2,))
        flat = at.reshape(-1, 2)
        within = np.zeros(len(flat), dtype=bool)
        for one in self.conductors:
            within |= inside(flat, one.outline)
        # The common edge of two conductors in contact is metal, whichever way the rounding falls.
        start, end, shared = self._edges()
        if shared.any():
            away = point_distances(flat, start[shared], end[shared])
            within |= np.min(away, axis=1) <= COINCIDENT * self.size
        return within.reshape(at.shape[:-1])

    def distance(self, points: ArrayLike) -> FloatArray:
        """Distance of points (..., 2) to the nearest face, m; negative inside metal."""
        at = read_only(points, name="points", shape=(2,))
        away = np.min(point_distances(at.reshape(-1, 2), *self.faces()), axis=1).reshape(at.shape[:-1])
        return np.asarray(np.where(self.contains(at), -away, away))

    def clearance(self, start: ArrayLike, end: ArrayLike) -> FloatArray:
        """Distance of straight pieces from start to end, both (..., 2), to the nearest metal, m; zero where they meet.

        Examples
        --------
        >>> sheet = CrossSection.plate(width=0.1, thickness=2e-3, conductivity=3.5e7)
        >>> sheet.clearance([-0.01, 5e-3], [[0.01, 5e-3], [0.01, -5e-3]]).round(6).tolist()
        [0.005, 0.0]
        """
        a, b = np.broadcast_arrays(read_only(start, name="start", shape=(2,)), read_only(end, name="end", shape=(2,)))
        away = np.min(edge_distances(a.reshape(-1, 2), b.reshape(-1, 2), *self.faces()), axis=1)
        return np.asarray(np.where(self.contains(a), 0.0, away.reshape(a.shape[:-1])))

    def require_clear(self, start: ArrayLike, end: ArrayLike, *, margin: float = 0.0, name: str = "coil") -> None:
        """Refuse straight pieces from start (..., 2) to end (..., 2), m, that come within `margin` of metal.

        Raises
        ------
        ValueError : a piece meets metal, or comes nearer than the margin

        Examples
        --------
        >>> sheet = CrossSection.plate(width=0.1, thickness=2e-3, conductivity=3.5e7)
        >>> sheet.require_clear([-0.01, 5e-3], [0.01, -5e-3])
        Traceback (most recent call last):
        ValueError: coil: the piece from (-0.01, 0.005) to (0.01, -0.005) m meets the guideway's metal
        """
        away = self.clearance(start, end)
        worst = int(np.argmin(away))
        nearest = float(away.reshape(-1)[worst])
        if nearest > margin:
            return
        a, b = (np.broadcast_to(np.asarray(p, dtype=np.float64), (*away.shape, 2)) for p in (start, end))
        (y0, z0), (y1, z1) = a.reshape(-1, 2)[worst].tolist(), b.reshape(-1, 2)[worst].tolist()
        what = "meets the guideway's metal"
        if nearest > 0.0:
            what = f"comes within {nearest:g} m of the guideway's metal; at least {margin:g} m is needed"
        raise ValueError(f"{name}: the piece from ({y0:g}, {z0:g}) to ({y1:g}, {z1:g}) m {what}")

    def digest(self) -> str:
        """Hash of outlines (to 1e-12 m) and conductivities (to 12 digits); names and first vertices do not matter.

        Examples
        --------
        >>> a = CrossSection.plate(width=0.1, thickness=2e-3, conductivity=3.5e7)
        >>> a.digest() == CrossSection.plate(width=0.1, thickness=2e-3 * (1 + 1e-15), conductivity=3.5e7).digest()
        True
        """
        text = hashlib.sha256()
        for one in self.conductors:
            # Whole picometres: no negative zeros, the same bytes on every machine.
            corners = np.rint(one.outline * 1e12).astype("<i8")
            first = int(np.lexsort((corners[:, 1], corners[:, 0]))[0])
            text.update(f"{len(corners)} {one.conductivity:.11e} ".encode())
            text.update(np.roll(corners, -first, axis=0).tobytes())
        return text.hexdigest()


def _rectangle(name: str, box: tuple[float, float, float, float], conductivity: float) -> Conductor:
    left, right, bottom, top = (float(side) for side in box)
    if not (left < right and bottom < top):
        raise ValueError(f"{name}: expected left < right and bottom < top, got {(left, right, bottom, top)}")
    return Conductor(name, np.array([[left, bottom], [right, bottom], [right, top], [left, top]]), conductivity)


def _require_lengths(**lengths: float) -> None:
    for name, value in lengths.items():
        if not (np.isfinite(value) and value > 0.0):
            raise ValueError(f"{name}: expected a positive length in m, got {value}")


def _extent(corners: FloatArray) -> float:
    return float(np.max(np.ptp(corners, axis=0)))


def _require_simple(outline: FloatArray, label: str) -> None:
    """Refuse repeated vertices, no area, and edges that cross or touch; edge i runs from vertex i to the next."""
    count, tolerance = len(outline), COINCIDENT * _extent(outline)
    gaps = np.hypot(*(outline[:, None] - outline).transpose(2, 0, 1))
    i, j = np.nonzero(np.triu(gaps <= tolerance, 1))
    if i.size:
        raise ValueError(f"{label}: vertices {i[0] + 1} and {j[0] + 1} of the outline are the same point")
    # Thickness of the thinnest strip that holds every vertex, from the vertices' second moments.
    if np.linalg.svd(outline - outline.mean(axis=0), compute_uv=False)[-1] <= tolerance * np.sqrt(count):
        raise ValueError(f"{label}: the outline has no thickness; all its vertices lie on one line")
    start, end = outline, np.roll(outline, -1, axis=0)
    # An edge that folds back onto its neighbour also touches an edge that is not its neighbour.
    meets = edge_distances(start, end, start, end) <= tolerance
    order = np.arange(count)
    apart = (order[:, None] - order) % count
    crossing = np.triu(meets & (apart > 1) & (apart < count - 1), 1)
    if crossing.any():
        i, j = np.nonzero(crossing)
        raise ValueError(f"{label}: edges {i[0] + 1} and {j[0] + 1} of the outline cross or touch")


def _with_common_vertices(conductors: tuple[Conductor, ...], tolerance: float) -> tuple[Conductor, ...]:
    """Vertices within the tolerance of an earlier conductor's are moved onto it, so that shared edges match exactly."""
    known = conductors[0].outline
    result = [conductors[0]]
    for one in conductors[1:]:
        gap = np.hypot(*(one.outline[:, None] - known).transpose(2, 0, 1))
        nearest = np.argmin(gap, axis=1)
        snapped = np.where((np.min(gap, axis=1) <= tolerance)[:, None], known[nearest], one.outline)
        result.append(replace(one, outline=snapped))
        known = np.concatenate([known, snapped])
    return tuple(result)


def _require_apart(first: Conductor, second: Conductor, tolerance: float) -> None:
    """Refuse two conductors that overlap, or that touch otherwise than along whole shared edges."""
    pair = f"conductors '{first.name}' and '{second.name}'"
    a, b = first.outline, second.outline
    a_end, b_end = np.roll(a, -1, axis=0), np.roll(b, -1, axis=0)
    shared = _same(a, b_end) & _same(a_end, b)
    touch = (edge_distances(a, a_end, b, b_end) <= tolerance) & ~shared
    ends = ((point_distances(p, b, b_end) <= tolerance).T for p in (a, a_end))
    other_ends = (point_distances(p, a, a_end) <= tolerance for p in (b, b_end))
    at_an_end = np.any([*(one.T for one in ends), *(one.T for one in other_ends)], axis=0)
    # With no edges crossing, an edge that is not shared lies wholly inside the other conductor or wholly outside it.
    swallowed = (
        inside(0.5 * (a + a_end)[~shared.any(axis=1)], b).any()
        or inside(0.5 * (b + b_end)[~shared.any(axis=0)], a).any()
    )
    if (touch & ~at_an_end).any() or (_same(a, b) & _same(a_end, b_end)).any() or (swallowed and not touch.any()):
        raise ValueError(f"{pair} overlap")
    # Edges beside a shared one may meet at its end, but only there.
    hinges = np.concatenate([a[shared.any(axis=1)], a_end[shared.any(axis=1)]])
    stray = touch.copy()
    for i, j in zip(*np.nonzero(touch), strict=True):
        for p, p_far in ((a[i], a_end[i]), (a_end[i], a[i])):
            for q, q_far in ((b[j], b_end[j]), (b_end[j], b[j])):
                if np.array_equal(p, q) and np.any(np.all(hinges == p, axis=1)):
                    u, v = p_far - p, q_far - q
                    along = abs(float(cross(u, v))) <= COINCIDENT * float(np.hypot(*u) * np.hypot(*v)) and u @ v > 0.0
                    stray[i, j] = along
    if stray.any():
        i, j = (int(k[0]) + 1 for k in np.nonzero(stray))
        raise ValueError(
            f"{pair} touch or overlap at edge {i} of the first and edge {j} of the second: conductors in contact must "
            "share whole edges, vertex on vertex, and separate ones need a gap"
        )
    if swallowed:
        raise ValueError(f"{pair} overlap")


def _same(p: FloatArray, q: FloatArray) -> BoolArray:
    """Which of the points p (n, 2) equals which of q (m, 2): (n, m)."""
    return np.asarray(np.all(p[:, None] == q, axis=-1))
