"""Exact covariances under a random guideway: delayed inputs, weighted outputs, displacements without variance.

The response of every output to an impulse of the white noise behind a process is a sum of exponentials that changes at
every delay. Its energy, and that of its derivative, is the variance; Cauchy's matrix -1/(p_i + conj p_j) of the
exponents solves the Lyapunov equation of the modes. Where modes are too close to one another for that, `lyapunov`
gives the same from one Lyapunov equation and matrix exponentials.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from maglev_ctrl.analysis.response.channels import Process, RideChannel
from maglev_ctrl.analysis.response.lyapunov import covariance_by_lyapunov
from maglev_ctrl.analysis.response.sources import Observed, Source, observed_rows, sources
from maglev_ctrl.arrays import ComplexArray, FloatArray, read_only_any

EPS = float(np.finfo(float).eps)
LARGEST_ROUNDING = 1e-9
"""Share of a variance that rounding may take before the modes are left for the Lyapunov equation."""


@dataclass(frozen=True, eq=False, slots=True)
class Covariances:
    """Second moments of outputs: `covariance` (N, N), `rates` (N,) variances of their time derivatives.

    An infinite variance is inf and `ends`, `rate_ends` (N,) say "low frequency" or "high frequency"; covariances of
    such an output are NaN. `rounding` (N,) estimates the relative error; `by_modes` tells which way it was found.
    `shares` (processes, N) is what each process adds to the variances.
    """

    names: tuple[str, ...]
    covariance: FloatArray
    rates: FloatArray
    ends: tuple[str, ...]
    rate_ends: tuple[str, ...]
    rounding: FloatArray
    by_modes: bool
    shares: FloatArray
    processes: tuple[str, ...]

    @property
    def variances(self) -> FloatArray:
        """(N,) variances, inf where there is none."""
        return np.asarray(np.diag(self.covariance))


def covariances(
    channel: RideChannel,
    processes: Sequence[Process],
    observed: Sequence[Observed] | None = None,
    *,
    largest_rounding: float = LARGEST_ROUNDING,
) -> Covariances:
    """Exact covariances of outputs, weighted or not, of a stable channel under independent processes and noises.

    Parameters
    ----------
    observed : outputs with their weightings; every output as it is when left out
    largest_rounding : estimated relative error above which the Lyapunov equation is solved; 0 always does

    Raises
    ------
    ValueError : an unknown output or guideway input

    Examples
    --------
    A mass on a spring and damper over a guideway with white rate: E[(z - w)^2] = S (m / c) / 2 with E[w'w'] = S delta.

    >>> from maglev_ctrl.analysis.response.channels import Signal, ride_channel, track_processes
    >>> from maglev_ctrl.guideway.correlation import track_inputs
    >>> from maglev_ctrl.guideway.shaping import shaping_filter
    >>> from maglev_ctrl.guideway.spectra import inverse_square
    >>> from maglev_ctrl.systems import SecondOrderSystem
    >>> cart = SecondOrderSystem.from_matrices([[2.0]], [[0.8]], [[8.0]], guideway=("heave@leg",), K_w=[[8.0]],
    ...     C_w=[[0.8]], outputs=("gap", "place"), H_q=[[1.0], [1.0]], H_w=[[-1.0], [0.0]])
    >>> rough = shaping_filter(inverse_square(1e-6), speed=100.0)
    >>> track = track_inputs(["heave@leg"], [[0.0, 0.0]], speed=100.0)
    >>> found = covariances(ride_channel(cart, None, [Signal.of("gap"), Signal.of("place")]),
    ...                     track_processes(track, vertical=rough))
    >>> round(float(found.variances[0] / (float(rough.D_rate[0, 0]) ** 2 * 2.0 / 0.8 / 2.0)), 12), found.ends
    (1.0, ('', 'low frequency'))
    """
    wanted = tuple(Observed(name) for name in channel.outputs) if observed is None else tuple(observed)
    rows = observed_rows(channel, wanted)
    parts = sources(channel, processes)
    count = len(wanted)
    ends, rate_ends = _ends(channel, parts, wanted, rows)
    total, rates, rounding = np.zeros((count, count)), np.zeros(count), np.zeros(count)
    shares = np.zeros((len(parts), count))
    by_modes = largest_rounding > 0.0
    if by_modes:
        with np.errstate(all="ignore"):
            modes = _modes(channel)
            for index, part in enumerate(parts):
                added, added_rates, blur = _energies(_residues(channel, modes, part, wanted, rows))
                total, rates, rounding = total + added, rates + added_rates, rounding + blur
                shares[index] = np.diag(added)
            rounding = np.where(rounding > 0.0, rounding / np.abs(np.diag(total)), 0.0)
        judged = np.array([not end for end in ends])
        by_modes = bool(np.all(np.isfinite(total[judged][:, judged])) and np.all(rounding[judged] <= largest_rounding))
    if not by_modes:
        finite = np.array([not end for end in ends]), np.array([not end for end in rate_ends])
        total, rates, shares = covariance_by_lyapunov(channel, parts, wanted, finite)
        rounding = np.full(count, np.nan)
    infinite = np.array([bool(end) for end in ends])
    total[infinite, :] = np.nan
    total[:, infinite] = np.nan
    total[infinite, infinite] = np.inf
    rates[[bool(end) for end in rate_ends]] = np.inf
    shares[:, infinite] = np.nan
    return Covariances(
        tuple(one.name for one in wanted),
        read_only_any(total), read_only_any(rates), ends, rate_ends, read_only_any(rounding), by_modes,
        read_only_any(shares), tuple(part.name for part in parts),
    )  # fmt: skip


@dataclass(frozen=True, eq=False, slots=True)
class _Modes:
    """Eigenvalues and outputs (N base rows) in modal coordinates; `back` gives inputs."""

    poles: ComplexArray
    rows: ComplexArray
    back: ComplexArray


def _modes(channel: RideChannel) -> _Modes:
    poles, vectors = np.linalg.eig(channel.A)
    try:
        back = np.linalg.inv(vectors)
    except np.linalg.LinAlgError:
        back = np.full_like(vectors, np.nan)
    return _Modes(poles.astype(complex), (channel.C @ vectors).astype(complex), back.astype(complex))


def _ends(
    channel: RideChannel, parts: Sequence[Source], wanted: tuple[Observed, ...], rows: list[int]
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Which end makes a variance infinite, for values and for rates (jumps of the answer to an impulse)."""
    ends, rate_ends = [""] * len(wanted), [""] * len(wanted)
    for part in parts:
        carried = channel.C @ part.e
        size = np.abs(channel.C) @ np.abs(part.e)
        for j, (one, row) in enumerate(zip(wanted, rows, strict=True)):
            weight = one.weighting
            through = 1.0 if weight is None else weight.through
            still = 1.0 if weight is None else float(weight.at(0.0).real)
            if not part.bounded and part.drift[row] and still != 0.0:
                ends[j] = rate_ends[j] = ends[j] or "low frequency"
                continue
            if through != 0.0 and part.through != 0.0 and np.any(part.d[row] != 0.0):
                ends[j] = rate_ends[j] = ends[j] or "high frequency"
                continue
            slope = 0.0
            if weight is not None and weight.relative_degree == 1:
                slope = weight.gain
            elif weight is not None and weight.relative_degree == 0:
                slope = float(np.sum(weight.residues()).real)
            terms = (carried[row] * part.through, part.d[row] * part.early, part.s[row] * part.through)
            jump = through * (terms[0] + terms[1] + terms[2]) + slope * part.d[row] * part.through
            scale = size[row] * abs(part.through) + abs(part.d[row] * part.early) + abs(part.s[row] * part.through)
            if np.any(np.abs(jump) > 1e-9 * abs(through) * scale + 1e-12 * abs(slope * part.d[row])):
                rate_ends[j] = rate_ends[j] or "high frequency"
    return tuple(ends), tuple(rate_ends)


