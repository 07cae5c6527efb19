"""CAREX: benchmark Riccati equations with reference solutions of 45 digits."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from maglev_ctrl.errors import Agreement, Status
from maglev_ctrl.synthesis.riccati import riccati_continuous

PATH = Path(__file__).parents[3] / "shared" / "data" / "external" / "carex.json"
EPS = float(np.finfo(float).eps)


@cache
def _cases():
    return json.loads(PATH.read_text())["cases"] if PATH.exists() else []


def _complex(values):
    return np.array([complex(v["re"], v["im"]) if isinstance(v, dict) else complex(v) for v in values])


def _error(found, expected):
    return np.linalg.norm(found - expected) / np.linalg.norm(expected)


def _data(case):
    return tuple(np.array(case[key], dtype=float) for key in "ABQR")


@pytest.mark.parametrize("index", range(max(len(_cases()), 1)))
def test_case(index, record_property):
    if not _cases():
        pytest.skip("the collection carex.json is not part of this checkout")
    case = _cases()[index]
    solution = riccati_continuous(*_data(case))
    assert solution.status is Status.SOLVED, case["id"]
    assert solution.agreed is Agreement.AGREED, case["id"]
    expected = np.array(case["X_ref"], dtype=float)
    # The collection allows max(1e-10, 100 x the error of a plain solver). Refinement in extended precision leaves
    # only the rounding of the stored answer, whatever the condition of the case.
    assert _error(solution.P, expected) <= max(4.0 * EPS, solution.forward_error), case["id"]
    of_gain = _error(solution.gain, np.array(case["K_ref"], dtype=float))
    record_property("error", float(of_gain))
    record_property("allowed", 8.0 * EPS)
    assert of_gain <= 8.0 * EPS, case["id"]
    poles = _complex(case["closed_loop_eigs"])
    distance = np.abs(solution.closed_loop_poles[:, None] - poles[None, :]).min(axis=1)
    # Eigenvalues of A - B K computed in double precision; multiple poles split by the root of the rounding.
    assert np.max(distance) <= 1e-6 * np.max(np.abs(poles)), case["id"]


def test_a_mutant_is_caught():
    if not _cases():
        pytest.skip("the collection carex.json is not part of this checkout")
    case = next(c for c in _cases() if c["n"] == 9)
    A, B, Q, R = _data(case)
    mutant = riccati_continuous(A.T, B, Q, R)
    assert _error(mutant.P, np.array(case["X_ref"], dtype=float)) > 1e-6
