"""Margins of a stable loop read off a frequency grid: estimates for searches, not proofs (`margins` has those).

The grid has every closed-loop resonance in it, at the resonance's own width, so that peaks and crossings fall between
neighbours that are close together; they are then interpolated. Delays are exact.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from maglev_ctrl.analysis.loops import Loop, sensitivity_at
from maglev_ctrl.arrays import ComplexArray, FloatArray

LARGEST_DISK = 2.0
"""A balanced disk of this size lets every gain from 0 to infinity through; larger ones tell nothing more."""
_BASE = 120
_CLUSTER = np.array([-6.0, -3.5, -2.2, -1.5, -1.0, -0.6, -0.3, 0.0, 0.3, 0.6, 1.0, 1.5, 2.2, 3.5, 6.0])
"""Places about a resonance, in its half widths."""


@dataclass(frozen=True, slots=True)
class MarginEstimates:
    """The smallest margins of a loop, over channels one at a time; `disk` over all channels at once too.

    gain : dB, up or down; phase : rad; delay : s; disk : balanced disk margin, at most 2; sensitivity_peak : largest
    |S| of one channel. Infinite where nothing is crossed.
    """

    gain: float
    phase: float
    delay: float
    disk: float
    sensitivity_peak: float


def margin_estimates(loop: Loop, poles: ComplexArray) -> MarginEstimates:
    """Margins of a stable loop, to about two per cent where they are small enough to matter (gains below 30 dB).

    Parameters
    ----------
    loop : return ratio in continuous time, negative feedback
    poles : (n,) poles of the closed loop, all stable; the grid is made for them. Approximate poles will do

    Raises
    ------
    ValueError : a sampled loop, or a pole that is not stable

    Examples
    --------
    >>> loop = Loop.from_transfer_function([25.0], [1.0, 10.0, 10.0, 10.0])
    >>> found = margin_estimates(loop, np.roots([1.0, 10.0, 10.0, 35.0]))
    >>> round(10.0 ** (found.gain / 20.0), 1), round(float(np.degrees(found.phase))), round(found.disk, 2)
    (3.6, 29, 0.46)
    """
    if loop.dt is not None:
        raise ValueError(f"loop: expected continuous time, got a sampling period of {loop.dt} s")
    if not np.all(poles.real < 0.0):
        raise ValueError("poles: expected stable poles; margins of an unstable loop mean nothing")
    frequency = _grid(poles, loop.delays)
    S = sensitivity_at(loop, np.asarray(1j * frequency, dtype=np.complex128))
    single = np.diagonal(S, axis1=1, axis2=2)
    gain = phase = delay = np.inf
    for i in range(single.shape[1]):
        gain = min(gain, _gain_margin(single[:, i]))
        one, later = _phase_margins(single[:, i], frequency)
        phase, delay = min(phase, one), min(delay, later)
    half = 0.5 * np.eye(S.shape[-1])
    size = max(_peak(_structured(S - half)), float(np.max(_peaks(np.abs(single - 0.5)))))
    disk = min(1.0 / size, LARGEST_DISK) if size > 0.0 else LARGEST_DISK
    return MarginEstimates(gain, phase, delay, disk, float(np.max(_peaks(np.abs(single)))))


def _grid(poles: ComplexArray, delays: FloatArray) -> FloatArray:
    """Frequencies, rad/s: from far below the slowest to far above the fastest pole, and about every resonance."""
    modulus = np.abs(poles)
    modulus = modulus[modulus > 1e-9 * np.max(modulus, initial=1.0)]
    low, high = (0.05 * float(np.min(modulus)), 20.0 * float(np.max(modulus))) if modulus.size else (1e-2, 1e2)
    low = max(low, 1e-6 * high)
    base = np.geomspace(low, high, _BASE)
    pairs = poles[poles.imag > 0.0]
    clusters = (pairs.imag[:, None] - pairs.real[:, None] * _CLUSTER).ravel()
    everything = np.unique(np.concatenate([base, clusters]))
    longest = float(np.max(delays, initial=0.0))
    if longest > 0.0:  # a turn of the delay must not fall between two points
        turns = np.arange(0.3, min(high * longest, 40.0), 0.3) / longest
        everything = np.unique(np.concatenate([everything, turns]))
    return np.asarray(everything[(everything >= low) & (everything <= high)])


def _gain_margin(S: ComplexArray) -> float:
    """dB: the factor f = S / (S - 1) nearest to one that brings a pole to the axis; ends of the grid included."""
    crossing = np.flatnonzero(np.signbit(S.imag[1:]) != np.signbit(S.imag[:-1]))
    rise = S.imag[crossing + 1] - S.imag[crossing]
    share = np.divide(-S.imag[crossing], rise, out=np.zeros(crossing.size), where=rise != 0.0)
    real = np.concatenate([S.real[crossing] + share * (S.real[crossing + 1] - S.real[crossing]), S.real[[0, -1]]])
    away = np.abs(real - 1.0) > 1e-6
    factors = real[away] / (real[away] - 1.0)
    factors = factors[factors > 1e-9]
    return float(np.min(np.abs(20.0 * np.log10(factors)), initial=np.inf))


def _phase_margins(S: ComplexArray, frequency: FloatArray) -> tuple[float, float]:
    """Smallest phase (rad, lag or lead) and delay (s) at the frequencies where |L| = |1 - S| / |S| is one."""
    level = np.abs(1.0 - S) - np.abs(S)
    k = np.flatnonzero(np.signbit(level[1:]) != np.signbit(level[:-1]))
    if not k.size:
        return np.inf, np.inf
    share = level[k] / (level[k] - level[k + 1])
    at = S[k] + share * (S[k + 1] - S[k])
    where = frequency[k] + share * (frequency[k + 1] - frequency[k])
    lag = np.mod(np.angle(-(1.0 - at) / at), 2.0 * np.pi)
    return float(np.min(np.minimum(lag, 2.0 * np.pi - lag))), float(np.min(lag / where))


def _structured(N: ComplexArray) -> FloatArray:
    """Upper bound of mu over frequency, (F,): the largest singular value after scaling rows and columns even.

    For two channels it is mu itself: scaling leaves the determinant, so the largest singular value is least where the
    sum of squares is.
    """
    size = np.abs(N)
    m = N.shape[-1]
    if m == 1:
        return np.asarray(size[:, 0, 0])
    scale = np.ones((len(N), m))
    for _ in range(1 if m == 2 else 12):
        for i in range(m):
            scaled = size * scale[:, :, None] / scale[:, None, :]
            others = [j for j in range(m) if j != i]
            row, column = (np.sqrt(np.sum(x**2, axis=1)) for x in (scaled[:, i, others], scaled[:, others, i]))
            usable = (row > 0.0) & (column > 0.0)
            scale[usable, i] *= np.sqrt(column[usable] / row[usable])
    return np.asarray(np.linalg.norm(N * scale[:, :, None] / scale[:, None, :], 2, axis=(1, 2)))


def _peaks(values: FloatArray) -> FloatArray:
    return np.array([_peak(column) for column in values.T])


def _peak(values: FloatArray) -> float:
    """Largest value of a curve, with a parabola through the largest sample and its neighbours."""
    k = int(np.argmax(values))
    top = float(values[k])
    if not 0 < k < len(values) - 1:
        return top
    before, after = float(values[k - 1]), float(values[k + 1])
    bend = before - 2.0 * top + after
    lift = -((after - before) ** 2) / (8.0 * bend) if bend < 0.0 else 0.0
    return top + min(lift, 0.02 * top)
