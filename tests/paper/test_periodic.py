"""Parametric and combination resonance: exact Mathieu, Meissner and Floquet references, Hsu's closed forms.

Sources: truncated Hill matrix with 30 harmonics in extended precision (characteristic values); closed-form trace of
Meissner's equation; DOP853 at 1e-12 with roots of the spectral radius (intervals); Hsu, J. Appl. Mech. 30 (1963).
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq

from maglev_ctrl.analysis.floquet import floquet
from maglev_ctrl.analysis.resonance import Tongue, hsu_tongues, tongues
from maglev_ctrl.analysis.resonance_naming import name_instability
from maglev_ctrl.errors import Agreement
from maglev_ctrl.kernels import piecewise_propagators, tree_product
from maglev_ctrl.systems import PeriodicSystem, SecondOrderSystem, modulate

I2, K0 = np.eye(2), np.diag([1.0, 2.89])
PLUS, MINUS = np.array([[0.5, 0.4], [0.3, 0.6]]), np.array([[0.5, 0.4], [-0.3, 0.6]])
DAMPED = np.diag([0.004, 0.012])
M_CG = np.diag([0.006350736014167257, 1.0197162129779282])
K_CG = np.array([[9.06341088, 58.42], [44.196, 600.0]])
K1_CG = np.array([[10.68901088, 58.42], [44.196, 600.0]])


def periodic(K1: np.ndarray, frequency: float, eps: float, *, M=I2, K=K0, C=None, K1_sin=None) -> PeriodicSystem:
    system = SecondOrderSystem.from_matrices(M, np.zeros_like(K) if C is None else C, K)
    sine = None if K1_sin is None else [eps * np.asarray(K1_sin)]
    return modulate(system, [eps * np.asarray(K1)], sine, frequency=frequency)


def mathieu(a: float, q: float) -> PeriodicSystem:
    return PeriodicSystem.from_matrices([[0, 1], [-a, 0]], [[[0, 0], [2 * q, 0]]], frequency=2.0)


def trace(system: PeriodicSystem) -> float:
    return float(np.sum(floquet(system).multipliers).real)


MATHIEU = [  # (order, q, characteristic value); trace of the monodromy over pi is +2 for even, -2 for odd order
    (0, 0.5, -0.1217655449410827),
    (1, 0.2, 0.7951238680838633),
    (1, 1.0, -0.11024881699209517),
    (2, 1.0, 3.917024772998471),
    (3, 1.0, 9.047739259809376),
    (1, 5.0, -5.790080598637771),
]


@pytest.mark.parametrize(("order", "q", "value"), MATHIEU)
def test_mathieu_characteristic_values(order: int, q: float, value: float) -> None:
    def edge(a: float) -> float:
        return trace(mathieu(a, q)) - 2.0 * (-1.0) ** order

    step = 1e-3 * max(1.0, abs(value))
    found = brentq(edge, value - step, value + step, xtol=1e-13)
    assert found == pytest.approx(value, rel=1e-9, abs=1e-11)


def test_mathieu_limits_in_frequency() -> None:
    """q'' + (1 + 0.1 cos W t) q = 0: exact limits of the principal region; Hsu's 2 -+ eta/2 is 3e-4 off."""

    def edge(W: float) -> float:
        system = PeriodicSystem.from_matrices([[0, 1], [-1, 0]], [[[0, 0], [-0.1, 0]]], frequency=W)
        return trace(system) + 2.0

    assert brentq(edge, 1.93, 1.96, xtol=1e-13) == pytest.approx(1.9496984382629277, rel=1e-9)
    assert brentq(edge, 2.04, 2.07, xtol=1e-13) == pytest.approx(2.0496787731544197, rel=1e-9)


def meissner_trace(delta: float, eps: float, damping: float = 0.0) -> float:
    """y'' + c y' + [delta + eps sgn(cos t)] y = 0 over 2 pi by exact propagators."""

    def A(k: float) -> list[list[float]]:
        return [[0.0, 1.0], [-k, -damping]]

    factors = piecewise_propagators([A(delta + eps), A(delta - eps), A(delta + eps)], [0.5 * np.pi, np.pi, 0.5 * np.pi])
    return float(np.trace(tree_product(factors)))


