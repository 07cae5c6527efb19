"""Floquet analysis: agreement of two engines, error bounds, stiff and badly scaled systems."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest
from scipy.special import mathieu_a, mathieu_b

import maglev_ctrl.analysis.floquet as floquet_module
from maglev_ctrl.analysis.floquet import floquet
from maglev_ctrl.errors import Agreement
from maglev_ctrl.systems import PeriodicSystem

HZ = 2 * np.pi


def stiff_vehicle(period: float, *, spoil: bool = True) -> PeriodicSystem:
    """Six light modes of 0.9..7 Hz at 1 % damping with eight real poles of 20..125 rad/s; units 8 decades apart."""
    rng = np.random.default_rng(3)
    w = HZ * np.array([0.9, 1.3, 1.7, 3.0, 5.0, 7.0])
    A, A_1 = np.zeros((20, 20)), np.zeros((20, 20))
    A[:6, 6:12] = np.eye(6)
    A[6:12, :6] = -np.diag(w**2)
    A[6:12, 6:12] = -0.02 * np.diag(w)
    A[12:, 12:] = -np.diag([125.0, 125.0, 90.0, 80.0, 60.0, 40.0, 30.0, 20.0])
    A[6:12, 12:] = 0.1 * rng.standard_normal((6, 8))
    A[12:, 6:12] = rng.standard_normal((8, 6))
    A_1[6:12, :6] = -20.0 * rng.standard_normal((6, 6))
    d = 10.0 ** rng.uniform(-4, 4, 20) if spoil else np.ones(20)
    return PeriodicSystem.from_matrices(A * d / d[:, None], [A_1 * d / d[:, None]], frequency=HZ / period)


def commuting(exponents: np.ndarray, frequency: float, seed: int = 0) -> PeriodicSystem:
    """A(t) = S [diag(exponents) + diag(a) cos W t + diag(b) sin W t] S^-1: exponents known exactly."""
    rng = np.random.default_rng(seed)
    n = len(exponents)
    S = np.eye(n) + 0.3 * rng.standard_normal((n, n))
    a, b = rng.standard_normal((2, n))
    inverse = np.linalg.inv(S)
    return PeriodicSystem.from_matrices(
        S @ np.diag(exponents) @ inverse, [S @ np.diag(a) @ inverse], [S @ np.diag(b) @ inverse], frequency=frequency
    )


@pytest.mark.parametrize("period", [0.1, 1.0, 2.0])
def test_stiff_vehicle_engines_agree(period: float) -> None:
    result = floquet(stiff_vehicle(period))
    assert result.agreement is Agreement.AGREED
    clean = floquet(stiff_vehicle(period, spoil=False))
    assert result.growth_rate == pytest.approx(clean.growth_rate, rel=1e-8)
    assert result.spectral_radius == pytest.approx(clean.spectral_radius, rel=1e-8)
    assert result.growth_error < 1e-8 * max(abs(result.growth_rate), 1.0)
    assert np.sum(result.exponents.real) == pytest.approx(np.trace(stiff_vehicle(period).A_0), rel=1e-9)


@pytest.mark.parametrize("seed", range(6))
def test_error_bound_is_a_bound_on_known_exponents(seed: int) -> None:
    expected = np.sort(np.random.default_rng(seed + 50).uniform(-30.0, 1.0, 5))[::-1]
    result = floquet(commuting(expected, 2.0 + seed, seed))
    assert result.agreement is Agreement.AGREED
    error = np.abs(result.exponents - expected)
    assert np.all(error <= result.error_bound)
    assert abs(result.growth_rate - expected[0]) <= result.growth_error + 1e-15


@pytest.mark.parametrize(("kind", "order", "q"), [("a", 1, 0.5), ("b", 1, 5.0), ("b", 2, 1.0)])
def test_error_bound_at_a_double_multiplier(kind: str, order: int, q: float) -> None:
    """At a tongue's edge the two multipliers merge: true growth 0, computed one of order 1e-8, bound says so."""
    a = (mathieu_a if kind == "a" else mathieu_b)(order, q)
    result = floquet(PeriodicSystem.from_matrices([[0, 1], [-a, 0]], [[[0, 0], [2 * q, 0]]], frequency=2.0))
    assert abs(result.growth_rate) <= result.growth_error
    assert result.stable is None
    assert result.agreement is Agreement.AGREED


