"""Hill's method: shift families, selection of the physical exponents, convergence."""

from __future__ import annotations

import numpy as np

from maglev_ctrl.kernels import hill_matrix, hill_pair, hill_spectrum
from maglev_ctrl.kernels.hill import _amplitudes, _real_form, folded_distance


def mathieu(a: float, q: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """y'' + (a - 2 q cos 2 t) y = 0."""
    return np.array([[0.0, 1.0], [-a, 0.0]]), np.array([[[0.0, 0.0], [2.0 * q, 0.0]]]), np.zeros((1, 2, 2))


def test_block_against_definition() -> None:
    rng = np.random.default_rng(2)
    A_0, cosine, sine = rng.standard_normal((2, 2)), rng.standard_normal((2, 2, 2)), rng.standard_normal((2, 2, 2))
    N, W = 3, 1.7
    matrix = hill_matrix(A_0, cosine, sine, frequency=W, harmonics=N).reshape(7, 2, 7, 2)
    for k in range(7):
        for m in range(7):
            q = k - m
            block = np.zeros((2, 2), dtype=complex)
            if q == 0:
                block = A_0 - 1j * (k - N) * W * np.eye(2)
            elif abs(q) <= 2:
                block = 0.5 * (cosine[abs(q) - 1] - np.sign(q) * 1j * sine[abs(q) - 1])
            assert np.array_equal(matrix[k, :, m, :], block)


def test_constant_system_gives_its_eigenvalues_once_each() -> None:
    A_0 = np.diag([-1.0, -2.0, -125.0])
    spectrum = hill_spectrum(A_0, np.zeros((1, 3, 3)), np.zeros((1, 3, 3)), frequency=4.0)
    assert spectrum.converged
    assert np.allclose(spectrum.exponents, [-1.0, -2.0, -125.0], atol=1e-12)


def test_degenerate_families_are_counted() -> None:
    """Two uncoupled oscillators whose frequencies differ by exactly 3 W have exponents that coincide modulo i W."""
    A_0 = np.zeros((4, 4))
    A_0[:2, :2] = [[0.0, 1.0], [-1.0, -0.1]]
    w = np.sqrt(1.0 - 0.05**2) + 3 * 0.7
    A_0[2:, 2:] = [[0.0, 1.0], [-(w**2 + 0.05**2), -0.1]]
    spectrum = hill_spectrum(A_0, np.zeros((1, 4, 4)), np.zeros((1, 4, 4)), frequency=0.7)
    assert spectrum.converged
    assert np.allclose(spectrum.exponents.real, -0.05, atol=1e-12)


def test_more_harmonics_do_not_change_the_exponents() -> None:
    A_0, cosine, sine = mathieu(1.3, 0.9)
    spectrum = hill_spectrum(A_0, cosine, sine, frequency=2.0)
    for harmonics in (spectrum.harmonics + 4, spectrum.harmonics + 20):
        values = np.linalg.eigvals(hill_matrix(A_0, cosine, sine, frequency=2.0, harmonics=harmonics))
        for s in spectrum.exponents:
            assert np.min(np.abs(values - s)) < 1e-10


def test_mathieu_stability_edges() -> None:
    """Inside the first tongue (b1 < a < a1) real growth, outside none; q = 0.5: a1 = 1.4667, b1 = 0.4708."""
    inside = hill_spectrum(*mathieu(1.0, 0.5), frequency=2.0)
    outside = hill_spectrum(*mathieu(2.5, 0.5), frequency=2.0)
    assert inside.exponents.real[0] > 0.1
    assert np.max(np.abs(outside.exponents.real)) < 1e-11


def test_sign_of_the_shift_mutant_is_caught() -> None:
    """The conjugate coupling on the wrong side changes the spectrum of a phase-lagged system."""
    rng = np.random.default_rng(3)
    A_0 = np.array([[0.0, 1.0], [-1.0, -0.1]])
    cosine, sine = rng.standard_normal((2, 2, 2)), rng.standard_normal((2, 2, 2))
    right = hill_spectrum(A_0, cosine, sine, frequency=2.0)
    wrong = hill_spectrum(A_0, cosine, np.stack([sine[0], -sine[1]]), frequency=2.0)
    assert np.max(folded_distance(right.exponents, wrong.exponents, 2.0)) > 1e-3


def test_pair_returns_both_vectors() -> None:
    A_0, cosine, sine = mathieu(1.0, 0.3)
    spectrum = hill_spectrum(A_0, cosine, sine, frequency=2.0)
    matrix = hill_matrix(A_0, cosine, sine, frequency=2.0, harmonics=10)
    value, _, left, residual = hill_pair(matrix, complex(spectrum.exponents[0]) + 1e-5)
    assert abs(value - spectrum.exponents[0]) < 1e-11
    assert residual < 1e-10
    assert np.linalg.norm(left.conj() @ matrix - value * left.conj()) < 1e-9


def test_real_form_is_the_same_operator() -> None:
    """Unitary change of basis: same spectrum, vectors that satisfy the complex problem; a swapped sign is caught."""
    rng = np.random.default_rng(4)
    A_0, cosine, sine = rng.standard_normal((3, 3)), rng.standard_normal((2, 3, 3)), rng.standard_normal((2, 3, 3))
    matrix = hill_matrix(A_0, cosine, sine, frequency=1.3, harmonics=4)
    real = _real_form(matrix, 3)
    assert np.isclose(np.linalg.norm(real), np.linalg.norm(matrix), rtol=1e-14)
    values, vectors = np.linalg.eig(real)
    back = _amplitudes(vectors.T.reshape(-1, 9, 3)).reshape(-1, 27).T
    assert np.max(np.abs(matrix @ back - back * values)) < 1e-12 * np.linalg.norm(matrix)
    assert np.allclose(np.linalg.norm(back, axis=0), 1.0, rtol=1e-13)
    mutant = _amplitudes(vectors.T.reshape(-1, 9, 3)[:, ::-1]).reshape(-1, 27).T
    assert np.max(np.abs(matrix @ mutant - mutant * values)) > 1e-2
