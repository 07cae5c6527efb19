"""Sine fit of a forced oscillation: from displacement and force over time to the complex stiffness at one frequency.

The four-parameter fit of IEEE Std 1057 (amplitude, phase, offset, frequency), with a drift and the harmonics that the
sampling resolves. Phasors belong to exp(+i w t), so that a force ahead of the displacement has a positive phase.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from maglev_ctrl.arrays import ComplexArray, FloatArray, read_only, read_only_any

LEAST_PERIODS = 2.0
HARMONICS = 5  # highest multiple of the frequency that is fitted
_SAMPLES_PER_PERIOD = 4.0
_FREE_SAMPLES = 4  # samples beyond the unknowns, else the residual says nothing
_SINE_SHARE = 0.8  # of the displacement's variance; below it the motion is not one sine
_SIGNIFICANT = 3.0  # standard deviations
_STRONG_HARMONIC = 0.1


@dataclass(frozen=True, eq=False, slots=True)
class SineFit:
    """One record's complex stiffness Q = force / displacement at `frequency` (rad/s), with its errors.

    `covariance` (2, 2) is that of the real and imaginary part of `response`; `degrees` are the degrees of freedom of
    the residual it is estimated from. `displacement` and `force` are phasors at the middle of the record.
    `harmonics_displacement`, `harmonics_force` are amplitudes of the multiples 2, 3, ... over that of the fundamental.
    """

    frequency: float
    frequency_error: float
    periods: float
    displacement: complex
    force: complex
    response: complex
    covariance: FloatArray
    degrees: float
    harmonics_displacement: FloatArray
    harmonics_force: FloatArray
    autocorrelation: tuple[float, float]
    notes: tuple[str, ...]

    @property
    def amplitude(self) -> float:
        """Amplitude of the force per unit displacement."""
        return abs(self.response)

    @property
    def phase(self) -> float:
        """Lead of the force over the displacement, rad, in (-pi, pi]."""
        return float(np.angle(self.response))


def fit_sine(time: ArrayLike, displacement: ArrayLike, force: ArrayLike) -> SineFit:
    """Complex stiffness of one record of a forced oscillation.

    Parameters
    ----------
    time : (N,) s, increasing in even steps
    displacement : (N,) m or rad
    force : (N,) force on the vehicle, N or N m

    Raises
    ------
    ValueError : uneven time, too few samples, no sine in the displacement, fewer than two periods

    Examples
    --------
    >>> t = np.linspace(0.0, 2.0, 400, endpoint=False)
    >>> u, f = 1e-3 * np.cos(20 * t), 0.1 * np.cos(20 * t + 2.5)
    >>> found = fit_sine(t, u, f)
    >>> round(found.frequency, 6), round(found.amplitude, 6), round(found.phase, 6)
    (20.0, 100.0, 2.5)
    """
    t, u, f = _checked(time, displacement, force)
    t = t - 0.5 * (t[0] + t[-1])
    frequency, share = _frequency(t, u)
    length = (t[-1] - t[0]) * t.size / (t.size - 1)
    periods = float(frequency * length / (2.0 * np.pi))
    if share < _SINE_SHARE:
        raise ValueError(
            f"displacement: expected a sine, got a motion of which the best explains {100.0 * max(share, 0.0):.0f} %"
        )
    if periods < 0.9 * LEAST_PERIODS:
        raise ValueError(_too_short(periods))
    if t.size < _SAMPLES_PER_PERIOD * periods:
        raise ValueError(f"time: expected at least four samples per period, got {t.size / periods:.2g}")
    multiples = _multiples(frequency, float(t[1] - t[0]), t.size)
    basis = _basis(t, frequency, multiples)
    both = np.column_stack([u, f])
    solution = np.linalg.lstsq(basis, both, rcond=None)[0]
    residual = both - basis @ solution
    degrees = t.size - basis.shape[1] - 1  # the frequency is an unknown too
    inverse = np.asarray(np.linalg.inv(basis.T @ basis), dtype=np.float64)
    correlation = tuple(_lag_one(residual[:, i], both[:, i]) for i in (0, 1))
    widen = np.array([_widening(r, frequency * float(t[1] - t[0]), t.size) for r in correlation])
    spread = np.asarray(residual.T @ residual / degrees * np.sqrt(np.outer(widen, widen)), dtype=np.float64)
    phasors = solution[0] - 1j * solution[1]
    response = complex(phasors[1] / phasors[0])
    harmonics = np.hypot(solution[2 : 2 * multiples : 2], solution[3 : 2 * multiples : 2]) / np.abs(phasors)
    # the frequency's own column, to see how well the record fixes it
    slope = t * (solution[1, 0] * np.cos(frequency * t) - solution[0, 0] * np.sin(frequency * t))
    free = slope - basis @ np.linalg.lstsq(basis, slope, rcond=None)[0]
    frequency_error = float(np.sqrt(spread[0, 0] / (free @ free)))
    if periods + 4.0 * frequency_error * length / (2.0 * np.pi) < LEAST_PERIODS * (1.0 - 1e-6):
        raise ValueError(_too_short(periods))
    amplitude_error = np.sqrt(np.trace(inverse[:2, :2]) / 2.0 * np.diag(spread))
    return SineFit(
        frequency=frequency,
        frequency_error=frequency_error,
        periods=periods,
        displacement=complex(phasors[0]),
        force=complex(phasors[1]),
        response=response,
        covariance=read_only(_covariance(response, complex(phasors[0]), inverse[:2, :2], spread), name="covariance"),
        degrees=float(degrees),
        harmonics_displacement=read_only_any(harmonics[:, 0]),
        harmonics_force=read_only_any(harmonics[:, 1]),
        autocorrelation=(correlation[0], correlation[1]),
        notes=tuple(_notes(harmonics, widen, np.abs(phasors) / np.maximum(amplitude_error, 1e-300))),
    )


def _too_short(periods: float) -> str:
    return f"time: expected at least two periods of the oscillation, got {periods:.3g}"


def _checked(time: ArrayLike, displacement: ArrayLike, force: ArrayLike) -> tuple[FloatArray, FloatArray, FloatArray]:
    t = read_only(time, name="time", shape=(None,))
    u = read_only(displacement, name="displacement", shape=(None,))
    f = read_only(force, name="force", shape=(None,))
    if not t.size == u.size == f.size:
        raise ValueError(f"displacement, force: expected as many as times ({t.size}), got {u.size} and {f.size}")
    if t.size < 7 + _FREE_SAMPLES:
        raise ValueError(f"time: expected at least {7 + _FREE_SAMPLES} samples, got {t.size}")
    place = first_uneven_step(t)
    if place is not None:
        raise ValueError(f"time: expected even, increasing steps, got {t[place]:.9g} s after {t[place - 1]:.9g} s")
    if np.ptp(u) == 0.0:
        raise ValueError("displacement: expected an oscillation, got one value throughout")
    if np.ptp(f) == 0.0:
        raise ValueError("force: expected an oscillation, got one value throughout")
    return t, u, f


def first_uneven_step(time: FloatArray) -> int | None:
    """Index of the first time (N,), s, whose step from the one before is off the usual step by a tenth; None if even.

    Examples
    --------
    >>> first_uneven_step(np.array([0.0, 0.1, 0.2, 0.4])), first_uneven_step(np.array([0.0, 0.1, 0.2]))
    (3, None)
    """
    steps = np.diff(time)
    usual = float(np.median(steps))
    wrong = np.flatnonzero((steps <= 0.0) | (np.abs(steps - usual) > 0.1 * abs(usual)))
    return int(wrong[0]) + 1 if wrong.size else None


def _frequency(t: FloatArray, u: FloatArray) -> tuple[float, float]:
    """Frequency of the sine in `u`, rad/s, and the share of the variance about the drift that it explains."""
    from scipy.optimize import minimize_scalar

    level = np.column_stack([np.ones_like(t), t])
    flat = u - level @ np.linalg.lstsq(level, u, rcond=None)[0]
    length = (t[-1] - t[0]) * t.size / (t.size - 1)
    unit = 2.0 * np.pi / length

    def left(w: float) -> float:
        basis = _basis(t, w, 1)
        misfit = u - basis @ np.linalg.lstsq(basis, u, rcond=None)[0]
        return float(misfit @ misfit)

    padded = 1 << int(np.ceil(np.log2(8 * t.size)))
    spectrum = np.abs(np.fft.rfft(flat * np.hanning(t.size), padded))
    peak = 2.0 * np.pi * float(np.argmax(spectrum)) / (padded * (t[1] - t[0]))
    # Below a few periods the window's lobe hides the peak and drift looks like a slow sine: look there one by one.
    candidates = [peak, *(unit * np.arange(0.3, 4.0, 0.1))] if peak < 5.0 * unit else [peak]
    start = min((w for w in candidates if w > 0.0), key=left)
    # The valley around the best frequency is one unit wide on either side; golden section cannot leave it.
    found = minimize_scalar(left, bounds=(max(0.2 * unit, start - 0.4 * unit), start + 0.4 * unit), method="bounded",
                            options={"xatol": 1e-10 * start})  # fmt: skip
    w = _polished(t, u, float(found.x))
    total = float(flat @ flat)
    return w, 1.0 - left(w) / total if total > 0.0 else 0.0


def _polished(t: FloatArray, u: FloatArray, w: float) -> float:
    """Gauss-Newton steps of the four-parameter fit: the frequency's own column beside sine, cosine, offset, drift."""
    limit = 0.5 / (t[-1] - t[0])
    for _ in range(20):
        basis = _basis(t, w, 1)
        a, b = np.linalg.lstsq(basis, u, rcond=None)[0][:2]
        slope = t * (b * np.cos(w * t) - a * np.sin(w * t))
        step = float(np.linalg.lstsq(np.column_stack([basis, slope]), u, rcond=None)[0][-1])
        if not abs(step) < limit:
            break
        w += step
        if abs(step) < 1e-14 * w:
            break
    return abs(w)


