"""Series in two variables, and the monodromy matrices of many systems at once."""

from __future__ import annotations

import numpy as np
import pytest

import maglev_ctrl.kernels.taylor_many as many_module
from maglev_ctrl.analysis.floquet import plan_for
from maglev_ctrl.kernels import monodromy_over_depths
from maglev_ctrl.kernels.plane_series import Direction, plane_series, shortened, tails
from maglev_ctrl.kernels.taylor_many import monodromy_many


def surface(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """A (p, q, 2, 2) function entire in 1/x and y."""
    a, b = 3.0 / x[:, None], y[None, :]
    return np.stack([np.stack([np.cos(a + b), np.sin(a * b)], -1), np.stack([np.exp(b - a), a + b], -1)], -1)


X, Y = Direction(0.5, 3.0, reciprocal=True), Direction(-0.3, 0.8)


def test_series_reproduces_an_entire_function_within_its_error() -> None:
    series = plane_series(surface(X.points(33), Y.points(21)), x=X, y=Y)
    x, y = np.linspace(0.5, 3.0, 23), np.linspace(-0.3, 0.8, 17)
    apart = np.max(np.linalg.norm(series.grid(x, y) - surface(x, y), axis=(2, 3)))
    assert apart < 1e-11
    assert np.allclose(series.points(x[:17], y), series.grid(x, y)[np.arange(17), np.arange(17)], atol=1e-13)


@pytest.mark.parametrize(("count_x", "count_y"), [(9, 15), (15, 7), (11, 11), (7, 5)])
def test_tails_bound_the_error_of_a_short_series(count_x: int, count_y: int) -> None:
    series = plane_series(surface(X.points(count_x), Y.points(count_y)), x=X, y=Y)
    x, y = np.linspace(0.5, 3.0, 41), np.linspace(-0.3, 0.8, 37)
    apart = np.max(np.linalg.norm(series.grid(x, y) - surface(x, y), axis=(2, 3)))
    assert 1e-9 < apart <= 2.0 * series.error


def test_tail_of_one_direction_alone_does_not_bound_the_error() -> None:
    """Mutant: an estimate that looks along x only calls a series good that y spoils."""
    series = plane_series(surface(X.points(33), Y.points(5)), x=X, y=Y)
    y = np.linspace(-0.3, 0.8, 37)
    apart = np.max(np.abs(series.grid(X.points(33), y) - surface(X.points(33), y)))
    end = tails(series.coefficients)
    assert apart > 100.0 * end.x
    assert apart <= 2.0 * (end.x + end.y)


def test_nested_points_are_shared() -> None:
    assert np.allclose(X.points(33)[::2], X.points(17), rtol=1e-15)
    assert X.points(9)[0] == 0.5
    assert X.points(9)[-1] == 3.0


def test_shortening_costs_no_more_than_allowed() -> None:
    series = plane_series(surface(X.points(49), Y.points(33)), x=X, y=Y)
    short = shortened(series, allowed=1e-8)
    x, y = np.linspace(0.5, 3.0, 23), np.linspace(-0.3, 0.8, 17)
    assert short.coefficients.shape[0] < 40
    assert np.max(np.linalg.norm(short.grid(x, y) - surface(x, y), axis=(2, 3))) <= short.error <= 2e-8


def test_points_outside_are_refused() -> None:
    series = plane_series(surface(X.points(9), Y.points(9)), x=X, y=Y)
    with pytest.raises(ValueError, match=r"expected values within 0\.5\.\.3"):
        series.grid(np.array([0.4]), np.array([0.0]))


def systems(count: int, n: int, harmonics: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(5)
    A_0 = rng.standard_normal((count, n, n)) - 2.0 * np.eye(n)
    A_cos, A_sin = 0.3 * rng.standard_normal((2, count, harmonics, n, n))
    A_cos[..., n // 2 :] = A_sin[..., n // 2 :] = 0.0  # the modulation reads half of the states
    return A_0, A_cos, A_sin, np.linspace(0.7, 9.0, count)


@pytest.mark.parametrize(("n", "harmonics", "levels"), [(4, 1, 9), (6, 3, 5), (3, 2, 1), (2, 1, 40)])
def test_many_systems_equal_one_system_at_a_time(n: int, harmonics: int, levels: int) -> None:
    A_0, A_cos, A_sin, frequency = systems(7, n, harmonics)
    depths = np.linspace(-0.5, 1.0, levels) if levels > 1 else np.ones(1)
    found = monodromy_many(A_0, A_cos, A_sin, frequency=frequency, depths=None if levels == 1 else depths)
    for k in range(7):
        one = A_0[k], A_cos[k], A_sin[k]
        plan = plan_for(*one, frequency=frequency[k], tolerance=1e-16)
        exact = monodromy_over_depths(*one, frequency=frequency[k], depths=depths, plan=plan)
        apart = np.linalg.norm(found.matrices[k] - exact, axis=(1, 2)) / np.linalg.norm(exact, axis=(1, 2))
        assert np.max(apart) <= max(found.error[k], 1e-12)


def test_both_ways_of_integrating_agree(monkeypatch: pytest.MonkeyPatch) -> None:
    A_0, A_cos, A_sin, frequency = systems(5, 4, 1)
    depths = np.linspace(0.0, 1.0, 30)
    expanded = monodromy_many(A_0, A_cos, A_sin, frequency=frequency, depths=depths).matrices
    monkeypatch.setattr(many_module, "degree_for", lambda *args, **named: None)
    single = monodromy_many(A_0, A_cos, A_sin, frequency=frequency, depths=depths).matrices
    assert np.allclose(expanded, single, rtol=1e-11, atol=1e-12)


def test_sine_sign_mutant_is_caught() -> None:
    A_0, A_cos, A_sin, frequency = systems(2, 4, 2)
    right = monodromy_many(A_0, A_cos, A_sin, frequency=frequency).matrices
    wrong = monodromy_many(A_0, A_cos, -A_sin, frequency=frequency).matrices
    assert np.max(np.abs(right - wrong)) > 1e-3
