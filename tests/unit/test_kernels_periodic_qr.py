"""Periodic QR: multipliers of long products whose moduli spread over many decades."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest

from maglev_ctrl.kernels import periodic_multipliers


def spread_product(count: int, exponents: np.ndarray, seed: int, angle: float = 0.0) -> np.ndarray:
    """Factors S_(k+1) D S_k^-1 with S_count = S_0: the product has the eigenvalues of D^count exactly."""
    rng = np.random.default_rng(seed)
    n = len(exponents)
    bases = [np.linalg.qr(rng.standard_normal((n, n)))[0] @ (np.eye(n) + 0.2 * rng.standard_normal((n, n)))
             for _ in range(count)]  # fmt: skip
    bases.append(bases[0])
    step = np.diag(np.exp(exponents / count))
    if angle:
        c, s = np.cos(angle / count), np.sin(angle / count)
        step[:2, :2] = step[0, 0] * np.array([[c, -s], [s, c]])
    return np.array([bases[k + 1] @ step @ np.linalg.inv(bases[k]) for k in range(count)])


def test_three_hundred_factors_keep_every_multiplier() -> None:
    """The case that ruins the explicit product: 7.7e-53, 4.2e-18, 1.0001, 1.07e13 over 300 factors."""
    logs = np.log(np.array([1.07e13, 1.0001, 4.2e-18, 7.7e-53]))
    factors = spread_product(300, logs, 5)
    found = periodic_multipliers(factors)
    assert found.converged
    # 300 factors, each formed with rounding error of a well conditioned 4 x 4 product
    assert np.max(np.abs(found.logs - logs)) < 2e-12
    product = np.linalg.multi_dot(list(factors[::-1]))
    explicit = np.sort(np.abs(np.linalg.eigvals(product)))[::-1]
    assert np.max(np.abs(np.log(explicit[2:]) - logs[2:])) > 1.0  # what the product makes of the small ones


def test_complex_pair_between_spread_moduli() -> None:
    logs = np.array([0.3, 0.3, -40.0, -90.0])
    found = periodic_multipliers(spread_product(120, logs, 7, angle=1.1))
    assert np.allclose(found.logs.real, logs, atol=2e-12)
    assert np.allclose(np.sort(found.logs.imag[:2]), [-1.1, 1.1], atol=2e-12)


def test_equal_moduli_of_both_signs() -> None:
    factors = np.array([np.diag([2.0, -2.0, 1e-8])] * 3)
    found = periodic_multipliers(factors)
    assert np.allclose(np.sort(np.exp(found.logs).real), [-8.0, 1e-24, 8.0], rtol=1e-12, atol=1e-30)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_against_forty_digits(seed: int) -> None:
    factors = np.random.default_rng(seed).standard_normal((25, 4, 4))
    with mpmath.workdps(60):
        product = mpmath.eye(4)
        for factor in factors:
            product = mpmath.matrix(factor.tolist()) * product
        exact = sorted((complex(mpmath.log(abs(x))).real for x in mpmath.eig(product)[0]), reverse=True)
    found = periodic_multipliers(factors)
    assert np.max(np.abs(found.logs.real - exact)) < 1e-8
    assert np.all(np.abs(found.logs.real - exact)[:2] < 1e-9)


def test_order_of_factors_matters_mutant_is_caught() -> None:
    factors = np.random.default_rng(9).standard_normal((4, 3, 3))
    expected = np.sort_complex(np.linalg.eigvals(factors[3] @ factors[2] @ factors[1] @ factors[0]))
    assert np.allclose(np.sort_complex(np.exp(periodic_multipliers(factors).logs)), expected, rtol=1e-9)
    mutant = np.sort_complex(np.exp(periodic_multipliers(factors[[0, 2, 1, 3]]).logs))
    assert not np.allclose(mutant, expected, rtol=1e-3)


def test_wrong_shape_is_refused() -> None:
    with pytest.raises(ValueError, match="factors: expected shape"):
        periodic_multipliers(np.eye(3))


@pytest.mark.parametrize("seed", [4, 5])
def test_error_covers_factors_that_cancel(seed: int) -> None:
    """Stretching and its inverse in turn: grouped products look harmless, what they lost is in the error told."""
    rng = np.random.default_rng(seed)
    factors = []
    for _ in range(6):
        basis, other = (np.linalg.qr(rng.standard_normal((3, 3)))[0] for _ in range(2))
        stretch = basis @ np.diag([1e5, 1.0, 1e-4]) @ other
        factors += [stretch, np.diag([1.3, 0.9, 0.8]) @ np.linalg.inv(stretch)]
    found = periodic_multipliers(np.array(factors))
    with mpmath.workdps(60):
        product = mpmath.eye(3)
        for factor in factors:
            product = mpmath.matrix(factor.tolist()) * product
        exact = sorted((float(mpmath.log(abs(x))) for x in mpmath.eig(product)[0]), reverse=True)
    off = np.abs(found.logs.real - exact)
    assert np.all(off <= found.error)
    assert np.max(off) > 1e-12  # beyond what well conditioned factors would leave: the account is needed
