"""One candidate judged: the figures are those of the full study, the stages order candidates, nothing is hidden."""

from pathlib import Path

import numpy as np
import pytest

from maglev_ctrl.analysis.girder.contacts import element_places
from maglev_ctrl.analysis.girder.estimate import passing_estimate
from maglev_ctrl.analysis.girder.passing import passing_response
from maglev_ctrl.analysis.loops import Loop
from maglev_ctrl.analysis.margin_estimates import margin_estimates
from maglev_ctrl.analysis.margins import loop_margins
from maglev_ctrl.analysis.modes import modes
from maglev_ctrl.scenario import load
from maglev_ctrl.scenario.reader import with_values
from maglev_ctrl.scenario.tunes import tuned_quantities
from maglev_ctrl.study.design.make import make_law
from maglev_ctrl.study.loops import option_loops
from maglev_ctrl.study.passing import girder_shape
from maglev_ctrl.study.ride import ride_at
from maglev_ctrl.study.situation import OptionModel, Situation
from maglev_ctrl.study.tuning.evaluate import FAILED, RESERVE, STABLE, Judge, judged_after, judged_in_loop, violation
from maglev_ctrl.study.tuning.figures import relative_violation, ride_figures, worst_of
from maglev_ctrl.study.tuning.law import quick_law
from maglev_ctrl.study.tuning.operating_set import operating_set

FOUR = Path("scenarios/compare/four_options.toml")
EDS = load("scenarios/compare/eds_135t.toml")


@pytest.fixture(scope="module")
def smooth(tmp_path_factory):
    """The four options on a guideway without girders: the exact passage of a girder takes seconds."""
    text = "".join(line for line in FOUR.read_text().splitlines(keepends=True) if not line.startswith("girder"))
    path = tmp_path_factory.mktemp("tuning") / "smooth.toml"
    path.write_text(text)
    return load(path)


def judge_of(scenario, name):
    option = next(one for one in scenario.options if one.name == name)
    return Judge(scenario, option, tuned_quantities(scenario, option))


def start(judge):
    return [one.start for one in judge.tuned]


def requirement(scenario, name):
    return next(one for one in scenario.judged if one.name == name)


@pytest.mark.parametrize("name", ["passive_primary", "active_secondary"])
def test_the_figures_are_those_of_the_full_study(smooth, name):
    judge = judge_of(smooth, name)
    found = judge(start(judge), everywhere=True)
    model = OptionModel(smooth, judge.option)
    law = make_law(smooth, judge.option, model)
    controller = None if law is None else law.design.controller
    rides, ratios, disks = [], [], []
    for place in operating_set(smooth):
        rides.append(ride_figures(ride_at(model, controller, place.situation, quick=True)))
        closed = model.closed_of(model.vehicle(place.situation.payload), place.situation, controller)
        known = modes(closed)
        ratios.append(np.min(known.damping_ratio[known.s.imag > known.error_bound]))
        if not place.inner:
            loops = option_loops(model, place.situation, controller)
            margins = loop_margins(loops.loop())
            disks.append(min(margins.multi_loop.alpha, *(one.disk.alpha for one in margins.channels)))
    values = dict(zip([one.name for one in judge.requirements], found.values, strict=True))
    spread = [one for one, place in zip(ratios, operating_set(smooth), strict=True) if "speed" in place.scopes]
    swept = [ride for ride, place in zip(rides, operating_set(smooth), strict=True) if "speed" in place.scopes]
    for objective, figure in zip(
        found.objectives, ("weighted_acceleration", "gap_used", "supplied_power"), strict=True
    ):
        assert objective == pytest.approx(worst_of(rides, figure), rel=1e-9, abs=1e-9)
    assert values["stroke"] == pytest.approx(worst_of(swept, "stroke_used"), rel=1e-9)
    assert values["damping"] == pytest.approx(min(spread), rel=1e-9)
    assert values["disk_margin"] == pytest.approx(min(disks), rel=0.02)
    assert max(r["weighted_acceleration"] for r in rides) > 1.01 * rides[0]["weighted_acceleration"]  # not the design's


