"""Electromagnets in scenario files: what is built, what a law may command, what is refused and where."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from maglev_ctrl.scenario import build_option, build_vehicle, control_law, load
from maglev_ctrl.scenario.layout import command_dimensions
from maglev_ctrl.scenario.problems import ScenarioProblems
from maglev_ctrl.scenario.scenario_schema import Scenario
from maglev_ctrl.scenario.units import dimensions_of
from maglev_ctrl.synthesis.laws import design_lqr
from maglev_ctrl.synthesis.weights import InputWeight, OutputWeight
from maglev_ctrl.systems import close_loop
from maglev_ctrl.vehicle import OperatingPoint, equilibrium, linearize, magnet_circuits

SHIPPED = Path(__file__).parents[2] / "scenarios" / "design" / "ems_hover.toml"

SMALL = """
format = 1
title = "Hover"
[vehicle]
model = "six_dof"
freedom = ["heave", "pitch"]
[vehicle.car]
mass = "4 t"
pitch_inertia = "6e3 kg*m^2"
[vehicle.magnets]
count = 4
length = "6 m"
[forces]
model = "electromagnet"
turns = 300
pole_area = "0.03 m^2"
resistance = "1 ohm"
[operating]
speed = "10 m/s"
height = "10 mm"
[[option]]
name = "bare"
kind = "baseline"
[[option]]
name = "hold"
kind = "active_primary"
[option.control]
law = "lqr"
allowed = [{ output = "magnet_gap", value = "2 mm" }, { actuator = "magnet", value = "50 V" }]
"""

BOGIES = """
format = 1
title = "Bogies"
[vehicle]
model = "two_stage"
freedom = ["heave", "pitch"]
[vehicle.car]
mass = "20 t"
pitch_inertia = "4e5 kg*m^2"
[[vehicle.bogie]]
name = "front"
mass = "4 t"
position = "6 m"
freedom = ["heave"]
[[vehicle.bogie]]
name = "rear"
mass = "4 t"
position = "-6 m"
freedom = ["heave"]
[vehicle.secondary]
stiffness = "0.5 MN/m"
damping = "40 kN*s/m"
[vehicle.magnets]
count = 2
length = "4 m"
[forces]
model = "electromagnet"
turns = 300
pole_area = "0.1 m^2"
resistance = "1 ohm"
count = 2
[operating]
speed = "10 m/s"
height = "10 mm"
[[option]]
name = "hold"
kind = "active_primary"
[option.control]
law = "lqr"
allowed = [{ output = "magnet_gap", value = "2 mm" }, { actuator = "front_magnet", value = "50 V" },
           { actuator = "rear_magnet", value = "40 V" }]
