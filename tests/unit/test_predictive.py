"""Predictive control: plans that are optimal, limits that hold, a law to fall back on, no offset."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from maglev_ctrl.errors import ModelError, Status
from maglev_ctrl.synthesis.predictive.controller import PredictiveController
from maglev_ctrl.synthesis.predictive.design import design_predictive
from maglev_ctrl.synthesis.predictive.estimate import DisturbanceModel, estimator
from maglev_ctrl.synthesis.predictive.general import GeneralSolver
from maglev_ctrl.synthesis.predictive.problem import OutputLimit, predictive_problem
from maglev_ctrl.synthesis.predictive.quadratic import quadratic_program
from maglev_ctrl.synthesis.predictive.simulate import simulate_predictive, simulate_saturated
from maglev_ctrl.systems.plant import Plant


def hanging(*, measured: str = "states") -> Plant:
    """A magnet under a rail: 1 t, negative stiffness, force command and force disturbance in kN, gap in mm."""
    k, m = 1.0e6 / 1000.0, 1000.0  # N/mm, kg; accelerations in mm/s^2
    A = [[0.0, 1.0], [1000.0 * k / m, 0.0]]
    B = [[0.0], [1.0e6 / m]]
    rows = None if measured == "states" else [[1.0, 0.0]]
    return Plant.from_matrices(
        A, B, B, np.eye(2), rows, states=("gap", "rate"), commands=("force",), disturbances=("load",),
        performance=("gap_error", "rate_error"), measured=None if rows is None else ("gap",), name="magnet",
    )  # fmt: skip


def problem_of(plant=None, **given):
    chosen = {
        "horizon": 20, "dt": 0.005, "Q": np.diag([1.0, 1e-4]), "R": [[0.01]],
        "command_limits": ([-5.0], [5.0]),
    } | given  # fmt: skip
    return predictive_problem(plant if plant is not None else hanging(), **chosen)


@pytest.fixture(scope="module")
def box():
    return design_predictive(problem_of(terminal="cost"))


@pytest.fixture(scope="module")
def full():
    limits = (OutputLimit("gap_error", -2.0, 2.0),)
    return design_predictive(problem_of(output_limits=limits, rate_limits=[2.0]))


def test_without_active_limits_it_is_the_regulator(box, full):
    generator = np.random.default_rng(1)
    for design in (box, full):
        law = PredictiveController(design)
        for x in 0.02 * generator.normal(size=(20, 2)) * [1.0, 20.0]:
            law.reset()
            record = law.step(x)
            assert record.active == () and record.path == "condensed"
            expected = -design.gain @ x
            assert abs(record.command[0] - expected[0]) <= 1e-9 * np.max(np.abs(design.gain) @ np.abs(x))


def test_the_general_path_without_active_limits_is_the_regulator(full):
    solver, x = GeneralSolver(full.program), np.array([0.02, -0.5])
    plan = solver.solve(full.at_origin(x, np.zeros(1)))
    assert plan.status is Status.SOLVED
    # OSQP with polishing; the program has no inequality active, so its solution is a linear system's
    assert abs(plan.moves[0, 0] + float(full.gain[0] @ x)) <= 1e-9


def test_the_plan_under_limits_is_the_programs_optimum(full, box):
    """Condensed and sparse programs, two formulations, against the cascade."""
    for design, x in ((box, [1.5, 20.0]), (full, [0.5, 10.0]), (full, [0.9, 15.0])):
        x = np.array(x)
        law = PredictiveController(design)
        record = law.step(x)
        now = design.at_origin(x, np.zeros(1))
        program = design.program
        reference = quadratic_program(program.P, program.q, program.A, *program.bounds(now))
        assert reference.status is Status.SOLVED and record.status is Status.SOLVED
        n_x = program.sizes[0]
        expected = (reference.x * program.units)[n_x : n_x + record.moves.size]
        assert np.max(np.abs(record.moves.ravel() - expected)) <= 1e-6 * 5.0
        assert record.active_ahead > 0 or record.path == "general"
        assert record.residual <= 1e-6
        # what is predicted is what the plant does
        x_next = design.problem.plant.A @ x + design.problem.plant.B2 @ record.command
        assert np.allclose(record.states[1], x_next, atol=1e-6)


def test_cross_weights_in_both_formulations():
    """x'Nu pairs states and commands of one sample; a shift by one would be seen here."""
    weights = {"Q": np.diag([1.0, 1e-3]), "R": [[0.02]], "N": [[0.05], [0.001]]}
    design = design_predictive(problem_of(**weights, terminal="cost", horizon=7))
    x = np.array([1.0, 30.0])
    record = PredictiveController(design).step(x)
    plan = GeneralSolver(design.program).solve(design.at_origin(x, np.zeros(1)))
    assert record.active_ahead > 0
    assert np.max(np.abs(plan.moves - record.moves)) <= 1e-6


