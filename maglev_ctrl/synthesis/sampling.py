"""Sampled equivalents of continuous plants and costs: exact between samples, by matrix exponentials.

Commands are held over one sampling period (zero-order hold). Integrals over the period follow Van Loan, IEEE Trans.
Autom. Control 23 (1978) 395, on a short step that is doubled, so that fast modes do not overflow.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import expm

from maglev_ctrl.arrays import FloatArray, read_only
from maglev_ctrl.errors import ModelError
from maglev_ctrl.kernels import scaling
from maglev_ctrl.synthesis.doubling import symmetric
from maglev_ctrl.systems.plant import Plant

LONGEST_STEP = 0.5
"""Norm of A dt up to which an integral is taken in one step."""


def held(A: ArrayLike, B: ArrayLike, dt: float) -> tuple[FloatArray, FloatArray]:
    """Zero-order hold: x(t + dt) = F x(t) + G u with u held; F = exp(A dt), G = integral of exp(A s) B over dt.

    Raises
    ------
    ValueError : shapes do not fit or `dt` is not positive

    Examples
    --------
    >>> F, G = held([[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]], 2.0)
    >>> F.tolist(), G.tolist()
    ([[1.0, 2.0], [0.0, 1.0]], [[2.0], [2.0]])
    """
    a = read_only(A, name="A", shape=(None, None))
    n = a.shape[0]
    b = read_only(B, name="B", shape=(n, None))
    period(dt)
    if n == 0:
        return np.zeros((0, 0)), np.zeros((0, b.shape[1]))
    joined = np.zeros((n + b.shape[1], n + b.shape[1]))
    joined[:n, :n], joined[:n, n:] = a, b
    power = balanced_exponential(joined * dt)
    return power[:n, :n], power[:n, n:]


def held_cost(
    A: ArrayLike, B: ArrayLike, Q: ArrayLike, R: ArrayLike, N: ArrayLike | None = None, *, dt: float
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """F, G and weights Q_d, R_d, N_d of one period: the integral of x'Qx + u'Ru + 2 x'Nu with u held is the same.

    The discrete regulator for them minimises the continuous cost among all held commands.

    Parameters
    ----------
    A, B, Q, R, N : (n, n), (n, m), (n, n), (m, m), (n, m)
    dt : sampling period, s

    Raises
    ------
    ValueError : shapes do not fit or `dt` is not positive

    Examples
    --------
    >>> _, _, Q, R, N = held_cost([[0.0]], [[1.0]], [[3.0]], [[1.0]], dt=1.0)
    >>> round(float(Q[0, 0]), 12), round(float(R[0, 0]), 12), round(float(N[0, 0]), 12)  # of 3 (x + u t)^2 + u^2
    (3.0, 2.0, 1.5)
    """
    a = read_only(A, name="A", shape=(None, None))
    n = a.shape[0]
    b = read_only(B, name="B", shape=(n, None))
    m = b.shape[1]
    q, r = read_only(Q, name="Q", shape=(n, n)), read_only(R, name="R", shape=(m, m))
    cross = read_only(np.zeros((n, m)) if N is None else N, name="N", shape=(n, m))
    period(dt)
    joined = np.zeros((n + m, n + m))
    joined[:n, :n], joined[:n, n:] = a, b
    power, weight = gramian(joined, np.block([[q, cross], [cross.T, r]]), dt)
    return power[:n, :n], power[:n, n:], weight[:n, :n], weight[n:, n:], weight[:n, n:]


def held_noise(A: ArrayLike, intensity: ArrayLike, dt: float) -> FloatArray:
    """Covariance that white noise of the given two-sided intensity (n, n) adds to the state over one period.

    Integral of exp(A s) W exp(A's) over the period.

    Raises
    ------
    ValueError : shapes do not fit or `dt` is not positive

    Examples
    --------
    >>> held_noise([[0.0]], [[4.0]], 0.5).tolist()
    [[2.0]]
    """
    a = read_only(A, name="A", shape=(None, None))
    W = read_only(intensity, name="intensity", shape=a.shape)
    period(dt)
    return gramian(a.T, W, dt)[1]


def sampled(
    plant: Plant,
    dt: float,
    *,
    disturbances: Literal["held", "white"] = "held",
    performance: Literal["instant", "integral"] = "instant",
) -> Plant:
    """The plant seen at samples `dt` apart, with held commands.

    disturbances : "held", w is constant over a period like a command (steps, set points); "white", w is white noise
        of unit two-sided intensity: the sampled plant has one unit-variance disturbance for each state and each
        measurement, with the covariance the noise gathers over one period, sensors reading their mean over it
    performance : "instant", z as it is at the samples; "integral", a new z whose sum of squares over the samples is
        the integral of the old z'z, what happens between samples included (for white noise up to a constant that no
        law changes)

    Raises
    ------
    ValueError : `dt` is not positive, or the plant is sampled already
    ModelError : white noise reaches the performance or state and sensors at once: neither has a sampled equivalent here

    Examples
    --------
    >>> plant = Plant.from_matrices([[0.0]], [[1.0]], [[1.0]], [[1.0]])
    >>> sampled(plant, 0.1).B2.tolist()
    [[0.1]]
    """
    period(dt)
    if plant.dt is not None:
        raise ValueError(f"plant: expected a continuous plant, got one sampled every {plant.dt:g} s")
    n_w, n_u = len(plant.disturbances), len(plant.commands)
    A, B = held(plant.A, np.hstack([plant.B1, plant.B2]), dt)
    B1, D11, D21, names = B[:, :n_w], plant.D11, plant.D21, plant.disturbances
    C1, D12, outputs = plant.C1, plant.D12, plant.performance
    through = plant.D11
    if disturbances == "white":
        B1, D21, names = _white(plant, dt)
        D11 = np.zeros((len(outputs), len(names)))
        through = np.zeros_like(plant.D11)
    if performance == "integral":
        inputs = np.hstack([plant.B1 * (disturbances == "held"), plant.B2])
        C1, D11_held, D12 = _integrated(plant.A, inputs, plant.C1, np.hstack([through, plant.D12]), n_u, dt)
        outputs = tuple(f"cost {i + 1}" for i in range(C1.shape[0]))
        D11 = D11_held if disturbances == "held" else np.zeros((C1.shape[0], len(names)))
    return Plant.from_matrices(
        A, B1, B[:, n_w:], C1, plant.C2, D11=D11, D12=D12, D21=D21, D22=plant.D22,
        states=plant.states, disturbances=names, commands=plant.commands, performance=outputs,
        measured=plant.measured, dt=float(dt), name=plant.name,
    )  # fmt: skip


def _white(plant: Plant, dt: float) -> tuple[FloatArray, FloatArray, tuple[str, ...]]:
    """Unit-variance disturbances with the covariance of one period: first the states', then the sensors'."""
    if np.any(plant.D11):
        raise ModelError("white noise acts on the performance outputs directly: their variance is infinite")
    if np.any(plant.B1 @ plant.D21.T):
        raise ModelError("one white noise drives states and sensors at once: filter the sensors before sampling")
    gathered = held_noise(plant.A, plant.B1 @ plant.B1.T, dt)
    sensors = plant.D21 @ plant.D21.T / dt
    n, n_y = len(plant.states), len(plant.measured)
    B1 = np.hstack([root(gathered).T, np.zeros((n, n_y))])
    D21 = np.hstack([np.zeros((n_y, n)), root(sensors).T])
    return B1, D21, tuple(f"noise of {name}" for name in plant.states) + tuple(f"error of {y}" for y in plant.measured)


def _integrated(
    A: FloatArray, B: FloatArray, C: FloatArray, D: FloatArray, commands: int, dt: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """C1, D11, D12 with (C1 x + D11 w + D12 u)^2 = integral of z'z over one period, w and u held."""
    n, m = B.shape
    joined = np.zeros((n + m, n + m))
    joined[:n, :n], joined[:n, n:] = A, B
    rows = np.hstack([C, D])
    factor = root(gramian(joined, rows.T @ rows, dt)[1])
    split = n + m - commands
    return factor[:, :n], factor[:, n:split], factor[:, split:]


