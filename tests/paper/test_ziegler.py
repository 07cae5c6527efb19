"""Damping-induced flutter (Ziegler) and the roll-sway block of the double-L vehicle, model P, sample S1.

Sources: Ziegler, Ingenieur-Archiv 20 (1952) 49; Routh-Hurwitz on s^4 + (e+d) s^3 + (A11+A22+ed) s^2
+ (e A22 + d A11) s + A11 A22 + beta, closed form and 40-digit roots.
"""

from __future__ import annotations

import numpy as np
import pytest

from maglev_ctrl.analysis.boundary import stability_boundaries
from maglev_ctrl.analysis.modes import ModeKind, StabilityVerdict, modes, spectral_abscissa
from maglev_ctrl.analysis.routh import exact_root_count
from maglev_ctrl.systems import SecondOrderSystem

ZIEGLER = np.array([[4.0, 1.0], [-2.0, 1.0]])  # A11 = 4, A22 = 1, A12 A21 = -2
S1_P = np.array([[841.9632099447514, 9198.933772349588], [-10.46173422, 588.399]])  # target RH_S1_P_A
S1_E_CRIT = 3.3321052564723406  # target RH_S1_P_ecrit_ratio10: e = E/I when d = D/m = 10 e


def damped(A: np.ndarray, e: float, d: float) -> SecondOrderSystem:
    return SecondOrderSystem.from_matrices(np.eye(2), np.diag([e, d]), A, dofs=("car.roll", "car.sway"))


def hurwitz_margin(A: np.ndarray, e: float, d: float) -> float:
    """ed Delta^2 + ed (e+d)(e A22 + d A11) - (e+d)^2 beta: positive means stable."""
    delta, beta = A[0, 0] - A[1, 1], -A[0, 1] * A[1, 0]
    return e * d * delta**2 + e * d * (e + d) * (e * A[1, 1] + d * A[0, 0]) - (e + d) ** 2 * beta


def test_undamped_frequencies() -> None:
    found = modes(damped(ZIEGLER, 0.0, 0.0))
    np.testing.assert_allclose(found.natural_frequency**2, [2.0, 3.0], rtol=1e-12)
    assert found.kind == (ModeKind.NEUTRAL, ModeKind.NEUTRAL)
    assert found.verdict is StabilityVerdict.UNRESOLVED


def test_equal_damping_growth() -> None:
    found = modes(damped(ZIEGLER, 0.01, 0.01))
    assert found.spectral_abscissa == pytest.approx(-0.005, rel=1e-8)
    assert found.stable


def test_unequal_damping_destabilises() -> None:
    # (1 + r)^2 / r beta < Delta^2 fails at r = 10: 12.1 * 2 > 9, though undamped flutter needs only 4 * 2 > 9
    found = modes(damped(ZIEGLER, 0.01, 0.1))
    assert found.verdict is StabilityVerdict.UNSTABLE
    assert exact_root_count(damped(ZIEGLER, 0.01, 0.1)).right == 2
    # The circulatory forces feed it (damping alone would dissipate): a coupled-mode flutter.
    assert found.kind[found.critical] is ModeKind.COUPLED_MODE_FLUTTER
    assert np.sum(found.ledger.damping[:, found.critical]) < 0.0 < np.sum(found.ledger.circulatory[:, found.critical])


def test_destabilisation_needs_circulation_mutant_is_caught() -> None:
    symmetric = np.array([[4.0, 1.0], [2.0, 1.0]])  # one flipped sign
    assert modes(damped(symmetric, 0.01, 0.1)).stable


def test_ratio_of_dampings_at_the_boundary_of_small_damping() -> None:
    def growth(ratio: float) -> float:
        return float(spectral_abscissa(damped(ZIEGLER, 1e-4, 1e-4 * ratio)))

    found = stability_boundaries(growth, 0.2, 5.0, samples=60)
    assert [c.direction for c in found.crossings] == ["gains", "loses"]
    # (1 + r)^2 / r = Delta^2 / beta = 9/2 -> r = 1/2 and 2, up to the square of the damping
    np.testing.assert_allclose([c.value for c in found.crossings], [0.5, 2.0], atol=1e-6)


def test_critical_damping_of_the_double_l_sample() -> None:
    def growth(e: float) -> float:
        return float(spectral_abscissa(damped(S1_P, e, 10.0 * e)))

    found = stability_boundaries(growth, 0.1, 20.0, samples=60, tolerance=1e-10)
    assert [c.direction for c in found.crossings] == ["gains"]
    assert found.crossings[0].value == pytest.approx(S1_E_CRIT, rel=1e-8)
    assert modes(damped(S1_P, 0.99 * S1_E_CRIT, 9.9 * S1_E_CRIT)).verdict is StabilityVerdict.UNSTABLE
    assert modes(damped(S1_P, 1.01 * S1_E_CRIT, 10.1 * S1_E_CRIT)).verdict is StabilityVerdict.STABLE


def test_critical_damping_mutant_is_caught() -> None:
    swapped = S1_P[::-1, ::-1]  # roll and sway exchanged, dampings not
    found = stability_boundaries(
        lambda e: float(spectral_abscissa(damped(swapped, e, 10.0 * e))), 0.1, 20.0, samples=60
    )
    assert all(abs(c.value / S1_E_CRIT - 1.0) > 1e-3 for c in found.crossings)


def test_closed_form_condition_against_modes_and_exact_count() -> None:
    rng = np.random.default_rng(7)
    checked = 0
    for _ in range(150):
        A11, A22 = rng.uniform(1.0, 10.0, 2)
        beta = rng.uniform(0.0, 4.0)
        A = np.array([[A11, 1.0], [-beta, A22]])
        e, d = 10.0 ** rng.uniform(-2.0, 0.5, 2)
        found = modes(damped(A, e, d))
        if found.verdict is StabilityVerdict.UNRESOLVED:
            continue
        checked += 1
        assert found.stable == (hurwitz_margin(A, e, d) > 0.0)
        assert found.stable == (exact_root_count(damped(A, e, d)).right == 0)
    assert checked > 140