def test_meissner_trace() -> None:
    assert meissner_trace(0.25, 0.1) == pytest.approx(-2.159460989758121, rel=1e-10)
    assert meissner_trace(0.6, 0.2) == pytest.approx(0.13257530085971142, rel=1e-10)


@pytest.mark.parametrize(
    ("eps", "lower", "upper"),
    [(0.05, 0.21764211572094974, 0.2812782431034174), (0.2, 0.11482074932538619, 0.3678177280508952)],
)
def test_meissner_limits(eps: float, lower: float, upper: float) -> None:
    def edge(delta: float) -> float:
        return meissner_trace(delta, eps) + 2.0

    assert brentq(edge, lower - 0.01, 0.25, xtol=1e-14) == pytest.approx(lower, rel=1e-9)
    assert brentq(edge, 0.25, upper + 0.01, xtol=1e-14) == pytest.approx(upper, rel=1e-9)


@pytest.mark.parametrize(("delta", "eps", "c"), [(0.25, 0.1, 0.03), (0.6, 0.2, 0.1), (0.1, 0.2, 0.05)])
def test_damped_meissner_closed_form(delta: float, eps: float, c: float) -> None:
    p1, p2 = (np.sqrt(complex(delta + sign * eps - c * c / 4)) for sign in (1.0, -1.0))
    closed = 2 * np.cos(np.pi * p1) * np.cos(np.pi * p2) - (p1 / p2 + p2 / p1) * np.sin(np.pi * p1) * np.sin(np.pi * p2)
    assert meissner_trace(delta, eps, c) == pytest.approx(float(closed.real) * np.exp(-np.pi * c), rel=1e-10)


INTERVALS = [  # K1, C, eps, lower, upper, name
    (PLUS, None, 0.05, 1.987453552160784, 2.012452604234657, "2 w1/1 (q1)"),
    (PLUS, None, 0.05, 2.6933712511332972, 2.7066535775711595, "(w1 + w2)/1 (q1, q2)"),
    (PLUS, DAMPED, 0.1, 1.9751341987126716, 2.0244828627890255, "2 w1/1 (q1)"),
    (MINUS, DAMPED, 0.1, 0.6869642543634507, 0.7131532006074245, "(w2 - w1)/1 (q1, q2)"),
]


def radius_minus_one(W: float, K1: np.ndarray, eps: float, C: np.ndarray | None, **more: np.ndarray) -> float:
    return floquet(periodic(K1, W, eps, C=C, **more)).spectral_radius - 1.0 - 1e-8


@pytest.mark.parametrize(("K1", "C", "eps", "lower", "upper", "name"), INTERVALS)
def test_exact_intervals(K1, C, eps, lower, upper, name) -> None:
    half = 0.5 * (upper - lower)
    for edge, sign in ((lower, -1.0), (upper, 1.0)):
        found = brentq(radius_minus_one, edge + sign * 0.3 * half, edge - sign * 0.3 * half, args=(K1, eps, C),
                       xtol=1e-11)  # fmt: skip
        assert found == pytest.approx(edge, rel=2e-7)
    middle = periodic(K1, 0.5 * (lower + upper), eps, C=C)
    result = floquet(middle)
    assert result.stable is False
    assert result.agreement is Agreement.AGREED
    assert name_instability(middle, result).name == name


def test_exact_interval_with_circulatory_stiffness() -> None:
    lower, upper = 82.86956878063303, 85.20701537468989
    more = {"M": M_CG, "K": K_CG}
    for edge, inward in ((lower, 0.3), (upper, -0.3)):
        found = brentq(lambda W: radius_minus_one(W, K1_CG, 0.05, None, **more), edge - inward, edge + inward,
                       xtol=1e-9)  # fmt: skip
        assert found == pytest.approx(edge, rel=1e-6)
    middle = periodic(K1_CG, 0.5 * (lower + upper), 0.05, **more)
    assert name_instability(middle).name.startswith("2 w2/1")


