"""Ranking and its sensitivity on fronts made by hand, and whole small searches over a scenario."""

from pathlib import Path

import numpy as np
import pytest

from maglev_ctrl.errors import Verdict
from maglev_ctrl.scenario import load
from maglev_ctrl.scenario.problems import ScenarioProblems
from maglev_ctrl.scenario.reader import with_values
from maglev_ctrl.study.run import run
from maglev_ctrl.study.tuning.evaluate import Judge, judged_in_loop
from maglev_ctrl.study.tuning.figures import objective_axis
from maglev_ctrl.study.tuning.option import OptionSearch, tune_option, untuned
from maglev_ctrl.study.tuning.ranking import Contender, distances, ranked, shifts
from maglev_ctrl.study.tuning.records import TunedOption
from maglev_ctrl.study.tuning.run import tune, tuned_scenario

FOUR = load("scenarios/compare/four_options.toml")
DAMPING = tuple(one for one in judged_in_loop(FOUR) if one.name == "damping")  # at least 0.05
AXES = tuple(objective_axis(one) for one in ("ride", "gap"))


def searched(name, rows, values, *, front=None, chosen=0, violation=0.0, reason=""):
    """A search whose first `front` rows are its front; one requirement's value a row."""
    count = len(rows) if front is None else front
    score = np.array(rows, dtype=float).reshape(-1, 2)
    record = TunedOption(
        option=name, label=name, kind="baseline", variables=(), front=score[:count],
        front_variables=np.zeros((count, 0)),
        chosen=chosen, knee=chosen, feasible=count > 0, binding="" if count else "damping", violation=violation,
        evaluations=len(rows), failures=0, generations=1, stopped="generations", seed=1, seconds=0.0, reason=reason,
    )  # fmt: skip
    return OptionSearch(record, score, np.array(values, dtype=float).reshape(-1, 1), () if count else ("damping",))


def test_distance_in_ranges_over_all_fronts():
    one = Contender(np.array([[0.0, 40.0], [1.0, 20.0], [4.0, 0.0]]), 1)
    other = Contender(np.array([[2.0, 10.0]]), 0)
    nothing = Contender(np.zeros((0, 2)), -1)
    far = distances([one, other, nothing], [1.0, 1.0])
    assert far[0] == pytest.approx(np.sqrt((0.25**2 + 0.5**2) / 2.0)) and np.isinf(far[2])
    assert far[1] == pytest.approx(np.sqrt((0.5**2 + 0.25**2) / 2.0))
    weighted = distances([one, other], [2.0, 1.0])
    assert weighted[0] < far[0] and weighted[1] > far[1]  # the first is better in the first objective
    assert np.allclose(distances([one, other], [3.0, 3.0]), far[:2])  # only ratios of weights count
    assert np.all(np.isinf(distances([nothing], [1.0, 1.0])))


def test_an_option_that_misses_comes_after_all_that_meet():
    fine = searched("fine", [[3.0, 3.0]], [0.06])
    best = searched("best", [[1.0, 1.0]], [0.09])
    little = searched("little", [[0.1, 0.1]], [0.045], front=0, violation=0.1)
    much = searched("much", [[0.1, 0.1]], [0.01], front=0, violation=0.8)
    lost = untuned(FOUR, FOUR.options[0], "its process was killed")
    lost = OptionSearch(lost.record, np.zeros((0, 2)), np.zeros((0, 1)), lost.misses)
    order = ranked([much, lost, fine, little, best])
    assert [one.option for one in order] == ["best", "fine", "little", "much", FOUR.options[0].name]
    assert [one.place for one in order] == [1, 2, 3, 4, 5]
    assert [bool(one.misses) for one in order] == [False, False, True, True, True]


