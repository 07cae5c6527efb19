"""Control laws and damping budgets in scenario files: what each fault is answered with."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest
from control_texts import ACTIVE, ALLOWED, DAMPERS, DISTURBED, LAWS, ROOT, VEHICLE, edited, faults

from maglev_ctrl.scenario import ScenarioProblems, load
from maglev_ctrl.scenario.eddy_current import study_domain

Write = Callable[..., Path]


@pytest.fixture
def write(tmp_path: Path) -> Write:
    """Writes the vehicle with one option and (old, new) replacements."""
    return partial(edited, tmp_path)


# -------------------------------------------------------------------------------------------------- faults
SECOND = '{ actuator = "cylinder", value = "5 kN" },'
CONTROL, BUDGET = "option[1].control", "option[1].damping_budget"
NODES = 'nodes = ["200 km/h", "450 km/h"]'
INTEGRAL = '[{ output = "car.heave", value = "5 mm*s" }]'
CORNERS = 'corners = { speed = ["450 km/h"] }'
HOLD = 'h2_below = 9\nhold_from = [{{ output = "{}", value = "{}" }}]'
LIMIT = '[{ output = "stroke", value = "40 mm" }]'
START = '[{ output = "car.heave", value = "20 mm" }]'
LINKS = '[["car_velocity", "cylinder"], ["stroke", "cylinder"]]'
# law, one edit, the place of the fault (a text of its line), the key, and words of the message
CASES: list[tuple[str, str, str, str, str, list[str]]] = [
    # times
    ("lqr", 'period = "2 ms"', 'period = "0 s"', '"0 s"', f"{CONTROL}.sampling_period", ["expected a time above zero"]),
    ("lqr", 'period = "2 ms"', 'period = "2 mm"', "2 mm", f"{CONTROL}.sampling_period", ["expected a time"]),
    ("mpc", '"20 ms"', '"0 ms"', '"0 ms"', f"{CONTROL}.sampling_period", ["expected a time above zero"]),
    ("mpc", '"2 s"', '"0 s"', '"0 s"', f"{CONTROL}.duration", ["expected a time above zero"]),
    ("mpc", '"2 s"', '"1e6 s"', "1e6", f"{CONTROL}.duration", ["expected 1 to 20000 sampling periods, got 5e+07"]),
    ("mpc", '"2 s"', '"1 ms"', "1 ms", f"{CONTROL}.duration", ["expected 1 to 20000 sampling periods, got 0.05"]),
    ("output_feedback", '"5 s"', '"0 s"', '"0 s"', f"{CONTROL}.time_limit", ["expected a time above zero"]),
    ("multi_objective", "h2_below", 'time_limit = "0 s"\nh2_below', '"0 s"', f"{CONTROL}.time_limit", ["above zero"]),
    # weights
    ("lqr", '"5 kN"', '"0 kN"', "0 kN", f"{CONTROL}.allowed[2].value", ["expected a value above zero"]),
    ("lqr", '"10 mm"', '"-10 mm"', "-10", f"{CONTROL}.allowed[1].value", ["expected a value above zero"]),
    ("h2", '"5 kN"', '"5 mm"', "5 mm", f"{CONTROL}.allowed[2].value", ["expected a force", "for cylinder", "a length"]),
    ("mpc", "magnet_gap", "magnet_gab", "gab", f"{CONTROL}.allowed[1].output", ['did you mean "magnet_gap"?']),
    ("lqr", "magnet_gap", "zzz", "zzz", f"{CONTROL}.allowed[1].output", ['no output is called "zzz"', "examples are"]),
    ("h_infinity", '"cylinder", v', '"cilinder", v', "cilinder", f"{CONTROL}.allowed[2].actuator",
     ['did you mean "cylinder"?']),
    ("lqr", SECOND, SECOND + '\n  { output = "front_magnet_1.gap", value = "5 mm" },', "front_magnet_1",
     f"{CONTROL}.allowed[3]", ['"front_magnet_1.gap" already has a weight by "magnet_gap"']),
    ("lqr", SECOND, SECOND + '\n  { actuator = "cylinder", value = "6 kN" },', "6 kN", f"{CONTROL}.allowed[3]",
     ['"cylinder" already has a weight']),
    ("lqr", '{ actuator = "cylinder", value', '{ actuator = "cylinder", output = "car.pitch", value', "car.pitch",
     f"{CONTROL}.allowed[2]", ["exactly one of output and actuator"]),
    ("scheduled", SECOND, "", "allowed", f"{CONTROL}.allowed", ['actuator = "cylinder"']),
    ("lqr", 'value = "10 mm"', 'value = "1 deg"', "1 deg", f"{CONTROL}.allowed[1].value", ["expected a length"]),
    ("lqr", '"car.heave.acceleration", value = "0.5 m/s^2"', '"car.pitch", value = "0.1 %"', "0.1 %",
     f"{CONTROL}.allowed[0].value", ["unit"]),
    # sensors and their noise
    ("lqg", 'noise = "1 mm/s/Hz^0.5"', "", "[[option.sensor]]", "option[1].sensor[0].noise",
     ["missing; the law lqg needs a noise density", '"1 mm/s/Hz^0.5"']),
    ("h2", 'to = "bogies"\nnoise = "0.1 mm/Hz^0.5"', 'to = "bogies"', "[[option.sensor]]", "option[1].sensor[1].noise",
     ["missing; the law h2 needs a noise density"]),
    ("output_feedback", 'to = "bogies"\nnoise = "0.1 mm/Hz^0.5"', 'to = "bogies"', "[[option.sensor]]",
     "option[1].sensor[1].noise", ["missing; the law output_feedback needs a noise density"]),
    ("lqg", 'disturbance = "0.5 m/s^2/Hz^0.5"', "", "[option.control]", f"{CONTROL}.disturbance", ["missing"]),
    ("lqg", 'disturbance = "0.5 m/s^2/Hz^0.5"', 'disturbance = "0.5 m/s^2"', "0.5 m/s^2\"", f"{CONTROL}.disturbance",
     ["expected an acceleration noise density", "got an acceleration"]),
    # integral action
    ("lqi", "5 mm*s", "5 mm", "5 mm", f"{CONTROL}.integral[0].value", ["[length]^1 [time]^1", "got a length"]),
    ("lqi", '"car.heave", value = "5 mm*s"', '"car.heav", value = "5 mm*s"', "car.heav",
     f"{CONTROL}.integral[0].output", ['did you mean "car.heave"?']),
    ("lqi", INTEGRAL, '[{ output = "stroke", value = "5 mm*s" }]', "stroke", f"{CONTROL}.integral[0].output",
     ["expected a freedom or an output with a weight in allowed: stroke"]),
    ("lqi", INTEGRAL, '[{ output = "car.heave.velocity", value = "5 mm" }]', "velocity",
     f"{CONTROL}.integral[0].output", ["car.heave.velocity has no steady error"]),
    ("lqi", INTEGRAL, '[{ output = "magnet_gap", value = "5 mm*s" }]', "magnet_gap", f"{CONTROL}.integral",
     ["expected at most as many integrals as there are commands: 2, got 4"]),
    ("lqi", INTEGRAL, INTEGRAL[:-1] + ", " + INTEGRAL[1:], "car.heave", f"{CONTROL}.integral[1]",
     ['"car.heave" already has an integral']),
    ("lqi", INTEGRAL, "[]", "[]", f"{CONTROL}.integral", ["expected at least 1, got 0"]),
    # H2 and H-infinity
    ("h_infinity", 'feedback = "states"', 'feedback = "states"\nguideway = "1 mm/s/Hz^0.5"', "guideway",
     f"{CONTROL}.guideway", ['expected feedback = "sensors"', "not measured"]),
    ("h_infinity", 'feedback = "states"\n', "", "[option.control]", f"{CONTROL}.feedback",
     ["missing; the option has sensors"]),
    ("h_infinity", 'feedback = "states"', 'feedback = "sensor"', '"sensor"', f"{CONTROL}.feedback",
     ['did you mean "sensors"?']),
    ("h_infinity", "back_off = 1.1", "back_off = 1.0", "1.0", f"{CONTROL}.back_off", ["expected a factor above 1"]),
    ("h2", 'guideway = "1 mm/s/Hz^0.5"', "back_off = 1.2", "back_off", f"{CONTROL}.back_off", ["remove it"]),
    # requirements that contradict each other
    ("multi_objective", "damping_ratio = 0.1", "damping_ratio = 1.0", "1.0", f"{CONTROL}.damping_ratio",
     ["expected a damping ratio below 1, got 1"]),
    ("multi_objective", "damping_ratio = 0.1", "damping_ratio = 0", "= 0", f"{CONTROL}.damping_ratio", ["above zero"]),
    ("multi_objective", "0.5 1/s", "300 1/s", "300 1/s", f"{CONTROL}.decay_rate", ["contradict each other"]),
    ("multi_objective", "0.5 1/s", "0 1/s", "0 1/s", f"{CONTROL}.decay_rate", ["expected a rate above zero"]),
    ("multi_objective", "300 1/s", "-300 1/s", "-300", f"{CONTROL}.fastest", ["expected a rate above zero"]),
    ("multi_objective", "gain_below = 1e6", "gain_below = 0", "gain_below", f"{CONTROL}.gain_below", ["above zero"]),
    ("output_feedback", "links", 'objective = "h2"\nlinks', "objective", f"{CONTROL}.objective",
     ["infinite", "order = 1"]),
    # corners
    ("output_feedback", CORNERS, "corners = {}", "corners", f"{CONTROL}.corners", ["at least one list of values"]),
    ("output_feedback", CORNERS, 'corners = { speed = ["450 km/h", "300 km/h", "450 km/h"] }', "corners",
     f"{CONTROL}.corners.speed[2]", ["this value is named twice"]),
    ("output_feedback", CORNERS, 'corners = { speed = ["125 m/s", "450 km/h"] }', "corners",
     f"{CONTROL}.corners.speed[1]", ["this value is named twice"]),
    ("output_feedback", CORNERS, 'corners = { gap = ["10 mm"] }', "corners", f"{CONTROL}.corners.gap",
     ["the design point has no guidance gap"]),
    ("multi_objective", "[0.9, 1.1]", "[0.8, 0.85, 0.9, 1.1], height = ['0.08 m', '0.09 m', '0.11 m']", "corners",
     f"{CONTROL}.corners", ["expected at most 32 combinations, got 48"]),
    ("multi_objective", "[0.9, 1.1]", "[0.0, 1.1]", "corners", f"{CONTROL}.corners.magnetic_stiffness[0]",
     ["above zero"]),
    ("multi_objective", '["0 t", "5 t"]', '["-1 t", "5 t"]', "corners", f"{CONTROL}.corners.payload[0]",
     ["zero or more"]),
    ("multi_objective", "payload = [", "paylod = [", "corners", f"{CONTROL}.corners.paylod",
     ['did you mean "payload"?']),
    # starts from which no command meets its limit
    ("multi_objective", "h2_below = 9", HOLD.format("car.heav", "1 mm"), "hold_from", f"{CONTROL}.hold_from[0].output",
     ["no freedom or velocity is called", 'did you mean "car.heave"?']),
    ("multi_objective", "h2_below = 9", HOLD.format("car.heave", "1 N"), "hold_from", f"{CONTROL}.hold_from[0].value",
     ["expected a length"]),
    ("multi_objective", "h2_below = 9", HOLD.format("car.heave", "1 mm") + '\nlyapunov = "parameter_dependent"',
     "hold_from", f"{CONTROL}.hold_from", ['expected lyapunov = "common"']),
    ("h_infinity", 'feedback = "states"', 'feedback = "states"\ngain_bound = 0.0', "gain_bound",
     f"{CONTROL}.gain_bound", ["above zero"]),
    ("h2", 'feedback = "sensors"', 'feedback = "sensors"\ngain_bound = 2.0', "gain_bound", f"{CONTROL}.gain_bound",
     ["an H2 law has no gamma that gain_bound could move"]),
    # links
    ("output_feedback", '["stroke", "cylinder"]', '["strok", "cylinder"]', "strok", f"{CONTROL}.links[1][0]",
     ['no sensor is called "strok"', 'did you mean "stroke"?']),
    ("output_feedback", '["stroke", "cylinder"]', '["stroke", "cilinder"]', "cilinder", f"{CONTROL}.links[1][1]",
     ['no actuator is called "cilinder"', 'did you mean "cylinder"?']),
    ("output_feedback", '["stroke", "cylinder"]', '["stroke"]', "stroke", f"{CONTROL}.links[1]", ["at least 2"]),
    ("output_feedback", "starts = 3", "order = 2", "order", f"{CONTROL}.order", ["expected order = 0 with links"]),
    ("output_feedback", "starts = 3", "starts = 0", "starts", f"{CONTROL}.starts", ["greater than or equal to 1"]),
    # sky-hook and its kin
    ("sky_hook", 'damping = "40 kN*s/m"', 'damping = "0 kN*s/m"', "damping", f"{CONTROL}.damping",
     ["expected a damping above zero"]),
    ("sky_hook", 'sensor = "car_velocity"', 'sensor = "car_velocty"', "velocty", f"{CONTROL}.sensor",
     ['did you mean "car_velocity"?']),
    ("sky_hook", 'sensor = "car_velocity"', 'sensor = "stroke"', "stroke", f"{CONTROL}.sensor",
     ["expected a sensor of velocity or acceleration, got one of kind stroke"]),
    ("sky_hook", 'on = "car"\nat = "bogies"', 'on = "car"', "sensor", f"{CONTROL}.sensor",
     ["one velocity per actuator: 2 actuators, 1 measurements"]),
    ("damping", LAWS["damping"], "", "[option.control]", CONTROL,
     ["at least one of sky, ground, relative and gap_rate"]),
    ("damping", 'ground = "5 kN', 'ground = "-5 kN', "-5", f"{CONTROL}.ground", ["not negative"]),
    ("damping", 'at = "bogies"', 'at = "1 m"', "[option.control]", CONTROL,
     ["sky-hook of 'cylinder_front'", "add one"]),
    # schedules
    ("scheduled", NODES, 'nodes = ["450 km/h", "200 km/h"]', "450 km/h", f"{CONTROL}.nodes",
     ["expected rising values"]),
    ("scheduled", NODES, 'nodes = ["200 km/h", "200 km/h"]', "200 km/h", f"{CONTROL}.nodes",
     ["expected rising values"]),
    ("scheduled", NODES, 'nodes = ["200 km/h", "300 km/h"]', "300 km/h", f"{CONTROL}.nodes",
     ["on both sides of the design point, whose speed is 111.111 m/s; got 200 km/h to 300 km/h"]),
    ("scheduled", NODES, 'nodes = ["500 km/h", "600 km/h"]', "600 km/h", f"{CONTROL}.nodes", ["on both sides"]),
    ("scheduled", NODES, 'nodes = ["0 km/h", "450 km/h"]', "0 km/h", f"{CONTROL}.nodes[0]",
     ["expected a speed above zero"]),
    ("scheduled", NODES, 'nodes = ["-1 km/h", "450 km/h"]', "-1 km/h", f"{CONTROL}.nodes[0]", ["zero or more"]),
    ("scheduled", NODES, 'nodes = ["200 km/h", "450 t"]', "450 t", f"{CONTROL}.nodes[1]",
     ["expected a speed", "for speed"]),
    ("scheduled", NODES, 'nodes = ["450 km/h"]', "450 km/h", f"{CONTROL}.nodes", ["expected at least 2, got 1"]),
    ("scheduled", '"1.5 m/s^2"', '"1.5 m/s"', "1.5 m/s", f"{CONTROL}.fastest_change",
     ["expected an acceleration", "for the change of speed", "got a speed"]),
    ("scheduled", f'over = "speed"\n{NODES}\nfastest_change = "1.5 m/s^2"', 'over = "gap"\nnodes = ["1 mm", "2 mm"]',
     "gap", f"{CONTROL}.over", ["no guidance gap"]),
    ("scheduled", 'over = "speed"', 'over = "spede"', "spede", f"{CONTROL}.over", ['did you mean "speed"?']),
    # predictive control
    ("mpc", LIMIT, '[{ output = "strok", value = "40 mm" }]', "strok", f"{CONTROL}.limit[0].output", ['"stroke"?']),
    ("mpc", LIMIT, '[{ output = "cylinder.force", value = "1 kN" }]', "cylinder.force", f"{CONTROL}.limit[0].output",
     ['no output is called "cylinder.force"']),
    ("mpc", LIMIT, '[{ output = "stroke", value = "40 kN" }]', "40 kN", f"{CONTROL}.limit[0].value",
     ["expected a length", "for stroke", "got a force"]),
    ("mpc", LIMIT, '[{ output = "stroke", value = "4 mm" }, { output = "stroke_rear", value = "5 mm" }]', "stroke_rear",
     f"{CONTROL}.limit[1]", ['"stroke_rear" already has a limit by "stroke"']),
    ("mpc", START, '[{ output = "car.heav", value = "20 mm" }]', "car.heav", f"{CONTROL}.start[0].output",
     ["no freedom or velocity is called", 'did you mean "car.heave"?']),
    ("mpc", START, '[{ output = "magnet_gap", value = "20 mm" }]', "magnet_gap", f"{CONTROL}.start[0].output",
     ["no freedom or velocity is called", "known here: car.heave, car.pitch, front.heave, rear.heave"]),
    ("mpc", START, '[{ output = "car.heave", value = "20 deg" }]', "20 deg", f"{CONTROL}.start[0].value",
     ["expected a length", "for car.heave"]),
    ("mpc", START, '[{ output = "car.heave", value = "1 mm" }, { output = "car.heave", value = "2 mm" }]', "2 mm",
     f"{CONTROL}.start[1]", ['"car.heave" is named twice']),
    ("mpc", "0.1 rad/s^2", "0.1 m/s^2", "0.1 m/s^2", f"{CONTROL}.load[0].value",
     ["an angular acceleration", "car.pitch"]),
    ("mpc", "horizon = 20", "horizon = 1", "horizon = 1", f"{CONTROL}.horizon", ["greater than or equal to 2"]),
    # damping budgets
    ("budget", 'choose = "0.4 1/s"', 'choose = "0.3 1/s"', "0.3 1/s", f"{BUDGET}.choose", ["one of the decay_rates"]),
    ("budget", '["0.2 1/s", "0.4 1/s"]', '["0.6 1/s", "0.4 1/s"]', "0.6 1/s", f"{BUDGET}.decay_rates", ["rising"]),
    ("budget", '["0.2 1/s", "0.4 1/s"]', '["0 1/s", "0.4 1/s"]', "0 1/s", f"{BUDGET}.decay_rates[0]", ["above zero"]),
    ("budget", "costs = [1.0, 3.0]", "costs = [1.0]", "costs", f"{BUDGET}.costs",
     ["one cost per spring_damper: 2, got 1"]),
    ("budget", "costs = [1.0, 3.0]", "costs = [1.0, 0.0]", "costs", f"{BUDGET}.costs[1]", ["above zero"]),
    ("budget", '"200 kN*s/m"', '"0 kN*s/m"', "largest", f"{BUDGET}.largest", ["expected a damping above zero"]),
    ("budget", "largest", 'time_limit = "0 s"\nlargest', "time_limit", f"{BUDGET}.time_limit", ["a time above zero"]),
    ("budget", 'damping = "60 kN*s/m"', 'damping = "60 kN*s/m"\nlag = "5 ms"', "5 ms", "option[1].spring_damper[0].lag",
     ["a damping_budget chooses dampers without a lag only"]),
    ("budget", '["300 km/h"]', '["300 km/h", "300 km/h"]', "corners", f"{BUDGET}.corners.speed[1]", ["named twice"]),
]  # fmt: skip


@pytest.mark.parametrize(
    ("law", "old", "new", "place", "key", "words"), CASES, ids=[f"{c[0]}-{c[4]}-{i}" for i, c in enumerate(CASES)]
)
def test_each_fault_is_placed_and_explained(
    write: Write, law: str, old: str, new: str, place: str, key: str, words: list[str]
) -> None:
    file = write(law, (old, new))
    lines = faults(file)
    assert len(lines) == 1, lines
    assert f" {key}: " in lines[0], lines[0]
    for word in words:
        assert word in lines[0], lines[0]
    path, line, column, _ = lines[0].split(":", 3)
    assert path == str(file)
    text = file.read_text(encoding="utf-8").splitlines()[int(line) - 1]
    assert place in text, (text, lines[0])
    assert 1 <= int(column) <= len(text)


def test_without_the_checks_the_faults_go_unseen(write: Write, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every sentence about a law's meaning comes from the checks of laws, budgets and points: none would be left."""
    silent = lambda *given, **named: iter(())  # noqa: E731
    for place in ("checks_options.control_faults", "checks_options.budget_faults", "checks.point_faults",
                  "reader.domain_faults", "hooks.hooked_dampers"):  # fmt: skip
        monkeypatch.setattr(f"maglev_ctrl.scenario.{place}", silent)
    unseen = 0
    for law, old, new, *_ in CASES:
        file = write(law, (old, new))
        try:
            load(file)
        except ScenarioProblems as error:
            # What is left is the business of single fields: their unit, their range, their spelling.
            assert len(error.problems) == 1
            continue
        unseen += 1
    assert unseen >= 55


