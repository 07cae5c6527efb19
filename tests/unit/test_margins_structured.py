"""Structured singular value of complex diagonal uncertainty, and its peak over frequency."""

from __future__ import annotations

import numpy as np
import pytest

from maglev_ctrl.analysis.hamiltonian import response
from maglev_ctrl.analysis.loops import Loop
from maglev_ctrl.analysis.margins import loop_margins
from maglev_ctrl.analysis.structured import mu_lower, mu_upper, phases_from_scaling, scaled
from maglev_ctrl.analysis.structured_peak import structured_peak, without
from maglev_ctrl.arrays import ComplexArray


def random_matrix(seed: int, size: int) -> ComplexArray:
    generator = np.random.default_rng(seed)
    return np.asarray(generator.normal(size=(size, size)) + 1j * generator.normal(size=(size, size)))


@pytest.mark.parametrize("size", [2, 3, 4, 5])
def test_rank_one_closed_form(size: int) -> None:
    """mu(u v^H) = sum |u_i v_i|."""
    generator = np.random.default_rng(size)
    u, v = (generator.normal(size=size) + 1j * generator.normal(size=size) for _ in range(2))
    matrix = np.outer(u, v.conj())
    exact = float(np.sum(np.abs(u * v)))
    assert mu_upper(matrix).value == pytest.approx(exact, rel=1e-6)
    assert mu_lower(matrix).value == pytest.approx(exact, rel=1e-8)


@pytest.mark.parametrize("size", [1, 2, 3])
@pytest.mark.parametrize("seed", range(6))
def test_bounds_coincide_for_at_most_three_blocks(size: int, seed: int) -> None:
    matrix = random_matrix(seed, size)
    upper = mu_upper(matrix)
    lower = mu_lower(matrix, starts=(phases_from_scaling(matrix, upper.log_scales),))
    assert lower.value <= upper.value * (1.0 + 1e-9)
    assert lower.value == pytest.approx(upper.value, rel=1e-4)
    if size > 1:  # mutant: without the scales the largest singular value is not mu
        assert np.linalg.norm(matrix, 2) > upper.value * (1.0 + 1e-4)


@pytest.mark.parametrize("size", [2, 3, 4])
def test_perturbation_makes_the_loop_singular(size: int) -> None:
    matrix = random_matrix(40 + size, size)
    bound = mu_lower(matrix)
    assert np.allclose(np.abs(bound.perturbation), 1.0 / bound.value)
    gap = np.linalg.svd(np.eye(size) - matrix @ np.diag(bound.perturbation), compute_uv=False)[-1]
    assert gap < 1e-9
    flipped = np.linalg.svd(np.eye(size) + matrix @ np.diag(bound.perturbation), compute_uv=False)[-1]
    assert flipped > 1e-3  # mutant: the other sign does not


def test_diagonal_triangular_and_zero_matrices() -> None:
    assert mu_upper(np.diag([1.0, -3.0, 2.0]).astype(complex)).value == pytest.approx(3.0)
    triangular = np.array([[1.0, 500.0], [0.0, 0.5]], dtype=complex)  # best scale is infinite
    assert mu_upper(triangular).value == pytest.approx(1.0, rel=1e-5)
    zero = np.zeros((2, 2), dtype=complex)
    assert mu_upper(zero).value == 0.0
    assert mu_lower(zero).value == 0.0


def test_upper_bound_does_not_feel_units() -> None:
    matrix = random_matrix(9, 3)
    units = np.log([1e6, 1e-2, 1.0])
    assert mu_upper(scaled(matrix, units)).value == pytest.approx(mu_upper(matrix).value, rel=1e-5)


@pytest.mark.parametrize("seed", range(3))
def test_peak_bounds_hold_between_all_frequencies(seed: int) -> None:
    generator = np.random.default_rng(seed)
    A = generator.normal(size=(6, 6)) * 3.0
    A -= (np.max(np.linalg.eigvals(A).real) + 0.05) * np.eye(6)
    B, C, D = generator.normal(size=(6, 3)), generator.normal(size=(3, 6)), 0.3 * generator.normal(size=(3, 3))
    peak = structured_peak(A, B, C, D, seeds=np.abs(np.linalg.eigvals(A)))
    assert peak.lower <= peak.upper <= peak.lower * 1.001
    value = response(A, B, C, D, np.array([peak.frequency]))[0]
    assert np.linalg.svd(np.eye(3) - value @ np.diag(peak.perturbation), compute_uv=False)[-1] < 1e-7
    for omega in np.logspace(-2, 2, 9):
        assert mu_lower(response(A, B, C, D, np.array([omega]))[0]).value <= peak.upper * (1.0 + 1e-9)


