"""Pixels of a map computed only where they matter: cells of one state are filled in unless a resonance may hide there.

A tongue begins where two multipliers meet on the unit circle, or one meets its own conjugate at +1 or -1. Beside a
tongue the two exponents s, s' make (s - s')^2 smooth, with its apex at the tongue's centre, so the multipliers at the
corners of a cell tell how much growth the cell can hide: the phase that the modes turn through across the cell bounds
how far the apex lies above the corners.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maglev_ctrl.analysis.plane_pixels import Corners, PanelPixels, Pixels, lattice, spread
from maglev_ctrl.analysis.plane_records import NO_ANSWER, STABLE
from maglev_ctrl.analysis.resonance import resonant_pairs
from maglev_ctrl.arrays import ComplexArray, FloatArray

_STRIDE = 8  # pixels between computed points before any cell is divided
_ORDER = 4  # resonances (w_i +- w_j)/k of the mean system up to this k
_MARGIN = 1.5  # the modulation shifts frequencies, so that phases change faster than those of the mean system
_COARSE_PHASE = 0.8  # rad: a cell across which a mode turns further is always divided
_REAL = 1e-9  # imaginary part over modulus below which a multiplier counts as real

Indices = NDArray[np.intp]


@dataclass(frozen=True, eq=False, slots=True)
class CellRows:
    """Rows of a panel: growth and its error bound (1/s, NaN where filled in), state, which pixels were filled in, and
    how many were computed."""

    growth: FloatArray
    error: FloatArray
    state: NDArray[np.int8]
    interpolated: NDArray[np.bool_]
    evaluated: int


def adaptive_rows(
    pixels: PanelPixels, first: int, last: int, *, strength: FloatArray
) -> CellRows:  # fmt: skip
    """The rows first..last of a panel by cells.

    Parameters
    ----------
    strength : (columns,) what the modulation can add to a growth rate at most, 1/s
    """
    strip = _Strip(pixels, first, last)
    rows, columns = lattice(last - first, _STRIDE), lattice(pixels.columns, _STRIDE)
    strip.compute(*(grid.ravel() for grid in np.meshgrid(rows, columns, indexing="ij")))
    strip.note_conditions(rows, columns)
    cells = _cells(rows, columns)
    leaves: list[Indices] = []
    while len(cells):
        divisible = (cells[:, 1] - cells[:, 0] > 1) | (cells[:, 3] - cells[:, 2] > 1)
        leaves.append(cells[~divisible])
        cells = cells[divisible]
        divide = np.zeros(len(cells), dtype=np.bool_)
        for begin in range(0, len(cells), 1024):
            divide[begin : begin + 1024] = strip.to_divide(cells[begin : begin + 1024], strength)
        leaves.append(cells[~divide])
        cells = _divided(cells[divide])
        # cells of single pixels are not divided again: only their growth is wanted
        single = np.maximum(cells[:, 1] - cells[:, 0], cells[:, 3] - cells[:, 2]) <= 1
        corners = _corners(cells)
        strip.compute(corners[~single, :, 0].ravel(), corners[~single, :, 1].ravel())
        strip.judge(corners[single, :, 0].ravel(), corners[single, :, 1].ravel())
    strip.fill(np.concatenate(leaves) if leaves else np.empty((0, 4), dtype=np.intp))
    return CellRows(strip.growth, strip.error, strip.state, ~strip.known, int(np.count_nonzero(strip.known)))


class _Strip:
    """What is known of some rows of a panel."""

    def __init__(self, pixels: PanelPixels, first: int, last: int) -> None:
        self._pixels, self._first = pixels, first
        shape = last - first, pixels.columns
        self.growth, self.error = np.full(shape, np.nan), np.full(shape, np.nan)
        self.state = np.full(shape, NO_ANSWER, dtype=np.int8)
        self.known = np.zeros(shape, dtype=np.bool_)
        self._place = np.full(shape, -1, dtype=np.intp)
        self._condition = np.ones(shape)
        self._multipliers: list[ComplexArray] = []
        self._mean: list[ComplexArray] = []
        self._period: list[FloatArray] = []
        self._joined: tuple[ComplexArray, ComplexArray, FloatArray] | None = None
        self._count = 0

    def compute(self, i: Indices, j: Indices) -> None:
        """Compute those of the pixels (i, j) whose multipliers are not known yet."""
        rows, columns = self._missing(i, j, self._place >= 0)
        if not len(rows):
            return
        corners: Corners = self._pixels.pixels(self._first + rows, columns)
        self._keep(rows, columns, corners.found)
        self._place[rows, columns] = self._count + np.arange(len(rows))
        self._count += len(rows)
        self._multipliers.append(corners.multipliers)
        self._mean.append(corners.mean)
        self._period.append(corners.period)
        self._joined = None

    def judge(self, i: Indices, j: Indices) -> None:
        """Growth and state alone of those of the pixels (i, j) that are not known yet."""
        rows, columns = self._missing(i, j, self.known)
        if len(rows):
            found = self._pixels.verdicts(self._first + rows, columns, self._condition[rows, columns])
            self._keep(rows, columns, found)

    def note_conditions(self, rows: Indices, columns: Indices) -> None:
        """Spread the conditions at the points computed first over the pixels between them."""
        i, j = np.meshgrid(rows, columns, indexing="ij")
        period = np.concatenate(self._period)[self._place[i, j]]
        found = Pixels(self.growth[i, j], self.error[i, j], self.state[i, j])
        condition = self._pixels.conditions_of(found, period)
        self._condition = spread(condition, rows, columns, self.known.shape)

    def _missing(self, i: Indices, j: Indices, known: NDArray[np.bool_]) -> tuple[Indices, Indices]:
        """Those of the pixels that are not known yet, each once."""
        wanted = np.unique(i * self.known.shape[1] + j)
        wanted = wanted[~known.ravel()[wanted]]
        return np.divmod(wanted, self.known.shape[1])

    def _keep(self, rows: Indices, columns: Indices, found: Pixels) -> None:
        self.growth[rows, columns] = found.growth
        self.error[rows, columns] = found.error
        self.state[rows, columns] = found.state
        self.known[rows, columns] = True

    def to_divide(self, cells: Indices, strength: FloatArray) -> NDArray[np.bool_]:
        """Cells whose corners differ in state, are near a change of state, or between which a resonance may hide."""
        if not len(cells):
            return np.zeros(0, dtype=np.bool_)
        i, j = (_corners(cells)[..., k] for k in (0, 1))
        state, growth = self.state[i, j], self.growth[i, j]
        low, high = np.min(growth, axis=1), np.max(growth, axis=1)
        reach = high - low
        divide = np.any(state != state[:, :1], axis=1) | ((high + reach >= 0.0) & (low - reach <= 0.0))
        if self._joined is None:
            self._joined = tuple(np.concatenate(a) for a in (self._multipliers, self._mean, self._period))  # type: ignore[assignment]
        multipliers, mean, period = (a[self._place[i, j]] for a in self._joined)  # type: ignore[union-attr]
        quiet = ~divide & (state[:, 0] == STABLE)
        if np.any(quiet):
            within = np.max(strength[j[quiet]], axis=1)
            hidden = hiding(multipliers[quiet], mean[quiet], period[quiet], within)
            divide[quiet] = hidden
        return np.asarray(divide)

    def fill(self, leaves: Indices) -> None:
        """Interpolate the pixels inside the cells that were not divided."""
        size = np.stack([leaves[:, 1] - leaves[:, 0], leaves[:, 3] - leaves[:, 2]], axis=1)
        for height, width in np.unique(size, axis=0):
            here = leaves[(size[:, 0] == height) & (size[:, 1] == width)]
            down, across = np.arange(height + 1), np.arange(width + 1)
            i = here[:, 0, None, None] + down[None, :, None] + 0 * across
            j = here[:, 2, None, None] + across[None, None, :] + 0 * down[:, None]
            u = (down / max(height, 1))[None, :, None]
            v = (across / max(width, 1))[None, None, :]
            at = _corners(here)
            growth = self.growth[at[..., 0], at[..., 1]]
            corner = growth[:, :, None, None]
            mixed = (1 - u) * ((1 - v) * corner[:, 0] + v * corner[:, 1]) + u * (
                (1 - v) * corner[:, 2] + v * corner[:, 3]
            )
            open_ = ~self.known[i, j]
            i, j = i[open_], j[open_]
            self.growth[i, j] = mixed[open_]
            same = self.state[here[:, 0], here[:, 2]]
            self.state[i, j] = np.broadcast_to(same[:, None, None], open_.shape)[open_]


def hiding(
    multipliers: ComplexArray, mean: ComplexArray, period: FloatArray, strength: FloatArray
) -> NDArray[np.bool_]:
    """Whether an unstable spot may hide between four stable corners; (cells,).

    Parameters
    ----------
    multipliers, mean : (cells, 4, n) at the corners, the second ones eigenvalues of the mean system in 1/s
    period : (cells, 4) s
    strength : (cells,) what the modulation can add to a growth rate at most, 1/s
    """
    phases = np.sort(np.abs(mean.imag) * period[..., None], axis=2)
    turned = np.max(np.ptp(phases, axis=1), axis=1)
    return np.asarray(
        (turned > _COARSE_PHASE)
        | _meeting(multipliers, mean, period, _MARGIN * turned, strength)
        | _crossed(mean, period, strength)
    )


def _meeting(
    multipliers: ComplexArray, mean: ComplexArray, period: FloatArray, turned: FloatArray, strength: FloatArray
) -> NDArray[np.bool_]:
    """Cells where two multipliers, or one and its conjugate, may meet and grow beyond the unit circle."""
    size = np.log(np.maximum(np.abs(multipliers), 1e-300))
    angle = np.abs(np.angle(multipliers))
    upper = multipliers.imag >= -_REAL * np.abs(multipliers)
    active = upper & (size + (strength[:, None] * period)[..., None] > 0.0)
    # real multipliers of overdamped modes stay on the axis: one positive real multiplier per real mean eigenvalue
    lasting = np.sum(np.abs(mean.imag) <= _REAL * np.abs(mean), axis=2)
    real = angle <= _REAL
    rank = np.cumsum(real[..., ::-1], axis=2)[..., ::-1]
    active &= ~(real & (rank <= lasting[..., None]))
    ranked = np.where(active, angle, np.nan)
    order = np.argsort(ranked, axis=2)  # NaN last
    sorted_angle = np.take_along_axis(ranked, order, axis=2)
    sorted_size = np.take_along_axis(np.where(active, size, np.nan), order, axis=2)
    count = np.sum(active, axis=2)
    uneven = np.any(count != count[:, :1], axis=1)
    with np.errstate(invalid="ignore"):
        change = np.nanmax(np.ptp(sorted_angle, axis=1), axis=1, initial=0.0)
        across = np.maximum(turned, np.where(np.isfinite(change), np.minimum(change, 0.5), 0.0))[:, None]
        # with one another: angle apart, sizes split
        apart = np.diff(sorted_angle, axis=2)
        split = np.diff(sorted_size, axis=2)
        middle = 0.5 * (sorted_size[..., 1:] + sorted_size[..., :-1])
        pair = _can_grow(split**2 - apart**2, middle, across)
        # with its own conjugate at +1 or -1; the angle between the two is twice that to the axis
        alone = np.zeros(len(multipliers), dtype=np.bool_)
        for distance in (sorted_angle, np.pi - sorted_angle):
            alone |= np.any(_can_grow(-((2.0 * distance) ** 2), sorted_size, across), axis=1)
    return np.asarray(uneven | np.any(pair, axis=1) | alone)


def _can_grow(square: FloatArray, middle: FloatArray, turned: FloatArray) -> NDArray[np.bool_]:
    """Whether the apex of (s - s')^2 between the corners may lift the larger exponent above zero."""
    apex = np.max(square, axis=1) + turned**2
    lifted = np.max(middle, axis=1) + 0.5 * np.sqrt(np.maximum(apex, 0.0))
    return np.asarray((lifted > 0.0) & (apex > 0.0))


def _crossed(mean: ComplexArray, period: FloatArray, strength: FloatArray) -> NDArray[np.bool_]:
    """Cells that a line (w_i +- w_j)/k = W of the mean system crosses, unless damping outweighs the modulation."""
    w = np.where(mean.imag > _REAL * np.abs(mean), mean.imag, np.nan)
    order = np.argsort(w, axis=2)
    w = np.take_along_axis(w, order, axis=2)
    real = np.take_along_axis(mean.real, order, axis=2)
    counts = np.sum(np.isfinite(w), axis=2)
    uneven = np.any(counts != counts[:, :1], axis=1)
    most = int(np.max(counts, initial=0))
    found = uneven.copy()
    for kind, i, j in resonant_pairs(most):
        sign = -1.0 if kind == "difference" else 1.0
        turns = np.abs(w[..., j] + sign * w[..., i]) * period / (2.0 * np.pi)
        low, high = np.min(turns, axis=1), np.max(turns, axis=1)
        nearest = np.ceil(low)
        alive = np.max(real[..., i] + real[..., j], axis=1) * 0.5 + strength > 0.0
        found |= (nearest <= high) & (nearest >= 1.0) & (nearest <= _ORDER) & alive
    return np.asarray(found)


def _cells(rows: Indices, columns: Indices) -> Indices:
    """Cells (first row, last row, first column, last column) between lattice lines, ends included."""
    if len(rows) == 1:
        rows = np.repeat(rows, 2)
    if len(columns) == 1:
        columns = np.repeat(columns, 2)
    top, left = np.meshgrid(rows[:-1], columns[:-1], indexing="ij")
    bottom, right = np.meshgrid(rows[1:], columns[1:], indexing="ij")
    return np.stack([top.ravel(), bottom.ravel(), left.ravel(), right.ravel()], axis=1)


def _divided(cells: Indices) -> Indices:
    """Four smaller cells for each (two where it is one pixel wide)."""
    top, bottom, left, right = cells.T
    middle, centre = (top + bottom) // 2, (left + right) // 2
    tall, wide = bottom - top > 1, right - left > 1
    parts = [
        np.stack([top, np.where(tall, middle, bottom), left, np.where(wide, centre, right)], axis=1),
        np.stack([middle, bottom, left, np.where(wide, centre, right)], axis=1)[tall],
        np.stack([top, np.where(tall, middle, bottom), centre, right], axis=1)[wide],
        np.stack([middle, bottom, centre, right], axis=1)[tall & wide],
    ]
    return np.concatenate(parts)


def _corners(cells: Indices) -> Indices:
    """(cells, 4, 2): row and column of the corners, row by row."""
    top, bottom, left, right = cells.T
    rows = np.stack([top, top, bottom, bottom], axis=1)
    columns = np.stack([left, right, left, right], axis=1)
    return np.stack([rows, columns], axis=2)
