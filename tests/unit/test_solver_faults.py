"""Solvers that fail, one way after another: the option says what failed and why, the others are as they were."""

from __future__ import annotations

import builtins
import json
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import design_fixture
import numpy as np
import pytest
from typer.testing import CliRunner

from maglev_ctrl.cli import app
from maglev_ctrl.errors import Status, Verdict
from maglev_ctrl.report.serialise import to_plain
from maglev_ctrl.study import option as option_module
from maglev_ctrl.study.design.run import chosen_options, survey_design
from maglev_ctrl.study.option import study_option
from maglev_ctrl.study.run import run
from maglev_ctrl.synthesis import h_infinity, riccati
from maglev_ctrl.synthesis.predictive import quadratic, solvers

REQUIREMENT = '\n[[requirement]]\nname = "no_growth"\nquantity = "growth_rate"\nat_most = "0 1/s"\nover = "nominal"\n'
VEHICLE, _, _ = design_fixture.VEHICLE.partition("sweep.speed")
BARE = '\n[[option]]\nname = "bare"\nkind = "baseline"\n'
TEXT = VEHICLE + BARE + design_fixture.LQR + design_fixture.H_INFINITY + REQUIREMENT
CHANGING = ("seconds", "created", "versions", "scenario_path")
"""What of a record two equal runs may differ in."""


class Panic(Exception):
    """What a compiled solver raises when it gives up on itself."""


FAULTS: dict[str, tuple[Exception, str]] = {
    "exception": (Panic("factorisation broke down"), "not foreseen: Panic: factorisation broke down"),
    "memory": (MemoryError(), "the memory was not enough"),
    "eigenvalues": (np.linalg.LinAlgError("Eigenvalues did not converge"), "Eigenvalues did not converge"),
    "missing": (
        ModuleNotFoundError("No module named 'slycot'", name="slycot"), "slycot is not installed or cannot be loaded",
    ),
    "no text": (RuntimeError(), "not foreseen: RuntimeError"),
}  # fmt: skip


def raising(fault: Exception) -> Callable[..., Any]:
    def call(*arguments: Any, **options: Any) -> Any:
        raise fault

    return call


def kept(value: Any) -> Any:
    """A record without what changes from run to run."""
    if isinstance(value, dict):
        return {key: kept(one) for key, one in value.items() if key not in CHANGING}
    return [kept(one) for one in value] if isinstance(value, list) else value


@cache
def sound(folder: Path) -> dict[str, Any]:
    """Every option of the small scenario, nothing broken."""
    comparison = run(design_fixture.read(TEXT, folder))
    return {one["name"]: json.dumps(kept(one)) for one in to_plain(comparison)["options"]}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("faults")


