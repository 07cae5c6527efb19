"""Linear-quadratic laws with integral action: chosen outputs return to their set point whatever constant load acts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.errors import ModelError, Status
from maglev_ctrl.proofs.makers import decay_claim
from maglev_ctrl.synthesis.lq import kalman
from maglev_ctrl.synthesis.lq_discrete import kalman_discrete, lqr_discrete
from maglev_ctrl.synthesis.lq_plants import (
    COST,
    NORM,
    cost_matrix,
    hidden_mode,
    mean_square,
    quadratic,
    unsolvable,
    worse,
)
from maglev_ctrl.synthesis.result import Performance, Synthesis, proven, refused
from maglev_ctrl.synthesis.riccati import RiccatiSolution, riccati_continuous
from maglev_ctrl.systems import Controller
from maglev_ctrl.systems.plant import Plant

SINGULAR = 1e-9
"""Smallest singular value, rows and columns at unit length, below which a static effect counts as none."""


@dataclass(frozen=True, eq=False, slots=True)
class Integral:
    """An output whose integral is weighted by 1 / `allowed`^2; `allowed` is its largest acceptable value, unit x s."""

    output: str
    allowed: float


@dataclass(frozen=True, eq=False, slots=True)
class _Tracked:
    """Integrand e = rows_y y + rows_u u = E x + F u + (noise), and the prices 1 / allowed of the integrals."""

    names: tuple[str, ...]
    rows_y: FloatArray
    rows_u: FloatArray
    E: FloatArray
    F: FloatArray
    price: FloatArray


def lqi(plant: Plant, integrals: Sequence[Integral], *, name: str = "LQI") -> Synthesis:
    """Linear-quadratic law with integral action; the integrators are states of the controller.

    Minimises the integral of z'z + sum (integral of y_i / allowed_i)^2 (sampled: the sum over the samples). Where all
    states are measured the law is u = -K_x x - K_i xi, otherwise x is the estimate of a steady Kalman filter for white
    noise w (sampled: the predictor). xi' = y_i, sampled xi+ = xi + dt y_i.

    Parameters
    ----------
    integrals : measured outputs; where all states are measured also performance outputs w does not act on directly

    Raises
    ------
    ValueError : no integral, a name that is unknown or doubled, `allowed` not positive

    Examples
    --------
    >>> plant = Plant.from_matrices([[-1.0]], [[1.0]], [[1.0]], [[1.0], [0.0]], D12=[[0.0], [1.0]])
    >>> design = lqi(plant, [Integral("x1", 1.0)])
    >>> design.status.name, design.controller.A.shape
    ('SOLVED', (1, 1))
    """
    tracked = _tracked(plant, integrals)
    stuck = hidden_mode(plant.A.T, plant.B2.T, plant.states, plant.dt)
    if stuck:
        return refused(
            name, [plant], Status.INFEASIBLE, f"the commands {', '.join(plant.commands)} cannot move {stuck}"
        )
    blocked = _blocked(plant, tracked)
    if blocked:
        return refused(name, [plant], Status.INFEASIBLE, blocked)
    try:
        regulator = _regulator(plant, tracked)
        if plant.measures_states:
            law, observer, error = _state_feedback(plant, tracked, regulator, name), None, None
        else:
            law, observer, error = _output_feedback(plant, tracked, regulator, name)
    except ModelError as fault:
        return refused(name, [plant], Status.INFEASIBLE, unsolvable(plant, fault))
    riccati = [one for one in (regulator, observer) if one is not None]
    return proven(
        name, [plant], [law], claims=[decay_claim([plant], [law])],
        performance=[_performance(plant, tracked, regulator, law, error)],
        notes=[f"integral of {', '.join(tracked.names)}"] + [f"Riccati: {s.message}" for s in riccati if s.message],
        status=worse(*(one.status for one in riccati)),
    )  # fmt: skip


def _tracked(plant: Plant, integrals: Sequence[Integral]) -> _Tracked:
    if not integrals:
        raise ValueError("integrals: expected at least one output")
    names = tuple(one.output for one in integrals)
    if len(set(names)) != len(names):
        raise ValueError(f"integrals: an output is named twice in {', '.join(names)}")
    rows_y = np.zeros((len(names), len(plant.measured)))
    rows_u = np.zeros((len(names), len(plant.commands)))
    for i, one in enumerate(integrals):
        if not (np.isfinite(one.allowed) and one.allowed > 0.0):
            raise ValueError(f"integrals: expected a positive acceptable integral of {one.output!r}, got {one.allowed}")
        if one.output in plant.measured:
            rows_y[i, plant.measured.index(one.output)] = 1.0
            continue
        offered = plant.performance if plant.measures_states else ()
        if one.output not in offered or np.any(plant.D11[plant.performance.index(one.output)]):
            raise ValueError(f"integrals: {one.output!r} is not measured; there are {', '.join(plant.measured)}")
        k = plant.performance.index(one.output)
        rows_y[i], rows_u[i] = plant.C1[k], plant.D12[k]
    return _Tracked(
        names, rows_y, rows_u, rows_y @ plant.C2, rows_y @ plant.D22 + rows_u,
        np.array([1.0 / one.allowed for one in integrals]),
    )  # fmt: skip


def _blocked(plant: Plant, tracked: _Tracked) -> str:
    """Why the integrals cannot be steered: outputs that the commands do not change in the steady state."""
    at = "z = 1" if plant.dt is not None else "s = 0"
    for i, output in enumerate(tracked.names):
        if _singular(plant, tracked.E[i : i + 1], tracked.F[i : i + 1]):
            return (
                f"the integral of {output} cannot be steered: the commands {', '.join(plant.commands)} have no steady "
                f"effect on it (a zero at {at}); integrate another output"
            )
    if _singular(plant, tracked.E, tracked.F):
        many = f"{len(tracked.names)} integrals for {len(plant.commands)} command(s)"
        why = many if len(tracked.names) > len(plant.commands) else f"a zero at {at}"
        return (
            f"the integrals of {', '.join(tracked.names)} cannot be steered together: the commands have no independent "
            f"steady effects on them ({why}); integrate fewer outputs"
        )
    return ""


def _singular(plant: Plant, E: FloatArray, F: FloatArray) -> bool:
    shift = np.eye(len(plant.states)) if plant.dt is not None else 0.0
    joined = np.block([[plant.A - shift, plant.B2], [E, F]])
    for _ in range(4):  # unit rows and columns, so that units do not matter
        for axis in (0, 1):
            length = np.linalg.norm(joined, axis=axis, keepdims=True)
            joined = joined / np.where(length > 0.0, length, 1.0)
    if joined.shape[0] > joined.shape[1]:
        return True
    return bool(np.linalg.svd(joined, compute_uv=False)[-1] <= SINGULAR)


def _regulator(plant: Plant, tracked: _Tracked) -> RiccatiSolution:
    n, q = len(plant.states), len(tracked.names)
    step = plant.dt if plant.dt is not None else 1.0
    kept = np.eye(q) if plant.dt is not None else np.zeros((q, q))
    A = np.block([[plant.A, np.zeros((n, q))], [step * tracked.E, kept]])
    B = np.vstack([plant.B2, step * tracked.F])
    Q_x, R, N_x = quadratic(plant)
    Q = np.zeros((n + q, n + q))
    Q[:n, :n], Q[n:, n:] = Q_x, np.diag(tracked.price**2)
    N = np.vstack([N_x, np.zeros((q, N_x.shape[1]))])
    if plant.dt is not None:
        return lqr_discrete(A, B, Q, R, N)
    if np.linalg.matrix_rank(R) < R.shape[0]:
        raise ModelError("a command without a price: give every command a weight in the performance outputs")
    return riccati_continuous(A, B, Q, R, N).require()


def _state_feedback(plant: Plant, tracked: _Tracked, regulator: RiccatiSolution, name: str) -> Controller:
    n = len(plant.states)
    K_x, K_i = regulator.gain[:, :n], regulator.gain[:, n:]
    A, B = -tracked.rows_u @ K_i, tracked.rows_y - tracked.rows_u @ K_x
    if plant.dt is not None:
        A, B = np.eye(len(A)) + plant.dt * A, plant.dt * B
    return Controller.from_matrices(
        A, B, -K_i, -K_x, measured=plant.measured, commands=plant.commands, name=name, dt=plant.dt
    )


def _output_feedback(
    plant: Plant, tracked: _Tracked, regulator: RiccatiSolution, name: str
) -> tuple[Controller, RiccatiSolution, FloatArray]:
    """States: the estimate, then the integrals; u = -K_x x^ - K_i xi."""
    n, q = len(plant.states), len(tracked.names)
    process, measurement, cross = plant.B1 @ plant.B1.T, plant.D21 @ plant.D21.T, plant.B1 @ plant.D21.T
    if plant.dt is None:
        if np.any(plant.D11):
            raise ModelError("white noise acts on the performance outputs directly: their variance is infinite")
        if np.linalg.matrix_rank(measurement) < len(plant.measured):
            raise ModelError("a measurement without noise: give every measurement a disturbance of its own")
        found = kalman(plant.A, plant.C2, process, measurement, cross)
        L, riccati, error = found.gain, found.riccati, found.covariance
    else:
        predictor = kalman_discrete(plant.A, plant.C2, process, measurement, cross)
        L, riccati, error = predictor.gain, predictor.riccati, predictor.covariance
    C = -regulator.gain
    estimate = np.hstack([plant.A - L @ plant.C2, np.zeros((n, q))]) + (plant.B2 - L @ plant.D22) @ C
    integrator = tracked.rows_u @ C
    B = tracked.rows_y
    if plant.dt is not None:
        integrator, B = plant.dt * integrator, plant.dt * B
        integrator[:, n:] += np.eye(q)
    law = Controller.from_matrices(
        np.vstack([estimate, integrator]), np.vstack([L, B]), C, np.zeros((len(plant.commands), len(plant.measured))),
        measured=plant.measured, commands=plant.commands, name=name, dt=plant.dt,
    )  # fmt: skip
    return law, riccati, error


def _performance(
    plant: Plant, tracked: _Tracked, regulator: RiccatiSolution, law: Controller, error: FloatArray | None
) -> Performance:
    """The reported cost, and the same from a Lyapunov equation of the closed loop with its integrators."""
    n, q = len(plant.states), len(tracked.names)
    extra = np.zeros((q, n + len(law.A)))
    extra[:, -q:] = np.diag(tracked.price)
    if error is None:
        found = cost_matrix(plant, law, extra=extra)
        return Performance(COST, float(np.trace(regulator.P)), float(np.trace(found)))
    step = plant.dt if plant.dt is not None else 1.0
    noise = np.vstack([plant.B1, step * tracked.rows_y @ plant.D21])
    price = plant.D12.T @ plant.D12
    if plant.dt is not None:
        B = np.vstack([plant.B2, step * tracked.F])
        price = price + B.T @ regulator.P @ B
    K_x = regulator.gain[:, :n]
    reported = np.trace(noise.T @ regulator.P @ noise) + np.trace(price @ K_x @ error @ K_x.T) + np.sum(plant.D11**2)
    return Performance(NORM, float(reported), mean_square(plant, law, extra=extra))
