"""The central H-infinity output feedback for any D: normal form, two games and their coupling, controller formula.

Glover & Doyle, Systems & Control Letters 11 (1988) 167; Zhou, Doyle & Glover, Robust and Optimal Control (1996),
chapter 17.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.linalg import LinAlgError

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.synthesis.h_infinity_game import Channel, Game, solve_game
from maglev_ctrl.synthesis.h_infinity_search import Trial
from maglev_ctrl.systems.plant import Plant

Realisation = tuple[FloatArray, FloatArray, FloatArray, FloatArray]


@dataclass(frozen=True, eq=False, slots=True)
class NormalForm:
    """The plant in units where D12 = [0; I] and D21 = [0, I]; command = `command` u~, y~ = `measurement` y.

    Rotations of w and z change no gain. D22 is left out; `restore` puts it back.
    """

    A: FloatArray
    B1: FloatArray
    B2: FloatArray
    C1: FloatArray
    C2: FloatArray
    D11: FloatArray
    command: FloatArray
    measurement: FloatArray
    D22: FloatArray

    @property
    def counts(self) -> tuple[int, int, int, int]:
        """Numbers of disturbances, commands, performance signals and measurements."""
        return self.B1.shape[1], self.B2.shape[1], self.C1.shape[0], self.C2.shape[0]

    @property
    def control(self) -> Channel:
        """The game of a command that knows state and disturbance."""
        _, m2, p1, _ = self.counts
        D12 = np.vstack([np.zeros((p1 - m2, m2)), np.eye(m2)])
        return Channel(self.A, self.B1, self.B2, self.C1, self.D11, D12, sees_disturbance=True)

    @property
    def estimation(self) -> Channel:
        """The transposed game, of the estimator."""
        m1, _, _, p2 = self.counts
        D21 = np.hstack([np.zeros((p2, m1 - p2)), np.eye(p2)])
        return Channel(self.A.T, self.C1.T, self.C2.T, self.B1.T, self.D11.T, D21.T, sees_disturbance=True)


@dataclass(frozen=True, eq=False, slots=True)
class Coupled:
    """Both games at one gamma, and the coupling rho(X Y) < gamma^2 as the share 1 - rho / gamma^2."""

    control: Game
    estimation: Game
    coupling: float

    @property
    def solvable(self) -> bool:
        """All three conditions hold."""
        return self.control.solvable and self.estimation.solvable and self.coupling > 0.0

    @property
    def trial(self) -> Trial:
        """What the search looks at."""
        measures = {f"control: {name}": value for name, value in game_measures(self.control).items()}
        measures |= {f"estimation: {name}": value for name, value in game_measures(self.estimation).items()}
        if self.control.solvable and self.estimation.solvable:
            measures["coupling of control and estimation"] = self.coupling
        return Trial(self.control.gamma, self.solvable, measures)


def game_measures(game: Game) -> dict[str, float]:
    """Numbers that fall through zero where the game stops being solvable."""
    if not game.lagrangian:
        return {"frequency": game.axis}
    return {"frequency": max(game.axis, 1e-30), "growth of X": game.angle_margin}


def normal_form(plant: Plant) -> NormalForm:
    """Rotate and scale signals; D12 must have full column rank and D21 full row rank.

    Examples
    --------
    >>> plant = Plant.from_matrices([[1.0]], [[1.0, 0.0]], [[1.0]], [[1.0], [0.0]], [[1.0]],
    ...                             D12=[[0.0], [2.0]], D21=[[0.0, 4.0]])
    >>> form = normal_form(plant)
    >>> abs(float(form.command[0, 0])), abs(float(form.measurement[0, 0]))
    (0.5, 0.25)
    """
    m2, p2 = plant.B2.shape[1], plant.C2.shape[0]
    unit = np.linalg.norm(plant.D12, axis=0)  # units first, or the rotation would lose the small ones
    left, size, right = np.linalg.svd(plant.D12 / unit)
    Z = np.hstack([left[:, m2:], left[:, :m2]])  # columns: uncommanded first
    command = right.T / size / unit[:, None]
    unit = np.linalg.norm(plant.D21, axis=1)
    left, size, right = np.linalg.svd(plant.D21 / unit[:, None])
    W = np.hstack([right[p2:].T, right[:p2].T])
    measurement = left.T / size[:, None] / unit
    return NormalForm(
        plant.A, plant.B1 @ W, plant.B2 @ command, Z.T @ plant.C1, measurement @ plant.C2, Z.T @ plant.D11 @ W,
        command, measurement, plant.D22,
    )  # fmt: skip


def couple(form: NormalForm, gamma: float, *, refine: bool = False) -> Coupled:
    """Solve both games at one gamma."""
    control = solve_game(form.control, gamma, refine=refine)
    if not control.solvable:
        return Coupled(control, Game(gamma, False, False, -np.pi, -1.0), -1.0)
    estimation = solve_game(form.estimation, gamma, refine=refine)
    if not estimation.solvable or control.X is None or estimation.X is None:
        return Coupled(control, estimation, -1.0)
    rho = float(np.max(np.linalg.eigvals(control.X @ estimation.X).real, initial=0.0))
    return Coupled(control, estimation, 1.0 - rho / gamma**2)


def central_controller(form: NormalForm, pair: Coupled) -> Realisation | None:
    """Realisation of u = K y with D22 put back; None where an algebraic loop or the formula breaks down."""
    if not pair.solvable or pair.control.gain is None or pair.estimation.gain is None:
        return None
    X, Y = pair.control.X, pair.estimation.X
    if X is None or Y is None:
        return None
    m1, m2, p1, p2 = form.counts
    gamma = pair.control.gamma
    free_w, free_z = m1 - p2, p1 - m2
    F1, F2 = pair.control.gain[:m1], pair.control.gain[m1:]
    L1, L2 = pair.estimation.gain[:p1].T, pair.estimation.gain[p1:].T
    F12, L12 = F1[free_w:], L1[:, free_z:]
    D1111, D1112 = form.D11[:free_z, :free_w], form.D11[:free_z, free_w:]
    D1121, D1122 = form.D11[free_z:, :free_w], form.D11[free_z:, free_w:]
    try:
        inner = np.linalg.inv(gamma**2 * np.eye(free_z) - D1111 @ D1111.T)
        other = np.linalg.inv(gamma**2 * np.eye(free_w) - D1111.T @ D1111)
        D11k = -D1121 @ D1111.T @ inner @ D1112 - D1122
        D12k = np.linalg.cholesky(np.eye(m2) - D1121 @ other @ D1121.T)
        D21k = np.linalg.cholesky(np.eye(p2) - D1112.T @ inner @ D1112).T
        Z = np.linalg.inv(np.eye(len(form.A)) - Y @ X / gamma**2)
        B2k = Z @ (form.B2 + L12) @ D12k
        C2k = -D21k @ (form.C2 + F12)
        B1k = -Z @ L2 + B2k @ np.linalg.solve(D12k, D11k)
        C1k = F2 + D11k @ np.linalg.solve(D21k, C2k)
        A_k = form.A + form.B1 @ F1 + form.B2 @ F2 + B1k @ np.linalg.solve(D21k, C2k)
    except LinAlgError:
        return None
    return restore(form, A_k, B1k, C1k, D11k)


def restore(form: NormalForm, A: FloatArray, B: FloatArray, C: FloatArray, D: FloatArray) -> Realisation | None:
    """Back to the plant's D22, u = K (y - D22 u), and to its units; the loop is judged in units of the normal form."""
    D22 = form.measurement @ form.D22 @ form.command
    loop = np.eye(D22.shape[0]) + D22 @ D
    if np.linalg.cond(loop) > 1e10:
        return None
    back = np.linalg.inv(loop)
    A, B, C, D = A - B @ back @ D22 @ C, B @ back, C - D @ back @ D22 @ C, D @ back
    return A, B @ form.measurement, form.command @ C, form.command @ D @ form.measurement
