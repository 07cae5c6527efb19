"""Sampled linear-quadratic designs against brute force: simulation of cost, covariance recursions, finer sampling."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm, solve_continuous_lyapunov, solve_discrete_lyapunov

from maglev_ctrl.errors import ModelError, Status
from maglev_ctrl.synthesis.lq import lqr
from maglev_ctrl.synthesis.lq_discrete import (
    held,
    held_cost,
    held_noise,
    kalman_discrete,
    lqg_discrete,
    lqr_discrete,
    sampled,
)
from maglev_ctrl.synthesis.lq_plants import design_sampled_lqg, design_sampled_lqr, mean_square
from maglev_ctrl.synthesis.sampling import root
from maglev_ctrl.systems.plant import Plant, closed_channel


def _plant(**changes):
    """A magnet above a rail: unstable gap, voltage lag; force disturbance, gap sensor."""
    given = {
        "A": [[0.0, 1.0, 0.0], [100.0, 0.0, -10.0], [0.0, 5.0, -20.0]],
        "B1": [[0.0, 0.0], [1.0, 0.0], [0.0, 0.0]],
        "B2": [[0.0], [0.0], [20.0]],
        "C1": [[10.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 0.0]],
        "C2": [[1.0, 0.0, 0.0]],
        "D12": [[0.0], [0.0], [0.1]],
        "D21": [[0.0, 1e-3]],
    } | changes
    return Plant.from_matrices(given["A"], given["B1"], given["B2"], given["C1"], given["C2"], D12=given["D12"],
                               D21=given["D21"], states=("gap", "speed", "current"), commands=("voltage",))  # fmt: skip


def _full():
    plant = _plant()
    return Plant.from_matrices(plant.A, plant.B1, plant.B2, plant.C1, D12=plant.D12, states=plant.states,
                               commands=plant.commands)  # fmt: skip


def _integral_of_cost(plant, x0, u, dt):
    def slope(_, s):
        x = s[:-1]
        z = plant.C1 @ x + plant.D12 @ u
        return np.append(plant.A @ x + plant.B2 @ u, z @ z)

    found = solve_ivp(slope, (0.0, dt), np.append(x0, 0.0), rtol=1e-11, atol=1e-13).y[:, -1]
    return found[:-1], found[-1]


@pytest.mark.parametrize("dt", [1e-3, 0.02, 0.3])
def test_held_cost_is_the_integral_between_samples(dt):
    plant = _full()
    rng = np.random.default_rng(1)
    x0, u = rng.standard_normal(3), rng.standard_normal(1)
    F, G, Q, R, N = held_cost(
        plant.A, plant.B2, plant.C1.T @ plant.C1, plant.D12.T @ plant.D12, plant.C1.T @ plant.D12, dt=dt
    )
    x, cost = _integral_of_cost(plant, x0, u, dt)
    np.testing.assert_allclose(F @ x0 + G @ u, x, rtol=1e-8)
    assert x0 @ Q @ x0 + u @ R @ u + 2.0 * x0 @ N @ u == pytest.approx(cost, rel=1e-7)
    assert x0 @ Q @ x0 + u @ R @ u - 2.0 * x0 @ N @ u != pytest.approx(cost, rel=2e-6)  # the mutant
    np.testing.assert_allclose(F, expm(plant.A * dt), rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(held(plant.A, plant.B2, dt)[1], G, rtol=1e-10, atol=1e-15)


def test_a_fast_mode_does_not_overflow():
    *_, Q, R, _ = held_cost([[-1e5]], [[1e5]], [[1.0]], [[0.0]], dt=1.0)
    assert Q[0, 0] == pytest.approx(0.5e-5, rel=1e-10)
    assert R[0, 0] == pytest.approx(1.0 - 1.5e-5, rel=1e-10)


def test_noise_gathered_over_a_period():
    plant, dt = _plant(), 0.01
    W = plant.B1 @ plant.B1.T
    s = (np.arange(2000) + 0.5) * dt / 2000
    powers = np.array([expm(plant.A * x) for x in s])
    by_sum = np.einsum("kij,jl,kml->im", powers, W, powers) * dt / 2000
    np.testing.assert_allclose(held_noise(plant.A, W, dt), by_sum, rtol=1e-5, atol=1e-5 * by_sum.max())
    # halves add up: W(2h) = W(h) + F W(h) F'
    half, F = held_noise(plant.A, W, dt / 2), expm(plant.A * dt / 2)
    np.testing.assert_allclose(held_noise(plant.A, W, dt), half + F @ half @ F.T, rtol=1e-11, atol=1e-18)


def test_sampled_regulator_minimises_the_continuous_cost():
    """The cost of the sampled law, integrated in continuous time, is x0'Px0; another gain costs more."""
    plant, dt = _full(), 0.02
    design = design_sampled_lqr(plant, dt)
    assert design.status is Status.SOLVED
    model = design.plants[0]
    P = lqr_discrete(model.A, model.B2, model.C1.T @ model.C1, model.D12.T @ model.D12, model.C1.T @ model.D12).P
    x0 = np.array([0.01, 0.0, 0.0])

    def cost(gain):
        x, total = x0, 0.0
        for _ in range(150):
            x, one = _integral_of_cost(plant, x, gain @ x, dt)
            total += one
        return total

    best = cost(design.controller.D)
    assert best == pytest.approx(x0 @ P @ x0, rel=1e-6)
    for change in (0.95, 1.05):
        assert cost(change * design.controller.D) > best * (1.0 + 1e-5)


