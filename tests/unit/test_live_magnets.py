"""The loop over speed from the magnets and the air alone is the loop assembled in full."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from maglev_ctrl.scenario import load
from maglev_ctrl.study import solve_forces
from maglev_ctrl.study.live.designed import designed
from maglev_ctrl.study.live.level_magnets import LevelMagnets
from maglev_ctrl.study.live.speeds import _Source
from maglev_ctrl.study.situation import Situation

SCENARIOS = Path(__file__).resolve().parents[2] / "scenarios"


def source(name: str, option: str) -> _Source:
    scenario = solve_forces(load(SCENARIOS / f"{name}.toml"))
    return _Source(designed(scenario, option), Situation.of_design(scenario))


@pytest.mark.parametrize(
    ("name", "option"),
    [("compare/eds_135t", "combined"), ("periodic/girder_passing", "windings"), ("paper/heave_surge", "bare")],
)
def test_magnets_alone_give_the_loop_of_the_whole_assembly(name: str, option: str) -> None:
    made = source(name, option)
    assert made._level is not None
    for speed in (20.0, 60.0, 150.0):
        exact = made.exact(speed)
        assert np.max(np.abs(made(speed) - exact)) <= 1e-12 * np.max(np.abs(exact))
        entry = np.abs(exact) + 1e-9 * np.max(np.abs(exact))
        assert np.max(np.abs(made(speed) - exact) / entry) <= 1e-9


def test_currents_that_are_not_trimmed_anew_are_seen() -> None:
    made = source("compare/eds_135t", "combined")
    level, exact = made._level, made.exact(60.0)
    assert level is not None
    made._level = replace(level, lift=1.001 * level.lift)
    assert np.max(np.abs(made(60.0) - exact) / (np.abs(exact) + 1e-9 * np.max(np.abs(exact)))) > 1e-4


def test_magnets_that_cannot_lift_leave_the_answer_to_the_whole_assembly() -> None:
    made = source("periodic/girder_passing", "windings")
    assert isinstance(made._level, LevelMagnets)
    assert made._level(0.0) is None
