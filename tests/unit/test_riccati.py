"""Riccati equations: closed forms, extreme scalings, honest failure, batches, extended precision."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest
from random_plants import random_plant

from maglev_ctrl.errors import Agreement, ModelError, Status
from maglev_ctrl.synthesis import riccati
from maglev_ctrl.synthesis.doubling import relative_residual
from maglev_ctrl.synthesis.extended import Extended, extended_solve, two_sum
from maglev_ctrl.synthesis.riccati import axis_frequency, riccati_continuous
from maglev_ctrl.synthesis.riccati_batch import riccati_batch
from maglev_ctrl.synthesis.riccati_newton import EPS, exists
from maglev_ctrl.synthesis.riccati_seeds import FALLBACK, PRIMARY


def _random_problem(seed, n=6, m=2):
    rng = np.random.default_rng(seed)
    A, B, C = rng.standard_normal((n, n)), rng.standard_normal((n, m)), rng.standard_normal((3, n))
    D = rng.standard_normal((3, m))
    return A, B, C.T @ C, np.eye(m) + D.T @ D, C.T @ D


def _residual_in_long_digits(A, B, Q, R, N, P):
    with mpmath.workdps(50):
        a, b, q, r, n, p = (mpmath.matrix(x.tolist()) for x in (A, B, Q, R, N, P))
        cross = p * b + n
        rest = a.T * p + p * a + q - cross * r**-1 * cross.T
        return float(mpmath.mnorm(rest, "f") / mpmath.mnorm(p, "f"))


@pytest.mark.parametrize("seed", range(5))
def test_random_problem_has_a_last_digit_residual_and_a_stable_loop(seed):
    A, B, Q, R, N = _random_problem(seed)
    solution = riccati_continuous(A, B, Q, R, N)
    assert solution.status is Status.SOLVED
    assert solution.agreed is Agreement.AGREED
    assert _residual_in_long_digits(A, B, Q, R, N, solution.P) < 1e-13
    assert np.max(np.linalg.eigvals(A - B @ solution.gain).real) < 0.0
    assert np.min(np.linalg.eigvalsh(solution.P)) > 0.0
    np.testing.assert_allclose(solution.gain, np.linalg.solve(R, B.T @ solution.P + N.T), rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("seed", range(5))
def test_residual_check_catches_a_mutant(seed):
    A, B, Q, R, N = _random_problem(seed)
    P = riccati_continuous(A, B, Q, R, -N).P  # sign of the cross weight flipped
    assert _residual_in_long_digits(A, B, Q, R, N, P) > 1e-3


@pytest.mark.parametrize("name", [*PRIMARY, *FALLBACK])
def test_every_seed_reaches_the_same_solution(name):
    A, B, Q, R, _ = _random_problem(3)
    P = riccati_continuous(A, B, Q, R).P
    seed = {**PRIMARY, **FALLBACK}[name](A, B, Q, R, B @ np.linalg.solve(R, B.T))
    np.testing.assert_allclose(seed, P, rtol=1e-8, atol=1e-8 * np.linalg.norm(P))


@pytest.mark.parametrize("small", [1e-2, 1e-6, 1e-7])
def test_nearly_uncontrollable_double_integrator_matches_its_closed_form(small):
    # CAREX 2.3 (Kenney, Laub and Wette 1989): p11 = sqrt(1 + 2 e) / e, p12 = 1, p22 = sqrt(1 + 2 e).
    solution = riccati_continuous([[0.0, small], [0.0, 0.0]], [[0.0], [1.0]], np.eye(2), [[1.0]])
    with mpmath.workdps(40):  # from 1 = p12^2, e p11 = p12 p22, p22^2 = 1 + 2 e p12
        p22 = mpmath.sqrt(1 + 2 * mpmath.mpf(small))
        exact = [[float(p22 / mpmath.mpf(small)), 1.0], [1.0, float(p22)]]
    np.testing.assert_allclose(solution.P, exact, rtol=4e-16)


@pytest.mark.parametrize("spread", [1.0, 1e3, 1e6])
def test_spread_weights_match_their_closed_form(spread):
    # CAREX 2.6 (Petkov, Christov and Konstantinov 1987): three scalar equations behind one reflection.
    V = np.eye(3) - 2.0 / 3.0 * np.ones((3, 3))
    A, Q = V @ np.diag(spread * np.array([1.0, 2.0, 3.0])) @ V, V @ np.diag([1.0 / spread, 1.0, spread]) @ V
    solution = riccati_continuous(A, np.eye(3), Q, spread * np.eye(3))
    scalar = [
        spread * (a * spread + np.sqrt((a * spread) ** 2 + q / spread))
        for a, q in ((1.0, 1.0 / spread), (2.0, 1.0), (3.0, spread))
    ]
    exact = V @ np.diag(scalar) @ V
    assert solution.agreed is Agreement.AGREED
    assert np.linalg.norm(solution.P - exact) < 2e-15 * np.linalg.norm(exact)


def test_scaling_of_states_changes_nothing():
    A, B, Q, R, N = _random_problem(11)
    T = np.diag(10.0 ** np.array([-6.0, 3.0, 0.0, 5.0, -2.0, 1.0]))
    inverse = np.linalg.inv(T)
    plain, scaled = (
        riccati_continuous(A, B, Q, R, N),
        riccati_continuous(inverse @ A @ T, inverse @ B, T @ Q @ T, R, T @ N),
    )
    np.testing.assert_allclose(T @ plain.P @ T / scaled.P, 1.0, rtol=1e-9)


def test_forward_error_is_an_honest_bound():
    # Example 6 of Laub 1979 (CAREX 4.1) with 12 integrators.
    n = 12
    A, B, Q = np.diag(np.ones(n - 1), 1), np.eye(n)[:, -1:], np.diag([1.0] + [0.0] * (n - 1))
    solution = riccati_continuous(A, B, Q, [[1.0]])
    # The optimal poles of a chain of integrators are the Butterworth pattern (cheap output x1): K is its polynomial.
    poles = np.exp(1j * np.pi * (2 * np.arange(n) + n + 1) / (2 * n))
    butterworth = np.real(np.poly(poles))[1:][::-1]
    np.testing.assert_allclose(solution.gain[0], butterworth, rtol=1e-12)
    assert solution.forward_error < 1e-15


@pytest.mark.parametrize(
    ("A", "B", "Q", "words"),
    [
        (np.diag([1.0, -1.0]), [[0.0], [1.0]], np.eye(2), "cannot move"),
        (np.diag([0.0, -1.0]), [[1.0], [1.0]], np.diag([0.0, 1.0]), "do not see"),
        ([[0.0, 1.0], [-1.0, 0.0]], [[0.0], [1.0]], np.zeros((2, 2)), "do not see"),
        ([[0.0]], [[1.0]], [[-1.0]], "imaginary axis"),
    ],
)
def test_a_problem_without_solution_says_why(A, B, Q, words):
    solution = riccati_continuous(A, B, Q, [[1.0]])
    assert solution.status is Status.INFEASIBLE
    assert words in solution.message
    assert np.all(np.isnan(solution.P))
    with pytest.raises(ModelError, match=words):
        solution.require()


def test_sensitive_data_are_reported():
    # CAREX 2.8: poles of A - G P come within 1e-6 of the axis; the condition number tells.
    e = 1e-6
    A = np.array([[-e, 1, 0, 0], [-1, -e, 0, 0], [0, 0, e, 1], [0, 0, -1, e]])
    solution = riccati_continuous(A, np.ones((4, 1)), np.ones((4, 4)), [[1.0]])
    assert solution.status is Status.ALMOST_SOLVED
    assert solution.condition > 1e10


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"A": np.ones((2, 3))}, "A: expected"),
        ({"B": np.ones((3, 1))}, "B: expected"),
        ({"Q": [[1.0, 1.0], [0.0, 1.0]]}, "Q: expected a symmetric"),
        ({"R": [[-1.0]]}, "R: expected a positive"),
        ({"N": np.ones((1, 2))}, "N: expected"),
        ({"Q": [[np.nan, 0.0], [0.0, 1.0]]}, "Q: every entry"),
        ({"Q": np.zeros((4, 2, 2))}, "riccati_batch"),
    ],
)
def test_wrong_use_is_named(change, words):
    given = {"A": np.diag([1.0, -1.0]), "B": np.ones((2, 1)), "Q": np.eye(2), "R": np.eye(1), "N": None} | change
    with pytest.raises(ValueError, match=words):
        riccati_continuous(**given)


def test_batch_equals_single_solutions_and_broadcasts():
    rng = np.random.default_rng(7)
    A, B = rng.standard_normal((3, 4, 5, 5)), rng.standard_normal((4, 5, 2))
    N = 0.1 * rng.standard_normal((5, 2))
    batch = riccati_batch(A, B, np.eye(5), np.eye(2), N)
    assert batch.P.shape == (3, 4, 5, 5)
    assert batch.gain.shape == (3, 4, 2, 5)
    assert np.all(batch.solved)
    assert np.max(batch.residual) < 1e-11
    for i, j in np.ndindex(3, 4):
        single = riccati_continuous(A[i, j], B[j], np.eye(5), np.eye(2), N)
        np.testing.assert_allclose(batch.P[i, j], single.P, rtol=1e-6, atol=1e-9 * np.linalg.norm(single.P))


def test_batch_marks_points_without_solution():
    A = np.array([[[1.0, 0.0], [0.0, -1.0]], [[-2.0, 0.0], [0.0, -1.0]]])
    batch = riccati_batch(A, [[0.0], [1.0]], np.eye(2), [[1.0]])
    assert batch.solved.tolist() == [False, True]
    assert np.all(np.isnan(batch.P[0]))


def test_relative_residual_catches_a_mutant():
    A, B, Q, R, _ = _random_problem(2)
    G = B @ np.linalg.solve(R, B.T)
    P = riccati_continuous(A, B, Q, R).P
    assert relative_residual(A, G, Q, P) < 1e-14
    assert relative_residual(A, G, Q, P + 1e-6 * np.eye(6)) > 1e-8


def test_extended_product_and_solve_hold_thirty_digits():
    rng = np.random.default_rng(5)
    left = rng.standard_normal((7, 9)) * 10.0 ** rng.uniform(-4, 4, (7, 1))
    right = rng.standard_normal((9, 4))
    pair = Extended(*two_sum(left, 1e-17 * left * rng.standard_normal(left.shape)))
    product = pair @ Extended.of(right)
    with mpmath.workdps(60):

        def exact(x):
            return mpmath.matrix(x.high.tolist()) + mpmath.matrix(x.low.tolist())

        rest = exact(product) - exact(pair) * mpmath.matrix(right.tolist())
        largest = max(abs(rest[i, j]) / mpmath.mpf(float(np.max(abs(left[i])))) for i in range(7) for j in range(4))
        assert largest < 1e-29
        matrix = rng.standard_normal((5, 5)) + 4.0 * np.eye(5)
        solved = extended_solve(matrix, Extended.of(rng.standard_normal((5, 2))))
        back = Extended.of(matrix) @ solved
        again = extended_solve(matrix, back)
        assert float(mpmath.mnorm(exact(again) - exact(solved), "f")) < 1e-28
    plain = left @ right
    assert np.max(np.abs((product.high - plain) + product.low)) > 0.0  # ordinary arithmetic is seen to differ


def test_a_point_without_a_solution_does_not_send_its_batch_the_slow_way() -> None:
    rng = np.random.default_rng(8)
    A, B = rng.standard_normal((40, 2, 2)), rng.standard_normal((40, 2, 3))
    hopeless = random_plant(781).plant  # a mode that grows and that no input moves
    A[17], B[17] = hopeless.A, hopeless.B2
    weights = [x.T @ y for x in (hopeless.C1, hopeless.D12) for y in (hopeless.C1, hopeless.D12)]
    batch = riccati_batch(A, B, weights[0], weights[3], weights[1])
    assert not batch.solved[17] and np.count_nonzero(batch.solved) == 39
    assert np.flatnonzero(batch.redone).tolist() == [17]


@pytest.mark.parametrize("weight", [-2.0, -1.000001, -1e6])
def test_an_indefinite_weight_without_a_solution_is_refused_and_nothing_is_raised(weight) -> None:
    # -2 P - P^2 + weight = 0 has no real root below weight = -1; the iteration runs off to infinity
    solution = riccati_continuous([[-1.0]], [[1.0]], [[weight]], [[1.0]])
    assert solution.status not in (Status.SOLVED, Status.ALMOST_SOLVED)
    with pytest.raises(ModelError, match="Riccati"):
        solution.require()


def _on_the_edge(seed: int, *, pole: float):
    """Data without rounding, from a chosen P, whose closed loop has one pole at `pole` and the others well left."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 5))
    B, P, closed = (np.round(4.0 * rng.normal(size=shape)) / 4.0 for shape in ((n, 1), (n, n), (n, n)))
    P, closed = P + P.T, closed - 6.0 * np.eye(n)
    closed[-1] = 0.0
    closed[-1, -1] = pole
    A = closed + B @ (B.T @ P)
    return A, B, -(A.T @ P + P @ A - P @ B @ B.T @ P), P, closed


