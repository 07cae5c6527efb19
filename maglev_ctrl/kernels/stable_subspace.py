"""F'X + X F - X G X + Q = 0 by the stable invariant subspace of its Hamiltonian, G and Q of any sign.

The Hamiltonian is scaled by a symplectic diagonal in powers of two first (nothing is rounded), and the solution is
carried on by Newton steps as long as these make the residual smaller.
"""

from __future__ import annotations

import warnings

import numpy as np
from numpy.linalg import LinAlgError
from scipy.linalg import schur, solve_continuous_lyapunov

from maglev_ctrl.arrays import ComplexArray, FloatArray
from maglev_ctrl.kernels import scaling


def stabilising_solution(F: FloatArray, G: FloatArray, Q: FloatArray) -> FloatArray | None:
    """X (n, n) with F - G X stable, None where none was found.

    Examples
    --------
    >>> stabilising_solution(*(np.array([[x]]) for x in (-1.0, -0.75, 1.0))).round(6)  # 0.75 x^2 - 2 x + 1 = 0
    array([[0.666667]])
    >>> stabilising_solution(*(np.array([[x]]) for x in (-1.0, -2.0, 1.0))) is None
    True
    """
    with np.errstate(all="ignore"):
        if not all(np.all(np.isfinite(matrix)) for matrix in (F, G, Q)):
            return None
        H, states, scale = balanced_hamiltonian(F, G, Q, np.abs(Q))
        if not np.all(np.isfinite(H)):
            return None
        basis, n = stable_subspace(H)[1], len(F)
        X = None if basis is None else subspace_solution(basis[:n], basis[n:], states, scale)
        return None if X is None else newton_refined(X, F, G, Q)


def balanced_hamiltonian(
    F: FloatArray, G: FloatArray, Q: FloatArray, weight: FloatArray
) -> tuple[FloatArray, FloatArray, float]:
    """Hamiltonian [[F, -G], [-Q, -F']] scaled by a symplectic diagonal in powers of two, and level Q against G.

    `weight` is |Q| without what is rounding alone: that must not set the scale of X.
    """
    n = F.shape[0]
    magnitude = np.abs(np.block([[F, G], [weight, F.T]]))
    np.fill_diagonal(magnitude, 0.0)
    with np.errstate(invalid="ignore"):  # its permutation, not used, is cast to integers
        balance = scaling.balance(magnitude)
    states = np.exp2(np.round(0.5 * np.log2(balance[:n] / balance[n:])))
    G_s, Q_s, F_s = G / np.outer(states, states), Q * np.outer(states, states), F * states / states[:, None]
    strong, heavy = float(np.linalg.norm(G_s)), float(np.linalg.norm(weight * np.outer(states, states)))
    level = 1.0
    if strong > 0.0:  # X is about sqrt(Q / G), or up to 2 F / G where the plant is unstable
        level = max(np.sqrt(heavy / strong), 0.1 * float(np.linalg.norm(F_s)) / strong)
    elif heavy > 0.0:
        level = heavy / max(float(np.linalg.norm(F_s)), 1e-300)
    level = float(np.exp2(np.round(np.log2(level)))) if level > 0.0 else 1.0
    return np.block([[F_s, -level * G_s], [-Q_s / level, -F_s.T]]), states, level


def stable_subspace(H: FloatArray) -> tuple[ComplexArray, FloatArray | None]:
    """All eigenvalues, and an orthonormal basis of the stable ones where they are half of all."""
    try:
        T, basis, count = schur(H, output="real", sort="lhp")
    except LinAlgError:
        return np.linalg.eigvals(H).astype(np.complex128), None
    n = H.shape[0] // 2
    poles = _diagonal_poles(T)
    return poles, np.asarray(basis[:, :n]) if count == n else None


def _diagonal_poles(T: FloatArray) -> ComplexArray:
    """Eigenvalues of a real Schur form."""
    size = T.shape[0]
    values = np.diag(T).astype(np.complex128)
    k = np.nonzero(np.diag(T, -1))[0]
    if k.size:
        root = np.sqrt((T[k, k] - T[k + 1, k + 1]).astype(complex) ** 2 / 4.0 + T[k, k + 1] * T[k + 1, k])
        middle = 0.5 * (T[k, k] + T[k + 1, k + 1])
        values[k], values[k + 1] = middle + root, middle - root
    return values[:size]


def subspace_solution(U: FloatArray, V: FloatArray, states: FloatArray, scale: float) -> FloatArray | None:
    """X = V U^-1 in the coordinates before `balanced_hamiltonian`, None where it does not exist."""
    try:
        X = np.linalg.solve(U.T, V.T)
    except LinAlgError:
        return None
    X = 0.5 * scale * (X + X.T) / np.outer(states, states)
    return X if np.all(np.isfinite(X)) else None


def newton_refined(X: FloatArray, F: FloatArray, G: FloatArray, Q: FloatArray) -> FloatArray:
    """Newton steps while they make the residual of F'X + X F - X G X + Q smaller."""

    def residual(P: FloatArray) -> FloatArray:
        left = F.T @ P
        return np.asarray(left + left.T - P @ G @ P + Q)

    size = float(np.linalg.norm(residual(X)))
    for _ in range(3):
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                step = solve_continuous_lyapunov((F - G @ X).T, -residual(X))
        except (LinAlgError, ValueError):
            break
        moved = X + 0.5 * (step + step.T)
        after = float(np.linalg.norm(residual(moved)))
        if not after < 0.5 * size:
            break
        X, size = moved, after
    return X