def gramian(A: FloatArray, W: FloatArray, dt: float) -> tuple[FloatArray, FloatArray]:
    """exp(A dt) and the integral of exp(A's) W exp(A s) over `dt` (Van Loan on a short step, then doubled)."""
    n = A.shape[0]
    if n == 0:
        return np.zeros((0, 0)), np.zeros((0, 0))
    scale = scaling.balance(A)
    a, w = A * scale / scale[:, None], W * np.outer(scale, scale)
    length = float(np.linalg.norm(a, 1)) * dt
    halvings = max(0, int(np.ceil(np.log2(length / LONGEST_STEP)))) if length > 0.0 else 0
    joined = np.zeros((2 * n, 2 * n))
    joined[:n, :n], joined[:n, n:], joined[n:, n:] = -a.T, w, a
    step = expm(joined * (dt / 2.0**halvings))
    power = step[n:, n:]
    total = symmetric(power.T @ step[:n, n:])
    for _ in range(halvings):
        total = symmetric(total + power.T @ total @ power)
        power = power @ power
    return power * scale[:, None] / scale, total / np.outer(scale, scale)


def root(weight: FloatArray) -> FloatArray:
    """F with F'F = weight, for a positive semidefinite matrix (rounding below zero is cut off).

    Examples
    --------
    >>> F = root(np.array([[4.0, 2.0], [2.0, 1.0]]))
    >>> bool(np.allclose(F.T @ F, [[4.0, 2.0], [2.0, 1.0]]))
    True
    """
    size = np.sqrt(np.maximum(np.diag(weight), 0.0))
    unit = np.exp2(np.round(np.log2(np.where(size > 0.0, size, 1.0))))
    values, vectors = np.linalg.eigh(symmetric(weight / np.outer(unit, unit)))
    return np.asarray(np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T * unit)


def balanced_exponential(matrix: FloatArray) -> FloatArray:
    """exp(matrix) by way of balanced coordinates (powers of two)."""
    scale = scaling.balance(matrix)
    balanced = scaling.rescale(matrix, scale)
    return np.asarray(expm(balanced) * scale[:, None] / scale)


def period(dt: float) -> None:
    """Raise unless `dt` is a sampling period.

    Raises
    ------
    ValueError : `dt` is not finite and positive
    """
    if not (np.isfinite(dt) and dt > 0.0):
        raise ValueError(f"dt: expected a positive sampling period in s, got {dt!r}")
