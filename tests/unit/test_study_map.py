"""Maps of a scenario's options: every point is the loop it says it is, what is finished is kept, nothing is dropped."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from maglev_ctrl.analysis.floquet import floquet
from maglev_ctrl.analysis.floquet_margins import scaled_controller
from maglev_ctrl.analysis.plane_records import NO_ANSWER, UNSTABLE, StabilityPlane
from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.errors import ModelError
from maglev_ctrl.scenario import Scenario, load
from maglev_ctrl.study.forcing import periodic_system
from maglev_ctrl.study.law import design_law, designed_option
from maglev_ctrl.study.map import option as option_module
from maglev_ctrl.study.map.family import OptionFamily
from maglev_ctrl.study.map.option import MERGED, option_map
from maglev_ctrl.study.map.request import MapRequest, map_request
from maglev_ctrl.study.map.run import survey_estimate, survey_map
from maglev_ctrl.study.map.store import FolderStore, MapFolder, map_key
from maglev_ctrl.study.situation import OptionModel, Situation
from maglev_ctrl.systems import at_depth

SmallScenario = Callable[..., Scenario]
SPEEDS, DEPTHS = "speed=60km/h:400km/h:12", "depth=0:0.5:6"


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Only the plane, whose companions have tests of their own."""
    monkeypatch.setattr(option_module, "tongue_table", lambda *a, **k: ())
    monkeypatch.setattr(option_module, "tongue_atlas", lambda *a, **k: None)
    monkeypatch.setattr(option_module, "option_margins", lambda *a, **k: (None, "not asked"))


def plane_of(scenario: Scenario, request: MapRequest, name: str) -> StabilityPlane:
    plane = option_map(scenario, request, name).plane
    assert plane is not None
    return plane


def family_of(scenario: Scenario, request: MapRequest, name: str) -> OptionFamily:
    record = next(option for option in scenario.options if option.name == name)
    model, design = designed_option(scenario, record)
    return OptionFamily.of(model, None if design is None else design.controller, request)


def assert_pixels(family: OptionFamily, plane: StabilityPlane, *, count: int) -> None:
    """Random pixels are those of the family's systems, by the engines that know nothing of maps."""
    generator = np.random.default_rng(7)
    for _ in range(count):
        i, j = (int(generator.integers(size)) for size in plane.state.shape)
        found = floquet(family(float(plane.x.values[i]), float(plane.y.values[j])))
        error = abs(found.growth_rate - plane.growth[i, j])
        assert error <= plane.growth_error[i, j] + 1e-7 * (1.0 + abs(found.growth_rate)), (i, j)
        if found.stable is not None and abs(found.growth_rate) > plane.growth_error[i, j] + 1e-7:
            assert (plane.state[i, j] == UNSTABLE) == (not found.stable), (i, j)


@pytest.mark.usefixtures("quick")
@pytest.mark.parametrize(
    ("name", "x", "y"),
    [
        ("bare", SPEEDS, DEPTHS),
        ("damper", SPEEDS, "option.damper.spring_damper.damper.damping=0:30kN*s/m:5"),
        ("active", SPEEDS, "gain=0.5:2:5"),
        ("damper", "wavelength=10m:30m:7", "payload=0t:3t:4"),
        ("bare", "vehicle.secondary.stiffness=100kN/m:400kN/m:6", "depth=0:0.5:4"),
    ],
)
def test_a_map_is_its_points(small_scenario: SmallScenario, name: str, x: str, y: str) -> None:
    scenario = small_scenario()
    request = map_request(scenario, x=x, y=y, options=[name])
    assert_pixels(family_of(scenario, request, name), plane_of(scenario, request, name), count=6)


