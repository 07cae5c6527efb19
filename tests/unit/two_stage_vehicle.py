"""A car on a bogie under control, and parameters of it that are not well known."""

from __future__ import annotations

import numpy as np

from maglev_ctrl.analysis.robustness import UncertainParameter
from maglev_ctrl.systems import Controller, SecondOrderSystem
from maglev_ctrl.vehicle import Actuator, Body, OperatingPoint, SpringDamper, Vehicle, linearize

CORNERS = ((1.0, 0.5), (-1.0, 0.5), (1.0, -0.5), (-1.0, -0.5))


def two_stages(*, car: float = 1.0, stiffness: float = 1.0, lag: float = 1.0, delay: float = 1.0) -> SecondOrderSystem:
    """A car on a bogie with lagged dampers and two actuators; the factors make another vehicle."""
    secondary = tuple(
        SpringDamper(f"s{i}", "car", to="bogie", position=(x, y, 0.0), stiffness=4e4 * stiffness, damping=900.0,
                     lag=0.01 if i % 2 else 0.0)
        for i, (x, y) in enumerate(CORNERS)
    )  # fmt: skip
    primary = tuple(
        SpringDamper(f"p{i}", "bogie", position=(x, y, 0.0), stiffness=9e4, damping=900.0)
        for i, (x, y) in enumerate(CORNERS)
    )
    actuators = tuple(
        Actuator(name, "car", to="bogie", position=place, bandwidth=bandwidth / lag, delay=0.004 * delay)
        for name, place, bandwidth in (("a1", (0.7, 0.0, 0.0), 200.0), ("a2", (-0.7, 0.2, 0.0), 300.0))
    )
    dofs = ("heave", "roll", "pitch")
    bodies = (
        Body("car", 1000.0 * car, inertia=(200.0 * car, 900.0 * car, 800.0), dofs=dofs),
        Body("bogie", 300.0, inertia=(50.0, 80.0, 80.0), dofs=dofs),
    )
    vehicle = Vehicle("two_stages", bodies, connections=secondary + primary, actuators=actuators, reference_height=0.1)
    return linearize(vehicle, OperatingPoint(0.0, 0.1))


def law() -> Controller:
    """Reads an acceleration, spring forces (which know stiffness and damping) and a rate; two states."""
    rng = np.random.default_rng(0)
    return Controller.from_matrices(
        -50.0 * np.eye(2) + rng.normal(size=(2, 2)), rng.normal(size=(2, 5)), rng.normal(size=(2, 2)),
        [[-10.0, 0.01, 0.01, -50.0, 0.01], [-10.0, 0.01, 0.01, 50.0, 0.02]],
        measured=("car.heave.acceleration", "s1.force", "s0.force", "car.pitch.velocity", "a1.force"),
        commands=("a1", "a2"),
    )  # fmt: skip


PARAMETERS = (
    UncertainParameter("mass", "mass", 0.05),
    UncertainParameter("inertia", "inertia", 0.1, ("car",)),
    UncertainParameter("payload", "payload", 0.1, ("car",)),
    UncertainParameter("springs", "stiffness", 0.05),
    UncertainParameter("dampers", "damping", 0.2, ("s0", "s1")),
    UncertainParameter("lag", "actuator_lag", 0.3),
    UncertainParameter("delay", "actuator_delay", 0.001, unit="s"),
)