@dataclass(frozen=True, eq=False, slots=True)
class Residues:
    """Answers of N outputs to one white noise: sum over delays of exp(-s delay) (sum rho/(s - exponents) + constant).

    `rho` (K, N, exponents), `constant` (K, N). The exponents are the modes, the process's poles, the weightings' poles
    and, last, 0 for a displacement without variance.
    """

    delays: FloatArray
    exponents: ComplexArray
    rho: ComplexArray
    constant: FloatArray

    def at(self, s: ComplexArray) -> ComplexArray:
        """(S, N) at complex frequencies (S,)."""
        terms = np.einsum("kjn,sn->skj", self.rho, 1.0 / (s[:, None] - self.exponents), optimize=True) + self.constant
        return np.asarray(np.einsum("sk,skj->sj", np.exp(-s[:, None] * self.delays), terms))


def modal_residues(
    channel: RideChannel, processes: Sequence[Process], observed: Sequence[Observed]
) -> tuple[Residues, ...]:
    """Partial fractions of every observed output, one record a process or noise; not finite for a defective system."""
    wanted = tuple(observed)
    rows = observed_rows(channel, wanted)
    with np.errstate(all="ignore"):
        modes = _modes(channel)
        return tuple(_residues(channel, modes, part, wanted, rows) for part in sources(channel, processes))


