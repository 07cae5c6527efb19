"""`simulate` against closed forms, matrix exponentials and the theory of sampled systems."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from scipy.linalg import expm
from simulation_vehicles import WalledForce, cart, full_vehicle

from maglev_ctrl.analysis.simulation.records import Limits
from maglev_ctrl.analysis.simulation.run import simulate
from maglev_ctrl.forces import Electromagnet
from maglev_ctrl.systems import Controller, close_loop
from maglev_ctrl.vehicle import (
    Actuator,
    Body,
    Magnet,
    OperatingPoint,
    Sensor,
    SpringDamper,
    Vehicle,
    equilibrium,
    linearize,
)

ERROR = 1e-6
"""Of Runge-Kutta steps as the tests choose them, relative; a wrong sign or entry changes results by more than 1e-3."""


@dataclass(frozen=True)
class Wave:
    """A sinusoidal guideway."""

    amplitude: float
    length: float

    def under(self, x, y):
        return self.amplitude * np.sin(2.0 * np.pi * np.asarray(x) / self.length), np.zeros_like(x)

    def slopes(self, x, y):
        k = 2.0 * np.pi / self.length
        return self.amplitude * k * np.cos(k * np.asarray(x)), np.zeros_like(x)


def _pushed(**actuator: float) -> tuple:
    elements = {"actuators": (Actuator("push", "car", **actuator),)}
    return cart(damping=20.0, elements=elements)


def test_free_and_forced_oscillations_are_the_closed_forms() -> None:
    vehicle, rest = cart(damping=20.0)
    free = simulate(vehicle, rest, duration=1.0, start={"car.heave": [0.01, -0.02]}, runs=2, sampling=0.02, step=0.002)
    decay, w = 1.0, np.sqrt(399.0)
    form = np.exp(-decay * free.time) * (np.cos(w * free.time) + decay / w * np.sin(w * free.time))
    assert np.max(np.abs(free.of("car.heave") - np.outer([0.01, -0.02], form))) < ERROR * 0.02
    mutant = np.exp(-decay * free.time) * (np.cos(w * free.time) - decay / w * np.sin(w * free.time))
    assert np.max(np.abs(free.of("car.heave")[0] - 0.01 * mutant)) > 1e-3 * 0.01
    assert free.energy_error < ERROR and free.step_error < ERROR and not free.events
    # Over a wave: m z'' + c (z' - w') + k (z - w) = 0, steady after a transient that decays as exp(-t).
    wave = Wave(0.005, 10.0)
    forced = simulate(vehicle, rest, duration=7.0, track=wave, sampling=0.05, step=0.01)
    W = 2.0 * np.pi * 20.0 / 10.0
    transfer = (4000.0 + 20j * W) / (4000.0 - 10.0 * W**2 + 20j * W)
    late = forced.time > 6.5
    steady = np.imag(0.005 * transfer * np.exp(1j * W * forced.time))
    transient = 0.02 * np.exp(-6.5)
    assert np.max(np.abs(forced.of("car.heave")[0] - steady)[late]) < transient
    opposite = np.imag(0.005 * np.conj(transfer) * np.exp(1j * W * forced.time))
    assert np.max(np.abs(forced.of("car.heave")[0] - opposite)[late]) > 10.0 * transient
    stroke = forced.of("leg.stroke")[0] - (forced.of("car.heave")[0] - wave.under(20.0 * forced.time, 0.0)[0])
    assert np.max(np.abs(stroke)) < 1e-15


def test_rear_elements_meet_the_track_later() -> None:
    legs = tuple(
        SpringDamper(f"{name}_leg", name, stiffness=4000.0, damping=20.0, position=(x, 0.0, 0.0))
        for name, x in (("front", 3.0), ("rear", -1.0))
    )
    bodies = tuple(Body(leg.body, 10.0, position=leg.position) for leg in legs)
    vehicle = Vehicle("two", bodies, connections=legs, reference_height=0.1)
    found = simulate(
        vehicle, equilibrium(vehicle, OperatingPoint(20.0, 0.1)), duration=7.0, track=Wave(0.005, 10.0), sampling=0.05,
        step=0.005,
    )  # fmt: skip
    front, rear, delay = found.of("front.heave")[0], found.of("rear.heave")[0], 4.0 / 20.0
    late = np.arange(130, 140)
    assert np.max(np.abs(rear[late] - front[late - round(delay / 0.05)])) < 1e-4
    assert np.max(np.abs(rear[late] - front[late + round(delay / 0.05) - 4])) > 1e-3


def test_small_motion_is_the_matrix_exponential_of_the_closed_loop() -> None:
    vehicle, rest = full_vehicle()
    system = linearize(vehicle, rest, pade_order=0)
    law = Controller.from_matrices(
        [[-20.0, 3.0], [0.0, -8.0]], [[4.0, 0.1, 0.5], [30.0, -0.2, 1.0]], [[5.0, -8.0], [3.0, 9.0]],
        [[-300.0, -15.0, -40.0], [200.0, 4.0, -60.0]],
        measured=("above", "shaken", "moved"), commands=("ideal", "slow"),
    )  # fmt: skip
    closed = close_loop(system, law)
    random = np.random.default_rng(0)
    names = [name for name in closed.states if not name.startswith("controller")]
    start = {name: 1e-8 * random.standard_normal(2) for name in names}
    found = simulate(
        vehicle, rest, controller=law, duration=0.2, start=start, runs=2, sampling=0.05, step=0.002, noise=False
    )
    first = np.array([start.get(name, np.zeros(2)) for name in closed.states])
    for sample in (2, 4):
        expected = expm(closed.state_matrix() * found.time[sample]) @ first
        got = np.array([found.of(name)[:, sample] for name in names])
        scale = np.max(np.abs(expected[: len(names)]))
        assert np.max(np.abs(got - expected[: len(names)])) < 1e-5 * scale
    # Mutant: without the acceleration's part of the law the motion is another.
    D = law.D.copy()
    D[:, 1] = 0.0
    other = Controller.from_matrices(law.A, law.B, law.C, D, measured=law.measured, commands=law.commands)
    expected = expm(close_loop(system, other).state_matrix() * found.time[4]) @ first
    assert np.max(np.abs(got - expected[: len(names)])) > 1e-3 * scale


@pytest.mark.parametrize(("computation", "delay"), [(0.0, 0.0), (0.006, 0.0), (0.003, 0.0245), (0.02, 0.02)])
def test_a_sampled_law_with_delays_is_discrete_time_theory(computation: float, delay: float) -> None:
    vehicle, rest = _pushed(delay=delay)
    period, gain = 0.02, np.array([[-900.0, -40.0]])
    law = Controller.static(gain, measured=("car.heave", "car.heave.velocity"), commands=("push",), dt=period)
    found = simulate(
        vehicle, rest, controller=law, duration=0.3, start={"car.heave": 0.01}, sampling=period,
        computation=computation, step=0.002,
    )  # fmt: skip
    # One command at a time: over a period the older one acts first, the newer one after the delay's remainder.
    late = computation + delay
    ago = int(np.floor(late / period + 1e-9))
    rest_of = late - ago * period
    A, B = np.array([[0.0, 1.0], [-400.0, -2.0]]), np.array([[0.0], [0.1]])

    def held(time: float) -> tuple[np.ndarray, np.ndarray]:
        whole = expm(np.block([[A, B], [np.zeros((1, 3))]]) * time)
        return whole[:2, :2], whole[:2, 2:]

    def motion(older: int) -> np.ndarray:
        (P1, G1), (P2, G2) = held(rest_of), held(period - rest_of)
        x, issued, states = np.array([[0.01], [0.0]]), [np.zeros((1, 1))] * 5, []
        for _ in found.time:
            states.append(x[0, 0])
            issued.append(gain @ x)
            x = P2 @ (P1 @ x + G1 @ issued[-1 - older]) + G2 @ issued[-1 - ago]
        return np.array(states)

    assert np.max(np.abs(found.of("car.heave")[0] - motion(ago + 1))) < ERROR * 0.01
    if rest_of > 1e-9:
        assert np.max(np.abs(found.of("car.heave")[0] - motion(ago))) > 1e-4 * 0.01


def test_a_sampled_law_keeps_its_states_and_samples_in_between() -> None:
    vehicle, rest = _pushed()
    law = Controller.from_matrices(
        [[0.7]], [[1.0]], [[-300.0]], [[-100.0]], measured=("car.heave",), commands=("push",), dt=0.02
    )
    found = simulate(vehicle, rest, controller=law, duration=0.4, start={"car.heave": 0.01}, sampling=0.01, step=0.001)
    y, command = found.of("car.heave")[0, ::2], found.of("push.applied")[0]
    x, issued = 0.0, []
    for reading in y:
        issued.append(-300.0 * x - 100.0 * reading)
        x = 0.7 * x + reading
    assert np.max(np.abs(command[::2] - issued)) < 1e-9
    assert np.max(np.abs(command[1::2] - issued[:-1])) < 1e-9
    for period, interval in ((0.01, 0.01 / 3.0), (0.0015, 0.0045), (0.004, 0.004)):
        timed = Controller.static([[-1.0]], measured=("car.heave",), commands=("push",), dt=period)
        assert simulate(vehicle, rest, controller=timed, duration=0.05).interval == pytest.approx(interval)
    with pytest.raises(ValueError, match="whole multiple or a whole part"):
        simulate(vehicle, rest, controller=law, duration=0.4, sampling=0.015)


def test_a_continuous_law_with_a_delay_has_the_transcendental_root() -> None:
    delay, gain = 0.03, 60.0
    vehicle, rest = _pushed(delay=delay)
    law = Controller.static([[-gain]], measured=("car.heave.velocity",), commands=("push",))

    def characteristic(s: complex, sign: float = 1.0) -> complex:
        return 10.0 * s * s + 20.0 * s + 4000.0 + sign * gain * s * np.exp(-s * delay)

    def root(sign: float) -> complex:
        s = -1.0 + 20j
        for _ in range(50):
            slope = (characteristic(s + 1e-7, sign) - characteristic(s - 1e-7, sign)) / 2e-7
            s -= characteristic(s, sign) / slope
        return s

    found = simulate(vehicle, rest, controller=law, duration=1.2, start={"car.heave": 0.01}, sampling=0.01, step=0.005)
    s = root(1.0)
    late = found.time > 0.7
    basis = np.exp(np.outer(found.time[late], [s, np.conj(s)]))
    value = found.of("car.heave")[0, late]
    fit = np.linalg.lstsq(basis, value.astype(complex), rcond=None)[0]
    assert np.max(np.abs(basis @ fit - value)) < 1e-4 * np.max(np.abs(value))
    wrong = np.exp(np.outer(found.time[late], [root(-1.0), np.conj(root(-1.0))]))
    fit = np.linalg.lstsq(wrong, value.astype(complex), rcond=None)[0]
    assert np.max(np.abs(wrong @ fit - value)) > 1e-2 * np.max(np.abs(value))


def test_saturated_force_throws_a_parabola() -> None:
    vehicle, rest = cart(
        stiffness=0.0, elements={"actuators": (Actuator("push", "car", force_limit=50.0),), "gravity": 0.0}
    )
    law = Controller.static([[-1e6]], measured=("car.heave",), commands=("push",))
    found = simulate(vehicle, rest, controller=law, duration=0.1, start={"car.heave": 0.05}, sampling=0.01, step=0.005)
    assert np.max(np.abs(found.of("car.heave")[0] - (0.05 - 2.5 * found.time**2))) < 1e-12
    assert found.saturation["push"][0] == pytest.approx(1.0)
    assert np.all(found.of("push.applied")[0] == -50.0) and found.of("push.command")[0, 0] == -5e4
    weak = simulate(vehicle, rest, controller=law, duration=0.02, start={"car.heave": 1e-6}, sampling=0.01, step=1e-4)
    assert weak.saturation["push"][0] == 0.0


@dataclass(frozen=True, eq=False, slots=True)
class Shelf(WalledForce):
    """A lift that holds the vehicle at its height and is gone anywhere below."""

    def forces(self, height, gap, speed):
        found = WalledForce.forces(self, np.asarray(height), gap, speed)
        return found.scaled(np.where(np.asarray(height) < 0.1 - 1e-9, 0.0, 1.0))


def test_a_falling_mass_touches_when_it_must() -> None:
    vehicle = Vehicle(
        "falling", (Body("car", 10.0),), reference_height=0.1, reference_gap=0.05, drag_direction=False,
        magnets=(Magnet("shelf", "car", force=Shelf(), side=1),),
    )  # fmt: skip
    rest = equilibrium(vehicle, OperatingPoint(20.0, 0.1, gap=0.05))
    drops = np.array([0.001, 0.01, 0.05])
    found = simulate(
        vehicle, rest, duration=1.0, start={"car.heave": -drops}, runs=3, sampling=0.01, step=0.01,
        limits=Limits(0.005),
    )  # fmt: skip
    times = np.sqrt(2.0 * (0.095 - drops) / 9.80665)
    assert [event.kind for event in found.events] == ["contact"] * 3
    assert np.max(np.abs(found.ends - times)) < 1e-9
    assert found.events[1].speed == pytest.approx(9.80665 * times[1], rel=1e-9) and found.events[1].element == "shelf"
    whole = np.isfinite(found.of("car.heave")).sum(axis=1)
    assert np.array_equal(whole, np.floor(times / 0.01).astype(int) + 1)
    # Mutant: straight lines between nodes would be seen.
    assert np.min(np.abs(np.ceil(times / 0.01) * 0.01 - times)) > 1e-6


def test_strokes_data_and_divergence_end_runs() -> None:
    vehicle, rest = cart(stiffness=-4000.0, elements={"gravity": 0.0})
    limits = Limits(strokes={"leg": 0.05}, travel=1.0)
    found = simulate(vehicle, rest, duration=1.0, start={"car.heave": [1e-3, -2e-3]}, runs=2, limits=limits, step=0.004)
    exact = np.arccosh(0.05 / np.array([1e-3, 2e-3])) / 20.0
    assert np.max(np.abs(found.ends - exact)) < 1e-6 and found.events[0].element == "leg"
    free = simulate(vehicle, rest, duration=0.6, start={"car.heave": [1e-3, 0.0]}, runs=2, limits=Limits(travel=1.0))
    assert [event.kind for event in free.events] == ["diverged"]
    assert free.ends[1] == pytest.approx(0.6) and np.all(free.of("car.heave")[1] == 0.0)
    walled = Vehicle(
        "walled", (Body("car", 10.0),), reference_height=0.04, reference_gap=0.05, drag_direction=False,
        magnets=(Magnet("m", "car", force=WalledForce(1.0, (0.03, 0.06)), side=1),),
    )  # fmt: skip
    rest = equilibrium(walled, OperatingPoint(20.0, 0.04, gap=0.05))
    out = simulate(walled, rest, duration=0.1, start={"car.heave.velocity": [-1.0, 1.0, 1e-3]}, runs=3)
    assert [(event.run, event.kind) for event in out.events] == [(0, "data"), (1, "data")]
    assert "0.03 m is the end of the force model's data" in out.events[0].reason
    with pytest.raises(ValueError, match="no stroke of 'arm'"):
        simulate(walled, rest, duration=1.0, limits=Limits(strokes={"arm": 0.1}))


def test_iron_saturates_and_currents_follow_energy() -> None:
    coil = Electromagnet.for_lift(5e3, 0.01, turns=300, pole_area=0.03, resistance=1.0, flux_limit=0.5)
    car = Vehicle(
        "hung", (Body("car", 1e3),), magnets=(Magnet("lift", "car", force=coil, count=2),), reference_height=0.01
    )
    rest = equilibrium(car, OperatingPoint(0.0, 0.01))
    found = simulate(car, rest, duration=0.3, start={"car.heave": [1e-4, -1e-4]}, runs=2, sampling=0.001, step=0.001)
    assert found.events[0].kind == "data" and "saturates" in found.events[0].reason
    height, current = found.of("lift.height")[0], found.of("lift.current")[0]
    last = int(np.isfinite(height).sum()) - 1
    standing = float(coil.scaled(rest.strength).current)
    flux = float(coil.flux_density(height[last])) * (standing + current[last]) / float(coil.current)
    assert 0.49 < flux < 0.5  # the last sample before the limit, at most 1 ms earlier
    assert found.energy_error < 1e-4


def test_noise_has_its_density_and_seed() -> None:
    sensor = Sensor("seen", "gap", body="car", noise=1e-5)
    vehicle, rest = cart(elements={"sensors": (sensor,), "actuators": (Actuator("push", "car"),)})
    law = Controller.static([[-1.0]], measured=("seen",), commands=("push",), dt=0.005)
    runs = [
        simulate(vehicle, rest, controller=law, duration=2.0, runs=6, seed=seed, sampling=0.005, step=0.005)
        for seed in (1, 1, 2)
    ]
    same, again, other = (run.of("push.command") + run.of("seen") for run in runs)
    assert np.array_equal(same, again) and not np.allclose(same, other)
    # Variance of held samples: density^2 / (2 dt); the share of 2400 values that a variance scatters by is 2.9 %.
    assert np.var(same) == pytest.approx(1e-10 / (2 * 0.005), rel=4 * 0.029)


def test_a_guideway_that_gives_way_is_told_of_the_loads() -> None:
    class Soft(Wave):
        responds = True

        def __init__(self) -> None:
            Wave.__init__(self, 0.0, 10.0)
            object.__setattr__(self, "told", [])

        def advance(self, time, places, loads, step):
            self.told.append((time, places.copy(), loads.copy(), step))

    walled = Vehicle(
        "walled", (Body("car", 10.0),), reference_height=0.04, reference_gap=0.05,
        magnets=(Magnet("m", "car", force=WalledForce(), side=1, position=(2.0, 0.0, 0.0)),),
    )  # fmt: skip
    rest = equilibrium(walled, OperatingPoint(20.0, 0.04, gap=0.05))
    tracks = [Soft(), Soft()]
    simulate(walled, rest, duration=0.1, track=tracks, runs=2, sampling=0.01, step=0.01)
    time, places, loads, step = tracks[1].told[3]
    assert (time, step) == pytest.approx((0.03, 0.01)) and places == pytest.approx([2.6])
    assert loads == pytest.approx([98.0665])
    with pytest.raises(ValueError, match="one for each of 2 runs"):
        simulate(walled, rest, duration=0.1, track=tracks[0], runs=2)


def test_wrong_calls_are_refused() -> None:
    vehicle, rest = cart()
    for wrong, text in (
        ({"duration": 0.0}, "duration"),
        ({"duration": 1.0, "runs": 0}, "runs"),
        ({"duration": 1.0, "start": {"car.pitch": 1.0}}, "no state"),
        ({"duration": 1.0, "start": {"car.heave": [1.0, 2.0]}}, r"or \(1,\)"),
        ({"duration": 1.0, "signals": ["car.roll"]}, "signals"),
        ({"duration": 1.0, "limits": Limits(commands={"push": 1.0})}, "not an input"),
    ):
        with pytest.raises(ValueError, match=text):
            simulate(vehicle, rest, **wrong)
