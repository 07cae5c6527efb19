"""Floquet multipliers and exponents of a periodic system by two independent engines, with error bounds.

Time domain: Taylor propagators over segments and a periodic QR iteration, never their product where moduli spread.
Frequency domain: Hill's method with harmonics added until nothing changes. The exponents are those of the first; the
second has to agree, or the result says UNRESOLVED.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.sparse.csgraph import connected_components

from maglev_ctrl.arrays import ComplexArray, FloatArray, read_only_any
from maglev_ctrl.display import Shown
from maglev_ctrl.errors import Agreement
from maglev_ctrl.kernels import (
    TaylorPlan,
    balance,
    check_periodic,
    eigen_triplets,
    hill_spectrum,
    periodic_multipliers,
    propagators_over_depths,
    rescale,
    taylor_plan,
    tree_product,
)
from maglev_ctrl.systems import PeriodicSystem

_CLUSTER = 1e-5  # exponents nearer than this (relative) count as one nearly defective group
_NEGLIGIBLE = np.log(1e-16)  # a multiplier this far below the largest cannot decide anything
_LOOSE = 1e-6


@dataclass(frozen=True, eq=False, slots=True)
class EngineRecord:
    """What one engine found: its exponents (n,) 1/s, imaginary parts within -W/2..W/2, and how hard it worked."""

    name: str
    exponents: ComplexArray
    resolution: str
    converged: bool


@dataclass(frozen=True, eq=False, slots=True, repr=False)
class Floquet(Shown):
    """Floquet analysis of x' = A(t) x with period `period` (s).

    `exponents` (n,) 1/s, largest growth first, imaginary parts within -W/2..W/2; `multipliers` (n,) = exp(exponent
    period); `error_bound` (n,) 1/s on the modulus of the error of each exponent; `engines`: time domain, then Hill.
    """

    _told: ClassVar = ("growth_rate", "growth_error", "spectral_radius", "stable", "agreement", "period")

    multipliers: ComplexArray
    exponents: ComplexArray
    error_bound: FloatArray
    agreement: Agreement
    engines: tuple[EngineRecord, EngineRecord]
    period: float

    @property
    def growth_rate(self) -> float:
        """Largest real part of an exponent, 1/s."""
        return float(self.exponents[0].real)

    @property
    def growth_error(self) -> float:
        """Bound on the error of `growth_rate`, 1/s."""
        reach = self.exponents.real + self.error_bound
        return float(np.max(reach) - self.growth_rate)

    @property
    def spectral_radius(self) -> float:
        """Largest modulus of a multiplier."""
        return float(np.exp(self.growth_rate * self.period))

    @property
    def stable(self) -> bool | None:
        """True or False beyond the error bound; None when the engines disagree or the bound straddles zero."""
        if self.agreement is not Agreement.AGREED or abs(self.growth_rate) <= self.growth_error:
            return None
        return self.growth_rate < 0.0


def floquet(system: PeriodicSystem, *, agreement_tolerance: float = 1e-8, min_segments: int = 1) -> Floquet:
    """Floquet multipliers and exponents with error bounds, computed twice.

    Parameters
    ----------
    system : one periodic system (no batch axes)
    agreement_tolerance : largest difference of the engines, relative to max(W, |exponent|). Nearly defective groups
        are compared by their mean, which is well conditioned; exponents whose multiplier is below 1e-16 of the
        largest are compared to 1e-6
    min_segments : fewest segments per period of the time-domain engine; the result does not depend on it

    Raises
    ------
    ValueError : the system carries batch axes, entries that are not finite, or a frequency that is not positive

    References
    ----------
    Yakubovich, Starzhinskii, Linear Differential Equations with Periodic Coefficients (1975).

    Examples
    --------
    >>> mathieu = PeriodicSystem.from_matrices([[0, 1], [-1, 0]], [[[0, 0], [-0.4, 0]]], frequency=2.0)
    >>> result = floquet(mathieu)
    >>> round(result.growth_rate, 6), result.agreement.value
    (0.099536, 'AGREED')
    """
    if system.A_0.ndim != 2 or system.A_cos.ndim != 3 or system.frequency.ndim != 0:
        raise ValueError("system: expected one periodic system, got batch axes; see resonance_map for batches")
    frequency = float(system.frequency)
    if system.A_cos.shape[0] == 0:
        none = read_only_any(np.zeros((1, *system.A_0.shape)))
        system = replace(system, A_cos=none, A_sin=none)
    check_periodic(system.A_0, system.A_cos, system.A_sin, frequency)
    period = 2.0 * np.pi / frequency
    A_0, A_cos, A_sin = scaled_coefficients(system.A_0, system.A_cos, system.A_sin)
    plan = plan_for(A_0, A_cos, A_sin, frequency=frequency, min_segments=min_segments)
    factors = propagators_over_depths(A_0, A_cos, A_sin, frequency=frequency, depths=np.ones(1), plan=plan)[0]
    product = periodic_multipliers(factors)
    time_exponents = _principal(product.logs / period, frequency)
    hill = hill_spectrum(A_0, A_cos, A_sin, frequency=frequency)
    engines = (
        EngineRecord("time domain", time_exponents, f"{plan.segments} segments, order {plan.order}, "
                     f"{product.sweeps} sweeps", product.converged),
        EngineRecord("Hill", _principal(hill.exponents, frequency), f"{hill.harmonics} harmonics", hill.converged),
    )  # fmt: skip
    own = _own_error(factors, plan, product.error, time_exponents, period)
    difference = _matched_difference(time_exponents, hill.exponents, frequency)
    agreed = hill.converged and _agree(time_exponents, difference, frequency, period, agreement_tolerance)
    return Floquet(
        multipliers=read_only_any(np.exp(time_exponents * period)),
        exponents=read_only_any(time_exponents),
        error_bound=read_only_any(own + np.abs(difference)),
        agreement=Agreement.AGREED if agreed else Agreement.UNRESOLVED,
        engines=engines,
        period=period,
    )


def scaled_coefficients(
    A_0: FloatArray, A_cos: FloatArray, A_sin: FloatArray, *, depth: float = 1.0
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Fourier coefficients in balanced coordinates, the same diagonal scaling for all of them."""
    magnitude = np.abs(A_0) + depth * np.sum(np.abs(A_cos) + np.abs(A_sin), axis=0)
    scale = balance(magnitude)
    return rescale(A_0, scale), rescale(A_cos, scale), rescale(A_sin, scale)


