"""Sampled laws against transfer functions at single points, closed forms, and simulation."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm

from maglev_ctrl.errors import ModelError, NotStable
from maglev_ctrl.synthesis.discretise import delayed, discretisation_loss, discretise, largest_period, return_ratio
from maglev_ctrl.systems import Controller
from maglev_ctrl.systems.plant import Plant


def _law(seed=0, n=3):
    rng = np.random.default_rng(seed)
    return Controller.from_matrices(
        rng.standard_normal((n, n)) - 3.0 * np.eye(n), rng.standard_normal((n, 2)), rng.standard_normal((1, n)),
        rng.standard_normal((1, 2)), measured=("gap", "rate"), commands=("force",), name="law",
    )  # fmt: skip


def _value(law, point):
    return law.C @ np.linalg.solve(point * np.eye(len(law.A)) - law.A, law.B) + law.D


@pytest.mark.parametrize("prewarp", [None, 7.0])
def test_tustin_is_the_bilinear_substitution(prewarp):
    law, dt = _law(), 0.1
    sampled = discretise(law, dt, prewarp=prewarp)
    a = 2.0 / dt if prewarp is None else prewarp / np.tan(prewarp * dt / 2.0)
    for z in (np.exp(0.3j), 1.7 + 0.2j, -0.4j):
        np.testing.assert_allclose(_value(sampled, z), _value(law, a * (z - 1.0) / (z + 1.0)), rtol=1e-12)
    np.testing.assert_allclose(_value(sampled, 1.0), _value(law, 0.0), rtol=1e-12)
    if prewarp is not None:
        agreed = _value(sampled, np.exp(1j * prewarp * dt))
        np.testing.assert_allclose(agreed, _value(law, 1j * prewarp), rtol=1e-12)
        plain = _value(discretise(law, dt), np.exp(1j * prewarp * dt))
        assert np.linalg.norm(plain - _value(law, 1j * prewarp)) > 1e-3  # the mutant: no prewarping
    assert (sampled.measured, sampled.commands, sampled.dt) == (law.measured, law.commands, dt)


def test_hold_is_exact_for_constant_measurements():
    law, dt = _law(1), 0.2
    sampled = discretise(law, dt, method="hold")
    y, state = np.array([1.0, -2.0]), np.zeros(3)
    for _ in range(4):
        state = sampled.A @ state + sampled.B @ y
    exact = np.linalg.solve(law.A, (expm(law.A * 4 * dt) - np.eye(3)) @ law.B @ y)
    np.testing.assert_allclose(state, exact, rtol=1e-12)


def test_a_static_law_stays_as_it_is():
    law = Controller.static([[2.0]], measured=("y",), commands=("u",))
    assert discretise(law, 0.1).D.tolist() == [[2.0]]
    assert discretise(law, 0.1, method="hold").dt == 0.1


def test_a_delayed_law_says_the_same_later():
    law = discretise(_law(), 0.1)
    late = delayed(law, 2)
    for z in (np.exp(0.3j), 1.7 + 0.2j):
        np.testing.assert_allclose(_value(late, z), _value(law, z) / z**2, rtol=1e-12)
    assert delayed(law, 0) is law


def _integrator(delay=0):
    plant = Plant.from_matrices([[0.0]], [[1.0]], [[1.0]], [[1.0]])
    law = Controller.static([[-1.0]], measured=("x1",), commands=("u1",))
    return discretisation_loss(plant, law, 0.1, delay_samples=delay)


def test_closed_forms_of_an_integrator_with_unit_gain():
    # z - 1 + dt = 0 up to dt = 2; with one sample of delay z^2 - z + dt = 0 up to dt = 1.
    plain, late = _integrator(), _integrator(1)
    assert plain.spectral_radius == pytest.approx(0.9, rel=1e-12)
    assert plain.largest_period.value == pytest.approx(2.0, rel=1e-9)
    assert late.largest_period.value == pytest.approx(1.0, rel=1e-9)
    assert plain.largest_period.verified and late.largest_period.verified
    # gain margin 2 / dt; with the delay 1 / dt
    assert plain.sampled.channels[0].gain_increase.value == pytest.approx(20.0, rel=1e-9)
    assert late.sampled.channels[0].gain_increase.value == pytest.approx(10.0, rel=1e-9)
    # |L| = dt / |z - 1| = 1 at sin(w dt / 2) = dt / 2; the hold costs half a period of phase exactly
    crossover = 2.0 / 0.1 * np.arcsin(0.05)
    assert plain.phase_lost("u1") == pytest.approx(np.degrees(crossover * 0.05), rel=1e-7)
    assert late.phase_lost("u1") == pytest.approx(np.degrees(crossover * 0.15), rel=1e-7)
    assert 0.0 < plain.disk_margin_lost < late.disk_margin_lost < 1.0


def _magnet():
    plant = Plant.from_matrices([[0.0, 1.0], [100.0, 0.0]], [[0.0], [1.0]], [[0.0], [1.0]], np.eye(2), [[1.0, 0.0]],
                                states=("gap", "speed"), measured=("gap",), commands=("force",))  # fmt: skip
    # -(k s + d) 200 / (s + 200): a filtered PD law, k and d for two poles near 10 rad/s
    lead = Controller.from_matrices([[-200.0]], [[1.0]], [[200.0 * (20.0 * 200.0 - 300.0)]], [[-4000.0]],
                                    measured=("gap",), commands=("force",))  # fmt: skip
    return plant, lead


def test_margins_shrink_with_the_period_until_the_loop_is_unstable():
    plant, law = _magnet()
    lost = [discretisation_loss(plant, law, dt).disk_margin_lost for dt in (1e-4, 1e-3, 5e-3)]
    assert 0.0 < lost[0] < lost[1] < lost[2] < 1.0
    loss = discretisation_loss(plant, law, 1e-3)
    border = loss.largest_period
    assert border.verified
    beyond = discretisation_loss(plant, law, 1.02 * border.value)
    assert not beyond.stable and beyond.sampled is None and beyond.disk_margin_lost == 1.0
    assert np.isnan(beyond.phase_lost("force"))
    inside = discretisation_loss(plant, law, 0.98 * border.value)
    assert inside.stable and inside.disk_margin_lost > 0.9


@pytest.mark.parametrize("share", [0.99, 1.01])
def test_the_border_shows_in_a_simulation(share):
    """Held commands and the exact flow between samples, no use of loop matrices."""
    plant, law = _magnet()
    dt = share * largest_period(plant, law).value
    sampled = discretise(law, dt)
    flow = expm(np.block([[plant.A, plant.B2], [np.zeros((1, 3))]]) * dt)
    x, state = np.array([1e-3, 0.0]), np.zeros(1)
    size = []
    for _ in range(3000):
        y = x[:1]
        u = sampled.C @ state + sampled.D @ y
        state = sampled.A @ state + sampled.B @ y
        x = (flow @ np.append(x, u))[:2]
        size.append(np.linalg.norm(x))
    assert (size[-1] < size[1000]) == (share < 1.0)


def test_a_loop_stable_at_every_rate_is_said_to_be():
    plant = Plant.from_matrices([[-1.0]], [[1.0]], [[1.0]], [[1.0]])
    law = Controller.static([[-0.5]], measured=("x1",), commands=("u1",))
    found = largest_period(plant, law)
    assert found.value == np.inf and "every period tried" in found.reason


def test_a_direct_term_of_the_plant_is_in_the_loop():
    plant = Plant.from_matrices([[-1.0]], [[1.0]], [[1.0]], [[1.0]], [[1.0]], D22=[[0.5]])
    law = Controller.static([[-3.0]], measured=("y1",), commands=("u1",))
    assert return_ratio(plant, law).D.tolist() == [[1.5]]
    # y = x + u/2, u = -3 y: y = x / 2.5, x' = -x - 1.2 x; sampled: z = e^-dt - 1.2 (1 - e^-dt)
    loss = discretisation_loss(plant, law, 0.1)
    assert loss.spectral_radius == pytest.approx(np.exp(-0.1) - 1.2 * (1.0 - np.exp(-0.1)), rel=1e-12)


@pytest.mark.parametrize(
    ("act", "fault", "words"),
    [
        (lambda: discretise(_law(), -1.0), ValueError, "dt: expected"),
        (lambda: discretise(discretise(_law(), 0.1), 0.1), ValueError, "sampled already"),
        (lambda: discretise(_law(), 0.1, method="euler"), ValueError, "method: expected"),
        (lambda: discretise(_law(), 0.1, prewarp=40.0), ValueError, "prewarp: expected"),
        (lambda: discretise(_law(), 0.1, prewarp=1.0, method="hold"), ValueError, "prewarp: expected"),
        (lambda: delayed(_law(), 1), ValueError, "expected a sampled law"),
        (lambda: delayed(discretise(_law(), 0.1), -1), ValueError, "samples: expected"),
    ],
)
def test_wrong_use_is_named(act, fault, words):
    with pytest.raises(fault, match=words):
        act()


def test_a_pole_where_the_bilinear_rule_fails_is_named():
    law = Controller.from_matrices([[20.0]], [[1.0]], [[1.0]], [[0.0]], measured=("y",), commands=("u",))
    with pytest.raises(ModelError, match="bilinear rule fails"):
        discretise(law, 0.1)


def test_an_unstable_continuous_loop_is_refused():
    plant = Plant.from_matrices([[1.0]], [[1.0]], [[1.0]], [[1.0]])
    law = Controller.static([[-0.5]], measured=("x1",), commands=("u1",))
    with pytest.raises(NotStable):
        discretisation_loss(plant, law, 0.1)
    with pytest.raises(NotStable):
        largest_period(plant, law)
