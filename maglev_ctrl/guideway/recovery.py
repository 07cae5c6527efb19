"""Whether a profile has the density it is said to have: Welch's estimate with its confidence band."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import welch
from scipy.signal.windows import hann
from scipy.special import chdtri

from maglev_ctrl.arrays import FloatArray, read_only, read_only_any
from maglev_ctrl.guideway.profile import Profile
from maglev_ctrl.guideway.realisation import band_limits, waves
from maglev_ctrl.guideway.spectra import Roughness

_APART = 3  # bins whose estimates are independent under a Hann window


@dataclass(frozen=True, eq=False, slots=True)
class Recovery:
    """A profile's density by Welch's method beside the one it should have.

    Parameters
    ----------
    wavenumber : (b,) rad/m; bins three apart, whose estimates are independent
    density : (b,) estimated one-sided density, m^2/(rad/m)
    expected : (b,) what the estimate is on average: the roughness as the window smears it
    lower, upper : (b,) the confidence band about the estimate, by chi squared
    degrees_of_freedom : of every estimate
    confidence : of the band; the share of `inside` is near it if the profile has the roughness
    inside : (b,) whether `expected` lies in the band
    """

    wavenumber: FloatArray
    density: FloatArray
    expected: FloatArray
    lower: FloatArray
    upper: FloatArray
    degrees_of_freedom: float
    confidence: float
    inside: NDArray[np.bool_]

    @property
    def share_inside(self) -> float:
        """Share of the bins whose confidence band holds what is expected."""
        return float(np.mean(self.inside))


def recovered(
    profile: Profile,
    roughness: Roughness,
    *,
    segment: float,
    band: tuple[float, float] | None = None,
    confidence: float = 0.95,
) -> Recovery:
    """Whether an evenly sampled profile has a roughness: Welch's density with its chi-squared confidence band.

    Segments overlap by half under a Hann window. With K of them the estimate has nu = 2 K / (1 + 2 sum over m of
    (1 - m / K) r_m) degrees of freedom, r_m the squared correlation of the window with itself m hops on (1/36 at the
    first, 0 beyond). A steep density leaks through any window, so the estimate is held against its own mean, the
    density folded with the window, and not against the density itself.

    Parameters
    ----------
    profile : evenly sampled; its mean is taken as zero
    roughness : what it should have; a sample with "fixed" amplitudes scatters less than chi squared tells
    segment : length of a segment, m, at most half the profile
    band : the wave numbers that the profile holds, as told to `realisation`; only bins inside it are judged
    confidence : between 0 and 1

    Raises
    ------
    ValueError : a segment too long or too short, positions unevenly spaced, a confidence outside (0, 1), a band without
        bins

    Examples
    --------
    >>> from maglev_ctrl.guideway.realisation import realisation
    >>> from maglev_ctrl.guideway.spectra import inverse_square
    >>> track = realisation(inverse_square(), length=20000.0, step=0.5, seed=3)
    >>> seen = recovered(track, inverse_square(), segment=500.0)
    >>> round(seen.degrees_of_freedom, 1), seen.share_inside > 0.9
    (149.8, True)
    """
    if not 0.0 < confidence < 1.0:
        raise ValueError(f"confidence: expected a share between 0 and 1, got {confidence}")
    step, samples = profile.step, profile.heights[:-1]
    size = 2 * round(0.5 * segment / step)
    if not 16 <= size <= samples.size // 2:
        raise ValueError(
            f"segment: expected from {16 * step:g} m (16 steps) to {0.5 * samples.size * step:g} m (half the profile), "
            f"got {segment:g}"
        )
    window, hop = np.asarray(hann(size, sym=False), dtype=np.float64), size // 2
    _, estimate = welch(samples, fs=2.0 * np.pi / step, window="hann", nperseg=size, noverlap=size - hop, detrend=False)
    expected = _through_window(roughness, profile.length, step, band, window)
    wavenumber = 2.0 * np.pi * np.arange(estimate.size) / (size * step)
    low, high = band_limits(profile.length, step, band)
    # The lowest and the highest bins fold onto their own images at negative wave numbers.
    edge = _APART * 2.0 * np.pi / (size * step)
    judged = (wavenumber >= max(low, edge)) & (wavenumber <= min(high, np.pi / step - edge))
    chosen = np.flatnonzero(judged)[::_APART]
    if not chosen.size:
        raise ValueError(f"band: expected bins between {low:g} and {high:g} rad/m, got none; take a longer segment")
    degrees = _degrees_of_freedom(window, hop, segments=(samples.size - size) // hop + 1)
    lower, upper = (
        degrees * estimate[chosen] / float(chdtri(degrees, 0.5 - 0.5 * side * confidence)) for side in (1.0, -1.0)
    )
    mean = expected[chosen]
    return Recovery(
        read_only(wavenumber[chosen], name="wavenumber"),
        density=read_only(estimate[chosen], name="density"),
        expected=read_only(mean, name="expected"),
        lower=read_only(lower, name="lower"),
        upper=read_only(upper, name="upper"),
        degrees_of_freedom=degrees,
        confidence=confidence,
        inside=read_only_any((mean >= lower) & (mean <= upper)),
    )


def _through_window(
    roughness: Roughness, length: float, step: float, band: tuple[float, float] | None, window: FloatArray
) -> FloatArray:
    """Mean of Welch's estimate of a process with the density's lines: the covariance times that of the window."""
    count, size = round(length / step), window.size
    _, power = waves(roughness, length, step, band)
    line = np.zeros(count // 2 + 1)
    line[1 : power.size + 1] = power
    covariance = np.fft.irfft(0.5 * count * line, n=count)[:size]
    overlap = np.fft.irfft(np.abs(np.fft.rfft(window, n=2 * size)) ** 2, n=2 * size)[:size]
    product = covariance * overlap / np.sum(window**2)
    both = np.concatenate([product, [0.0], product[:0:-1]])
    # One-sided, over rad/m; every second bin of the doubled length is one of the estimate's.
    return np.asarray(2.0 * np.fft.rfft(both).real[::2] * step / (2.0 * np.pi))


def _degrees_of_freedom(window: FloatArray, hop: int, *, segments: int) -> float:
    power, total = float(window @ window), 0.0
    for m in range(1, min(segments, -(-window.size // hop))):
        shared = float(window[m * hop :] @ window[: window.size - m * hop]) / power
        total += (1.0 - m / segments) * shared**2
    return 2.0 * segments / (1.0 + 2.0 * total)
