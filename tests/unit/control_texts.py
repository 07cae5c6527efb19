"""Scenario files with one option that has a control law or a damping budget, for the tests of both."""

from __future__ import annotations

from pathlib import Path

import pytest

from maglev_ctrl.errors import ScenarioError
from maglev_ctrl.scenario import ScenarioProblems, load
from maglev_ctrl.scenario.starter import starter_text

ROOT = Path(__file__).resolve().parents[2]
Edit = tuple[str, str]

VEHICLE = starter_text("Case").partition("[[option]]")[0]
BARE = '[[option]]\nname = "bare"\nkind = "baseline"\n'
ACTIVE = """
[[option]]
name = "active"
kind = "active_secondary"
[[option.actuator]]
name = "cylinder"
between = ["car", "bogies"]
force_limit = "20 kN"
delay = "2 ms"
[[option.sensor]]
name = "car_velocity"
kind = "velocity"
on = "car"
at = "bogies"
noise = "1 mm/s/Hz^0.5"
[[option.sensor]]
name = "stroke"
kind = "stroke"
on = "car"
to = "bogies"
noise = "0.1 mm/Hz^0.5"
[[option.sensor]]
name = "track"
kind = "gap"
on = "bogies"
noise = "0.1 mm/Hz^0.5"
"""
ALLOWED = """
allowed = [
  { output = "car.heave.acceleration", value = "0.5 m/s^2" },
  { output = "magnet_gap", value = "10 mm" },
  { actuator = "cylinder", value = "5 kN" },
]
"""
DISTURBED = ALLOWED + 'disturbance = "0.5 m/s^2/Hz^0.5"\n'
LAWS = {
    "lqr": ALLOWED + 'sampling_period = "2 ms"',
    "lqi": ALLOWED + 'integral = [{ output = "car.heave", value = "5 mm*s" }]',
    "lqg": DISTURBED,
    "h2": DISTURBED + 'feedback = "sensors"\nguideway = "1 mm/s/Hz^0.5"',
    "h_infinity": DISTURBED + 'feedback = "states"\nback_off = 1.1',
    "multi_objective": DISTURBED
    + 'decay_rate = "0.5 1/s"\ndamping_ratio = 0.1\nfastest = "300 1/s"\nh2_below = 9\ngain_below = 1e6\n'
    + 'corners = { speed = ["300 km/h", "400 km/h"], payload = ["0 t", "5 t"], magnetic_stiffness = [0.9, 1.1] }',
    "output_feedback": DISTURBED
    + 'links = [["car_velocity", "cylinder"], ["stroke", "cylinder"]]\nstarts = 3\nseed = 1\ntime_limit = "5 s"\n'
    + 'corners = { speed = ["450 km/h"] }',
    "sky_hook": 'damping = "40 kN*s/m"\nsensor = "car_velocity"',
    "damping": 'sky = "40 kN*s/m"\nground = "5 kN*s/m"\nrelative = "1 kN*s/m"\ngap_rate = "1 kN*s/m"',
    "scheduled": ALLOWED + 'over = "speed"\nnodes = ["200 km/h", "450 km/h"]\nfastest_change = "1.5 m/s^2"',
    "mpc": ALLOWED
    + 'sampling_period = "20 ms"\nhorizon = 20\nduration = "2 s"\nlimit = [{ output = "stroke", value = "40 mm" }]\n'
    + 'start = [{ output = "car.heave", value = "20 mm" }]\nload = [{ output = "car.pitch", value = "0.1 rad/s^2" }]',
}
DAMPERS = """
[[option]]
name = "dampers"
kind = "combined"
[[option.spring_damper]]
name = "secondary_damper"
between = ["car", "bogies"]
damping = "60 kN*s/m"
[[option.spring_damper]]
name = "primary_damper"
between = ["bogies", "guideway"]
[option.damping_budget]
decay_rates = ["0.2 1/s", "0.4 1/s"]
choose = "0.4 1/s"
costs = [1.0, 3.0]
largest = "200 kN*s/m"
corners = { speed = ["300 km/h"] }
"""


def option_of(law: str) -> str:
    """The option with a law of this name, or with a budget."""
    return DAMPERS if law == "budget" else f'{ACTIVE}[option.control]\nlaw = "{law}"\n{LAWS[law]}\n'


def edited(folder: Path, law: str, *edits: Edit) -> Path:
    """The starter's vehicle with one option, (old, new) replacements made; every old text has to be there."""
    text = VEHICLE + BARE + option_of(law)
    for old, new in edits:
        assert old in text, old
        text = text.replace(old, new, 1)
    file = folder / "case.toml"
    file.write_text(text, encoding="utf-8")
    return file


def faults(file: Path) -> list[str]:
    """What is wrong with a file, one line each."""
    with pytest.raises(ScenarioError) as caught:
        load(file)
    lines = str(caught.value).splitlines()
    assert isinstance(caught.value, ScenarioProblems)
    assert len(lines) == len(caught.value.problems)
    return lines
