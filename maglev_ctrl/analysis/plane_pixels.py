"""Growth rates with error bounds at the pixels of one panel, from its series or by integrating every pixel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maglev_ctrl.analysis.floquet import scaled_coefficients
from maglev_ctrl.analysis.plane_panels import Panel
from maglev_ctrl.analysis.plane_records import NO_ANSWER, STABLE, UNRESOLVED, UNSTABLE, PeriodicFamily
from maglev_ctrl.arrays import ComplexArray, FloatArray
from maglev_ctrl.errors import ModelError, OutOfDomain
from maglev_ctrl.kernels.plane_series import PlaneSeries
from maglev_ctrl.kernels.spectral_radius import RadiusEngine, leading_eigenvalues
from maglev_ctrl.kernels.taylor_many import monodromy_many

_NEUTRAL = 1e-6  # |largest Re eigenvalue of A_0| times the period below which a point counts as undamped
_STRIDE = 4  # conditions of the leading multiplier are computed at every fourth pixel, and wherever they decide
_MARGIN = 4.0  # conditions between those pixels may be this much larger
_APART = 1e-9  # error per period up to which the multipliers of an undamped system are simple
_ROUGH = 1e-5  # error per period that even a nearly defective multiplier keeps with the accuracy of a series
_ENGINE = 1e-10  # relative error that moduli found without eigenvalues may have
_BATCH = 256
_LOST = "the growth over one period leaves the range of numbers"


@dataclass(frozen=True, eq=False, slots=True)
class Pixels:
    """Results at k pixels: growth and its error bound in 1/s, the state of each, and what went wrong."""

    growth: FloatArray
    error: FloatArray
    state: NDArray[np.int8]
    faults: tuple[str, ...] = ()
    integrated: int = 0


@dataclass(frozen=True, eq=False, slots=True)
class Corners:
    """Pixels with all they say about resonances near them: `multipliers` (k, n), `mean` (k, n) eigenvalues of the mean
    system in 1/s, `period` (k,) in s."""

    found: Pixels
    multipliers: ComplexArray
    mean: ComplexArray
    period: FloatArray


def conditions(matrices: FloatArray, multiplier: ComplexArray, relative: FloatArray) -> FloatArray:
    """Relative error of the leading multiplier per relative error of the matrix, from the resolvent beside it; (k,).

    At a distance r the resolvent of a simple eigenvalue is its condition over r. With r the square root of the
    perturbation a nearly defective pair gives the square-root law by itself.

    Parameters
    ----------
    matrices : (k, n, n)
    multiplier : (k,) their leading eigenvalues
    relative : (k,) size of the perturbation over the modulus

    Examples
    --------
    >>> float(conditions(np.diag([2.0, 1.0])[None], np.array([2.0 + 0j]), np.array([1e-12]))[0].round(4))
    1.0
    """
    reach = np.sqrt(np.maximum(relative, 1e-18)) * np.abs(multiplier)
    shifted = matrices - ((multiplier + reach)[:, None, None] * np.eye(matrices.shape[-1]))
    try:
        resolvent = np.linalg.inv(shifted)
    except np.linalg.LinAlgError:
        return np.full(len(matrices), np.inf)
    return np.asarray(np.linalg.norm(resolvent, axis=(1, 2)) * reach)


def judge(growth: FloatArray, error: FloatArray, neutral: NDArray[np.bool_], period: FloatArray) -> NDArray[np.int8]:
    """State of each pixel; of an undamped system, growth within a small error bound is no growth.

    Simple multipliers of an undamped system stay on the circle; where two of them meet, at the edge of a tongue, the
    error bound tells, and nothing is decided.

    Examples
    --------
    >>> growth, error = np.array([0.1, 1e-12, 1e-12]), np.array([1e-10, 1e-10, 1e-10])
    >>> judge(growth, error, np.array([False, False, True]), np.ones(3)).tolist()
    [1, 0, -1]
    """
    state = np.full(growth.shape, UNRESOLVED, dtype=np.int8)
    state[growth > error] = UNSTABLE
    state[growth < -error] = STABLE
    state[neutral & (np.abs(growth) <= error) & (error * period <= _APART)] = STABLE
    state[~np.isfinite(growth)] = NO_ANSWER
    return state


class PanelPixels:
    """Evaluates pixels of one panel that has a series; safe to share between threads."""

    def __init__(self, panel: Panel, x: FloatArray, y: FloatArray, engine: RadiusEngine) -> None:
        if panel.series is None or panel.period is None or panel.mean is None:
            raise ValueError("panel: expected one with a series")
        self.series, self.period, self.mean = panel.series, panel.period, panel.mean
        self._x, self._y, self._engine = x, y, engine
        self._basis = self.series.y_basis(y)
        self._error = self.series.error
        self._slack = 0.0 if engine.name == "numpy" else _ENGINE  # the series' error covers rounding of eigenvalues
        self.columns = len(y)

    def rows(self, first: int, last: int) -> tuple[Pixels, FloatArray]:
        """Every pixel of the rows first..last of the panel; growth (rows, columns), and the periods."""
        rows = self.series.rows(self._x[first:last])
        modulus = np.empty((last - first, len(self._y)))
        for k, coefficients in enumerate(rows):
            modulus[k] = self._moduli(coefficients, self._basis)
        period = self.period.grid(self._x[first:last], self._y)
        growth = np.log(np.maximum(modulus, 1e-300)) / period
        i, j = lattice(last - first, _STRIDE), lattice(len(self._y), _STRIDE)
        matrices = np.matmul(self._basis[j], rows[i].reshape(len(i), self._basis.shape[1], -1))
        sampled = self._conditions(matrices.reshape(-1, *self.series.coefficients.shape[2:]))
        condition = _MARGIN * spread(sampled.reshape(len(i), len(j)), i, j, growth.shape)
        error = (condition * self._error / np.maximum(modulus, 1e-300) + self._slack) / period
        state = judge(growth, np.maximum(error, _ROUGH / period), np.zeros(growth.shape, dtype=bool), period)
        close = np.nonzero((state == UNRESOLVED) | (error * period > _ROUGH))
        if len(close[0]):
            self._settle(first, rows, close, growth, error, period, state)
        return Pixels(growth, error, state), period

    def pixels(self, i: NDArray[np.intp], j: NDArray[np.intp]) -> Corners:
        """Pixels (i, j) of the panel one by one, with all multipliers and the mean system's eigenvalues."""
        matrices = self.matrices(i, j)
        multipliers = np.linalg.eigvals(matrices).astype(np.complex128)
        leading = multipliers[np.arange(len(i)), np.argmax(np.abs(multipliers), axis=1)]
        period = _scattered(self.period, self._x, self._y, i, j)
        mean = self._mean_eigenvalues(i, j)
        abscissa = np.max(mean.real, axis=1)
        found = judged_pixels(matrices, leading, np.full(len(i), self._error), period, abscissa)
        return Corners(found, multipliers, mean, period)

    def verdicts(self, i: NDArray[np.intp], j: NDArray[np.intp], condition: FloatArray) -> Pixels:
        """Pixels (i, j) of the panel by the engine, row by row; `condition` (k,) of the leading multiplier, roughly."""
        modulus = np.empty(len(i))
        rows, which = np.unique(i, return_inverse=True)
        for k, coefficients in enumerate(self.series.rows(self._x[rows])):
            here = np.nonzero(which == k)[0]
            modulus[here] = self._moduli(coefficients, self._basis[j[here]])
        period = _scattered(self.period, self._x, self._y, i, j)
        growth = np.log(np.maximum(modulus, 1e-300)) / period
        error = (condition * self._error / np.maximum(modulus, 1e-300) + self._slack) / period
        state = judge(growth, np.maximum(error, _ROUGH / period), np.zeros(growth.shape, dtype=bool), period)
        close = np.nonzero((state == UNRESOLVED) | (error * period > _ROUGH))[0]
        if len(close):
            exact = self.pixels(i[close], j[close]).found
            growth[close], error[close], state[close] = exact.growth, exact.error, exact.state
        return Pixels(growth, error, state)

    def conditions_of(self, found: Pixels, period: FloatArray) -> FloatArray:
        """The condition behind each error bound, with a margin for the pixels around."""
        return np.asarray(_MARGIN * found.error * period * np.exp(found.growth * period) / self._error)

    def matrices(self, i: NDArray[np.intp], j: NDArray[np.intp]) -> FloatArray:
        """Monodromy matrices (k, n, n) at pixels."""
        return _scattered(self.series, self._x, self._y, i, j)

    def _mean_eigenvalues(self, i: NDArray[np.intp], j: NDArray[np.intp]) -> ComplexArray:
        """Eigenvalues of the mean system (k, n) at pixels, once for each place where it differs."""
        terms = self.mean.coefficients.shape[:2]
        places = np.stack([i if terms[0] > 1 else np.zeros_like(i), j if terms[1] > 1 else np.zeros_like(j)])
        different, which = np.unique(places, axis=1, return_inverse=True)
        values = np.linalg.eigvals(_scattered(self.mean, self._x, self._y, *different))
        return np.asarray(values[which.ravel()], dtype=np.complex128)

    def _moduli(self, coefficients: FloatArray, basis: FloatArray) -> FloatArray:
        if self._engine.name == "numpy":
            return np.asarray(np.abs(self._engine.multipliers(coefficients, basis)))
        return self._engine.moduli(coefficients, basis)[0]

    def _conditions(self, matrices: FloatArray) -> FloatArray:
        leading = leading_eigenvalues(matrices)
        return conditions(matrices, leading, self._error / np.maximum(np.abs(leading), 1e-300))

    def _settle(
        self, first: int, rows: FloatArray, close: tuple[NDArray[np.intp], ...], growth: FloatArray, error: FloatArray,
        period: FloatArray, state: NDArray[np.int8],
    ) -> None:  # fmt: skip
        """Conditions of their own for the pixels that the rough bound does not decide."""
        for begin in range(0, len(close[0]), 4096):
            i, j = close[0][begin : begin + 4096], close[1][begin : begin + 4096]
            matrices = np.einsum("kl,klz->kz", self._basis[j], rows.reshape(*rows.shape[:2], -1)[i])
            stack = matrices.reshape(-1, *self.series.coefficients.shape[2:])
            abscissa = np.max(self._mean_eigenvalues(first + i, j).real, axis=1)
            errors = np.full(len(i), self._error)
            found = judged_pixels(stack, leading_eigenvalues(stack), errors, period[i, j], abscissa)
            growth[i, j], error[i, j], state[i, j] = found.growth, found.error, found.state