def _multiples(w: float, step: float, samples: int) -> int:
    """Highest multiple that stays below 0.9 of half the sampling rate and leaves the residual its freedom."""
    below = int(0.9 * np.pi / (w * step))
    room = (samples - 3 - _FREE_SAMPLES) // 2
    return max(1, min(HARMONICS, below, room))


def _basis(t: FloatArray, w: float, multiples: int) -> FloatArray:
    """Columns cos, sin of the multiples of w, then offset and drift."""
    angles = [n * w * t for n in range(1, multiples + 1)]
    waves = [wave(angle) for angle in angles for wave in (np.cos, np.sin)]
    return np.column_stack([*waves, np.ones_like(t), t / (t[-1] - t[0])])


def _covariance(response: complex, displacement: complex, inverse: FloatArray, spread: FloatArray) -> FloatArray:
    """Covariance (2, 2) of Q = F / U: dQ = (dF - Q dU) / U, errors of F and U with their correlation `spread`."""
    phasor = np.diag([1.0, -1.0]) @ inverse @ np.diag([1.0, -1.0])  # sine coefficient = minus imaginary part
    turn = np.hstack([_matrix(-response / displacement), _matrix(1.0 / displacement)])
    joint = np.kron(spread, phasor)
    rounding = (1e-12 * abs(response)) ** 2  # exact data are still no better than their arithmetic
    return np.asarray(turn @ joint @ turn.T + rounding * np.eye(2))


