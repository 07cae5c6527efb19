"""Datasets and tables against the records they come from: values, axes, units, verdicts, and files read back."""

from __future__ import annotations

import comparison_fixture
import map_fixture
import numpy as np
import pytest
import xarray
from test_notebook import car, mathieu, small_map

from maglev_ctrl.analysis.floquet import floquet
from maglev_ctrl.analysis.loops import Loop
from maglev_ctrl.analysis.margins import loop_margins
from maglev_ctrl.analysis.modes import modes
from maglev_ctrl.analysis.simulation.records import Event, Trajectory
from maglev_ctrl.analysis.tracking import track
from maglev_ctrl.report.map.data import ARRAYS
from maglev_ctrl.report.notebook import to_dataset, to_frame


def trajectory() -> Trajectory:
    time = np.linspace(0.0, 1.0, 11)
    signals = {"car.heave": np.vstack([np.sin(time), np.where(time > 0.5, np.nan, time)]),
               "car.heave.velocity": np.vstack([np.cos(time), np.ones(11)])}  # fmt: skip
    event = Event(1, "contact", 0.5, "magnet", 0.1, "magnet_1 touched")
    blank = np.zeros((2, 11))
    return Trajectory(time, signals, (event,), np.array([1.0, 0.5]), {}, blank, blank, 1e-9, 1e-3, 1e-6, 1.0)


def everything() -> dict[str, object]:
    stack = car(stiffness=[np.diag([9.0 + x, 5.0]) for x in np.linspace(0.0, 3.0, 5)])
    found = modes(car())
    return {
        "modes": found, "ledger": found.ledger, "tracks": track(stack, parameter=np.linspace(0.0, 3.0, 5)),
        "margins": loop_margins(Loop.from_transfer_function([25.0], [1.0, 10.0, 10.0, 10.0])),
        "floquet": floquet(mathieu()), "map": small_map(), "plane": map_fixture.plane(count=(24, 12)),
        "ride": comparison_fixture.response(), "trajectory": trajectory(), "comparison": comparison_fixture.small(),
    }  # fmt: skip


@pytest.fixture(scope="module")
def results() -> dict[str, object]:
    return everything()


def test_every_number_has_a_unit_and_words_and_is_written(results, tmp_path):
    for name, result in results.items():
        dataset = to_dataset(result)
        for key, variable in {**dataset.variables}.items():
            numeric = variable.dtype.kind in "fiu"
            assert not numeric or "units" in variable.attrs, (name, key)
            assert not np.iscomplexobj(variable.values), (name, key)
        for dim in dataset.dims:
            assert dim in dataset.coords or dim == "run", (name, dim)
        path = tmp_path / "found.nc"
        dataset.to_netcdf(path, engine="scipy")
        with xarray.open_dataset(path, engine="scipy") as again:
            for key in dataset.data_vars:
                assert again[key].attrs.get("units") == dataset[key].attrs.get("units"), (name, key)
                if dataset[key].dtype.kind == "f":
                    np.testing.assert_array_equal(again[key].values, dataset[key].values, err_msg=f"{name} {key}")


def test_modes_and_ledger_are_the_record(results):
    found = results["modes"]
    dataset = to_dataset(found)
    np.testing.assert_array_equal(dataset.growth_rate + 1j * dataset.angular_frequency, found.s)
    np.testing.assert_array_equal(dataset.shape_real.values + 1j * dataset.shape_imag.values, found.shapes)
    assert dataset.participation.dims == ("coordinate", "mode")
    assert list(dataset.mode.values) == list(found.labels)
    assert dataset.attrs["verdict"] == "stable"
    total = (dataset.damping_share + dataset.circulatory_share).sum("element")
    np.testing.assert_allclose(total, found.s.real, rtol=1e-9)
    flutter = modes(car(stiffness=((9.0, -1.0), (2.0, 5.0))))
    shares = to_dataset(flutter)
    assert shares.attrs["verdict"] == "unstable"
    both = (shares.damping_share + shares.circulatory_share).sum("element")
    np.testing.assert_allclose(both, flutter.s.real, rtol=1e-9)
    wrong = (shares.damping_share - shares.circulatory_share).sum("element")  # a mutant: one share with its sign turned
    assert not np.allclose(wrong, flutter.s.real)


def test_tracks_keep_parameter_and_labels(results):
    found = results["tracks"]
    dataset = to_dataset(found)
    assert dataset.growth_rate.dims == ("parameter", "mode")
    np.testing.assert_array_equal(dataset.sel(parameter=3.0).angular_frequency.values, found.s[-1].imag)


