"""COMPleib plants: state feedback by matrix inequalities within 1 % of the optimum found by Riccati equations."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import solve_continuous_lyapunov

from maglev_ctrl.errors import Status
from maglev_ctrl.synthesis.lmi import LmiSession, MultiObjective, multi_objective
from maglev_ctrl.systems.plant import Plant

PATH = Path(__file__).parents[3] / "shared" / "data" / "external" / "compleib.json"
LARGEST, QUICK = 12, 5
SESSION = LmiSession()
TARGETS = {"h2": "sf_h2", "h_infinity": "sf_hinf"}


@cache
def _problems():
    if not PATH.exists():
        return []
    cases = json.loads(PATH.read_text())["cases"]
    return [
        (case, objective)
        for case in cases
        for objective, key in TARGETS.items()
        if case.get(key) and case["dims"]["nx"] <= LARGEST
    ]


def _name(index):
    return f"{_problems()[index][0]['id']}-{_problems()[index][1]}" if _problems() else "absent"


def _matrices(case):
    return tuple(np.array(case[key], dtype=float) for key in ("A", "B1", "B", "C1", "D11", "D12"))


def _plant(case):
    A, B1, B, C1, D11, D12 = _matrices(case)
    return Plant.from_matrices(A, B1, B, C1, D11=D11, D12=D12, name=case["id"])


def _energy(case, gain):
    """H2 norm of the closed loop by its controllability Gramian."""
    A, B1, B, C1, _, D12 = _matrices(case)
    closed, C = A + B @ gain, C1 + D12 @ gain
    return np.sqrt(np.trace(C @ solve_continuous_lyapunov(closed, -B1 @ B1.T) @ C.T))


def _peak(case, gain):
    """Largest gain on a grid: a lower bound of the H-infinity norm, and no more."""
    A, B1, B, C1, D11, D12 = _matrices(case)
    closed, C = A + B @ gain, C1 + D12 @ gain
    poles = np.abs(np.linalg.eigvals(closed))
    grid = np.concatenate([[0.0], np.geomspace(0.1 * poles.min(), 10.0 * poles.max(), 200), poles])
    return max(np.linalg.norm(D11 + C @ np.linalg.solve(1j * w * np.eye(len(A)) - closed, B1), 2) for w in grid)


def _marked(index):
    large = bool(_problems()) and _problems()[index][0]["dims"]["nx"] > QUICK
    return pytest.param(index, id=_name(index), marks=[pytest.mark.slow] if large else [])


@pytest.mark.parametrize("index", [_marked(i) for i in range(max(len(_problems()), 1))])
def test_within_one_percent(index):
    if not _problems():
        pytest.skip("the collection compleib.json is not part of this checkout")
    case, objective = _problems()[index]
    design = multi_objective([_plant(case)], MultiObjective(objective), session=SESSION)
    assert design.status in (Status.SOLVED, Status.ALMOST_SOLVED), design.message
    assert all(proof.holds for proof in design.proofs)
    target = case[TARGETS[objective]]
    words = {"h2": "H2 norm", "h_infinity": "H-infinity norm"}[objective]
    found = next(one.recomputed for one in design.performance if one.quantity == words)
    assert target * (1.0 - 1e-4) <= found <= 1.01 * target
    # The level proved bounds the norm of the loop, and is within the same percent.
    claim = design.claims[-1]
    level = claim.level if objective == "h2" else claim.gamma
    assert found <= level <= 1.01 * target
    gain = design.controller.D
    if objective == "h2":
        assert _energy(case, gain) == pytest.approx(found, rel=1e-6)
    else:
        assert 0.95 * found <= _peak(case, gain) <= found * (1.0 + 1e-6)


def test_a_mutant_is_caught():
    if not _problems():
        pytest.skip("the collection compleib.json is not part of this checkout")
    case = next(case for case, _ in _problems() if case["id"] == "HE2")
    plant = _plant(case)
    mutant = Plant.from_matrices(plant.A, plant.B1, -plant.B2, plant.C1, D11=plant.D11, D12=plant.D12)
    design = multi_objective([mutant], MultiObjective("h2"), session=SESSION)
    closed = plant.A + plant.B2 @ design.controller.D
    assert np.max(np.linalg.eigvals(closed).real) > 0.0 or _energy(case, design.controller.D) > 1.01 * case["sf_h2"]