def test_a_law_without_sensors(write: Write) -> None:
    sensors = ACTIVE[ACTIVE.index("[[option.sensor]]") :]
    lines = faults(write("lqg", (sensors, "\n")))
    assert len(lines) == 1 and "the law lqg measures with sensors; expected at least one [[option.sensor]]" in lines[0]
    assert load(write("h_infinity", (sensors, "\n"), ('feedback = "states"\n', ""))).options  # nothing else to measure


@pytest.mark.parametrize("law", ["sky_hook", "damping"])
def test_a_damper_without_an_actuator(write: Write, law: str) -> None:
    actuator = ACTIVE[ACTIVE.index("[[option.actuator]]") : ACTIVE.index("[[option.sensor]]")]
    assert any("[[option.actuator]]" in line for line in faults(write(law, (actuator, ""))))


def test_no_objective_and_no_requirement(write: Write) -> None:
    asked = LAWS["multi_objective"][len(DISTURBED) :]
    lines = faults(write("multi_objective", (asked, 'objective = "none"')))
    assert len(lines) == 1 and "expected an objective or at least one requirement" in lines[0]


def test_weights_of_actuators_alone_weigh_nothing(write: Write) -> None:
    outputs = ALLOWED[ALLOWED.index("  { output") : ALLOWED.index("  { actuator")]
    file = write("lqr", (outputs, '  { actuator = "cylinder", value = "1 kN" },\n'))
    assert any("expected at least one { output = ..., value = ... }" in line for line in faults(file))


