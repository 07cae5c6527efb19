"""Stability gate: right with delays, names the pole, refuses what it cannot prove."""

from __future__ import annotations

import numpy as np
import pytest

from maglev_ctrl.analysis.delay_line import ORDERS, delay_line, line_error, sufficient_order
from maglev_ctrl.analysis.loops import Loop, sensitivity
from maglev_ctrl.analysis.replay import pole_near
from maglev_ctrl.analysis.stability_gate import close
from maglev_ctrl.errors import ModelError, NotStable


def test_unstable_loop_is_named() -> None:
    with pytest.raises(NotStable, match=r"pole at 0\.5 1/s"):
        close(Loop.from_transfer_function([0.5], [1.0, -1.0]))


def test_pole_on_the_axis_is_refused() -> None:
    with pytest.raises(NotStable, match="indistinguishable"):
        close(Loop.from_transfer_function([3.0], [1.0, 0.0, 1.0]))


def test_an_undamped_mode_beside_an_unstable_one_is_told_with_a_delay() -> None:
    """The input cannot move the oscillator: its pole stays on the axis, where no gain can be found."""
    A = np.array([[0.5, 0.0, 0.0], [0.0, 0.0, 37.0], [0.0, -37.0, 0.0]])
    loop = Loop(A, [[1.0], [0.0], [0.0]], [[0.2, 0.0, 0.0]], [[0.0]], ("u",), (0.001,))
    with pytest.raises(ModelError, match=r"keeps a pole on the axis at 37 rad/s"):
        close(loop)


def test_discrete_unstable_loop_is_named() -> None:
    with pytest.raises(NotStable, match=r"z plane"):
        close(Loop.from_transfer_function([2.5], [1.0, -1.0], dt=0.1))  # pole at -1.5
    close(Loop.from_transfer_function([1.5], [1.0, -1.0], dt=0.1))


def test_ill_posed_loop_is_refused() -> None:
    with pytest.raises(ModelError, match="well posed"):
        close(Loop([[-1.0]], [[1.0]], [[1.0]], [[-1.0]], ("u",)))


@pytest.mark.parametrize(("gain", "delay"), [(1.0, 1.5), (10.0, 0.15), (0.1, 15.6)])
def test_delayed_integrator_below_its_limit(gain: float, delay: float) -> None:
    """k exp(-s tau)/s is stable exactly for k tau < pi/2."""
    assert gain * delay < np.pi / 2.0
    close(Loop.from_transfer_function([gain], [1.0, 0.0], delay=delay))


@pytest.mark.parametrize(("gain", "delay"), [(1.0, 1.6), (10.0, 0.16), (0.1, 15.8), (5.0, 4.0)])
def test_delayed_integrator_beyond_its_limit(gain: float, delay: float) -> None:
    with pytest.raises(NotStable) as fault:
        close(Loop.from_transfer_function([gain], [1.0, 0.0], delay=delay))
    assert "pole at" in str(fault.value)
    close(Loop.from_transfer_function([gain], [1.0, 0.0]))  # mutant: a gate that forgets the delay lets it pass


@pytest.mark.parametrize(("delay", "stable"), [(1.0, True), (3.0, True), (4.0, False), (6.0, False), (7.5, True)])
def test_delay_may_stabilise(delay: float, stable: bool) -> None:
    """s^2 + 1 = k exp(-s tau): to first order Re s = -(k/2) sin tau; neutral without the delay."""
    loop = Loop.from_transfer_function([-0.02], [1.0, 0.0, 1.0], delay=delay)
    if stable:
        close(loop)
    else:
        with pytest.raises(NotStable):
            close(loop)


def test_offending_pole_solves_the_characteristic_equation() -> None:
    loop = Loop.from_transfer_function([1.0], [1.0, 0.0], delay=2.0)
    pole = pole_near(loop, 0.2 + 0.8j).pole
    assert abs(pole + np.exp(-2.0 * pole)) < 1e-10


