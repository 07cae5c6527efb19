"""Candidate certificate matrices of one closed loop, from Lyapunov and Riccati equations in balanced coordinates.

Made with ordinary rounding; `maglev_ctrl.proofs.prove` decides about them.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator

import numpy as np
import scipy.linalg

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.kernels import scaling
from maglev_ctrl.kernels.stable_subspace import stabilising_solution

NOISE = 1e-20
"""A Gramian's diagonal entry below this share of the largest is rounding: the state is not reached, or not seen."""


def balance(A: FloatArray) -> FloatArray:
    """Powers of two t such that diag(1/t) A diag(t) has rows and columns of like size."""
    if not len(A):
        return np.ones(0)
    scale = scaling.balance(A)
    return np.asarray(np.exp2(np.round(np.log2(scale))), dtype=float)


def gramian(A: FloatArray, Q: FloatArray, dt: float | None) -> FloatArray:
    """P of A'P + P A + Q = 0, or of A'P A - P + Q = 0 by Smith's doubling, for a stable A."""
    if dt is None:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            P = np.asarray(scipy.linalg.solve_continuous_lyapunov(A.T, -Q), dtype=float)
        return np.asarray(0.5 * (P + P.T))
    P, power = Q, A
    with np.errstate(all="ignore"):
        for _ in range(64):
            step = power.T @ P @ power
            P = P + 0.5 * (step + step.T)
            power = power @ power
            if not np.max(np.abs(step), initial=0.0) > 1e-17 * np.max(np.abs(P), initial=0.0):
                break
    return P


def strict_parts(A: FloatArray, dt: float | None) -> Iterator[tuple[FloatArray, FloatArray]]:
    """(P, Q) > 0 with A'P + P A + Q = 0 (P - A'P A = Q): for Q = I, then for Q = I + a share of P, widely spread."""
    eye = np.eye(len(A))
    yield gramian(A, eye, dt), eye
    poles = np.linalg.eigvals(A)
    for share in (0.5, 0.9):
        if dt is None:
            slower = -share * float(np.max(poles.real))
            P = gramian(A + slower * eye, eye, dt)
            yield P, eye + 2.0 * slower * P
        else:
            larger = float(np.max(np.abs(poles), initial=1e-8)) ** share
            P = gramian(A / larger, eye, dt)
            yield P, larger**2 * eye + (1.0 - larger**2) * P


def even_scales(A: FloatArray, B: FloatArray, C: FloatArray, dt: float | None) -> FloatArray:
    """Powers of two that make every state reached and observed alike; one for states where either is but rounding."""
    reached, observed = np.diag(gramian(A.T, B @ B.T, dt)), np.diag(gramian(A, C.T @ C, dt))
    told = (reached > NOISE * np.max(reached, initial=0.0)) & (observed > NOISE * np.max(observed, initial=0.0))
    with np.errstate(all="ignore"):
        ratio = np.where(told, reached / observed, 1.0)
    return np.asarray(np.exp2(np.round(0.25 * np.log2(ratio))))


def bounded_real_solution(
    A: FloatArray, B: FloatArray, Q: FloatArray, S: FloatArray, D: FloatArray, dt: float | None
) -> FloatArray | None:
    """Stabilising solution of the bounded-real Riccati equation for the bound one; None where there is none."""
    if B.shape[1] == 0:
        return gramian(A, Q, dt)
    R = D.T @ D - np.eye(B.shape[1])
    if dt is None:
        solved = np.linalg.solve(R, np.hstack([S.T, B.T]))
        cross, into = solved[:, : len(A)], solved[:, len(A) :]
        rest = Q - S @ cross
        G = B @ into
        return stabilising_solution(A - B @ cross, 0.5 * (G + G.T), 0.5 * (rest + rest.T))
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            P = np.asarray(scipy.linalg.solve_discrete_are(A, B, Q, R, s=S), dtype=float)
    except (np.linalg.LinAlgError, ValueError):
        return None
    return 0.5 * (P + P.T) if np.isfinite(P).all() else None


def modal_matrix(A: FloatArray) -> FloatArray:
    """X (n, n) = V V^H of the eigenvectors: every region that holds the poles has its inequality met mode by mode.

    Examples
    --------
    >>> modal_matrix(np.diag([-1.0, -2.0]))
    array([[1., 0.],
           [0., 1.]])
    """
    scale = balance(A)
    vectors = np.linalg.eig(A / scale[:, None] * scale)[1]
    X = (vectors @ np.conj(vectors.T)).real * scale[:, None] * scale
    return np.asarray(0.5 * (X + X.T))
