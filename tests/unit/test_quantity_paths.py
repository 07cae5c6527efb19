"""Any quantity of a scenario by name: what there is, how a value is read, and that the file is checked again."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest

from maglev_ctrl.errors import ModelError
from maglev_ctrl.scenario import Scenario, load
from maglev_ctrl.scenario.quantity_paths import (
    display_unit,
    find_quantity,
    scenario_quantities,
    with_quantity,
)
from maglev_ctrl.scenario.reader import with_values

SmallScenario = Callable[..., Scenario]
ALL = (
    "scenarios/compare/eds_135t.toml", "scenarios/paper/double_l.toml", "scenarios/paper/six_dof.toml",
    "scenarios/periodic/girder_passing.toml", *(f"scenarios/design/{name}.toml" for name in (
        "damping_budget", "lqr_primary", "mpc_stroke", "polytopic_speed",
    )),
)  # fmt: skip


def test_names_units_and_values(small_scenario: SmallScenario) -> None:
    known = {quantity.name: quantity for quantity in scenario_quantities(small_scenario())}
    assert list(known)[:4] == ["speed", "height", "lateral_offset", "payload"]
    assert (known["depth"].value, known["wavelength"].value, known["gain"].value) == (0.05, 25.0, 1.0)
    assert (known["vehicle.bogie.bogie.mass"].value, known["vehicle.bogie.bogie.mass"].unit) == (3000.0, "kg")
    damping = known["option.damper.spring_damper.damper.damping"]
    assert (damping.value, damping.unit, damping.option, damping.of_law) == (30e3, "N*s/m", 1, False)
    assert damping.label == "damping of spring damper damper in option damper"
    weight = known["option.active.control.allowed[0].value"]
    assert (weight.value, weight.unit, weight.of_law) == (0.5, "m/s^2", True)
    assert known["vehicle.magnets.count"].whole and math.isnan(known["vehicle.car.pitch_inertia"].value)
    idle = ("requirement", "format", "operating.sweep", "periodic.map", "periodic.wavelength")
    assert not [name for name in known if name.startswith(idle)]


@pytest.mark.parametrize("path", ALL)
def test_every_value_of_a_file_can_be_put_back(path: str) -> None:
    scenario = load(path)
    for quantity in scenario_quantities(scenario):
        if quantity.path and not math.isnan(quantity.value) and "[" not in quantity.name.partition("stiffness")[2]:
            changed = with_quantity(scenario, ((quantity, quantity.value),))
            again = {one.name: one for one in scenario_quantities(changed)}[quantity.name]
            assert again.value == pytest.approx(quantity.value, rel=1e-15), quantity.name


def test_a_value_goes_where_its_name_says(small_scenario: SmallScenario) -> None:
    scenario = small_scenario()
    mass = find_quantity(scenario, "vehicle.bogie.bogie.mass")
    damping = find_quantity(scenario, "option.damper.spring_damper.damper.damping")
    changed = with_quantity(scenario, ((mass, 2500.0), (damping, 1e4)))
    assert changed.vehicle.bogies[0].mass == 2500.0  # type: ignore[union-attr]
    assert changed.options[1].spring_dampers[0].damping == 1e4
    assert scenario.options[1].spring_dampers[0].damping == 30e3  # what was read stays as it is
    assert changed.hash != scenario.hash and changed.path == scenario.path
    # A quantity the file leaves out is put in.
    lateral = find_quantity(scenario, "vehicle.secondary.lateral_stiffness")
    assert with_quantity(scenario, ((lateral, 5.0),)).vehicle.secondary.lateral_stiffness == 5.0  # type: ignore[union-attr]


def test_a_damper_may_be_varied_from_nothing(small_scenario: SmallScenario) -> None:
    scenario = small_scenario()
    damping = find_quantity(scenario, "option.damper.spring_damper.damper.damping")
    assert with_quantity(scenario, ((damping, 0.0),)).options[1].spring_dampers[0].damping == 0.0
    with pytest.raises(ModelError, match=r"^option\[1\].*damping: .*damping"):
        with_quantity(scenario, ((damping, -1.0),))


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("spede", 'unknown quantity "spede"; did you mean "speed"? --list-quantities shows them all'),
        ("vehicle.car.mas", 'did you mean "vehicle.car.mass"?'),
        ("damping", "did you mean vehicle.secondary.damping or option.damper.spring_damper.damper.damping?"),
        ("gap", "gap: there is none in this scenario: no magnet faces a guidance wall"),
        ("requirement.stable.at_most", "unknown quantity"),
    ],
)
def test_unknown_names(small_scenario: SmallScenario, name: str, said: str) -> None:
    with pytest.raises(ValueError) as caught:
        find_quantity(small_scenario(), name)
    assert said in str(caught.value) and "\n" not in str(caught.value)


def test_what_of_a_law_may_be_varied() -> None:
    found = {
        quantity.name.removeprefix("option.").removeprefix(option)
        for file, option in (
            ("d_region", "region"), ("hinf_secondary", "h_infinity"), ("lqr_primary", "lqi"), ("mpc_stroke", "mpc"),
            ("polytopic_speed", "common"), ("scheduled_speed", "interpolated"), ("sky_hook", "best_gains"),
        )
        for quantity in scenario_quantities(load(f"scenarios/design/{file}.toml"))
        if quantity.of_law and quantity.name.startswith(f"option.{option}.")
    }  # fmt: skip
    parts = {name.removeprefix(".control.").partition("[")[0] for name in found}
    assert parts >= {
        "allowed", "disturbance", "decay_rate", "damping_ratio", "fastest", "guideway", "back_off", "integral",
        "corners.speed", "corners.payload", "corners.magnetic_stiffness", "order",
    }  # fmt: skip
    assert not parts & {
        "time_limit", "starts", "seed", "sampling_period", "horizon", "limit", "start", "duration", "nodes",
        "fastest_change", "cross_check", "law",
    }  # fmt: skip


@pytest.mark.parametrize(
    ("file", "name", "said"),
    [
        ("sky_hook", "option.best_gains.control.seed", "it only says how long and from where the law is searched for"),
        ("sky_hook", "option.best_gains.control.time_limit", "how long and from where the law is searched for"),
        ("lqr_primary", "option.lqr.control.sampling_period", "it changes nothing of the continuous law a map shows"),
        ("mpc_stroke", "option.mpc.control.horizon", "a map shows predictive control where no limit is active"),
        ("mpc_stroke", "option.mpc.control.limit[0].value", "a map shows predictive control where no limit is active"),
        ("hinf_secondary", "option.h2.control.back_off", "an H2 law has no gamma to back off from"),
        ("damping_budget", "option.dampers.damping_budget.choose", "a damping budget is not chosen anew along a map"),
        ("damping_budget", "option.dampers.spring_damper.primary_damper.damping", "damping_budget chooses the damping"),
        ("scheduled_speed", "option.interpolated.control.nodes[0]", "the nodes of a schedule have to rise"),
    ],
)
def test_what_changes_no_motion_is_refused_in_a_sentence(file: str, name: str, said: str) -> None:
    scenario = load(f"scenarios/design/{file}.toml")
    with pytest.raises(ValueError) as caught:
        find_quantity(scenario, name)
    assert str(caught.value).startswith(f"{name}: ") and said in str(caught.value)
    assert name not in {quantity.name for quantity in scenario_quantities(scenario)}


def test_no_gain_without_a_law() -> None:
    with pytest.raises(ValueError, match="gain: there is none in this scenario: no option has a control law"):
        find_quantity(load("scenarios/periodic/girder_passing.toml"), "gain")


def test_forces_that_take_long_are_not_varied() -> None:
    scenario = load("scenarios/paper/double_l.toml")
    with pytest.raises(ValueError, match="eddy-current forces would have to be solved anew at every value"):
        find_quantity(scenario, "forces.guideway.thickness")
    assert find_quantity(scenario, "vehicle.car.mass").value > 0.0


@pytest.mark.parametrize(
    ("name", "text", "value", "bare"),
    [
        ("speed", "36 km/h", 10.0, False), ("speed", "36km/h", 10.0, False), ("speed", "10", 10.0, True),
        ("depth", "0.25", 0.25, False), ("depth", "25 %", 0.25, False), ("vehicle.car.mass", "8t", 8000.0, False),
        ("option.active.actuator.cylinder.bandwidth", "1 Hz", 2.0 * math.pi, False),
        ("option.active.control.allowed[0].value", "0.1 m/s^2", 0.1, False),
    ],
)  # fmt: skip
def test_reading(small_scenario: SmallScenario, name: str, text: str, value: float, bare: bool) -> None:
    found = find_quantity(small_scenario(), name).read(text)
    assert found == (pytest.approx(value, rel=1e-15), bare)


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("speed", "1 kg", "speed: expected a speed"), ("speed", "nan", 'speed: expected a finite number, got "nan"'),
        ("speed", "-inf km/h", "expected a finite number"), ("speed", "1e999", "not finite"),
        ("depth", "-0.1", 'depth: expected 0 or more, got "-0.1"'), ("depth", "1 m", "expected a plain number"),
        ("depth", "1e999", "expected a finite number"), ("payload", "-1 t", "a mass of zero or more"),
        ("vehicle.car.mass", "0 t", "a mass above zero"), ("height", "0 mm", "a length above zero"),
    ],
)  # fmt: skip
def test_values_that_cannot_be(small_scenario: SmallScenario, name: str, text: str, said: str) -> None:
    with pytest.raises(ValueError) as caught:
        find_quantity(small_scenario(), name).read(text)
    assert said in str(caught.value)


def test_a_value_that_makes_the_scenario_invalid_is_one_sentence(small_scenario: SmallScenario) -> None:
    with pytest.raises(ModelError, match=r"^vehicle\.magnets\.count: expected a multiple of 2, got 3$"):
        with_values(small_scenario(), {("vehicle", "magnets", "count"): 3})


def test_display_units(small_scenario: SmallScenario) -> None:
    scenario = small_scenario()
    shown = {
        name: display_unit(find_quantity(scenario, name), largest)
        for name, largest in (
            ("speed", 100.0), ("depth", 0.5), ("height", 0.1), ("wavelength", 25.0), ("payload", 2000.0),
            ("vehicle.secondary.stiffness", 3e5), ("option.active.actuator.cylinder.bandwidth", 100.0), ("gain", 2.0),
        )
    }  # fmt: skip
    assert shown == {
        "speed": ("km/h", 3.6), "depth": ("%", 100.0), "height": ("mm", 1e3), "wavelength": ("m", 1.0),
        "payload": ("t", 1e-3), "vehicle.secondary.stiffness": ("kN/m", 1e-3),
        "option.active.actuator.cylinder.bandwidth": ("Hz", 0.5 / math.pi), "gain": ("", 1.0),
    }  # fmt: skip
