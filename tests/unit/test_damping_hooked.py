"""Hooked damping laws: closed matrices by hand, filters by their transfer functions, sensors by where they sit."""

import numpy as np
import pytest

from maglev_ctrl.errors import ModelError
from maglev_ctrl.synthesis.damping.hooked import HookedDamper, Opposed, design_hooked, hooked_controller, signal_of
from maglev_ctrl.synthesis.damping.sensors import hooked_damper
from maglev_ctrl.systems import SecondOrderSystem, close_loop
from maglev_ctrl.vehicle import Actuator, Body, OperatingPoint, Sensor, SpringDamper, Vehicle, linearize

ZERO = np.zeros((2, 2))
K = np.array([[8e3, -8e3], [-8e3, 9.8e4]])


def _quarter_car():
    return SecondOrderSystem.from_matrices(
        np.diag([300.0, 50.0]), ZERO, K, dofs=("car", "bogie"), inputs=("leg",), B=[[1.0], [-1.0]],
        guideway=("track",), K_w=[[0.0], [9e4]],
        outputs=("gap", "stroke", "a", "mixed"),
        H_q=[[0.0, 1.0], [1.0, -1.0], [0.0, 0.0], [1.0, 0.0]], H_v=[[0.0, 0.0]] * 3 + [[1.0, 0.0]],
        H_a=[[0.0, 0.0], [0.0, 0.0], [1.0, 0.0], [0.0, 0.0]], H_w=[[-1.0], [0.0], [0.0], [0.0]],
    )  # fmt: skip


@pytest.mark.parametrize(
    ("terms", "expected"),
    [
        ((Opposed("car.velocity"),), [[1.0, 0.0], [-1.0, 0.0]]),  # sky-hook
        ((Opposed("bogie.velocity", -1.0),), [[0.0, -1.0], [0.0, 1.0]]),  # ground-hook: bogie damped to the inertial
        ((Opposed("car.velocity"), Opposed("bogie.velocity", -1.0)), [[1.0, -1.0], [-1.0, 1.0]]),  # relative
        ((Opposed("car.velocity", 0.7), Opposed("bogie.velocity", -0.3)), [[0.7, -0.3], [-0.7, 0.3]]),  # hybrid
    ],
)
def test_closed_damping_matrix_of_each_law(terms, expected):
    plant = _quarter_car()
    closed = close_loop(plant, hooked_controller(plant, [HookedDamper("leg", terms, 900.0)]))
    assert np.allclose(closed.C, 900.0 * np.array(expected))


def test_ground_hook_with_the_sign_turned_feeds_the_bogie():
    plant = _quarter_car()
    right = design_hooked(plant, [HookedDamper("leg", (Opposed("bogie.velocity", -1.0),), 50.0)])
    wrong = design_hooked(plant, [HookedDamper("leg", (Opposed("bogie.velocity", 1.0),), 50.0)])
    assert wrong.certificate.spectral_abscissa > 0.0
    assert right.certificate.spectral_abscissa < wrong.certificate.spectral_abscissa


def test_dampers_of_one_actuator_add_up():
    plant = _quarter_car()
    both = hooked_controller(
        plant,
        [
            HookedDamper("leg", (Opposed("car.velocity"),), 700.0),
            HookedDamper("leg", (Opposed("bogie.velocity", -1.0),), 300.0),
        ],
    )
    assert both.commands == ("leg",)
    assert np.allclose(both.D, [[-700.0, 300.0]])


def test_ground_hook_alone_pushes_the_car():
    """The actuator's other end is the car: damping the bogie alone drives the car's mode, a hybrid does not."""
    plant = _quarter_car()

    def abscissa(share):
        terms = (Opposed("car.velocity", share), Opposed("bogie.velocity", share - 1.0))
        return design_hooked(plant, [HookedDamper("leg", terms, 500.0)]).certificate.spectral_abscissa

    assert abscissa(0.0) > 0.0 > abscissa(0.5)


def test_a_stroke_is_differentiated_and_an_acceleration_integrated():
    plant = _quarter_car()
    law = hooked_controller(
        plant, [HookedDamper("leg", (Opposed("stroke"), Opposed("a", 0.5)), 10.0)],
        integrator_corner=0.2, differentiator_corner=900.0,
    )  # fmt: skip
    for s in (3.0j, 40.0j, 2000.0j):
        gain = law.D + law.C @ np.linalg.solve(s * np.eye(3) - law.A, law.B)
        assert np.allclose(gain, [[-10.0 * s * 900.0 / (s + 900.0), -5.0 * s / (s + 0.2) ** 2]], rtol=1e-12)


