"""The live study: sliders, previews that agree with the full computation, what is said where there is no answer."""

from dataclasses import replace

import numpy as np
import pytest

from maglev_ctrl.analysis.modes import ModeKind, modes
from maglev_ctrl.analysis.plane_records import STABLE
from maglev_ctrl.analysis.tracking import track
from maglev_ctrl.errors import ModelError, OutOfDomain, Verdict
from maglev_ctrl.scenario import load
from maglev_ctrl.scenario.reader import from_text
from maglev_ctrl.study.live import LiveStudy, compare_options, tracks
from maglev_ctrl.study.live.designed import designed
from maglev_ctrl.study.live.fast_map import plane_of
from maglev_ctrl.study.live.quantities import MOST
from maglev_ctrl.study.live.settle import verdict_of
from maglev_ctrl.study.situation import OptionModel, Situation

TRAIN = "scenarios/compare/warwick_30t.toml"


@pytest.fixture(scope="module")
def train():
    return load(TRAIN)


@pytest.fixture(scope="module")
def study(train):
    return LiveStudy(train, "secondary_skyhook")


@pytest.fixture(scope="module")
def bare(train):
    return LiveStudy(train, "bare")


def test_the_sliders_are_few_named_for_people_and_hold_their_own_value(train, study):
    found = study.quantities()
    assert [one.name for one in found[:2]] == ["speed", "depth"]
    assert len(found) <= MOST
    assert all(one.low <= one.value <= one.high and one.low < one.high for one in found)
    assert all(not one.logarithmic or one.low > 0.0 for one in found)
    speed = found[0]
    assert (speed.unit, speed.scale, speed.group) == ("km/h", 3.6, "operating")
    assert {one.group for one in found} >= {"operating", "modulation", "vehicle", "law"}
    assert not any("lateral" in one.name for one in found)  # the train only heaves


@pytest.mark.parametrize("path, option", [
    (TRAIN, "secondary_lqr"), ("scenarios/paper/heave_surge.toml", "heave_coil_lqr"),
    ("scenarios/paper/six_dof.toml", "all_dampers"), ("scenarios/design/ems_hover.toml", "lqr"),
    ("scenarios/paper/double_l_corner_image.toml", "sway_damper"),
])  # fmt: skip
def test_both_ends_of_every_slider_make_a_valid_file_that_says_these_values(path, option):
    scenario = load(path)
    live = LiveStudy(scenario, option)
    for end in ("low", "high"):
        values = {one.name: getattr(one, end) for one in live.quantities()}
        made = LiveStudy(from_text(live.scenario_text(values), scenario), option)
        for one in made.quantities():
            assert one.value == pytest.approx(values[one.name], rel=1e-9, abs=1e-12), one.name


def test_a_written_scenario_keeps_its_comments_and_what_was_not_moved(train, study):
    assert study.scenario_text({}) == train.text
    text = study.scenario_text({"speed": 100.0})
    assert text != train.text
    changed = [(a, b) for a, b in zip(train.text.splitlines(), text.splitlines(), strict=True) if a != b]
    assert len(changed) == 1
    assert 'speed = "360 km/h"' in changed[0][1]
    assert changed[0][0].partition("#")[2] == changed[0][1].partition("#")[2]


def test_a_value_the_file_leaves_out_is_written_beside_its_neighbours():
    scenario = load("scenarios/paper/heave_surge.toml")
    assert "payload" not in scenario.text
    text = LiveStudy(scenario, "bare").scenario_text({"payload": 500.0})
    assert from_text(text, scenario).vehicle.car.payload == 500.0


def test_the_point_is_that_of_the_full_model(train, study):
    values = {"speed": 80.0, "height": 0.11, "payload": 2500.0}
    values = {name: value for name, value in values.items() if name in {one.name for one in study.quantities()}}
    view = study.preview(values)
    own = designed(train, "secondary_skyhook")
    situation = replace(Situation.of_design(train), **values)
    expected = modes(own.model.closed_of(own.model.vehicle(situation.payload), situation, own.controller))
    assert np.allclose(view.modes.s, expected.s, rtol=1e-12)
    assert view.modes.labels == expected.labels
    assert view.verdict is Verdict.NOT_EVALUATED and not view.settled and not view.map.checked
    assert "Not checked" in view.map.note


def test_moving_the_point_keeps_the_law_and_moving_a_damping_designs_it_anew(train):
    live = LiveStudy(train, "secondary_lqr")
    own = live.preview({})
    law = live._designed(live._chosen({}))
    assert live._designed(live._chosen({"height": 0.11, "speed": 90.0})) is law
    name = next(one.name for one in live.quantities() if one.group == "law")
    other = live._designed(live._chosen({name: 2.0 * {q.name: q.value for q in live.quantities()}[name]}))
    assert not np.allclose(other.controller.D, law.controller.D)
    assert live.preview({"speed": 90.0}).map is own.map  # speed and depth move the marker alone
    assert live.preview({"height": 1.02 * own.height}).map is not own.map


