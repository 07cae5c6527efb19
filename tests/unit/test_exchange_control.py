"""python-control and back: the same poles, the same frequency response, the same margins, and mutants that are seen."""

from __future__ import annotations

import control
import numpy as np
import pytest

from maglev_ctrl.analysis.loops import Loop, return_ratio
from maglev_ctrl.analysis.margins import loop_margins
from maglev_ctrl.synthesis.interchange import (
    from_python_control,
    loop_from_python_control,
    plant_from_python_control,
    to_python_control,
)
from maglev_ctrl.systems import Controller, PeriodicSystem, SecondOrderSystem, close_loop
from maglev_ctrl.systems.plant import Plant, plant_fields
from maglev_ctrl.vehicle.pade import pade_delay

FREQUENCIES = np.array([0.03, 0.7, 1.9, 2.1, 14.0, 300.0])  # rad/s


def car() -> SecondOrderSystem:
    """Two coordinates, an actuator with a lag, a guideway, an acceleration among the outputs."""
    return SecondOrderSystem.from_matrices(
        [[2.0, 0.3], [0.3, 1.0]], [[0.2, -0.1], [0.0, 0.1]], [[8.0, -1.0], [-2.0, 5.0]], dofs=("heave", "pitch"),
        internal=("force.lag",), A_internal=[[-30.0]], F=[[1.0], [0.5]], inputs=("force", "push"),
        B=[[0.0, 1.0], [0.0, -2.0]], B_internal=[[30.0, 0.0]], guideway=("rail",), K_w=[[8.0], [1.0]],
        C_w=[[0.1], [0.0]], outputs=("heave.acceleration", "gap"), H_q=[[0.0, 0.0], [1.0, 0.4]],
        H_a=[[1.0, 0.2], [0.0, 0.0]], H_w=[[0.0], [-1.0]],
    )  # fmt: skip


def law(dt: float | None = None) -> Controller:
    return Controller.from_matrices(
        [[0.5, 0.1], [-0.2, 0.3]] if dt else [[-5.0, 1.0], [-2.0, -3.0]], [[1.0, 2.0], [0.3, -1.0]], [[-4.0, 0.5]],
        [[-0.7, -2.0]], measured=("gap", "heave.velocity"), commands=("force",), dt=dt,
    )  # fmt: skip


def by_matrices(system: SecondOrderSystem, omega: float) -> np.ndarray:
    """Outputs per input and guideway displacement and rate, straight from M, C, K without any state space."""
    s = 1j * omega
    xi = 1.0 / (s - system.A_internal[0, 0])
    stiff = s**2 * system.M + s * system.C + system.K
    drive = np.hstack([system.B + system.F @ (xi * system.B_internal), system.K_w, system.C_w])
    q = np.linalg.solve(stiff, drive)
    through = np.hstack([np.zeros((2, 2)), system.H_w, system.H_wv])
    return (system.H_q + s * system.H_v + s**2 * system.H_a) @ q + through


def apart(found: np.ndarray, expected: np.ndarray) -> float:
    return float(np.max(np.abs(found - expected)) / np.max(np.abs(expected)))


def test_a_vehicle_has_the_same_poles_and_the_same_response():
    system = car()
    out = to_python_control(system)
    assert out.input_labels == ["force", "push", "rail", "rail_rate"]
    assert out.output_labels == ["heave_acceleration", "gap"]
    assert out.state_labels == ["heave", "pitch", "heave_velocity", "pitch_velocity", "force_lag"]
    np.testing.assert_array_equal(out.A, system.state_matrix())
    swapped = control.ss(out.A, out.B[:, [1, 0, 2, 3]], out.C, out.D[:, [1, 0, 2, 3]])
    for omega in FREQUENCIES:
        expected = by_matrices(system, omega)
        assert apart(out(1j * omega), expected) < 1e-12
        assert apart(swapped(1j * omega), expected) > 1e-3  # a mutant with its inputs swapped is seen
    assert to_python_control(SecondOrderSystem.from_matrices([[1.0]], [[0.1]], [[4.0]])).output_labels == [
        "q1", "q1_velocity",
    ]  # fmt: skip


@pytest.mark.parametrize("dt", [None, 0.02])
def test_a_law_goes_there_and_back_unchanged(dt):
    own = law(dt)
    out = to_python_control(own)
    back = from_python_control(out, measured=own.measured, commands=own.commands)
    for key in "ABCD":
        np.testing.assert_array_equal(getattr(back, key), getattr(own, key))
    assert (back.dt, back.measured, back.commands) == (own.dt, own.measured, own.commands)
    turned = control.ss(own.A, own.B.T, own.C, own.D, own.dt or 0)  # B is square: a transposed one still fits
    for omega in FREQUENCIES[:4]:
        point = np.exp(1j * omega * dt) if dt else 1j * omega
        expected = own.C @ np.linalg.solve(point * np.eye(2) - own.A, own.B) + own.D
        assert apart(out(point), expected) < 1e-12
        assert apart(turned(point), expected) > 1e-3


def test_a_closed_loop_made_there_has_the_poles_of_the_one_made_here():
    system, own = car(), law()
    here = np.sort_complex(np.linalg.eigvals(close_loop(system, own).state_matrix()))
    rows = system.output_rows(own.measured)
    plant = control.ss(system.state_matrix(), system.input_matrix()[:, :1], rows[0], rows[1][:, :1])
    there = np.sort_complex(control.feedback(plant, to_python_control(own), sign=1).poles())
    np.testing.assert_allclose(there, here, rtol=1e-10)
    assert (
        np.max(np.abs(np.sort_complex(control.feedback(plant, to_python_control(own), sign=-1).poles()) - here)) > 0.1
    )


