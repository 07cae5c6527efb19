"""Lyapunov inertia against exact root counts: two methods that share nothing."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from maglev_ctrl.analysis.hurwitz import lyapunov_inertia
from maglev_ctrl.analysis.routh import exact_root_count, root_count
from maglev_ctrl.errors import ModelError
from maglev_ctrl.systems import SecondOrderSystem


def random_system(seed: int, *, n: int = 3) -> SecondOrderSystem:
    rng = np.random.default_rng(seed)
    root = rng.standard_normal((n, n))
    shift = rng.uniform(-1.0, 3.0)
    C, K = rng.standard_normal((n, n)) + shift * np.eye(n), 4.0 * rng.standard_normal((n, n)) + 4.0 * shift * np.eye(n)
    return SecondOrderSystem.from_matrices(root @ root.T + np.eye(n), C, K)


@pytest.mark.parametrize("seed", range(25))
def test_inertia_equals_the_exact_count(seed: int) -> None:
    system = random_system(seed)
    certificate, exact = lyapunov_inertia(system.state_matrix()), exact_root_count(system)
    assert certificate.certified
    assert exact.axis == 0
    assert (certificate.left, certificate.right) == (exact.left, exact.right)


def test_inertia_mutant_is_caught() -> None:
    counts = [(lyapunov_inertia(-random_system(k).state_matrix()).right, exact_root_count(random_system(k)).right)
              for k in range(5)]  # fmt: skip
    assert any(mutant != exact for mutant, exact in counts)  # a flipped sign of A does not pass


def test_shift_counts_right_of_a_line() -> None:
    A = np.diag([-3.0, -1.0, 0.5, 2.0])
    assert [lyapunov_inertia(A, shift=line).right for line in (-2.0, 0.0, 1.0)] == [3, 2, 1]


def test_light_damping_needs_the_modal_basis() -> None:
    turn = np.linalg.qr(np.random.default_rng(1).standard_normal((3, 3)))[0]
    w, zeta = np.array([1.0, 10.0, 100.0]), 1e-10
    system = SecondOrderSystem.from_matrices(
        np.eye(3), turn @ np.diag(2 * zeta * w) @ turn.T, turn @ np.diag(w**2) @ turn.T
    )
    certificate = lyapunov_inertia(system.state_matrix())
    assert certificate.certified
    assert certificate.right == 0
    assert certificate.method == "modal basis"
    assert exact_root_count(system).right == 0


def test_imaginary_axis_is_never_certified() -> None:
    assert not lyapunov_inertia(np.array([[0.0, 1.0], [-4.0, 0.0]])).certified
    assert not lyapunov_inertia(np.zeros((2, 2))).certified


def test_exact_count_of_singular_cases() -> None:
    def polynomial(*factors: list[int]) -> list[Fraction]:
        product = [Fraction(1)]
        for factor in factors:
            grown = [Fraction(0)] * (len(product) + len(factor) - 1)
            for i, a in enumerate(product):
                for j, b in enumerate(factor):
                    grown[i + j] += a * b
            product = grown
        return product

    cases = {
        (2, 0, 0): [[1, 1], [2, 1]],
        (0, 4, 0): [[4, 0, 1], [4, 0, 1]],  # (s^2 + 4)^2
        (1, 3, 0): [[0, 1], [1, 0, 1], [1, 1]],  # s (s^2 + 1)(s + 1)
        (2, 0, 2): [[5, 2, 1], [5, -2, 1]],  # a quadruple symmetric about both axes
        (1, 2, 1): [[-1, 0, 1], [9, 0, 1]],
        (3, 0, 2): [[2, 1], [5, 2, 1], [5, -2, 1]],
        (0, 0, 1): [[-3, 1]],
    }
    for expected, factors in cases.items():
        count = root_count(polynomial(*factors))
        assert (count.left, count.axis, count.right) == expected


def test_wrong_use_is_named() -> None:
    with pytest.raises(ValueError, match="square"):
        lyapunov_inertia(np.zeros((2, 3)))
    with pytest.raises(ValueError, match="not zero"):
        root_count([Fraction(0)])
    with pytest.raises(ModelError, match="singular"):
        exact_root_count(SecondOrderSystem.from_matrices([[0.0]], [[1.0]], [[1.0]]))
    with pytest.raises(ValueError, match="batch"):
        exact_root_count(SecondOrderSystem.from_matrices([[1.0]], [[1.0]], [[[1.0]], [[2.0]]]))
