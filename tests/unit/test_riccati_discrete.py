"""Discrete Riccati equations: the literature's hard cases in long digits, closed forms, honest failure."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest

from maglev_ctrl.errors import Agreement, ModelError, Status
from maglev_ctrl.synthesis.riccati_discrete import riccati_discrete
from maglev_ctrl.synthesis.riccati_discrete_seeds import FALLBACK, PRIMARY, relative_residual

EPS = float(np.finfo(float).eps)


def _newton_in_long_digits(A, B, Q, R, N, X):
    """Hewer's iteration in 50 digits from X; shares nothing with the code under test."""
    with mpmath.workdps(50):
        a, b, q, r, n, x = (mpmath.matrix(M.tolist()) for M in (A, B, Q, R, N, X))
        for _ in range(6):
            gain = (r + b.T * x * b) ** -1 * (b.T * x * a + n.T)
            power = a - b * gain
            step = a.T * x * a - x + q - (a.T * x * b + n) * gain
            for _ in range(24):
                step, power = step + power.T * step * power, power * power
                if mpmath.mnorm(power, "f") < mpmath.mpf(10) ** -50:
                    break
            x = x + step
        return np.array(x.tolist(), dtype=float), np.array(gain.tolist(), dtype=float)


def _manufactured(seed, shape):
    """Data whose solution is known to be stabilising: R = W - B'XB is indefinite, N is not zero."""
    rng = np.random.default_rng(seed)
    n, m = shape
    A, B = rng.standard_normal((n, n)), rng.standard_normal((n, m))
    if seed % 2:
        A[:, 0] = 0.0
    X = rng.standard_normal((n, n))
    X = X + X.T + n * np.eye(n)
    gain = riccati_discrete(A, B, np.eye(n), np.eye(m)).gain  # any stabilising gain
    W = np.diag(rng.uniform(0.5, 2.0, m))
    R, N = W - B.T @ X @ B, gain.T @ W - A.T @ X @ B
    Q = X - A.T @ X @ A + gain.T @ W @ gain
    return (A, B, 0.5 * (Q + Q.T), 0.5 * (R + R.T), N), X, gain


def _literature():
    mirror = np.eye(3) - 2.0 / 3.0 * np.ones((3, 3))
    spread = 1e6
    return {
        "cheap and dear inputs": (
            np.diag([0.9512, 0.9048]), [[4.877, 4.877], [-1.1895, 3.569]], np.diag([0.005, 0.02]),
            np.diag([1.0 / (3.0 * spread), 3.0 * spread]), np.zeros((2, 2)),
        ),
        "three scalar equations behind a mirror": (
            mirror @ np.diag([0.0, 1.0, 3.0]) @ mirror, np.eye(3), spread * np.eye(3), spread * np.eye(3),
            np.zeros((3, 3)),
        ),
        "a pole 1e-8 from the circle": (
            [[1.0 - 1e-8, 0, 0, 0], [1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]], [[1e-8], [0], [0], [0]],
            np.diag([0.0, 0.0, 0.0, 1.0]), [[0.25]], np.zeros((4, 1)),
        ),
        "slow and fast": (
            [[0.999999, 1.0, 0.0], [0.0, 1.0, 1e-3], [0.0, 0.0, 1e-6]], [[0.0], [1e-6], [1.0]],
            np.diag([1.0, 0.0, 0.0]), [[1e-8]], np.zeros((3, 1)),
        ),
        "free commands": (
            np.diag([2.0, 0.5, -1.5]) + np.eye(3, k=1), [[1.0, 0.0], [0.0, 1.0], [1.0, 1.0]], np.eye(3),
            np.zeros((2, 2)), np.zeros((3, 2)),
        ),
    }  # fmt: skip


@pytest.mark.parametrize("name", list(_literature()))
def test_hard_cases_are_right_to_the_last_digit(name):
    data = tuple(np.array(x, dtype=float) for x in _literature()[name])
    solution = riccati_discrete(*data)
    assert solution.status is Status.SOLVED
    assert solution.agreed is Agreement.AGREED
    exact, gain = _newton_in_long_digits(*data, solution.P)
    assert np.linalg.norm(solution.P - exact) <= 4.0 * EPS * np.linalg.norm(exact)
    assert np.linalg.norm(solution.gain - gain) <= 8.0 * EPS * np.linalg.norm(gain)
    assert np.max(np.abs(solution.closed_loop_poles)) < 1.0
    other = riccati_discrete((1.0 + 1e-6) * data[0], *data[1:])
    assert np.linalg.norm(other.P - exact) > 1e-9 * np.linalg.norm(exact)  # a mutant is seen


