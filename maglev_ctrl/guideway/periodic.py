"""Periodic guideways: passing frequency, stiffness modulation, and the speeds at which it can resonate."""

from __future__ import annotations

from dataclasses import dataclass
from math import gcd, pi
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from maglev_ctrl.arrays import FloatArray, read_only

ResonanceKind = Literal["parametric", "sum", "difference"]


def passing_frequency(speed: ArrayLike, wavelength: float) -> FloatArray:
    """2 pi |v| / p in rad/s: how often the guideway's period p passes under the vehicle.

    Parameters
    ----------
    speed : (...) m/s
    wavelength : p, m

    Raises
    ------
    ValueError : a wavelength that is not positive

    Examples
    --------
    >>> round(float(passing_frequency(100.0, 25.0)) / (2 * pi), 12)     # Hz
    4.0
    """
    _require_wavelength(wavelength)
    return np.asarray(2.0 * pi * np.abs(np.asarray(speed, dtype=np.float64)) / wavelength)


@dataclass(frozen=True, eq=False, slots=True)
class Modulation:
    """Periodic change of the magnetic stiffness along the guideway: spans, joints, coil pitch.

    The stiffness at a point x along the track is K [1 + depth * sum_h harmonics[h-1] cos(2 pi h x / wavelength)].

    Parameters
    ----------
    wavelength : period along the track, m
    depth : modulation as a fraction of the magnetic stiffness, not negative
    harmonics : relative amplitudes of the harmonics 1, 2, ...; at least one is not zero
    name : what it is, for tables and figures
    source : where the numbers come from

    Raises
    ------
    ValueError : a wavelength that is not positive, a negative depth, or no harmonic

    Examples
    --------
    >>> spans = Modulation(wavelength=25.0, depth=0.05)
    >>> round(float(spans.frequency(100.0)), 6), [round(v, 6) for v in spans.at([0.0, 12.5]).tolist()]
    (25.132741, [1.05, 0.95])
    """

    wavelength: float
    depth: float
    harmonics: tuple[float, ...] = (1.0,)
    name: str = "guideway"
    source: str = ""

    def __post_init__(self) -> None:
        _require_wavelength(self.wavelength)
        if not (np.isfinite(self.depth) and self.depth >= 0.0):
            raise ValueError(f"depth: expected a fraction that is not negative, got {self.depth}")
        amplitudes = tuple(float(part) for part in self.harmonics)
        if not np.all(np.isfinite(amplitudes)) or not any(amplitudes):
            raise ValueError(f"harmonics: expected at least one amplitude that is not zero, got {self.harmonics}")
        object.__setattr__(self, "harmonics", amplitudes)

    def frequency(self, speed: ArrayLike) -> FloatArray:
        """Passing frequency of the fundamental at a speed (...) m/s, rad/s."""
        return passing_frequency(speed, self.wavelength)

    def at(self, position: ArrayLike) -> FloatArray:
        """Stiffness over its mean at positions (...) m along the track."""
        x = np.asarray(position, dtype=np.float64)[..., None]
        order = np.arange(1, len(self.harmonics) + 1)
        wave = np.cos(2.0 * pi * order * x / self.wavelength) @ np.asarray(self.harmonics)
        return np.asarray(1.0 + self.depth * wave)


@dataclass(frozen=True, eq=False, slots=True)
class ResonanceSpeed:
    """A speed at which the modulation can feed a mode, or a pair of modes.

    `modes` are indices (i, j), i <= j, into the frequencies given; equal for a parametric resonance. `order` is k.
    """

    speed: float
    kind: ResonanceKind
    modes: tuple[int, int]
    order: int