def plan_for(
    A_0: FloatArray, A_cos: FloatArray, A_sin: FloatArray, *, frequency: float, depth: float = 1.0,
    tolerance: float = 1e-16, min_segments: int = 1,
) -> TaylorPlan:  # fmt: skip
    """Segments and order of the Taylor propagators for one system."""
    norms = np.array([depth * (np.linalg.norm(a, 2) + np.linalg.norm(b, 2)) for a, b in zip(A_cos, A_sin, strict=True)])
    return taylor_plan(
        float(np.linalg.norm(A_0, 2)), norms, frequency=frequency, tolerance=tolerance, min_segments=min_segments
    )


def _principal(exponents: ComplexArray, frequency: float) -> ComplexArray:
    """Imaginary parts folded into (-W/2, W/2]."""
    turns = np.ceil(exponents.imag / frequency - 0.5 - 1e-12)
    return np.asarray(exponents - 1j * frequency * turns)


def _own_error(
    factors: FloatArray, plan: TaylorPlan, relative: FloatArray, exponents: ComplexArray, period: float
) -> FloatArray:
    """Error of the time-domain engine by its own account: backward error times conditioning, 1/s."""
    n = factors.shape[-1]
    backward = plan.segments * plan.truncation + 50.0 * np.finfo(float).eps * np.sqrt(plan.segments) * n
    condition = _conditions(factors, exponents, period)
    multiplied = (backward + relative) * condition
    # a nearly defective multiplier moves by the root of the perturbation, not by its condition times it
    return np.asarray(np.minimum(multiplied, 10.0 * np.sqrt(backward + relative)) / period)


def _conditions(factors: FloatArray, exponents: ComplexArray, period: float) -> FloatArray:
    """Condition of each multiplier; those too small for the explicit product get the worst one of the others."""
    product = tree_product(factors)
    values, left, right = eigen_triplets(product)
    overlap = np.abs(np.sum(left.conj() * right, axis=0))
    condition = 1.0 / np.maximum(overlap, 1e-16)
    size = float(np.linalg.norm(product, 2))
    wanted = np.exp(np.minimum(exponents.real * period, 700.0)) * np.exp(1j * exponents.imag * period)
    result = np.empty(len(exponents))
    for i, multiplier in enumerate(wanted):
        nearest = int(np.argmin(np.abs(values - multiplier)))
        lift = size / abs(multiplier) if abs(multiplier) > 1e-6 * size else 1.0
        result[i] = max(condition[nearest] * lift, 1.0)
    return result


def _matched_difference(found: ComplexArray, others: ComplexArray, frequency: float) -> ComplexArray:
    """found - partner for each exponent, imaginary part modulo W, partners assigned one to one."""
    if not np.all(np.isfinite(others)):
        return np.full(len(found), np.inf + 0j)
    difference = found[:, None] - others[None, :]
    difference = difference - 1j * frequency * np.round(difference.imag / frequency)
    rows, columns = linear_sum_assignment(np.abs(difference))
    return np.asarray(difference[rows, columns])


def _agree(
    exponents: ComplexArray, difference: ComplexArray, frequency: float, period: float, tolerance: float
) -> bool:
    """Whether the engines agree, nearly defective groups by their mean."""
    if not np.all(np.isfinite(difference)):
        return False
    scale = np.maximum(frequency, np.abs(exponents))
    apart = exponents[:, None] - exponents[None, :]
    apart = apart - 1j * frequency * np.round(apart.imag / frequency)
    count, labels = connected_components(np.abs(apart) <= _CLUSTER * scale[:, None], directed=False)
    negligible = (exponents.real - exponents.real[0]) * period < _NEGLIGIBLE
    allowed = np.where(negligible, max(_LOOSE, tolerance), tolerance) * scale
    for group in range(count):
        members = labels == group
        spread = _LOOSE * scale[members] if np.sum(members) > 1 else allowed[members]
        mean_fits = abs(np.mean(difference[members])) <= np.min(allowed[members])
        if not mean_fits or np.any(np.abs(difference[members]) > np.maximum(spread, allowed[members])):
            return False
    return True
