"""Return ratios as records: L(s) = (C (sI - A)^-1 B + D) diag(exp(-s tau)), negative feedback (I + L)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from maglev_ctrl.arrays import ComplexArray, FloatArray, read_only
from maglev_ctrl.kernels import balance
from maglev_ctrl.systems import Controller, SecondOrderSystem, loop_matrices


@dataclass(frozen=True, eq=False, slots=True)
class Loop:
    """Return ratio L broken at the actuator commands, negative feedback: u = -L u, closed loop where det(I + L) = 0.

    Parameters
    ----------
    A, B, C, D : (n, n), (n, m), (m, n), (m, m) state space of L without its delays
    channels : m names of the broken signals
    delays : (m,) s, exact input delay of each channel; None for none. In discrete time whole samples only
    dt : sampling period in s; None for continuous time

    Raises
    ------
    ValueError : shapes do not fit, a delay is negative, dt is not positive, a discrete delay is not whole samples

    Examples
    --------
    >>> loop = Loop([[-1.0]], [[1.0]], [[2.0]], [[0.0]], ("force",), delays=[0.1])
    >>> float(np.round(abs(return_ratio(loop, [0.0])[0, 0, 0]), 12))
    2.0
    """

    A: FloatArray
    B: FloatArray
    C: FloatArray
    D: FloatArray
    channels: tuple[str, ...]
    delays: FloatArray
    dt: float | None

    def __init__(
        self,
        A: ArrayLike,
        B: ArrayLike,
        C: ArrayLike,
        D: ArrayLike,
        channels: tuple[str, ...],
        delays: ArrayLike | None = None,
        dt: float | None = None,
    ) -> None:
        m = len(channels)
        n = np.shape(A)[-1] if np.size(A) else 0
        if m == 0 or len(set(channels)) != m:
            raise ValueError(f"channels: expected distinct names, at least one, got {channels!r}")
        if dt is not None and not (np.isfinite(dt) and dt > 0.0):
            raise ValueError(f"dt: expected a positive sampling period in s or None, got {dt!r}")
        lags = read_only(np.zeros(m) if delays is None else delays, name="delays", shape=(m,))
        if lags.ndim != 1 or np.any(lags < 0.0):
            raise ValueError(f"delays: expected {m} values in s, none negative, got {lags}")
        if dt is not None and np.any(np.abs(lags / dt - np.round(lags / dt)) > 1e-9):
            raise ValueError(f"delays: expected whole multiples of dt = {dt} s, got {lags}")
        shapes = {"A": (A, n, n), "B": (B, n, m), "C": (C, m, n), "D": (D, m, m)}
        for key, (value, rows, columns) in shapes.items():
            block = np.zeros((rows, columns)) if not np.size(value) else value
            array = read_only(block, name=key, shape=(rows, columns))
            if array.ndim != 2:
                raise ValueError(f"{key}: expected one matrix, got shape {array.shape}")
            object.__setattr__(self, key, array)
        object.__setattr__(self, "channels", tuple(channels))
        object.__setattr__(self, "delays", lags)
        object.__setattr__(self, "dt", None if dt is None else float(dt))

    @classmethod
    def from_transfer_function(
        cls,
        numerator: ArrayLike,
        denominator: ArrayLike,
        *,
        delay: float = 0.0,
        dt: float | None = None,
        channel: str = "loop",
    ) -> Loop:
        """A single loop L = numerator / denominator (highest power first) times exp(-s delay).

        Raises
        ------
        ValueError : more zeros than poles

        Examples
        --------
        >>> Loop.from_transfer_function([25.0], [1.0, 10.0, 10.0, 10.0]).A.shape
        (3, 3)
        """
        top, bottom = np.trim_zeros(np.atleast_1d(np.asarray(numerator, dtype=float)), "f"), np.atleast_1d(denominator)
        if len(top) > len(np.trim_zeros(np.asarray(bottom, dtype=float), "f")):
            raise ValueError("numerator: expected a degree at most that of the denominator (a proper loop)")
        from scipy.signal import tf2ss  # loads half of scipy, and only transfer functions need it

        A, B, C, D = tf2ss(top if len(top) else np.zeros(1), bottom)
        if len(np.trim_zeros(np.asarray(bottom, dtype=float), "f")) == 1:
            A, B, C = np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0))
        return balanced(cls(A, B, C, D, (channel,), [delay], dt))

    @classmethod
    def from_system(cls, system: SecondOrderSystem, controller: Controller, *, delays: ArrayLike | None = None) -> Loop:
        """The loop of `system` and `controller` broken at the actuator commands.

        Delays given here are exact; they come on top of delays the system carries as Pade states.

        Examples
        --------
        >>> plant = SecondOrderSystem.from_matrices([[1.0]], [[0.0]], [[4.0]], inputs=("force",), B=[[1.0]])
        >>> law = Controller.static([[-0.5]], measured=("q1.velocity",), commands=("force",))
        >>> Loop.from_system(plant, law).channels
        ('force',)
        """
        A, B, C, D = loop_matrices(system, controller)
        return cls(A, B, C, D, controller.commands, delays)


def balanced(loop: Loop) -> Loop:
    """The same loop in state coordinates of even size: diagonal powers of two, no rounding.

    Forces of 1e6 N beside displacements of 1e-2 m would otherwise drown the small entries.

    Examples
    --------
    >>> wild = Loop([[0.0, 1e6], [-1e-6, -1.0]], [[0.0], [1.0]], [[1e-6, 0.0]], [[0.0]], ("u",))
    >>> bool(np.max(np.abs(balanced(wild).A)) < 10.0)
    True
    """
    scale = state_scales(loop.A, loop.B, loop.C)
    A, B, C = loop.A * scale / scale[:, None], loop.B / scale[:, None], loop.C * scale
    return Loop(A, B, C, loop.D, loop.channels, loop.delays, loop.dt)


def state_scales(A: FloatArray, B: FloatArray, C: FloatArray) -> FloatArray:
    """Powers of two that even out states against inputs and outputs: x = scale * x_balanced; (n,)."""
    n, m, p = A.shape[0], B.shape[1], C.shape[0]
    if n == 0:
        return np.ones(0)
    joined = np.zeros((n + m + p, n + m + p))
    joined[:n, :n], joined[:n, n : n + m], joined[n + m :, :n] = A, B, C
    for i in range(min(m, p)):  # tie input i to output i, so that neither is free to absorb the whole scale
        joined[n + i, n + m + i] = 1.0
    state = balance(joined)[:n]
    b, c = np.linalg.norm(B / state[:, None]), np.linalg.norm(C * state)
    if b > 0.0 and c > 0.0:
        state = state * 2.0 ** np.round(0.5 * np.log2(b / c))
    return state


def axis_points(loop: Loop, frequency: ArrayLike) -> ComplexArray:
    """Points j omega, or exp(j omega dt) in discrete time, for frequencies in rad/s."""
    omega = np.asarray(frequency, dtype=np.float64)
    if loop.dt is None:
        return np.asarray(1j * omega)
    return np.asarray(np.exp(1j * omega * loop.dt), dtype=np.complex128)


def delay_factors(loop: Loop, points: ComplexArray) -> ComplexArray:
    """Exact delay factors exp(-s tau) (or z**-k) of every channel at the points s (or z); (..., m)."""
    if loop.dt is None:
        return np.asarray(np.exp(-points[..., None] * loop.delays))
    return np.asarray(points[..., None] ** (-np.round(loop.delays / loop.dt)))


def return_ratio(loop: Loop, frequency: ArrayLike) -> ComplexArray:
    """L at frequencies in rad/s, delays exact; (..., m, m).

    Raises
    ------
    numpy.linalg.LinAlgError : a frequency is exactly a pole of L

    Examples
    --------
    >>> complex(return_ratio(Loop.from_transfer_function([1.0], [1.0, 1.0]), 1.0)[0, 0])
    (0.5-0.5j)
    """
    points = axis_points(loop, frequency)
    n = loop.A.shape[0]
    plain = loop.D + loop.C @ np.linalg.solve(points[..., None, None] * np.eye(n) - loop.A, loop.B + 0j)
    return np.asarray(plain * delay_factors(loop, points)[..., None, :])


def sensitivity(loop: Loop, frequency: ArrayLike) -> ComplexArray:
    """S = (I + L)^-1 at frequencies in rad/s, delays exact; finite also where L has a pole; (..., m, m).

    Its diagonal is the sensitivity of each loop with all others closed: S_ii = 1 / (1 + L_i).

    Examples
    --------
    >>> complex(sensitivity(Loop.from_transfer_function([1.0], [1.0, 0.0]), 0.0)[0, 0])
    0j
    """
    return sensitivity_at(loop, axis_points(loop, frequency))


def sensitivity_at(loop: Loop, points: ComplexArray) -> ComplexArray:
    """S = (I + L)^-1 at complex points s (or z), from one bordered solve; (..., m, m)."""
    n, m = loop.B.shape
    right = np.zeros((n + m, m), dtype=complex)
    right[n:] = np.eye(m)
    solution = np.linalg.solve(bordered(loop, points), np.broadcast_to(right, (*points.shape, n + m, m)))
    return np.asarray(solution[..., n:, :] + 0.0, dtype=np.complex128)  # + 0.0: no negative zeros


def bordered(loop: Loop, points: ComplexArray) -> ComplexArray:
    """[[sI - A, -B Theta], [C, I + D Theta]]: singular exactly at the closed-loop poles; (..., n + m, n + m)."""
    n, m = loop.B.shape
    theta = delay_factors(loop, points)[..., None, :]
    matrix = np.zeros((*points.shape, n + m, n + m), dtype=complex)
    matrix[..., :n, :n] = points[..., None, None] * np.eye(n) - loop.A
    matrix[..., :n, n:] = -loop.B * theta
    matrix[..., n:, :n] = loop.C
    matrix[..., n:, n:] = np.eye(m) + loop.D * theta
    return matrix
