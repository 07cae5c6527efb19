"""Ride of passengers, clearances, power of actuators, masks; against balances, closed forms and simulation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.signal
from ride_vehicles import SPEED, train

from maglev_ctrl.analysis.response.channels import Noise, Signal, passenger_signals, ride_channel, track_processes
from maglev_ctrl.analysis.response.covariance import covariances
from maglev_ctrl.analysis.response.gaussian import crossing_rate, probability_per_hour, share_beyond, supplied_power
from maglev_ctrl.analysis.response.masks import third_octave_grid, worst_over_mask
from maglev_ctrl.analysis.response.records import PsdMask
from maglev_ctrl.analysis.response.requests import Clearance, Passenger, guideway_places, link_port
from maglev_ctrl.analysis.response.ride import ride_response
from maglev_ctrl.analysis.response.weighting import weighting_from_parameters
from maglev_ctrl.errors import Agreement
from maglev_ctrl.forces import ImageForce
from maglev_ctrl.guideway.correlation import track_inputs
from maglev_ctrl.guideway.shaping import shaping_filter
from maglev_ctrl.guideway.spectra import federal_railroad, inverse_square, rational, single_pole
from maglev_ctrl.systems import SecondOrderSystem
from maglev_ctrl.vehicle import Body, Magnet, OperatingPoint, SpringDamper, Vehicle, linearize


def _cart(damping=900.0, speed=100.0):
    """A body on one magnet, sprung and damped to a smaller one below it."""
    coil = ImageForce(1e5, 1.0, 2.5e7, 0.02, 1.0)
    vehicle = Vehicle(
        "cart", bodies=(Body("car", 2000.0, position=(0.0, 0.0, 1.0)), Body("bogie", 500.0)),
        magnets=(Magnet("magnet", "bogie", force=coil),),
        connections=(
            SpringDamper("spring", "car", to="bogie", stiffness=3e4, damping=damping),
            SpringDamper("primary", "bogie", damping=4e3),
        ),
        reference_height=0.1,
    )  # fmt: skip
    system = linearize(vehicle, OperatingPoint(speed, 0.1))
    return system, track_inputs(system.guideway, guideway_places(vehicle, system.guideway), speed=speed)


SMOOTH = rational([1e-6], [1.0, 2.0, 0.0], name="integral of a first-order process")


def test_dissipation_of_dampers_is_their_damping_and_what_the_guideway_feeds_in():
    system, track = _cart()
    ports = [link_port(system, "spring"), link_port(system, "primary")]
    found = ride_response(system, None, track=track, speed=100.0, vertical=SMOOTH, ports=ports)
    assert found.agreement is Agreement.AGREED
    secondary, primary = found.actuators
    assert secondary.mean_power == pytest.approx(-900.0 * secondary.velocity**2, rel=1e-9)
    assert primary.mean_power == pytest.approx(-4e3 * primary.velocity**2, rel=1e-9)
    # a pure damper's force and velocity are one: it supplies nothing; the spring's elastic part gives and takes
    assert abs(primary.supplied_power) < 1e-6 * abs(primary.mean_power)
    assert secondary.supplied_power > 0.0
    assert secondary.energy_per_hour == pytest.approx(3600.0 * secondary.supplied_power)
    # what the dampers take is what the moving guideway puts in: -E[(guideway force on the vehicle) w']
    rough = track_processes(track, vertical=shaping_filter(SMOOTH, speed=100.0))
    channel = ride_channel(system, None, [Signal.of("car.heave.acceleration"), Signal.of("bogie.heave.acceleration")])
    channel = replace(  # w' of the guideway as an output; the magnet and the damper stand at one place
        channel, C=np.vstack([channel.C, np.zeros((1, len(channel.A)))]),
        D_p=np.vstack([channel.D_p, np.zeros((1, 2))]), D_v=np.vstack([channel.D_v, [[1.0, 0.0]]]),
        D_n=np.zeros((3, 0)), outputs=(*channel.outputs, "guideway.rate"),
    )  # fmt: skip
    moved = covariances(channel, rough).covariance
    fed = 2000.0 * moved[0, 2] + 500.0 * moved[1, 2]
    taken = -(secondary.mean_power + primary.mean_power)
    assert fed == pytest.approx(taken, rel=1e-8)
    assert abs(fed + secondary.mean_power - primary.mean_power) > 0.1 * fed  # a flipped sign


def test_comfort_rises_with_the_roughness_and_masks_find_the_peak():
    system, track = _cart()
    mask = PsdMask("flat", "vertical", [0.1, 80.0], [1e-2, 1e-2])

    def ride(factor):
        return ride_response(
            system, None, track=track, speed=100.0, vertical=single_pole(1e-6 * factor, corner=0.02),
            passengers=[Passenger("seat")], masks=[mask],
        )  # fmt: skip

    first, second = ride(1.0), ride(4.0)
    assert second.passengers[0].total == pytest.approx(2.0 * first.passengers[0].total, rel=1e-9)
    assert second.masks[0].worst == pytest.approx(4.0 * first.masks[0].worst, rel=1e-9)
    assert second.masks[0].agreement is Agreement.AGREED
    density = first.spectra[0]
    assert density.frequency.shape == density.density.shape
    peak = np.argmax(density.density)
    assert first.masks[0].worst >= 100.0 * np.max(density.density) * (1.0 - 1e-12)
    assert first.masks[0].frequency == pytest.approx(density.frequency[peak], rel=0.03)
    # area under the spectrum and its third octaves is the variance
    wide = ride_response(
        system, None, track=track, speed=100.0, vertical=single_pole(1e-6, corner=0.02),
        passengers=[Passenger("seat")], frequency=np.geomspace(1e-3, 3e4, 60_000),
    )  # fmt: skip
    area = np.trapezoid(wide.spectra[0].density, wide.spectra[0].frequency)
    assert wide.passengers[0].unweighted[0] == pytest.approx(np.sqrt(area), rel=1e-3)
    banded = ride_response(
        system, None, track=track, speed=100.0, vertical=single_pole(1e-6, corner=0.02),
        passengers=[Passenger("seat")], band=(0.1, 50.0), frequency=np.geomspace(0.1, 50.0, 20_000),
    )  # fmt: skip
    area = np.trapezoid(banded.spectra[0].density, banded.spectra[0].frequency)
    assert banded.passengers[0].unweighted[0] == pytest.approx(np.sqrt(area), rel=1e-6)
    assert banded.agreement is Agreement.AGREED
    assert banded.band == (0.1, 50.0)


def test_a_sharp_resonance_cannot_hide_from_a_mask():
    w0, ratio = 2 * np.pi * 3.217, 1e-5
    system = SecondOrderSystem.from_matrices(
        [[1.0]], [[2 * ratio * w0]], [[w0**2]], dofs=("car.heave",), guideway=("heave@leg",), K_w=[[w0**2]],
        outputs=("car.heave.acceleration",), H_a=[[1.0]],
    )  # fmt: skip
    tracks = track_processes(
        track_inputs(["heave@leg"], [[0.0, 0.0]], speed=100.0),
        vertical=shaping_filter(inverse_square(1e-6), speed=100.0),
    )
    channel = ride_channel(system, None, [Signal.of("car.heave.acceleration")])
    worst, at, _ = worst_over_mask(channel, tracks, "car.heave.acceleration", PsdMask("m", "vertical", [1, 10], [1, 1]))
    assert at == pytest.approx(3.217, rel=1e-6)
    # w0^2 |s / (..)| of w' at resonance is w0 / (2 ratio)
    assert worst == pytest.approx(2.0 * np.pi * 1e-4 * (w0 / (2.0 * ratio)) ** 2, rel=1e-4)


def test_a_passenger_feels_rotation_with_the_right_sign():
    names = tuple(f"car.{dof}" for dof in ("sway", "heave", "roll", "pitch", "yaw"))
    system = SecondOrderSystem.from_matrices(
        np.eye(5),
        np.eye(5),
        np.eye(5),
        dofs=names,
        outputs=tuple(f"{name}.acceleration" for name in names),
        H_a=np.eye(5),
    )
    parts = dict(passenger_signals(system, "car", x=10.0, y=2.0, z=0.5, name="seat"))
    vertical, lateral = dict(parts["vertical"].terms), dict(parts["lateral"].terms)
    turn = {f"car.{dof}.acceleration": value for dof, value in (("roll", 0.3), ("pitch", -0.2), ("yaw", 0.7))}
    lifted = np.cross([0.3, -0.2, 0.7], [10.0, 2.0, 0.5])  # angles times the lever
    assert sum(vertical.get(k, 0.0) * v for k, v in turn.items()) == pytest.approx(lifted[2])
    assert sum(lateral.get(k, 0.0) * v for k, v in turn.items()) == pytest.approx(lifted[1])
    with pytest.raises(ValueError, match="body: expected"):
        passenger_signals(system, "bogie", x=0.0, y=0.0, z=0.0, name="seat")


def test_a_whole_train():
    system, law, track = train()
    asked = {
        "track": track, "speed": SPEED, "vertical": federal_railroad(6), "cross_level": single_pole(1e-7, corner=0.05),
        "passengers": [Passenger("middle"), Passenger("nose", 12.0, 1.0)],
        "clearances": [
            Clearance("gap", "gap", "front_magnet_1_left.gap", nominal=0.2, clearance=0.15),
            Clearance("stroke", "stroke", "secondary_rear_left.stroke", nominal=0.0, clearance=0.08, sag=0.01),
            Clearance("none", "stroke", "secondary_rear_left.stroke", nominal=0.0, clearance=0.01, sag=0.01),
        ],
        "ports": [link_port(system, "front_motor", limit=2e4), link_port(system, "front_primary_left")],
        "noises": [Noise("front_speed", 1e-4)],
        "signals": [Signal("twist", (("car.roll", 1.0), ("front.roll", -1.0)), "rad")],
    }  # fmt: skip
    found = ride_response(system, law, **asked)
    assert found.agreement is Agreement.AGREED
    assert found.largest_difference < 1e-9
    gap, stroke, none = found.clearances
    assert gap.used == pytest.approx(3.0 * gap.deviation / 0.15)
    assert np.isnan(gap.contact_per_hour)
    assert gap.reason == "infinite variance of the rate: high frequency"
    assert stroke.contact_per_hour == pytest.approx(2.0 * 3600.0 * stroke.crossing_rate, rel=1e-6)
    assert none.contact_per_hour == 1.0
    motor, primary = found.actuators
    assert motor.mean_power < 0.0  # a skyhook law takes energy out
    assert 0.0 < motor.saturated < 1.0
    assert motor.three_sigma_share == pytest.approx(3.0 * motor.force / 2e4)
    assert np.isnan(primary.mean_power)
    assert "velocity: infinite variance: high frequency" in primary.reason
    assert found.signals[0].by_lyapunov == pytest.approx(found.signals[0].by_frequency, rel=1e-8)
    quick = ride_response(system, law, **asked, verified=False)
    assert quick.agreement is Agreement.UNRESOLVED
    assert quick.passengers[1].total == pytest.approx(found.passengers[1].total, rel=1e-12)
    assert quick.passengers[1].reason == "vertical: one method only; unweighted vertical: one method only"
    passive = ride_response(*train(active=False)[:1], None, **{**asked, "noises": []})
    idle = passive.actuators[0]  # no law: no force, hence no power
    assert idle.force == idle.mean_power == idle.supplied_power == idle.saturated == 0.0
    assert passive.passengers[1].total != pytest.approx(found.passengers[1].total, rel=1e-2)


def test_what_cancels_is_zero_and_not_rounding():
    # without delays the front and the rear move in step: no pitch; without a cross level no roll
    system, _, track = train(active=False)
    together = replace(track, delays=np.zeros_like(track.delays))
    rides = [
        ride_response(
            system, None, track=t, speed=SPEED, vertical=federal_railroad(6),
            signals=[Signal.of("car.pitch"), Signal.of("car.roll"), Signal.of("car.roll.acceleration")],
        )
        for t in (track, together)
    ]  # fmt: skip
    assert rides[0].agreement is rides[1].agreement is Agreement.AGREED
    assert rides[0].signals[0].deviation > 1e-4
    assert [one.deviation for one in rides[1].signals] == [0.0, 0.0, 0.0]
    assert [one.deviation for one in rides[0].signals[1:]] == [0.0, 0.0]


def test_an_output_that_nothing_reaches_does_not_move():
    system = SecondOrderSystem.from_matrices(
        np.eye(2), np.eye(2), np.array([[4.0, 0.0], [0.0, 9.0]]), dofs=("car.heave", "car.sway"),
        guideway=("heave@leg",), K_w=[[4.0], [0.0]], outputs=("car.heave.acceleration", "car.sway.acceleration"),
        H_a=np.eye(2),
    )  # fmt: skip
    found = ride_response(
        system, None, track=track_inputs(["heave@leg"], [[0.0, 0.0]], speed=100.0), speed=100.0,
        vertical=inverse_square(1e-6), passengers=[Passenger("seat")],
    )  # fmt: skip
    assert found.agreement is Agreement.AGREED
    assert found.passengers[0].weighted[1] == 0.0
    assert found.passengers[0].total == found.passengers[0].weighted[0] > 0.0


def test_gaussian_statistics():
    rng = np.random.default_rng(5)
    force, velocity, r = 3.0, 0.5, -0.6
    sample = rng.multivariate_normal([0, 0], [[9.0, r * 1.5], [r * 1.5, 0.25]], size=400_000)
    product = sample[:, 0] * sample[:, 1]
    positive = np.maximum(product, 0.0)
    noise = np.std(positive) / np.sqrt(len(positive))
    assert supplied_power(force, velocity, r) == pytest.approx(np.mean(positive), abs=4.0 * noise)
    assert supplied_power(force, velocity, -r) - supplied_power(force, velocity, r) == pytest.approx(-r * 1.5)
    assert supplied_power(force, velocity, 0.0) == pytest.approx(1.5 / np.pi)
    assert share_beyond(1.0, 1.0) == pytest.approx(0.317310508)
    assert crossing_rate(0.002, 0.05, 0.01) == pytest.approx(0.05 / (2 * np.pi * 0.002) * np.exp(-12.5))
    assert probability_per_hour(1e-12) == pytest.approx(3.6e-9, rel=1e-6)
    assert crossing_rate(0.0, 0.0, 1.0) == 0.0


def test_simulated_deviations_and_crossings():
    # two legs, the rear 0.1 s late, white rate held over steps of 0.5 ms
    m, k, c, dt, delay, D = 1.0, 400.0, 8.0, 5e-4, 0.1, np.pi * 1e-6 * 50.0
    system = SecondOrderSystem.from_matrices(
        [[m]], [[c]], [[k]], guideway=("heave@front", "heave@rear"), K_w=[[k / 2, k / 2]], outputs=("place",),
        H_q=[[1.0]], H_w=[[-0.5, -0.5]],
    )  # fmt: skip
    track = track_inputs(system.guideway, [[5.0, 0.0], [0.0, 0.0]], speed=50.0)
    found = ride_response(
        system, None, track=track, speed=50.0, vertical=inverse_square(1e-6),
        clearances=[Clearance("stroke", "gap", "place", nominal=0.1, clearance=0.02)], band=None,
    )  # fmt: skip
    exact = found.clearances[0]
    # relative motion r'' + c r' + k r = -(w'' + c w') with w the mean of both, from w': -(s + c)/(s^2 + c s + k)
    filtered = scipy.signal.cont2discrete(([-1.0, -c], [1.0, c, k]), dt)
    rng = np.random.default_rng(1)
    count, shift = 6_000_000, round(delay / dt)
    rate = rng.standard_normal(count + shift) * np.sqrt(D / dt)
    mean = 0.5 * (rate[shift:] + rate[:-shift])
    answer = scipy.signal.lfilter(filtered[0].ravel(), filtered[1], mean)
    assert np.std(answer) == pytest.approx(exact.deviation, rel=0.03)  # 3000 s, some 1e4 independent values
    alone = scipy.signal.lfilter(filtered[0].ravel(), filtered[1], rate[shift:])
    assert abs(np.std(alone) / exact.deviation - 1.0) > 0.1  # both legs in step


def test_requests_are_checked():
    system, track = _cart()
    with pytest.raises(ValueError, match="at least one of them"):
        ride_response(system, None, track=track, speed=100.0)
    with pytest.raises(ValueError, match="link: expected"):
        link_port(system, "nothing")
    with pytest.raises(ValueError, match="expected a positive length"):
        Clearance("gap", "gap", "magnet.gap", nominal=0.1, clearance=0.0)
    with pytest.raises(ValueError, match="frequencies in Hz that increase"):
        PsdMask("m", "vertical", [2.0, 1.0], [1.0, 1.0])
    with pytest.raises(ValueError, match="positive densities"):
        PsdMask("m", "vertical", [1.0, 2.0], [1.0, -1.0])
    with pytest.raises(ValueError, match="two different signals"):
        ride_response(
            system, None, track=track, speed=100.0,
            signals=[Signal("a", (("car.heave", 1.0),)), Signal("a", (("car.heave", 2.0),))],
        )  # fmt: skip
    flat = weighting_from_parameters(f1=0.5, f2=50.0, name="band")
    found = ride_response(
        system, None, track=track, speed=100.0, vertical=SMOOTH, passengers=[Passenger("seat", vertical="band")],
        weightings=[flat],
    )  # fmt: skip
    assert found.passengers[0].agreement is Agreement.AGREED


def test_third_octaves_have_base_ten_edges():
    grid = third_octave_grid(1.0, 2.0, per_band=1)
    np.testing.assert_allclose(grid, 10.0 ** (np.array([-1, 1, 3, 5, 7]) / 20.0))
