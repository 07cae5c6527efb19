"""A small vehicle with laws that are designed within a second, shared by the tests of studies, pages and verbs."""

from __future__ import annotations

import tempfile
from functools import cache
from pathlib import Path

from maglev_ctrl.scenario import Scenario, load
from maglev_ctrl.study.design.records import DesignStudy, LawStudy
from maglev_ctrl.study.design.run import chosen_options, survey_design

VEHICLE = """\
format = 1
title = "Small"
description = "Heave of one car over one bogie."

[vehicle]
model = "two_stage"
freedom = ["heave"]
[vehicle.car]
mass = "24 t"
[[vehicle.bogie]]
name = "bogie"
mass = "6 t"
position = "0 m"
freedom = ["heave"]
[vehicle.secondary]
stiffness = "0.75 MN/m"
damping = "0 kN*s/m"
[vehicle.magnets]
count = 4
length = "8 m"

[forces]
model = "image"
exponent = 1
thickness = "20 mm"
conductivity = "2.5e7 S/m"
vertical_velocity = "receding_image"

[operating]
speed = "135 m/s"
height = "98.07 mm"
sweep.speed = { from = "60 m/s", to = "140 m/s", count = 3 }

[[option]]
name = "bare"
kind = "baseline"
"""
ACTUATOR = """
[[option]]
name = "{name}"
label = "{label}"
kind = "active_secondary"
[[option.actuator]]
name = "cylinder"
between = ["car", "bogies"]
force_limit = "20 kN"
bandwidth = "20 Hz"
delay = "2 ms"
"""
ALLOWED = """
allowed = [
  { output = "car.heave.acceleration", value = "0.5 m/s^2" },
  { output = "magnet_gap", value = "10 mm" },
  { actuator = "cylinder", value = "8 kN" },
]
"""
LQR = ACTUATOR.format(name="lqr", label="LQR") + '[option.control]\nlaw = "lqr"\nsampling_period = "2 ms"' + ALLOWED
H_INFINITY = (
    ACTUATOR.format(name="worst", label="Worst frequency")
    + '[option.control]\nlaw = "h_infinity"\nfeedback = "states"\ndisturbance = "0.5 m/s^2/Hz^0.5"' + ALLOWED
)  # fmt: skip
SCHEDULED = (
    ACTUATOR.format(name="scheduled", label="Scheduled")
    + '[option.control]\nlaw = "scheduled"\nover = "speed"\nnodes = ["60 m/s", "100 m/s", "140 m/s"]\n'
    'method = "interpolated"\nfastest_change = "1.5 m/s^2"\nsampling_period = "2 ms"' + ALLOWED
)
PREDICTIVE = (
    ACTUATOR.format(name="mpc", label="Predictive")
    + '[option.control]\nlaw = "mpc"\nsampling_period = "20 ms"\nhorizon = 10\n'
    'start = [{ output = "car.heave", value = "30 mm" }]\nduration = "0.4 s"' + ALLOWED
    + '[[option.control.limit]]\noutput = "cylinder.stroke"\nvalue = "20 mm"\n'
)  # fmt: skip
BUDGET = """
[[option]]
name = "dampers"
label = "Dampers"
kind = "combined"
[[option.spring_damper]]
name = "secondary_damper"
between = ["car", "bogies"]
damping = "60 kN*s/m"
[option.damping_budget]
decay_rates = ["0.2 1/s", "0.4 1/s"]
choose = "0.4 1/s"
"""
EVERY = VEHICLE + LQR + H_INFINITY + SCHEDULED + PREDICTIVE + BUDGET


def read(text: str, folder: Path) -> Scenario:
    """The scenario of a text."""
    file = folder / "small.toml"
    file.write_text(text, encoding="utf-8")
    return load(file)


@cache
def small_study() -> DesignStudy:
    """Every law of the small scenario, designed once for all tests."""
    with tempfile.TemporaryDirectory() as folder:
        scenario = read(EVERY, Path(folder))
        return survey_design(scenario, chosen_options(scenario, ()))


def law(study: DesignStudy, name: str) -> LawStudy:
    """One law of a study."""
    return next(one for one in study.options if one.name == name)
