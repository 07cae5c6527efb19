"""Polytopes with a known limit of quadratic stability, and a loop with a known delay margin."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from maglev_ctrl.analysis.loops import Loop
from maglev_ctrl.analysis.margins import loop_margins
from maglev_ctrl.synthesis.lmi import parameter_dependent_stability, quadratic_stability
from maglev_ctrl.synthesis.lmi.dual import refutes

PATH = Path(__file__).parents[3] / "shared" / "data" / "external" / "polytopic.json"


@cache
def _cases():
    return {case["id"]: case for case in json.loads(PATH.read_text())["cases"]} if PATH.exists() else {}


def _polytopes():
    return [
        (case["id"], *check) for case in _cases().values() if "checks" in case for check in case["checks"]
    ]  # fmt: skip


def _loops(case, a):
    return [np.array(case["A1"]), np.array([[-1.0, -a], [1.0 / a, -1.0]])]


def _case(name):
    if not _cases():
        pytest.skip("the collection polytopic.json is not part of this checkout")
    return _cases()[name]


@pytest.mark.parametrize("index", range(max(len(_polytopes()), 1)))
def test_quadratic_stability_is_decided_with_a_proof_either_way(index):
    name, a, quadratic, _ = _polytopes()[index] if _polytopes() else ("dayawansa-martin", 0.0, False, False)
    case = _case(name)
    loops = _loops(case, a)
    found = quadratic_stability(loops)
    assert found.stable is quadratic
    if quadratic:
        assert found.proof.holds and found.rate > 0.0
        # The rate proved is a rate of every blend, so of the middle one too.
        assert found.rate <= -np.max(np.linalg.eigvals(0.5 * (loops[0] + loops[1])).real)
    else:
        assert refutes(found.refutation.Z, loops)
    # Constant blends are stable for every a: trace -2, determinant 1 + ((1-l) + l a)((1-l) + l/a) > 0.
    assert parameter_dependent_stability(loops).stable is True


def test_both_sides_of_the_limit_are_proved_within_a_millionth():
    case = _case("dayawansa-martin")
    limit = case["a_quadratic_limit"]
    assert limit == pytest.approx(3.0 + np.sqrt(8.0), rel=1e-14)
    assert quadratic_stability(_loops(case, limit * (1.0 - 1e-5))).stable is True
    assert quadratic_stability(_loops(case, limit * (1.0 + 1e-6))).stable is False


def test_a_mutant_is_caught():
    case = _case("dayawansa-martin")
    # a for 1/a: both vertices then have a negative definite symmetric part, and P = I serves every a.
    mutant = [np.array(case["A1"]), np.array([[-1.0, -6.0], [6.0, -1.0]])]
    assert quadratic_stability(mutant).stable is True
    found = quadratic_stability(_loops(case, 6.0))
    assert not refutes(found.refutation.Z, _loops(case, 5.0))
    assert not refutes(-found.refutation.Z, _loops(case, 6.0))


def _delays():
    return [name for name, case in _cases().items() if "tau_max" in case]


@pytest.mark.parametrize("name", _delays() or ["delay-scalar-k1.0"])
def test_a_scalar_loop_bears_the_delay_of_the_formula(name):
    case = _case(name)
    k = case["k"]
    margins = loop_margins(Loop([[0.0]], [[1.0]], [[k]], [[0.0]], ("force",)))
    found = margins.channels[0].delay.value
    assert found == pytest.approx(case["tau_max"], rel=1e-9)
    assert found == pytest.approx(np.pi / (2.0 * k), rel=1e-9)
