"""Disk margins: how much gain and phase may change together, one loop at a time and all loops at once.

Uncertainty f = (2 + delta (1 - sigma)) / (2 - delta (1 + sigma)), |delta| < alpha in every channel (Seiler, Packard &
Gahinet, IEEE Control Systems 40(5), 2020). The closed loop reaches the boundary where det(I - Delta N) = 0 with
N = S + (sigma - 1)/2 I, so alpha = 1 / sup_w mu(N). sigma = 0 is the balanced (S - T)/2; sigma = 1 gives S, -1 gives T.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.optimize

from maglev_ctrl.analysis.hamiltonian import peak_gain
from maglev_ctrl.analysis.replay import DynamicPerturbation, Factor, all_nominal, reaches_axis
from maglev_ctrl.analysis.stability_gate import ClosedLoop
from maglev_ctrl.analysis.structured_peak import structured_peak
from maglev_ctrl.arrays import ComplexArray, read_only_any
from maglev_ctrl.errors import Agreement

AGREEMENT_TOLERANCE = 1e-3


@dataclass(frozen=True, eq=False, slots=True)
class DiskMargin:
    """Disk margin with the perturbation that reaches it.

    `alpha` is the proven margin: no perturbation of modulus below it destabilises. `alpha_reached` belongs to
    `perturbation`, which puts a closed-loop pole on the axis at `frequency` (rad/s). Where the two differ by more than
    0.1 % `agreement` says UNRESOLVED and `alpha` is NaN (`alpha_proven` stays). `gain_min`, `gain_max`: factors on
    all channels at once; `phase`: degrees. `dynamics`: real all-pass perturbations with the same effect.
    """

    sigma: float
    alpha: float
    alpha_proven: float
    alpha_reached: float
    gain_min: float
    gain_max: float
    phase: float
    frequency: float
    perturbation: ComplexArray
    dynamics: tuple[DynamicPerturbation, ...]
    agreement: Agreement
    verified: bool
    reason: str

    @property
    def factors(self) -> ComplexArray:
        """Complex factors (m,) the worst perturbation puts on the channels; inf where a channel's gain is infinite."""
        top, bottom = 2.0 + self.perturbation * (1.0 - self.sigma), 2.0 - self.perturbation * (1.0 + self.sigma)
        finite = np.abs(bottom) > 1e-12
        return np.asarray(np.where(finite, top / np.where(finite, bottom, 1.0), np.inf + 0j))

    @property
    def gain_range_db(self) -> tuple[float, float]:
        """Range of gain factors in dB; -inf where the gain may fall to zero or below."""
        low = 20.0 * np.log10(self.gain_min) if self.gain_min > 0.0 else -np.inf
        return float(low), float(20.0 * np.log10(self.gain_max)) if np.isfinite(self.gain_max) else np.inf


def disk_gain_range(alpha: float, *, sigma: float = 0.0) -> tuple[float, float]:
    """Real factors that stay inside a disk of size alpha: (2 -+ alpha(1 - sigma)) / (2 +- alpha(1 + sigma)).

    A negative lower end means that even a sign reversal of that size is tolerated; the upper end may be inf.

    Examples
    --------
    >>> low, high = disk_gain_range(0.75)
    >>> round(low, 4), round(high, 4)
    (0.4545, 2.2)
    """
    below, above = 2.0 + alpha * (1.0 + sigma), 2.0 - alpha * (1.0 + sigma)
    low = (2.0 - alpha * (1.0 - sigma)) / below if below > 1e-9 else -np.inf
    high = (2.0 + alpha * (1.0 - sigma)) / above if above > 1e-9 else np.inf
    return float(low), float(high)


def disk_phase(alpha: float, *, sigma: float = 0.0) -> float:
    """Phase in degrees that stays inside a disk of size alpha; 180 when every phase does.

    From |delta|^2 = 8 (1 - cos phi) / (2 + 2 sigma^2 + 2 (1 - sigma^2) cos phi) = alpha^2 on the unit circle.

    Examples
    --------
    >>> round(disk_phase(0.6, sigma=0.75), 4)
    34.2267
    """
    if alpha * abs(sigma) >= 2.0 or not np.isfinite(alpha):
        return 180.0
    cosine = (4.0 - alpha**2 * (1.0 + sigma**2)) / (4.0 + alpha**2 * (1.0 - sigma**2))
    return float(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))


def channel_disk(closed: ClosedLoop, channel: int, *, sigma: float = 0.0, also: tuple[float, ...] = ()) -> DiskMargin:
    """Disk margin of one channel with all others closed; `also` are frequencies where a delayed loop is looked at too.

    Raises
    ------
    ValueError : sigma is not finite
    """
    _require_finite(sigma)
    shift = (sigma - 1.0) / 2.0
    row, column = closed.C[channel : channel + 1], closed.B[:, channel : channel + 1]
    through = closed.D[channel : channel + 1, channel : channel + 1] + shift
    peak = peak_gain(closed.A, column, row, through)
    frequency = peak.frequency
    if np.any(closed.loop.delays > 0.0):
        places = np.array([frequency, *also])
        exact = np.abs(closed.response(places)[:, channel, channel] + shift)
        frequency = _polished_peak(closed, channel, float(places[int(np.argmax(exact))]), shift)
    value = complex(closed.response(np.array([frequency]))[0, channel, channel]) + shift
    if abs(value) == 0.0:
        return _record(closed, sigma, 0.0, peak.upper, frequency, np.full(1, np.inf + 0j), [channel])
    upper = max(peak.upper, abs(value) * (1.0 + 1e-9))
    return _record(closed, sigma, abs(value), upper, frequency, np.array([1.0 / value]), [channel])