def test_a_flipped_gradient_is_not_applied(box):
    """The solver's maps are replaced by wrong ones; the check, made of predictions, refuses the plan."""
    for mutant in (
        replace(box.condensed, free=-box.condensed.free),
        replace(box.condensed, inverse=box.condensed.inverse + 0.1 * np.eye(20)),
    ):
        law = PredictiveController(replace(box, condensed=mutant))
        record = law.step([0.9, 0.0])
        assert record.fallback and record.status is Status.NOT_VERIFIED
        assert "proved law" in record.message
    record = PredictiveController(replace(box, condensed=replace(box.condensed, F=-box.condensed.F))).step([0.9, 0.0])
    assert record.fallback


def test_an_infeasible_step_falls_back(full):
    law = PredictiveController(full)
    record = law.step([50.0, 0.0])
    assert record.fallback and record.status is Status.INFEASIBLE
    assert "from this state the plant cannot keep all of: command limits" in record.message
    expected = np.clip(-full.gain @ [50.0, 0.0], -2.0, 2.0)  # the rate from rest binds before the limit
    assert record.command == pytest.approx(expected)
    # and it goes on with a plan as soon as there is one
    assert law.step([0.01, 0.0]).path != "fallback"


def test_hard_limits_hold_and_stay_feasible(full):
    start = [0.9, 10.0]
    run = simulate_predictive(full, start, steps=60)
    assert run.fallback_steps == ()
    assert np.all(np.abs(run.u) <= 5.0 + 1e-9)
    assert np.max(np.abs(run.x[:, 0])) <= 2.0 + 1e-6
    changes = np.diff(np.concatenate([[0.0], run.u[:, 0]]))
    assert np.max(np.abs(changes)) <= 2.0 + 1e-6
    assert np.max(np.abs(changes)) >= 2.0 - 1e-6  # the rate limit was met
    assert abs(run.x[-1, 0]) <= 1e-6
    assert max(run.residuals) <= 1e-6


def test_prediction_is_worth_something(full):
    """From a start the rate-limited regulator loses, the predictive law comes home."""
    start = [0.9, 10.0]
    run, cut = simulate_predictive(full, start, steps=60), simulate_saturated(full, start, steps=60)
    assert np.max(np.abs(run.x[:, 0])) <= 2.0 + 1e-6
    assert np.max(np.abs(cut.u)) <= 5.0
    assert run.cost < cut.cost
    assert any("force" in name for names in cut.active for name in names) or np.max(np.abs(cut.x[:, 0])) > 2.0


def test_soft_limits_are_broken_only_where_they_must():
    soft = OutputLimit("gap_error", -1.0, 1.0, soft=True, linear=1e3, quadratic=1e3)
    design = design_predictive(problem_of(output_limits=(soft,), terminal="cost"))
    law = PredictiveController(design)
    inside = law.step([0.5, 0.0])
    assert inside.broken == {}
    outside = law.step([1.5, 40.0])
    assert outside.path == "general" and not outside.fallback
    assert outside.broken["gap_error"] == pytest.approx(np.max(np.abs(outside.states[1:, 0])) - 1.0, abs=1e-5)
    run = simulate_predictive(design, [1.5, 40.0], steps=80)
    assert run.fallback_steps == () and abs(run.x[-1, 0]) < 1e-6
    # exact penalty: where the hard limit can be kept, the soft one is
    x = [0.9, 25.0]
    hard = OutputLimit("gap_error", -1.0, 1.0)
    lazy = [design_predictive(problem_of(output_limits=(limit,), terminal="cost", R=[[1.0]])) for limit in (soft, hard)]
    one, other = (PredictiveController(design).step(x) for design in lazy)
    assert one.path == other.path == "general"
    assert np.max(np.abs(one.moves - other.moves)) <= 1e-4 * 5.0
    assert max(one.broken.values(), default=0.0) <= 1e-6


