"""A stability plane as a picture of bounded size in which nothing unstable is lost, and what is read off it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from maglev_ctrl.analysis.plane_records import NO_ANSWER, STABLE, UNRESOLVED, UNSTABLE, StabilityPlane
from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.report.charts_periodic import short_words
from maglev_ctrl.report.labels import Anchor
from maglev_ctrl.report.raster import even_cells, worst_members

MOST_COLUMNS: Final = 480  # as many as a printed figure can show
MOST_ROWS: Final = 320
# Worst first: what is unstable shows in a cell whatever else it stands for, and nothing undecided hides behind stable.
_RANK: Final = {STABLE: 0, NO_ANSWER: 1, UNRESOLVED: 2, UNSTABLE: 3}
_NEAR: Final = 0.12  # of the picture: pieces of one tongue nearer than this share a name


@dataclass(frozen=True, eq=False, slots=True)
class Picture:
    """Even cells over `x` (nx,) and `y` (ny,) in display units; `state`, `growth` (1/s), `tongue` are (ny, nx).

    `gathered`: whether cells stand for several points; each then shows its worst one.
    """

    x: FloatArray
    y: FloatArray
    state: NDArray[np.int8]
    growth: FloatArray
    tongue: NDArray[np.int16]
    gathered: bool

    def where(self, state: int) -> NDArray[np.bool_]:
        """The cells in a state."""
        return np.asarray(self.state == state)


def picture(
    plane: StabilityPlane, *, scale: tuple[float, float] = (1.0, 1.0), most: tuple[int, int] = (MOST_COLUMNS, MOST_ROWS)
) -> Picture:
    """The plane on at most `most` even cells, each as its worst point is: unstable before unresolved before no answer
    before stable, and of equal ones the one that grows fastest.

    Parameters
    ----------
    scale : display value over SI value of x and y
    """
    x, columns = even_cells(plane.x.values, most=most[0])
    y, rows = even_cells(plane.y.values, most=most[1])
    chosen = worst_members(_priority(plane), columns, rows)
    return Picture(
        x=x * scale[0], y=y * scale[1], state=plane.state.ravel()[chosen], growth=plane.growth.ravel()[chosen],
        tongue=plane.tongue_index.ravel()[chosen],
        gathered=any(len(one) > 1 for one in (*columns, *rows)),
    )  # fmt: skip


def _priority(plane: StabilityPlane) -> FloatArray:
    """How bad every point is: whole numbers by its state, what lies between by its growth."""
    bad = np.zeros(plane.state.shape)
    for value, rank in _RANK.items():
        bad[plane.state == value] = rank
    known = np.isfinite(plane.growth)
    if known.any():
        low, high = float(plane.growth[known].min()), float(plane.growth[known].max())
        bad[known] += 0.1 + 0.8 * (plane.growth[known] - low) / ((high - low) or 1.0)
    return bad


def boundary(shown: Picture) -> tuple[FloatArray, FloatArray]:
    """The line between stable and unstable as one curve with NaN between its pieces.

    It stands where the growth rate is zero between neighbouring cells, on the side their states say.
    """
    from contourpy import contour_generator

    if min(shown.growth.shape) < 2:
        return np.zeros(0), np.zeros(0)
    known = np.abs(shown.growth[np.isfinite(shown.growth)])
    least = 1e-3 * (float(np.max(known)) if known.size else 1.0) or 1.0
    growth = np.where(np.isnan(shown.growth), 0.0, shown.growth)
    signed = np.where(shown.where(UNSTABLE), np.maximum(growth, least), np.minimum(growth, -least))
    undecided = shown.where(UNRESOLVED) | shown.where(NO_ANSWER)
    lines = contour_generator(shown.x, shown.y, np.ma.masked_array(signed, undecided), corner_mask=True).lines(0.0)
    pieces = [np.vstack([np.asarray(line), [[np.nan, np.nan]]]) for line in lines]
    curve = np.concatenate(pieces) if pieces else np.zeros((0, 2))
    return curve[:, 0], curve[:, 1]


def region_anchors(shown: Picture, plane: StabilityPlane) -> list[Anchor]:
    """One name per connected unstable region, the largest regions first, each at its inmost point or its lowest.

    Pieces of one tongue that a grid has cut apart are named once where they lie close together.
    """
    from scipy import ndimage

    found: list[tuple[int, tuple[int, int], tuple[int, int], str]] = []
    for index in (int(i) for i in np.unique(shown.tongue[shown.where(UNSTABLE)])):
        text = "unnamed" if index < 0 else region_words(plane.tongues[index].name)
        mask = shown.where(UNSTABLE) & (shown.tongue == index)
        parts, _ = ndimage.label(mask, structure=np.ones((3, 3)))
        for k, window in enumerate(ndimage.find_objects(parts), start=1):
            own = np.pad(parts[window] == k, 1)
            row, column = np.unravel_index(int(np.argmax(ndimage.distance_transform_cdt(own))), own.shape)
            lowest = np.flatnonzero(own[1])  # the first row that holds cells: the tip of a tongue over depth
            tip = window[0].start, window[1].start - 1 + int(lowest[len(lowest) // 2])
            inmost = int(row) - 1 + window[0].start, int(column) - 1 + window[1].start
            found.append((int(own.sum()), inmost, tip, text))
    rows, columns = shown.state.shape
    kept: list[tuple[tuple[int, int], tuple[int, int], str]] = []
    for _, (r, c), tip, text in sorted(found, key=lambda one: (-one[0], one[3], one[1])):
        if not any(
            text == other and abs(r - s) < _NEAR * rows and abs(c - d) < _NEAR * columns for (s, d), _, other in kept
        ):
            kept.append(((r, c), tip, text))
    return [
        Anchor(float(shown.x[c]), float(shown.y[r]), text, (float(shown.x[tip[1]]), float(shown.y[tip[0]])))
        for (r, c), tip, text in kept
    ]


def small_parts(shown: Picture, mask: NDArray[np.bool_], *, least: float, most: int) -> tuple[FloatArray, FloatArray]:
    """Middles x, y of the connected parts of a mask that are smaller than a share of the picture, `most` at most."""
    from scipy import ndimage

    parts, count = ndimage.label(mask, structure=np.ones((3, 3)))
    sizes = np.bincount(parts.ravel(), minlength=count + 1)[1:]
    small = 1 + np.flatnonzero(sizes < least * mask.size)
    if not small.size:
        return np.zeros(0), np.zeros(0)
    chosen = small[np.unique(np.linspace(0, small.size - 1, min(most, small.size)).astype(int))]
    middles = np.array(ndimage.center_of_mass(mask, parts, chosen))
    at = np.rint(middles).astype(int)
    return shown.x[at[:, 1]], shown.y[at[:, 0]]


def region_words(name: str) -> str:
    """The short name of a region as the map shows it; "none" where no resonance is behind it.

    Examples
    --------
    >>> region_words("(w1 + w2)/1 (heave, pitch)"), region_words("none")
    ('w1 + w2', 'none')
    """
    return "none" if name in ("none", "") else short_words(name)