def test_an_option_whose_solver_raises_is_told_and_the_others_are_bit_for_bit_the_same(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = sound(folder)
    monkeypatch.setattr(h_infinity, "state_problem", raising(Panic("factorisation broke down")))
    comparison = run(design_fixture.read(TEXT, folder))
    after = {one["name"]: json.dumps(kept(one)) for one in to_plain(comparison)["options"]}
    assert after["lqr"] == before["lqr"] and after["bare"] == before["bare"]
    assert after["worst"] != before["worst"]  # the fault was felt
    assert json.loads(before["worst"])["failure"] == ""


@pytest.mark.parametrize("name", FAULTS)
def test_whatever_a_solver_raises_becomes_a_sentence(name: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    fault, words = FAULTS[name]
    monkeypatch.setattr(h_infinity, "state_problem", raising(fault))
    scenario = design_fixture.read(TEXT, folder)
    broken = study_option(scenario, next(one for one in scenario.options if one.name == "worst"))
    assert words in broken.failure and "Traceback" not in broken.failure and "\n" not in broken.failure
    assert [one.verdict for one in broken.requirements] == [Verdict.NOT_EVALUATED]
    assert words in broken.requirements[0].reason


def test_a_part_that_breaks_takes_no_other_part_with_it(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(option_module, "loop_margins", raising(Panic("no crossings")))
    scenario = design_fixture.read(TEXT, folder)
    active = study_option(scenario, next(one for one in scenario.options if one.name == "lqr"))
    assert not active.failure and active.modes is not None
    assert active.margins is None and "no crossings" in active.margins_reason
    assert active.requirements[0].verdict is Verdict.PASS  # growth needs no margin


def test_a_warning_that_was_made_an_error_is_not_swallowed(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(h_infinity, "state_problem", raising(RuntimeWarning("overflow")))
    scenario = design_fixture.read(TEXT, folder)
    with pytest.raises(RuntimeWarning):
        study_option(scenario, next(one for one in scenario.options if one.name == "worst"))


@pytest.mark.parametrize(
    ("kind", "answer"),
    [
        ("NaN", lambda A, *rest: np.full(A.shape, np.nan)),
        ("infinite", lambda A, *rest: np.full(A.shape, np.inf)),
        ("wrong", lambda A, *rest: np.eye(len(A))),
        ("destabilising", lambda A, *rest: -1e3 * np.eye(len(A))),
    ],
)
def test_riccati_solvers_that_answer_wrongly_are_not_believed(
    kind: str, answer: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    A, B, Q, R = np.array([[0.0, 1.0], [2.0, 0.0]]), np.array([[0.0], [1.0]]), np.eye(2), np.eye(1)
    truth = riccati.riccati_continuous(A, B, Q, R)
    for group in (riccati.PRIMARY, riccati.FALLBACK):
        for name in group:
            monkeypatch.setitem(group, name, answer)
    found = riccati.riccati_continuous(A, B, Q, R)
    if found.status is Status.SOLVED:  # Newton's method may find the way from a poor start; then it is the solution
        np.testing.assert_allclose(found.P, truth.P, rtol=1e-12)
    else:
        assert found.message and np.all(np.isnan(found.P))


def test_a_singular_riccati_equation_says_why() -> None:
    """A growing mode that no command moves has no law, a weightless one on the axis no stabilising solution."""
    stuck = riccati.riccati_continuous([[1.0, 0.0], [0.0, -1.0]], [[0.0], [1.0]], np.eye(2), [[1.0]])
    assert stuck.status is Status.INFEASIBLE and stuck.message
    neutral = riccati.riccati_continuous([[0.0, 1.0], [-4.0, 0.0]], [[0.0], [1.0]], np.zeros((2, 2)), [[1.0]])
    assert neutral.status is Status.INFEASIBLE and "2" in neutral.message


def test_a_law_whose_design_breaks_has_the_status_of_its_fault(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scenario = design_fixture.read(TEXT, folder)
    monkeypatch.setattr(h_infinity, "state_problem", raising(MemoryError()))
    study = survey_design(scenario, chosen_options(scenario, ()))
    broken, good = design_fixture.law(study, "worst"), design_fixture.law(study, "lqr")
    assert broken.status is Status.NUMERICAL_ERROR and broken.verdict is Verdict.NOT_EVALUATED
    assert broken.failure == "the memory was not enough" and broken.document is None
    assert good.status is Status.SOLVED and good.verdict is Verdict.PASS


def test_the_command_ends_with_a_report_that_tells_of_the_fault(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "small.toml"
    file.write_text(TEXT, encoding="utf-8")
    monkeypatch.setattr(h_infinity, "state_problem", raising(Panic("factorisation broke down")))
    result = CliRunner().invoke(
        app, ["report", str(file), "--out", str(tmp_path / "out"), "--format", "json,md", "--jobs", "1"]
    )
    assert result.exit_code == 1, result.output
    assert "Traceback" not in result.output
    page = (tmp_path / "out" / "report.md").read_text(encoding="utf-8")
    assert "factorisation broke down" in page and "NOT EVALUATED" in page
    record = json.loads((tmp_path / "out" / "report.json").read_text(encoding="utf-8"))
    verdicts = {one["name"]: one["verdict"] for one in record["options"]}
    assert verdicts["worst"] == "NOT EVALUATED" and verdicts["lqr"] == "PASS"


@pytest.mark.parametrize("answer", [None, 7.0])
def test_what_solvers_of_quadratic_programs_say_is_not_believed(
    answer: float | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """min x^2 - 4 x + y^2 / 2 - 3 y in a box: (1, 3), by any means that can be checked, or no point at all."""

    def candidate(P: Any, q: Any, A: Any, bounds: Any, *, time_limit: float) -> solvers.Candidate:
        if answer is None:
            return solvers.Candidate("broken", None, None, 0)
        return solvers.Candidate("broken", np.full(q.shape, answer), np.full(A.shape[0], answer), 1)

    for name in ("osqp_candidate", "clarabel_candidate"):
        monkeypatch.setattr(quadratic, name, candidate)
    found = quadratic.quadratic_program(np.diag([2.0, 1.0]), [-4.0, -3.0], np.eye(2), [0.0, 0.0], [1.0, 5.0])
    if found.status is Status.SOLVED:
        np.testing.assert_allclose(found.x, [1.0, 3.0], atol=1e-9)
    else:
        assert found.status is Status.NOT_VERIFIED and found.message
    monkeypatch.setattr(quadratic, "_active_set_points", lambda *arguments: iter(()))
    blind = quadratic.quadratic_program(np.diag([2.0, 1.0]), [-4.0, -3.0], np.eye(2), [0.0, 0.0], [1.0, 5.0])
    assert blind.status is not Status.SOLVED or np.allclose(blind.x, [1.0, 3.0], atol=1e-9)


def test_numbers_that_are_none_leave_no_point() -> None:
    for bad in (np.nan, np.inf, -np.inf, 1e300):
        assert solvers._point([1.0, bad]) is None
    assert solvers._point([1.0, -2.0]) is not None and solvers._point(None) is None


def test_a_library_that_is_not_there_is_named(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """cvxpy's import is refused, as where it was never installed: the budget says so, the laws beside it are made."""
    scenario = design_fixture.read(TEXT + design_fixture.BUDGET, folder)
    real = builtins.__import__

    def refuse(name: str, *arguments: Any, **options: Any) -> Any:
        if name.split(".")[0] == "cvxpy":
            raise ModuleNotFoundError("No module named 'cvxpy'", name="cvxpy")
        return real(name, *arguments, **options)

    monkeypatch.delitem(sys.modules, "cvxpy", raising=False)
    monkeypatch.setattr(builtins, "__import__", refuse)
    study = survey_design(scenario, [one for one in scenario.options if one.name in ("dampers", "lqr")])
    broken, good = design_fixture.law(study, "dampers"), design_fixture.law(study, "lqr")
    assert "cvxpy is not installed" in broken.failure and broken.verdict is Verdict.NOT_EVALUATED
    assert good.verdict is Verdict.PASS
