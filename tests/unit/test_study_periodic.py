"""What a resonance map is read for: critical depths and the speeds that are safe."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from maglev_ctrl.analysis.resonance_map import ResonanceMap, SeededTongue, critical_depth, resonance_map
from maglev_ctrl.scenario import Scenario
from maglev_ctrl.study.forcing import Forcing
from maglev_ctrl.study.law import design_law
from maglev_ctrl.study.periodic import UNRESOLVED, critical_depths, floquet_study, speed_ranges
from maglev_ctrl.study.situation import OptionModel
from maglev_ctrl.systems import PeriodicSystem, at_depth

ZETA = 0.01


@pytest.fixture(scope="module")
def atlas() -> ResonanceMap:
    """Damped Mathieu equation of unit frequency; the "speed" is the forcing frequency."""
    speed = np.linspace(1.6, 2.4, 81)
    A_0 = np.broadcast_to(np.array([[0.0, 1.0], [-1.0, -2.0 * ZETA]]), (81, 2, 2))
    A_1 = np.broadcast_to(np.array([[0.0, 0.0], [-1.0, 0.0]]), (81, 1, 2, 2))
    return resonance_map(A_0, A_1, 0.0 * A_1, speed, np.linspace(0.0, 0.2, 41), parameter=speed)


def test_critical_depth_at_the_principal_tongue_is_four_zeta(atlas: ResonanceMap) -> None:
    curve = critical_depths(atlas)
    centre = int(np.argmin(np.abs(atlas.parameter - 2.0)))
    # published threshold h = 0.04000087498952537 at zeta = 0.01; a depth step is 0.005, growth is nearly linear in it
    assert curve[centre] == pytest.approx(0.0400009, abs=2e-4)
    assert np.isinf(curve[0])


def test_speed_ranges_close_an_unstable_column_to_its_neighbours(atlas: ResonanceMap) -> None:
    go, no_go = speed_ranges(atlas, critical_depths(atlas), 0.1)
    ((low, high, name),) = no_go
    half_width = 0.5 * np.sqrt(0.1**2 - (4 * ZETA) ** 2)  # first order, 2 -+ sqrt(h^2 - 16 zeta^2)/2
    step = atlas.parameter[1] - atlas.parameter[0]
    assert name == "2 w1/1"
    assert 2.0 - half_width - 1.5 * step <= low <= 2.0 - half_width + 0.5 * step
    assert 2.0 + half_width - 0.5 * step <= high <= 2.0 + half_width + 1.5 * step
    assert go[0][0] == atlas.parameter[0] and go[-1][1] == atlas.parameter[-1]
    assert all(end <= low or start >= high for start, end in go)


def test_without_modulation_every_speed_is_safe(atlas: ResonanceMap) -> None:
    go, no_go = speed_ranges(atlas, critical_depths(atlas), 0.0)
    assert no_go == () and go == ((float(atlas.parameter[0]), float(atlas.parameter[-1])),)


@pytest.mark.parametrize("shown_deeper", [False, True])
def test_a_tongue_between_columns_blocks_its_column(atlas: ResonanceMap, shown_deeper: bool) -> None:
    # even where the grid shows the tongue at greater depth, at this depth it lies between the columns
    hidden = SeededTongue(parameter=1.7049, threshold=0.05, name="2 w9/1", resolved_by_grid=shown_deeper)
    seeded = replace(atlas, seeded=(hidden,))
    _, no_go = speed_ranges(seeded, critical_depths(atlas), 0.1)
    assert any(low <= 1.7049 <= high and name == "2 w9/1" for low, high, name in no_go)
    shallow = speed_ranges(seeded, critical_depths(atlas), 0.04)[1]
    assert all(name != "2 w9/1" for *_, name in shallow)


def test_scaling_the_depth_scales_the_modulation_only() -> None:
    system = PeriodicSystem.from_matrices([[0, 1], [-1, 0]], [[[0, 0], [-1, 0]]], frequency=2.0)
    scaled = at_depth(system, 0.25)
    np.testing.assert_array_equal(scaled.A_cos, 0.25 * system.A_cos)
    np.testing.assert_array_equal(scaled.A_0, system.A_0)


def test_an_unstable_start_is_named_so(atlas: ResonanceMap) -> None:
    growing = replace(atlas, unstable=np.ones_like(atlas.unstable), growth_rate=np.abs(atlas.growth_rate) + 1.0)
    _, no_go = speed_ranges(growing, critical_depths(growing), 0.0)
    assert [name for *_, name in no_go] == ["unstable without modulation"]


def test_the_worst_depth_is_the_bottom_between_the_columns(small_scenario: Callable[..., Scenario]) -> None:
    """The deepest point over speed is not above the depth at any speed near it, on the full model."""
    scenario = small_scenario()
    weak = scenario.options[1].model_copy(
        update={
            "spring_dampers": tuple(s.model_copy(update={"damping": 3.0e3}) for s in scenario.options[1].spring_dampers)
        }
    )
    model = OptionModel(scenario, weak)
    study = floquet_study(model, None)
    assert 0.0 < study.worst_depth < study.largest_depth
    assert study.worst_depth <= np.min(study.critical_depth) * (1.0 + 1e-3)
    forcing = Forcing.of(model, None, scenario.periodic)
    for factor in (0.997, 0.999, 1.001, 1.003):
        beside = critical_depth(forcing.at(study.worst_speed * factor), depth_max=study.largest_depth).depth
        assert study.worst_depth <= beside * (1.0 + 1e-3)


def test_a_tongue_at_the_edge_of_the_map_is_not_overlooked(
    small_scenario: Callable[..., Scenario], small_text: str
) -> None:
    """A map that begins inside a narrow tongue, whose bottom lies between its first two columns."""
    weak = small_text.replace('damping = "30 kN*s/m"', 'damping = "3 kN*s/m"')
    wide = small_scenario(weak)
    bottom = floquet_study(OptionModel(wide, wide.options[1]), None)
    start = 3.6 * bottom.worst_speed - 0.8
    grid = f'{{ from = "{start:.4f} km/h", to = "{start + 120.0:.4f} km/h", count = 9 }}'
    edge = small_scenario(
        weak.replace('map = { speed = { from = "60 km/h", to = "400 km/h", count = 24 }', f"map = {{ speed = {grid}")
    )
    found = floquet_study(OptionModel(edge, edge.options[1]), None)
    assert found.worst_depth == pytest.approx(bottom.worst_depth, rel=1e-3)


def test_depths_always_hold_none_and_the_expected_one(small_scenario: Callable[..., Scenario], small_text: str) -> None:
    shifted = small_scenario(small_text.replace("from = 0.0, to = 0.5, count = 11", "from = 0.1, to = 0.2, count = 3"))
    study = floquet_study(OptionModel(shifted, shifted.options[0]), None)
    assert study.map.depths[0] == 0.0
    assert study.worst_depth == 0.0 and study.go_ranges == ()
    deep = small_scenario(small_text.replace("depth = 0.05", "depth = 0.7"))
    assert floquet_study(OptionModel(deep, deep.options[1]), None).map.depths[-1] == 0.7


def test_unresolved_columns_are_no_go(atlas: ResonanceMap) -> None:
    doubt = np.zeros_like(atlas.unresolved)
    doubt[3] = True
    go, no_go = speed_ranges(replace(atlas, unresolved=doubt), critical_depths(atlas), 0.0)
    assert [name for *_, name in no_go] == [UNRESOLVED]
    assert all(not low < atlas.parameter[3] < high for low, high in go)


@pytest.mark.parametrize(("delay", "merged"), [("2 ms", True), ("60 ms", False), ("0 ms", False)])
def test_only_short_delays_are_merged_into_a_lag(
    small_scenario: Callable[..., Scenario], small_text: str, delay: str, merged: bool
) -> None:
    scenario = small_scenario(small_text.replace('delay = "2 ms"', f'delay = "{delay}"'))
    model = OptionModel(scenario, scenario.options[2])
    design = design_law(scenario, scenario.options[2], model)
    assert design is not None and scenario.periodic is not None
    assert Forcing.of(model, design.controller, scenario.periodic).merged is merged
