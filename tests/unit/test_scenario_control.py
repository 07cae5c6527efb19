"""Control laws and damping budgets in scenario files: what is accepted, what it means, and how it reads."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from control_texts import LAWS, ROOT, edited

from maglev_ctrl.errors import OutOfDomain
from maglev_ctrl.scenario import Scenario, control_law, describe_option, load
from maglev_ctrl.scenario.control_schema import HookedLaw, Lqi, Predictive, Scheduled, SkyHook
from maglev_ctrl.scenario.layout import layout, outputs_of
from maglev_ctrl.study.situation import OptionModel, Situation
from maglev_ctrl.systems import Controller
from maglev_ctrl.systems.scheduled import ScheduledController

Write = Callable[..., Path]


@pytest.fixture
def write(tmp_path: Path) -> Write:
    """Writes the vehicle with one option and (old, new) replacements."""
    return partial(edited, tmp_path)


def law_of(scenario: Scenario) -> object:
    law = control_law(scenario, scenario.options[1])
    assert law is not None
    return law.record


# ------------------------------------------------------------------------------------------------ accepted


@pytest.mark.parametrize("law", [*LAWS, "budget"])
def test_every_law_is_accepted(write: Write, law: str) -> None:
    scenario = load(write(law))
    if law != "budget":
        assert law_of(scenario).law == law  # type: ignore[attr-defined]


def test_names_are_spelled_out(write: Write) -> None:
    scenario = load(write("output_feedback"))
    law = control_law(scenario, scenario.options[1])
    assert law is not None
    both = ("front", "rear")
    assert law.actuators == tuple(f"cylinder_{one}" for one in both)
    assert law.sensors == tuple(f"{name}_{one}" for name in ("car_velocity", "stroke", "track") for one in both)
    gaps = [(f"{one}_magnet_{i}.gap", 0.01) for one in both for i in (1, 2)]
    assert law.output_weights == (("car.heave.acceleration", 0.5), *gaps)
    assert law.input_weights == tuple((name, 5000.0) for name in law.actuators)
    assert law.noise == tuple((name, 1e-4 if "velocity" not in name else 1e-3) for name in law.sensors)
    # One sensor per bogie and one actuator per bogie: each place sees its own sensor, never the other's.
    linked = ("car_velocity", "stroke")
    assert law.links == tuple((f"{name}_{one}", f"cylinder_{one}") for name in linked for one in both)
    assert law.placed("stroke") == ("stroke_front", "stroke_rear") and law.placed(None) == ()
    with pytest.raises(KeyError):
        law.placed("strok")


def test_one_sensor_for_several_actuators_is_linked_to_each(write: Write) -> None:
    one = ('on = "car"\nat = "bogies"', 'on = "car"')
    scenario = load(write("output_feedback", one))
    law = control_law(scenario, scenario.options[1])
    assert law is not None
    assert law.links[:2] == (("car_velocity", "cylinder_front"), ("car_velocity", "cylinder_rear"))


def test_dampers_of_velocities_drive_the_options_actuators_only(write: Write) -> None:
    for name in ("sky_hook", "damping"):
        scenario = load(write(name))
        law = control_law(scenario, scenario.options[1])
        assert law is not None and isinstance(law.record, SkyHook | HookedLaw)
        assert law.actuators == ("cylinder_front", "cylinder_rear")
        assert law.output_weights == law.input_weights == law.links == ()


def test_windings_are_driven_where_a_weight_names_them(tmp_path: Path) -> None:
    text = (ROOT / "scenarios/design/ems_hover.toml").read_text(encoding="utf-8")
    file = tmp_path / "one.toml"
    file.write_text(text.replace('{ actuator = "magnet",', '{ actuator = "magnet_1",', 1), encoding="utf-8")
    scenario = load(file)
    law = control_law(scenario, scenario.options[1])
    assert law is not None
    assert law.actuators == ("magnet_1.voltage",) and law.input_weights == (("magnet_1.voltage", 50.0),)


@pytest.mark.parametrize("bandwidth", ["", 'bandwidth = "20 Hz"\n'])
def test_every_output_that_may_be_named_is_one_of_the_model(write: Write, bandwidth: str) -> None:
    """The force of an actuator without a lag is the command itself, and no output."""
    scenario = load(
        write("lqr", ('delay = "2 ms"\n[[option.sensor]]', f'delay = "2 ms"\n{bandwidth}[[option.sensor]]'))
    )
    option = scenario.options[1]
    named = {name for _, names in outputs_of(option, layout(scenario.vehicle)).values() for name in names}
    known = OptionModel(scenario, option).plant(Situation.of_design(scenario), pade_order=0).outputs
    assert named <= set(known)
    assert ("cylinder_front.force" in named) == bool(bandwidth)


def test_values_are_in_si(write: Write) -> None:
    lqi, mpc = law_of(load(write("lqi"))), law_of(load(write("mpc")))
    scheduled = law_of(load(write("scheduled")))
    assert isinstance(lqi, Lqi) and isinstance(mpc, Predictive) and isinstance(scheduled, Scheduled)
    assert lqi.integral[0].value.value == pytest.approx(5e-3)
    assert (mpc.limits[0].value.value, mpc.load[0].value.value) == pytest.approx((0.04, 0.1))
    assert [node.value for node in scheduled.nodes] == pytest.approx([200 / 3.6, 450 / 3.6])


def test_angles_may_be_integrated(write: Write) -> None:
    pitch = ('{ output = "car.heave", value = "5 mm*s" }', '{ output = "car.pitch", value = "0.1 deg*s" }')
    assert load(write("lqi", pitch)).options


def test_a_schedule_may_begin_without_payload(write: Write) -> None:
    over = ('over = "speed"\nnodes = ["200 km/h", "450 km/h"]\nfastest_change = "1.5 m/s^2"',
            'over = "payload"\nnodes = ["0 t", "5 t"]\nfastest_change = "10 kg/s"')  # fmt: skip
    assert load(write("scheduled", over)).options


def test_a_corner_equal_to_the_design_point_is_fine(write: Write) -> None:
    same = ('corners = { speed = ["450 km/h"] }', 'corners = { speed = ["400 km/h"], height = ["0.10 m"] }')
    assert load(write("output_feedback", same)).options


def test_outside_its_schedule_there_is_no_law(write: Write) -> None:
    scenario = load(write("scheduled"))
    law = Controller.static(-np.ones((1, 1)), measured=("car.heave",), commands=("cylinder_front",))
    schedule = ScheduledController.from_nodes("speed", "m/s", [50.0, 120.0], (law, law))
    model, point = OptionModel(scenario, scenario.options[1], schedule), Situation.of_design(scenario)
    assert model.law_at(point, law) is not None
    doubled, there = model.with_gain(2.0), Situation(60.0, None, 0.1, None, 0.0)
    scheduled, twice = model.law_at(there, law), doubled.law_at(there, law)
    assert scheduled is not None and twice is not None
    np.testing.assert_array_equal(twice.D, 2.0 * scheduled.D)
    with pytest.raises(OutOfDomain, match=r"not scheduled there: speed: expected 50 to 120 m/s.*got 130"):
        model.law_at(Situation(130.0, None, 0.1, None, 0.0), law)


# --------------------------------------------------------------------------------------------------- words
WORDS = {
    "lqr": "LQR; acceptable: car.heave.acceleration 0.5 m/s^2, magnet_gap 10 mm, cylinder 5 kN",
    "lqi": "LQR with integrals of car.heave; acceptable: ",
    "lqg": "LQG, disturbance 0.5 m/s^2 per sqrt(Hz); acceptable: ",
    "h2": "H2 feedback of the sensors, rough guideway; acceptable: ",
    "h_infinity": "H-infinity feedback of the states; acceptable: ",
    "multi_objective": "multi-objective LMI, least H2 norm, H2 norm below 9, decay rate 0.5 1/s, damping ratio 0.1, "
    "poles within 300 1/s, gain below 1e+06, at every corner, one Lyapunov matrix; acceptable: ",
    "output_feedback": "output feedback, constant gains, car_velocity to cylinder, stroke to cylinder, least "
    "H-infinity norm, at every corner; acceptable: ",
    "sky_hook": "sky-hook damping 40 kN s/m of car_velocity",
    "damping": "damping: sky-hook 40 kN s/m, ground-hook 5 kN s/m, relative 1 kN s/m, gap-rate 1 kN s/m",
    "scheduled": "gains scheduled over speed, interpolated, 2 nodes from 200 km/h to 450 km/h; acceptable: ",
    "mpc": "predictive control, 20 steps of 20 ms, stroke within 40 mm; acceptable: ",
    "budget": "damping chosen: the cheapest proved to decay at 0.4 1/s, prices 1 : 3, at most 200 kN s/m at one place, "
    "at every corner",
}  # fmt: skip


@pytest.mark.parametrize("law", WORDS)
def test_laws_in_words(write: Write, law: str) -> None:
    scenario = load(write(law))
    lines = describe_option(scenario, scenario.options[1])
    assert lines[-1].startswith(WORDS[law])


def test_a_damper_to_be_chosen_shows_no_damping(write: Write) -> None:
    scenario = load(write("budget"))
    first, second, _ = describe_option(scenario, scenario.options[1])
    assert first == "2 x secondary_damper, vertical, car to bogies: damping to be chosen"
    assert second == "2 x primary_damper, vertical, bogies to guideway: damping to be chosen"


def test_matrices_of_their_own_are_told(write: Write) -> None:
    scenario = load(write("multi_objective", ("h2_below", 'lyapunov = "parameter_dependent"\nh2_below')))
    assert "at every corner, a Lyapunov matrix for each;" in describe_option(scenario, scenario.options[1])[-1]
