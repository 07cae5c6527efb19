"""Margins with closed forms, the lightly damped mode, infinite margins with reasons, units, time."""

from __future__ import annotations

import time

import numpy as np
import pytest

from maglev_ctrl.analysis.disk import disk_gain_range, disk_phase
from maglev_ctrl.analysis.loops import Loop, axis_points, return_ratio, sensitivity
from maglev_ctrl.analysis.margins import MarginValue, loop_margins
from maglev_ctrl.analysis.replay import DynamicPerturbation, Factor, pole_near
from maglev_ctrl.errors import Agreement, NotStable
from maglev_ctrl.systems import Controller, SecondOrderSystem

HEAVE = 2.0 * np.pi * 1.1147  # rad/s, heave mode of an electrodynamic vehicle
DAMPING_RATIO = 1e-4


def heave_loop(share: float) -> Loop:
    """Rate feedback that takes away `share` of the natural damping: L(j omega_0) = -share."""
    damping = 2.0 * DAMPING_RATIO * HEAVE
    return Loop([[0.0, 1.0], [-(HEAVE**2), -damping]], [[0.0], [1.0]], [[0.0, -share * damping]], [[0.0]], ("force",))


def test_lightly_damped_heave_mode_is_not_missed() -> None:
    """share = 39/41 gives N = S - 1/2 = 20 at resonance: disk margin 0.05, 0.43 dB, 2.86 degrees."""
    margins = loop_margins(heave_loop(39.0 / 41.0))
    one = margins.channels[0]
    assert margins.verified
    assert one.disk.alpha == pytest.approx(0.05, rel=1e-6)
    assert one.disk.gain_range_db[1] == pytest.approx(0.434, abs=1e-3)
    assert one.disk.phase == pytest.approx(2.864, abs=1e-3)
    assert one.disk.frequency == pytest.approx(HEAVE, rel=1e-5)
    assert one.gain_increase.value == pytest.approx(41.0 / 39.0, rel=1e-9)
    assert one.modulus.value == pytest.approx(2.0 / 41.0, rel=1e-6)


def test_grid_only_mutant_misses_the_heave_mode() -> None:
    """The same disk margin read off a grid of 1001 frequencies, as grid-based tools do, is twenty times optimistic."""
    grid = sensitivity(heave_loop(39.0 / 41.0), np.logspace(-2, 3, 1001))[:, 0, 0]
    from_grid = 1.0 / np.max(np.abs(grid - 0.5))
    assert from_grid > 0.9
    assert from_grid > 15.0 * loop_margins(heave_loop(39.0 / 41.0)).multi_loop.alpha


def test_heave_mode_beyond_its_damping_is_refused() -> None:
    with pytest.raises(NotStable, match=r"7\.0038"):
        loop_margins(heave_loop(1.01))


def test_unstable_loop_has_no_margins() -> None:
    """The formulas would happily return a gain factor of 2 and 36.9 degrees here."""
    with pytest.raises(NotStable, match=r"0\.5"):
        loop_margins(Loop.from_transfer_function([0.5], [1.0, -1.0]))


def test_integrator_with_delay_closed_forms() -> None:
    tau = 0.4
    one = loop_margins(Loop.from_transfer_function([1.0], [1.0, 0.0], delay=tau)).channels[0]
    assert one.verified
    assert one.gain_increase.value == pytest.approx(np.pi / 2.0 / tau, rel=1e-9)
    assert one.gain_increase.frequency == pytest.approx(np.pi / 2.0 / tau, rel=1e-9)
    assert one.phase.value == pytest.approx(90.0 - np.degrees(tau), rel=1e-9)
    assert one.delay.value == pytest.approx(np.pi / 2.0 - tau, rel=1e-9)
    without = loop_margins(Loop.from_transfer_function([1.0], [1.0, 0.0])).channels[0]
    assert without.delay.value == pytest.approx(np.pi / 2.0)  # mutant: the delay already there forgotten


def test_first_order_unstable_plant_has_both_gain_margins() -> None:
    """L = k/(s - 1), k = 2: reduction to 1/k at zero frequency, increase without limit, phase 60 degrees."""
    one = loop_margins(Loop.from_transfer_function([2.0], [1.0, -1.0])).channels[0]
    assert one.gain_reduction.value == pytest.approx(0.5)
    assert one.gain_reduction.frequency == 0.0
    assert one.gain_increase.value == np.inf
    assert "no gain increase" in one.gain_increase.reason
    assert one.phase.value == pytest.approx(60.0)
    assert one.delay.value == pytest.approx(np.radians(60.0) / np.sqrt(3.0))


def test_phase_lead_may_be_the_smaller_side() -> None:
    """A resonance with lead: below it the loop leads by nearly 90 degrees, above it it lags by less."""
    pair = loop_margins(Loop.from_transfer_function([0.3, 3.0, 0.0], [1.0, 0.5, 1.0])).channels[0]
    assert pair.verified
    assert pair.gain_crossovers.shape[0] == 2
    assert pair.phase_lead.value < pair.phase_lag.value
    assert pair.phase.value == pair.phase_lead.value
    assert pair.phase_lead.frequency < 1.0 < pair.phase_lag.frequency
    # the delay margin knows lags only
    assert pair.delay.frequency == pair.phase_lag.frequency
    assert pair.delay.value == pytest.approx(np.radians(pair.phase_lag.value) / pair.phase_lag.frequency)