def test_a_neutral_closed_loop_is_refused_however_small_the_last_step() -> None:
    # 2 a p - p^2 - a^2 = 0 has the double root p = a: the steps halve, and so does the computed pole
    for a in (-1.0, -2.0, -3.0, -0.5, -0.1, -10.0):
        solution = riccati_continuous([[a]], [[1.0]], [[-a * a]], [[1.0]])
        assert solution.status is Status.INFEASIBLE, a
        assert "imaginary axis" in solution.message
    for seed in range(10):
        A, B, Q, *_ = _on_the_edge(seed, pole=0.0)
        solution = riccati_continuous(A, B, Q, [[1.0]])
        assert solution.status is Status.INFEASIBLE, (seed, solution.message)


@pytest.mark.parametrize("power", [-3, -20, -30])
def test_a_loop_that_decays_slowly_is_solved_all_the_same(power) -> None:
    for seed in range(12):
        A, B, Q, P, closed = _on_the_edge(seed, pole=-(2.0**power))
        assert np.max(np.linalg.eigvals(closed).real) < 0.0
        if np.linalg.svd(np.hstack([A, B]), compute_uv=False)[-1] < 1e-6:
            continue  # the slow mode itself is all but uncontrollable
        solution = riccati_continuous(A, B, Q, [[1.0]])
        assert solution.status is Status.SOLVED, (seed, solution.message)
        assert np.linalg.norm(solution.P - P) <= 4.0 * EPS * np.linalg.norm(P)


