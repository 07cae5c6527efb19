"""Thousands of random plants, some of them hopeless: every law that is let through does what its claims say.

A row of `DESIGNERS` is all that a further synthesis needs. Claims are confirmed by code that shares nothing with the
proofs: poles from eigenvalues (with fifty digits where the axis is near), gains over frequency, energies by Gramians.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import mpmath
import numpy as np
import pytest
import scipy.linalg
from random_plants import HOPELESS, RandomPlant, random_plant

from maglev_ctrl.errors import MaglevError, Status
from maglev_ctrl.proofs.claims import DecayClaim, EnergyClaim, GainClaim
from maglev_ctrl.proofs.makers import lyapunov_claim
from maglev_ctrl.proofs.prove import prove
from maglev_ctrl.synthesis.h2 import h2_synthesis
from maglev_ctrl.synthesis.h_infinity import h_infinity_synthesis
from maglev_ctrl.synthesis.lmi.request import MultiObjective
from maglev_ctrl.synthesis.lmi.state_feedback import multi_objective
from maglev_ctrl.synthesis.lq_plants import design_sampled_lqr
from maglev_ctrl.synthesis.result import Synthesis, proven, refused
from maglev_ctrl.synthesis.riccati import riccati_continuous
from maglev_ctrl.synthesis.riccati_batch import riccati_batch
from maglev_ctrl.synthesis.structured.design import structured_design
from maglev_ctrl.synthesis.structured.structure import Structure
from maglev_ctrl.systems import Controller
from maglev_ctrl.systems.plant import Plant

REGULATORS, CHUNK = 10_000, 1_250
"""Regulators designed and checked, and how many at a time; plant number k comes from seed k."""


def closed(plant: Plant, law: Controller) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Closed loop by eliminating u and y at once: [[I, -D_k], [-D22, I]] (u, y) = (C_k x_k, C2 x + D21 w)."""
    n, n_k, n_u, n_y = len(plant.A), len(law.A), len(plant.commands), len(plant.measured)
    joint = np.block([[np.eye(n_u), -law.D], [-plant.D22, np.eye(n_y)]])
    seen = np.block([
        [np.zeros((n_u, n)), law.C, np.zeros((n_u, len(plant.disturbances)))],
        [plant.C2, np.zeros((n_y, n_k)), plant.D21],
    ])  # fmt: skip
    signals = np.linalg.solve(joint, seen)
    into_x = np.block([[plant.B2, np.zeros((n, n_y))], [np.zeros((n_k, n_u)), law.B]])
    into_z = np.hstack([plant.D12, np.zeros((len(plant.performance), n_y))])
    rows = into_x @ signals
    A = scipy.linalg.block_diag(plant.A, law.A) + rows[:, : n + n_k]
    B = np.vstack([plant.B1, np.zeros((n_k, plant.B1.shape[1]))]) + rows[:, n + n_k :]
    back = into_z @ signals
    C = np.hstack([plant.C1, np.zeros((len(plant.performance), n_k))]) + back[:, : n + n_k]
    return A, B, C, plant.D11 + back[:, n + n_k :]


def decays(plant: Plant, law: Controller, rate: float) -> bool:
    """Every pole decays at `rate` or faster, from eigenvalues; with fifty digits where these are in doubt."""
    A = closed(plant, law)[0]
    poles = np.linalg.eigvals(A)
    size = max(float(np.max(np.abs(poles))), 1e-300)
    if plant.dt is None:
        distance = -rate - float(np.max(poles.real))
    else:
        distance = float(np.exp(-rate * plant.dt)) - float(np.max(np.abs(poles)))
    if abs(distance) > 1e-6 * size:
        return distance > 0.0
    with mpmath.workdps(50):
        exact = mpmath.eig(_closed_exactly(plant, law), left=False, right=False)
        if plant.dt is None:
            return max(mpmath.re(pole) for pole in exact) < -rate
        return max(abs(pole) for pole in exact) < mpmath.exp(-mpmath.mpf(rate) * plant.dt)


def _closed_exactly(plant: Plant, law: Controller) -> mpmath.matrix:
    """A of the closed loop with the digits mpmath works with."""

    def many(array: np.ndarray) -> mpmath.matrix:
        return mpmath.matrix(array.tolist())

    n, n_k, n_u, n_y = len(plant.A), len(law.A), len(plant.commands), len(plant.measured)
    joint = np.block([[np.eye(n_u), -law.D], [-plant.D22, np.eye(n_y)]])
    seen = np.block([[np.zeros((n_u, n)), law.C], [plant.C2, np.zeros((n_y, n_k))]])
    into = np.block([[plant.B2, np.zeros((n, n_y))], [np.zeros((n_k, n_u)), law.B]])
    return many(scipy.linalg.block_diag(plant.A, law.A)) + many(into) * mpmath.inverse(many(joint)) * many(seen)


