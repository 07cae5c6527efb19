"""Second moments by two methods, with what could not be settled told."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from maglev_ctrl.analysis.response.channels import Process, RideChannel
from maglev_ctrl.analysis.response.covariance import Covariances, covariances, modal_residues
from maglev_ctrl.analysis.response.frequency import (
    TOLERANCE,
    ZERO,
    frequency_covariances,
    response_edges,
    spectral_density,
)
from maglev_ctrl.analysis.response.sources import Observed
from maglev_ctrl.arrays import FloatArray, read_only_any
from maglev_ctrl.errors import Agreement

SAME = 1e-6
"""Two methods agree where standard deviations differ by less than this share."""


@dataclass(frozen=True, eq=False, slots=True)
class Moments:
    """Standard deviations of N signals and of their rates, (N,), and covariances of P pairs.

    What does not exist, or is not settled by both methods, is NaN; `reasons` and `rate_reasons` (N,) say why. `exact`
    and `integral` (N,) are what either method gives (NaN: not asked), `difference` (N,) relative. A signal in which
    everything cancels but for rounding has the deviation 0.
    """

    names: tuple[str, ...]
    deviations: FloatArray
    rates: FloatArray
    pairs: FloatArray
    exact: FloatArray
    integral: FloatArray
    difference: FloatArray
    settled: tuple[bool, ...]
    reasons: tuple[str, ...]
    rate_reasons: tuple[str, ...]

    def agreement(self, *indices: int) -> Agreement:
        """Whether both methods agree on signals."""
        return Agreement.AGREED if all(self.settled[i] for i in indices) else Agreement.UNRESOLVED


def moments(
    channel: RideChannel,
    processes: Sequence[Process],
    observed: Sequence[Observed],
    *,
    pairs: Sequence[tuple[int, int]] = (),
    band: tuple[float, float] | None = None,
    verified: bool = True,
) -> Moments:
    """Standard deviations of outputs and their rates, and covariances of pairs, by the exact way and over frequency.

    Over a band the two methods are partial fractions on Gauss points and solved responses on Kronrod pieces.

    Parameters
    ----------
    pairs : (P,) indices into `observed`
    band : Hz; only this part of the roughness and noise counts
    verified : False leaves the second method out; then nothing is settled

    Raises
    ------
    ValueError : an unknown output or guideway input, or a band that is not increasing

    Examples
    --------
    >>> from maglev_ctrl.analysis.response.channels import Signal, ride_channel, track_processes
    >>> from maglev_ctrl.guideway.correlation import track_inputs
    >>> from maglev_ctrl.guideway.shaping import shaping_filter
    >>> from maglev_ctrl.guideway.spectra import inverse_square
    >>> from maglev_ctrl.systems import SecondOrderSystem
    >>> cart = SecondOrderSystem.from_matrices([[2.0]], [[0.8]], [[8.0]], guideway=("heave@leg",), K_w=[[8.0]],
    ...     C_w=[[0.8]], outputs=("gap",), H_q=[[1.0]], H_w=[[-1.0]])
    >>> rough = shaping_filter(inverse_square(1e-6), speed=100.0)
    >>> track = track_processes(track_inputs(["heave@leg"], [[0.0, 0.0]], speed=100.0), vertical=rough)
    >>> found = moments(ride_channel(cart, None, [Signal.of("gap")]), track, [Observed("gap")])
    >>> found.settled, found.rate_reasons
    ((True,), ('infinite variance of the rate: high frequency',))
    """
    wanted, joined = tuple(observed), tuple(pairs)
    if band is not None:
        return _over_band(channel, processes, wanted, joined, band=band, verified=verified)
    exact = covariances(channel, processes, wanted)
    finite = [not end for end in exact.ends]
    finite_rates = [not end for end in exact.rate_ends]
    both = [finite[i] and finite[j] for i, j in joined]
    given = np.array([exact.covariance[i, j] for i, j in joined])
    count = len(wanted)
    reasons = tuple(f"infinite variance: {end}" if end else "" for end in exact.ends)
    rate_reasons = tuple(f"infinite variance of the rate: {end}" if end else "" for end in exact.rate_ends)
    if not verified:
        told = tuple(reason or "one method only" for reason in reasons)
        return Moments(
            exact.names, _roots(exact.variances, finite), _roots(exact.rates, finite_rates), read_only_any(given),
            _roots(exact.variances, finite), _nothing(count), _nothing(count), (False,) * count, told, rate_reasons,
        )  # fmt: skip
    integral = frequency_covariances(
        channel, processes, wanted, finite=finite, finite_rates=finite_rates,
        pairs=[pair for pair, fits in zip(joined, both, strict=True) if fits],
    )  # fmt: skip
    crossed = np.full(len(joined), np.nan)
    crossed[both] = integral.pairs
    confirmed = _confirmed(channel, processes, wanted, exact)
    return _compared(
        exact.names, (exact.variances, exact.rates, given), (integral.variances, integral.rates, crossed),
        joined, reasons, rate_reasons, finite, finite_rates, confirmed, integral.scales,
    )  # fmt: skip


def _compared(
    names: tuple[str, ...],
    first: tuple[FloatArray, FloatArray, FloatArray],
    second: tuple[FloatArray, FloatArray, FloatArray],
    pairs: tuple[tuple[int, int], ...],
    reasons: tuple[str, ...],
    rate_reasons: tuple[str, ...],
    finite: list[bool],
    finite_rates: list[bool],
    confirmed: list[bool],
    scales: FloatArray,
) -> Moments:
    count = len(names)
    values = [_roots(first[0], finite), _roots(second[0], finite)]
    speeds = [_roots(first[1], finite_rates), _roots(second[1], finite_rates)]
    still = np.array([finite[i] and max(values[0][i], values[1][i]) <= ZERO * scales[i] for i in range(count)])
    values, speeds = (
        [read_only_any(np.where(still & np.isfinite(v), 0.0, v)) for v in two] for two in (values, speeds)
    )
    difference, off = _difference(*values), _difference(*speeds)
    settled = [confirmed[i] if not finite[i] else bool(difference[i] <= SAME) for i in range(count)]
    told, told_rates = list(reasons), list(rate_reasons)
    deviations, rates = np.array(values[0]), np.array(speeds[0])
    for i in range(count):
        if finite[i] and not settled[i]:
            told[i] = f"two methods differ: {values[0][i]:.9g} and {values[1][i]:.9g}"
            deviations[i] = np.nan
        if not finite[i] and not confirmed[i]:
            told[i] += " (not confirmed over frequency)"
        if finite_rates[i] and not off[i] <= SAME:
            told_rates[i] = f"two methods differ in the rate: {speeds[0][i]:.9g} and {speeds[1][i]:.9g}"
            rates[i] = np.nan
    crossed = np.array(first[2])
    for k, (i, j) in enumerate(pairs):
        scale = values[0][i] * values[0][j]
        if scale == 0.0:
            crossed[k] = 0.0
        elif not abs(first[2][k] - second[2][k]) <= SAME * scale:
            crossed[k] = np.nan
    return Moments(
        names, read_only_any(deviations), read_only_any(rates), read_only_any(crossed), values[0], values[1],
        difference, tuple(settled), tuple(told), tuple(told_rates),
    )  # fmt: skip


def _confirmed(
    channel: RideChannel, processes: Sequence[Process], wanted: tuple[Observed, ...], exact: Covariances
) -> list[bool]:
    """Whether the density itself, far out at the end told, falls too slowly for a variance."""
    found = [not end for end in exact.ends]
    open_ones = [i for i, end in enumerate(exact.ends) if end]
    if not open_ones:
        return found
    edges = response_edges(channel, processes, wanted)
    low, high = edges[0], edges[1]
    points = np.array([1e-3 * low, 1e-2 * low, 1e4 * high, 1e5 * high]) / (2.0 * np.pi)
    density = spectral_density(channel, processes, [wanted[i] for i in open_ones], points)
    with np.errstate(divide="ignore", invalid="ignore"):
        slope = np.log10(density[:, 1::2] / density[:, ::2])
    for row, i in enumerate(open_ones):
        found[i] = bool(slope[row, 0] < -0.9 if exact.ends[i].startswith("low") else slope[row, 1] > -1.1)
    return found


def _over_band(
    channel: RideChannel,
    processes: Sequence[Process],
    wanted: tuple[Observed, ...],
    pairs: tuple[tuple[int, int], ...],
    *,
    band: tuple[float, float],
    verified: bool,
) -> Moments:
    count = len(wanted)
    integral = frequency_covariances(
        channel,
        processes,
        wanted,
        pairs=pairs,
        band=band,
        quick=not verified,
        tolerance=TOLERANCE if verified else 1e-6,
    )
    everything = [True] * count
    names = tuple(one.name for one in wanted)
    if not verified:
        deviations = _roots(integral.variances, everything)
        return Moments(
            names, deviations, _roots(integral.rates, everything), integral.pairs, _nothing(count), deviations,
            _nothing(count), (False,) * count, ("one method only",) * count, ("",) * count,
        )  # fmt: skip
    modal = _modal_band(channel, processes, wanted, pairs, band)
    blank = ("",) * count
    return _compared(
        names, modal, (integral.variances, integral.rates, integral.pairs), pairs, blank, blank,
        everything, everything, everything, integral.scales,
    )  # fmt: skip


def _modal_band(
    channel: RideChannel,
    processes: Sequence[Process],
    wanted: tuple[Observed, ...],
    pairs: tuple[tuple[int, int], ...],
    band: tuple[float, float],
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Partial fractions on Gauss points of the same pieces, halved until the sums stand."""
    parts = modal_residues(channel, processes, wanted)
    edges = response_edges(channel, processes, wanted, band=band)
    points, weights = np.polynomial.legendre.leggauss(16)
    first, second = (np.array([pair[k] for pair in pairs], dtype=int) for k in range(2))
    last: tuple[FloatArray, FloatArray, FloatArray] | None = None
    for _ in range(6):
        half = 0.5 * np.diff(edges)
        omega = (0.5 * (edges[1:] + edges[:-1])[:, None] + half[:, None] * points).ravel()
        weight = (half[:, None] * weights).ravel() / np.pi
        total = np.zeros(len(wanted)), np.zeros(len(wanted)), np.zeros(len(pairs))
        for part in parts:
            for start in range(0, len(omega), 2000):
                here = slice(start, start + 2000)
                answer = part.at(np.asarray(1j * omega[here]))
                power = np.abs(answer) ** 2
                total[0][:] += weight[here] @ power
                total[1][:] += (weight[here] * omega[here] ** 2) @ power
                total[2][:] += weight[here] @ np.real(answer[:, first] * answer[:, second].conj())
        if last is not None and all(
            np.all(np.abs(a - b) <= 1e-8 * np.abs(a)) for a, b in zip(total[:2], last[:2], strict=True)
        ):
            return total
        last = total
        edges = np.sort(np.concatenate([edges, 0.5 * (edges[1:] + edges[:-1])]))
    return total


def _roots(values: FloatArray, finite: list[bool]) -> FloatArray:
    kept = np.where(finite, values, np.nan)
    return read_only_any(np.sqrt(np.maximum(kept, 0.0)))


def _nothing(count: int) -> FloatArray:
    return read_only_any(np.full(count, np.nan))


def _difference(first: FloatArray, second: FloatArray) -> FloatArray:
    larger = np.maximum(np.abs(first), np.abs(second))
    with np.errstate(invalid="ignore"):
        return read_only_any(
            np.where(larger == 0.0, 0.0, np.abs(first - second) / np.where(larger == 0.0, 1.0, larger))
        )
