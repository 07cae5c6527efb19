"""Published quadratic programs, with optima from the literature; and programs without a solution made from them."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from maglev_ctrl.errors import Status
from maglev_ctrl.synthesis.predictive.kkt import kkt_residual, proves_infeasible, proves_unbounded
from maglev_ctrl.synthesis.predictive.quadratic import quadratic_program

PATH = Path(__file__).parents[3] / "shared" / "data" / "external" / "qp.json"


@cache
def _cases():
    return json.loads(PATH.read_text())["cases"] if PATH.exists() else []


def _case(index):
    if not _cases():
        pytest.skip("the collection qp.json is not part of this checkout")
    return _cases()[index]


def _bounds(case):
    lower = np.array([-np.inf if v is None else v for v in case["l"]], dtype=float)
    upper = np.array([np.inf if v is None else v for v in case["u"]], dtype=float)
    return lower, upper


INDICES = range(max(len(_cases()), 1))


@pytest.mark.parametrize("index", INDICES)
def test_case(index):
    case = _case(index)
    solution = quadratic_program(case["P"], case["q"], case["A"], case["l"], case["u"])
    assert solution.status is Status.SOLVED, case["id"]
    assert solution.residual.largest <= 1e-12, case["id"]
    published = case["published_optimum"]
    # the constant is subtracted where it dwarfs the optimum; published optima carry 10 digits
    scale = max(abs(published), abs(case["constant"]), 1e-300)
    assert abs(solution.objective + case["constant"] - published) <= 1e-9 * scale, case["id"]
    reference = np.array(case["x_clarabel"])
    assert np.max(np.abs(solution.x - reference)) <= 1e-5 * max(1.0, np.max(np.abs(reference))), case["id"]


@pytest.mark.parametrize("index", INDICES)
def test_a_mutant_is_caught(index):
    """Another gradient, or multipliers of the other sign, is no solution."""
    case = _case(index)
    P, q, A, bounds = np.array(case["P"]), np.array(case["q"]), np.array(case["A"]), _bounds(case)
    solution = quadratic_program(P, q, A, *bounds)
    assert kkt_residual(P, q, A, bounds, x=solution.x, y=solution.y).largest <= 1e-12
    if np.any(solution.y):
        assert kkt_residual(P, q, A, bounds, x=solution.x, y=-solution.y).largest > 1e-3
    moved = solution.x + 1e-3 * (1.0 + np.abs(solution.x))
    assert kkt_residual(P, q, A, bounds, x=moved, y=solution.y).largest > 1e-6


@pytest.mark.parametrize("index", INDICES)
def test_made_infeasible(index):
    """Two rows added that exclude one another: INFEASIBLE with a certificate, which the original does not admit."""
    case = _case(index)
    A, (lower, upper) = np.array(case["A"]), _bounds(case)
    n = A.shape[1]
    more = np.vstack([A, np.ones((1, n)), np.ones((1, n))])
    low, high = np.append(lower, [3.0, -np.inf]), np.append(upper, [np.inf, 2.9])
    solution = quadratic_program(case["P"], case["q"], more, low, high)
    assert solution.status is Status.INFEASIBLE, case["id"]
    assert proves_infeasible(more, low, high, solution.certificate)
    assert not proves_infeasible(A, lower, upper, solution.certificate[:-2])


@pytest.mark.parametrize("index", INDICES)
def test_made_unbounded(index):
    """A free direction without curvature added: UNBOUNDED with a ray."""
    case = _case(index)
    A, (lower, upper) = np.array(case["A"]), _bounds(case)
    n = A.shape[1]
    P = np.zeros((n + 1, n + 1))
    P[:n, :n] = case["P"]
    q, wider = np.append(case["q"], 1.0), np.hstack([A, np.zeros((A.shape[0], 1))])
    solution = quadratic_program(P, q, wider, lower, upper)
    assert solution.status is Status.UNBOUNDED, case["id"]
    assert proves_unbounded(P, q, wider, (lower, upper), solution.certificate)


@pytest.mark.parametrize("index", INDICES)
def test_degenerate_rows_and_scales(index):
    """Every row twice, rows scaled by a million: the same optimum."""
    case = _case(index)
    A, (lower, upper) = np.array(case["A"]), _bounds(case)
    scales = np.where(np.arange(A.shape[0]) % 2 == 0, 1e6, 1e-6)[:, None]
    solution = quadratic_program(
        case["P"], case["q"], np.vstack([A, scales * A]),
        np.append(lower, scales[:, 0] * lower), np.append(upper, scales[:, 0] * upper),
    )  # fmt: skip
    assert solution.status is Status.SOLVED, case["id"]
    scale = max(abs(case["published_optimum"]), abs(case["constant"]), 1e-300)
    assert abs(solution.objective + case["constant"] - case["published_optimum"]) <= 1e-8 * scale, case["id"]