def test_either_a_law_or_a_budget(write: Write) -> None:
    actuator = ACTIVE[ACTIVE.index("[[option.actuator]]") : ACTIVE.index("[[option.sensor]]")]
    both = f'{actuator}[option.control]\nlaw = "lqr"\n{LAWS["lqr"]}\n[option.damping_budget]'
    lines = faults(write("budget", ("[option.damping_budget]", both)))
    assert len(lines) == 1 and "expected either a control law or a damping budget" in lines[0]
    assert BUDGET in lines[0]


def test_a_budget_without_dampers(write: Write) -> None:
    budget = DAMPERS[DAMPERS.index("[option.damping_budget]") :]
    lines = faults(write("lqr", (LAWS["lqr"], LAWS["lqr"] + "\n" + budget)))
    assert any("expected at least one [[option.spring_damper]] whose damping is to be chosen" in line for line in lines)


# ------------------------------------------------------------------------- points where nothing is known


def test_a_height_that_follows_is_not_prescribed(write: Write) -> None:
    held = ('hold = "height"', 'hold = "strength"')
    corner = write("output_feedback", held, (CORNERS, 'corners = { height = ["0.12 m"] }'))
    assert [one for one in faults(corner) if f"{CONTROL}.corners.height" in one and "follows from the magnets" in one]
    over = f'over = "speed"\n{NODES}\nfastest_change = "1.5 m/s^2"'
    nodes = write("scheduled", held, (over, 'over = "height"\nnodes = ["0.05 m", "0.12 m"]'))
    assert [line for line in faults(nodes) if f"{CONTROL}.over" in line and "follows from the magnets" in line]


