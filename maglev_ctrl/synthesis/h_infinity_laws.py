"""State feedback and output feedback as functions of gamma: what is solvable, and the law that comes with it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.linalg import LinAlgError

from maglev_ctrl.analysis.hamiltonian import balanced_realisation, continuous_equivalent, peak_gain
from maglev_ctrl.analysis.loops import state_scales
from maglev_ctrl.arrays import FloatArray, read_only
from maglev_ctrl.synthesis.h_infinity_central import (
    NormalForm,
    Realisation,
    central_controller,
    couple,
    game_measures,
    normal_form,
)
from maglev_ctrl.synthesis.h_infinity_game import Channel, Game, solve_game, weight_matrix
from maglev_ctrl.synthesis.h_infinity_search import Trial
from maglev_ctrl.systems import Controller
from maglev_ctrl.systems.plant import Plant


class Problem(Protocol):
    """A family of laws over gamma."""

    @property
    def floor(self) -> float:
        """No gamma at or below it is reached."""

    @property
    def scale(self) -> float:
        """A gain typical of the plant."""

    def trial(self, gamma: float) -> Trial:
        """Whether a law reaches gamma."""

    def law(self, gamma: float) -> Controller | None:
        """The law of one gamma."""


@dataclass(frozen=True, eq=False, slots=True)
class StateProblem:
    """Static feedback of the states; the disturbance is not known to the law.

    A sampled plant is looked at as a continuous one with the same gains (bilinear transformation), where the game has
    the same X; that the law does not know w is a further condition there, gamma^2 > |D11'D11 + B1'X B1|.
    """

    plant: Plant
    channel: Channel
    units: FloatArray

    @property
    def floor(self) -> float:
        """Gain of what feedback of states cannot cancel at high frequency."""
        return self.channel.floor

    @property
    def scale(self) -> float:
        """A gain typical of the plant."""
        return gain_scale(self.plant)

    def trial(self, gamma: float) -> Trial:
        """Whether a static law reaches gamma."""
        game = solve_game(self.channel, gamma)
        measures = game_measures(game)
        if not game.solvable or self.plant.dt is None or game.X is None:
            return Trial(gamma, game.solvable, measures)
        measures["answer to the disturbance at once"] = self._unanswered(game.X, gamma)
        return Trial(gamma, measures["answer to the disturbance at once"] > 0.0, measures)

    def law(self, gamma: float) -> Controller | None:
        """u = K x of the saddle."""
        game = solve_game(self.channel, gamma, refine=True)
        if game.X is None or not game.solvable:
            return None
        gain = self._gain(game, gamma)
        if gain is None:
            return None
        return Controller.static(
            gain / self.units[:, None],
            measured=self.plant.states,
            commands=self.plant.commands,
            name="h_infinity",
            dt=self.plant.dt,
        )

    def _unanswered(self, X: FloatArray, gamma: float) -> float:
        worst = self.plant.D11.T @ self.plant.D11 + self.plant.B1.T @ X @ self.plant.B1
        return 1.0 - float(np.linalg.norm(worst, 2)) / gamma**2 if worst.size else 1.0

    def _gain(self, game: Game, gamma: float) -> FloatArray | None:
        if game.X is None or game.gain is None:
            return None
        m1 = self.plant.B1.shape[1]
        if self.plant.dt is None:
            return game.gain[m1:]
        if not self._unanswered(game.X, gamma) > 0.0:
            return None
        plant = self.plant
        raw = Channel(plant.A, plant.B1, plant.B2, plant.C1, plant.D11, plant.D12)
        B, D, R = weight_matrix(raw, gamma)
        try:
            both = -np.linalg.solve(R + B.T @ game.X @ B, B.T @ game.X @ plant.A + D.T @ plant.C1)
        except LinAlgError:
            return None
        return np.asarray(both[m1:])


@dataclass(frozen=True, eq=False, slots=True)
class OutputProblem:
    """Dynamic feedback of the measurements; sampled plants by the bilinear transformation, which keeps every gain."""

    plant: Plant
    form: NormalForm

    @property
    def floor(self) -> float:
        """Gain of what the law's feedthrough cannot cancel at high frequency."""
        return max(self.form.control.floor, self.form.estimation.floor)

    @property
    def scale(self) -> float:
        """A gain typical of the plant."""
        return gain_scale(self.plant)

    def trial(self, gamma: float) -> Trial:
        """Whether a law reaches gamma."""
        return couple(self.form, gamma).trial

    def law(self, gamma: float) -> Controller | None:
        """The central law of one gamma."""
        matrices = central_controller(self.form, couple(self.form, gamma, refine=True))
        if matrices is None or not all(np.all(np.isfinite(matrix)) for matrix in matrices):
            return None
        if self.plant.dt is not None:
            try:
                matrices = sampled_equivalent(*matrices, self.plant.dt)
            except LinAlgError:
                return None
        A, B, C = balanced_realisation(*matrices[:3])
        return Controller.from_matrices(
            A,
            B,
            C,
            matrices[3],
            measured=self.plant.measured,
            commands=self.plant.commands,
            name="h_infinity",
            dt=self.plant.dt,
        )