def test_without_a_solution_the_frequency_on_the_axis_is_named() -> None:
    # H of a mass on a spring, Q = -diag(q, 0): s^4 + 2 s^2 + 1 - q has the roots s^2 = -1 +- sqrt(q)
    solution = riccati_continuous([[0.0, 1.0], [-1.0, 0.0]], [[0.0], [1.0]], np.diag([-0.25, 0.0]), [[1.0]])
    assert solution.status is Status.INFEASIBLE
    assert f"{np.sqrt(1.5):.4g} rad/s" in solution.message
    solution = riccati_continuous([[0.0]], [[1.0]], [[0.0]], [[1.0]])
    assert solution.status is Status.INFEASIBLE
    assert "do not see the neutral mode" in solution.message


def test_the_hamiltonian_in_long_digits_agrees_on_which_equations_have_a_solution() -> None:
    rng, count = np.random.default_rng(3), {True: 0, False: 0}
    for _ in range(24):
        n, m = (int(x) for x in rng.integers((1, 1), (5, 3)))
        A, B, Q = rng.normal(size=(n, n)), rng.normal(size=(n, m)), rng.normal(size=(n, n))
        Q = Q + Q.T
        with mpmath.workdps(40):
            a, b, q = (mpmath.matrix(x.tolist()) for x in (A, B, Q))
            whole, g = mpmath.zeros(2 * n), b * b.T
            whole[:n, :n], whole[:n, n:], whole[n:, :n], whole[n:, n:] = a, -g, -q, -a.T
            poles = mpmath.eig(whole, left=False, right=False)
            neutral = min(abs(mpmath.re(pole)) for pole in poles) < mpmath.mpf(10) ** -25
        solution = riccati_continuous(A, B, Q, np.eye(m))
        assert solution.status is (Status.INFEASIBLE if neutral else Status.SOLVED), solution.message
        if neutral:
            on_axis = [float(mpmath.im(pole)) for pole in poles if abs(mpmath.re(pole)) < 1e-25]
            named = float(solution.message.split(" at ")[1].split()[0])
            assert np.min(np.abs(np.array(on_axis) - named)) <= 1e-3 * abs(named)
        count[neutral] += 1
    assert min(count.values()) >= 6


def test_the_share_of_decay_in_doubt_tells_a_double_root_from_a_slow_loop(monkeypatch) -> None:
    assert exists(0.0) and exists(1e-3)
    assert not exists(1.0) and not exists(np.inf) and not exists(np.nan)
    monkeypatch.setattr(riccati, "exists", lambda departure: True)  # the mutant: the sign of the computed pole decides
    assert riccati_continuous([[-1.0]], [[1.0]], [[-1.0]], [[1.0]]).status is not Status.INFEASIBLE
    assert axis_frequency(np.array([[-1.0]]), np.eye(1), np.array([[-1.0]])) == pytest.approx(0.0, abs=1e-6)
    assert axis_frequency(np.array([[-1.0]]), np.eye(1), np.array([[-0.99]])) is None