TABLE = """[forces]
model = "coefficients"
units = "SI"
convention = "left_hand_side"
speeds = ["50 m/s", "120 m/s"]
"""


def measured(write: Write, corners: str) -> Path:
    """Forces measured from 50 m/s to 120 m/s as matrices, which know no height."""
    zero, K = [[0.0] * 6 for _ in range(6)], [[1e6 * (i == j == 2) for j in range(6)] for i in range(6)]
    matrices = f"mass = {[zero] * 2}\ndamping = {[zero] * 2}\nstiffness = {[K] * 2}\n"
    forces = VEHICLE[VEHICLE.index("[forces]") : VEHICLE.index("# ---", VEHICLE.index("[forces]"))]
    magnets = VEHICLE[VEHICLE.index("[vehicle.magnets]") : VEHICLE.index("[vehicle.aerodynamics]")]
    period = VEHICLE[VEHICLE.index("[periodic]") : VEHICLE.rindex("# ---")]
    return write(
        "output_feedback", (CORNERS, corners), (forces, TABLE + matrices), (magnets, ""), (period, ""),
        ("magnet_gap", "car.pitch"), ('"10 mm"', '"1 deg"'),
    )  # fmt: skip


def test_coefficients_know_no_height_and_their_own_speeds_only(write: Write) -> None:
    assert load(measured(write, 'corners = { speed = ["60 m/s", "120 m/s"] }')).options
    height = faults(measured(write, 'corners = { height = ["0.1 m"] }'))
    assert len(height) == 1 and "do not change with the height" in height[0]
    speed = faults(measured(write, 'corners = { speed = ["60 m/s", "130 m/s"] }'))
    assert len(speed) == 1 and f"{CONTROL}.corners.speed[1]: the forces are not known there: " in speed[0]


