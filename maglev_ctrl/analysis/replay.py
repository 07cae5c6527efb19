"""Replays: put a perturbation into the exact loop and find the closed-loop pole it produces.

The characteristic matrix uses the loop's own matrices and exact delays, none of the machinery that found the margin.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from maglev_ctrl.analysis.loops import Loop, delay_factors
from maglev_ctrl.arrays import ComplexArray, FloatArray

POLE_TOLERANCE = 1e-6


@dataclass(frozen=True, eq=False, slots=True)
class DynamicPerturbation:
    """Real dynamic uncertainty delta(s) = gain (corner - s)/(corner + s); corner 0 means the constant `gain`.

    In discrete time s stands for (2/dt)(z - 1)/(z + 1).
    """

    gain: float
    corner: float

    @classmethod
    def through(cls, value: complex, frequency: float) -> DynamicPerturbation:
        """The stable all-pass of real coefficients equal to `value` at j `frequency` (rad/s on the axis).

        Examples
        --------
        >>> delta = DynamicPerturbation.through(0.3 + 0.4j, 2.0)
        >>> complex(np.round(delta.at(np.array(2j)), 12))
        (0.3+0.4j)
        """
        size, angle = abs(value), float(np.angle(value))
        if frequency == 0.0 or not np.isfinite(frequency) or abs(np.sin(angle)) < 1e-14:
            return cls(float(np.copysign(size, value.real)), 0.0)
        gain = -size if angle > 0.0 else size
        lag = -(angle - np.pi) if angle > 0.0 else -angle
        return cls(gain, float(frequency / np.tan(lag / 2.0)))

    def at(self, s: ComplexArray) -> ComplexArray:
        """Value at points s of the (equivalent) continuous plane."""
        if self.corner == 0.0:
            return np.full_like(np.asarray(s, dtype=complex), self.gain)
        return np.asarray(self.gain * (self.corner - s) / (self.corner + s))


@dataclass(frozen=True, eq=False, slots=True)
class Factor:
    """What multiplies one channel: a constant, an extra delay, and a disk perturbation of skew sigma.

    f(s) = constant * exp(-s delay) * (2 + delta(s)(1 - sigma)) / (2 - delta(s)(1 + sigma)); delta is `disk`, or the
    complex constant `fixed` where there is none.
    """

    constant: complex = 1.0
    delay: float = 0.0
    disk: DynamicPerturbation | None = None
    sigma: float = 0.0
    fixed: complex = 0.0

    def fraction(self, point: complex, dt: float | None) -> tuple[complex, complex]:
        """Numerator and denominator of f at a point s (or z)."""
        lag = np.exp(-point * self.delay) if dt is None else point ** (-self.delay / dt)
        delta = complex(self.fixed)
        if self.disk is not None and self.disk.corner == 0.0:
            delta = complex(self.disk.gain)  # also at z = -1, where s is infinite
        elif self.disk is not None:
            delta = complex(self.disk.at(np.asarray(point if dt is None else 2.0 / dt * (point - 1.0) / (point + 1.0))))
        return complex(self.constant * lag * (2.0 + delta * (1.0 - self.sigma))), complex(
            2.0 - delta * (1.0 + self.sigma)
        )


@dataclass(frozen=True, eq=False, slots=True)
class Replay:
    """A closed-loop pole of the perturbed loop and the relative smallest singular value left there."""

    pole: complex
    residual: float


def characteristic(loop: Loop, point: complex, factors: tuple[Factor, ...]) -> ComplexArray:
    """[[sI - A, B Theta n], [-C, d + D Theta n]] with f = n/d: singular exactly at the poles of the perturbed loop."""
    n, m = loop.B.shape
    fractions = [factor.fraction(point, loop.dt) for factor in factors] or [(1.0 + 0j, 1.0 + 0j)] * m
    top = np.array([f[0] for f in fractions]) * delay_factors(loop, np.asarray(point))
    matrix = np.zeros((n + m, n + m), dtype=complex)
    matrix[:n, :n] = point * np.eye(n) - loop.A
    matrix[:n, n:] = loop.B * top
    matrix[n:, :n] = -loop.C
    matrix[n:, n:] = np.diag([f[1] for f in fractions]) + loop.D * top
    return matrix


def pole_near(loop: Loop, start: complex, factors: tuple[Factor, ...] = (), *, iterations: int = 12) -> Replay:
    """Pole of the perturbed loop found by Newton's method from `start` (two-sided singular vectors).

    Examples
    --------
    >>> loop = Loop.from_transfer_function([25.0], [1.0, 10.0, 10.0, 10.0])
    >>> replay = pole_near(loop, 3.1j, (Factor(constant=3.6),))
    >>> complex(np.round(replay.pole, 9))
    3.16227766j
    """
    step = 1e-6 * (abs(start) + 1e-6 * _size(loop))
    point, residual = complex(start), np.inf
    best = Replay(point, np.inf)
    for _ in range(iterations):
        matrix = characteristic(loop, point, factors)
        left, values, right = np.linalg.svd(matrix)
        residual = float(values[-1] / max(values[0], 1.0))
        if residual < best.residual:
            best = Replay(point, residual)
        slope = (characteristic(loop, point + step, factors) - characteristic(loop, point - step, factors)) / (2 * step)
        u, v = left[:, -1], right[-1].conj()
        denominator = complex(u.conj() @ slope @ v)
        if denominator == 0.0:
            break
        change = values[-1] / denominator
        point -= change
        if abs(change) <= 1e-13 * abs(point):
            final = np.linalg.svd(characteristic(loop, point, factors), compute_uv=False)
            return Replay(complex(point), float(final[-1] / max(final[0], 1.0)))
    return best


def _size(loop: Loop) -> float:
    return float(np.max(np.abs(loop.A), initial=0.0)) or 1.0


def reaches_axis(loop: Loop, point: complex, factors: tuple[Factor, ...]) -> bool:
    """Whether the perturbed loop has a pole on the axis at `point` (s = j omega, or z on the circle).

    The pole found must lie within 1e-6 of the point, relative to its modulus (at the origin: to the loop's rates).
    """
    replay = pole_near(loop, point, factors)
    scale = abs(point) if abs(point) > 0.0 else 1e-3 * _size(loop)
    return bool(abs(replay.pole - point) <= POLE_TOLERANCE * scale and replay.residual <= 1e-9)


def all_nominal(count: int) -> list[Factor]:
    """Factors of one for every channel, to be changed one by one."""
    return [Factor() for _ in range(count)]


def frequencies_of(poles: ComplexArray) -> FloatArray:
    """Moduli, imaginary parts and neighbours of poles: where a response may be narrow; sorted, rad/s."""
    width = np.abs(poles.real)
    around = np.abs(poles.imag)[:, None] + width[:, None] * np.array([-3.0, -1.0, -0.3, 0.0, 0.3, 1.0, 3.0])
    return np.unique(np.abs(np.concatenate([np.abs(poles), around.ravel()])))
