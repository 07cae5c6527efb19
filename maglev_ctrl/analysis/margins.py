"""Stability margins of feedback loops: gain, phase, delay, modulus and disk margins, each replayed before it is told.

One loop at a time (the others closed) and all loops at once. Nothing is computed for a loop that is not stable.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from maglev_ctrl.analysis.crossings import crossovers, scan_frequencies
from maglev_ctrl.analysis.disk import DiskMargin, channel_disk, multi_loop_disk
from maglev_ctrl.analysis.hamiltonian import PeakGain, peak_gain
from maglev_ctrl.analysis.loops import Loop
from maglev_ctrl.analysis.replay import Factor, all_nominal, reaches_axis
from maglev_ctrl.analysis.stability_gate import ClosedLoop, close
from maglev_ctrl.arrays import ComplexArray, FloatArray, read_only_any
from maglev_ctrl.display import Shown

_JUST_BEFORE = 1e-4
_HUGE = 1e9
_NEVER_UNITY = "the gain of the loop never equals one"


@dataclass(frozen=True, eq=False, slots=True, repr=False)
class MarginValue(Shown):
    """One margin: its value, where it is reached (rad/s), whether a replay confirmed it, and why if it did not.

    NaN means UNRESOLVED; inf (or a gain reduction of 0) means unlimited; `reason` says why in both cases.
    """

    value: float
    frequency: float
    verified: bool
    reason: str = ""

    @property
    def decibel(self) -> float:
        """The value, a factor, in dB; -inf for 0.

        Examples
        --------
        >>> MarginValue(10.0, 1.0, True).decibel
        20.0
        """
        return float(20.0 * np.log10(self.value)) if self.value > 0.0 else (-np.inf if self.value == 0.0 else np.nan)


@dataclass(frozen=True, eq=False, slots=True, repr=False)
class ChannelMargins(Shown):
    """Margins of one channel with all others closed.

    gain_reduction, gain_increase : factors; the loop stays stable for every factor between them
    phase_lag, phase_lead, phase : degrees; `phase` is the smaller of the two
    delay : s, on top of the delays already in the loop
    modulus : 1 / max |S|; the largest |T| is `complementary_peak`
    disk : disk margin of skew sigma
    phase_crossovers : (k, 2) factor that brings the pole to the axis, frequency in rad/s; factors 0 < f only
    gain_crossovers : (k, 3) phase lag in degrees (0..360), delay in s, frequency in rad/s
    searches_agree : the eigenvalue method and the sign-change search found the same crossovers
    """

    _told: ClassVar = ("channel", "verified", "searches_agree")

    channel: str
    gain_reduction: MarginValue
    gain_increase: MarginValue
    phase: MarginValue
    phase_lag: MarginValue
    phase_lead: MarginValue
    delay: MarginValue
    modulus: MarginValue
    complementary_peak: MarginValue
    disk: DiskMargin
    phase_crossovers: FloatArray
    gain_crossovers: FloatArray
    searches_agree: bool

    @property
    def sensitivity_peak(self) -> float:
        """Largest |S|, the inverse of the modulus margin."""
        return 1.0 / self.modulus.value if self.modulus.value > 0.0 else np.inf

    @property
    def verified(self) -> bool:
        """Whether every number of this channel was confirmed by a replay."""
        return self.disk.verified and all(
            value.verified
            for value in (
                self.gain_reduction, self.gain_increase, self.phase_lag, self.phase_lead, self.delay, self.modulus,
                self.complementary_peak,
            )
        )  # fmt: skip


@dataclass(frozen=True, eq=False, slots=True, repr=False)
class Margins(Shown):
    """All margins of a loop: one channel at a time, and all channels at once.

    `sensitivity_peak` and `complementary_peak` are largest singular values of S and T; with several channels they
    depend on the channels' units, `multi_loop` does not.
    """

    _told: ClassVar = ("channels", "verified", "sigma")

    channels: tuple[ChannelMargins, ...]
    multi_loop: DiskMargin
    sensitivity_peak: PeakGain
    complementary_peak: PeakGain
    poles: ComplexArray
    sigma: float

    @property
    def verified(self) -> bool:
        """Whether every number was confirmed by a replay."""
        return self.multi_loop.verified and all(channel.verified for channel in self.channels)

    def channel(self, name: str) -> ChannelMargins:
        """The margins of the named channel.

        Raises
        ------
        ValueError : no such channel
        """
        for one in self.channels:
            if one.channel == name:
                return one
        raise ValueError(f"name: {name!r} is not a channel; there are {', '.join(c.channel for c in self.channels)}")


def loop_margins(loop: Loop, *, sigma: float = 0.0) -> Margins:
    """All stability margins of a loop, after a stability gate that is exact with delays.

    Parameters
    ----------
    loop : return ratio, negative feedback
    sigma : skew of the disk margin; 0 balances gain increase and reduction

    Raises
    ------
    NotStable : the closed loop is not stable; the message names the pole
    ModelError : not well posed, or stability with delays cannot be proven
    ValueError : sigma is not finite

    Examples
    --------
    >>> margins = loop_margins(Loop.from_transfer_function([25.0], [1.0, 10.0, 10.0, 10.0]))
    >>> one = margins.channels[0]
    >>> round(one.gain_increase.value, 6), round(one.phase.value, 2), round(one.disk.alpha, 4), margins.verified
    (3.6, 29.11, 0.4581, True)
    """
    closed = close(loop)
    scan = scan_frequencies(closed)
    scanned = closed.response(scan)
    indices = range(len(loop.channels))
    channels = tuple(_channel_margins(closed, i, sigma, scan, scanned[:, i, i]) for i in indices)
    m = len(channels)
    if m == 1:
        multi = channels[0].disk
    else:
        seeds = tuple(_axis_frequency(closed, one.disk.frequency) for one in channels)
        multi = multi_loop_disk(closed, sigma=sigma, seeds=seeds)
    return Margins(
        channels=channels,
        multi_loop=multi,
        sensitivity_peak=_peak(closed, closed.C, closed.D),
        complementary_peak=_peak(closed, -closed.C, np.eye(m) - closed.D),
        poles=read_only_any(closed.poles),
        sigma=float(sigma),
    )


def _peak(closed: ClosedLoop, C: FloatArray, D: FloatArray) -> PeakGain:
    peak = peak_gain(closed.A, closed.B, C, D, tolerance=1e-7)
    return PeakGain(peak.lower, peak.upper, closed.true_frequency(peak.frequency))


def _axis_frequency(closed: ClosedLoop, frequency: float) -> float:
    """Inverse of `true_frequency`."""
    if closed.loop.dt is None or not np.isfinite(frequency):
        return frequency
    return float(2.0 / closed.loop.dt * np.tan(min(frequency * closed.loop.dt / 2.0, np.pi / 2.0 * (1 - 1e-12))))


def _channel_margins(
    closed: ClosedLoop, i: int, sigma: float, scan: FloatArray, scanned: ComplexArray
) -> ChannelMargins:
    real_at, agree_real = crossovers(closed, i, "phase", scan=scan, scanned=scanned)
    unity_at, agree_unity = crossovers(closed, i, "gain", scan=scan, scanned=scanned)
    factors, real_at = _critical_factors(closed, i, np.concatenate([[0.0], real_at, [np.inf]]))
    sensitivity = closed.response(unity_at)[:, i, i]
    lags = np.mod(np.angle(-(1.0 - sensitivity) / sensitivity), 2.0 * np.pi)
    true_unity = np.array([closed.true_frequency(w) for w in unity_at])
    lag = _phase_margin(closed, i, lags, unity_at, sign=1.0)
    lead = _phase_margin(closed, i, 2.0 * np.pi - lags, unity_at, sign=-1.0)
    phase = _closer_phase(closed, i, lag, lead)
    modulus_disk, complementary, disk = (_disk(closed, i, s, scan, scanned) for s in (1.0, -1.0, sigma))
    return ChannelMargins(
        channel=closed.loop.channels[i],
        gain_reduction=_gain_margin(closed, i, factors, real_at, increase=False),
        gain_increase=_gain_margin(closed, i, factors, real_at, increase=True),
        phase=phase,
        phase_lag=lag,
        phase_lead=lead,
        delay=_delay_margin(closed, i, lags, unity_at, true_unity),
        modulus=MarginValue(modulus_disk.alpha, modulus_disk.frequency, modulus_disk.verified, modulus_disk.reason),
        complementary_peak=MarginValue(
            1.0 / complementary.alpha, complementary.frequency, complementary.verified, complementary.reason
        ),
        disk=disk,
        phase_crossovers=read_only_any(
            np.column_stack([factors, [closed.true_frequency(w) for w in real_at]]).reshape(-1, 2)
        ),
        gain_crossovers=read_only_any(
            np.column_stack([np.degrees(lags), lags / true_unity, true_unity]).reshape(-1, 3)
        ),
        searches_agree=agree_real and agree_unity,
    )


def _disk(closed: ClosedLoop, i: int, sigma: float, scan: FloatArray, scanned: ComplexArray) -> DiskMargin:
    """Disk margin; with delays the exact response of the search is looked at beside the stand-in's peak."""
    also: tuple[float, ...] = ()
    if np.isfinite(closed.reach):
        also = (float(scan[int(np.argmax(np.abs(scanned + (sigma - 1.0) / 2.0)))]),)
    return channel_disk(closed, i, sigma=sigma, also=also)