def _scattered(
    series: PlaneSeries, x: FloatArray, y: FloatArray, i: NDArray[np.intp], j: NDArray[np.intp]
) -> FloatArray:
    """Values of a series at the places (x[i], y[j]), pixels of one row together."""
    result = np.empty((len(i), *series.coefficients.shape[2:]))
    rows, inverse = np.unique(i, return_inverse=True)
    flat = series.rows(x[rows]).reshape(len(rows), series.coefficients.shape[1], -1)
    columns, which = np.unique(j, return_inverse=True)
    basis = series.y_basis(y[columns])
    order = np.argsort(inverse, kind="stable")
    starts = np.searchsorted(inverse[order], np.arange(len(rows) + 1))
    for k in range(len(rows)):
        here = order[starts[k] : starts[k + 1]]
        result[here] = (basis[which[here]] @ flat[k]).reshape(-1, *result.shape[1:])
    return result


def judged_pixels(
    matrices: FloatArray, leading: ComplexArray, error: FloatArray, period: FloatArray, abscissa: FloatArray
) -> Pixels:
    """Growth, bound and state from monodromy matrices (k, n, n) known within `error` (k,) in Frobenius norm.

    `abscissa` (k,): largest real part of an eigenvalue of the mean system, 1/s.
    """
    modulus = np.maximum(np.abs(leading), 1e-300)
    relative = error / modulus
    bound = np.maximum(conditions(matrices, leading, relative), 1.0) * relative / period
    growth = np.log(modulus) / period
    neutral = np.abs(abscissa) * period < _NEUTRAL
    return Pixels(growth, bound, judge(growth, bound, neutral, period))


