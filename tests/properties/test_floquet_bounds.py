"""Error bounds of every engine bound the true error, and by no more than a stated factor too much.

Truth without rounding: with a triangular A(t) the exponents are the means of its diagonal, however strongly its states
are coupled; a unimodular change of states with whole numbers hides the triangle and is exact in floating point.
"""

from __future__ import annotations

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linear_sum_assignment

import maglev_ctrl.analysis.floquet as floquet_module
from maglev_ctrl.analysis.floquet import floquet
from maglev_ctrl.errors import Agreement
from maglev_ctrl.kernels import hill_spectrum, periodic_multipliers, piecewise_error, piecewise_propagators
from maglev_ctrl.systems import PeriodicSystem

SEEDS = st.integers(0, 10_000)
FEW = settings(max_examples=8, deadline=None, derandomize=True)
GRID = 2.0**-20  # all numbers are whole multiples of this: nothing is rounded
KINDS = ("moderate", "non-normal", "nearly defective", "stiff", "many harmonics")


def hidden_triangle(seed: int, kind: str) -> tuple[PeriodicSystem, np.ndarray]:
    """A dense periodic system and its exponents."""
    rng = np.random.default_rng(seed)
    n, harmonics = 4, 6 if kind == "many harmonics" else 2
    size = 40.0 if kind == "non-normal" else 1.0
    diagonal = rng.permutation(n) - 3.0 + rng.uniform(0.0, 0.5, n)  # apart from one another
    if kind == "stiff":
        diagonal[:2] = -rng.uniform(200.0, 800.0, 2)
    if kind == "nearly defective":
        diagonal[1] = diagonal[0] + 2.0**-19

    def exact(matrix: np.ndarray) -> np.ndarray:
        return np.asarray(np.round(matrix / GRID) * GRID)

    change = np.eye(n)
    for _ in range(4):
        i, j = rng.permutation(n)[:2]
        change[i] += change[j]
    inverse = np.round(np.linalg.inv(change))
    assert np.array_equal(change @ inverse, np.eye(n))
    mean = exact(np.triu(size * rng.standard_normal((n, n)), 1) + np.diag(diagonal))
    parts = [exact(np.triu(rng.standard_normal((n, n))) / k) for k in range(1, 2 * harmonics + 1)]
    moved = [change @ part @ inverse for part in parts]
    system = PeriodicSystem.from_matrices(change @ mean @ inverse, moved[:harmonics], moved[harmonics:],
                                          frequency=float(rng.uniform(2.0, 8.0)))  # fmt: skip
    return system, np.diag(mean).copy()


def excess(found: np.ndarray, bound: np.ndarray, truth: np.ndarray, frequency: float) -> tuple[float, np.ndarray]:
    """Largest error over its bound, exponents paired with the truth in the best way, and the errors."""
    apart = found[:, None] - truth[None, :]
    apart = np.abs(apart - 1j * frequency * np.round(apart.imag / frequency))
    rows, columns = linear_sum_assignment(apart)
    return float(np.max(apart[rows, columns] / bound[rows])), apart[rows, columns]


@FEW
@given(SEEDS)
@pytest.mark.parametrize("kind", KINDS)
def test_bounds_of_both_engines_together_and_of_hill_alone(kind: str, seed: int) -> None:
    system, truth = hidden_triangle(seed, kind)
    W = float(system.frequency)
    result = floquet(system)
    over, _ = excess(result.exponents, result.error_bound, truth, W)
    assert over <= 1.0
    hill = hill_spectrum(system.A_0, system.A_cos, system.A_sin, frequency=W)
    over, error = excess(hill.exponents, hill.error, truth, W)
    assert over <= 1.0
    if kind in ("moderate", "stiff", "many harmonics"):
        assert hill.converged and result.agreement is Agreement.AGREED
        # not absurdly loose: conditions of the exponents reach a few thousand here
        assert np.max(hill.error) <= 1e-6 * max(W, float(np.max(np.abs(truth))))
        assert result.growth_error <= 1e-6 * max(W, float(np.max(np.abs(truth))))
    assert np.all(np.isfinite(error))