def _critical_factors(closed: ClosedLoop, i: int, frequency: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Positive finite real factors f with f L_i = -1 at the frequencies: f = S/(S - 1); and those frequencies."""
    values = closed.response(frequency)[:, i, i]
    below = values.real - 1.0
    # S = 1 (no loop gain at all) needs no factor; it is where strictly proper loops end.
    away = np.abs(below) > 1.0 / _HUGE
    factors = np.divide(values.real, below, out=np.full(values.size, np.nan), where=away)
    kept = away & (factors > 1e-12)
    return factors[kept], frequency[kept]


def _gain_margin(closed: ClosedLoop, i: int, factors: FloatArray, at: FloatArray, *, increase: bool) -> MarginValue:
    on_side = factors > 1.0 if increase else factors < 1.0
    if not np.any(on_side):
        far = min(1e3, closed.trusted_factor) if increase else 1e-3
        verified = _stable_with(closed, i, far)
        limit, what = (np.inf, "increase") if increase else (0.0, "reduction")
        if not verified:
            return MarginValue(np.nan, np.nan, False, f"UNRESOLVED: unstable at factor {far:g}, crossing not found")
        return MarginValue(limit, np.nan, True, f"no gain {what} brings a pole to the axis")
    side = np.flatnonzero(on_side)
    k = int(side[np.argmin(np.abs(np.log(factors[side])))])
    value = float(factors[k])
    before = value ** (1.0 - _JUST_BEFORE)
    reached = _reaches(closed, i, at[k], Factor(constant=value))
    # Beyond the trusted factor only the search on the exact loop tells that no pole crosses earlier.
    stable_before = before > closed.trusted_factor or _stable_with(closed, i, before)
    return _confirmed(value, closed.true_frequency(at[k]), reached, stable_before)


def _phase_margin(closed: ClosedLoop, i: int, angles: FloatArray, at: FloatArray, *, sign: float) -> MarginValue:
    if not angles.size:
        return MarginValue(np.inf, np.nan, True, _NEVER_UNITY)
    k = int(np.argmin(angles))
    reached = _reaches(closed, i, at[k], Factor(constant=complex(np.exp(-1j * sign * angles[k]))))
    return _confirmed(float(np.degrees(angles[k])), closed.true_frequency(at[k]), reached, True)


def _closer_phase(closed: ClosedLoop, i: int, lag: MarginValue, lead: MarginValue) -> MarginValue:
    """The smaller of lag and lead; a rotation just short of it must leave every pole, of either sign, stable."""
    if not (lag.verified and lead.verified):
        return lag if not lag.verified else lead
    closer = lag if lag.value <= lead.value else lead
    if not np.isfinite(closer.value):
        stable = all(_stable_with(closed, i, np.exp(1j * angle)) for angle in (0.5 * np.pi, np.pi, 1.5 * np.pi))
        return closer if stable else MarginValue(np.nan, np.nan, False, "UNRESOLVED: a crossing was not found")
    before = np.radians(closer.value) * (1.0 - _JUST_BEFORE)
    return _confirmed(closer.value, closer.frequency, True, _stable_with(closed, i, np.exp(-1j * before)))


def _delay_margin(closed: ClosedLoop, i: int, lags: FloatArray, at: FloatArray, true_at: FloatArray) -> MarginValue:
    R = closed.D[i, i]
    if closed.loop.dt is None and abs(1.0 - R) >= abs(R) * (1.0 - 1e-12):
        gain = abs((1.0 - R) / R) if R != 0.0 else np.inf
        return MarginValue(0.0, np.inf, True, f"any delay destabilises: gain {gain:.4g} at infinite frequency")
    if not lags.size:
        return MarginValue(np.inf, np.nan, True, _NEVER_UNITY)
    delays = lags / true_at
    k = int(np.argmin(delays))
    reached = _reaches(closed, i, at[k], Factor(delay=float(delays[k])))
    return _confirmed(float(delays[k]), float(true_at[k]), reached, True)


def _reaches(closed: ClosedLoop, i: int, frequency: float, factor: Factor) -> bool:
    """Replay on the exact loop: does the factor put a pole at j frequency?"""
    if not np.isfinite(frequency) and closed.loop.dt is None:
        R = complex(closed.D[i, i])
        return bool(abs(R + factor.constant * (1.0 - R)) <= 1e-9 * max(1.0, abs(R)))
    factors = all_nominal(len(closed.loop.channels))
    factors[i] = factor
    point = -1.0 + 0j if not np.isfinite(frequency) else complex(closed.points(np.array([frequency]))[0])
    return reaches_axis(closed.loop, point, tuple(factors))


def _stable_with(closed: ClosedLoop, i: int, factor: complex) -> bool:
    """Whether all closed-loop poles stay stable with a constant factor on one channel (rational realisation)."""
    kappa = factor - 1.0
    R = closed.D[i, i]
    update = np.outer(closed.B[:, i], closed.C[i]) * kappa / (1.0 + kappa * (1.0 - R))
    A = closed.A + (update.real if np.imag(factor) == 0.0 else update)
    return bool(np.all(np.linalg.eigvals(A).real < 0.0)) if A.size else True


def _confirmed(value: float, frequency: float, reached: bool, stable_before: bool) -> MarginValue:
    if reached and stable_before:
        return MarginValue(value, frequency, True)
    why = "the replay finds no pole on the axis" if not reached else "a pole crosses earlier"
    return MarginValue(np.nan, frequency, False, f"UNRESOLVED: {why} (candidate {value:.6g})")
