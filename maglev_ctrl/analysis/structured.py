"""Structured singular value of complex diagonal uncertainty: upper bound by scaling, lower bound by construction.

mu(N) = 1 / min{ max_i |delta_i| : det(I - N diag(delta)) = 0 }. Doyle (1982); Packard & Doyle (1993).
Upper: inf over D = diag(exp x) of sigma_max(D N D^-1), convex in x. Lower: max over phases of the spectral radius
rho(N diag(exp j theta)). They coincide for at most three blocks.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.optimize

from maglev_ctrl.arrays import ComplexArray, FloatArray, read_only_any

_POWERS = (3.0, 30.0, 300.0, 3000.0)
_LIMIT = 40.0


@dataclass(frozen=True, eq=False, slots=True)
class UpperBound:
    """sigma_max(D N D^-1) for D = diag(exp(log_scales)); the last entry of log_scales is 0."""

    value: float
    log_scales: FloatArray


@dataclass(frozen=True, eq=False, slots=True)
class LowerBound:
    """Spectral radius reached by N diag(exp(j phases)), and a perturbation that makes I - N Delta singular."""

    value: float
    phases: FloatArray
    perturbation: ComplexArray


def scaled(matrix: ComplexArray, log_scales: FloatArray) -> ComplexArray:
    """D N D^-1 with D = diag(exp(log_scales))."""
    return np.asarray(matrix * np.exp(log_scales[:, None] - log_scales[None, :]))


def mu_upper(matrix: ComplexArray, *, start: FloatArray | None = None, target: float = 0.0) -> UpperBound:
    """Smallest scaled largest singular value; stops early once it is below `target`.

    Examples
    --------
    >>> round(mu_upper(np.array([[0.0, 100.0], [0.01, 0.0]], dtype=complex)).value, 6)
    1.0
    """
    m = matrix.shape[0]
    if m == 1:
        return UpperBound(float(abs(matrix[0, 0])), np.zeros(1))
    candidates = [_evenly_scaled(matrix)] + ([start] if start is not None else [])
    values = [_top(matrix, x) for x in candidates]
    x, best = candidates[int(np.argmin(values))], float(np.min(values))
    if best <= target or best == 0.0:
        return UpperBound(best, x)
    for power in _POWERS:

        def smooth(free: FloatArray, power: float = power) -> tuple[float, FloatArray]:
            return _smooth_norm(matrix, np.append(free, 0.0), power)

        found = scipy.optimize.minimize(smooth, x[:-1] - x[-1], jac=True, method="BFGS", options={"gtol": 1e-9})
        trial = np.append(np.clip(found.x, -_LIMIT, _LIMIT), 0.0)
        value = _top(matrix, trial)
        if value < best:
            x, best = trial, value
        if best <= target:
            break
    return UpperBound(best, x)


def mu_lower(matrix: ComplexArray, *, starts: tuple[FloatArray, ...] = (), goal: float = np.inf) -> LowerBound:
    """Largest spectral radius over the phases, by local ascent from several starts (deterministic).

    Ascent ends early once it reaches `goal`, the upper bound, where there is nothing left to find.

    Examples
    --------
    >>> bound = mu_lower(np.array([[1.0, 2.0], [3.0, -4.0]], dtype=complex))
    >>> closed = np.eye(2) - np.array([[1.0, 2.0], [3.0, -4.0]]) @ np.diag(bound.perturbation)
    >>> bool(abs(np.linalg.det(closed)) < 1e-9)
    True
    """
    m = matrix.shape[0]
    if m == 1:
        return _lower(matrix, np.zeros(1))
    generator = np.random.default_rng(7)
    best, phases = -np.inf, np.zeros(m)
    for start in [*starts, np.zeros(m), *generator.uniform(-np.pi, np.pi, (m + 2, m))]:
        value, found = _ascend(matrix, np.asarray(start))
        if value > best:
            best, phases = value, found
        if np.exp(best) >= goal * (1.0 - 1e-9):
            break
    return _lower(matrix, phases)


def phases_from_scaling(matrix: ComplexArray, log_scales: FloatArray) -> FloatArray:
    """Phases that turn the top right singular vector onto the left one: the optimum where it is alone."""
    left, _, right = np.linalg.svd(scaled(matrix, log_scales))
    return np.asarray(np.angle(right[0].conj()) - np.angle(left[:, 0]))


def spectral_radius(matrix: ComplexArray, phases: FloatArray) -> tuple[float, FloatArray, ComplexArray, ComplexArray]:
    """log rho(N diag(exp j phases)), its gradient by the phases, and the right and left eigenvectors (y^H x = 1)."""
    turned = matrix * np.exp(1j * phases)
    values, vectors = np.linalg.eig(turned)
    top = int(np.argmax(np.abs(values)))
    x = vectors[:, top]
    try:
        y = np.linalg.inv(vectors)[top].conj()
    except np.linalg.LinAlgError:
        y = x
    scale = y.conj() @ x
    y = y / np.conj(scale)
    # d lambda / d phase_k = j lambda conj(y_k) x_k, so the modulus grows by Re(j conj(y_k) x_k)
    return float(np.log(np.abs(values[top]) + 1e-300)), np.real(1j * y.conj() * x), x, y


def _lower(matrix: ComplexArray, phases: FloatArray) -> LowerBound:
    values = np.linalg.eigvals(matrix * np.exp(1j * phases))
    top = values[int(np.argmax(np.abs(values)))]
    if top == 0.0:
        return LowerBound(0.0, phases, read_only_any(np.full(len(phases), np.inf + 0j)))
    return LowerBound(float(abs(top)), phases, read_only_any(np.exp(1j * phases) / top))


def _ascend(matrix: ComplexArray, start: FloatArray) -> tuple[float, FloatArray]:
    def descent(free: FloatArray) -> tuple[float, FloatArray]:
        value, slope, _, _ = spectral_radius(matrix, np.append(free, 0.0))
        return -value, -slope[:-1]

    found = scipy.optimize.minimize(descent, start[:-1] - start[-1], jac=True, method="BFGS", options={"gtol": 1e-10})
    return -float(found.fun), np.append(found.x, 0.0)


def _evenly_scaled(matrix: ComplexArray) -> FloatArray:
    """Osborne's balancing: rows and columns of even norm."""
    size = np.abs(matrix) ** 2
    np.fill_diagonal(size, 0.0)
    x = np.zeros(matrix.shape[0])
    floor = max(1e-30 * float(np.max(size, initial=0.0)), 1e-280)
    for _ in range(12):
        moved = 0.0
        for i in range(len(x)):
            weight = np.exp(2.0 * (x[i] - x))
            row, column = float(size[i] @ weight), float(size[:, i] @ (1.0 / weight))
            change = 0.25 * float(np.log((column + floor) / (row + floor)))
            x[i] += change
            moved = max(moved, abs(change))
        if moved < 1e-13:
            break
    return np.asarray(np.clip(x - x[-1], -_LIMIT, _LIMIT))


def _top(matrix: ComplexArray, log_scales: FloatArray) -> float:
    return float(np.linalg.svd(scaled(matrix, log_scales), compute_uv=False)[0])


def _smooth_norm(matrix: ComplexArray, log_scales: FloatArray, power: float) -> tuple[float, FloatArray]:
    """Logarithm of the Schatten norm of order 2 power (convex in the scales) and its gradient by all but the last."""
    left, values, right = np.linalg.svd(scaled(matrix, np.clip(log_scales, -2 * _LIMIT, 2 * _LIMIT)))
    logs = np.log(values + 1e-300)
    weights = np.exp(2.0 * power * (logs - logs[0]))
    share = weights / weights.sum()
    norm = float(logs[0] + np.log(weights.sum()) / (2.0 * power))
    slope = (np.abs(left) ** 2) @ share - (np.abs(right.T) ** 2) @ share
    # A faint pull to the middle keeps decoupled channels, whose best scale is infinite, finite.
    return norm + 1e-12 * float(log_scales @ log_scales), (slope + 2e-12 * log_scales)[:-1]
