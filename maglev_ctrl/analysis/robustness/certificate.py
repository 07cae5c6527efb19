"""Proof that no combination of real parameters inside a box puts a pole on the axis, at all frequencies.

Scales D and G that are good at one frequency are proven good up to the next eigenvalue of a Hamiltonian matrix on the
axis; the frequencies still open are looked at in turn until none is left (the frequency elimination of
`structured_peak`, with scales for real repeated blocks). The nominal loop is stable, the box is connected, and no pole
can cross: every loop in the box is stable.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from maglev_ctrl.analysis.hamiltonian import balanced_realisation, response
from maglev_ctrl.analysis.robustness.scalings import Scales, balancing, real_mu_upper
from maglev_ctrl.analysis.robustness.uncertain_loop import UncertainLoop
from maglev_ctrl.analysis.robustness.work import Work, matrix_cost
from maglev_ctrl.analysis.structured_peak import Interval, next_pick, without
from maglev_ctrl.arrays import ComplexArray, FloatArray

_AIM = 0.8
_ENOUGH = 0.98
_RISE = 1.025
_MOST_LOOKS = 400
_PROBES = 24
_BEYOND = 30.0
_WORST_SCALES = 1e7
_CLOSENESS = 1e-3
_SINGULAR = 1e-2


@dataclass(frozen=True, eq=False, slots=True)
class Proof:
    """`level` bounds mu at every frequency where `complete`; else the search ended, at `frequency` (rad/s).

    The loop is stable for every combination of changes within +- 1/level.
    """

    level: float
    complete: bool
    frequency: float
    looks: int


def prove(
    loop: UncertainLoop, *, level: float, rising: bool = False, work: Work | None = None, seeds: tuple[float, ...] = ()
) -> Proof:
    """Bound mu of the uncertain loop by `level` at every frequency; `rising` lets the level rise to where it holds.

    Parameters
    ----------
    loop : its nominal state matrix is stable
    work : budget that every look is taken from; left out, without end
    seeds : frequencies (rad/s) to look at first

    Raises
    ------
    ValueError : the nominal loop is not stable, or the level is not positive

    Examples
    --------
    >>> stiff = UncertainLoop.from_affine([[0.0, 1.0], [-4.0, -0.02]], [[[0.0, 0.0], [-4.0, 0.0]]])
    >>> prove(stiff, level=1.001).complete  # stable for every positive stiffness: mu is one, from below at d = -1
    True
    """
    if not (np.isfinite(level) and level > 0.0):
        raise ValueError(f"level: expected a positive number, got {level!r}")
    poles = np.linalg.eigvals(loop.A) if loop.A.size else np.zeros(0, dtype=complex)
    if np.any(poles.real >= 0.0):
        raise ValueError(f"loop: expected a stable nominal loop, got a pole at {poles[np.argmax(poles.real)]:.6g}")
    budget = Work() if work is None else work
    A, B, C, D = _even_channels(loop, np.asarray(poles + 0j))
    order = np.argsort(-poles.real / np.maximum(np.abs(poles), 1e-300))
    rates = np.abs(poles)
    # Not 0 and inf themselves: a channel that vanishes there says nothing about its scale beside them.
    ends = [1e-2 * float(rates.min()), 1e2 * float(rates.max())] if rates.size else [0.0]
    picks = [*(w for w in (*seeds, *np.abs(poles.imag[order])) if w > 0.0), *ends]
    rest: list[Interval] = [(0.0, np.inf)]
    scales: Scales | None = None
    worst = 0.0
    for look in range(_MOST_LOOKS):
        if not rest:
            return Proof(level, True, worst, look)
        if budget.ended():
            return Proof(level, False, worst, look)
        omega = next_pick(picks, rest)
        value = response(A, B, C, D, np.array([omega]))[0]
        bound = real_mu_upper(
            value, loop.blocks, start=scales, level=level, target=_AIM * level, enough=_ENOUGH * level
        )
        if rising and bound.value >= level * _ENOUGH:  # a level once risen stays: look harder before
            budget.spend(bound.work)
            bound = real_mu_upper(value, loop.blocks, start=bound.scales, level=level, target=_ENOUGH * level)
        budget.spend(bound.work)
        scales = bound.scales
        if bound.value >= level * (1.0 - 1e-6):
            worst = omega
            if not rising:
                return Proof(level, False, omega, look)
            level = _RISE * bound.value
        elif bound.value > _AIM * level:
            worst = omega
        low, high = _held(A, B, C, D, scales, level, omega)
        budget.spend(_look_cost(loop))
        if low >= high:  # scales from a neighbour may have run far away: once more from none
            bound = real_mu_upper(value, loop.blocks, level=level, target=_AIM * level)
            scales = bound.scales
            budget.spend(bound.work + _look_cost(loop))
            low, high = _held(A, B, C, D, scales, level, omega)
        if low >= high:
            return Proof(level, False, omega, look)
        rest = without(rest, (low, high))
    return Proof(level, False, rest[0][0] if rest else worst, _MOST_LOOKS)


def _look_cost(loop: UncertainLoop) -> float:
    n, r = map(int, loop.B.shape)
    return matrix_cost(2 * n) + (2 * _PROBES + 2 * n) * matrix_cost(min(n, r))


def _even_channels(loop: UncertainLoop, poles: ComplexArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """The loop with channels and states of even size: a diagonal scale commutes with every repeated block."""
    frequencies = np.append(np.unique(np.abs(poles)), np.inf)
    size = np.max(np.abs(response(loop.A, loop.B, loop.C, loop.D, frequencies)), axis=0) + 0j
    even = np.diag(balancing(size).T).real
    B, C, D = loop.B / even, loop.C * even[:, None], loop.D * even[:, None] / even
    A, B, C = balanced_realisation(loop.A, B, C)
    return A, B, C, D


@dataclass(frozen=True, eq=False, slots=True)
class _Form:
    """Phi(w) = level^2 - N* N - j (G N - N* G) of the scaled loop N = C (j w - A)^-1 B + D; positive: mu < level."""

    A: FloatArray
    B: ComplexArray
    C: ComplexArray
    D: ComplexArray
    G: ComplexArray
    level: float

    def least(self, frequency: FloatArray) -> FloatArray:
        """Smallest eigenvalue of Phi over level^2 at frequencies, inf included; (N,)."""
        if not frequency.size:
            return np.zeros(0)
        finite = np.isfinite(frequency)
        N = np.broadcast_to(self.D, (frequency.size, *self.D.shape)).copy()
        if np.any(finite) and self.A.shape[0]:
            pencil = 1j * frequency[finite, None, None] * np.eye(self.A.shape[0]) - self.A
            N[finite] += self.C @ np.linalg.solve(pencil, np.broadcast_to(self.B, (len(pencil), *self.B.shape)))
        cross = 1j * (self.G @ N)
        whole = np.swapaxes(N.conj(), -1, -2) @ N + cross + np.swapaxes(cross.conj(), -1, -2)
        return np.asarray(1.0 - np.linalg.eigvalsh(whole)[:, -1] / self.level**2)

    def singular_frequencies(self) -> FloatArray:
        """Frequencies where Phi may be singular: eigenvalues of its Hamiltonian matrix near the axis, rad/s."""
        cross = 1j * (self.G @ self.D)
        R = self.level**2 * np.eye(self.D.shape[0]) - self.D.conj().T @ self.D - cross - cross.conj().T
        Q, S = -self.C.conj().T @ self.C, self.C.conj().T @ (1j * self.G - self.D)
        gain = np.linalg.solve(R, np.hstack([S.conj().T, self.B.conj().T]))
        n = self.A.shape[0]
        zero = np.zeros((n, n))
        H = np.block([[self.A + 0j, zero], [-Q, -self.A.conj().T]]) + np.vstack([-self.B, S]) @ gain
        s = np.linalg.eigvals(H)
        size = np.max(np.abs(s), initial=0.0)
        near = (np.abs(s.real) <= _CLOSENESS * np.abs(s) + 1e-13 * size) & (s.imag >= -1e-13 * size)
        return np.unique(np.maximum(s.imag[near], 0.0))


def _held(
    A: FloatArray, B: FloatArray, C: FloatArray, D: FloatArray, scales: Scales, level: float, omega: float
) -> Interval:
    """Interval around omega where the scales prove mu below the level; empty (omega, omega) if not even there."""
    back = np.linalg.inv(scales.T)
    form = _Form(A, B @ back, scales.T @ C, scales.T @ D @ back, scales.G, level)
    if np.linalg.cond(scales.T) > _WORST_SCALES or not form.least(np.array([omega]))[0] > 0.0:
        return omega, omega
    if A.shape[0] == 0:
        return 0.0, np.inf
    try:
        candidates = form.singular_frequencies()
    except np.linalg.LinAlgError:
        return omega, omega
    crossings = candidates[form.least(candidates) <= _SINGULAR]
    below, above = crossings[crossings < omega], crossings[crossings > omega]
    low, high = (float(below.max()) if below.size else 0.0), (float(above.min()) if above.size else np.inf)
    # Looked at a second way, without the Hamiltonian matrix: one refutation, and the scales cannot be trusted.
    size = np.abs(np.linalg.eigvals(A))
    size = size[size > 0.0] if np.any(size > 0.0) else np.ones(1)
    spread = np.geomspace(size.min() / _BEYOND, size.max() * _BEYOND, _PROBES)
    start, end = max(low, 1e-3 * float(size.min())), min(high, 1e3 * float(size.max()))
    own = np.geomspace(start, end, _PROBES)[1:-1] if start < end else np.zeros(0)
    inside = np.concatenate([spread, own, size, 0.5 * (candidates[1:] + candidates[:-1]), [0.0, np.inf]])
    margin = 1e-6 * inside
    margin[~np.isfinite(inside)] = 0.0
    held = ((inside - margin > low) | ((inside == 0.0) & (low == 0.0))) & ((inside + margin < high) | (high == np.inf))
    inside = inside[held]
    return (omega, omega) if np.any(form.least(inside) <= 0.0) else (low, high)
