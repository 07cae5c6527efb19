"""Elements and vehicles: what they accept, and how they refuse the rest."""

from __future__ import annotations

import numpy as np
import pytest

from maglev_ctrl.forces import ImageForce
from maglev_ctrl.vehicle import (
    GUIDEWAY,
    Actuator,
    Aerodynamics,
    Body,
    Magnet,
    OperatingPoint,
    Sensor,
    SpringDamper,
    Vehicle,
    linearize,
)
from maglev_ctrl.vehicle.kinematics import rotation_matrix
from maglev_ctrl.vehicle.models import MagnetRow, Secondary, double_l_geometry, two_stage

COIL = ImageForce(6e5, 1.5, 2.5e7, 0.02, 1.0)


def test_body_takes_principal_moments_or_a_matrix() -> None:
    assert Body("car", 1.0, inertia=(1.0, 2.0, 3.0)).inertia_matrix[1, 1] == 2.0
    with pytest.raises(ValueError, match="symmetric"):
        Body("car", 1.0, inertia=[[1.0, 2.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Body("car", -1.0), "body car: mass: expected a positive number, got -1.0"),
        (lambda: Body("car", 1.0, dofs=("heave", "heave")), "expected distinct names"),
        (lambda: Body("car", 1.0, dofs=("bounce",)), "expected distinct names out of surge"),
        (lambda: Body(GUIDEWAY, 1.0), "expected a name other than"),
        (lambda: Magnet("m", "car", force=COIL, side=2), "side: expected -1, 0 or 1"),
        (lambda: Magnet("m", "car", force=COIL, count=0.0), "count: expected a positive"),
        (lambda: SpringDamper("s", "car", to="car"), "expected another body"),
        (lambda: SpringDamper("s", "car", direction=(0.0, 1.0, 1.0)), "expected a unit vector"),
        (lambda: SpringDamper("s", "car", lag=-1.0), "not negative"),
        (lambda: Actuator("a", "car", bandwidth=0.0), "bandwidth: expected a positive"),
        (lambda: Actuator("a", "car", delay=float("nan")), "delay"),
        (lambda: Sensor("s", "stroke", body="car"), "measures to another body, got None"),
        (lambda: Sensor("s", "velocity", body="car", to="bogie"), "measures to nothing"),
        (lambda: Sensor("s", "gap", body="car", to="bogie"), "measures to the guideway"),
        (lambda: Sensor("s", "speed", body="car"), "expected gap, stroke, velocity, acceleration or current"),
        (lambda: Aerodynamics("car", -1.0), "not negative"),
        (lambda: MagnetRow(COIL, 3, length=1.0), "expected an even number"),
        (lambda: double_l_geometry(0.12), "between 0 and 0.1016 m"),
    ],
)
def test_wrong_elements_are_refused(make, message) -> None:
    with pytest.raises(ValueError, match=message):
        make()


def vehicle(**extra) -> Vehicle:
    return Vehicle("cart", (Body("car", 1.0), Body("bogie_1", 1.0)), reference_height=0.1, **extra)


@pytest.mark.parametrize(
    ("extra", "message"),
    [
        ({"connections": (SpringDamper("s", "car", to="bogie1"),)}, "did you mean 'bogie_1'"),
        ({"connections": (SpringDamper("s", "car", to="guidway"),)}, "did you mean 'guideway'"),
        ({"sensors": (Sensor("s", "gap", body="zzz"),)}, "the bodies are car, bogie_1"),
        ({"connections": (SpringDamper("car", "bogie_1"),)}, "name used twice: car"),
        ({"magnets": (Magnet("m", "car", force=COIL, side=1),)}, "reference_gap: expected a gap because m"),
        ({"kinematics": "papers"}, "kinematics: expected"),
        ({"thrust_positions": (("cart", (0.0, 0.0, 0.0)),)}, "thrust_positions: there is no body 'cart'"),
    ],
)
def test_wrong_vehicles_are_refused(extra, message) -> None:
    with pytest.raises(ValueError, match=message):
        vehicle(**extra)


def test_with_elements_grows_a_copy() -> None:
    bare = vehicle()
    grown = bare.with_elements(sensors=(Sensor("gap", "gap", body="car"),), actuators=(Actuator("push", "car"),))
    assert (len(bare.sensors), len(grown.sensors), len(grown.actuators)) == (0, 1, 1)
    assert bare.dofs == ("car.heave", "bogie_1.heave")


