"""Scenarios with eddy-current forces: guideways of every shape, ranges, every bad input with its place."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from maglev_ctrl.errors import ModelError
from maglev_ctrl.forces import CornerImageForce
from maglev_ctrl.scenario import Scenario, ScenarioProblems, build_vehicle, load, with_solved_force
from maglev_ctrl.scenario.eddy_current import coils_of, domain_of, section_of
from maglev_ctrl.scenario.layout import layout
from maglev_ctrl.study.situation import OptionModel, Situation

TEXT = """
format = 1
title = "Double L over aluminium"
[vehicle]
model = "double_l"
half_gauge = "88.9 mm"
magnet_depth = "91.4 mm"
[vehicle.car]
mass = "0.84 kg"
roll_inertia = "5.6e-3 kg*m^2"
[forces]
model = "eddy_current"
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
L_SHAPE = TEXT[TEXT.index('shape = "l_shape"') : TEXT.index("[[forces.coil]]")]
Read = Callable[[str], Scenario]


@pytest.fixture
def read(tmp_path: Path) -> Read:
    def written(text: str) -> Scenario:
        file = tmp_path / "case.toml"
        file.write_text(text, encoding="utf-8")
        return load(file)

    return written


def replaced(old: str, new: str, text: str = TEXT) -> str:
    assert old in text
    return text.replace(old, new)


def guideway(lines: str) -> str:
    return replaced(L_SHAPE, lines + "\n")


def domain(scenario: Scenario):
    return domain_of(scenario, layout(scenario.vehicle))


def test_reading_solves_nothing(read: Read) -> None:
    read(TEXT)
    started = time.perf_counter()
    scenario = read(TEXT)
    assert time.perf_counter() - started < 1.0  # solving takes tens of seconds
    force = build_vehicle(scenario).magnets[0].force
    with pytest.raises(ModelError, match="have not been solved"):
        force.forces(0.0127, 0.0127, 36.1)
    with pytest.raises(ModelError, match="have not been solved"):
        OptionModel(scenario, None).plant(Situation.of_design(scenario))


def test_section_and_coil_are_those_of_the_file(read: Read) -> None:
    forces = read(TEXT).forces
    low, high = section_of(forces.guideway).bounds
    np.testing.assert_allclose([low, high], [[-6.35e-3, -6.35e-3], [69.85e-3, 69.85e-3]], rtol=1e-12)
    (coil,) = coils_of(forces)
    assert (coil.length, coil.width, coil.ampere_turns) == pytest.approx((50.8e-3, 25.4e-3, 6000.0))
    inside = read(replaced('leg = "76.2 mm"', 'leg = "76.2 mm"\noutside = false')).forces
    assert section_of(inside.guideway).bounds[1][0] == pytest.approx(76.2e-3)


@pytest.mark.parametrize(
    ("lines", "conductors", "width"),
    [
        ('shape = "plate"\nwidth = "0.4 m"\nthickness = "5 mm"\nconductivity = "3e7 S/m"', 1, 0.4),
        ('shape = "channel"\nwidth = "60 mm"\nwall = "50 mm"\nthickness = "5 mm"\nconductivity = "3e7 S/m"', 1, 0.07),
        (
            'shape = "plates"\n'
            + "".join(
                f'[[forces.guideway.plate]]\nleft = "{a} mm"\nright = "{a + 40} mm"\nbottom = "-5 mm"\ntop = "0 mm"\n'
                'conductivity = "3e7 S/m"\n'
                for a in (0, 41)
            ),
            2, 0.081,
        ),
        (
            'shape = "polygon"\n[[forces.guideway.conductor]]\nname = "wedge"\nconductivity = "3e7 S/m"\n'
            'vertices = [["0 mm", "0 mm"], ["0 mm", "-10 mm"], ["7 cm", "-10 mm"], ["7 cm", "-1 mm"]]',
            1, 0.07,
        ),
    ],
    ids=["plate", "channel", "plates", "polygon"],
)  # fmt: skip
def test_other_shapes(read: Read, lines: str, conductors: int, width: float) -> None:
    section = section_of(read(guideway(lines)).forces.guideway)
    low, high = section.bounds
    assert len(section.conductors) == conductors
    assert high[0] - low[0] == pytest.approx(width)


