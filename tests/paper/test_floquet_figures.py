"""How near the truth Floquet analysis comes: Mathieu to 1e-9, Meissner to 1e-12, Hsu's widths with their eps^2 trend.

Sources: scipy's characteristic values of Mathieu's equation; closed form of Meissner's; Hsu, J. Appl. Mech. 30 (1963);
products of matrices in extended precision.
"""

from __future__ import annotations

from collections.abc import Callable

import mpmath
import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import mathieu_a, mathieu_b

from maglev_ctrl.analysis.floquet import floquet
from maglev_ctrl.analysis.tongue_table import TongueRow, tongue_table
from maglev_ctrl.errors import Agreement
from maglev_ctrl.kernels import periodic_multipliers, piecewise_propagators
from maglev_ctrl.systems import PeriodicSystem, SecondOrderSystem, modulate

Path = Callable[[float], PeriodicSystem]


def rows_of(path: Path, depth: float, lower: float, upper: float, order: int = 1) -> list[TongueRow]:
    found = tongue_table(path, depth=depth, lower=lower, upper=upper, largest_depth=depth, max_order=order,
                         removals=False)  # fmt: skip
    return [row for row in found if row.resonance.order == order]


# ------------------------------------------------------------------------------------------------------ Mathieu
@pytest.mark.parametrize(
    ("order", "q"), [(1, 0.1), (1, 0.4), (2, 0.3), (2, 1.0), (3, 1.0), (3, 3.0), (4, 2.0), (4, 5.0)]
)
def test_mathieu_tongues_are_scipys(order: int, q: float, record_property) -> None:
    """y'' + (a - 2 q cos 2t) y = 0: tongue k lies between b_k and a_k; the path runs over a."""

    def path(a: float) -> PeriodicSystem:
        return PeriodicSystem.from_matrices([[0, 1], [-a, 0]], [[[0, 0], [2, 0]]], frequency=2.0)

    (row,) = rows_of(path, q, max(order**2 - 0.9 * order, 0.05), order**2 + 0.9 * order, order)
    assert row.resonance.name == f"2 w1/{order}"
    lower, upper = row.computed_centre - row.computed_half_width, row.computed_centre + row.computed_half_width
    off = max(abs(lower / mathieu_b(order, q) - 1.0), abs(upper / mathieu_a(order, q) - 1.0))
    record_property("error", float(off))
    record_property("allowed", 1e-9)
    assert off < 1e-9


# ----------------------------------------------------------------------------------------------------- Meissner
def closed_form(delta: float, eps: float, c: float) -> float:
    p1, p2 = (np.sqrt(complex(delta + sign * eps - 0.25 * c * c)) for sign in (1.0, -1.0))
    cosines, sines = np.cos(np.pi * p1) * np.cos(np.pi * p2), np.sin(np.pi * p1) * np.sin(np.pi * p2)
    return float((2.0 * cosines - (p1 / p2 + p2 / p1) * sines).real * np.exp(-np.pi * c))


def by_engine(delta: float, eps: float, c: float) -> float:
    """Sum of the multipliers by the piecewise engine and periodic QR."""
    matrices = [[[0.0, 1.0], [-(delta + sign * eps), -c]] for sign in (1.0, -1.0)]
    logs = periodic_multipliers(piecewise_propagators(matrices, [np.pi, np.pi])).logs
    return float(np.sum(np.exp(logs)).real)


MEISSNER = [(0.25, 0.1, 0.0), (0.6, 0.2, 0.0), (2.3, 1.7, 0.0), (0.1, 0.2, 0.05), (5.2, 0.4, 0.1)]


@pytest.mark.parametrize(("delta", "eps", "c"), MEISSNER)
def test_meissner_trace(delta: float, eps: float, c: float) -> None:
    assert by_engine(delta, eps, c) == pytest.approx(closed_form(delta, eps, c), rel=1e-12, abs=1e-12)
    assert abs(by_engine(delta, eps, c) - closed_form(delta, -1.01 * eps, c)) > 1e-6  # mutant


