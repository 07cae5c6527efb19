"""One seeded sample of a rough guideway."""

from __future__ import annotations

from typing import Literal

import numpy as np

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.guideway.profile import Profile
from maglev_ctrl.guideway.spectra import Roughness

Amplitudes = Literal["gaussian", "fixed"]
_LARGEST_LOST = 0.01  # of the variance, to waves shorter than two steps, where no band is named
_WHOLE = 1e-9


def realisation(
    roughness: Roughness,
    *,
    length: float,
    step: float,
    seed: int,
    band: tuple[float, float] | None = None,
    amplitudes: Amplitudes = "gaussian",
) -> Profile:
    """A sample of a roughness: waves of whole numbers in the length, with random phases and the density's amplitudes.

    Wave k of wave number W_k = 2 pi k / length has the mean square S(W_k) 2 pi / length. "gaussian" draws every
    amplitude too (Rayleigh), so that the sample is one of a Gaussian process; with "fixed" ones only the phases are
    drawn, and every sample has the same mean square. Its mean is zero, it repeats after its length, and between the
    samples it is the sum of the waves itself.

    Parameters
    ----------
    length : m, a whole number of steps
    step : m
    seed : not negative; the same seed gives the same sample
    band : lowest and highest wave number, rad/m; None: all that the length and the step hold

    Raises
    ------
    ValueError : a length that is not at least eight whole steps, a step too coarse (for the band; without one, if more
        than a hundredth of the variance stood in waves shorter than two steps), a band that holds no wave, or a seed
        that is negative

    Examples
    --------
    >>> from maglev_ctrl.guideway.spectra import inverse_square
    >>> track = realisation(inverse_square(), length=1000.0, step=0.5, seed=1, band=(0.05, 5.0), amplitudes="fixed")
    >>> expected = inverse_square().variance((0.05, 5.0))
    >>> bool(abs(np.mean(track.heights[:-1] ** 2) / expected - 1.0) < 0.1)
    True
    """
    count = _whole_steps(length, step)
    if seed < 0:
        raise ValueError(f"seed: expected a number that is not negative, got {seed}")
    if amplitudes not in ("gaussian", "fixed"):
        raise ValueError(f'amplitudes: expected "gaussian" or "fixed", got {amplitudes!r}')
    wavenumber, power = waves(roughness, length, step, band)
    random = np.random.default_rng(seed)
    # Drawn for every line, inside the band or not: a narrower band then leaves the waves it holds as they were.
    drawn = random.standard_normal(wavenumber.size) + 1j * random.standard_normal(wavenumber.size)
    drawn = drawn / np.sqrt(2.0) if amplitudes == "gaussian" else drawn / np.abs(drawn)
    line = np.zeros(count // 2 + 1, dtype=np.complex128)
    line[1 : wavenumber.size + 1] = count * np.sqrt(power / 2.0) * drawn
    heights = np.fft.irfft(line, n=count)
    return Profile(
        step * np.arange(count + 1, dtype=np.float64),
        np.append(heights, heights[0]),
        periodic=True,
        interpolation="band_limited",
        name=f"{roughness.name or 'roughness'}, seed {seed}",
        source=roughness.source,
    )


def band_limits(length: float, step: float, band: tuple[float, float] | None) -> tuple[float, float]:
    """Lowest and highest wave number (rad/m) of a sample: those of the band, or those that length and step (m) hold.

    Raises
    ------
    ValueError : a band that does not ascend, or a step too coarse for it

    Examples
    --------
    >>> [round(one, 6) for one in band_limits(np.pi, 0.01, None)], band_limits(100.0, 0.1, (1.0, 30.0))
    ([2.0, 314.159265], (1.0, 30.0))
    """
    shortest = np.pi / step
    if band is None:
        return 2.0 * np.pi / length, shortest
    low, high = band
    if not 0.0 <= low < high:
        raise ValueError(f"band: expected 0 <= lowest < highest in rad/m, got {low:g} and {high:g}")
    if high > shortest:
        raise ValueError(
            f"step: too coarse for waves up to {high:g} rad/m: expected at most {np.pi / high:g} m, got {step:g}"
        )
    return low, high


def waves(
    roughness: Roughness, length: float, step: float, band: tuple[float, float] | None
) -> tuple[FloatArray, FloatArray]:
    """The waves that a sample is made of: wave numbers 2 pi k / length (n,) rad/m and mean squares (n,) m^2.

    All wave numbers below pi / step, in order; those outside the band have no mean square.

    Raises
    ------
    ValueError : as `realisation`

    Examples
    --------
    >>> from maglev_ctrl.guideway.spectra import inverse_square
    >>> wavenumber, power = waves(inverse_square(1.0), 2 * np.pi, 0.25 * np.pi, (0.0, 2.0))
    >>> wavenumber.round(9).tolist(), power.round(9).tolist()
    ([1.0, 2.0, 3.0], [1.0, 0.25, 0.0])
    """
    low, high = band_limits(length, step, band)
    spacing = 2.0 * np.pi / length
    count = round(length / step)
    wavenumber = np.asarray(spacing * np.arange(1, (count - 1) // 2 + 1), dtype=np.float64)
    held = (wavenumber >= low * (1.0 - _WHOLE)) & (wavenumber <= high * (1.0 + _WHOLE))
    if not np.any(held):
        raise ValueError(f"band: expected it to hold a wave of {length:g} m / k, got {low:g} to {high:g} rad/m")
    if band is None:
        beyond, within = roughness.variance((high, np.inf)), roughness.variance((low, high))
        if beyond > _LARGEST_LOST * (beyond + within):
            raise ValueError(
                f"step: {step:g} m is too coarse: {beyond / (beyond + within):.1%} of the variance stands in waves "
                f"shorter than two steps; expected at most {_LARGEST_LOST:.0%}, or a band that ends below"
            )
    return wavenumber, np.where(held, roughness.density(wavenumber) * spacing, 0.0)


def _whole_steps(length: float, step: float) -> int:
    if not (np.isfinite(length) and np.isfinite(step) and 0.0 < step < length):
        raise ValueError(f"length, step: expected 0 < step < length in m, got {length} and {step}")
    count = round(length / step)
    if count < 8 or abs(count * step / length - 1.0) > _WHOLE:
        raise ValueError(f"length: expected a whole number of steps of {step:g} m, at least 8, got {length:g} m")
    return count
