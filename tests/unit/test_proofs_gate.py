"""The gate: nothing without a claim, with a claim that fails, or with a number that is not found again."""

from __future__ import annotations

import numpy as np
import pytest

from maglev_ctrl.errors import ModelError, Status
from maglev_ctrl.proofs.claims import DecayClaim
from maglev_ctrl.synthesis.result import Performance, proven, refused
from maglev_ctrl.systems import Controller
from maglev_ctrl.systems.plant import Plant

PLANT = Plant.from_matrices([[1.0]], [[1.0]], [[1.0]], [[1.0]])
LAW = Controller.static([[-3.0]], measured=("x1",), commands=("u1",))
GOOD, BAD = (DecayClaim((0,), (0,), rate, np.ones((1, 1, 1))) for rate in (1.5, 2.5))


def test_a_proved_design_passes() -> None:
    design = proven("demo", [PLANT], [LAW], claims=[GOOD], performance=[Performance("norm", 2.0, 2.0 + 1e-6)])
    assert design.status is Status.SOLVED and design.require().controller is LAW and not design.message
    assert proven("demo", [PLANT], [LAW], claims=[GOOD], status=Status.ALMOST_SOLVED).status is Status.ALMOST_SOLVED


def test_one_failing_claim_keeps_the_law_back() -> None:
    design = proven("demo", [PLANT], [LAW], claims=[GOOD, BAD])
    assert design.status is Status.NOT_VERIFIED and not design.controllers
    assert "decays at 2.5 1/s or faster: the decay inequality is violated" in design.message
    with pytest.raises(ModelError, match="do not use"):
        design.require()
    with pytest.raises(ModelError, match="0 laws"):
        _ = design.controller


def test_no_claim_no_law() -> None:
    assert not proven("demo", [PLANT], [LAW], claims=[]).controllers


@pytest.mark.parametrize("recomputed", [2.1, 1.9, np.nan, np.inf])
def test_a_number_that_is_not_found_again(recomputed: float) -> None:
    design = proven("demo", [PLANT], [LAW], claims=[GOOD], performance=[Performance("norm", 2.0, recomputed)])
    assert not design.controllers and "norm: the solver reported 2" in design.message


def test_a_solver_that_reports_nothing_is_not_compared() -> None:
    assert proven("demo", [PLANT], [LAW], claims=[GOOD], performance=[Performance("norm", np.nan, 2.0)]).controllers


def test_a_law_for_other_signals_is_kept_back() -> None:
    other = Controller.static([[-3.0]], measured=("x2",), commands=("u1",))
    design = proven("demo", [PLANT], [other], claims=[GOOD])
    assert not design.controllers and "x2" in design.message


def test_refused_says_why() -> None:
    assert refused("demo", [PLANT], Status.INFEASIBLE, "no input").message == "no input"
