"""Laws every Floquet analysis obeys: Liouville, reciprocity, agreement of the engines, change of origin."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from maglev_ctrl.analysis.floquet import floquet
from maglev_ctrl.errors import Agreement
from maglev_ctrl.kernels.hill import folded_distance
from maglev_ctrl.systems import PeriodicSystem, SecondOrderSystem, modulate

SEEDS = st.integers(0, 10_000)
FEW = settings(max_examples=12, deadline=None, derandomize=True)


def random_system(seed: int, n: int = 4) -> PeriodicSystem:
    rng = np.random.default_rng(seed)
    return PeriodicSystem.from_matrices(
        rng.standard_normal((n, n)) - 0.5 * np.eye(n), 0.5 * rng.standard_normal((2, n, n)),
        0.5 * rng.standard_normal((2, n, n)), frequency=rng.uniform(1.0, 6.0),
    )  # fmt: skip


def conservative(seed: int, n: int = 3) -> PeriodicSystem:
    rng = np.random.default_rng(seed)
    B, S = rng.standard_normal((2, n, n))
    system = SecondOrderSystem.from_matrices(
        np.diag(rng.uniform(0.5, 2.0, n)), np.zeros((n, n)), B @ B.T + np.diag(np.arange(1.0, n + 1.0))
    )
    return modulate(system, [0.3 * (S + S.T)], frequency=rng.uniform(1.5, 5.0))


@FEW
@given(SEEDS)
def test_liouville(seed: int) -> None:
    """Product of the multipliers = exp(integral of the trace); the sum of the exponents = mean trace."""
    system = random_system(seed)
    result = floquet(system)
    assert abs(np.sum(result.exponents.real) - np.trace(system.A_0)) <= 1e-11 + np.sum(result.error_bound)
    mutant = PeriodicSystem.from_matrices(
        system.A_0 + 1e-6 * np.eye(4), system.A_cos, system.A_sin, frequency=system.frequency
    )
    assert abs(np.sum(floquet(mutant).exponents.real) - np.trace(system.A_0)) > 1e-6


@FEW
@given(SEEDS)
def test_multipliers_of_a_conservative_system_are_reciprocal(seed: int) -> None:
    multipliers = floquet(conservative(seed)).multipliers
    for value in multipliers:
        assert np.min(np.abs(multipliers - 1.0 / value)) < 1e-6 * abs(1.0 / value)


def test_reciprocity_fails_with_damping_mutant_is_caught() -> None:
    system = conservative(5)
    A = system.A_0.copy()
    A[3:, 3:] -= 0.05 * np.eye(3)
    multipliers = floquet(PeriodicSystem.from_matrices(A, system.A_cos, frequency=system.frequency)).multipliers
    assert max(float(np.min(np.abs(multipliers - 1.0 / v)) / abs(1.0 / v)) for v in multipliers) > 1e-2


@FEW
@given(SEEDS)
def test_hill_equals_monodromy(seed: int) -> None:
    system = random_system(seed)
    result = floquet(system)
    assert result.agreement is Agreement.AGREED
    time_domain, hill = result.engines
    apart = folded_distance(time_domain.exponents, hill.exponents, float(system.frequency))
    assert np.max(apart) < 1e-8 * max(float(system.frequency), float(np.max(np.abs(result.exponents))))


@FEW
@given(SEEDS, st.floats(0.0, 6.0))
def test_origin_of_time_does_not_matter(seed: int, phase: float) -> None:
    """A(t + t0): harmonics rotated by k phase, multipliers unchanged."""
    system = random_system(seed)
    k = np.array([1.0, 2.0])[:, None, None] * phase
    moved = PeriodicSystem.from_matrices(
        system.A_0, system.A_cos * np.cos(k) + system.A_sin * np.sin(k),
        system.A_sin * np.cos(k) - system.A_cos * np.sin(k), frequency=system.frequency,
    )  # fmt: skip
    base, other = floquet(system), floquet(moved)
    assert abs(base.growth_rate - other.growth_rate) <= base.growth_error + other.growth_error + 1e-12


@FEW
@given(SEEDS, st.integers(2, 60))
def test_number_of_segments_does_not_matter(seed: int, segments: int) -> None:
    system = random_system(seed)
    base, other = floquet(system), floquet(system, min_segments=segments)
    assert abs(base.growth_rate - other.growth_rate) <= base.growth_error + other.growth_error


@FEW
@given(SEEDS)
def test_counting_two_periods_as_one_squares_the_multipliers(seed: int) -> None:
    system = random_system(seed)
    zero = np.zeros((4, 4))
    cosine = np.stack([zero, system.A_cos[0], zero, system.A_cos[1]])
    sine = np.stack([zero, system.A_sin[0], zero, system.A_sin[1]])
    slow = PeriodicSystem.from_matrices(system.A_0, cosine, sine, frequency=0.5 * system.frequency)
    base, other = floquet(system), floquet(slow)
    assert abs(base.growth_rate - other.growth_rate) <= base.growth_error + other.growth_error + 1e-11
