"""Coordinates in which the inequalities are of order one: states, commands, time and norms of a quadratic regulator.

A regulator of the nominal plant tells how large the states and commands get and how fast the loop can be. States are
scaled by its covariance (powers of two, so without rounding), commands by theirs, time by its poles, norms by its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import LinAlgError, solve_continuous_are, solve_continuous_lyapunov

from maglev_ctrl.analysis.hamiltonian import peak_gain
from maglev_ctrl.analysis.loops import state_scales
from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.synthesis.lmi.request import MultiObjective, channel_indices
from maglev_ctrl.systems.plant import Plant


@dataclass(frozen=True, eq=False, slots=True)
class Scaling:
    """x = states * x_scaled, u = commands * u_scaled, t = t_scaled / rate; norms in units of `h2` and `h_infinity`.

    `balance` shares the H-infinity channel out between disturbance and output, which changes no norm. Where one matrix
    serves both norms it makes the matrix of A'P + P A + C'C + P B B'P / gamma^2 < 0 that of the H2 norm as well
    (Bernstein & Haddad 1989).
    """

    states: FloatArray
    commands: FloatArray
    rate: float
    h2: float
    h_infinity: float
    balance: float = 1.0


@dataclass(frozen=True, eq=False, slots=True)
class ScaledVertex:
    """One vertex in scaled coordinates; the norms' channels carry B, C, D12 and D11 of their own."""

    A: FloatArray
    B: FloatArray
    h2: tuple[FloatArray, FloatArray, FloatArray]
    h_infinity: tuple[FloatArray, FloatArray, FloatArray, FloatArray]


def find_scaling(plants: Sequence[Plant], request: MultiObjective) -> Scaling:
    """Scales from a quadratic regulator of the mean of the vertices.

    Examples
    --------
    >>> plant = Plant.from_matrices([[1.0]], [[1.0]], [[1.0]], [[1.0], [0.0]], D12=[[0.0], [1.0]])
    >>> find_scaling([plant], MultiObjective("h2")).states
    array([0.5])
    """
    A, B1, B2, C1, D12 = (np.mean([getattr(p, key) for p in plants], axis=0) for key in ("A", "B1", "B2", "C1", "D12"))
    first = state_scales(A, np.hstack([B1, B2]), C1)
    A_b, B_b, B1_b, C_b = A * first / first[:, None], B2 / first[:, None], B1 / first[:, None], C1 * first
    unit_u = 1.0 / np.maximum(np.linalg.norm(B_b, axis=0), 1e-300)
    price = D12.T @ D12
    size = max(float(np.linalg.norm(A_b, 2)), 1e-3)
    R = price + 1e-6 * _level(price, C_b, B_b * unit_u, size) * np.diag(1.0 / unit_u**2)
    Q = C_b.T @ C_b + 1e-6 * max(float(np.linalg.norm(C_b, 2)) ** 2, 1e-300) * np.eye(A.shape[0])
    shift = 0.0 if request.decay_rate is None else request.decay_rate
    gain = _regulator(A_b + shift * np.eye(A.shape[0]), B_b, Q, R, C_b.T @ D12)
    closed = A_b - B_b @ gain
    noise = B1_b @ B1_b.T
    noise += 1e-4 * max(float(np.trace(noise)) / A.shape[0], 1e-300) * np.eye(A.shape[0])
    covariance = solve_continuous_lyapunov(closed, -noise)
    spread = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    states = first * spread
    swing = np.sqrt(np.maximum(np.diag(gain @ covariance @ gain.T), 1e-300))
    commands = np.where(swing > 1e-12 * np.max(swing), swing, np.max(swing) if np.max(swing) > 1e-290 else 1.0)
    poles = np.abs(np.linalg.eigvals(closed))
    rate = float(np.exp(np.mean(np.log(np.maximum(poles, 1e-6 * np.max(poles))))))
    level_2, level_infinity = _norms(plants[0], request, A, B1, B2, C1, D12, gain / first)
    rate = _power(np.array(rate)).item()
    balance = 1.0
    if request.has_h2 and request.has_h_infinity:
        balance = level_2**2 / (rate * level_infinity * (request.h_infinity_below or level_infinity))
    return Scaling(_power(states), _power(commands), rate, level_2, level_infinity, balance)


