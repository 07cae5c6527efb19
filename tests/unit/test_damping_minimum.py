"""Least certified damping against closed forms: one mass, roll-sway flutter, and the paradox of unequal damping."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from maglev_ctrl.arrays import read_only
from maglev_ctrl.errors import ModelError, Status
from maglev_ctrl.proofs.claims import DecayClaim
from maglev_ctrl.proofs.prove import prove
from maglev_ctrl.synthesis.damping.descent import pole_gradients
from maglev_ctrl.synthesis.damping.minimum import minimum_damping
from maglev_ctrl.synthesis.damping.places import DampingPlace, damped_family
from maglev_ctrl.systems import Controller, SecondOrderSystem
from maglev_ctrl.systems.plant import Plant

ROLL, SWAY = DampingPlace("roll", [1.0, 0.0]), DampingPlace("sway", [0.0, 1.0])


def _mass(m, k):
    return SecondOrderSystem.from_matrices([[m]], [[0.0]], [[k]], dofs=("heave",))


def _roll_sway(a11, a22, beta):
    side = np.sqrt(beta)
    return SecondOrderSystem.from_matrices(np.eye(2), np.zeros((2, 2)), [[a11, side], [-side, a22]])


def _routh(e, d, a11, a22, beta):
    """Damped flutter condition on roll and sway: positive where stable."""
    delta = a11 - a22
    return e * d * delta**2 + e * d * (e + d) * (e * a22 + d * a11) - (e + d) ** 2 * beta


@pytest.mark.parametrize("masses", [(2.0,), (1.0, 1.5, 3.0)])
def test_one_mass_needs_twice_mass_times_rate(masses):
    design = minimum_damping([_mass(m, 100.0) for m in masses], [DampingPlace("leg", [1.0])], rate=0.8, starts=2)
    exact = 2.0 * max(masses) * 0.8
    assert exact <= design.cost <= exact * 1.005
    assert design.lower_bound == pytest.approx(exact)
    assert all(proof.holds for proof in design.synthesis.proofs)


def test_a_rate_beyond_the_reach_of_damping_is_refused_with_the_reason():
    """A mass decays at sqrt(k / m) at most; and more damping makes it creep: c <= m (rate + k / (m rate))."""
    design = minimum_damping([_mass(1.0, 1.0)], [DampingPlace("leg", [1.0])], rate=1.2, starts=2)
    assert design.carried is None and not design.synthesis.controllers
    assert "no damping was found that decays at 1.2" in design.reason
    both = minimum_damping([_mass(1.0, 1.0), _mass(4.0, 16.0)], [DampingPlace("leg", [1.0])], rate=0.9, starts=2)
    assert both.synthesis.status is Status.INFEASIBLE  # one needs 7.2, the other bears 2.01
    with pytest.raises(ModelError, match=r"decays at 0\.9"):
        both.require()


def test_limits_too_low_are_told_by_the_sum_of_the_poles():
    design = minimum_damping([_mass(2.0, 8.0)], [DampingPlace("leg", [1.0], limit=1.0)], rate=0.5)
    assert "the sum of the poles forbids it" in design.reason


def test_roll_sway_flutter_against_the_closed_form():
    a11, a22, beta = 100.0, 104.0, 144.0

    def total(ratio):  # e + d on the stability boundary at d / e = ratio
        need = (1.0 + ratio) ** 2 / ratio * beta - (a11 - a22) ** 2
        return (1.0 + ratio) * np.sqrt(max(need, 0.0) / ((1.0 + ratio) * (a22 + ratio * a11)))

    exact = minimize_scalar(total, bounds=(0.2, 5.0), method="bounded", options={"xatol": 1e-10}).fun
    equal = 2.0 * np.sqrt((4.0 * beta - (a11 - a22) ** 2) / (2.0 * (a11 + a22)))
    assert exact <= equal
    design = minimum_damping([_roll_sway(a11, a22, beta)], [ROLL, SWAY], rate=0.0, starts=3)
    assert exact <= design.cost <= exact * 1.002
    assert _routh(*design.damping, a11, a22, beta) > 0.0
    assert _routh(*(0.995 * design.damping), a11, a22, beta) < 0.0
    # one place alone never holds flutter: beta > 0 and one of e, d zero
    single = minimum_damping([_roll_sway(a11, a22, beta)], [ROLL], rate=0.0, starts=2)
    assert single.carried is None and "no damping was found" in single.reason


@pytest.mark.slow
def test_more_damping_at_one_place_destabilises_and_is_told():
    a11, a22, beta = 100.0, 125.0, 144.0  # stable undamped: 625 > 4 beta; lost where (1 + r)^2 / r exceeds 625 / beta
    design = minimum_damping([_roll_sway(a11, a22, beta)], [ROLL, SWAY], rate=1e-3, starts=3)
    assert design.carried == "any variation"
    by_place = {more.place: more for more in design.more}
    assert by_place["every place"].proved
    e, d = design.damping
    for place, factors in (("roll", (1.0, 0.0)), ("sway", (0.0, 1.0))):
        told = by_place[place].unstable_at
        grid = [x for x in (1.05, 1.1, 1.2, 1.5, 2.0, 3.0, 5.0, 10.0)
                if _routh(e * x ** factors[0], d * x ** factors[1], a11, a22, beta) <= 0.0]  # fmt: skip
        assert told == (grid[0] if grid else np.inf)
    assert min(by_place["roll"].unstable_at, by_place["sway"].unstable_at) < 10.0
    assert any("destabilises" in sentence for sentence in design.warnings)


def test_a_damping_ratio_of_one_mass():
    """c = 2 zeta sqrt(k m), proved by a sector."""
    design = minimum_damping([_mass(2.0, 8.0)], [DampingPlace("leg", [1.0])], rate=0.0, ratio=0.3, starts=2)
    assert 2.4 <= design.cost <= 2.4 * 1.002
    assert any("damping ratio" in proof.statement and proof.holds for proof in design.synthesis.proofs)


@pytest.mark.slow
def test_one_matrix_for_any_variation_costs_more_and_holds_between_the_vertices():
    vertices = [_roll_sway(100.0, 104.0, 144.0), _roll_sway(100.0, 120.0, 64.0)]
    free = minimum_damping(vertices, [ROLL, SWAY], rate=0.5, starts=2)
    fast = minimum_damping(vertices, [ROLL, SWAY], rate=0.5, guarantee="any variation", starts=2)
    assert fast.carried == "any variation" and free.carried == "each vertex"
    assert fast.cost > free.cost
    P = fast.synthesis.claims[-1].P[0]
    loops = damped_family(vertices, [ROLL, SWAY]).loops(fast.damping)
    for weight in np.linspace(0.0, 1.0, 11):
        A = weight * loops[0] + (1.0 - weight) * loops[1]
        assert np.max(np.linalg.eigvalsh(A.T @ P + P @ A + P)) < 0.0
    less = [fast.synthesis.plants, [Controller.static(-np.diag(0.7 * fast.damping), measured=law.measured,
            commands=law.commands) for law in fast.synthesis.controllers]]  # fmt: skip
    assert not prove(fast.synthesis.claims[-1], *less).holds


@pytest.mark.slow
def test_every_constant_blend_is_proved_where_the_cheapest_damping_is_not():
    """Two masses in heave, light and loaded: the cheapest vertex-wise damping carries no proof between them."""
    K, places = np.array([[75e4, -75e4], [-75e4, 375e4]]), [DampingPlace("leg", [1.0, -1.0])]
    vertices = [
        SecondOrderSystem.from_matrices(np.diag([m, 6e3]), np.diag([0.0, -250.0 + c]), K)
        for m, c in ((24e3, 0.0), (29e3, 0.0), (29e3, 200.0), (24e3, 200.0))
    ]
    cheapest = minimum_damping(vertices, places, rate=0.1, starts=2)
    design = minimum_damping(vertices, places, rate=0.1, starts=2, guarantee="every constant blend")
    assert design.carried in ("every constant blend", "any variation") and cheapest.carried == "each vertex"
    assert design.cost >= cheapest.cost * (1.0 - 1e-6)
    loops = damped_family(vertices, places).loops(design.damping)
    for weights in np.random.default_rng(1).dirichlet(np.ones(4), 40):
        assert np.max(np.linalg.eigvals(np.tensordot(weights, loops, 1)).real) < -0.1


def test_proofs_catch_swapped_dampings_and_turned_signs():
    vertices = [_roll_sway(100.0, 118.0, 144.0)]
    design = minimum_damping(vertices, [ROLL, replace(SWAY, cost=4.0)], rate=0.2, starts=3)
    law, claim = design.synthesis.controller, design.synthesis.claims[0]
    assert isinstance(claim, DecayClaim) and prove(claim, design.synthesis.plants, [law]).holds
    for mutant in (-law.D, 0.8 * law.D, np.diag([law.D[0, 0], 0.0])):
        broken = Controller.static(mutant, measured=law.measured, commands=law.commands)
        assert not prove(claim, design.synthesis.plants, [broken]).holds


def test_gradients_agree_with_differences():
    vertices = [_roll_sway(100.0, 104.0, 144.0), _roll_sway(90.0, 120.0, 30.0)]
    family, c = damped_family(vertices, [ROLL, SWAY]), np.array([1.7, 0.6])
    values, slopes = pole_gradients(family, c)
    for j in range(2):
        step = 1e-6 * np.eye(2)[j]
        for sign in (1.0, -1.0):
            moved, _ = pole_gradients(family, c + sign * step)
            nearest = np.argmin(np.abs(moved[:, None, :] - values[:, :, None]), axis=-1)
            change = np.take_along_axis(moved, nearest, axis=-1) - values
            assert np.allclose(change, sign * 1e-6 * slopes[..., j], atol=1e-10)


def test_plants_with_ports_give_the_same_damping():
    plants = []
    for m, k in ((1.0, 90.0), (3.0, 100.0)):
        plants.append(
            Plant.from_matrices([[0.0, 1.0], [-k / m, 0.0]], [[0.0], [1.0]], [[0.0], [1.0 / m]], [[1.0, 0.0]],
                                [[0.0, 1.0]], commands=("leg",), measured=("rate",))
        )  # fmt: skip
    design = minimum_damping(plants, [DampingPlace("leg", port=("leg", "rate"))], rate=0.8, starts=2)
    assert 4.8 <= design.cost <= 4.8 * 1.005


def test_a_mode_that_no_damper_moves_with_is_named():
    with pytest.raises(ModelError, match=r"no damper moves with the mode .*q2"):
        damped_family([SecondOrderSystem.from_matrices(np.eye(2), np.zeros((2, 2)), np.diag([4.0, 9.0]))], [ROLL])


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"rate": -1.0}, "rate: expected"),
        ({"ratio": 1.0}, "ratio: expected"),
        ({"guarantee": "surely"}, "guarantee: expected"),
    ],
)
def test_refusals(change, words):
    with pytest.raises(ValueError, match=words):
        minimum_damping([_mass(1.0, 1.0)], [DampingPlace("leg", [1.0])], **{"rate": 0.1, **change})


def test_places_are_checked():
    with pytest.raises(ValueError, match="either a direction or a port"):
        DampingPlace("leg")
    with pytest.raises(ValueError, match="cost: expected a positive"):
        DampingPlace("leg", [1.0], cost=0.0)
    with pytest.raises(ValueError, match="'leg' is given twice"):
        damped_family([_mass(1.0, 1.0)], [DampingPlace("leg", [1.0]), DampingPlace("leg", [1.0])])
    with pytest.raises(ValueError, match="expected 1 numbers"):
        damped_family([_mass(1.0, 1.0)], [DampingPlace("leg", read_only([1.0, 0.0], name="b"))])
