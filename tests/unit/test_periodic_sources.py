"""The [[periodic.source]] tables: what is accepted, what each fault is answered with, what a study makes of them."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from maglev_ctrl.errors import ModelError, OutOfDomain, ScenarioError
from maglev_ctrl.scenario import Scenario, build_vehicle, json_schema, load
from maglev_ctrl.scenario.eddy_current import study_domain
from maglev_ctrl.scenario.periodic_sources import build_pattern, build_sources, reach, source_names
from maglev_ctrl.study.forcing import Forcing
from maglev_ctrl.study.modulation import (
    depth_of,
    describe_periodicity,
    elements_of,
    modulation_of,
    wavelength_of,
)
from maglev_ctrl.study.periodic import floquet_study
from maglev_ctrl.study.situation import OptionModel, Situation
from maglev_ctrl.systems import at_depth
from maglev_ctrl.vehicle import OperatingPoint, equilibrium, stiffness_modulation
from maglev_ctrl.vehicle.guideway_modulation import guideway_modulation

ROOT = Path(__file__).resolve().parents[2]
PRESCRIBED = 'wavelength = "25 m"\ndepth = 0.05\n'
Small = Callable[[str], Scenario]

GIRDER = '{ kind = "girder", span = "25 m", sag = "5 mm" }'
JOINT = '{ kind = "joint", spacing = "12.5 m", opening = "20 mm" }'
COILS = '{ kind = "pitch", spacing = "0.45 m", ripple = 0.01, basis = "assumed" }'


def text_with(small_text: str, *sources: str, more: str = "") -> str:
    assert PRESCRIBED in small_text
    return small_text.replace(PRESCRIBED, f"source = [{', '.join(sources)}]\n{more}\n" if sources else f"{more}\n")


@pytest.fixture(scope="module")
def girder(small_scenario: Small, small_text: str) -> Scenario:
    return small_scenario(text_with(small_text, GIRDER))


def test_a_girder_gives_wavelength_and_depth(girder: Scenario) -> None:
    assert wavelength_of(girder) == 25.0
    # First order: 2 sag / height times (4/pi)/3, the first harmonic of a half sine; the next order is of sag / height.
    assert depth_of(girder) == pytest.approx(2 * 0.05 * 4 / np.pi / 3, rel=0.02)


def test_unit_depth_times_the_expected_depth_is_the_guideway_itself(girder: Scenario) -> None:
    vehicle = build_vehicle(girder)
    state = equilibrium(vehicle, OperatingPoint(50.0, 0.1))
    unit = modulation_of(girder)(vehicle, state)
    itself = guideway_modulation(vehicle, state, build_pattern(girder.periodic))  # type: ignore[arg-type]
    parts = elements_of(girder)(vehicle, state)
    for one, other, share in zip(unit, itself, (parts.K_cos, parts.K_sin), strict=True):
        np.testing.assert_allclose(depth_of(girder) * one, other, rtol=1e-12, atol=1e-9)
        np.testing.assert_allclose(np.sum(share, axis=0), one, rtol=1e-12, atol=1e-9)
    # At unit depth the largest harmonic of the heave stiffness, in phase, is the mean one: one magnet at x = 0 here.
    magnets = stiffness_modulation(vehicle, state, wavelength=1e12)[0][0]
    bogie = vehicle.dofs.index("bogie.heave")
    assert float(np.hypot(unit[0][0], unit[1][0])[bogie, bogie] / magnets[bogie, bogie]) == pytest.approx(1.0, rel=1e-2)


def test_a_prescribed_pattern_is_what_it_was_to_the_bit(small_scenario: Small, small_text: str) -> None:
    scenario = small_scenario(small_text)
    vehicle = build_vehicle(scenario)
    state = equilibrium(vehicle, OperatingPoint(50.0, 0.1))
    found = modulation_of(scenario)(vehicle, state)
    wanted = stiffness_modulation(vehicle, state, wavelength=25.0, harmonics=(1.0,))
    for one, other in zip(found, wanted, strict=True):
        assert np.array_equal(one, other)
    assert (wavelength_of(scenario), depth_of(scenario)) == (25.0, 0.05)
    (line,) = describe_periodicity(scenario)
    assert line == (
        "Prescribed pattern: the stiffness of every magnet varies by 5 % (expected depth) with a period of 25 m; "
        "harmonics 1."
    )


def test_keys_that_came_later_leave_a_hash_alone(small_scenario: Small, small_text: str) -> None:
    assert small_scenario(small_text).hash == "16548193ea856316d17f77c9448f1b4edaf49e541ac04a2a1e0cba049eaaaba1"
    more = [small_scenario(text_with(small_text, *sources)).hash for sources in ((GIRDER,), (GIRDER, JOINT))]
    assert len({*more, small_scenario(small_text).hash}) == 3


def test_forcing_takes_the_sources(girder: Scenario) -> None:
    model = OptionModel(girder, girder.options[0])
    assert girder.periodic is not None
    forcing = Forcing.of(model, None, girder.periodic)
    system = forcing.at(80.0)
    assert system.A_cos.shape[0] == 4 and float(system.frequency) == pytest.approx(2 * np.pi * 80.0 / 25.0)
    held, balanced = model.balance_of(model.vehicle(), Situation.of_design(girder))
    K_cos, _ = modulation_of(girder)(held, balanced)
    assert np.max(np.abs(at_depth(system, 0.0).A_cos)) == 0.0 and np.max(np.abs(K_cos)) > 0.0


def test_a_study_runs_on_sources(small_scenario: Small, small_text: str) -> None:
    text = text_with(small_text, GIRDER, JOINT, more="source_harmonics = 2")
    scenario = small_scenario(text)
    found = floquet_study(OptionModel(scenario, scenario.options[1]), None)
    assert found.wavelength == 25.0 and found.expected_depth == pytest.approx(depth_of(scenario))
    assert found.map.unstable.shape[0] > 10


def test_every_source_is_told_with_its_contribution(small_scenario: Small, small_text: str) -> None:
    stepped = '{ kind = "joint", name = "steps", spacing = "25 m", step = "1 mm" }'
    soft = '{ kind = "girder", name = "beams", span = "25 m", sag = "5 mm", camber = "1 mm", softness = "1 %" }'
    profile = '{ kind = "segment", spacing = "12.5 m", heights = ["0 mm", "1 mm", "0.5 mm"] }'
    lines = describe_periodicity(small_scenario(text_with(small_text, soft, JOINT, stepped, profile)))
    assert len(lines) == 7
    assert lines[0].startswith(
        "Beams: girders of 25 m, sag 5 mm, camber 1 mm, half sine between supports: harmonics of"
    )
    assert re.search(r"force model at \d+ positions", lines[0]) and "change of the mean, left out" in lines[0]
    assert lines[1].startswith("Beams (softness): girders of 25 m, magnetic stiffness 1 % lower at mid-span: harmonics")
    assert lines[2].startswith(
        "Joint: joints every 12.5 m, 20 mm without conductor, sharp edges: harmonics of the heave"
    )
    assert lines[3].startswith("Steps: joints every 25 m with a step of 1 mm: ")
    assert lines[4].startswith("Segment: segments of 12.5 m with a profile of heights: ")
    assert lines[5].startswith("Together: period 25 m (beams 1 times, beams (softness) 1 times, joint 2 times, ")
    assert "a depth scales all sources in proportion" in lines[5]
    assert "sampling of digital controllers" in lines[6] and "flies straight" in lines[6]


def test_what_has_no_common_period_is_refused_or_told(small_scenario: Small, small_text: str) -> None:
    odd = '{ kind = "pitch", name = "coils", spacing = "0.4501 m", ripple = "1 %", basis = "measured" }'
    with pytest.raises(ScenarioError, match=r"girder and coils: wavelengths 25 m and 0\.4501 m have no common period"):
        small_scenario(text_with(small_text, GIRDER, odd))
    with pytest.raises(ScenarioError, match=r'on_incommensurate = "slower" does that and says what was left out'):
        small_scenario(text_with(small_text, GIRDER, odd))
    kept = small_scenario(text_with(small_text, GIRDER, odd, more='on_incommensurate = "slower"'))
    lines = describe_periodicity(kept)
    assert lines[1].startswith(
        'Left out: "coils", period 0.4501 m, the faster source; kept is "girder", 25 m. Wavelengths 25 m and 0.4501 m '
        "have no common period: their ratio "
    )
    assert lines[1].endswith("For a map of coils by itself remove girder.")
    many = COILS.replace("0.45 m", "2.5 m")
    more = 'source_harmonics = 10\non_incommensurate = "slower"'
    crowded = describe_periodicity(small_scenario(text_with(small_text, GIRDER, many, more=more)))
    assert "The common period of 25 m takes 100 harmonics, above 60. For a map of pitch" in crowded[1]
    alone = small_scenario(text_with(small_text, GIRDER))
    assert wavelength_of(kept) == 25.0 and depth_of(kept) == depth_of(alone)


def test_a_modulation_deeper_than_the_stiffness_is_allowed_and_said(small_scenario: Small, small_text: str) -> None:
    deep = '{ kind = "pitch", spacing = "1 m", ripple = 1.4, basis = "assumed" }'
    lines = describe_periodicity(small_scenario(text_with(small_text, deep)))
    assert any("expected depth of 140 % is more than the stiffness itself" in line for line in lines)


def test_a_sag_into_the_magnets_is_told_with_its_source(small_scenario: Small, small_text: str) -> None:
    scenario = small_scenario(text_with(small_text, '{ kind = "girder", span = "25 m", sag = "200 mm" }'))
    with pytest.raises(
        OutOfDomain, match=r"girder: the guideway stands -72\.68 to 127\.3 mm about its mean; there the h"
    ):
        describe_periodicity(scenario)


def test_sources_that_cancel_leave_nothing_to_map(small_scenario: Small, small_text: str) -> None:
    coils = [
        f'{{ kind = "pitch", name = "{name}", spacing = "2 m", offset = "{at} m", ripple = 0.1, basis = "assumed" }}'
        for name, at in (("first", 0), ("second", 1))
    ]
    with pytest.raises(ModelError, match="the sources \\(first, second\\) leave the total heave stiffness without"):
        depth_of(small_scenario(text_with(small_text, *coils, more="source_harmonics = 1")))


FAULTS = [
    ((), "", "periodic.wavelength", "missing; expected a length with its unit, for example"),
    ((), "", "periodic.depth", "missing; expected a plain number, or [[periodic.source]] tables in its place"),
    ((), 'wavelength = "25 m"\ndepth = 0.1\nmagnet_length = "1 m"', "periodic.magnet_length", "belongs to [[periodic"),
    ((GIRDER,), 'wavelength = "25 m"', "periodic.wavelength", "given beside [[periodic.source]]"),
    ((GIRDER,), "harmonics = [1.0]", "periodic.harmonics", "given beside [[periodic.source]]"),
    ((GIRDER, GIRDER.replace("{", '{ name = "girder_1",', 1), GIRDER), "", "periodic.source[1]", "expected a unique"),
    ((GIRDER.replace("25 m", "0 m"),), "", "periodic.source[0].span", 'expected a length above zero, got "0 m"'),
    ((GIRDER.replace('"5 mm"', "5"),), "", "periodic.source[0].sag", "got the bare number 5"),
    ((GIRDER.replace("5 mm", "-5 mm"),), "", "periodic.source[0].sag", "expected a length of zero or more"),
    ((GIRDER.replace("5 mm", "1e999 m"),), "", "periodic.source[0].sag", ""),
    ((GIRDER.replace("sag", "sga"),), "", "periodic.source[0].sga", 'unknown key; did you mean "sag"?'),
    ((GIRDER.replace("girder", "girdr"),), "", "periodic.source[0].kind", 'did you mean "girder"?'),
    ((GIRDER.replace(', sag = "5 mm"', ""),), "", "periodic.source[0]", "there is neither sag, camber nor softness"),
    ((GIRDER.replace("}", ', camber = "5 mm" }'),), "", "periodic.source[0]", "the camber takes away the sag"),
    ((GIRDER.replace("}", ", softness = 1.0 }"),), "", "periodic.source[0].softness", "expected a fraction between"),
    ((JOINT.replace("20 mm", "12.5 m"),), "", "periodic.source[0].opening", "expected less than the spacing of 12.5 m"),
    ((JOINT.replace("}", ', step = "1 mm" }'),), "", "periodic.source[0]", "exactly one of opening and step, got both"),
    ((JOINT.replace(', opening = "20 mm"', ""),), "", "periodic.source[0]", "one of opening and step, got none"),
    ((JOINT.replace("opening", "step").replace("20 mm", "0 mm"),), "", "periodic.source[0].step", "other than zero"),
    (('{ kind = "segment", spacing = "5 m" }',), "", "periodic.source[0]", "missing; expected heights or gaps"),
    (('{ kind = "segment", spacing = "5 m", heights = ["0 m", "1 mm"] }',), "", "periodic.source[0].heights",
     "at least 3"),
    (('{ kind = "segment", spacing = "5 m", heights = ["1 mm", "1 mm", "1 mm"] }',), "", "periodic.source[0].heights",
     "all its samples are equal"),
    (('{ kind = "segment", spacing = "5 m", gaps = ["0 m", "1 mm", "0 m"] }',), "", "periodic.source[0].gaps",
     "no magnet faces a guidance wall"),
    ((COILS.replace("0.01", "0.0"),), "", "periodic.source[0].ripple", "expected a number above zero"),
    ((COILS.replace("}", ", harmonics = [0.0] }"),), "", "periodic.source[0].harmonics", "one harmonic that is not"),
    ((COILS.replace(', basis = "assumed"', ""),), "", "periodic.source[0].basis", 'expected "measured" or "assumed"'),
    ((GIRDER,), "source_harmonics = 0", "periodic.source_harmonics", "greater than or equal to 1"),
    ((GIRDER,), 'on_incommensurate = "slow"', "periodic.on_incommensurate", 'did you mean "slower"?'),
    ((GIRDER, COILS.replace("0.45 m", "2.5 m")), "source_harmonics = 10", "periodic.source", "takes 100 harmonics"),
]  # fmt: skip


@pytest.mark.parametrize(("sources", "more", "key", "words"), FAULTS, ids=[f"{f[2]}-{i}" for i, f in enumerate(FAULTS)])
def test_faults_name_the_key_and_what_was_expected(
    small_scenario: Small, small_text: str, sources: tuple[str, ...], more: str, key: str, words: str
) -> None:
    with pytest.raises(ScenarioError) as caught:
        small_scenario(text_with(small_text, *sources, more=more))
    lines = str(caught.value).splitlines()
    assert any(f" {key}: " in line and words in line for line in lines), lines


def test_measured_coefficients_take_no_heights(tmp_path: Path) -> None:
    text = (ROOT / "scenarios/paper/six_dof.toml").read_text(encoding="utf-8")
    assert "[periodic]" not in text
    table = '[periodic]\nsource = [%s]\nmap = { speed = { from = "5 m/s", to = "9 m/s", count = 3 }, depth = '
    table += "{ from = 0.0, to = 0.1, count = 3 } }\n"
    coefficients = tmp_path / "six.toml"
    coefficients.write_text(f"{text}\n{table % GIRDER}", encoding="utf-8")
    with pytest.raises(ScenarioError, match="measured coefficients do not tell how the stiffness changes"):
        load(coefficients)
    coefficients.write_text(f"{text}\n{table % JOINT}", encoding="utf-8")
    assert depth_of(load(coefficients)) == pytest.approx(2 * np.sin(np.pi * 0.0016) / np.pi / (1 - 0.0016), rel=1e-12)


def test_names_and_order_are_those_of_the_file(small_scenario: Small, small_text: str) -> None:
    scenario = small_scenario(text_with(small_text, GIRDER, JOINT, JOINT.replace("opening", "step")))
    assert scenario.periodic is not None
    assert source_names(scenario.periodic) == ("girder", "joint_1", "joint_2")
    assert [one.name for one in build_sources(scenario.periodic)] == ["girder", "joint_1", "joint_2"]


def test_forces_are_solved_where_the_sources_take_the_magnets(girder: Scenario, small_text: str) -> None:
    (low, high), gaps = reach(girder.periodic)
    # A sagging half sine stands 2/pi of the sag above its mean and 1 - 2/pi below: its top is the least height.
    assert (low, high) == pytest.approx((-0.005 * 2 / np.pi, 0.005 * (1 - 2 / np.pi)), rel=1e-4)
    assert gaps == (0.0, 0.0) and reach(None) == ((0.0, 0.0), (0.0, 0.0))
    found = study_domain(girder, has_gap=False).height
    assert found[0] == pytest.approx(0.9 * (0.1 + low)) or found[0] < 0.1 + low
    assert found[1] > 0.1 + high


def test_the_schema_shows_the_sources() -> None:
    schema = json_schema()["$defs"]
    assert set(schema["GirderSource"]["properties"]) == {
        "name", "offset", "kind", "span", "sag", "camber", "softness",
    }  # fmt: skip
    assert schema["Periodic"]["required"] == ["map"]
    assert json.dumps(schema["Periodic"]["properties"]["source"]).count("Source") >= 4