def offset_free(**given):
    plant = problem_of(hanging(measured="gap"), terminal="cost", **given).plant
    model = DisturbanceModel.on_commands(plant)
    return design_predictive(
        problem_of(hanging(measured="gap"), terminal="cost", **given), disturbance=model, tracked=("gap",),
        process=np.diag([1e-4, 1e-1]), drift=0.1, measurement=[[1e-4]],
    )  # fmt: skip


def test_no_offset_under_a_constant_load():
    design = offset_free()
    assert design.synthesis.status is Status.SOLVED, design.synthesis.message
    run = simulate_predictive(design, [0.0, 0.0], steps=400, disturbance=[1.5])
    assert abs(run.x[-1, 0]) <= 1e-8
    assert run.u[-1, 0] == pytest.approx(-1.5, abs=1e-6)
    assert run.estimates[-1, 2] == pytest.approx(1.5, abs=1e-6)
    # the mutant without integration: a state feedback rests beside the reference
    plain = design_predictive(problem_of(terminal="cost"))
    assert abs(simulate_predictive(plain, [0.0, 0.0], steps=400, disturbance=[1.5]).x[-1, 0]) > 1e-2


def test_no_offset_with_a_wrong_model_and_a_reference():
    design = offset_free()
    true = design.problem.plant
    wrong = replace(true, B2=0.9 * true.B2, B1=1.1 * true.B1)
    run = simulate_predictive(design, [0.0, 0.0], steps=600, disturbance=[1.0], reference=[0.2], plant=wrong)
    assert abs(run.x[-1, 0] - 0.2) <= 1e-7


def test_a_target_out_of_reach_is_cut_and_told():
    design = offset_free(command_limits=([-1.0], [1.0]))
    law = PredictiveController(design)
    law.reset([0.0, 0.0, 0.5])
    record = law.step([0.0], reference=[50.0])
    assert "out of reach" in record.message and abs(record.command[0]) <= 1.0


def test_more_disturbances_than_measurements():
    plant = problem_of(hanging(measured="gap")).plant
    model = DisturbanceModel.on_commands(plant)
    twice = DisturbanceModel(np.hstack([model.B, model.B]), np.hstack([model.C, model.C]), ("one", "two"))
    with pytest.raises(ModelError, match=r"2 constant disturbances .* 1 measured outputs"):
        estimator(plant, twice, measurement=[[1.0]])


def test_an_undetectable_disturbance_is_named():
    """A bias of the position sensor of a free mass is a position."""
    free = Plant.from_matrices([[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]], [[0.0], [1.0]], np.eye(2), [[1.0, 0.0]],
                               measured=("position",))  # fmt: skip
    plant = predictive_problem(free, horizon=5, dt=0.1).plant if np.any(free.D12) else problem_of(free).plant
    with pytest.raises(ModelError, match="disturbance 'position' cannot be told"):
        estimator(plant, DisturbanceModel.on_outputs(plant), measurement=[[1.0]])


def test_an_unseen_unstable_mode_is_named():
    plant = Plant.from_matrices(np.diag([1.1, 0.5]), np.eye(2), np.eye(2), np.eye(2), [[0.0, 1.0]],
                                states=("loose", "held"), dt=0.1)  # fmt: skip
    with pytest.raises(ModelError, match="loose"):
        estimator(plant, DisturbanceModel.on_commands(plant, ("u1",)), measurement=[[1.0]])


def test_a_sensor_that_feels_the_command():
    """An accelerometer: decide, apply, observe."""
    plant = hanging(measured="gap")
    both = replace(
        plant, C2=np.vstack([plant.C2, plant.A[1:]]), D21=np.vstack([plant.D21, plant.B1[1:]]),
        D22=np.vstack([plant.D22, plant.B2[1:]]), measured=("gap", "acceleration"),
    )  # fmt: skip
    problem = problem_of(both, terminal="cost")
    model = DisturbanceModel.on_disturbances(problem.plant)
    design = design_predictive(problem, disturbance=model, tracked=("gap",), process=np.diag([1e-4, 1e-1]),
                               drift=0.1, measurement=np.diag([1e-4, 1e2]))  # fmt: skip
    assert design.synthesis.controllers
    run = simulate_predictive(design, [0.1, 0.0], steps=400, disturbance=[1.0])
    assert abs(run.x[-1, 0]) <= 1e-7
    with pytest.raises(ValueError, match="decide"):
        PredictiveController(design).step([0.0, 0.0])


