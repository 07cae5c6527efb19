"""Weightings: printed values, sections left out, realisations, comfort classes."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg

from maglev_ctrl.analysis.response.weighting import (
    TABLE,
    comfort_class,
    vector_sum,
    weighting,
    weighting_from_parameters,
)


def _formula(s, f1, f2, f3=None, f4=None, Q4=None, f5=None, Q5=None, f6=None, Q6=None):
    """The transfer function as the standard writes it."""
    w1, w2 = 2 * np.pi * f1, 2 * np.pi * f2
    value = 1 / (1 + np.sqrt(2) * w1 / s + (w1 / s) ** 2) / (1 + np.sqrt(2) * s / w2 + (s / w2) ** 2)
    if f4:
        w4 = 2 * np.pi * f4
        value = value * (1 + (s / (2 * np.pi * f3) if f3 else 0)) / (1 + s / (Q4 * w4) + (s / w4) ** 2)
    if f5:
        w5, w6 = 2 * np.pi * f5, 2 * np.pi * f6
        value = value * (1 + s / (Q5 * w5) + (s / w5) ** 2) / (1 + s / (Q6 * w6) + (s / w6) ** 2) * (w5 / w6) ** 2
    return value


@pytest.mark.parametrize("name", sorted(TABLE))
def test_every_weighting_is_the_standards_formula_in_three_forms(name):
    f = np.geomspace(1e-3, 1e3, 61)
    s = 2j * np.pi * f
    found = weighting(name)
    expected = _formula(s, **TABLE[name])
    np.testing.assert_allclose(found.response(f), expected, rtol=1e-12)
    A, B, C, D = found.state_space()
    realised = np.array([(C @ np.linalg.solve(one * np.eye(len(A)) - A, B) + D)[0, 0] for one in s])
    np.testing.assert_allclose(realised, expected, rtol=1e-6, atol=1e-11)
    fractions = (1 / (s[:, None] - found.poles)) @ found.residues() + found.through
    np.testing.assert_allclose(fractions, expected, rtol=1e-6, atol=1e-11)
    reach, watch = (scipy.linalg.solve_continuous_lyapunov(a, -load) for a, load in ((A, B @ B.T), (A.T, C.T @ C)))
    np.testing.assert_allclose(reach, watch, atol=1e-8 * np.max(np.abs(reach)))  # balanced


@pytest.mark.parametrize(
    ("name", "frequency", "printed"),
    [("Wk", 8.0, 1.036), ("Wk", 16.0, 0.768), ("Wd", 1.0, 1.011), ("Wd", 4.0, 0.512),
     ("Wf", 0.2, 0.992), ("Wf", 0.08, 0.461)],
)  # fmt: skip
def test_values_of_the_standards_tables(name, frequency, printed):
    gain = abs(weighting(name).response(frequency))
    assert gain == pytest.approx(printed, rel=0.012)
    assert abs(weighting(name).response(1.3 * frequency)) != pytest.approx(printed, rel=0.004)


def test_missing_and_infinite_corners_are_left_out():
    flat = weighting_from_parameters()
    assert flat.response(5.0) == 1.0
    assert flat.through == 1.0
    some = weighting_from_parameters(f1=0.4, f2=100.0, f3=float("inf"), f4=None)
    assert abs(some.response(6.0)) == pytest.approx(1.0, abs=1e-3)
    step = weighting_from_parameters(f5=2.0, Q5=0.9, f6=4.0, Q6=0.9)
    assert step.at(0.0).real == pytest.approx(0.25)
    assert step.through == 1.0
    real = weighting_from_parameters(f4=2.0, Q4=0.3, f3=5.0)  # two real poles
    s = 2j * np.pi * 1.7
    w3, w4 = 10 * np.pi, 4 * np.pi
    assert real.at(s) == pytest.approx((1 + s / w3) / (1 + s / (0.3 * w4) + (s / w4) ** 2))
    assert real.relative_degree == 1


@pytest.mark.parametrize(
    ("params", "told"),
    [({"f1": -1.0}, "f1: expected a positive"), ({"f4": 2.0}, "Q4: expected"), ({"f3": 2.0}, "f4: expected"),
     ({"f5": 2.0, "Q5": 1.0}, "f6: expected")],
)  # fmt: skip
def test_sections_that_are_not_complete_are_refused(params, told):
    with pytest.raises(ValueError, match=told):
        weighting_from_parameters(**params)
    with pytest.raises(ValueError, match="expected one of"):
        weighting("Wx")


def test_comfort_classes_and_vector_sum():
    words = [comfort_class(a) for a in (0.3, 0.4, 0.7, 0.9, 1.3, 1.8, 2.2, 3.0)]
    assert words[0] == "not uncomfortable"
    assert words[1] == "a little uncomfortable"
    assert words[2] == "fairly uncomfortable"
    assert words[3] == "fairly uncomfortable to uncomfortable"
    assert words[4] == "uncomfortable to very uncomfortable"
    assert words[5] == "very uncomfortable"
    assert words[6] == "very uncomfortable to extremely uncomfortable"
    assert words[7] == "extremely uncomfortable"
    assert comfort_class(float("nan")) == "not evaluated"
    assert vector_sum([1.0, 2.0, 2.0]) == 3.0
    assert vector_sum([1.0, 1.0], [1.4, 1.0]) == pytest.approx(np.sqrt(2.96))
