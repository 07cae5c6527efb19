"""Claims about finished loops with certificate matrices for them: decay, peak gain, H2 norm; each kept strict.

For every synthesis that brings no matrices of its own. Each claim made here has been proved once, and is proved again
by whoever carries it. Strict inequalities are what can be proved with rounding, so the claims that follow a number
(`decay_claim`, `tightest_claim`) are a little weaker than it; how much is tried from tight to loose.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import TypeVar

import numpy as np

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.errors import ModelError
from maglev_ctrl.proofs.candidates import balance, bounded_real_solution, even_scales, gramian, strict_parts
from maglev_ctrl.proofs.claims import DecayClaim, EnergyClaim, GainClaim
from maglev_ctrl.proofs.prove import UNDECIDED, prove
from maglev_ctrl.systems import Controller
from maglev_ctrl.systems.plant import Plant, closed_channel

C = TypeVar("C", GainClaim, EnergyClaim)
Made = TypeVar("Made", bound=DecayClaim | GainClaim | EnergyClaim)
RATES = (0.98, 0.9, 0.5, 0.1, 0.0)
"""Shares of the slowest pole's rate that are claimed, the first that is proved."""
FASTEST = 20.0
"""Largest claimed decay over one sampling period, in powers of e; dead-beat loops decay faster than any."""
LEVELS = (1e-5, 1e-4, 1e-3, 1e-2, 1e-1)
"""Shares by which a claimed level exceeds the norm, the first that is proved."""
_STEPS = (0.3, 1e-2, 1e-4, 1e-6, 1e-8, 1e-10)
"""Shares of the room below a bound that are spent on strictness, tried from the largest."""


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
    laws = _laws(plants, controllers)
    found = [_decay_matrix(plant, controllers[j], rate) for plant, j in zip(plants, laws, strict=True)]
    return DecayClaim(tuple(range(len(plants))), laws, rate, np.stack(found))


def decay_claim(
    plants: Sequence[Plant], controllers: Sequence[Controller], *, shares: Sequence[float] = RATES
) -> DecayClaim:
    """Decay of every loop at almost the rate of the slowest pole: at the first of `shares` of it that can be proved.

    A sampled loop is not said to decay by more than `FASTEST` powers of e in one period.

    Raises
    ------
    ModelError : a loop is not stable (the pole is named), or nothing could be proved
    ValueError : names, sampling periods or numbers of plants and laws do not fit

    Examples
    --------
    >>> plant = Plant.from_matrices([[1.0]], [[1.0]], [[1.0]], [[1.0]])
    >>> law = Controller.static([[-3.0]], measured=("x1",), commands=("u1",))
    >>> decay_claim([plant], [law]).rate
    1.96
    """
    laws = _laws(plants, controllers)
    slowest = min(
        _decay_rate(closed_channel(plant, controllers[j])[0], plant.dt) for plant, j in zip(plants, laws, strict=True)
    )
    if not slowest > 0.0:
        return lyapunov_claim(plants, controllers)  # which names the pole
    return _first_made([partial(lyapunov_claim, plants, controllers, rate=share * slowest) for share in shares])


def tightest_claim(
    make: Callable[[Plant, Controller, float], C],
    plants: Sequence[Plant],
    controllers: Sequence[Controller],
    norm: float,
    *,
    shares: Sequence[float] = LEVELS,
) -> C:
    """The norms of all loops below a level a little above `norm`: the first share more that can be proved.

    Parameters
    ----------
    make : `bounded_real_claim` or `energy_claim`
    norm : the largest of the loops' norms

    Raises
    ------
    ModelError : none of the levels could be proved, with the reason for the loosest

    Examples
    --------
    >>> plant = Plant.from_matrices([[-1.0]], [[1.0]], [[1.0]], [[1.0]])
    >>> law = Controller.static([[0.0]], measured=("x1",), commands=("u1",))
    >>> round(tightest_claim(bounded_real_claim, [plant], [law], 1.0).gamma, 9)
    1.00001
    """
    return _first_made([partial(joint_claim, make, plants, controllers, (1.0 + share) * norm) for share in shares])


