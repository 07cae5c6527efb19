"""Constant m, c, k from a forced oscillation at several frequencies (Eqs. 6-9), and whether they are constant at all.

Force on the vehicle per unit displacement, at w: Q(w) = k - m w^2 + i w c, fitted to real and imaginary parts together.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum

import numpy as np
from numpy.typing import ArrayLike
from scipy import special

from maglev_ctrl.arrays import ComplexArray, FloatArray, read_only_any
from maglev_ctrl.forces.complex_stiffness import ComplexStiffness

LEVEL = 0.95
ALARM = 0.01  # chance of calling constants frequency dependent when they are not
_NOT_CONSTANT = "frequency dependent: no constant describes the data"
_TRENDLESS = "the misfit shows no clear trend over frequency: the errors may be too small instead, or a point wrong"
_ONE_FREQUENCY = "one frequency cannot separate k from -m w^2; measure a second frequency or the static stiffness"


class Description(Enum):
    """Whether constant m, c, k describe the data."""

    CONSTANT = "constant m, c, k describe the data within their errors"
    FREQUENCY_DEPENDENT = "frequency dependent: constant m, c, k do not describe the data"
    NOT_TESTED = "no redundancy: nothing is left to test whether m, c, k are constant"


@dataclass(frozen=True, slots=True)
class Estimate:
    """A value, its standard error and 95 % interval; NaN where there is none, and then `reason` says why."""

    value: float
    error: float = np.nan
    low: float = np.nan
    high: float = np.nan
    reason: str = ""


@dataclass(frozen=True, eq=False, slots=True)
class Identification:
    """Force derivatives m (kg), c (N s/m), k (N/m): force = m u'' + c u' + k u ON the vehicle, and how sure they are.

    `dynamic_stiffness` = k - m w^2 stands in for k and m where there is only one frequency. Per-frequency values hold
    whatever the verdict: c(w) = Im Q / w, and m(w) = (k - Re Q) / w^2 with the stiffness that `mass_from` names.
    """

    mass: Estimate
    damping: Estimate
    stiffness: Estimate
    dynamic_stiffness: Estimate
    description: Description
    test: str
    chance: float  # that constant m, c, k leave so much unexplained; NaN where nothing is tested
    degrees: float
    errors_from: str
    frequency: FloatArray  # (N,) rad/s, ascending
    response: ComplexArray  # (N,)
    response_error: FloatArray  # (N, 2) standard errors of the real and imaginary part
    fitted: ComplexArray  # (N,)
    damping_at: FloatArray  # (N,)
    damping_error_at: FloatArray
    mass_at: FloatArray
    mass_error_at: FloatArray
    mass_from: str
    least_squares: FloatArray  # (3,) k, m, c of the drawn curve, even where they are no constants of the data
    covariance: FloatArray  # (3, 3) of k, m, c; NaN where unknown
    quantile: float
    static: float
    static_error: float
    notes: tuple[str, ...]

    @property
    def separated(self) -> bool:
        """Whether k and m are known apart."""
        return not np.isnan(self.least_squares[0])

    def model(self, frequency: ArrayLike) -> tuple[ComplexArray, FloatArray]:
        """The fitted Q (F,) at frequencies (F,) rad/s, and the standard errors (F, 2) of its two parts."""
        w = np.asarray(frequency, dtype=np.float64)
        k, m, c = self.least_squares
        q = k - m * w**2 + 1j * w * c
        rows = np.stack([np.ones_like(w), -(w**2), np.zeros_like(w)], axis=-1)
        real = np.sqrt(np.maximum(np.einsum("fi,ij,fj->f", rows, self.covariance, rows), 0.0))
        return q, np.stack([real, w * np.sqrt(self.covariance[2, 2])], axis=-1)


def identify_constants(
    frequency: ArrayLike,
    response: ArrayLike,
    *,
    covariance: ArrayLike | None = None,
    degrees: float = np.inf,
    static_stiffness: float | None = None,
    static_error: float | None = None,
) -> Identification:
    """Fit constant m, c, k to measured complex stiffnesses and test whether they are constant.

    Errors that are given weigh the points and make the intervals; without them both are estimated from the residuals,
    with one standard error for all real and imaginary parts.

    Parameters
    ----------
    frequency : (N,) rad/s
    response : (N,) complex, force on the vehicle per unit displacement, N/m
    covariance : (N, 2, 2) of real and imaginary part, or None
    degrees : degrees of freedom of the given covariances (infinite where they are known)
    static_stiffness : dF/du of the steady force at the same speed, N/m
    static_error : its standard error; needed where `covariance` is given

    Raises
    ------
    ValueError : a frequency that is not positive, shapes that do not match, a covariance that is not positive definite

    Examples
    --------
    >>> w = np.array([10.0, 20.0, 30.0, 40.0])
    >>> found = identify_constants(w, -500.0 - 0.2 * -(w**2) + 3j * w)
    >>> round(found.stiffness.value, 6), round(found.mass.value, 6), round(found.damping.value, 6)
    (-500.0, -0.2, 3.0)
    """
    data = ComplexStiffness.checked(frequency, response, covariance, degrees, static_stiffness, static_error)
    separated = data.distinct + data.has_static >= 2
    # k and m need three points to leave anything over; c alone is over-determined by two
    redundant = data.distinct + data.has_static > 2 if separated else data.w.size > 1
    fit = _fit(data, _columns(data, separated), redundant=redundant)
    testable = redundant or (data.covariance is not None and data.w.size > 1)
    chance, test, trend = _lack_of_fit(data, fit, separated) if testable else (np.nan, "", False)
    if testable and not redundant:
        test = f"c alone: {test}"
    if chance < ALARM:
        description = Description.FREQUENCY_DEPENDENT
    elif np.isnan(chance) or not (redundant and separated):
        description = Description.NOT_TESTED
    else:
        description = Description.CONSTANT
    made = _assembled(data, fit, separated, description, chance, test)
    if description is Description.FREQUENCY_DEPENDENT and not trend:
        made = replace(made, notes=(*made.notes, _TRENDLESS))
    return made


@dataclass(frozen=True, eq=False, slots=True)
class _Fit:
    """Least squares: unknowns, their covariance (NaN without redundancy), and the whitened problem behind them."""

    x: FloatArray
    covariance: FloatArray
    degrees: float
    scale: float  # standard error of each part where it is estimated, else NaN
    whitened: FloatArray  # columns of the rows in units of their errors
    squares: float  # whitened residual sum of squares
    size: float  # whitened values, to tell rounding from misfit
    whitener: FloatArray


def _columns(data: ComplexStiffness, separated: bool, *, extended: bool = False) -> FloatArray:
    """Rows of the design: k, m, c (or k - m w^2 and c); `extended` adds the next power of w to either part."""
    w, one, zero = data.w, np.ones_like(data.w), np.zeros_like(data.w)
    real = [one, -(w**2), zero] if separated else [one, zero]
    imaginary = [zero, zero, w] if separated else [zero, w]
    if extended:
        real, imaginary = [*real, w**4, zero], [*imaginary, zero, w**3]
    rows = np.stack([np.stack(real, -1), np.stack(imaginary, -1)], axis=1).reshape(2 * w.size, -1)
    if data.has_static:
        rows = np.vstack([rows, np.eye(1, rows.shape[1])])
    return rows


def _fit(data: ComplexStiffness, columns: FloatArray, *, redundant: bool) -> _Fit:
    if data.covariance is not None:
        whitener = data.whitener()
        return _solved(data, columns, whitener, np.nan, data.degrees, known=True)
    rows, points = columns.shape[0], 2 * data.w.size
    floor = 1e-13 * float(np.max(np.abs(data.values)))
    scale, degrees = 1.0, float(rows - columns.shape[1])
    for _ in range(50 if not np.isnan(data.static_error) else 2):
        weight = np.full(rows, 1.0 / max(scale, floor, 1e-300))
        if not np.isnan(data.static_error):
            weight[-1] = 1.0 / data.static_error
        a, b = columns * weight[:, None], data.values * weight
        residual = b - a @ _least(a, b)
        before = scale
        if np.isnan(data.static_error):
            scale = float(np.sqrt(residual @ residual / max(degrees, 1.0)) / weight[0])
            continue
        # the static point's own error is known: it takes its share of the unknowns, the others keep theirs
        share = float(np.sum(_leverage(a)[:points]))
        degrees = max(points - share, 1e-9)
        scale = float(np.sqrt(residual[:points] @ residual[:points] / degrees) / weight[0])
        if abs(scale - before) <= 1e-9 * before:
            break
    scale = max(scale, floor, 1e-300)
    weight = np.full(rows, 1.0 / scale)
    if not np.isnan(data.static_error):
        weight[-1] = 1.0 / data.static_error
    return _solved(data, columns, np.diag(weight), scale if redundant else np.nan, degrees, known=redundant)


def _solved(
    data: ComplexStiffness, columns: FloatArray, whitener: FloatArray, scale: float, degrees: float, *, known: bool
) -> _Fit:
    a, b = whitener @ columns, whitener @ data.values
    x = _least(a, b)
    residual = b - a @ x
    size = np.linalg.norm(a, axis=0)
    inverse = np.linalg.inv((a / size).T @ (a / size)) / np.outer(size, size)
    covariance = inverse if known else np.full_like(inverse, np.nan)
    return _Fit(x, covariance, degrees, scale, a, float(residual @ residual), float(b @ b), whitener)


def _least(a: FloatArray, b: FloatArray) -> FloatArray:
    """Least squares with columns of like size: w^2 beside 1 would cost digits."""
    size = np.linalg.norm(a, axis=0)
    return np.asarray(np.linalg.lstsq(a / size, b, rcond=None)[0] / size)


def _leverage(a: FloatArray) -> FloatArray:
    q, _ = np.linalg.qr(a / np.linalg.norm(a, axis=0))
    return np.asarray(np.sum(q**2, axis=1))


def _lack_of_fit(data: ComplexStiffness, fit: _Fit, separated: bool) -> tuple[float, str, bool]:
    """Chance that constants leave so much unexplained, the test that said so, and whether it is a trend over w."""
    a = fit.whitener @ _columns(data, separated, extended=True)
    kept = np.linalg.norm(a, axis=0) > 0.0
    a = a[:, kept] / np.linalg.norm(a[:, kept], axis=0)
    b = fit.whitener @ data.values
    rank, rows, unknowns = int(np.linalg.matrix_rank(a, tol=1e-9)), b.size, fit.x.size
    extra, free = rank - unknowns, rows - rank
    if fit.squares <= 1e-22 * fit.size:
        return 1.0, "the residuals are rounding", False
    misfit = b - a @ np.linalg.lstsq(a, b, rcond=1e-9)[0]
    gained, rest = max(fit.squares - float(misfit @ misfit), 0.0), float(misfit @ misfit)
    ratio = gained / max(extra, 1) / max(rest / max(free, 1), 1e-300)
    by_scatter = float(special.fdtrc(extra, free, ratio)) if extra > 0 and free > 0 else np.nan
    clear = not by_scatter > 0.05  # with nothing to compare with, a trend is not ruled out
    if data.covariance is not None:
        overall = _tail(fit.squares, rows - unknowns, data.degrees)
        chances = [(overall, f"chi-square {fit.squares:.3g} with {rows - unknowns} degrees of freedom")]
        if extra > 0:
            trend = f"the next powers of w take {gained:.3g} off chi-square, {extra} more unknown(s)"
            chances.append((_tail(gained, extra, data.degrees), trend))
        chance, test = min(chances)
        return min(1.0, chance * len(chances)), test, clear  # two looks at the same data: each at half the level
    if extra <= 0 or free < 1:
        return np.nan, "errors are not given and too few points are left to see a trend", False
    return by_scatter, f"F({extra}, {free}) = {ratio:.3g} for the next powers of w", clear


def _tail(squares: float, free: int, degrees: float) -> float:
    """Chance of a larger sum of squares, by chi-square, or by F where the errors themselves are estimates."""
    if np.isinf(degrees):
        return float(special.chdtrc(free, squares))
    return float(special.fdtrc(free, degrees, squares / free))


def _assembled(
    data: ComplexStiffness, fit: _Fit, separated: bool, description: Description, chance: float, test: str
) -> Identification:
    known = data.covariance is not None
    quantile = float(
        special.ndtri(0.5 + LEVEL / 2) if np.isinf(fit.degrees) else special.stdtrit(fit.degrees, 0.5 + LEVEL / 2)
    )
    reason = ""
    if description is Description.FREQUENCY_DEPENDENT:
        reason = _NOT_CONSTANT
    elif np.isnan(fit.covariance).any():
        reason = "errors are not given and cannot be estimated: as many unknowns as measurements"
    spread = np.full_like(fit.covariance, np.nan) if reason else fit.covariance
    best = np.where(reason == _NOT_CONSTANT, np.nan, fit.x)  # no number for what is no constant
    made = [_estimate(float(x), float(spread[i, i]), quantile, reason) for i, x in enumerate(best)]
    least_squares, covariance = np.full(3, np.nan), np.full((3, 3), np.nan)
    missing = Estimate(np.nan, reason=_ONE_FREQUENCY)
    if separated:
        (stiffness, mass, damping), covariance, least_squares = made, spread, fit.x
        dynamic = Estimate(np.nan, reason="k and m are known apart")
    else:
        (dynamic, damping), stiffness, mass = made, missing, missing
        covariance[2, 2], least_squares[2] = spread[1, 1], fit.x[1]
    if known:
        error = np.sqrt(np.stack([data.covariance[:, 0, 0], data.covariance[:, 1, 1]], axis=-1))  # type: ignore[index]
    else:
        error = np.full((data.w.size, 2), fit.scale)
    mass_at, mass_error, mass_from = _mass_at(data, error, stiffness, description)
    fitted = _columns(data, separated)[: 2 * data.w.size] @ fit.x
    return Identification(
        mass=mass, damping=damping, stiffness=stiffness, dynamic_stiffness=dynamic,
        description=description, test=test, chance=chance, degrees=fit.degrees,
        errors_from="given" if known else "residuals" if not np.isnan(fit.scale) else "none",
        frequency=read_only_any(data.w), response=read_only_any(data.q), response_error=read_only_any(error),
        fitted=read_only_any(fitted[0::2] + 1j * fitted[1::2]),
        damping_at=read_only_any(data.q.imag / data.w), damping_error_at=read_only_any(error[:, 1] / data.w),
        mass_at=read_only_any(mass_at), mass_error_at=read_only_any(mass_error), mass_from=mass_from,
        least_squares=read_only_any(least_squares), covariance=read_only_any(covariance),
        quantile=quantile, static=data.static, static_error=data.static_error,
        notes=tuple(_notes(data, fit, separated, description)),
    )  # fmt: skip


def _estimate(value: float, variance: float, quantile: float, reason: str) -> Estimate:
    error = float(np.sqrt(variance))
    return Estimate(value, error, value - quantile * error, value + quantile * error, reason)


def _mass_at(
    data: ComplexStiffness, error: FloatArray, stiffness: Estimate, description: Description
) -> tuple[FloatArray, FloatArray, str]:
    """m(w) needs k from elsewhere: the static measurement, else the fitted k as long as constants hold."""
    if data.has_static:
        k, spread, source = data.static, 0.0 if np.isnan(data.static_error) else data.static_error, "static stiffness"
    elif description is Description.CONSTANT and not np.isnan(stiffness.value):
        k, spread, source = stiffness.value, 0.0, "fitted stiffness"
    else:
        return np.full_like(data.w, np.nan), np.full_like(data.w, np.nan), ""
    return (k - data.q.real) / data.w**2, np.hypot(error[:, 0], spread) / data.w**2, source


def _notes(data: ComplexStiffness, fit: _Fit, separated: bool, description: Description) -> list[str]:
    notes = []
    if not separated:
        notes.append(f"k and m are not identifiable: {_ONE_FREQUENCY}")
    elif data.distinct == 2 and not data.has_static:
        notes.append("two frequencies give k and m with no redundancy: a wrong point shows nowhere")
    elif data.distinct == 1:
        notes.append(
            "one frequency and the static stiffness give m with nothing to spare: it absorbs whatever of k changes "
            "with frequency (Eq. 9)"
        )
    if description is Description.FREQUENCY_DEPENDENT:
        notes.append("use the values frequency by frequency; a lag (state-space) model may describe them")
        if not data.has_static:
            notes.append("m(w) needs the static stiffness at the same speed, which is not given")
    free = fit.whitened.shape[0] - fit.x.size
    if data.covariance is not None and np.isinf(data.degrees) and free > 0:
        chance = float(special.chdtr(free, fit.squares))
        if chance < ALARM / 10.0:
            notes.append(f"residuals smaller than the errors allow (chance {chance:.1g}): the errors look too large")
    return notes


def damping_words(found: Identification, *, direct: bool) -> str:
    """What the damping derivative does, in words.

    Parameters
    ----------
    direct : whether force and motion are along the same coordinate

    Examples
    --------
    >>> w = np.array([10.0, 20.0, 30.0, 40.0])
    >>> damping_words(identify_constants(w, -500.0 + 3j * w), direct=True)
    'c > 0: negative damping, the force feeds energy into the motion'
    """
    if not direct:
        return "a coupling: the sign of c alone says nothing about damping"
    low, high, name = np.array([found.damping.low]), np.array([found.damping.high]), "c"
    if found.description is Description.FREQUENCY_DEPENDENT:
        half = found.quantile * found.damping_error_at
        low, high, name = found.damping_at - half, found.damping_at + half, "c(w), at every frequency measured,"
    if np.isnan(low).any():
        return "no interval for c: whether it damps is not certain"
    if np.all(low > 0.0):
        return f"{name} > 0: negative damping, the force feeds energy into the motion"
    if np.all(high < 0.0):
        return f"{name} < 0: positive damping, the force takes energy out of the motion"
    if name == "c":
        return "the interval of c holds zero: whether it damps is not known"
    if np.any(low > 0.0):
        return "c(w) > 0 at some frequencies: negative damping, the force feeds energy into the motion there"
    return "c(w) is not below zero with certainty at every frequency: whether it damps there is not known"