def test_ranges_follow_the_study_and_offsets_change_the_gap(read: Read) -> None:
    sweeps = (
        'gap = "12.7 mm"\nsweep.height = { from = "10 mm", to = "20 mm", count = 3 }\n'
        'sweep.speed = { from = "20 m/s", to = "50 m/s", count = 3 }\n'
        'sweep.lateral_offset = { from = "-4 mm", to = "6 mm", count = 3 }'
    )
    found = domain(read(replaced('gap = "12.7 mm"', sweeps)))
    np.testing.assert_allclose(found.height, (9e-3, 22e-3), rtol=1e-12)
    np.testing.assert_allclose(found.gap, (0.9 * 6.7e-3, 1.1 * 18.7e-3), rtol=1e-12)
    np.testing.assert_allclose(found.speed, (18.0, 55.0), rtol=1e-12)


def test_ranges_stop_short_of_the_metal(read: Read) -> None:
    """An offset that would push the magnet into the wall leaves a range that does not: 20 % of 12.7 mm stay clear."""
    text = replaced(
        'gap = "12.7 mm"', 'gap = "12.7 mm"\nsweep.lateral_offset = { from = "-12.6 mm", to = "12.6 mm", count = 3 }'
    )
    assert domain(read(text)).gap[0] == pytest.approx(0.2 * 12.7e-3, rel=1e-4)


def test_given_ranges_are_taken(read: Read) -> None:
    given = (
        'model = "eddy_current"\nheight_range = { from = "8 mm", to = "30 mm" }\n'
        'gap_range = { from = "6 mm", to = "20 mm" }\nvelocity_range = { from = "5 m/s", to = "60 m/s" }'
    )
    found = domain(read(replaced('model = "eddy_current"', given)))
    np.testing.assert_allclose([found.height, found.gap, found.speed], [(8e-3, 30e-3), (6e-3, 20e-3), (5.0, 60.0)])


def test_without_a_current_the_magnets_lift_the_weight(read: Read) -> None:
    stand_in = CornerImageForce(1.0, length=0.05, width=0.025, thickness=6e-3)
    for text, sized in (
        (replaced('current = "6000 A"\n', ""), True),
        (TEXT, False),
        (replaced('model = "eddy_current"', 'model = "eddy_current"\ntrim_to_weight = true'), True),
    ):
        vehicle = build_vehicle(with_solved_force(read(text), stand_in))
        lift = sum(float(m.force.forces(0.0127, 0.0127, 36.1).lift) for m in vehicle.magnets)
        assert (abs(lift - 0.84 * 9.80665) < 1e-9) is sized