"""

HEAVE = SMALL.replace('model = "six_dof"\nfreedom = ["heave", "pitch"]', 'model = "heave_surge"')
HEAVE = HEAVE.replace('pitch_inertia = "6e3 kg*m^2"\n[vehicle.magnets]\ncount = 4\nlength = "6 m"\n', "")
# Drag on the way, or nothing would hold the speed.
HEAVE = HEAVE.replace("[forces]", '[vehicle.aerodynamics]\ndrag = "10 kN"\ndrag_speed = "10 m/s"\n[forces]')
HEAVE = HEAVE.replace("magnet_gap", "magnet.gap")
PERIODIC = """
[periodic]
wavelength = "25 m"
depth = 0.05
map = { speed = { from = "5 m/s", to = "15 m/s", count = 3 }, depth = { from = 0.0, to = 0.1, count = 3 } }
"""


def read(tmp_path: Path, text: str) -> Scenario:
    path = tmp_path / "hover.toml"
    path.write_text(text, encoding="utf-8")
    return load(path)


def refused(tmp_path: Path, text: str, *old_new: tuple[str, str]) -> str:
    for old, new in old_new:
        assert old in text
        text = text.replace(old, new)
    with pytest.raises(ScenarioProblems) as caught:
        read(tmp_path, text)
    (problem,) = caught.value.problems
    assert problem.line > 0
    return f"{problem.key}: {problem.message}"


def test_the_magnets_lift_the_weight_at_their_gap(tmp_path: Path) -> None:
    vehicle = build_vehicle(read(tmp_path, SMALL))
    state = equilibrium(vehicle, OperatingPoint(10.0, 0.010))
    assert state.strength == pytest.approx(1.0, rel=1e-12) and float(np.abs(state.unbalanced).max()) < 1e-6
    system = linearize(vehicle, state)
    assert system.inputs == ("magnet_1.voltage", "magnet_2.voltage")
    assert system.internal == ("magnet_1.current", "magnet_2.current")
    assert sum(np.linalg.eigvals(system.state_matrix()).real > 1e-6) == 2


def test_held_currents_diverge_with_gravity_over_gap(tmp_path: Path) -> None:
    text = SMALL.replace('resistance = "1 ohm"', 'resistance = "1 ohm"\ndrive = "current"').replace('"50 V"', '"5 A"')
    system = linearize(build_vehicle(read(tmp_path, text)), OperatingPoint(10.0, 0.010))
    assert system.inputs == ("magnet_1.current", "magnet_2.current") and system.internal == ()
    growth = np.sort(np.linalg.eigvals(system.state_matrix()).real)[::-1]
    # Heave: sqrt(2 g / gap); pitch: the same times arm over radius of gyration, 1.5 m / sqrt(1.5 m^2).
    heave = np.sqrt(2.0 * 9.80665 / 0.010)
    np.testing.assert_allclose(growth[:2], [heave * 1.5 / np.sqrt(1.5), heave], rtol=1e-9)


def test_several_magnets_in_one_place_share_the_weight(tmp_path: Path) -> None:
    vehicle = build_vehicle(read(tmp_path, SMALL.replace("turns = 300", "turns = 300\ncount = 3")))
    assert [magnet.count for magnet in vehicle.magnets] == [6.0, 6.0]
    found = magnet_circuits(vehicle, equilibrium(vehicle, OperatingPoint(10.0, 0.010)))
    assert 12.0 * found["magnet_1"].force == pytest.approx(4e3 * 9.80665, rel=1e-12)


def test_names_a_law_may_command(tmp_path: Path) -> None:
    volt = dimensions_of("V")
    found = command_dimensions(read(tmp_path, SMALL))
    assert found == {
        "magnet": (volt, ("magnet_1.voltage", "magnet_2.voltage")),
        "magnet_1": (volt, ("magnet_1.voltage",)),
        "magnet_2": (volt, ("magnet_2.voltage",)),
    }
    scenario = read(tmp_path, BOGIES)
    found = command_dimensions(scenario)
    assert set(found) == {"magnet", "front_magnet", "rear_magnet", "front_magnet_1", "rear_magnet_1"}
    assert found["rear_magnet"] == (volt, ("rear_magnet_1.voltage",))
    inputs = linearize(build_vehicle(scenario), OperatingPoint(10.0, 0.010)).inputs
    assert found["magnet"][1] == inputs
    assert command_dimensions(load(SHIPPED.parents[1] / "compare" / "warwick_30t.toml")) == {}


@pytest.mark.parametrize("text", [SMALL, BOGIES, HEAVE])
def test_a_law_on_the_voltages_holds_the_vehicle(tmp_path: Path, text: str) -> None:
    scenario = read(tmp_path, text)
    law = control_law(scenario, scenario.options[-1])
    assert law is not None
    plant = linearize(build_vehicle(scenario), OperatingPoint(10.0, 0.010))
    assert np.max(np.linalg.eigvals(plant.state_matrix()).real) > 10.0
    design = design_lqr(
        plant,
        [OutputWeight(name, allowed) for name, allowed in law.output_weights],
        [InputWeight(name, allowed) for name, allowed in law.input_weights],
        name="hold",
    )
    closed = np.linalg.eigvals(close_loop(plant, design.controller).state_matrix()).real
    assert np.max(closed) < -0.4


def test_gap_sensors_read_the_gap_under_the_rail(tmp_path: Path) -> None:
    sensors = '\n[[option.sensor]]\nname = "amps"\nkind = "current"\non = "car"\n'
    sensors += '[[option.sensor]]\nname = "nose"\nkind = "gap"\non = "car"\nat = "1.5 m"\n'
    scenario = read(tmp_path, SMALL.replace("[option.control]", sensors + "[option.control]"))
    vehicle = build_option(scenario, scenario.options[1], build_vehicle(scenario))
    system = linearize(vehicle, OperatingPoint(10.0, 0.010))
    C, _, _ = system.output_rows(("nose", "magnet_1.gap", "amps_magnet_2", "magnet_2.current"))
    np.testing.assert_allclose(C[0], C[1])
    np.testing.assert_allclose(C[2], C[3])
    heave = system.states.index("car.heave")
    assert C[0, heave] == -1.0


def test_the_facts_tell_current_heat_and_stiffness(tmp_path: Path) -> None:
    from maglev_ctrl.study.forces import describe_forces

    scenario = read(tmp_path, SMALL)
    facts = " ".join(describe_forces(scenario, build_vehicle(scenario)))
    assert "each of 4 windings carries" in facts and "stiffness -1.961 MN/m per winding" in facts


def test_the_shipped_scenario_is_what_it_says() -> None:
    scenario = load(SHIPPED)
    vehicle = build_vehicle(scenario)
    point = OperatingPoint(scenario.operating.speed, scenario.operating.height)
    found = magnet_circuits(vehicle, equilibrium(vehicle, point))
    power = sum(magnet.count * found[magnet.name].power for magnet in vehicle.magnets)
    assert sum(magnet.count for magnet in vehicle.magnets) == 16
    assert 1.0 < power / 53e3 < 2.0  # W per kg; the source has 2 with its converters
    growth = np.max(np.linalg.eigvals(linearize(vehicle, point).state_matrix()).real)
    assert 10.0 < growth < 44.3


@pytest.mark.parametrize(
    ("text", "changes", "expected"),
    [
        (SMALL, [('freedom = ["heave", "pitch"]', 'freedom = ["sway", "heave", "pitch"]')],
         'vehicle.freedom[0]: expected no "sway" on a body with electromagnets'),
        (SMALL, [('freedom = ["heave", "pitch"]\n', ""), ('mass = "4 t"', 'mass = "4 t"\nroll_inertia = "1 t*m^2"\n'
         'yaw_inertia = "1 t*m^2"')], "vehicle.freedom: missing; expected freedoms without sway and yaw"),
        (BOGIES, [('position = "-6 m"\nfreedom = ["heave"]', 'position = "-6 m"\nfreedom = ["heave", "sway"]')],
         'vehicle.bogie[1].freedom[1]: expected no "sway"'),
        (SMALL, [('speed = "10 m/s"', 'speed = "10 m/s"\ngap = "10 mm"'), ('length = "6 m"', 'length = "6 m"\n'
         "guidance = true")], "vehicle.magnets.guidance: expected false"),
        (SMALL + PERIODIC, [], "periodic: expected no periodic guideway with electromagnets"),
        (SMALL, [('"50 V"', '"50 N"')], 'allowed[1].value: expected a voltage with its unit for magnet, got a force'),
        (SMALL, [('resistance = "1 ohm"', 'resistance = "1 ohm"\ndrive = "current"')],
         "expected a current with its unit for magnet, got a voltage"),
        (SMALL, [('resistance = "1 ohm"', 'resistance = "1 V"')],
         'forces.resistance: expected a resistance with its unit, for example "4 ohm", got a voltage'),
        (SMALL, [('pole_area = "0.03 m^2"', 'pole_area = "0.03 m"')], "forces.pole_area: expected an area"),
        (SMALL, [('actuator = "magnet"', 'actuator = "magnet_3"')], 'no actuator is called "magnet_3"; did you mean'),
        (SMALL, [('kind = "active_primary"', 'kind = "baseline"')], 'a "baseline" option drives no magnet'),
        (SMALL, [('kind = "active_primary"', 'kind = "active_secondary"')], 'drives no magnet; did you mean'),
        (SMALL, [("turns = 300", 'turns = 300\nflux_limit = "0.5 T"')], "T in the gap is above the 0.5 T"),
    ],
)  # fmt: skip
def test_faults_say_where_and_what(tmp_path: Path, text: str, changes: list[tuple[str, str]], expected: str) -> None:
    assert expected in refused(tmp_path, text, *changes)


def test_faults_of_current_sensors(tmp_path: Path) -> None:
    sensor = '\n[[option.sensor]]\nname = "amps"\nkind = "current"\non = "car"\n[option.control]'
    current = ('resistance = "1 ohm"', 'resistance = "1 ohm"\ndrive = "current"')
    told = refused(tmp_path, SMALL, ("[option.control]", sensor), current, ('"50 V"', '"5 A"'))
    assert 'option[1].sensor[0].kind: expected electromagnets with drive = "voltage"' in told
    told = refused(tmp_path, SMALL, ("[option.control]", sensor.replace('on = "car"', 'on = "car"\nat = "1 m"')))
    assert "option[1].sensor[0].at: a current is measured in its magnet" in told


def test_an_actuator_may_not_take_a_magnets_name(tmp_path: Path) -> None:
    actuator = '\n[[option.actuator]]\nname = "magnet"\nbetween = ["car", "guideway"]\n[option.control]'
    assert "expected a unique name; a magnet of this option" in refused(tmp_path, SMALL, ("[option.control]", actuator))


def test_a_double_l_needs_guidance(tmp_path: Path) -> None:
    text = (SHIPPED.parents[1] / "paper" / "double_l_corner_image.toml").read_text(encoding="utf-8")
    start, end = text.index("[forces]"), text.index("[operating]")
    forces = '[forces]\nmodel = "electromagnet"\nturns = 300\npole_area = "0.1 m^2"\nresistance = "1 ohm"\n'
    with pytest.raises(ScenarioProblems, match="a double_l needs guidance forces, and electromagnets lift only"):
        read(tmp_path, text[:start] + forces + text[end:])


def test_the_loops_are_broken_at_the_windings(tmp_path: Path) -> None:
    from maglev_ctrl.study.loops import option_loops
    from maglev_ctrl.study.situation import OptionModel, Situation

    scenario = read(tmp_path, SMALL)
    law = control_law(scenario, scenario.options[1])
    assert law is not None
    outputs = [OutputWeight(*one) for one in law.output_weights]
    inputs = [InputWeight(*one) for one in law.input_weights]
    model, point = OptionModel(scenario, scenario.options[1]), Situation.of_design(scenario)
    controller = design_lqr(model.plant(point), outputs, inputs, name="hold").controller
    loops = option_loops(model, point, controller)
    assert loops is not None and loops.loop().channels == ("magnet_1.voltage", "magnet_2.voltage")
    assert not np.any(loops.delays)


def test_the_report_tells_what_the_windings_carry(tmp_path: Path) -> None:
    from types import SimpleNamespace

    from maglev_ctrl.report.content_option import _equilibrium_table

    scenario = read(tmp_path, SMALL)
    vehicle = build_vehicle(scenario)
    state = equilibrium(vehicle, OperatingPoint(10.0, 0.010))
    table = _equilibrium_table(SimpleNamespace(equilibrium=state, label="hover", vehicle=vehicle))  # type: ignore[arg-type]
    told = {str(cells[0].text): str(cells[1].text) for cells in table.rows}
    one = magnet_circuits(vehicle, state)["magnet_1"]
    assert told["Standing currents of the windings"] == f"{one.current:.1f} A"
    assert told["Heat in all windings"] == f"{4e-3 * one.power:.2f} kW"
