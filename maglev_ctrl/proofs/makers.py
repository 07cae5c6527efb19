"""Certificate matrices of a finished loop, for syntheses that make none: Lyapunov and bounded-real, kept strict.

Nothing made here is trusted: a claim is made with ordinary rounding and proved elsewhere.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np
import scipy.linalg

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.errors import ModelError
from maglev_ctrl.kernels.stable_subspace import stabilising_solution
from maglev_ctrl.proofs.claims import DecayClaim, EnergyClaim, GainClaim
from maglev_ctrl.proofs.prove import UNDECIDED, prove
from maglev_ctrl.systems import Controller
from maglev_ctrl.systems.plant import Plant, closed_channel

_STEPS = (0.3, 1e-2, 1e-4, 1e-6, 1e-8, 1e-10)
"""Shares of the room below a bound that are spent on strictness, tried from the largest."""
_NOISE = 1e-20
"""A Gramian's diagonal entry below this share of the largest is rounding: the state is not reached, or not seen."""


def lyapunov_claim(plants: Sequence[Plant], controllers: Sequence[Controller], *, rate: float = 0.0) -> DecayClaim:
    """Decay of every loop at `rate` (1/s) with a matrix of its own; one law may serve all plants.

    Raises
    ------
    ModelError : a loop does not decay that fast; the pole is named
    ValueError : names, sampling periods or numbers of plants and laws do not fit

    Examples
    --------
    >>> plant = Plant.from_matrices([[1.0]], [[1.0]], [[1.0]], [[1.0]])
    >>> law = Controller.static([[-3.0]], measured=("x1",), commands=("u1",))
    >>> lyapunov_claim([plant], [law], rate=1.0).P
    array([[[0.5]]])
    """
    if len(controllers) not in (1, len(plants)):
        raise ValueError(f"controllers: expected 1 or {len(plants)}, got {len(controllers)}")
    laws = list(range(len(controllers))) if len(controllers) > 1 else [0] * len(plants)
    found = [_decay_matrix(plant, controllers[j], rate) for plant, j in zip(plants, laws, strict=True)]
    return DecayClaim(tuple(range(len(plants))), tuple(laws), rate, np.stack(found))


def energy_claim(
    plant: Plant,
    controller: Controller,
    level: float,
    *,
    disturbances: tuple[str, ...] = (),
    performance: tuple[str, ...] = (),
    index: int = 0,
    law: int = 0,
) -> EnergyClaim:
    """H2 norm of one closed loop below `level`, which has to be above the norm by 1e-7 of it or more.

    P solves A'P + P A + C'C + e Q = 0 with the largest e that leaves the trace below level^2.

    Parameters
    ----------
    index, law : of plant and controller in the design

    Raises
    ------
    ModelError : the loop is not stable, passes disturbances straight through, or has a norm that is not below `level`

    Examples
    --------
    >>> plant = Plant.from_matrices([[-1.0]], [[1.0]], [[1.0]], [[1.0]])
    >>> law = Controller.static([[0.0]], measured=("x1",), commands=("u1",))
    >>> energy_claim(plant, law, 0.7072).P.round(3)
    array([[[0.5]]])
    """
    A, B, C, D = _channel(plant, controller, disturbances, performance)
    _require_decay(A, 0.0, plant)
    if plant.dt is None and np.any(D):
        raise ModelError(f"{plant.name}: disturbances pass straight through, the H2 norm is infinite")
    through = float(np.sum(D**2))
    basis = _balance(A)
    A_b, B_b, C_b = A / basis[:, None] * basis, B / basis[:, None], C * basis
    observed = _gramian(A_b, C_b.T @ C_b, plant.dt)
    norm = float(np.sqrt(max(np.sum(B_b * (observed @ B_b)) + through, 0.0)))
    room = level**2 - norm**2
    if not room > 0.0:
        raise ModelError(f"{plant.name}: the H2 norm is {norm:.10g}, not below {level:.10g}")

    def tries() -> Iterator[FloatArray]:
        for spare, _ in _strict_parts(A_b, plant.dt):
            cost = float(np.sum(B_b * (spare @ B_b)))
            for share in (0.5, 0.9, 0.1):
                yield observed + (share * room / cost if cost > 0.0 else 1.0) * spare

    def made(P: FloatArray) -> EnergyClaim:
        return EnergyClaim((index,), (law,), level, P[None], disturbances, performance)

    return made(_first_proved(tries(), basis, made, plant, controller))


