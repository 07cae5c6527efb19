"""Certificate matrices for loops of any scale: made, proved, and refused where there is nothing to prove."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg

from maglev_ctrl.analysis.hamiltonian import h_infinity_norm
from maglev_ctrl.errors import ModelError
from maglev_ctrl.proofs.makers import (
    bounded_real_claim,
    decay_claim,
    energy_claim,
    joint_claim,
    lyapunov_claim,
    tightest_claim,
)
from maglev_ctrl.proofs.prove import prove
from maglev_ctrl.systems import Controller
from maglev_ctrl.systems.plant import Plant


def random_plant(rng: np.random.Generator, *, dt: float | None, direct: bool, scaled: bool) -> tuple[Plant, Plant]:
    """A stable plant, and the same in units from 1e-6 to 1e8: (as given, in plain units)."""
    n, n_w, n_z = (int(x) for x in rng.integers(1, [9, 4, 4]))
    A = rng.standard_normal((n, n))
    if dt is None:
        A -= (np.linalg.eigvals(A).real.max() + 10.0 ** rng.uniform(-3, 1)) * np.eye(n)
    else:
        A *= (1.0 - 10.0 ** rng.uniform(-3, -0.1)) / np.abs(np.linalg.eigvals(A)).max()
    B, C = rng.standard_normal((n, n_w)), rng.standard_normal((n_z, n))
    D = rng.standard_normal((n_z, n_w)) if direct else np.zeros((n_z, n_w))
    u = np.exp2(np.round(rng.uniform(-20, 27, n))) if scaled else np.ones(n)
    plain = Plant.from_matrices(A, B, np.zeros((n, 1)), C, D11=D, dt=dt)
    given = Plant.from_matrices(A * u[:, None] / u, B * u[:, None], np.zeros((n, 1)), C / u, D11=D, dt=dt)
    return given, plain


def idle(plant: Plant) -> Controller:
    return Controller.static(
        np.zeros((1, len(plant.states))), measured=plant.measured, commands=plant.commands, dt=plant.dt
    )


@pytest.mark.parametrize("dt", [None, 0.01])
@pytest.mark.parametrize("scaled", [False, True])
def test_every_stable_loop_is_certified(dt: float | None, scaled: bool) -> None:
    rng = np.random.default_rng(11)
    for trial in range(40):
        given, plain = random_plant(rng, dt=dt, direct=trial % 3 == 0, scaled=scaled)
        law = idle(given)
        assert prove(lyapunov_claim([given], [law]), [given], [law]).holds
        peak = h_infinity_norm(plain.A, plain.B1, plain.C1, plain.D11, dt=dt).upper
        for slack in (1e-2, 1e-4):
            assert prove(bounded_real_claim(given, law, peak * (1.0 + slack)), [given], [law]).holds
        with pytest.raises(ModelError):
            bounded_real_claim(given, law, 0.5 * peak)
        if dt is None and np.any(plain.D11):
            continue
        if dt is None:
            gramian = scipy.linalg.solve_continuous_lyapunov(plain.A.T, -plain.C1.T @ plain.C1)
        else:
            gramian = scipy.linalg.solve_discrete_lyapunov(plain.A.T, plain.C1.T @ plain.C1)
        norm = np.sqrt(np.trace(plain.B1.T @ gramian @ plain.B1) + np.sum(plain.D11**2))
        assert prove(energy_claim(given, law, norm * (1.0 + 1e-7)), [given], [law]).holds
        with pytest.raises(ModelError):
            energy_claim(given, law, 0.999 * norm)


def test_a_bound_close_to_the_peak() -> None:
    """1e-6 above the norm, in three of four random loops or more; what is not found is not claimed either."""
    rng = np.random.default_rng(12)
    proved = 0
    for _ in range(40):
        given, plain = random_plant(rng, dt=None, direct=False, scaled=True)
        law = idle(given)
        peak = h_infinity_norm(plain.A, plain.B1, plain.C1, plain.D11).upper
        try:
            claim = bounded_real_claim(given, law, peak * (1.0 + 1e-6))
        except ModelError:
            continue
        proved += prove(claim, [given], [law]).holds
    assert proved >= 30


def test_a_vehicle_in_newtons_and_millimetres() -> None:
    """20 t on 4 MN/m with an actuator of 2 ms: forces of 1e6, deflections of 1e-3, one state in newtons."""
    m, k, c, lag = 2e4, 4e6, 4e4, 2e-3
    A = np.array([[0.0, 1.0, 0.0], [-k / m, -c / m, 1.0 / m], [0.0, 0.0, -1.0 / lag]])
    plant = Plant.from_matrices(A, [[0.0], [1.0 / m], [0.0]], [[0.0], [0.0], [1.0 / lag]], [[k, c, 0.0]])
    law = Controller.static([[-1e6, -3e4, 0.0]], measured=plant.measured, commands=plant.commands)
    assert prove(lyapunov_claim([plant], [law], rate=0.5), [plant], [law]).holds
    closed = A.copy()
    closed[2] += np.array([-1e6, -3e4, 0.0]) / lag
    peak = h_infinity_norm(closed, plant.B1, plant.C1, plant.D11).upper
    assert prove(bounded_real_claim(plant, law, peak * 1.00001), [plant], [law]).holds


def test_the_pole_that_is_too_slow_is_named() -> None:
    plant = Plant.from_matrices([[-0.25]], [[1.0]], [[1.0]], [[1.0]])
    with pytest.raises(ModelError, match=r"-0\.25.*does not decay at 0\.5 1/s"):
        lyapunov_claim([plant], [idle(plant)], rate=0.5)
    sampled = Plant.from_matrices([[1.25]], [[1.0]], [[1.0]], [[1.0]], dt=0.1)
    with pytest.raises(ModelError, match=r"1\.25.*z plane"):
        lyapunov_claim([sampled], [idle(sampled)])


def test_one_law_for_several_plants() -> None:
    plants = [Plant.from_matrices([[-a]], [[1.0]], [[1.0]], [[1.0]]) for a in (1.0, 2.0)]
    claim = lyapunov_claim(plants, [idle(plants[0])])
    assert claim.plants == (0, 1) and claim.controllers == (0, 0) and claim.P.shape == (2, 1, 1)
    with pytest.raises(ValueError, match="controllers: expected 1 or 2, got 3"):
        lyapunov_claim(plants, [idle(plants[0])] * 3)


def test_channels_without_signals_or_reach() -> None:
    """A disturbance that reaches nothing, an output that sees nothing: the norms are zero, any bound is above."""
    plant = Plant.from_matrices(-np.eye(2), np.zeros((2, 1)), np.zeros((2, 1)), np.zeros((1, 2)))
    law = idle(plant)
    assert prove(bounded_real_claim(plant, law, 1e-3), [plant], [law]).holds
    assert prove(energy_claim(plant, law, 1e-3), [plant], [law]).holds


def test_states_neither_reached_nor_seen_do_not_stand_in_the_way() -> None:
    """Couplings of rounding's size only: the state has no scale of its own, and the inequality holds all the same."""
    A = np.array([[-0.5, 1.0, 1e-35], [-2.0, -0.1, 0.0], [1e-28, -4e-28, -0.02]])
    plant = Plant.from_matrices(A, [[1.0], [0.0], [0.0]], np.zeros((3, 1)), [[1.0, 0.5, 1e-35]])
    law = idle(plant)
    peak = h_infinity_norm(A[:2, :2], plant.B1[:2], plant.C1[:, :2], plant.D11).upper
    assert prove(bounded_real_claim(plant, law, peak * 1.0001), [plant], [law]).holds


