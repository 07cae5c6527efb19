"""Where every candidate is judged: the design point, the ends of the sweeps, and speeds between."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from maglev_ctrl.scenario import Scenario
from maglev_ctrl.study.records import SweepName
from maglev_ctrl.study.ride import SPEEDS
from maglev_ctrl.study.situation import Situation
from maglev_ctrl.study.sweeps import DISPLAY, sweep_values, varied

SPEEDS_BETWEEN: Final = SPEEDS - 2
"""Speeds between the ends of the sweep, those at which the full study looks at the ride; margins are not read there."""
ALWAYS: Final = ("speed", "payload")
"""Sweeps whose ends every candidate is judged at; those of others only where a requirement asks for them."""


@dataclass(frozen=True, slots=True)
class Place:
    """One situation of the operating set.

    `scopes`: the sweeps it belongs to, the design point to all; `inner`: between the ends of the speed sweep.
    """

    name: str
    situation: Situation
    scopes: tuple[str, ...]
    inner: bool = False


def operating_set(scenario: Scenario) -> tuple[Place, ...]:
    """The design point first, then the ends of the sweeps, then speeds between.

    Examples
    --------
    >>> from maglev_ctrl.scenario import load
    >>> [place.name for place in operating_set(load("scenarios/compare/eds_135t.toml"))][:4]
    ['design point', 'speed 100 km/h', 'speed 600 km/h', 'payload 0 t']
    """
    design = Situation.of_design(scenario)
    asked = {one.over for one in scenario.judged if one.hard}
    own = {
        "speed": design.speed, "payload": scenario.vehicle.car.payload, "height": design.height, "gap": design.gap,
        "lateral_offset": design.lateral_offset,
    }  # fmt: skip
    swept = [(name, values) for name, values in sweep_values(scenario) if name in ALWAYS or name in asked]
    places = [Place("design point", design, ("nominal", *(name for name, _ in swept)))]
    places += [
        _place(design, name, float(value))
        for name, values in swept
        for value in (values[0], values[-1])
        if float(value) != own[name]
    ]
    for name, values in swept:
        if name == "speed":
            between = np.linspace(values[0], values[-1], SPEEDS_BETWEEN + 2)[1:-1]
            places += [replace(_place(design, name, float(v)), inner=True) for v in between if float(v) != design.speed]
    return tuple(places)


def _place(design: Situation, name: SweepName, value: float) -> Place:
    unit, scale = DISPLAY[name]
    words = f"{name.replace('_', ' ')} {value * scale:.4g} {unit}"
    return Place(words, varied(design, name, value), (name,))