def test_mathieu_growth_against_thirty_digits() -> None:
    """Growth inside the first tongue from Hill's determinant evaluated with 30 digits."""
    q, a = 0.3, 1.05
    with mpmath.workdps(30):
        N = 12

        def determinant(s: mpmath.mpf) -> mpmath.mpf:
            # real arithmetic: the solution is e^(st) times odd harmonics, y'' + (a - 2q cos 2t) y = 0
            matrix = mpmath.zeros(2 * N)
            for row in range(2 * N):
                k = 2 * row - (2 * N - 1)
                matrix[row, row] = mpmath.mpc(a) + (s + 1j * k) ** 2
                matrix[row, row] /= k * k
                for other in (row - 1, row + 1):
                    if 0 <= other < 2 * N:
                        matrix[row, other] = mpmath.mpf(-q) / (k * k)
            return mpmath.re(mpmath.det(matrix))

        exact = float(mpmath.findroot(determinant, (0.13, 0.15), solver="secant"))
    result = floquet(PeriodicSystem.from_matrices([[0, 1], [-a, 0]], [[[0, 0], [2 * q, 0]]], frequency=2.0))
    assert result.growth_rate == pytest.approx(exact, rel=1e-8)
    assert abs(result.growth_rate - exact) <= result.growth_error + 1e-12


@pytest.mark.parametrize("segments", [3, 5, 17, 80])
def test_result_does_not_depend_on_the_number_of_segments(segments: int) -> None:
    system = stiff_vehicle(1.0)
    base, other = floquet(system), floquet(system, min_segments=segments)
    assert abs(base.growth_rate - other.growth_rate) <= base.growth_error + other.growth_error
    assert np.allclose(np.sort(base.exponents.real), np.sort(other.exponents.real), rtol=1e-8, atol=1e-9)


def test_disagreement_says_unresolved(monkeypatch: pytest.MonkeyPatch) -> None:
    """An engine that is made wrong by one part in 1e6 is caught."""
    original = floquet_module.propagators_over_depths
    system = commuting(np.array([-0.5, -2.0, -9.0]), 3.0)
    assert floquet(system).agreement is Agreement.AGREED

    def wrong(*arguments: np.ndarray, **named: object) -> np.ndarray:
        return original(*arguments, **named) * (1.0 + 1e-6)  # type: ignore[arg-type]

    monkeypatch.setattr(floquet_module, "propagators_over_depths", wrong)
    result = floquet(system)
    assert result.agreement is Agreement.UNRESOLVED
    assert result.stable is None
    assert result.error_bound[0] > 1e-7


def test_constant_system_is_its_own_eigenvalues() -> None:
    A = np.array([[0.0, 1.0], [-4.0, -0.4]])
    result = floquet(PeriodicSystem.from_matrices(A, np.zeros((1, 2, 2)), frequency=30.0))
    assert np.allclose(np.sort_complex(result.exponents), np.sort_complex(np.linalg.eigvals(A)), atol=1e-12)
    assert result.stable is True


def test_four_harmonics_with_phases_and_a_stiff_pole() -> None:
    """Joint-like modulation: harmonics 1, 1/2, 1/3, 1/4 in both phases on two modes with an actuator pole at -125."""
    A = np.zeros((5, 5))
    A[:2, 2:4] = np.eye(2)
    A[2:4, :2] = -np.diag([64.0, 100.0])
    A[2:4, 2:4] = -0.1 * np.eye(2)
    A[4, 4], A[2:4, 4], A[4, 2:4] = -125.0, 3.0, 1.0
    shape = np.zeros((5, 5))
    shape[2:4, :2] = [[12.0, 4.0], [-3.0, 20.0]]
    cosine = np.array([shape / k for k in (1, 2, 3, 4)])
    sine = np.array([0.5 * shape / k**2 for k in (1, 2, 3, 4)])
    for W in (4.0, 16.2, 40.0):
        result = floquet(PeriodicSystem.from_matrices(A, cosine, sine, frequency=W))
        assert result.agreement is Agreement.AGREED
        assert np.sum(result.exponents.real) == pytest.approx(np.trace(A), rel=1e-10)


def test_batches_are_refused() -> None:
    system = PeriodicSystem.from_matrices(np.zeros((3, 2, 2)), np.zeros((3, 1, 2, 2)), frequency=np.ones(3))
    with pytest.raises(ValueError, match="system: expected one periodic system"):
        floquet(system)
