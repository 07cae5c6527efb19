"""Fixtures of the unit tests: a small two-stage scenario, quick to run, with an option of every sort."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from maglev_ctrl.scenario import Scenario, load

TEXT = """
format = 1
title = "A small train"
assumptions = ["every number: a test"]

[sources]
test = "made for the tests"

[vehicle]
model = "two_stage"
freedom = ["heave"]
[vehicle.car]
mass = "8 t"
payload = "2 t"
[[vehicle.bogie]]
name = "bogie"
mass = "3 t"
position = "0 m"
freedom = ["heave"]
[vehicle.secondary]
stiffness = "250 kN/m"
damping = "0 kN*s/m"
[vehicle.magnets]
count = 2
length = "1 m"

[forces]
model = "image"
exponent = 1
thickness = "20 mm"
conductivity = "2.5e7 S/m"
vertical_velocity = "receding_image"

[operating]
speed = "300 km/h"
height = "0.1 m"
sweep.speed = { from = "60 km/h", to = "400 km/h", count = 9 }
sweep.payload = { from = "0 t", to = "3 t", count = 3 }

[periodic]
wavelength = "25 m"
depth = 0.05
map = { speed = { from = "60 km/h", to = "400 km/h", count = 24 }, depth = { from = 0.0, to = 0.5, count = 11 } }

[[option]]
name = "bare"
kind = "baseline"

[[option]]
name = "damper"
kind = "passive_secondary"
[[option.spring_damper]]
name = "damper"
between = ["car", "bogies"]
damping = "30 kN*s/m"

[[option]]
name = "active"
kind = "active_secondary"
[[option.actuator]]
name = "cylinder"
between = ["car", "bogies"]
bandwidth = "20 Hz"
delay = "2 ms"
[option.control]
law = "lqr"
allowed = [
  { output = "car.heave.acceleration", value = "0.5 m/s^2" },
  { output = "magnet_gap", value = "20 mm" },
  { actuator = "cylinder", value = "5 kN" },
]

[[requirement]]
name = "stable"
quantity = "growth_rate"
at_most = "0 1/s"
[[requirement]]
name = "damping"
quantity = "damping_ratio"
at_least = 0.02
[[requirement]]
name = "disk"
quantity = "disk_margin"
at_least = 0.4
[[requirement]]
name = "phase"
quantity = "phase_margin"
at_least = "30 deg"
over = "nominal"
[[requirement]]
name = "modulation"
quantity = "modulation_ratio"
at_least = 2.0
[[requirement]]
name = "overspeed"
quantity = "speed_margin"
at_least = 0.1
"""


@pytest.fixture(scope="session")
def small_text() -> str:
    """The small scenario as a file's text."""
    return TEXT


@pytest.fixture(scope="session")
def small_scenario(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Scenario]:
    """The small scenario, or a variation of its text, written to a folder of its own and read back."""

    def read(text: str = TEXT) -> Scenario:
        path = tmp_path_factory.mktemp("scenario") / "small.toml"
        path.write_text(text, encoding="utf-8")
        return load(path)

    return read
