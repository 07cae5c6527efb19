"""Modes that a design cannot see or cannot move: found, named, and treated in the open or refused."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, cast

import numpy as np
from scipy.linalg import eig

from maglev_ctrl.arrays import ComplexArray, FloatArray
from maglev_ctrl.errors import ModelError
from maglev_ctrl.kernels import scaling
from maglev_ctrl.synthesis.weights import QuadraticWeights

Uncontrollable = Literal["refuse", "leave"]
AXIS = 1e-10
"""A pole left of the axis by less than this share of the size of the state matrix counts as neutral."""
NEUTRAL_RATE = 0.01
"""Rate (rad/s) at which a neutral mode that no weight sees is made to decay, unless told otherwise."""
HIDDEN = 1e-8
"""A direction weaker than this (balanced coordinates, unit vectors) counts as zero."""


@dataclass(frozen=True, eq=False, slots=True)
class HiddenMode:
    """A mode that some rows do not see: its pole, vectors v and w with w^H v = 1, and its strongest states."""

    pole: complex
    right: ComplexArray
    left: ComplexArray
    states: tuple[str, ...]
    simple: bool

    @property
    def label(self) -> str:
        """Pole and strongest states in words."""
        return f"the mode at {_number(self.pole)} rad/s ({', '.join(self.states)})"


@dataclass(frozen=True, eq=False, slots=True)
class Prepared:
    """State matrix and state weight to design with, and what was changed."""

    A: FloatArray
    Q: FloatArray
    notes: tuple[str, ...]


def hidden_modes(A: FloatArray, rows: FloatArray, states: tuple[str, ...]) -> tuple[HiddenMode, ...]:
    """Modes that are not stable and that `rows` (ny, n) do not see, one per conjugate pair.

    Examples
    --------
    >>> A = np.array([[0.0, 0.0], [0.0, -1.0]])
    >>> [mode.states[0] for mode in hidden_modes(A, np.array([[0.0, 1.0]]), ("drift", "lag"))]
    ['drift']
    """
    scale = scaling.balance(A)
    balanced = scaling.rescale(A, scale)
    size = float(np.linalg.norm(balanced, 2)) + 1e-300
    poles, left, right = cast(tuple[ComplexArray, ...], eig(balanced, left=True, right=True))
    scaled = rows * scale
    lengths = np.linalg.norm(scaled, axis=1)
    unit = scaled[lengths > 0.0] / lengths[lengths > 0.0, None]
    found: list[HiddenMode] = []
    for k, pole in enumerate(poles):
        if pole.imag < 0.0 or pole.real < -AXIS * size:
            continue
        if unit.size and float(np.max(np.abs(unit @ right[:, k]))) > HIDDEN:
            continue
        overlap = complex(np.vdot(left[:, k], right[:, k]))
        simple = abs(overlap) > 1e-5
        share = np.abs(right[:, k]) * (np.abs(left[:, k]) if simple else 1.0)
        names = tuple(states[i] for i in np.argsort(-share)[:2] if share[i] > 0.3 * np.max(share))
        dual = left[:, k] / scale / (np.conj(overlap) if simple else 1.0)
        found.append(HiddenMode(complex(pole), right[:, k] * scale, dual, names, simple))
    return tuple(found)


def prepare(
    A: FloatArray,
    B: FloatArray,
    weights: QuadraticWeights,
    *,
    states: tuple[str, ...],
    neutral_rate: float,
    uncontrollable: Uncontrollable,
) -> Prepared:
    """Make the regulator problem solvable without hiding how.

    A mode that no weight sees and that neither decays nor grows faster than `neutral_rate` gets a weight q on its modal
    coordinate, q = (rate^2 - Re(s)^2) / (w^H B R_s^-1 B' w), with R_s the price of a command at the mode's own pole s,
    what it stirs in the weighted outputs included. To first order the pole then decays at `neutral_rate` and nothing
    else moves. A mode no actuator can move is refused,
    or left as it is: the design then treats it as decaying, so that the other modes are controlled, and the note says
    that it stays.

    Raises
    ------
    ModelError : an unseen neutral mode is not simple (free drift), or a mode that is not stable cannot be moved
    """
    notes: list[str] = []
    A_design, Q = np.array(A), np.array(weights.Q)
    for mode in hidden_modes(A.T, B.T, states):
        if uncontrollable == "refuse" or not mode.simple:
            raise ModelError(
                f"the actuators {', '.join(weights.commands)} cannot move {mode.label}: add an actuator, or hold or "
                "leave out this freedom"
            )
        shift = mode.pole.real + max(neutral_rate, abs(mode.pole))
        push = shift * np.outer(np.conj(mode.left), mode.right)  # vectors of A' are conjugate duals of A's
        A_design -= push.real if mode.pole.imag == 0.0 else 2.0 * push.real
        notes.append(f"{mode.label} cannot be moved by the actuators and stays as it is")
    solved = np.linalg.solve(weights.R, weights.N.T)
    seen = np.vstack([weights.rows - weights.through @ solved, solved])
    bare, Q_bare = A_design - B @ solved, weights.Q - weights.N @ solved
    for mode in hidden_modes(bare, seen, states):
        if not mode.simple:
            raise ModelError(f"no weight sees {mode.label}, which drifts freely: weigh its position")
        if mode.pole.real >= neutral_rate:
            notes.append(f"no weight sees {mode.label}, which grows: it is turned to decay at the same rate")
            continue
        weight = (neutral_rate**2 - mode.pole.real**2) / _reach(bare, B, Q_bare, weights.R, mode)
        Q += weight * np.outer(mode.left, np.conj(mode.left)).real * (1.0 if mode.pole.imag == 0.0 else 2.0)
        notes.append(
            f"no weight sees {mode.label}: its modal coordinate is weighted by {weight:.3g} to decay at "
            f"{neutral_rate:g} rad/s"
        )
    return Prepared(A_design, 0.5 * (Q + Q.T), tuple(notes))


def _reach(A: FloatArray, B: FloatArray, Q: FloatArray, R: FloatArray, mode: HiddenMode) -> float:
    """w^H B R_s^-1 B' w; the mode itself, which the weights do not see, is moved away from s first."""
    moved = A - (1.0 + abs(mode.pole)) * np.outer(mode.right, np.conj(mode.left))
    stirred = np.linalg.solve(mode.pole * np.eye(A.shape[0]) - moved, B.astype(complex))
    price = R + np.conj(stirred.T) @ Q @ stirred
    push = B.T @ mode.left
    return float(np.vdot(push, np.linalg.solve(price, push)).real)


def _number(pole: complex) -> str:
    return f"{pole.real:.3g}" if pole.imag == 0.0 else f"{pole.real:.3g} +- {pole.imag:.3g}j"
