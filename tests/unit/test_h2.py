"""H2 synthesis: closed forms, optimality against changed laws, limit cases, sampled plants."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from maglev_ctrl.analysis.norms import h2_norm
from maglev_ctrl.errors import Status
from maglev_ctrl.synthesis.h2 import h2_output_feedback, h2_state_feedback, h2_synthesis
from maglev_ctrl.systems import Controller
from maglev_ctrl.systems.plant import Plant, closed_channel


def _general(seed, sizes=(4, 3, 2, 3, 1), *, dt=None, D11=None):
    n, m1, m2, p1, p2 = sizes
    draw = np.random.default_rng(seed).standard_normal
    return Plant.from_matrices(
        draw((n, n)) * (1.0 if dt is None else 0.5), draw((n, m1)), draw((n, m2)), draw((p1, n)), draw((p2, n)),
        D11=draw((p1, m1)) if dt is not None else D11, D12=draw((p1, m2)), D21=draw((p2, m1)), D22=draw((p2, m2)),
        dt=dt,
    )  # fmt: skip


def _norm(plant, law, **changed):
    matrices = {name: changed.get(name, getattr(law, name)) for name in "ABCD"}
    made = Controller.from_matrices(
        *matrices.values(), measured=law.measured, commands=law.commands, dt=plant.dt
    )  # fmt: skip
    return h2_norm(*closed_channel(plant, made), dt=plant.dt).value


@pytest.mark.parametrize("a", [-2.0, 0.0, 3.0])
def test_scalar_state_feedback(a):
    plant = Plant.from_matrices([[a]], [[1.0]], [[1.0]], [[1.0], [0.0]], D12=[[0.0], [1.0]])
    design = h2_state_feedback(plant)
    P = a + np.sqrt(a**2 + 1.0)
    assert design.optimum == pytest.approx(np.sqrt(P), rel=1e-12)
    assert design.norm == pytest.approx(np.sqrt(P), rel=1e-12)
    assert design.controller.D[0, 0] == pytest.approx(-P, rel=1e-12)


@pytest.mark.parametrize("dt", [None, 0.1])
def test_output_feedback_is_the_least_of_its_neighbours(dt):
    plant = _general(3, dt=dt)
    design = h2_output_feedback(plant)
    assert design.synthesis.status is Status.SOLVED, design.synthesis.message
    assert design.optimum == pytest.approx(design.norm, rel=1e-9)
    law = design.controller
    rng = np.random.default_rng(0)
    names = "ABC" if dt is None else "ABCD"  # a feedthrough makes the continuous norm infinite
    for _ in range(40):
        name = names[rng.integers(len(names))]
        matrix = getattr(law, name)
        changed = matrix + 1e-4 * np.linalg.norm(matrix) * rng.standard_normal(matrix.shape)
        assert _norm(plant, law, **{name: changed}) >= design.norm * (1.0 - 1e-9)


def test_sampled_state_feedback_is_the_least_of_its_neighbours():
    plant = _general(9, dt=0.1)
    design = h2_state_feedback(plant)
    assert design.optimum == pytest.approx(design.norm, rel=1e-9)
    states = design.synthesis.plants[0]
    rng = np.random.default_rng(0)
    for _ in range(20):
        changed = design.controller.D + 1e-3 * rng.standard_normal(design.controller.D.shape)
        assert _norm(states, design.controller, D=changed) >= design.norm * (1.0 - 1e-12)


def test_feedthrough_that_the_law_cancels():
    plant = Plant.from_matrices(
        [[1.0]], [[1.0, 0.0]], [[1.0]], [[1.0], [0.0]], [[1.0]],
        D11=[[0.0, 0.0], [0.0, 2.0]], D12=[[0.0], [1.0]], D21=[[0.0, 1.0]],
    )  # fmt: skip
    design = h2_output_feedback(plant)  # z2 = u + 2 v, y = x + v: D_k = -2
    assert design.synthesis.status is Status.SOLVED, design.synthesis.message
    assert design.controller.D[0, 0] == -2.0
    assert design.norm == pytest.approx(design.optimum, rel=1e-10)
    stubborn = replace(plant, D11=np.array([[1.0, 0.0], [0.0, 0.0]]))
    refused = h2_output_feedback(stubborn)
    assert refused.synthesis.status is Status.INFEASIBLE
    assert "no feedthrough of the law cancels D11" in refused.synthesis.message
    assert h2_state_feedback(plant).synthesis.status is Status.INFEASIBLE


def test_d22_changes_the_law_and_not_the_optimum():
    plant = _general(5)
    bare = replace(plant, D22=np.zeros_like(plant.D22))
    assert h2_output_feedback(plant).norm == pytest.approx(h2_output_feedback(bare).norm, rel=1e-9)


def test_singular_and_unmovable_plants():
    cheap = Plant.from_matrices([[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]], [[0.0], [1.0]], [[1.0, 0.0]])
    design = h2_state_feedback(cheap)
    assert "the plant is singular: one command is not weighed at once" in design.synthesis.notes[0]
    assert design.optima[0] > design.optima[1] > design.optima[2] == design.optimum
    stuck = Plant.from_matrices([[1.0]], [[1.0]], [[0.0]], [[1.0]], states=("gap",))
    assert "cannot move the mode at 1 rad/s (gap)" in h2_state_feedback(stuck).synthesis.message


def test_dispatch_and_mutant():
    plant = _general(3)
    assert h2_synthesis(plant).law == "H2 output feedback"
    design = h2_output_feedback(plant)
    assert _norm(plant, design.controller, B=-design.controller.B) > design.norm * 1.001
