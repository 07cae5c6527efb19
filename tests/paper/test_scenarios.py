"""The scenarios of the paper's examples find what theory says they must: v*, the false flutter band, none with true kinematics.

Values: corrected equations of the paper (the errata), Secs. 2.1 and 3.3.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from maglev_ctrl.analysis.modes import ModeKind, modes
from maglev_ctrl.scenario import Scenario, load
from maglev_ctrl.study.situation import OptionModel, Situation
from maglev_ctrl.study.sweeps import sweep, sweep_values, varied

PAPER = Path(__file__).resolve().parents[2] / "scenarios/paper"
V_STAR = 55.76556404461478  # (m w g / 2 K_a)^(1/3), exact for heave and surge together
BAND = (17.24, 22.30)  # mm, given to two decimals
BAND_TOLERANCE = 0.01  # mm
ROLL_DIVERGENCE = 39.0  # mm, "about 39"


def crossings(scenario: Scenario, option: str, parameter: str, **within: float) -> list[tuple[float, str]]:
    """Boundaries of an option along a sweep, in SI, with their direction; a coarse scan is enough to bracket them."""
    record = next(one for one in scenario.options if one.name == option)
    values = dict(sweep_values(scenario))[parameter]
    low, high = within.get("low", values[0]), within.get("high", values[-1])
    found = sweep(OptionModel(scenario, record), None, parameter=parameter, values=np.linspace(low, high, 21))
    return [(crossing.value, crossing.direction) for crossing in found.boundaries.crossings]


@pytest.fixture(scope="module")
def surge() -> Scenario:
    return load(PAPER / "heave_surge.toml")


@pytest.mark.parametrize("option", ["bare", "heave_damper"])
def test_the_speed_sweep_finds_the_surge_boundary_and_no_damper_moves_it(surge: Scenario, option: str) -> None:
    record = next(one for one in surge.options if one.name == option)
    values = dict(sweep_values(surge))["speed"][::5]
    boundaries = sweep(OptionModel(surge, record), None, parameter="speed", values=values).boundaries
    (crossing,) = boundaries.crossings
    assert crossing.direction == "gains"
    # The bisection stops within its error; growth up to the eigenvalues' own error bound counts as none, and near v*
    # growth falls with speed at 3 w g / v*^3 = 5e-4 per second and metre per second.
    assert crossing.value == pytest.approx(V_STAR, abs=crossing.error + 1e-6)


def test_a_mutant_with_the_air_drag_doubled_is_caught(tmp_path: Path) -> None:
    text = (PAPER / "heave_surge.toml").read_text(encoding="utf-8")
    file = tmp_path / "mutant.toml"
    file.write_text(text.replace('drag = "18 kN"', 'drag = "36 kN"'), encoding="utf-8")
    ((value, direction),) = crossings(load(file), "bare", "speed")
    assert direction == "gains"
    assert value == pytest.approx(V_STAR / 2.0 ** (1.0 / 3.0), abs=1e-6)
    assert abs(value - V_STAR) > 10.0


@pytest.mark.parametrize("file", ["heave_surge.toml", "heave_pitch_surge.toml"])
def test_heave_and_pitch_frequencies(file: str) -> None:
    scenario = load(PAPER / file)
    found = modes(OptionModel(scenario, scenario.options[0]).plant(Situation.of_design(scenario)))
    frequency = dict(zip(found.labels, np.abs(found.s), strict=True))
    heave = math.sqrt(9.80665 / 0.1)  # Eq. 25; the coupling with surge shifts it by less than 1e-5
    assert frequency["car heave"] == pytest.approx(heave, rel=1e-5)
    if "car pitch" in frequency:
        assert frequency["car pitch"] / heave == pytest.approx(math.sqrt(3.0 / (1.0 + 0.2**2)), rel=1e-6)
        # A square side view is another vehicle.
        assert abs(frequency["car pitch"] / heave - math.sqrt(1.5)) > 0.1


def test_heave_pitch_surge_has_the_same_boundary() -> None:
    ((value, direction),) = crossings(load(PAPER / "heave_pitch_surge.toml"), "end_dampers", "speed")
    assert direction == "gains"
    assert value == pytest.approx(V_STAR, abs=1e-6)


def test_the_papers_kinematics_make_a_false_flutter_band() -> None:
    found = crossings(load(PAPER / "double_l_paper_kinematics.toml"), "bare", "height", low=0.010, high=0.030)
    assert [direction for _, direction in found] == ["loses", "gains"]
    np.testing.assert_allclose([1e3 * value for value, _ in found], BAND, atol=BAND_TOLERANCE)


def test_consistent_kinematics_have_no_flutter_but_roll_diverges() -> None:
    """The mutant of the test above, which asks for the band, is the true vehicle: it has none."""
    scenario = load(PAPER / "double_l.toml")
    ((value, direction),) = crossings(scenario, "bare", "height")
    assert direction == "loses"
    assert 1e3 * value == pytest.approx(ROLL_DIVERGENCE, abs=1.0)
    model = OptionModel(scenario, scenario.options[0])
    for height, kind in ((0.019, None), (0.042, ModeKind.DIVERGENCE)):
        found = modes(model.plant(varied(Situation.of_design(scenario), "height", height)))
        flutter = {ModeKind.SINGLE_MODE_FLUTTER, ModeKind.COUPLED_MODE_FLUTTER}
        assert not flutter & set(found.kind)
        assert kind is None or kind in found.kind


def test_the_false_flutter_is_named_coupled_mode_flutter() -> None:
    scenario = load(PAPER / "double_l_paper_kinematics.toml")
    model = OptionModel(scenario, scenario.options[0])
    found = modes(model.plant(varied(Situation.of_design(scenario), "height", 0.019)))
    assert ModeKind.COUPLED_MODE_FLUTTER in found.kind
    # Errata, Sec. 3.3: omega^2 = 1533 +- 281i for a mass of 2 F_L / g at 19 mm.
    squared = -(found.s[found.kind.index(ModeKind.COUPLED_MODE_FLUTTER)] ** 2)
    assert squared.real == pytest.approx(1533.0, abs=0.5)
    assert abs(squared.imag) == pytest.approx(281.0, abs=0.5)