def _matrix(factor: complex) -> FloatArray:
    """Multiplication by a complex number on (real, imaginary)."""
    return np.array([[factor.real, -factor.imag], [factor.imag, factor.real]])


def _lag_one(residual: FloatArray, signal: FloatArray) -> float:
    """Correlation of neighbouring residuals; 0 where the fit is exact to rounding."""
    power = float(residual @ residual)
    if power <= 1e-24 * float(signal @ signal):
        return 0.0
    return float(residual[1:] @ residual[:-1]) / power


def _widening(correlation: float, angle: float, samples: int) -> float:
    """Noise power at the oscillation's frequency over that of white noise, for neighbours so correlated; at least 1."""
    if abs(correlation) < _SIGNIFICANT / np.sqrt(samples):
        return 1.0
    r = min(correlation, 0.99)
    return max(1.0, float((1.0 - r * r) / (1.0 - 2.0 * r * np.cos(angle) + r * r)))


def _notes(harmonics: FloatArray, widen: FloatArray, certainty: FloatArray) -> list[str]:
    notes = []
    for place, name in enumerate(("displacement", "force")):
        if widen[place] > 1.0:
            notes.append(
                f"the residual of the {name} is autocorrelated; its standard errors were widened "
                f"by {np.sqrt(widen[place]):.2g}"
            )
        strong = harmonics[:, place] > _STRONG_HARMONIC
        # a harmonic counts when it stands clear of the noise, which is that of the fundamental
        strong &= harmonics[:, place] * certainty[place] > _SIGNIFICANT
        if strong.any():
            worst = int(np.argmax(harmonics[:, place]))
            notes.append(
                f"harmonic {worst + 2} of the {name} is {100.0 * harmonics[worst, place]:.0f} % of the fundamental: "
                + (
                    "the motion is not a sine"
                    if name == "displacement"
                    else "the motion is too large for a linear force"
                )
            )
    if certainty[1] < _SIGNIFICANT:
        notes.append("the force at this frequency does not stand out of its noise")
    return notes


def phasor_series(phasor: complex, frequency: float, time: FloatArray) -> FloatArray:
    """The sine that a phasor stands for, Re(phasor exp(i w t)), at times (N,) s; `frequency` in rad/s.

    Examples
    --------
    >>> phasor_series(1j, 1.0, np.array([0.0])).tolist()
    [0.0]
    """
    turning: ComplexArray = phasor * np.exp(1j * frequency * time)
    return np.asarray(turning.real)
