"""Norms of systems: closed forms, systems without a norm, poles on the axis that are hidden."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.linalg import block_diag

from maglev_ctrl.analysis.minimal import minimal_part, reachable_basis
from maglev_ctrl.analysis.norms import h2_norm, h_infinity_norm, l2_norm, l_infinity_norm
from maglev_ctrl.errors import Agreement

ZERO = [[0.0]]


def _companion(poles):
    coefficients = np.real(np.poly(poles))
    n = len(poles)
    A = np.eye(n, k=1)
    A[-1] = -coefficients[:0:-1]
    return A, np.eye(n)[:, -1:], np.eye(n)[:1]


def _random(seed, n, m, p, *, sampled=False):
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((n, n))
    poles = np.linalg.eigvals(A)
    A = A / (1.1 * np.max(np.abs(poles))) if sampled else A - (np.max(poles.real) + 0.3) * np.eye(n)
    return A, rng.standard_normal((n, m)), rng.standard_normal((p, n)), rng.standard_normal((p, m))


def test_sampled_h2_is_the_energy_of_the_impulse_response_with_feedthrough():
    A, B, C, D = _random(1, 5, 2, 3, sampled=True)
    total, state = float(np.sum(D**2)), B
    for _ in range(2000):
        total, state = total + float(np.sum((C @ state) ** 2)), A @ state
    found = h2_norm(A, B, C, D, dt=0.1)
    assert found.agreed is Agreement.AGREED
    assert found.value == pytest.approx(np.sqrt(total), rel=1e-10)


@pytest.mark.parametrize("count", [2, 4, 6])
def test_repeated_poles(count):
    A, B, C = _companion([-1.0] * count)  # 1 / (s + 1)^k: energy (2k-2)! / ((k-1)!^2 2^(2k-1))
    from math import factorial

    energy = factorial(2 * count - 2) / (factorial(count - 1) ** 2 * 2.0 ** (2 * count - 1))
    found = h2_norm(A, B, C, ZERO)
    assert found.value == pytest.approx(np.sqrt(energy), rel=1e-10)
    assert h_infinity_norm(A, B, C, ZERO).value == pytest.approx(1.0, rel=1e-10)


@pytest.mark.parametrize("damping", [1e-3, 1e-6, 1e-9])
def test_lightly_damped(damping):
    A = [[0.0, 1.0], [-1.0, -2.0 * damping]]
    B, C = [[0.0], [1.0]], [[1.0, 0.0]]
    peak = h_infinity_norm(A, B, C, ZERO)
    assert peak.agreed is Agreement.AGREED
    assert peak.value == pytest.approx(1.0 / (2.0 * damping * np.sqrt(1.0 - damping**2)), rel=1e-7)
    assert h2_norm(A, B, C, ZERO).value == pytest.approx(np.sqrt(0.25 / damping), rel=1e-7)


@pytest.mark.parametrize("count", [1, 2, 3, 4])
def test_integrator_chains_have_no_norm(count):
    A, B, C = np.eye(count, k=1), np.eye(count)[:, -1:], np.eye(count)[:1]
    rng = np.random.default_rng(count)
    T = np.linalg.qr(rng.standard_normal((count, count)))[0]
    for norm in (h2_norm, h_infinity_norm, l2_norm, l_infinity_norm):
        assert np.isinf(norm(A, B, C, ZERO).value)
        assert np.isinf(norm(T @ A @ T.T, T @ B, C @ T.T, ZERO).value)


@pytest.mark.parametrize("dt", [None, 0.5])
def test_a_hidden_pole_on_the_axis_is_left_out_and_told(dt):
    stable, neutral = (-1.0, 0.0) if dt is None else (0.5, 1.0)
    A = np.diag([stable, neutral])
    unseen = h2_norm(A, [[1.0], [1.0]], [[1.0, 0.0]], ZERO, dt=dt)
    alone = h2_norm([[stable]], [[1.0]], [[1.0]], ZERO, dt=dt)
    assert unseen.value == pytest.approx(alone.value, rel=1e-12)
    assert "hidden" in unseen.message
    assert np.isinf(h_infinity_norm(A, [[1.0], [1e-3]], [[1.0, 1e-3]], ZERO, dt=dt).value)


def test_a_growing_pole_makes_h_norms_infinite_even_where_it_is_hidden():
    A = np.diag([-1.0, 2.0])
    assert np.isinf(h2_norm(A, [[1.0], [0.0]], [[1.0, 1.0]], ZERO).value)
    assert l_infinity_norm(A, [[1.0], [0.0]], [[1.0, 1.0]], ZERO).value == pytest.approx(1.0)


def test_feedthrough_peaks_at_infinity_and_has_no_continuous_energy():
    found = h_infinity_norm([[-1.0]], [[1.0]], [[-0.5]], [[2.0]])  # 2 - 0.5 / (s + 1)
    assert found.value == pytest.approx(2.0, rel=1e-12)
    assert found.frequency == np.inf
    assert np.isinf(h2_norm([[-1.0]], [[1.0]], [[1.0]], [[1e-3]]).value)
    assert np.isinf(l2_norm([[1.0]], [[1.0]], [[1.0]], [[1e-3]]).value)


def test_static_systems():
    nothing = np.zeros((0, 0)), np.zeros((0, 2)), np.zeros((1, 0))
    D = [[3.0, 4.0]]
    assert h_infinity_norm(*nothing, D).value == pytest.approx(5.0)
    assert np.isinf(h2_norm(*nothing, D).value)
    assert h2_norm(*nothing, D, dt=1.0).value == pytest.approx(5.0)
    assert h2_norm(*nothing, [[0.0, 0.0]]).value == 0.0


def test_l2_of_a_mixed_system_by_quadrature():
    rng = np.random.default_rng(3)
    A = block_diag([[-0.5, 2.0], [-2.0, -0.5]], [[1.0, 3.0], [-3.0, 1.0]], [[-4.0]])
    T = rng.standard_normal((5, 5))
    A, B, C = np.linalg.solve(T, A @ T), rng.standard_normal((5, 2)), rng.standard_normal((2, 5))

    def density(w):
        return float(np.sum(np.abs(C @ np.linalg.solve(1j * w * np.eye(5) - A, B)) ** 2)) / np.pi

    energy = quad(density, 0.0, 8.0, limit=400, epsabs=1e-12)[0] + quad(density, 8.0, np.inf, limit=400)[0]
    found = l2_norm(A, B, C, np.zeros((2, 2)))
    assert found.agreed is Agreement.AGREED
    assert found.value == pytest.approx(np.sqrt(energy), rel=1e-8)
    assert found.value != pytest.approx(h2_norm(-A, B, C, np.zeros((2, 2))).value)


def test_sampled_l2_of_a_mixed_system_with_feedthrough():
    A, B, C, D = _random(7, 4, 2, 2, sampled=True)
    A = block_diag(A, [[1.7]])
    B, C = np.vstack([B, [[1.0, -1.0]]]), np.hstack([C, [[1.0], [2.0]]])
    z = np.exp(2j * np.pi * np.arange(4096) / 4096)
    values = D + C @ np.linalg.solve(z[:, None, None] * np.eye(5) - A, B + 0j)
    energy = np.mean(np.sum(np.abs(values) ** 2, axis=(1, 2)))
    found = l2_norm(A, B, C, D, dt=0.2)
    assert found.agreed is Agreement.AGREED
    assert found.value == pytest.approx(np.sqrt(energy), rel=1e-9)


def test_many_random_systems_agree_by_both_methods():
    for seed in range(12):
        sampled = seed % 2 == 1
        A, B, C, D = _random(seed, 2 + seed, 1 + seed % 3, 2, sampled=sampled)
        dt = 0.05 if sampled else None
        peak = h_infinity_norm(A, B, C, D, dt=dt)
        assert peak.agreed is Agreement.AGREED, peak
        energy = h2_norm(A, B, C, D if sampled else 0.0 * D, dt=dt)
        assert energy.agreed is Agreement.AGREED, energy


def test_wrong_shapes_are_refused():
    with pytest.raises(ValueError, match="B: expected shape"):
        h2_norm([[-1.0]], [[1.0, 2.0]], [[1.0]], ZERO)
    with pytest.raises(ValueError, match="dt: expected a positive"):
        h2_norm([[-1.0]], [[1.0]], [[1.0]], ZERO, dt=-1.0)


def test_minimal_part_of_a_hidden_chain():
    A = np.diag([1.0, 2.0, 3.0])
    assert minimal_part(A, np.array([[1.0], [1.0], [0.0]]), np.array([[1.0, 0.0, 1.0]]))[0].shape == (1, 1)
    assert reachable_basis(A, np.ones((3, 1))).shape == (3, 3)
    assert reachable_basis(A, np.zeros((3, 1))).shape == (3, 0)
