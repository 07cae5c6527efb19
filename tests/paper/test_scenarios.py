"""The scenarios find what theory says they must: v*, the false flutter band, none with true kinematics, tongues.

Values: corrected equations of the paper (the errata), Secs. 2.1 and 3.3.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from maglev_ctrl.analysis.floquet import Floquet, floquet
from maglev_ctrl.analysis.modes import ModeKind, modes
from maglev_ctrl.errors import Agreement
from maglev_ctrl.guideway import passing_frequency
from maglev_ctrl.scenario import Scenario, load
from maglev_ctrl.study.situation import OptionModel, Situation
from maglev_ctrl.study.sweeps import sweep, sweep_values, varied
from maglev_ctrl.systems import modulate
from maglev_ctrl.vehicle import linearize, stiffness_modulation

LIBRARY = Path(__file__).resolve().parents[2] / "scenarios"
PAPER = LIBRARY / "paper"
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
    scenario = load(PAPER / "double_l_corner_image.toml")
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


def test_a_damper_feeds_the_false_flutter_and_calms_the_true_vehicle() -> None:
    """Ziegler's paradox needs a circulatory matrix; the corner's field has none."""
    for file, growing in (("double_l_paper_kinematics.toml", True), ("double_l_corner_image.toml", False)):
        scenario = load(PAPER / file)
        record = next(one for one in scenario.options if one.name == "both_dampers")
        found = modes(OptionModel(scenario, record).plant(Situation.of_design(scenario)))
        assert (found.spectral_abscissa > 0.0) == growing


def girders(option: str, speed: float, depth: float) -> Floquet:
    """One option of the girder study at a speed and a depth of modulation."""
    scenario = load(LIBRARY / "periodic/girder_passing.toml")
    record = next(one for one in scenario.options if one.name == option)
    vehicle, balanced = OptionModel(scenario, record).balance(varied(Situation.of_design(scenario), "speed", speed))
    K_cos, K_sin = stiffness_modulation(vehicle, balanced, wavelength=24.768, harmonics=(1.0,))
    plant = linearize(vehicle, balanced)
    return floquet(modulate(plant, depth * K_cos, depth * K_sin, frequency=passing_frequency(speed, 24.768)))


@pytest.fixture(scope="module")
def girder_modes() -> dict[str, float]:
    """Natural frequencies of the bare vehicle by hand, rad/s: symmetric and antisymmetric pairs of bogies."""
    primary, secondary, bogie, half = 30e3 * 9.80665 / 0.1 / 2.0, 300e3, 6e3, 8.0
    found = {}
    for name, inertia in (("heave", 18e3 / 2.0), ("pitch", 8.86e5 / (2.0 * half**2))):
        K = np.array([[secondary / inertia, -secondary / inertia],
                      [-secondary / bogie, (primary + secondary) / bogie]])  # fmt: skip
        low, high = np.sqrt(np.sort(np.linalg.eigvals(K).real))
        found[f"car {name}"], found[f"bogies in {name}"] = float(low), float(high)
    return found


def test_girders_shake_the_vehicle_where_the_sum_of_two_frequencies_passes(girder_modes: dict[str, float]) -> None:
    """v = L (w_i + w_j) / 2 pi. Thresholds follow from Floquet theory; here only their order is asked for."""
    bogies = 24.768 * (girder_modes["bogies in heave"] + girder_modes["bogies in pitch"]) / (2.0 * math.pi)
    car = 24.768 * (girder_modes["car heave"] + girder_modes["car pitch"]) / (2.0 * math.pi)
    assert 100 / 3.6 < car < bogies < 550 / 3.6  # both lie inside the operating range
    for speed, option, stable in (
        (bogies, "weak_windings", False),
        (1.06 * bogies, "weak_windings", True),  # the mutant of the formula: 6 per cent off, nothing resonates
        (bogies, "windings", True),
        (car, "weak_windings", False),
        (car, "windings_and_dampers", True),
    ):
        found = girders(option, speed, 0.10)
        assert found.agreement is Agreement.AGREED
        assert found.stable is stable, f"{option} at {speed * 3.6:.1f} km/h: {found.growth_rate}"
    assert girders("windings", car, 0.20).stable is False  # twice the depth is required: this option fails there
