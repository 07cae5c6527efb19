"""The magnetically suspended ball of the CTMS tutorials against the linear model of an electromagnet.

The tutorial takes a force i^2 / h and a constant inductance. A force i^2 / l^2 has the same slopes where
l = 2 h + c = 4 h, so the iron path is c = 2 h; its inductance is constant but for the motional voltage, which the
tutorial leaves out. That term follows from energy: it is the force per current over the inductance.
"""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from maglev_ctrl.analysis.loops import Loop
from maglev_ctrl.analysis.margins import loop_margins
from maglev_ctrl.forces import Electromagnet, circuit
from maglev_ctrl.synthesis.lq import lqr
from maglev_ctrl.systems import Controller, SecondOrderSystem, close_loop
from maglev_ctrl.vehicle import Body, Magnet, OperatingPoint, Vehicle, linearize

PATH = Path(__file__).parents[3] / "shared" / "data" / "external" / "suspension.json"
MASS, GRAVITY, DISTANCE, CURRENT, RESISTANCE, INDUCTANCE = 0.05, 9.8, 0.01, 7.0, 1.0, 0.01


@cache
def _case():
    if not PATH.exists():
        return None
    return next((c for c in json.loads(PATH.read_text())["cases"] if c["id"] == "ctms-magnetic-ball"), None)


def _published(name):
    if _case() is None:
        pytest.skip("the collection suspension.json is not part of this checkout")
    return _case()[name]


@pytest.fixture
def ball():
    """State matrix and input in the tutorial's states: distance below the magnet, its rate, current."""
    path = 4.0 * DISTANCE
    square = MASS * GRAVITY * path**2 / CURRENT**2  # mu0 N^2 S
    magnet = Electromagnet(
        CURRENT, turns=100, pole_area=square / (4e-7 * np.pi * 100**2), resistance=RESISTANCE,
        leakage=INDUCTANCE - square / path, iron_gap=2.0 * DISTANCE,
    )  # fmt: skip
    vehicle = Vehicle(
        "ball", (Body("ball", MASS),), magnets=(Magnet("coil", "ball", force=magnet),), reference_height=DISTANCE,
        gravity=GRAVITY,
    )  # fmt: skip
    system = linearize(vehicle, OperatingPoint(0.0, DISTANCE))
    turn = np.diag([-1.0, -1.0, 1.0])
    return turn @ system.state_matrix() @ turn, turn @ system.input_matrix(), circuit(magnet, DISTANCE)


def test_the_published_matrices_are_found(ball):
    A, B, found = ball
    assert found.current == pytest.approx(CURRENT) and found.force == pytest.approx(MASS * GRAVITY)
    motional = np.zeros((3, 3))
    motional[2, 1] = found.force_by_current / found.inductance
    np.testing.assert_allclose(A - motional, _published("A"), rtol=1e-12, atol=1e-9)
    np.testing.assert_allclose(B, _published("B"), rtol=1e-12)
    # Not small: what the tutorial leaves out, by reciprocity.
    assert A[2, 1] == pytest.approx(MASS * 2.8 / INDUCTANCE)


def test_the_published_poles_and_gain_hold_without_the_motional_voltage(ball):
    A, B, found = ball
    A = A.copy()
    A[2, 1] -= found.force_by_current / found.inductance
    published = np.sort(_published("published")["poles"])
    np.testing.assert_allclose(np.sort(np.linalg.eigvals(A).real), published, atol=2e-3)
    gain = np.atleast_2d(_published("published")["K_10"])
    closed = np.sort_complex(np.linalg.eigvals(A - B @ gain))
    np.testing.assert_allclose(closed, [-50.0, -10.0 - 10.0j, -10.0 + 10.0j], atol=2e-3)


def _placed(A, B, poles):
    """Gain that places the poles of one input (Ackermann's formula)."""
    n = len(A)
    reach = np.hstack([np.linalg.matrix_power(A, k) @ B for k in range(n)])
    wanted = sum(c * np.linalg.matrix_power(A, n - k) for k, c in enumerate(np.real(np.poly(poles))))
    return np.linalg.solve(reach.T, np.eye(n)[-1]) @ wanted


