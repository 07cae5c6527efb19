"""Studies of laws: what is told of each, what is written down of it, and what happens where there is none."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from design_fixture import ACTUATOR, ALLOWED, BUDGET, EVERY, LQR, VEHICLE, law, read, small_study

from maglev_ctrl.errors import ModelError, OutOfDomain, Status, Verdict
from maglev_ctrl.proofs.claims import DecayClaim
from maglev_ctrl.proofs.file import from_document
from maglev_ctrl.scenario import Scenario
from maglev_ctrl.study.design import option as recipe
from maglev_ctrl.study.design.budgeted import budgeted, in_kilonewtons, shown_damping
from maglev_ctrl.study.design.document import (
    DAMPERS,
    PREDICTIVE,
    changed_since,
    designs_text,
    kind_of,
    load_designs,
    pick,
    prove_again,
    sampled_controllers,
)
from maglev_ctrl.study.design.option import lost_law, study_law
from maglev_ctrl.study.design.records import DesignStudy
from maglev_ctrl.study.design.run import chosen_options, survey_design
from maglev_ctrl.study.law import designed_option
from maglev_ctrl.study.loops import own_connections
from maglev_ctrl.study.option import study_option
from maglev_ctrl.study.situation import OptionModel, Situation
from maglev_ctrl.systems import close_loop
from maglev_ctrl.systems.plant import closed_channel


@pytest.fixture(scope="module")
def study() -> DesignStudy:
    return small_study()


@pytest.fixture(scope="module")
def scenario(tmp_path_factory: pytest.TempPathFactory) -> Scenario:
    return read(EVERY, tmp_path_factory.mktemp("small"))


def test_every_law_is_proved_and_told_in_order(study: DesignStudy) -> None:
    assert [one.name for one in study.options] == ["lqr", "worst", "scheduled", "mpc", "dampers"]
    assert {one.verdict for one in study.options} == {Verdict.PASS} and study.verdict is Verdict.PASS
    for one in study.options:
        assert one.synthesis is not None and one.synthesis.proofs and one.failure == ""


def test_corner_poles_are_those_of_the_vehicle(study: DesignStudy, scenario: Scenario) -> None:
    one = law(study, "lqr")
    option = next(o for o in scenario.options if o.name == "lqr")
    model, design = designed_option(scenario, option)
    assert design is not None
    system = model.plant(Situation.of_design(scenario), pade_order=0)
    wanted = np.linalg.eigvals(close_loop(system, design.controller).state_matrix())
    found = one.corners[0].closed_loop
    np.testing.assert_allclose(np.sort_complex(found), np.sort_complex(wanted), rtol=1e-8)
    flipped = np.linalg.eigvals(
        close_loop(system, replace(design.controller, D=-design.controller.D)).state_matrix()
    )  # the mutant: feedback of the wrong sign
    assert np.max(found.real) < 0.0 < np.max(flipped.real)


def test_gain_curve_is_the_closed_loops_gain_and_stays_below_the_proved_level(study: DesignStudy) -> None:
    one = law(study, "worst")
    assert one.gain is not None and one.synthesis is not None
    A, B, C, D = closed_channel(one.synthesis.plants[0], one.synthesis.controllers[0])
    for k in range(0, len(one.gain.frequency), 97):
        s = 1j * one.gain.frequency[k]
        direct = np.linalg.norm(C @ np.linalg.solve(s * np.eye(len(A)) - A, B) + D, 2)
        assert one.gain.closed_loop[k] == pytest.approx(direct, rel=1e-7)
    assert np.max(one.gain.closed_loop) < one.gain.level < 1.01 * np.max(one.gain.closed_loop)


def test_documents_read_back_to_the_same_bits(study: DesignStudy, tmp_path: Path) -> None:
    documents = [one.document for one in study.options if one.document is not None]
    file = tmp_path / "design.json"
    file.write_text(designs_text(documents, created="now", versions=study.versions), encoding="utf-8")
    designs = load_designs(file)
    for one, found in zip(study.options, designs, strict=True):
        assert one.synthesis is not None
        for ours, theirs in zip(one.synthesis.controllers, found.controllers, strict=True):
            assert all(np.array_equal(getattr(ours, key), getattr(theirs, key)) for key in "ABCD")
        again = prove_again(found)
        assert [proof.statement for proof in again.proofs] == [proof.statement for proof in one.synthesis.proofs]
        assert all(proof.holds for proof in again.proofs)
        assert found.scenario["text"] == study.scenario_text and found.created == "now"
    assert [kind_of(found) for found in designs] == ["law", "law", "law", PREDICTIVE, DAMPERS]
    with pytest.raises(ModelError, match='did you mean "worst"'):
        pick(designs, "wurst", file=file)
    with pytest.raises(ModelError, match="several designs; choose one with --option: lqr, worst"):
        pick(designs, None, file=file)


def test_a_changed_gain_is_not_proved_again(study: DesignStudy) -> None:
    document = json.loads(json.dumps(law(study, "lqr").document))
    gains = document["controllers"][0]["D"]
    gains[0] = [-value for value in gains[0]]
    assert not any(proof.holds for proof in prove_again(from_document(document)).proofs)
    assert not prove_again(from_document(document)).proved
    none = {**document, "claims": []}
    assert prove_again(from_document(none)).doubts == ("the file makes no claim: there is nothing to prove",)


@pytest.mark.parametrize(
    ("part", "said"),
    [("plants", "no claim says that the loop at plant 2"), ("controllers", "no claim speaks of law 2")],
)
def test_what_no_claim_speaks_of_is_told(study: DesignStudy, part: str, said: str) -> None:
    document = json.loads(json.dumps(law(study, "lqr").document))
    assert prove_again(from_document(document)).proved
    document[part].append(document[part][0])
    again = prove_again(from_document(document))
    assert all(proof.holds for proof in again.proofs) and not again.proved
    assert said in again.doubts[0]


def test_a_claim_that_says_nothing_covers_nothing(study: DesignStudy) -> None:
    document = json.loads(json.dumps(law(study, "lqr").document))
    document["claims"][0]["rate"] = -1e6
    again = prove_again(from_document(document))
    assert all(proof.holds for proof in again.proofs) and not again.proved


def test_a_sampled_law_that_is_not_the_proved_one_is_told(study: DesignStudy) -> None:
    document = json.loads(json.dumps(law(study, "lqr").document))
    gains = document["extra"]["sampled"]["controllers"][0]["D"]
    gains[0] = [0.6 * value for value in gains[0]]
    again = prove_again(from_document(document))
    assert all(proof.holds for proof in again.proofs) and not again.proved
    assert "is not the proved law sampled every" in again.doubts[0]


def test_the_sampled_law_is_tustins_and_is_in_the_document(study: DesignStudy) -> None:
    one = law(study, "lqr")
    assert one.sampled is not None and one.sampled.loss is not None and one.document is not None
    held = sampled_controllers(from_document(one.document))
    assert held is not None and held[0] == 0.002
    assert np.array_equal(held[1][0].D, one.sampled.controllers[0].D)  # static gains stay what they are
    assert one.sampled.loss.stable
    wrong = {**one.document, "extra": {**one.document["extra"], "sampled": {**one.document["extra"]["sampled"]}}}
    wrong["extra"]["sampled"]["period"] = 0.004
    with pytest.raises(ModelError, match="expected laws and their sampling period"):
        sampled_controllers(from_document(wrong))
    assert sampled_controllers(from_document(law(study, "worst").document)) is None


def test_a_scheduled_law_follows_its_parameter(study: DesignStudy, scenario: Scenario) -> None:
    option = next(o for o in scenario.options if o.name == "scheduled")
    model, design = designed_option(scenario, option)
    assert design is not None and model.schedule is not None
    point = Situation.of_design(scenario)
    for place, node in enumerate(model.schedule.nodes):
        there = model.law_at(replace(point, speed=float(node)), design.controller)
        assert there is not None
        np.testing.assert_array_equal(there.D, model.schedule.controllers[place].D)
    between = model.law_at(replace(point, speed=80.0), design.controller)
    low, high = (law.D for law in model.schedule.controllers[:2])
    assert between is not None
    np.testing.assert_allclose(between.D, 0.5 * (low + high), rtol=1e-12)
    assert np.any(low != high)
    with pytest.raises(OutOfDomain, match="not scheduled there"):
        model.law_at(replace(point, speed=200.0), design.controller)
    fixed = OptionModel(scenario, option).law_at(replace(point, speed=80.0), design.controller)
    assert fixed is design.controller  # without a schedule the law stays what it was
    assert [corner.name for corner in law(study, "scheduled").corners][1:] == [
        "speed 216 km/h", "speed 360 km/h", "speed 504 km/h"
    ]  # fmt: skip
    assert "the proof allows it" in law(study, "scheduled").asked


def test_the_budget_chooses_the_dampers_of_the_report_too(study: DesignStudy, scenario: Scenario) -> None:
    one = law(study, "dampers")
    assert one.budget is not None and one.synthesis is not None and one.chosen == 0.4
    (damping,) = one.budget.together.damping[1]
    assert np.max(one.corners[0].closed_loop.real) == pytest.approx(-0.4, rel=0.01)
    assert [plant.name for plant in one.synthesis.plants] == ["design point"]
    assert any(note.startswith("secondary_damper_bogie: ") and "kN s/m" in note for note in one.notes)
    option = next(o for o in scenario.options if o.name == "dampers")
    model, _ = designed_option(scenario, option)
    assert dict(model.dampings)["secondary_damper_bogie"] == pytest.approx(damping, rel=0.02)
    shown = study_option(scenario, option)
    assert shown.modes is not None
    assert np.max(shown.modes.s.real) == pytest.approx(-0.4, rel=0.02)


def test_a_budget_keeps_its_time_limit_and_tells_its_points(tmp_path: Path) -> None:
    scenario = read(VEHICLE + BUDGET + 'time_limit = "1 us"\n', tmp_path)
    told: list[str] = []
    option = scenario.options[1]
    one = budgeted(scenario, option, lost_law(scenario, option, ""), step=told.append)
    assert one.failure == "damping budget: the time limit was reached" and one.verdict is Verdict.NOT_EVALUATED
    assert one.budget is not None and set(one.budget.together.reasons) == {"the time limit was reached"}
    assert told == []  # nothing was begun after the limit


def test_what_the_search_left_of_zero_is_zero() -> None:
    assert shown_damping(np.array([[4e4, 1e-6], [4e4, 1e-3]])).tolist() == [[4e4, 0.0], [4e4, 1e-3]]
    assert shown_damping(np.zeros((1, 2))).tolist() == [[0.0, 0.0]]
    assert in_kilonewtons("proved for every constant blend") == "proved for every constant blend"


def test_a_law_that_does_not_exist_keeps_its_reason(tmp_path: Path) -> None:
    hopeless = (
        ACTUATOR.format(name="hopeless", label="Hopeless")
        + '[option.control]\nlaw = "multi_objective"\nobjective = "h2"\ndecay_rate = "1 1/s"\n'
        'disturbance = "0.5 m/s^2/Hz^0.5"\ngain_below = 1.0' + ALLOWED
    )
    scenario = read(VEHICLE + hopeless + LQR, tmp_path)
    told: list[str] = []
    study = survey_design(scenario, chosen_options(scenario, ()), progress=lambda words, done: told.append(words))
    lost, kept = study.options
    assert lost.verdict is Verdict.NOT_EVALUATED and lost.document is None and lost.synthesis is None
    assert "a gain below 1" in lost.failure and "the least gain found" in lost.failure
    assert kept.verdict is Verdict.PASS and study.verdict is Verdict.NOT_EVALUATED
    assert told[0] == "Hopeless: designing" and told[-1] == "LQR: PASS" and "LQR: poles, gains and margins" in told


def test_faults_of_numerics_are_recorded_too(scenario: Scenario, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object) -> None:
        raise np.linalg.LinAlgError("Singular matrix")

    monkeypatch.setattr(recipe, "make_law", broken)
    one = study_law(scenario, scenario.options[1])
    assert one.failure == "Singular matrix" and one.status is Status.NUMERICAL_ERROR and one.design is None


def test_a_claim_that_fails_is_no_pass(study: DesignStudy) -> None:
    one = law(study, "lqr")
    assert one.synthesis is not None and isinstance(one.synthesis.claims[0], DecayClaim)
    worse = replace(one.synthesis.proofs[0], holds=False)
    assert replace(one, synthesis=replace(one.synthesis, proofs=(worse,))).verdict is Verdict.FAIL
    assert replace(one, delays="unstable").verdict is Verdict.FAIL
    assert replace(one, synthesis=replace(one.synthesis, proofs=())).verdict is Verdict.NOT_EVALUATED


def test_names_of_options(scenario: Scenario) -> None:
    assert [o.name for o in chosen_options(scenario, ["mpc"])] == ["mpc"]
    with pytest.raises(ValueError, match='no option is called "lqg"; did you mean "lqr"'):
        chosen_options(scenario, ["lqg"])
    with pytest.raises(ValueError, match='"bare" has neither a control law nor a damping budget'):
        chosen_options(scenario, ["bare"])
    with pytest.raises(ValueError, match="there is nothing to design"):
        chosen_options(scenario.model_copy(update={"options": scenario.options[:1]}), ())
    with pytest.raises(ValueError, match="jobs: expected one or more"):
        survey_design(scenario, (), jobs=0)


def test_levels_are_the_variance_of_the_closed_loop(study: DesignStudy) -> None:
    one = law(study, "worst")
    assert one.synthesis is not None and one.levels
    plant, controller = one.synthesis.plants[0], one.synthesis.controllers[0]
    A, B, C, _ = closed_channel(plant, controller)
    # By quadrature over frequency: the other method.
    omega = np.concatenate([np.linspace(0.0, 60.0, 60_001), np.geomspace(60.0, 1e5, 20_001)[1:]])
    gains = np.empty((len(omega), len(plant.performance)))
    for part in np.array_split(np.arange(len(omega)), 200):
        reply = C @ np.linalg.solve(1j * omega[part, None, None] * np.eye(len(A)) - A, B + 0j)
        gains[part] = np.sum(np.abs(reply) ** 2, axis=-1)
    variance = np.trapezoid(gains, omega, axis=0) / np.pi
    for level in one.levels:
        share = level.root_mean_square / level.allowed
        assert share == pytest.approx(np.sqrt(variance[plant.performance.index(level.name)]), rel=2e-3), level.name
    assert not law(study, "lqr").levels  # it names no disturbance


def test_a_file_that_was_changed_is_told(study: DesignStudy, tmp_path: Path) -> None:
    documents = [one.document for one in study.options if one.document is not None]
    file = tmp_path / "design.json"
    file.write_text(designs_text(documents, created="now", versions=study.versions), encoding="utf-8")
    assert changed_since(file) == ""
    data = json.loads(file.read_text(encoding="utf-8"))
    data["designs"][0]["scenario"]["text"] += "#"
    file.write_text(json.dumps(data), encoding="utf-8")
    assert "not as it was written" in changed_since(file)
    del data["digest"]
    file.write_text(json.dumps(data), encoding="utf-8")
    assert changed_since(file) == "the file has no digest"


def test_a_damper_of_nothing_is_no_channel(scenario: Scenario) -> None:
    option = next(o for o in scenario.options if o.damping_budget is not None)
    model = OptionModel(scenario, option)
    names = own_connections(model, model.vehicle())
    assert names
    some = replace(model, dampings=((names[0], 0.0),))
    assert own_connections(some, some.vehicle()) == names[1:]