def multi_loop_disk(closed: ClosedLoop, *, sigma: float = 0.0, seeds: tuple[float, ...] = ()) -> DiskMargin:
    """Disk margin with independent perturbations in all channels at once (structured singular value).

    Raises
    ------
    ValueError : sigma is not finite
    """
    _require_finite(sigma)
    m = closed.D.shape[0]
    poles = np.linalg.eigvals(closed.A) if closed.A.size else np.zeros(0)
    start = np.concatenate([np.abs(poles), np.abs(poles.imag), np.asarray(seeds, dtype=float)])
    D = closed.D + (sigma - 1.0) / 2.0 * np.eye(m)
    peak = structured_peak(closed.A, closed.B, closed.C, D, seeds=start)
    perturbation = peak.perturbation
    if np.any(closed.loop.delays > 0.0) and np.all(np.isfinite(perturbation)):
        # Keep the phases, let the exact loop say the size: an eigenvalue of N exp(j phases) close to the stand-in's.
        exact = closed.response(np.array([peak.frequency]))[0] + (sigma - 1.0) / 2.0 * np.eye(m)
        inverse = np.linalg.eigvals(exact @ np.diag(perturbation))
        perturbation = perturbation / inverse[int(np.argmin(np.abs(inverse - 1.0)))]
    reached = 1.0 / float(np.max(np.abs(perturbation))) if np.all(np.isfinite(perturbation)) else 0.0
    return _record(closed, sigma, reached, peak.upper, peak.frequency, perturbation, list(range(m)))


def _require_finite(sigma: float) -> None:
    if not np.isfinite(sigma):
        raise ValueError(f"sigma: expected a finite skew (0 balanced, 1 for S, -1 for T), got {sigma!r}")


def _polished_peak(closed: ClosedLoop, channel: int, frequency: float, shift: float) -> float:
    """The stand-in's peak moved to the exact loop's."""
    if frequency == 0.0 or not np.isfinite(frequency):
        return frequency

    def descent(omega: float) -> float:
        return -float(abs(closed.response(np.array([omega]))[0, channel, channel] + shift))

    width = 1e-3 * frequency
    found = scipy.optimize.minimize_scalar(
        descent, bounds=(frequency - width, frequency + width), method="bounded", options={"xatol": 1e-10 * frequency}
    )
    return float(found.x) if found.fun < descent(frequency) else frequency


def _record(
    closed: ClosedLoop,
    sigma: float,
    lower: float,
    upper: float,
    frequency: float,
    perturbation: ComplexArray,
    channels: list[int],
) -> DiskMargin:
    if not closed.faithful:
        upper = np.inf  # the stand-in of long delays proves stability, not peaks
    proven, reached = 1.0 / upper if upper > 0.0 else np.inf, 1.0 / lower if lower > 0.0 else np.inf
    agreed = reached == proven or (np.isfinite(reached) and reached <= proven * (1.0 + AGREEMENT_TOLERANCE))
    dynamics = tuple(DynamicPerturbation.through(complex(d), frequency) for d in perturbation)
    verified = bool(np.isfinite(reached)) and _replayed(closed, sigma, frequency, perturbation, dynamics, channels)
    reason = ""
    if not agreed:
        reason = f"UNRESOLVED: proven {proven:.6g}, reached {reached:.6g}"
    elif not np.isfinite(reached):
        reason, verified = "no perturbation of any size destabilises", True
    elif not verified:
        reason = "UNRESOLVED: the replayed perturbation does not put a pole on the axis"
    elif not np.isfinite(frequency):
        reason = "reached at infinite frequency" if closed.loop.dt is None else "reached at the Nyquist frequency"
    resolved = agreed and verified
    low, high = disk_gain_range(proven, sigma=sigma) if resolved else (np.nan, np.nan)
    return DiskMargin(
        sigma=float(sigma),
        alpha=float(proven) if resolved else np.nan,
        alpha_proven=float(proven),
        alpha_reached=float(reached),
        gain_min=low,
        gain_max=high,
        phase=disk_phase(proven, sigma=sigma) if resolved else np.nan,
        frequency=closed.true_frequency(frequency),
        perturbation=read_only_any(perturbation),
        dynamics=dynamics,
        agreement=Agreement.AGREED if resolved else Agreement.UNRESOLVED,
        verified=verified,
        reason=reason,
    )


def _replayed(
    closed: ClosedLoop,
    sigma: float,
    frequency: float,
    perturbation: ComplexArray,
    dynamics: tuple[DynamicPerturbation, ...],
    channels: list[int],
) -> bool:
    """Whether the complex perturbation and its real dynamic form both put a pole of the exact loop on the axis."""
    if not np.isfinite(frequency):
        block = closed.response(np.array([np.inf]))[0][np.ix_(channels, channels)]
        N = block + (sigma - 1.0) / 2.0 * np.eye(len(channels))
        gap = np.linalg.svd(np.eye(len(channels)) - perturbation[:, None] * N, compute_uv=False)
        return bool(gap[-1] <= 1e-8 * max(1.0, gap[0]))
    point = complex(closed.points(np.array([frequency]))[0])
    m = len(closed.loop.channels)
    outcome = []
    for constant in (True, False):
        factors = all_nominal(m)
        for k, i in enumerate(channels):
            if constant:
                factors[i] = Factor(fixed=complex(perturbation[k]), sigma=sigma)
            else:
                factors[i] = Factor(disk=dynamics[k], sigma=sigma)
        outcome.append(reaches_axis(closed.loop, point, tuple(factors)))
    return all(outcome)
