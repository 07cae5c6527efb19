"""Linear-quadratic designs on sampled plants, each with a decay proof and its cost found a second time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.linalg import eig

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.errors import ModelError, Status
from maglev_ctrl.kernels import scaling
from maglev_ctrl.proofs.candidates import gramian
from maglev_ctrl.proofs.makers import decay_claim
from maglev_ctrl.synthesis.doubling import symmetric
from maglev_ctrl.synthesis.lq_discrete import EstimateForm, lqg_discrete, lqr_discrete
from maglev_ctrl.synthesis.neutral import HIDDEN, hidden_modes
from maglev_ctrl.synthesis.result import Performance, Synthesis, proven, refused
from maglev_ctrl.synthesis.sampling import sampled
from maglev_ctrl.systems import Controller
from maglev_ctrl.systems.plant import Plant, closed_channel

COST = "trace of the cost matrix"
NORM = "mean square of the performance outputs under white noise"


def design_sampled_lqr(plant: Plant, dt: float | None = None, *, name: str = "sampled LQR") -> Synthesis:
    """Sampled state feedback of least sum of z'z (w = 0); all states measured.

    A continuous plant is sampled every `dt` seconds first, and the sum is then the integral of z'z over time, what
    happens between the samples included (`sampled` with performance "integral").

    Raises
    ------
    ValueError : a continuous plant without `dt`, or a sampled one with another `dt`
    ModelError : the states are not measured

    Examples
    --------
    >>> plant = Plant.from_matrices([[1.0]], [[1.0]], [[1.0]], [[1.0], [0.0]], D12=[[0.0], [1.0]])
    >>> design = design_sampled_lqr(plant, 0.1)
    >>> design.status.name, design.controller.dt
    ('SOLVED', 0.1)
    """
    at_samples = _at_samples(plant, dt, disturbances="held")
    if not at_samples.measures_states:
        raise ModelError("a state feedback needs every state measured: use design_sampled_lqg")
    try:
        solution = lqr_discrete(at_samples.A, at_samples.B2, *quadratic(at_samples))
    except ModelError as fault:
        return refused(name, [at_samples], Status.INFEASIBLE, unsolvable(at_samples, fault))
    law = Controller.static(
        -solution.gain, measured=at_samples.measured, commands=at_samples.commands, name=name, dt=at_samples.dt
    )
    cost = Performance(COST, float(np.trace(solution.P)), float(np.trace(cost_matrix(at_samples, law))))
    return proven(
        name, [at_samples], [law], claims=[decay_claim([at_samples], [law])], performance=[cost],
        notes=[f"Riccati equation: {solution.message}"] if solution.message else [], status=solution.status,
    )  # fmt: skip


def design_sampled_lqg(
    plant: Plant, dt: float | None = None, *, form: EstimateForm = "filter", name: str = "sampled LQG"
) -> Synthesis:
    """Sampled output feedback of least mean z'z under white noise w of unit variance (unit intensity if continuous).

    A continuous plant is sampled every `dt` seconds first (`sampled` with "white" and "integral"); the cost then leaves
    out what the noise does within one period, which no law changes.

    Parameters
    ----------
    form : "filter" uses the measurement of the present sample, "predictor" leaves a whole period for computing

    Raises
    ------
    ValueError : a continuous plant without `dt`, or a sampled one with another `dt`
    ModelError : the filter form with noise that drives states and sensors at once

    Examples
    --------
    >>> plant = Plant.from_matrices([[1.0]], [[1.0, 0.0]], [[1.0]], [[1.0], [0.0]], [[1.0]],
    ...                             D12=[[0.0], [1.0]], D21=[[0.0, 0.1]])
    >>> design_sampled_lqg(plant, 0.1).status.name
    'SOLVED'
    """
    model = _at_samples(plant, dt, disturbances="white")
    process, measurement, cross = model.B1 @ model.B1.T, model.D21 @ model.D21.T, model.B1 @ model.D21.T
    if form == "filter" and (np.any(cross) or np.any(model.D11 @ model.D21.T)):
        raise ModelError("one noise drives states and sensors at once: use the predictor form")
    try:
        law = lqg_discrete(
            model.A, model.B2, model.C2, model.D22, weights=quadratic(model), noise=(process, measurement, cross),
            form=form,
        )  # fmt: skip
    except ModelError as fault:
        return refused(name, [model], Status.INFEASIBLE, unsolvable(model, fault))
    controller = Controller.from_matrices(
        law.A, law.B, law.C, law.D, measured=model.measured, commands=model.commands, name=name, dt=model.dt
    )
    X, K = law.regulator.P, law.regulator.gain
    price = model.D12.T @ model.D12 + model.B2.T @ X @ model.B2
    error = law.observer.filter_covariance if form == "filter" else law.observer.covariance
    reported = np.trace(X @ process) + np.trace(model.D11 @ model.D11.T) + np.trace(price @ K @ error @ K.T)
    power = Performance(NORM, float(reported), mean_square(model, controller))
    messages = [s.message for s in (law.regulator, law.observer.riccati) if s.message]
    return proven(
        name, [model], [controller], claims=[decay_claim([model], [controller])], performance=[power],
        notes=[f"Riccati equation: {message}" for message in messages],
        status=worse(law.regulator.status, law.observer.riccati.status),
    )  # fmt: skip


def worse(*status: Status) -> Status:
    """ALMOST_SOLVED as soon as one is.

    Examples
    --------
    >>> worse(Status.SOLVED, Status.ALMOST_SOLVED).name
    'ALMOST_SOLVED'
    """
    return Status.ALMOST_SOLVED if Status.ALMOST_SOLVED in status else Status.SOLVED


def quadratic(plant: Plant) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Q, R, N of z'z = x'Qx + u'Ru + 2 x'Nu."""
    return plant.C1.T @ plant.C1, plant.D12.T @ plant.D12, plant.C1.T @ plant.D12


