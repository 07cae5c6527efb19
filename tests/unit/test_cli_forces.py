"""maglev-ctrl forces: from a scenario's geometry to the page, the arrays and the table, for every kind of forces."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray

from maglev_ctrl import cli
from maglev_ctrl.report.charts_forces import charts
from maglev_ctrl.report.force_survey import csv_text, damping_words, to_dataset
from maglev_ctrl.scenario import load
from maglev_ctrl.scenario.force_table import read_force_table
from maglev_ctrl.study import run
from maglev_ctrl.study.force_cache import FOLDER
from maglev_ctrl.study.force_survey import ForceSurvey, survey

ROOT = Path(__file__).resolve().parents[2]
TEXT = """
format = 1
title = "Double L over aluminium"
assumptions = ["the legs are 6.35 mm thick"]
[vehicle]
model = "double_l"
half_gauge = "88.9 mm"
magnet_depth = "91.4 mm"
[vehicle.car]
mass = "0.84 kg"
roll_inertia = "5.6e-3 kg*m^2"
[forces]
model = "eddy_current"
height_range = { from = "12 mm", to = "13.4 mm" }
gap_range = { from = "12 mm", to = "13.4 mm" }
velocity_range = { from = "15 m/s", to = "38 m/s" }
[forces.guideway]
shape = "l_shape"
leg = "76.2 mm"
thickness = "6.35 mm"
conductivity = "2.5e7 S/m"
[[forces.coil]]
length = "50.8 mm"
width = "25.4 mm"
current = "6000 A"
lateral = "12.7 mm"
height = "3.175 mm"
[operating]
speed = "36.1 m/s"
height = "12.7 mm"
gap = "12.7 mm"
[[option]]
name = "bare"
kind = "baseline"
"""


@pytest.fixture(scope="module", autouse=True)
def kept(tmp_path_factory: pytest.TempPathFactory):
    """A cache of its own, filled by the first test that needs it."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(FOLDER, str(tmp_path_factory.mktemp("cache")))
        yield


@pytest.fixture(scope="module")
def scenario_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("case") / "corner.toml"
    file.write_text(TEXT, encoding="utf-8")
    return file


@pytest.fixture(scope="module")
def found(scenario_file: Path, kept: None) -> ForceSurvey:
    return survey(load(scenario_file))


def test_forces_are_those_of_the_reference_solution(found: ForceSurvey) -> None:
    """4.142, 1.281, 1.844 N by an independent program, good to 0.05 %; a draft is good to 0.2 %."""
    assert float(found.forces.lift) == pytest.approx(4.142, rel=2.5e-3)
    assert float(found.forces.guidance) == pytest.approx(1.281, rel=2.5e-3)
    assert float(found.forces.drag) == pytest.approx(1.844, rel=2.5e-3)
    assert float(found.partials.by_height.lift) == pytest.approx(-546.1, rel=5e-3)
    assert float(found.partials.by_gap.guidance) == pytest.approx(-148.7, rel=5e-3)
    assert float(found.partials.by_gap.lift) == pytest.approx(float(found.partials.by_height.guidance), abs=1e-9)


def test_drag_peak_and_damping(found: ForceSurvey) -> None:
    """The peak lies at 18 to 19 m/s; heave is damped by about 0.1 N s/m, surge fed by 0.019."""
    assert found.drag_peak is not None and 18.0 < found.drag_peak < 19.0
    slope = np.interp(found.drag_peak, found.over_speed.values, found.over_speed.slopes.by_speed.drag)
    assert abs(slope) < 1e-3
    assert found.heave_damping == pytest.approx(-0.10, abs=0.01)
    assert found.heave_changes == ()
    damping = found.damping_over_speed
    assert damping is not None
    assert float(np.interp(36.1, damping.along, damping.surge)) == pytest.approx(0.019, abs=0.001)
    assert "positive" in damping_words(found)
    assert "negative" in damping_words(replace(found, heave_damping=0.1))  # the mutant


def test_the_stated_error_covers_the_difference(found: ForceSurvey) -> None:
    assert found.error is not None and 0.0 < found.error < 5e-3
    assert found.quality is not None and found.quality.stiffness < 1e-2


def test_every_figure_has_finite_numbers(found: ForceSurvey) -> None:
    drawn = charts(found)
    assert {chart.key for chart in drawn} == {
        "section", "over-height", "over-gap", "over-speed", "stiffness", "damping", "torque", "map-lift", "map-guidance"
    }  # fmt: skip
    assert all(chart.caption and chart.alt for chart in drawn)


