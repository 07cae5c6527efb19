"""Linear-quadratic regulator, steady Kalman filter and their union, on plain matrices."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from maglev_ctrl.arrays import FloatArray, read_only
from maglev_ctrl.synthesis.riccati import RiccatiSolution, riccati_continuous

__all__ = ["KalmanFilter", "RiccatiSolution", "Compensator", "kalman", "lqg", "lqr", "riccati_continuous"]


@dataclass(frozen=True, eq=False, slots=True)
class KalmanFilter:
    """Steady Kalman filter: `gain` L (n, ny), error covariance `covariance` (n, n), poles of A - L C in `riccati`."""

    gain: FloatArray
    covariance: FloatArray
    riccati: RiccatiSolution


@dataclass(frozen=True, eq=False, slots=True)
class Compensator:
    """LQG compensator x' = A x + B y, u = C x, and the two solutions it was made of."""

    A: FloatArray
    B: FloatArray
    C: FloatArray
    regulator: RiccatiSolution
    observer: KalmanFilter


def lqr(A: ArrayLike, B: ArrayLike, Q: ArrayLike, R: ArrayLike, N: ArrayLike | None = None) -> RiccatiSolution:
    """State feedback u = -gain x of least integral of x'Qx + u'Ru + 2 x'Nu; the cost from x0 is x0' P x0.

    Parameters
    ----------
    A, B : (n, n), (n, m)
    Q, R, N : weights (n, n), (m, m), (n, m)

    Raises
    ------
    ValueError : shapes do not fit or R is not positive definite
    ModelError : there is no stabilising solution

    Examples
    --------
    >>> float(lqr([[0.0]], [[1.0]], [[9.0]], [[1.0]]).gain[0, 0])
    3.0
    """
    return riccati_continuous(A, B, Q, R, N).require()


def kalman(
    A: ArrayLike, C: ArrayLike, process: ArrayLike, measurement: ArrayLike, cross: ArrayLike | None = None
) -> KalmanFilter:
    """Steady Kalman filter of x' = A x + B u + w, y = C x + D u + v: x^' = A x^ + B u + L (y - C x^ - D u).

    The dual Riccati equation A S + S A' + W - (S C' + X) V^-1 (S C' + X)' = 0, L = (S C' + X) V^-1; the cross
    intensity X is not zero where a sensor (an accelerometer) feels the process noise directly.

    Parameters
    ----------
    A, C : (n, n), (ny, n)
    process, measurement : intensities W (n, n) and V (ny, ny) of w and v (two-sided); V positive definite
    cross : X (n, ny), E[w v']

    Raises
    ------
    ValueError : shapes do not fit or V is not positive definite
    ModelError : an unstable or neutral mode is not seen by the sensors

    Examples
    --------
    >>> float(kalman([[0.0]], [[1.0]], [[4.0]], [[1.0]]).gain[0, 0])
    2.0
    """
    a, c = (np.asarray(x, dtype=float) for x in (A, C))
    solution = riccati_continuous(a.T, c.T, process, measurement, cross).require()
    return KalmanFilter(gain=read_only(solution.gain.T, name="gain"), covariance=solution.P, riccati=solution)


def lqg(
    A: ArrayLike,
    B: ArrayLike,
    C: ArrayLike,
    D: ArrayLike,
    *,
    weights: tuple[ArrayLike, ArrayLike, ArrayLike],
    noise: tuple[ArrayLike, ArrayLike, ArrayLike],
) -> Compensator:
    """Regulator and Kalman filter joined: x^' = (A - B K - L (C - D K)) x^ + L y, u = -K x^.

    Parameters
    ----------
    A, B, C, D : plant x' = A x + B u + w, y = C x + D u + v
    weights : Q, R, N of the regulator
    noise : W, V, X of the filter

    Raises
    ------
    ValueError : shapes do not fit
    ModelError : one of the two Riccati equations has no stabilising solution

    Examples
    --------
    >>> weights, noise = ([[1.0]], [[1.0]], [[0.0]]), ([[1.0]], [[1.0]], [[0.0]])
    >>> float(lqg([[0.0]], [[1.0]], [[1.0]], [[0.0]], weights=weights, noise=noise).A[0, 0])
    -2.0
    """
    a, b, c, d = (np.asarray(x, dtype=float) for x in (A, B, C, D))
    regulator = lqr(a, b, *weights)
    observer = kalman(a, c, *noise)
    K, L = regulator.gain, observer.gain
    return Compensator(
        A=read_only(a - b @ K - L @ (c - d @ K), name="A"),
        B=L,
        C=read_only(-K, name="C"),
        regulator=regulator,
        observer=observer,
    )
