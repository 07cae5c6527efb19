"""Closed loops as functions of one gain matrix, and how a change of that matrix enters them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from maglev_ctrl.analysis.loops import state_scales
from maglev_ctrl.arrays import ComplexArray, FloatArray
from maglev_ctrl.systems.plant import Plant


@dataclass(frozen=True, eq=False, slots=True)
class Joined:
    """A plant with `order` free states appended, so that a dynamic law is one gain K = [[D, C], [B, A]]; balanced.

    States are scaled by powers of two, which changes no channel. `dt` as in the plant.
    """

    A: FloatArray
    B1: FloatArray
    B2: FloatArray
    C1: FloatArray
    D11: FloatArray
    D12: FloatArray
    C2: FloatArray
    D21: FloatArray
    D22: FloatArray
    dt: float | None


@dataclass(frozen=True, eq=False, slots=True)
class Closed:
    """Closed loop (A, B, C, D) from w to z, and the matrices through which a change of K enters it.

    dA = E dK F, dB = E dK F_w, dC = E_z dK F, dD = E_z dK F_w
    """

    A: FloatArray
    B: FloatArray
    C: FloatArray
    D: FloatArray
    E: FloatArray
    E_z: FloatArray
    F: FloatArray
    F_w: FloatArray
    dt: float | None

    def gain_gradient(
        self,
        A: FloatArray,
        B: FloatArray | None = None,
        C: FloatArray | None = None,
        D: FloatArray | None = None,
    ) -> FloatArray:
        """Derivatives by the entries of K from those by the entries of the closed-loop matrices."""
        total = self.E.T @ A @ self.F.T
        if B is not None:
            total = total + self.E.T @ B @ self.F_w.T
        if C is not None:
            total = total + self.E_z.T @ C @ self.F.T
        if D is not None:
            total = total + self.E_z.T @ D @ self.F_w.T
        return np.asarray(total)


def join(plant: Plant, order: int) -> Joined:
    """Append the states of a law of this order and balance.

    Examples
    --------
    >>> plant = Plant.from_matrices([[1.0]], [[1.0]], [[1.0]], [[1.0]])
    >>> join(plant, 2).A.shape
    (3, 3)
    """
    scale = state_scales(plant.A, np.hstack([plant.B1, plant.B2]), np.vstack([plant.C1, plant.C2]))
    own, none = np.eye(order), np.zeros((order, order))
    n_w, n_z = plant.B1.shape[1], plant.C1.shape[0]
    return Joined(
        A=_diagonal(plant.A * scale / scale[:, None], none),
        B1=np.vstack([plant.B1 / scale[:, None], np.zeros((order, n_w))]),
        B2=_diagonal(plant.B2 / scale[:, None], own),
        C1=np.hstack([plant.C1 * scale, np.zeros((n_z, order))]),
        D11=plant.D11,
        D12=np.hstack([plant.D12, np.zeros((n_z, order))]),
        C2=_diagonal(plant.C2 * scale, own),
        D21=np.vstack([plant.D21, np.zeros((order, n_w))]),
        D22=_diagonal(plant.D22, none),
        dt=plant.dt,
    )


def close(plant: Joined, K: FloatArray) -> Closed:
    """The closed loop of u = K y.

    Raises
    ------
    numpy.linalg.LinAlgError : the algebraic loop I - D22 K is singular

    Examples
    --------
    >>> plant = Plant.from_matrices([[1.0]], [[1.0]], [[1.0]], [[1.0]])
    >>> close(join(plant, 0), np.array([[-3.0]])).A
    array([[-2.]])
    """
    E, E_z, F, F_w, through = plant.B2, plant.D12, plant.C2, plant.D21, K
    if np.any(plant.D22):
        loop = np.linalg.inv(np.eye(K.shape[1]) - plant.D22 @ K)
        back = np.eye(K.shape[0]) + K @ loop @ plant.D22  # (I - K D22)^-1
        E, E_z, F, F_w, through = E @ back, E_z @ back, loop @ F, loop @ F_w, K @ loop
    fed, fed_w = through @ plant.C2, through @ plant.D21
    return Closed(
        plant.A + plant.B2 @ fed, plant.B1 + plant.B2 @ fed_w,
        plant.C1 + plant.D12 @ fed, plant.D11 + plant.D12 @ fed_w,
        E, E_z, F, F_w, plant.dt,
    )  # fmt: skip


def gain_sizes(plants: tuple[Joined, ...]) -> FloatArray:
    """Size that each entry of K must have to move poles by about the size of the plant's own; (nu, ny).

    From the norms of B2 and C2: a measure of the search's units, right where commands act on the states at once.
    """
    return np.asarray(np.exp(np.mean([_direct_size(plant) for plant in plants], axis=0)))


def felt_sizes(plant: Joined) -> FloatArray:
    """Size that each entry of K must have to be felt at the plant's poles, whatever lies between; (nu, ny).

    K G is about one for the gain G beside the poles: an actuator's lag, whose state has units of its own, counts.
    """
    return np.asarray(np.exp(_size_through(plant)))


def _direct_size(plant: Joined) -> FloatArray:
    poles = np.abs(np.linalg.eigvals(plant.A))
    kept = poles[poles > 1e-3 * np.max(poles, initial=0.0)]
    rate = float(np.mean(np.log(kept))) if kept.size else 0.0
    into, out = np.linalg.norm(plant.B2, axis=0), np.linalg.norm(plant.C2, axis=1)
    into[into == 0.0], out[out == 0.0] = 1.0, 1.0
    return np.asarray(rate - np.log(into)[:, None] - np.log(out)[None, :])


def _size_through(plant: Joined) -> FloatArray:
    gain = np.max(np.abs(_response(plant, _beside_poles(plant))), axis=0)
    into, out = np.linalg.norm(gain, axis=0), np.linalg.norm(gain, axis=1)
    total = max(float(np.linalg.norm(gain)), 1e-300)
    into[into == 0.0], out[out == 0.0] = total, total
    return np.asarray(np.log(total) - np.log(into)[:, None] - np.log(out)[None, :])


def _beside_poles(plant: Joined) -> ComplexArray:
    """Points at the poles' frequencies, on the stable side of no pole: off the axis, or outside the circle."""
    poles = np.linalg.eigvals(plant.A)
    if plant.dt is not None:
        return np.asarray(1.3 * np.exp(1j * np.angle(poles))) if poles.size else np.array([1.3 + 0j])
    moduli = np.abs(poles)
    kept = moduli[moduli > 1e-3 * np.max(moduli, initial=0.0)]
    reach = max(float(np.max(poles.real, initial=0.0)), 0.0)
    return np.asarray(reach + (0.3 + 1.0j) * (kept if kept.size else np.ones(1)))


def _response(plant: Joined, points: ComplexArray) -> ComplexArray:
    """C2 (s - A)^-1 B2 + D22 at points of the complex plane; (k, ny, nu)."""
    pencil = points[:, None, None] * np.eye(plant.A.shape[0]) - plant.A
    return np.asarray(plant.C2 @ np.linalg.solve(pencil, plant.B2 + 0j) + plant.D22)


def _diagonal(first: FloatArray, second: FloatArray) -> FloatArray:
    joined = np.zeros((first.shape[0] + second.shape[0], first.shape[1] + second.shape[1]))
    joined[: first.shape[0], : first.shape[1]] = first
    joined[first.shape[0] :, first.shape[1] :] = second
    return joined
