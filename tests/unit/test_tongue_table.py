"""Tongues as a table: exact edges, onset, cause and sign condition; nothing invented where tongues overlap."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import maglev_ctrl.analysis.tongue_table as table_module
from maglev_ctrl.analysis.critical_depth import critical_depth
from maglev_ctrl.analysis.exponent_surface import SpeedSurface
from maglev_ctrl.analysis.floquet import floquet
from maglev_ctrl.analysis.followed_tongue import FollowedTongue
from maglev_ctrl.analysis.tongue_search import Crossing, Track
from maglev_ctrl.analysis.tongue_table import TongueRow, tongue_table
from maglev_ctrl.errors import ModelError
from maglev_ctrl.systems import PeriodicSystem, SecondOrderSystem, at_depth, modulate

SUM, DIFFERENCE = np.array([[0.5, 0.4], [0.3, 0.6]]), np.array([[0.5, 0.4], [-0.3, 0.6]])


def two_modes(speed: float, K_1: np.ndarray = SUM, C: np.ndarray | None = None) -> PeriodicSystem:
    """Natural frequencies 1 and 1.7, W = 2 v."""
    damping = np.diag([0.004, 0.012]) if C is None else C
    system = SecondOrderSystem.from_matrices(np.eye(2), damping, np.diag([1.0, 2.89]), dofs=("heave", "pitch"))
    return modulate(system, [K_1], frequency=2.0 * speed)


def named(rows: tuple[TongueRow, ...]) -> dict[tuple[str, tuple[int, ...], int], TongueRow]:
    return {(r.resonance.kind, r.resonance.modes, r.resonance.order): r for r in rows}


def table(K_1: np.ndarray = SUM, **more: object) -> dict[tuple[str, tuple[int, ...], int], TongueRow]:
    options = {"depth": 0.1, "lower": 0.3, "upper": 1.9, "largest_depth": 0.2, "max_order": 1, "removals": False}
    return named(tongue_table(lambda v: two_modes(v, K_1), **{**options, **more}))  # type: ignore[arg-type]


def test_computed_intervals_are_the_published_ones() -> None:
    """DOP853 at 1e-12 with roots of the spectral radius, halved: speeds."""
    principal = table()[("parametric", (1, 1), 1)]
    difference = table(DIFFERENCE)[("difference", (1, 2), 1)]
    for row, lower, upper in ((principal, 1.9751341987126716, 2.0244828627890255),
                              (difference, 0.6869642543634507, 0.7131532006074245)):  # fmt: skip
        assert 2.0 * (row.computed_centre - row.computed_half_width) == pytest.approx(lower, rel=2e-7)
        assert 2.0 * (row.computed_centre + row.computed_half_width) == pytest.approx(upper, rel=2e-7)
        assert row.computed_half_width == pytest.approx(row.first_order_half_width, rel=5e-3)
        assert row.reason == ""


def test_edges_are_between_stable_and_unstable() -> None:
    row = table()[("sum", (1, 2), 1)]
    for side in (-1.0, 1.0):
        for share, stable in ((0.999, False), (1.001, True)):
            speed = row.computed_centre + side * share * row.computed_half_width
            assert floquet(at_depth(two_modes(speed), 0.1)).stable is stable
    grown = floquet(at_depth(two_modes(row.computed_centre), 0.1)).growth_rate
    assert row.peak_growth == pytest.approx(grown, rel=1e-6)


def test_onset_is_the_smallest_critical_depth_over_speed() -> None:
    row = table()[("parametric", (1, 1), 1)]
    speeds = np.linspace(0.99995, 1.00005, 5)
    lowest = min(critical_depth(two_modes(float(v)), depth_max=0.1).depth for v in speeds)
    assert row.onset == pytest.approx(lowest, rel=1e-5) and row.onset <= lowest * (1.0 + 1e-8)
    assert row.onset == pytest.approx(4.0 * 0.002 / 0.5, rel=1e-4)  # eps d = 4 zeta w^2
    at_rest = critical_depth(two_modes(1.01), depth_max=0.1).depth
    assert at_rest > 1.5 * row.onset  # the mutant that stays at one speed


def test_tongue_above_the_depth_tells_its_onset_only() -> None:
    row = table(depth=0.012)[("parametric", (1, 1), 1)]
    assert np.isfinite(row.onset) and row.onset > 0.012
    assert np.isnan(row.computed_half_width) and row.reason == "begins at a greater depth"
    assert row.first_order_half_width == 0.0


def test_absent_combination_tongue_and_its_sign() -> None:
    """d12 d21 > 0 makes the sum tongue, its flipped sign (the mutant) the difference tongue."""
    for K_1, there, absent, sign in ((SUM, "sum", "difference", "> 0"), (DIFFERENCE, "difference", "sum", "< 0")):
        rows = table(K_1)
        present, missing = rows[(there, (1, 2), 1)], rows[(absent, (1, 2), 1)]
        assert present.computed_half_width > 0.0 and present.needs == f"needs d12 d21 {sign}, found {sign}"
        assert np.isinf(missing.onset) and np.isnan(missing.computed_centre)
        assert missing.needs.endswith(f"found {sign}") and missing.reason == "none up to depth 0.2"
    assert table()[("parametric", (2, 2), 1)].needs == ""


def test_overlapping_tongues_are_told_not_measured() -> None:
    """Two equal oscillators a little apart: their tongues merge at depth 0.3, each is measured at depth 0.02."""

    def path(v: float) -> PeriodicSystem:
        spring = SecondOrderSystem.from_matrices(np.eye(2), 4e-3 * np.eye(2), np.diag([1.0, 1.04]), dofs=("a", "b"))
        return modulate(spring, [np.eye(2)], frequency=2.0 * v)

    wide = named(tongue_table(path, depth=0.3, lower=0.7, upper=1.4, largest_depth=0.3, max_order=1, removals=False))
    slim = named(tongue_table(path, depth=0.02, lower=0.7, upper=1.4, largest_depth=0.3, max_order=1, removals=False))
    for modes in ((1, 1), (2, 2)):
        assert np.isfinite(slim[("parametric", modes, 1)].computed_half_width)
        assert np.isnan(wide[("parametric", modes, 1)].computed_half_width)
        told = wide[("parametric", modes, 1)].reason
        assert "overlaps with" in told and not told.endswith(")")  # no labels of modes in a reason


def test_undamped_mathieu_has_no_threshold() -> None:
    def path(v: float) -> PeriodicSystem:
        return PeriodicSystem.from_matrices([[0, 1], [-1, 0]], [[[0, 0], [-1, 0]]], frequency=2.0 * v)

    (row,) = tongue_table(path, depth=0.1, lower=0.8, upper=1.2, largest_depth=0.3, max_order=1, removals=False)
    assert row.onset == 0.0
    edges = row.computed_centre + row.computed_half_width * np.array([-1.0, 1.0])
    assert 2.0 * edges == pytest.approx([1.9496984382629277, 2.0496787731544197], rel=1e-7)


def test_slope_of_the_campbell_curve_widens_in_speed() -> None:
    def path(v: float) -> PeriodicSystem:
        w = 1.0 + 0.5 * (v - 1.0)
        return PeriodicSystem.from_matrices([[0, 1], [-(w**2), -1e-4]], [[[0, 0], [-1, 0]]], frequency=2.0 * v)

    (row,) = tongue_table(path, depth=0.01, lower=0.8, upper=1.2, largest_depth=0.02, max_order=1, removals=False)
    flat = 0.5 * np.sqrt(0.25 * 0.01**2 - 1e-8)
    assert row.first_order_half_width == pytest.approx(2.0 * flat, rel=1e-4)
    assert row.computed_half_width == pytest.approx(2.0 * flat, rel=1e-3)


def test_removal_and_feeding() -> None:
    front, rear = 0.75 * SUM, 0.25 * SUM

    def elements(v: float) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        parts = {name: two_modes(v, part) for name, part in (("front", front), ("rear", rear))}
        return {name: (one.A_cos, one.A_sin) for name, one in parts.items()}

    row = table(lower=0.95, upper=1.05, removals=True, elements=elements)[("parametric", (1, 1), 1)]
    assert row.removal is not None
    assert row.removal.equal.safe == pytest.approx(0.1 * 0.5 / 4.0 - 0.002, rel=1e-2)
    assert dict(row.feeding) == pytest.approx({"front": 0.75, "rear": 0.25})


def test_engines_that_disagree_leave_no_numbers(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(system: PeriodicSystem) -> object:
        return dataclasses.replace(floquet(system), agreement=table_module.Agreement.UNRESOLVED)

    monkeypatch.setattr(table_module, "floquet", broken)
    row = table(lower=0.9, upper=1.1)[("parametric", (1, 1), 1)]
    assert np.isnan(row.onset) and np.isnan(row.computed_half_width)
    assert row.reason == "the engines do not confirm the onset"


def test_refusals() -> None:
    with pytest.raises(ValueError, match="expected 0 < lower < upper"):
        table(lower=2.0)
    with pytest.raises(ValueError, match="0 < depth <= largest_depth"):
        table(depth=0.3)

    def nothing(v: float) -> PeriodicSystem:
        raise ModelError(f"no equilibrium at {v:g} m/s")

    with pytest.raises(ModelError, match="no answer from 1 to 2 m/s: no equilibrium"):
        tongue_table(nothing, depth=0.1, lower=1.0, upper=2.0, largest_depth=0.1)


def test_nothing_grows_below_the_threshold_and_the_narrow_tongue_above_it_is_seen() -> None:
    """eps d = 4 zeta w^2: just below it nothing grows, just above it a tongue far narrower than the samples does."""
    calm = []
    for share in (0.99, 1.01):
        largest = share * 4.0 * 0.002 / 0.5
        surface = SpeedSurface.of(two_modes, lower=0.9, upper=1.1, largest_depth=largest)
        base = Track(surface.smooth)
        base.system(0.99), base.system(1.01)
        tongue = FollowedTongue(base, surface, Crossing("parametric", (0, 0), 1, 1.0), largest, largest, (0.9, 1.1))
        calm.append(tongue.calm())
    assert calm == [True, False]
