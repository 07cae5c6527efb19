"""The periodic linear-quadratic problem: system, weights, closed loop, and its multipliers over one period."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from maglev_ctrl.analysis.floquet import plan_for, scaled_coefficients
from maglev_ctrl.arrays import ComplexArray, FloatArray, read_only
from maglev_ctrl.kernels import periodic_multipliers, propagators_over_depths
from maglev_ctrl.kernels.fourier_matrix import FourierMatrix
from maglev_ctrl.systems import PeriodicSystem

_GAIN_DIGITS = 1e-15  # harmonics of the gain below this share are left out


@dataclass(frozen=True, eq=False, slots=True)
class PeriodicProblem:
    """x' = A(t) x + B(t) u, cost: integral of x'Qx + u'Ru; `Q` (n, n) semidefinite, `R` (m, m) positive definite."""

    A: FourierMatrix
    B: FourierMatrix
    Q: FloatArray
    R: FloatArray

    @classmethod
    def of(
        cls, system: PeriodicSystem, B: ArrayLike, Q: ArrayLike, R: ArrayLike, *,
        B_cos: ArrayLike | None = None, B_sin: ArrayLike | None = None,
    ) -> PeriodicProblem:  # fmt: skip
        """The problem of one periodic system, checked.

        Parameters
        ----------
        system : A(t), no batch axes
        B, B_cos, B_sin : (n, m) mean and (H, n, m) harmonics of the input matrix; constant where only B is given
        Q, R : (n, n), (m, m)

        Raises
        ------
        ValueError : a shape does not fit, a weight is not symmetric, Q not semidefinite or R not positive definite

        Examples
        --------
        >>> mathieu = PeriodicSystem.from_matrices([[0, 1], [-1, 0]], [[[0, 0], [-0.4, 0]]], frequency=2.0)
        >>> PeriodicProblem.of(mathieu, [[0.0], [1.0]], np.eye(2), [[1.0]]).input_weight().mean
        array([[0., 0.],
               [0., 1.]])
        """
        if system.A_0.ndim != 2 or system.A_cos.ndim != 3 or system.frequency.ndim != 0:
            raise ValueError("system: expected one periodic system, got batch axes")
        frequency = float(system.frequency)
        A = FourierMatrix.of(system.A_0, system.A_cos, system.A_sin, frequency=frequency)
        n = A.mean.shape[0]
        inputs = FourierMatrix.of(read_only(B, name="B", shape=(n, None)), B_cos, B_sin, frequency=frequency)
        m = inputs.mean.shape[1]
        weights: list[FloatArray] = []
        for name, value, size in (("Q", Q, n), ("R", R, m)):
            weight = read_only(value, name=name, shape=(size, size))
            if weight.ndim != 2 or np.linalg.norm(weight - weight.T) > 1e-10 * np.linalg.norm(weight):
                raise ValueError(f"{name}: expected one symmetric matrix")
            weights.append(read_only(0.5 * (weight + weight.T), name=name))
        if np.min(np.linalg.eigvalsh(_correlation(weights[0]))) < -1e-10:
            raise ValueError("Q: expected a positive semidefinite matrix")
        try:
            np.linalg.cholesky(weights[1])
        except np.linalg.LinAlgError:
            raise ValueError("R: expected a positive definite matrix") from None
        return cls(A, inputs, *weights)

    def input_weight(self) -> FourierMatrix:
        """B R^-1 B'."""
        weighted = FourierMatrix.of(np.linalg.inv(self.R), frequency=self.A.frequency)
        return self.B.times(weighted).times(self.B.T)

    def closed(self, gain: FourierMatrix) -> FourierMatrix:
        """A(t) - B(t) K(t)."""
        return self.A.plus(self.B.times(gain), -1.0)


def gain_of(problem: PeriodicProblem, P: FourierMatrix) -> FourierMatrix:
    """R^-1 B(t)' P(t) as a series, harmonics in the rounding left out."""
    inverse = FourierMatrix.of(np.linalg.inv(problem.R), frequency=P.frequency)
    scale = cost_scale(P)
    full = inverse.times(problem.B.T).times(P)
    short = full.scaled(np.ones(len(problem.R)), 1.0 / scale).truncated(_GAIN_DIGITS).harmonics
    return FourierMatrix.of(full.mean, full.cosine[:short], full.sine[:short], frequency=P.frequency)


def loop_multipliers(A: FourierMatrix) -> ComplexArray:
    """Multipliers of x' = A(t) x, largest first, by Taylor propagators and a periodic QR iteration.

    Examples
    --------
    >>> loop_multipliers(FourierMatrix.of([[-1.0]], [[[5.0]]], frequency=2.0 * np.pi)).real.round(9)
    array([0.36787944])
    """
    padded = A.padded(1)
    scaled = scaled_coefficients(padded.mean, padded.cosine, padded.sine)
    plan = plan_for(*scaled, frequency=A.frequency)
    factors = propagators_over_depths(*scaled, frequency=A.frequency, depths=np.ones(1), plan=plan)[0]
    with np.errstate(over="ignore"):
        return np.asarray(np.exp(periodic_multipliers(factors).logs))


def cost_scale(P: FourierMatrix) -> FloatArray:
    """Square roots of the mean diagonal of P, one where there is no cost: (n,)."""
    diagonal = np.sqrt(np.abs(np.diagonal(P.mean)))
    floor = 1e-12 * float(np.max(diagonal, initial=0.0))
    return np.asarray(np.where(diagonal > floor, diagonal, 1.0))


def multiplier_text(multiplier: complex) -> str:
    """A multiplier as told to the user."""
    real = abs(multiplier.imag) <= 1e-9 * abs(multiplier)
    value = f"{multiplier.real:.6g}" if real else f"{complex(multiplier):.6g}"
    return f"multiplier {value} (modulus {abs(multiplier):.6g})"


def _correlation(weight: FloatArray) -> FloatArray:
    """The weight in units of its own diagonal, so that its smallest eigenvalue means something."""
    diagonal = np.sqrt(np.abs(np.diag(weight)))
    diagonal = np.where(diagonal > 0.0, diagonal, 1.0)
    return np.asarray(weight / np.outer(diagonal, diagonal))
