"""The worst place of a sweep lies between its points as often as on them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from maglev_ctrl.scenario import Scenario
from maglev_ctrl.study.situation import OptionModel, Situation
from maglev_ctrl.study.sweeps import least_damping, sweep, varied, worst_places


def test_the_largest_growth_of_the_bare_vehicle_is_found_between_coarse_points(
    small_scenario: Callable[..., Scenario],
) -> None:
    """Receding images: -c = F w (v^2 - w^2)/(v^2 + w^2)^2 with F = mg (v^2 + w^2)/v^2 peaks near sqrt(3) w."""
    scenario = small_scenario()
    model = OptionModel(scenario, scenario.options[0])
    w = 2.0 / (4e-7 * np.pi * 2.5e7 * 0.02)
    speeds = np.linspace(0.5 * w, 40.0 * w, 8)
    coarse = sweep(model, None, parameter="speed", values=speeds)
    v = np.linspace(0.5 * w, 40.0 * w, 100_001)
    best = v[np.argmax(w * (v**2 - w**2) / (v**2 * (v**2 + w**2)))]
    places = worst_places(model, None, coarse)
    assert min(abs(place - best) for place in places) < 0.05 * w
    assert min(abs(speeds - best)) > 0.5 * w  # no sample of the sweep itself comes near


def test_ends_belong_to_the_worst_places(small_scenario: Callable[..., Scenario]) -> None:
    scenario = small_scenario()
    model = OptionModel(scenario, scenario.options[1])
    values = np.linspace(20.0, 110.0, 5)
    one = sweep(model, None, parameter="speed", values=values)
    places = worst_places(model, None, one)
    assert {20.0, 110.0} <= set(places)


def test_tracks_and_damping_belong_to_the_situation(small_scenario: Callable[..., Scenario]) -> None:
    from maglev_ctrl.analysis.modes import modes

    scenario = small_scenario()
    model = OptionModel(scenario, scenario.options[1])
    one = sweep(model, None, parameter="payload", values=np.array([0.0, 1500.0, 3000.0]))
    situation = varied(Situation.of_design(scenario), "payload", 1500.0)
    found = modes(model.closed_of(model.vehicle(1500.0), situation, None))
    assert one.abscissa[1] == found.spectral_abscissa
    assert one.least_damping[1] == least_damping(found)
    assert one.abscissa[0] != one.abscissa[2]
