"""Perfectly conducting corner: the forces and stiffnesses of an independent mutual-inductance computation."""

from __future__ import annotations

import numpy as np
import pytest

from maglev_ctrl.forces.corner_image import CornerImageForce

MAGNET = CornerImageForce(6000.0, length=50.8e-3, width=25.4e-3, thickness=6.35e-3)
# height m; lift, guidance, k_ll, k_lg, k_gg at a gap of 12.7 mm, from closed-form filament mutuals
EXPECTED = {
    0.015: (5.961448507293618, 3.6283961953220003, -838.9785779647217, 22.717157053056543, -631.5046247387655),
    0.025: (1.8742132151812472, 3.480017538031593, -179.38088917035518, -28.855324089339934, -550.5376287837092),
}
TOLERANCE = 2e-4  # stated with the values


def found(magnet: CornerImageForce, height: float) -> tuple[float, ...]:
    forces, partials = magnet.forces(height, 0.0127, 36.0), magnet.derivatives(height, 0.0127, 36.0)
    return (
        float(forces.lift), float(forces.guidance), float(partials.by_height.lift), float(partials.by_gap.lift),
        float(partials.by_gap.guidance),
    )  # fmt: skip


@pytest.mark.parametrize("height", EXPECTED)
def test_forces_and_stiffnesses(height: float, record_property) -> None:
    record_property("error", float(np.max(np.abs(found(MAGNET, height) / np.array(EXPECTED[height]) - 1.0))))
    record_property("allowed", TOLERANCE)
    np.testing.assert_allclose(found(MAGNET, height), EXPECTED[height], rtol=TOLERANCE)


def test_a_mutant_with_length_and_width_swapped_is_caught() -> None:
    mutant = CornerImageForce(6000.0, length=25.4e-3, width=50.8e-3, thickness=6.35e-3)
    assert not np.allclose(found(mutant, 0.015), EXPECTED[0.015], rtol=0.01)


def test_partials_are_the_slopes_of_the_forces() -> None:
    h, g, step = 0.021, 0.0083, 1e-6
    partials = MAGNET.derivatives(h, g, 0.0)
    up, down = MAGNET.forces(h + step, g, 0.0), MAGNET.forces(h - step, g, 0.0)
    wide, narrow = MAGNET.forces(h, g + step, 0.0), MAGNET.forces(h, g - step, 0.0)
    for name in ("lift", "guidance"):
        by_height = (getattr(up, name) - getattr(down, name)) / (2 * step)
        by_gap = (getattr(wide, name) - getattr(narrow, name)) / (2 * step)
        assert getattr(partials.by_height, name) == pytest.approx(float(by_height), rel=1e-6)
        assert getattr(partials.by_gap, name) == pytest.approx(float(by_gap), rel=1e-6)


def test_the_field_is_conservative() -> None:
    partials = MAGNET.derivatives(0.019, 0.0127, 0.0)
    assert float(partials.by_gap.lift) == float(partials.by_height.guidance)


def test_guidance_has_its_maximum_where_the_corner_begins() -> None:
    heights = np.linspace(0.012, 0.022, 2001)
    guidance = MAGNET.forces(heights, 0.0127, 0.0).guidance
    assert heights[np.argmax(guidance)] == pytest.approx(16.89e-3, abs=5e-6)