def test_infinite_margins_say_why() -> None:
    one = loop_margins(Loop.from_transfer_function([0.5], [1.0, 1.0])).channels[0]
    for value in (one.phase, one.delay):
        assert value.value == np.inf
        assert value.verified
        assert "never equals one" in value.reason
    assert one.gain_reduction.value == 0.0
    assert one.gain_reduction.decibel == -np.inf


def test_feedthrough_above_one_has_no_delay_margin() -> None:
    one = loop_margins(Loop([[-1.0]], [[1.0]], [[1.0]], [[1.5]], ("u",))).channels[0]
    assert one.delay.value == 0.0
    assert "any delay" in one.delay.reason


def test_static_loop() -> None:
    one = loop_margins(Loop.from_transfer_function([-0.5], [1.0])).channels[0]
    assert one.gain_increase.value == pytest.approx(2.0)
    assert one.modulus.value == pytest.approx(0.5)


def test_open_channel_is_harmless() -> None:
    """A channel that measures nothing: S = 1."""
    margins = loop_margins(Loop([[-1.0]], [[1.0, 1.0]], [[1.0], [0.0]], np.zeros((2, 2)), ("live", "dead")))
    assert margins.verified
    assert margins.channel("dead").modulus.value == pytest.approx(1.0)
    with pytest.raises(ValueError, match="live, dead"):
        margins.channel("other")


def test_integrators_and_undamped_poles_in_the_loop() -> None:
    """Poles of L on the axis at 0 (double) and 3 rad/s."""
    loop = Loop.from_transfer_function(
        np.polymul([1.0, 0.5], [1.0, 0.4, 9.0]), np.polymul([1.0, 0.0, 0.0], [1.0, 0.0, 9.0])
    )
    margins = loop_margins(loop)
    assert margins.verified
    assert margins.channels[0].gain_reduction.value < 1.0


def test_two_coupled_channels_bounds_meet() -> None:
    generator = np.random.default_rng(5)
    A = generator.normal(size=(6, 6)) - 3.0 * np.eye(6)
    loop = Loop(A, generator.normal(size=(6, 2)), generator.normal(size=(2, 6)), np.zeros((2, 2)), ("a", "b"))
    margins = loop_margins(loop)
    assert margins.multi_loop.agreement is Agreement.AGREED
    assert margins.multi_loop.alpha <= margins.multi_loop.alpha_reached <= margins.multi_loop.alpha * 1.001
    assert margins.multi_loop.alpha <= min(one.disk.alpha for one in margins.channels) * (1.0 + 1e-6)
    assert margins.sensitivity_peak.lower >= max(one.sensitivity_peak for one in margins.channels) * (1.0 - 1e-6)


def test_units_and_state_scales_do_not_matter() -> None:
    """Channels in N beside kN m, states in N beside mm."""
    generator = np.random.default_rng(8)
    A = generator.normal(size=(8, 8)) - 4.0 * np.eye(8)
    B, C = generator.normal(size=(8, 2)), generator.normal(size=(2, 8))
    states, units = np.diag(10.0 ** generator.uniform(-8, 8, 8)), np.diag([1e6, 1e-2])
    inverse = np.linalg.inv
    for delays in (None, [0.02, 0.05]):
        plain = loop_margins(Loop(A, B, C, np.zeros((2, 2)), ("a", "b"), delays))
        wild = loop_margins(
            Loop(states @ A @ inverse(states), states @ B @ units, inverse(units) @ C @ inverse(states),
                 np.zeros((2, 2)), ("a", "b"), delays)
        )  # fmt: skip
        assert wild.verified
        assert wild.multi_loop.alpha == pytest.approx(plain.multi_loop.alpha, rel=1e-6)
        for one, other in zip(plain.channels, wild.channels, strict=True):
            assert other.disk.alpha == pytest.approx(one.disk.alpha, rel=1e-8)
            assert other.delay.value == pytest.approx(one.delay.value, rel=1e-8)


def test_discrete_delay_is_a_power_of_z() -> None:
    delayed = loop_margins(Loop.from_transfer_function([0.2], [1.0, -1.0], delay=0.2, dt=0.1)).channels[0]
    rational = loop_margins(Loop.from_transfer_function([0.2], [1.0, -1.0, 0.0, 0.0], dt=0.1)).channels[0]
    assert delayed.verified
    assert delayed.gain_increase.value == pytest.approx(rational.gain_increase.value, rel=1e-10)
    assert delayed.disk.alpha == pytest.approx(rational.disk.alpha, rel=1e-8)
    assert delayed.delay.value == pytest.approx(rational.delay.value, rel=1e-9)