def _residues(
    channel: RideChannel, modes: _Modes, part: Source, wanted: tuple[Observed, ...], rows: list[int]
) -> Residues:
    count, n = len(wanted), len(modes.poles)
    inner = modes.back @ part.e  # (n, K)
    filters = list(dict.fromkeys(one.weighting for one in wanted if one.weighting is not None))
    base = sorted(set(rows))
    place = {row: i for i, row in enumerate(base)}
    evaluated = np.concatenate([part.poles, *(one.poles for one in filters)])
    residues = modes.rows[base][:, :, None] * inner[None]  # (rows, n, K), of the channel itself
    gains = np.einsum("rik,qi->qrk", residues, 1.0 / (evaluated[:, None] - modes.poles), optimize=True)
    gains += part.d[base][None] + part.s[base][None] / evaluated[:, None, None]
    n_a = len(part.poles)
    shaped = part.rate_at(modes.poles)
    rho = np.zeros((len(part.delays), count, n + len(evaluated) + 1), dtype=complex)
    constant = np.zeros((len(part.delays), count))
    starts = np.cumsum([n + n_a, *(len(one.poles) for one in filters)])
    known = [(one.at(modes.poles), one.at(part.poles), one.residues() * part.rate_at(one.poles)) for one in filters]
    for j, one in enumerate(wanted):
        row = place[rows[j]]
        own, of_process, still, through = shaped, part.residues, 1.0, 1.0
        if one.weighting is not None:
            index = filters.index(one.weighting)
            by_mode, by_process, by_weight = known[index]
            own, of_process = shaped * by_mode, part.residues * by_process
            still, through = float(one.weighting.at(0.0).real), one.weighting.through
            span = slice(int(starts[index]), int(starts[index + 1]))
            rho[:, j, span] = (by_weight[:, None] * gains[span.start - n : span.stop - n, row]).T
        rho[:, j, :n] = (own[:, None] * residues[row]).T
        rho[:, j, n : n + n_a] = (of_process[:, None] * gains[:n_a, row]).T
        rho[:, j, -1] = still * part.static * part.s[rows[j]]
        constant[:, j] = through * part.through * part.d[rows[j]]
        if not part.live[rows[j]]:
            rho[:, j] = 0.0  # eigenvectors mix parts that are not coupled, by rounding
    return Residues(part.delays, np.concatenate([modes.poles, evaluated, [0.0]]), rho, constant)


def _energies(given: Residues) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Covariance (N, N), rate variances (N,) and absolute rounding (N,) of one source."""
    rho, exponents, steps = given.rho, given.exponents, np.diff(given.delays)
    count = rho.shape[1]
    end = np.zeros((count, len(exponents)), dtype=complex)
    ended = np.empty_like(rho)
    standing = np.zeros((count, count))
    for k in range(len(given.delays)):
        ended[k] = end
        if k < len(steps):
            end = (end + rho[k]) * np.exp(exponents * steps[k])
            standing += steps[k] * np.real(np.outer(end[:, -1], end[:, -1]))
    pair = -1.0 / (exponents[:, None] + exponents[None, :].conj())
    pair[-1, -1] = 0.0
    # Energy gained at every delay: that of (end + rho) less that of end, without taking the difference.
    middle = ended + 0.5 * rho
    half = (rho @ pair).transpose(1, 0, 2).reshape(count, -1) @ middle.transpose(1, 0, 2).reshape(count, -1).conj().T
    covariance = np.real(half + half.conj().T) + standing
    rates = 2.0 * np.real(np.einsum("kjn,kjn->j", (rho * exponents) @ pair, (middle * exponents).conj()))
    spread = np.einsum("kjn,kjn->j", np.abs(rho) @ np.abs(pair), np.abs(middle))
    return covariance, rates, 2.0 * EPS * len(exponents) * spread


__all__ = ["Covariances", "Observed", "Residues", "covariances", "modal_residues"]
