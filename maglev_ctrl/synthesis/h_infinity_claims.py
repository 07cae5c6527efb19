"""What is claimed of a law for one plant: decay, and peak gain or energy, as tight as it can be proved.

Strict inequalities are what can be proved with rounding, so every claim is a little weaker than the number it stands
for: the rate a little slower, the level a little higher. How much is tried from tight to loose.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
from numpy.linalg import LinAlgError

from maglev_ctrl.analysis.hamiltonian import balanced_realisation, continuous_equivalent, peak_gain
from maglev_ctrl.analysis.loops import state_scales
from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.errors import ModelError, Status
from maglev_ctrl.proofs.claims import Claim, GainClaim
from maglev_ctrl.proofs.makers import bounded_real_claim, energy_claim, lyapunov_claim
from maglev_ctrl.proofs.prove import prove
from maglev_ctrl.synthesis.h_infinity_game import Channel, solve_game
from maglev_ctrl.synthesis.result import Performance, Synthesis, proven, refused
from maglev_ctrl.systems import Controller
from maglev_ctrl.systems.plant import Plant, closed_channel

RATES = (0.9, 0.5, 0.1)
"""Shares of the slowest pole's rate that are claimed, the first that is proved."""
LEVELS = (1e-4, 1e-3, 1e-2, 1e-1)
"""Shares by which a claimed level exceeds the norm, the first that is proved."""


def proved_law(
    law: str,
    plant: Plant,
    controller: Controller,
    *,
    norm: float,
    energy: bool,
    performance: Sequence[Performance],
    notes: Sequence[str],
    status: Status = Status.SOLVED,
) -> Synthesis:
    """The design with the tightest claims that are proved: decay, and peak gain or (where `energy`) H2 norm.

    Where none of them is proved the loosest goes to the gate, which keeps the law back and says why.

    Examples
    --------
    >>> plant = Plant.from_matrices([[1.0]], [[1.0]], [[1.0]], [[1.0]])
    >>> law = Controller.static([[-3.0]], measured=("x1",), commands=("u1",))
    >>> found = proved_law("demo", plant, law, norm=0.5, energy=False, performance=[], notes=[])
    >>> [round(x, 6) for x in (found.claims[0].rate, found.claims[1].gamma)]
    [1.8, 0.50005]
    """
    loop = closed_channel(plant, controller)
    fastest = slowest_rate(loop[0], plant.dt)
    decays = [partial(lyapunov_claim, [plant], [controller], rate=share * fastest) for share in RATES]
    levels: list[Callable[[], Claim]] = []
    for share in LEVELS:
        if energy:
            levels.append(partial(energy_claim, plant, controller, (1.0 + share) * norm))
        else:
            levels.append(partial(gain_claim, loop, plant.dt, norm, share))
            levels.append(partial(bounded_real_claim, plant, controller, (1.0 + share) * norm))
    try:
        claims = [_first(plant, controller, decays), _first(plant, controller, levels)]
    except ModelError as error:
        return refused(law, [plant], Status.NOT_VERIFIED, f"the law is kept back: {error}")
    return proven(law, [plant], [controller], claims=claims, performance=performance, notes=notes, status=status)


def slowest_rate(A: FloatArray, dt: float | None) -> float:
    """Rate (1/s) at which the slowest mode decays.

    Examples
    --------
    >>> slowest_rate(np.diag([-2.0, -3.0]), None)
    2.0
    """
    poles = np.linalg.eigvals(A)
    if not poles.size:
        return 1.0
    if dt is None:
        return -float(np.max(poles.real))
    return -float(np.log(max(float(np.max(np.abs(poles))), 1e-12))) / dt


def gain_claim(
    loop: tuple[FloatArray, FloatArray, FloatArray, FloatArray], dt: float | None, norm: float, share: float
) -> GainClaim:
    """That the peak gain is below (1 + share) norm: bounded-real matrix of the loop with the states added to z.

    The added outputs make P positive definite where states are hidden from z.

    The matrix is the same in continuous and sampled time where the two are joined by the bilinear transformation.

    Examples
    --------
    >>> loop = (-np.eye(1), np.eye(1), np.eye(1), np.zeros((1, 1)))
    >>> gain_claim(loop, None, 1.0, 0.01).gamma
    1.01
    """
    A, B, C, D = loop
    level = (1.0 + share) * norm
    try:
        if dt is not None:
            A, B, C, D = continuous_equivalent(A, B, C, D, dt)
        scale = state_scales(A, B, C)
        A, B, C = balanced_realisation(A, B, C)
        n, m = B.shape
        reach = peak_gain(A, B, np.eye(n), np.zeros((n, m)), tolerance=1e-3).upper
    except LinAlgError:
        raise ModelError("the bounded-real equation of the closed loop is singular") from None
    added = 0.5 * np.sqrt(level**2 - norm**2) / max(reach, 1e-300)
    added = min(added, 1e3 * max(float(np.linalg.norm(C, 2)), level * float(np.linalg.norm(A, 2))))
    C_more, D_more = np.vstack([C, added * np.eye(n)]), np.vstack([D, np.zeros((n, m))])
    game = solve_game(Channel(A, B, np.zeros((n, 0)), C_more, D_more, np.zeros((len(C_more), 0))), level, refine=True)
    if game.X is None or not game.solvable:
        raise ModelError(f"the bounded-real equation was not solved at {level:.6g}")
    return GainClaim((0,), (0,), level, (game.X / np.outer(scale, scale))[None] / level)


def _first(plant: Plant, controller: Controller, makers: Sequence[Callable[[], Claim]]) -> Claim:
    """The first claim that is proved, else the last that could be made.

    Raises
    ------
    ModelError : none could be made
    """
    claim: Claim | None = None
    reason = ModelError("no claim")
    for make in makers:
        try:
            claim = make()
        except ModelError as error:
            reason = error
            continue
        if prove(claim, [plant], [controller]).holds:
            break
    if claim is None:
        raise reason
    return claim
