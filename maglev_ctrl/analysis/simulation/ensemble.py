"""Root mean squares of many runs with their confidence bands."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy import special

from maglev_ctrl.arrays import FloatArray, read_only_any
from maglev_ctrl.errors import Agreement

DISAGREEMENT = 2.0
"""Widths of the two bands may differ by this factor before they count as telling different things."""


@dataclass(frozen=True, eq=False, slots=True)
class EnsembleRms:
    """The root mean square over all runs and times, with two bands at one confidence.

    `scatter_band` from the runs' mean squares (Student t, runs - 1 degrees of freedom), `band` from the samples'
    autocorrelation (chi-square with `freedom` degrees). They rest on different assumptions: independent runs, and
    Gaussian stationary signals; `agreement` says whether their widths agree. `each` (r,) is that of every run.
    """

    rms: float
    band: tuple[float, float]
    scatter_band: tuple[float, float]
    freedom: float
    each: FloatArray
    confidence: float
    agreement: Agreement
    reason: str


def ensemble_rms(
    values: ArrayLike, *, discard: float = 0.0, confidence: float = 0.95, about_mean: bool = False
) -> EnsembleRms:
    """Root mean square of a signal over runs, with confidence bands.

    A sum of squares of a Gaussian signal with autocorrelation rho_k has as many degrees of freedom as
    N / (1 + 2 sum rho_k^2) independent samples (Bendat and Piersol, Random Data, Sec. 8.3); rho is averaged over the
    runs, and summed up to a third of a run's length, with what noise adds to a square taken off.

    Parameters
    ----------
    values : (r, s) at equal intervals; runs with NaN (ended early) are refused
    discard : share of each run left out at its start
    about_mean : take the mean over all runs and times off first

    Raises
    ------
    ValueError : fewer than two runs, a run that ended early, a share or confidence out of range

    Examples
    --------
    >>> found = ensemble_rms(np.random.default_rng(1).standard_normal((30, 400)))
    >>> found.band[0] < 1.0 < found.band[1], found.agreement.value
    (True, 'AGREED')
    """
    given = np.asarray(values, dtype=np.float64)
    if given.ndim != 2 or given.shape[0] < 2 or given.shape[1] < 4:
        raise ValueError(f"values: expected at least two runs of at least four samples, (r, s), got {given.shape}")
    if not 0.0 <= discard < 1.0 or not 0.0 < confidence < 1.0:
        raise ValueError(f"discard, confidence: expected shares of one, got {discard} and {confidence}")
    kept = given[:, int(discard * given.shape[1]) :]
    if not np.all(np.isfinite(kept)):
        early = np.flatnonzero(~np.all(np.isfinite(kept), axis=1))
        raise ValueError(f"values: expected whole runs; run {early[0]} ended early ({len(early)} of {len(kept)} did)")
    if about_mean:
        kept = kept - np.mean(kept)
    squares = np.mean(kept**2, axis=1)
    mean, runs = float(np.mean(squares)), len(squares)
    if mean == 0.0:
        still = read_only_any(np.zeros(runs))
        return EnsembleRms(0.0, (0.0, 0.0), (0.0, 0.0), np.inf, still, confidence, Agreement.AGREED, "")
    tail = 0.5 * (1.0 - confidence)
    freedom = max(runs * kept.shape[1] / _correlated(kept), 1.0)
    low, high = (0.5 * freedom / float(special.gammaincinv(0.5 * freedom, q)) for q in (1.0 - tail, tail))
    wide = float(special.stdtrit(runs - 1, 1.0 - tail)) * float(np.std(squares, ddof=1)) / np.sqrt(runs)
    band = (float(np.sqrt(mean * low)), float(np.sqrt(mean * high)))
    scatter = (float(np.sqrt(max(mean - wide, 0.0))), float(np.sqrt(mean + wide)))
    ratio = (scatter[1] - scatter[0]) / (band[1] - band[0])
    same = 1.0 / DISAGREEMENT <= ratio <= DISAGREEMENT
    return EnsembleRms(
        rms=float(np.sqrt(mean)),
        band=band,
        scatter_band=scatter,
        freedom=freedom,
        each=read_only_any(np.sqrt(squares)),
        confidence=confidence,
        agreement=Agreement.AGREED if same else Agreement.UNRESOLVED,
        reason="" if same else f"the runs scatter {ratio:.3g} times as much as their autocorrelation explains",
    )


def _correlated(kept: FloatArray) -> float:
    """1 + 2 sum rho_k^2: samples that count as one."""
    runs, count = kept.shape
    padded = np.fft.rfft(kept, 2 * count, axis=1)
    covariance = np.mean(np.fft.irfft(np.abs(padded) ** 2, axis=1)[:, :count], axis=0)
    rho = covariance / covariance[0] * count / (count - np.arange(count))
    lags = max(count // 3, 1)
    # A correlation of nothing scatters by 1 / (number of products): its square is that much too large on average.
    noise = 1.0 / (runs * (count - np.arange(1, lags + 1)))
    return float(max(1.0 + 2.0 * np.sum(rho[1 : lags + 1] ** 2 - noise), 1.0))
