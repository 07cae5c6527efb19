"""H-infinity norm with exact gradient: peaks by Hamiltonian levels, derivatives from singular vectors."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from maglev_ctrl.analysis.hamiltonian import continuous_equivalent, hamiltonian_frequencies
from maglev_ctrl.arrays import ComplexArray, FloatArray
from maglev_ctrl.synthesis.structured.loop import Closed
from maglev_ctrl.synthesis.structured.spectral import Piece

TOLERANCE = 1e-7
"""Relative height that a missed peak may have above the one found."""
_LEVELS = 25
_SEEDS = 4


def peak_pieces(
    loop: Closed,
    poles: ComplexArray,
    *,
    hints: FloatArray,
    closeness: float = 0.0,
    ceiling: float = np.inf,
) -> tuple[list[Piece], FloatArray]:
    """Peaks of the largest singular value, highest first, with derivatives by the entries of K; and their frequencies.

    Parameters
    ----------
    hints : frequencies (rad/s) to look at first; those of the last call save levels
    closeness : peaks lower by more than this share are left out; 0 returns the highest only
    ceiling : as soon as a gain above this is seen the search stops (the value is then a lower bound)
    """
    A, B, C, D = loop.A, loop.B, loop.C, loop.D
    if loop.dt is not None:
        A, B, C, D = continuous_equivalent(A, B, C, D, loop.dt)
        poles = np.linalg.eigvals(A).astype(complex)
    # The level test finds every peak; the seeds only save levels: the last peaks and the lightly damped poles.
    light = poles[poles.imag >= 0.0]
    light = light[np.argsort(-light.real / np.maximum(np.abs(light), 1e-300))[:_SEEDS]]
    seeds = np.concatenate([hints, np.where(light.imag > 0.0, light.imag, np.abs(light)), [0.0, np.inf]])
    gains = _gains(A, B, C, D, seeds)
    best = float(np.max(gains))
    at = float(seeds[int(np.argmax(gains))])
    if not np.isfinite(best) or best == 0.0:
        return [Piece(best, np.zeros((loop.E.shape[1], loop.F.shape[0])))], np.array([at])
    # Near the feedthrough the fine level is ill-conditioned: a coarser one first, so that a missed hump is tiny.
    for step in (1e-3, TOLERANCE) if np.any(D) else (TOLERANCE,):
        for _ in range(_LEVELS):
            if best > ceiling:
                break
            crossings = hamiltonian_frequencies(A, B, C, D, best * (1.0 + step))
            if not crossings.size:
                break
            points = np.concatenate([crossings, 0.5 * (crossings[1:] + crossings[:-1])])
            gains = _gains(A, B, C, D, points)
            top = int(np.argmax(gains))
            risen = gains[top] > best * (1.0 + step)
            if gains[top] > best:
                best, at = float(gains[top]), float(points[top])
            if not risen:
                break
    frequencies = np.array([at])
    if best > ceiling:
        return [Piece(best, np.zeros((loop.E.shape[1], loop.F.shape[0])))], frequencies
    if closeness > 0.0:
        frequencies = _near_peaks(A, B, C, D, best, at, closeness)
    pieces = [piece for w in frequencies for piece in _piece(loop, float(w), best, closeness)]
    pieces.sort(key=lambda piece: -piece.value)
    return pieces, frequencies


def _near_peaks(
    A: FloatArray, B: FloatArray, C: FloatArray, D: FloatArray, best: float, at: float, closeness: float
) -> FloatArray:
    """One frequency for every interval in which the gain is above (1 - closeness) best; `at` first."""
    crossings = hamiltonian_frequencies(A, B, C, D, best * (1.0 - closeness))
    edges = np.concatenate([[0.0], crossings, [2.0 * crossings[-1] + 1.0 if crossings.size else 1.0]])
    edges = np.unique(edges)
    found = [at]
    inner = np.linspace(0.0, 1.0, 9)[1:-1]
    for low, high in pairwise(edges):
        if low <= at <= high or high - low <= 1e-9 * high:
            continue
        for _ in range(3):  # each round narrows the interval around the largest of seven points by four
            points = low + (high - low) * inner
            gains = _gains(A, B, C, D, points)
            k = int(np.argmax(gains))
            step = (high - low) / 8.0
            low, high = points[k] - step, points[k] + step
        if gains[k] >= best * (1.0 - closeness):
            found.append(float(points[k]))
    for end in (0.0, np.inf):
        if end != at and _gains(A, B, C, D, np.array([end]))[0] >= best * (1.0 - closeness):
            found.append(end)
    return np.array(found)


def _piece(loop: Closed, frequency: float, best: float, closeness: float) -> list[Piece]:
    """Singular values at one frequency as smooth pieces: d sigma = Re(u^H dG v).

    G = C (s I - A)^-1 B + D gives dG = (E_z + C R E) dK (F_w + F R B) with the resolvent R.
    """
    if loop.dt is None:
        point: complex | None = 1j * frequency if np.isfinite(frequency) else None
    else:
        half = 0.5 * loop.dt * frequency
        point = (1.0 + 1j * half) / (1.0 - 1j * half) if np.isfinite(half) else -1.0
    if point is None:
        G, left, right = (value.astype(np.complex128) for value in (loop.D, loop.E_z, loop.F_w))
    else:
        pencil = point * np.eye(loop.A.shape[0]) - loop.A
        both = np.linalg.solve(pencil, np.hstack([loop.B, loop.E]) + 0j)
        n_w = loop.B.shape[1]
        G = np.asarray(loop.D + loop.C @ both[:, :n_w], dtype=np.complex128)
        left = np.asarray(loop.E_z + loop.C @ both[:, n_w:], dtype=np.complex128)
        right = np.asarray(loop.F_w + loop.F @ both[:, :n_w], dtype=np.complex128)
    U, s, Vh = np.linalg.svd(G, full_matrices=False)
    found = []
    for k in range(s.size):
        if k and s[k] < best * (1.0 - closeness):
            break
        row = np.conj(U[:, k]) @ left
        column = right @ np.conj(Vh[k])
        found.append(Piece(float(s[k]), np.outer(row, column).real))
        if closeness == 0.0:
            break
    return found


def _gains(A: FloatArray, B: FloatArray, C: FloatArray, D: FloatArray, frequency: FloatArray) -> FloatArray:
    """Largest singular value at frequencies in rad/s, inf included."""
    values = np.empty((frequency.size, *D.shape), dtype=complex)
    finite = np.isfinite(frequency)
    values[~finite] = D
    if np.any(finite):
        pencil = np.zeros((int(np.sum(finite)), *A.shape), dtype=complex)
        pencil -= A
        diagonal = np.arange(A.shape[0])
        pencil[:, diagonal, diagonal] += 1j * frequency[finite, None]
        values[finite] = D + C @ np.linalg.solve(pencil, np.broadcast_to(B + 0j, (pencil.shape[0], *B.shape)))
    if min(D.shape) == 1:
        return np.asarray(np.linalg.norm(values, axis=(1, 2)))
    flat = values if D.shape[0] >= D.shape[1] else np.conj(np.swapaxes(values, 1, 2))
    gram = np.conj(np.swapaxes(flat, 1, 2)) @ flat
    return np.asarray(np.sqrt(np.maximum(np.linalg.eigvalsh(gram)[:, -1], 0.0)))
