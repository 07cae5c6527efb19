"""Stability boundaries: published speeds, narrow windows, holes that stay holes."""

from __future__ import annotations

import numpy as np
import pytest

from maglev_ctrl.analysis.boundary import margin_to_boundary, stability_boundaries
from maglev_ctrl.analysis.modes import spectral_abscissa
from maglev_ctrl.analysis.tracking import frequency_crossings, track
from maglev_ctrl.errors import ModelError, NotStable, OutOfDomain
from maglev_ctrl.systems import SecondOrderSystem

# Meijaard, Papadopoulos, Ruina & Schwab, Proc. R. Soc. A 463 (2007) 1955: the benchmark bicycle.
BICYCLE_M = np.array([[80.81722, 2.31941332208709], [2.31941332208709, 0.29784188199686]])
BICYCLE_C1 = np.array([[0.0, 33.86641391492494], [-0.85035641456978, 1.6854039739756]])
BICYCLE_K0 = np.array([[-80.95, -2.59951685249872], [-2.59951685249872, -0.80329488458618]])
BICYCLE_K2 = np.array([[0.0, 76.59734589573222], [0.0, 2.65431523794604]])


def bicycle(speed: float) -> SecondOrderSystem:
    stiffness = 9.81 * BICYCLE_K0 + speed**2 * BICYCLE_K2
    return SecondOrderSystem.from_matrices(BICYCLE_M, speed * BICYCLE_C1, stiffness, dofs=("roll", "steer"))


def test_published_bicycle_weave_and_capsize_speeds() -> None:
    # Meijaard, Papadopoulos, Ruina & Schwab (2007): self-stable from 4.292 382 536 341 11 to 6.024 262 015 388 37 m/s
    found = stability_boundaries(lambda v: float(spectral_abscissa(bicycle(v))), 0.0, 10.0, tolerance=1e-12)
    assert [c.direction for c in found.crossings] == ["gains", "loses"]
    assert found.crossings[0].value == pytest.approx(4.29238253634111, abs=1e-10)
    assert found.crossings[1].value == pytest.approx(6.02426201538837, abs=1e-10)
    margin = margin_to_boundary(found, 5.0)
    assert margin.kind == "boundary"
    assert margin.distance == pytest.approx(5.0 - 4.29238253634111, abs=1e-10)


def test_bicycle_mutant_is_caught() -> None:
    def mirrored(v: float) -> float:
        right = bicycle(v)
        return float(spectral_abscissa(SecondOrderSystem.from_matrices(right.M, right.C.T, right.K)))

    found = stability_boundaries(mirrored, 0.0, 10.0)
    assert all(abs(c.value - 4.29238253634111) > 1e-3 for c in found.crossings)


@pytest.mark.parametrize("centre", [0.5137, 0.5, 0.123456, 0.99])
@pytest.mark.parametrize("half_width", [1e-3, 1e-4])
def test_narrow_unstable_window_between_samples(centre: float, half_width: float) -> None:
    found = stability_boundaries(lambda x: half_width**2 - (x - centre) ** 2, 0.0, 1.0, samples=33)
    assert [c.direction for c in found.crossings] == ["loses", "gains"]
    np.testing.assert_allclose(
        [c.value for c in found.crossings], [centre - half_width, centre + half_width], atol=2e-10
    )


def test_narrow_stable_window_between_samples() -> None:
    found = stability_boundaries(lambda x: (x - 0.3) ** 2 - 1e-8, 0.0, 1.0, samples=33)
    assert [c.direction for c in found.crossings] == ["gains", "loses"]
    assert len(found.stable_intervals) == 1


def test_peak_that_stays_below_zero_gives_no_crossing() -> None:
    found = stability_boundaries(lambda x: -((x - 0.5137) ** 2) - 1e-9, 0.0, 1.0, samples=33)
    assert found.crossings == ()
    assert found.stable_intervals == ((0.0, 1.0),)


