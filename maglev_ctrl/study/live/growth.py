"""Growth rates over speed and depth, fast: a short series of the monodromy matrix, spectral radii by squaring.

Every eighth row of depths is computed at every speed; between two rows only what may hold an edge of a tongue. What
is computed is good to about 1e-5 of a growth per period, and what is nearer to zero stays undecided. The growth in
between, where both rows have the same state far from zero, is interpolated: off by up to a tenth per period.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from maglev_ctrl.analysis.plane_pixels import judge, lattice
from maglev_ctrl.analysis.plane_records import NO_ANSWER, STABLE, UNRESOLVED, UNSTABLE
from maglev_ctrl.arrays import FloatArray, read_only_any
from maglev_ctrl.kernels import balance, rescale
from maglev_ctrl.kernels.plane_series import Direction, PlaneSeries, plane_series, tails
from maglev_ctrl.kernels.taylor_many import monodromy_many

SERIES = 1e-7
"""Tail of a series of the monodromy matrix, relative to its largest coefficient."""
SQUARINGS = 18
"""The modulus is known to the condition of its eigenvector to the power 1 / 2^18."""
STRIDE = 8
"""Rows of depth from one that is computed throughout to the next."""
_BEYOND = 3  # pixels on either side of an edge that are computed as well
_MOST = 45  # speeds at which the matrix is integrated for one panel; where it takes more the panel is halved
_LEAST = 12  # speeds of a panel that is not halved any more but integrated at every speed
_DEPTHS = (7, 9, 13, 25, 49)
_BESIDE = 10  # terms of a series in speed beside the phase that the fastest mode turns through
_CONDITION = 30.0  # of a leading multiplier, assumed
_AT_ONCE = 3  # squarings between two norms that are taken out: a power of eight leaves no range of numbers
_NEUTRAL = 1e-6  # growth of the mean system, times the period, below which a point counts as undamped
_NOISE = 1e-7  # growth per period that rounding can feign at the edge of an undamped tongue
_TRUNCATION = 1e-8  # per segment of the period
_CHUNK = 1 << 16  # matrix entries squared at once, so that they stay in the cache
_THREADS = 2


@dataclass(frozen=True, eq=False, slots=True)
class Columns:
    """What a map is computed of at speeds (V,): `mean` (V, m, m), `cosine` and `sine` (V, H, m, m) at unit depth, 1/s,
    `frequency` (V,) rad/s. NaN where there is no equilibrium."""

    mean: FloatArray
    cosine: FloatArray
    sine: FloatArray
    frequency: FloatArray


@dataclass(frozen=True, eq=False, slots=True)
class GrowthPlane:
    """`growth` (V, E) 1/s and `state` (V, E) over speeds and depths; `evaluated` points were computed."""

    growth: FloatArray
    state: NDArray[np.int8]
    evaluated: int


@dataclass(frozen=True, eq=False, slots=True)
class Sizes:
    """How many speeds and depths the last map took, by the range of speeds: where the next one begins."""

    known: dict[tuple[int, int], tuple[int, int]] = field(default_factory=dict)


Source = Callable[[FloatArray], Columns]


def growth_plane(
    source: Source, speed: FloatArray, depth: FloatArray, *, smooth: bool = True, sizes: Sizes | None = None
) -> GrowthPlane:  # fmt: skip
    """Growth rates at every pair of speeds (V,), ascending and positive, and depths (E,), ascending.

    Parameters
    ----------
    source : the systems at speeds
    smooth : whether they are smooth in speed; otherwise they are integrated at every speed
    sizes : kept between maps that are alike

    Examples
    --------
    >>> def mathieu(v):
    ...     A, B = np.array([[0.0, 1.0], [-1.0, -0.02]]), np.array([[[0.0, 0.0], [-1.0, 0.0]]])
    ...     return Columns(np.array([A] * len(v)), np.array([B] * len(v)), np.array([0 * B] * len(v)), v)
    >>> found = growth_plane(mathieu, np.linspace(1.5, 2.5, 21), np.linspace(0.0, 0.2, 7))
    >>> found.state[10].tolist()
    [-1, -1, 1, 1, 1, 1, 1]
    """
    shape = len(speed), len(depth)
    growth, state = np.full(shape, np.nan), np.full(shape, NO_ANSWER, dtype=np.int8)
    evaluated = 0
    for first, last, panel in _panels(source, speed, depth, smooth, sizes or Sizes()):
        pixels = _Pixels(panel, depth)
        pixels.fill()
        growth[first:last], state[first:last] = pixels.growth, pixels.state
        evaluated += pixels.evaluated
    return GrowthPlane(read_only_any(growth), read_only_any(state), evaluated)


@dataclass(frozen=True, eq=False, slots=True)
class _Panel:
    """Monodromy matrices at speeds (V,) as series in depth: `rows` (V, terms, m, m), `basis` (E, terms); `error` of a
    matrix, `period` (V,) s, `mean` (V, m, m)."""

    rows: FloatArray
    basis: FloatArray
    error: float
    period: FloatArray
    mean: FloatArray


def _panels(
    source: Source, speed: FloatArray, depth: FloatArray, smooth: bool, sizes: Sizes
) -> Iterator[tuple[int, int, _Panel]]:
    """Ranges of speeds with their series; a range whose series does not fall is halved in 1/speed."""
    y = Direction(float(depth[0]), float(depth[-1]))
    waiting = [(0, len(speed))]
    while waiting:
        first, last = waiting.pop()
        part = speed[first:last]
        if not smooth or len(part) <= _LEAST:
            yield first, last, _each(source, part, depth, y)
            continue
        x = Direction(float(part[0]), float(part[-1]), reciprocal=True)
        series, scale = _series(source, x, y, sizes, (first, last))
        if series is None:
            middle = 2.0 / (1.0 / part[0] + 1.0 / part[-1])
            cut = first + int(np.clip(np.searchsorted(part, middle), 1, len(part) - 1))
            waiting += [(cut, last), (first, cut)]
            continue
        here = source(part)
        yield first, last, _Panel(
            series.rows(part), series.y_basis(depth), series.error, 2.0 * np.pi / here.frequency,
            rescale(here.mean, scale),
        )  # fmt: skip


def _series(
    source: Source, x: Direction, y: Direction, sizes: Sizes, key: tuple[int, int]
) -> tuple[PlaneSeries | None, FloatArray]:
    """The monodromy matrix over a range of speeds and all depths, and the scale of its coordinates; None: too long."""
    ends = source(np.array([x.lower, x.upper]))
    scale = _scale(ends, y.upper)
    if not np.all(np.isfinite(ends.mean)):
        return None, scale
    phase = 2.0 * np.pi / ends.frequency * np.max(np.abs(np.linalg.eigvals(ends.mean).imag), axis=1)
    guess = int(0.5 * abs(phase[1] - phase[0])) + _BESIDE, _DEPTHS[0]
    across, along = sizes.known.get(key, guess)
    while across <= _MOST and along <= _DEPTHS[-1]:
        matrices, rounding = _integrated(source(x.points(across)), y.points(along), scale)
        if not np.all(np.isfinite(matrices)):
            return None, scale
        series = plane_series(matrices, x=x, y=y)
        end = tails(series.coefficients)
        allowed = SERIES * end.largest
        if end.x <= allowed and end.y <= allowed:
            sizes.known[key] = _needed(series, allowed, across), along
            return replace(series, error=series.error + rounding), scale
        across = across if end.x <= allowed else int(1.4 * across) + 1
        along = along if end.y <= allowed else next((k for k in _DEPTHS if k > along), _DEPTHS[-1] + 1)
    return None, scale


def _needed(series: PlaneSeries, allowed: float, count: int) -> int:
    """Speeds that would have been enough."""
    size = np.sqrt(np.sum(series.coefficients.reshape(count, -1) ** 2, axis=1))
    behind = np.cumsum(size[::-1])[::-1]
    return min(count, int(np.count_nonzero(behind > 0.1 * allowed)) + 2)


def _each(source: Source, speed: FloatArray, depth: FloatArray, y: Direction) -> _Panel:
    """A panel integrated at each of its speeds."""
    here = source(speed)
    scale = _scale(here, y.upper)
    for along in _DEPTHS:
        matrices, rounding = _integrated(here, y.points(along), scale)
        rows = np.moveaxis(y.coefficients(np.ascontiguousarray(np.moveaxis(matrices, 1, 0))), 0, 1)
        size = np.sqrt(np.nansum(rows**2, axis=(2, 3)))
        largest = np.maximum(np.max(size, axis=1), 1e-300)
        tail = float(np.max((size[:, -1] + size[:, -2]) / largest))
        if tail <= SERIES:
            break
    error = max(tail, SERIES) * float(np.max(largest)) + rounding
    return _Panel(
        np.ascontiguousarray(rows), y.basis(depth, along), error, 2.0 * np.pi / here.frequency,
        rescale(here.mean, scale),
    )  # fmt: skip


def _scale(here: Columns, deepest: float) -> FloatArray:
    """Coordinates in which the matrices are balanced."""
    size = np.abs(here.mean) + deepest * np.sum(np.abs(here.cosine) + np.abs(here.sine), axis=1)
    with np.errstate(all="ignore"):
        return balance(np.nan_to_num(np.nanmean(size, axis=0)) if np.any(np.isfinite(size)) else np.eye(size.shape[-1]))


def _integrated(here: Columns, depths: FloatArray, scale: FloatArray) -> tuple[FloatArray, float]:
    """Propagators over one period (V, D, m, m), NaN where there is no system, and their largest error."""
    known = np.all(np.isfinite(here.mean), axis=(1, 2))
    found = np.full((len(known), len(depths), *here.mean.shape[1:]), np.nan)
    if not np.any(known):
        return found, 0.0
    parts = (rescale(one[known], scale) for one in (here.mean, here.cosine, here.sine))
    with np.errstate(over="ignore", invalid="ignore"):
        many = monodromy_many(*parts, frequency=here.frequency[known], depths=depths, tolerance=_TRUNCATION,
                              threads=_THREADS)  # fmt: skip
        found[known] = many.matrices
        size = np.sqrt(np.max(np.sum(many.matrices**2, axis=(2, 3)), axis=1))
    return found, float(np.max(many.error * size))


class _Pixels:
    """The pixels of one panel."""

    def __init__(self, panel: _Panel, depth: FloatArray) -> None:
        self._panel, self._count = panel, len(depth)
        shape = len(panel.period), len(depth)
        self.growth, self.state = np.full(shape, np.nan), np.full(shape, NO_ANSWER, dtype=np.int8)
        self.evaluated = 0
        self._abscissa: FloatArray | None = None

    def fill(self) -> None:
        """Compute the rows that are computed throughout, then what lies between two of them."""
        everywhere = np.arange(len(self._panel.period))
        rows = lattice(self._count, STRIDE)
        self._compute(everywhere, rows)
        for below, above in pairwise(rows):
            inner = np.arange(below + 1, above)
            if not len(inner):
                continue
            open_ = self._open(int(below), int(above))
            if np.any(open_):
                self._compute(np.flatnonzero(open_), inner)
            calm = np.flatnonzero(~open_)
            share = (inner - below) / (above - below)
            low, high = self.growth[calm, below][:, None], self.growth[calm, above][:, None]
            self.growth[np.ix_(calm, inner)] = (1.0 - share) * low + share * high
            self.state[np.ix_(calm, inner)] = self.state[calm, below][:, None]

    def _open(self, below: int, above: int) -> NDArray[np.bool_]:
        """Speeds at which an edge of a tongue may lie between two rows: their states differ there or beside it, a
        tongue leaves, or the growth comes as near to zero as it changes from one row to the other."""
        first, second = self.state[:, below], self.state[:, above]
        low, high = self.growth[:, below], self.growth[:, above]
        edges = (first != second) | (first == UNRESOLVED)
        edges = ndimage.binary_dilation(edges, iterations=_BEYOND)
        leaving = (first == UNSTABLE) & (second != UNSTABLE)
        if np.any(leaving):
            edges |= ndimage.binary_dilation(leaving, iterations=STRIDE)
        change = np.abs(high - low)
        near = (np.maximum(low, high) + change >= 0.0) & (np.minimum(low, high) - change <= 0.0)
        return np.asarray((edges | near) & np.isfinite(low))

    def _compute(self, i: NDArray[np.intp], j: NDArray[np.intp]) -> None:
        """Growth and state at the speeds i and the depths j."""
        panel, n = self._panel, self._panel.rows.shape[-1]
        rows = panel.rows[i].reshape(len(i), panel.rows.shape[1], -1)
        matrices = np.matmul(panel.basis[j], rows).reshape(-1, n, n)
        logarithm = _log_radius(matrices).reshape(len(i), len(j))
        period = panel.period[i, None]
        lowest = np.log(max(panel.error, 1e-300))
        relative = _CONDITION * panel.error * np.exp(-np.maximum(logarithm, lowest)) + (
            np.log(_CONDITION) / 2.0**SQUARINGS
        )
        if lowest < -1.0:  # what is too small to be seen is stable; beside fierce growth it could be anything
            relative = np.minimum(relative, 1.0)
        growth = np.maximum(logarithm, lowest) / period
        growth[~np.isfinite(logarithm)] = np.nan
        error = relative / period
        period = np.repeat(period, len(j), axis=1)
        state = judge(growth, error, np.zeros(growth.shape, dtype=np.bool_), period)
        doubtful = np.any(state == UNRESOLVED, axis=1)
        if np.any(doubtful):
            neutral = np.abs(self._growth_of_mean()[i]) * panel.period[i] < _NEUTRAL
            # This map is a first answer: the growth of an undamped system that it cannot see is drawn as none.
            state[neutral[:, None] & (np.abs(growth) <= np.maximum(_NOISE / period, error))] = STABLE
        self.growth[np.ix_(i, j)], self.state[np.ix_(i, j)] = growth, state
        self.evaluated += growth.size

    def _growth_of_mean(self) -> FloatArray:
        if self._abscissa is None:
            known = np.all(np.isfinite(self._panel.mean), axis=(1, 2))
            self._abscissa = np.full(len(known), np.nan)
            self._abscissa[known] = np.max(np.linalg.eigvals(self._panel.mean[known]).real, axis=1)
        return self._abscissa


def _log_radius(matrices: FloatArray) -> FloatArray:
    """Natural logarithm of the spectral radii (k,) of matrices (k, n, n); NaN where one is not finite."""
    n = matrices.shape[-1]
    step = max(16, _CHUNK // (n * n))
    parts = [slice(first, first + step) for first in range(0, len(matrices), step)]
    result = np.empty(len(matrices))

    def work(part: slice) -> None:
        power, exponent = matrices[part], np.zeros(len(matrices[part]))
        with np.errstate(all="ignore"):
            for _ in range(SQUARINGS // _AT_ONCE):
                norm = np.sqrt(np.einsum("kij,kij->k", power, power))
                exponent = (exponent + np.log(norm)) * 2.0**_AT_ONCE
                power = power / norm[:, None, None]
                for _ in range(_AT_ONCE):
                    power = power @ power
            norm = np.sqrt(np.einsum("kij,kij->k", power, power))
            result[part] = (exponent + np.log(norm)) / 2.0**SQUARINGS

    with ThreadPoolExecutor(max_workers=_THREADS) as pool:
        list(pool.map(work, parts))
    return result