def guided(tmp_path: Path, law: str) -> Path:
    """The double-L vehicle, whose eddy-current forces are solved for given ranges, with another law."""
    text = (ROOT / "scenarios/design/double_l_guidance.toml").read_text(encoding="utf-8")
    file = tmp_path / "guided.toml"
    file.write_text(text.replace('law = "lqr"', law), encoding="utf-8")
    return file


def test_points_outside_the_forces_are_refused(tmp_path: Path) -> None:
    law = 'law = "multi_objective"\ndisturbance = "0.1 m/s^2/Hz^0.5"\n'
    law += 'corners = { gap = ["20 mm"], height = ["HEIGHT"] }'
    assert load(guided(tmp_path, law.replace("HEIGHT", "15 mm"))).options
    lines = faults(guided(tmp_path, law.replace("HEIGHT", "60 mm")))
    assert len(lines) == 1
    assert "option[2].control.corners.height[0]: the forces are not known there: height 0.06 m" in lines[0]
    lines = faults(guided(tmp_path, 'law = "scheduled"\nover = "gap"\nnodes = ["20 mm", "30 mm", "43 mm"]'))
    assert len(lines) == 1 and "option[2].control.nodes[2]: the forces are not known there: gap 0.043 m" in lines[0]


def test_ranges_that_are_solved_for_cover_the_corners(tmp_path: Path) -> None:
    law = 'law = "multi_objective"\ndisturbance = "0.1 m/s^2/Hz^0.5"\n'
    plain = study_domain(load(guided(tmp_path, law)), has_gap=True)
    corners = 'corners = { speed = ["58 m/s"], height = ["35 mm"], gap = ["40 mm"] }'
    wide = study_domain(load(guided(tmp_path, law + corners)), has_gap=True)
    assert plain.speed[1] < 58.0 < wide.speed[1] and plain.height[1] < 0.035 < wide.height[1]
    assert plain.gap is not None and wide.gap is not None and plain.gap[1] < 0.04 < wide.gap[1]