def test_fine_sampling_tends_to_the_continuous_gain():
    plant = _full()
    continuous = lqr(plant.A, plant.B2, plant.C1.T @ plant.C1, plant.D12.T @ plant.D12).gain
    away = [np.linalg.norm(design_sampled_lqr(plant, dt).controller.D + continuous) for dt in (5e-4, 2.5e-4)]
    assert away[1] < 0.01 * np.linalg.norm(continuous)
    assert away[0] / away[1] == pytest.approx(2.0, rel=0.05)  # first order in the period


def test_kalman_covariances_are_the_limit_of_the_recursion():
    rng = np.random.default_rng(3)
    A, C = 0.9 * rng.standard_normal((4, 4)), rng.standard_normal((2, 4))
    G, H = rng.standard_normal((4, 5)), rng.standard_normal((2, 5))
    W, V, X = G @ G.T, H @ H.T, G @ H.T
    observer = kalman_discrete(A, C, W, V, X)
    S = np.eye(4)
    for _ in range(400):  # joint Gaussian conditioning of (x+, x, y), without the Riccati equation
        joint_y = C @ S @ C.T + V
        ahead = A @ S @ C.T + X
        filtered = S - S @ C.T @ np.linalg.solve(joint_y, C @ S)
        S = A @ S @ A.T + W - ahead @ np.linalg.solve(joint_y, ahead.T)
        S = 0.5 * (S + S.T)
    np.testing.assert_allclose(observer.covariance, S, rtol=1e-9)
    np.testing.assert_allclose(observer.filter_covariance, filtered, rtol=1e-8, atol=1e-10)
    np.testing.assert_allclose(observer.gain, ahead @ np.linalg.inv(joint_y), rtol=1e-8)
    wrong = kalman_discrete(A, C, W, V, -X)
    assert np.linalg.norm(wrong.covariance - S) > 1e-3 * np.linalg.norm(S)


@pytest.mark.parametrize("form", ["predictor", "filter"])
def test_lqg_simulates_to_the_optimal_controller(form):
    """The compensator step by step equals regulator and filter written out, with a direct term D."""
    rng = np.random.default_rng(4)
    A, B, C, D = rng.standard_normal((3, 3)), rng.standard_normal((3, 2)), rng.standard_normal((2, 3)), np.eye(2) * 0.1
    weights, noise = (np.eye(3), np.eye(2), np.zeros((3, 2))), (np.eye(3), np.eye(2), np.zeros((3, 2)))
    law = lqg_discrete(A, B, C, D, weights=weights, noise=noise, form=form)
    K, L, M = law.regulator.gain, law.observer.gain, law.observer.filter_gain
    state, estimate = np.zeros(3), np.zeros(3)
    for _ in range(20):
        y = rng.standard_normal(2)
        u = law.C @ state + law.D @ y
        used = estimate + M @ (y - C @ estimate - D @ u) if form == "filter" else estimate
        np.testing.assert_allclose(u, -K @ used, rtol=1e-8, atol=1e-12)
        state = law.A @ state + law.B @ y
        estimate = A @ estimate + B @ u + L @ (y - C @ estimate - D @ u)
        np.testing.assert_allclose(state, estimate, rtol=1e-7, atol=1e-9)


