"""What a predictive law has to do: a sampled plant, weights, a horizon and limits."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, cast

import numpy as np
from numpy.typing import ArrayLike

from maglev_ctrl.arrays import FloatArray, read_only
from maglev_ctrl.synthesis.sampling import sampled
from maglev_ctrl.systems.plant import Plant

Terminal = Literal["cost", "set"]


@dataclass(frozen=True, eq=False, slots=True)
class OutputLimit:
    """Bounds of one named performance output, measured output or state (a gap, a stroke).

    A soft limit may be broken by s at the price `linear` s + `quadratic` s^2 per sample; a hard one may not.
    """

    name: str
    lower: float = -np.inf
    upper: float = np.inf
    soft: bool = False
    linear: float = 0.0
    quadratic: float = 0.0


@dataclass(frozen=True, eq=False, slots=True)
class PredictiveProblem:
    """Least sum of x'Q x + u'R u + 2 x'N u over `horizon` samples and a terminal cost, within limits.

    `command_lower`, `command_upper` (nu,), `rate` (nu,) largest change of a command per sample, infinite where there
    is none; `output_rows` (no, n), `output_through` (no, nu) of `output_limits`, from commands; `terminal` "set" asks
    the last state into an invariant set, "cost" only weighs it.
    """

    plant: Plant
    Q: FloatArray
    R: FloatArray
    N: FloatArray
    horizon: int
    command_lower: FloatArray
    command_upper: FloatArray
    rate: FloatArray
    output_limits: tuple[OutputLimit, ...]
    output_rows: FloatArray
    output_through: FloatArray
    terminal: Terminal

    @property
    def limits_commands_only(self) -> bool:
        """Whether the commands' own bounds are all there is: the fast path decides alone."""
        return not self.output_limits and not np.any(np.isfinite(self.rate)) and self.terminal == "cost"


def predictive_problem(
    plant: Plant,
    *,
    horizon: int,
    dt: float | None = None,
    Q: ArrayLike | None = None,
    R: ArrayLike | None = None,
    N: ArrayLike | None = None,
    command_limits: tuple[ArrayLike, ArrayLike] | None = None,
    rate_limits: ArrayLike | None = None,
    output_limits: tuple[OutputLimit, ...] = (),
    terminal: Terminal = "set",
) -> PredictiveProblem:
    """A predictive problem with everything checked; without weights, the sum of squares of the performance outputs.

    Parameters
    ----------
    plant : sampled, or continuous with `dt` in s (sampled by zero-order hold)
    horizon : samples looked ahead
    Q, R, N : (n, n), (nu, nu), (n, nu) weights per sample; give Q and R together or neither
    command_limits : lower and upper bounds (nu,), zero strictly between them
    rate_limits : (nu,) largest change of each command per sample
    output_limits : bounds of named outputs or states, zero strictly between them
    terminal : "set" (recursive feasibility) or "cost"

    Raises
    ------
    ValueError : shapes, names or signs do not fit, or weights are not positive (semi)definite

    Examples
    --------
    >>> plant = Plant.from_matrices([[1.0]], [[1.0]], [[1.0]], [[1.0]], dt=0.1)
    >>> problem = predictive_problem(plant, horizon=5, Q=[[1.0]], R=[[1.0]], command_limits=([-1.0], [1.0]))
    >>> problem.command_upper
    array([1.])
    """
    plant = _sampled(plant, dt)
    n_u = len(plant.commands)
    if isinstance(horizon, bool) or not isinstance(horizon, int) or horizon < 1:
        raise ValueError(f"horizon: expected a positive number of samples, got {horizon!r}")
    if terminal not in ("cost", "set"):
        raise ValueError(f"terminal: expected 'cost' or 'set', got {terminal!r}")
    weights = _weights(plant, Q, R, N)
    lower, upper = (np.full(n_u, -np.inf), np.full(n_u, np.inf)) if command_limits is None else command_limits
    low, high = _limits(lower, "command_limits", n_u), _limits(upper, "command_limits", n_u)
    if not (np.all(low < 0.0) and np.all(high > 0.0)):
        raise ValueError(f"command_limits: expected lower < 0 < upper, got {low} and {high}")
    rate = _limits(np.full(n_u, np.inf) if rate_limits is None else rate_limits, "rate_limits", n_u)
    if not np.all(rate > 0.0):
        raise ValueError(f"rate_limits: expected positive changes per sample, got {rate}")
    for limit in output_limits:
        _check_output(limit)
    if len({limit.name for limit in output_limits}) != len(output_limits):
        raise ValueError("output_limits: expected every name once")
    rows, through = output_matrices(plant, tuple(limit.name for limit in output_limits))
    return PredictiveProblem(
        plant=plant, Q=weights[0], R=weights[1], N=weights[2], horizon=horizon, command_lower=low, command_upper=high,
        rate=rate, output_limits=tuple(output_limits), output_rows=rows, output_through=through, terminal=terminal,
    )  # fmt: skip


