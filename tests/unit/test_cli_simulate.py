"""`maglev-ctrl simulate` and what it writes: exit status, refusals that leave nothing, files that say one thing."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from ride_scenario import BARE, ONE_MASS, read

from maglev_ctrl.cli import main
from maglev_ctrl.errors import Agreement
from maglev_ctrl.report.simulation.folder import json_text, simulation_model, verdict_words, write_simulation
from maglev_ctrl.study.nonlinear import compared, survey

FILES = ["simulation.html", "simulation.json", "simulation.pdf", "trajectory.nc"]


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    """A short run of the mass on its winding, through the whole survey."""
    scenario = read(tmp_path_factory.mktemp("study"), ONE_MASS)
    request = scenario.simulation.model_copy(update={"duration": 0.6, "settle": 0.0})
    told = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(compared, "DECAYS", 2.0)
        made = survey.survey_simulation(
            scenario, scenario.options[0], request, everything=False, progress=lambda what, share: told.append(share)
        )
    assert told == sorted(told) and told[0] >= 0.0 and told[-1] < 1.0
    return made


@pytest.fixture
def prepared(tmp_path, monkeypatch, study):
    """A scenario file in a folder of its own; the survey is stood in for by the one made already."""
    monkeypatch.chdir(tmp_path)
    asked = []

    def stand_in(scenario, option, request, **how):
        asked.append((option.name, request, how))
        return study

    monkeypatch.setattr(survey, "survey_simulation", stand_in)
    (tmp_path / "one.toml").write_text(ONE_MASS, encoding="utf-8")
    (tmp_path / "two.toml").write_text(ONE_MASS + BARE, encoding="utf-8")
    return asked


def untouched(folder=Path()):
    return sorted(one.name for one in folder.iterdir()) == ["one.toml", "two.toml"]


def agreed(study):
    """The study with every comparison agreed: what a passing one looks like."""
    rows = tuple(replace(one, agreement=Agreement.AGREED, reason="") for one in study.study.compared)
    return replace(study, study=replace(study.study, compared=rows))


def test_files_are_written_and_told(prepared, study, monkeypatch, capsys):
    monkeypatch.setattr(survey, "survey_simulation", lambda *given, **how: agreed(study))
    assert main(["simulate", "one.toml"]) == 0
    folder = Path("out/one/simulate_winding")
    assert sorted(one.name for one in folder.iterdir()) == FILES
    out = capsys.readouterr().out
    assert "confirmed by the nonlinear vehicle" in out and out.count("written: ") == 4
    assert (folder / "simulation.pdf").read_bytes().startswith(b"%PDF")
    page = (folder / "simulation.html").read_text(encoding="utf-8")
    assert verdict_words(agreed(study)) in page and "PASS" in page
    data = json.loads((folder / "simulation.json").read_text(encoding="utf-8"), parse_constant=pytest.fail)
    assert data["verdict"] == "PASS" and data["option"] == "winding" and data["study"]["runs"] == 2


def test_contact_and_disagreement_end_with_one(prepared, study, monkeypatch, capsys):
    rows = (replace(study.study.compared[0], agreement=Agreement.UNRESOLVED, reason="they differ"),)
    differs = replace(study, study=replace(study.study, compared=rows))
    monkeypatch.setattr(survey, "survey_simulation", lambda *given, **how: differs)
    assert main(["simulate", "one.toml", "--out", "here"]) == 1
    out = capsys.readouterr().out
    assert "Not agreed with the linear theory" in out and "they differ" in out
    touched = replace(agreed(study), study=replace(study.study, events=(event(),)))
    monkeypatch.setattr(survey, "survey_simulation", lambda *given, **how: touched)
    assert main(["simulate", "one.toml", "--out", "here"]) == 1
    out = capsys.readouterr().out
    assert "run 2, 1.25 s: contact of magnet_1 at 0.3 m/s" in out and "1 of 2 runs ended early" in out
    assert json.loads(Path("here/simulation.json").read_text(encoding="utf-8"))["verdict"] == "FAIL"


def event():
    from maglev_ctrl.study.nonlinear.records import SimulatedEvent

    return SimulatedEvent(1, 1.25, "contact", "magnet_1", 0.3, "the height of magnet_1 fell to 20 mm")


def test_what_was_asked_arrives_in_si(prepared):
    line = ["simulate", "two.toml", "--option", "bare", "--duration", "500 ms", "--runs", "3", "--seed", "7"]
    main([*line, "--speed", "36 km/h", "--sampling-period", "2 ms", "--runs-only", "--jobs", "1"])
    ((name, request, how),) = prepared
    assert name == "bare" and (request.duration, request.runs, request.seed) == (0.5, 3, 7)
    assert request.sampling_period == 0.002 and request.settle == pytest.approx(0.1)  # a fifth of the new duration
    assert how["speed"] == pytest.approx(10.0) and how["everything"] is False and how["jobs"] == 1
    assert Path("out/two/simulate_bare").is_dir()


@pytest.mark.parametrize(
    ("line", "words"),
    [
        (["two.toml"], "--option: the scenario has several options; choose one of winding, bare"),
        (["two.toml", "--option", "windin"], 'no option is called "windin"; did you mean "winding"'),
        (["one.toml", "--duration", "5 m"], 'for example "2 ms", got a length: "5 m"'),
        (["one.toml", "--duration", "5"], "--duration: expected"),
        (["one.toml", "--duration", "0 s"], "--duration: expected"),
        (["one.toml", "--sampling-period", "2 Hz"], "--sampling-period: expected"),
        (["one.toml", "--speed", "0 km/h"], '--speed: expected a speed above zero, got "0 km/h"'),
        (["one.toml", "--speed", "fast"], "--speed: expected"),
        (["one.toml", "--runs", "1"], "--runs"),
        (["one.toml", "--seed", "-1"], "--seed"),
        (["none.toml"], "none.toml"),
        (["one.toml", "--out", "two.toml"], "two.toml: expected a folder for the simulation, got a file"),
    ],
)
def test_bad_input_ends_with_two_and_leaves_nothing(prepared, capsys, line, words):
    assert main(["simulate", *line]) == 2
    said = " ".join(capsys.readouterr().err.split())
    assert words in said and "Traceback" not in said
    assert prepared == [] and untouched()


def test_a_study_that_cannot_be_leaves_nothing(prepared, monkeypatch, capsys):
    from maglev_ctrl.errors import ModelError

    def fails(*given, **how):
        raise ModelError("there is no equilibrium")

    monkeypatch.setattr(survey, "survey_simulation", fails)
    assert main(["simulate", "one.toml"]) == 2
    assert "there is no equilibrium" in capsys.readouterr().err and untouched()


def test_the_page_has_the_verdict_and_every_number_compared(study):
    model = simulation_model(study)
    assert model.sections[0].verdict is study.verdict
    assert model.sections[0].blocks[0].verdict is study.verdict
    assert model.sections[0].blocks[0].text == verdict_words(study)
    told = repr(model)
    assert all(one.name in told for one in study.study.compared)
    assert repr(study.scenario_text)[1:-1] in told  # the file stands on the page whole


def test_json_has_no_token_that_json_does_not_know(study):
    nothing = replace(study.study.compared[0], nonlinear=math.nan, low=-math.inf, high=math.inf, reason="no value")
    text = json_text(replace(study, study=replace(study.study, compared=(nothing,), events=(event(),))))
    data = json.loads(text, parse_constant=pytest.fail)
    (row,) = data["study"]["compared"]
    assert row["nonlinear"] != row["linear"] and row["name"] == nothing.name
    assert data["verdict"] == "FAIL" and data["study"]["events"][0]["element"] == "magnet_1"


def test_the_signals_of_every_run_are_in_the_file(study, tmp_path):
    xarray = pytest.importorskip("xarray")
    paths = write_simulation(study, tmp_path / "out")
    assert sorted(one.name for one in paths) == FILES
    with xarray.open_dataset(tmp_path / "out" / "trajectory.nc", engine="scipy") as data:
        assert set(data.sizes) == {"run", "time"} and data.sizes["run"] == 2
        names = {data[key].attrs.get("signal") for key in data}
        assert set(study.trajectory.signals) <= names
        kept = np.asarray(data["magnet_1_height"])
        assert np.array_equal(kept, study.trajectory.signals["magnet_1.height"])
        assert data.attrs["option"] == "winding" and len(data.data_vars) == len(study.trajectory.signals) + 1


def test_json_is_the_summary(prepared, study, monkeypatch, capsys):
    monkeypatch.setattr(survey, "survey_simulation", lambda *given, **how: agreed(study))
    assert main(["simulate", "one.toml", "--json"]) == 0
    found = json.loads(capsys.readouterr().out, parse_constant=pytest.fail)
    assert found["verb"] == "simulate" and found["status"] == 0 and found["verdict"] == "PASS"
    assert found["option"] == "winding" and len(found["written"]) == 4
