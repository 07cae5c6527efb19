"""Linear-quadratic laws without their proofs: for searches that make hundreds of laws and prove the one they choose.

The equations and weights are those of `laws`; what is left out is the refinement in doubled precision, the agreement of
two solvers and the certificate of the closed loop. A law made here is never reported as designed.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.linalg import solve_continuous_are

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.errors import ModelError
from maglev_ctrl.synthesis.gaussian import SensorNoise, noise_model
from maglev_ctrl.synthesis.neutral import NEUTRAL_RATE, prepare
from maglev_ctrl.synthesis.weights import InputWeight, OutputWeight, quadratic_weights
from maglev_ctrl.systems import Controller, SecondOrderSystem


def lqr_controller(
    system: SecondOrderSystem,
    output_weights: Sequence[OutputWeight],
    input_weights: Sequence[InputWeight],
    *,
    name: str = "LQR",
) -> Controller:
    """The law of `laws.design_lqr`, unproved.

    Raises
    ------
    ValueError : unknown or doubled names, batch axes
    ModelError : no stabilising law exists

    Examples
    --------
    >>> plant = SecondOrderSystem.from_matrices([[1.0]], [[0.0]], [[-1.0]], inputs=("force",), B=[[1.0]])
    >>> law = lqr_controller(plant, [OutputWeight("q1", 1.0)], [InputWeight("force", 1.0)])
    >>> np.round(law.D, 6)
    array([[-2.414214, -2.197368]])
    """
    weights = quadratic_weights(system, output_weights, input_weights)
    A = system.state_matrix()
    B = system.input_matrix()[:, [system.inputs.index(x) for x in weights.commands]]
    prepared = prepare(A, B, weights, states=system.states, neutral_rate=NEUTRAL_RATE, uncontrollable="refuse")
    gain = _gain(prepared.A, B, prepared.Q, weights.R, weights.N)
    return Controller.static(-gain, measured=system.states, commands=weights.commands, name=name)


def lqg_controller(
    system: SecondOrderSystem,
    output_weights: Sequence[OutputWeight],
    input_weights: Sequence[InputWeight],
    *,
    sensors: Sequence[SensorNoise],
    disturbance: float,
    name: str = "LQG",
) -> Controller:
    """The law of `laws.design_lqg`, unproved.

    Parameters
    ----------
    sensors, disturbance : as in `laws.design_lqg`

    Raises
    ------
    ValueError : unknown or doubled names, densities that are not positive, batch axes
    ModelError : no stabilising law exists

    Examples
    --------
    >>> plant = SecondOrderSystem.from_matrices([[1.0]], [[0.0]], [[-1.0]], inputs=("force",), B=[[1.0]])
    >>> law = lqg_controller(plant, [OutputWeight("q1", 1.0)], [InputWeight("force", 1.0)],
    ...                      sensors=[SensorNoise("q1", 1e-3)], disturbance=1.0)
    >>> law.measured, law.A.shape
    (('q1',), (2, 2))
    """
    weights = quadratic_weights(system, output_weights, input_weights)
    model = noise_model(system, weights, sensors, disturbance=disturbance, guideway=None)
    prepared = prepare(
        model.A, model.B, model.weights, states=model.states, neutral_rate=NEUTRAL_RATE, uncontrollable="refuse"
    )
    K = _gain(prepared.A, model.B, prepared.Q, weights.R, model.weights.N)
    L = _gain(model.A.T, model.C.T, model.process, model.measurement, model.cross).T
    return Controller.from_matrices(
        model.A - model.B @ K - L @ (model.C - model.D @ K), L, -K, np.zeros((len(weights.commands), len(L.T))),
        measured=model.measured, commands=weights.commands, name=name,
    )  # fmt: skip


def _gain(A: FloatArray, B: FloatArray, Q: FloatArray, R: FloatArray, N: FloatArray) -> FloatArray:
    """K = R^-1 (B'P + N') of the stabilising solution; the closed loop is looked at, nothing else."""
    try:
        P = solve_continuous_are(A, B, Q, R, s=N)
    except (np.linalg.LinAlgError, ValueError) as fault:
        raise ModelError(f"no stabilising solution of the Riccati equation was found: {fault}") from None
    gain = np.linalg.solve(R, B.T @ P + N.T)
    if not np.all(np.isfinite(gain)) or np.max(np.linalg.eigvals(A - B @ gain).real, initial=-1.0) >= 0.0:
        raise ModelError("the solution found of the Riccati equation does not stabilise")
    return np.asarray(gain, dtype=np.float64)
