"""Upper bound of the structured singular value of real repeated parameters at one frequency, by scales D and G.

mu(M) <= b where M* D M + j (G M - M* G) < b^2 D for some D > 0, G Hermitian, both block diagonal (Fan, Tits & Doyle,
IEEE Trans. Autom. Control 36 (1991) 25; Young, Newlin & Doyle 1995). In the coordinates T, D = T* T, that is
largest singular value of (N - j G)(b^2 I + G^2)^(-1/2) below 1 with N = T M T^-1: a norm, so that a Hamiltonian matrix
tells how far around the frequency the same scales hold.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg
import scipy.optimize

from maglev_ctrl.analysis.robustness.work import matrix_cost
from maglev_ctrl.arrays import ComplexArray, FloatArray

_SHARPNESS = (8.0, 80.0, 800.0)
_STEPS = (60, 60, 80)
_LEAST_D = 1e-2
_PULL = 1e-9
_LARGEST_G = 1e3
_EVENED = 1e-8
_DESCENT = 5.0


@dataclass(frozen=True, eq=False, slots=True)
class Scales:
    """T (r, r), invertible, and G (r, r), Hermitian, both block diagonal; G belongs to the coordinates of T."""

    T: ComplexArray
    G: ComplexArray


@dataclass(frozen=True, eq=False, slots=True)
class ScaledBound:
    """The bound `value` on mu that the scales prove at one frequency; `work` units went into it."""

    value: float
    scales: Scales
    work: float = 0.0


def real_mu_upper(
    matrix: ComplexArray, blocks: tuple[int, ...], *, start: Scales | None = None, level: float = 0.0,
    target: float = 0.0, enough: float = 0.0,
) -> ScaledBound:  # fmt: skip
    """Upper bound of mu of M (r, r) against real repeated scalar blocks; the search ends once it is below `target`.

    Parameters
    ----------
    start : scales of a neighbouring frequency, tried first
    level : size to judge by; left out, the largest singular value after balancing
    enough : with a bound below it no further, sharper descent is begun

    Examples
    --------
    >>> one = real_mu_upper(np.array([[0.1 + 5j]]), (1,))  # no real d makes 1 - d M zero
    >>> one.value < 0.2
    True
    """
    candidates = [balancing(matrix)]
    if start is not None and np.linalg.norm(start.G, 2) <= _LARGEST_G * max(level, 1e-300):
        candidates.append(start)
    values = [_proven(matrix, scales) for scales in candidates]
    best = int(np.argmin(values))
    bound = ScaledBound(values[best], candidates[best])
    if level <= 0.0:
        level = values[0] or 1.0
    spent = 0.0
    for sharpness, steps in zip(_SHARPNESS, _STEPS, strict=True):
        if bound.value <= max(target, enough) or bound.value == 0.0:
            break
        unit = Scales(bound.scales.T, bound.scales.G / level)
        found, looks = _descended(matrix / level, blocks, unit, sharpness, steps, goal=(target / level) ** 2)
        spent += _DESCENT * looks * matrix_cost(matrix.shape[0])
        trial = Scales(found.T, found.G * level)
        value = _proven(matrix, trial)
        if value < bound.value:
            bound = ScaledBound(value, trial)
    return replace(bound, work=spent)


def balancing(matrix: ComplexArray) -> Scales:
    """Scales without G that even out rows and columns (Osborne's balancing)."""
    r = matrix.shape[0]
    size = np.abs(matrix) ** 2
    np.fill_diagonal(size, 0.0)
    floor = max(_EVENED * float(np.max(np.abs(matrix) ** 2, initial=0.0)), 1e-280)
    x = np.zeros(r)
    for _ in range(20):
        moved = 0.0
        for i in range(r):
            weight = np.exp(2.0 * (x[i] - x))
            change = 0.25 * float(np.log((size[:, i] @ (1.0 / weight) + floor) / (size[i] @ weight + floor)))
            x[i] += change
            moved = max(moved, abs(change))
        if moved < 1e-6:
            break
    return Scales(np.diag(np.exp(np.clip(x - np.mean(x), -30.0, 30.0))).astype(complex), np.zeros((r, r), complex))


def block_mask(blocks: tuple[int, ...]) -> FloatArray:
    """Ones where a block diagonal matrix may differ from zero; (r, r)."""
    return np.asarray(scipy.linalg.block_diag(*(np.ones((size, size)) for size in blocks)), dtype=np.float64)


def scaled_response(matrix: ComplexArray, scales: Scales) -> ComplexArray:
    """T M T^-1 of M (..., r, r)."""
    return np.asarray(scales.T @ matrix @ np.linalg.inv(scales.T))


def _proven(matrix: ComplexArray, scales: Scales) -> float:
    """The bound on mu the scales prove: root of the largest eigenvalue of N* N + j (G N - N* G), or 0 below zero."""
    N = scaled_response(matrix, scales)
    if not np.all(np.isfinite(N)):
        return np.inf
    cross = 1j * (scales.G @ N)
    top = float(np.linalg.eigvalsh(N.conj().T @ N + cross + cross.conj().T)[-1])
    return float(np.sqrt(max(top, 0.0)))


class _Reached(Exception):
    """The goal is reached; there is nothing left to find."""


def _descended(
    matrix: ComplexArray, blocks: tuple[int, ...], start: Scales, sharpness: float, steps: int, *, goal: float
) -> tuple[Scales, int]:
    """Scales after a descent of a smooth maximum of the eigenvalues (generalised, of the pencil in D and G), looks."""
    r = matrix.shape[0]
    rows, columns = np.nonzero(block_mask(blocks))
    count = rows.size
    N = scaled_response(matrix, start)
    best: list[tuple[float, FloatArray]] = []
    looks = 0

    def unpacked(free: FloatArray) -> tuple[ComplexArray, ComplexArray]:
        X, Y = np.zeros((r, r), complex), np.zeros((r, r), complex)
        X[rows, columns] = free[:count] + 1j * free[count : 2 * count]
        Y[rows, columns] = free[2 * count : 3 * count] + 1j * free[3 * count :]
        return np.asarray(np.eye(r) + X), np.asarray(start.G + 0.5 * (Y + Y.conj().T))

    def descent(free: FloatArray) -> tuple[float, FloatArray]:
        nonlocal looks
        looks += 1
        T, G = unpacked(free)
        D = T.conj().T @ T + _LEAST_D * np.eye(r)
        back = np.linalg.inv(np.linalg.cholesky(D)).conj().T
        cross = 1j * (G @ N)
        F = back.conj().T @ (N.conj().T @ D @ N + cross + cross.conj().T) @ back
        values, vectors = np.linalg.eigh(0.5 * (F + F.conj().T))
        top = float(values[-1])
        if not best or top < best[0][0]:
            best[:] = [(top, free.copy())]
            if top <= goal:
                raise _Reached
        sharp = sharpness / max(1.0, abs(scale))
        weights = np.exp(sharp * (values - top))
        total = float(weights.sum())
        v = back @ vectors
        y = N @ v
        share = weights / total
        by_D = (y * share) @ y.conj().T - (v * (share * values)) @ v.conj().T
        turn = 1j * ((y * share) @ v.conj().T)
        by_X, by_Y = 2.0 * by_D @ T.conj().T, turn + turn.conj().T
        slope = np.concatenate([
            by_X[columns, rows].real, -by_X[columns, rows].imag, by_Y[columns, rows].real, -by_Y[columns, rows].imag
        ])  # fmt: skip
        # A faint pull keeps the scales finite where the best ones are not: what is proven near infinity holds nowhere.
        pull = _PULL * float(free @ free)
        return top + float(np.log(total)) / sharp + pull, slope + 2.0 * _PULL * free

    zero = np.zeros(4 * count)
    scale = 1.0
    cross = 1j * (start.G @ N)
    scale = float(np.linalg.eigvalsh(N.conj().T @ N + cross + cross.conj().T)[-1])
    with suppress(_Reached):
        scipy.optimize.minimize(
            descent, zero, jac=True, method="L-BFGS-B", options={"maxiter": steps, "maxcor": 20, "ftol": 1e-7}
        )
    X, G = unpacked(best[0][1])
    least = _LEAST_D
    while True:  # the scales form a convex cone: adding to D moderates G
        T = np.linalg.cholesky(X.conj().T @ X + least * np.eye(r)).conj().T
        back = np.linalg.inv(T)
        moved = back.conj().T @ G @ back
        if np.linalg.norm(moved, 2) <= _LARGEST_G:
            break
        least *= 4.0
    return Scales(np.asarray(T @ start.T), np.asarray(0.5 * (moved + moved.conj().T))), looks