def state_problem(plant: Plant) -> StateProblem:
    """State feedback of a regular plant.

    Raises
    ------
    numpy.linalg.LinAlgError : a sampled plant has a pole at -1 exactly

    Examples
    --------
    >>> plant = Plant.from_matrices([[1.0]], [[1.0]], [[1.0]], [[1.0], [0.0]], D12=[[0.0], [1.0]])
    >>> round(float(state_problem(plant).law(2.0).D[0, 0]), 6)
    -3.097168
    """
    if plant.dt is None:
        plant, units = _in_price_units(plant, plant.D12)
        return StateProblem(plant, Channel(plant.A, plant.B1, plant.B2, plant.C1, plant.D11, plant.D12), units)
    m1 = plant.B1.shape[1]
    B, D = np.hstack([plant.B1, plant.B2]), np.hstack([plant.D11, plant.D12])
    plant, units = _in_price_units(plant, continuous_equivalent(plant.A, B, plant.C1, D, plant.dt or 1.0)[3][:, m1:])
    B, D = np.hstack([plant.B1, plant.B2]), np.hstack([plant.D11, plant.D12])
    A, B, C, D = continuous_equivalent(plant.A, B, plant.C1, D, plant.dt or 1.0)
    channel = Channel(A, B[:, :m1], B[:, m1:], C, D[:, :m1], D[:, m1:], sees_disturbance=True)
    return StateProblem(plant, channel, units)


def _in_price_units(plant: Plant, price: FloatArray) -> tuple[Plant, FloatArray]:
    """The plant with commands in units in which their prices (columns of D12, or of its continuous like) are alike."""
    units = np.linalg.norm(price, axis=0)
    return replace(plant, B2=plant.B2 / units, D12=plant.D12 / units), units


def output_problem(plant: Plant) -> OutputProblem:
    """Output feedback of a regular plant.

    Raises
    ------
    numpy.linalg.LinAlgError : a sampled plant has a pole at -1 exactly
    """
    return OutputProblem(plant, normal_form(continuous_plant(plant)))


def measuring_states(plant: Plant) -> Plant:
    """The plant with its states as measurements, exactly and alone.

    Examples
    --------
    >>> measuring_states(Plant.from_matrices([[1.0]], [[1.0]], [[1.0]], [[1.0]], [[3.0]])).measures_states
    True
    """
    n = len(plant.states)
    return replace(
        plant, C2=read_only(np.eye(n), name="C2"), D21=read_only(np.zeros((n, len(plant.disturbances))), name="D21"),
        D22=read_only(np.zeros((n, len(plant.commands))), name="D22"), measured=plant.states,
    )  # fmt: skip


def continuous_plant(plant: Plant) -> Plant:
    """A sampled plant as the continuous one with the same gains (bilinear); a continuous plant as it is.

    Examples
    --------
    >>> plant = Plant.from_matrices([[0.5]], [[1.0]], [[1.0]], [[1.0]], dt=0.1)
    >>> round(float(continuous_plant(plant).A[0, 0]), 6)  # (2 / dt) (0.5 - 1) / (0.5 + 1)
    -6.666667
    """
    if plant.dt is None:
        return plant
    m1, p1 = plant.B1.shape[1], plant.C1.shape[0]
    A, B, C, D = continuous_equivalent(
        plant.A, np.hstack([plant.B1, plant.B2]), np.vstack([plant.C1, plant.C2]),
        np.block([[plant.D11, plant.D12], [plant.D21, plant.D22]]), plant.dt,
    )  # fmt: skip
    return Plant.from_matrices(
        A, B[:, :m1], B[:, m1:], C[:p1], C[p1:], D11=D[:p1, :m1], D12=D[:p1, m1:], D21=D[p1:, :m1], D22=D[p1:, m1:],
        states=plant.states, disturbances=plant.disturbances, commands=plant.commands, performance=plant.performance,
        measured=plant.measured, name=plant.name,
    )  # fmt: skip


def sampled_equivalent(A: FloatArray, B: FloatArray, C: FloatArray, D: FloatArray, dt: float) -> Realisation:
    """The way back: z = (1 + s dt/2) / (1 - s dt/2).

    Raises
    ------
    numpy.linalg.LinAlgError : a pole lies at 2 / dt, the law would look ahead

    Examples
    --------
    >>> there = continuous_equivalent(*(np.array([[x]]) for x in (0.5, 1.0, 2.0, 3.0)), 0.1)
    >>> [round(float(x[0, 0]), 12) for x in sampled_equivalent(*there, 0.1)]
    [0.5, 1.0, 2.0, 3.0]
    """
    eye = np.eye(len(A))
    E = eye - 0.5 * dt * A
    into = np.linalg.solve(E, B)
    out = np.linalg.solve(E.T, C.T).T
    return 2.0 * np.linalg.inv(E) - eye, np.sqrt(dt) * into, np.sqrt(dt) * out, D + 0.5 * dt * C @ into


def law_gain(controller: Controller) -> float:
    """Largest gain of a law from measurements to commands over all frequencies.

    Examples
    --------
    >>> law_gain(Controller.static([[-3.0, 4.0]], measured=("a", "b"), commands=("u",)))
    5.0
    """
    if not controller.A.size:
        return float(np.linalg.norm(controller.D, 2))
    try:
        return peak_gain(controller.A, controller.B, controller.C, controller.D, dt=controller.dt, tolerance=1e-4).lower
    except LinAlgError:
        return np.inf


def gain_scale(plant: Plant) -> float:
    """|C1| |B1| / |A| in balanced states, and |D11|: the order of gains the plant has."""
    scale = state_scales(plant.A, plant.B1, plant.C1)
    A, B, C = plant.A * scale / scale[:, None], plant.B1 / scale[:, None], plant.C1 * scale
    pace = float(np.linalg.norm(A, 2)) if plant.dt is None else 1.0
    through = float(np.linalg.norm(plant.D11, 2)) if plant.D11.size else 0.0
    size = float(np.linalg.norm(B, 2) * np.linalg.norm(C, 2)) / (pace or 1.0) + through
    return size if size > 0.0 else 1.0