def test_margins_are_those_of_python_control():
    numerator, denominator = [25.0], [1.0, 10.0, 10.0, 10.0]
    there = control.tf(numerator, denominator)
    gain, phase, modulus, _, crossing, _ = control.stability_margins(there)
    (found,) = loop_margins(loop_from_python_control(there, channels=("force",))).channels
    assert found.channel == "force"
    assert found.gain_increase.value == pytest.approx(gain, rel=1e-6)
    assert found.phase.value == pytest.approx(phase, rel=1e-6)
    assert found.phase.frequency == pytest.approx(crossing, rel=1e-6)
    assert found.modulus.value == pytest.approx(modulus, rel=1e-3)  # theirs is read from a grid
    own = Loop.from_transfer_function(numerator, denominator)
    again = control.stability_margins(to_python_control(own))
    assert again[0] == pytest.approx(gain, rel=1e-6) and again[1] == pytest.approx(phase, rel=1e-6)


def test_delays_are_refused_approximated_or_kept_as_samples():
    slow = Loop.from_transfer_function([2.0], [1.0, 3.0, 1.0], delay=0.04)
    with pytest.raises(ValueError, match=r"exact delays \(0.04 s\).*give pade_order"):
        to_python_control(slow)
    A, b, c, d = pade_delay(0.04, 4)
    for omega in FREQUENCIES[:5]:
        s = 1j * omega
        expected = return_ratio(slow, omega)[0, 0]
        found = complex(np.squeeze(to_python_control(slow, pade_order=4)(s)))
        form = c @ np.linalg.solve(s * np.eye(4) - A, b) + d
        assert abs(found / (expected * np.exp(s * 0.04) * form) - 1.0) < 1e-10
        assert abs(found / expected - 1.0) < 1e-6
    sampled = Loop([[0.9]], [[0.1]], [[1.0]], [[0.2]], ("u",), [0.06], 0.02)
    out = to_python_control(sampled)
    assert out.nstates == 4 and out.dt == 0.02
    for omega in FREQUENCIES[:5]:
        found = complex(np.squeeze(out(np.exp(1j * omega * 0.02))))
        assert abs(found / return_ratio(sampled, omega)[0, 0] - 1.0) < 1e-12
    two = Loop(-np.eye(2), np.eye(2), [[1.0, 0.3], [0.0, 2.0]], np.zeros((2, 2)), ("a", "b"), [0.0, 0.1])
    assert apart(to_python_control(two, pade_order=5)(1.0j), return_ratio(two, 1.0)) < 1e-9
    own = loop_from_python_control(control.tf([2.0], [1.0, 3.0, 1.0]), channels=("u",), delays=[0.04])
    assert abs(return_ratio(own, 3.0)[0, 0] / return_ratio(slow, 3.0)[0, 0] - 1.0) < 1e-12


def test_a_plant_goes_there_and_back():
    rng = np.random.default_rng(5)
    own = Plant.from_matrices(
        rng.standard_normal((3, 3)), rng.standard_normal((3, 2)), rng.standard_normal((3, 1)),
        rng.standard_normal((2, 3)), rng.standard_normal((2, 3)), D12=rng.standard_normal((2, 1)),
        D21=rng.standard_normal((2, 2)), D11=rng.standard_normal((2, 2)), D22=rng.standard_normal((2, 1)),
        disturbances=("gust", "noise"), commands=("force",), performance=("ride", "effort"), measured=("gap", "rate"),
    )  # fmt: skip
    back = plant_from_python_control(to_python_control(own), commands=("force",), measured=("gap", "rate"))
    for key in plant_fields():
        np.testing.assert_array_equal(getattr(back, key), getattr(own, key), err_msg=key)
    assert (back.disturbances, back.performance) == (own.disturbances, own.performance)
    other = plant_from_python_control(to_python_control(own), commands=("noise",), measured=("rate", "gap"))
    assert other.disturbances == ("gust", "force") and not np.array_equal(other.C2, own.C2)


@pytest.mark.parametrize(
    ("act", "kind", "words"),
    [
        (lambda: from_python_control(control.ss([[0.5]], [[1]], [[1]], [[0]], True)), ValueError, "period is not"),
        (lambda: from_python_control(control.frd([1.0, 2.0], [1.0, 2.0])), TypeError, "StateSpace or TransferFunction"),
        (lambda: from_python_control("K"), TypeError, "got str"),
        (lambda: loop_from_python_control(control.ss([[-1]], [[1, 1]], [[1]], [[0, 0]])), ValueError, "2 and 1"),
        (lambda: to_python_control(PeriodicSystem.from_matrices([[1.0]], [[[1.0]]], frequency=1.0)), TypeError,
         "got PeriodicSystem"),
        (lambda: to_python_control(SecondOrderSystem.from_matrices([[1.0]], [[0.1]], [[[4.0]], [[9.0]]])), ValueError,
         "without batch axes"),
        (lambda: plant_from_python_control(to_python_control(car()), commands=("pull",), measured=("gap",)), ValueError,
         "'pull' is not among force, push"),
    ],
)  # fmt: skip
def test_what_cannot_cross_is_said(act, kind, words):
    with pytest.raises(kind, match=words):
        act()
