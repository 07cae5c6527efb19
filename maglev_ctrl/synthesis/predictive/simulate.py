"""A predictive law in closed loop with its plant, next to the saturated regulator it improves on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from maglev_ctrl.arrays import FloatArray, read_only
from maglev_ctrl.errors import Status
from maglev_ctrl.synthesis.predictive.controller import PredictiveController, SaturatedController
from maglev_ctrl.synthesis.predictive.design import PredictiveDesign
from maglev_ctrl.systems.plant import Plant


@dataclass(frozen=True, eq=False, slots=True)
class PredictiveRun:
    """Trajectories of one closed loop over `steps` samples.

    `x` (steps + 1, n), `u` (steps, nu), `z` (steps, nz), `y` (steps, ny), `estimates` (steps, n + nd); per step the
    `status`, the `path`, the names of `active` limits, and the KKT `residuals` (infinite where the fallback acted);
    `fallback_steps` samples at which the proved law acted; `cost` sum of x'Qx + u'Ru + 2 x'Nu.
    """

    law: str
    dt: float
    x: FloatArray
    u: FloatArray
    z: FloatArray
    y: FloatArray
    estimates: FloatArray
    status: tuple[Status, ...]
    path: tuple[str, ...]
    active: tuple[tuple[str, ...], ...]
    residuals: tuple[float, ...]
    fallback_steps: tuple[int, ...]
    cost: float


def simulate_predictive(
    design: PredictiveDesign,
    x0: ArrayLike,
    *,
    steps: int,
    disturbance: ArrayLike | None = None,
    reference: ArrayLike | None = None,
    plant: Plant | None = None,
    known_start: bool = True,
) -> PredictiveRun:
    """The predictive law in closed loop.

    Parameters
    ----------
    x0 : (n,) first state
    steps : samples
    disturbance : w (steps, nw), or (nw,) held; none when left out
    reference : r (nr,) of the tracked outputs
    plant : the plant as it is, where it differs from the design's
    known_start : the filter starts from `x0`, else from zero

    Raises
    ------
    ValueError : a shape does not fit

    Examples
    --------
    >>> from maglev_ctrl.synthesis.predictive.design import design_predictive
    >>> from maglev_ctrl.synthesis.predictive.problem import predictive_problem
    >>> plant = Plant.from_matrices([[1.1]], [[1.0]], [[1.0]], [[1.0]], dt=0.1)
    >>> problem = predictive_problem(plant, horizon=5, Q=[[1.0]], R=[[1.0]], command_limits=([-1.0], [1.0]))
    >>> run = simulate_predictive(design_predictive(problem), [3.0], steps=30)
    >>> run.u[:2].ravel().tolist(), run.fallback_steps, bool(abs(run.x[-1, 0]) < 1e-9)
    ([-1.0, -1.0], (), True)
    """
    law = PredictiveController(design)
    return _closed(law, "predictive", x0, steps, (disturbance, reference), plant, known_start)


def simulate_saturated(
    design: PredictiveDesign,
    x0: ArrayLike,
    *,
    steps: int,
    disturbance: ArrayLike | None = None,
    reference: ArrayLike | None = None,
    plant: Plant | None = None,
    known_start: bool = True,
) -> PredictiveRun:
    """The regulator with its commands cut at their limits, the same filter and targets: what prediction is worth.

    Parameters
    ----------
    x0, steps, disturbance, reference, plant, known_start : as in `simulate_predictive`

    Raises
    ------
    ValueError : a shape does not fit
    """
    law = SaturatedController(design)
    return _closed(law, "saturated regulator", x0, steps, (disturbance, reference), plant, known_start)


def _closed(
    law: PredictiveController,
    name: str,
    start: ArrayLike,
    steps: int,
    signals: tuple[ArrayLike | None, ArrayLike | None],
    plant: Plant | None,
    known_start: bool,
) -> PredictiveRun:
    """Plant and law, sample by sample; y and z are those of the sample, with the command applied at it."""
    problem = law.design.problem
    true = problem.plant if plant is None else plant
    x0, (n, n_w) = np.asarray(start, dtype=float), true.B1.shape
    if x0.shape != (n,):
        raise ValueError(f"x0: expected {n} numbers, got shape {x0.shape}")
    if true.dt != problem.plant.dt:
        raise ValueError(f"plant: expected the sampling period {problem.plant.dt}, got {true.dt}")
    given = np.zeros(n_w) if signals[0] is None else np.asarray(signals[0], dtype=float)
    if given.shape not in ((n_w,), (steps, n_w)):
        raise ValueError(f"disturbance: expected shape ({steps}, {n_w}) or ({n_w},), got {given.shape}")
    w, filtered = np.broadcast_to(given, (steps, n_w)), law.design.estimator is not None
    estimate = np.zeros(n + law.design.disturbances)
    estimate[:n] = x0 if known_start else 0.0
    law.reset(estimate)
    x, cost = [x0], 0.0
    z, y, records = [], [], []
    for k in range(steps):
        record = law.decide(None if filtered else x[k], signals[1])
        u = record.command
        y.append(true.C2 @ x[k] + true.D21 @ w[k] + true.D22 @ u)
        law.observe(y[k])
        z.append(true.C1 @ x[k] + true.D11 @ w[k] + true.D12 @ u)
        cost += float(x[k] @ problem.Q @ x[k] + u @ problem.R @ u + 2.0 * x[k] @ problem.N @ u)
        x.append(true.A @ x[k] + true.B1 @ w[k] + true.B2 @ u)
        records.append(record)
    return PredictiveRun(
        law=name, dt=float(true.dt or 0.0), x=read_only(np.array(x), name="x"),
        u=read_only(np.array([r.command for r in records]), name="u"), z=read_only(np.array(z), name="z"),
        y=read_only(np.array(y), name="y"),
        estimates=read_only(np.array([r.estimate for r in records]), name="estimates"),
        status=tuple(r.status for r in records), path=tuple(r.path for r in records),
        active=tuple(r.active for r in records), residuals=tuple(r.residual for r in records),
        fallback_steps=tuple(k for k, r in enumerate(records) if r.fallback), cost=cost,
    )  # fmt: skip
