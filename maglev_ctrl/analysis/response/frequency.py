"""Covariances by adaptive integration over frequency: independent of eigenvectors and Lyapunov equations.

Responses are solved for at every frequency with the guideway's displacement and rate as they stand, and weighted by the
weighting's own formula. Above the last resonance the delays still beat: there the terms of one delay are integrated to
infinity, and the products of two delays tau_k - tau_l = T > 0 along w = W - i t, where exp(-i w T) decays and no pole
lies in the way.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maglev_ctrl.analysis.response.channels import Process, RideChannel
from maglev_ctrl.analysis.response.quadrature import adaptive_integral
from maglev_ctrl.analysis.response.sources import Observed, observed_rows, process_weights
from maglev_ctrl.arrays import FloatArray, read_only_any

TOLERANCE = 1e-8
_Complex = NDArray[np.complexfloating[Any, Any]]
_CHUNK = 400

WELL_APART = 1e8
"""Condition of the eigenvectors below which they may stand for a solve."""

LOWEST = 1e-5
"""Share of the smallest pole, and of the inverse of the longest delay, below which nothing changes any more."""

ZERO = 1e-9
"""A deviation below this share of its scale is one of rounding."""


@dataclass(frozen=True, eq=False, slots=True)
class FrequencyCovariances:
    """Integrals over frequency: `variances` and `rates` (N,) (NaN where not asked for), `pairs` (P,) covariances.

    `errors` (N,) relative estimates of the variances' errors; `evaluations` counts frequencies. `scales` (N,) are the
    deviations were the guideway inputs independent and nothing in an output cancelled: what rounding is a share of.
    """

    names: tuple[str, ...]
    variances: FloatArray
    rates: FloatArray
    pairs: FloatArray
    errors: FloatArray
    evaluations: int
    scales: FloatArray


@dataclass(frozen=True, eq=False, slots=True)
class _Drive:
    """A process (or noise) as columns over [w; w'; n], one a delay, and its filter."""

    delays: FloatArray
    mixture: FloatArray
    process: Process | None
    noise: int

    def rate_at(self, s: _Complex) -> _Complex:
        if self.process is None:
            return np.ones_like(s)
        shaping = self.process.shaping
        found = np.full(len(s), shaping.D_rate[0, 0], dtype=complex)
        if len(shaping.A):
            pencil = s[:, None, None] * np.eye(len(shaping.A)) - shaping.A
            found += (
                shaping.C_rate @ np.linalg.solve(pencil, np.broadcast_to(shaping.B + 0j, (len(s), *shaping.B.shape)))
            )[:, 0, 0]
        return found


def frequency_covariances(
    channel: RideChannel,
    processes: Sequence[Process],
    observed: Sequence[Observed] | None = None,
    *,
    finite: Sequence[bool] | None = None,
    finite_rates: Sequence[bool] | None = None,
    pairs: Sequence[tuple[int, int]] = (),
    band: tuple[float, float] | None = None,
    tolerance: float = TOLERANCE,
    quick: bool = False,
) -> FrequencyCovariances:
    """Variances of outputs, of their rates, and covariances of pairs, over all frequencies or a band.

    Parameters
    ----------
    observed : outputs with their weightings; every output as it is when left out
    finite, finite_rates : (N,) which to integrate: those whose variance exists (`Covariances.ends`); over a band all
    pairs : (P,) of indices into `observed`, both with a variance
    band : f1, f2 in Hz; all frequencies when left out
    tolerance : relative
    quick : take eigenvectors for the solves where they are well apart, some five times faster; then it is no longer
        independent of them, and no `scales` are found

    Raises
    ------
    ValueError : an unknown output or guideway input, or a band that is not increasing

    Examples
    --------
    >>> from maglev_ctrl.analysis.response.channels import Signal, ride_channel
    >>> from maglev_ctrl.analysis.response.covariance import covariances
    >>> from maglev_ctrl.analysis.response.channels import track_processes
    >>> from maglev_ctrl.guideway.correlation import track_inputs
    >>> from maglev_ctrl.guideway.shaping import shaping_filter
    >>> from maglev_ctrl.guideway.spectra import inverse_square
    >>> from maglev_ctrl.systems import SecondOrderSystem
    >>> cart = SecondOrderSystem.from_matrices([[2.0]], [[0.8]], [[8.0]], guideway=("heave@a", "heave@b"),
    ...     K_w=[[4.0, 4.0]], C_w=[[0.4, 0.4]], outputs=("stroke",), H_q=[[1.0]], H_w=[[-0.5, -0.5]])
    >>> track = track_inputs(["heave@a", "heave@b"], [[2.0, 0.0], [-2.0, 0.0]], speed=10.0)
    >>> rough = track_processes(track, vertical=shaping_filter(inverse_square(1e-6), speed=10.0))
    >>> channel = ride_channel(cart, None, [Signal.of("stroke")])
    >>> exact, integral = covariances(channel, rough), frequency_covariances(channel, rough)
    >>> bool(abs(integral.variances[0] / exact.variances[0] - 1.0) < 1e-8)
    True
    """
    wanted = tuple(Observed(name) for name in channel.outputs) if observed is None else tuple(observed)
    rows = observed_rows(channel, wanted)
    count = len(wanted)
    if band is not None and not (0.0 <= band[0] < band[1]):
        raise ValueError(f"band: expected 0 <= f1 < f2 in Hz, got {band}")
    value_list = [i for i in range(count) if band is not None or finite is None or finite[i]]
    rate_list = [i for i in range(count) if band is not None or finite_rates is None or finite_rates[i]]
    if band is None and finite is not None:
        rate_list = [i for i in rate_list if finite[i]]
    products = [(i, i, 0) for i in value_list] + [(i, i, 1) for i in rate_list] + [(i, j, 0) for i, j in pairs]
    first, second, power = (np.array([p[k] for p in products], dtype=int) for k in range(3))
    solver = _Solver(channel, _drives(channel, processes), wanted, rows, quick=quick)
    poles = _poles(channel, processes, wanted)
    top = _top(poles)
    longest = max(
        (float(drive.delays[-1] - drive.delays[0]) for drive in solver.drives if len(drive.delays)), default=0.0
    )

    def on_axis(omega: FloatArray) -> FloatArray:
        values = np.zeros((len(omega), len(products)))
        for answer in solver.together(1j * omega):
            values += np.real(answer[:, first] * answer[:, second].conj())
        return values * np.where(power == 1, omega[:, None] ** 2, 1.0)

    scales = np.zeros(count) if quick else solver.scales(poles)
    floor = (100.0 * ZERO**2 * scales[first] * scales[second]) * np.where(power == 1, np.max(np.abs(poles)) ** 2, 1.0)
    low, high = (0.0, top) if band is None else (2.0 * np.pi * band[0], 2.0 * np.pi * band[1])
    start = max(low, min(LOWEST * _smallest(poles, longest), 0.5 * high))
    edges = _edges(poles, start, high, longest, coarse=quick)
    body = adaptive_integral(on_axis, edges, tolerance=tolerance, floor=floor)
    # Densities of what has a variance are flat below `start`; nearer to 0 they would be differences of rounding.
    value, error, evaluations = body.value + on_axis(np.array([start]))[0] * (start - low), body.error, body.evaluations
    if band is None:
        floor = np.maximum(floor, np.abs(body.value))
        single = _single_tail(solver, products, top, poles, tolerance, floor)
        crossed = _crossed_tail(solver, products, top, tolerance, floor)
        value = value + single[0] + crossed[0]
        error = error + single[1] + crossed[1]
        evaluations += single[2] + crossed[2]
    value, error = value / np.pi, error / np.pi
    n_v, n_r = len(value_list), len(rate_list)
    variances, rates, errors = np.full(count, np.nan), np.full(count, np.nan), np.full(count, np.nan)
    variances[value_list], rates[rate_list] = value[:n_v], value[n_v : n_v + n_r]
    errors[value_list] = error[:n_v] / np.where(value[:n_v] > 0.0, value[:n_v], 1.0)
    return FrequencyCovariances(
        tuple(one.name for one in wanted), read_only_any(variances), read_only_any(rates),
        read_only_any(value[n_v + n_r :]), read_only_any(errors), evaluations, read_only_any(scales),
    )  # fmt: skip


def spectral_density(
    channel: RideChannel,
    processes: Sequence[Process],
    observed: Sequence[Observed],
    frequency: FloatArray,
) -> FloatArray:
    """One-sided power spectral densities (N, F) of outputs over frequencies (F,) in Hz, unit^2 per Hz.

    Raises
    ------
    ValueError : an unknown output or guideway input, or a frequency that is not positive
    """
    points = np.asarray(frequency, dtype=np.float64)
    if points.ndim != 1 or np.any(points <= 0.0):
        raise ValueError("frequency: expected (F,) positive frequencies in Hz")
    solver = _Solver(channel, _drives(channel, processes), tuple(observed), observed_rows(channel, observed))
    density = np.zeros((len(points), len(observed)))
    for answer in solver.together(2j * np.pi * points):
        density += 2.0 * np.abs(answer) ** 2
    return read_only_any(density.T)


def response_edges(
    channel: RideChannel,
    processes: Sequence[Process],
    observed: Sequence[Observed],
    *,
    band: tuple[float, float] | None = None,
) -> FloatArray:
    """Frequencies (rad/s, increasing) that part resonances and beats of the delays: pieces for an integral.

    Without a `band` (Hz) only the two ends, below and above which nothing resonates.
    """
    poles = _poles(channel, processes, tuple(observed))
    if band is None:
        sizes = np.concatenate([np.abs(poles), np.abs(poles.real)])
        return np.array([float(np.min(sizes[sizes > 0.0], initial=1.0)), float(np.max(sizes, initial=1.0))])
    longest = max((float(np.ptp(process.delays)) for process in processes), default=0.0)
    return _edges(poles, 2.0 * np.pi * band[0], 2.0 * np.pi * band[1], longest)


def _poles(channel: RideChannel, processes: Sequence[Process], wanted: tuple[Observed, ...]) -> _Complex:
    return np.concatenate(
        [np.zeros(0, dtype=complex), np.linalg.eigvals(channel.A)]
        + [one.weighting.poles for one in wanted if one.weighting is not None]
        + [np.linalg.eigvals(process.shaping.A) for process in processes]
    )


def _smallest(poles: _Complex, longest: float) -> float:
    sizes = np.concatenate([np.abs(poles), np.abs(poles.real)])
    return float(np.min(sizes[sizes > 0.0], initial=1.0 / longest if longest > 0.0 else np.inf))


def _top(poles: _Complex) -> float:
    return 1.4 * max(float(np.max(np.abs(poles.imag), initial=0.0)), 0.2 * float(np.median(np.abs(poles))), 1e-3)


def _drives(channel: RideChannel, processes: Sequence[Process]) -> list[_Drive]:
    n_w, n_n = len(channel.guideway), len(channel.noises)
    found = [
        _Drive(*process_weights(channel, process), process, -1) for process in processes if np.any(process.weights)
    ]
    return found + [_Drive(np.zeros(1), np.zeros((n_w, 1)), None, i) for i in range(n_n)]


class _Solver:
    """Responses of the observed outputs to every white noise at complex frequencies."""

    def __init__(
        self,
        channel: RideChannel,
        drives: list[_Drive],
        wanted: tuple[Observed, ...],
        rows: list[int],
        *,
        quick: bool = False,
    ) -> None:
        self.channel, self.drives, self.wanted, self.rows = channel, drives, wanted, rows
        self.modes: tuple[_Complex, _Complex, _Complex] | None = None
        if quick and len(channel.A):
            poles, vectors = np.linalg.eig(channel.A)
            if np.linalg.cond(vectors) < WELL_APART:
                loads = np.linalg.solve(vectors, np.hstack([channel.E_p, channel.E_v, channel.E_n]))
                self.modes = poles + 0j, (channel.C @ vectors).T + 0j, loads.T + 0j
        self.filters = list(dict.fromkeys(one.weighting for one in wanted if one.weighting is not None))

    def together(self, s: _Complex) -> list[_Complex]:
        """(N, outputs) a source, delays included."""
        columns = [
            (drive.mixture @ np.exp(-s[:, None] * drive.delays)[..., None])[..., 0][..., None] for drive in self.drives
        ]
        if self.modes is not None:
            return self._by_modes(s, [column[:, :, 0] for column in columns])
        return [answer[:, :, 0] for answer in self._solve(s, columns)]

    def _by_modes(self, s: _Complex, met: list[_Complex]) -> list[_Complex]:
        """The same from modal coordinates, one column a source."""
        assert self.modes is not None
        channel, (poles, rows, loads) = self.channel, self.modes
        n_w = len(channel.guideway)
        resolvent, gains = 1.0 / (s[:, None] - poles), self._gains(s)
        found: list[_Complex] = []
        for drive, rate in zip(self.drives, met, strict=True):
            if drive.process is None:
                load, direct = loads[2 * n_w + drive.noise], np.asarray(channel.D_n[:, drive.noise] + 0j)
            else:
                shift = rate / s[:, None]
                load = shift @ loads[:n_w] + rate @ loads[n_w : 2 * n_w]
                direct = shift @ channel.D_p.T + rate @ channel.D_v.T
            answer = (resolvent * load) @ rows + direct
            found.append(answer[:, self.rows] * gains * drive.rate_at(s)[:, None])
        return found

    def _gains(self, s: _Complex) -> _Complex:
        weights = [one.at(s) for one in self.filters]
        one = np.ones_like(s)
        return np.stack(
            [one if o.weighting is None else weights[self.filters.index(o.weighting)] for o in self.wanted], axis=1
        )

    def apart(self, s: _Complex) -> list[_Complex]:
        """(N, outputs, delays) a source, without the delays."""
        return self._solve(s, [np.broadcast_to(d.mixture + 0j, (len(s), *d.mixture.shape)) for d in self.drives])

    def scales(self, poles: _Complex) -> FloatArray:
        """Deviations of the outputs were every guideway input on its own and nothing cancelled; a coarse integral."""
        sizes = np.concatenate([np.abs(poles), np.abs(poles.imag)])
        sizes = sizes[sizes > 0.0]
        span = np.geomspace(0.1 * float(np.min(sizes, initial=1.0)), 10.0 * float(np.max(sizes, initial=1.0)), 60)
        omega = np.unique(np.concatenate([span, sizes]))
        s = 1j * omega
        channel = self.channel
        density = np.zeros((len(omega), len(channel.outputs)))
        pencil = s[:, None, None] * np.eye(len(channel.A)) - channel.A
        alone = np.abs(np.linalg.solve(pencil, channel.E_p / s[:, None, None] + channel.E_v))
        alone = np.abs(channel.C) @ alone + np.abs(channel.D_p) / omega[:, None, None] + np.abs(channel.D_v)
        for drive in self.drives:
            if drive.process is None:
                loads = np.broadcast_to(channel.E_n[:, [drive.noise]] + 0j, (len(s), len(channel.A), 1))
                met = (np.abs(channel.C) @ np.abs(np.linalg.solve(pencil, loads)))[:, :, 0]
            else:
                met = alone @ np.abs(drive.mixture).sum(axis=1)
            density += (met * np.abs(drive.rate_at(s))[:, None]) ** 2
        gains = np.stack([np.ones(len(s)) if o.weighting is None else np.abs(o.weighting.at(s)) for o in self.wanted])
        return np.asarray(np.sqrt(np.trapezoid(density[:, self.rows].T * gains**2, omega, axis=1) / np.pi))

    def _solve(self, s: _Complex, mixtures: list[_Complex]) -> list[_Complex]:
        channel = self.channel
        widths = [mixture.shape[-1] for mixture in mixtures]
        answers = np.empty((len(s), len(channel.outputs), sum(widths)), dtype=complex)
        for start in range(0, len(s), _CHUNK):
            part = slice(start, start + _CHUNK)
            here = s[part]
            loads: list[_Complex] = []
            direct: list[_Complex] = []
            for drive, mixture in zip(self.drives, mixtures, strict=True):
                if drive.process is None:
                    i = drive.noise
                    loads.append(np.broadcast_to(channel.E_n[:, i : i + 1] + 0j, (len(here), len(channel.A), 1)))
                    direct.append(np.broadcast_to(channel.D_n[:, i : i + 1] + 0j, (len(here), len(channel.outputs), 1)))
                    continue
                displaced = mixture[part] / here[:, None, None]
                loads.append(channel.E_p @ displaced + channel.E_v @ mixture[part])
                direct.append(channel.D_p @ displaced + channel.D_v @ mixture[part])
            pencil = here[:, None, None] * np.eye(len(channel.A)) - channel.A
            state = np.linalg.solve(pencil, np.concatenate(loads, axis=2) + 0j)
            answers[part] = channel.C @ state + np.concatenate(direct, axis=2)
        gains = self._gains(s)
        found: list[_Complex] = []
        start = 0
        for drive, width in zip(self.drives, widths, strict=True):
            block = answers[:, self.rows, start : start + width]
            found.append(block * gains[:, :, None] * drive.rate_at(s)[:, None, None])
            start += width
        return found


def _edges(poles: _Complex, low: float, high: float, longest: float, *, coarse: bool = False) -> FloatArray:
    """First pieces: around every resonance, and not more than two beats of the longest delay."""
    steps = np.array([-125.0, -25.0, -5.0, -1.0, 0.0, 1.0, 5.0, 25.0, 125.0])
    if coarse:
        steps = np.array([-8.0, -1.0, 1.0, 8.0])
    around = np.abs(poles.imag)[:, None] + np.abs(poles.real)[:, None] * steps
    sizes = np.concatenate([np.abs(poles), np.abs(poles.real), [high]])
    smallest = float(np.min(sizes[sizes > 0.0]))
    wide = np.geomspace(1e-4 * smallest, max(high, 2e-4 * smallest), 8 if coarse else 25)
    points: FloatArray = np.concatenate([around.ravel(), wide]).astype(np.float64)
    points = np.unique(np.concatenate([[low, high], points[(points > low) & (points < high)]]))
    points = points[np.concatenate([[True], np.diff(points) > 1e-9 * points[1:]])]
    points[-1] = high
    if longest <= 0.0:
        return points
    most = (12.0 if coarse else 4.0) * np.pi / longest
    pieces = np.maximum(np.ceil(np.diff(points) / most).astype(int), 1)
    cut = [np.linspace(a, b, k, endpoint=False) for a, b, k in zip(points[:-1], points[1:], pieces, strict=True)]
    return np.asarray(np.concatenate([*cut, [high]]), dtype=np.float64)


def _single_tail(
    solver: _Solver,
    products: list[tuple[int, int, int]],
    top: float,
    poles: _Complex,
    tolerance: float,
    floor: FloatArray,
) -> tuple[FloatArray, FloatArray, int]:
    """Products of one delay with itself from `top` to infinity, w = top / u."""
    first, second, power = (np.array([p[k] for p in products], dtype=int) for k in range(3))

    def beyond(u: FloatArray) -> FloatArray:
        omega = top / u
        values = np.zeros((len(u), len(products)))
        for answer in solver.apart(1j * omega):
            values += np.real(np.sum(answer[:, first] * answer[:, second].conj(), axis=2))
        return values * np.where(power == 1, omega[:, None] ** 2, 1.0) * (omega / u)[:, None]

    far = max(float(np.max(np.abs(poles), initial=top)) / top, 1.0)
    edges = np.concatenate([[0.0], np.geomspace(0.1 / far, 1.0, 4 + int(2.0 * np.log10(far)))])
    found = adaptive_integral(beyond, edges, tolerance=tolerance, floor=floor)
    return found.value, found.error, found.evaluations


def _crossed_tail(
    solver: _Solver, products: list[tuple[int, int, int]], top: float, tolerance: float, floor: FloatArray
) -> tuple[FloatArray, FloatArray, int]:
    """Products of two delays from `top` to infinity, along w = top - i t."""
    if all(len(drive.delays) < 2 for drive in solver.drives):
        return np.zeros(len(products)), np.zeros(len(products)), 0
    first, second, power = (np.array([p[k] for p in products], dtype=int) for k in range(3))
    later = [np.tril_indices(len(drive.delays), -1) for drive in solver.drives]
    gaps = [drive.delays[k] - drive.delays[m] for drive, (k, m) in zip(solver.drives, later, strict=True)]
    turns = [np.exp(-1j * top * gap) for gap in gaps]

    def turned(t: FloatArray) -> FloatArray:
        s = t + 1j * top
        values = np.zeros((len(t), len(products)))
        ahead, behind = solver.apart(s), solver.apart(-s)
        for up, down, (k, m), gap, turn in zip(ahead, behind, later, gaps, turns, strict=True):
            if not len(k):
                continue
            fade = -1j * turn * np.exp(-t[:, None] * gap)  # (N, pairs of delays)
            # the later delay belongs to the first output, then to the second
            both = up[:, first][:, :, k] * down[:, second][:, :, m] + up[:, second][:, :, k] * down[:, first][:, :, m]
            values += np.real(
                np.einsum(
                    "npq,nq->np",
                    both * np.where(power == 1, -1.0, 1.0)[:, None] * (s**2)[:, None, None] ** power[:, None],
                    fade,
                )
            )
        return values

    shortest = min(float(np.min(gap)) for gap in gaps if len(gap))
    longest = max(float(np.max(gap)) for gap in gaps if len(gap))
    last = 40.0 / shortest
    edges = np.concatenate(
        [[0.0], np.geomspace(min(top, 1.0 / longest), last, 3 + int(np.log2(max(2.0, last * longest))))]
    )
    found = adaptive_integral(turned, np.unique(edges), tolerance=tolerance, floor=floor)
    return found.value, found.error, found.evaluations
