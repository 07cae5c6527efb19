"""COMPleib: static output feedback, H-infinity and H2, against the best values of a published search.

The references are upper bounds (best of a few starts); a smaller norm is no error. A law passes with a norm of at most
1.02 times the reference; nine of ten plants have to pass for each norm.
"""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import solve_continuous_lyapunov

from maglev_ctrl.synthesis.structured.design import structured_design
from maglev_ctrl.synthesis.structured.structure import Structure
from maglev_ctrl.systems.plant import Plant

PATH = Path(__file__).parents[3] / "shared" / "data" / "external" / "compleib.json"
STARTS, SEED = 10, 1
ALLOWED = 1.02
SHARE = 0.9
KEYS = {"h_infinity": "sof_hinf_best_found", "h2": "sof_h2_best_found"}


@cache
def _cases():
    return json.loads(PATH.read_text())["cases"] if PATH.exists() else []


def _plant(case):
    return Plant.from_matrices(
        case["A"], case["B1"], case["B"], case["C1"], case["C"],
        D11=case["D11"], D12=case["D12"], D21=case["D21"], name=case["id"],
    )  # fmt: skip


def _closed(case, K):
    A, B1, B, C1, C, D11, D12, D21 = (np.array(case[k]) for k in ("A", "B1", "B", "C1", "C", "D11", "D12", "D21"))
    return A + B @ K @ C, B1 + B @ K @ D21, C1 + D12 @ K @ C, D11 + D12 @ K @ D21


def _norm(case, K, quantity):
    """Norm of the closed loop without the package: Lyapunov equation, or a fine search over frequencies."""
    A, B, C, D = _closed(case, K)
    poles = np.linalg.eigvals(A)
    if np.max(poles.real) >= 0.0:
        return np.inf
    if quantity == "h2":
        if np.any(D != 0.0):
            return np.inf
        return float(np.sqrt(np.trace(C @ solve_continuous_lyapunov(A, -B @ B.T) @ C.T)))
    sizes = np.unique(np.concatenate([np.abs(poles), np.abs(poles.imag)]))
    grid = np.concatenate([[0.0], *(w * np.linspace(0.5, 2.0, 61) for w in sizes[sizes > 0.0])])
    narrow = [p.imag + abs(p.real) * np.linspace(-3.0, 3.0, 61) for p in poles]
    grid = np.unique(np.abs(np.concatenate([grid, *narrow])))

    def gains(w):
        pencil = 1j * w[:, None, None] * np.eye(len(A)) - A
        return np.linalg.norm(C @ np.linalg.solve(pencil, np.broadcast_to(B + 0j, (len(w), *B.shape))) + D, 2, (1, 2))

    values = gains(grid)
    best = max(float(np.max(values)), float(np.linalg.norm(D, 2)))
    for k in np.argsort(-values)[:3]:
        low, high = grid[max(k - 1, 0)], grid[min(k + 1, len(grid) - 1)]
        best = max(best, float(np.max(gains(np.linspace(low, high, 201)))))
    return best


@pytest.mark.slow
@pytest.mark.parametrize("quantity", ["h_infinity", "h2"])
def test_static_output_feedback(quantity):
    cases = [case for case in _cases() if case.get(KEYS[quantity]) is not None]
    if not cases:
        pytest.skip("the collection compleib.json is not part of this checkout")
    failed = {}
    for case in cases:
        plant = _plant(case)
        design = structured_design([plant], Structure.full(plant), objective=quantity, starts=STARTS, seed=SEED)
        if not design.controllers:
            failed[case["id"]] = design.message
            continue
        found = _norm(case, design.controller.D, quantity)
        ratio = found / case[KEYS[quantity]]
        assert design.performance[0].recomputed == pytest.approx(found, rel=1e-4), case["id"]
        if ratio > ALLOWED:
            failed[case["id"]] = f"{ratio:.4f} of the reference"
    assert len(failed) <= (1.0 - SHARE) * len(cases), failed


def test_a_mutant_is_caught():
    if not _cases():
        pytest.skip("the collection compleib.json is not part of this checkout")
    case = next(c for c in _cases() if c["id"] == "AC6")
    K = np.array(case["sof_hinf_K"])
    assert _norm(case, K, "h_infinity") == pytest.approx(case["sof_hinf_best_found"], rel=1e-5)
    assert _norm(case, -K, "h_infinity") > ALLOWED * case["sof_hinf_best_found"]
