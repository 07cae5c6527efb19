"""Structure-preserving doubling for continuous Riccati equations, over any number of batch axes.

Chu, Fan and Lin, Linear Algebra and its Applications 396 (2005) 55: a Cayley map with shift `shift` > 0 turns the
Hamiltonian of Q + A'P + P A - P G P = 0 into a symplectic pencil whose powers 2, 4, 8, ... cost one solve each.
The shift is the geometric mean of the moduli of the closed-loop poles, read off the determinant of the Hamiltonian.
"""

from __future__ import annotations

import numpy as np

from maglev_ctrl.arrays import FloatArray, join_columns, join_rows, transpose

MAXIMUM_DOUBLINGS = 40


def hamiltonian(A: FloatArray, G: FloatArray, Q: FloatArray) -> FloatArray:
    """[[A, -G], [-Q, -A']]; its stable eigenvalues are the closed-loop poles; (..., 2n, 2n)."""
    return join_rows([join_columns([A, -G]), join_columns([-Q, -transpose(A)])])


def cayley_shift(A: FloatArray, G: FloatArray, Q: FloatArray) -> FloatArray:
    """Geometric mean of the moduli of the closed-loop poles: |det H|^(1/2n); (...,)."""
    _, logarithm = np.linalg.slogdet(hamiltonian(A, G, Q))
    shift = np.exp(logarithm / (2.0 * A.shape[-1]))
    size = np.linalg.norm(A, axis=(-2, -1)) + 1.0
    return np.asarray(np.where(np.isfinite(shift) & (shift > 1e-8 * size), shift, size))


def doubled_solution(
    A: FloatArray, G: FloatArray, Q: FloatArray, shift: FloatArray | None = None
) -> tuple[FloatArray, FloatArray]:
    """Stabilising P by doubling, and the norm of the last power (zero where the iteration converged).

    Raises
    ------
    numpy.linalg.LinAlgError : an intermediate matrix is singular

    Examples
    --------
    >>> P, rest = doubled_solution(np.array([[0.0]]), np.array([[1.0]]), np.array([[4.0]]))
    >>> round(float(P[0, 0]), 12)
    2.0
    """
    n = A.shape[-1]
    gamma = np.asarray(cayley_shift(A, G, Q) if shift is None else shift)[..., None, None]
    inverse = np.linalg.inv(A - gamma * np.eye(n))
    middle = np.linalg.inv(transpose(A) - gamma * np.eye(n) + Q @ inverse @ G)
    power = np.eye(n) + 2.0 * gamma * transpose(middle)
    dual = symmetric(2.0 * gamma * inverse @ G @ middle)
    primal = symmetric(2.0 * gamma * middle @ Q @ inverse)
    for _ in range(MAXIMUM_DOUBLINGS):
        solved = np.linalg.inv(np.eye(n) + dual @ primal)
        ahead, through = solved @ power, solved @ dual
        step = symmetric(transpose(power) @ primal @ ahead)
        dual = dual + symmetric(power @ through @ transpose(power))
        power = power @ ahead
        primal = primal + step
        moved, size = _size(step), _size(primal)
        # Quadratic convergence: the next step is about the square of this one.
        if np.all((moved <= 1e-10 * size) | ~np.isfinite(size)):
            break
    return primal, _size(power)


def relative_residual(A: FloatArray, G: FloatArray, Q: FloatArray, P: FloatArray) -> FloatArray:
    """Frobenius norm of Q + A'P + P A - P G P relative to the norms of its terms; (...,)."""
    forward, quadratic = P @ A, P @ G @ P
    rest = Q + forward + transpose(forward) - quadratic
    size = _size(Q) + 2.0 * _size(forward) + _size(quadratic)
    return np.asarray(_size(rest) / np.where(size > 0.0, size, 1.0))


def symmetric(matrix: FloatArray) -> FloatArray:
    """Symmetric part; (..., n, n)."""
    return np.asarray(0.5 * (matrix + transpose(matrix)))


def _size(matrix: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.norm(matrix, axis=(-2, -1)))
