"""Scenario texts for tests of ride and simulation: a small train on a rough guideway, and one mass on a magnet."""

from __future__ import annotations

from pathlib import Path

from maglev_ctrl.scenario import Scenario, load

HEAD = """
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
pitch_inertia = "9 t*m^2"
position = "0 m"
freedom = ["heave", "pitch"]
[vehicle.secondary]
stiffness = "250 kN/m"
damping = "0 kN*s/m"
[vehicle.magnets]
count = 4
length = "6 m"

[forces]
model = "image"
exponent = 1
thickness = "20 mm"
conductivity = "2.5e7 S/m"
vertical_velocity = "receding_image"

[operating]
speed = "300 km/h"
height = "0.1 m"
sweep.speed = { from = "120 km/h", to = "400 km/h", count = 3 }
sweep.payload = { from = "0 t", to = "3 t", count = 2 }

[irregularity]
vertical = { form = "federal_railroad", amplitude = "1.5e-6 m" }
girder = { span = "25 m", sag = "3 mm" }
step = { height = "2 mm", ramp = "0.5 m" }

[ride]
smallest_height = "20 mm"
largest_stroke = "60 mm"
passenger = [{ name = "centre", x = "0 m" }]
[[ride.mask]]
axis = "vertical"
point = [{ frequency = "1 Hz", density = "0.01 m^2/s^4/Hz" }, { frequency = "10 Hz", density = "0.01 m^2/s^4/Hz" }]
"""

OPTIONS = """
[[option]]
name = "bare"
kind = "baseline"

[[option]]
name = "damped"
kind = "combined"
[[option.spring_damper]]
name = "damper"
between = ["car", "bogies"]
damping = "30 kN*s/m"
[[option.spring_damper]]
name = "front_winding"
between = ["bogies", "guideway"]
damping = "10 kN*s/m"
at = "3 m"
[[option.spring_damper]]
name = "rear_winding"
between = ["bogies", "guideway"]
damping = "10 kN*s/m"
at = "-3 m"

[[option]]
name = "active"
kind = "combined"
[[option.spring_damper]]
name = "front_winding"
between = ["bogies", "guideway"]
damping = "10 kN*s/m"
at = "3 m"
[[option.spring_damper]]
name = "rear_winding"
between = ["bogies", "guideway"]
damping = "10 kN*s/m"
at = "-3 m"
[[option.actuator]]
name = "cylinder"
between = ["car", "bogies"]
bandwidth = "20 Hz"
force_limit = "20 kN"
[[option.sensor]]
name = "car_velocity"
kind = "velocity"
on = "car"
at = "bogies"
[option.control]
law = "sky_hook"
damping = "30 kN*s/m"
sensor = "car_velocity"
"""

REQUIREMENTS = """
[[requirement]]
name = "calm"
quantity = "weighted_acceleration"
at_most = "0.5 m/s^2"
over = "speed"
[[requirement]]
name = "gap"
quantity = "gap_used"
at_most = 0.5
over = "payload"
[[requirement]]
name = "power"
quantity = "supplied_power"
at_most = "2 kW"
[[requirement]]
name = "very_calm"
quantity = "weighted_acceleration"
at_most = "0.001 m/s^2"
hard = false
"""

TRAIN = HEAD + OPTIONS + REQUIREMENTS

ONE_MASS = """
format = 1
title = "One mass"
assumptions = ["every number: a test"]

[sources]
test = "made for the tests"

[vehicle]
model = "six_dof"
freedom = ["heave"]
[vehicle.car]
mass = "10 t"
[vehicle.magnets]
count = 2
length = "0.1 m"

[forces]
model = "image"
exponent = 1
thickness = "20 mm"
conductivity = "2.5e7 S/m"
vertical_velocity = "receding_image"

[operating]
speed = "300 km/h"
height = "0.1 m"

[irregularity]
vertical = { form = "inverse_square", amplitude = "1.5e-6 m" }
band = { from = "0.5 Hz", to = "10 Hz" }

[ride]
smallest_height = "20 mm"
passenger = [{ name = "centre", x = "0 m" }]

[simulation]
duration = "2 s"
runs = 2
settle = "0.5 s"

[[option]]
name = "winding"
kind = "passive_primary"
[[option.spring_damper]]
name = "winding"
between = ["car", "guideway"]
damping = "80 kN*s/m"
"""
BARE = '\n[[option]]\nname = "bare"\nkind = "baseline"\n'
"""A second option of ONE_MASS: its magnets damp by a little less than nothing."""


def read(folder: Path, text: str) -> Scenario:
    """A text written to a folder and read back."""
    file = folder / "small.toml"
    file.write_text(text, encoding="utf-8")
    return load(file)