def test_the_fallback_law_is_proved(box, full):
    for design in (box, full, offset_free()):
        assert design.synthesis.status is Status.SOLVED, design.synthesis.message
        kinds = [type(claim).__name__ for claim in design.synthesis.claims]
        assert kinds == ["DecayClaim", "EllipsoidClaim"]
        assert all(proof.holds for proof in design.synthesis.proofs)
    assert any("recursive feasibility" in line for line in full.statements)
    assert any("not promised" in line for line in box.statements)


def test_the_compiled_path_gives_the_same_moves(box):
    pytest.importorskip("numba")
    plain, compiled = PredictiveController(box), PredictiveController(box, backend="fast")
    for x in np.random.default_rng(2).normal(size=(15, 2)) * [0.6, 15.0]:
        one, other = plain.step(x), compiled.step(x)
        assert np.max(np.abs(one.moves - other.moves)) <= 1e-9
    with pytest.raises(ValueError, match="backend"):
        PredictiveController(box, backend="numbers").step([0.0, 0.0])


def test_a_command_without_limits():
    """One limited command, one free: the free one passes the others' limits by."""
    plant = Plant.from_matrices([[0.0, 1.0], [4.0, 0.0]], np.eye(2), [[0.0, 0.0], [1.0, 0.5]], np.eye(2))
    problem = predictive_problem(plant, dt=0.1, horizon=10, Q=np.eye(2), R=np.diag([0.1, 1.0]), terminal="cost",
                                 command_limits=([-0.5, -np.inf], [0.5, np.inf]))  # fmt: skip
    design = design_predictive(problem)
    assert design.synthesis.status is Status.SOLVED, design.synthesis.message
    run = simulate_predictive(design, [3.0, 0.0], steps=250)
    assert run.fallback_steps == () and np.max(np.abs(run.u[:, 1])) > 1.0
    assert np.max(np.abs(run.u[:, 0])) <= 0.5 and "u1" in run.active[0][0]
    assert np.max(np.abs(run.x[-1])) < 1e-2


def test_a_run_can_be_repeated(full):
    record = PredictiveController(full).step([0.1, 0.0])
    assert not any(array.flags.writeable for array in (record.command, record.moves, record.states, record.estimate))
    first, second = (simulate_predictive(full, [0.9, 10.0], steps=15) for _ in range(2))
    assert np.array_equal(first.u, second.u)


def test_what_is_wrong_is_said():
    with pytest.raises(ValueError, match="dt: the plant is continuous"):
        predictive_problem(hanging(), horizon=5)
    with pytest.raises(ValueError, match="lower < 0 < upper"):
        problem_of(command_limits=([0.0], [1.0]))
    with pytest.raises(ValueError, match="'gapp' is no output"):
        problem_of(output_limits=(OutputLimit("gapp", -1.0, 1.0),))
    with pytest.raises(ValueError, match="positive penalty"):
        problem_of(output_limits=(OutputLimit("gap", -1.0, 1.0, soft=True),))
    with pytest.raises(ValueError, match="positive definite matrix; every command"):
        problem_of(R=[[0.0]])
    with pytest.raises(ValueError, match="give a disturbance model"):
        design_predictive(problem_of(hanging(measured="gap")))
    with pytest.raises(ModelError, match="no regulator"):
        design_predictive(problem_of(replace(hanging(), B2=np.zeros((2, 1)))))
    law = PredictiveController(design_predictive(problem_of(terminal="cost")))
    with pytest.raises(ValueError, match="2 finite numbers"):
        law.step([np.nan, 0.0])


def test_solvers_are_loaded_late():
    code = (
        "import sys, maglev_ctrl.synthesis.predictive.controller, maglev_ctrl.synthesis.predictive.simulate\n"
        "print(sorted(set(sys.modules) & {'osqp', 'cvxpy', 'clarabel', 'control', 'numba'}))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