def test_discrete_loop_with_limit_at_the_nyquist_frequency() -> None:
    """L = k/(z - 1): pole at 1 - k, so k = 2 brings it to -1."""
    margins = loop_margins(Loop.from_transfer_function([0.5], [1.0, -1.0], dt=0.1))
    one = margins.channels[0]
    assert margins.verified
    assert one.gain_increase.value == pytest.approx(4.0)
    assert one.gain_increase.frequency == pytest.approx(np.pi / 0.1)


def test_four_channels_and_twenty_states_are_quick() -> None:
    generator = np.random.default_rng(0)
    K = generator.normal(size=(10, 10))
    K = K @ K.T + np.diag(generator.uniform(10.0, 400.0, 10))
    A = np.block([[np.zeros((10, 10)), np.eye(10)], [-K, -0.3 * np.eye(10)]])
    force = generator.normal(size=(10, 4))
    B = np.vstack([np.zeros((10, 4)), force])
    loop = Loop(A, B, np.hstack([0.5 * force.T, 2.0 * force.T]), np.zeros((4, 4)), ("a", "b", "c", "d"))
    spent = []
    for _ in range(3):
        start = time.process_time()
        margins = loop_margins(loop)
        spent.append(time.process_time() - start)
    assert margins.verified
    assert min(spent) < 0.5


def test_loop_from_system_has_the_closed_loop_poles() -> None:
    plant = SecondOrderSystem.from_matrices([[2.0]], [[0.1]], [[8.0]], inputs=("force",), B=[[1.0]])
    law = Controller.static([[-3.0, -1.5]], measured=("q1", "q1.velocity"), commands=("force",))
    margins = loop_margins(Loop.from_system(plant, law))
    assert np.allclose(np.poly(margins.poles), [1.0, 1.6 / 2.0, 11.0 / 2.0])


def test_wrong_use_is_named() -> None:
    with pytest.raises(ValueError, match="delays"):
        Loop([[-1.0]], [[1.0]], [[1.0]], [[0.0]], ("u",), [-0.1])
    with pytest.raises(ValueError, match="multiples of dt"):
        Loop([[-1.0]], [[1.0]], [[1.0]], [[0.0]], ("u",), [0.15], 0.1)
    with pytest.raises(ValueError, match="channels"):
        Loop([[-1.0]], [[1.0]], [[1.0]], [[0.0]], ())
    with pytest.raises(ValueError, match="B"):
        Loop([[-1.0]], [[1.0, 2.0]], [[1.0]], [[0.0]], ("u",))
    with pytest.raises(ValueError, match="proper"):
        Loop.from_transfer_function([1.0, 0.0, 0.0], [1.0, 1.0])
    with pytest.raises(ValueError, match="sigma"):
        loop_margins(Loop.from_transfer_function([1.0], [1.0, 1.0]), sigma=np.nan)


def test_return_ratio_and_sensitivity_agree() -> None:
    loop = Loop.from_transfer_function([2.0], [1.0, 1.0], delay=0.3)
    omega = np.array([0.1, 1.0, 5.0])
    assert np.allclose(sensitivity(loop, omega), 1.0 / (1.0 + return_ratio(loop, omega)))
    assert np.allclose(return_ratio(loop, omega)[:, 0, 0], 2.0 / (1.0 + 1j * omega) * np.exp(-0.3j * omega))
    assert np.allclose(axis_points(loop, omega), 1j * omega)


@pytest.mark.parametrize("sigma", [-2.0, -1.0, 0.0, 0.5, 1.0, 2.0])
def test_disk_gain_and_phase_lie_on_the_disk(sigma: float) -> None:
    alpha = 0.6
    low, high = disk_gain_range(alpha, sigma=sigma)
    turn = np.exp(1j * np.radians(disk_phase(alpha, sigma=sigma)))
    for factor in (low, high, turn):
        delta = 2.0 * (factor - 1.0) / ((1.0 - sigma) + (1.0 + sigma) * factor)
        assert abs(delta) == pytest.approx(alpha)


def test_large_disks_have_no_limits() -> None:
    assert disk_gain_range(2.0)[1] == np.inf
    assert disk_phase(2.5, sigma=1.0) == 180.0
    assert disk_phase(np.inf) == 180.0


@pytest.mark.parametrize("value", [0.5j, -0.5j, 0.3 - 0.2j, -0.3 - 0.2j, 0.7 + 0j, -0.7 + 0j])
def test_all_pass_takes_the_value(value: complex) -> None:
    delta = DynamicPerturbation.through(value, 3.0)
    assert complex(delta.at(np.array(3.0j))) == pytest.approx(value)
    assert delta.corner >= 0.0
    assert np.allclose(np.abs(delta.at(1j * np.logspace(-2, 2, 9))), abs(value))


def test_pole_near_follows_a_delay() -> None:
    loop = Loop.from_transfer_function([1.0], [1.0, 0.0])
    replay = pole_near(loop, 0.9j, (Factor(delay=np.pi / 2.0),))
    assert replay.pole == pytest.approx(1j, abs=1e-9)


def test_unresolved_value_reads_as_nan() -> None:
    assert np.isnan(MarginValue(np.nan, np.nan, False, "UNRESOLVED").decibel)
