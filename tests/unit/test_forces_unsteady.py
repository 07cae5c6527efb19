from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from maglev_ctrl.forces import coefficients_from_oscillation

SIZE = st.floats(-1e3, 1e3)


@settings(deadline=None)
@given(m=SIZE, c=SIZE, k=SIZE, w=st.floats(0.1, 100.0))
def test_an_oscillation_gives_back_the_coefficients_that_made_it(m: float, c: float, k: float, w: float) -> None:
    response = k - m * w**2 + 1j * c * w  # force per unit displacement, force = m u'' + c u' + k u
    found = coefficients_from_oscillation(abs(response), np.angle(response), frequency=w, stiffness=k)
    scale = abs(k) + abs(response)
    np.testing.assert_allclose(found.mass, m, rtol=1e-9, atol=1e-12 * scale / w**2)
    np.testing.assert_allclose(found.damping, c, rtol=1e-9, atol=1e-12 * scale / w)


def test_a_lag_instead_of_a_lead_is_caught() -> None:
    response = -120.0 + 2.0 * 25.0 + 1j * 3.0 * 5.0
    lag = coefficients_from_oscillation(abs(response), -np.angle(response), frequency=5.0, stiffness=-120.0)
    assert float(lag.damping) == pytest.approx(-3.0)  # the mutant's sign, not the truth's +3


def test_errors_are_those_of_many_repeated_measurements() -> None:
    rng = np.random.default_rng(7)
    a, psi, k, w = 90.0, 2.1, -140.0, 12.0
    errors = {"amplitude_error": 0.3, "phase_error": 0.01, "stiffness_error": 1.5}
    stated = coefficients_from_oscillation(a, psi, frequency=w, stiffness=k, **errors)
    count = 40_000
    drawn = coefficients_from_oscillation(
        a + 0.3 * rng.standard_normal(count),
        psi + 0.01 * rng.standard_normal(count),
        frequency=w,
        stiffness=k + 1.5 * rng.standard_normal(count),
    )
    # a standard deviation from n draws has relative error 1/sqrt(2n) = 0.35 %; four of them
    np.testing.assert_allclose(np.std(drawn.mass), stated.mass_error, rtol=0.015)
    np.testing.assert_allclose(np.std(drawn.damping), stated.damping_error, rtol=0.015)


def test_without_errors_given_the_errors_are_zero() -> None:
    found = coefficients_from_oscillation([1.0, 2.0], 0.3, frequency=2.0, stiffness=1.0)
    assert found.mass.shape == (2,)
    assert not found.mass_error.any()
    assert not found.damping_error.any()


def test_wrong_use_is_refused() -> None:
    with pytest.raises(ValueError, match="frequency: expected a positive"):
        coefficients_from_oscillation(1.0, 0.0, frequency=0.0, stiffness=1.0)
    with pytest.raises(ValueError, match="amplitude: expected a value that is not negative"):
        coefficients_from_oscillation(-1.0, 0.0, frequency=1.0, stiffness=1.0)
    with pytest.raises(ValueError, match="phase_error"):
        coefficients_from_oscillation(1.0, 0.0, frequency=1.0, stiffness=1.0, phase_error=-0.1)
    with pytest.raises(ValueError, match="phase: every entry must be finite"):
        coefficients_from_oscillation(1.0, np.nan, frequency=1.0, stiffness=1.0)