def coupled(x: float) -> SecondOrderSystem:
    """Skew coupling 0.05 of two oscillators whose frequencies meet at x = 0.511."""
    K = [[100.0 + 40 * (x - 0.511), 0.05], [-0.05, 100.0 - 40 * (x - 0.511)]]
    return SecondOrderSystem.from_matrices(np.eye(2), 0.001 * np.eye(2), K)


def test_narrow_flutter_window_is_found_through_frequency_crossings() -> None:
    # Equal damping c: unstable where Im sqrt(...) beats c/2; the window is |x - x0| < sqrt(p^2 - c^2 k) / 40 about.
    x = np.linspace(0.0, 1.0, 20)
    stack = SecondOrderSystem.from_matrices(np.eye(2), 0.001 * np.eye(2), [coupled(p).K for p in x])
    candidates = frequency_crossings(track(stack, parameter=x))

    def growth(p: float) -> float:
        return float(spectral_abscissa(coupled(p)))

    found = stability_boundaries(growth, 0.0, 1.0, samples=20, candidates=candidates.tolist())
    assert [c.direction for c in found.crossings] == ["loses", "gains"]
    half_width = np.sqrt(0.05**2 - 0.001**2 * 100.0) / 40.0
    np.testing.assert_allclose([c.value for c in found.crossings], 0.511 + half_width * np.array([-1, 1]), rtol=1e-4)
    blind = stability_boundaries(growth, 0.0, 1.0, samples=20)  # mutant: without candidates such a flat scan is blind
    assert blind.crossings == ()


def test_gaps_are_reported_and_never_bridged() -> None:
    def growth(x: float) -> float:
        if 0.4 <= x <= 0.6:
            raise OutOfDomain(f"height: {x} lies outside the data")
        if x > 0.9:
            raise ModelError("no equilibrium")
        return -1.0 if x < 0.4 else 1.0

    found = stability_boundaries(growth, 0.0, 1.0, samples=41)
    assert found.crossings == ()  # the sign differs across the gap, but nobody knows where or whether it crosses
    assert len(found.gaps) == 2
    assert found.gaps[0].lower == pytest.approx(0.4, abs=1e-9)
    assert found.gaps[0].upper == pytest.approx(0.6, abs=1e-9)
    assert "height" in found.gaps[0].reason
    assert "no equilibrium" in found.gaps[1].reason
    assert found.gaps[1].upper == 1.0
    margin = margin_to_boundary(found, 0.3)
    assert margin.kind == "gap"
    assert margin.distance == pytest.approx(0.1, abs=1e-9)


def test_gap_inside_a_bracket_is_found() -> None:
    def growth(x: float) -> float:
        return float("nan") if 0.49 < x < 0.51 else x - 0.5

    found = stability_boundaries(growth, 0.0, 1.0, samples=4)
    assert found.crossings == ()
    assert len(found.gaps) == 1
    assert "not a number" in found.gaps[0].reason


def test_margin_kinds_and_refusals() -> None:
    found = stability_boundaries(lambda x: x - 3.0, 0.0, 10.0, samples=11)
    assert margin_to_boundary(found, 1.0).kind == "range"
    with pytest.raises(NotStable):
        margin_to_boundary(found, 4.0)
    with pytest.raises(ValueError, match="outside"):
        margin_to_boundary(found, 11.0)


def test_other_faults_are_not_swallowed() -> None:
    def broken(x: float) -> float:
        raise KeyError("stiffness")

    with pytest.raises(KeyError):
        stability_boundaries(broken, 0.0, 1.0)


def test_wrong_use_is_named() -> None:
    with pytest.raises(ValueError, match="lower"):
        stability_boundaries(lambda x: x, 1.0, 0.0)
    with pytest.raises(ValueError, match="samples"):
        stability_boundaries(lambda x: x, 0.0, 1.0, samples=2)
    with pytest.raises(ValueError, match="tolerance"):
        stability_boundaries(lambda x: x, 0.0, 1.0, tolerance=0.0)
    with pytest.raises(ValueError, match="candidates"):
        stability_boundaries(lambda x: x, 0.0, 1.0, candidates=[2.0])