@pytest.mark.parametrize("eps", [0.05, 0.1, 0.2])
def test_meissner_edges(eps: float) -> None:
    """First tongue, stable |tr| < 2: lower and upper edge in delta."""
    for low, high in ((0.25 - 1.2 * eps, 0.25), (0.25, 0.25 + 1.2 * eps)):
        found, exact = (
            brentq(lambda d, f=f: f(d, eps, 0.0) + 2.0, low, high, xtol=1e-15, rtol=1e-14)
            for f in (by_engine, closed_form)
        )  # fmt: skip
        assert found == pytest.approx(exact, abs=1e-12)
        assert abs(exact - 0.25) == pytest.approx(2.0 * eps / np.pi, rel=eps)


# ---------------------------------------------------------------------------------------------------------- Hsu
DOUBLE_L = (
    np.diag([0.006350736014167257, 1.0197162129779282]),
    np.array([[9.06341088, 58.42], [44.196, 600.0]]),
    np.array([[10.68901088, 58.42], [44.196, 600.0]]),
)
TWO_MODES = (np.eye(2), np.diag([1.0, 2.89]), np.array([[0.5, 0.4], [0.3, 0.6]]))


# The circulatory example is modulated as deeply as it is stiff and reaches the thousandth at half the depth.
@pytest.mark.parametrize(("case", "lower", "upper", "at"), [(TWO_MODES, 1.7, 3.7, 0.1), (DOUBLE_L, 30.0, 90.0, 0.05)])
def test_hsu_widths_within_a_thousandth_and_off_by_the_square_of_the_depth(case, lower, upper, at) -> None:
    """Ratio of computed to first-order width, and its distance from one at twice, once and half the depth."""
    M, K, K_1 = case
    spring = SecondOrderSystem.from_matrices(M, np.zeros((2, 2)), K)
    off: dict[str, list[float]] = {}
    for eps in (2.0 * at, at, 0.5 * at):
        for row in rows_of(lambda W: modulate(spring, [K_1], frequency=W), eps, lower, upper):
            if row.first_order_half_width > 0.0:
                ratio = row.computed_half_width / row.first_order_half_width
                off.setdefault(row.resonance.name, []).append(ratio - 1.0)
    assert len(off) == 3
    for wide, middle, narrow in off.values():
        assert abs(middle) < 1e-3
        # the next term is of the fourth order: its share of the ratio falls with the depth
        assert wide / middle == pytest.approx(4.0, rel=0.06)
        assert middle / narrow == pytest.approx(4.0, rel=0.015)


def test_transposed_modulation_keeps_and_swapped_sign_loses_the_sum_tongue_mutant_is_caught() -> None:
    M, K, K_1 = TWO_MODES
    spring = SecondOrderSystem.from_matrices(M, np.zeros((2, 2)), K)
    for matrix, there in ((K_1.T, True), (np.array([[0.5, 0.4], [-0.3, 0.6]]), False)):
        (row,) = rows_of(lambda W, K_1=matrix: modulate(spring, [K_1], frequency=W), 0.1, 2.5, 2.9)
        assert row.resonance.kind == "sum" and (row.first_order_half_width > 0.0) is there


@pytest.mark.parametrize("zeta", [0.005, 0.02])
def test_gap_modulation_threshold_is_twice_the_damping_ratio(zeta: float) -> None:
    """z_0 (1 + eta cos W t) with F ~ 1/z: the stiffness changes by 2 eta, unstable from eta = 2 zeta on."""

    def path(W: float) -> PeriodicSystem:
        return PeriodicSystem.from_matrices([[0, 1], [-1, -2 * zeta]], [[[0, 0], [-2, 0]]], frequency=W)

    (row,) = tongue_table(path, depth=0.2, lower=1.7, upper=2.4, largest_depth=0.3, max_order=1, removals=False)
    assert row.onset == pytest.approx(2.0 * zeta, rel=zeta)
    assert row.first_order_half_width == pytest.approx(np.sqrt(0.2**2 - (2.0 * zeta) ** 2), rel=1e-3)