@pytest.mark.parametrize(("seed", "shape"), [(0, (4, 2)), (1, (5, 3)), (2, (7, 1)), (3, (8, 4)), (5, (2, 2))])
def test_an_indefinite_price_is_no_obstacle(seed, shape):
    data, X, gain = _manufactured(seed, shape)
    assert np.linalg.eigvalsh(data[3])[0] < 0.0
    solution = riccati_discrete(*data)
    assert solution.status is Status.SOLVED
    assert solution.message == ""
    allowed = 1e2 * EPS * solution.condition  # the data were rounded
    assert np.linalg.norm(solution.P - X) <= allowed * np.linalg.norm(X)
    assert np.linalg.norm(solution.gain - gain) <= 10.0 * allowed * max(1.0, np.linalg.norm(gain))
    exact, _ = _newton_in_long_digits(*data, solution.P)
    assert np.linalg.norm(solution.P - exact) <= 4.0 * EPS * np.linalg.norm(exact)


def test_a_saddle_is_solved_and_named():
    A, B = [[0.0, 1.0], [0.0, -1.0]], [[1.0, 0.0], [2.0, 1.0]]
    Q, R = np.array([[-4.0, -4.0], [-4.0, 7.0]]) / 11.0, [[9.0, 3.0], [3.0, 1.0]]
    solution = riccati_discrete(A, B, Q, R, [[3.0, 1.0], [-1.0, 7.0]])
    assert solution.status is Status.SOLVED
    assert "saddle" in solution.message
    data = tuple(np.array(x, dtype=float) for x in (A, B, Q, R, [[3.0, 1.0], [-1.0, 7.0]]))
    assert relative_residual(*data, solution.P) < 1e-13


@pytest.mark.parametrize("name", [*PRIMARY, *FALLBACK])
def test_every_seed_reaches_the_same_solution(name):
    rng = np.random.default_rng(5)
    A, B, N = rng.standard_normal((5, 5)), rng.standard_normal((5, 2)), 0.1 * rng.standard_normal((5, 2))
    Q, R = np.eye(5), np.eye(2)
    X = riccati_discrete(A, B, Q, R, N).P
    np.testing.assert_allclose({**PRIMARY, **FALLBACK}[name](A, B, Q, R, N), X, atol=1e-8 * np.linalg.norm(X))


def test_scaling_of_states_and_inputs_changes_nothing():
    rng = np.random.default_rng(7)
    A, B, N = rng.standard_normal((5, 5)), rng.standard_normal((5, 2)), 0.1 * rng.standard_normal((5, 2))
    T, U = np.diag(10.0 ** np.array([-6.0, 3.0, 0.0, 5.0, -2.0])), np.diag([1e5, 1e-4])
    back = np.linalg.inv(T)
    plain = riccati_discrete(A, B, np.eye(5), np.eye(2), N)
    scaled = riccati_discrete(back @ A @ T, back @ B @ U, T @ T, U @ U, T @ N @ U)
    np.testing.assert_allclose(T @ plain.P @ T / scaled.P, 1.0, rtol=1e-9)
    np.testing.assert_allclose(np.linalg.inv(U) @ plain.gain @ T / scaled.gain, 1.0, rtol=1e-9)


def test_the_scalar_equation_has_its_closed_form():
    # x = a^2 x - (a b x)^2 / (r + b^2 x) + q with a = 2, b = q = r = 1: x^2 - 4 x - 1 = 0.
    assert riccati_discrete([[2.0]], [[1.0]], [[1.0]], [[1.0]]).P[0, 0] == pytest.approx(2.0 + np.sqrt(5.0), rel=4e-16)


@pytest.mark.parametrize(
    ("A", "B", "Q", "R", "words"),
    [
        (np.diag([2.0, 0.5]), [[0.0], [1.0]], np.eye(2), [[1.0]], "cannot move the mode at z = 2"),
        (np.diag([1.0, 0.5]), [[0.0], [1.0]], np.eye(2), [[1.0]], "cannot move the mode at z = 1"),
        (np.diag([1.0, 0.5]), [[1.0], [1.0]], np.diag([0.0, 1.0]), [[1.0]], "do not see the neutral mode at z = 1"),
        ([[0.0, 1.0], [-1.0, 0.0]], [[0.0], [1.0]], np.zeros((2, 2)), [[1.0]], "do not see"),
        ([[1.0]], [[1.0]], [[-1.0]], [[1.0]], "unit circle"),
        ([[0.5]], [[0.0, 1.0]], [[1.0]], np.zeros((2, 2)), "neither costs nor moves"),
        ([[0.5]], [[1.0, 1.0]], [[1.0]], np.zeros((2, 2)), "neither costs nor moves"),
    ],
)
def test_a_problem_without_solution_says_why(A, B, Q, R, words):
    solution = riccati_discrete(A, B, Q, R)
    assert solution.status is Status.INFEASIBLE
    assert words in solution.message
    assert np.all(np.isnan(solution.P))
    with pytest.raises(ModelError, match=words):
        solution.require()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"A": np.ones((2, 3))}, "A: expected"),
        ({"B": np.ones((3, 1))}, "B: expected"),
        ({"B": np.ones((2, 0))}, "B: expected"),
        ({"Q": [[1.0, 1.0], [0.0, 1.0]]}, "Q: expected a symmetric"),
        ({"R": [[1.0, 0.0], [1.0, 1.0]]}, "R: expected"),
        ({"N": np.ones((1, 2))}, "N: expected"),
        ({"Q": [[np.nan, 0.0], [0.0, 1.0]]}, "Q: every entry"),
        ({"Q": np.zeros((4, 2, 2))}, "one matrix"),
    ],
)
def test_wrong_use_is_named(change, words):
    given = {"A": np.diag([1.0, -1.0]), "B": np.ones((2, 1)), "Q": np.eye(2), "R": np.eye(1), "N": None} | change
    with pytest.raises(ValueError, match=words):
        riccati_discrete(**given)


