"""Structured laws: known optima, patterns kept exactly, bounds, fixed modes named, the same seed the same law."""

from __future__ import annotations

import numpy as np
import pytest

from maglev_ctrl.errors import ModelError, Status
from maglev_ctrl.proofs.claims import EnergyClaim, GainClaim
from maglev_ctrl.synthesis.structured.design import local_optima, structured_design
from maglev_ctrl.synthesis.structured.feedthrough import no_feedthrough
from maglev_ctrl.synthesis.structured.fixed_modes import fixed_modes
from maglev_ctrl.synthesis.structured.objective import Limit
from maglev_ctrl.synthesis.structured.structure import Structure
from maglev_ctrl.systems.plant import Plant, closed_channel


def oscillator(stiffness=4.0, *, price=0.0):
    """Unit mass on a spring, pushed by w; velocity measured; position and command weighted."""
    return Plant.from_matrices(
        [[0.0, 1.0], [-stiffness, 0.0]], [[0.0], [1.0]], [[0.0], [1.0]], [[1.0, 0.0], [0.0, 0.0]], [[0.0, 1.0]],
        D12=[[0.0], [price]], states=("position", "velocity"), measured=("speed",), commands=("force",),
    )  # fmt: skip


def two_magnets():
    """Two unit masses joined by a spring, each with a magnet and its own two sensors."""
    K = np.array([[-1.0, 0.5], [0.5, -1.0]])
    A = np.block([[np.zeros((2, 2)), np.eye(2)], [-K, np.zeros((2, 2))]])
    B = np.vstack([np.zeros((2, 2)), np.eye(2)])
    return Plant.from_matrices(
        A, B, B, np.vstack([np.eye(4), np.zeros((2, 4))]), np.eye(4), D12=np.vstack([np.zeros((4, 2)), np.eye(2)]),
        states=("gap1", "gap2", "gap1.velocity", "gap2.velocity"), measured=("g1", "g2", "v1", "v2"),
        commands=("m1", "m2"),
    )  # fmt: skip


def test_scalar_h2_in_closed_form():
    # x' = x + w + u, z = (x, u), u = k x: norm^2 = (1 + k^2) / (2 (-k - 1)), least at k = -1 - sqrt 2.
    plant = Plant.from_matrices([[1.0]], [[1.0]], [[1.0]], [[1.0], [0.0]], D12=[[0.0], [1.0]])
    design = structured_design([plant], Structure.full(plant), objective="h2", starts=4).require()
    assert design.controller.D.item() == pytest.approx(-1.0 - np.sqrt(2.0), rel=1e-4)
    assert design.performance[0].recomputed == pytest.approx(np.sqrt(1.0 + np.sqrt(2.0)), rel=1e-8)
    assert isinstance(design.claims[1], EnergyClaim)


def test_sampled_scalar_h2_in_closed_form():
    # x+ = 2 x + w + u, z = (x, u): the regulator equation p = 1 + 4 p - (2 p)^2 / (1 + p) has p = 2 + sqrt 5.
    plant = Plant.from_matrices([[2.0]], [[1.0]], [[1.0]], [[1.0], [0.0]], D12=[[0.0], [1.0]], dt=0.5)
    design = structured_design([plant], Structure.full(plant), objective="h2", starts=4).require()
    p = 2.0 + np.sqrt(5.0)
    assert design.controller.D.item() == pytest.approx(-2.0 * p / (1.0 + p), rel=1e-4)
    assert design.performance[0].recomputed == pytest.approx(np.sqrt(p), rel=1e-8)


def test_fastest_decay_of_a_damped_oscillator_is_critical_damping():
    design = structured_design([oscillator()], Structure.full(oscillator()), objective="decay_rate", starts=4).require()
    assert design.controller.D.item() == pytest.approx(-4.0, rel=1e-4)
    assert design.performance[0].recomputed == pytest.approx(2.0, rel=1e-2)


def test_peak_of_an_oscillator_with_a_free_damper_is_its_compliance():
    # Damping above critical / sqrt 2 removes the resonance: the peak is 1 / stiffness, at rest.
    design = structured_design([oscillator()], Structure.full(oscillator()), objective="h_infinity", starts=4).require()
    assert design.performance[0].recomputed == pytest.approx(0.25, rel=1e-6)
    assert isinstance(design.claims[1], GainClaim)


def test_h2_optimal_damper_in_closed_form():
    # z = (x, price u), u = -c v: norm^2 = 1 / (2 c k) + price^2 c / 2, least at c = 1 / (price sqrt k).
    plant = oscillator(price=0.2)
    design = structured_design([plant], Structure.full(plant), objective="h2", starts=4).require()
    assert design.controller.D.item() == pytest.approx(-1.0 / (0.2 * 2.0), rel=1e-4)