def test_the_family_is_the_loop_of_its_values(small_scenario: SmallScenario) -> None:
    """Each value goes where it belongs: the same systems from the scenario changed by hand."""
    scenario = small_scenario()
    model = OptionModel(scenario, scenario.options[2])
    design = design_law(scenario, scenario.options[2], model)
    assert design is not None
    request = map_request(scenario, x="gain=0.5:2:5", y="vehicle.car.mass=8t:12t:5", options=["active"])
    family = OptionFamily.of(model, design.controller, request)
    heavy = small_scenario(scenario.text.replace('mass = "8 t"', 'mass = "10 t"'))
    there = OptionModel(heavy, heavy.options[2])
    vehicle = there.vehicle()
    assert not family.merged  # with more gain the loop may become as fast as its delays
    law = scaled_controller(design.controller, 1.5)  # designed for 8 t
    expected = at_depth(periodic_system(there, vehicle, Situation.of_design(heavy), law), 0.05)
    found = family(1.5, 10e3)
    np.testing.assert_allclose(found.A_0, expected.A_0, rtol=1e-12, atol=1e-9)
    np.testing.assert_allclose(found.A_cos, expected.A_cos, rtol=1e-12, atol=1e-12)
    assert found.frequency == expected.frequency
    anew = design_law(heavy, heavy.options[2], there)
    assert anew is not None
    mutant = periodic_system(there, vehicle, Situation.of_design(heavy), scaled_controller(anew.controller, 1.5))
    assert not np.allclose(found.A_0, mutant.A_0, rtol=1e-6)  # a law designed anew would be told from this one


def test_a_quantity_of_the_law_designs_it_anew(small_scenario: SmallScenario) -> None:
    scenario = small_scenario()
    name = "option.active.control.allowed[2].value"
    request = map_request(scenario, x=SPEEDS, y=f"{name}=1kN:9kN:5")
    assert request.options == ("active",)
    family = family_of(scenario, request, "active")
    stronger = small_scenario(scenario.text.replace('value = "5 kN"', 'value = "9 kN"'))
    other = family_of(stronger, map_request(stronger, x=SPEEDS, y="gain=0.5:2:5", options=["active"]), "active")
    np.testing.assert_allclose(family(80.0, 9e3).A_0, other(80.0, 1.0).A_0, rtol=1e-9, atol=1e-6)
    assert not np.allclose(family(80.0, 9e3).A_0, family(80.0, 5e3).A_0)


def test_depth_reuses_the_system_of_a_speed(small_scenario: SmallScenario, monkeypatch: pytest.MonkeyPatch) -> None:
    from maglev_ctrl.study.map import family as family_module

    scenario = small_scenario()
    family = family_of(scenario, map_request(scenario, x=SPEEDS, y=DEPTHS), "bare")
    calls: list[float] = []

    def counted(model: OptionModel, vehicle: object, situation: Situation, *rest: object) -> object:
        calls.append(situation.speed)
        return periodic_system(model, vehicle, situation, *rest)  # type: ignore[arg-type]

    monkeypatch.setattr(family_module, "periodic_system", counted)
    deep, shallow = family(70.0, 0.4), family(70.0, 0.1)
    assert calls == [70.0]
    np.testing.assert_allclose(deep.A_cos, 4.0 * shallow.A_cos, rtol=1e-14)


def test_without_an_answer_a_point_says_why(small_scenario: SmallScenario) -> None:
    text = small_scenario().text.replace('damping = "30 kN*s/m"', 'damping = "30 kN*s/m"\nlag = "5 ms"')
    scenario = small_scenario(text)
    request = map_request(scenario, x=SPEEDS, y="option.damper.spring_damper.damper.lag=0ms:5ms:3")
    family = family_of(scenario, request, "damper")
    with pytest.raises(ModelError, match=r"the model has 4 states at speed 80 m/s and .*lag 0 s, and 5 at the design"):
        family(80.0, 0.0)
    assert len(family(80.0, 0.005).A_0) == 5


@pytest.mark.usefixtures("quick")
def test_points_without_an_answer_are_counted(small_scenario: SmallScenario) -> None:
    text = small_scenario().text.replace('damping = "30 kN*s/m"', 'damping = "30 kN*s/m"\nlag = "5 ms"')
    scenario = small_scenario(text)
    request = map_request(scenario, x=SPEEDS, y="option.damper.spring_damper.damper.lag=0ms:5ms:3")
    done = option_map(scenario, request, "damper")
    assert done.plane is not None and np.all(done.plane.state[:, 0] == NO_ANSWER)
    assert not np.any(done.plane.state[:, 1:] == NO_ANSWER)
    assert any("33.3 % of the points have no answer: " in note for note in done.notes)


