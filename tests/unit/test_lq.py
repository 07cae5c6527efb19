"""Regulator, Kalman filter and compensator on plain matrices."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm, solve_continuous_are

from maglev_ctrl.errors import ModelError
from maglev_ctrl.synthesis.lq import kalman, lqg, lqr


def _plant():
    A = np.array([[0.0, 1.0, 0.0], [2.0, -0.1, 1.0], [0.0, 0.0, -20.0]])
    return A, np.array([[0.0], [0.0], [20.0]]), np.array([[1.0, 0.0, 0.0], [2.0, -0.1, 1.0]])


def _kalman_residual(A, C, W, V, X, L, S):
    return A @ S + S @ A.T + W - L @ V @ L.T, (S @ C.T + X) - L @ V


def test_regulator_agrees_with_an_independent_solver():
    A, B, _ = _plant()
    gain = lqr(A, B, np.eye(3), [[0.5]]).gain
    P = solve_continuous_are(A, B, np.eye(3), [[0.5]])
    np.testing.assert_allclose(gain, B.T @ P / 0.5, rtol=1e-9)


def test_regulator_refuses_what_it_cannot_stabilise():
    with pytest.raises(ModelError, match="cannot move"):
        lqr([[1.0]], [[0.0]], [[1.0]], [[1.0]])


def test_kalman_filter_satisfies_its_own_equations():
    A, _, C = _plant()
    rng = np.random.default_rng(0)
    joint = rng.standard_normal((5, 5))
    joint = joint @ joint.T
    W, V, X = joint[:3, :3], joint[3:, 3:], joint[:3, 3:]
    found = kalman(A, C, W, V, X)
    first, second = _kalman_residual(A, C, W, V, X, found.gain, found.covariance)
    assert np.linalg.norm(first) < 1e-11 * np.linalg.norm(found.gain @ V @ found.gain.T)
    assert np.linalg.norm(second) < 1e-11
    assert np.max(np.linalg.eigvals(A - found.gain @ C).real) < 0.0
    mutant = kalman(A, C, W, V, -X)
    assert np.linalg.norm(_kalman_residual(A, C, W, V, X, mutant.gain, mutant.covariance)[1]) > 1e-2


def test_error_covariance_is_that_of_the_error_system():
    """Covariance of e' = (A - L C) e + w - L v by integration of the matrix exponential, no Lyapunov solver."""
    A, _, C = _plant()
    W, V, X = np.diag([0.0, 1.0, 0.1]), np.diag([0.01, 0.5]), np.array([[0.0, 0.0], [0.0, 0.3], [0.0, 0.0]])
    found = kalman(A, C, W, V, X)
    closed, L = A - found.gain @ C, found.gain
    drive = W - L @ X.T - X @ L.T + L @ V @ L.T
    block = expm(np.block([[-closed, drive], [np.zeros((3, 3)), closed.T]]) * 0.05)  # Van Loan 1978
    step, total, power = block[3:, 3:].T, block[3:, 3:].T @ block[:3, 3:], np.eye(3)
    covariance = np.zeros((3, 3))
    for _ in range(3000):
        covariance, power = covariance + power @ total @ power.T, power @ step
    np.testing.assert_allclose(covariance, found.covariance, rtol=1e-9, atol=1e-12)


def test_separation_poles_of_the_loop_are_regulator_and_observer():
    A, B, C = _plant()
    D = np.array([[0.0], [0.7]])
    zero = np.zeros((3, 1))
    K = lqr(A, B, np.eye(3), [[1.0]]).gain
    made = lqg(A, B, C, D, weights=(np.eye(3), [[1.0]], zero), noise=(np.eye(3), np.diag([0.1, 0.2]), np.zeros((3, 2))))
    L = made.observer.gain
    loop = np.block([[A, B @ made.C], [made.B @ C, made.A + made.B @ D @ made.C]])
    expected = np.concatenate([np.linalg.eigvals(A - B @ K), np.linalg.eigvals(A - L @ C)])
    np.testing.assert_allclose(np.sort_complex(np.linalg.eigvals(loop)), np.sort_complex(expected), rtol=1e-8)
    without_feedthrough = np.block([[A, B @ made.C], [made.B @ C, A - B @ K - L @ C + made.B @ D @ made.C]])
    wrong = np.sort_complex(np.linalg.eigvals(without_feedthrough))
    assert np.max(np.abs(wrong - np.sort_complex(expected))) > 1e-2