def test_gap_rate_damping_approaches_a_damper_to_the_guideway():
    plant = _quarter_car()
    ideal = np.linalg.eigvals(
        close_loop(plant, hooked_controller(plant, [HookedDamper("leg", (Opposed("bogie.velocity", -1.0),), 400.0)]))
        .state_matrix()
    )  # fmt: skip
    law = hooked_controller(plant, [HookedDamper("leg", (Opposed("gap", -1.0),), 400.0)], differentiator_corner=1e5)
    filtered = np.linalg.eigvals(close_loop(plant, law).state_matrix())
    for pole in ideal:
        assert np.min(np.abs(filtered - pole)) < 1e-2 * abs(pole)


def test_signals_are_told_by_their_rows():
    plant = _quarter_car()
    told = [signal_of(plant, x) for x in ("gap", "stroke", "a", "car", "car.velocity")]
    assert told == ["position", "position", "acceleration", "position", "velocity"]
    with pytest.raises(ValueError, match="'mixed' is neither"):
        signal_of(plant, "mixed")


@pytest.mark.parametrize(
    ("damper", "words"),
    [
        (HookedDamper("leg", (), 1.0), "at least one measured term"),
        (HookedDamper("leg", (Opposed("car.velocity"),), -1.0), "at least 0 for 'leg'"),
        (HookedDamper("lag", (Opposed("car.velocity"),), 1.0), "did you mean 'leg'"),
        (HookedDamper("leg", (Opposed("car.velocity", np.nan),), 1.0), "weight: expected a finite"),
    ],
)
def test_refusals(damper, words):
    with pytest.raises(ValueError, match=words):
        hooked_controller(_quarter_car(), [damper])


DOWN = (0.0, 0.0, -1.0)
SENSORS = (
    Sensor("car_a", "acceleration", body="car"),
    Sensor("bogie_v", "velocity", body="bogie", direction=DOWN),
    Sensor("travel", "stroke", body="bogie", to="car"),
    Sensor("gap", "gap", body="bogie"),
)


def _vehicle(sensors=SENSORS):
    return Vehicle(
        "quarter", bodies=(Body("car", 300.0), Body("bogie", 50.0)), reference_height=0.1,
        connections=(SpringDamper("primary", "bogie", stiffness=9e4), SpringDamper("sec", "car", to="bogie",
                                                                                   stiffness=8e3)),
        actuators=(Actuator("leg", "car", to="bogie"),), sensors=sensors,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("hook", "measured", "weight"),
    [
        ("sky-hook", "car_a", 1.0),
        ("ground-hook", "bogie_v", 1.0),  # reaction end (-1), sensor upside down (-1)
        ("relative", "travel", -1.0),  # measured from the other end
        ("gap rate", "gap", -1.0),
    ],
)
def test_sensor_and_sign_follow_from_where_it_sits(hook, measured, weight):
    damper = hooked_damper(_vehicle(), hook, "leg", 500.0)
    assert (damper.terms[0].measured, damper.terms[0].weight) == (measured, weight)
    system = linearize(_vehicle(), OperatingPoint(0.0, 0.1))
    speed = 4.9 if hook in ("sky-hook", "relative") else 44.3  # the mode each law is there for

    def decay(one):
        law = hooked_controller(system, [one], integrator_corner=1e-3, differentiator_corner=1e5)
        poles = np.linalg.eigvals(close_loop(system, law).state_matrix())
        return poles[np.argmin(np.abs(poles - 1j * speed))].real

    assert decay(damper) < -0.1
    assert decay(HookedDamper("leg", (Opposed(measured, -weight),), 500.0)) > 0.1


@pytest.mark.parametrize(
    ("hook", "words"),
    [
        ("sky-hook", "sky-hook of 'leg' needs a velocity or acceleration sensor on 'car' at"),
        ("ground-hook", "needs a velocity, acceleration or gap sensor on 'bogie' at"),
        ("relative", "needs a stroke sensor between 'car' and 'bogie' at"),
        ("gap rate", "needs a gap sensor on 'car' or 'bogie' at"),
    ],
)
def test_a_missing_sensor_is_named_with_its_place(hook, words):
    elsewhere = tuple(
        Sensor(x.name, x.kind, body=x.body, to=x.to, position=(1.0, 0.0, 0.0)) for x in SENSORS
    )  # fmt: skip
    with pytest.raises(ModelError, match=words):
        hooked_damper(_vehicle(elsewhere), hook, "leg", 1.0)


def test_ground_hook_needs_an_unsprung_body():
    cart = Vehicle("cart", bodies=(Body("car", 10.0),), reference_height=0.1, actuators=(Actuator("coil", "car"),))
    with pytest.raises(ModelError, match="reacts on the guideway"):
        hooked_damper(cart, "ground-hook", "coil", 1.0)
    with pytest.raises(ValueError, match="hook: expected"):
        hooked_damper(cart, "sea-hook", "coil", 1.0)
