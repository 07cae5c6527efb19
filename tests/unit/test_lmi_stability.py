"""Analysis of polytopes: rates against closed forms, refutations, and what the certificates do not cover."""

from __future__ import annotations

import numpy as np
import pytest

from maglev_ctrl.errors import Status
from maglev_ctrl.synthesis.lmi import closed_loops, parameter_dependent_stability, quadratic_stability
from maglev_ctrl.synthesis.lmi.dual import refutes
from maglev_ctrl.systems import Controller
from maglev_ctrl.systems.plant import Plant

ROTATING = np.array([[-1.0, -1.0], [1.0, -1.0]])


def stretched(a):
    return np.array([[-1.0, -a], [1.0 / a, -1.0]])


def test_rate_of_normal_matrices_is_that_of_the_slowest():
    found = quadratic_stability([np.diag([-2.0, -5.0]), np.diag([-9.0, -3.0])])
    assert found.stable is True and found.rate == pytest.approx(2.0, rel=1e-4)
    assert found.rate < 2.0


def test_rate_of_two_rotations_has_a_closed_form():
    # P = diag(1, a) centres the pair: the scaled rotations' symmetric parts are -1 +- (sqrt(a) - 1/sqrt(a)) / 2, so
    # that the common rate is 1 - (a - 1) / (2 sqrt(a)), zero at a = 3 + sqrt(8).
    a = 4.0
    found = quadratic_stability([ROTATING, stretched(a)])
    assert found.rate == pytest.approx(1.0 - (a - 1.0) / (2.0 * np.sqrt(a)), rel=1e-3)


def test_one_loop_decays_at_its_slowest_pole():
    found = quadratic_stability([[[0.0, 1.0], [-5.0, -2.0]]])
    assert found.rate == pytest.approx(1.0, rel=1e-5) and found.rate < 1.0


@pytest.mark.parametrize("unit", [1e-3, 1.0, 1e3])
def test_the_unit_of_time_does_not_matter(unit):
    loops = [unit * ROTATING, unit * stretched(6.5)]
    assert quadratic_stability(loops).stable is False
    assert parameter_dependent_stability(loops, rate=0.5 * unit).stable is True
    assert quadratic_stability([unit * ROTATING, unit * stretched(5.0)]).rate == pytest.approx(
        unit * quadratic_stability([ROTATING, stretched(5.0)]).rate, rel=1e-4
    )


def test_a_blend_that_is_unstable_has_no_certificate():
    # Both vertices are stable, the middle of them is not: trace -2, determinant 1 - 4.
    loops = [np.array([[-1.0, 4.0], [0.0, -1.0]]), np.array([[-1.0, 0.0], [4.0, -1.0]])]
    assert np.max(np.linalg.eigvals(0.5 * (loops[0] + loops[1])).real) > 0.0
    assert quadratic_stability(loops).stable is False
    assert parameter_dependent_stability(loops).stable is None


def test_an_unstable_vertex_is_told():
    found = quadratic_stability([ROTATING, np.diag([0.5, -1.0])])
    assert found.stable is False and "vertex 2" in found.message
    assert parameter_dependent_stability([ROTATING], rate=1.5).stable is False


def test_refutation_with_a_wrong_sign_is_not_believed():
    found = quadratic_stability([ROTATING, stretched(8.0)])
    Z = found.refutation.Z
    assert refutes(Z, [ROTATING, stretched(8.0)])
    assert not refutes(Z[::-1], [ROTATING, stretched(8.0)]) or not refutes(Z, [-ROTATING.T, -stretched(8.0)])
    assert not refutes(Z, [ROTATING, stretched(3.0)])


def test_time_limit():
    found = quadratic_stability([ROTATING, stretched(3.0)], time_limit=0.0)
    assert found.stable is None and found.status is Status.TIME_LIMIT
    assert parameter_dependent_stability([ROTATING], time_limit=0.0).stable is None


def test_loops_of_plants_and_a_law():
    plants = [
        Plant.from_matrices([[0.0, 1.0], [k, 0.0]], np.ones((2, 1)), [[0.0], [1.0]], np.eye(2)) for k in (1.0, 2.0)
    ]
    law = Controller.static([[-9.0, -4.0]], measured=plants[0].measured, commands=plants[0].commands)
    assert quadratic_stability(closed_loops(plants, law)).stable is True
    mutant = Controller.static([[9.0, 4.0]], measured=plants[0].measured, commands=plants[0].commands)
    assert quadratic_stability(closed_loops(plants, mutant)).stable is False


@pytest.mark.parametrize("matrices", [[], [np.zeros((2, 3))], [np.eye(2), np.eye(3)]])
def test_what_is_no_polytope_is_refused(matrices):
    with pytest.raises(ValueError, match="matrices: expected"):
        quadratic_stability(matrices)
