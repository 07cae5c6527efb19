"""Tongues over speed: exact edges, widths with the slope of the Campbell curve, nothing undecided told as safe."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

import maglev_ctrl.analysis.tongue_atlas as atlas_module
from maglev_ctrl.analysis.exponent_surface import SpeedSurface
from maglev_ctrl.analysis.floquet import Floquet, floquet
from maglev_ctrl.analysis.tongue_atlas import TongueAtlas, tongue_atlas
from maglev_ctrl.errors import Agreement, ModelError
from maglev_ctrl.guideway import passing_frequency, resonance_speeds
from maglev_ctrl.systems import PeriodicSystem, SecondOrderSystem, modulate

WAVELENGTH = 25.0
SUM = np.array([[0.5, 0.4], [0.3, 0.6]])


def mathieu(speed: float, *, eps: float = 0.1, damping: float = 1e-6) -> PeriodicSystem:
    """Natural frequency 1, W = 2 v."""
    return PeriodicSystem.from_matrices([[0, 1], [-1, -damping]], [[[0, 0], [-eps, 0]]], frequency=2.0 * speed)


def two_modes(speed: float, *, eps: float, K_1: np.ndarray = SUM, c: float = 4e-3) -> PeriodicSystem:
    system = SecondOrderSystem.from_matrices(np.eye(2), c * np.eye(2), np.diag([1.0, 2.89]), dofs=("heave", "pitch"))
    return modulate(system, [eps * K_1], frequency=float(passing_frequency(speed, WAVELENGTH)))


def speed_of(frequency: float) -> float:
    return frequency * WAVELENGTH / (2.0 * np.pi)


def covers(atlas: TongueAtlas, lower: float, upper: float) -> bool:
    ends = [(r.lower, r.upper) for r in atlas.ranges]
    joined = all(a[1] == b[0] for a, b in pairwise(ends))
    return ends[0][0] == lower and ends[-1][1] == upper and joined and all(a < b for a, b in ends)


def test_edges_are_mathieus() -> None:
    """Exact limits of the principal region at depth 0.1 in W, halved: speeds."""
    atlas = tongue_atlas(mathieu, lower=0.8, upper=1.2, samples=20, checks=4)
    assert [r.verdict for r in atlas.ranges] == ["go", "no-go", "go"]
    row = atlas.of("no-go")[0]
    assert row.lower == pytest.approx(0.5 * 1.9496984382629277, abs=1e-6)
    assert row.upper == pytest.approx(0.5 * 2.0496787731544197, abs=1e-6)
    assert row.tongues == ("2 w1/1",)
    # the row reaches outwards to speeds that are stable, and the next speed inwards is not
    assert floquet(mathieu(row.lower)).stable is True and floquet(mathieu(row.upper)).stable is True
    assert floquet(mathieu(row.lower + 1e-5)).stable is False and floquet(mathieu(row.upper - 1e-5)).stable is False
    assert covers(atlas, 0.8, 1.2)


def test_crossings_are_the_resonance_speeds() -> None:
    atlas = tongue_atlas(lambda v: two_modes(v, eps=0.02), lower=1.5, upper=15.0, samples=40, checks=4)
    known = [r for r in resonance_speeds([1.0, 1.7], WAVELENGTH, orders=2) if 1.5 <= r.speed <= 15.0]
    assert len(known) == len(atlas.crossings)
    for wanted, found in zip(known, atlas.crossings, strict=True):
        assert found.speed == pytest.approx(wanted.speed, rel=1e-4)
        assert (found.resonance.kind, found.resonance.order) == (wanted.kind, wanted.order)
    assert covers(atlas, 1.5, 15.0)
    assert atlas.frequencies.shape == (40, 2)
    np.testing.assert_allclose(atlas.passing, 2.0 * np.pi * atlas.speed / WAVELENGTH)


def test_growth_and_width_are_hsus() -> None:
    """Half-width over 2 pi/p, growth sqrt(g) - c/2, both to first order in the depth."""
    eps, c = 0.04, 4e-3
    atlas = tongue_atlas(lambda v: two_modes(v, eps=eps, c=c), lower=6.0, upper=15.0, samples=40, checks=4)
    found = {(t.resonance.kind, t.resonance.modes): t for t in atlas.crossings if t.resonance.order == 1}
    for key, product, sum_w in (
        (("parametric", (1, 1)), 0.25 / 1.0, 2.0),
        (("sum", (1, 2)), 0.12 / 1.7, 2.7),
        (("parametric", (2, 2)), 0.36 / 2.89, 3.4),
    ):
        width = np.sqrt(eps**2 * product / 4.0 - c**2)
        assert found[key].half_width == pytest.approx(speed_of(width), rel=1e-3)
        assert found[key].growth == pytest.approx(0.25 * eps * np.sqrt(product) - 0.5 * c, rel=3 * eps)
        row = next(r for r in atlas.of("no-go") if r.lower < speed_of(sum_w) < r.upper)
        assert 0.5 * (row.upper - row.lower) == pytest.approx(speed_of(width), rel=3 * eps)
    assert len(atlas.of("no-go")) == 3


def test_width_knows_the_slope_of_the_campbell_curve() -> None:
    """Stiffening with speed: the line and the curve part at half the rate, the tongue is twice as wide in speed."""
    eps, c = 0.01, 1e-4

    def path(v: float) -> PeriodicSystem:
        w = 1.0 + 0.5 * (v - 1.0)  # W = 2 v meets 2 w at v = 1, where d(2 w)/dv = 1 and dW/dv = 2
        return PeriodicSystem.from_matrices([[0, 1], [-(w**2), -c]], [[[0, 0], [-eps, 0]]], frequency=2.0 * v)

    atlas = tongue_atlas(path, lower=0.8, upper=1.2, samples=15, checks=4)
    (found,) = [t for t in atlas.crossings if t.resonance.order == 1]
    flat = 0.5 * np.sqrt(0.25 * eps**2 - c**2)
    row = atlas.of("no-go")[0]
    assert found.half_width == pytest.approx(2.0 * flat, rel=1e-2)
    assert 0.5 * (row.upper - row.lower) == pytest.approx(2.0 * flat, rel=1e-2)
    assert abs(0.5 * (row.upper - row.lower) - flat) > 0.4 * flat  # the mutant that forgets the slope


def narrow(v: float) -> PeriodicSystem:
    return two_modes(v, eps=0.5, K_1=np.array([[0.02, 0.01], [0.01, 0.02]]), c=2e-4)


def test_narrow_tongue_between_samples_is_no_go() -> None:
    atlas = tongue_atlas(narrow, lower=speed_of(2.3), upper=speed_of(3.1), samples=8, checks=3)
    (row,) = atlas.of("no-go")
    assert row.tongues == ("(w1 + w2)/1 (heave, pitch)",)
    assert row.lower < speed_of(2.7) < row.upper
    assert row.upper - row.lower < 0.1 * (atlas.speed[1] - atlas.speed[0])
    assert atlas.missed_width < 0.01 * (row.upper - row.lower)


def third_order(v: float) -> PeriodicSystem:
    """Two lightly damped modes under one harmonic: their sum meets 3 W where no product of one harmonic predicts it."""
    return two_modes(v, eps=0.15, c=2e-6)


def around_third(width: float) -> tuple[float, float]:
    return speed_of(2.7 / 3.0 - width), speed_of(2.7 / 3.0 + 1.07 * width)


@pytest.mark.parametrize("read", [False, True])
def test_a_tongue_of_an_order_nobody_predicts_is_found_and_the_mutant_is_caught(
    read: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Order 3, narrower than a step of the scan: found where multipliers meet, missed by the scan alone."""
    monkeypatch.setattr(atlas_module, "_SCAN", (200, 200))
    lower, upper = around_third(0.1)
    reader = SpeedSurface.of(
        lambda v: two_modes(v, eps=1.0, c=2e-6), lower=lower, upper=upper, largest_depth=0.2
    ).over(0.15) if read else None  # fmt: skip
    atlas = tongue_atlas(third_order, lower=lower, upper=upper, samples=12, checks=3, max_order=2, reader=reader)
    mutant = tongue_atlas(third_order, lower=lower, upper=upper, samples=12, checks=3, max_order=2, reader=reader,
                          refine=False)  # fmt: skip
    assert covers(atlas, lower, upper)
    found = [r for r in atlas.of("no-go") if any("/3" in name for name in r.tongues)]
    assert found
    for row in found:
        middle = 0.5 * (row.lower + row.upper)
        assert row.upper - row.lower < atlas.scan_step
        assert floquet(third_order(middle)).stable is False
        assert not any(r.lower < middle < r.upper for r in atlas.of("go"))
        assert atlas.missed_width < 0.1 * (row.upper - row.lower)
    missed = [r for r in found if any(m.lower < 0.5 * (r.lower + r.upper) < m.upper for m in mutant.of("go"))]
    assert missed, [(r.lower, r.upper) for r in found]


