"""H-infinity synthesis: closed forms, laws that keep their bound, limit cases said in words, mutants."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from maglev_ctrl.analysis.norms import h_infinity_norm
from maglev_ctrl.errors import ModelError, Status
from maglev_ctrl.synthesis.h_infinity import (
    h_infinity_output_feedback,
    h_infinity_state_feedback,
    h_infinity_synthesis,
    limit_words,
)
from maglev_ctrl.synthesis.h_infinity_central import central_controller, couple, normal_form
from maglev_ctrl.synthesis.h_infinity_game import Channel, solve_game
from maglev_ctrl.synthesis.h_infinity_laws import continuous_plant, sampled_equivalent
from maglev_ctrl.synthesis.h_infinity_search import LARGEST, Trial, infimum
from maglev_ctrl.systems import Controller
from maglev_ctrl.systems.plant import Plant, closed_channel


def _scalar(a, b=1.0, **more):
    return Plant.from_matrices([[a]], [[1.0]], [[b]], [[1.0], [0.0]], D12=[[0.0], [1.0]], **more)


def _general(seed, sizes, *, dt=None):
    n, m1, m2, p1, p2 = sizes
    draw = np.random.default_rng(seed).standard_normal
    A = draw((n, n)) * (1.0 if dt is None else 0.6)
    return Plant.from_matrices(
        A, draw((n, m1)), draw((n, m2)), draw((p1, n)), draw((p2, n)), D11=draw((p1, m1)), D12=draw((p1, m2)),
        D21=draw((p2, m1)), D22=draw((p2, m2)), dt=dt,
    )  # fmt: skip


@pytest.mark.parametrize("a", [-3.0, -0.5, 0.0, 2.0])
@pytest.mark.parametrize("b", [0.3, 1.0, 5.0])
def test_scalar_state_feedback(a, b):
    # 2 a X + 1 = (b^2 - 1/gamma^2) X^2: X > 0 ends at gamma = 1/b (a >= 0) or where both roots meet (a < 0).
    expected = 1.0 / b if a >= 0.0 else 1.0 / np.hypot(a, b)
    design = h_infinity_state_feedback(_scalar(a, b))
    assert design.infimum == pytest.approx(expected, rel=1e-6)
    assert design.gamma == pytest.approx(1.02 * expected, rel=1e-6)
    if a != 0.0:  # there both limits meet
        assert design.limit == ("growth of X" if a > 0.0 else "frequency")
    assert design.norm <= design.gamma
    gain = design.controller.D[0, 0]
    # The closed loop x' = (a + b k) x + w, z = [x, k x] peaks at rest.
    assert design.norm == pytest.approx(np.sqrt(1.0 + gain**2) / abs(a + b * gain), rel=1e-9)


def test_scalar_output_feedback():
    # z = [x; u], y = x + v: X = Y, and the coupling X Y < gamma^2 ends at gamma with X(gamma) = gamma.
    a = 1.0
    plant = Plant.from_matrices(
        [[a]], [[1.0, 0.0]], [[1.0]], [[1.0], [0.0]], [[1.0]], D12=[[0.0], [1.0]], D21=[[0.0, 1.0]]
    )
    # gamma = X: 2 a g + 1 = (1 - 1/g^2) g^2 = g^2 - 1, so g = a + sqrt(a^2 + 2)
    design = h_infinity_output_feedback(plant)
    assert design.infimum == pytest.approx(a + np.sqrt(a**2 + 2.0), rel=1e-6)
    assert design.limit == "coupling of control and estimation"
    assert design.synthesis.status is Status.SOLVED


def test_static_plant_is_bounded_by_its_feedthrough():
    plant = Plant.from_matrices(
        [[-1.0]], [[0.0, 0.0]], [[1.0]], [[1.0], [0.0]], D11=[[3.0, 0.0], [0.0, 0.0]], D12=[[0.0], [1.0]]
    )
    design = h_infinity_state_feedback(plant)
    assert design.infimum == pytest.approx(3.0, rel=1e-6)
    assert design.limit == "feedthrough"


@pytest.mark.parametrize("sizes", [(4, 3, 2, 3, 1), (5, 2, 2, 4, 2), (3, 2, 1, 1, 2), (6, 4, 2, 4, 3), (4, 1, 1, 3, 1)])
@pytest.mark.parametrize("dt", [None, 0.1])
def test_general_feedthroughs(sizes, dt):
    plant = _general(11, sizes, dt=dt)
    design = h_infinity_output_feedback(plant, curve=())
    assert design.synthesis.status is Status.SOLVED, design.synthesis.message
    assert design.norm <= design.gamma == pytest.approx(1.02 * design.infimum)
    # Nothing but the coupling or a game at its end: a law made close to the infimum comes close to it.
    near = h_infinity_output_feedback(plant, gamma=1.001 * design.infimum, curve=())
    if near.synthesis.controllers:
        assert design.infimum * (1.0 - 1e-6) <= near.norm <= 1.001 * design.infimum * (1.0 + 1e-6)


def test_output_feedback_of_the_dual_plant_has_the_same_infimum():
    plant = _general(5, (4, 3, 2, 3, 2))
    dual = Plant.from_matrices(
        plant.A.T, plant.C1.T, plant.C2.T, plant.B1.T, plant.B2.T,
        D11=plant.D11.T, D12=plant.D21.T, D21=plant.D12.T, D22=plant.D22.T,
    )  # fmt: skip
    first, second = (h_infinity_output_feedback(one, curve=()).infimum for one in (plant, dual))
    assert first == pytest.approx(second, rel=1e-6)


@pytest.mark.slow
def test_sampled_state_feedback_by_semidefinite_programming():
    cvxpy = pytest.importorskip("cvxpy")
    plant = _general(2, (3, 2, 1, 3, 1), dt=0.5)
    n, m, p = 3, 2, 3
    Q, L, level = cvxpy.Variable((n, n), symmetric=True), cvxpy.Variable((1, n)), cvxpy.Variable()
    move, out = plant.A @ Q + plant.B2 @ L, plant.C1 @ Q + plant.D12 @ L
    matrix = cvxpy.bmat([
        [Q, np.zeros((n, m)), move.T, out.T],
        [np.zeros((m, n)), level * np.eye(m), plant.B1.T, plant.D11.T],
        [move, plant.B1, Q, np.zeros((n, p))],
        [out, plant.D11, np.zeros((p, n)), level * np.eye(p)],
    ])  # fmt: skip
    problem = cvxpy.Problem(cvxpy.Minimize(level), [0.5 * (matrix + matrix.T) >> 0])
    problem.solve(solver="CLARABEL")
    design = h_infinity_state_feedback(plant)
    assert design.synthesis.status is Status.SOLVED
    assert design.infimum == pytest.approx(float(level.value), rel=1e-5)


def test_bilinear_transformation_keeps_the_norm_and_returns():
    plant = _general(4, (4, 2, 1, 2, 1), dt=0.2)
    there = continuous_plant(plant)
    A = 0.9 * plant.A / np.max(np.abs(np.linalg.eigvals(plant.A)))
    stable = replace(plant, A=A)
    there = continuous_plant(stable)
    sampled = h_infinity_norm(stable.A, stable.B1, stable.C1, stable.D11, dt=0.2)
    continuous = h_infinity_norm(there.A, there.B1, there.C1, there.D11)
    assert sampled.value == pytest.approx(continuous.value, rel=1e-9)
    back = sampled_equivalent(there.A, there.B1, there.C1, there.D11, 0.2)
    for found, given in zip(back, (stable.A, stable.B1, stable.C1, stable.D11), strict=True):
        np.testing.assert_allclose(found, given, atol=1e-12)


def test_gain_bound_raises_gamma_or_refuses():
    plant = _scalar(2.0)
    free = h_infinity_state_feedback(plant)
    bound = 0.3 * abs(float(free.controller.D[0, 0]))
    held = h_infinity_state_feedback(plant, gain_bound=bound)
    assert abs(float(held.controller.D[0, 0])) <= bound
    assert held.gamma > free.gamma
    assert "to keep the gain below" in " ".join(held.synthesis.notes)
    refused = h_infinity_state_feedback(plant, gain_bound=1.9)  # x' = 2 x needs more than 2
    assert refused.synthesis.status is Status.INFEASIBLE
    assert "allow more gain" in refused.synthesis.message
    with pytest.raises(ModelError, match="no law with a gain below"):
        _ = refused.controller


def test_curve_falls_with_distance_from_the_infimum():
    curve = h_infinity_state_feedback(_scalar(1.0)).curve
    assert np.all(np.diff(curve.gamma) > 0.0)
    assert np.all(np.diff(curve.gain) < 0.0)


def test_a_level_below_the_infimum_is_refused():
    design = h_infinity_state_feedback(_scalar(1.0), gamma=0.99)
    assert design.synthesis.status is Status.INFEASIBLE
    assert not design.synthesis.controllers
    assert "none of this kind stays below 1" in design.synthesis.message
    assert design.synthesis.message.endswith(f"what ends the range: {limit_words(design.limit)}")


def test_nearness_to_the_least_level_is_told_in_words():
    (told,) = h_infinity_state_feedback(_scalar(1.0), back_off=1.05).synthesis.notes
    assert (
        told.startswith("no law of this kind stays below ") and "made for 1.05 (5 % above, for smaller gains)" in told
    )
    assert 0.999 <= float(told.split(" below ")[1].split(";")[0]) <= 1.0
    assert all(
        ": " not in limit_words(name) for name in ("estimation: frequency", "control: growth of X", "feedthrough")
    )


def test_unmovable_and_unseen_modes_are_named():
    stuck = Plant.from_matrices(
        np.diag([1.0, -1.0]), np.eye(2), [[0.0], [1.0]], np.eye(2), states=("drift", "lag")
    )  # fmt: skip
    design = h_infinity_state_feedback(stuck)
    assert design.synthesis.status is Status.INFEASIBLE
    assert "cannot move the mode at 1 rad/s (drift)" in design.synthesis.message
    unseen = Plant.from_matrices(
        np.diag([1.0, -1.0]), np.eye(2), np.eye(2), np.eye(2), [[0.0, 1.0]], states=("drift", "lag")
    )
    design = h_infinity_output_feedback(unseen)
    assert "do not see the mode at 1 rad/s (drift)" in design.synthesis.message
    sampled = replace(unseen, dt=0.1, A=np.diag([1.5, 0.5]))
    assert "do not see the mode at 1.5 (drift)" in h_infinity_output_feedback(sampled).synthesis.message


def test_singular_plants_are_enlarged_in_the_open():
    cheap = Plant.from_matrices([[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]], [[0.0], [1.0]], [[1.0, 0.0]])
    design = h_infinity_state_feedback(cheap, curve=())
    told = " ".join(design.synthesis.notes)
    assert "not weighed at once" in told
    assert "the lowest level falls with what is added" in told
    assert design.infima[0] > design.infima[1] > design.infima[2]
    # A zero at the origin from u to z: z = [x1'; u] of a double integrator.
    zero = Plant.from_matrices(
        [[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]], [[0.0], [1.0]], [[0.0, 1.0], [0.0, 0.0]], D12=[[0.0], [1.0]]
    )
    design = h_infinity_state_feedback(zero, curve=())
    assert "an invariant zero at 0 on the axis" in " ".join(design.synthesis.notes)
    assert design.synthesis.status is Status.SOLVED
    assert design.infimum == pytest.approx(1.0, rel=1e-3)  # that of x2' = w + u, z = [x2; u]


def test_options_are_checked():
    with pytest.raises(ValueError, match="back_off: expected a factor above 1"):
        h_infinity_state_feedback(_scalar(1.0), back_off=1.0)
    with pytest.raises(ValueError, match="gain_bound: expected a positive number"):
        h_infinity_output_feedback(_general(1, (2, 2, 1, 2, 1)), gain_bound=-1.0)


def test_dispatch():
    assert h_infinity_synthesis(_scalar(1.0)).synthesis.law == "H-infinity state feedback"
    assert h_infinity_synthesis(_general(1, (2, 2, 1, 2, 1))).synthesis.law == "H-infinity output feedback"


def test_game_tells_beyond_the_limit():
    channel = Channel(
        np.eye(1), np.eye(1), np.eye(1), np.array([[1.0], [0.0]]), np.zeros((2, 1)), np.array([[0.0], [1.0]])
    )
    assert solve_game(channel, 1.001).angle_margin > 0.0
    beyond = solve_game(channel, 0.999)
    assert beyond.lagrangian
    assert beyond.angle_margin < 0.0
    assert not beyond.solvable
    stable = replace(channel, A=-np.eye(1))
    on_axis = solve_game(stable, 0.7)  # the limit is sqrt(1/2)
    assert not on_axis.lagrangian
    assert on_axis.axis < 0.0


def test_infimum_of_step_functions():
    for edge in (1e-6, 0.3, 7.0, 1e5):
        found = infimum(lambda g, edge=edge: Trial(g, g > edge, {}), floor=0.0, scale=1.0)
        assert found.upper == pytest.approx(edge, rel=1e-6)
        assert found.lower <= edge <= found.upper
    assert infimum(lambda g: Trial(g, False, {}), floor=0.0, scale=1.0) is None
    assert infimum(lambda g: Trial(g, True, {}), floor=0.0, scale=1.0).limit.startswith("none")
    assert LARGEST > 1e10


def test_a_mutant_formula_is_caught():
    plant = _general(11, (5, 2, 2, 4, 2))
    form = normal_form(plant)
    gamma = 1.02 * h_infinity_output_feedback(plant, curve=()).infimum
    A, B, C, D = central_controller(form, couple(form, gamma))

    def norm(*law):
        made = Controller.from_matrices(*law, measured=plant.measured, commands=plant.commands)
        return h_infinity_norm(*closed_channel(plant, made)).value

    assert norm(A, B, C, D) <= gamma
    for mutant in ((A, -B, C, D), (A, B, C, -D), (A.T, B, C, D), (A, B, 1.05 * C, D)):
        assert norm(*mutant) > gamma


def test_a_bound_whose_square_is_no_number_has_no_game() -> None:
    one = np.eye(1)
    channel = Channel(one, one, one, np.array([[1.0], [0.0]]), np.zeros((2, 1)), np.array([[0.0], [1.0]]))
    assert not solve_game(channel, np.inf).solvable and not solve_game(channel, 1e200).solvable
    assert solve_game(channel, 1e100).solvable
