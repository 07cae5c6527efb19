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

from maglev_ctrl.forces import Electromagnet, circuit
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


def test_a_positive_stiffness_would_be_caught(ball):
    A, _, _ = ball
    mutant = A.copy()
    mutant[1, 0] *= -1.0
    assert not np.allclose(mutant[:2], np.array(_published("A"))[:2], rtol=1e-3)
