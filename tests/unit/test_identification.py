"""Constants from forced oscillations: round trips, coverage of the intervals, mutants, and what cannot be told."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy import stats

from maglev_ctrl.forces import coefficients_from_oscillation, identification, sine_fit
from maglev_ctrl.forces.complex_stiffness import response_from_polar
from maglev_ctrl.forces.identification import Description, Identification, damping_words, identify_constants
from maglev_ctrl.forces.sine_fit import SineFit, fit_sine, phasor_series

M, C, K = -0.5, 12.0, -4.0e3
W = 2.0 * np.pi * np.array([2.0, 4.0, 6.0, 8.0, 10.0, 12.0])
SEEDS = 300
Array = np.ndarray


def truth(w: Array) -> Array:
    return K - M * w**2 + 1j * w * C


def lag(w: Array, *, steady: float = -3e3, gain: float = -2e3, time: float = 0.02) -> Array:
    return steady + gain * 1j * w * time / (1.0 + 1j * w * time)


def coverage_bounds(count: int) -> tuple[float, float]:
    """Hits of 95 % intervals that 99.9 % of correct procedures stay within."""
    low, high = stats.binom.interval(0.999, count, 0.95)
    return float(low), float(high)


def with_errors(rng: np.random.Generator, *, model: Callable[[Array], Array] = truth) -> Identification:
    q = model(W)
    size, turn = 0.01 * np.abs(q), np.full(W.size, 0.005)
    amplitude = np.abs(q) + size * rng.standard_normal(W.size)
    phase = np.angle(q) + turn * rng.standard_normal(W.size)
    response, covariance = response_from_polar(amplitude, phase, amplitude_error=size, phase_error=turn)
    static = float(model(np.zeros(1))[0].real + 20.0 * rng.standard_normal())
    return identify_constants(W, response, covariance=covariance, static_stiffness=static, static_error=20.0)


def from_residuals(rng: np.random.Generator, *, static_error: float | None = None) -> Identification:
    noise = 30.0 * (rng.standard_normal(W.size) + 1j * rng.standard_normal(W.size))
    if static_error is None:
        return identify_constants(W, truth(W) + noise)
    static = K + static_error * float(rng.standard_normal())
    return identify_constants(W, truth(W) + noise, static_stiffness=static, static_error=static_error)


def residuals_and_static(rng: np.random.Generator) -> Identification:
    return from_residuals(rng, static_error=20.0)


@pytest.mark.parametrize("measure", [with_errors, from_residuals, residuals_and_static])
def test_intervals_hold_the_truth_as_often_as_they_say(measure: Callable[..., Identification]) -> None:
    hits, alarms = np.zeros(3), 0
    for seed in range(SEEDS):
        found = measure(np.random.default_rng(seed))
        if found.description is Description.FREQUENCY_DEPENDENT:
            alarms += 1
            continue
        pairs = ((found.mass, M), (found.damping, C), (found.stiffness, K))
        hits += [estimate.low <= value <= estimate.high for estimate, value in pairs]
    assert alarms <= stats.binom.ppf(0.9999, SEEDS, 0.01)
    low, high = coverage_bounds(SEEDS - alarms)
    assert np.all((hits >= low) & (hits <= high)), hits


def test_the_coverage_check_catches_normal_quantiles_in_place_of_t() -> None:
    """Mutant: with three points, three degrees of freedom, 1.96 standard errors are too narrow."""
    w, hits = W[:3], 0
    for seed in range(SEEDS):
        rng = np.random.default_rng(seed)
        found = identify_constants(w, truth(w) + 30.0 * (rng.standard_normal(3) + 1j * rng.standard_normal(3)))
        hits += abs(found.least_squares[2] - C) <= 1.96 * np.sqrt(found.covariance[2, 2])
    low, _ = coverage_bounds(SEEDS)
    assert hits < low


def test_exact_data_give_back_the_coefficients() -> None:
    found = identify_constants(W, truth(W))
    for estimate, value in ((found.mass, M), (found.damping, C), (found.stiffness, K)):
        assert estimate.value == pytest.approx(value, rel=1e-10)
    assert found.description is Description.CONSTANT


def test_one_frequency_with_a_static_stiffness_is_equation_9() -> None:
    a, psi, w = 90.0, 2.1, 12.0
    response, covariance = response_from_polar([a], [psi], amplitude_error=[0.3], phase_error=[0.01])
    found = identify_constants([w], response, covariance=covariance, static_stiffness=-140.0, static_error=1.5)
    errors = {"amplitude_error": 0.3, "phase_error": 0.01, "stiffness_error": 1.5}
    expected = coefficients_from_oscillation(a, psi, frequency=w, stiffness=-140.0, **errors)
    assert found.mass.value == pytest.approx(float(expected.mass), rel=1e-9)
    assert found.damping.value == pytest.approx(float(expected.damping), rel=1e-9)
    assert found.mass.error == pytest.approx(float(expected.mass_error), rel=1e-9)
    assert found.damping.error == pytest.approx(float(expected.damping_error), rel=1e-9)
    assert found.description is Description.NOT_TESTED


def test_one_frequency_does_not_separate_k_from_m() -> None:
    w = W[:1]
    found = identify_constants(w, truth(w))
    assert np.isnan(found.stiffness.value) and np.isnan(found.mass.value)
    assert "cannot separate k from -m w^2" in found.stiffness.reason
    assert found.dynamic_stiffness.value == pytest.approx(K - M * w[0] ** 2)
    assert found.damping.value == pytest.approx(C)
    assert np.isnan(found.damping.low) and np.isnan(found.mass_at).all()
    assert found.description is Description.NOT_TESTED
    repeated = identify_constants(np.full(4, w[0]), truth(w)[0] + np.array([1.0, -1.0, 1j, -1j]))
    assert np.isnan(repeated.mass.value) and not np.isnan(repeated.damping.low)


def test_two_frequencies_leave_no_redundancy() -> None:
    w = W[[0, 3]]
    bare = identify_constants(w, truth(w))
    assert bare.mass.value == pytest.approx(M)
    assert np.isnan(bare.mass.low) and "as many unknowns" in bare.mass.reason
    assert bare.description is Description.NOT_TESTED and any("no redundancy" in note for note in bare.notes)
    q, covariance = response_from_polar(
        np.abs(truth(w)), np.angle(truth(w)), amplitude_error=[20.0, 20.0], phase_error=[0.01, 0.01]
    )
    given = identify_constants(w, q, covariance=covariance)
    assert given.mass.low < M < given.mass.high
    assert given.description is Description.NOT_TESTED
    # c is over-determined even so: two points that contradict each other are told
    wrong = identify_constants(w, q + np.array([0.0, 2e3j]), covariance=covariance)
    assert wrong.description is Description.FREQUENCY_DEPENDENT


def test_a_lag_is_found_to_be_frequency_dependent() -> None:
    found = with_errors(np.random.default_rng(3), model=lag)
    assert found.description is Description.FREQUENCY_DEPENDENT
    assert np.isnan(found.mass.value) and np.isnan(found.damping.value)
    assert found.chance < 1e-6
    exact = lag(W)
    # four standard errors: the chance of one miss in six is below 1e-3
    np.testing.assert_array_less(np.abs(found.damping_at - exact.imag / W), 4.0 * found.damping_error_at)
    assert "at every frequency measured, < 0" in damping_words(found, direct=True)
    bare = identify_constants(W, exact)
    assert bare.description is Description.FREQUENCY_DEPENDENT and bare.mass_from == ""
    assert any("static stiffness" in note for note in bare.notes)


def test_errors_that_do_not_fit_the_scatter_are_told() -> None:
    rng = np.random.default_rng(5)
    q = truth(W) + 30.0 * (rng.standard_normal(W.size) + 1j * rng.standard_normal(W.size))
    small = identify_constants(W, q, covariance=np.tile(np.eye(2) * 3.0**2, (W.size, 1, 1)))
    assert small.description is Description.FREQUENCY_DEPENDENT
    assert any("errors may be too small" in note for note in small.notes)
    large = identify_constants(W, q, covariance=np.tile(np.eye(2) * 300.0**2, (W.size, 1, 1)))
    assert any("errors look too large" in note for note in large.notes)


def test_words_about_damping() -> None:
    w = W
    feeding = identify_constants(w, truth(w))
    assert "negative damping" in damping_words(feeding, direct=True)
    assert "positive damping" in damping_words(identify_constants(w, truth(w).conj()), direct=True)
    assert "coupling" in damping_words(feeding, direct=False)
    nothing = identify_constants(w, truth(w).real + np.resize([1.0 + 1j, -1.0 - 1j], w.size))
    assert "holds zero" in damping_words(nothing, direct=True)


def test_wrong_use_is_refused() -> None:
    with pytest.raises(ValueError, match="one per frequency"):
        identify_constants([1.0], [1.0, 2.0])
    with pytest.raises(ValueError, match="positive frequency"):
        identify_constants([0.0], [1.0])
    with pytest.raises(ValueError, match="positive definite"):
        identify_constants([1.0], [1.0], covariance=np.zeros((1, 2, 2)))
    with pytest.raises(ValueError, match="static_error: expected one"):
        identify_constants([1.0], [1.0], covariance=np.eye(2)[None], static_stiffness=1.0)
    with pytest.raises(ValueError, match="beside a static stiffness"):
        identify_constants([1.0], [1.0], static_error=1.0)
    with pytest.raises(ValueError, match="must be finite"):
        identify_constants([1.0], [np.nan])
    with pytest.raises(ValueError, match="both or neither"):
        response_from_polar([1.0], [0.0], amplitude_error=[1.0])
    with pytest.raises(ValueError, match="not negative"):
        response_from_polar([-1.0], [0.0])
    with pytest.raises(ValueError, match="amplitude of zero"):
        response_from_polar([0.0], [0.0], amplitude_error=[1.0], phase_error=[0.1])


# Records over time


def record(
    rng: np.random.Generator, *, hertz: float = 3.0, periods: float = 5.7, samples: int = 200, noise: float = 0.05,
    harmonic: float = 0.0,
) -> tuple[Array, Array, Array]:  # fmt: skip
    w = 2.0 * np.pi * hertz
    t = np.arange(samples) * periods / hertz / samples
    q, turn = complex(truth(np.array([w]))[0]), rng.uniform(0.0, 2.0 * np.pi)
    u = 1e-3 * np.cos(w * t + turn) + 1e-4 + 2e-4 * t
    f = (q * 1e-3 * np.exp(1j * (w * t + turn))).real + 5.0 + 0.3 * t
    f += harmonic * abs(q) * 1e-3 * np.cos(2.0 * w * t)
    return (
        t + 7.0,  # no clock starts at zero
        u + 0.3e-3 * noise * rng.standard_normal(samples),
        f + abs(q) * 1e-3 * noise * rng.standard_normal(samples),
    )


def misses(fit: SineFit, q: complex) -> Array:
    return np.array([fit.response.real - q.real, fit.response.imag - q.imag]) / np.sqrt(np.diag(fit.covariance))


@pytest.mark.parametrize("periods", [2.05, 2.4, 5.7, 20.0])
def test_errors_of_a_sine_fit_hold(periods: float) -> None:
    q = complex(truth(np.array([6.0 * np.pi]))[0])
    inside = np.zeros(3)
    for seed in range(SEEDS):
        fit = fit_sine(*record(np.random.default_rng(seed), periods=periods))
        close = [abs(fit.frequency - 6.0 * np.pi) <= 1.96 * fit.frequency_error]
        inside += [*(np.abs(misses(fit, q)) <= 1.96), *close]
    low, high = coverage_bounds(SEEDS)
    assert np.all((inside >= low) & (inside <= high)), inside


def test_a_record_without_noise_is_exact() -> None:
    fit = fit_sine(*record(np.random.default_rng(0), noise=0.0))
    assert fit.frequency == pytest.approx(6.0 * np.pi, rel=1e-9)
    assert fit.response == pytest.approx(complex(truth(np.array([6.0 * np.pi]))[0]), rel=1e-8)
    assert fit.phase == pytest.approx(np.angle(fit.response)) and fit.amplitude == pytest.approx(abs(fit.response))
    assert fit.notes == ()


def test_a_positive_phase_is_a_force_ahead_of_the_displacement() -> None:
    t = np.arange(200) * 0.01
    ahead = fit_sine(t, np.sin(20.0 * t), 5.0 * np.sin(20.0 * t + 0.4))
    assert ahead.phase == pytest.approx(0.4, abs=1e-9)


def test_sine_and_cosine_swapped_would_be_caught(monkeypatch: pytest.MonkeyPatch) -> None:
    right = sine_fit._basis

    def swapped(t: Array, w: float, multiples: int) -> Array:
        basis = right(t, w, multiples)
        return basis[:, [1, 0, *range(2, basis.shape[1])]] if multiples > 1 else basis

    monkeypatch.setattr(sine_fit, "_basis", swapped)
    with pytest.raises(AssertionError):
        test_a_positive_phase_is_a_force_ahead_of_the_displacement()
    with pytest.raises(AssertionError):
        test_a_record_without_noise_is_exact()


def test_a_flipped_phase_would_be_caught(monkeypatch: pytest.MonkeyPatch) -> None:
    right = identification.identify_constants
    monkeypatch.setitem(globals(), "identify_constants", lambda w, q, **more: right(w, np.conj(q), **more))
    with pytest.raises(AssertionError):
        test_exact_data_give_back_the_coefficients()
    with pytest.raises(AssertionError):
        test_one_frequency_with_a_static_stiffness_is_equation_9()


def test_records_at_several_frequencies_combine() -> None:
    rng = np.random.default_rng(11)
    fits = [fit_sine(*record(rng, hertz=hertz)) for hertz in (2.0, 4.0, 7.0, 11.0)]
    found = identify_constants(
        [fit.frequency for fit in fits], [fit.response for fit in fits],
        covariance=np.stack([fit.covariance for fit in fits]), degrees=min(fit.degrees for fit in fits),
    )  # fmt: skip
    assert found.description is Description.CONSTANT
    for estimate, value in ((found.mass, M), (found.damping, C), (found.stiffness, K)):
        assert abs(estimate.value - value) < 4.0 * estimate.error


def test_harmonics_and_correlated_noise_are_told() -> None:
    loud = fit_sine(*record(np.random.default_rng(1), harmonic=0.3))
    assert loud.harmonics_force[0] == pytest.approx(0.3, abs=0.03)
    assert any("too large for a linear force" in note for note in loud.notes)
    t, u, f = record(np.random.default_rng(2), noise=0.0)
    white = np.random.default_rng(3).standard_normal(t.size)
    slow = np.zeros(t.size)
    for i in range(1, t.size):
        slow[i] = 0.9 * slow[i - 1] + white[i]
    coloured = fit_sine(t, u, f + 0.1 * slow)
    assert coloured.autocorrelation[1] > 0.5
    assert any("autocorrelated" in note for note in coloured.notes)


def test_errors_hold_in_correlated_noise_because_they_are_widened() -> None:
    q = complex(truth(np.array([6.0 * np.pi]))[0])
    squares, narrow = [], []
    for seed in range(100):
        t, u, f = record(np.random.default_rng(seed), noise=0.0, periods=8.0, samples=400)
        white = np.random.default_rng(1000 + seed).standard_normal(t.size + 50)
        slow = np.zeros(white.size)
        for i in range(1, white.size):
            slow[i] = 0.8 * slow[i - 1] + white[i]
        fit = fit_sine(t, u, f + 0.05 * slow[50:])
        squares.append(misses(fit, q) ** 2)
        r = fit.autocorrelation[1]
        narrow.append(misses(fit, q) ** 2 * (1 - r * r) / (1 - 2 * r * np.cos(6 * np.pi * (t[1] - t[0])) + r * r))
    # mean square of 200 standard normals has standard deviation 0.1; the AR(1) model is itself only estimated
    assert np.mean(squares) == pytest.approx(1.0, abs=0.4)
    assert np.mean(narrow) > 2.0  # the mutant that does not widen


def test_records_that_cannot_be_fitted_are_refused() -> None:
    rng = np.random.default_rng(0)
    t = np.arange(100) * 0.01
    with pytest.raises(ValueError, match=r"at least two periods of the oscillation, got 1\.6"):
        fit_sine(*record(rng, periods=1.6, noise=0.001))
    with pytest.raises(ValueError, match="at least two periods"):
        fit_sine(*record(rng, periods=0.5, noise=0.0))
    with pytest.raises(ValueError, match="four samples per period"):
        fit_sine(t, np.cos(2 * np.pi * 40 * t), t)
    with pytest.raises(ValueError, match="expected a sine"):
        fit_sine(t, rng.standard_normal(100), t)
    with pytest.raises(ValueError, match="one value throughout"):
        fit_sine(t, np.ones(100), t)
    with pytest.raises(ValueError, match="force: expected an oscillation"):
        fit_sine(t, np.cos(30 * t), np.ones(100))
    with pytest.raises(ValueError, match="even, increasing steps"):
        fit_sine(np.delete(t, 40), np.cos(30 * t[1:]), t[1:])
    with pytest.raises(ValueError, match="as many as times"):
        fit_sine(t, t[1:], t)
    with pytest.raises(ValueError, match="at least 11 samples"):
        fit_sine(t[:5], t[:5], t[:5])


def test_a_phasor_is_the_sine_it_stands_for() -> None:
    t = np.linspace(0.0, 1.0, 11)
    np.testing.assert_allclose(phasor_series(2.0 * np.exp(0.5j), 3.0, t), 2.0 * np.cos(3.0 * t + 0.5), atol=1e-12)
