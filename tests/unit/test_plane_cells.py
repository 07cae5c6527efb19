"""Maps where not every pixel is computed: no tongue wider than two pixels is lost, wherever it lies on the grid."""

from __future__ import annotations

import numpy as np
import pytest

import maglev_ctrl.analysis.plane_cells as cells_module
from maglev_ctrl.analysis.plane_records import STABLE, UNSTABLE, MapAxis, PeriodicFamily, StabilityPlane
from maglev_ctrl.analysis.resonance import hsu_tongues
from maglev_ctrl.analysis.stability_plane import stability_plane
from maglev_ctrl.systems import PeriodicSystem, SecondOrderSystem, modulate

STEP = 0.005
COUNT = 97
OFFSETS = np.arange(0.0, 8.0, 0.9)  # pixels: one distance of computed points, in steps that fit no grid


def mathieu(width: float, order: int) -> tuple[PeriodicFamily, float]:
    """A tongue of the given full width in W at 2/order, the same at every value of the other parameter.

    First: e/2 from edge to edge for w = 1 and stiffness 1 + e cos W t is 2 (e/4) 2 = e; second, a2 - b2 = q^2/2 with
    a = 4/W^2, q = 2 e/W^2: W from 1 - 5 e^2/24 to 1 + e^2/24, so e^2/4. The damping is small against either.
    """
    depth = width if order == 1 else 2.0 * np.sqrt(width)

    def family(W: float, damping: float) -> PeriodicSystem:
        return PeriodicSystem.from_matrices([[0, 1], [-1, -damping]], [[[0, 0], [-depth, 0]]], frequency=W)

    return family, 2.0 / order


def combination(width: float) -> tuple[PeriodicFamily, float]:
    """A sum tongue (w1 + w2) of the given full width by Hsu's result, light damping."""
    K, K_1 = np.diag([1.0, 2.89]), np.array([[0.0, 0.4], [0.3, 0.0]])
    unit = next(t for t in hsu_tongues(np.eye(2), K, K_1, depth=1.0) if t.resonance.kind == "sum")
    depth = 0.5 * width / unit.half_width

    def family(W: float, damping: float) -> PeriodicSystem:
        system = SecondOrderSystem.from_matrices(np.eye(2), np.diag([damping, damping]), K)
        return modulate(system, depth * K_1[None], frequency=W)

    return family, unit.centre


def mapped(family: PeriodicFamily, centre: float, offset: float, step: float = STEP) -> StabilityPlane:
    start = centre - (0.5 * COUNT + offset) * step
    x = MapAxis("W", start + step * np.arange(COUNT), reciprocal=True)
    y = MapAxis("damping", np.linspace(2e-5, 6e-5, 20))
    return stability_plane(family, x, y, coverage="adaptive", checks=0)


def test_parametric_tongue_of_known_width_is_found_at_every_offset() -> None:
    family, centre = mathieu(2.5 * STEP, 1)
    for offset in OFFSETS:
        found = mapped(family, centre, offset)
        inside = np.abs(found.x.values - centre) < 0.5 * 2.4 * STEP
        assert np.count_nonzero(inside) >= 2
        assert np.all(found.state[inside] == UNSTABLE)
        outside = np.abs(found.x.values - centre) > 0.5 * 2.6 * STEP
        assert np.all(found.state[outside] == STABLE)
        assert found.missed_width == pytest.approx(2.0 * STEP)


def test_second_order_tongue_of_known_width_is_found_at_every_offset() -> None:
    width = 2.5 * STEP
    family, _ = mathieu(width, 2)
    middle = 1.0 - width / 3.0  # e^2 = 4 width, centred at 1 - e^2/12
    for offset in OFFSETS:
        found = mapped(family, middle, offset)
        inside = np.abs(found.x.values - middle) < 0.5 * 2.1 * STEP
        assert np.count_nonzero(inside) >= 2
        assert np.all(found.state[inside] == UNSTABLE)


def test_combination_tongue_of_known_width_is_found_at_every_offset() -> None:
    family, centre = combination(2.5 * STEP)
    for offset in OFFSETS:
        found = mapped(family, centre, offset)
        inside = np.abs(found.x.values - centre) < 0.5 * 2.4 * STEP
        assert np.all(found.state[inside] == UNSTABLE)
        assert not np.all(found.state == UNSTABLE)


def test_without_the_resonances_mutant_is_caught(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cells_module, "hiding", lambda multipliers, *args: np.zeros(len(multipliers), dtype=bool))
    family, centre = mathieu(2.5 * STEP, 1)
    lost = 0
    for offset in OFFSETS:
        found = mapped(family, centre, offset)
        lost += int(not np.any(found.state == UNSTABLE))
    assert lost >= 2


@pytest.mark.parametrize("rule", ["_meeting", "_crossed"])
def test_either_rule_alone_finds_the_tongue(rule: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Meeting multipliers and crossing lines of the mean system each see a first-order tongue for themselves."""
    monkeypatch.setattr(cells_module, rule, lambda multipliers, *args: np.zeros(len(multipliers), dtype=bool))
    family, centre = mathieu(2.5 * STEP, 1)
    for offset in OFFSETS[::3]:
        found = mapped(family, centre, offset)
        inside = np.abs(found.x.values - centre) < 0.5 * 2.4 * STEP
        assert np.all(found.state[inside] == UNSTABLE)


def test_adaptive_map_equals_the_full_one_and_costs_less() -> None:
    system = SecondOrderSystem.from_matrices(np.eye(2), np.diag([0.02, 0.03]), np.diag([1.0, 2.89]))
    A_0 = system.state_matrix()
    A_1 = system.modulated_state_matrix(np.array([[0.5, 0.4], [0.3, 0.6]]))

    def family(W: float, depth: float) -> PeriodicSystem:
        return PeriodicSystem.from_matrices(A_0, depth * A_1[None], frequency=W)

    x = MapAxis("W", np.linspace(1.2, 3.9, 400), reciprocal=True)
    y = MapAxis("depth", np.linspace(0.0, 0.5, 300), linear=True)
    full = stability_plane(family, x, y, coverage="every", checks=0)
    found = stability_plane(family, x, y, coverage="adaptive", checks=0)
    assert np.array_equal(found.state, full.state)
    assert found.evaluated < 0.5 * full.evaluated
    assert np.count_nonzero(~found.interpolated) == found.evaluated
    computed = ~found.interpolated
    apart = np.abs(found.growth - full.growth)
    assert np.all(apart[computed] <= (found.growth_error + full.growth_error)[computed])
    assert np.array_equal(np.isnan(found.growth_error), found.interpolated)  # no bound is claimed for these
    # filled-in growth misses ridges that stay stable, but never the sign
    assert np.array_equal(np.sign(found.growth), np.sign(full.growth))
    assert np.median(apart[found.interpolated]) < 1e-4 * np.ptp(full.growth)
    assert stability_plane(family, x, y, checks=0).evaluated == full.evaluated  # auto: all pixels of a small map


def test_auto_leaves_pixels_out_of_a_large_map(monkeypatch: pytest.MonkeyPatch) -> None:
    import maglev_ctrl.analysis.stability_plane as plane_module

    monkeypatch.setattr(plane_module, "MANY_PIXELS", 100)
    family, _ = mathieu(0.2, 1)
    x = MapAxis("W", np.linspace(2.3, 3.0, 60), reciprocal=True)
    found = stability_plane(family, x, MapAxis("damping", np.linspace(0.02, 0.1, 60)))
    assert np.any(found.interpolated)
    assert len(found.checked) > 0
