"""Gradients of the structured design against differences, for continuous and sampled loops."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from maglev_ctrl.synthesis.structured.descent import descend
from maglev_ctrl.synthesis.structured.objective import MARGIN, Limit, Objective
from maglev_ctrl.synthesis.structured.structure import Structure
from maglev_ctrl.systems.plant import Plant

QUANTITIES = ("decay_rate", "damping_ratio", "h2", "h_infinity")


def _plant(dt=None, *, through=False, seed=3, name="plant"):
    rng = np.random.default_rng(seed)
    n = 5
    A = rng.standard_normal((n, n))
    if dt is None:
        A = A - (np.max(np.linalg.eigvals(A).real) + 0.7) * np.eye(n)
    else:
        A = 0.6 * A / np.max(np.abs(np.linalg.eigvals(A)))
    matrix = rng.standard_normal
    return Plant.from_matrices(
        A, matrix((n, 2)), matrix((n, 2)), matrix((3, n)), matrix((2, n)),
        D12=matrix((3, 2)), D22=0.1 * matrix((2, 2)) if through else None, dt=dt, name=name,
    )  # fmt: skip


def _difference(objective, t, direction, step=1e-5):
    return (objective.value(t + step * direction)[0] - objective.value(t - step * direction)[0]) / (2.0 * step)


@pytest.mark.parametrize("quantity", QUANTITIES)
@pytest.mark.parametrize("dt", [None, 0.1])
@pytest.mark.parametrize("through", [False, True])
def test_gradients_equal_differences(quantity, dt, through):
    plant = _plant(dt, through=through)
    objective = Objective.of((plant,), Structure.full(plant, order=1), quantity)
    rng = np.random.default_rng(0)
    t, direction = 0.02 * rng.standard_normal(9), rng.standard_normal(9)
    t[-1] = -0.5  # the law's own pole, scaled
    value, gradient = objective.value(t)
    assert np.isfinite(value)
    expected = _difference(objective, t, direction)
    # Central differences with step 1e-5 of a function with curvature of order one: error about 1e-9.
    assert gradient @ direction == pytest.approx(expected, rel=1e-5, abs=1e-7)
    assert -gradient @ direction != pytest.approx(expected, rel=1e-5, abs=1e-7)


def test_the_peak_has_a_gradient_with_feedthrough_at_infinite_frequency():
    plant = Plant.from_matrices([[-1.0]], [[1.0]], [[1.0]], [[0.1]], [[1.0]], D12=[[1.0]], D21=[[1.0]])
    objective = Objective.of((plant,), Structure.full(plant), "h_infinity")
    t = np.array([-3.0 / objective.size[0]])
    value, gradient = objective.value(t)
    # G = 0.1 (1 + k)/(s + 1 - k) + k (s + 2)/(...): the feedthrough k sets the peak for this k
    assert objective.physical(value) == pytest.approx(3.0, rel=1e-6)
    assert gradient[0] == pytest.approx(_difference(objective, t, np.ones(1)), rel=1e-5)


def test_the_worst_plant_counts_and_limits_add_their_excess():
    first, second = _plant(seed=3, name="first"), _plant(seed=4, name="second")
    structure = Structure.full(first)
    both = Objective.of((first, second), structure, "h2")
    alone = [Objective.of((plant,), structure, "h2") for plant in (first, second)]
    t = np.zeros(4)
    values = [one.value(t)[0] for one in alone]
    assert both.value(t)[0] == pytest.approx(max(values))
    peak = Objective.of((first,), structure, "h_infinity").value(t)[0]
    limited = Objective.of((first,), structure, "h2", (Limit("h_infinity", 0.5 * np.exp(peak)),))
    assert limited.value(t)[0] == pytest.approx(values[0] + limited.weight * (np.log(2.0) + MARGIN), rel=1e-6)
    rng = np.random.default_rng(1)
    direction = rng.standard_normal(4)
    assert limited.value(t)[1] @ direction == pytest.approx(_difference(limited, t, direction), rel=1e-5)


def test_pieces_are_the_peaks_near_the_highest():
    # Two resonances of nearly the same height, far apart.
    A = np.zeros((4, 4))
    A[:2, :2], A[2:, 2:] = [[0, 1], [-1, -0.1]], [[0, 10], [-10, -1.0]]
    plant = Plant.from_matrices(
        A, [[0, 0], [1, 0], [0, 0], [0, 1]], [[0], [1], [0], [1]], [[0, 1, 0, 0], [0, 0, 0, 9.9]], [[0, 1, 0, 1]]
    )
    objective = Objective.of((plant,), Structure.full(plant), "h_infinity")
    pieces = objective.pieces(np.zeros(1), 0.1)
    assert len(pieces) == 2
    # x / (s^2 + 0.1 s + 1) of a speed: 1 / 0.1; the other 9.9 / 1. The second is found by sampling an interval.
    assert [np.exp(piece.value) for piece in pieces] == pytest.approx([10.0, 9.9], rel=1e-4)


@pytest.mark.parametrize("sides", [(2.0, 1.0), (1.0, 30.0)])
def test_descent_in_a_kink_and_at_a_bound(sides):
    def function(t, *, ceiling=np.inf):
        pieces = [sides[0] * abs(t[0]) + (t[1] - 1.0) ** 2, sides[1] * t[0] - 5.0]
        if pieces[0] >= pieces[1]:
            return pieces[0], np.array([sides[0] * np.sign(t[0]), 2.0 * (t[1] - 1.0)])
        return pieces[1], np.array([sides[1], 0.0])

    upper = np.array([np.inf, 0.25])
    end = descend(function, np.array([1.3, -2.0]), lower=np.full(2, -np.inf), upper=upper, iterations=200)
    assert end.t[1] == 0.25
    assert end.t[0] == pytest.approx(0.0, abs=1e-5)


def test_a_function_with_a_wrong_gradient_is_seen():
    plant = _plant()
    objective = Objective.of((plant,), Structure.full(plant), "h2")
    mutant = replace(objective, size=-objective.size)
    t, direction = np.full(4, 0.01), np.ones(4)
    assert mutant.value(-t)[0] == pytest.approx(objective.value(t)[0])
    assert mutant.value(-t)[1] @ direction != pytest.approx(_difference(objective, t, direction), rel=1e-3)