def direct_pixels(family: PeriodicFamily, x: FloatArray, y: FloatArray) -> tuple[Pixels, ComplexArray]:
    """Pixels at (x, y) (k,), each integrated for itself, with their leading multipliers (NaN without an answer)."""
    count = len(x)
    growth, error = np.full(count, np.nan), np.full(count, np.nan)
    state = np.full(count, NO_ANSWER, dtype=np.int8)
    leading = np.full(count, np.nan + 0j, dtype=np.complex128)
    faults: dict[str, None] = {}
    alike: dict[tuple[int, int], list[tuple[int, FloatArray, FloatArray, FloatArray, float]]] = {}
    integrated = 0

    def finish(group: list[tuple[int, FloatArray, FloatArray, FloatArray, float]]) -> None:
        at = np.array([one[0] for one in group])
        A_0, A_cos, A_sin = (np.stack([one[k] for one in group]) for k in (1, 2, 3))
        omega = np.array([one[4] for one in group])
        with np.errstate(over="ignore", invalid="ignore"):
            found = monodromy_many(A_0, A_cos, A_sin, frequency=omega)
        matrices = found.matrices[:, 0]
        finite = np.all(np.isfinite(matrices), axis=(1, 2))
        if not np.all(finite):
            faults[_LOST] = None
        good = at[finite]
        leading[good] = leading_eigenvalues(matrices[finite])
        size = np.linalg.norm(matrices[finite], axis=(1, 2)) * found.error[finite]
        abscissa = np.max(np.linalg.eigvals(A_0[finite]).real, axis=1)
        pixels = judged_pixels(matrices[finite], leading[good], size, 2.0 * np.pi / omega[finite], abscissa)
        growth[good], error[good], state[good] = pixels.growth, pixels.error, pixels.state

    for k in range(count):
        try:
            system = family(float(x[k]), float(y[k]))
        except (ModelError, OutOfDomain) as fault:
            faults[str(fault)] = None
            continue
        group = alike.setdefault((system.A_0.shape[-1], len(system.A_cos)), [])
        group.append((k, *scaled_coefficients(system.A_0, system.A_cos, system.A_sin), float(system.frequency)))
        integrated += 1
        if len(group) == _BATCH:
            finish(group)
            group.clear()
    for group in alike.values():
        if group:
            finish(group)
    return Pixels(growth, error, state, tuple(faults), integrated), leading


def lattice(count: int, stride: int) -> NDArray[np.intp]:
    """Every `stride`-th index below `count`, and the last one.

    Examples
    --------
    >>> lattice(7, 4).tolist()
    [0, 4, 6]
    """
    return np.unique(np.append(np.arange(0, count, stride), count - 1))


def spread(values: FloatArray, i: NDArray[np.intp], j: NDArray[np.intp], shape: tuple[int, ...]) -> FloatArray:
    """At each pixel the largest of the values at the lattice points around it."""
    for axis, (places, count) in enumerate(((i, shape[0]), (j, shape[1]))):
        right = np.searchsorted(places, np.arange(count))
        left = np.maximum(right - (places[right] > np.arange(count)), 0)
        values = np.maximum(np.take(values, left, axis), np.take(values, right, axis))
    return values
