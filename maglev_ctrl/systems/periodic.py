"""Periodic systems by their Fourier coefficients, and stiffness modulation of a vehicle."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from maglev_ctrl.arrays import FloatArray, read_only, read_only_any
from maglev_ctrl.display import Shown
from maglev_ctrl.systems.second_order import SecondOrderSystem


@dataclass(frozen=True, eq=False, slots=True, repr=False)
class PeriodicSystem(Shown):
    """x' = A(t) x with A(t) = A_0 + sum over k of (A_cos[k] cos k W t + A_sin[k] sin k W t), W = `frequency`.

    `A_0` (..., nx, nx); `A_cos`, `A_sin` (..., H, nx, nx), harmonic k = 1..H on the axis before the matrix axes;
    `frequency` (...,) rad/s. Exact for cosine modulation; feeds the Hill and the propagator engine alike.
    """

    _told: ClassVar = ("states", "A_0", "A_cos", "frequency")

    A_0: FloatArray
    A_cos: FloatArray
    A_sin: FloatArray
    frequency: FloatArray
    states: tuple[str, ...] = ()

    @classmethod
    def from_matrices(
        cls,
        A_0: ArrayLike,
        A_cos: ArrayLike,
        A_sin: ArrayLike | None = None,
        *,
        frequency: ArrayLike,
        states: tuple[str, ...] = (),
    ) -> PeriodicSystem:
        """A periodic system from its Fourier coefficients, shapes checked.

        Raises
        ------
        ValueError : a shape does not fit, there are no states, an entry is not finite, or a frequency is not positive

        Examples
        --------
        >>> mathieu = PeriodicSystem.from_matrices([[0, 1], [-1, 0]], [[[0, 0], [-0.1, 0]]], frequency=2.0)
        >>> float(mathieu.period)
        3.141592653589793
        """
        A = read_only(A_0, name="A_0", shape=(None, None))
        n = A.shape[-1]
        if n == 0:
            raise ValueError(f"A_0: expected at least one state, got shape {A.shape}")
        cosine = read_only(A_cos, name="A_cos", shape=(None, n, n))
        sine = read_only(np.zeros_like(cosine) if A_sin is None else A_sin, name="A_sin", shape=cosine.shape[-3:])
        omega = read_only(frequency, name="frequency")
        if np.any(omega <= 0.0):
            raise ValueError(f"frequency: expected a positive angular frequency in rad/s, got {np.min(omega):g}")
        return cls(A_0=read_only(A, name="A_0", shape=(n, n)), A_cos=cosine, A_sin=sine, frequency=omega, states=states)

    @property
    def period(self) -> FloatArray:
        """Period 2 pi / W in s."""
        return np.asarray(2.0 * np.pi / self.frequency)


def modulate(
    system: SecondOrderSystem,
    K_cos: ArrayLike,
    K_sin: ArrayLike | None = None,
    *,
    frequency: ArrayLike,
) -> PeriodicSystem:
    """The system (open or closed loop) with stiffness K + sum_k (K_cos[k] cos k W t + K_sin[k] sin k W t).

    Parameters
    ----------
    K_cos, K_sin : (..., H, n, n) N/m, harmonics 1..H
    frequency : (...,) rad/s

    Raises
    ------
    ValueError : a shape does not fit, there is no harmonic, an entry is not finite, a frequency is not positive, or a
        modulation acts on an ignorable position

    Examples
    --------
    >>> spring = SecondOrderSystem.from_matrices([[1.0]], [[0.0]], [[4.0]])
    >>> modulate(spring, [[[0.4]]], frequency=4.0).A_cos
    array([[[ 0. ,  0. ],
            [-0.4,  0. ]]])
    """
    n = len(system.dofs)
    cosine = read_only(K_cos, name="K_cos", shape=(None, n, n))
    sine = np.zeros_like(cosine) if K_sin is None else read_only(K_sin, name="K_sin", shape=cosine.shape[-3:])
    harmonics = range(cosine.shape[-3])
    if not len(harmonics):
        raise ValueError(f"K_cos: expected at least one harmonic, got shape {cosine.shape}")
    return PeriodicSystem.from_matrices(
        system.state_matrix(),
        np.stack([system.modulated_state_matrix(cosine[..., k, :, :]) for k in harmonics], axis=-3),
        np.stack([system.modulated_state_matrix(sine[..., k, :, :]) for k in harmonics], axis=-3),
        frequency=frequency,
        states=system.states,
    )


def at_depth(system: PeriodicSystem, depth: float) -> PeriodicSystem:
    """A periodic system given at unit depth, its modulation scaled to a depth.

    Examples
    --------
    >>> mathieu = PeriodicSystem.from_matrices([[0, 1], [-1, 0]], [[[0, 0], [-1, 0]]], frequency=2.0)
    >>> at_depth(mathieu, 0.25).A_cos[0, 1]
    array([-0.25,  0.  ])
    """
    return replace(system, A_cos=read_only_any(depth * system.A_cos), A_sin=read_only_any(depth * system.A_sin))