def cost_matrix(plant: Plant, controller: Controller, *, extra: FloatArray | None = None) -> FloatArray:
    """P of the closed loop: x' P x is the integral (sum) of z'z from x without disturbance, by a Lyapunov equation.

    extra : further cost rows on the closed loop's states
    """
    A, _, C, _ = closed_channel(plant, controller)
    rows = C if extra is None else np.vstack([C, extra])
    return _lyapunov(A.T, rows.T @ rows, plant.dt)


def mean_square(plant: Plant, controller: Controller, *, extra: FloatArray | None = None) -> float:
    """Mean of z'z under white noise w of unit intensity (variance where sampled), by a Lyapunov equation.

    extra : further cost rows on the closed loop's states
    """
    A, B, C, D = closed_channel(plant, controller)
    covariance = _lyapunov(A, B @ B.T, plant.dt)
    rows = C if extra is None else np.vstack([C, extra])
    return float(np.trace(rows @ covariance @ rows.T) + np.sum(D**2))


def unsolvable(plant: Plant, fault: ModelError) -> str:
    """The reason why the Riccati equations of a plant have no solution, with names where one can be found."""
    for rows, A, sentence in (
        (plant.B2.T, plant.A.T, f"the commands {', '.join(plant.commands)} cannot move"),
        (plant.C2, plant.A, f"the measurements {', '.join(plant.measured)} do not see"),
    ):
        label = hidden_mode(A, rows, plant.states, plant.dt)
        if label:
            return f"{sentence} {label}"
    return str(fault)


def hidden_mode(A: FloatArray, rows: FloatArray, states: Sequence[str], dt: float | None) -> str:
    """First mode that is not stable and that `rows` do not see, in words; empty where there is none.

    Examples
    --------
    >>> hidden_mode(np.diag([1.5, 0.5]), np.array([[0.0, 1.0]]), ("drift", "lag"), 0.1)
    'the mode at z = 1.5 (drift)'
    """
    if dt is None:
        found = hidden_modes(A, rows, tuple(states))
        return found[0].label if found else ""
    scale = scaling.balance(A)
    balanced = scaling.rescale(A, scale)
    poles, right = eig(balanced)
    scaled = rows * scale
    lengths = np.linalg.norm(scaled, axis=1)
    unit = scaled[lengths > 0.0] / lengths[lengths > 0.0, None]
    for k, pole in enumerate(poles):
        if abs(pole) < 1.0 - 1e-10 or (unit.size and np.max(np.abs(unit @ right[:, k])) > HIDDEN):
            continue
        share = np.abs(right[:, k])
        names = ", ".join(states[i] for i in np.argsort(-share)[:2] if share[i] > 0.3 * np.max(share))
        number = f"{pole.real:.4g}" if pole.imag == 0.0 else f"{pole.real:.4g} +- {abs(pole.imag):.4g}j"
        return f"the mode at z = {number} ({names})"
    return ""


def _lyapunov(A: FloatArray, W: FloatArray, dt: float | None) -> FloatArray:
    """Solution of A S + S A' + W = 0, or of A S A' - S + W = 0 where sampled; balanced, with one step of refinement.

    Forces of 1e4 N beside displacements of 1e-3 m would otherwise cost most digits.
    """
    scale = scaling.balance(A)
    balanced = scaling.rescale(A, scale)
    a = np.asarray(balanced, dtype=np.float64)
    w = W / np.outer(scale, scale)
    S = gramian(a.T, w, dt)
    if np.all(np.isfinite(S)):  # else the loop is not stable
        rest = a @ S + S @ a.T + w if dt is None else a @ S @ a.T - S + w
        S = S + symmetric(gramian(a.T, symmetric(rest), dt))
    return np.asarray(S * np.outer(scale, scale))


def _at_samples(plant: Plant, dt: float | None, *, disturbances: str) -> Plant:
    if plant.dt is not None:
        if dt is not None and dt != plant.dt:
            raise ValueError(f"dt: the plant is sampled every {plant.dt:g} s, got {dt!r}")
        return plant
    if dt is None:
        raise ValueError("dt: expected a sampling period in s for a continuous plant, got None")
    return sampled(plant, dt, disturbances="white" if disturbances == "white" else "held", performance="integral")