@pytest.mark.parametrize(
    ("key", "poles"), [("K_10", (-10 + 10j, -10 - 10j, -50)), ("K_20", (-20 + 20j, -20 - 20j, -100))]
)
def test_poles_placed_on_the_assembled_ball(ball, key, poles):
    """The gain on the assembled model, voltage induced by motion left out as the tutorial does, closed as a loop."""
    A, B, found = ball
    expected = np.array(_case()["computed"][key])
    A = A.copy()
    A[2, 1] -= found.force_by_current / found.inductance
    np.testing.assert_allclose(_placed(A, B, poles), expected, rtol=1e-9, atol=1e-9)
    law = Controller.static(-expected[None], measured=("ball", "ball.velocity", "current"), commands=("voltage",))
    plant = SecondOrderSystem.from_matrices(
        [[1.0]], [[0.0]], [[-A[1, 0]]], dofs=("ball",), internal=("current",), A_internal=[[A[2, 2]]], F=[[A[1, 2]]],
        inputs=("voltage",), B_internal=B[2:],
    )  # fmt: skip
    closed = np.sort_complex(np.linalg.eigvals(close_loop(plant, law).state_matrix()))
    np.testing.assert_allclose(closed, np.sort_complex(np.array(poles, dtype=complex)), rtol=1e-9)
    margins = loop_margins(Loop.from_system(plant, law))
    assert margins.verified
    # An unstable plant under state feedback can neither lose its gain nor take any amount of it away.
    assert margins.channels[0].gain_reduction.value > 0.0
    flipped = close_loop(plant, Controller.static(expected[None], measured=law.measured, commands=law.commands))
    assert np.max(np.linalg.eigvals(flipped.state_matrix()).real) > 0.0


def _sky_hook_case():
    if not PATH.exists():
        pytest.skip("the collection suspension.json is not part of this checkout")
    return next(c for c in json.loads(PATH.read_text())["cases"] if c["id"] == "skyhook-1dof")


def test_the_optimal_suspension_is_a_spring_and_a_damper_to_the_sky():
    """x'' = u, cost u^2 + r (x - x0)^2: sqrt(r) on the stroke, sqrt(2) r^(1/4) on the absolute velocity."""
    for row in _sky_hook_case()["rows"]:
        r = row["r"]
        gain = lqr([[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]], np.diag([r, 0.0]), [[1.0]]).gain[0]
        np.testing.assert_allclose(gain, [np.sqrt(r), np.sqrt(2.0) * r**0.25], rtol=1e-9)
        body = SecondOrderSystem.from_matrices([[1.0]], [[0.0]], [[0.0]], dofs=("x",), inputs=("force",), B=[[1.0]])
        law = Controller.static(-gain[None], measured=("x", "x.velocity"), commands=("force",))
        pole = np.linalg.eigvals(close_loop(body, law).state_matrix())[0]
        assert abs(pole) == pytest.approx(row["wn"], rel=1e-9)
        assert -pole.real / abs(pole) == pytest.approx(row["zeta"], rel=1e-9)
        # Margins of the optimum: at least 60 degrees and any increase of gain (Safonov & Athans 1977).
        one = loop_margins(Loop.from_system(body, law)).channels[0]
        assert one.phase.value >= 60.0
        assert one.gain_increase.value == np.inf
        assert one.modulus.value == pytest.approx(1.0, rel=1e-8)
        half = Controller.static(-gain[None] * [1.0, 0.5], measured=law.measured, commands=law.commands)
        weak = np.linalg.eigvals(close_loop(body, half).state_matrix())[0]
        assert -weak.real / abs(weak) < 0.4  # mutant: half the damper


def test_a_positive_stiffness_would_be_caught(ball):
    A, _, _ = ball
    mutant = A.copy()
    mutant[1, 0] *= -1.0
    assert not np.allclose(mutant[:2], np.array(_published("A"))[:2], rtol=1e-3)