def gain_found(plant: Plant, law: Controller) -> float:
    """Largest gain over frequencies from far below to far above the poles, and at each of them."""
    A, B, C, D = closed(plant, law)
    poles = np.linalg.eigvals(A)
    if plant.dt is None:
        moduli = np.abs(poles)
        low, high = max(np.min(moduli), 1e-8) / 100.0, np.max(moduli) * 100.0
        points = 1j * np.concatenate([[0.0], np.abs(poles.imag), moduli, np.geomspace(low, high, 200)])
    else:
        points = np.exp(1j * np.concatenate([np.abs(np.angle(poles)), np.linspace(0.0, np.pi, 200)]))
    _, (scale, _) = scipy.linalg.matrix_balance(A, permute=False, separate=True)
    left = points[:, None, None] * np.eye(len(A)) - A / scale[:, None] * scale
    response = (C * scale) @ np.linalg.solve(left, np.broadcast_to(B / scale[:, None], (len(points), *B.shape))) + D
    return float(np.max(np.linalg.svd(response, compute_uv=False), initial=0.0))


def energy_found(plant: Plant, law: Controller) -> float:
    """H2 norm from the Gramian of the disturbances (the claim's matrix is one of the outputs)."""
    A, B, C, D = closed(plant, law)
    _, (scale, _) = scipy.linalg.matrix_balance(A, permute=False, separate=True)
    A, B, C = A / scale[:, None] * scale, B / scale[:, None], C * scale
    if plant.dt is None:
        reached = scipy.linalg.solve_continuous_lyapunov(A, -B @ B.T)
        return float(np.sqrt(np.trace(C @ reached @ C.T)))
    reached = scipy.linalg.solve_discrete_lyapunov(A, B @ B.T)
    return float(np.sqrt(np.trace(C @ reached @ C.T) + np.sum(D**2)))


def confirm(synthesis: Synthesis) -> None:
    """Every claim of a design is true, and one of them is stability."""
    assert synthesis.claims and all(proof.holds for proof in synthesis.proofs)
    for claim in synthesis.claims:
        for i, j in zip(claim.plants, claim.controllers, strict=True):
            plant, law = synthesis.plants[i], synthesis.controllers[j]
            assert decays(plant, law, claim.rate if isinstance(claim, DecayClaim) else 0.0), (plant.name, claim)
            if isinstance(claim, GainClaim):
                assert gain_found(plant, law) <= claim.gamma * (1.0 + 1e-9), plant.name
            if isinstance(claim, EnergyClaim):
                assert energy_found(plant, law) <= claim.level * (1.0 + 1e-7), plant.name


def regulators(numbers: range) -> list[tuple[RandomPlant, Synthesis]]:
    """State feedback by Riccati equations, through the gate; plants of one size are solved together.

    The batch is asked for eight digits only: what it gets wrong is for the gate to see, and then solved one by one.
    """
    made: list[tuple[RandomPlant, Synthesis]] = []
    groups: dict[tuple[int, int], list[RandomPlant]] = {}
    for one in map(random_plant, numbers):
        groups.setdefault(one.plant.B2.shape, []).append(one)
    for group in groups.values():
        plants = [one.plant for one in group]
        A, B, C, D = (np.stack([getattr(plant, key) for plant in plants]) if key in ("A", "B2") else
                      [getattr(plant, key) for plant in plants] for key in ("A", "B2", "C1", "D12"))  # fmt: skip
        Q, R, N = (np.stack([x.T @ y for x, y in zip(*pair, strict=True)]) for pair in ((C, C), (D, D), (C, D)))
        solutions = riccati_batch(A, B, Q, R, N, tolerance=1e-8)
        for one, gain, solved, *weights in zip(group, solutions.gain, solutions.solved, Q, R, N, strict=True):
            found = _gate(one.plant, gain) if solved else _unsolved(one.plant)
            if solved and not found.controllers:
                again = riccati_continuous(one.plant.A, one.plant.B2, *weights)
                solved = again.status in (Status.SOLVED, Status.ALMOST_SOLVED)
                found = _gate(one.plant, again.gain) if solved else _unsolved(one.plant)
            made.append((one, found))
    return made