# -------------------------------------------------------------------------------------------- spread multipliers
def test_stiff_multiplier_of_3e_66() -> None:
    """A published triangular system whose multipliers are 1 and exp(-48 pi) = 3e-66."""
    A_1 = [[[0.0, 0.0], [-10.0, 0.0]]]
    result = floquet(PeriodicSystem.from_matrices([[0, 1], [0, -24]], A_1, [[[0, 0], [0, -10]]], frequency=1.0))
    assert result.agreement is Agreement.AGREED
    assert abs(result.multipliers[0] - 1.0) < 1e-12
    assert result.multipliers[1].real == pytest.approx(np.exp(-48.0 * np.pi), rel=1e-12)


def logs_in_extended_precision(factors: np.ndarray) -> np.ndarray:
    """log of the moduli of the product's eigenvalues, largest first, by a Hessenberg QR with 250 digits."""
    with mpmath.workdps(250):
        product = mpmath.eye(factors.shape[-1])
        for factor in factors:
            product = mpmath.matrix(factor.tolist()) * product
        values = mpmath.eig(product, left=False, right=False)
        return np.array(sorted((float(mpmath.log(abs(v))) for v in values), reverse=True))


def turned(rng: np.random.Generator, exponents: np.ndarray) -> np.ndarray:
    """One factor near the identity: a stretch seen from a slightly turned basis."""
    n = len(exponents)
    skew = 0.05 * rng.standard_normal((n, n))
    turn = np.linalg.solve(np.eye(n) + (skew - skew.T), np.eye(n) - (skew - skew.T))
    return np.asarray(turn @ np.diag(np.exp(exponents)) @ turn.T)


def test_random_product_of_three_hundred_factors(record_property) -> None:
    """Moduli from 1e-52 to 1e13: all of them to 1e-12."""
    rng = np.random.default_rng(300)
    factors = np.array([turned(rng, np.array([0.14, 0.0, -0.16, -0.45]) + 0.05 * rng.standard_normal(4))
                        for _ in range(300)])  # fmt: skip
    exact = logs_in_extended_precision(factors)
    found = periodic_multipliers(factors)
    off = np.abs(found.logs.real - exact)
    assert exact[0] > np.log(1e13) and exact[-1] < np.log(7.7e-53)
    record_property("error", float(np.max(off)))
    record_property("allowed", 1e-12)
    assert found.converged and np.max(off) < 1e-12
    assert np.all(off <= found.error)


def test_symplectic_product_from_1e55_down_to_1e_55(record_property) -> None:
    """Multipliers in reciprocal pairs, 110 decades apart."""
    rng = np.random.default_rng(8)
    rates = 1.05 * np.array([0.42, 0.3, 0.17, 0.05])
    factors = []
    for _ in range(300):
        lead = turned(rng, rates)
        shear = 0.02 * rng.standard_normal((4, 4))
        block = np.block([[lead, np.zeros((4, 4))], [np.zeros((4, 4)), np.linalg.inv(lead).T]])
        factors.append(block @ np.block([[np.eye(4), shear + shear.T], [np.zeros((4, 4)), np.eye(4)]]))
    product = np.array(factors)
    exact = logs_in_extended_precision(product)
    found = periodic_multipliers(product)
    assert exact[0] > np.log(1e55) and exact[-1] < np.log(1e-55)
    record_property("error", float(np.max(np.abs(found.logs.real - exact))))
    record_property("allowed", 1e-12)
    assert np.max(np.abs(found.logs.real - exact)) < 1e-12
    assert np.all(np.abs(found.logs.real - exact) <= found.error)
