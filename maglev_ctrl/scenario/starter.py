"""The scenario file `maglev-ctrl new` writes: small, commented, and complete enough to run."""

from __future__ import annotations

import json

_TEMPLATE = """\
# A scenario of maglev-ctrl: one vehicle, the suspension options to compare, and what they must reach.
#   maglev-ctrl check  FILE.toml      says what is wrong, with line and column
#   maglev-ctrl report FILE.toml      computes everything and writes the report
#   maglev-ctrl design FILE.toml      the control laws alone, each with what is proved of it
#   maglev-ctrl schema                prints the whole format as a JSON Schema
#
# Every quantity is a text with its unit: "12.7 mm", "88 t", "500 km/h", "40 kN*s/m", "0.01 m/s^2/Hz^0.5".
# Only ratios and counts are plain numbers. Axes: x forward, y left, z up.
format = 1
title = @TITLE@
description = "A car on two bogies; replace every number by your own."
assumptions = ["All numbers of this file are examples."]    # printed in the report

[sources]                             # where your numbers come from; printed in the report
example = "starter file of maglev-ctrl"

# ------------------------------------------------------------------------------------------------- vehicle
[vehicle]
model = "two_stage"                   # heave_surge | heave_pitch_surge | six_dof | double_l | two_stage
freedom = ["heave", "pitch"]          # of the car body, out of surge sway heave roll pitch yaw

[vehicle.car]
mass = "20 t"                         # without payload
payload = "5 t"                       # at the design point
pitch_inertia = "8e5 kg*m^2"          # needed because pitch is free
centre_height = "0 m"                 # of the CM above the secondary suspension plane

[[vehicle.bogie]]                     # as many as there are
name = "front"
mass = "3 t"
position = "8 m"                      # forward of the car's centre
freedom = ["heave"]
[[vehicle.bogie]]
name = "rear"
mass = "3 t"
position = "-8 m"
freedom = ["heave"]

[vehicle.secondary]                   # spring and damper between car and each bogie, in every option
stiffness = "300 kN/m"
damping = "0 kN*s/m"

[vehicle.magnets]                     # of each bogie, both sides together
count = 4
length = "6 m"                        # over which they are spread
half_gauge = "1.2 m"

[vehicle.aerodynamics]                # may be left out
drag = "10 kN"
drag_speed = "400 km/h"

# -------------------------------------------------------------------------------------------------- forces
[forces]
model = "image"                       # image | eddy_current (any guideway) | table (CSV) | coefficients
exponent = 1                          # 1 for a wide sheet; 1/2, 1/3, 1/5 for narrower coils
thickness = "20 mm"                   # of the conducting sheet
conductivity = "2.5e7 S/m"
vertical_velocity = "receding_image"  # lift depends on vertical velocity: negative damping at speed; or "none"
# model = "table"                     # measured forces of one magnet, in a file beside this one with the header
# file = "forces.csv"                 #   height [mm], gap [mm], speed [m/s], lift [N], guidance [N], drag [N]
# method = "spline"                   # spline (regular grid) | polynomial (scattered points)

# ----------------------------------------------------------------------------------------------- operating
[operating]
speed = "400 km/h"                    # design point
height = "0.10 m"
hold = "height"                       # height: lift is trimmed to the weight at this height | strength
sweep.speed = { from = "60 km/h", to = "450 km/h", count = 15 }    # the map below covers the same speeds
sweep.payload = { from = "0 t", to = "5 t", count = 3 }

[periodic]                            # may be left out: no resonance map then
wavelength = "25 m"                   # girder span: stiffness changes as the girders pass
depth = 0.05                          # expected change, a fraction of the magnetic stiffness
# or, in place of both, [[periodic.source]] tables: girders that sag, joints, segment profiles, coil pitch
map = { speed = { from = "60 km/h", to = "450 km/h", count = 25 }, depth = { from = 0.0, to = 0.5, count = 25 } }

# ------------------------------------------------------------------------------------------------- options
[[option]]
name = "bare"
label = "No added suspension"
kind = "baseline"  # baseline | passive_primary | active_primary | passive_secondary | active_secondary | combined

[[option]]
name = "damper_windings"
label = "Damper windings"
kind = "passive_primary"
[[option.spring_damper]]
name = "winding"
between = ["bogies", "guideway"]      # "bogies": one on each; or "car", "front", "rear"
damping = "30 kN*s/m"
lag = "10 ms"                         # L/R of a shorted coil; may be left out

[[option]]
name = "active_secondary"
label = "Active secondary"
kind = "active_secondary"
[[option.actuator]]
name = "cylinder"
between = ["car", "bogies"]
force_limit = "20 kN"
bandwidth = "20 Hz"
delay = "2 ms"
[[option.sensor]]
name = "car_acceleration"
kind = "acceleration"                 # gap | stroke | velocity | acceleration
on = "car"
at = "bogies"                         # one above each bogie
noise = "0.01 m/s^2/Hz^0.5"
[[option.sensor]]
name = "stroke"
kind = "stroke"
on = "car"
to = "bogies"
noise = "0.1 mm/Hz^0.5"
[option.control]
law = "lqg"                           # lqr | lqi | lqg | h2 | h_infinity | multi_objective | output_feedback | mpc |
                                      # scheduled | damping | sky_hook (damping = "...", sensor = a velocity sensor)
allowed = [                           # the largest value you would accept of each
  { output = "car.heave.acceleration", value = "0.5 m/s^2" },
  { output = "magnet_gap", value = "10 mm" },               # the gaps of all magnets
  { actuator = "cylinder", value = "5 kN" },
]
disturbance = "0.5 m/s^2/Hz^0.5"      # what shakes the bodies; not for lqr, lqi, scheduled, mpc
# law = "h_infinity"                  # in place of lqg: the least gain at the worst frequency, from the same sensors
# feedback = "sensors"                #   (or "states"); command_disturbance buys margins, for larger norms
# command_disturbance = 0.1

# -------------------------------------------------------------------------------------------- requirements
[[requirement]]
name = "stable"
quantity = "growth_rate"
at_most = "0 1/s"
over = "speed"                        # worst point of this sweep; or "nominal": at the design point
[[requirement]]
name = "damping"
quantity = "damping_ratio"
at_least = 0.02
[[requirement]]
name = "gain_margin"
quantity = "gain_margin"              # also phase_margin "30 deg", delay_margin "5 ms"
at_least = "6 dB"
[[requirement]]
name = "disk"
quantity = "disk_margin"              # all loops at once
at_least = 0.4
[[requirement]]
name = "modulation"
quantity = "modulation_ratio"         # modulation depth survived over the expected depth
at_least = 2.0
[[requirement]]
name = "overspeed"
quantity = "speed_margin"             # distance to instability, a fraction of the design speed
at_least = 0.10

# ------------------------------------------------------------------- ride, worst cases, tuning: remove the # to use
# [irregularity]                      # how rough the guideway is: ride, gaps and power of actuators
# vertical = { form = "inverse_square", amplitude = "1.5e-6 m" }
# band = { from = "0.1 Hz", to = "50 Hz" }   # without it a gap's velocity has no variance, and contacts no rate
# [ride]
# smallest_height = "0.05 m"          # where a magnet touches
# [uncertainty]                       # how far parameters may be off: stable for all of them?
# magnetic_force = "5 %"
# [tuning]                            # `compare` then chooses the values that an option names, e.g. below the windings:
# objectives = ["ride", "gap"]        #   [[option.tune]]
#                                     #   value = "spring_damper.winding.damping"
#                                     #   from = "1 kN*s/m"
#                                     #   to = "100 kN*s/m"
# Sets of requirements from practice go to the top of the file: packs = ["classical_margins", "ride_iso_2631", "gap"]
"""


def starter_text(title: str) -> str:
    """A commented scenario that passes `check`, with a title of one's own.

    Examples
    --------
    >>> starter_text("My train").splitlines()[9]
    'title = "My train"'
    """
    return _TEMPLATE.replace("@TITLE@", json.dumps(title, ensure_ascii=False))
