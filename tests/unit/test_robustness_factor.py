"""Bounds on stability under real parameters: closed forms, proofs that hold, gaps that are told."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from two_stage_vehicle import PARAMETERS, law, two_stages

from maglev_ctrl.analysis.robustness import (
    UncertainLoop,
    UncertainParameter,
    Work,
    factor_bounds,
    prove,
    prove_box,
    stability_range,
    uncertain_loop,
    worst_case,
)
from maglev_ctrl.analysis.robustness.certificate import _held
from maglev_ctrl.analysis.robustness.scalings import Scales, real_mu_upper
from maglev_ctrl.analysis.robustness.search import growth_rates, poles_with_slopes
from maglev_ctrl.errors import Agreement, NotStable, Verdict
from maglev_ctrl.systems import Controller, SecondOrderSystem


def oscillator(ratio: float) -> UncertainLoop:
    """x'' + 2 ratio x' + (1 + d) x = 0: stable for every d > -1, whatever the damping."""
    return UncertainLoop.from_affine([[0.0, 1.0], [-1.0, -2.0 * ratio]], [[[0.0, 0.0], [-1.0, 0.0]]])


def third_order() -> UncertainLoop:
    """s^3 + 2 s^2 + (3 + d1) s + (2 + d2): Hurwitz asks 2 + d2 > 0 and 2 (3 + d1) > 2 + d2."""
    A = [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [-2.0, -3.0, -2.0]]
    one, two = np.zeros((3, 3)), np.zeros((3, 3))
    one[2, 1], two[2, 0] = -1.0, -1.0
    return UncertainLoop.from_affine(A, [one, two])


@pytest.mark.parametrize("ratio", [0.3, 1e-2, 1e-3])
def test_one_uncertain_stiffness(ratio: float) -> None:
    """The complex radius is about twice the damping ratio, the real one is 1: the gap between the two is told."""
    loop = oscillator(ratio)
    exact = stability_range(loop)
    assert (exact.low, exact.high, exact.low_frequency) == (pytest.approx(-1.0, abs=1e-9), np.inf, 0.0)
    assert exact.agreement is Agreement.AGREED
    bounds = factor_bounds(loop, limit=3.0)
    assert bounds.found == pytest.approx(1.0, abs=1e-9)
    assert 0.95 < bounds.proven <= 1.0
    assert bounds.agreement is Agreement.AGREED
    M = loop.C @ np.linalg.solve(1j * np.sqrt(1.0 - 2.0 * ratio**2) * np.eye(2) - loop.A, loop.B)
    complex_mu = float(np.abs(M[0, 0]))
    assert complex_mu == pytest.approx(1.0 / (2.0 * ratio * np.sqrt(1.0 - ratio**2)), rel=1e-9)
    assert real_mu_upper(M, (1,)).value < complex_mu / 1.5  # mutant: without G the bound is complex mu


def test_two_parameters_with_a_known_radius() -> None:
    """The nearest crossing in the box norm: d1 = -4/3, d2 = 4/3, where 6 + 2 d1 = 2 + d2; pole at j sqrt(3 + d1)."""
    bounds = factor_bounds(third_order(), limit=10.0)
    assert bounds.found == pytest.approx(4.0 / 3.0, rel=1e-9)
    assert np.allclose(bounds.changes, [-4.0 / 3.0, 4.0 / 3.0], rtol=1e-6)
    assert bounds.frequency == pytest.approx(np.sqrt(5.0 / 3.0), rel=1e-6)
    assert bounds.pole_distance < 1e-9
    assert bounds.proven <= bounds.found <= 1.05 * bounds.proven
    alone = stability_range(third_order().along([1.0, 0.0]))
    assert (alone.low, alone.high) == (pytest.approx(-2.0, rel=1e-9), np.inf)
    other = stability_range(third_order().along([0.0, 1.0]))
    assert (other.low, other.high) == (pytest.approx(-2.0, rel=1e-9), pytest.approx(4.0, rel=1e-9))
    assert other.high_frequency == pytest.approx(np.sqrt(3.0), rel=1e-6)
    flipped = UncertainLoop.from_affine(third_order().A, [m * s for m, s in zip(_directions(), (1, -1), strict=True)])
    assert np.sign(factor_bounds(flipped, limit=10.0).changes[1]) == -1.0  # mutant: a flipped share is seen