def test_stiffness_of_electromagnets_is_not_scaled_alone(tmp_path: Path) -> None:
    text = (ROOT / "scenarios/design/ems_hover.toml").read_text(encoding="utf-8")
    law = 'law = "multi_objective"\ndisturbance = "0.1 m/s^2/Hz^0.5"\ncorners = { CORNERS }'
    file = tmp_path / "ems.toml"
    file.write_text(text.replace('law = "lqr"', law.replace("CORNERS", "magnetic_stiffness = [0.9, 1.1]"), 1))
    lines = faults(file)
    assert len(lines) == 1 and "corners.magnetic_stiffness: the stiffness of electromagnets" in lines[0]
    file.write_text(text.replace('law = "lqr"', law.replace("CORNERS", 'height = ["9 mm", "11 mm"]'), 1))
    assert load(file).options


def test_windings_weighed_twice(tmp_path: Path) -> None:
    text = (ROOT / "scenarios/design/ems_hover.toml").read_text(encoding="utf-8")
    volts = '{ actuator = "magnet", value = "50 V" },'
    file = tmp_path / "ems.toml"
    file.write_text(text.replace(volts, volts + '\n  { actuator = "magnet_2", value = "40 V" },', 1))
    lines = faults(file)
    assert len(lines) == 1 and '"magnet_2.voltage" already has a weight by "magnet"' in lines[0]
    file.write_text(text.replace('value = "50 V"', 'value = "50 A"', 1))
    assert "expected a voltage with its unit for magnet" in faults(file)[0]