def test_speeds_another_search_doubts_are_looked_at() -> None:
    """Without refinement the scan sees the tongue only where it is told to look."""
    lower, upper = around_third(0.1)
    options = {"lower": lower, "upper": upper, "samples": 12, "checks": 3, "max_order": 2, "refine": False}
    row = min((r for r in tongue_atlas(third_order, **{**options, "refine": True}).of("no-go")),
              key=lambda r: r.upper - r.lower)  # fmt: skip
    middle = 0.5 * (row.lower + row.upper)
    blind, told = (tongue_atlas(third_order, **options, extra=extra) for extra in ((), (middle,)))
    assert any(r.lower < middle < r.upper for r in blind.of("go"))
    assert any(r.lower < middle < r.upper for r in told.of("no-go"))


def test_without_predictions_the_meetings_are_still_found(monkeypatch: pytest.MonkeyPatch) -> None:
    """Neither predicted nor refined: told safe. That is the mutant; the refinement alone finds the tongue."""
    monkeypatch.setattr(atlas_module, "find_crossings", lambda *_, **__: [])
    monkeypatch.setattr(atlas_module, "_SCAN_INTEGRATED", (20, 20))
    kept = {"lower": speed_of(2.3), "upper": speed_of(3.1), "samples": 8, "checks": 3}
    assert [r.verdict for r in tongue_atlas(narrow, **kept).ranges] == ["go", "no-go", "go"]
    assert [r.verdict for r in tongue_atlas(narrow, **kept, refine=False).ranges] == ["go"]


