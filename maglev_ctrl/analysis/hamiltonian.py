"""Peak gain over all frequencies from the eigenvalues of Hamiltonian matrices: no grid, so no missed peak.

Level test of Boyd, Balakrishnan & Kabamba (1989); two-step iteration of Boyd & Balakrishnan (1990) and
Bruinsma & Steinbuch (1990). The singular values of G(j omega) equal a level exactly where the Hamiltonian
matrix of that level has an eigenvalue j omega.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from maglev_ctrl.analysis.loops import state_scales
from maglev_ctrl.arrays import ComplexArray, FloatArray
from maglev_ctrl.errors import NotStable

_COARSE_STEPS = (1e-2, 1e-5)
_MAX_ITERATIONS = 60


@dataclass(frozen=True, eq=False, slots=True)
class PeakGain:
    """Largest singular value over all frequencies: attained at `frequency` (rad/s), proven not above `upper`.

    As far as rounding lets tell: where it moves the peak by more than the tolerance, `upper` is further up.
    """

    lower: float
    upper: float
    frequency: float


def balanced_realisation(A: FloatArray, B: FloatArray, C: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """State space with states scaled by powers of two."""
    scale = state_scales(A, B, C)
    return A * scale / scale[:, None], B / scale[:, None], C * scale


def continuous_equivalent(
    A: FloatArray, B: FloatArray, C: FloatArray, D: FloatArray, dt: float
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Continuous system with the same values on its axis as a discrete one on the unit circle.

    s = (2/dt)(z - 1)/(z + 1): frequency w of the discrete system appears at (2/dt) tan(w dt/2), Nyquist at infinity.
    """
    n = A.shape[0]
    plus = A + np.eye(n)
    into, out = np.linalg.solve(plus, B), np.linalg.solve(plus.T, C.T).T
    A_c = np.asarray((2.0 / dt) * np.linalg.solve(plus, A - np.eye(n)), dtype=np.float64)
    return A_c, 2.0 / np.sqrt(dt) * into, 2.0 / np.sqrt(dt) * out, D - C @ into


def response(A: FloatArray, B: FloatArray, C: FloatArray, D: FloatArray, frequency: FloatArray) -> ComplexArray:
    """C (j w I - A)^-1 B + D for frequencies in rad/s, inf included; (N, p, m)."""
    omega = np.atleast_1d(np.asarray(frequency, dtype=np.float64))
    values = np.empty((omega.size, *D.shape), dtype=complex)
    finite = np.isfinite(omega)
    values[~finite] = D
    if A.shape[0] == 0:
        values[:] = D
    elif np.any(finite):
        pencil = 1j * omega[finite, None, None] * np.eye(A.shape[0]) - A
        values[finite] = D + C @ np.linalg.solve(pencil, B + 0j)
    return values


def largest_gain(matrices: ComplexArray) -> FloatArray:
    """Largest singular value of every matrix of a stack."""
    if matrices.shape[-2:] == (1, 1):
        return np.asarray(np.abs(matrices[..., 0, 0]))
    return np.asarray(np.linalg.svd(matrices, compute_uv=False)[..., 0])


def hamiltonian_frequencies(
    A: FloatArray, B: FloatArray, C: FloatArray, D: FloatArray, level: float, *, closeness: float = 1e-4
) -> FloatArray:
    """Frequencies (rad/s, sorted) where a singular value may equal `level`: eigenvalues on or close to the axis.

    `closeness` is generous (real part relative to modulus): an eigenvalue too many costs one evaluation, one too
    few costs the peak.
    """
    root = np.sqrt(level)
    B_s, C_s, D_s = B / root, C / root, D / level
    right = np.linalg.inv(np.eye(D.shape[1]) - D_s.T @ D_s)
    left = np.eye(D.shape[0]) + D_s @ right @ D_s.T
    F = A + B_s @ right @ D_s.T @ C_s
    H = np.block([[F, B_s @ right @ B_s.T], [-C_s.T @ left @ C_s, -F.T]])
    s = np.linalg.eigvals(H)
    near = np.abs(s.real) <= closeness * np.abs(s) + 1e-14 * np.max(np.abs(s), initial=0.0)
    return np.unique(np.abs(s.imag[near]))