def _unsolved(plant: Plant) -> Synthesis:
    return refused("LQR", [plant], Status.INFEASIBLE, "no stabilising solution of the Riccati equation")


def _gate(plant: Plant, gain: np.ndarray) -> Synthesis:
    law = Controller.static(-gain, measured=plant.measured, commands=plant.commands)
    try:
        claim = lyapunov_claim([plant], [law])
    except MaglevError as fault:
        return refused("LQR", [plant], Status.NOT_VERIFIED, str(fault))
    return proven("LQR", [plant], [law], claims=[claim])


@pytest.mark.slow
@pytest.mark.parametrize("start", range(0, REGULATORS, CHUNK))
def test_ten_thousand_regulators(start: int) -> None:
    solved = hoped = 0
    for one, synthesis in regulators(range(start, start + CHUNK)):
        if one.kind in HOPELESS:
            assert not synthesis.controllers, one.plant.name
            continue
        hoped += not one.kind.endswith("neutral")
        if synthesis.controllers:
            confirm(synthesis)
            solved += not one.kind.endswith("neutral")
    assert solved >= 0.995 * hoped


@dataclass(frozen=True, eq=False, slots=True)
class Designer:
    """A synthesis under test: what it is called, how it is called, on how many plants of what sort.

    `least` share of the plants with a solution that must get a law; plants are those of `random_plant(seed, ...)`.
    """

    name: str
    make: Callable[[Plant], Synthesis]
    count: int
    least: float
    dt: float | None = None
    sensors: bool = False
    direct: bool = False


def _structured(plant: Plant) -> Synthesis:
    return structured_design([plant], Structure.full(plant), objective="decay_rate", starts=1, time_limit=2.0)


def _h_infinity(plant: Plant) -> Synthesis:
    return h_infinity_synthesis(plant).synthesis


def _lmi(plant: Plant) -> Synthesis:
    return multi_objective([plant], MultiObjective("gain", decay_rate=0.05), time_limit=10.0)


DESIGNERS = (
    Designer("H2 state feedback", h2_synthesis, 300, 0.95),
    Designer("H2 output feedback", h2_synthesis, 100, 0.85, sensors=True),
    Designer("H2 sampled", h2_synthesis, 200, 0.9, dt=0.1),
    Designer("H-infinity state feedback", _h_infinity, 100, 0.9),
    Designer("H-infinity output feedback", _h_infinity, 50, 0.6, sensors=True, direct=True),
    Designer("sampled LQR", design_sampled_lqr, 300, 0.95, dt=0.1),
    Designer("LMI", _lmi, 30, 0.6),
    Designer("structured output feedback", _structured, 30, 0.0, sensors=True),
)
"""Add a row for a further synthesis."""


@pytest.mark.slow
@pytest.mark.parametrize("designer", DESIGNERS, ids=lambda one: one.name)
def test_every_law_that_is_let_through_is_as_claimed(designer: Designer) -> None:
    draw = partial(random_plant, dt=designer.dt, sensors=designer.sensors, direct=designer.direct)
    solved = hoped = 0
    for seed in range(designer.count):
        one = draw(seed)
        try:
            synthesis = designer.make(one.plant)
        except MaglevError:
            synthesis = refused(designer.name, [one.plant], Status.INFEASIBLE, "raised")
        if one.kind in HOPELESS:
            assert not synthesis.controllers, one.plant.name
            continue
        if synthesis.controllers:
            confirm(synthesis)
        if not one.kind.endswith("neutral"):
            hoped += 1
            solved += bool(synthesis.controllers)
    assert solved >= designer.least * hoped, f"{solved} of {hoped}"


def test_mutants_are_not_let_through() -> None:
    """A sign of one gain flipped, a gain rounded to zero: the claim of the right law does not hold for these."""
    caught = tried = 0
    for one, synthesis in regulators(range(200)):
        if not synthesis.controllers or np.max(np.linalg.eigvals(one.plant.A).real) < 0.0:
            continue
        law = synthesis.controller
        for wrong in (replace(law, D=-law.D), replace(law, D=np.zeros_like(law.D))):
            tried += 1
            kept = prove(synthesis.claims[0], [one.plant], [wrong]).holds
            assert not kept or decays(one.plant, wrong, 0.0)
            caught += not kept
    assert tried > 150 and caught == tried
