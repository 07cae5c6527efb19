"""Sampled linear-quadratic regulator, Kalman filter and their union: on plain matrices, and on plants with a proof.

Two forms of the estimate: the predictor x^(k | k-1) uses measurements up to the last sample, so that a whole period is
left for computing; the filter x^(k | k) uses the measurement of the present sample too.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from maglev_ctrl.arrays import FloatArray, read_only
from maglev_ctrl.errors import ModelError
from maglev_ctrl.synthesis.doubling import symmetric
from maglev_ctrl.synthesis.riccati import RiccatiSolution
from maglev_ctrl.synthesis.riccati_discrete import SADDLE, riccati_discrete
from maglev_ctrl.synthesis.sampling import held, held_cost, held_noise, sampled

__all__ = [
    "DiscreteCompensator", "DiscreteKalmanFilter", "EstimateForm", "held", "held_cost", "held_noise",
    "kalman_discrete", "lqg_discrete", "lqr_discrete", "sampled",
]  # fmt: skip

EstimateForm = Literal["predictor", "filter"]


@dataclass(frozen=True, eq=False, slots=True)
class DiscreteKalmanFilter:
    """Steady Kalman filter of x+ = A x + B u + w, y = C x + D u + v.

    `gain` L (n, ny): x^(k+1 | k) = A x^ + B u + L e with the innovation e = y - C x^ - D u and x^ = x^(k | k-1);
    `filter_gain` M (n, ny): x^(k | k) = x^ + M e; `covariance` and `filter_covariance` (n, n) of their errors.
    """

    gain: FloatArray
    filter_gain: FloatArray
    covariance: FloatArray
    filter_covariance: FloatArray
    riccati: RiccatiSolution


@dataclass(frozen=True, eq=False, slots=True)
class DiscreteCompensator:
    """Sampled LQG compensator x+ = A x + B y, u = C x + D y (D = 0 in predictor form) and what it was made of."""

    A: FloatArray
    B: FloatArray
    C: FloatArray
    D: FloatArray
    form: EstimateForm
    regulator: RiccatiSolution
    observer: DiscreteKalmanFilter


def lqr_discrete(A: ArrayLike, B: ArrayLike, Q: ArrayLike, R: ArrayLike, N: ArrayLike | None = None) -> RiccatiSolution:
    """State feedback u = -gain x of least sum of x'Qx + u'Ru + 2 x'Nu; the cost from x0 is x0' P x0.

    Parameters
    ----------
    A, B : (n, n), (n, m) of x+ = A x + B u
    Q, R, N : weights (n, n), (m, m), (n, m); R may be singular where R + B'PB is not

    Raises
    ------
    ValueError : shapes do not fit, or a weight is not symmetric
    ModelError : there is no stabilising solution, or the cost has no least value

    Examples
    --------
    >>> round(float(lqr_discrete([[1.0]], [[1.0]], [[1.0]], [[1.0]]).gain[0, 0]), 9)
    0.618033989
    """
    solution = riccati_discrete(A, B, Q, R, N).require()
    if SADDLE in solution.message:
        raise ModelError(f"Riccati equation: {SADDLE}")
    return solution


def kalman_discrete(
    A: ArrayLike, C: ArrayLike, process: ArrayLike, measurement: ArrayLike, cross: ArrayLike | None = None
) -> DiscreteKalmanFilter:
    """Steady Kalman filter of x+ = A x + B u + w, y = C x + D u + v.

    With the covariance S of the prediction error, E = V + C S C': L = (A S C' + X) E^-1 and M = S C' E^-1.

    Parameters
    ----------
    A, C : (n, n), (ny, n)
    process, measurement : covariances W (n, n) and V (ny, ny) of w and v; V + C S C' must be regular
    cross : X (n, ny), E[w v']

    Raises
    ------
    ValueError : shapes do not fit
    ModelError : a mode on or outside the unit circle is not seen by the sensors

    Examples
    --------
    >>> observer = kalman_discrete([[1.0]], [[1.0]], [[1.0]], [[1.0]])
    >>> round(float(observer.covariance[0, 0]), 9), round(float(observer.filter_covariance[0, 0]), 9)
    (1.618033989, 0.618033989)
    """
    a, c = (np.asarray(x, dtype=float) for x in (A, C))
    solution = lqr_discrete(a.T, c.T, process, measurement, cross)
    S = solution.P
    innovation = np.asarray(measurement, dtype=float) + c @ S @ c.T
    M = np.linalg.solve(innovation, c @ S).T
    return DiscreteKalmanFilter(
        gain=read_only(solution.gain.T, name="gain"),
        filter_gain=read_only(M, name="filter_gain"),
        covariance=S,
        filter_covariance=read_only(symmetric(S - M @ innovation @ M.T), name="filter_covariance"),
        riccati=solution,
    )


def lqg_discrete(
    A: ArrayLike,
    B: ArrayLike,
    C: ArrayLike,
    D: ArrayLike,
    *,
    weights: tuple[ArrayLike, ArrayLike, ArrayLike],
    noise: tuple[ArrayLike, ArrayLike, ArrayLike],
    form: EstimateForm = "filter",
) -> DiscreteCompensator:
    """Regulator and Kalman filter joined: u = -K x^, with x^ in the chosen form.

    Both share the state x^(k | k-1); the filter form adds u = -K (x^ + M (y - C x^ - D u)), solved for u. Of all laws
    the filter form is the best where process and sensor noise are not correlated, the predictor form of all laws that
    leave a period for computing.

    Parameters
    ----------
    A, B, C, D : plant x+ = A x + B u + w, y = C x + D u + v
    weights : Q, R, N of the regulator
    noise : W, V, X of the filter
    form : "predictor" or "filter"

    Raises
    ------
    ValueError : shapes do not fit, or the form is unknown
    ModelError : one of the two Riccati equations has no stabilising solution

    Examples
    --------
    >>> weights, noise = ([[1.0]], [[1.0]], [[0.0]]), ([[1.0]], [[1.0]], [[0.0]])
    >>> law = lqg_discrete([[1.0]], [[1.0]], [[1.0]], [[0.0]], weights=weights, noise=noise)
    >>> round(float(law.D[0, 0]), 9)
    -0.381966011
    """
    if form not in ("predictor", "filter"):
        raise ValueError(f"form: expected 'predictor' or 'filter', got {form!r}")
    a, b, c, d = (np.asarray(x, dtype=float) for x in (A, B, C, D))
    regulator = lqr_discrete(a, b, *weights)
    observer = kalman_discrete(a, c, *noise)
    K, L, M = regulator.gain, observer.gain, observer.filter_gain
    if form == "filter":
        solved = np.linalg.solve(np.eye(b.shape[1]) - K @ M @ d, K)
        C_k, D_k = -solved @ (np.eye(len(a)) - M @ c), -solved @ M
    else:
        C_k, D_k = -K, np.zeros((b.shape[1], c.shape[0]))
    driven = b - L @ d
    return DiscreteCompensator(
        A=read_only(a - L @ c + driven @ C_k, name="A"),
        B=read_only(L + driven @ D_k, name="B"),
        C=read_only(C_k, name="C"),
        D=read_only(D_k, name="D"),
        form=form,
        regulator=regulator,
        observer=observer,
    )