def joint_claim(
    make: Callable[[Plant, Controller, float], C],
    plants: Sequence[Plant],
    controllers: Sequence[Controller],
    level: float,
) -> C:
    """One claim of a level about all loops, with a matrix for each; one law may serve all plants.

    make : `bounded_real_claim` or `energy_claim`

    Raises
    ------
    ModelError : a loop's norm is not below `level`, or not by enough
    """
    laws = _laws(plants, controllers)
    claims = [make(plant, controllers[j], level) for plant, j in zip(plants, laws, strict=True)]
    return replace(
        claims[0], plants=tuple(range(len(plants))), controllers=laws, P=np.concatenate([one.P for one in claims])
    )


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
    basis = balance(A)
    A_b, B_b, C_b = A / basis[:, None] * basis, B / basis[:, None], C * basis
    observed = gramian(A_b, C_b.T @ C_b, plant.dt)
    norm = float(np.sqrt(max(np.sum(B_b * (observed @ B_b)) + through, 0.0)))
    room = level**2 - norm**2
    if not room > 0.0:
        raise ModelError(f"{plant.name}: the H2 norm is {norm:.10g}, not below {level:.10g}")

    def tries() -> Iterator[FloatArray]:
        for spare, _ in strict_parts(A_b, plant.dt):
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
    basis = balance(A)
    root = np.sqrt(gamma)
    A_b, B_b, C_b = A / basis[:, None] * basis, B / basis[:, None] / root, C * basis / root
    second = even_scales(A_b, B_b, C_b, plant.dt)
    basis = basis * second
    A_b, B_b, C_b = A_b / second[:, None] * second, B_b / second[:, None], C_b * second
    D_b = D / gamma

    def tries() -> Iterator[FloatArray]:
        for part, weight in strict_parts(A_b, plant.dt):
            cost = float(np.sum(B_b * (part @ B_b)))
            for share in _STEPS:
                size = share / cost if cost > 0.0 else share
                found = bounded_real_solution(A_b, B_b, C_b.T @ C_b + size * weight, C_b.T @ D_b, D_b, plant.dt)
                if found is not None:
                    yield found

    def made(P: FloatArray) -> GainClaim:
        return GainClaim((index,), (law,), gamma, P[None], disturbances, performance)

    return made(_first_proved(tries(), basis, made, plant, controller))


def _laws(plants: Sequence[Plant], controllers: Sequence[Controller]) -> tuple[int, ...]:
    """Index of each plant's law."""
    if len(controllers) not in (1, len(plants)):
        raise ValueError(f"controllers: expected 1 or {len(plants)}, got {len(controllers)}")
    return tuple(range(len(controllers))) if len(controllers) > 1 else (0,) * len(plants)


def _first_made(makers: Sequence[Callable[[], Made]]) -> Made:
    """The first claim that can be made; where none can, the reason for the last."""
    for make in makers[:-1]:
        try:
            return make()
        except ModelError:
            continue
    return makers[-1]()


def _decay_rate(A: FloatArray, dt: float | None) -> float:
    """Rate (1/s) at which the slowest mode decays."""
    poles = np.linalg.eigvals(A)
    if dt is None:
        return -float(np.max(poles.real)) if len(poles) else 1.0
    return min(-float(np.log(max(float(np.max(np.abs(poles), initial=0.0)), 1e-300))), FASTEST) / dt


def _decay_matrix(plant: Plant, controller: Controller, rate: float) -> FloatArray:
    A = closed_channel(plant, controller)[0]
    _require_decay(A, rate, plant)
    moved = A + rate * np.eye(len(A)) if plant.dt is None else A * np.exp(rate * plant.dt)
    basis = balance(moved)

    def made(P: FloatArray) -> DecayClaim:
        return DecayClaim((0,), (0,), rate, P[None])

    tries = (P for P, _ in strict_parts(moved / basis[:, None] * basis, plant.dt))
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