def test_claims_follow_the_number_as_close_as_can_be_proved() -> None:
    plants = [Plant.from_matrices([[-a]], [[1.0]], [[1.0]], [[1.0]]) for a in (1.0, 2.0)]
    law = idle(plants[0])
    decay = decay_claim(plants, [law])
    assert decay.rate == pytest.approx(0.98) and prove(decay, plants, [law]).holds
    gain = tightest_claim(bounded_real_claim, plants, [law], 1.0)
    assert gain.gamma == pytest.approx(1.00001) and gain.P.shape == (2, 1, 1) and prove(gain, plants, [law]).holds
    with pytest.raises(ModelError):
        tightest_claim(bounded_real_claim, plants, [law], 0.8)
    assert prove(joint_claim(energy_claim, plants, [law], 0.7072), plants, [law]).holds
    assert not prove(replace(gain, gamma=0.999), plants, [law]).holds


def test_decay_is_claimed_slower_where_a_double_pole_leaves_less_to_prove() -> None:
    A = np.array([[-1.0, 1e9], [0.0, -1.0]])
    plant = Plant.from_matrices(A, np.zeros((2, 1)), np.zeros((2, 1)), np.zeros((1, 2)))
    assert 0.0 <= decay_claim([plant], [idle(plant)]).rate < 1.0
    dead = Plant.from_matrices(np.zeros((1, 1)), [[1.0]], [[1.0]], [[1.0]], dt=0.1)
    assert decay_claim([dead], [idle(dead)]).rate == pytest.approx(0.98 * 20.0 / 0.1)
    with pytest.raises(ModelError, match="does not decay"):
        decay_claim([replace(plant, A=-plant.A)], [idle(plant)])
