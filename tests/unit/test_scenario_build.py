"""From records to vehicles: the same physics by another road."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest

from maglev_ctrl.scenario import Scenario, build_option, build_vehicle, control_law, describe_option, load
from maglev_ctrl.scenario.control_schema import SkyHook
from maglev_ctrl.vehicle import OperatingPoint, Vehicle, linearize

ROOT = Path(__file__).resolve().parents[2]
G = 9.80665
IMAGE = """
[forces]
model = "image"
exponent = 1
thickness = "20 mm"
conductivity = "2.5e7 S/m"
"""
REST = """
[operating]
speed = "500 km/h"
height = "0.20 m"
[[option]]
name = "bare"
kind = "baseline"
"""


def scenario_of(folder: Path, vehicle: str, *, forces: str = IMAGE, rest: str = REST) -> Scenario:
    file = folder / "case.toml"
    file.write_text('format = 1\ntitle = "case"\n' + vehicle + forces + rest)
    return load(file)


def stiffness(vehicle: Vehicle, dof: str) -> float:
    system = linearize(vehicle, OperatingPoint(500 / 3.6, 0.20))
    i = system.dofs.index(dof)
    return float(system.K[i, i])


@pytest.fixture(scope="module")
def train() -> Scenario:
    return load(ROOT / "scenarios/compare/eds_135t.toml")


def test_heave_surge_has_the_stiffness_of_a_force_falling_with_height(tmp_path: Path) -> None:
    car = '[vehicle]\nmodel = "heave_surge"\n[vehicle.car]\nmass = "135 t"\n'
    vehicle = build_vehicle(scenario_of(tmp_path, car))
    assert vehicle.dofs == ("car.surge", "car.heave")
    assert stiffness(vehicle, "car.heave") == pytest.approx(135e3 * G / 0.20, rel=1e-9)  # Eq. 25: K = m g / z0


def test_stiffness_mutant_is_caught(tmp_path: Path) -> None:
    """A vehicle whose magnets carry twice the weight does not pass for the right one."""
    car = '[vehicle]\nmodel = "heave_surge"\n[vehicle.car]\nmass = "135 t"\n'
    vehicle = build_vehicle(scenario_of(tmp_path, car))
    lift = sum(m.count * float(m.force.forces(0.20, None, 500 / 3.6).lift) for m in vehicle.magnets)
    mutant = dataclasses.replace(
        vehicle, magnets=tuple(dataclasses.replace(m, count=2.0 * m.count) for m in vehicle.magnets)
    )
    doubled = sum(m.count * float(m.force.forces(0.20, None, 500 / 3.6).lift) for m in mutant.magnets)
    assert lift == pytest.approx(135e3 * G, rel=1e-12)
    assert doubled != pytest.approx(135e3 * G, rel=0.5)


def test_heave_pitch_surge_frequency_ratio(tmp_path: Path) -> None:
    """A long body on two end magnets: pitch over heave = sqrt(3) (Eq. 35)."""
    inertia = 135e3 * 56.0**2 / 12.0
    car = (
        '[vehicle]\nmodel = "heave_pitch_surge"\nmagnet_spacing = "56 m"\n'
        f'[vehicle.car]\nmass = "135 t"\npitch_inertia = "{inertia} kg*m^2"\n'
    )
    vehicle = build_vehicle(scenario_of(tmp_path, car))
    heave = stiffness(vehicle, "car.heave") / 135e3
    pitch = stiffness(vehicle, "car.pitch") / inertia
    assert math.sqrt(pitch / heave) == pytest.approx(math.sqrt(3.0), rel=1e-9)


def test_six_dof_spreads_its_magnets(tmp_path: Path) -> None:
    body = (
        '[vehicle]\nmodel = "six_dof"\nfreedom = ["heave", "roll", "pitch"]\n'
        '[vehicle.car]\nmass = "20 t"\nroll_inertia = "4e4 kg*m^2"\npitch_inertia = "9e5 kg*m^2"\n'
        '[vehicle.magnets]\ncount = 8\nlength = "20 m"\nhalf_gauge = "1.2 m"\n'
    )
    vehicle = build_vehicle(scenario_of(tmp_path, body))
    assert [m.position[0] for m in vehicle.magnets][::2] == [7.5, 2.5, -2.5, -7.5]
    assert {m.position[1] for m in vehicle.magnets} == {1.2, -1.2}
    heave = stiffness(vehicle, "car.heave")
    assert heave == pytest.approx(20e3 * G / 0.20, rel=1e-9)
    assert stiffness(vehicle, "car.pitch") == pytest.approx(heave * np.mean(np.square([7.5, 2.5])), rel=1e-6)


@pytest.mark.parametrize(("convention", "sign"), [("left_hand_side", 1.0), ("force_on_vehicle", -1.0)])
def test_coefficients_follow_their_convention(tmp_path: Path, convention: str, sign: float) -> None:
    zero = [[0.0] * 6 for _ in range(6)]
    k = [[1000.0 * (i == j == 2) for j in range(6)] for i in range(6)]
    forces = (
        f'[forces]\nmodel = "coefficients"\nunits = "SI"\nconvention = "{convention}"\n'
        f"mass = {zero}\ndamping = {zero}\nstiffness = {k}\n"
    )
    car = '[vehicle]\nmodel = "six_dof"\nfreedom = ["heave"]\n[vehicle.car]\nmass = "1 t"\n'
    assert stiffness(build_vehicle(scenario_of(tmp_path, car, forces=forces)), "car.heave") == sign * 1000.0


def test_payload_moves_the_mass_but_not_the_magnets(train: Scenario) -> None:
    full, empty = build_vehicle(train), build_vehicle(train, payload=0.0)
    assert full.mass == pytest.approx(135e3) and empty.mass == pytest.approx(115e3)
    lifts = [float(v.magnets[0].force.forces(0.2, None, 100.0).lift) for v in (full, empty)]
    assert lifts[0] == lifts[1]
    with pytest.raises(ValueError, match="payload"):
        build_vehicle(train, payload=-1.0)


def test_train_parts(train: Scenario) -> None:
    vehicle = build_vehicle(train)
    assert vehicle.dofs == ("car.heave", "car.pitch", "front.heave", "rear.heave")
    assert sum(m.count for m in vehicle.magnets) == 20
    assert [c.name for c in vehicle.connections] == ["secondary_front", "secondary_rear"]
    assert vehicle.aerodynamics[0].drag_factor * (500 / 3.6) ** 2 == pytest.approx(47.5e3)


def test_every_option_grows_and_linearizes_with_the_names_its_law_uses(train: Scenario) -> None:
    bare = build_vehicle(train)
    for option in train.options:
        vehicle = build_option(train, option, bare)
        system = linearize(vehicle, OperatingPoint(train.operating.speed, train.operating.height), pade_order=2)
        law = control_law(train, option)
        assert describe_option(train, option)
        if law is None:
            assert not vehicle.actuators
            continue
        assert set(law.actuators) == set(system.inputs)
        assert {name for name, _ in law.output_weights} <= set(system.outputs)
        assert set(law.sensors) <= set(system.outputs)
        if isinstance(law.record, SkyHook):
            assert len(law.placed(law.record.sensor)) == len(law.actuators)
            assert set(law.placed(law.record.sensor)) <= set(law.sensors)


def test_names_of_one_per_bogie(train: Scenario) -> None:
    option = next(o for o in train.options if o.name == "active_secondary_lqg")
    vehicle = build_option(train, option, build_vehicle(train))
    places = {a.name: (a.body, a.to, a.position[0]) for a in vehicle.actuators}
    assert places == {"cylinder_front": ("car", "front", 14.0), "cylinder_rear": ("car", "rear", -14.0)}
    sensors = {s.name: (s.kind, s.body, s.to, s.position[0]) for s in vehicle.sensors}
    assert sensors["car_acceleration_rear"] == ("acceleration", "car", None, -14.0)
    assert sensors["stroke_front"] == ("stroke", "car", "front", 14.0)


def test_an_end_called_guideway_may_come_first(train: Scenario) -> None:
    option = next(o for o in train.options if o.name == "damper_windings")
    spring = option.spring_dampers[0].model_copy(update={"between": ("guideway", "bogies")})
    turned = option.model_copy(update={"spring_dampers": (spring,)})
    bare = build_vehicle(train)
    ends = [[(c.body, c.to) for c in build_option(train, o, bare).connections] for o in (option, turned)]
    assert ends[0] == ends[1]


def test_every_output_a_weight_may_name_exists(train: Scenario) -> None:
    from maglev_ctrl.scenario.layout import layout, outputs_of

    for option in train.options:
        vehicle = build_option(train, option, build_vehicle(train))
        system = linearize(vehicle, OperatingPoint(train.operating.speed, train.operating.height))
        named = {name for _, names in outputs_of(option, layout(train.vehicle)).values() for name in names}
        assert named <= set(system.outputs)