@pytest.mark.usefixtures("quick")
def test_an_option_without_a_map_keeps_its_reason(
    small_scenario: SmallScenario, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*anything: object, **more: object) -> StabilityPlane:
        raise ModelError("no equilibrium")

    monkeypatch.setattr(option_module, "stability_plane", refuse)
    scenario = small_scenario()
    study = survey_map(scenario, map_request(scenario, x=SPEEDS, y=DEPTHS))
    assert {option.failure for option in study.options} == {"no equilibrium"}
    assert [option.plane for option in study.options] == [None, None, None]


class Interrupting(FolderStore):
    """A store that is interrupted after some parts."""

    __slots__ = ("left",)

    def put(self, key: str, arrays: Mapping[str, FloatArray]) -> None:
        left = getattr(self, "left", 2)
        if left == 0:
            raise KeyboardInterrupt
        super().put(key, arrays)
        object.__setattr__(self, "left", left - 1)


@pytest.mark.usefixtures("quick")
def test_an_interrupted_map_goes_on_to_the_same_bytes(small_scenario: SmallScenario, tmp_path: Path) -> None:
    scenario = small_scenario()
    request = map_request(scenario, x="speed=60km/h:400km/h:300", y="depth=0:0.5:200", options=["damper"])
    whole = plane_of(scenario, request, "damper")
    folder = MapFolder.of(tmp_path, scenario, request)
    with pytest.raises(KeyboardInterrupt):
        option_map(scenario, request, "damper", store=Interrupting(folder.root / "damper"))
    kept = sorted(folder.root.rglob("*.npz"))
    assert len(kept) == 2 and not list(folder.root.rglob(".*"))
    times = [file.stat().st_mtime_ns for file in kept]
    resumed = option_map(scenario, request, "damper", store=folder.store("damper")).plane
    assert resumed is not None
    assert [file.stat().st_mtime_ns for file in kept] == times  # read, not computed again
    for name in ("growth", "growth_error", "state", "interpolated", "tongue_index", "checked", "check_difference"):
        assert getattr(resumed, name).tobytes() == getattr(whole, name).tobytes(), name
    again = option_map(scenario, request, "damper", store=folder.store("damper"))
    assert again.plane is not None and again.plane.growth.tobytes() == whole.growth.tobytes()
    folder.remove()
    assert list(tmp_path.iterdir()) == []


