"""Integral action: constant loads leave no error, the cost is found again, outputs with a zero at s = 0 are refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from maglev_ctrl.errors import Status
from maglev_ctrl.synthesis.integral_action import Integral, lqi
from maglev_ctrl.synthesis.sampling import sampled
from maglev_ctrl.systems import Controller
from maglev_ctrl.systems.plant import Plant, closed_channel

STATES = ("gap", "speed", "current")


def _plant(*, measured=None, sensors=None, noise=None, B1=((0.0,), (1.0,), (0.0,))):
    return Plant.from_matrices(
        [[0.0, 1.0, 0.0], [100.0, 0.0, -10.0], [0.0, 5.0, -20.0]], B1, [[0.0], [0.0], [20.0]],
        [[10.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 0.0]], sensors, D12=[[0.0], [0.0], [0.1]], D21=noise,
        states=STATES, commands=("voltage",), measured=measured, performance=("gap 10", "speed 1", "price"),
    )  # fmt: skip


def _with_sensor():
    return _plant(
        measured=("gap",), sensors=[[1.0, 0.0, 0.0]], noise=[[0.0, 1e-3]], B1=[[0.0, 0.0], [1.0, 0.0], [0.0, 0.0]]
    )


def _steady(design):
    """Steady z for a unit constant disturbance (the first)."""
    plant = design.plants[0]
    A, B, C, D = closed_channel(plant, design.controller)
    shift = np.eye(len(A)) if plant.dt is not None else np.zeros_like(A)
    return (C @ np.linalg.solve(shift - A, B) + D)[:, 0]


@pytest.mark.parametrize("make", [_plant, _with_sensor])
@pytest.mark.parametrize("dt", [None, 0.005])
def test_a_constant_load_leaves_no_error(make, dt):
    plant = make() if dt is None else sampled(make(), dt)
    if dt is not None and make is _with_sensor:
        plant = sampled(make(), dt, disturbances="white")
    design = lqi(plant, [Integral("gap", 0.001)])
    assert design.status is Status.SOLVED, design.message
    assert all(proof.holds for proof in design.proofs)
    steady = _steady(replace(design, plants=(sampled(make(), dt),))) if dt is not None else _steady(design)
    assert abs(steady[0]) < 1e-9  # ten times the gap
    one = design.performance[0]
    assert one.recomputed == pytest.approx(one.reported, rel=1e-7)


def test_without_the_integral_the_load_leaves_an_error():
    design = lqi(_plant(), [Integral("gap", 1e9)])
    law = design.controller
    static = replace(design, controllers=(Controller.static(law.D, measured=law.measured, commands=law.commands),))
    assert abs(_steady(static)[0]) > 1e-3


def test_a_performance_output_may_be_integrated_where_all_states_are_measured():
    design = lqi(_plant(), [Integral("gap 10", 0.01)])
    assert design.status is Status.SOLVED
    assert abs(_steady(design)[0]) < 1e-9
    np.testing.assert_array_equal(design.controller.B, [[10.0, 0.0, 0.0]])


def test_an_output_that_holds_the_command_is_integrated_too():
    plant = _plant()
    design = lqi(plant, [Integral("price", 0.1)])  # 0.1 x the command itself returns to zero
    assert design.status is Status.SOLVED
    assert abs(_steady(design)[2]) < 1e-9


@pytest.mark.parametrize("dt", [None, 0.005])
def test_units_of_the_states_do_not_matter(dt):
    plant = _plant()
    unit = np.array([1e-4, 1e2, 1e6])
    other = replace(
        plant, A=plant.A * unit / unit[:, None], B1=plant.B1 / unit[:, None], B2=plant.B2 / unit[:, None],
        C1=plant.C1 * unit,
    )  # fmt: skip
    pair = [one if dt is None else sampled(one, dt) for one in (plant, other)]
    found = [lqi(one, [Integral("gap", limit)]) for one, limit in zip(pair, (1e-3, 1e1), strict=True)]
    assert [one.status for one in found] == [Status.SOLVED, Status.SOLVED], found[1].message
    np.testing.assert_allclose(found[1].controller.D / unit, found[0].controller.D, rtol=1e-9)


def test_a_zero_at_the_origin_is_refused_with_the_output_named():
    design = lqi(_plant(), [Integral("speed", 1.0)])  # the speed of a gap that stays bounded ends at zero
    assert design.controllers == ()
    assert design.message.startswith("the integral of speed cannot be steered: the commands voltage have no steady")
    assert "s = 0" in design.message
    at_samples = lqi(sampled(_plant(), 0.01), [Integral("speed", 1.0)])
    assert "z = 1" in at_samples.message


def test_more_integrals_than_commands_are_refused():
    design = lqi(_plant(), [Integral("gap", 1.0), Integral("current", 1.0)])
    assert "cannot be steered together" in design.message
    assert "2 integrals for 1 command(s)" in design.message


def test_a_mode_that_no_command_moves_is_named():
    plant = Plant.from_matrices(
        np.diag([1.0, -1.0]), np.eye(2), [[0.0], [1.0]], np.eye(3, 2), D12=[[0.0], [0.0], [1.0]],
        states=("tilt", "heave"), commands=("coil",),
    )  # fmt: skip
    assert lqi(plant, [Integral("heave", 1.0)]).message == "the commands coil cannot move the mode at 1 rad/s (tilt)"


def test_missing_noise_and_price_are_said():
    quiet = replace(_with_sensor(), D21=np.zeros((1, 2)))
    assert "measurement without noise" in lqi(quiet, [Integral("gap", 1.0)]).message
    free = replace(_plant(), D12=np.zeros((3, 1)))
    assert "command without a price" in lqi(free, [Integral("gap", 1.0)]).message


@pytest.mark.parametrize(
    ("integrals", "words"),
    [
        ([], "at least one"),
        ([Integral("gap", 1.0), Integral("gap", 1.0)], "twice"),
        ([Integral("height", 1.0)], "not measured; there are gap"),
        ([Integral("gap", 0.0)], "positive acceptable"),
    ],
)
def test_wrong_use_is_named(integrals, words):
    with pytest.raises(ValueError, match=words):
        lqi(_plant(), integrals)