@pytest.mark.parametrize("name", ["active_primary_lqr", "active_primary_lqg", "damper_windings", "combined"])
def test_estimated_margins_against_proved_ones(name):
    option = next(one for one in EDS.options if one.name == name)
    model, controller = quick_law(EDS, option, OptionModel(EDS, option))
    point = Situation.of_design(EDS)
    loop = option_loops(model, point, controller).loop()
    poles = np.linalg.eigvals(model.closed_of(model.vehicle(), point, controller).state_matrix())
    found, exact = margin_estimates(loop, poles), loop_margins(loop)
    gains = [abs(v.decibel) for c in exact.channels for v in (c.gain_reduction, c.gain_increase)]
    assert found.disk == pytest.approx(
        min(exact.multi_loop.alpha, *(c.disk.alpha for c in exact.channels)), rel=0.01
    )  # fmt: skip
    assert np.degrees(found.phase) == pytest.approx(min(c.phase.value for c in exact.channels), rel=0.02)
    assert found.delay == pytest.approx(min(c.delay.value for c in exact.channels), rel=0.02)
    assert found.sensitivity_peak == pytest.approx(max(c.sensitivity_peak for c in exact.channels), rel=0.01)
    if min(gains) < 30.0:
        assert found.gain == pytest.approx(min(gains), rel=0.02)
    flipped = Loop(loop.A, -loop.B, loop.C, -loop.D, loop.channels, delays=loop.delays)  # the mutant: positive feedback
    assert margin_estimates(flipped, poles).disk != pytest.approx(found.disk, rel=0.05)


def test_margins_of_what_is_not_stable_mean_nothing():
    option = next(one for one in EDS.options if one.name == "damper_windings")
    model = OptionModel(EDS, option)
    loop = option_loops(model, Situation.of_design(EDS), None).loop()
    with pytest.raises(ValueError, match="unstable"):
        margin_estimates(loop, np.array([0.1 + 1j]))


@pytest.mark.parametrize("name", ["active_primary_lqr", "active_primary_lqg", "active_secondary_skyhook"])
def test_the_quick_law_is_the_law_of_the_study(name):
    option = next(one for one in EDS.options if one.name == name)
    model = OptionModel(EDS, option)
    _, quick = quick_law(EDS, option, model)
    proved = make_law(EDS, option, model).design.controller
    assert (quick.measured, quick.commands) == (proved.measured, proved.commands)
    for key in "ABCD":
        one, other = getattr(quick, key), getattr(proved, key)
        assert np.allclose(one, other, rtol=1e-6, atol=1e-7 * np.max(np.abs(other), initial=0.0))


def test_the_short_series_of_girders():
    scenario = load(FOUR)
    option = next(one for one in scenario.options if one.name == "passive_secondary")
    model, point = OptionModel(scenario, option), Situation.of_design(scenario)
    closed, vehicle, shape = model.plant(point), model.vehicle(), girder_shape(model)
    outputs = ("front_magnet_1.gap", "secondary_front.stroke")
    places = element_places(vehicle)
    quick = passing_estimate(closed, shape, speed=point.speed, places=places, outputs=outputs)
    exact = passing_response(closed, shape, speed=point.speed, places=element_places(vehicle), outputs=outputs)
    for value, name in zip(quick.tolist(), outputs, strict=True):
        assert exact.of(name).peak <= value == pytest.approx(exact.of(name).peak, rel=5e-3)  # never on the unsafe side
    slower = passing_estimate(closed, shape, speed=0.5 * point.speed, places=places, outputs=outputs)
    assert slower[0] != pytest.approx(quick[0], rel=0.015)


