"""Passive elements as feedback: the closed loop is the vehicle they came from."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from maglev_ctrl.forces import ImageForce
from maglev_ctrl.systems import close_loop
from maglev_ctrl.vehicle import Body, OperatingPoint, SpringDamper, Vehicle, as_feedback, equilibrium, linearize
from maglev_ctrl.vehicle.models import MagnetRow, Secondary, two_stage

AT = OperatingPoint(100.0, 0.2)


def train() -> Vehicle:
    coil = ImageForce(6e5, 1.5, 2.5e7, 0.02, 1.0, "receding_image")
    car = Body("car", 108e3, inertia=(2e5, 2.8e7, 2.8e7), dofs=("heave", "roll", "pitch"), position=(0.0, 0.0, 0.9))
    bogies = [
        Body("front", 13.5e3, inertia=(2e4, 5e4, 5e4), dofs=("heave", "roll"), position=(14.0, 0.0, 0.0)),
        Body("rear", 13.5e3, inertia=(2e4, 5e4, 5e4), dofs=("heave", "roll"), position=(-14.0, 0.0, 0.0)),
    ]
    vehicle = two_stage(
        car, bogies, magnets=MagnetRow(coil, 6, length=12.0, half_gauge=1.35),
        secondary=Secondary(1.36e6, 3e4, half_spacing=1.0), reference_height=0.2,
    )  # fmt: skip
    return vehicle.with_elements(
        connections=(
            SpringDamper("winding_front", "front", position=(14.0, 0.0, 0.0), damping=1.2e5, stiffness=1e4, lag=0.03),
            SpringDamper("winding_rear", "rear", position=(-14.0, 0.0, 0.0), damping=1.2e5, lag=0.03),
            SpringDamper("bar", "car", to="front", direction=(1.0, 0.0, 0.0), stiffness=1e6, damping=1e3, angular=True),
        )
    )


def sorted_poles(A: np.ndarray) -> np.ndarray:
    return np.sort_complex(np.round(np.linalg.eigvals(A), 9))


@pytest.mark.parametrize("hold", ["height", "strength"])
@pytest.mark.parametrize(
    "names",
    [("winding_front", "winding_rear"), ("bar",), ("secondary_front_left", "secondary_front_right", "winding_rear")],
)
def test_closing_the_passive_loop_gives_the_vehicle_back(names, hold) -> None:
    vehicle = train()
    bare, law = as_feedback(vehicle, names)
    assert law.commands == names
    closed = close_loop(linearize(bare, equilibrium(bare, AT, hold=hold)), law)
    original = linearize(vehicle, equilibrium(vehicle, AT, hold=hold))
    wanted = sorted_poles(original.state_matrix())
    np.testing.assert_allclose(sorted_poles(closed.state_matrix()), wanted, rtol=1e-6, atol=1e-6)
    # Mutant: the law with its sign turned, and the vehicle without the elements, are other systems.
    flipped = replace(law, C=-law.C, D=-law.D)
    mutant = close_loop(linearize(bare, equilibrium(bare, AT, hold=hold)), flipped)
    assert np.max(np.abs(sorted_poles(mutant.state_matrix()) - wanted)) > 1e-2


def test_outputs_of_the_guideway_survive_the_exchange() -> None:
    vehicle = train()
    bare, law = as_feedback(vehicle, ["winding_front"])
    closed, original = close_loop(linearize(bare, AT), law), linearize(vehicle, AT)
    heave = "heave@winding_front"
    one, two = closed.guideway.index(heave), original.guideway.index(heave)
    s = 3.0j

    def transfer(system, column):
        A, E = system.state_matrix(), system.guideway_matrix()
        drive = E[:, column] + s * E[:, len(system.guideway) + column]
        x = np.linalg.solve(s * np.eye(len(A)) - A, drive)
        return x[system.states.index("car.heave")]

    assert transfer(closed, one) == pytest.approx(transfer(original, two), rel=1e-9)


def test_an_unknown_connection_is_named() -> None:
    with pytest.raises(ValueError, match="did you mean 'winding_front'"):
        as_feedback(train(), ["winding_frnt"])
