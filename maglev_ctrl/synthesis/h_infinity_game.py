"""The Riccati equation of one disturbance against one command, told by angles that stay finite where its solution
does not.

    A'X + X A + C'C - (X B + C'D) R^-1 (B'X + D'C) = 0,  B = [B1, B2], D = [D11, D12], R = D'D - diag(gamma^2 I, 0)

The stable invariant subspace of the Hamiltonian, spanned by orthonormal columns [U; V], is Lagrangian exactly where
the stabilising solution X = V U^-1 exists, and then U + jV is unitary; the eigenvalues of (U + jV)(U + jV)^T are
exp(2 j theta) with tan(theta) the eigenvalues of X. As gamma falls an eigenvalue of X grows through infinity and comes
back negative: theta passes a right angle smoothly, so neither "X >= 0" nor "X exists" is ever read off large numbers.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.linalg import LinAlgError

from maglev_ctrl.arrays import ComplexArray, FloatArray
from maglev_ctrl.kernels.stable_subspace import (
    balanced_hamiltonian,
    newton_refined,
    stable_subspace,
    subspace_solution,
)

LAGRANGIAN = 1e-7
"""Largest departure of U + jV from a unitary matrix; an eigenvalue on the imaginary axis leaves one of order one."""
ANGLE = 1e-7
"""Angles (rad) this little below zero are rounding of an eigenvalue zero of X: it cannot turn negative through zero."""


@dataclass(frozen=True, eq=False, slots=True)
class Channel:
    """x' = A x + B1 w + B2 u, z = C x + D11 w + D12 u; `sees_disturbance` where the command may answer w directly."""

    A: FloatArray
    B1: FloatArray
    B2: FloatArray
    C: FloatArray
    D11: FloatArray
    D12: FloatArray
    sees_disturbance: bool = False

    @property
    def floor(self) -> float:
        """No gain below this is possible, whatever the dynamics: what the command cannot cancel of D11."""
        if not np.any(self.D11):
            return 0.0
        rest = self.D11
        if self.sees_disturbance and self.D12.size:
            rest = self.D11 - self.D12 @ np.linalg.lstsq(self.D12, self.D11, rcond=None)[0]
        return float(np.linalg.norm(rest, 2))


@dataclass(frozen=True, eq=False, slots=True)
class Game:
    """The equation at one `gamma`: whether X exists and is positive semidefinite, and by how much.

    `solvable`; `angle_margin` (rad) distance of the largest 2 theta from pi, negative beyond (X is not >= 0); `axis`
    squared distance of the Hamiltonian's eigenvalues from the axis where X exists, minus the squared half gap of the
    closest two where they lie on it, both relative: linear in gamma across the limit; `X`, None where it does not
    exist; `gain` (m1 + m2, n), [w; u] = gain x at the saddle.
    """

    gamma: float
    solvable: bool
    lagrangian: bool
    angle_margin: float
    axis: float
    X: FloatArray | None = None
    gain: FloatArray | None = None


def weight_matrix(channel: Channel, gamma: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """B, D and R of the equation at one gamma."""
    D = np.hstack([channel.D11, channel.D12])
    R = D.T @ D
    m1 = channel.D11.shape[1]
    R[np.arange(m1), np.arange(m1)] -= gamma * gamma
    return np.hstack([channel.B1, channel.B2]), D, R


def solve_game(channel: Channel, gamma: float, *, refine: bool = False) -> Game:
    """The stabilising solution at one gamma, and what is wrong where there is none that is positive semidefinite.

    Examples
    --------
    >>> one = np.eye(1)
    >>> channel = Channel(one, one, one, np.array([[1.0], [0.0]]), np.zeros((2, 1)), np.array([[0.0], [1.0]]))
    >>> game = solve_game(channel, 2.0)  # X = (1 + sqrt(1 + 3/4)) / (3/4)
    >>> game.solvable, round(float(game.X[0, 0]), 9)
    (True, 3.097167541)
    """
    nothing = Game(gamma, False, False, -np.pi, -1.0)
    if not (gamma > channel.floor and np.isfinite(gamma * gamma)):
        return nothing
    B, D, R = weight_matrix(channel, gamma)
    try:
        solved = np.linalg.solve(R, np.hstack([D.T @ channel.C, B.T]))
    except LinAlgError:
        return nothing
    n = channel.A.shape[0]
    cross, into = solved[:, :n], solved[:, n:]
    F = channel.A - B @ cross
    G = B @ into
    rest = channel.C - D @ cross
    Q = channel.C.T @ rest
    G, Q = 0.5 * (G + G.T), 0.5 * (Q + Q.T)
    columns = np.linalg.norm(channel.C, axis=0)
    noise = 1e-13 * np.outer(columns, columns) * (1.0 + float(np.linalg.norm(D @ np.linalg.solve(R, D.T))))
    if not all(np.all(np.isfinite(matrix)) for matrix in (F, G, Q)):
        return nothing
    H, states, scale = balanced_hamiltonian(F, G, Q, np.where(np.abs(Q) > noise, np.abs(Q), 0.0))
    if not np.all(np.isfinite(H)):
        return nothing
    poles, basis = stable_subspace(H)
    if basis is None:
        return Game(gamma, False, False, -np.pi, _axis_gap(poles))
    U, V = basis[:n], basis[n:]
    unitary = U + 1j * V
    defect = float(np.linalg.norm(unitary @ unitary.conj().T - np.eye(n)))
    if not defect <= LAGRANGIAN:
        return Game(gamma, False, False, -np.pi, _axis_gap(poles))
    turned = np.angle(np.linalg.eigvals(unitary @ unitary.T))
    # below zero by more than rounding: the eigenvalue of X went through infinity
    full = np.where(turned < -ANGLE, turned + 2.0 * np.pi, turned)
    margin = float(np.pi - np.max(full, initial=0.0))
    size = float(np.max(np.abs(poles), initial=1e-300))
    axis = float(np.min(np.abs(poles.real), initial=size) / size) ** 2
    X = subspace_solution(U, V, states, scale)
    if X is None:
        return Game(gamma, False, True, min(margin, 0.0), axis)
    if refine:
        X = newton_refined(X, F, G, Q)
    gain = -(cross + into @ X)
    solvable = margin > 0.0
    if solvable and np.any(turned < 0.0):  # never let rounding pass what is not stable
        m1 = channel.B1.shape[1]
        solvable = bool(np.max(np.linalg.eigvals(channel.A + channel.B2 @ gain[m1:]).real, initial=-1.0) < 0.0)
    return Game(gamma, solvable, True, margin, axis, X, gain)


def _axis_gap(poles: ComplexArray) -> float:
    """Minus the squared half distance of the two closest eigenvalues on the axis, relative to the largest modulus."""
    size = float(np.max(np.abs(poles), initial=1e-300))
    on = np.sort(poles.imag[np.abs(poles.real) <= 1e-7 * size])
    return -((0.5 * float(np.min(np.diff(on))) / size) ** 2) if on.size > 1 else -1.0