def test_every_unstable_speed_of_a_fine_scan_is_in_a_no_go_row() -> None:
    path = lambda v: two_modes(v, eps=0.25)  # noqa: E731
    atlas = tongue_atlas(path, lower=2.2, upper=15.0, samples=30, checks=4)
    assert covers(atlas, 2.2, 15.0)
    blocked = [(r.lower, r.upper) for r in atlas.of("no-go")]
    for v in np.linspace(2.2, 15.0, 161):
        if floquet(path(float(v))).stable is False:
            assert any(a <= v <= b for a, b in blocked)
        else:
            assert not any(a + 1e-3 < v < b - 1e-3 for a, b in blocked)


def test_overlapping_tongues_are_one_row_with_both_names() -> None:
    def path(v: float) -> PeriodicSystem:
        return PeriodicSystem.from_matrices(
            np.block([[np.zeros((2, 2)), np.eye(2)], [-np.diag([1.0, 1.1**2]), -4e-3 * np.eye(2)]]),
            [np.block([[np.zeros((2, 4))], [-0.3 * np.eye(2), np.zeros((2, 2))]])], frequency=2.0 * v,
        )  # fmt: skip

    atlas = tongue_atlas(path, lower=0.8, upper=1.3, samples=40, checks=4)
    (row,) = atlas.of("no-go")  # 2 -+ 0.15 and 2.2 -+ 0.136 in W
    assert row.tongues == ("2 w1/1", "2 w2/1")


def disagreeing(lower: float, upper: float) -> Callable[[PeriodicSystem], Floquet]:
    def engine(system: PeriodicSystem) -> Floquet:
        found = floquet(system)
        inside = lower <= 0.5 * float(system.frequency) <= upper
        return replace(found, agreement=Agreement.UNRESOLVED) if inside else found

    return engine


@pytest.mark.parametrize("window", [(0.83, 0.9), (0.97, 0.98), (0.99, 1.01)])
def test_engines_that_disagree_make_a_row_of_their_own(window: tuple[float, float]) -> None:
    atlas = tongue_atlas(mathieu, lower=0.8, upper=1.2, samples=41, checks=41, engine=disagreeing(*window))
    assert covers(atlas, 0.8, 1.2)
    middle = 0.5 * (window[0] + window[1])
    row = next(r for r in atlas.ranges if r.lower <= middle <= r.upper)
    assert row.verdict != "go"
    if window[1] < 0.95:
        assert row.verdict == "unresolved" and row.lower <= 0.83 and row.upper >= 0.9 - 1e-9
    if window[0] == 0.99:
        assert row.verdict == "unresolved" and "growth" in row.reason


def test_speeds_without_a_model_are_unresolved_with_the_reason() -> None:
    def path(v: float) -> PeriodicSystem:
        if 1.1 < v < 1.15:
            raise ModelError("no equilibrium")
        return mathieu(v, damping=1e-3)

    atlas = tongue_atlas(path, lower=0.8, upper=1.3, samples=51, checks=5)
    (row,) = atlas.of("unresolved")
    assert "no equilibrium" in row.reason
    assert row.lower == pytest.approx(1.1, abs=1e-5) and row.upper == pytest.approx(1.15, abs=1e-5)
    assert covers(atlas, 0.8, 1.3)
    assert np.any(np.isnan(atlas.growth))


def test_undamped_speeds_are_never_go() -> None:
    atlas = tongue_atlas(lambda v: mathieu(v, damping=0.0), lower=0.8, upper=1.2, samples=15, checks=15)
    assert not atlas.of("go")
    assert atlas.of("no-go")


@pytest.mark.parametrize("options", [{"lower": 0.0}, {"lower": 2.0}, {"samples": 2}, {"checks": 1}])
def test_wrong_speeds_are_refused(options: dict[str, float]) -> None:
    with pytest.raises(ValueError, match="speeds: expected"):
        tongue_atlas(mathieu, **{"lower": 0.8, "upper": 1.2, **options})