def test_candidates_are_ordered_by_how_far_they_get(smooth):
    """Meets all < misses a little < far out (stages skipped) < not stable < no model at all."""
    judge = judge_of(smooth, "active_secondary")
    sky, ground, bandwidth = 300e3, 20e3, 100.0
    good = judge((sky, ground, bandwidth))
    little = judge((900e3, ground, bandwidth))  # the actuator's limit
    unstable = judge((11e3, 110e3, bandwidth))  # ground-hook without sky-hook drives the car
    broken = judge((sky, ground, float("nan")))
    assert good.total == 0.0 and good.complete and good.binding == ""
    assert 0.0 < little.total < 10.0 and little.complete and little.binding == "force_used"
    assert unstable.total > 10.0 and not unstable.complete and unstable.binding == "stable"
    assert np.all(np.isnan(unstable.objectives))
    assert broken.total == FAILED and broken.fault
    assert good.total < little.total < unstable.total < broken.total


def test_what_is_missed_by_most_binds(smooth):
    judge = judge_of(smooth, "passive_primary")
    weak = judge((20e3, 0.05))
    beyond = dict(zip([one.name for one in judge.requirements], weak.violations, strict=True))
    assert weak.binding == max((n for n in beyond if beyond[n] == beyond[n]), key=lambda n: beyond[n])
    assert beyond["damping"] > 0.3 and weak.worst == beyond[weak.binding]


def test_places_left_out_change_nothing_that_is_kept(smooth):
    """After a few candidates only the places that were worst are looked at: fewer, and the same worst values."""
    judge = judge_of(smooth, "passive_secondary")
    for damping in (3e4, 8e4, 2e5, 5e5):
        judge((damping,))
    watched = judge._watched["ride"]
    assert 0 in watched.places(everywhere=False)
    assert len(watched.places(everywhere=False)) < len(watched.every) == len(operating_set(smooth))
    few, all_places = judge((1.3e5,)), judge((1.3e5,), everywhere=True)
    assert np.allclose(few.objectives, all_places.objectives, rtol=1e-12)
    blind = judge_of(smooth, "passive_secondary")
    blind._watched["ride"].seen = 99  # the mutant: nothing but the design point was ever looked at
    assert blind((1.3e5,)).objectives[0] < 0.99 * all_places.objectives[0]


def test_what_the_loop_judges_and_what_it_leaves(smooth):
    inside = {one.name for one in judged_in_loop(smooth)}
    assert {"stable", "damping", "gap_used", "force_used", "gain_margin"} <= inside
    assert "supply" not in inside  # a wish
    assert judged_after(smooth) == ()
    more = with_values(smooth, {("packs",): ["gap", "robust"]})
    assert judged_after(more) == ("robust_factor",)


def test_reserve_and_relative_violation(smooth):
    damping = requirement(smooth, "damping")  # at least 0.05
    assert violation(damping, 0.05 * (1.0 + 1.01 * RESERVE)) == 0.0
    assert violation(damping, 0.05) > 0.0  # met, but not with the reserve
    assert violation(damping, 0.05, factor=0.8) == 0.0
    assert violation(requirement(smooth, "stable"), 0.3) == pytest.approx(0.3)
    assert violation(damping, float("nan")) == 1.0
    contact = requirement(smooth, "contact_probability")  # at most 1e-6
    assert violation(contact, 1e-6) == 0.0 and violation(contact, 1e-3) == pytest.approx(0.5)
    assert relative_violation(2.0, 1.0, "at_most") == 1.0 and relative_violation(0.5, 1.0, "at_most") == 0.0


def test_the_operating_set():
    names = [place.name for place in operating_set(EDS)]
    assert names[:5] == ["design point", "speed 100 km/h", "speed 600 km/h", "payload 0 t", "payload 30 t"]
    assert sum(place.inner for place in operating_set(EDS)) == 5 and not any("height" in name for name in names)
    tall = with_values(EDS, {("requirement", 1, "over"): "height"})
    assert "height 120 mm" in [place.name for place in operating_set(tall)]


def test_an_unstable_option_without_variables():
    tuned = load("scenarios/compare/four_options.toml")
    bare = with_values(tuned, {("option", 3, "spring_damper", 0, "damping"): "1 N*s/m", ("vehicle", "secondary",
                               "damping"): "0 kN*s/m"})  # fmt: skip
    judge = Judge(bare, bare.options[3], ())
    found = judge((), everywhere=True)
    assert found.binding == "stable" and found.worst > 0.0 and found.binding != STABLE