def test_a_tighter_limit_takes_candidates_from_the_front():
    """ "quick" is best, but only with little damping in hand: with a limit a quarter higher its knee is gone."""
    quick = searched("quick", [[1.0, 1.0], [9.0, 9.0]], [0.055, 0.08], front=1)
    calm = searched("calm", [[2.0, 2.0]], [0.09])
    table = {(s.what, s.factor): s for s in shifts([quick, calm], DAMPING, AXES, choose="knee")}
    assert len(table) == 4 + 2 * 2
    assert table["limit of damping", 1.25].changed and table["limit of damping", 1.25].first == "calm"
    assert table["limit of damping", 1.25].places == (2, 1)
    assert not table["limit of damping", 0.8].changed and table["limit of damping", 0.8].first == "quick"


def test_a_looser_limit_lets_candidates_in_that_were_searched():
    near = searched("near", [[3.0, 3.0], [1.0, 1.0]], [0.06, 0.047], front=1)
    calm = searched("calm", [[2.0, 2.0]], [0.09])
    table = {(s.what, s.factor): s for s in shifts([near, calm], DAMPING, AXES, choose="knee")}
    assert table["limit of damping", 0.8].first == "near" and table["limit of damping", 0.8].changed
    assert not table["limit of damping", 1.1].changed


def test_weights_change_who_is_first():
    soft = searched("soft", [[0.0, 10.0]], [0.09])
    tight = searched("tight", [[10.0, 0.0]], [0.09])
    middle = searched("middle", [[6.0, 6.0]], [0.09])
    table = {(s.what, s.factor): s for s in shifts([soft, tight, middle], DAMPING, AXES, choose="knee")}
    assert table["weight of ride", 2.0].first == "soft" and table["weight of gap", 2.0].first == "tight"
    assert not table["limit of damping", 1.1].changed


def test_nobody_left():
    only = searched("only", [[1.0, 1.0]], [0.052])
    table = {(s.what, s.factor): s for s in shifts([only], DAMPING, AXES, choose="ride")}
    assert table["limit of damping", 1.25].first == ""


# ------------------------------------------------------------------------------------------ whole small searches
def small(tmp_path, *, drop=(), **changes):
    """Two passive options without girders, a small budget."""
    text = Path("scenarios/compare/four_options.toml").read_text()
    head, *options = text.split("[[option]]\n")
    last, requirements = options[-1].split("# -----", 1)
    kept = [one for one in (*options[:-1], last) if "passive" in one.split("\n")[0]]
    head = "".join(line for line in head.splitlines(keepends=True) if not line.startswith("girder"))
    before, _, after = head.partition("[uncertainty]")  # no requirement is about it, and its proof takes longest
    head = before + after[after.index("\n[") + 1 :]
    head = head.replace("count = 19", "count = 5")  # the ends of the sweeps are what a search looks at
    for key, value in ({"population": "8", "generations": "2"} | changes).items():
        head = "".join(
            f"{key} = {value}\n" if line.startswith(f"{key} = ") else line for line in head.splitlines(keepends=True)
        )
    path = tmp_path / "small.toml"
    path.write_text("[[option]]\n".join([head, *kept]) + "# -----" + requirements)
    return load(path)


@pytest.fixture(scope="module")
def tuned(tmp_path_factory):
    told = []
    scenario = small(tmp_path_factory.mktemp("small"))
    return scenario, *tune(scenario, progress=lambda what, share: told.append((what, share))), told


def test_a_whole_search(tuned):
    _, _, study, told = tuned
    assert [one.option for one in study.options] == ["passive_primary", "passive_secondary"]
    assert "seed 1" in study.method and "8 candidates x 2 generations" in study.method
    assert study.situations[0] == "design point" and study.after == () and "damping" in study.in_loop
    second = study.options[1]
    assert second.feasible and second.stopped == "generations" and second.generations == 2
    assert 8 <= second.evaluations <= 16 and second.seed == 1
    assert np.all(np.diff(second.front[:, 0]) >= 0.0) and len(second.front) == len(second.front_variables)
    (damping,) = second.variables
    assert damping.lower <= damping.value <= damping.upper and damping.text.endswith("kN s/m")
    assert study.ranking[0].place == 1 and study.ranking[0].misses == ()
    assert told[-1][1] == 1.0 and any("generation 1 of 2" in what for what, _ in told)
    assert all(0.0 <= share <= 1.0 for _, share in told)


