"""Norms of systems: published values, closed forms and systems whose norm is infinite."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from maglev_ctrl.analysis.norms import h2_norm, h_infinity_norm, l2_norm, l_infinity_norm
from maglev_ctrl.errors import Agreement

PATH = Path(__file__).parents[3] / "shared" / "data" / "external" / "norms.json"
NORMS = {"h2": h2_norm, "hinf": h_infinity_norm, "linf": l_infinity_norm, "L2": l2_norm}


@cache
def _cases():
    return json.loads(PATH.read_text())["cases"] if PATH.exists() else []


def _data(case):
    n = len(case["A"])
    D = np.array(case["D"], dtype=float)
    return (
        np.array(case["A"], dtype=float).reshape(n, n), np.array(case["B"], dtype=float).reshape(n, D.shape[1]),
        np.array(case["C"], dtype=float).reshape(D.shape[0], n), D,
    )  # fmt: skip


def _stable(case):
    poles = np.linalg.eigvals(_data(case)[0])
    return bool(np.all(poles.real < 0.0 if case.get("dt") is None else np.abs(poles) < 1.0))


def _expected(case):
    """(norm, value, relative tolerance); a peak over the axis of an unstable system is its L-infinity norm."""
    peak = "hinf" if _stable(case) else "linf"
    for name, value in case.get("expect", {}).items():
        yield name, float(value), 1e-9
    for key, name in (("h2", "h2"), ("hinf", peak), ("computed_L2_by_quadrature", "L2")):
        if key in case:
            yield name, case[key], 1e-9
    for key, value in case.get("published", {}).items():
        if key in ("h2", "hinf", "L2"):
            yield {"hinf": peak}.get(key, key), value, case.get("rel_tol_published", 1e-6)


@pytest.mark.parametrize("index", range(max(len(_cases()), 1)))
def test_case(index):
    if not _cases():
        pytest.skip("the collection norms.json is not part of this checkout")
    case = _cases()[index]
    expected = list(_expected(case))
    assert expected
    for name, value, tolerance in expected:
        found = NORMS[name](*_data(case), dt=case.get("dt"))
        assert found.agreed is Agreement.AGREED, (case["id"], name, found)
        if np.isinf(value):
            assert np.isinf(found.value), (case["id"], name, found)
        else:
            assert abs(found.value - value) <= tolerance * value, (case["id"], name, found)
    if "peak" in case.get("published", {}):
        found = l_infinity_norm(*_data(case), dt=case.get("dt"))
        assert found.frequency == pytest.approx(case["published"]["peak"], rel=1e-4)
    if not _stable(case):
        for name in ("h2", "hinf"):
            assert np.isinf(NORMS[name](*_data(case), dt=case.get("dt")).value)


def test_a_mutant_is_caught():
    if not _cases():
        pytest.skip("the collection norms.json is not part of this checkout")
    case = next(case for case in _cases() if case["id"] == "pc-G4")
    A, B, C, D = _data(case)
    mutant = h2_norm(A.T, B, C, D)
    assert abs(mutant.value - case["h2"]) > 1e-3 * case["h2"]
