"""Singular plants: defects found whatever the units, enlarged plants that only add to gains."""

from __future__ import annotations

import numpy as np
import pytest

from maglev_ctrl.analysis.norms import h_infinity_norm
from maglev_ctrl.errors import ModelError
from maglev_ctrl.synthesis.h_infinity import h_infinity_state_feedback
from maglev_ctrl.synthesis.regular import defects, enlarged, require_movable
from maglev_ctrl.systems.plant import Plant


def _oscillator(**more):
    return Plant.from_matrices([[0.0, 1.0], [-4.0, 0.0]], [[0.0], [1.0]], [[0.0], [1.0]], **more)


def test_a_regular_plant_has_no_defects():
    plant = _oscillator(C1=[[1.0, 0.0], [0.0, 0.0]], D12=[[0.0], [1.0]])
    assert not defects(plant, output=False).any
    assert defects(plant, output=True).sentences == ("2 measurements are without noise (D21 lacks row rank)",)


@pytest.mark.parametrize("unit", [1e-8, 1.0, 1e8])
def test_units_of_commands_are_not_taken_for_missing_prices(unit):
    rows = np.vstack([np.eye(2), np.zeros((2, 2))])
    prices = np.vstack([np.zeros((2, 2)), np.diag([1.0, unit])])
    plant = Plant.from_matrices(np.eye(2), np.eye(2), np.diag([1.0, unit]), rows, D12=prices)
    assert not defects(plant, output=False).any
    expected = h_infinity_state_feedback(
        Plant.from_matrices(np.eye(2), np.eye(2), np.eye(2), rows, D12=rows[[2, 3, 0, 1]]), curve=()
    ).infimum
    assert h_infinity_state_feedback(plant, curve=()).infimum == pytest.approx(expected, rel=1e-6)
    same = Plant.from_matrices(np.eye(2), np.eye(2), np.eye(2), rows, D12=np.outer([0, 0, 1, 1], [1.0, unit]))
    assert len(defects(same, output=False).commands) == 1


def test_zeros_on_the_axis_are_found_and_others_are_not():
    # z = u alone: nothing sees the oscillation at 2 rad/s
    hidden = _oscillator(C1=[[0.0, 0.0]], D12=[[1.0]])
    assert "an invariant zero at 2j on the axis" in defects(hidden, output=False).sentences[0]
    damped = Plant.from_matrices([[-0.1]], [[1.0]], [[1.0]], [[0.0]], D12=[[1.0]])
    assert not defects(damped, output=False).any


@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e6])
def test_units_of_states_put_no_zero_on_the_axis(unit):
    states = np.diag([1.0, unit])

    def with_zeros(real):
        A = states @ np.array([[real, 1.0], [-1.0, real]]) @ np.linalg.inv(states)
        return Plant.from_matrices(A, np.eye(2), states @ [[0.0], [1.0]], np.zeros((1, 2)), D12=[[1.0]])

    assert not defects(with_zeros(0.05), output=False).any
    assert "an invariant zero at 1j on the axis" in defects(with_zeros(0.0), output=False).sentences[0]


def test_an_enlarged_plant_has_no_defects_and_no_smaller_gain():
    plant = _oscillator(C1=[[1.0, 0.0]], C2=[[1.0, 0.0]])
    found = defects(plant, output=True)
    larger = enlarged(plant, found, 1e-2)
    assert not defects(larger, output=True).any
    closed = plant.A + plant.B2 @ np.array([[-1.0, -2.0]])
    before = h_infinity_norm(closed, plant.B1, plant.C1, plant.D11).value
    after = h_infinity_norm(closed, larger.B1, larger.C1, larger.D11).value
    assert before < after < 1.1 * before
    mutant = enlarged(plant, found, 1.0)
    assert h_infinity_norm(closed, mutant.B1, mutant.C1, mutant.D11).value > 1.1 * before


def test_modes_out_of_reach_are_named():
    plant = Plant.from_matrices(
        np.diag([0.0, -1.0]), np.eye(2), [[0.0], [1.0]], np.eye(2), states=("drift", "lag"), commands=("force",)
    )
    with pytest.raises(ModelError, match=r"the commands force cannot move the mode at 0 rad/s \(drift\)"):
        require_movable(plant, output=False)
