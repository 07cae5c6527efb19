"""DAREX: benchmark discrete Riccati equations with reference solutions of 45 digits."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from maglev_ctrl.errors import Agreement, Status
from maglev_ctrl.synthesis.riccati_discrete import riccati_discrete

PATH = Path(__file__).parents[3] / "shared" / "data" / "external" / "darex.json"
EPS = float(np.finfo(float).eps)
NEAR = 0.05


@cache
def _cases():
    return json.loads(PATH.read_text())["cases"] if PATH.exists() else []


def _complex(values):
    return np.array([complex(v["re"], v["im"]) if isinstance(v, dict) else complex(v) for v in values])


def _error(found, expected, least=0.0):
    return np.linalg.norm(found - expected) / max(np.linalg.norm(expected), least)


def _data(case):
    return tuple(np.array(case[key], dtype=float) for key in "ABQRS")


@pytest.mark.parametrize("index", range(max(len(_cases()), 1)))
def test_case(index):
    if not _cases():
        pytest.skip("the collection darex.json is not part of this checkout")
    case = _cases()[index]
    A, B, *_ = _data(case)
    solution = riccati_discrete(*_data(case))
    assert solution.status is Status.SOLVED, case["id"]
    assert solution.agreed is Agreement.AGREED, case["id"]
    # The collection allows max(1e-10, 100 x the error of a plain solver). Refinement in extended precision leaves
    # only the rounding of the stored answer, whatever the condition of the case.
    assert _error(solution.P, np.array(case["X_ref"], dtype=float)) <= 4.0 * EPS, case["id"]
    # Two cases have the gain zero; their reference holds 1e-57.
    assert _error(solution.gain, np.array(case["K_ref"], dtype=float), least=1e-30) <= 8.0 * EPS, case["id"]
    poles = _complex(case["closed_loop_eigs"])
    # Dead beat: k poles in one place, known (in the reference too) to the k-th root of the rounding only.
    multiple = np.sum(np.abs(poles[:, None] - poles[None, :]) < NEAR, axis=1)
    distance = np.min(np.abs(poles[:, None] - solution.closed_loop_poles[None, :]), axis=1)
    size = np.linalg.norm(A - B @ solution.gain, 2)
    assert np.all(distance <= 10.0 * size * (10.0 * EPS) ** (1.0 / multiple)), case["id"]
    for pole in poles:  # no multiplicity harms this: the reference pole is one of a closed loop next to ours
        rest = np.linalg.svd(A - B @ solution.gain - pole * np.eye(len(A)), compute_uv=False)[-1]
        assert rest <= 1e-12 * size, case["id"]


@pytest.mark.parametrize("index", range(max(len(_cases()), 1)))
def test_a_mutant_is_caught(index):
    if not _cases():
        pytest.skip("the collection darex.json is not part of this checkout")
    case = _cases()[index]
    A, B, Q, R, S = _data(case)
    mutant = riccati_discrete(A, B, Q + 1e-6 * np.eye(len(A)) * np.linalg.norm(Q), R, S)
    assert not _error(mutant.P, np.array(case["X_ref"], dtype=float)) < 1e-9