def _on_the_edge(seed: int, *, pole: float):
    """Data of few digits, from a chosen X, whose closed loop has one pole at `pole` and the others well inside."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 4))
    B, X, gain, closed = (np.round(4.0 * rng.normal(size=shape)) / 4.0 for shape in ((n, 1), (n, n), (1, n), (n, n)))
    X, closed = X + X.T + 4.0 * np.eye(n), closed / 8.0
    closed[-1] = 0.0
    closed[-1, -1] = pole
    A, R = closed + B @ gain, np.array([[4.0]])
    price = R + B.T @ X @ B
    N = (price @ gain - B.T @ X @ A).T
    Q = X - A.T @ X @ A + gain.T @ price @ gain
    return (A, B, 0.5 * (Q + Q.T), R, N), X


def test_a_neutral_closed_loop_is_refused_and_nothing_is_raised() -> None:
    # x = x / (4 (1 + x)) - 1 / 4 has the double root x = -1/2, where the closed loop is at z = 1
    solution = riccati_discrete([[0.5]], [[1.0]], [[-0.25]], [[1.0]])
    assert solution.status is Status.INFEASIBLE
    assert "unit circle" in solution.message
    for seed in range(10):
        data, _ = _on_the_edge(seed, pole=1.0)
        solution = riccati_discrete(*data)
        assert solution.status is Status.INFEASIBLE, (seed, solution.message)


@pytest.mark.parametrize("power", [-3, -12, -20])
def test_a_loop_that_decays_slowly_is_solved_all_the_same(power) -> None:
    for seed in range(12):
        data, X = _on_the_edge(seed, pole=1.0 - 2.0**power)
        if np.linalg.svd(np.hstack([data[0] - np.eye(len(X)), data[1]]), compute_uv=False)[-1] < 1e-4:
            continue  # the slow mode itself is all but uncontrollable
        solution = riccati_discrete(*data)
        assert solution.status is Status.SOLVED, (seed, solution.message)
        assert np.linalg.norm(solution.P - X) <= 1e2 * EPS * solution.condition * np.linalg.norm(X)


def test_without_a_solution_the_angle_on_the_circle_is_named() -> None:
    # x+ = u, cost -c x^2 + u^2 + 2 n x u: the Popov function 1 - c + 2 n cos(angle) is zero at 60 degrees
    solution = riccati_discrete([[0.0]], [[1.0]], [[-1.5]], [[1.0]], [[0.5]])
    assert solution.status is Status.INFEASIBLE
    assert f"angle {np.pi / 3.0:.4g} rad" in solution.message
    slightly = riccati_discrete([[0.0]], [[1.0]], [[0.01]], [[1.0]], [[0.5]])  # 1.01 + cos(angle) is never zero
    assert slightly.status is Status.SOLVED


def test_the_popov_function_agrees_on_which_equations_have_a_solution() -> None:
    rng, count = np.random.default_rng(3), {True: 0, False: 0}
    around = np.exp(1j * np.linspace(0.0, np.pi, 2001))
    for _ in range(24):
        n = int(rng.integers(1, 5))
        A, B, Q = 0.5 * rng.normal(size=(n, n)), rng.normal(size=(n, 1)), rng.normal(size=(n, n))
        Q = Q + Q.T
        states = np.array([np.linalg.solve(z * np.eye(n) - A, B)[:, 0] for z in around])
        popov = 1.0 + np.einsum("ki,ij,kj->k", states.conj(), Q, states).real
        changes = bool(np.min(popov) < 0.0 < np.max(popov))
        solution = riccati_discrete(A, B, Q, [[1.0]])
        assert solution.status is (Status.INFEASIBLE if changes else Status.SOLVED), solution.message
        count[changes] += 1
    assert min(count.values()) >= 6


def test_states_of_very_different_size_are_no_reason_to_refuse() -> None:
    rng = np.random.default_rng(11)
    for _ in range(15):
        n, spread = int(rng.integers(2, 6)), rng.uniform(0.0, 3.0)
        A = rng.normal(size=(n, n)) * 10.0 ** rng.uniform(-spread, spread, (n, n))
        B = rng.normal(size=(n, 2)) * 10.0 ** rng.uniform(-spread, spread, (n, 2))
        solution = riccati_discrete(A, B, np.eye(n), np.eye(2))
        assert solution.status in (Status.SOLVED, Status.ALMOST_SOLVED), solution.message
