"""The nonlinear check of an option: seeded runs against exact variances, growth, contact, repeatability."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from ride_scenario import BARE, ONE_MASS, read

from maglev_ctrl.analysis.simulation.measure import Growth
from maglev_ctrl.errors import Agreement, ModelError, Verdict
from maglev_ctrl.study.nonlinear import compared, run
from maglev_ctrl.study.nonlinear.records import SimulationStudy
from maglev_ctrl.study.nonlinear.run import SimulatedOption, nonlinear_study
from maglev_ctrl.study.nonlinear.survey import chosen_option
from maglev_ctrl.study.nonlinear.tracks import in_band, simulated_tracks
from maglev_ctrl.study.ride import ride_at
from maglev_ctrl.study.situation import OptionModel, Situation

AGREED, UNRESOLVED = Agreement.AGREED, Agreement.UNRESOLVED


def model_of(tmp_path, text=ONE_MASS, option=0):
    scenario = read(tmp_path, text)
    return OptionModel(scenario, scenario.options[option])


def rows(study, words):
    return [one for one in study.compared if words in one.name]


@pytest.fixture(scope="module")
def thirty(tmp_path_factory):
    """Thirty seeded runs of the mass on its magnet and winding."""
    model = model_of(tmp_path_factory.mktemp("thirty"))
    request = model.scenario.simulation.model_copy(update={"runs": 30})
    return model, *nonlinear_study(model, None, request, everything=False)


def test_deviations_of_thirty_runs_hold_the_exact_ones_in_their_bands(thirty):
    _, study, found = thirty
    spreads = rows(study, "standard deviation")
    assert [one.name for one in spreads] == [
        "standard deviation: acceleration of car", "standard deviation: height of magnet_1",
    ]  # fmt: skip
    for one in spreads:
        assert one.agreement is AGREED and one.reason == ""
        assert one.low < one.nonlinear < one.high and one.low <= one.linear <= one.high
        assert one.high - one.low < 0.3 * one.nonlinear  # a band that says something
    assert study.events == () and study.runs == 30 and found.signals["magnet_1.height"].shape[0] == 30
    assert study.step_error < 1e-3 and study.speed == pytest.approx(300.0 / 3.6)


def test_another_amplitude_is_told_apart(thirty):
    """A guideway 1.5 times as rough as the one that was simulated: its deviations are outside the same bands."""
    model, study, found = thirty
    rough = model.scenario.irregularity
    wrong = rough.model_copy(update={"vertical": rough.vertical.model_copy(update={"amplitude": 1.5**2 * 1.5e-6})})
    other = replace(model, scenario=model.scenario.model_copy(update={"irregularity": wrong}))
    one = SimulatedOption.of(other, None, model.scenario.simulation)
    tracks = simulated_tracks(other, one.vehicle, speed=study.speed, duration=found.time[-1], runs=2, seed=1)
    told = compared.compared_spreads(one, found, tracks, discard=1.0)
    assert len(told) == 2
    for row in told:
        assert row.linear == pytest.approx(1.5 * rows(study, row.name)[0].linear, rel=1e-9)
        assert row.agreement is UNRESOLVED and "scatter" in row.reason and not row.low <= row.linear <= row.high


def test_the_linear_deviation_is_that_of_the_band_the_guideway_holds(thirty):
    model, study, found = thirty
    vehicle = model.vehicle()
    tracks = simulated_tracks(model, vehicle, speed=study.speed, duration=float(found.time[-1]), runs=2, seed=1)
    assert tracks.band == pytest.approx((0.5, 10.0)) and len(tracks.tracks) == 2
    here = Situation.of_design(model.scenario)
    inside = ride_at(in_band(model, tracks.band), None, here).clearances[0].deviation
    narrow = ride_at(in_band(model, (1.0, 10.0)), None, here).clearances[0].deviation
    told = rows(study, "height of")[0]
    assert told.linear == pytest.approx(inside, rel=1e-9) and narrow < 0.98 * inside
    # the guideway starts where the vehicle stands
    assert [abs(float(np.asarray(track.under(0.0, 0.0)[0]))) < 1e-12 for track in tracks.tracks] == [True, True]


def test_growth_of_small_motions_is_the_linear_one(thirty):
    _, study, _ = thirty
    (growth,) = rows(study, "growth rate")
    # m g / z0 = 98 kN/m per 10 t under 80 kN s/m: s = -4 +- j 9.06 but for the magnets' own small damping
    assert growth.linear == pytest.approx(-4.0, abs=5e-3)
    assert growth.nonlinear == pytest.approx(growth.linear, rel=1e-3) and growth.agreement is AGREED
    assert "1.44 Hz" in growth.name and growth.high - growth.low < 1e-2
    assert math.sqrt(9.80665 / 0.1 - 16.0) / (2.0 * math.pi) == pytest.approx(1.44, abs=0.01)


def test_a_rate_known_badly_confirms_nothing():
    table = np.array([[-1.0, 4.5]])
    good = Growth(rate=-1.0, frequency=4.5, spread=1e-4, residual=1e-5, window=3.0, modes=table)
    near = complex(-1.0, 4.5)

    def doubt(found):
        return compared._growth_doubt(found, near, near, compared._allowed(found, abs(near)), 0.02)

    assert doubt(good) == ""
    assert "are left over" in doubt(replace(good, residual=0.1))
    assert "grows at" in doubt(replace(good, rate=-0.6, spread=0.5))  # a wide scatter excuses no such difference
    assert "grows at" in doubt(replace(good, rate=-0.9, spread=math.nan))


@pytest.fixture
def brief(monkeypatch):
    """A short look at small motions, where they are not what a test is about."""
    monkeypatch.setattr(compared, "CYCLES", 4.0)
    monkeypatch.setattr(compared, "DECAYS", 2.0)


@pytest.fixture
def no_growth(monkeypatch):
    """The growth of small motions as known already, where a test is about the runs alone."""
    known = compared.row(
        "growth rate of small motions", "1/s", linear=-4.0, nonlinear=-4.0, band=(-4.0, -4.0), reason=""
    )
    monkeypatch.setattr(run, "compared_growth", lambda one: (known, -4.0))


def test_runs_repeat_bit_for_bit_and_seeds_differ(tmp_path, no_growth):
    model = model_of(tmp_path)
    request = model.scenario.simulation.model_copy(update={"duration": 0.25, "settle": 0.0})
    first, second = (nonlinear_study(model, None, request, everything=False)[1] for _ in range(2))
    other = nonlinear_study(model, None, request.model_copy(update={"seed": 2}), everything=False)[1]
    for name, values in first.signals.items():
        assert np.array_equal(values, second.signals[name], equal_nan=True), name
    assert not np.array_equal(first.signals["magnet_1.height"], other.signals["magnet_1.height"])
    # run k of seed s has the guideway of seed s + k
    moved = first.signals["magnet_1.height"][1] - other.signals["magnet_1.height"][0]
    assert np.max(np.abs(moved)) < 1e-6 * np.std(first.signals["magnet_1.height"][1])


def test_contact_is_told_with_time_magnet_and_speed(tmp_path, no_growth):
    """The touching height set half a millimetre under the levitation height: a few millimetres of motion reach it."""
    model = model_of(tmp_path, ONE_MASS.replace('smallest_height = "20 mm"', 'smallest_height = "99.5 mm"'))
    study, found = nonlinear_study(model, None, model.scenario.simulation, everything=False)
    assert len(study.events) == 2
    for event in study.events:
        assert event.kind == "contact" and event.element.startswith("magnet_")
        assert 0.0 < event.time < found.time[-1] and event.value > 0.0
        height = np.asarray(found.signals["magnet_1.height"])[event.run]
        assert np.nanmin(height) >= 0.0995 - 1e-9 and np.isnan(height[-1])  # nothing is computed under the ground
    assert not [one for one in study.compared if "deviation" in one.name]  # of runs cut short there is none
    assert simulated(model, study, found).verdict is Verdict.FAIL


def simulated(model, study, found):
    return SimulationStudy(
        title="One mass", name="small", scenario_hash="0", scenario_text="", option="winding", label="winding",
        summary=(), study=study, trajectory=found, versions=(), created="",
    )  # fmt: skip


def test_verdict_of_a_simulation(thirty):
    model, study, found = thirty
    assert simulated(model, study, found).verdict is Verdict.PASS
    doubt = replace(study.compared[0], agreement=UNRESOLVED, reason="differs")
    assert simulated(model, replace(study, compared=(doubt,)), found).verdict is Verdict.NOT_EVALUATED


def test_an_unstable_vehicle_has_a_growth_and_no_deviations(tmp_path, brief):
    model = model_of(tmp_path, ONE_MASS + BARE, option=1)
    request = model.scenario.simulation.model_copy(update={"duration": 0.8, "settle": 0.0})
    study, found = nonlinear_study(model, None, request, everything=False)
    (growth,) = study.compared
    assert growth.linear > 0.0 and growth.nonlinear == pytest.approx(growth.linear, rel=0.01)
    assert growth.agreement is AGREED and study.attraction == ()
    assert found.time[-1] == pytest.approx(0.8, abs=0.01)  # there is nothing to wait for


def test_without_roughness_runs_start_off_the_equilibrium(tmp_path, no_growth):
    start, end = ONE_MASS.index("[irregularity]"), ONE_MASS.index("[ride]")
    model = model_of(tmp_path, ONE_MASS[:start] + ONE_MASS[end:])
    request = model.scenario.simulation.model_copy(update={"duration": 0.3, "settle": 0.0})
    study, found = nonlinear_study(model, None, request, everything=False)
    heights = np.asarray(found.signals["magnet_1.height"])
    assert "smooth" in study.assumptions[0] and np.all(np.abs(heights[:, 0] - 0.1) > 1e-6)
    assert len(study.compared) == 1
    with pytest.raises(ModelError, match="no irregularity"):
        simulated_tracks(model, model.vehicle(), speed=80.0, duration=1.0, runs=2, seed=1)


def test_everything_is_asked_where_it_is_wanted(tmp_path, brief):
    """Starts of growing size: those that stay above the ground return, and their number is told."""
    model = model_of(tmp_path)
    request = model.scenario.simulation.model_copy(update={"duration": 0.3, "settle": 0.0})
    said = []
    study, _ = nonlinear_study(model, None, request, step=said.append)
    assert [name for name, *_ in study.attraction] == ["car.heave"] * 4
    assert [tried for *_, tried in study.attraction] == [2] * 4
    assert study.attraction[0][2] == 2 and study.attraction[0][1] == pytest.approx(0.1 * 0.08)
    assert "region of attraction" in said and "stability boundaries" in said


def test_the_option_meant(tmp_path):
    two = read(tmp_path, ONE_MASS + BARE)
    assert chosen_option(two, "bare").name == "bare"
    with pytest.raises(ValueError, match="choose one of winding, bare"):
        chosen_option(two, None)
    with pytest.raises(ValueError, match='did you mean "winding"'):
        chosen_option(two, "windin")
    assert chosen_option(read(tmp_path, ONE_MASS), None).name == "winding"
