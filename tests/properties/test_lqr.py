"""What a linear-quadratic regulator must satisfy, checked without its solver."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from maglev_ctrl.synthesis.laws import design_lqr
from maglev_ctrl.synthesis.weights import InputWeight, OutputWeight, quadratic_weights
from maglev_ctrl.systems import SecondOrderSystem

OUTPUTS = [OutputWeight("car.heave.acceleration", 0.5), OutputWeight("stroke", 0.05), OutputWeight("bogie.heave", 0.02)]
INPUTS = [InputWeight("secondary", 3000.0)]


def _plant(magnet_damping: float, bandwidth: float | None) -> SecondOrderSystem:
    lagged = bandwidth is not None
    actuator = (
        {
            "internal": ("secondary.force",), "A_internal": [[-bandwidth]], "F": [[-1.0], [1.0]],
            "B_internal": [[bandwidth]],
        }
        if lagged
        else {"B": [[-1.0], [1.0]]}
    )  # fmt: skip
    return SecondOrderSystem.from_matrices(
        [[1200.0, 0.0], [0.0, 5000.0]], [[magnet_damping, 0.0], [0.0, 0.0]], [[3.5e5, -5e4], [-5e4, 5e4]],
        dofs=("bogie.heave", "car.heave"), inputs=("secondary",), outputs=("car.heave.acceleration", "stroke"),
        H_q=[[0.0, 0.0], [-1.0, 1.0]], H_a=[[0.0, 1.0], [0.0, 0.0]], **actuator,
    )  # fmt: skip


def _problem(magnet_damping: float, bandwidth: float | None):
    plant = _plant(magnet_damping, bandwidth)
    design = design_lqr(plant, OUTPUTS, INPUTS)
    cost = quadratic_weights(plant, OUTPUTS, INPUTS)
    return plant.state_matrix(), plant.input_matrix(), cost, design.riccati[0]


def _cost_matrix(A, B, cost, K):
    """V with cost x0' V x0 of u = -K x: Lyapunov equation by Kronecker algebra."""
    closed = A - B @ K
    running = cost.Q - cost.N @ K - K.T @ cost.N.T + K.T @ cost.R @ K
    one, n = np.eye(len(A)), len(A)
    return np.linalg.solve(np.kron(closed.T, one) + np.kron(one, closed.T), -running.ravel()).reshape(n, n)


damping = st.floats(min_value=-1500.0, max_value=1500.0)
bandwidth = st.none() | st.floats(min_value=20.0, max_value=400.0)


@settings(max_examples=15, deadline=None, derandomize=True)
@given(damping, bandwidth)
def test_cost_is_the_quadratic_form_of_the_riccati_solution(magnet_damping, lag):
    A, B, cost, solution = _problem(magnet_damping, lag)
    V = _cost_matrix(A, B, cost, solution.gain)
    # Scaled by P's own diagonal: P's entries span the units of positions, velocities and forces.
    size = np.sqrt(np.outer(np.diag(solution.P), np.diag(solution.P)))
    np.testing.assert_allclose(V / size, solution.P / size, atol=1e-7)
    mutant = _cost_matrix(A, B, cost, 1.05 * solution.gain)
    assert np.max(np.abs(mutant / size - solution.P / size)) > 1e-5


@pytest.mark.parametrize("lag", [None, 60.0])
def test_cost_agrees_with_a_simulation_in_time(lag):
    A, B, cost, solution = _problem(-400.0, lag)
    x0 = np.zeros(len(A))
    x0[:2] = [0.01, -0.02]

    def slope(_, state):
        x = state[:-1]
        u = -solution.gain @ x
        rate = x @ cost.Q @ x + u @ cost.R @ u + 2 * x @ cost.N @ u
        return np.append(A @ x + B @ u, rate)

    horizon = -25.0 / np.max(solution.closed_loop_poles.real)
    run = solve_ivp(slope, (0.0, horizon), np.append(x0, 0.0), method="DOP853", rtol=1e-10, atol=1e-14)
    assert run.y[-1, -1] == pytest.approx(x0 @ solution.P @ x0, rel=1e-6)


@settings(max_examples=10, deadline=None, derandomize=True)
@given(damping, bandwidth, st.integers(0, 10_000))
def test_no_other_gain_costs_less(magnet_damping, lag, seed):
    A, B, cost, solution = _problem(magnet_damping, lag)
    rng = np.random.default_rng(seed)
    change = 0.02 * solution.gain * rng.standard_normal(solution.gain.shape)
    other = solution.gain + change
    if np.max(np.linalg.eigvals(A - B @ other).real) >= 0.0:
        return
    more = _cost_matrix(A, B, cost, other) - solution.P
    scale = 1.0 / np.sqrt(np.diag(solution.P))
    assert np.min(np.linalg.eigvalsh(more * np.outer(scale, scale))) > -1e-7


@settings(max_examples=15, deadline=None, derandomize=True)
@given(damping, st.floats(min_value=20.0, max_value=400.0))
def test_return_difference_of_one_input_never_falls_below_one(magnet_damping, lag):
    """Kalman's inequality |1 + K (jw - A)^-1 B| >= 1, which holds where no cross weight stands (lagged actuator)."""
    A, B, cost, solution = _problem(magnet_damping, lag)
    assert not np.any(cost.N)
    poles = np.abs(np.linalg.eigvals(A).imag)
    for frequency in np.concatenate([np.geomspace(1e-2, 1e4, 200), poles + 1e-3, poles * 1.01]):
        loop = (solution.gain @ np.linalg.solve(1j * frequency * np.eye(len(A)) - A, B))[0, 0]
        assert abs(1.0 + loop) >= 1.0 - 1e-7
    mutant = np.array(solution.gain)
    mutant[0, -1] = -0.9  # a wrong feedback of the actuator's own force
    worst = min(
        abs(1.0 + (mutant @ np.linalg.solve(1j * w * np.eye(len(A)) - A, B))[0, 0])
        for w in np.geomspace(1e-2, 1e4, 200)
    )
    assert worst < 0.99
