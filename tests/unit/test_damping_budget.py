"""Cost of damping against certified margin."""

import numpy as np
import pytest

from maglev_ctrl.errors import Agreement
from maglev_ctrl.synthesis.damping.budget import damping_budget
from maglev_ctrl.synthesis.damping.places import DampingPlace
from maglev_ctrl.systems import SecondOrderSystem


def _two_masses(coupling):
    K = np.array([[40.0, -coupling], [-coupling, 90.0]])
    return SecondOrderSystem.from_matrices(np.diag([1.0, 3.0]), np.zeros((2, 2)), K, dofs=("car", "bogie"))


CAR, BOGIE = DampingPlace("car", [1.0, 0.0]), DampingPlace("bogie", [0.0, 1.0], cost=2.0)


def test_uncoupled_masses_cost_the_sum_and_neither_place_does_it_alone():
    """Each mass needs 2 m rate: cost = 2 (1 + 2 * 3) rate = 14 rate, up to the slower mass's own frequency."""
    budget = damping_budget([_two_masses(0.0)], [CAR, BOGIE], margins=[0.5, 1.0, 2.0, 6.0], starts=3)
    curve = budget.together
    assert curve.certified.tolist() == [True, True, True, False]
    exact = 14.0 * curve.margin[:3]
    assert np.all(curve.cost[:3] >= exact) and np.allclose(curve.cost[:3], exact, rtol=3e-3)
    assert np.allclose(curve.damping[:3], np.outer(curve.margin[:3], [2.0, 6.0]), rtol=1e-2)
    assert np.allclose(curve.marginal[:3], 14.0, rtol=1e-2) and np.isnan(curve.marginal[3])
    assert np.all(curve.lower_bound[:3] <= curve.cost[:3])
    assert "no damping was found" in curve.reasons[3] and curve.best_margin == 2.0
    for alone, other in zip(budget.alone, ("bogie", "car"), strict=True):
        assert not alone.certified.any() and alone.status[0] is Agreement.UNRESOLVED
        assert "does not act on the mode" in alone.reasons[0] and other in alone.reasons[0]
        assert np.isnan(alone.best_margin)


def test_coupled_masses_have_a_curve_for_each_place_and_both_are_cheaper():
    budget = damping_budget([_two_masses(25.0), _two_masses(20.0)], [CAR, BOGIE], margins=[0.1, 0.3], starts=3)
    together = budget.together
    assert together.certified.all() and np.all(np.diff(together.cost) > 0.0)
    for alone in budget.alone:
        kept = alone.certified
        assert kept.any() and np.all(alone.cost[kept] >= together.cost[kept] * (1.0 - 1e-3))
    for design in budget.designs:
        assert all(proof.holds for proof in design.synthesis.proofs)
        assert np.max(np.linalg.eigvals(design.synthesis.plants[0].A).real) > -1e-12  # undamped without them


def test_damping_ratio_as_the_margin():
    mass = SecondOrderSystem.from_matrices([[2.0]], [[0.0]], [[8.0]])
    budget = damping_budget(
        [mass], [DampingPlace("leg", [1.0])], margins=[0.1, 0.5], quantity="damping ratio", starts=2
    )
    assert np.allclose(budget.together.cost, [0.8, 4.0], rtol=2e-3)


@pytest.mark.parametrize(
    ("change", "words"), [({"margins": [1.0, 0.5]}, "margins: expected rising"), ({"quantity": "gain"}, "quantity: ")]
)
def test_refusals(change, words):
    with pytest.raises(ValueError, match=words):
        damping_budget([_two_masses(0.0)], [CAR, BOGIE], **{"margins": [1.0], **change})


def test_damping_that_hardly_moves_the_worst_pole_is_found_all_the_same():
    # A car on a soft spring over a stiffly held bogie: the damper below the bogie moves the car's pole by little per
    # N s/m. Brute force over one number is the other method.
    masses, soft, stiff = np.diag([24e3, 6e3]), 0.75e6, 3.0e6
    vehicle = SecondOrderSystem.from_matrices(masses, np.zeros((2, 2)), [[soft, -soft], [-soft, soft + stiff]])
    direction = np.array([0.0, 1.0])

    def slowest(c):
        C = c * np.outer(direction, direction)
        A = np.block(
            [[np.zeros((2, 2)), np.eye(2)], [-np.linalg.solve(masses, vehicle.K), -np.linalg.solve(masses, C)]]
        )
        return -float(np.max(np.linalg.eigvals(A).real))

    grid = np.geomspace(1e3, 1e7, 4000)
    decays = np.array([slowest(c) for c in grid])
    budget = damping_budget([vehicle], [DampingPlace("below", direction)], margins=[0.1, 0.25, 0.4])
    for wanted, cost in zip(budget.together.margin, budget.together.cost, strict=True):
        enough = grid[decays >= wanted]
        if enough.size:
            assert cost == pytest.approx(enough[0], rel=6e-3)  # the grid's step and the reserve of the search
        else:
            assert np.isnan(cost)
    assert np.isfinite(budget.together.cost[:2]).all() and np.isnan(budget.together.cost[2])
