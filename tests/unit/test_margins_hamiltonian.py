"""Peak gain by Hamiltonian matrices: no peak is missed, however narrow."""

from __future__ import annotations

import numpy as np
import pytest

from maglev_ctrl.analysis.hamiltonian import (
    continuous_equivalent,
    h_infinity_norm,
    hamiltonian_frequencies,
    largest_gain,
    peak_gain,
    response,
)
from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.errors import NotStable

System = tuple[FloatArray, FloatArray, FloatArray, FloatArray]


def random_system(seed: int, *, order: int = 8, size: int = 3) -> System:
    generator = np.random.default_rng(seed)
    A = generator.normal(size=(order, order)) * 10.0 ** generator.uniform(-1, 2)
    A = A - (np.max(np.linalg.eigvals(A).real) + 10.0 ** generator.uniform(-4, 0)) * np.eye(order)
    return (
        A,
        generator.normal(size=(order, size)),
        generator.normal(size=(size, order)),
        generator.normal(size=(size, size)),
    )


def lightly_damped(damping_ratio: float) -> System:
    """A mode at 1 rad/s whose resonance peak is exactly 1 (rate over force times twice the damping)."""
    return (
        np.array([[0.0, 1.0], [-1.0, -2.0 * damping_ratio]]),
        np.array([[0.0], [1.0]]),
        np.array([[0.0, 2.0 * damping_ratio]]),
        np.zeros((1, 1)),
    )


@pytest.mark.parametrize("damping_ratio", [1e-1, 1e-4, 1e-7])
def test_narrow_resonance_is_found(damping_ratio: float) -> None:
    peak = peak_gain(*lightly_damped(damping_ratio))
    assert peak.lower == pytest.approx(1.0, rel=1e-8)
    assert peak.upper >= 1.0 - 1e-12
    assert peak.frequency == pytest.approx(1.0, rel=1e-6)


def test_grid_only_mutant_is_caught() -> None:
    system = lightly_damped(1e-4)
    grid = largest_gain(response(*system, np.logspace(-2.003, 2.001, 1001)))
    assert np.max(grid) < 0.1  # the grid sees a tenth of the true peak of 1


@pytest.mark.parametrize("seed", range(12))
def test_peak_bounds_every_sample_and_is_attained(seed: int) -> None:
    system = random_system(seed)
    peak = peak_gain(*system)
    poles = np.linalg.eigvals(system[0])
    near = np.abs(poles.imag)[:, None] + np.abs(poles.real)[:, None] * np.linspace(-4, 4, 81)
    grid = np.concatenate([np.logspace(-3, 5, 1500), np.abs(near).ravel()])
    assert np.max(largest_gain(response(*system, grid))) <= peak.upper * (1.0 + 1e-10)
    assert largest_gain(response(*system, np.array([peak.frequency])))[0] == pytest.approx(peak.lower, rel=1e-7)


@pytest.mark.parametrize("seed", range(4))
def test_level_crossings_are_where_a_singular_value_equals_the_level(seed: int) -> None:
    A, B, C, D = random_system(seed)
    level = 0.5 * (peak_gain(A, B, C, D).lower + float(np.linalg.norm(D, 2)))
    crossings = hamiltonian_frequencies(A, B, C, D, level, closeness=1e-8)
    values = np.linalg.svd(response(A, B, C, D, crossings), compute_uv=False)
    assert crossings.size
    assert np.allclose(np.min(np.abs(values - level), axis=1), 0.0, atol=1e-6 * level)
    # mutant: the feedthrough with the wrong sign puts the crossings elsewhere
    wrong = hamiltonian_frequencies(A, B, C, -D, level, closeness=1e-8)
    wrong_values = np.linalg.svd(response(A, B, C, D, wrong), compute_uv=False)
    assert not wrong.size or not np.allclose(np.min(np.abs(wrong_values - level), axis=1), 0.0, atol=1e-6 * level)


def test_flat_response_and_no_states() -> None:
    allpass = peak_gain([[-1.0]], [[1.0]], [[-2.0]], [[1.0]])  # (s - 1)/(s + 1)
    assert allpass.lower == pytest.approx(1.0, rel=1e-12)
    static = peak_gain(np.zeros((0, 0)), np.zeros((0, 2)), np.zeros((2, 0)), [[3.0, 0.0], [0.0, -4.0]])
    assert static.lower == 4.0


def test_peak_at_infinite_frequency() -> None:
    peak = peak_gain([[-1.0]], [[1.0]], [[-1.0]], [[1.0]])  # s/(s + 1)
    assert peak.lower == pytest.approx(1.0, rel=1e-12)
    assert peak.frequency == np.inf


@pytest.mark.parametrize("dt", [0.01, 2.0])
def test_discrete_axis_maps_exactly(dt: float) -> None:
    generator = np.random.default_rng(3)
    A = generator.normal(size=(5, 5))
    A *= 0.97 / np.max(np.abs(np.linalg.eigvals(A)))
    B, C, D = generator.normal(size=(5, 2)), generator.normal(size=(2, 5)), generator.normal(size=(2, 2))
    omega = np.array([0.0, 0.1, 0.7, 2.9]) / dt
    z = np.exp(1j * omega * dt)
    direct = D + C @ np.linalg.solve(z[:, None, None] * np.eye(5) - A, B + 0j)
    mapped = response(*continuous_equivalent(A, B, C, D, dt), 2.0 / dt * np.tan(omega * dt / 2.0))
    assert np.allclose(direct, mapped, rtol=1e-10, atol=1e-10)
    peak = peak_gain(A, B, C, D, dt=dt)
    grid = np.exp(1j * np.linspace(0.0, np.pi, 20001))
    sampled = np.max(largest_gain(D + C @ np.linalg.solve(grid[:, None, None] * np.eye(5) - A, B + 0j)))
    assert sampled <= peak.upper * (1.0 + 1e-12)
    assert sampled == pytest.approx(peak.lower, rel=1e-5)


def test_norm_of_unstable_system_is_refused() -> None:
    with pytest.raises(NotStable, match=r"pole at 0\.5"):
        h_infinity_norm([[0.5]], [[1.0]], [[1.0]], [[0.0]])
    with pytest.raises(NotStable):
        h_infinity_norm([[-1.5]], [[1.0]], [[1.0]], [[0.0]], dt=0.1)
    assert h_infinity_norm([[0.5]], [[1.0]], [[1.0]], [[0.0]], dt=0.1).lower == pytest.approx(2.0)