def test_coupled_channels_with_delays_equal_their_decoupled_form() -> None:
    """A rotation mixes two delayed integrators with equal delay; its loops are stable exactly as the single one."""
    angle = 0.7
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    for gain, stable in ((1.4, True), (1.7, False)):
        loop = Loop(np.zeros((2, 2)), turn, gain * turn.T, np.zeros((2, 2)), ("a", "b"), [1.0, 1.0])
        if stable:
            close(loop)
        else:
            with pytest.raises(NotStable):
                close(loop)


def test_different_delays_are_told_apart() -> None:
    """Two independent integrators; only the one with the long delay is at risk."""
    zero, eye = np.zeros((2, 2)), np.eye(2)
    close(Loop(zero, eye, eye, zero, ("a", "b"), [0.0, 1.5]))
    with pytest.raises(NotStable):
        close(Loop(zero, eye, eye, zero, ("a", "b"), [0.0, 1.6]))


def test_delayed_feedthrough_above_one_is_refused() -> None:
    with pytest.raises(ModelError, match="cannot be proven"):
        close(Loop([[-1.0]], [[1.0]], [[1.0]], [[1.2]], ("u",), [0.1]))


def test_realisation_is_close_to_the_exact_response() -> None:
    closed = close(Loop.from_transfer_function([2.0], [1.0, 1.0], delay=0.5))
    omega = np.linspace(0.0, 5.0, 30)
    n = closed.A.shape[0]
    rational = closed.D + closed.C @ np.linalg.solve(1j * omega[:, None, None] * np.eye(n) - closed.A, closed.B + 0j)
    assert np.allclose(rational, closed.response(omega), atol=1e-6)


@pytest.mark.parametrize("order", ORDERS)
def test_delay_line_is_bounded_by_one_and_accurate_up_to_its_order(order: int) -> None:
    A, B, C = delay_line(2.0, order)
    omega = np.logspace(-3, 4, 200)
    values = np.abs((C @ np.linalg.solve(1j * omega[:, None, None] * np.eye(order) - A, B + 0j))[:, 0, 0])
    assert np.max(values) <= 1.0 + 1e-9
    assert np.max(np.linalg.eigvals(A).real) < 0.0
    assert line_error(order, 0.25 * order) < 1e-4
    wrong = (C @ np.linalg.solve(0.5j * np.eye(order) - A, np.abs(B) + 0j))[0, 0]
    assert abs(wrong - np.exp(-1j)) > 0.1  # mutant: input weights without their alternating sign


def test_line_error_reports_what_is_reached() -> None:
    order, error = sufficient_order(1e4, 1e-9)
    assert order == ORDERS[-1]
    assert error > 0.1


def test_whole_sample_delays_become_states() -> None:
    dt = 0.1
    closed = close(Loop.from_transfer_function([0.3], [1.0, -1.0], delay=0.2, dt=dt))
    omega = np.array([0.5, 3.0, 11.0])
    z = np.exp(1j * omega * dt)
    exact = 1.0 / (1.0 + 0.3 / (z - 1.0) * z**-2)
    assert np.allclose(sensitivity(closed.loop, omega)[:, 0, 0], exact)
    assert not np.allclose(sensitivity(closed.loop, omega)[:, 0, 0], 1.0 / (1.0 + 0.3 / (z - 1.0) * z**-1))


def test_a_long_delay_at_high_gain_is_refused_by_an_exact_pole() -> None:
    """Active where the delay has turned ten thousand times: no stand-in is good there, one pole is proof enough."""
    loop = Loop.from_transfer_function([5e3], [1.0, 1.0], delay=0.5)
    with pytest.raises(NotStable, match="pole at") as raised:
        close(loop)
    numbers = str(raised.value).split("pole at ")[1].split(" 1/s")[0]
    real, _, imaginary = numbers.replace("j", "").partition(" +- ")
    pole = complex(float(real), float(imaginary or 0.0))
    # det(1 + L) = 0 there, to the digits told
    left = (pole + 1.0) * np.exp(0.5 * pole)
    assert abs(left + 5e3) < 1e-2 * 5e3
    slower = Loop.from_transfer_function([0.5], [1.0, 1.0], delay=0.5)  # mutant: refuses everything that is delayed
    assert close(slower).poles.size
