"""Growth rate = sum of the elements' shares, for any system; checked against matrices formed by their definition."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from maglev_ctrl.analysis.hurwitz import lyapunov_inertia
from maglev_ctrl.analysis.modes import Modes, StabilityVerdict, modes
from maglev_ctrl.analysis.routh import exact_root_count
from maglev_ctrl.arrays import read_only
from maglev_ctrl.systems import Contribution, SecondOrderSystem

SYSTEMS = {
    "seed": st.integers(0, 10**6),
    "n": st.integers(1, 4),
    "n_xi": st.integers(0, 3),
    "elements": st.integers(1, 4),
}


def random_system(seed: int, n: int, n_xi: int, elements: int) -> SecondOrderSystem:
    """Symmetric positive mass plus an antisymmetric part, gyroscopic and circulatory terms, internal states."""
    rng = np.random.default_rng(seed)

    def frozen(array: np.ndarray) -> np.ndarray:
        return read_only(array, name="share")

    shares = []
    for e in range(elements):
        root, skew = rng.standard_normal((n, n)), rng.standard_normal((n, n))
        M = 0.3 * root @ root.T + 0.1 * (skew - skew.T) + np.eye(n)
        C, K = rng.standard_normal((n, n)), 3 * rng.standard_normal((n, n)) + 12 * np.eye(n)
        shares.append(
            Contribution(f"element_{e}", "other", *(frozen(x) for x in (M, C, K, rng.standard_normal((n, n_xi)))))
        )
    M, C, K, F = (sum(getattr(c, key) for c in shares) for key in "MCKF")
    return SecondOrderSystem.from_matrices(
        M, C, K, F=F, internal=tuple(f"xi{i}" for i in range(n_xi)),
        A_internal=rng.standard_normal((n_xi, n_xi)) - 3 * np.eye(n_xi), G_q=rng.standard_normal((n_xi, n)),
        G_v=rng.standard_normal((n_xi, n)), G_a=0.1 * rng.standard_normal((n_xi, n)), contributions=tuple(shares),
    )  # fmt: skip


def by_definition(system: SecondOrderSystem, found: Modes, k: int) -> tuple[np.ndarray, np.ndarray]:
    """Damping and circulatory shares of mode k from Z_e(s), element by element."""
    s, a = found.s[k], found.shapes[:, k]
    lam, w = s.real, s.imag
    response = np.linalg.inv(s * np.eye(len(system.internal)) - system.A_internal) @ (
        system.G_q + s * system.G_v + s**2 * system.G_a
    )

    def form(matrix: np.ndarray) -> complex:
        return complex(a.conj() @ matrix @ a)

    action = 2 * w * form((system.M + system.M.T) / 2).real + form((system.C - system.C.T) / 2).imag
    damping, circulatory = [], []
    for c in system.contributions:
        Z = -c.F @ response
        damping.append(w * form((c.C + c.C.T) / 2).real + form((Z.imag + Z.imag.T) / 2).real)
        circulatory.append(
            form((c.K - c.K.T) / 2).imag
            + (lam**2 - w**2) * form((c.M - c.M.T) / 2).imag
            + form((Z.real - Z.real.T) / 2).imag
        )
    return -np.array(damping) / action, -np.array(circulatory) / action


@settings(max_examples=80, deadline=None)
@given(**SYSTEMS)
def test_shares_add_up_to_the_growth_rate(seed: int, n: int, n_xi: int, elements: int) -> None:
    system = random_system(seed, n, n_xi, elements)
    found = modes(system)
    ledger = found.ledger
    for k in range(len(found.s)):
        if np.isnan(ledger.damping[:, k]).any():
            continue
        assert found.s[k].imag > 0.0
        total = np.sum(ledger.damping[:, k] + ledger.circulatory[:, k])
        assert abs(total - found.s[k].real) <= 1e-10 * abs(found.s[k])
        damping, circulatory = by_definition(system, found, k)
        size = abs(found.s[k]) + np.max(np.abs(damping)) + np.max(np.abs(circulatory))
        np.testing.assert_allclose(ledger.damping[:, k], damping, atol=1e-8 * size)
        np.testing.assert_allclose(ledger.circulatory[:, k], circulatory, atol=1e-8 * size)


def test_most_oscillating_modes_have_a_split() -> None:
    defined = oscillating = 0
    for seed in range(60):
        found = modes(random_system(seed, 1 + seed % 4, seed % 3, 2))
        rows = found.s.imag > 1e-6
        oscillating += int(np.sum(rows))
        defined += int(np.sum(~np.isnan(found.ledger.damping[0, rows])))
    assert defined >= 0.98 * oscillating > 60


def test_mutant_with_a_flipped_circulation_is_caught() -> None:
    caught = 0
    for seed in range(20):
        found = modes(random_system(seed, 3, 1, 2))
        wrong = np.sum(found.ledger.damping - found.ledger.circulatory, axis=0) - found.s.real
        caught += bool(np.nanmax(np.abs(wrong), initial=0.0) > 1e-4)
    assert caught == 20


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 10**6), n=st.integers(1, 3), n_xi=st.integers(0, 2))
def test_verdict_agrees_with_the_exact_root_count(seed: int, n: int, n_xi: int) -> None:
    system = random_system(seed, n, n_xi, 1)
    exact, found = exact_root_count(system), modes(system)
    if found.verdict is StabilityVerdict.STABLE:
        assert exact.right == exact.axis == 0
    elif found.verdict is StabilityVerdict.UNSTABLE:
        assert exact.right > 0
    certificate = lyapunov_inertia(system.state_matrix())
    if certificate.certified:
        assert certificate.right == exact.right


@settings(max_examples=40, deadline=None)
@given(**SYSTEMS)
def test_growth_and_split_do_not_depend_on_units(seed: int, n: int, n_xi: int, elements: int) -> None:
    system = random_system(seed, n, n_xi, elements)
    unit = 2.0 ** np.random.default_rng(seed).integers(-20, 20, n)  # powers of two: the change of units is exact
    scale = np.outer(unit, unit)
    scaled = SecondOrderSystem.from_matrices(
        scale * system.M, scale * system.C, scale * system.K, F=unit[:, None] * system.F, internal=system.internal,
        A_internal=system.A_internal, G_q=system.G_q * unit, G_v=system.G_v * unit, G_a=system.G_a * unit,
        contributions=tuple(
            Contribution(c.name, c.kind, *(read_only(x, name="share") for x in (
                scale * c.M, scale * c.C, scale * c.K, unit[:, None] * c.F)))
            for c in system.contributions
        ),
    )  # fmt: skip
    one, two = modes(system), modes(scaled)
    assert len(one.s) == len(two.s)
    for k in range(len(one.s)):
        nearest = int(np.argmin(np.abs(two.s - one.s[k])))
        assert abs(two.s[nearest] - one.s[k]) <= one.error_bound[k] + two.error_bound[nearest]
        if not (np.isnan(one.ledger.damping[:, k]).any() or np.isnan(two.ledger.damping[:, nearest]).any()):
            tolerance = 1e-7 * (abs(one.s[k]) + np.max(np.abs(one.ledger.damping[:, k])))
            np.testing.assert_allclose(one.ledger.damping[:, k], two.ledger.damping[:, nearest], atol=tolerance)
