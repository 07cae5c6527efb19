"""Rational fits of a dynamic stiffness: known poles come back, errors are honest, what cannot be fitted is refused."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from maglev_ctrl.errors import ModelError
from maglev_ctrl.forces.dynamic import static_stiffness
from maglev_ctrl.forces.rational import RationalStiffness, fit_rational

BAND = np.geomspace(1.0, 300.0, 33)


def known(s, *, K, C, poles, residues):
    """Q(s) by its definition, conjugates written out."""
    s = np.asarray(s, dtype=complex)[..., None, None]
    found = K + C * s
    for pole, residue in zip(poles, residues, strict=True):
        found = found + residue * s / (s - pole)
        if pole.imag > 0.0:
            found = found + residue.conj() * s / (s - pole.conjugate())
    return found


def two_by_two(seed: int = 3):
    rng = np.random.default_rng(seed)
    K = np.diag([-500.0, -150.0]) + rng.normal(size=(2, 2))
    poles = [-40.0 + 0j, -90.0 + 160.0j]
    residues = [rng.normal(size=(2, 2)) + 0j, rng.normal(size=(2, 2)) + 1j * rng.normal(size=(2, 2))]
    return {"K": K, "C": 0.05 * rng.normal(size=(2, 2)), "poles": poles, "residues": residues}


def test_known_poles_and_residues_come_back() -> None:
    truth = two_by_two()
    found = fit_rational(BAND, known(1j * BAND, **truth), static=truth["K"], tolerance=1e-8)
    assert found.order == 3
    assert found.residual <= 1e-8
    order = np.argsort(found.poles.imag)
    np.testing.assert_allclose(found.poles[order], truth["poles"], rtol=1e-6)
    np.testing.assert_allclose(found.residues[order], truth["residues"], rtol=1e-5, atol=1e-5)
    np.testing.assert_allclose(found.damping, truth["C"], atol=1e-7)
    off_axis = np.array([-3.0 + 40.0j, 5.0 + 90.0j, 12.0])
    np.testing.assert_allclose(found.at(off_axis), known(off_axis, **truth), rtol=1e-7)


def test_the_static_stiffness_is_exact_and_the_fit_is_real() -> None:
    truth = two_by_two(4)
    found = fit_rational(BAND, known(1j * BAND, **truth), static=truth["K"])
    np.testing.assert_array_equal(found.at(0.0), truth["K"])
    np.testing.assert_allclose(found.at(-40j), found.at(40j).conj(), rtol=1e-14)
    np.testing.assert_allclose(found.at([30.0]).imag, 0.0, atol=1e-10)


@settings(deadline=None, max_examples=12)
@given(seed=st.integers(0, 10_000))
def test_the_stated_residual_holds_at_other_frequencies(seed: int) -> None:
    """Random fields of real poles outside and inside the band, as diffusion makes them."""
    rng = np.random.default_rng(seed)
    poles = -np.geomspace(30.0, 3000.0, 12) * rng.uniform(0.8, 1.2, 12) + 0j
    truth = {"K": -np.eye(2) * 300.0, "C": np.zeros((2, 2)), "poles": poles, "residues": rng.normal(size=(12, 2, 2))}
    try:
        found = fit_rational(BAND, known(1j * BAND, **truth), static=truth["K"], tolerance=1e-4)
    except ModelError:
        return
    assert np.all(found.poles.real < 0.0)
    between = np.geomspace(1.05, 290.0, 101)
    error = np.abs((found.at(1j * between) - known(1j * between, **truth)) / between[:, None, None]) / found.scale
    assert np.max(error) <= 3.0 * 1e-4
    assert found.residual <= found.tolerance == 1e-4
    assert not set(found.held_back) - set(BAND)


def test_the_smallest_order_is_taken() -> None:
    truth = two_by_two()
    Q = known(1j * BAND, **truth)
    orders = [fit_rational(BAND, Q, static=truth["K"], tolerance=t).order for t in (0.5, 1e-2, 1e-6)]
    assert orders == sorted(orders)
    assert orders[-1] == 3 > orders[0]


def test_a_magnetic_mass_is_fitted_where_allowed() -> None:
    s = 1j * BAND
    Q = (-40.0 + 0.3 * s + 0.02 * s**2)[:, None, None]
    assert fit_rational(BAND, Q, static=[[-40.0]], tolerance=1e-9, mass=True).mass[0, 0] == pytest.approx(0.02)
    with pytest.raises(ModelError, match="no rational form"):
        fit_rational(BAND, Q, static=[[-40.0]], tolerance=1e-9, order_at_most=2)


def test_a_wrong_sign_of_the_imaginary_part_is_a_wrong_sign_of_damping() -> None:
    Q = -40.0 - 3.0 * 1j * BAND / (1.0 + 0.02 * 1j * BAND)
    right = fit_rational(BAND, Q[:, None, None], static=[[-40.0]], tolerance=1e-6)
    assert right.at(1j * BAND[:1]).imag[0, 0, 0] < 0.0
    try:  # the mutant's lag would have to lead: no stable pole does that, so it is refused or has the other sign
        wrong = fit_rational(BAND, Q.conj()[:, None, None], static=[[-40.0]], tolerance=1e-6)
    except ModelError:
        return
    assert wrong.at(1j * BAND[:1]).imag[0, 0, 0] > 0.0


def test_unstable_data_never_make_an_unstable_pole() -> None:
    Q = known(1j * BAND, K=-np.eye(1), C=np.zeros((1, 1)), poles=[20.0 + 0j], residues=[np.ones((1, 1)) + 0j])
    try:
        found = fit_rational(BAND, Q, static=-np.eye(1), tolerance=1e-3)
    except ModelError:
        return
    assert np.all(found.poles.real < 0.0)


def test_noise_is_refused_and_not_fitted() -> None:
    rng = np.random.default_rng(0)
    H = -3.0 / (1.0 + 0.02j * BAND) * (1.0 + 0.01 * rng.normal(size=len(BAND)))
    with pytest.raises(
        ModelError, match=r"no rational form of up to 14 poles meets the tolerance 0.001 between 1 and 300"
    ):
        fit_rational(BAND, (1j * BAND * H)[:, None, None], static=[[0.0]])


def test_an_entry_that_is_rounding_is_left_alone() -> None:
    truth = two_by_two()
    Q = known(1j * BAND, **truth)
    Q[:, 0, 1] = 1e-13 * np.random.default_rng(1).normal(size=len(BAND))
    K = truth["K"].copy()
    K[0, 1] = 0.0
    found = fit_rational(BAND, Q, static=K, tolerance=1e-6)
    assert found.order == 3
    assert found.scale[0, 1] == 0.0
    assert not found.residues[:, 0, 1].any()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"frequency": BAND[:4], "stiffness": np.zeros((4, 1, 1))}, "at least 5 frequencies"),
        ({"frequency": -BAND}, "positive, distinct"),
        ({"stiffness": np.zeros((33, 2, 2))}, r"expected shape \(F, m, m\)"),
        ({"stiffness": np.full((33, 1, 1), np.nan)}, "every entry must be finite"),
        ({"tolerance": 0.0}, "tolerance: expected a number between 0 and 1"),
    ],
)
def test_wrong_input_is_refused(change, message) -> None:
    given = {"frequency": BAND, "stiffness": np.zeros((33, 1, 1)), "static": [[0.0]], "tolerance": 1e-3} | change
    with pytest.raises(ValueError, match=message):
        fit_rational(given.pop("frequency"), given.pop("stiffness"), **given)


def test_a_force_without_motion_dependence_needs_no_pole() -> None:
    found = fit_rational(BAND, np.full((33, 1, 1), -40.0), static=[[-40.0]])
    assert isinstance(found, RationalStiffness)
    assert found.order == 0
    assert not found.damping.any()


class Answers:
    """A model that answers what it was given."""

    def __init__(self, Q) -> None:
        self.Q = np.asarray(Q, dtype=complex)

    def motion_stiffness(self, height, gap, speed, frequency):
        return self.Q


@pytest.mark.parametrize(
    ("Q", "message"),
    [
        (np.zeros((1, 3, 3)), r"expected shape \(1, 4, 4\), got \(1, 3, 3\)"),
        (1j * np.eye(4)[None], "expected a real matrix at frequency zero"),
        (np.eye(4)[None], "guideway is not uniform"),
        (np.full((1, 4, 4), np.inf), "must be finite"),
    ],
)
def test_wrong_dynamic_stiffness_is_refused(Q, message) -> None:
    with pytest.raises(ValueError, match=message):
        static_stiffness(Answers(Q), height=0.1, gap=None, speed=10.0)