def test_margins_say_what_is_verified(results):
    found = results["margins"]
    dataset = to_dataset(found)
    assert float(dataset.gain_increase.sel(channel="loop")) == found.channels[0].gain_increase.value
    assert int(dataset.phase_verified[0]) == 1 and dataset.phase.attrs["units"] == "deg"
    assert dataset.attrs["verified"] == 1


def test_maps_keep_states_and_names(results):
    found = results["map"]
    dataset = to_dataset(found)
    assert dataset.growth_rate.dims == ("speed", "depth") and dataset.speed.attrs["units"] == "m/s"
    np.testing.assert_array_equal(dataset.unstable.values == 1, found.unstable)
    assert "0: " in dataset.tongue_index.attrs["names"]
    plane = results["plane"]
    as_plane = to_dataset(plane)
    np.testing.assert_array_equal(as_plane.state.values, plane.state)
    assert "unresolved" in as_plane.state.attrs["flag_meanings"]
    assert set(as_plane.data_vars) == {key for key, *_ in ARRAYS}  # as in the file that `map` writes


def test_a_trajectory_is_that_of_the_simulation_file(results):
    dataset = to_dataset(results["trajectory"])
    assert dataset.car_heave.dims == ("run", "time") and np.isnan(dataset.car_heave.values[1, -1])
    assert dataset.attrs["events"] == "magnet_1 touched" and float(dataset.ends[1]) == 0.5


def test_ride_spectra_lie_on_one_axis(results):
    found = results["ride"]
    dataset = to_dataset(found)
    first = found.spectra[0]
    np.testing.assert_array_equal(dataset.density.sel(spectrum=0, frequency=first.frequency).values, first.density)
    assert str(dataset.spectrum_passenger.values[0]) == first.passenger


def test_a_comparison_is_options_by_requirements(results):
    found = results["comparison"]
    dataset, frame = to_dataset(found), to_frame(found)
    for option in found.options:
        for one in option.requirements:
            here = dataset.sel(option=option.name, requirement=one.name)
            assert str(here.verdict.values) == one.verdict.value and float(here.limit) == one.limit
            np.testing.assert_equal(float(here.value), one.value)
            assert frame.loc[(option.name, one.name), "verdict"] == one.verdict.value
            np.testing.assert_equal(frame.loc[(option.name, one.name), "value"], one.value)
    asked = {(o.name, r.name) for o in found.options for r in o.requirements}
    for option in dataset.option.values:
        for name in dataset.requirement.values:
            if (str(option), str(name)) not in asked:
                assert str(dataset.verdict.sel(option=option, requirement=name).values) == "not asked"
    assert dataset.attrs["verdict"] == found.verdict.value
    assert frame["verdict"].unstack().shape == (dataset.sizes["option"], dataset.sizes["requirement"])


def test_tables_carry_units_and_the_numbers(results):
    found = results["modes"]
    frame = to_frame(found)
    np.testing.assert_array_equal(frame["growth rate (1/s)"], found.s.real)
    assert list(frame.index) == list(found.labels) and "frequency (Hz)" in frame.columns
    ledger = to_frame(results["ledger"])
    np.testing.assert_allclose(ledger["sum (1/s)"].groupby("mode").sum(), found.s.real, rtol=1e-9)
    margins = to_frame(results["margins"])
    assert margins.loc["loop", "gain increase (dB)"] == pytest.approx(20.0 * np.log10(3.6), rel=1e-6)
    ride = to_frame(results["ride"])
    assert "total (m/s²)" in ride.columns and len(ride) == len(results["ride"].passengers)


def test_fronts_of_a_tuning_are_in_display_units():
    study = comparison_fixture.tuning()
    frame = to_frame(study)
    option = next(o for o in study.options if len(o.front))
    axis = study.objectives[0]
    column = next(c for c in frame.columns if c.startswith(axis.label))
    np.testing.assert_allclose(frame.loc[option.option, column], option.front[:, 0] * axis.scale)
    assert frame.loc[option.option, "chosen"].sum() == 1
    assert not np.allclose(frame.loc[option.option, column], option.front[:, -1] * study.objectives[-1].scale)  # mutant


def test_what_has_no_numbers_to_give_is_said():
    with pytest.raises(TypeError, match=r"a float has no dataset; there are those of .*Modes"):
        to_dataset(1.0)
    with pytest.raises(TypeError, match=r"a str has no table; there are those of .*TuningStudy"):
        to_frame("modes")
