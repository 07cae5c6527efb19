"""Claims about a finished closed loop, with their matrices: decay, peak gain, H2 norm, damping sector."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
from scipy.linalg import (
    eig,
    solve_continuous_are,
    solve_continuous_lyapunov,
    solve_discrete_are,
    solve_discrete_lyapunov,
)

from maglev_ctrl.analysis.hamiltonian import h_infinity_norm
from maglev_ctrl.analysis.loops import state_scales
from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.errors import NotStable
from maglev_ctrl.proofs.claims import Claim, DecayClaim, EnergyClaim, GainClaim, RegionClaim
from maglev_ctrl.proofs.prove import prove
from maglev_ctrl.synthesis.structured.energy import lyapunov
from maglev_ctrl.systems import Controller
from maglev_ctrl.systems.plant import Plant, closed_channel

Channel = tuple[FloatArray, FloatArray, FloatArray, FloatArray]


def energy_norm(channel: Channel, dt: float | None) -> float:
    """H2 norm of a stable closed loop, by one Lyapunov equation.

    Examples
    --------
    >>> one = np.ones((1, 1))
    >>> round(energy_norm((-one, one, one, 0.0 * one), None), 9)
    0.707106781
    """
    A, B, C, D = _balanced(channel)[0]
    if dt is None:
        if np.any(D):
            return np.inf
        return float(np.sqrt(np.sum((C @ solve_continuous_lyapunov(A, -B @ B.T)) * C)))
    return float(np.sqrt(np.sum((C @ solve_discrete_lyapunov(A, B @ B.T)) * C) + np.sum(D**2)))


def decay_claim(plants: Sequence[Plant], controller: Controller, rate: float, *, needed: bool = False) -> Claim:
    """Poles of every loop decay: at nearly `rate` (1/s) if provable, else slower; at `rate` if `needed`."""
    shares = (1.0,) if needed else (0.999, 0.99, 0.9, 0.5, 0.1, 0.0)
    return _first(plants, controller, [partial(_decay, plants, controller, share * rate) for share in shares])


def gain_claim(plants: Sequence[Plant], controller: Controller, norm: float, *, level: float | None = None) -> Claim:
    """Peak gain of every loop below a level a little above `norm`, or below the `level` given."""
    levels = [norm * (1.0 + slack) for slack in (1e-4, 1e-3, 1e-2, 5e-2)] if level is None else [level]
    return _first(plants, controller, [partial(_gain, plants, controller, gamma) for gamma in levels])


def energy_claim(plants: Sequence[Plant], controller: Controller, norm: float, *, level: float | None = None) -> Claim:
    """H2 norm of every loop below a level a little above `norm`, or below the `level` given."""
    levels = [norm * (1.0 + slack) for slack in (1e-5, 1e-4, 1e-3, 1e-2)] if level is None else [level]
    return _first(plants, controller, [partial(_energy, plants, controller, top) for top in levels])


def damping_claims(
    plants: Sequence[Plant], controller: Controller, ratio: float, *, needed: bool = False
) -> list[Claim]:
    """Poles of every loop in the sector of a damping ratio; none for sampled loops, whose sector is no such region."""
    if plants[0].dt is not None:
        return []
    shares = (1.0,) if needed else (0.9999, 0.999, 0.99, 0.9, 0.5)
    return [
        _first(plants, controller, [partial(_sector, plants, controller, i, share * ratio) for share in shares])
        for i in range(len(plants))
    ]


def _first(plants: Sequence[Plant], controller: Controller, makers: list[Callable[[], Claim]]) -> Claim:
    """The first claim that holds, else the last."""
    claim = None
    for make in makers:
        made = make()
        claim = made
        if prove(made, plants, [controller]).holds:
            break
    assert claim is not None
    return claim


def _decay(plants: Sequence[Plant], controller: Controller, rate: float) -> Claim:
    matrices = []
    for plant in plants:
        (A, _, _, _), scale = _balanced(closed_channel(plant, controller))
        own = np.eye(A.shape[0])
        with np.errstate(all="ignore"):
            if plant.dt is None:
                P = lyapunov(A + rate * own, own)
            else:
                P = solve_discrete_lyapunov((A * np.exp(rate * plant.dt)).T, own)
        matrices.append(_unscaled(np.asarray(P, dtype=np.float64), scale))
    return DecayClaim(*_indices(plants), rate, np.stack(matrices))


def _gain(plants: Sequence[Plant], controller: Controller, gamma: float) -> Claim:
    """P of the bounded-real Riccati equation with a small extra output, so that the inequality is strict."""
    matrices = []
    for plant in plants:
        (A, B, C, D), scale = _balanced(closed_channel(plant, controller))
        n, n_w = B.shape
        inside = gamma * (1.0 - 1e-6)
        P = np.full((n, n), np.nan)
        extra = float(np.linalg.norm(C, 2)) ** 2 + 1e-300
        for _ in range(18):
            extra *= 0.1
            tall = np.vstack([C, np.sqrt(extra) * np.eye(n)])
            tall_D = np.vstack([D, np.zeros((n, n_w))])
            try:
                if h_infinity_norm(A, B, tall, tall_D, dt=plant.dt, tolerance=1e-7).upper >= inside:
                    continue
                R = D.T @ D - inside**2 * np.eye(n_w)
                solve = solve_continuous_are if plant.dt is None else solve_discrete_are
                P = solve(A, B, tall.T @ tall, R, s=C.T @ D) / gamma
                break
            except (np.linalg.LinAlgError, NotStable, ValueError):
                continue
        matrices.append(_unscaled(np.asarray(P, dtype=np.float64), scale))
    return GainClaim(*_indices(plants), gamma, np.stack(matrices))


def _energy(plants: Sequence[Plant], controller: Controller, level: float) -> Claim:
    matrices = []
    for plant in plants:
        (A, B, C, D), scale = _balanced(closed_channel(plant, controller))
        own = np.eye(A.shape[0])

        def solved(weight: FloatArray, A: FloatArray = A, dt: float | None = plant.dt) -> FloatArray:
            if dt is None:
                return lyapunov(A, weight)
            return np.asarray(solve_discrete_lyapunov(A.T, weight))

        P, S = solved(C.T @ C), solved(own)
        room = level**2 - float(np.sum((P @ B) * B)) - float(np.sum(D**2))
        share = 0.5 * room / max(float(np.sum((S @ B) * B)), 1e-300)
        matrices.append(_unscaled(P + max(share, 0.0) * S, scale))
    return EnergyClaim(*_indices(plants), level, np.stack(matrices))


def _sector(plants: Sequence[Plant], controller: Controller, i: int, ratio: float) -> Claim:
    """X = sum of v v^H over the modes: each mode meets the inequality of the sector by itself."""
    (A, _, _, _), scale = _balanced(closed_channel(plants[i], controller))
    vectors = eig(A)[1]
    X = (vectors @ np.conj(vectors.T)).real * scale[:, None] * scale
    sine = float(np.sqrt(max(1.0 - ratio**2, 0.0)))
    M = np.array([[sine, ratio], [-ratio, sine]])
    return RegionClaim(
        (i,), (0,), f"damping ratio above {ratio:.6g}", np.zeros((2, 2)), M, np.asarray(0.5 * (X + X.T))[None]
    )


def _indices(plants: Sequence[Plant]) -> tuple[tuple[int, ...], tuple[int, ...]]:
    return tuple(range(len(plants))), (0,) * len(plants)


def _balanced(channel: Channel) -> tuple[Channel, FloatArray]:
    A, B, C, D = channel
    scale = state_scales(A, B, C)
    return (A * scale / scale[:, None], B / scale[:, None], C * scale, D), scale


def _unscaled(P: FloatArray, scale: FloatArray) -> FloatArray:
    P = P / scale[:, None] / scale
    return np.asarray(0.5 * (P + P.T))