def _directions() -> list[np.ndarray]:
    loop = third_order()
    return [loop.B[:, k : k + 1] @ loop.C[k : k + 1] for k in range(2)]


def test_a_mass_enters_through_its_inverse() -> None:
    """m q'' + c q' + k q = f, T f' = -f - g q: by Routh stable exactly for m (T g - c) < c T (c + k T)."""
    m, c, k, T, g = 0.05, 0.4, 8.0, 0.1, 10.0
    plant = SecondOrderSystem.from_matrices(
        [[m]], [[c]], [[k]], internal=("f",), A_internal=[[-1.0 / T]], G_q=[[-g / T]], F=[[1.0]]
    )
    loop = uncertain_loop(plant, None, [UncertainParameter("m", "mass", 0.5, ("matrices",))])
    critical = c * T * (c + k * T) / (T * g - c)
    exact = stability_range(loop, limit=1.9)
    assert exact.high == pytest.approx((critical / m - 1.0) / 0.5, rel=1e-9)
    assert exact.high_frequency == pytest.approx(np.sqrt((c + k * T) / (T * critical)), rel=1e-6)
    bounds = factor_bounds(loop)
    assert bounds.found == pytest.approx(exact.high, rel=1e-9)
    assert bounds.proven <= bounds.found <= 1.05 * bounds.proven
    affine = replace(loop, D=np.zeros_like(loop.D))  # mutant: to first order in the mass
    assert stability_range(affine).high != pytest.approx(exact.high, rel=1e-2)


