"""Peak of the structured singular value over all frequencies, bounded from both sides without a grid.

The upper bound eliminates the frequency axis piece by piece: scales D that are good at one frequency are proven good
up to the next frequencies where sigma_max(D N D^-1) equals the level, which are Hamiltonian eigenvalues. Only an
empty rest is a proof (after Lawrence, Tits & Van Dooren 2000; Ferreres & Magni 2003).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg
import scipy.optimize

from maglev_ctrl.analysis.hamiltonian import hamiltonian_frequencies, largest_gain, response
from maglev_ctrl.analysis.structured import (
    LowerBound,
    mu_lower,
    mu_upper,
    phases_from_scaling,
    spectral_radius,
)
from maglev_ctrl.arrays import ComplexArray, FloatArray

Interval = tuple[float, float]
_TOLERANCE = 1e-6
_BUDGET = 60
_PATIENCE = 20


@dataclass(frozen=True, eq=False, slots=True)
class StructuredPeak:
    """Peak of mu over frequency: `lower` is reached by `perturbation` at `frequency` (rad/s), `upper` is proven."""

    lower: float
    upper: float
    frequency: float
    perturbation: ComplexArray


def structured_peak(A: FloatArray, B: FloatArray, C: FloatArray, D: FloatArray, *, seeds: FloatArray) -> StructuredPeak:
    """Peak over frequency of mu of C (j w I - A)^-1 B + D against complex diagonal uncertainty.

    Parameters
    ----------
    A, B, C, D : stable, square state space
    seeds : frequencies (rad/s) worth starting from

    Examples
    --------
    >>> one = np.eye(1)
    >>> peak = structured_peak(-one, one, one, 0 * one, seeds=np.array([1.0]))
    >>> round(peak.lower, 6), round(peak.upper, 3)
    (1.0, 1.0)
    """
    seeds = np.unique(np.concatenate([seeds, [0.0, np.inf]]))
    values = response(A, B, C, D, seeds)
    quick = np.array([np.max(np.abs(np.linalg.eigvals(v))) for v in values])
    rough = np.array([mu_upper(v, target=np.inf).value for v in values])
    order = np.argsort(-(quick + rough))
    best, at = LowerBound(-1.0, np.zeros(D.shape[0]), np.zeros(D.shape[0], dtype=complex)), 0.0
    for k in order[:3]:
        bound, frequency = _climb(A, B, C, D, float(seeds[k]), values[k])
        if bound.value > best.value:
            best, at = bound, frequency
    level, best, at = _eliminate(A, B, C, D, best, at)
    return StructuredPeak(best.value, level, at, best.perturbation)


def _climb(
    A: FloatArray, B: FloatArray, C: FloatArray, D: FloatArray, frequency: float, value: ComplexArray
) -> tuple[LowerBound, float]:
    """Ascent of the lower bound over phases, then over phases and frequency together."""
    upper = mu_upper(value)
    start = mu_lower(value, starts=(phases_from_scaling(value, upper.log_scales),), goal=upper.value)
    if frequency == 0.0 or not np.isfinite(frequency) or A.shape[0] == 0:
        return start, frequency

    triangle, unitary = scipy.linalg.schur(A + 0j, output="complex", check_finite=False)
    into, out = unitary.conj().T @ B, C @ unitary
    diagonal = np.diag_indices(A.shape[0])

    def descent(free: FloatArray) -> tuple[float, FloatArray]:
        omega = frequency * float(np.exp(np.clip(free[-1], -20.0, 20.0)))
        phases = np.append(free[:-1], 0.0)
        pencil = -triangle
        pencil[diagonal] += 1j * omega
        inner = scipy.linalg.lapack.ztrtrs(pencil, into)[0]
        plain = np.asarray(D + out @ inner, dtype=np.complex128)
        log_radius, slope, x, y = spectral_radius(plain, phases)
        rate = -1j * out @ scipy.linalg.lapack.ztrtrs(pencil, inner)[0]
        turned = plain * np.exp(1j * phases)
        value_now = y.conj() @ turned @ x
        along = np.real((y.conj() @ (rate * np.exp(1j * phases)) @ x) / (value_now or 1e-300)) * omega
        return -log_radius, -np.append(slope[:-1], along)

    free = np.append(start.phases[:-1] - start.phases[-1], 0.0)
    found = scipy.optimize.minimize(descent, free, jac=True, method="BFGS", options={"gtol": 1e-9})
    omega = frequency * float(np.exp(np.clip(found.x[-1], -20.0, 20.0)))
    at_top = response(A, B, C, D, np.array([omega]))[0]
    climbed = mu_lower_at(at_top, np.append(found.x[:-1], 0.0))
    end = _end_of_axis(A, omega)
    if end is not None:  # the climb runs to an end of the axis without ever arriving
        there = mu_lower(response(A, B, C, D, np.array([end]))[0], starts=(climbed.phases,), goal=climbed.value)
        if there.value >= climbed.value * (1.0 - 1e-6) and there.value >= start.value:
            return there, end
    return (climbed, omega) if climbed.value > start.value else (start, frequency)


def _end_of_axis(A: FloatArray, frequency: float) -> float | None:
    """0 or inf for a frequency far below or above every pole."""
    rates = np.abs(np.linalg.eigvals(A))
    if frequency < 1e-4 * float(np.min(rates)):
        return 0.0
    return np.inf if frequency > 1e4 * float(np.max(rates)) else None


def mu_lower_at(value: ComplexArray, phases: FloatArray) -> LowerBound:
    """The lower bound given by the phases as they are."""
    values = np.linalg.eigvals(value * np.exp(1j * phases))
    top = values[int(np.argmax(np.abs(values)))]
    return LowerBound(float(abs(top)), phases, np.asarray(np.exp(1j * phases) / (top or 1e-300)))


def _eliminate(
    A: FloatArray, B: FloatArray, C: FloatArray, D: FloatArray, best: LowerBound, at: float
) -> tuple[float, LowerBound, float]:
    """Raise the level until every frequency is proven below it; the level, and the lower bound perhaps improved."""
    tolerance = _TOLERANCE
    level = best.value * (1.0 + tolerance)
    rest: list[Interval] = [(0.0, np.inf)]
    picks = [at, np.inf, 0.0]
    scales: FloatArray | None = None
    for step in range(_BUDGET * 4):
        if not rest:
            return level, best, at
        if step and step % _PATIENCE == 0:
            tolerance *= 10.0
            level = max(level, best.value * (1.0 + tolerance))
        omega = next_pick(picks, rest)
        value = response(A, B, C, D, np.array([omega]))[0]
        bound = mu_upper(value, start=scales, target=level * (1.0 - 0.1 * tolerance))
        scales = bound.log_scales
        if bound.value >= level * (1.0 - 1e-9):
            climbed, where = _climb(A, B, C, D, omega, value)
            if climbed.value > best.value:
                best, at = climbed, where
            level = max(level, best.value * (1.0 + tolerance), bound.value * (1.0 + tolerance))
        rest = without(rest, _proven(A, B, C, D, bound.log_scales, level, omega))
    return np.inf, best, at


def next_pick(picks: list[float], rest: list[Interval]) -> float:
    """The next frequency to look at: the first pick (taken off the list) that is not yet proven, else in a gap."""
    while picks:
        omega = picks.pop(0)
        if any(low <= omega <= high for low, high in rest):
            return omega
    low, high = rest[0]
    if not np.isfinite(high):
        return 2.0 * low if low > 0.0 else 1.0
    return float(np.sqrt(low * high)) if low > 0.0 else 0.5 * high


def _proven(
    A: FloatArray, B: FloatArray, C: FloatArray, D: FloatArray, scales: FloatArray, level: float, omega: float
) -> Interval:
    """Interval around omega where sigma_max(D N D^-1) < level for the fixed scales."""
    d = np.exp(scales)
    B_d, C_d, D_d = B / d, C * d[:, None], D * d[:, None] / d
    if A.shape[0] == 0:
        return 0.0, np.inf
    if not np.isfinite(omega) and np.linalg.norm(D_d, 2) >= level:
        return omega, omega
    candidates = hamiltonian_frequencies(A, B_d, C_d, D_d, level)
    gains = largest_gain(response(A, B_d, C_d, D_d, candidates)) if candidates.size else np.zeros(0)
    crossings = candidates[gains >= level * (1.0 - 1e-3)]
    below, above = crossings[crossings < omega], crossings[crossings > omega]
    low = float(below.max()) if below.size else 0.0
    high = float(above.min()) if above.size else np.inf
    return low, high


def without(rest: list[Interval], proven: Interval) -> list[Interval]:
    """The rest with one interval taken out; slivers narrower than rounding are taken as covered."""
    low, high = proven
    left: list[Interval] = []
    for a, b in rest:
        for c, d in ((a, min(b, low)), (max(a, high), b)):
            # An interval without end is no sliver: inf - c > 1e-8 inf would say so.
            if d > c and (not np.isfinite(d) or d - c > 1e-8 * d or c == 0.0):
                left.append((c, d))
    return left