def resonance_speeds(
    frequencies: ArrayLike, wavelength: float, *, orders: int = 1, upper: float = np.inf
) -> tuple[ResonanceSpeed, ...]:
    """Speeds p (w_i +- w_j) / (2 pi k), slowest first: 2 w_i / k parametric, w_i + w_j sum, |w_i - w_j| difference.

    These are the frequencies of the paper's combination resonance with its slip mended (frequency, not period). Which
    kind really grows depends on the coupling: sum needs d_ij d_ji > 0, difference d_ij d_ji < 0.

    Parameters
    ----------
    frequencies : (m,) natural frequencies, rad/s, not negative
    wavelength : p, m
    orders : k runs from 1 to this
    upper : speeds above this (m/s) are left out

    Raises
    ------
    ValueError : wrong shape, negative frequencies, no order, or a wavelength that is not positive

    Examples
    --------
    >>> [(round(r.speed, 3), r.kind) for r in resonance_speeds([2 * pi, 6 * pi], 10.0)]
    [(20.0, 'parametric'), (20.0, 'difference'), (40.0, 'sum'), (60.0, 'parametric')]
    """
    _require_wavelength(wavelength)
    omega = read_only(frequencies, name="frequencies")
    if omega.ndim != 1 or np.any(omega < 0.0):
        raise ValueError(f"frequencies: expected (m,) frequencies in rad/s that are not negative, got {omega.tolist()}")
    if orders < 1:
        raise ValueError(f"orders: expected at least 1, got {orders}")
    found = [
        ResonanceSpeed(speed=float(wavelength * total / (2.0 * pi * k)), kind=kind, modes=modes, order=k)
        for total, kind, modes in _combinations(omega)
        for k in range(1, orders + 1)
    ]
    return tuple(sorted((one for one in found if 0.0 < one.speed <= upper), key=lambda one: one.speed))


def _combinations(omega: FloatArray) -> list[tuple[float, ResonanceKind, tuple[int, int]]]:
    found: list[tuple[float, ResonanceKind, tuple[int, int]]] = []
    for i, first in enumerate(omega.tolist()):
        found.append((2.0 * first, "parametric", (i, i)))
        for j in range(i + 1, omega.size):
            second = float(omega[j])
            found.append((first + second, "sum", (i, j)))
            found.append((abs(first - second), "difference", (i, j)))
    return found


@dataclass(frozen=True, slots=True)
class CommonPeriod:
    """A length that holds a whole number of two wavelengths: `cycles` (first, second) of them in `wavelength`, m.

    Harmonic h of the first wavelength is harmonic h cycles[0] of the common one, and so for the second. `mismatch`:
    how far the ratio of the wavelengths is from the ratio of whole numbers, relative.
    """

    wavelength: float
    cycles: tuple[int, int]
    mismatch: float


def common_period(first: float, second: float, *, largest: int = 12, tolerance: float = 1e-6) -> CommonPeriod:
    """The common period of two wavelengths of a guideway, where their ratio is one of small whole numbers.

    Floquet theory needs one period. Where two have none in common the motion is quasi-periodic, and rounding their
    ratio would put tongues where there are none.

    Parameters
    ----------
    first, second : m
    largest : largest whole number allowed, either side of the ratio
    tolerance : relative mismatch allowed

    Raises
    ------
    ValueError : a wavelength that is not positive, or a ratio that is not one of small whole numbers

    Examples
    --------
    >>> common_period(25.0, 10.0)
    CommonPeriod(wavelength=50.0, cycles=(2, 5), mismatch=0.0)
    """
    _require_wavelength(first)
    _require_wavelength(second)
    if largest < 1 or not 0.0 <= tolerance < 1.0:
        raise ValueError(f"largest, tolerance: expected at least 1 and a fraction, got {largest} and {tolerance}")
    candidates = [(m, n) for m in range(1, largest + 1) for n in range(1, largest + 1) if gcd(m, n) == 1]
    m, n = min(candidates, key=lambda pair: abs(pair[0] * first / (pair[1] * second) - 1.0))
    mismatch = abs(m * first / (n * second) - 1.0)
    if mismatch > tolerance:
        slower = max(first, second)
        raise ValueError(
            f"wavelengths {first:g} m and {second:g} m have no common period: their ratio {first / second:.9g} is not "
            f"one of whole numbers up to {largest} within {tolerance:g} (nearest {n}/{m}, off by {mismatch:.2g}); "
            f"treat the slower one ({slower:g} m, the lower passing frequency) alone"
        )
    return CommonPeriod(0.5 * (m * first + n * second), (m, n), mismatch)


def _require_wavelength(wavelength: float) -> None:
    if not (np.isfinite(wavelength) and wavelength > 0.0):
        raise ValueError(f"wavelength: expected a positive length in m, got {wavelength}")
