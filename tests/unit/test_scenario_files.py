"""The scenario library: every file loads, builds, states where its numbers come from, and has a linear model."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

from maglev_ctrl.forces import Domain
from maglev_ctrl.forces.force_map import ForceMap, LogAxis, MapQuality
from maglev_ctrl.scenario import Scenario, build_option, build_vehicle, control_law, load, with_solved_force
from maglev_ctrl.scenario.guideway_schema import EddyCurrentForces
from maglev_ctrl.scenario.layout import command_dimensions, design_mass
from maglev_ctrl.study.situation import OptionModel, Situation

ROOT = Path(__file__).resolve().parents[2]
FILES = sorted((ROOT / "scenarios").rglob("*.toml"))
NAMES = [str(file.relative_to(ROOT / "scenarios")) for file in FILES]
EXPECTED = {
    "compare/eds_135t.toml", "compare/ems_vs_eds.toml", "compare/ems_vs_eds_eds.toml", "compare/four_options.toml",
    "compare/payload_and_speed.toml", "compare/warwick_30t.toml", "design/d_region.toml",
    "design/damping_budget.toml", "design/double_l_guidance.toml", "design/ems_hover.toml",
    "design/hinf_secondary.toml", "design/lqr_primary.toml", "design/mpc_stroke.toml",
    "design/polytopic_speed.toml", "design/scheduled_speed.toml", "design/sky_hook.toml", "paper/double_l.toml",
    "paper/double_l_corner_image.toml", "paper/double_l_paper_kinematics.toml", "paper/heave_pitch_surge.toml",
    "paper/heave_surge.toml", "paper/six_dof.toml", "periodic/girder_passing.toml",
    "periodic/joints_and_girders.toml", "periodic/periodic_law.toml",
}  # fmt: skip
PHYSICS = ("[vehicle", "[[vehicle", "[forces", "[operating", "[periodic", "[irregularity", "[ride", "[uncertainty")


def body_of(text: str) -> str:
    """The file without its table of sources, where every key stands anyway."""
    before, _, rest = text.partition("[sources]")
    return before + rest[rest.index("\n[") :]


def unused_sources(text: str, keys: list[str]) -> list[str]:
    """Sources that nothing in the file refers to."""
    return [key for key in keys if not re.search(rf"\b{re.escape(key)}\b", body_of(text))]


def silent_numbers(text: str) -> list[str]:
    """Numbers of the vehicle, its forces and its operation without a remark beside them or just above them.

    Sweeps and maps are ranges the author chooses; zeros and rows of matrices need no remark of their own.
    """
    found, watched, remark_above = [], False, False
    for line in body_of(text).splitlines():
        stripped = line.strip()
        if re.match(r"\[+[a-z_.]+\]+", stripped):
            watched = stripped.startswith(PHYSICS)
        key, _, value = stripped.partition("=")
        number = re.fullmatch(r"[a-z_]+ ", key) and re.match(r' "?-?[\d.]*[1-9]', value)
        if watched and number and "#" not in stripped and not remark_above:
            found.append(stripped)
        remark_above = stripped.startswith("#") or (remark_above and bool(re.match(r"\[+[a-z_.]+\]+", stripped)))
    return found


def corner_forces() -> ForceMap:
    """Forces of the guideway that all eddy-current files share, kept with the tests of the paper at 36.1 m/s."""
    kept = json.loads((ROOT / "tests/paper/data/default_forces.json").read_text(encoding="utf-8"))
    height, gap, speed = tuple(kept["height"]), tuple(kept["gap"]), (36.1, 36.1)
    energy, drag = (np.asarray(kept[name])[:, :, None] for name in ("log_energy", "log_drag"))
    axes = (LogAxis(*height, kept["shift"][0]), LogAxis(*gap, kept["shift"][1]), LogAxis(*speed, 0.0))
    quality = MapQuality(np.nan, np.nan, np.nan, 0, (*energy.shape[:2], 1))
    return ForceMap(Domain(height=height, gap=gap, speed=speed), axes, energy, drag, quality)


@pytest.fixture(scope="module", params=FILES, ids=NAMES)
def scenario(request: pytest.FixtureRequest) -> Scenario:
    read = load(request.param)
    # Solving takes a minute; the forces at the design speed are known.
    return with_solved_force(read, corner_forces()) if isinstance(read.forces, EddyCurrentForces) else read


def test_the_library_is_complete() -> None:
    assert set(NAMES) >= EXPECTED


def test_it_has_a_title_a_description_sources_and_assumptions(scenario: Scenario) -> None:
    assert len(scenario.title) > 20
    assert len(scenario.description) > 200
    assert scenario.sources
    assert scenario.assumptions


def test_every_source_is_used(scenario: Scenario) -> None:
    assert not unused_sources(scenario.text, list(scenario.sources))


def test_an_unused_source_is_caught() -> None:
    text = '[sources]\nused = "a book"\nspare = "another"\n\n[vehicle]\nmass = "1 t"  # used\n'
    assert unused_sources(text, ["used", "spare"]) == ["spare"]


def test_every_number_says_where_it_comes_from(scenario: Scenario) -> None:
    assert not silent_numbers(scenario.text)


def test_a_silent_number_is_caught() -> None:
    text = '[sources]\na = "b"\n[vehicle.car]\nmass = "1 t"\n[forces]\nthickness = "2 mm"  # a\n[[option]]\nx = 1\n'
    assert silent_numbers(text) == ['mass = "1 t"']


def test_the_file_tells_how_to_run_it(scenario: Scenario) -> None:
    path = scenario.path.relative_to(ROOT).as_posix()
    assert re.search(
        rf"^# Run it:  maglev-ctrl (report|design|compare) {re.escape(path)}\b", scenario.text, re.MULTILINE
    )


def test_it_begins_with_a_baseline_and_has_something_to_compare(scenario: Scenario) -> None:
    assert scenario.options[0].kind == "baseline"
    assert len(scenario.options) >= 2
    assert len({option.label for option in scenario.options}) == len(scenario.options)
    assert scenario.requirements


def test_every_option_has_a_linear_model_at_the_design_point(scenario: Scenario) -> None:
    point = Situation.of_design(scenario)
    bare = build_vehicle(scenario)
    for option in scenario.options:
        grown = build_option(scenario, option, bare)
        plant = OptionModel(scenario, option).plant(point)
        windings = command_dimensions(scenario).get("magnet", ((), ()))[1]
        driven = {*windings, *(actuator.name for actuator in grown.actuators)}
        assert set(plant.inputs) == driven
        assert np.all(np.isfinite(plant.state_matrix()))
        assert np.all(np.linalg.eigvalsh(plant.M) > 0.0)
        law = control_law(scenario, option)
        assert law is None or set(law.actuators) == driven


def test_the_magnets_carry_the_weight(scenario: Scenario) -> None:
    vehicle = build_vehicle(scenario)
    if not vehicle.magnets:
        pytest.skip("forces given as matrices about an equilibrium: no lift to compare")
    _, balanced = OptionModel(scenario, scenario.options[0]).balance(Situation.of_design(scenario))
    # A file that gives a current and a mass may round the mass; all others are sized for the weight.
    assert float(np.max(np.abs(np.asarray(balanced.strength) - 1.0))) < 1e-4
    assert design_mass(scenario) > 0.0


def test_the_comparison_has_at_least_eight_options() -> None:
    scenario = load(ROOT / "scenarios/compare/eds_135t.toml")
    assert len(scenario.options) >= 8
    assert {option.kind for option in scenario.options} >= {
        "passive_primary", "active_primary", "passive_secondary", "active_secondary"
    }  # fmt: skip


def test_attraction_and_repulsion_are_compared_on_equal_terms() -> None:
    """All but the magnets and what drives them is alike in both files, and diff finds the same names."""
    one, other = (load(ROOT / f"scenarios/compare/{name}.toml") for name in ("ems_vs_eds", "ems_vs_eds_eds"))
    assert one.requirements == other.requirements
    assert [(option.name, option.label, option.kind, option.spring_dampers) for option in one.options] == [
        (option.name, option.label, option.kind, option.spring_dampers) for option in other.options
    ]
    assert (one.vehicle, one.irregularity, one.uncertainty) == (other.vehicle, other.irregularity, other.uncertainty)
    assert (one.ride.passengers, one.ride.largest_stroke) == (other.ride.passengers, other.ride.largest_stroke)
    assert (one.operating.speed, one.operating.sweep) == (other.operating.speed, other.operating.sweep)
    assert one.forces.model != other.forces.model


def test_warwick_primary_has_the_stiffness_of_its_source() -> None:
    scenario = load(ROOT / "scenarios/compare/warwick_30t.toml")
    plant = OptionModel(scenario, scenario.options[0]).plant(Situation.of_design(scenario))
    i = plant.dofs.index("bogie.heave")
    assert plant.K[i, i] - 0.75e6 == pytest.approx(3.0e6, rel=1e-3)  # K_zz = m g / z0


def test_six_freedoms_carry_the_signs_of_their_forces() -> None:
    """The matrices of the file are those of the closed form of Sec. 2.3 of the errata, check case times 100."""
    scenario = load(ROOT / "scenarios/paper/six_dof.toml")
    length, b, c, v0 = 1.3, 0.7, 0.4, 30.0
    L_h, L_g, G_h, G_g, D_h, D_g = -90e3, 3.7e3, -2.1e3, -61e3, -5.5e3, -0.8e3
    L_v, G_v, D_v, L0, G0, D0 = 200.0, 70.0, -30.0, 5e3, 1.1e3, 0.9e3
    K, C = np.zeros((6, 6)), np.zeros((6, 6))
    K[0, 2] = 4 * D_h
    K[1, 1], K[1, 3] = -4 * G_g, 4 * (b * G_h - c * G_g)
    K[2, 2] = -4 * L_h
    K[3, 1] = 4 * (b * L_g - c * G_g)
    K[3, 3] = -4 * (c**2 * G_g - b * c * (G_h + L_g) + b**2 * L_h) - 4 * (b * G0 + c * L0)
    K[4, 2], K[4, 4] = -4 * c * D_h, -4 * length**2 * L_h - 4 * c * L0
    K[5, 1], K[5, 3] = 4 * b * D_g, 4 * b * (c * D_g - b * D_h) - 4 * c * D0
    K[5, 5] = -4 * length**2 * G_g - 4 * b * G0
    C[0, 0], C[0, 4] = 4 * D_v + 1000.0, -4 * c * D_v  # with the speed control
    C[4, 0], C[1, 1] = C[0, 4], 4 * D0 / v0
    C[1, 3] = C[3, 1] = 4 * c * D0 / v0
    C[1, 5], C[2, 0], C[2, 4] = -4 * b * G_v, -4 * L_v, 4 * c * L_v
    C[3, 3], C[3, 5] = 4 * c**2 * D0 / v0, 4 * b * (b * L_v - c * G_v)
    C[4, 4], C[5, 5] = 4 * c**2 * D_v, 4 * (length**2 * D0 / v0 + b**2 * D_v)
    table = scenario.forces
    np.testing.assert_allclose(np.asarray(table.stiffness[0]), K, rtol=1e-9, atol=1e-6)
    np.testing.assert_allclose(np.asarray(table.damping[0]), C, rtol=1e-9, atol=1e-6)