def test_the_tuned_scenario_is_a_file_of_its_own(tuned):
    scenario, better, study, _ = tuned
    chosen = study.options[1].variables[0].value
    assert better.options[1].spring_dampers[0].damping == chosen
    assert repr(chosen) in better.text and better.hash != scenario.hash
    assert better.options[1].tunes == scenario.options[1].tunes


def test_the_front_is_not_bettered_by_the_candidate_it_started_from(tuned):
    scenario, _, study, _ = tuned
    option = scenario.options[1]
    written = tune_option(with_values(scenario, {("tuning", "generations"): 1, ("option", 1, "tune"): []}),
                          option.model_copy(update={"tunes": ()})).record  # fmt: skip
    assert written.stopped == "no variables" and written.evaluations == 1 and written.variables == ()
    assert not np.any(np.all(written.front[0] < study.options[1].front - 1e-12, axis=1))


def test_the_same_seed_and_the_number_of_processes_change_nothing(tmp_path):
    """One generation: what a process would change is there in the first already, and starting two takes longest."""
    scenario = small(tmp_path, generations="1")
    _, study = tune(scenario)
    _, again = tune(scenario, jobs=2)
    for one, other in zip(study.options, again.options, strict=True):
        assert np.array_equal(one.front, other.front) and np.array_equal(one.front_variables, other.front_variables)
    assert [one.option for one in again.ranking] == [one.option for one in study.ranking]


def test_a_requirement_nobody_meets_is_named(tmp_path):
    scenario = small(tmp_path, generations="1")
    hard = with_values(scenario, {("requirement", 1, "at_least"): 0.6})
    found = tune_option(hard, hard.options[1])
    assert not found.record.feasible and found.record.binding == "damping" and found.record.violation > 0.0
    assert len(found.record.front) == 1 and found.misses[0] == "damping"
    assert np.all(np.isfinite(found.record.front))  # the best found is measured in full where it is stable


def test_best_in_one_objective(tmp_path):
    scenario = small(tmp_path, generations="1")
    best = with_values(scenario, {("tuning", "choose"): "gap"})
    record = tune_option(best, best.options[1]).record
    assert record.chosen == int(np.argmin(record.front[:, 1]))


def test_no_model_at_all(tmp_path, monkeypatch):
    scenario = small(tmp_path, generations="1")
    found = Judge.__call__
    monkeypatch.setattr(Judge, "__call__", lambda self, values, *, everywhere=False: found(self, (np.nan,)))
    record = tune_option(scenario, scenario.options[1]).record
    assert record.reason.startswith("no candidate has a model") and record.chosen == -1 and len(record.front) == 0
    assert record.failures == record.evaluations
    assert tuned_scenario(scenario, [tune_option(scenario, one) for one in scenario.options]) is scenario


def test_time_limit(tmp_path):
    limited = with_values(small(tmp_path, generations="200"), {("tuning", "time_limit"): "0.5 s"})
    record = tune_option(limited, limited.options[1]).record
    assert record.stopped == "time limit" and record.evaluations < 400


def test_bad_calls(tmp_path):
    scenario = small(tmp_path)
    with pytest.raises(ValueError, match="jobs"):
        tune(scenario, jobs=0)
    with pytest.raises(ValueError, match="tuning"):
        tune(load("scenarios/compare/eds_135t.toml"))
    broken = with_values(scenario, {("option", 1, "tune", 0, "to"): "1 kN*s/m"})
    with pytest.raises(ScenarioProblems, match="more than the smallest value"):
        tune(broken)


def test_what_the_loop_promises_the_full_study_finds(tuned):
    """The chosen candidate, judged in full: every requirement that the loop judged passes there too."""
    _, better, study, _ = tuned
    only = better.model_copy(update={"options": better.options[1:]})
    judged = run(only).options[0].requirements
    verdicts = {one.name: one.verdict for one in judged}
    assert study.options[1].feasible
    for name in set(study.in_loop) & set(verdicts):
        assert verdicts[name] is Verdict.PASS, name