def bounded_real_claim(
    plant: Plant,
    controller: Controller,
    gamma: float,
    *,
    disturbances: tuple[str, ...] = (),
    performance: tuple[str, ...] = (),
    index: int = 0,
    law: int = 0,
) -> GainClaim:
    """Peak gain of one closed loop below `gamma`, which has to be above the norm by about 1e-6 of it or more.

    P is the stabilising solution of the bounded-real Riccati equation with C'C + e Q in place of C'C, so that the
    inequality is strict; the largest e with a solution is taken (Zhou, Doyle & Glover 1996, corollary 13.24).

    Parameters
    ----------
    index, law : of plant and controller in the design

    Raises
    ------
    ModelError : the loop is not stable, or no matrix was found: `gamma` is not above the peak gain, or too close

    Examples
    --------
    >>> plant = Plant.from_matrices([[-1.0]], [[1.0]], [[1.0]], [[1.0]])
    >>> law = Controller.static([[0.0]], measured=("x1",), commands=("u1",))
    >>> bounded_real_claim(plant, law, 1.001).gamma
    1.001
    """
    A, B, C, D = _channel(plant, controller, disturbances, performance)
    _require_decay(A, 0.0, plant)
    if not gamma > 0.0 or (D.size and np.linalg.norm(D, 2) >= gamma):
        raise ModelError(f"{plant.name}: the peak gain is not below {gamma:.10g}")
    basis = _balance(A)
    root = np.sqrt(gamma)
    A_b, B_b, C_b = A / basis[:, None] * basis, B / basis[:, None] / root, C * basis / root
    second = _even(A_b, B_b, C_b, plant.dt)
    basis = basis * second
    A_b, B_b, C_b = A_b / second[:, None] * second, B_b / second[:, None], C_b * second
    D_b = D / gamma

    def tries() -> Iterator[FloatArray]:
        for part, weight in _strict_parts(A_b, plant.dt):
            cost = float(np.sum(B_b * (part @ B_b)))
            for share in _STEPS:
                size = share / cost if cost > 0.0 else share
                found = _bounded_real(A_b, B_b, C_b.T @ C_b + size * weight, C_b.T @ D_b, D_b, plant.dt)
                if found is not None:
                    yield found

    def made(P: FloatArray) -> GainClaim:
        return GainClaim((index,), (law,), gamma, P[None], disturbances, performance)

    return made(_first_proved(tries(), basis, made, plant, controller))


def _decay_matrix(plant: Plant, controller: Controller, rate: float) -> FloatArray:
    A = closed_channel(plant, controller)[0]
    _require_decay(A, rate, plant)
    moved = A + rate * np.eye(len(A)) if plant.dt is None else A * np.exp(rate * plant.dt)
    basis = _balance(moved)

    def made(P: FloatArray) -> DecayClaim:
        return DecayClaim((0,), (0,), rate, P[None])

    tries = (P for P, _ in _strict_parts(moved / basis[:, None] * basis, plant.dt))
    return _first_proved(tries, basis, made, plant, controller)


