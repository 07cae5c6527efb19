"""Words about resonance maps: short names, tips, and never a safe-sounding sentence about an unresolved depth."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import pytest

from maglev_ctrl.report.charts_periodic import resonance_words, short_words, tongue_tips
from maglev_ctrl.report.findings import _resonance
from maglev_ctrl.scenario import Scenario
from maglev_ctrl.study import FloquetStudy, OptionStudy
from maglev_ctrl.study.option import study_option


@pytest.fixture(scope="module")
def studied(small_scenario: Callable[..., Scenario]) -> OptionStudy:
    scenario = small_scenario()
    return study_option(scenario, scenario.options[1])


def periodic(studied: OptionStudy) -> FloquetStudy:
    assert studied.floquet is not None
    return studied.floquet


@pytest.mark.parametrize(
    ("name", "short"),
    [
        ("2 w1/1 (car heave)", "2 w1"),
        ("2 w1/2 (car heave)", "2 w1/2"),
        ("(w1 + w2)/1 (car heave, car pitch)", "w1 + w2"),
        ("(w2 - w1)/2 (car heave, car pitch)", "(w2 - w1)/2"),
        ("none", "no resonance: unstable by itself"),
        ("unstable without modulation", "unstable without modulation"),
    ],
)
def test_short_names(name: str, short: str) -> None:
    assert short_words(name) == short


def test_an_unresolved_depth_is_never_told_as_survived(studied: OptionStudy) -> None:
    doubtful = replace(periodic(studied), worst_depth=math.nan)
    assert "UNRESOLVED" in resonance_words("Damper", doubtful)
    (sentence,) = _resonance(replace(studied, floquet=doubtful))
    assert "UNRESOLVED" in sentence and "up to" not in sentence


def test_a_survived_range_is_told_as_such(studied: OptionStudy) -> None:
    safe = replace(periodic(studied), worst_depth=math.inf)
    assert "UNRESOLVED" not in resonance_words("Damper", safe)


def test_tips_come_lowest_first_and_once(studied: OptionStudy) -> None:
    tips = tongue_tips(periodic(studied))
    assert [low for _, low, _ in tips] == sorted(low for _, low, _ in tips)
    assert len({name for name, *_ in tips}) == len(tips)
