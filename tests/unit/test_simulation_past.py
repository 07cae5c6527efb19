"""Delayed commands and unrecorded forces of the simulation against closed forms, the force models and each other."""

from __future__ import annotations

import numpy as np
import pytest
from simulation_vehicles import COIL, WalledForce, cart

from maglev_ctrl.analysis.simulation.evaluation import answering
from maglev_ctrl.analysis.simulation.past import Past
from maglev_ctrl.analysis.simulation.run import simulate
from maglev_ctrl.forces import ImageForce
from maglev_ctrl.systems import Controller
from maglev_ctrl.vehicle import Actuator, Sensor

ROUNDING = 1e-14


@pytest.mark.parametrize(
    ("force", "kinetic"),
    [(COIL, True), (COIL, False), (ImageForce(1e5, 1.0, 2.5e7, 0.02, 0.3), False), (WalledForce(), True)],
)
def test_forces_without_records_are_those_of_the_model(force, kinetic: bool) -> None:
    random = np.random.default_rng(0)
    height, gap, speed = (random.uniform(*span, (4, 3)) for span in ((0.02, 0.3), (0.02, 0.1), (2.0, 150.0)))
    rise, widening = random.standard_normal((2, 4, 3))
    lift, guidance, drag, moving = answering(force, kinetic=kinetic)(height, gap, speed, rise, widening)
    one, slopes = force.forces(height, gap, speed), force.derivatives(height, gap, speed)
    share = float(kinetic)
    by_rise, by_gap = slopes.by_vertical_velocity, slopes.by_lateral_velocity
    for got, name in ((lift, "lift"), (guidance if guidance is not None else np.zeros_like(lift), "guidance")):
        still = getattr(one, name)
        expected = still + share * (getattr(by_rise, name) * rise + getattr(by_gap, name) * widening)
        assert np.max(np.abs(got - expected)) <= ROUNDING * np.max(np.abs(one.lift))
    expected = one.drag + share * (by_rise.drag * rise + by_gap.drag * widening)
    assert np.max(np.abs(moving - expected)) < ROUNDING * np.max(one.drag)
    assert np.max(np.abs(drag - one.drag)) < ROUNDING * np.max(one.drag)
    # Mutant: a rate of the wrong sign is seen.
    if kinetic:
        mirrored = answering(force, kinetic=True)(height, gap, speed, -rise, -widening)[0]
        assert np.max(np.abs(mirrored - lift)) > 1e-6 * np.max(np.abs(lift))
    at_rest = force.forces(0.1, 0.05, 0.0) if isinstance(force, ImageForce) else None
    if at_rest is not None:
        place = np.array([0.1]), np.array([0.05]), np.zeros(1), np.zeros(1), np.zeros(1)
        assert answering(force, kinetic=kinetic)(*place)[2] == at_rest.drag


@pytest.mark.parametrize("lag", [1.0, 1.3, 2.0, 3.75])
def test_cubics_are_exact_and_the_first_command_keeps_its_impulse(lag: float) -> None:
    step, runs = 0.01, 2
    past = Past(np.array([lag * step, 5.0 * step]), step=step, runs=runs)

    def cubic(time: float) -> np.ndarray:
        return np.array([[1.0 + time, 2.0], [3.0 - 40.0 * time**2 + 900.0 * time**3, time]])

    integral, moment = np.zeros((runs, 2)), np.zeros((runs, 2))
    first = int(np.floor(lag))
    for node in range(12):
        past.put(node, cubic(node * step))
        values = [past.at(node, half) for half in (0, 1, 2)]
        if node == first:
            integral = (values[0] + 4.0 * values[1] + values[2])[:, 0] / 6.0
            moment = (values[0] + 2.0 * values[1])[:, 0] / 6.0
        if node < first:
            assert not np.any(np.array(values)[:, :, 0])
        if node >= 4 + int(np.ceil(lag)):
            for half, value in enumerate(values):
                exact = cubic((node + 0.5 * half - lag) * step)[:, 0]
                assert np.max(np.abs(value[:, 0] - exact)) < 1e-12
                late = cubic((node + 0.5 * half - lag + 1.0) * step)[:, 0]
                assert np.max(np.abs(value[:, 0] - late)) > 1e-4
    share = 1.0 - (lag - first)
    # What arrives within the step of the jump: nearly the first command, for the rest of the step.
    assert np.max(np.abs(integral - cubic(0.0)[:, 0] * share)) < 0.01
    assert np.max(np.abs(moment - cubic(0.0)[:, 0] * share**2 / 2.0)) < 0.01
    with pytest.raises(ValueError, match="at most the shortest delay"):
        Past(np.array([0.9 * step]), step=step, runs=1)


@pytest.mark.parametrize("lag", [1.0, 2.6])
def test_held_noise_bends_and_jumps_where_it_does(lag: float) -> None:
    # A command that is the noise itself and its integral: held over two steps, its straight pieces must come back.
    step, random = 0.01, np.random.default_rng(1)
    held = np.repeat(random.standard_normal(10), 2)
    ramp = np.concatenate([[0.0], np.cumsum(step * held)])
    past, blind = (Past(np.array([lag * step]), step=step, runs=1) for _ in range(2))
    for node in range(18):
        command = np.array([[ramp[node]]])
        past.put(node, command, (np.zeros((1, 1)), np.array([[held[node]]])))
        blind.put(node, command)
        place = node + 0.5 - lag
        if place > 4:
            exact = np.interp(place, np.arange(21), ramp)
            assert abs(past.at(node, 1)[0, 0] - exact) < 1e-14
    assert abs(blind.at(17, 1)[0, 0] - exact) > 1e-5  # mutant: cubics across the bends
    direct = Past(np.array([lag * step]), step=step, runs=1)
    for node in range(18):
        direct.put(node, np.array([[held[node]]]), (np.array([[held[node]]]), np.zeros((1, 1))))
        values = [float(direct.at(node, half)[0, 0]) for half in (0, 1, 2)]
        if node > 4:
            times = node - lag + (np.arange(2000) + 0.5) / 2000
            exact = held[np.floor(times + 1e-9).astype(int)]
            assert (values[0] + 4.0 * values[1] + values[2]) / 6.0 == pytest.approx(np.mean(exact), abs=1e-3)


def test_steps_as_long_as_the_delay_converge_from_a_start_and_with_noise() -> None:
    # At least the third order (a wrong impulse of the first command would be of the first).
    sensor = Sensor("seen", "velocity", body="car", noise=1e-3)
    elements = {"sensors": (sensor,), "actuators": (Actuator("push", "car", delay=0.013),)}
    vehicle, rest = cart(damping=20.0, elements=elements)
    law = Controller.from_matrices([[-40.0]], [[1.0]], [[-1500.0]], [[0.0]], measured=("seen",), commands=("push",))

    def moved(step: float, noise: bool) -> np.ndarray:
        found = simulate(
            vehicle, rest, controller=law, duration=0.6, start={"car.heave": 0.01, "car.heave.velocity": 0.1},
            step=step, sampling=0.02, noise=noise,
        )  # fmt: skip
        return found.of("car.heave")[0]

    for noise in (False, True):
        exact = moved(0.000625, noise)
        errors = [float(np.max(np.abs(moved(step, noise) - exact))) for step in (0.01, 0.005, 0.0025)]
        assert errors[0] < 5e-3 * np.max(np.abs(exact))
        assert errors[1] < errors[0] / 5.0 and errors[2] < errors[1] / 5.0