@pytest.mark.parametrize("form", ["predictor", "filter"])
def test_sampled_lqg_is_proved_and_its_cost_found_again(form):
    design = design_sampled_lqg(_plant(), 0.01, form=form)
    assert design.status is Status.SOLVED, design.message
    assert all(proof.holds for proof in design.proofs)
    A, *_ = closed_channel(design.plants[0], design.controller)
    assert np.max(np.abs(np.linalg.eigvals(A))) < 1.0
    assert design.performance[0].recomputed == pytest.approx(design.performance[0].reported, rel=1e-8)


def test_the_filter_is_better_than_the_predictor_and_both_than_a_detuned_law():
    filtered, predicted = (design_sampled_lqg(_plant(), 0.01, form=form) for form in ("filter", "predictor"))
    assert filtered.performance[0].recomputed < predicted.performance[0].recomputed
    detuned = design_sampled_lqg(_plant(D21=[[0.0, 2e-3]]), 0.01)
    assert mean_square(filtered.plants[0], detuned.controller) > filtered.performance[0].recomputed * (1.0 + 1e-4)


def test_white_sampling_keeps_the_variance():
    """A stable plant under white noise has the same stationary covariance at the samples."""
    A, B1 = np.array([[0.0, 1.0], [-4.0, -0.4]]), np.array([[0.0], [1.0]])
    plant = Plant.from_matrices(A, B1, B1, np.eye(2))
    at = sampled(plant, 0.3, disturbances="white")
    np.testing.assert_allclose(
        solve_discrete_lyapunov(at.A, at.B1 @ at.B1.T), solve_continuous_lyapunov(A, -B1 @ B1.T), rtol=1e-10, atol=1e-14
    )
    assert len(at.disturbances) == at.B1.shape[1] == at.D21.shape[1]


def test_sampled_keeps_names_and_held_disturbances_act_like_commands():
    plant = _plant(B1=[[0.0, 0.0], [0.0, 0.0], [20.0, 0.0]])
    at = sampled(plant, 0.05)
    np.testing.assert_allclose(at.B1[:, :1], at.B2, rtol=1e-12)
    assert (at.states, at.commands, at.measured, at.dt) == (plant.states, plant.commands, plant.measured, 0.05)
    rows = sampled(plant, 0.05, performance="integral")
    assert rows.performance[0] == "cost 1"


def test_root_of_a_semidefinite_weight():
    rng = np.random.default_rng(0)
    C = rng.standard_normal((2, 4)) * 10.0 ** np.array([-6.0, 0.0, 3.0, 6.0])
    F = root(C.T @ C)
    np.testing.assert_allclose(F.T @ F, C.T @ C, rtol=1e-9)


@pytest.mark.parametrize(
    ("act", "fault", "words"),
    [
        (lambda: sampled(_plant(), 0.0), ValueError, "dt: expected a positive"),
        (lambda: sampled(sampled(_plant(), 0.1), 0.1), ValueError, "continuous plant"),
        (lambda: design_sampled_lqr(_full()), ValueError, "expected a sampling period"),
        (lambda: design_sampled_lqr(sampled(_full(), 0.1), 0.2), ValueError, "sampled every 0.1"),
        (lambda: design_sampled_lqr(_plant(), 0.1), ModelError, "every state measured"),
        (lambda: sampled(_plant(D21=[[1.0, 1.0]], B1=np.ones((3, 2))), 0.1, disturbances="white"), ModelError, "once"),
        (lambda: lqg_discrete([[1]], [[1]], [[1]], [[0]], weights=(), noise=(), form="other"), ValueError, "form"),
        (lambda: lqr_discrete([[0.5]], [[1.0]], [[-4.0]], [[1.0]]), ModelError, "saddle|unit circle"),
    ],
)
def test_wrong_use_is_named(act, fault, words):
    with pytest.raises(fault, match=words):
        act()


def test_a_mode_that_no_command_moves_is_named():
    A = np.diag([2.0, 0.5])
    plant = Plant.from_matrices(
        A, np.eye(2), [[0.0], [1.0]], np.eye(3, 2), D12=[[0.0], [0.0], [1.0]], states=("tilt", "heave"), dt=0.1,
        commands=("coil",),
    )  # fmt: skip
    design = design_sampled_lqr(plant)
    assert design.controllers == ()
    assert design.message == "the commands coil cannot move the mode at z = 2 (tilt)"
