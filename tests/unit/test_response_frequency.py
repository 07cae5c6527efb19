"""Integrals over frequency: the rule, brute force, the exact covariances, bands."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from ride_vehicles import SPEED, random_channel, train
from scipy.integrate import quad
from scipy.special import exp1

from maglev_ctrl.analysis.response.channels import Noise, Signal, passenger_signals, ride_channel, track_processes
from maglev_ctrl.analysis.response.covariance import covariances
from maglev_ctrl.analysis.response.frequency import frequency_covariances, spectral_density
from maglev_ctrl.analysis.response.moments import moments
from maglev_ctrl.analysis.response.quadrature import GAUSS, KRONROD, NODES, adaptive_integral
from maglev_ctrl.analysis.response.sources import Observed
from maglev_ctrl.analysis.response.weighting import weighting
from maglev_ctrl.errors import Agreement
from maglev_ctrl.guideway.correlation import track_inputs
from maglev_ctrl.guideway.shaping import shaping_filter
from maglev_ctrl.guideway.spectra import federal_railroad, inverse_square, rational, single_pole
from maglev_ctrl.systems import SecondOrderSystem


def test_the_rules_are_exact_for_polynomials():
    for degree in range(24):
        exact = 0.0 if degree % 2 else 2.0 / (degree + 1)
        assert KRONROD @ NODES**degree == pytest.approx(exact, abs=2e-15)
        if degree < 14:
            assert GAUSS @ NODES**degree == pytest.approx(exact, abs=2e-15)
    assert abs(GAUSS @ NODES**14 - 2.0 / 15.0) > 1e-6


def test_integral_of_a_sharp_peak_and_its_error():
    width = 1e-6

    def peaks(x):
        return np.column_stack([width / ((x - 0.3) ** 2 + width**2), np.cos(40.0 * x)])

    found = adaptive_integral(peaks, np.array([0.0, 1.0]), tolerance=1e-10)
    exact = np.array([np.arctan(0.7 / width) + np.arctan(0.3 / width), np.sin(40.0) / 40.0])
    np.testing.assert_allclose(found.value, exact, rtol=1e-9)
    assert np.all(np.abs(found.value - exact) <= np.maximum(found.error, 1e-14))
    coarse = adaptive_integral(peaks, np.array([0.0, 1.0]), tolerance=1e-10, rounds=2)
    assert coarse.error[0] > 1e-3  # it does not claim what it has not


def _bicycle():
    """Heave and pitch on two unlike legs, wheelbase 10 m."""
    a, b, k1, k2, c1, c2 = 6.0, 4.0, 3e4, 5e4, 1.1e3, 0.7e3
    T = np.array([[1.0, -a], [1.0, b]])  # heights of the legs; pitch nose down
    k, c = np.diag([k1, k2]), np.diag([c1, c2])
    return SecondOrderSystem.from_matrices(
        np.diag([900.0, 8e3]), T.T @ c @ T, T.T @ k @ T, dofs=("car.heave", "car.pitch"),
        guideway=("heave@front", "heave@rear"), K_w=T.T @ k, C_w=T.T @ c,
        outputs=("front.gap", "rear.gap", "car.heave.acceleration"),
        H_q=np.vstack([T, np.zeros((1, 2))]), H_a=[[0, 0], [0, 0], [1, 0]], H_w=[[-1, 0], [0, -1], [0, 0]],
    )  # fmt: skip


def test_a_bicycle_with_a_delayed_rear_by_brute_force():
    system, speed, A = _bicycle(), 50.0, 4e-6
    rough = rational([A], [1.0, 0.3, 0.0])
    track = track_inputs(("heave@front", "heave@rear"), [[6.0, 0.0], [-4.0, 0.0]], speed=speed)
    tracks = track_processes(track, vertical=shaping_filter(rough, speed=speed))
    channel = ride_channel(system, None, [Signal.of(name) for name in system.outputs])

    def density(w, output, delay):
        s = 1j * w
        drive = np.array([1.0, np.exp(-s * delay)])
        q = np.linalg.solve(system.M * s**2 + system.C * s + system.K, (system.K_w + s * system.C_w) @ drive)
        y = (system.H_q[output] + s**2 * system.H_a[output]) @ q + system.H_w[output] @ drive
        return abs(y) ** 2 * A / ((w / speed) ** 2 * ((w / speed) ** 2 + 0.3)) / speed

    def brute(output, delay, top=2000.0):
        edges = np.concatenate([[1e-9], np.geomspace(1e-2, 4.0, 8), np.arange(5.0, top + 1.0, 15.0)])
        return sum(
            quad(density, a, b, args=(output, delay), epsabs=0.0, epsrel=1e-9, limit=200)[0] for a, b in pairwise(edges)
        )

    found = frequency_covariances(channel, tracks, finite_rates=[True, True, False])
    exact = covariances(channel, tracks)
    for output in (0, 1):
        expected = brute(output, 0.2)
        assert found.variances[output] == pytest.approx(expected, rel=1e-6)  # (brute force stops at 2000 rad/s)
        assert exact.variances[output] == pytest.approx(expected, rel=1e-6)
    np.testing.assert_allclose(found.variances, exact.variances, rtol=1e-9)
    assert abs(brute(1, 0.19) / expected - 1.0) > 1e-3  # one wrong delay


@pytest.mark.parametrize("active", [True, False])
def test_a_train_agrees_with_its_covariances(active):
    system, law, track = train(active=active)
    signals = [signal for _, signal in passenger_signals(system, "car", x=12.0, y=1.0, z=0.0, name="nose")]
    signals += [
        Signal.of(name) for name in ("front_magnet_1_left.gap", "secondary_rear_left.stroke", "front_motor.force")
    ]
    signals += [Signal.of("front_motor.stroke.velocity")]
    noises = [Noise("front_speed", 1e-3)] if active else []
    channel = ride_channel(system, law if active else None, signals, noises=noises)
    tracks = track_processes(
        track,
        vertical=shaping_filter(inverse_square(1e-6), speed=SPEED),
        cross_level=shaping_filter(single_pole(1e-7, corner=0.05), speed=SPEED),
    )
    watched = [Observed("nose.vertical", weighting("Wk"))] + [Observed(signal.name) for signal in signals[1:]]
    exact = covariances(channel, tracks, watched)
    assert exact.ends == ("",) * len(watched)
    found = frequency_covariances(
        channel, tracks, watched, finite_rates=[not end for end in exact.rate_ends], pairs=[(3, 4)]
    )
    np.testing.assert_allclose(found.variances, exact.variances, rtol=1e-8, atol=1e-20)
    rated = np.isfinite(found.rates)
    assert rated.any()
    np.testing.assert_allclose(found.rates[rated], exact.rates[rated], rtol=1e-8, atol=1e-20)
    assert found.pairs[0] == pytest.approx(exact.covariance[3, 4], rel=1e-7, abs=1e-20)
    one_wrong = replace(tracks[0], delays=np.where(np.arange(len(track.names)) == 3, 0.0, track.delays))
    mutant = frequency_covariances(channel, (one_wrong, *tracks[1:]), watched, finite_rates=[False] * len(watched))
    assert np.max(np.abs(mutant.variances / np.where(exact.variances > 0.0, exact.variances, 1.0) - 1.0)) > 1e-3


@pytest.mark.parametrize("seed", range(20, 26))
def test_random_loops_agree_with_their_covariances(seed):
    channel, places = random_channel(seed, states=12 + seed % 5)
    tracks = track_processes(
        track_inputs(channel.guideway, places, speed=60.0), vertical=shaping_filter(federal_railroad(5), speed=60.0)
    )
    watched = [Observed(f"y{i}") for i in range(3)] + [Observed("y3", weighting("Wd"))]
    exact = covariances(channel, tracks, watched)
    found = frequency_covariances(channel, tracks, watched, finite_rates=[not end for end in exact.rate_ends])
    np.testing.assert_allclose(found.variances, exact.variances, rtol=1e-8)
    assert np.all(np.abs(found.variances - exact.variances) <= np.maximum(found.errors, 1e-11) * exact.variances)


def test_a_sharp_resonance_is_not_missed():
    w0, ratio = 2 * np.pi * 1.1, 1e-6
    system = SecondOrderSystem.from_matrices(
        [[1.0]], [[2 * ratio * w0]], [[w0**2]], guideway=("heave@leg",), K_w=[[w0**2]], outputs=("gap",),
        H_q=[[1.0]], H_w=[[-1.0]],
    )  # fmt: skip
    tracks = track_processes(
        track_inputs(["heave@leg"], [[0.0, 0.0]], speed=100.0),
        vertical=shaping_filter(inverse_square(1e-6), speed=100.0),
    )
    channel = ride_channel(system, None, [Signal.of("gap")])
    found = frequency_covariances(channel, tracks, finite_rates=[False])
    expected = np.pi * 1e-4 * (1.0 + 4.0 * ratio**2) / (4.0 * ratio * w0)
    assert found.variances[0] == pytest.approx(expected, rel=1e-7)
    density = spectral_density(channel, tracks, [Observed("gap")], np.array([1.1, 2.0]))[0]
    assert density[0] > 1e9 * density[1]


def test_bands_add_up_and_agree_with_closed_forms():
    # x' + a x = w', white w': S(f) = 2 D / (w^2 + a^2)
    a = 5.0
    system = SecondOrderSystem.from_matrices(
        [[1.0]], [[a]], [[0.0]], dofs=("x",), ignorable=("x",), guideway=("heave@leg",), C_w=[[1.0]],
        outputs=("speed",), H_v=[[1.0]],
    )  # fmt: skip
    tracks = track_processes(
        track_inputs(["heave@leg"], [[0.0, 0.0]], speed=100.0),
        vertical=shaping_filter(inverse_square(1e-6), speed=100.0),
    )
    channel = ride_channel(system, None, [Signal.of("speed")])
    f1, f2 = 0.3, 7.0
    expected = np.pi * 1e-4 / (np.pi * a) * (np.arctan(2 * np.pi * f2 / a) - np.arctan(2 * np.pi * f1 / a))
    found = frequency_covariances(channel, tracks, band=(f1, f2))
    assert found.variances[0] == pytest.approx(expected, rel=1e-9)
    below, above = (frequency_covariances(channel, tracks, band=b).variances[0] for b in ((0.0, f1), (f2, 1e6)))
    assert below + above + expected == pytest.approx(covariances(channel, tracks).variances[0], rel=1e-6)
    told = moments(channel, tracks, [Observed("speed")], band=(f1, f2))
    assert told.agreement(0) is Agreement.AGREED
    assert told.deviations[0] == pytest.approx(np.sqrt(expected), rel=1e-9)
    assert told.rates[0] ** 2 == pytest.approx(
        1e-4 * (2 * np.pi * (f2 - f1)) - a**2 * expected, rel=1e-8
    )  # finite over a band
    quick = moments(channel, tracks, [Observed("speed")], band=(f1, f2), verified=False)
    assert quick.settled == (False,)
    assert quick.deviations[0] == pytest.approx(np.sqrt(expected), rel=1e-6)
    with pytest.raises(ValueError, match="band: expected"):
        frequency_covariances(channel, tracks, band=(3.0, 1.0))


def test_a_band_with_delays_by_exponential_integrals():
    # two legs on one rate: |1 + exp(-i w T)|^2 / (w^2 + a^2) over a band, cos(w T)/(w^2 + a^2) by E1
    a, T = 5.0, 0.4
    system = SecondOrderSystem.from_matrices(
        [[1.0]], [[a]], [[0.0]], dofs=("x",), ignorable=("x",), guideway=("heave@a", "heave@b"), C_w=[[1.0, 1.0]],
        outputs=("speed",), H_v=[[1.0]],
    )  # fmt: skip
    track = track_inputs(["heave@a", "heave@b"], [[40.0, 0.0], [0.0, 0.0]], speed=100.0)
    tracks = track_processes(track, vertical=shaping_filter(inverse_square(1e-6), speed=100.0))
    w1, w2 = 2 * np.pi * 0.3, 2 * np.pi * 20.0

    def upper(w):  # integral from w to infinity of exp(i x T) / (x^2 + a^2) dx
        return (np.exp(-a * T) * exp1(T * (-1j * w - a)) - np.exp(a * T) * exp1(T * (-1j * w + a))) / (2j * a)

    crossed = np.real(upper(w1) - upper(w2))
    plain = (np.arctan(w2 / a) - np.arctan(w1 / a)) / a
    expected = 1e-4 * 2.0 * (plain + crossed)
    found = moments(ride_channel(system, None, [Signal.of("speed")]), tracks, [Observed("speed")], band=(0.3, 20.0))
    assert found.settled == (True,)
    assert found.deviations[0] ** 2 == pytest.approx(expected, rel=1e-8)
    assert abs(2e-4 * (plain - crossed) / expected - 1.0) > 1e-2
