"""What a proof says is no more than what it proves: numbers are cut to the side that claims less."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from maglev_ctrl.proofs.claims import (
    DecayClaim,
    EllipsoidClaim,
    EnergyClaim,
    GainClaim,
    ParameterClaim,
    RegionClaim,
    SegmentClaim,
)
from maglev_ctrl.proofs.prove import prove
from maglev_ctrl.proofs.statements import between, statement
from maglev_ctrl.systems import Controller
from maglev_ctrl.systems.plant import Plant

ONE = np.ones((1, 1, 1))


def loop(pole: float, gain: float = 1.0, feedback: float = 0.0) -> tuple[list[Plant], list[Controller]]:
    plant = Plant.from_matrices([[pole]], [[1.0]], [[1.0]], [[gain]])
    return [plant], [Controller.static([[feedback]], measured=("x1",), commands=("u1",))]


def said(statement: str, before: str) -> float:
    return float(statement.partition(before)[2].split()[0])


def test_a_peak_gain_above_one_is_not_said_to_be_below_one() -> None:
    gain = 1.0 + 2e-11  # of gain / (s + 1)
    proof = prove(GainClaim((0,), (0,), 1.0 + 4e-11, ONE), *loop(-1.0, gain))
    assert proof.holds
    assert gain < said(proof.statement, "is below ") < gain + 1e-9


def test_a_decay_below_two_is_not_said_to_be_two() -> None:
    proof = prove(DecayClaim((0,), (0,), 1.99999999997, ONE), *loop(-1.99999999998))
    assert proof.holds
    assert 2.0 - 1e-8 < said(proof.statement, "decays at ") < 1.99999999998


def test_a_command_of_three_is_not_said_to_be_below_three() -> None:
    proof = prove(EllipsoidClaim((0,), (0,), ONE, (3.0 + 1e-12,)), *loop(1.0, feedback=-3.0))
    assert proof.holds
    assert 3.0 < said(proof.statement, "|u1| < ") < 3.0 + 1e-8


@pytest.mark.parametrize("speed", [0.1, 1 / 3, 2 / 3, 1e5 / 7, 12345678901.5])
def test_a_speed_limit_is_not_said_to_be_higher_nor_a_segment_narrower(speed: float) -> None:
    claim = SegmentClaim((0, 0), (0, 0), np.ones((2, 1, 1)), speed, speed)
    statement = prove(claim, *loop(-1.0)).statement
    assert speed * (1 - 1e-9) < said(statement, "moves at ") <= speed
    assert speed <= said(statement, "the parameter, ") < speed * (1 + 1e-9)


def test_numbers_that_are_told_exactly_stay() -> None:
    claim = GainClaim((0,), (0,), 1.2, ONE)
    assert prove(claim, *loop(-1.0)).statement.endswith("is below 1.2")
    assert prove(replace(claim, gamma=1e-320), *loop(-1.0)).statement  # below the normal numbers


@pytest.mark.parametrize("rate", [1e308, -1e308])
def test_a_rate_that_doubles_beyond_every_float_does_not_hold(rate: float) -> None:
    proof = prove(DecayClaim((0,), (0,), rate, ONE), *loop(-1.0))
    assert not proof.holds
    assert "not finite" in proof.reason


def test_a_region_without_rows_is_none() -> None:
    proof = prove(RegionClaim((0,), (0,), "none", np.zeros((0, 0)), np.zeros((0, 0)), ONE), *loop(-1.0))
    assert not proof.holds
    assert "region" in proof.reason


def test_a_loop_that_varies_has_no_poles() -> None:
    plants, _ = loop(-1.0)
    several, two = plants * 2, ((0, 1), (0, 0))
    moving, constant = "every loop between them however fast it varies", "every constant loop between them"
    decay, still = DecayClaim(*two, 0.2, ONE), DecayClaim(*two, 0.0, ONE)
    assert statement(decay, several, between(decay)) == (
        f"each of the 2 closed loops, and {moving}, decays at 0.2 1/s or faster"
    )
    assert statement(still, several, between(still)) == f"each of the 2 closed loops, and {moving}, is stable"
    assert statement(still, several, "") == "each of the 2 closed loops is stable"
    assert statement(DecayClaim((0,), (0,), 0.0, ONE), plants, "") == "the closed loop is stable"
    assert statement(DecayClaim((0,), (0,), 0.2, ONE), plants, "").startswith("every pole of the closed loop decays at")
    blend = ParameterClaim(*two, 0.2, np.ones((2, 1, 1)), np.ones((1, 1)))
    assert statement(blend, several, "") == (f"each of the 2 closed loops, and {constant}, decays at 0.2 1/s or faster")
    region = RegionClaim(*two, "left", np.zeros((1, 1)), np.ones((1, 1)), ONE)
    assert statement(region, several, between(region)).startswith(
        f"every pole of each of the 2 closed loops, and of {constant}, lies in the region called left"
    )
    energy = EnergyClaim(*two, 0.5, ONE)
    assert f"of each of the 2 closed loops, and of {constant}, from" in statement(energy, several, between(energy))