@pytest.mark.usefixtures("quick")
def test_damaged_parts_are_computed_again(small_scenario: SmallScenario, tmp_path: Path) -> None:
    scenario = small_scenario()
    request = map_request(scenario, x=SPEEDS, y=DEPTHS, options=["bare"])
    store = FolderStore(tmp_path / "bare")
    whole = option_map(scenario, request, "bare", store=store).plane
    files = sorted((tmp_path / "bare").glob("*.npz"))
    assert whole is not None and files
    files[0].write_bytes(files[0].read_bytes()[:100])
    for file in files[1:]:
        content = bytearray(file.read_bytes())
        content[len(content) // 2] ^= 0xFF
        file.write_bytes(bytes(content))
    again = option_map(scenario, request, "bare", store=store).plane
    assert again is not None and again.growth.tobytes() == whole.growth.tobytes()


def test_the_store_keeps_arrays_whole(tmp_path: Path) -> None:
    store = FolderStore(tmp_path / "part")
    assert store.get("a/b: c") is None and not (tmp_path / "part").exists()
    store.reach(0.5)
    assert not (tmp_path / "part").exists() and store.reached() == 0.0
    store.put("a/b: c", {"x": np.arange(3.0), "y": np.zeros((2, 2))})
    found = store.get("a/b: c")
    assert found is not None and found["x"].tolist() == [0.0, 1.0, 2.0] and found["y"].shape == (2, 2)
    store.reach(0.25)
    assert store.reached() == 0.25
    (tmp_path / "part" / "reached").write_text("nonsense")
    assert store.reached() == 0.0
    (file,) = (tmp_path / "part").glob("*.npz")
    file.write_bytes(b"not an archive")
    assert store.get("a/b: c") is None and not file.exists()


def test_other_maps_have_other_folders(small_scenario: SmallScenario) -> None:
    scenario = small_scenario()
    request = map_request(scenario, x=SPEEDS, y=DEPTHS)
    heavier = small_scenario(scenario.text.replace('mass = "8 t"', 'mass = "9 t"'))
    keys = [
        map_key(scenario, request), map_key(heavier, request),
        map_key(scenario, map_request(scenario, x="speed=60km/h:400km/h:13", y=DEPTHS)),
        map_key(scenario, map_request(scenario, x=SPEEDS, y="depth=0:0.51:6")),
        map_key(scenario, map_request(scenario, x=SPEEDS, y="payload=0t:1t:6")),
        map_key(scenario, replace(request, coverage="every")), map_key(scenario, replace(request, backend="fast")),
    ]  # fmt: skip
    assert len(set(keys)) == len(keys)
    # Which options are asked for does not matter: each has a folder of its own.
    assert map_key(scenario, map_request(scenario, x=SPEEDS, y=DEPTHS, options=["bare"])) == keys[0]


@pytest.mark.slow
def test_processes_map_the_same(small_scenario: SmallScenario, tmp_path: Path) -> None:
    scenario = small_scenario()
    request = map_request(scenario, x=SPEEDS, y=DEPTHS, options=["bare", "damper"], tables=False)
    told: list[float] = []
    study = survey_map(scenario, request, jobs=2, progress=lambda what, done: told.append(done), store_folder=tmp_path)
    assert [option.name for option in study.options] == ["bare", "damper"]
    assert told == sorted(told) and told[-1] == 1.0
    one = plane_of(scenario, request, "damper")
    other = study.options[1].plane
    assert other is not None and other.growth.tobytes() == one.growth.tobytes()
    assert (study.options[1].atlas, study.options[1].margins_reason) == (None, "not asked for")
    assert (study.wavelength, study.depth, study.x.unit, study.y.unit) == (25.0, 0.05, "km/h", "%")
    assert (study.x.design, study.y.design) == (pytest.approx(300.0 / 3.6), 0.05)
    assert MapFolder.of(tmp_path, scenario, request).reached() == pytest.approx(0.7)


@pytest.mark.usefixtures("quick")
def test_notes_say_what_is_not_seen(small_scenario: SmallScenario) -> None:
    scenario = small_scenario()
    study = survey_map(scenario, map_request(
        scenario, x="speed=20:100:5", y="vehicle.car.mass=6t:8t:4", options=["active"]
    ))  # fmt: skip
    said = "\n".join(study.notes)
    assert "speed: 20 to 100 came without a unit and is read in m/s." in said
    assert "Control laws stay as designed at the scenario's own values" in said and "vehicle.car.mass" in said
    assert "Not mapped: bare, damper." in said
    assert MERGED not in study.options[0].notes
    for merge in (True, False):
        request = map_request(
            scenario, x=SPEEDS, y="depth=0:0.5:3", options=["active"], merge_delays=merge, tables=False
        )
        assert (MERGED in survey_map(scenario, request).options[0].notes) is merge
    deep = survey_map(scenario, map_request(scenario, x=SPEEDS, y="depth=0:1.5:3", options=["bare"]))
    assert any("Above a depth of 1 the modulation is deeper than the stiffness" in note for note in deep.notes)
    assert not any("deeper" in note for note in study.notes)
    off = survey_map(scenario, map_request(scenario, x=SPEEDS, y="depth=0.2:0.4:3", options=["bare"], tables=False))
    assert "The expected depth of modulation, 5 %, is not on the map, which runs from 20 to 40 %." in off.notes
    assert not any("not on the map" in note for note in deep.notes)


def test_an_estimate_comes_at_once() -> None:
    scenario = load("scenarios/periodic/girder_passing.toml")
    request = map_request(scenario, x="speed=60km/h:600km/h:31623", y="depth=0:0.5:31623", options=["bare"])
    found = survey_estimate(scenario, request, jobs=1)
    assert found.points == 31623**2 and found.seconds > 60.0 and found.bytes > 2e9