def test_one_law_for_two_plants_serves_the_worse():
    # norm^2 = 1 / (2 c k) + price^2 c / 2 falls with k: the soft plant is always the worse one.
    plants = [oscillator(1.0, price=0.2), oscillator(4.0, price=0.2)]
    design = structured_design(plants, Structure.full(plants[0]), objective="h2", starts=4).require()
    assert design.controller.D.item() == pytest.approx(-1.0 / 0.2, rel=1e-4)
    assert len(design.claims[0].P) == 2


def test_pattern_and_equal_gains_are_exact():
    plant = two_magnets()
    structure = Structure.readings(plant, {"m1": ("g1", "v1"), "m2": ("g2", "v2")}, equal=True)
    for objective in ("h2", "h_infinity"):
        D = structured_design([plant], structure, objective=objective, starts=4).require().controller.D
        assert np.all(D[[0, 0, 1, 1], [1, 3, 0, 2]] == 0.0)
        assert D[0, 0] == D[1, 1] and D[0, 2] == D[1, 3]
        free = structured_design([plant], Structure.full(plant), objective=objective, starts=4).require()
        assert np.any(free.controller.D[[0, 0, 1, 1], [1, 3, 0, 2]] != 0.0)


def test_fixed_entries_and_bounds_are_kept():
    plant = two_magnets()
    mask = np.zeros((2, 4))
    mask[0, 2] = mask[1, 3] = 1.0
    fixed = np.full((2, 4), np.nan)
    fixed[0, 0] = fixed[1, 1] = -4.0
    # Dampers that take energy out: u = -c v with c >= 0, and at most 1.5, which binds.
    structure = Structure.from_mask(mask, fixed=fixed, lower=-1.5, upper=0.0)
    D = structured_design([plant], structure, objective="decay_rate", starts=5).require().controller.D
    assert D[0, 0] == D[1, 1] == -4.0
    dampers = D[[0, 1], [2, 3]]
    assert np.all((dampers >= -1.5) & (dampers <= 0.0))
    assert np.min(dampers) == -1.5


def test_a_limit_on_a_second_norm_is_kept_and_proved():
    plant = oscillator(price=0.2)
    free = structured_design([plant], Structure.full(plant), objective="h2", starts=4).require()
    decay = float(-np.max(np.linalg.eigvals(closed_channel(plant, free.controller)[0]).real))
    wanted = 1.3 * decay
    bound = structured_design(
        [plant], Structure.full(plant), objective="h2", limits=[Limit("decay_rate", wanted)], starts=4
    ).require()
    assert bound.performance[1].recomputed >= wanted
    assert bound.performance[0].recomputed > free.performance[0].recomputed
    assert bound.claims[-1].rate == wanted


@pytest.mark.parametrize("other", ["h2", "h_infinity"])
def test_a_norm_within_a_limit_that_binds(other):
    plant = oscillator(price=0.2)
    objective = "h_infinity" if other == "h2" else "h2"
    structure = Structure.full(plant)
    best = structured_design([plant], structure, objective=other, starts=4).require().performance[0].recomputed
    free = structured_design([plant], structure, objective=objective, starts=4).require()
    level = 1.02 * best
    bound = structured_design([plant], structure, objective=objective, limits=[Limit(other, level)], starts=4).require()
    assert 0.999 * level <= bound.performance[1].recomputed <= level
    assert bound.performance[0].recomputed > free.performance[0].recomputed


def test_damping_ratio_is_raised_and_its_sector_proved():
    plant = two_magnets()
    structure = Structure.readings(plant, {"m1": ("g1", "v1"), "m2": ("g2", "v2")})
    design = structured_design(
        [plant], structure, objective="h2", limits=[Limit("damping_ratio", 0.8)], starts=4
    ).require()
    poles = np.linalg.eigvals(closed_channel(plant, design.controller)[0])
    assert np.min(-poles.real / np.abs(poles)) >= 0.8


def test_law_with_a_state_of_its_own_stabilises_what_static_feedback_cannot():
    # Position only: a lead is needed.
    plant = Plant.from_matrices([[0, 1], [4, 0]], [[0], [1]], [[0], [1]], [[1, 0], [0, 0]], [[1, 0]], D12=[[0], [1]])
    static = structured_design([plant], Structure.full(plant), objective="h2", starts=4)
    assert not static.controllers
    assert static.status in (Status.ITERATION_LIMIT, Status.TIME_LIMIT)
    assert "does not prove that none exists" in static.message and "x" in static.message
    lead = structured_design([plant], Structure.full(plant, order=1), objective="h_infinity", starts=6).require()
    assert lead.controller.A.shape == (1, 1)


