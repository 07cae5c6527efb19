"""Roughness: densities, their integrals, the filters made of them, seeded samples, and what places share."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy.linalg import expm, solve_continuous_lyapunov
from scipy.signal import coherence as estimated_coherence
from scipy.signal import lfilter
from scipy.stats import binom

from maglev_ctrl.guideway.correlation import TrackInputs, coherence, track_inputs
from maglev_ctrl.guideway.realisation import realisation, waves
from maglev_ctrl.guideway.recovery import recovered
from maglev_ctrl.guideway.shaping import ShapingFilter, shaping_filter
from maglev_ctrl.guideway.spectra import (
    FEDERAL_RAILROAD_CORNER,
    Roughness,
    federal_railroad,
    inverse_square,
    rational,
    single_pole,
)

SPEED = 135.0
FORMS = [
    inverse_square(),
    single_pole(corner=0.01),
    federal_railroad(5),
    rational([2e-6, 1e-8], [1.0, 0.5, 0.02]),
    rational([1e-6, 0.0], [1.0, 2e-3, 1e-4]),  # nothing at zero: a survey without its long waves
    rational([1e-6, 1e-7, 1e-4], [1.0, -0.5, 1.0, 1e-4]),  # complex zeros and poles, a resonance near 0.9 rad/m
    rational([1e-6, 1e-7, 1e-4], [1.0, -0.5, 1.0, 1e-4, 0.0]),
    rational([1e-6], np.poly([-1e-6, -1e4, -1.0, -1.0]).tolist()),  # corners five decades apart, one of them double
    rational([1e-6, 1e-6, 2e-6, 1e-7], [1.0, 4.0, 6.0, 4.0, 1.0]),  # a pole of fourth order
]


# Densities


def test_the_warwick_form_met_at_a_speed_is_a_u_over_w_squared() -> None:
    w = np.geomspace(0.1, 1e3, 9)
    assert np.allclose(inverse_square().temporal(w, speed=SPEED), 1.5e-6 * SPEED / w**2, rtol=1e-14, atol=0.0)


def test_the_federal_form_is_its_formula() -> None:
    W = np.geomspace(1e-3, 1e2, 9)
    formula = 0.25 * 2.095e-5 * FEDERAL_RAILROAD_CORNER**2 / ((W**2 + FEDERAL_RAILROAD_CORNER**2) * W**2)
    assert np.allclose(federal_railroad(5).density(W), formula, rtol=1e-14, atol=0.0)
    assert federal_railroad(9, amplitude=1e-6).numerator[0] == pytest.approx(0.25e-6 * FEDERAL_RAILROAD_CORNER**2)


def test_the_better_class_is_smoother_and_says_that_it_is_in_doubt() -> None:
    assert federal_railroad(6).density(1.0) < federal_railroad(5).density(1.0)
    assert "ten times" in federal_railroad(6).source and "ten times" not in federal_railroad(5).source
    assert federal_railroad(6, amplitude=3.365e-5).density(1.0) > federal_railroad(5).density(1.0)


@pytest.mark.parametrize(
    ("numerator", "denominator", "message"),
    [
        ([-1.0], [1.0, 1.0], "numerator: expected P"),
        ([1.0], [1.0, -3.0, 2.0], r"denominator: expected Q.*\(2 of them\)"),
        ([1.0], [1.0, -2.0, 1.0], r"denominator: expected Q.*\(1 of them\)"),  # touches zero: an infinite density
        ([1.0, -1.0], [1.0, 0.0, 1.0], "numerator: expected P"),
        ([1.0, 1.0], [1.0, 1.0], "degree below"),
        ([1.0, 0.0], [1.0, 1.0, 0.0], "no common factor"),
        ([0.0, 0.0], [1.0, 1.0], "at least one coefficient"),
        ([1.0], [float("inf"), 1.0], "finite"),
    ],
)
def test_what_is_no_density_is_refused(numerator: list[float], denominator: list[float], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Roughness(tuple(numerator), tuple(denominator))


def test_the_sign_of_a_density_is_decided_exactly() -> None:
    # (s - 1)^2 + e^2 with e^2 one unit in the last place: positive everywhere, and no rounding may say otherwise.
    near = float(np.nextafter(1.0, 2.0))
    Roughness((1.0,), (1.0, -2.0, near))
    with pytest.raises(ValueError, match="2 of them"):
        Roughness((1.0,), (1.0, -2.0, float(np.nextafter(1.0, 0.0))))
    # Both signs turned is the same density.
    assert Roughness((-1.0,), (-1.0, -2.0)).numerator == (1.0,)


# Variances


def test_variances_of_the_simple_forms_are_the_closed_ones() -> None:
    A, corner = 1.5e-6, 0.02
    rough, bent = inverse_square(A), single_pole(A, corner=corner)
    low, high = 0.7, 300.0
    assert rough.variance((low, high), speed=SPEED) == pytest.approx(A * SPEED * (1 / low - 1 / high), rel=1e-11)
    assert rough.variance((0.0, high), speed=SPEED, derivative=1) == pytest.approx(A * SPEED * high, rel=1e-11)
    assert rough.variance((low, high), speed=SPEED, derivative=2) == pytest.approx(
        A * SPEED * (high**3 - low**3) / 3.0, rel=1e-11
    )
    turn = np.arctan(high / SPEED / corner) - np.arctan(low / SPEED / corner)
    assert bent.variance((low, high), speed=SPEED) == pytest.approx(A / corner * turn, rel=1e-11)
    assert bent.variance((0.0, np.inf), speed=SPEED) == pytest.approx(A * np.pi / (2 * corner), rel=1e-11)


def test_an_infinite_variance_names_its_end() -> None:
    rough, bent = inverse_square(), single_pole(corner=0.1)
    for form, band, derivative, end in [
        (rough, (0.0, 10.0), 0, "LOW"),
        (rough, (1.0, np.inf), 1, "HIGH"),
        (bent, (0.0, np.inf), 1, "HIGH"),
        (federal_railroad(5), (0.0, np.inf), 0, "LOW"),
        (federal_railroad(5), (0.0, np.inf), 2, "HIGH"),
        (Roughness((1.0,), (1.0, 0.0, 0.0)), (0.0, np.inf), 1, "LOW"),
    ]:
        with pytest.raises(ValueError, match=end):
            form.variance(band, speed=SPEED, derivative=derivative)
    # One derivative up or down the same ends are finite.
    assert np.isfinite(federal_railroad(5).variance((0.0, np.inf), speed=SPEED, derivative=1))
    assert np.isfinite(rough.variance((1.0, np.inf), speed=SPEED))


@pytest.mark.parametrize("band", [(1.0, 1.0), (-1.0, 1.0), (2.0, 1.0), (np.nan, 1.0)])
def test_a_band_that_does_not_ascend_is_refused(band: tuple[float, float]) -> None:
    with pytest.raises(ValueError, match="band"):
        single_pole(corner=0.1).variance(band)


# Shaping filters


@pytest.mark.parametrize("form", FORMS, ids=lambda one: f"{len(one.numerator)}/{len(one.denominator)}")
def test_the_filter_reproduces_the_density(form: Roughness) -> None:
    for speed in (0.5, SPEED):
        made = shaping_filter(form, speed=speed)
        w = np.geomspace(1e-7, 1e6, 300) * speed
        assert np.allclose(np.abs(made.response(w)) ** 2 / np.pi, form.temporal(w, speed=speed), rtol=1e-12, atol=0.0)
        rate = np.abs(made.rate_response(w)) ** 2 / np.pi
        # Where the rate is a difference of large parts (w far below the poles) rounding is relative to those.
        inner = w > 1e-3 * speed if made.C is not None else w > 0.0
        assert np.allclose(rate[inner], (w**2 * form.temporal(w, speed=speed))[inner], rtol=1e-7, atol=0.0)
        assert made.mismatch < 1e-12
        if len(made.A):
            assert np.max(np.linalg.eigvals(made.A).real) < 0.0
        assert (made.C is None) == (form.poles_at_zero == 1)


def _squares_reproduced(made: ShapingFilter, form: Roughness) -> bool:
    w = SPEED * np.geomspace(1e-2, 10.0, 50)
    return bool(np.allclose(np.abs(made.response(w)) ** 2 / np.pi, form.temporal(w, speed=SPEED), rtol=1e-12, atol=0.0))


def test_a_filter_with_a_slip_is_caught() -> None:
    form = rational([2e-6, 1e-8], [1.0, 0.5, 0.02])
    made = shaping_filter(form, speed=SPEED)
    assert made.C is not None and _squares_reproduced(made, form)
    # One-sided taken for two-sided, the speed forgotten, and a swapped entry.
    assert not _squares_reproduced(dataclasses.replace(made, C=made.C / np.sqrt(2.0)), form)
    assert not _squares_reproduced(dataclasses.replace(made, C=made.C * np.sqrt(SPEED)), form)
    assert not _squares_reproduced(dataclasses.replace(made, C=made.C[:, ::-1]), form)


def _turned(made: ShapingFilter) -> float:
    """How far the phase of the displacement turns from the lowest frequencies to the highest, rad."""
    w = SPEED * np.geomspace(1e-9, 1e8, 20_000)
    phase = np.unwrap(np.angle(made.response(w)))
    return float(phase[-1] - phase[0])


@pytest.mark.parametrize("form", FORMS, ids=lambda one: f"{len(one.numerator)}/{len(one.denominator)}")
def test_no_zero_stands_on_the_right(form: Roughness) -> None:
    """Each pole on the left turns the phase back by 90 degrees, each zero there forward; one on the right, back."""
    poles = len(form.denominator) - 1 - form.poles_at_zero
    zeros = len(form.numerator) - 1 - (form.numerator[-1] == 0.0)
    assert _turned(shaping_filter(form, speed=SPEED)) == pytest.approx((zeros - poles) * np.pi / 2.0, abs=1e-5)


def test_a_zero_mirrored_to_the_right_keeps_the_density_and_is_caught_by_its_phase() -> None:
    form = rational([2e-6, 1e-8], [1.0, 0.5, 0.02])
    made = shaping_filter(form, speed=SPEED)
    assert made.C is not None
    mirrored = dataclasses.replace(made, C=made.C * np.array([[-1.0, 1.0]]))
    assert _squares_reproduced(mirrored, form)
    assert abs(_turned(mirrored) + np.pi / 2.0) > 1.0


@pytest.mark.parametrize("form", [one for one in FORMS if one.poles_at_zero == 0])
def test_the_variance_by_covariance_equation_and_by_integral_agree(form: Roughness) -> None:
    made = shaping_filter(form, speed=SPEED)
    assert made.C is not None
    covariance = solve_continuous_lyapunov(made.A, -made.B @ made.B.T)
    by_equation = float((made.C @ covariance @ made.C.T)[0, 0])
    assert by_equation == pytest.approx(form.variance((0.0, np.inf), speed=SPEED), rel=1e-8)


def test_a_sharp_resonance_is_integrated_or_refused() -> None:
    """1 / ((s - 1)^2 + 4 z^2 s) in s = W^2 has the variance pi / (4 z), a peak of width z at W = 1."""
    for damping in (1e-2, 1e-3, 1e-4):
        sharp = rational([1e-6], [1.0, -2.0 + 4.0 * damping**2, 1.0])
        assert sharp.variance((0.0, np.inf)) == pytest.approx(1e-6 * np.pi / (4.0 * damping), rel=1e-7)
    # Here the coefficients themselves hold the damping to a few digits only.
    with pytest.raises(ArithmeticError, match="only known to"):
        rational([1e-6], [1.0, -2.0 + 4e-14, 1.0]).variance((0.0, np.inf))


def test_the_rate_of_the_federal_form_has_the_variance_of_its_integral() -> None:
    form = federal_railroad(5)
    made = shaping_filter(form, speed=SPEED)
    assert made.C is None and made.A.shape == (1, 1)
    covariance = solve_continuous_lyapunov(made.A, -made.B @ made.B.T)
    by_equation = float((made.C_rate @ covariance @ made.C_rate.T)[0, 0])
    closed = 0.25 * 2.095e-5 * FEDERAL_RAILROAD_CORNER * np.pi / 2.0 * SPEED**2
    assert by_equation == pytest.approx(closed, rel=1e-12)
    assert form.variance((0.0, np.inf), speed=SPEED, derivative=1) == pytest.approx(closed, rel=1e-10)


def test_the_filter_of_the_inverse_square_is_an_integrator_of_white_noise() -> None:
    made = shaping_filter(inverse_square(1.5e-6), speed=SPEED)
    assert made.A.shape == (0, 0) and made.C is None
    assert made.D_rate[0, 0] == pytest.approx(np.sqrt(np.pi * 1.5e-6 * SPEED), rel=1e-14)
    with pytest.raises(ValueError, match="no faster"):
        shaping_filter(Roughness((1.0,), (1.0, 0.0, 0.0)), speed=SPEED)
    with pytest.raises(ValueError, match="speed"):
        shaping_filter(inverse_square(), speed=0.0)


def test_white_noise_through_the_filter_has_the_density() -> None:
    """By time steps: exact discretisation, and the variance of the samples against the integral."""
    form = single_pole(1e-6, corner=0.1)
    made = shaping_filter(form, speed=100.0)
    assert made.C is not None
    step, count = 0.01, 200_000
    phi = float(expm(made.A * step)[0, 0])
    spread = np.sqrt(made.B[0, 0] ** 2 * (1.0 - phi**2) / (-2.0 * made.A[0, 0]))
    noise = spread * np.random.default_rng(5).standard_normal(count)
    x = lfilter([1.0], [1.0, -phi], noise)[1000:]
    seen, expected = made.C[0, 0] ** 2 * np.mean(x**2), form.variance((0.0, np.inf))
    # Independent samples: those of a first-order process are worth (1 - phi^2) / (1 + phi^2) each.
    worth = x.size * (1.0 - phi**2) / (1.0 + phi**2)
    assert abs(seen / expected - 1.0) < 4.0 * np.sqrt(2.0 / worth)
    # Double the density (two-sided read as one-sided) would be seen.
    assert abs(seen / (2.0 * expected) - 1.0) > 4.0 * np.sqrt(2.0 / worth)


# Seeded samples


def test_a_sample_is_its_seed() -> None:
    first, again, other = (
        realisation(inverse_square(), length=500.0, step=0.5, seed=seed).heights for seed in (7, 7, 8)
    )
    assert np.array_equal(first, again) and not np.allclose(first, other)
    assert abs(np.mean(first[:-1])) < 1e-15


def test_fixed_amplitudes_have_the_mean_square_of_their_waves() -> None:
    rough = single_pole(1e-6, corner=0.05)
    sample = realisation(rough, length=2000.0, step=0.5, seed=0, band=(0.01, 3.0), amplitudes="fixed")
    _, power = waves(rough, 2000.0, 0.5, (0.01, 3.0))
    assert np.mean(sample.heights[:-1] ** 2) == pytest.approx(float(np.sum(power)), rel=1e-12)
    # 200 waves to the corner: their sum is the integral within its ends' half bins.
    assert float(np.sum(power)) == pytest.approx(rough.variance((0.01, 3.0)), rel=0.02)


def test_a_band_holds_its_waves_and_no_other() -> None:
    sample = realisation(inverse_square(), length=200.0, step=0.25, seed=2, band=(0.5, 2.0))
    wide = realisation(inverse_square(), length=200.0, step=0.25, seed=2)
    line, whole = (np.fft.rfft(one.heights[:-1]) for one in (sample, wide))
    wavenumber = 2.0 * np.pi * np.arange(line.size) / 200.0
    held = (wavenumber >= 0.5) & (wavenumber <= 2.0)
    assert np.max(np.abs(line[~held])) < 1e-12 * np.max(np.abs(line))
    assert np.allclose(line[held], whole[held], rtol=1e-9, atol=0.0)


def test_what_cannot_be_sampled_is_refused() -> None:
    rough = inverse_square()
    with pytest.raises(ValueError, match="too coarse for waves"):
        realisation(rough, length=100.0, step=1.0, seed=0, band=(0.1, 4.0))
    with pytest.raises(ValueError, match="too coarse: "):
        realisation(single_pole(corner=10.0), length=100.0, step=1.0, seed=0)
    with pytest.raises(ValueError, match="whole number of steps"):
        realisation(rough, length=100.3, step=0.5, seed=0)
    with pytest.raises(ValueError, match="hold a wave"):
        realisation(rough, length=100.0, step=0.5, seed=0, band=(0.001, 0.002))
    with pytest.raises(ValueError, match="seed"):
        realisation(rough, length=100.0, step=0.5, seed=-1)


def _inside(form: Roughness, claimed: Roughness, seeds: range, confidence: float = 0.95) -> tuple[int, int, float]:
    found = total = 0
    ratios = []
    for seed in seeds:
        sample = realisation(form, length=4000.0, step=0.5, seed=seed, band=(0.0, 6.0))
        seen = recovered(sample, claimed, segment=200.0, band=(0.0, 6.0), confidence=confidence)
        found, total = found + int(np.sum(seen.inside)), total + seen.inside.size
        ratios.append(seen.density / seen.expected)
        # Two squares over the degrees of freedom: the variance of a chi-squared estimate.
        freedom = seen.degrees_of_freedom
    assert claimed is not form or np.var(np.concatenate(ratios)) == pytest.approx(2.0 / freedom, rel=0.15)
    return found, total, confidence


@pytest.mark.parametrize(
    "form", [inverse_square(), single_pole(corner=0.2), federal_railroad(5), FORMS[3]], ids=lambda one: one.name
)
def test_the_density_is_recovered_inside_its_confidence_band(form: Roughness) -> None:
    found, total, confidence = _inside(form, form, range(12))
    assert total > 500
    # Four standard deviations of a binomial count, either side.
    low, high = binom.ppf([3e-5, 1.0 - 3e-5], total, confidence)
    assert low <= found <= high


def test_a_wrong_density_is_not_recovered() -> None:
    form = inverse_square()
    low = binom.ppf(3e-5, 540, 0.95) / 540
    for wrong in (form.scaled(1.3), form.scaled(2.0), form.scaled(1.0 / (2.0 * np.pi)), single_pole(corner=0.5)):
        found, total, _ = _inside(form, wrong, range(4))
        assert found / total < low - 0.05


def test_the_degrees_of_freedom_are_those_of_half_overlapped_hann_segments() -> None:
    sample = realisation(inverse_square(), length=4000.0, step=0.5, seed=1)
    seen = recovered(sample, inverse_square(), segment=200.0)
    count = 39  # 8000 samples in segments of 400, 200 apart
    assert seen.degrees_of_freedom == pytest.approx(2 * count / (1 + 2 * (1 - 1 / count) / 36), rel=1e-6)


# Left and right, front and rear


def test_front_and_rear_meet_the_same_track_a_wheelbase_apart() -> None:
    inputs = track_inputs(
        ["heave@rear", "heave@front", "sway@front"], [[-8.0, 1.2], [12.0, -1.2], [12.0, -1.2]], speed=50.0
    )
    assert inputs.delays.tolist() == [0.4, 0.0, 0.0]
    assert inputs.mixing.tolist() == [[1.0, 1.2, 0.0], [1.0, -1.2, 0.0], [0.0, 0.0, 1.0]]
    w = np.array([0.0, 3.0])
    transfer = inputs.transfer(w)
    assert transfer.shape == (2, 3, 3)
    assert np.allclose(transfer[1, 0], np.exp(-1j * 3.0 * 0.4) * np.array([1.0, 1.2, 0.0]), rtol=1e-15)
    # The rear lags: a front that lagged instead has the other phase.
    assert transfer[1, 0, 0].imag < 0.0 < np.conj(transfer[1, 0, 0]).imag


def test_the_delays_are_what_a_moving_vehicle_sees() -> None:
    """The input of a profile at the place v t + x is that of the foremost place, delayed."""
    speed, places = 40.0, np.array([[10.0, 0.0], [3.0, 0.0], [-10.0, 0.0]])
    track = realisation(inverse_square(), length=400.0, step=0.5, seed=4)
    inputs = track_inputs(["heave@a", "heave@b", "heave@c"], places, speed=speed)
    t = np.linspace(1.0, 5.0, 41)
    met = track.at(speed * t[:, None] + places[:, 0])
    delayed = track.at(speed * (t[:, None] - inputs.delays) + 10.0)
    assert np.allclose(met, delayed, atol=1e-12 * np.max(np.abs(met)))
    assert not np.allclose(met, track.at(speed * (t[:, None] + inputs.delays) + 10.0), atol=1e-4 * np.max(np.abs(met)))


@pytest.mark.parametrize(
    ("names", "places", "message"),
    [
        (["lift@a"], [[0.0, 0.0]], "heave@<element>"),
        (["heave"], [[0.0, 0.0]], "heave@<element>"),
        (["heave@a", "heave@a"], [[0.0, 0.0], [1.0, 0.0]], "every one once"),
        (["heave@a"], [[0.0]], "places"),
        ([], [], "at least one"),
    ],
)
def test_inputs_that_are_none_are_refused(names: list[str], places: list[list[float]], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        track_inputs(names, places, speed=10.0)


def test_track_inputs_keep_their_shapes() -> None:
    one = np.ones(1)
    with pytest.raises(ValueError, match="vertical"):
        TrackInputs(("heave@a",), delays=one, vertical=np.ones(2), cross_level=one, lateral=one)
    with pytest.raises(ValueError, match="delays"):
        TrackInputs(("heave@a",), delays=-one, vertical=one, cross_level=one, lateral=one)


def test_left_and_right_are_as_coherent_as_their_densities_say() -> None:
    vertical, tilt, half = single_pole(4e-6, corner=0.05), single_pole(1e-6, corner=0.3), 1.2
    options = {"length": 60_000.0, "step": 0.5, "band": (0.0, 6.0)}
    z = realisation(vertical, seed=10, **options).heights[:-1]
    phi = realisation(tilt, seed=11, **options).heights[:-1]
    size = 256
    f, seen = estimated_coherence(z + half * phi, z - half * phi, fs=2.0 * np.pi / 0.5, nperseg=size)
    judged = slice(3, size // 2 - 4, 3)
    expected = coherence(vertical, tilt, f[judged], left=half, right=-half)
    # Standard deviation of an estimated squared coherence: sqrt(2 g / n) (1 - g), with n averages (and a bias of 1/n).
    averages = 0.95 * (2 * z.size / size - 1)
    spread = np.sqrt(2.0 * expected / averages) * (1.0 - expected) + 1.0 / averages
    assert np.all(np.abs(seen[judged] - expected) < 4.5 * spread)
    wrong = coherence(vertical, tilt.scaled(1.5), f[judged], left=half, right=-half)
    assert not np.all(np.abs(seen[judged] - wrong) < 4.5 * spread)
