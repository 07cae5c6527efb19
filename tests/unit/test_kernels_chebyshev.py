"""Chebyshev series: exact on polynomials, tail as an error estimate, refusal to extrapolate."""

from __future__ import annotations

import numpy as np
import pytest

from maglev_ctrl.kernels import balance, chebyshev_series, piecewise_propagators, rescale
from maglev_ctrl.kernels.chebyshev import chebyshev_points


def test_polynomials_are_exact() -> None:
    x = chebyshev_points(6, lower=-1.0, upper=3.0)
    series = chebyshev_series(1.0 - 2.0 * x + x**5, lower=-1.0, upper=3.0)
    probe = np.linspace(-1.0, 3.0, 17)
    assert np.allclose(series(probe), 1.0 - 2.0 * probe + probe**5, rtol=0, atol=1e-12)


def test_points_are_nested() -> None:
    fine, coarse = chebyshev_points(17, lower=0.0, upper=0.2), chebyshev_points(9, lower=0.0, upper=0.2)
    assert np.allclose(fine[::2], coarse, rtol=0, atol=1e-17)


@pytest.mark.parametrize("count", [7, 9, 12, 17])
def test_tail_bounds_the_error_of_an_entire_function(count: int) -> None:
    x = chebyshev_points(count, lower=0.0, upper=1.0)
    values = np.stack([np.exp(2.0 * x), np.cos(3.0 * x)], axis=1)
    series = chebyshev_series(values, lower=0.0, upper=1.0)
    probe = np.linspace(0.0, 1.0, 301)
    error = np.max(np.linalg.norm(series(probe) - np.stack([np.exp(2 * probe), np.cos(3 * probe)], axis=1), axis=1))
    largest = np.max(np.linalg.norm(series.coefficients, axis=1))
    assert error <= series.tail * largest + 1e-14


def test_tail_does_not_fall_across_a_kink() -> None:
    x = chebyshev_points(33, lower=0.0, upper=1.0)
    assert chebyshev_series(np.abs(x - 0.4), lower=0.0, upper=1.0).tail > 1e-5


def test_extrapolation_is_refused() -> None:
    series = chebyshev_series(np.ones(5), lower=0.0, upper=1.0)
    with pytest.raises(ValueError, match="points: expected values within"):
        series(np.array([1.01]))


def test_balance_undoes_mixed_units() -> None:
    rng = np.random.default_rng(0)
    A = rng.standard_normal((6, 6))
    d = 2.0 ** rng.integers(-30, 30, 6)
    spoiled = A * d / d[:, None]
    mended = rescale(spoiled, balance(np.abs(spoiled)))
    assert np.linalg.norm(mended) < 10.0 * np.linalg.norm(A)
    assert np.linalg.norm(spoiled) > 1e6 * np.linalg.norm(A)
    assert np.allclose(np.sort_complex(np.linalg.eigvals(mended)), np.sort_complex(np.linalg.eigvals(A)), atol=1e-12)


def test_piecewise_propagators_are_exact_and_keep_their_order() -> None:
    spring = [[0.0, 1.0], [-4.0, 0.0]]
    found = piecewise_propagators([spring, [[0.0, 1.0], [0.0, 0.0]]], [0.3, 0.5])
    c, s = np.cos(0.6), np.sin(0.6)
    assert np.allclose(found[0], [[c, s / 2.0], [-2.0 * s, c]], atol=1e-14)
    assert np.allclose(found[1], [[1.0, 0.5], [0.0, 1.0]], atol=1e-15)


@pytest.mark.parametrize("durations", [[0.3, 0.0], [0.3, -1.0]])
def test_durations_must_be_positive(durations: list[float]) -> None:
    with pytest.raises(ValueError, match="durations: expected positive"):
        piecewise_propagators(np.zeros((2, 2, 2)), durations)
