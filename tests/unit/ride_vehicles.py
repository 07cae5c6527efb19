"""Vehicles and tracks that tests of the response to a random guideway share."""

from __future__ import annotations

import numpy as np

from maglev_ctrl.analysis.response.channels import RideChannel
from maglev_ctrl.analysis.response.requests import guideway_places
from maglev_ctrl.forces import ImageForce
from maglev_ctrl.guideway.correlation import track_inputs
from maglev_ctrl.systems.feedback import Controller
from maglev_ctrl.vehicle import Actuator, Body, OperatingPoint, Sensor, SpringDamper, linearize
from maglev_ctrl.vehicle.models import MagnetRow, Secondary, two_stage

SPEED = 138.9


def train(*, active: bool = True, rows: int = 10):
    """A car on two levitated bogies, `rows` magnets each, with its guideway inputs at `SPEED`."""
    coil = ImageForce(6e5, 1.5, 2.5e7, 0.02, 1.0)
    bogies = [
        Body(name, 13.5e3, inertia=(2e4, 8e4, 8e4), dofs=("heave", "pitch", "roll"), position=(x, 0.0, 0.0))
        for name, x in (("front", 14.0), ("rear", -14.0))
    ]
    car = Body("car", 108e3, inertia=(4e5, 2.8e7, 2.8e7), dofs=("heave", "pitch", "roll"))
    vehicle = two_stage(
        car, bogies, magnets=MagnetRow(coil, rows, length=24.0, half_gauge=1.35),
        secondary=Secondary(1.36e6, 4e4, half_spacing=1.2), reference_height=0.2,
    )  # fmt: skip
    dampers = tuple(
        SpringDamper(f"{b}_primary_{side}", b, damping=4e4, position=(1.4 * x, y, 0.0), lag=0.004)
        for b, x in (("front", 14.0), ("rear", -14.0))
        for side, y in (("left", 1.35), ("right", -1.35))
    )
    actuators = tuple(
        Actuator(f"{b}_motor", "car", to=b, position=(x, 0.0, 0.0), bandwidth=60.0, delay=0.01 if active else 0.0)
        for b, x in (("front", 14.0), ("rear", -14.0))
    )
    sensors = tuple(
        Sensor(f"{b}_speed", "velocity", body="car", position=(x, 0.0, 0.0))
        for b, x in (("front", 14.0), ("rear", -14.0))
    )
    vehicle = vehicle.with_elements(connections=dampers, actuators=actuators, sensors=sensors)
    system = linearize(vehicle, OperatingPoint(SPEED, 0.2), pade_order=2)
    law = Controller.from_matrices(
        -0.2 * np.eye(2), np.eye(2), 0.2 * 8e4 * np.eye(2), -8e4 * np.eye(2),
        measured=("front_speed", "rear_speed"), commands=("front_motor", "rear_motor"), name="skyhook",
    )  # fmt: skip
    track = track_inputs(system.guideway, guideway_places(vehicle, system.guideway), speed=SPEED)
    return system, law, track


def random_channel(seed: int, *, states: int = 16, stations: int = 5, outputs: int = 4):
    """A stable channel with static answers that cancel over a common shift, a noise, and its stations' places."""
    rng = np.random.default_rng(seed)
    A = 20.0 * rng.standard_normal((states, states))
    A -= (np.max(np.linalg.eigvals(A).real) + rng.uniform(0.3, 4.0)) * np.eye(states)
    C, E_p = rng.standard_normal((outputs, states)), rng.standard_normal((states, stations))
    still = rng.standard_normal((outputs, stations))
    still -= still.mean(axis=1, keepdims=True)
    D_v = np.zeros((outputs, stations))
    D_v[-1] = rng.standard_normal(stations)
    names = tuple(f"heave@{i}" for i in range(stations))
    channel = RideChannel(
        A, E_p, 0.1 * rng.standard_normal((states, stations)), 1e-3 * rng.standard_normal((states, 1)), C,
        C @ np.linalg.solve(A, E_p) + still, D_v, np.zeros((outputs, 1)),
        names, tuple(f"y{i}" for i in range(outputs)), ("sensor.noise",),
    )  # fmt: skip
    places = np.column_stack([rng.uniform(-12.0, 12.0, stations), rng.uniform(-1.5, 1.5, stations)])
    return channel, places
