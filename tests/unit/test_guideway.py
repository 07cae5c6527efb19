from __future__ import annotations

from math import pi

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from maglev_ctrl.guideway import Modulation, passing_frequency, resonance_speeds

POSITIVE = st.floats(0.1, 300.0)


@given(speed=POSITIVE, wavelength=POSITIVE)
def test_one_period_passes_in_wavelength_over_speed(speed: float, wavelength: float) -> None:
    period = 2 * pi / float(passing_frequency(speed, wavelength))
    assert period * speed == pytest.approx(wavelength, rel=1e-14)
    assert float(passing_frequency(-speed, wavelength)) == float(passing_frequency(speed, wavelength))


@given(first=POSITIVE, second=POSITIVE, wavelength=POSITIVE, orders=st.integers(1, 4))
def test_at_every_resonance_speed_the_guideway_passes_at_the_combination(
    first: float, second: float, wavelength: float, orders: int
) -> None:
    omega = (first, second)
    for one in resonance_speeds(omega, wavelength, orders=orders):
        i, j = one.modes
        total = {"parametric": 2 * omega[i], "sum": omega[i] + omega[j], "difference": abs(omega[i] - omega[j])}
        assert float(passing_frequency(one.speed, wavelength)) * one.order == pytest.approx(total[one.kind], rel=1e-12)


def test_a_period_in_place_of_a_frequency_is_caught() -> None:
    """The paper's wording, a period that is a multiple of the natural frequencies, is another speed."""
    omega, wavelength = 2 * pi * 1.5, 25.0
    (speed,) = (one.speed for one in resonance_speeds([omega], wavelength))
    assert speed == pytest.approx(2 * 1.5 * 25.0)
    mutant = wavelength / (2 * omega)  # period = 2 w
    assert abs(speed - mutant) > 1.0


def test_resonances_are_complete_sorted_and_cut() -> None:
    found = resonance_speeds([5.0, 8.0, 13.0], 10.0, orders=3)
    assert len(found) == (3 + 2 * 3) * 3
    assert [one.speed for one in found] == sorted(one.speed for one in found)
    cut = resonance_speeds([5.0, 8.0, 13.0], 10.0, orders=3, upper=found[10].speed)
    assert [one.speed for one in cut] == [one.speed for one in found[: len(cut)]]
    assert cut[-1].speed == found[10].speed


def test_equal_or_zero_frequencies_have_no_resonance_at_rest() -> None:
    found = resonance_speeds([0.0, 4.0, 4.0], 10.0)
    assert all(one.speed > 0.0 for one in found)
    assert {(one.kind, one.modes) for one in found} == {
        ("parametric", (1, 1)),
        ("parametric", (2, 2)),
        ("sum", (0, 1)),
        ("sum", (0, 2)),
        ("sum", (1, 2)),
        ("difference", (0, 1)),
        ("difference", (0, 2)),
    }


def test_a_modulation_repeats_with_its_mean_at_one() -> None:
    joints = Modulation(wavelength=2.0, depth=0.2, harmonics=(1.0, -0.5, 0.25), name="joints", source="drawing 7")
    x = np.linspace(0.0, 2.0, 200, endpoint=False)
    np.testing.assert_allclose(joints.at(x), joints.at(x + 2.0), atol=1e-13)
    assert float(joints.at(x).mean()) == pytest.approx(1.0, abs=1e-14)
    spectrum = np.fft.rfft(joints.at(x)).real / 100
    np.testing.assert_allclose(spectrum[1:5], [0.2, -0.1, 0.05, 0.0], atol=1e-14)
    assert float(joints.frequency(10.0)) == pytest.approx(10 * pi)
    assert joints.at(0.3).shape == ()


def test_wrong_use_is_refused() -> None:
    with pytest.raises(ValueError, match="wavelength: expected a positive length in m, got 0"):
        passing_frequency(10.0, 0.0)
    with pytest.raises(ValueError, match="wavelength"):
        Modulation(wavelength=-1.0, depth=0.1)
    with pytest.raises(ValueError, match="depth: expected a fraction that is not negative, got -0"):
        Modulation(wavelength=1.0, depth=-0.1)
    for harmonics in ((), (0.0, 0.0), (np.nan,)):
        with pytest.raises(ValueError, match="harmonics: expected at least one"):
            Modulation(wavelength=1.0, depth=0.1, harmonics=harmonics)
    with pytest.raises(ValueError, match="frequencies"):
        resonance_speeds([-1.0], 10.0)
    with pytest.raises(ValueError, match="frequencies"):
        resonance_speeds([[1.0]], 10.0)
    with pytest.raises(ValueError, match="orders: expected at least 1, got 0"):
        resonance_speeds([1.0], 10.0, orders=0)
