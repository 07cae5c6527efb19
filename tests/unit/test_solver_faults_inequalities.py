"""Semidefinite solvers that lie, die or never end; searches and maps whose engines break."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cvxpy
import numpy as np
import pytest

from maglev_ctrl.errors import Status, Verdict
from maglev_ctrl.scenario import load
from maglev_ctrl.study.map import option as map_module
from maglev_ctrl.study.map.request import map_request
from maglev_ctrl.study.tuning import option as tuning_module
from maglev_ctrl.synthesis.damping.minimum import minimum_damping
from maglev_ctrl.synthesis.damping.places import DampingPlace
from maglev_ctrl.synthesis.lmi import session
from maglev_ctrl.synthesis.lmi.request import MultiObjective
from maglev_ctrl.synthesis.lmi.state_feedback import multi_objective
from maglev_ctrl.systems import SecondOrderSystem
from maglev_ctrl.systems.plant import Plant

ROOT = Path(__file__).resolve().parents[2]
PLANT = Plant.from_matrices(
    [[0.0, 1.0], [4.0, 0.0]], [[0.0], [1.0]], [[0.0], [1.0]], [[1.0, 0.0], [0.0, 0.0]], D12=[[0.0], [1.0]]
)
REQUEST = MultiObjective("h2", decay_rate=0.5)


class Panic(BaseException):
    """A compiled solver's panic is no ordinary exception."""


def raising(fault: BaseException) -> Callable[..., None]:
    def solve(problem: Any, **options: Any) -> None:
        raise fault

    return solve


def saying(status: str, value: float | None) -> Callable[..., None]:
    """The solver comes back with a status and every unknown at one value."""

    def solve(problem: Any, **options: Any) -> None:
        for variable in problem.variables():
            variable.save_value(None if value is None else np.full(variable.shape, value))
        problem._status, problem._value = status, value

    return solve


@pytest.mark.parametrize(
    ("solve", "statuses"),
    [
        (raising(Panic("index out of bounds")), {Status.NUMERICAL_ERROR}),
        (raising(cvxpy.error.SolverError("failed")), {Status.NUMERICAL_ERROR}),
        (saying("optimal", np.nan), {Status.NUMERICAL_ERROR}),
        (saying("optimal", np.inf), {Status.NUMERICAL_ERROR}),
        (saying("optimal", None), {Status.NUMERICAL_ERROR}),
        (saying("optimal", 1.0), {Status.NOT_VERIFIED, Status.NUMERICAL_ERROR}),
        (saying("optimal_inaccurate", 1.0), {Status.NUMERICAL_ERROR, Status.NOT_VERIFIED}),
        (saying("infeasible", None), {Status.NUMERICAL_ERROR}),  # a linear-quadratic law proves it false
        (saying("infeasible_inaccurate", None), {Status.NUMERICAL_ERROR}),
        (saying("user_limit", None), {Status.ITERATION_LIMIT}),
        (saying("a word of a newer version", None), {Status.NUMERICAL_ERROR}),
    ],
    ids=[
        "panic", "solver error", "nan", "inf", "no numbers", "wrong numbers", "almost, wrong",
        "false certificate", "false doubt", "limit", "unknown status",
    ],
)  # fmt: skip
def test_a_broken_solver_makes_no_law_and_says_why(
    solve: Callable[..., None], statuses: set[Status], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cvxpy.Problem, "solve", solve)
    found = multi_objective([PLANT], REQUEST, time_limit=30.0)
    assert found.status in statuses, found.message
    assert not found.controllers and found.message and "Traceback" not in found.message


def test_a_solver_that_never_ends_is_left_behind_at_its_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cvxpy.Problem, "solve", lambda *arguments, **options: time.sleep(20.0))
    monkeypatch.setattr(session, "GRACE", 0.05)
    started = time.monotonic()
    found = multi_objective([PLANT], REQUEST, time_limit=0.5)
    assert found.status is Status.TIME_LIMIT and not found.controllers and "0.5 s" in found.message
    assert time.monotonic() - started < 10.0


@pytest.mark.parametrize("fault", [MemoryError(), ModuleNotFoundError("No module named 'clarabel'", name="clarabel")])
def test_what_no_other_solver_cures_is_raised_for_the_study_to_tell(
    fault: Exception, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cvxpy.Problem, "solve", raising(fault))
    with pytest.raises(type(fault)):
        multi_objective([PLANT], REQUEST)


def test_a_true_certificate_is_still_believed() -> None:
    """A growing mode that no command moves: the law made without the solver does not exist either."""
    stuck = Plant.from_matrices([[1.0, 0.0], [0.0, -1.0]], [[1.0], [1.0]], [[0.0], [1.0]], [[1.0, 1.0]], D12=[[1.0]])
    with pytest.raises(Exception, match=r"cannot move|stab|grows"):
        multi_objective([stuck], REQUEST).require()
    fast = multi_objective([PLANT], MultiObjective("feasible", decay_rate=50.0, gain_below=10.0), time_limit=30.0)
    assert fast.status is Status.INFEASIBLE and "cannot both be met" in fast.message


def test_dampers_found_without_the_solver_are_proved_all_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    """The minimum of c for 2 x'' + c x' + 8 x to decay at 0.5 1/s is 2 kg/s (c / 2 m = 0.5)."""
    monkeypatch.setattr(cvxpy.Problem, "solve", saying("optimal", 1.0))
    mass = SecondOrderSystem.from_matrices([[2.0]], [[0.0]], [[8.0]])
    found = minimum_damping([mass], [DampingPlace("leg", [1.0])], rate=0.5, starts=2)
    assert not found.certified or found.damping[0] >= 2.0
    assert found.certified is (found.synthesis.status in (Status.SOLVED, Status.ALMOST_SOLVED))
    assert all(proof.holds for proof in found.synthesis.proofs) or not found.certified


@pytest.mark.parametrize(
    "fault", [RuntimeError("population lost"), MemoryError(), ImportError("no pymoo", name="pymoo")]
)
def test_a_search_that_breaks_leaves_its_option_as_it_is_written(
    fault: Exception, monkeypatch: pytest.MonkeyPatch
) -> None:
    scenario = load(ROOT / "scenarios/compare/four_options.toml")

    def broken(*arguments: Any, **options: Any) -> None:
        raise fault

    monkeypatch.setattr(tuning_module, "search", broken)
    option = next(one for one in scenario.options if one.tunes)
    found = tuning_module.tune_option(scenario, option)
    assert found.record.reason and not found.record.variables and not found.record.feasible
    assert "\n" not in found.record.reason and "Traceback" not in found.record.reason


def test_a_map_whose_engine_breaks_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    scenario = load(ROOT / "scenarios/periodic/girder_passing.toml")
    request = map_request(scenario, options=["bare"])

    def broken(*arguments: Any, **options: Any) -> None:
        raise RuntimeError("eigenvalues lost")

    monkeypatch.setattr(map_module, "stability_plane", broken)
    found = map_module.option_map(scenario, request, "bare")
    assert "eigenvalues lost" in found.failure and found.plane is None
    assert Verdict.PASS.value not in found.failure