def test_a_hundredth_of_the_bounds_would_not_do_mutant_is_caught() -> None:
    worst = [0.0, 0.0]
    for seed in range(12):
        system, truth = hidden_triangle(seed, "nearly defective")
        W = float(system.frequency)
        result, hill = floquet(system), hill_spectrum(system.A_0, system.A_cos, system.A_sin, frequency=W)
        worst[0] = max(worst[0], excess(result.exponents, result.error_bound, truth, W)[0])
        worst[1] = max(worst[1], excess(hill.exponents, hill.error, truth, W)[0])
    assert min(worst) > 1e-4  # a bound a ten thousandth as large is caught by one of these systems


def exact_logs(factors: np.ndarray) -> np.ndarray:
    with mpmath.workdps(120):
        product = mpmath.eye(factors.shape[-1])
        for factor in factors:
            product = mpmath.matrix(factor.tolist()) * product
        values = mpmath.eig(product, left=False, right=False)
        return np.array(sorted((float(mpmath.log(abs(v))) for v in values), reverse=True))


@FEW
@given(SEEDS)
def test_bound_of_periodic_qr(seed: int) -> None:
    """Strongly stretching factors: each modulus within its bound; the largest one known to 1e-10 at least."""
    rng = np.random.default_rng(seed)
    factors = np.array([np.linalg.qr(rng.standard_normal((4, 4)))[0] * 10.0 ** rng.uniform(-1.0, 1.0, 4)
                        for _ in range(30)])  # fmt: skip
    found = periodic_multipliers(factors)
    off = np.abs(found.logs.real - exact_logs(factors))
    assert found.converged
    assert off[0] <= found.error[0] + 1e-15 and found.error[0] < 1e-8


@FEW
@given(SEEDS)
def test_bound_of_the_piecewise_engine(seed: int) -> None:
    """Defective, stiff and non-normal pieces; bounds within 1e6 of the error or of one rounding."""
    rng = np.random.default_rng(seed)
    pieces = [rng.standard_normal((4, 4)), np.triu(20.0 * rng.standard_normal((4, 4)), 1) - 0.5 * np.eye(4),
              -np.diag(10.0 ** rng.uniform(0.0, 2.5, 4)) + 0.5 * rng.standard_normal((4, 4)),
              np.eye(4, k=1) - np.eye(4)]  # fmt: skip
    times = rng.uniform(0.2, 2.0, 4)
    found, bound = piecewise_propagators(pieces, times), piecewise_error(pieces, times)
    with mpmath.workdps(60):
        for A, t, X, limit in zip(pieces, times, found, bound, strict=True):
            true = mpmath.expm(mpmath.matrix(A.tolist()) * mpmath.mpf(float(t)), method="taylor")
            exact = np.array((true - mpmath.matrix(X.tolist())).tolist(), dtype=float)
            error = float(np.linalg.norm(exact, 2))
            assert error <= limit
            assert limit <= 1e6 * max(error, np.finfo(float).eps * float(np.linalg.norm(X, 2)))


def test_hill_that_does_not_converge_leaves_the_point_unresolved(monkeypatch: pytest.MonkeyPatch) -> None:
    """A modulation too deep for the harmonics allowed: the time domain alone decides nothing."""
    deep = PeriodicSystem.from_matrices([[0, 1], [-1, -0.1]], [[[0, 0], [-4000.0, 0]]], frequency=1.0)
    resolved = floquet(PeriodicSystem.from_matrices([[0, 1], [-1, -0.1]], [[[0, 0], [-4.0, 0]]], frequency=1.0))
    assert resolved.agreement is Agreement.AGREED
    original = floquet_module.hill_spectrum
    monkeypatch.setattr(floquet_module, "hill_spectrum", lambda *a, **k: original(*a, **k, max_size=60))
    result = floquet(deep)
    assert not result.engines[1].converged
    assert result.agreement is Agreement.UNRESOLVED and result.stable is None


@pytest.mark.parametrize("wrong", [1.0 + 1e-6, 1.0 - 1e-6])
def test_a_broken_hill_engine_is_caught(monkeypatch: pytest.MonkeyPatch, wrong: float) -> None:
    system, _ = hidden_triangle(3, "moderate")
    original = floquet_module.hill_spectrum
    assert floquet(system).agreement is Agreement.AGREED
    monkeypatch.setattr(floquet_module, "hill_spectrum",
                        lambda A_0, *a, **k: original(A_0 * wrong, *a, **k))  # fmt: skip
    assert floquet(system).agreement is Agreement.UNRESOLVED
