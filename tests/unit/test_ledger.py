"""The growth-rate split: closed forms, the internal-state share, what must be refused."""

from __future__ import annotations

import numpy as np
import pytest

from maglev_ctrl.analysis.ledger import Ledger
from maglev_ctrl.analysis.modes import modes
from maglev_ctrl.arrays import read_only
from maglev_ctrl.errors import ModelError
from maglev_ctrl.systems import Contribution, SecondOrderSystem


def share(name: str, M: object, C: object, K: object, F: object) -> Contribution:
    arrays = [read_only(np.asarray(x, dtype=float), name=name) for x in (M, C, K, F)]
    return Contribution(name, "other", *arrays)


def summed(shares: list[Contribution], **rest: object) -> SecondOrderSystem:
    M, C, K, F = (sum(getattr(c, key) for c in shares) for key in "MCKF")
    return SecondOrderSystem.from_matrices(M, C, K, F=F, contributions=tuple(shares), **rest)  # type: ignore[arg-type]


def test_two_dampers_share_a_decay() -> None:
    zero, none = [[0.0]], np.zeros((1, 0))
    system = summed([
        share("mass", [[2.0]], zero, zero, none), share("spring", zero, [[0.3]], [[8.0]], none),
        share("magnet", zero, [[-0.1]], zero, none),
    ])  # fmt: skip
    ledger = modes(system).ledger
    # growth -c/2m, each damper's part in proportion to its own c
    np.testing.assert_allclose(ledger.damping[:, 0], [0.0, -0.3 / 4, 0.1 / 4], atol=1e-15)
    np.testing.assert_allclose(ledger.circulatory[:, 0], 0.0, atol=1e-15)
    assert [name for name, *_ in ledger.ranked(0)] == ["spring", "magnet", "mass"]


def test_circulatory_pair_closed_form() -> None:
    # M = I, K = [[k, p], [-p, k]]: s^2 = -(k +- i p), growth wholly circulatory
    k, p = 4.0, 0.7
    found = modes(SecondOrderSystem.from_matrices(np.eye(2), np.zeros((2, 2)), [[k, p], [-p, k]]))
    exact = np.sqrt(-(k + 1j * p))
    np.testing.assert_allclose(np.sort(found.ledger.circulatory[0]), [-abs(exact.real), abs(exact.real)], rtol=1e-13)
    np.testing.assert_allclose(found.ledger.damping[0], 0.0, atol=1e-15)


def test_formula_without_internal_states() -> None:
    rng = np.random.default_rng(3)
    root = rng.standard_normal((3, 3))
    M, C, K = root @ root.T + np.eye(3), rng.standard_normal((3, 3)), 20 * np.eye(3) + rng.standard_normal((3, 3))
    found = modes(SecondOrderSystem.from_matrices(M, C, K))

    def form(matrix: np.ndarray, a: np.ndarray) -> complex:
        return complex(a.conj() @ matrix @ a)

    for i in np.flatnonzero(found.s.imag > 0.0):
        a, w = found.shapes[:, i], found.s[i].imag
        work = w * form((C + C.T) / 2, a).real + form((K - K.T) / 2, a).imag
        growth = -work / (2 * w * form(M, a).real + form((C - C.T) / 2, a).imag)
        assert growth == pytest.approx(found.s[i].real, rel=1e-11)
        mutant = w * form((C + C.T) / 2, a).real - form((K - K.T) / 2, a).imag
        assert -mutant / (2 * w * form(M, a).real) != pytest.approx(found.s[i].real, rel=1e-4)


def test_lagging_damper_loses_its_share_with_frequency() -> None:
    # c s / (1 + tau s): real part of the impedance c / (1 + (w tau)^2) at light damping
    c, tau, stiffness = 1e-3, 0.5, 9.0
    zero = [[0.0]]
    system = summed(
        [share("body", [[1.0]], zero, [[stiffness]], [[0.0]]), share("damper", zero, zero, zero, [[-c]])],
        internal=("damper.lag",), A_internal=[[-1 / tau]], G_v=[[1 / tau]],
    )  # fmt: skip
    found = modes(system)
    k = int(np.argmax(found.s.imag))
    assert found.ledger.damping[1, k] == pytest.approx(-c / 2 / (1 + 9.0 * tau**2), rel=1e-3)
    assert found.ledger.damping[0, k] == pytest.approx(0.0, abs=1e-18)
    assert abs(found.ledger.residual[k]) <= 1e-10 * abs(found.s[k])


def test_circulatory_internal_element_is_told_from_a_damping_one() -> None:
    # Two coordinates, lags at zero frequency act as a rotational (circulatory) force: F (-A)^-1 G = skew.
    zero = np.zeros((2, 2))
    skew = np.array([[0.0, 1.0], [-1.0, 0.0]])
    body = share("body", np.eye(2), 0.1 * np.eye(2), 25 * np.eye(2), zero)
    system = summed(
        [body, share("actuators", zero, zero, zero, 0.3 * skew)],
        internal=("a.force", "b.force"), A_internal=-1e4 * np.eye(2), G_q=1e4 * np.eye(2),
    )  # fmt: skip
    found = modes(system)
    for k in np.flatnonzero(found.s.imag > 1.0):
        assert abs(found.ledger.circulatory[1, k]) == pytest.approx(0.03, rel=1e-2)
        assert abs(found.ledger.damping[1, k]) < 1e-3


def test_divergence_has_a_stiffness_share_and_no_split() -> None:
    zero, none = [[0.0]], np.zeros((1, 0))
    system = summed([share("spring", [[1.0]], [[0.2]], [[3.0]], none), share("magnet", zero, zero, [[-5.0]], none)])
    found = modes(system)
    assert np.isnan(found.ledger.damping).all()
    assert np.isnan(found.ledger.residual).all()
    k = found.critical
    np.testing.assert_allclose(found.ledger.stiffness_share[:, k], [3.0, -5.0], rtol=1e-13)
    assert found.ledger.ranked(k) == ()


def test_shares_that_do_not_add_up_are_refused() -> None:
    part = share("spring", [[1.0]], [[0.2]], [[3.0]], np.zeros((1, 0)))
    system = SecondOrderSystem.from_matrices([[1.0]], [[0.2]], [[3.1]], contributions=(part,))
    with pytest.raises(ModelError, match="do not add up to K"):
        modes(system)


def test_ledger_is_read_only() -> None:
    ledger: Ledger = modes(SecondOrderSystem.from_matrices([[1.0]], [[0.2]], [[3.0]])).ledger
    with pytest.raises(ValueError, match="read-only"):
        ledger.damping[0, 0] = 1.0
