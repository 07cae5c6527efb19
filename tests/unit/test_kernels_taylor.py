"""Taylor propagators against an independent integrator, closed forms, and their own truncation bound."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from maglev_ctrl.kernels import monodromy_over_depths, propagators_over_depths, taylor_plan, tree_product


def random_system(seed: int, n: int = 5, harmonics: int = 2) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    cosine, sine = rng.standard_normal((harmonics, n, n)), rng.standard_normal((harmonics, n, n))
    cosine[0][:, 2] = 0.0  # a state the modulation does not read
    sine[-1] = 0.0
    return rng.standard_normal((n, n)), cosine, sine


def plan(A_0: np.ndarray, cosine: np.ndarray, sine: np.ndarray, frequency: float, depth: float, segments: int = 1):
    norms = np.array([np.linalg.norm(a, 2) + np.linalg.norm(b, 2) for a, b in zip(cosine, sine, strict=True)])
    return taylor_plan(float(np.linalg.norm(A_0, 2)), depth * norms, frequency=frequency, min_segments=segments)


def reference(A_0, cosine, sine, frequency, depth) -> np.ndarray:
    n = len(A_0)

    def rate(t: float, x: np.ndarray) -> np.ndarray:
        A = A_0 + depth * sum(
            cosine[k] * np.cos((k + 1) * frequency * t) + sine[k] * np.sin((k + 1) * frequency * t)
            for k in range(len(cosine))
        )
        return (A @ x.reshape(n, n)).ravel()

    solved = solve_ivp(rate, (0.0, 2 * np.pi / frequency), np.eye(n).ravel(), method="DOP853", rtol=1e-12, atol=1e-13)
    return solved.y[:, -1].reshape(n, n)


@pytest.mark.parametrize("segments", [1, 7, 40])
def test_monodromy_equals_dop853(segments: int) -> None:
    A_0, cosine, sine = random_system(1)
    depths = np.array([0.0, 0.3])
    found = monodromy_over_depths(
        A_0, cosine, sine, frequency=2.3, depths=depths, plan=plan(A_0, cosine, sine, 2.3, 0.3, segments)
    )
    exact = reference(A_0, cosine, sine, 2.3, 0.3)
    assert np.max(np.abs(found[1] - exact)) < 1e-10 * np.max(np.abs(exact))  # the integrator's own error
    assert np.allclose(found[0], expm(A_0 * 2 * np.pi / 2.3), rtol=1e-12, atol=1e-13)


def test_swapped_sine_is_caught() -> None:
    A_0, cosine, sine = random_system(1)
    mutant = monodromy_over_depths(
        A_0, cosine, -sine, frequency=2.3, depths=np.array([0.3]), plan=plan(A_0, cosine, sine, 2.3, 0.3)
    )[0]
    assert np.max(np.abs(mutant - reference(A_0, cosine, sine, 2.3, 0.3))) > 1e-2


def test_scalar_closed_form() -> None:
    """x' = (a + b cos W t + c sin W t) x: over a segment log x grows by the integral."""
    a, b, c, W = -0.7, 1.3, 0.4, 3.0
    cosine, sine = np.array([[[b]]]), np.array([[[c]]])
    found = propagators_over_depths(
        np.array([[a]]), cosine, sine, frequency=W, depths=np.array([1.0]),
        plan=plan(np.array([[a]]), cosine, sine, W, 1.0, 3),
    )[0, :, 0, 0]  # fmt: skip
    t = np.linspace(0.0, 2 * np.pi / W, len(found) + 1)
    integral = a * t + b / W * np.sin(W * t) + c / W * (1.0 - np.cos(W * t))
    assert np.allclose(found, np.exp(np.diff(integral)), rtol=5e-15)


def test_truncation_bound_holds_and_is_needed() -> None:
    """The majorant is a bound: a plan cut to a low order stays below the tail computed for that order."""
    A_0, cosine, sine = random_system(4)
    loose = taylor_plan(float(np.linalg.norm(A_0, 2)), np.array([
        np.linalg.norm(cosine[k], 2) + np.linalg.norm(sine[k], 2) for k in range(2)
    ]) * 0.3, frequency=2.3, tolerance=1e-5)  # fmt: skip
    tight = plan(A_0, cosine, sine, 2.3, 0.3, loose.segments)
    arguments = {"frequency": 2.3, "depths": np.array([0.3])}
    coarse = propagators_over_depths(A_0, cosine, sine, plan=loose, **arguments)[0]
    assert loose.truncation <= 1e-5
    assert tight.truncation <= 1e-16
    fine = monodromy_over_depths(A_0, cosine, sine, plan=tight, **arguments)[0]
    error = np.linalg.norm(tree_product(coarse) - fine, 2)
    growth = np.prod([max(np.linalg.norm(X, 2), 1.0) + loose.truncation for X in coarse])
    assert 0.0 < error <= loose.segments * loose.truncation * growth


def test_tree_product_keeps_the_order_of_time() -> None:
    rng = np.random.default_rng(0)
    factors = rng.standard_normal((7, 3, 3))
    expected = np.eye(3)
    for factor in factors:
        expected = factor @ expected
    assert np.allclose(tree_product(factors), expected, rtol=1e-13)
    assert not np.allclose(tree_product(factors[::-1]), expected, rtol=1e-3)
