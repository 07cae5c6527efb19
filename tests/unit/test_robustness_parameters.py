"""Uncertain parameters pulled out of a closed loop: the linear fractional form against the model assembled again."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from two_stage_vehicle import PARAMETERS, law, two_stages

from maglev_ctrl.analysis.robustness import (
    UncertainLoop,
    UncertainParameter,
    parameter_share,
    perturbed_system,
    uncertain_loop,
)
from maglev_ctrl.analysis.robustness.uncertain_loop import rank_factors
from maglev_ctrl.forces import Electromagnet
from maglev_ctrl.systems import SecondOrderSystem, close_loop
from maglev_ctrl.vehicle import Body, Magnet, OperatingPoint, Vehicle, linearize


def differs(loop: UncertainLoop, plant: SecondOrderSystem, changes: np.ndarray) -> float:
    """Largest difference of the two state matrices, entry by entry, relative to rows' sizes."""
    again = close_loop(perturbed_system(plant, PARAMETERS, changes * loop.spreads), law()).state_matrix()
    size = np.max(np.abs(again), axis=1)[:, None]
    return float(np.max(np.abs(loop.state_matrix(changes) - again) / size))


def test_closing_the_form_gives_the_model_assembled_again() -> None:
    plant = two_stages()
    loop = uncertain_loop(plant, law(), PARAMETERS)
    assert loop.blocks == (2, 2, 3, 6, 2, 2, 8)  # two heaves; roll and pitch; ...; two Pade forms of order four
    assert loop.spreads[-1] == pytest.approx(0.25)  # 1 ms of 4 ms
    rng = np.random.default_rng(3)
    for changes in (np.zeros(7), *rng.uniform(-1.0, 1.0, (6, 7))):
        assert differs(loop, plant, changes) < 1e-12
    # mutants: a sign in one share; a mass that enters without its inverse
    wrong = replace(loop, B=loop.B * np.repeat([1.0, 1.0, 1.0, -1.0, 1.0, 1.0, 1.0], loop.blocks))
    first_order = replace(loop, D=np.zeros_like(loop.D))
    for mutant in (wrong, first_order):
        assert differs(mutant, plant, np.full(7, 0.5)) > 1e-4


def test_the_changes_are_those_of_another_vehicle() -> None:
    """Not through shares at all: the vehicle is built with other numbers and linearised."""
    plant = two_stages()
    chosen = (
        UncertainParameter("load", "payload", 0.2, ("car",)),
        UncertainParameter("springs", "stiffness", 0.1, ("s0", "s1", "s2", "s3")),
        UncertainParameter("lag", "actuator_lag", 0.3),
        UncertainParameter("delay", "actuator_delay", 0.5),
    )
    loop = uncertain_loop(plant, law(), chosen)
    other = two_stages(car=1.1, stiffness=0.95, lag=1.15, delay=0.75)
    # The car's yaw inertia stays; it has no yaw freedom here.
    A, B = loop.state_matrix([0.5, -0.5, 0.5, -0.5]), close_loop(other, law()).state_matrix()
    assert np.max(np.abs(A - B) / np.max(np.abs(B), axis=1)[:, None]) < 1e-9
    C = loop.state_matrix([0.5, 0.5, 0.5, -0.5])  # mutant: a spring that stiffens
    assert np.max(np.abs(C - B) / np.max(np.abs(B), axis=1)[:, None]) > 1e-4


def test_magnetic_force_scales_stiffness_and_force_per_current() -> None:
    coil = Electromagnet.for_lift(500.0 * 9.81, 0.01, turns=300, pole_area=0.03, resistance=1.0)
    vehicle = Vehicle("car", (Body("car", 500.0),), magnets=(Magnet("lift", "car", force=coil),), reference_height=0.01,
                      gravity=9.81)  # fmt: skip
    plant = linearize(vehicle, OperatingPoint(0.0, 0.01))
    share = parameter_share(plant, UncertainParameter("magnets", "magnetic_force", 0.05))
    assert pytest.approx(plant.K) == share.K
    assert pytest.approx(plant.F) == share.F
    assert share.K[0, 0] < 0.0
    assert not np.any(share.M)


def test_rank_factors_are_exact_and_small() -> None:
    rng = np.random.default_rng(1)
    wild = np.diag([1e6, 1.0, 1e-6]) @ rng.normal(size=(3, 2)) @ rng.normal(size=(2, 4)) @ np.diag([1e3, 1, 1e-3, 1])
    left, right = rank_factors(wild)
    assert left.shape[1] == 2
    assert np.allclose(left @ right, wild, rtol=1e-9, atol=0.0)


def test_recentred_and_along() -> None:
    loop = uncertain_loop(two_stages(), law(), PARAMETERS)
    rng = np.random.default_rng(2)
    centre, half, changes = rng.uniform(-0.5, 0.5, 7), rng.uniform(0.1, 0.5, 7), rng.uniform(-1.0, 1.0, 7)
    moved = loop.recentred(centre, half).state_matrix(changes)
    there = loop.state_matrix(centre + half * changes)
    assert np.max(np.abs(moved - there)) < 1e-12 * np.max(np.abs(there))
    assert np.max(np.abs(loop.along(changes).state_matrix([0.5]) - loop.state_matrix(0.5 * changes))) < 1e-8


@pytest.mark.parametrize(
    ("parameter", "message"),
    [
        (UncertainParameter("x", "mass", 0.1, ("nobody",)), "no share"),
        (UncertainParameter("x", "magnetic_force", 0.1), "changes nothing"),
        (UncertainParameter("x", "actuator_lag", 0.1, ("s0",)), "no actuator"),
    ],
)
def test_parameters_that_do_not_fit_are_refused(parameter: UncertainParameter, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        uncertain_loop(two_stages(), law(), [parameter])


def test_wrong_descriptions_are_refused() -> None:
    plant = two_stages()
    with pytest.raises(ValueError, match="spread"):
        UncertainParameter("x", "mass", 0.0)
    with pytest.raises(ValueError, match="unit"):
        UncertainParameter("x", "mass", 0.1, unit="s")
    twice = [UncertainParameter("x", "actuator_lag", 0.1), UncertainParameter("y", "actuator_lag", 0.1, ("a1",))]
    with pytest.raises(ValueError, match="slowed twice"):
        uncertain_loop(plant, law(), twice)
    with pytest.raises(ValueError, match="distinct"):
        uncertain_loop(plant, law(), [twice[0], twice[0]])
    with pytest.raises(ValueError, match="cannot fall to zero"):
        perturbed_system(plant, twice[:1], [-1.0])