def test_rotation_matrix_is_a_rotation() -> None:
    for vector in ([0.3, -0.2, 0.5], [1e-9, 0.0, 0.0], [0.0, 0.0, 3.0]):
        R = rotation_matrix(np.array(vector))
        np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-14)
        assert np.linalg.det(R) == pytest.approx(1.0)
        np.testing.assert_allclose(R @ vector, vector, atol=1e-14)


def test_magnets_merge_where_the_side_makes_no_difference() -> None:
    row = MagnetRow(COIL, 10, length=24.0, half_gauge=1.35)
    plain = row.place(Body("front", 1.0, position=(14.0, 0.0, 0.0)), name="front_magnet")
    assert [m.name for m in plain][:2] == ["front_magnet_1", "front_magnet_2"]
    np.testing.assert_allclose([m.position[0] - 14.0 for m in plain], [9.6, 4.8, 0.0, -4.8, -9.6], atol=1e-12)
    assert {m.count for m in plain} == {2.0}
    rolling = row.place(Body("front", 1.0, dofs=("heave", "roll"), position=(14.0, 0.0, 0.0)))
    assert [m.name for m in rolling][:2] == ["magnet_1_left", "magnet_1_right"]
    assert rolling[0].position[1] == 1.35
    assert rolling[0].side == 0
    walls = MagnetRow(COIL, 2, length=1.0, half_gauge=1.0, guidance=True).place(Body("front", 1.0))
    assert [m.side for m in walls] == [1, -1]


def test_merged_and_split_magnets_are_the_same_vehicle() -> None:
    bogies = [Body("front", 13.5e3, position=(14.0, 0.0, 0.0)), Body("rear", 13.5e3, position=(-14.0, 0.0, 0.0))]
    turning = [
        Body(b.name, b.mass, inertia=(3e4, 0.0, 0.0), dofs=("heave", "roll"), position=b.position) for b in bogies
    ]
    car = Body("car", 108e3, inertia=(0.0, 2.8e7, 0.0), dofs=("heave", "pitch"))
    at = OperatingPoint(100.0, 0.2)
    systems = [
        linearize(
            two_stage(car, group, magnets=MagnetRow(COIL, 10, length=24.0, half_gauge=1.35),
                      secondary=Secondary(1.36e6, 2e4), reference_height=0.2), at)
        for group in (bogies, turning)
    ]  # fmt: skip
    kept = [systems[1].dofs.index(name) for name in systems[0].dofs]
    np.testing.assert_allclose(systems[1].K[np.ix_(kept, kept)], systems[0].K, rtol=1e-12)
    np.testing.assert_allclose(systems[1].C[np.ix_(kept, kept)], systems[0].C, rtol=1e-12)


def test_two_stage_heave_matrices() -> None:
    """Two springs in a row per bogie: the textbook matrices."""
    bogies = [Body("front", 13.5e3, position=(14.0, 0.0, 0.0)), Body("rear", 13.5e3, position=(-14.0, 0.0, 0.0))]
    car = Body("car", 108e3, inertia=(0.0, 2.8e7, 0.0), dofs=("heave", "pitch"))
    train = two_stage(car, bogies, magnets=MagnetRow(COIL, 10, length=24.0), secondary=Secondary(1.36e6, 2e4),
                      reference_height=0.2)  # fmt: skip
    system = linearize(train, OperatingPoint(100.0, 0.2))
    k, primary, x = 1.36e6, 135e3 * 9.80665 / 0.2 / 2, 14.0
    # Nose-down pitch lowers the front: stroke of the front spring is z - x theta - z_front.
    expected = np.array([
        [2 * k, 0, -k, -k], [0, 2 * k * x**2, k * x, -k * x], [-k, k * x, k + primary, 0], [-k, -k * x, 0, k + primary],
    ])  # fmt: skip
    np.testing.assert_allclose(system.K, expected, rtol=1e-12, atol=1e-6)
    assert not np.allclose(system.K, expected * np.array([1, -1, 1, 1]))
    np.testing.assert_allclose(system.C[0], [4e4, 0, -2e4, -2e4], atol=1e-9)
