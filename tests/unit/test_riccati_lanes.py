"""The compiled engine for grids of Riccati equations against the one of NumPy and against single solutions."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("numba", reason="the extra fast (numba) is not installed")

from maglev_ctrl.kernels.riccati_lanes import many_by_doubling
from maglev_ctrl.synthesis.doubling import relative_residual
from maglev_ctrl.synthesis.riccati_batch import riccati_batch


def _points(count, n, seed=0):
    rng = np.random.default_rng(seed)
    return rng.standard_normal((count, n, n)), rng.standard_normal((count, n, 2))


@pytest.mark.parametrize(("count", "n"), [(1, 1), (33, 2), (70, 5)])
def test_the_compiled_engine_equals_the_plain_one(count, n):
    A, B = _points(count, n)
    plain, fast = (riccati_batch(A, B, np.eye(n), np.eye(2), backend=backend) for backend in ("numpy", "fast"))
    assert np.all(fast.solved)
    assert np.max(fast.residual) <= 1e-11
    size = np.linalg.norm(plain.P, axis=(1, 2))
    assert np.max(np.linalg.norm(fast.P - plain.P, axis=(1, 2)) / size) < 1e-8
    assert np.array_equal(fast.P, np.swapaxes(fast.P, 1, 2))


def test_residuals_are_those_of_the_equation_and_a_mutant_is_seen():
    A, B = _points(20, 4, seed=1)
    G, Q = B @ np.swapaxes(B, 1, 2), np.broadcast_to(np.eye(4), A.shape)
    P, residual, rest = many_by_doubling(A, G, Q)
    by_hand = relative_residual(A, G, Q, P)
    assert np.max(np.abs(residual - by_hand)) < 1e-13
    assert np.max(rest) < 1e-3
    wrong, _, _ = many_by_doubling(A, 2.0 * G, Q)
    assert np.min(relative_residual(A, G, Q, wrong)) > 1e-3


def test_a_point_without_solution_harms_no_other():
    A, B = np.array([np.diag([1.0, -1.0]), np.diag([-2.0, 1.0]), np.full((2, 2), 1e300)]), [[0.0], [1.0]]
    found = riccati_batch(A, B, np.eye(2), [[1.0]], backend="fast")
    assert found.solved.tolist()[:2] == [False, True]
    assert np.all(np.isnan(found.P[0]))
    assert found.P[1, 1, 1] == pytest.approx(1.0 + np.sqrt(2.0), rel=1e-12)


def test_an_unknown_backend_is_named():
    with pytest.raises(ValueError, match="backend: expected"):
        riccati_batch([[1.0]], [[1.0]], [[1.0]], [[1.0]], backend="gpu")
