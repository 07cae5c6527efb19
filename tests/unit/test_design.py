"""Certificates: three methods must tell the same story about a closed loop."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from maglev_ctrl.arrays import read_only
from maglev_ctrl.errors import Agreement, ModelError, NotStable, Status
from maglev_ctrl.synthesis import design as design_module
from maglev_ctrl.synthesis.design import Design, lyapunov_proof, verify, worst
from maglev_ctrl.systems import Controller, SecondOrderSystem


def _quarter_car(bandwidth: float = 60.0, **more) -> SecondOrderSystem:
    """Bogie on a magnet with negative damping, car on a soft spring, one lagged actuator between them."""
    return SecondOrderSystem.from_matrices(
        [[1000.0, 0.0], [0.0, 4000.0]], [[-150.0, 0.0], [0.0, 0.0]], [[2.4e5, -4e4], [-4e4, 4e4]],
        dofs=("bogie.heave", "car.heave"), internal=("secondary.force",), A_internal=[[-bandwidth]],
        F=[[-1.0], [1.0]], inputs=("secondary",), B_internal=[[bandwidth]],
        guideway=("heave@magnet",), K_w=[[2e5], [0.0]],
        outputs=("car.heave.acceleration", "secondary.stroke", "magnet.gap"),
        H_q=[[0.0, 0.0], [-1.0, 1.0], [1.0, 0.0]], H_a=[[0.0, 1.0], [0.0, 0.0], [0.0, 0.0]],
        H_w=[[0.0], [0.0], [-1.0]], **more,
    )  # fmt: skip


def _damper(gain: float = 6000.0) -> Controller:
    return Controller.static(
        [[gain, -gain]], measured=("bogie.heave.velocity", "car.heave.velocity"), commands=("secondary",), name="damper"
    )


def test_both_closings_and_the_lyapunov_proof_agree_on_a_stable_loop():
    certificate = verify(_quarter_car(), _damper())
    assert certificate.stable
    assert certificate.agreed is Agreement.AGREED
    assert certificate.lyapunov_positive
    assert certificate.lyapunov_residual < 1e-6
    assert certificate.matrix_difference < 1e-14
    assert certificate.eigenvalue_difference < 1e-10
    assert len(certificate.closed_loop_eigenvalues) == 5


def test_a_flipped_law_is_unstable_and_all_methods_say_so():
    certificate = verify(_quarter_car(), _damper(-6000.0))
    assert certificate.agreed is Agreement.AGREED
    assert not certificate.stable
    assert not certificate.lyapunov_positive
    assert certificate.spectral_abscissa > 0.0


def test_acceleration_feedback_closes_alike_in_both_ways():
    plant = SecondOrderSystem.from_matrices(
        [[2.0]], [[1.0]], [[8.0]], inputs=("force",), B=[[1.0]], outputs=("a",), H_a=[[1.0]]
    )
    law = Controller.static([[-3.0]], measured=("a",), commands=("force",))
    certificate = verify(plant, law)  # virtual mass: 2 + 3 = 5 kg
    np.testing.assert_allclose(
        np.sort_complex(certificate.closed_loop_eigenvalues), np.sort_complex(np.roots([5, 1, 8]))
    )
    assert certificate.agreed is Agreement.AGREED
    assert certificate.smallest_return_difference == pytest.approx(2.5)
    with pytest.raises(ModelError, match=r"algebraic loop|cancels the mass"):
        verify(plant, Controller.static([[2.0]], measured=("a",), commands=("force",)))


def test_a_mutant_of_one_closing_is_caught(monkeypatch):
    """Were one of the two closings wrong, the certificate would not agree."""
    honest = design_module.loop_matrices

    def mutant(system, controller):
        A, B, C, D = honest(system, controller)
        return A, B, -C, D

    monkeypatch.setattr(design_module, "loop_matrices", mutant)
    certificate = verify(_quarter_car(), _damper())
    assert certificate.agreed is Agreement.UNRESOLVED
    assert not certificate.stable
    assert certificate.disagreements


def test_lyapunov_proof_matches_the_eigenvalues_near_the_axis():
    rng = np.random.default_rng(3)
    for shift in (-1e-4, 1e-4, -1.0, 1.0):
        A = rng.standard_normal((6, 6)) * 30.0
        A += (shift - np.max(np.linalg.eigvals(A).real)) * np.eye(6)
        positive, residual = lyapunov_proof(A)
        assert positive == (shift < 0.0)
        assert residual < 1.0


def test_neutral_loop_is_not_called_stable():
    plant = SecondOrderSystem.from_matrices([[1.0]], [[0.0]], [[4.0]], inputs=("force",), B=[[1.0]])
    certificate = verify(plant, Controller.static([[0.0]], measured=("q1",), commands=("force",)))
    assert not certificate.stable


def _delayed(order: int, delay: float) -> SecondOrderSystem:
    """Mass with a delayed actuator: Pade (1, 1) or two of them in series with half the delay each."""
    stages = order
    rate = 2.0 * stages / delay
    A, B, outward = np.zeros((stages, stages)), np.zeros((stages, 1)), np.zeros((1, stages))
    for i in range(stages):  # stage: x' = -rate x + in, out = 2 rate x - in
        A[i, i] = -rate
        B[i, 0] = (-1.0) ** i
        for j in range(i):
            A[i, j] = 2.0 * rate * (-1.0) ** (i - 1 - j)
    outward[0] = [2.0 * rate * (-1.0) ** (stages - 1 - j) for j in range(stages)]
    return SecondOrderSystem.from_matrices(
        [[1.0]], [[0.0]], [[4.0]], internal=tuple(f"force.delay{i + 1}" for i in range(stages)), A_internal=A,
        F=outward, inputs=("force",), B=[[(-1.0) ** stages]], B_internal=B,
    )  # fmt: skip


def test_a_finer_delay_confirms_or_refutes_the_certificate():
    law = Controller.static([[-0.5]], measured=("q1.velocity",), commands=("force",))
    short = verify(_delayed(1, 0.05), law, refined=_delayed(2, 0.05))
    assert short.stable
    assert short.refined_abscissa == pytest.approx(short.spectral_abscissa, rel=0.02)
    long = verify(_delayed(1, 1.3), law, refined=_delayed(2, 1.3))
    assert long.agreed is Agreement.UNRESOLVED
    assert "finer plant" in long.disagreements[0]
    inner = Controller.static([[1.0]], measured=("force.delay1",), commands=("force",))
    with pytest.raises(ValueError, match="one Pade order"):
        verify(_delayed(1, 0.05), inner, refined=_delayed(2, 0.05))


def test_require_lets_only_proven_designs_through():
    plant = _quarter_car()
    good = Design("d", "given", _damper(), Status.SOLVED, (), None, verify(plant, _damper()))
    assert good.require() is good
    with pytest.raises(NotStable, match="real part"):
        replace(good, certificate=verify(plant, _damper(-6000.0))).require()
    with pytest.raises(ModelError, match="do not use"):
        replace(good, status=Status.NOT_VERIFIED).require()
    unresolved = replace(good.certificate, agreed=Agreement.UNRESOLVED, disagreements=("x",))
    with pytest.raises(ModelError, match="unresolved"):
        replace(good, certificate=unresolved).require()


def test_wrong_names_and_batches_are_refused():
    plant = _quarter_car()
    with pytest.raises(ValueError, match="is not an input"):
        verify(plant, Controller.static([[1.0]], measured=("car.heave",), commands=("primary",)))
    stacked = replace(plant, K=read_only(np.stack([plant.K, plant.K]), name="K"))
    with pytest.raises(ValueError, match="batch axes"):
        verify(stacked, _damper())


def test_worst_status_puts_failures_first():
    assert worst() is Status.SOLVED
    assert worst(Status.SOLVED, Status.ALMOST_SOLVED, Status.INFEASIBLE) is Status.INFEASIBLE