def test_tracks_are_those_of_the_modes_one_by_one(train, bare):
    found = bare.preview({}).tracks
    chosen = np.arange(0, len(found.parameter), 6)
    own = designed(train, "bare")
    points = [
        modes(own.closed(replace(Situation.of_design(train), speed=float(v)))[0]) for v in found.parameter[chosen]
    ]
    expected = track(points, parameter=found.parameter[chosen])
    assert found.labels == expected.labels
    assert np.allclose(found.s[chosen], expected.s, rtol=1e-5)
    assert [found.kinds[k] for k in chosen] == list(expected.kinds)
    assert any(ModeKind.SINGLE_MODE_FLUTTER in row for row in found.kinds)


def test_left_vectors_turned_the_wrong_way_are_seen_by_the_track_test(bare, monkeypatch):
    right = bare.preview({}).tracks
    monkeypatch.setattr(tracks, "_left", lambda vectors: np.conj(vectors))
    wrong = LiveStudy(bare.scenario, "bare").preview({}).tracks
    assert not np.allclose(wrong.confidence, right.confidence, atol=1e-3, equal_nan=True)


def test_settling_checks_names_and_judges(train, study):
    view = study.preview({})
    settled = study.settle(view)
    assert settled.settled and settled.map.checked and settled.floquet is not None and settled.margins is not None
    assert settled.map.regions and all(one.name for one in settled.map.regions)
    own = designed(train, "secondary_skyhook")
    plane = plane_of(own, Situation.of_design(train), view.map.speed, view.map.depth, checks=4)
    assert np.array_equal(settled.map.state, plane.state.T)
    judged = {one.quantity: one for one in settled.requirements}
    assert judged["growth_rate"].value == pytest.approx(view.modes.spectral_abscissa, rel=0.05)
    assert "at the operating point" in judged["growth_rate"].description
    later = [one for one in settled.requirements if one.reason == "computed in the report"]
    assert later and all(one.verdict is Verdict.NOT_EVALUATED for one in later)
    assert settled.verdict is not Verdict.PASS
    assert settled.verdict_words.startswith("Stable; ") and settled.verdict_words.endswith(".")
    assert study.settle(settled) is settled


def test_a_point_that_fails_one_judged_requirement_fails(bare):
    settled = bare.settle(bare.preview({}))
    assert settled.verdict is Verdict.FAIL
    assert settled.verdict_words.startswith("Unstable: bogie heave grows at 0.0042 1/s, fed most by bogie magnet")
    assert "nothing to break" in settled.margins_reason


def test_a_cancelled_settle_changes_nothing(study):
    view = study.preview({})
    assert study.settle(view, cancelled=lambda: True) is view


@pytest.mark.parametrize("values, words", [
    ({"height": -0.01}, "height"), ({"speed": -1.0}, "speed"), ({"speed": float("nan")}, "speed"),
])  # fmt: skip
def test_a_point_without_an_answer_says_so_in_words(study, values, words):
    view = study.preview(values)
    assert words in view.failure and "Traceback" not in view.failure
    assert view.modes is None and view.map is None and view.vehicle is not None
    assert study.settle(view) is view


def test_a_point_outside_the_forces_is_told(study, monkeypatch):
    def refused(*_, **__):
        raise OutOfDomain("height 0.3 m is outside the model's range 0.05 to 0.2 m")

    monkeypatch.setattr("maglev_ctrl.study.live.designed.linearize", refused)
    assert study.preview({"height": 0.3}).failure == "height 0.3 m is outside the model's range 0.05 to 0.2 m"


def test_an_unknown_slider_and_an_unknown_option_are_refused(train, study):
    with pytest.raises(ValueError, match='no slider "spede"'):
        study.preview({"spede": 1.0})
    with pytest.raises(ModelError, match='unknown option "bear"; did you mean "bare"'):
        LiveStudy(train, "bear")


def test_forces_that_are_not_solved_are_refused_with_the_way_to_solve_them():
    with pytest.raises(ModelError, match="solve_forces"):
        LiveStudy(load("scenarios/paper/double_l.toml"), "bare")


def test_without_periodic_forces_there_is_a_reason_instead_of_a_map():
    view = LiveStudy(load("scenarios/paper/heave_surge.toml"), "bare").preview({})
    assert view.map is None and "periodic" in view.map_reason and view.tracks is not None and view.depth == 0.0


