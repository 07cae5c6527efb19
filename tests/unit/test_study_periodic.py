"""What a resonance map is read for: critical depths and the speeds that are safe."""

from __future__ import annotations

import numpy as np
import pytest

from maglev_ctrl.analysis.resonance_map import ResonanceMap, SeededTongue, resonance_map
from maglev_ctrl.study.periodic import at_depth, critical_depths, speed_ranges
from maglev_ctrl.systems import PeriodicSystem

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


def test_a_tongue_between_columns_blocks_its_column(atlas: ResonanceMap) -> None:
    from dataclasses import replace

    hidden = SeededTongue(parameter=1.7049, threshold=0.05, name="2 w9/1", resolved_by_grid=False)
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
