"""Floquet margins of an option against scans by brute force, and what is told where there is none."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from maglev_ctrl.analysis.first_instability import PeriodicMargin
from maglev_ctrl.analysis.floquet import floquet
from maglev_ctrl.analysis.floquet_margins import FloquetMargins, scaled_controller
from maglev_ctrl.analysis.resonance import NO_RESONANCE
from maglev_ctrl.errors import Agreement, Verdict
from maglev_ctrl.report.content_periodic import floquet_margin_blocks
from maglev_ctrl.report.model import Paragraph, Table
from maglev_ctrl.report.style import ABSENT, number
from maglev_ctrl.scenario import Scenario
from maglev_ctrl.scenario.problems import ScenarioProblems
from maglev_ctrl.study import OptionStudy
from maglev_ctrl.study.floquet_margins import LOST, NO_CONTROLLER, NOT_ASKED, UNFORCED, option_margins
from maglev_ctrl.study.forcing import Forcing
from maglev_ctrl.study.law import design_law
from maglev_ctrl.study.option import study_option
from maglev_ctrl.study.requirements_periodic import nearest
from maglev_ctrl.study.situation import OptionModel
from maglev_ctrl.systems import Controller, at_depth

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


# ---- requirements and report -----------------------------------------------------------------------------------------


def margin(bound: str, safe: float, unsafe: float = math.nan, *, resolved: bool = True) -> PeriodicMargin:
    agreement = Agreement.AGREED if resolved else Agreement.UNRESOLVED
    return PeriodicMargin(
        "speed", 100.0, 200.0, safe, unsafe, bound, agreement, NO_RESONANCE, False, 1.0, (), 9, "why"  # type: ignore[arg-type]
    )  # fmt: skip


EXACT, FAR, NEAR = margin("exact", 110.0, 110.0), margin("lower", 160.0), margin("lower", 60.0)
MOST, DOUBT = margin("upper", 100.0, 105.0), margin("lower", math.nan, resolved=False)


@pytest.mark.parametrize(
    ("pair", "value", "bound"),
    [
        ((EXACT, FAR), 0.1, "exact"),
        ((NEAR, FAR), 0.4, "lower"),
        ((margin("lower", 95.0), EXACT), 0.05, "lower"),
        ((MOST, EXACT), 0.05, "upper"),
        ((MOST, DOUBT), 0.05, "upper"),
        ((EXACT, DOUBT), 0.1, "upper"),
    ],
)
def test_the_smaller_of_two_margins_is_never_told_as_more_than_it_is(
    pair: tuple[PeriodicMargin, PeriodicMargin], value: float, bound: str
) -> None:
    found = nearest(pair, lambda v: abs(v / 100.0 - 1.0), str)
    assert (round(found.value, 12), found.bound) == (value, bound)


def test_no_margin_comes_from_doubt_alone() -> None:
    assert math.isnan(nearest((FAR, DOUBT), lambda v: abs(v / 100.0 - 1.0), str).value)


@pytest.fixture(scope="module")
def asked(small_scenario: Callable[..., Scenario], small_text: str) -> OptionStudy:
    wanted = '[[requirement]]\nname = "{0}"\nquantity = "{0}"\nat_least = {1}\n'
    text = weak(small_text, depth=DEPTH) + wanted.format("floquet_gain_margin", '"6 dB"')
    scenario = small_scenario(text + wanted.format("floquet_speed_margin", "0.1"))
    return study_option(scenario, scenario.options[1])


def test_requirements_are_judged_on_the_margins(asked: OptionStudy) -> None:
    assert asked.floquet is not None and asked.floquet.margins is not None and asked.floquet.margins.speed is not None
    judged = {one.quantity: one for one in asked.requirements}
    speed = judged["floquet_speed_margin"]
    lost = asked.floquet.margins.speed[1]
    assert speed.verdict is Verdict.FAIL and speed.bound == "exact"
    assert speed.value == pytest.approx(lost.safe / lost.nominal - 1.0)
    assert lost.tongue.name in speed.reason
    gain = judged["floquet_gain_margin"]
    assert gain.verdict is Verdict.NOT_EVALUATED and gain.reason == NO_CONTROLLER and gain.unit == "dB"


def test_the_table_shows_bracket_tongue_and_what_the_number_is(asked: OptionStudy) -> None:
    assert asked.floquet is not None and asked.floquet.margins is not None
    found = asked.floquet.margins
    table, missing = floquet_margin_blocks("Damper", found, asked.floquet.margins_reason, expected_depth=DEPTH)
    assert isinstance(table, Table) and isinstance(missing, Paragraph) and "no controller" in missing.text
    rows = {line[0].text: [cell.text for cell in line] for line in table.rows}
    assert list(rows) == ["Depth of modulation", "Speed down", "Speed up"]
    depth = rows["Depth of modulation"]
    shown, half = (float(part.split()[0]) for part in depth[1].split("±"))
    # what is told holds the bracket
    assert shown - half <= 100.0 * found.depth.safe < 100.0 * found.depth.unsafe <= shown + half and half < 1e-2
    assert depth[2] == f"factor {number(found.depth.safe / DEPTH)}"
    assert depth[3] == "exact" and found.depth.tongue.name in depth[4]
    assert rows["Speed down"][3] == "at least" and rows["Speed down"][1].startswith("none as far as 60.0 km/h")
    halved = replace(EXACT, quantity="gain factor", nominal=1.0, safe=0.5, unsafe=0.4999)
    gained = floquet_margin_blocks("LQR", replace(found, gain=(halved, MOST)), "", expected_depth=DEPTH)[0]
    assert isinstance(gained, Table)
    assert [cell.text for cell in gained.rows[1]][:3] == ["Gain factor down", "0.49995 ± 0.00005", "−6.02 dB"]  # noqa: RUF001
    assert gained.rows[2][3].text == "at most"
    doubtful = replace(found, depth=replace(found.depth, agreement=Agreement.UNRESOLVED, reason="they differ"))
    doubt = floquet_margin_blocks("Damper", doubtful, "", expected_depth=DEPTH)[0]
    assert isinstance(doubt, Table)
    assert [cell.text for cell in doubt.rows[0]][1:5] == ["UNRESOLVED", ABSENT, ABSENT, "they differ"]
    (words,) = floquet_margin_blocks("Bare", None, UNFORCED, expected_depth=DEPTH)
    assert isinstance(words, Paragraph) and UNFORCED in words.text


def test_margins_cost_nothing_where_nobody_asks(small_scenario: Callable[..., Scenario]) -> None:
    scenario = small_scenario()
    study = study_option(scenario, scenario.options[1]).floquet
    assert study is not None and study.margins is None and study.margins_reason == NOT_ASKED


@pytest.mark.parametrize("quantity", ["floquet_gain_margin", "floquet_speed_margin"])
def test_a_margin_under_modulation_needs_periodic_forces(
    small_scenario: Callable[..., Scenario], small_text: str, quantity: str
) -> None:
    before, _, rest = small_text.partition("[periodic]")
    limit = '"6 dB"' if quantity == "floquet_gain_margin" else "0.1"
    wanted = f'[[requirement]]\nname = "asked"\nquantity = "{quantity}"\nat_least = {limit}\n'
    with pytest.raises(ScenarioProblems, match=rf"{quantity} needs the table \[periodic\]"):
        small_scenario(before + rest[rest.index("[[option]]") :] + wanted)
