"""Regulators of the vertices kept where one Lyapunov matrix serves them all."""

from __future__ import annotations

import numpy as np
from scipy.linalg import solve_continuous_are

from maglev_ctrl.proofs.prove import prove
from maglev_ctrl.synthesis.scheduling.polytopic import polytopic_lpv
from maglev_ctrl.synthesis.scheduling.regulators import shared_regulators
from maglev_ctrl.systems.plant import Plant


def oscillator(stiffness, price=1.0):
    A = np.array([[0.0, 1.0], [-stiffness, 0.1]])
    C = np.array([[1.0, 0.0], [0.0, 0.0]])
    return Plant.from_matrices(A, [[0.0], [1.0]], [[0.0], [1.0]], C, D12=[[0.0], [price]])


def dayawansa_martin(a, price):
    """Each loop decays, their blends share no Lyapunov matrix for a > 3 + sqrt 8 (IEEE TAC 44 (1999) 751)."""
    loops = ([[-1.0, -1.0], [1.0, -1.0]], [[-1.0, -a], [1.0 / a, -1.0]])
    through = np.vstack([np.zeros((2, 2)), price * np.eye(2)])
    return [
        Plant.from_matrices(A, np.eye(2), np.eye(2), np.vstack([np.eye(2), np.zeros((2, 2))]), D12=through)
        for A in loops
    ]


def test_the_gains_are_those_of_the_regulators():
    plants = [oscillator(4.0), oscillator(5.0)]
    design = polytopic_lpv(plants, [20.0, 40.0], objective="regulator", parameter="speed", unit="m/s")
    for plant, law in zip(plants, design.synthesis.controllers, strict=True):
        P = solve_continuous_are(plant.A, plant.B2, plant.C1.T @ plant.C1, np.eye(1))
        np.testing.assert_allclose(law.D, -plant.B2.T @ P, rtol=1e-9)
    assert any("linear-quadratic regulators" in note for note in design.synthesis.notes)
    claim = design.synthesis.claims[0]
    mutant = [law.static(-law.D, measured=law.measured, commands=law.commands) for law in design.synthesis.controllers]
    assert not prove(claim, plants, mutant).holds


def test_the_matrix_serves_every_blend():
    plants = [oscillator(4.0), oscillator(6.0)]
    K, P = shared_regulators(plants, [(0, 0), (1, 1)], 0.0)
    for share in np.linspace(0.0, 1.0, 11):
        A = (1.0 - share) * (plants[0].A + plants[0].B2 @ K[0]) + share * (plants[1].A + plants[1].B2 @ K[1])
        assert np.max(np.linalg.eigvalsh(A.T @ P + P @ A)) < 0.0


def test_without_a_common_matrix_other_gains_are_sought():
    plants = dayawansa_martin(8.0, price=10.0)  # dear commands: the regulators hardly act
    assert shared_regulators(plants, [(0, 0), (1, 1)], 0.0) is None
    design = polytopic_lpv(plants, [0.0, 1.0], objective="regulator")
    assert design.guarantee == "polytopic: any variation"
    assert any("does not serve the regulators" in note for note in design.synthesis.notes)
    cheap = dayawansa_martin(8.0, price=1.0)
    assert shared_regulators(cheap, [(0, 0), (1, 1)], 0.0) is not None


def test_a_command_without_a_price_has_no_regulator():
    plants = [oscillator(4.0, price=0.0), oscillator(5.0, price=0.0)]
    assert shared_regulators(plants, [(0, 0), (1, 1)], 0.0) is None