def test_the_dataset_carries_units_and_residuals(found: ForceSurvey) -> None:
    data = to_dataset(found)
    assert all("units" in data[name].attrs for name in (*data.data_vars, *data.coords))
    assert data["lift"].dims == ("height", "gap", "speed")
    assert data.attrs["error_estimate_relative"] == found.error
    assert {"c_ll_over_speed", "c_gg_over_height", "roll_torque_over_speed", "k_lg"} <= set(data.data_vars)


def test_the_table_can_be_read_as_a_force_table(found: ForceSurvey) -> None:
    samples = read_force_table(csv_text(found).encode(), shown="forces.csv")
    assert samples.gap is not None and samples.guidance is not None
    at = (samples.height == 0.0127) & (np.abs(samples.gap - 0.0127) < 1e-9)
    assert at.any()
    np.testing.assert_allclose(np.interp(36.1, samples.speed[at], samples.lift[at]), found.forces.lift, rtol=2e-3)


def test_the_verb_writes_whole_folders(
    scenario_file: Path, found: ForceSurvey, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert cli.main(["forces", str(scenario_file), "--out", str(out), "--jobs", "1"]) == 0
    said = capfd.readouterr()
    for words in ("drag peak", "18.", "vertical damping", "none in range", "error of the forces", "6.35 mm thick"):
        assert words in said.out
    assert "%" in said.err
    assert {file.name for file in out.iterdir()} == {"forces.html", "forces.nc", "forces.csv"}
    with xarray.open_dataset(out / "forces.nc", engine="scipy") as data:
        assert float(data["lift"].max()) > 4.0
    page = (out / "forces.html").read_text(encoding="utf-8")
    assert "Vertical damping: positive" in page
    assert page.count("<svg") >= 9
    assert not list(tmp_path.glob(".*"))


def test_a_study_runs_with_solved_forces(scenario_file: Path, found: ForceSurvey) -> None:
    comparison = run(load(scenario_file))
    (option,) = comparison.options
    assert option.failure == ""
    assert option.modes is not None and len(option.modes.s) == 3
    assert any("points held back" in line for line in comparison.forces)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("paper/double_l_corner_image.toml", "not in this model"),
        ("paper/heave_surge.toml", "drag peak"),
        ("compare/warwick_30t.toml", "Vertical damping: negative"),
    ],
)
def test_other_force_models(name: str, words: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["forces", str(ROOT / "scenarios" / name), "--out", str(tmp_path / "out")]) == 0
    assert words in capfd.readouterr().out


def test_the_speed_at_which_heave_damping_turns_negative(tmp_path: Path) -> None:
    """A line current over a thin sheet: damping changes its sign at w = 2 / (mu_0 sigma d) (Davis and Wilkie 1971)."""
    text = (ROOT / "scenarios/compare/warwick_30t.toml").read_text(encoding="utf-8")
    for exponent, sheet in ((1.0, '"20 mm"'), (2.0, '"10 mm"')):
        file = tmp_path / "slow.toml"
        slower = re.sub(r'speed = \{ from = "[^"]*"', 'speed = { from = "1 m/s"', text)
        assert slower != text
        file.write_text(re.sub(r'(?m)^thickness = "20 mm"', f"thickness = {sheet}", slower), encoding="utf-8")
        found = survey(load(file))
        w = 2.0 / (4e-7 * np.pi * 2.5e7 * 0.02) * exponent
        np.testing.assert_allclose(found.heave_changes, [w], rtol=1e-3)


def test_matrices_have_no_forces_to_show(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["forces", str(ROOT / "scenarios/paper/six_dof.toml"), "--out", str(tmp_path / "out")]) == 2
    assert "nothing to draw" in capfd.readouterr().err
    assert not (tmp_path / "out").exists()


def test_an_interrupt_leaves_nothing(scenario_file: Path, tmp_path: Path) -> None:
    env = os.environ | {FOLDER: str(tmp_path / "empty"), "PYTHONUNBUFFERED": "1"}
    process = subprocess.Popen(
        [sys.executable, "-m", "maglev_ctrl", "forces", str(scenario_file), "--out", str(tmp_path / "out")],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=env, start_new_session=True,
    )  # fmt: skip
    assert process.stderr is not None
    first = process.stderr.readline()  # it has begun to solve
    assert "currents" in first
    time.sleep(0.2)
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=20)
    assert process.returncode == 130
    assert "Traceback" not in said
    assert not (tmp_path / "out").exists()
