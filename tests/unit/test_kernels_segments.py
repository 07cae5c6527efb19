"""Segment propagators as polynomials in the modulation: against direct integration; the bound on the remainder."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

import maglev_ctrl.kernels.taylor as taylor
from maglev_ctrl.kernels import TaylorPlan, propagators_over_depths
from maglev_ctrl.kernels.segments import count_monomials, degree_for, monomials, segment_coefficients


def random_system(seed: int, n: int, harmonics: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    cosine, sine = rng.standard_normal((harmonics, n, n)), rng.standard_normal((harmonics, n, n))
    cosine[:, :, 1] = sine[:, :, 1] = 0.0
    return 4.0 * rng.standard_normal((n, n)), cosine, sine


def test_monomials_are_products_of_powers() -> None:
    basis = monomials(3, 4)
    z = np.random.default_rng(3).standard_normal((5, 3))
    expected = np.prod(z[:, None, :] ** basis.powers[None, :, :], axis=2)
    assert len(basis.powers) == count_monomials(3, 4) == 35
    assert np.allclose(basis.values(z), expected, rtol=1e-14)
    for q in range(3):
        for i in np.flatnonzero(basis.parents[q] >= 0):
            lower = basis.powers[i].copy()
            lower[q] -= 1
            assert np.array_equal(basis.powers[basis.parents[q, i]], lower)


@pytest.mark.parametrize(("n", "harmonics", "segments"), [(4, 1, 60), (6, 2, 900)])
def test_expansion_equals_direct_integration(
    n: int, harmonics: int, segments: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    A_0, cosine, sine = random_system(n, n, harmonics)
    plan, depths = TaylorPlan(segments, 24, 1e-14), np.array([0.0, 0.013, 0.03])
    arguments = {"frequency": 2.3, "depths": depths, "plan": plan}
    direct = taylor._one_by_one(A_0, cosine, sine, **arguments)
    monkeypatch.setattr(taylor, "_one_by_one", None)  # the expansion has to be taken
    found = propagators_over_depths(A_0, cosine, sine, **arguments)
    assert np.max(np.abs(found - direct)) < 2e-14 * np.max(np.abs(direct))
    assert np.allclose(found[0], expm(A_0 * 2 * np.pi / (2.3 * segments)), rtol=1e-13, atol=1e-14)


def test_one_segment_against_an_integrator() -> None:
    """The same propagator by DOP853, and the mutant that turns the phase the wrong way."""
    A_0, cosine, sine = random_system(2, 3, 1)
    W, segments, depth, k = 2.0, 40, 0.05, 13
    plan = TaylorPlan(segments, 24, 1e-14)

    def rate(t: float, x: np.ndarray) -> np.ndarray:
        return ((A_0 + depth * (cosine[0] * np.cos(W * t) + sine[0] * np.sin(W * t))) @ x.reshape(3, 3)).ravel()

    step = 2 * np.pi / (W * segments)
    exact = solve_ivp(rate, (k * step, (k + 1) * step), np.eye(3).ravel(), method="DOP853", rtol=1e-13, atol=1e-14)
    expected = exact.y[:, -1].reshape(3, 3)
    depths = np.linspace(0.0, depth, 3)
    found = propagators_over_depths(A_0, cosine, sine, frequency=W, depths=depths, plan=plan)[-1, k]
    mutant = propagators_over_depths(A_0, cosine, -sine, frequency=W, depths=depths, plan=plan)[-1, k]
    assert np.max(np.abs(found - expected)) < 1e-12
    assert np.max(np.abs(mutant - expected)) > 1e-4


def test_remainder_bound_holds_and_is_needed() -> None:
    """A low degree leaves an error below the bound that chose it, and above rounding."""
    A_0, cosine, sine = random_system(5, 4, 1)
    step, depth, frequency = 0.05, 0.3, 2.0
    for tolerance in (1e-3, 1e-6, 1e-9):
        degree = degree_for(A_0, cosine, sine, step=step, depth=depth, tolerance=tolerance)
        assert degree is not None
        values = []
        for used in (degree, 10):
            basis = monomials(2, used)
            X = segment_coefficients(A_0, cosine, sine, basis, step=step, frequency=frequency, order=24)
            z = depth * np.array([[np.cos(0.7), np.sin(0.7)]])
            values.append((basis.values(z) @ X.reshape(len(X), -1)).reshape(4, 4))
        error = np.linalg.norm(values[0] - values[1], 2)
        assert 1e-15 < error <= tolerance


def test_strong_modulation_is_not_expanded() -> None:
    A_0, cosine, sine = random_system(6, 3, 1)
    assert degree_for(A_0, cosine, sine, step=2.0, depth=20.0, tolerance=1e-14) is None
