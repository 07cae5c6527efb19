"""Exact covariances: closed forms, two exact ways, systems without modes apart, variances that do not exist."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from ride_vehicles import random_channel

from maglev_ctrl.analysis.response.channels import Noise, Process, RideChannel, Signal, ride_channel, track_processes
from maglev_ctrl.analysis.response.covariance import covariances, modal_residues
from maglev_ctrl.analysis.response.sources import Observed
from maglev_ctrl.analysis.response.weighting import weighting, weighting_from_parameters
from maglev_ctrl.errors import NotStable
from maglev_ctrl.guideway.correlation import track_inputs
from maglev_ctrl.guideway.shaping import shaping_filter
from maglev_ctrl.guideway.spectra import federal_railroad, inverse_square, rational, single_pole
from maglev_ctrl.systems import SecondOrderSystem
from maglev_ctrl.systems.feedback import Controller

SPEED = 80.0


def _leg(m=2.0, c=0.8, k=8.0, *, absolute=False):
    """A mass on a leg; the damper to the guideway or to the sky."""
    return SecondOrderSystem.from_matrices(
        [[m]], [[c]], [[k]], guideway=("heave@leg",), K_w=[[k]], C_w=[[0.0 if absolute else c]],
        outputs=("gap", "place", "acceleration", "speed"), H_q=[[1.0], [1.0], [0.0], [0.0]],
        H_a=[[0.0], [0.0], [1.0], [0.0]], H_v=[[0.0], [0.0], [0.0], [1.0]], H_w=[[-1.0], [0.0], [0.0], [0.0]],
    )  # fmt: skip


def _track(rough, places=((0.0, 0.0),), names=("heave@leg",), speed=SPEED):
    return track_processes(track_inputs(names, places, speed=speed), vertical=shaping_filter(rough, speed=speed))


def test_base_excitation_by_white_rate_in_closed_form():
    # relative motion: m r'' + c r' + k r = -m w'', so r = -s/(s^2 + ..) w': E r^2 = D^2 / (4 z w0), E r'^2 infinite;
    # with a damper to the sky r = -(s + 2 z w0)/(s^2 + ...) w': E r^2 = D^2 (1 + 4 z^2) / (4 z w0)
    m, c, k = 2.0, 0.8, 8.0
    w0, z = np.sqrt(k / m), c / (2.0 * np.sqrt(k * m))
    rough = inverse_square(2e-6)
    D = np.pi * 2e-6 * SPEED  # (two-sided intensity of w')
    on_track = covariances(ride_channel(_leg(), None, [Signal.of("gap"), Signal.of("acceleration")]), _track(rough))
    assert on_track.variances[0] == pytest.approx(D / (4.0 * z * w0), rel=1e-12)
    assert on_track.ends == ("", "high frequency")
    assert on_track.rate_ends == ("high frequency", "high frequency")
    sky = ride_channel(_leg(absolute=True), None, [Signal.of("gap"), Signal.of("acceleration"), Signal.of("speed")])
    found = covariances(sky, _track(rough))
    assert found.variances[0] == pytest.approx(D * (1.0 + 4.0 * z**2) / (4.0 * z * w0), rel=1e-12)
    # x'' = w0^2 s/(s^2 + 2 z w0 s + w0^2) w'
    assert found.variances[1] == pytest.approx(D * w0**3 / (4.0 * z), rel=1e-12)
    assert found.variances[2] == pytest.approx(D * w0 / (4.0 * z), rel=1e-12)
    assert found.rates[2] == pytest.approx(found.variances[1], rel=1e-12)  # the rate of the speed is the acceleration
    assert found.covariance[1, 2] == pytest.approx(0.0, abs=1e-12 * np.sqrt(found.variances[1] * found.variances[2]))
    mutant = covariances(sky, _track(inverse_square(2.1e-6)))
    assert mutant.variances[0] != pytest.approx(found.variances[0], rel=0.04)


def test_two_wheels_of_a_rigid_lever_see_a_window_of_the_track():
    # (w(t) - w(t - T)): variance 2 sigma^2 (1 - exp(-a T)) where w is bounded, D T where it is an integral of noise
    T, corner = 0.25, 0.02
    idle = np.array([[-1.0]])
    nothing, one = np.zeros((1, 2)), np.zeros((1, 1))
    channel = RideChannel(
        idle, nothing, nothing, np.zeros((1, 0)), one, np.array([[1.0, -1.0]]), nothing, np.zeros((1, 0)),
        ("heave@a", "heave@b"), ("tilt",),
    )  # fmt: skip
    places, names = [[SPEED * T, 0.0], [0.0, 0.0]], ("heave@a", "heave@b")
    for bounded in (True, False):
        rough = single_pole(1e-6, corner=corner) if bounded else inverse_square(1e-6)
        a = corner * SPEED
        expected = np.pi * 1e-6 / corner * (1.0 - np.exp(-a * T)) if bounded else np.pi * 1e-6 * SPEED * T
        for rounding in (1e-9, 0.0):
            found = covariances(channel, _track(rough, places, names), largest_rounding=rounding)
            assert found.variances[0] == pytest.approx(expected, rel=1e-10)
    later = [[SPEED * T * 1.01, 0.0], [0.0, 0.0]]
    assert covariances(channel, _track(inverse_square(1e-6), later, names)).variances[0] > 1.005 * expected


@pytest.mark.parametrize("rough", [inverse_square(1e-6), single_pole(1e-6, corner=0.1), federal_railroad(5)],
                         ids=["integral", "bounded", "railroad"])  # fmt: skip
@pytest.mark.parametrize("seed", range(4))
def test_modes_and_lyapunov_agree(rough, seed):
    channel, places = random_channel(seed)
    tracks = track_processes(
        track_inputs(channel.guideway, places, speed=SPEED),
        vertical=shaping_filter(rough, speed=SPEED),
        cross_level=shaping_filter(single_pole(1e-7, corner=0.3), speed=SPEED),
    )
    watched = [Observed(name) for name in channel.outputs] + [
        Observed("y0", weighting("Wk")),
        Observed("y3", weighting("Wd")),
    ]
    modal, direct = (covariances(channel, tracks, watched, largest_rounding=r) for r in (1e-6, 0.0))
    assert modal.by_modes
    assert not direct.by_modes
    assert modal.ends == direct.ends
    finite = np.isfinite(modal.variances)
    assert finite[:3].all()
    assert finite[4:].all()
    both = np.ix_(finite, finite)
    scale = np.sqrt(np.outer(modal.variances[finite], modal.variances[finite]))
    assert np.max(np.abs(modal.covariance[both] - direct.covariance[both]) / scale) < 1e-9
    rated = np.isfinite(modal.rates)
    np.testing.assert_allclose(modal.rates[rated], direct.rates[rated], rtol=1e-8)
    np.testing.assert_allclose(modal.shares[:, finite].sum(axis=0), modal.variances[finite], rtol=1e-12)
    assert modal.processes == ("vertical", "cross level", "sensor.noise")
    late = [replace(p, delays=np.where(np.arange(len(p.delays)) == 1, p.delays + 0.002, p.delays)) for p in tracks]
    mutant = covariances(channel, late, watched)
    assert np.max(np.abs(mutant.variances[finite] / modal.variances[finite] - 1.0)) > 1e-4


def test_a_defective_loop_falls_back_to_lyapunov():
    # critically damped twice, and a process with the same pole
    A = np.array([[-3.0, 1.0, 0.0], [0.0, -3.0, 1.0], [0.0, 0.0, -3.0]])
    channel = RideChannel(
        A, np.array([[0.0], [0.0], [1.0]]), np.zeros((3, 1)), np.zeros((3, 0)), np.array([[1.0, 0.0, 0.0]]),
        np.zeros((1, 1)), np.zeros((1, 1)), np.zeros((1, 0)), ("heave@leg",), ("y",),
    )  # fmt: skip
    rough = single_pole(1e-6, corner=3.0 / SPEED)
    found = covariances(channel, _track(rough))
    assert not found.by_modes
    # |1/(s+3)^3|^2 times 2 a s^2/(w^2 + a^2): a quadruple pole; integral of 1/(w^2+a^2)^4 is 5 pi / (16 a^7)
    variance = 1e-6 * np.pi / (2.0 * 3.0 / SPEED)
    assert found.variances[0] == pytest.approx(variance * 2.0 * 3.0 / np.pi * 5.0 * np.pi / (32.0 * 3.0**7), rel=1e-9)


def test_infinite_variances_are_told_by_their_end():
    channel = ride_channel(_leg(), None, [Signal.of(name) for name in ("gap", "place", "acceleration")])
    wide = covariances(channel, _track(inverse_square(1e-6)))
    assert wide.ends == ("", "low frequency", "high frequency")
    assert np.isinf(wide.variances[1:]).all()
    assert np.isnan(wide.covariance[0, 1])
    bounded = covariances(channel, _track(single_pole(1e-6, corner=0.01)))
    assert bounded.ends == ("", "", "high frequency")
    smooth = covariances(channel, _track(rational([1e-6], [1.0, 1.0, 0.01])))
    assert smooth.ends == ("", "", "")
    assert smooth.rate_ends == ("", "", "high frequency")


def test_weighting_of_a_relative_degree_of_one_passes_white_noise_but_not_its_rate():
    channel = ride_channel(_leg(), None, [Signal.of("acceleration")])
    gentle = weighting_from_parameters(f1=0.4, f3=5.0, f4=2.0, Q4=0.63)
    found = covariances(channel, _track(inverse_square(1e-6)), [Observed("acceleration", gentle)])
    assert found.ends == ("",)
    assert found.rate_ends == ("high frequency",)
    again = covariances(channel, _track(inverse_square(1e-6)), [Observed("acceleration", gentle)], largest_rounding=0.0)
    assert found.variances[0] == pytest.approx(again.variances[0], rel=1e-9)


def test_noise_of_sensors_and_commands():
    # x' = -k (x + n) with one-sided density d: E x^2 = k d^2 / 4, command u = -k (x + n) is not finite
    system = SecondOrderSystem.from_matrices(
        [[1.0]], [[0.0]], [[0.0]], inputs=("push",), B=[[1.0]], ignorable=("q1",), guideway=("heave@none",),
        outputs=("speed",), H_v=[[1.0]],
    )  # fmt: skip
    law = Controller.static([[-3.0]], measured=("speed",), commands=("push",))
    channel = ride_channel(system, law, [Signal.of("speed"), Signal.of("push")], noises=[Noise("speed", 0.2)])
    found = covariances(channel, ())
    assert found.variances[0] == pytest.approx(3.0 * 0.2**2 / 4.0, rel=1e-12)
    assert found.ends == ("", "high frequency")
    filtered = Controller.from_matrices(
        [[-50.0]], [[1.0]], [[-150.0]], [[0.0]], measured=("speed",), commands=("push",)
    )
    lagged = ride_channel(system, filtered, [Signal.of("push")], noises=[Noise("speed", 0.2)])
    # u = -150 n / ((s + 50) + 150/s) -> variance of s/(s^2 + 50 s + 150): 1/(2 * 50) times intensity
    assert covariances(lagged, ()).variances[0] == pytest.approx(150.0**2 * 0.02 / 100.0, rel=1e-10)


def test_wrong_requests_are_refused():
    channel = ride_channel(_leg(), None, [Signal.of("gap")])
    with pytest.raises(ValueError, match="observed: expected outputs"):
        covariances(channel, (), [Observed("gup")])
    with pytest.raises(ValueError, match="heave@other"):
        covariances(channel, _track(inverse_square(1e-6), names=("heave@other",)))
    with pytest.raises(ValueError, match="neither an output"):
        ride_channel(_leg(), None, [Signal.of("nothing")])
    with pytest.raises(NotStable, match="pole at"):
        ride_channel(_leg(c=-0.1), None, [Signal.of("gap")])
    with pytest.raises(NotStable, match="pole at"):
        ride_channel(_leg(c=0.0), None, [Signal.of("gap")])


def test_a_neutral_mode_that_nothing_sees_is_left_out():
    system = SecondOrderSystem.from_matrices(
        np.eye(2), np.diag([0.8, 0.0]), np.diag([4.0, 0.0]), dofs=("heave", "surge"), guideway=("heave@leg",),
        K_w=[[4.0], [0.0]], outputs=("gap", "speed"), H_q=[[1.0, 0.0], [0.0, 0.0]], H_v=[[0.0, 0.0], [0.0, 1.0]],
        H_w=[[-1.0], [0.0]], ignorable=("surge",),
    )  # fmt: skip
    channel = ride_channel(system, None, [Signal.of("gap")])
    assert len(channel.A) == 2
    assert np.isfinite(covariances(channel, _track(single_pole(1e-6, corner=0.1))).variances).all()


def test_partial_fractions_answer_as_the_loop_does():
    channel, places = random_channel(11)
    tracks = track_processes(
        track_inputs(channel.guideway, places, speed=SPEED), vertical=shaping_filter(federal_railroad(5), speed=SPEED)
    )
    process: Process = tracks[0]
    part = modal_residues(channel, tracks, [Observed("y3", weighting("Wk"))])[0]
    s = 2j * np.pi * 3.0
    loads = process.weights * np.exp(-s * process.delays)
    inner = np.linalg.solve(s * np.eye(len(channel.A)) - channel.A, (channel.E_p / s + channel.E_v) @ loads)
    answer = (channel.C @ inner + (channel.D_p / s + channel.D_v) @ loads)[3] * weighting("Wk").at(s)
    expected = answer * process.shaping.rate_response(2 * np.pi * 3.0)
    assert part.at(np.array([s]))[0, 0] == pytest.approx(expected, rel=1e-9)
