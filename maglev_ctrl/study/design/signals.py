"""SI units of the signals a law reads and drives, for people who connect it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from maglev_ctrl.scenario import OptionRecord, Scenario
from maglev_ctrl.scenario.layout import layout, outputs_of
from maglev_ctrl.scenario.units import Dimensions, dimensions_of

_ENDINGS: Final = ((".current", "A"), (".voltage", "V"), (".rate", "m/s"), (".velocity", "m/s"), (".force", "N"))
_UNITS: Final = ("m", "m/s", "m/s^2", "rad/s", "rad/s^2", "N", "A", "V")


def signal_units(
    scenario: Scenario, option: OptionRecord, measured: Sequence[str], commands: Sequence[str]
) -> dict[str, str]:
    """SI unit of every signal whose unit is known, by its name; the others are left out.

    Parameters
    ----------
    measured, commands : names as a controller has them
    """
    known = {
        name: dimensions
        for dimensions, members in outputs_of(option, layout(scenario.vehicle)).values()
        for name in members
    }
    found: dict[str, str] = {}
    for name in measured:
        unit = _of(known[name]) if name in known else ""
        unit = unit or next((unit for ending, unit in _ENDINGS if name.endswith(ending)), "")
        if unit:
            found[name] = unit
    return found | {name: "V" if name.endswith(".voltage") else "N" for name in commands}


def _of(dimensions: Dimensions) -> str:
    if not dimensions:
        return "rad"
    return next((unit for unit in _UNITS if dimensions_of(unit) == dimensions), "")