BAD = {
    "thickness": (replaced('"6.35 mm"', '"0 mm"'), ":16:13: forces.guideway.thickness", "above zero"),
    "conductivity": (replaced('"2.5e7 S/m"', '"0 S/m"'), ":17:16: forces.guideway.conductivity", "above zero"),
    "leg": (replaced('leg = "76.2 mm"', 'leg = "6 mm"'), "forces.guideway.leg", "exceed the thickness"),
    "shape": (replaced('"l_shape"', '"l_shap"'), "forces.guideway.shape", 'did you mean "l_shape"?'),
    "no shape": (replaced('shape = "l_shape"\n', ""), "forces.guideway.shape", "missing"),
    "unknown key": (replaced("leg =", "legs ="), "forces.guideway.legs", 'did you mean "leg"?'),
    "bare number": (replaced('leg = "76.2 mm"', "leg = 76.2"), ":15:7: forces.guideway.leg", "bare number"),
    "no coil": (TEXT[: TEXT.index("[[forces.coil]]")] + TEXT[TEXT.index("[operating]") :], "forces.coil", "missing"),
    "zero current": (replaced('"6000 A"', '"0 A"'), "forces.coil[0].current", "other than zero"),
    "touching": (replaced('height = "12.7 mm"', 'height = "1 mm"').replace('"3.175 mm"', '"-2 mm"'),
                 "forces.coil[0]", "touches or lies inside"),
    "inside": (replaced('lateral = "12.7 mm"', 'lateral = "-15 mm"'), "forces.coil[0]", "touches or lies inside"),
    "one-sided coils": (replaced('height = "3.175 mm"', 'height = "3.175 mm"\nforward = "10 mm"'), "forces.coil[0]",
                        "forwards and backwards"),
    "speed zero": (replaced('model = "eddy_current"', 'model = "eddy_current"\nvelocity_range = '
                            '{ from = "0 m/s", to = "50 m/s" }'), "velocity_range.from", "forces vanish"),
    "speed outside": (replaced('model = "eddy_current"', 'model = "eddy_current"\nvelocity_range = '
                               '{ from = "40 m/s", to = "50 m/s" }'), "velocity_range", "the design point's speed"),
    "height outside": (replaced('model = "eddy_current"', 'model = "eddy_current"\nheight_range = '
                                '{ from = "15 mm", to = "20 mm" }'), "height_range", "the design point's height"),
    "gap outside": (replaced('model = "eddy_current"', 'model = "eddy_current"\ngap_range = '
                             '{ from = "2 mm", to = "5 mm" }'), "gap_range", "holds the design point's gap"),
    "crossing": (guideway('shape = "polygon"\n[[forces.guideway.conductor]]\nname = "bow"\nconductivity = "3e7 S/m"\n'
                          'vertices = [["0 mm", "0 mm"], ["9 mm", "-9 mm"], ["9 mm", "0 mm"], ["0 mm", "-9 mm"]]'),
                 ":18:12: forces.guideway.conductor[0].vertices", "cross or touch"),
    "bare vertices": (guideway('shape = "polygon"\n[[forces.guideway.conductor]]\nname = "bow"\nconductivity = '
                               '"3e7 S/m"\nvertices = [[0, 0], [9, -9], [9, 0]]'), "vertices", "bare number"),
    "two vertices": (guideway('shape = "polygon"\n[[forces.guideway.conductor]]\nname = "bow"\nconductivity = '
                              '"3e7 S/m"\nvertices = [["0 mm", "0 mm"], ["1 mm", "0 mm"]]'), "vertices", "at least 3"),
    "crooked plate": (guideway('shape = "plates"\n[[forces.guideway.plate]]\nleft = "5 mm"\nright = "1 mm"\n'
                               'bottom = "-5 mm"\ntop = "0 mm"\nconductivity = "3e7 S/m"'),
                      "forces.guideway.plate[0]", "left below right"),
    "sweep beyond": (
        replaced('model = "eddy_current"', 'model = "eddy_current"\nheight_range = { from = "12 mm", to = "13 mm" }')
        .replace('gap = "12.7 mm"', 'gap = "12.7 mm"\nsweep.height = { from = "12 mm", to = "13.5 mm", count = 4 }'),
        "operating.sweep.height", "widen the range or shorten the sweep"),
    "into the wall": (
        replaced('gap = "12.7 mm"', 'gap = "12.7 mm"\n'
                 'sweep.lateral_offset = { from = "-20 mm", to = "20 mm", count = 5 }'),
        "operating.sweep.lateral_offset", "into the wall 12.7 mm away"),
    "no gap": (replaced('gap = "12.7 mm"\n', ""), "operating.gap", "missing"),
}  # fmt: skip


@pytest.mark.parametrize(("text", "place", "words"), BAD.values(), ids=BAD.keys())
def test_bad_input_is_told_with_its_place(read: Read, text: str, place: str, words: str) -> None:
    with pytest.raises(ScenarioProblems) as caught:
        read(text)
    said = str(caught.value)
    assert place in said
    assert words in said
    assert said.split("case.toml:")[1].split(":")[0].isdigit()


def test_a_current_in_one_coil_only_is_refused(read: Read) -> None:
    coil = TEXT[TEXT.index("[[forces.coil]]") : TEXT.index("[operating]")]
    with pytest.raises(ScenarioProblems, match=r"forces\.coil\[1\]: expected a current in every coil or in none"):
        read(replaced(coil, coil + coil.replace('current = "6000 A"\n', "")))
