"""Rounding bounds hold the exact result; signs of eigenvalues are told rightly, or not at all."""

from __future__ import annotations

import math
from fractions import Fraction

import mpmath
import numpy as np
import pytest

from maglev_ctrl.proofs.enclosure import Enclosure, NotDecided, definite
from maglev_ctrl.proofs.exact import Exact, decay_factor, exactly_definite


def held(enclosure: Enclosure, exact: Exact) -> bool:
    """Every exact entry is within the radius of its midpoint, compared as fractions."""
    for i, row in enumerate(exact.fractions()):
        for j, value in enumerate(row):
            if abs(value - Fraction(float(enclosure.middle[i, j]))) > Fraction(float(enclosure.spread[i, j])):
                return False
    return True


def spread_numbers(rng: np.random.Generator, shape: tuple[int, int], decades: float) -> np.ndarray:
    return rng.standard_normal(shape) * 10.0 ** rng.uniform(-decades, decades, shape)


@pytest.mark.parametrize("decades", [0.0, 8.0, 70.0])
def test_sums_products_and_inverses_hold_the_exact_result(decades: float) -> None:
    rng = np.random.default_rng(3)
    for _ in range(30):
        n = int(rng.integers(1, 6))
        given = [spread_numbers(rng, (n, n), decades) for _ in range(3)]
        r = [Enclosure.of(x) for x in given]
        q = [Exact.of(x) for x in given]
        with np.errstate(all="ignore"):
            pairs = [
                (r[0] @ r[1] - r[2], q[0] @ q[1] - q[2]),
                ((r[0] @ r[1]) @ (r[2] + r[0]), (q[0] @ q[1]) @ (q[2] + q[0])),
                ((r[0] @ r[1]).T.times(0.1).over(3), (q[0] @ q[1]).T.times(0.1).over(3)),
                (
                    Enclosure.blocks([[r[0], -r[1]], [r[2] @ r[2], r[0]]]),
                    Exact.blocks([[q[0], -q[1]], [q[2] @ q[2], q[0]]]),
                ),
            ]
        assert all(held(one, exact) for one, exact in pairs)


def test_what_underflow_loses_is_in_the_radius() -> None:
    X, Y = np.full((2, 2), 1.1e-170), np.full((2, 2), 1.3e-160)
    assert np.all(X @ Y == 0.0)
    assert held(Enclosure.of(X) @ Enclosure.of(Y), Exact.of(X) @ Exact.of(Y))


def test_mutant_a_radius_of_a_hundredth_does_not_hold_the_exact_result() -> None:
    rng = np.random.default_rng(4)
    X, Y = rng.standard_normal((2, 6, 6))
    one = Enclosure.of(X) @ Enclosure.of(Y)
    assert held(one, Exact.of(X) @ Exact.of(Y))
    assert one.radius is not None
    assert not held(Enclosure(one.middle, one.radius * 0.01), Exact.of(X) @ Exact.of(Y))


def test_inverse_is_enclosed_or_not_given() -> None:
    rng = np.random.default_rng(5)
    for decades in (0.0, 3.0):
        for _ in range(20):
            X = spread_numbers(rng, (4, 4), decades)
            try:
                found = Enclosure.of(X).inverse()
            except NotDecided:
                continue
            assert held(found, Exact.of(X).inverse())
    with pytest.raises(NotDecided):
        Enclosure.of([[1.0, 2.0], [2.0, 4.0]]).inverse()
    with pytest.raises(ZeroDivisionError):
        Exact.of([[1.0, 2.0], [2.0, 4.0]]).inverse()


def smallest_eigenvalue(matrix: np.ndarray) -> mpmath.mpf:
    with mpmath.workdps(120):
        return min(mpmath.eigsy(mpmath.matrix(matrix.tolist()), eigvals_only=True))


def test_definiteness_agrees_with_many_digits() -> None:
    """Near-singular matrices with the sign of the smallest eigenvalue on either side, down to one unit in the last."""
    rng = np.random.default_rng(6)
    proved = told = 0
    for trial in range(120):
        n = int(rng.integers(2, 8))
        basis = np.linalg.qr(rng.standard_normal((n, n)))[0]
        values = 10.0 ** rng.uniform(-3, 3, n)
        values[0] = rng.choice([-1, 1]) * 10.0 ** rng.uniform(-18, -8)
        S = basis * values @ basis.T
        S = np.tril(S) + np.tril(S, -1).T
        if trial % 3 == 0:
            scale = np.exp2(rng.integers(-60, 60, n))
            S = S * scale[:, None] * scale
        positive = smallest_eigenvalue(S) > 0
        rounded = definite(Enclosure.of(S))[0]
        exact = exactly_definite(Exact.of(S))[0]
        assert not (rounded and not positive)
        assert exact == positive
        proved += rounded
        told += positive
    assert 10 < proved <= told  # the cheap test is worth having, and never goes too far


def test_an_enclosure_is_definite_only_if_all_of_it_is() -> None:
    S = np.diag([1.0, 1.0])
    assert definite(Enclosure(S, np.full((2, 2), 0.49)))[0]
    assert not definite(Enclosure(S, np.full((2, 2), 0.51)))[0]
    assert not definite(Enclosure.of([[np.nan, 0.0], [0.0, 1.0]]))[0]
    assert definite(Enclosure.of(np.zeros((0, 0))))[0]


@pytest.mark.parametrize("n", [30, 60])
def test_large_matrices_are_decided_in_better_coordinates(n: int) -> None:
    rng = np.random.default_rng(n)
    factor = rng.standard_normal((n, n))
    factor[:, -1] = factor[:, 0] * (1.0 + 2.0**-40)
    gram = Exact.of(factor).T @ Exact.of(factor)  # exactly positive definite unless singular
    assert not definite(Enclosure.of(factor.T @ factor))[0]
    assert exactly_definite(gram)[0] is True
    factor[:, -1] = factor[:, 0]
    assert exactly_definite(Exact.of(factor).T @ Exact.of(factor))[0] is not True


def test_entries_beyond_every_float_refute() -> None:
    assert exactly_definite(Exact.of([[1e-300, 1e300], [1e300, 1e-300]]))[0] is False
    assert exactly_definite(Exact.of([[1e300, 1.0], [1.0, 1e-299]]))[0] is True


def test_too_large_matrices_are_not_decided() -> None:
    assert exactly_definite(Exact.of(np.eye(121)))[0] is None


@pytest.mark.parametrize(("rate", "dt"), [(0.5, 0.01), (3.0, 2.0), (-0.7, 0.3), (1e-9, 1e-3), (40.0, 7.0), (1e3, 1.0)])
def test_decay_factor_is_just_below_the_exponential(rate: float, dt: float) -> None:
    with mpmath.workdps(60):
        true = mpmath.exp(-2 * mpmath.mpf(rate) * mpmath.mpf(dt))
        found = mpmath.mpf(decay_factor(rate, dt))
        assert found <= true
        assert found >= true * (1 - mpmath.mpf(2) ** -51) or abs(2 * rate * dt) > 600
    assert decay_factor(0.0, 1.0) == 1.0
    assert math.isfinite(decay_factor(-1e6, 1.0))