def test_fixed_modes_are_named():
    plant = two_magnets()
    blind = Structure.readings(plant, {"m1": ("g1",)})
    assert not fixed_modes(plant, blind)  # the spring carries the one magnet's force to the other mass
    apart = Plant.from_matrices(
        np.diag([1.0, 2.0]), np.eye(2), np.eye(2), np.eye(2), states=("front", "rear"), commands=("m1", "m2")
    )
    design = structured_design([apart], Structure.readings(apart, {"m1": ("front",)}), objective="h2", starts=4)
    assert design.status is Status.INFEASIBLE
    assert "rear" in design.message and "2 rad/s" in design.message
    crossed = structured_design(
        [apart], Structure.readings(apart, {"m1": ("rear",), "m2": ("rear",)}), objective="h2", starts=4
    )
    assert "front" in crossed.message
    seen = structured_design(
        [apart], Structure.readings(apart, {"m1": ("front",), "m2": ("rear",)}), objective="decay_rate", starts=4
    )
    assert seen.controllers


def test_a_missing_sensor_or_actuator_is_one_sentence():
    plant = two_magnets()
    with pytest.raises(ModelError, match="needs the sensor 'acceleration'"):
        Structure.readings(plant, {"m1": ("acceleration",)})
    with pytest.raises(ModelError, match="no command 'm3'"):
        Structure.readings(plant, {"m3": ("g1",)})
    unseen = Plant.from_matrices(np.diag([1.0, 2.0]), np.eye(2), np.ones((2, 1)), np.eye(2), [[1.0, 0.0]])
    design = structured_design([unseen], Structure.full(unseen), objective="h2", starts=2)
    assert "no sensor among y1 sees it" in design.message
    unmoved = Plant.from_matrices(np.diag([1.0, 2.0]), np.eye(2), [[1.0], [0.0]], np.eye(2))
    design = structured_design([unmoved], Structure.full(unmoved), objective="h2", starts=2)
    assert "no actuator among u1 moves it" in design.message


def test_an_infinite_h2_norm_is_refused_or_avoided_exactly():
    noisy = Plant.from_matrices(
        [[-1.0]], [[1.0]], [[1.0]], [[1.0], [0.0]], [[1.0], [1.0]], D12=[[0.0], [0.5]], D21=[[0.3], [0.3]]
    )
    structure = no_feedthrough(Structure.full(noisy), (noisy,))
    assert np.array_equal(np.abs(structure.basis), np.ones((1, 1, 2)))
    design = structured_design([noisy], Structure.full(noisy), objective="h2", starts=4).require()
    assert design.controller.D[0, 0] == -design.controller.D[0, 1]
    passed = Plant.from_matrices([[-1.0]], [[1.0]], [[1.0]], [[1.0]], D11=[[1.0]])
    refused = structured_design([passed], Structure.full(passed), objective="h2", starts=4)
    assert "the H2 norm is infinite" in refused.message


def test_the_same_seed_gives_the_same_law():
    plant = two_magnets()
    structure = Structure.readings(plant, {"m1": ("g1", "v1"), "m2": ("g2", "v2")})
    first, second = (local_optima([plant], structure, objective="h_infinity", starts=6, seed=5) for _ in range(2))
    assert [one.value for one in first.optima] == [one.value for one in second.optima]
    assert np.array_equal(first.best.gain, second.best.gain)
    assert first.seed == 5 and "seed 5" in first.notes[0] and "not proved to be the global optimum" in first.notes[0]


def test_misfits_are_refused():
    plant, other = oscillator(), two_magnets()
    with pytest.raises(ValueError, match="differ in measurements"):
        structured_design([plant, other], Structure.full(plant), objective="h2")
    with pytest.raises(ValueError, match="structure: expected the size"):
        structured_design([plant], Structure.full(other), objective="h2")
    with pytest.raises(ValueError, match="objective"):
        structured_design([plant], Structure.full(plant), objective="h3")
    with pytest.raises(ValueError, match="groups: expected shape"):
        Structure.from_mask(np.ones((1, 1)), groups=np.ones((2, 2)))
    with pytest.raises(ValueError, match="lower <= upper"):
        Structure.from_mask(np.ones((1, 1)), lower=1.0, upper=0.0)


def test_a_command_behind_a_lag_in_units_of_its_own_is_felt():
    # A mass of 1e5 kg, its actuator a lag in newtons: gains of 1e5 N s/m are what moves it, gains of one are not felt.
    A = np.array([[0.0, 1.0, 0.0], [-400.0, 0.01, 1e-5], [0.0, 0.0, -125.0]])
    plant = Plant.from_matrices(A, [[0.0], [1.0], [0.0]], [[0.0], [0.0], [125.0]], [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
    assert fixed_modes(plant, Structure.full(plant)) == ()
    mutant = Plant.from_matrices(A, [[0.0], [1.0], [0.0]], np.zeros((3, 1)), [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
    assert len(fixed_modes(mutant, Structure.full(mutant))) == 1