def _channel(
    plant: Plant, controller: Controller, disturbances: tuple[str, ...], performance: tuple[str, ...]
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    A, B, C, D = closed_channel(plant, controller)
    columns = [plant.disturbances.index(name) for name in disturbances or plant.disturbances]
    rows = [plant.performance.index(name) for name in performance or plant.performance]
    return A, B[:, columns], C[rows], D[np.ix_(rows, columns)]


def _require_decay(A: FloatArray, rate: float, plant: Plant) -> None:
    poles = np.linalg.eigvals(A)
    if not len(poles):
        return
    if plant.dt is None:
        slowest = poles[np.argmax(poles.real)]
        slow, unit = slowest.real >= -rate, "1/s"
    else:
        slowest = poles[np.argmax(np.abs(poles))]
        slow, unit = abs(slowest) >= np.exp(-rate * plant.dt), "in the z plane"
    if slow:
        raise ModelError(
            f"{plant.name}: the pole {slowest:.6g} {unit} of the closed loop does not decay at {rate:.6g} 1/s"
        )


def _balance(A: FloatArray) -> FloatArray:
    """Powers of two t such that diag(1/t) A diag(t) has rows and columns of like size."""
    if not len(A):
        return np.ones(0)
    scale = scipy.linalg.matrix_balance(A, permute=False, separate=True)[1][0]
    return np.asarray(np.exp2(np.round(np.log2(scale))), dtype=float)


def _gramian(A: FloatArray, Q: FloatArray, dt: float | None) -> FloatArray:
    """P of A'P + P A + Q = 0, or of A'P A - P + Q = 0 by Smith's doubling, for a stable A."""
    if dt is None:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            P = np.asarray(scipy.linalg.solve_continuous_lyapunov(A.T, -Q), dtype=float)
        return np.asarray(0.5 * (P + P.T))
    P, power = Q, A
    with np.errstate(all="ignore"):
        for _ in range(64):
            step = power.T @ P @ power
            P = P + 0.5 * (step + step.T)
            power = power @ power
            if not np.max(np.abs(step), initial=0.0) > 1e-17 * np.max(np.abs(P), initial=0.0):
                break
    return P


def _strict_parts(A: FloatArray, dt: float | None) -> Iterator[tuple[FloatArray, FloatArray]]:
    """(P, Q) > 0 with A'P + P A + Q = 0 (P - A'P A = Q): for Q = I, then for Q = I + a share of P, widely spread."""
    eye = np.eye(len(A))
    yield _gramian(A, eye, dt), eye
    poles = np.linalg.eigvals(A)
    for share in (0.5, 0.9):
        if dt is None:
            slower = -share * float(np.max(poles.real))
            P = _gramian(A + slower * eye, eye, dt)
            yield P, eye + 2.0 * slower * P
        else:
            larger = float(np.max(np.abs(poles), initial=1e-8)) ** share
            P = _gramian(A / larger, eye, dt)
            yield P, larger**2 * eye + (1.0 - larger**2) * P


def _even(A: FloatArray, B: FloatArray, C: FloatArray, dt: float | None) -> FloatArray:
    """Powers of two that make every state reached and observed alike; one for states where either is but rounding."""
    reached, observed = np.diag(_gramian(A.T, B @ B.T, dt)), np.diag(_gramian(A, C.T @ C, dt))
    told = (reached > _NOISE * np.max(reached, initial=0.0)) & (observed > _NOISE * np.max(observed, initial=0.0))
    with np.errstate(all="ignore"):
        ratio = np.where(told, reached / observed, 1.0)
    return np.asarray(np.exp2(np.round(0.25 * np.log2(ratio))))


def _bounded_real(
    A: FloatArray, B: FloatArray, Q: FloatArray, S: FloatArray, D: FloatArray, dt: float | None
) -> FloatArray | None:
    """Stabilising solution of the bounded-real Riccati equation for the bound one; None where there is none."""
    if B.shape[1] == 0:
        return _gramian(A, Q, dt)
    R = D.T @ D - np.eye(B.shape[1])
    if dt is None:
        solved = np.linalg.solve(R, np.hstack([S.T, B.T]))
        cross, into = solved[:, : len(A)], solved[:, len(A) :]
        rest = Q - S @ cross
        G = B @ into
        return stabilising_solution(A - B @ cross, 0.5 * (G + G.T), 0.5 * (rest + rest.T))
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            P = np.asarray(scipy.linalg.solve_discrete_are(A, B, Q, R, s=S), dtype=float)
    except (np.linalg.LinAlgError, ValueError):
        return None
    return 0.5 * (P + P.T) if np.isfinite(P).all() else None


def _first_proved(
    tries: Iterator[FloatArray],
    basis: FloatArray,
    made: Callable[[FloatArray], DecayClaim | GainClaim | EnergyClaim],
    plant: Plant,
    controller: Controller,
) -> FloatArray:
    """First matrix whose claim is proved, with rounding bounds if possible; back from balanced coordinates.

    Raises
    ------
    ModelError : there is none
    """
    kept = []
    for found in tries:
        P = found / basis[:, None] / basis
        proof = prove(replace(made(P), plants=(0,), controllers=(0,)), [plant], [controller], exactly=False)
        if proof.holds:
            return P
        if proof.reason == UNDECIDED:
            kept.append(P)
    for P in kept[:3]:
        if prove(replace(made(P), plants=(0,), controllers=(0,)), [plant], [controller]).holds:
            return P
    raise ModelError(
        f"{plant.name}: no certificate matrix was found that rounding errors leave alone: the bound is not above "
        "the norm, or too close to it"
    )