def scale_vertex(plant: Plant, request: MultiObjective, scaling: Scaling) -> ScaledVertex:
    """A vertex in scaled coordinates.

    G = G_scaled h_infinity for the H-infinity channel, with B b / sqrt(rate) and C / (b h_infinity sqrt(rate)), b^2 the
    balance; the H2 channel keeps B / sqrt(rate) and has C / h2.
    """
    T, S, root = scaling.states, scaling.commands, np.sqrt(scaling.rate)
    two, infinity = (channel_indices(plant, c, k) for c, k in (
        (request.h2_channel, "h2"), (request.h_infinity_channel, "h_infinity")))  # fmt: skip
    B_w = plant.B1 / T[:, None] / root
    C_z, D_z = plant.C1 * T, plant.D12 * S
    through = plant.D11[np.ix_(infinity[1], infinity[0])] / scaling.h_infinity
    b = float(np.sqrt(scaling.balance))
    c_2, c_infinity = 1.0 / scaling.h2, 1.0 / (b * scaling.h_infinity * root)
    return ScaledVertex(
        A=plant.A * T / T[:, None] / scaling.rate, B=plant.B2 * S / T[:, None] / scaling.rate,
        h2=(B_w[:, two[0]], c_2 * C_z[two[1]], c_2 * D_z[two[1]]),
        h_infinity=(b * B_w[:, infinity[0]], c_infinity * C_z[infinity[1]], c_infinity * D_z[infinity[1]], through),
    )  # fmt: skip


def _level(price: FloatArray, C: FloatArray, B: FloatArray, size: float) -> float:
    return max(float(np.linalg.norm(price, 2)), float(np.linalg.norm(C, 2)) ** 2 / size**2, 1e-300)


def _regulator(A: FloatArray, B: FloatArray, Q: FloatArray, R: FloatArray, N: FloatArray) -> FloatArray:
    """Gain of the regulator; without cross weight, then with a dear state, where the equation has no answer."""
    for cross, more in ((N, 1e-12), (0.0 * N, 1e-12), (0.0 * N, 1.0)):
        try:
            weight = Q + more * np.linalg.norm(Q, 2) * np.eye(A.shape[0])
            P = solve_continuous_are(A, B, weight, R, s=cross)
            gain = np.asarray(np.linalg.solve(R, B.T @ P + cross.T), dtype=np.float64)
        except (LinAlgError, ValueError):
            continue
        if np.all(np.isfinite(gain)) and np.max(np.linalg.eigvals(A - B @ gain).real) < 0.0:
            return gain
    return _spread_poles(A, B)


def _spread_poles(A: FloatArray, B: FloatArray) -> FloatArray:
    """Bass: with A + b stable in reversed time, (A + b) W + W (A + b)' = 2 B B' gives the gain B' W^-1."""
    shift = float(np.linalg.norm(A, 2)) * 1.1 + 1e-12
    W = solve_continuous_lyapunov(A + shift * np.eye(A.shape[0]), 2.0 * B @ B.T)
    return np.asarray(B.T @ np.linalg.pinv(0.5 * (W + W.T), hermitian=True), dtype=np.float64)


def _norms(
    plant: Plant, request: MultiObjective, A: FloatArray, B1: FloatArray, B2: FloatArray, C1: FloatArray,
    D12: FloatArray, gain: FloatArray,
) -> tuple[float, float]:  # fmt: skip
    """H2 and H-infinity norm of the regulator's loop on the channels asked for, the units of both norms."""
    closed, C = A - B2 @ gain, C1 - D12 @ gain
    two, infinity = (channel_indices(plant, c, k) for c, k in (
        (request.h2_channel, "h2"), (request.h_infinity_channel, "h_infinity")))  # fmt: skip
    B_2 = B1[:, two[0]]
    energy = float(np.trace(C[two[1]] @ solve_continuous_lyapunov(closed, -B_2 @ B_2.T) @ C[two[1]].T))
    D11 = plant.D11[np.ix_(infinity[1], infinity[0])]
    peak = peak_gain(closed, B1[:, infinity[0]], C[infinity[1]], D11, tolerance=1e-3).lower
    return _unit(np.sqrt(max(energy, 0.0))), _unit(peak)


def _unit(value: float) -> float:
    return float(value) if np.isfinite(value) and value > 1e-150 else 1.0


def _power(value: FloatArray) -> FloatArray:
    return np.asarray(np.exp2(np.round(np.log2(value))), dtype=np.float64)