@pytest.mark.parametrize("seed", range(6))
def test_nothing_unstable_lies_inside_what_is_proven(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n, p = int(rng.integers(3, 9)), int(rng.integers(1, 4))
    A = rng.normal(size=(n, n))
    A -= (np.max(np.linalg.eigvals(A).real) + rng.uniform(0.05, 0.5)) * np.eye(n)
    shares = [rng.normal(size=(n, r)) @ rng.normal(size=(r, n)) for r in rng.integers(1, 3, p)]
    loop = UncertainLoop.from_affine(A, shares)
    bounds = factor_bounds(loop, limit=20.0)
    assert 0.0 < bounds.proven <= bounds.found
    inside = rng.uniform(-bounds.proven, bounds.proven, (500, p))
    assert np.all(growth_rates(loop, inside) < 0.0)
    if p == 1:
        exact = stability_range(loop)
        assert bounds.found == pytest.approx(min(-exact.low, exact.high), rel=1e-6)
    # the slopes that the search climbs along
    values, slopes = poles_with_slopes(loop, np.zeros(p))
    shifted = np.linalg.eigvals(loop.state_matrix(np.r_[1e-6, np.zeros(p - 1)]))
    moved = np.array([shifted[np.argmin(np.abs(shifted - v))] for v in values])
    assert np.allclose((moved - values) / 1e-6, slopes[:, 0], rtol=1e-3, atol=1e-3)


def test_boxes_that_hold_an_unstable_point_are_never_proven() -> None:
    loop = third_order()
    assert prove_box(loop, factor=1.3).stable
    outcome = prove_box(loop, factor=1.4, work=Work(3e5))
    assert outcome.stable is not True
    assert not prove(loop, level=1.0 / 1.4).complete
    with pytest.raises(ValueError, match="stable nominal"):
        prove(replace(loop, A=-loop.A), level=1.0)


def test_an_interval_never_spans_a_frequency_it_does_not_hold_at() -> None:
    """Scales good at one frequency, judged at a level that complex mu exceeds at resonance: the interval ends there."""
    loop = oscillator(0.05)
    none = Scales(np.eye(1, dtype=complex), np.zeros((1, 1), dtype=complex))
    low, high = _held(loop.A, loop.B, loop.C, loop.D, none, 5.0, 0.1)
    gain = np.abs([(loop.C @ np.linalg.solve(1j * w * np.eye(2) - loop.A, loop.B))[0, 0] for w in (low, high)])
    assert low == 0.0
    assert gain[1] == pytest.approx(5.0, rel=1e-6)
    assert high < 1.0


def test_worst_case_of_a_closed_loop_within_five_seconds() -> None:
    plant, controller = two_stages(), law()
    found = worst_case(plant, controller, PARAMETERS[:6])
    assert found.seconds < 15.0  # 5 s on a machine of its own
    assert found.stable is Verdict.PASS
    assert found.factor.proven > 1.0
    assert found.growth.nominal < found.growth.value < 0.0
    assert found.growth.verified
    assert found.damping.value < found.damping.nominal
    assert found.disk.value <= found.disk.nominal
    loop = uncertain_loop(plant, controller, PARAMETERS[:6])
    rates = growth_rates(loop, np.random.default_rng(1).uniform(-1.0, 1.0, (200, 6)))
    assert np.max(rates) <= found.growth.value + 1e-9  # random looks find nothing worse
    assert np.allclose(found.growth.percent, 100.0 * loop.spreads * found.growth.changes)


def test_an_unstable_combination_within_the_spreads_fails_and_is_replayed() -> None:
    plant = SecondOrderSystem.from_matrices([[1.0]], [[-0.1]], [[4.0]], inputs=("force",), B=[[1.0]])
    controller = Controller.static([[-0.3]], measured=("q1.velocity",), commands=("force",))
    bad = UncertainParameter("destabilising", "damping", 3.0, ("matrices",))
    found = worst_case(plant, controller, [bad])
    assert found.stable is Verdict.NOT_EVALUATED  # a spread beyond 100 % is no spread
    mild = [
        UncertainParameter("m", "mass", 0.5, ("matrices",)),
        UncertainParameter("k", "stiffness", 0.9, ("matrices",)),
    ]
    assert worst_case(plant, controller, mild).stable is Verdict.PASS
    with pytest.raises(NotStable, match="nominal"):
        worst_case(plant, None, mild)
    # -0.1 (1 + d) + 0.12 >= 0 until d = 0.2; the spread of 0.5 goes beyond
    thin = Controller.static([[-0.12]], measured=("q1.velocity",), commands=("force",))
    failed = worst_case(plant, thin, [UncertainParameter("c", "damping", 0.5, ("matrices",))])
    assert failed.stable is Verdict.FAIL
    assert failed.factor.found == pytest.approx(0.4, rel=1e-6)
    assert failed.factor.frequency == pytest.approx(2.0, rel=1e-6)
    assert failed.factor.pole_distance < 1e-9
    assert failed.growth.value == pytest.approx(0.5 * (0.15 - 0.12), rel=1e-6)
    assert np.isnan(failed.disk.value)


def test_scales_that_rounding_cannot_carry_prove_nothing() -> None:
    """Scales of 1e9 between channels: a Hamiltonian matrix of such a loop is noise."""
    loop = third_order()
    moderate = Scales(np.eye(2, dtype=complex), np.zeros((2, 2), dtype=complex))
    extreme = Scales(np.diag([1.0, 1e9]).astype(complex), np.zeros((2, 2), dtype=complex))
    low, high = _held(loop.A, loop.B, loop.C, loop.D, moderate, 5.0, 0.3)
    assert low < 0.3 < high
    assert _held(loop.A, loop.B, loop.C, loop.D, extreme, 1e12, 0.3) == (0.3, 0.3)