def output_matrices(plant: Plant, names: tuple[str, ...]) -> tuple[FloatArray, FloatArray]:
    """Rows (no, n) and direct share of the commands (no, nu) of named performance outputs, measurements or states.

    Raises
    ------
    ValueError : a name is unknown

    Examples
    --------
    >>> plant = Plant.from_matrices([[1.0]], [[1.0]], [[1.0]], [[2.0]], performance=("gap",))
    >>> output_matrices(plant, ("gap", "x1"))[0].ravel().tolist()
    [2.0, 1.0]
    """
    rows, through = [np.zeros((0, len(plant.states)))], [np.zeros((0, len(plant.commands)))]
    for name in names:
        for known, C, D in (
            (plant.performance, plant.C1, plant.D12),
            (plant.measured, plant.C2, plant.D22),
            (plant.states, np.eye(len(plant.states)), np.zeros((len(plant.states), len(plant.commands)))),
        ):
            if name in known:
                i = known.index(name)
                rows.append(C[i : i + 1])
                through.append(D[i : i + 1])
                break
        else:
            known_names = ", ".join(dict.fromkeys((*plant.performance, *plant.measured, *plant.states)))
            raise ValueError(f"output: {name!r} is no output and no state of the plant; known: {known_names}")
    return read_only(np.vstack(rows), name="rows"), read_only(np.vstack(through), name="through")


def _sampled(plant: Plant, dt: float | None) -> Plant:
    if plant.dt is None:
        if dt is None:
            raise ValueError("dt: the plant is continuous; expected a sampling period in s")
        return sampled(plant, dt)
    if dt is not None and dt != plant.dt:
        raise ValueError(f"dt: the plant is sampled every {plant.dt} s, got {dt}")
    return plant


def _weights(
    plant: Plant, Q: ArrayLike | None, R: ArrayLike | None, N: ArrayLike | None
) -> tuple[FloatArray, FloatArray, FloatArray]:
    n, n_u = len(plant.states), len(plant.commands)
    if (Q is None) != (R is None) or (Q is None and N is not None):
        raise ValueError("Q, R: expected both, or neither for the performance outputs")
    if Q is None or R is None:
        C, D = plant.C1, plant.D12
        q, r, cross = C.T @ C, D.T @ D, C.T @ D
    else:
        q, r = read_only(Q, name="Q", shape=(n, n)), read_only(R, name="R", shape=(n_u, n_u))
        cross = read_only(np.zeros((n, n_u)) if N is None else N, name="N", shape=(n, n_u))
    for name, matrix in (("Q", q), ("R", r)):
        if np.linalg.norm(matrix - matrix.T) > 1e-10 * np.linalg.norm(matrix):
            raise ValueError(f"{name}: expected a symmetric matrix")
    try:
        np.linalg.cholesky(r)
    except np.linalg.LinAlgError:
        raise ValueError("R: expected a positive definite matrix; every command needs a weight") from None
    scale = 1.0 / np.sqrt(np.maximum(np.diag(q), np.max(np.diag(q), initial=0.0) * 1e-12 + 1e-300))
    joint = (q - cross @ np.linalg.solve(r, cross.T)) * np.outer(scale, scale)
    if float(np.linalg.eigvalsh(0.5 * (joint + joint.T))[0]) < -1e-9 * max(1.0, float(np.linalg.norm(joint, 2))):
        raise ValueError("Q, N: expected x'Qx + u'Ru + 2 x'Nu never negative (a convex problem)")
    return (
        read_only(0.5 * (q + q.T), name="Q"),
        read_only(0.5 * (r + r.T), name="R"),
        read_only(cross, name="N"),
    )


def _limits(value: ArrayLike, name: str, count: int) -> FloatArray:
    found = np.array(value, dtype=float)
    if found.shape != (count,) or np.any(np.isnan(found)):
        raise ValueError(f"{name}: expected {count} numbers, one for each command, got {value!r}")
    found.flags.writeable = False
    return cast(FloatArray, found)


def _check_output(limit: OutputLimit) -> None:
    if not (limit.lower < 0.0 < limit.upper):
        raise ValueError(f"output_limits: {limit.name!r}: expected lower < 0 < upper, got {limit.lower}, {limit.upper}")
    if limit.soft and not (limit.linear >= 0.0 and limit.quadratic >= 0.0 and limit.linear + limit.quadratic > 0.0):
        raise ValueError(f"output_limits: {limit.name!r} is soft: expected a positive penalty, linear or quadratic")