def test_narrow_peak_is_found_without_seeds() -> None:
    """Two lightly damped modes coupled through two channels; seeds far away from both."""
    A = np.zeros((4, 4))
    for k, (omega, zeta) in enumerate([(7.0, 1e-4), (40.0, 1e-5)]):
        A[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = [[0.0, omega], [-omega, -2.0 * zeta * omega]]
    B = np.array([[0.0, 0.0], [1.0, 0.3], [0.0, 0.0], [-0.2, 1.0]])
    C = 1e-3 * np.array([[0.0, 1.0, 0.0, 0.5], [0.0, 0.1, 0.0, 1.0]])
    peak = structured_peak(A, B, C, np.zeros((2, 2)), seeds=np.array([1.0]))
    grid = max(mu_upper(v, target=np.inf).value for v in response(A, B, C, np.zeros((2, 2)), np.logspace(-1, 3, 300)))
    assert peak.lower == pytest.approx(peak.upper, rel=1e-3)
    assert grid < 0.5 * peak.lower  # mutant: a grid alone misses it


def test_what_lies_above_the_first_proven_interval_is_not_forgotten() -> None:
    assert without([(0.0, np.inf)], (0.0, 21.54)) == [(21.54, np.inf)]
    assert without([(21.54, np.inf)], (20.0, np.inf)) == []
    assert without([(0.0, 1.0)], (0.0, 1.0 - 1e-12)) == []


def test_a_peak_above_the_first_resonance_is_found() -> None:
    """Two decoupled channels, a low and a high resonance: the worst is the high one, 1/|S - 1/2| by hand."""

    def block(omega: float, damping: float, gain: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        A = np.array([[0.0, 1.0], [-(omega**2), -2.0 * damping * omega]])
        return A, np.array([[0.0], [1.0]]), np.array([[0.0, gain * omega]])

    (A_1, B_1, C_1), (A_2, B_2, C_2) = block(2.0, 0.3, 0.5), block(40.0, 0.05, 0.9)
    zero = np.zeros((2, 2))
    A, B, C = np.block([[A_1, zero], [zero, A_2]]), np.zeros((4, 2)), np.zeros((2, 4))
    B[:2, :1], B[2:, 1:], C[:1, :2], C[1:, 2:] = B_1, B_2, C_1, -0.99 * C_2 / 9.0
    found = loop_margins(Loop(A, B, C, np.zeros((2, 2)), ("low", "high"))).multi_loop
    grid = np.geomspace(0.1, 1e3, 400_001)
    s = 1j * grid[:, None]
    transfer = [C[i] @ B[:, i] * s[:, 0] / (s[:, 0] ** 2 + 2 * z * w * s[:, 0] + w**2)
                for i, (w, z) in enumerate(((2.0, 0.3), (40.0, 0.05)))]  # fmt: skip
    alpha = min(float(np.min(1.0 / np.abs(1.0 / (1.0 + L) - 0.5))) for L in transfer)
    assert found.alpha == pytest.approx(alpha, rel=1e-5)


@pytest.mark.parametrize("seed", [0, 3, 11])
def test_no_frequency_of_a_dense_grid_exceeds_the_peak(seed: int) -> None:
    """Random stable systems with resonances decades apart: the proven peak covers the lower bound everywhere."""
    generator = np.random.default_rng(seed)
    channels, pairs = int(generator.integers(2, 4)), 4
    A = np.zeros((2 * pairs, 2 * pairs))
    for k, (omega, zeta) in enumerate(
        zip(10.0 ** generator.uniform(-1, 3, pairs), generator.uniform(0.01, 0.5, pairs), strict=False)
    ):
        A[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = [[-zeta * omega, omega], [-omega, -zeta * omega]]
    B, C = generator.normal(size=(2 * pairs, channels)), generator.normal(size=(channels, 2 * pairs))
    D = 0.3 * generator.normal(size=(channels, channels))
    found = structured_peak(A, B, C, D, seeds=np.array([1.0]))
    grid = np.geomspace(1e-2, 1e4, 90)
    largest = max(mu_lower(matrix).value for matrix in response(A, B, C, D, grid))
    assert largest <= found.upper * (1.0 + 1e-9)
    assert found.lower <= found.upper * (1.0 + 1e-9)