def test_options_side_by_side(train):
    found = compare_options(train, {"speed": 90.0})
    assert found.options == tuple(one.name for one in train.options)
    assert found.growth[0] > 0.0 > found.growth[1]
    assert found.verdicts[0] is Verdict.FAIL
    assert np.isnan(found.disk_margin[0]) and "nothing to break" in found.reasons[0]
    assert np.all(np.isfinite(found.periodic_growth))
    stopped = compare_options(train, {}, cancelled=lambda: True)
    assert np.all(np.isnan(stopped.growth)) and "cancelled" in stopped.reasons[0]


def test_the_map_of_a_calm_option_is_calm(train):
    view = LiveStudy(train, "secondary_damper").preview({})
    assert np.all(view.map.state == STABLE) and view.map.state.shape == (100, 100)
    assert view.map.depth[0] == 0.0


def test_a_vehicle_of_the_option_is_shown(train, study):
    names = {one.name for one in study.preview({}).vehicle.actuators}
    assert names and names == {one.name for one in OptionModel(train, train.options[3]).vehicle().actuators}


def test_a_point_that_grows_under_modulation_never_passes() -> None:
    """Requirements of the mean system alone would pass there; removing the modulation is the mutant that does."""
    study = LiveStudy(load("scenarios/periodic/girder_passing.toml"), "weak_windings")
    calm = {"speed": 330.0 / 3.6, "depth": 0.0}
    deep = calm | {"depth": 0.4}
    at_rest, driven = (study.settle(study.point(values)) for values in (calm, deep))
    assert at_rest.floquet is not None and at_rest.floquet.stable is True
    assert driven.floquet is not None and driven.floquet.stable is False
    assert driven.verdict is Verdict.FAIL and driven.verdict_words.startswith("Unstable under modulation")
    passing = tuple(one for one in driven.requirements if one.verdict is Verdict.PASS)
    assert verdict_of(passing, True) is (Verdict.PASS if any(one.hard for one in passing) else Verdict.NOT_EVALUATED)
    assert verdict_of(passing, False) is Verdict.FAIL
    assert verdict_of(passing, None) is Verdict.NOT_EVALUATED


def test_a_point_comes_with_the_lines_and_the_map_that_are_known_already(study):
    whole = study.preview({})
    faster = {"speed": 1.05 * whole.speed}
    assert study.knows_sweep({}) and study.knows_sweep(faster)
    again = study.point(faster)
    assert again.speed > whole.speed and again.tracks is whole.tracks and again.map is whole.map  # neither follows it
    payload = next(one for one in whole.values if one.name == "payload")
    heavier = {"payload": 0.5 * (payload.value + payload.high)}
    assert not study.knows_sweep(heavier)
    assert study.point(heavier).tracks is None and study.point(heavier).modes is not None
    with pytest.raises(ValueError, match="no slider"):
        study.knows_sweep({"mass": 1.0})


def test_a_twin_answers_the_same_and_keeps_its_own_notes(study):
    study.preview({})
    twin = study.twin()
    assert twin.knows_sweep({})  # it need not be computed again
    law = next(one for one in study.quantities() if one.group == "law")
    values = {law.name: 0.5 * (law.value + law.high)}
    mine, its = study.preview(values), twin.preview(values)
    assert mine.modes is not its.modes
    np.testing.assert_array_equal(mine.modes.s, its.modes.s)
    np.testing.assert_array_equal(mine.map.growth, its.map.growth)
    fresh = {law.name: 0.5 * (law.value + law.low)}
    twin.preview(fresh)
    assert twin.knows_sweep(fresh) and not study.knows_sweep(fresh)


def test_a_point_cannot_meet_what_is_asked_over_a_sweep_but_can_miss_it():
    scenario = load("scenarios/paper/heave_surge.toml")
    swept = [one.name for one in scenario.judged if one.over != "nominal" and one.quantity == "growth_rate"]
    assert swept  # stable where it was designed, growing below 201 km/h
    live = LiveStudy(scenario, "bare")
    fine = live.settle(live.point({}))
    assert fine.modes is not None and fine.modes.stable
    told = {one.name: one for one in fine.requirements}
    assert all(
        told[name].verdict is Verdict.NOT_EVALUATED and "met at this point" in told[name].reason for name in swept
    )
    assert fine.verdict is not Verdict.PASS and "only judged in the report" in fine.verdict_words
    slow = live.settle(live.point({"speed": 20.0}))
    assert {one.name: one.verdict for one in slow.requirements}[swept[0]] is Verdict.FAIL
    assert slow.verdict is Verdict.FAIL


def test_a_mode_that_only_grows_counts_as_undamped_in_the_comparison():
    found = compare_options(load("scenarios/design/ems_hover.toml"), {})
    for growth, damping, verdict in zip(found.growth, found.least_damping, found.verdicts, strict=True):
        assert (damping <= 0.0) == (growth > 0.0)
        assert growth <= 0.0 or verdict is Verdict.FAIL
    assert np.min(found.least_damping) == -1.0
