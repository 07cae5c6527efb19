"""Frequency weightings of ISO 2631-1 against the standard's tables."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from maglev_ctrl.analysis.response.weighting import TABLE, weighting, weighting_from_parameters

PATH = Path(__file__).parents[3] / "shared" / "data" / "external" / "iso2631.json"


@cache
def _cases():
    return json.loads(PATH.read_text())["cases"] if PATH.exists() else []


def _worst(found, case):
    """Largest deviation from the table's rows, in units of the one per cent allowed."""
    rows = case["rows"]
    printed = np.array([row["published_x1000"] for row in rows]) / 1000.0
    gains = np.abs(found.response(np.array([row["f_nominal"] for row in rows], dtype=float)))
    return float(np.max(np.abs(gains / printed - 1.0)) / 0.01)


@pytest.mark.parametrize("index", range(max(len(_cases()), 1)))
def test_case(index, record_property):
    if not _cases():
        pytest.skip("the collection iso2631.json is not part of this checkout")
    case = _cases()[index]
    given = weighting_from_parameters(**case["params"], name=case["weighting"])
    record_property("error", float(_worst(given, case)) / 100.0)
    record_property("allowed", 0.01)
    assert _worst(given, case) < 1.0
    if case["weighting"] in TABLE:
        own = weighting(case["weighting"])
        assert _worst(own, case) < 1.0
        analytic = np.array([row["analytic_at_nominal_x1000"] for row in case["rows"]]) / 1000.0
        f = np.array([row["f_nominal"] for row in case["rows"]], dtype=float)
        np.testing.assert_allclose(np.abs(own.response(f)), analytic, rtol=1e-9)
        A, B, C, D = own.state_space()
        pencil = 2j * np.pi * f[:, None, None] * np.eye(len(A)) - A
        realised = (C @ np.linalg.solve(pencil, np.broadcast_to(B + 0j, (len(f), *B.shape))) + D)[:, 0, 0]
        np.testing.assert_allclose(realised, own.response(f), rtol=1e-8, atol=1e-11)


@pytest.mark.parametrize("mutant", [{"f3": None}, {"Q4": 0.7071}, {"f5": 3.35, "f6": 2.37}, {"f1": 0.5}])
def test_a_mutant_is_caught(mutant):
    if not _cases():
        pytest.skip("the collection iso2631.json is not part of this checkout")
    case = next(case for case in _cases() if case["weighting"] == "Wk")
    assert _worst(weighting_from_parameters(**{**case["params"], **mutant}), case) > 2.0
