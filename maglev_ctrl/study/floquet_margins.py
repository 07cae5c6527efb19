"""Floquet margins of one option: how far depth, gain or speed may go until periodic forcing makes it unstable."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from maglev_ctrl.analysis.floquet_margins import FloquetMargins, floquet_margins, scaled_controller
from maglev_ctrl.errors import MaglevError, NotStable
from maglev_ctrl.scenario.scenario_schema import Periodic
from maglev_ctrl.study.forcing import Forcing
from maglev_ctrl.study.modulation import depth_of
from maglev_ctrl.study.situation import OptionModel
from maglev_ctrl.systems import Controller, PeriodicSystem, at_depth

SAMPLES = 24
"""Scan points of each search; the tongues predicted on the way come on top."""

REACH = 0.1
"""The search over speed goes at least this share of the design speed either way, also where the map ends nearer."""

NOT_ASKED = "no requirement asks for floquet_gain_margin or floquet_speed_margin; the verb map always computes them"
UNFORCED = "no margins: unstable without modulation at the design point"
NO_CONTROLLER = "no gain margin: the option has no controller"
LOST = "no gain and speed margins: unstable at the expected depth and the design speed"


def option_margins(
    model: OptionModel, controller: Controller | None, periodic: Periodic, *, samples: int = SAMPLES
) -> tuple[FloquetMargins | None, str]:
    """Depth, gain and speed margins of an option about its design point, all on the full model, and what is missing.

    The depth is searched up to the map's largest, the speed over the map's range, the gain (of all commands at once)
    between a tenth and ten times. A place where the model has no answer ends the search and is told as such.

    Parameters
    ----------
    controller : the option's law; None leaves the gain margin out
    periodic : the scenario's periodic forcing
    samples : scan points of each search

    Returns
    -------
    the margins, None where there are none; and why something is missing ("" where nothing is)
    """
    forcing = Forcing.of(model, controller, periodic)
    design_speed, expected = model.scenario.operating.speed, depth_of(model.scenario)
    grid = periodic.map
    units: dict[tuple[float, float], PeriodicSystem] = {}

    def loop(*, depth: float, gain: float, speed: float) -> PeriodicSystem:
        key = (gain, speed)
        if key not in units:
            law = controller if controller is None or gain == 1.0 else scaled_controller(controller, gain)
            units[key] = replace(forcing, model=forcing.model.with_gain(gain), controller=law).at(speed)
        return at_depth(units[key], depth)

    try:
        found = floquet_margins(
            loop, depth=expected, speed=design_speed, largest_depth=max(grid.depth.last, expected),
            gain_limits=None if controller is None else (0.1, 10.0), samples=samples,
            speed_limits=(min(grid.speed.first, (1.0 - REACH) * design_speed),
                          max(grid.speed.last, (1.0 + REACH) * design_speed)),
        )  # fmt: skip
    except NotStable:
        return None, UNFORCED
    except (MaglevError, ValueError, np.linalg.LinAlgError) as fault:
        return None, f"{fault}"
    if found.speed is None:
        return found, LOST
    return found, NO_CONTROLLER if controller is None else ""