def test_growth_with_phase_lag() -> None:
    result = floquet(periodic([[0.0, 0.4], [0.3, 0.0]], 2.7, 0.05, K1_sin=[[0.0, 0.2], [-0.3, 0.0]]))
    assert result.growth_rate == pytest.approx(0.0033877423982263733, rel=1e-6)
    found = hsu_tongues(I2, K0, [[0.0, 0.4], [0.3, 0.0]], K_sin=[[0.0, 0.2], [-0.3, 0.0]], depth=0.05)
    first_order = next(t.growth for t in found if t.resonance.kind == "sum")
    assert first_order == pytest.approx(0.00338775, abs=5e-9)
    mutant = hsu_tongues(I2, K0, [[0.0, 0.4], [0.3, 0.0]], K_sin=[[0.0, 0.2], [0.3, 0.0]], depth=0.05)
    assert abs(next(t.growth for t in mutant if t.resonance.kind == "sum") - first_order) > 1e-4


HSU = [  # M, K, C, K1, eps, kind, modes, half width, tolerance
    (I2, K0, None, PLUS, 0.05, "parametric", (1, 1), 0.0125, 1e-10),
    (I2, K0, None, PLUS, 0.05, "sum", (1, 2), 0.0066421116415507145, 1e-10),
    (I2, K0, DAMPED, PLUS, 0.1, "parametric", (1, 1), 0.024677925358506134, 1e-10),
    (I2, K0, DAMPED, MINUS, 0.1, "difference", (1, 2), 0.013087937868398476, 1e-10),
    (M_CG, K_CG, None, K1_CG, 0.05, "parametric", (1, 1), 0.4855468932801659, 1e-8),
    (M_CG, K_CG, None, K1_CG, 0.05, "sum", (1, 2), 0.10342635932466161, 1e-8),
]


def pick(found: tuple[Tongue, ...], kind: str, pair: tuple[int, int]) -> Tongue:
    return next(t for t in found if t.resonance.kind == kind and t.resonance.modes == pair)


@pytest.mark.parametrize(("M", "K", "C", "K1", "eps", "kind", "pair", "half", "tolerance"), HSU)
def test_hsu_half_widths(M, K, C, K1, eps, kind, pair, half, tolerance) -> None:
    found = pick(hsu_tongues(M, K, K1, C=C, depth=eps), kind, pair)
    assert found.half_width == pytest.approx(half, rel=tolerance)
    system = SecondOrderSystem.from_matrices(M, np.zeros((2, 2)) if C is None else C, K)
    full = pick(tongues(system, [K1], depth=eps), kind, pair)
    # the state matrix carries the damped frequencies: second order in c/w, 1e-5 here
    assert full.half_width == pytest.approx(half, rel=tolerance if C is None else 2e-5)


def test_sum_and_difference_exclude_each_other_mutant_is_caught() -> None:
    """d12 d21 > 0 gives the sum type only, a flipped sign the difference type only."""
    for K1, there, absent in ((PLUS, "sum", "difference"), (MINUS, "difference", "sum")):
        found = hsu_tongues(I2, K0, K1, C=DAMPED, depth=0.1)
        assert pick(found, there, (1, 2)).half_width > 0.01
        assert pick(found, absent, (1, 2)).half_width == 0.0


def test_unequal_damping_widens_the_sum_region() -> None:
    """The undamped width is not the limit of the damped one: 0.0066 against 0.0234."""
    bare = pick(hsu_tongues(I2, K0, PLUS, depth=0.05), "sum", (1, 2))
    uneven = pick(hsu_tongues(I2, K0, PLUS, C=np.diag([4e-5, 2e-3]), depth=0.05), "sum", (1, 2))
    assert bare.half_width == pytest.approx(0.0066421, rel=1e-4)
    assert uneven.half_width > 3.0 * bare.half_width
    edge = uneven.centre + 0.9 * uneven.half_width
    assert floquet(periodic(PLUS, edge, 0.05, C=np.diag([4e-5, 2e-3]))).stable is False
    assert floquet(periodic(PLUS, edge, 0.05)).stable is not False