def hovering(tmp_path: Path, law: str) -> Path:
    """The section under its guideway, electromagnets and no actuator, with another law in its first option."""
    text = (ROOT / "scenarios/design/ems_hover.toml").read_text(encoding="utf-8")
    start = text.index("[option.control]")
    file = tmp_path / "hovering.toml"
    file.write_text(text[:start] + law + text[text.index("[[option]]", start) :], encoding="utf-8")
    return file


@pytest.mark.parametrize(
    "law", ['law = "sky_hook"\ndamping = "1 kN*s/m"\nsensor = "v"', 'law = "damping"\nsky = "1 N*s/m"']
)
def test_electromagnets_are_no_dampers(tmp_path: Path, law: str) -> None:
    lines = faults(hovering(tmp_path, f"[option.control]\n{law}\n"))
    assert len(lines) == 1
    assert "option[1].control: expected at least one [[option.actuator]] for the law to drive" in lines[0]


def test_a_law_without_a_weighted_winding(tmp_path: Path) -> None:
    law = '[option.control]\nlaw = "lqr"\nallowed = [\n{ output = "magnet_gap", value = "2 mm" },\n'
    lines = faults(hovering(tmp_path, law + '{ output = "car.heave", value = "2 mm" },\n]\n'))
    assert len(lines) == 1 and "expected at least one { actuator = ..., value = ... }, out of magnet, " in lines[0]


def test_an_actuator_that_sees_no_sensor(write: Write) -> None:
    second = '[[option.actuator]]\nname = "spare"\nbetween = ["car", "front"]\n[[option.sensor]]'
    weight = SECOND + '\n  { actuator = "spare", value = "1 kN" },'
    lines = faults(write("output_feedback", ("[[option.sensor]]", second), (SECOND, weight)))
    assert len(lines) == 1 and f'{CONTROL}.links: the actuator "spare" sees no sensor' in lines[0]
    linked = ('["stroke", "cylinder"]]', '["stroke", "cylinder"], ["track", "spare"]]')
    assert load(write("output_feedback", ("[[option.sensor]]", second), (SECOND, weight), linked)).options


def test_nothing_begins_displaced_along_the_guideway(write: Write) -> None:
    surge = ('freedom = ["heave", "pitch"]', 'freedom = ["surge", "heave", "pitch"]')
    lines = faults(write("mpc", surge, (START, '[{ output = "car.surge", value = "1 m" }]')))
    assert len(lines) == 1 and f"{CONTROL}.start[0].output: nothing depends on surge" in lines[0]
