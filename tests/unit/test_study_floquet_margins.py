"""Floquet margins of an option against scans by brute force, and what is told where there is none."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from maglev_ctrl.analysis.first_instability import PeriodicMargin
from maglev_ctrl.analysis.floquet import floquet
from maglev_ctrl.analysis.floquet_margins import FloquetMargins, scaled_controller
from maglev_ctrl.errors import Agreement
from maglev_ctrl.scenario import Scenario
from maglev_ctrl.study.floquet_margins import LOST, NO_CONTROLLER, UNFORCED, option_margins
from maglev_ctrl.study.forcing import Forcing, at_depth
from maglev_ctrl.study.law import design_law
from maglev_ctrl.study.situation import OptionModel
from maglev_ctrl.systems import Controller

SAMPLES = 10
DEPTH = 0.28
SCAN = 25
"""Speeds, depths or factors of a brute-force scan."""


def margins_of(
    scenario: Scenario, option: int, controller: Controller | None = None
) -> tuple[FloquetMargins | None, str, Forcing]:
    model = OptionModel(scenario, scenario.options[option])
    assert scenario.periodic is not None
    found, reason = option_margins(model, controller, scenario.periodic, samples=SAMPLES)
    return found, reason, Forcing.of(model, controller, scenario.periodic)


def weak(text: str, *, depth: float) -> str:
    """A damper too weak for the tongue w1 + w2 at 388 km/h; at the design speed, 380 km/h, it begins at depth 0.31."""
    slack = text.replace('damping = "30 kN*s/m"', 'damping = "3 kN*s/m"')
    return slack.replace('speed = "300 km/h"', 'speed = "380 km/h"').replace("depth = 0.05", f"depth = {depth}")


def agrees(margin: PeriodicMargin, stable: Callable[[float], bool | None]) -> bool:
    """Whether a scan by both engines finds the margin: stable all the way to it, unstable at it."""
    if margin.agreement is not Agreement.AGREED:
        return False
    way = np.linspace(margin.nominal, margin.safe, SCAN)
    return all(stable(float(x)) is True for x in way) and (
        margin.bound == "lower" or stable(margin.unsafe) is False
    )  # fmt: skip


def test_depth_and_speed_margins_against_brute_force(small_scenario: Callable[..., Scenario], small_text: str) -> None:
    scenario = small_scenario(weak(small_text, depth=DEPTH))
    found, reason, forcing = margins_of(scenario, 1)
    assert found is not None and found.speed is not None and found.gain is None and reason == NO_CONTROLLER
    assert (found.depth.bound, found.speed[1].bound) == ("exact", "exact")
    assert found.depth.tongue.name == found.speed[1].tongue.name
    speed = scenario.operating.speed
    unit = forcing.at(speed)
    assert agrees(found.depth, lambda e: floquet(at_depth(unit, e)).stable)
    for one in found.speed:
        assert agrees(one, lambda v: floquet(at_depth(forcing.at(v), DEPTH)).stable)


def test_a_wrong_passing_frequency_mutant_is_caught(
    small_scenario: Callable[..., Scenario], small_text: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    scenario = small_scenario(weak(small_text, depth=DEPTH))
    forcing, original = margins_of(scenario, 1)[2], Forcing.at
    monkeypatch.setattr(Forcing, "at", lambda self, speed, full=True: original(self, 0.99 * speed, full=full))
    found = margins_of(scenario, 1)[0]
    monkeypatch.undo()
    assert found is not None and found.speed is not None
    bad = [one for one in found.speed if not agrees(one, lambda v: floquet(at_depth(forcing.at(v), DEPTH)).stable)]
    assert bad


def test_gain_margins_against_brute_force(small_scenario: Callable[..., Scenario]) -> None:
    scenario = small_scenario()
    model = OptionModel(scenario, scenario.options[2])
    design = design_law(scenario, scenario.options[2], model)
    assert design is not None and scenario.periodic is not None
    law = design.controller
    found, reason, _ = margins_of(scenario, 2, law)
    assert found is not None and found.gain is not None and reason == ""
    periodic, speed = scenario.periodic, scenario.operating.speed

    def stable(factor: float) -> bool | None:
        forcing = Forcing.of(model, scaled_controller(law, factor), periodic)
        return floquet(at_depth(forcing.at(speed), periodic.depth)).stable

    for one in found.gain:
        assert agrees(one, stable)


def test_the_search_over_speed_leaves_the_design_speed_where_the_map_ends(
    small_scenario: Callable[..., Scenario], small_text: str
) -> None:
    scenario = small_scenario(small_text.replace('speed = "300 km/h"', 'speed = "400 km/h"'))
    found, _, _ = margins_of(scenario, 1)
    assert found is not None and found.speed is not None
    assert found.speed[1].limit == pytest.approx(1.1 * 400.0 / 3.6)


def test_what_has_no_margin_says_why(small_scenario: Callable[..., Scenario], small_text: str) -> None:
    assert margins_of(small_scenario(), 0)[:2] == (None, UNFORCED)
    bottom = small_scenario(weak(small_text, depth=0.45))
    found, reason, _ = margins_of(bottom, 1)
    assert found is not None and found.depth.unsafe < 0.45
    assert (found.gain, found.speed, reason) == (None, None, LOST)
