"""State and constant disturbance from measurements: a steady Kalman filter, so that the law leaves no offset.

    x+ = A x + B u + B_d d,   d+ = d,   y = C x + D u + C_d d

The filter predicts: the command at a sample uses measurements up to the sample before, so that a direct share D of
the command in a measurement (an accelerometer) makes no loop. Offset-free control: Pannocchia & Rawlings, AIChE J.
49 (2003) 426.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import null_space

from maglev_ctrl.arrays import FloatArray, read_only
from maglev_ctrl.errors import ModelError, Status
from maglev_ctrl.synthesis.predictive.problem import PredictiveProblem
from maglev_ctrl.synthesis.riccati_discrete import riccati_discrete
from maglev_ctrl.systems.plant import Plant

RANK = 1e-9


@dataclass(frozen=True, eq=False, slots=True)
class DisturbanceModel:
    """How constant disturbances enter: `B` (n, nd) into the states, `C` (ny, nd) into the measurements; `names`."""

    B: FloatArray
    C: FloatArray
    names: tuple[str, ...]

    @classmethod
    def on_commands(cls, plant: Plant, commands: tuple[str, ...] | None = None) -> DisturbanceModel:
        """Disturbances that add to commands (a constant force), all or named ones.

        Raises
        ------
        ValueError : a command is unknown
        """
        return cls._columns(plant, commands, (plant.commands, plant.B2, plant.D22), "commands")

    @classmethod
    def on_disturbances(cls, plant: Plant, disturbances: tuple[str, ...] | None = None) -> DisturbanceModel:
        """Constant shares of the plant's own disturbances, all or named ones.

        Raises
        ------
        ValueError : a disturbance is unknown
        """
        return cls._columns(plant, disturbances, (plant.disturbances, plant.B1, plant.D21), "disturbances")

    @classmethod
    def on_outputs(cls, plant: Plant, outputs: tuple[str, ...] | None = None) -> DisturbanceModel:
        """Disturbances that add to measurements (a sensor's bias), all or named ones.

        Raises
        ------
        ValueError : an output is unknown
        """
        count = len(plant.measured)
        return cls._columns(
            plant, outputs, (plant.measured, np.zeros((len(plant.states), count)), np.eye(count)), "outputs"
        )

    @classmethod
    def _columns(
        cls,
        plant: Plant,
        names: tuple[str, ...] | None,
        known: tuple[tuple[str, ...], FloatArray, FloatArray],
        what: str,
    ) -> DisturbanceModel:
        chosen = known[0] if names is None else names
        unknown = [name for name in chosen if name not in known[0]]
        if unknown:
            raise ValueError(f"{what}: {unknown[0]!r} is unknown; known: {', '.join(known[0])}")
        pick = [known[0].index(name) for name in chosen]
        return cls(read_only(known[1][:, pick], name="B"), read_only(known[2][:, pick], name="C"), tuple(chosen))


@dataclass(frozen=True, eq=False, slots=True)
class Estimator:
    """Filter of the augmented state (x, d): z+ = A z + B u + gain (y - C z - D u); `poles` of A - gain C."""

    A: FloatArray
    B: FloatArray
    C: FloatArray
    D: FloatArray
    gain: FloatArray
    poles: FloatArray
    model: DisturbanceModel

    def update(self, estimate: FloatArray, measured: FloatArray, command: FloatArray) -> FloatArray:
        """The estimate one sample on."""
        return (
            self.A @ estimate
            + self.B @ command
            + self.gain @ (measured - self.C @ estimate - self.D @ command)
        )  # fmt: skip


@dataclass(frozen=True, eq=False, slots=True)
class Targets:
    """Steady state and command for disturbance d and reference r: (x_s, u_s) = by_disturbance d + by_reference r."""

    states: int
    by_disturbance: FloatArray
    by_reference: FloatArray
    tracked: tuple[str, ...]

    def at(self, disturbance: FloatArray, reference: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Steady state (n,) and command (nu,)."""
        both = self.by_disturbance @ disturbance + self.by_reference @ reference
        return both[: self.states], both[self.states :]


def estimator(
    plant: Plant,
    model: DisturbanceModel,
    *,
    process: ArrayLike | None = None,
    drift: ArrayLike | float = 1.0,
    measurement: ArrayLike | None = None,
) -> Estimator:
    """Steady Kalman filter of states and constant disturbances.

    Parameters
    ----------
    plant : sampled
    process : (n, n) covariance per sample of the noise on the states; B1 B1' when left out
    drift : covariance per sample (nd, nd), or one variance for all, of the random walk that stands for "constant"
    measurement : (ny, ny) covariance of the noise of the sensors; D21 D21' when left out

    Raises
    ------
    ValueError : the plant is continuous, or a covariance does not fit
    ModelError : more disturbances than measurements, or a mode or a disturbance is not seen

    Examples
    --------
    >>> plant = Plant.from_matrices([[0.9]], [[1.0]], [[1.0]], [[1.0]], [[1.0]], dt=0.1)
    >>> found = estimator(plant, DisturbanceModel.on_commands(plant), measurement=[[1.0]])
    >>> bool(np.max(np.abs(found.poles)) < 1.0)
    True
    """
    if plant.dt is None:
        raise ValueError("plant: expected a sampled plant")
    n, n_y, n_d = len(plant.states), len(plant.measured), len(model.names)
    A = np.block([[plant.A, model.B], [np.zeros((n_d, n)), np.eye(n_d)]])
    C = np.hstack([plant.C2, model.C])
    _require_detectable(plant, model)
    W = np.zeros((n + n_d, n + n_d))
    W[:n, :n] = plant.B1 @ plant.B1.T if process is None else read_only(process, name="process", shape=(n, n))
    walk = np.asarray(drift, dtype=float)
    W[n:, n:] = walk * np.eye(n_d) if walk.ndim == 0 else read_only(walk, name="drift", shape=(n_d, n_d))
    noise = plant.D21 @ plant.D21.T if measurement is None else measurement
    V = read_only(noise, name="measurement", shape=(n_y, n_y))
    try:
        np.linalg.cholesky(V)
    except np.linalg.LinAlgError:
        raise ValueError("measurement: expected a positive definite covariance; every sensor has noise") from None
    cross = np.zeros((n + n_d, n_y))
    if process is None and measurement is None:
        cross[:n] = plant.B1 @ plant.D21.T
    solved = riccati_discrete(A.T, C.T, W, V, cross)
    if solved.status not in (Status.SOLVED, Status.ALMOST_SOLVED):
        raise ModelError(f"estimator: {solved.status.value}; {solved.message}")
    gain = solved.gain.T
    poles = np.linalg.eigvals(A - gain @ C)
    return Estimator(
        A=read_only(A, name="A"), B=read_only(np.vstack([plant.B2, np.zeros((n_d, plant.B2.shape[1]))]), name="B"),
        C=read_only(C, name="C"), D=plant.D22, gain=read_only(gain, name="gain"),
        poles=read_only(np.sort(np.abs(poles)), name="poles"), model=model,
    )  # fmt: skip


def targets(problem: PredictiveProblem, model: DisturbanceModel | None, tracked: tuple[str, ...]) -> Targets:
    """Where the plant can rest: (A - I) x_s + B u_s = -B_d d, tracked outputs = r; least u_s'R u_s where free.

    Parameters
    ----------
    model : disturbances; None means there are none
    tracked : measured outputs that have to reach their reference; fewer than commands or as many

    Raises
    ------
    ValueError : a tracked output is not measured
    ModelError : the commands cannot hold the tracked outputs where they are asked to be

    Examples
    --------
    >>> from maglev_ctrl.synthesis.predictive.problem import predictive_problem
    >>> plant = Plant.from_matrices([[0.5]], [[1.0]], [[1.0]], [[1.0]], dt=0.1)
    >>> problem = predictive_problem(plant, horizon=5, Q=[[1.0]], R=[[1.0]])
    >>> rest = targets(problem, DisturbanceModel.on_commands(plant), ("x1",))
    >>> [float(round(v[0], 12)) for v in rest.at(np.array([1.0]), np.array([2.0]))]
    [2.0, 0.0]
    """
    plant = problem.plant
    n, n_u = plant.B2.shape
    unknown = [name for name in tracked if name not in plant.measured]
    if unknown:
        raise ValueError(f"tracked: {unknown[0]!r} is not measured; measured: {', '.join(plant.measured)}")
    if len(tracked) > n_u:
        raise ModelError(f"{len(tracked)} outputs cannot follow {len(tracked)} references with {n_u} commands")
    pick = [plant.measured.index(name) for name in tracked]
    B_d = np.zeros((n, 0)) if model is None else model.B
    C_d = np.zeros((len(plant.measured), 0)) if model is None else model.C
    steady = np.block([[plant.A - np.eye(n), plant.B2], [plant.C2[pick], plant.D22[pick]]])
    sides = np.block([
        [-B_d, np.zeros((n, len(tracked)))], [-C_d[pick], np.eye(len(tracked))]
    ])  # fmt: skip
    row_scale = np.max(np.abs(steady), axis=1, initial=1e-300)
    # commands at their weights' scale, so that "least" has one unit
    scale = np.ones(n + n_u)
    scale[n:] = 1.0 / np.sqrt(np.diag(problem.R))
    scale[:n] = np.max(np.linalg.norm(plant.B2 * scale[n:], axis=1))
    matrix = steady * scale / row_scale[:, None]
    particular = np.linalg.lstsq(matrix, sides / row_scale[:, None], rcond=1e-13)[0]
    rest = matrix @ particular - sides / row_scale[:, None]
    if sides.size and float(np.max(np.abs(rest))) > 1e-8 * float(np.max(np.abs(sides / row_scale[:, None]))):
        what = ", ".join(tracked) if tracked else "the plant"
        raise ModelError(f"no steady command holds {what} against a constant disturbance or at a reference")
    kernel = null_space(matrix, rcond=1e-12)
    if kernel.size:
        cost = np.zeros((n + n_u, n + n_u))
        cost[:n, :n], cost[n:, n:] = 1e-9 * np.eye(n), problem.R * np.outer(scale[n:], scale[n:])
        particular = particular - kernel @ np.linalg.lstsq(
            kernel.T @ cost @ kernel, kernel.T @ cost @ particular, rcond=None
        )[0]  # fmt: skip
    both = particular * scale[:, None]
    n_d = B_d.shape[1]
    return Targets(
        states=n, by_disturbance=read_only(both[:, :n_d], name="by_disturbance"),
        by_reference=read_only(both[:, n_d:], name="by_reference"), tracked=tracked,
    )  # fmt: skip


def _require_detectable(plant: Plant, model: DisturbanceModel) -> None:
    n, n_d, n_y = len(plant.states), len(model.names), len(plant.measured)
    if n_d > n_y:
        raise ModelError(
            f"{n_d} constant disturbances ({', '.join(model.names)}) cannot be told apart by {n_y} measured outputs "
            f"({', '.join(plant.measured)}): give at most {n_y}"
        )
    poles = np.linalg.eigvals(plant.A)
    size = 1.0 + float(np.linalg.norm(plant.C2, 2))
    for pole in poles[np.abs(poles) >= 1.0 - 1e-9]:
        seen = np.linalg.svd(np.vstack([plant.A - pole * np.eye(n), plant.C2]))
        if seen[1][-1] <= RANK * size:
            shape = np.abs(seen[2][-1])
            names = ", ".join(plant.states[i] for i in np.argsort(-shape)[:2] if shape[i] > 0.3 * shape.max())
            raise ModelError(f"the measurements do not see the mode at |z| = {abs(pole):.4g} ({names})")
    scale = np.maximum(np.max(np.abs(np.vstack([model.B, model.C])), axis=0, initial=0.0), 1e-300)
    joint = np.block([[plant.A - np.eye(n), model.B / scale], [plant.C2, model.C / scale]])
    _, values, shapes = np.linalg.svd(joint)
    if n_d and values[-1] <= RANK * max(1.0, values[0]):
        shape = np.abs(shapes[-1][n:])
        name = model.names[int(np.argmax(shape))]
        raise ModelError(
            f"the disturbance {name!r} cannot be told from a steady motion by the measured outputs "
            f"({', '.join(plant.measured)}); put it on an input or measure more"
        )