def peak_gain(
    A: ArrayLike,
    B: ArrayLike,
    C: ArrayLike,
    D: ArrayLike,
    *,
    dt: float | None = None,
    tolerance: float = 1e-9,
    extra: ArrayLike = (),
) -> PeakGain:
    """Largest singular value of C (sI - A)^-1 B + D over the whole frequency axis (the L-infinity norm).

    Parameters
    ----------
    A, B, C, D : state space without poles on the axis
    dt : sampling period in s; None for continuous time
    tolerance : relative width of [lower, upper]
    extra : frequencies (rad/s) to start from besides those of the poles

    Examples
    --------
    >>> peak = peak_gain([[0.0, 1.0], [-1.0, -2e-4]], [[0.0], [1.0]], [[0.0, 2e-4]], [[0.0]])
    >>> round(peak.lower, 9), round(peak.frequency, 6)
    (1.0, 1.0)
    """
    a, b, c, d = (np.asarray(value, dtype=np.float64) for value in (A, B, C, D))
    start = np.asarray(extra, dtype=np.float64)
    if dt is not None:
        a, b, c, d = continuous_equivalent(a, b, c, d, dt)
        start = 2.0 / dt * np.tan(np.minimum(start * dt, np.pi * (1 - 1e-12)) / 2.0)
    peak = _peak_continuous(*balanced_realisation(a, b, c), d, tolerance=tolerance, extra=start)
    if dt is None:
        return peak
    return PeakGain(peak.lower, peak.upper, 2.0 / dt * float(np.arctan(peak.frequency * dt / 2.0)))


def _peak_continuous(
    A: FloatArray, B: FloatArray, C: FloatArray, D: FloatArray, *, tolerance: float, extra: FloatArray
) -> PeakGain:
    poles = np.linalg.eigvals(A)
    seeds = np.concatenate([extra, np.abs(poles.imag), np.abs(poles), [0.0, np.inf]])
    gains = largest_gain(response(A, B, C, D, seeds))
    best, at = float(np.max(gains)), float(seeds[int(np.argmax(gains))])
    if A.shape[0] == 0 or best == 0.0:
        return PeakGain(best, best, 0.0 if A.shape[0] == 0 else at)
    # A coarse level first: near the feedthrough the fine level is ill-conditioned, and a missed hump must be tiny.
    for step in (*_COARSE_STEPS, tolerance):
        for _ in range(_MAX_ITERATIONS):
            level = best * (1.0 + step)
            crossings = hamiltonian_frequencies(A, B, C, D, level)
            points = np.concatenate([crossings, 0.5 * (crossings[1:] + crossings[:-1])])
            if not points.size:
                break
            gains = largest_gain(response(A, B, C, D, points))
            top = int(np.argmax(gains))
            if gains[top] > best:
                at = float(points[top])
                risen = gains[top] > level
                best = float(gains[top])
                if risen:
                    continue
            break
    # A peak of damping ratio 1e-13 is narrower than the frequencies and entries it is computed from are apart.
    rounding = gain_rounding(A, B, C, D, 1j * at)
    return PeakGain(best, best * (1.0 + max(tolerance, rounding)), at)


def gain_rounding(A: FloatArray, B: FloatArray, C: FloatArray, D: FloatArray, point: complex) -> float:
    """Relative error of the gain at a point when the entries of A are known to the rounding unit, first order.

    A peak of damping ratio z moves by about the rounding unit over z: at 1e-10 six digits are left.

    Examples
    --------
    >>> gain_rounding(np.array([[-1.0]]), np.array([[1.0]]), np.array([[1.0]]), np.zeros((1, 1)), 0j) < 1e-15
    True
    """
    if not np.isfinite(point) or not A.size:
        return 0.0
    resolvent = np.linalg.inv(point * np.eye(len(A)) - A)
    spread = np.abs(C @ resolvent) @ (np.abs(A) + abs(point) * np.eye(len(A))) @ np.abs(resolvent @ B)
    gain = float(np.linalg.norm(D + C @ resolvent @ B, 2))
    return float(np.finfo(float).eps) * float(np.linalg.norm(spread)) / gain if gain > 0.0 else 0.0


def h_infinity_norm(
    A: ArrayLike, B: ArrayLike, C: ArrayLike, D: ArrayLike, *, dt: float | None = None, tolerance: float = 1e-9
) -> PeakGain:
    """H-infinity norm of a stable system: its peak gain, after the poles have been looked at.

    Raises
    ------
    NotStable : a pole is on or beyond the axis; the norm of an unstable system is infinite

    Examples
    --------
    >>> round(h_infinity_norm([[-2.0]], [[1.0]], [[4.0]], [[0.0]]).lower, 9)
    2.0
    """
    poles = np.linalg.eigvals(np.asarray(A, dtype=np.float64)) if np.size(A) else np.zeros(0, dtype=complex)
    beyond = poles.real if dt is None else np.abs(poles) - 1.0
    if np.any(beyond >= 0.0):
        worst = poles[int(np.argmax(beyond))]
        raise NotStable(f"the H-infinity norm is infinite: pole at {worst:.6g}")
    return peak_gain(A, B, C, D, dt=dt, tolerance=tolerance)
