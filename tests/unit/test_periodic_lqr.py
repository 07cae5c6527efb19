"""Periodic regulators: against the ordinary one, against plain integration, against mutants, against constant gains."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from maglev_ctrl.analysis.floquet import floquet
from maglev_ctrl.errors import Agreement, ModelError, Status
from maglev_ctrl.kernels import periodic_riccati as kernel
from maglev_ctrl.kernels.fourier_matrix import FourierMatrix
from maglev_ctrl.synthesis.periodic import PeriodicProblem, periodic_lqr, verify_periodic
from maglev_ctrl.synthesis.periodic_constant import (
    compare_laws,
    constant_lqr,
    cost_and_gradient,
    default_spread,
    law_map,
)
from maglev_ctrl.synthesis.periodic_problem import gain_of
from maglev_ctrl.synthesis.riccati import riccati_continuous
from maglev_ctrl.systems import PeriodicSystem, SecondOrderSystem, modulate


def mathieu(depth=0.4, frequency=2.0, damping=0.0):
    return PeriodicSystem.from_matrices([[0, 1], [-1, -damping]], [[[0, 0], [-depth, 0]]], frequency=frequency)


def mathieu_problem(depth=0.4, frequency=2.0, weight=1.0, damping=0.0):
    return PeriodicProblem.of(mathieu(depth, frequency, damping), [[0.0], [1.0]], weight * np.eye(2), [[1.0]])


def train_problem():
    """Two freedoms in newtons and metres, stiffness modulated with the girders' beat of two phases."""
    M, K = np.diag([8e3, 3e3]), np.array([[4e5, -4e5], [-4e5, 2.6e6]])
    system = SecondOrderSystem.from_matrices(M, np.zeros((2, 2)), K, inputs=("coil",), B=[[1.0], [-1.0]])
    first, second = 0.5 * np.array([[0, 0], [0, 2.2e6]]), 0.2 * np.array([[0, 0], [0, 2.2e6]])
    periodic = modulate(system, [first, 0 * first], [0 * first, second], frequency=2.0 * 7.05)
    weight = np.diag([1 / 0.02**2, 1 / 0.02**2, 1 / 0.2**2, 1 / 0.2**2])
    return PeriodicProblem.of(periodic, system.input_matrix(), weight, [[1 / 5e3**2]])


# --- against what is known otherwise


@pytest.mark.parametrize("seed", range(3))
def test_a_constant_system_gives_the_ordinary_regulator(seed):
    rng = np.random.default_rng(seed)
    A, B, C = rng.standard_normal((5, 5)), rng.standard_normal((5, 2)), rng.standard_normal((3, 5))
    R = np.array([[2.0, 0.3], [0.3, 1.0]])
    system = PeriodicSystem.from_matrices(A, np.zeros((1, 5, 5)), frequency=3.0)
    law = periodic_lqr(PeriodicProblem.of(system, B, C.T @ C, R))
    known = riccati_continuous(A, B, C.T @ C, R)
    assert law.status is Status.SOLVED
    scale = np.max(np.abs(known.P))
    assert np.max(np.abs(law.P_samples - known.P)) <= 1e-10 * scale
    assert np.max(np.abs(law.gain.samples(7) - known.gain)) <= 1e-10 * np.max(np.abs(known.gain))


@pytest.mark.parametrize("periodic_input", [False, True])
def test_the_scalar_equation_agrees_with_plain_integration(periodic_input):
    wave = [[[1.5]]]
    system = PeriodicSystem.from_matrices([[0.5]], [[[2.0]]], wave, frequency=3.0)
    extra = {"B_cos": [[[0.9]]], "B_sin": [[[0.0]]]} if periodic_input else {}
    law = periodic_lqr(PeriodicProblem.of(system, [[1.0]], [[0.7]], [[0.4]], **extra))

    def backward(s, p):
        t = -s
        a = 0.5 + 2.0 * np.cos(3.0 * t) + 1.5 * np.sin(3.0 * t)
        b = 1.0 + (0.9 * np.cos(3.0 * t) if periodic_input else 0.0)
        return 2.0 * a * p - b**2 / 0.4 * p**2 + 0.7

    periods = 2.0 * np.pi / 3.0 * 12
    times = np.linspace(0.05, 2.0, 23)
    done = solve_ivp(backward, (0.0, periods), [1.0], method="DOP853", rtol=1e-13, atol=1e-13,
                     t_eval=np.sort(periods - times))  # fmt: skip
    reference = done.y[0][np.argsort(np.argsort(periods - times))]
    assert np.max(np.abs(law.P(times)[:, 0, 0] - reference)) <= 1e-10
    assert law.certificate.agreed is Agreement.AGREED


def test_the_tongue_of_mathieu_is_stabilised():
    system = mathieu()
    assert floquet(system).spectral_radius > 1.3
    law = periodic_lqr(mathieu_problem()).require()
    closed = law.problem.closed(law.gain)
    result = floquet(PeriodicSystem.from_matrices(closed.mean, closed.cosine, closed.sine, frequency=2.0))
    assert result.agreement is Agreement.AGREED  # Hill's method among them
    assert result.stable
    assert result.spectral_radius == pytest.approx(law.certificate.spectral_radius, rel=1e-9)


def test_a_vehicle_in_newtons_and_metres_is_solved_and_certified():
    law = periodic_lqr(train_problem()).require()
    certificate = law.certificate
    assert certificate.residual < 1e-10
    assert certificate.cost_difference < 1e-8
    assert certificate.multiplier_difference < 1e-9
    assert certificate.least_eigenvalue > 0.0
    assert max(law.series_error, law.refinement_change, law.closure) < 1e-10
    assert not law.notes


def test_an_unseen_growing_motion_is_turned_round_at_least_cost():
    system = PeriodicSystem.from_matrices([[0.3]], [[[1.0]]], frequency=2.0)
    law = periodic_lqr(PeriodicProblem.of(system, [[1.0]], [[0.0]], [[1.0]]))
    assert law.status is Status.SOLVED
    assert law.certificate.spectral_radius == pytest.approx(np.exp(-0.3 * np.pi), rel=1e-9)  # mirrored in the circle
    assert "not seen" in law.notes[0]


# --- error estimates


@pytest.mark.parametrize("segments", [4, 12, 40, 100])
def test_the_series_error_covers_the_error_between_the_samples(segments):
    problem = mathieu_problem(depth=0.9, frequency=9.0, damping=0.5)
    wave = FourierMatrix.of(problem.Q, frequency=9.0)
    G = problem.input_weight().plus(FourierMatrix.of(np.zeros((2, 2)), [[[0, 0], [0, 0.7]]], frequency=9.0))
    coarse = kernel.periodic_riccati(problem.A, G, wave, segments=segments)
    fine = kernel.periodic_riccati(problem.A, G, wave, segments=400)
    times = np.linspace(0.0, 0.7, 41)
    error = np.max(np.abs(coarse.series(times) - fine.series(times))) / np.max(np.abs(fine.P))
    assert error <= 5.0 * coarse.series_error + 1e-13


def test_the_result_does_not_depend_on_the_segments():
    problem = train_problem()
    few, many = (periodic_lqr(problem, segments=s, simulate=False) for s in (16, 300))
    np.testing.assert_allclose(few.gain(0.123), many.gain(0.123), rtol=1e-9)


# --- refusals


def test_an_unstable_motion_that_nothing_moves_is_named():
    A, A_1 = np.zeros((3, 3)), np.zeros((1, 3, 3))
    A[:2, :2], A_1[0, 1, 0], A[2, 2] = [[0, 1], [-1, 0]], -0.4, -1.0
    system = PeriodicSystem.from_matrices(A, A_1, frequency=2.0)
    with pytest.raises(ModelError, match=r"cannot move the motion with multiplier -1\.36712 \(modulus 1\.36712\)"):
        periodic_lqr(PeriodicProblem.of(system, [[0.0], [0.0], [1.0]], np.eye(3), [[1.0]]))


def test_a_neutral_motion_that_the_weights_do_not_see_is_named():
    problem = mathieu_problem(depth=0.3, frequency=5.0, weight=0.0)
    with pytest.raises(ModelError, match=r"do not see the motion with multiplier .* \(modulus 1\)"):
        periodic_lqr(problem)


def test_a_motion_moved_only_by_the_modulated_input_is_accepted():
    system = PeriodicSystem.from_matrices([[0.1]], [[[0.0]]], frequency=2.0)
    law = periodic_lqr(PeriodicProblem.of(system, [[0.0]], [[1.0]], [[1.0]], B_cos=[[[1.0]]]))
    assert law.require().certificate.spectral_radius < 1.0


@pytest.mark.parametrize("reach", [1e-2, 1e-6, 1e-10])
def test_a_weak_reach_is_used_and_none_is_refused(reach):
    system = PeriodicSystem.from_matrices(np.diag([0.1, -1.0]), [np.diag([0.2, 0.3])], frequency=5.0)
    problem = PeriodicProblem.of(system, [[reach], [1.0]], np.eye(2), [[1.0]])
    if reach > 1e-9:
        assert periodic_lqr(problem).require().certificate.residual < 1e-9
    else:
        with pytest.raises(ModelError, match=r"cannot move the motion with multiplier 1\.1339 "):
            periodic_lqr(problem)


@pytest.mark.parametrize("seed", range(3))
def test_random_systems_with_periodic_inputs_are_certified(seed):
    rng = np.random.default_rng(seed)
    A, B = rng.standard_normal((4, 4)), rng.standard_normal((4, 2))
    waves = 0.7 * rng.standard_normal((2, 2, 4, 4))
    system = PeriodicSystem.from_matrices(A, waves[0], waves[1], frequency=2.0 + seed)
    problem = PeriodicProblem.of(system, B, np.eye(4), np.eye(2), B_cos=0.4 * rng.standard_normal((1, 4, 2)))
    assert not periodic_lqr(problem).require().notes


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"Q": [[1.0, 0.5], [0.0, 1.0]]}, "Q: expected one symmetric"),
        ({"Q": [[1.0, 2.0], [2.0, 1.0]]}, "Q: expected a positive semidefinite"),
        ({"R": [[-1.0]]}, "R: expected a positive definite"),
        ({"B": [[1.0]]}, "B: expected shape"),
    ],
)
def test_wrong_input_is_told(change, told):
    given = {"B": [[0.0], [1.0]], "Q": np.eye(2), "R": [[1.0]]} | change
    with pytest.raises(ValueError, match=told):
        PeriodicProblem.of(mathieu(), **given)


def test_a_system_too_fast_for_its_period_is_told():
    system = PeriodicSystem.from_matrices([[-1e6]], [[[0.0]]], frequency=1.0)
    with pytest.raises(ValueError, match="segments in a period"):
        periodic_lqr(PeriodicProblem.of(system, [[1.0]], [[1.0]], [[1.0]]))


# --- mutants the certificate has to catch


def claims(mutant):
    problem = mathieu_problem(depth=0.4, weight=0.02, damping=0.6)
    right = periodic_lqr(problem).require()
    P, gain, Q = right.P, right.gain, FourierMatrix.of(problem.Q, frequency=2.0)
    if mutant == "sign of G":
        P = kernel.periodic_riccati(problem.A, FourierMatrix.of(-problem.input_weight().mean, frequency=2.0), Q).series
        gain = gain_of(problem, P)
    elif mutant == "time reversed":
        # the sine part of the modulation is what tells forward from backward; P itself is not even in time
        P = P.reversed
        gain = gain_of(problem, P)
    elif mutant == "forward equation":
        P = kernel.periodic_riccati(problem.A.T, problem.input_weight(), Q).series
    elif mutant == "gain half a period late":
        odd = (-1.0) ** np.arange(1, gain.harmonics + 1)[:, None, None]
        gain = FourierMatrix.of(gain.mean, odd * gain.cosine, odd * gain.sine, frequency=2.0)
    elif mutant == "weight of the command":
        gain = FourierMatrix.of(0.9 * gain.mean, 0.9 * gain.cosine, 0.9 * gain.sine, frequency=2.0)
    elif mutant == "mean only":
        P = FourierMatrix.of(P.mean, frequency=2.0)
    return verify_periodic(problem, P, gain)


def test_the_right_claim_is_borne_out():
    assert claims("none").stable


@pytest.mark.parametrize(
    "mutant",
    ["sign of G", "time reversed", "forward equation", "gain half a period late", "weight of the command", "mean only"],
)
def test_the_certificate_catches(mutant):
    certificate = claims(mutant)
    assert not certificate.stable
    assert certificate.disagreements


@pytest.mark.parametrize("part", ["G", "H", "order"])
def test_a_broken_solver_is_never_believed(monkeypatch, part):
    right = kernel.structured
    if part == "order":
        monkeypatch.setattr(kernel, "structured", lambda x: right(x[::-1]))
    else:
        sign = {"G": (1.0, -1.0, 1.0), "H": (1.0, 1.0, -1.0)}[part]

        def broken(transitions):
            triple = right(transitions)
            return kernel.Triple(*(s * x for s, x in zip(sign, (triple.E, triple.G, triple.H), strict=True)))

        monkeypatch.setattr(kernel, "structured", broken)
    system = PeriodicSystem.from_matrices([[0, 1], [-1, -0.6]], [np.zeros((2, 2))], [[[0, 0], [-0.4, 0]]], frequency=2)
    problem = PeriodicProblem.of(system, [[0.0], [1.0]], 0.02 * np.eye(2), [[1.0]])
    with pytest.raises(ModelError):
        periodic_lqr(problem).require()


# --- building stones


def test_triples_compose_as_transitions_multiply():
    rng = np.random.default_rng(4)
    J = np.block([[np.zeros((3, 3)), np.eye(3)], [-np.eye(3), np.zeros((3, 3))]])
    S = rng.standard_normal((2, 6, 6))
    first, second = (np.linalg.inv(np.eye(6) - 0.1 * J @ s) @ (np.eye(6) + 0.1 * J @ s) for s in S + S.swapaxes(1, 2))
    joined = kernel.compose(kernel.structured(first), kernel.structured(second))
    direct = kernel.structured(second @ first)
    for name in ("E", "G", "H"):
        np.testing.assert_allclose(getattr(joined, name), getattr(direct, name), rtol=1e-11, atol=1e-12)


def test_a_final_weight_leads_to_the_same_solution():
    one = kernel.Triple(np.array([[0.8, 0.3], [0.0, 0.9]]), np.diag([0.2, 0.4]), np.eye(2))
    S = np.array([[3.0, 1.0], [1.0, 2.0]])
    np.testing.assert_allclose(kernel.doubled(kernel.with_final_weight(one, S))[0] + S, kernel.doubled(one)[0])


def test_series_algebra():
    rng = np.random.default_rng(5)
    a, b = (FourierMatrix.of(*rng.standard_normal((2, 2, 2))[:1], *rng.standard_normal((2, h, 2, 2)), frequency=1.7)
            for h in (2, 3))  # fmt: skip
    t = np.array([0.3, 1.1])
    np.testing.assert_allclose(a.times(b)(t), a(t) @ b(t), atol=1e-12)
    np.testing.assert_allclose(a.plus(b, -2.0)(t), a(t) - 2.0 * b(t), atol=1e-12)
    np.testing.assert_allclose(a.rate(t), (a(t + 1e-6) - a(t - 1e-6)) / 2e-6, atol=1e-7)
    np.testing.assert_allclose(a.reversed(t), a(-t), atol=1e-12)
    np.testing.assert_allclose(a.T(t), a(t).swapaxes(1, 2), atol=1e-12)
    assert a.padded(9).truncated(1e-12).harmonics == 2
    with pytest.raises(ValueError, match="frequency"):
        a.plus(FourierMatrix.of(np.eye(2), frequency=1.0))


# --- constant competitors


def test_the_gradient_of_the_constant_gain_agrees_with_differences():
    law = periodic_lqr(train_problem(), simulate=False)
    spread = default_spread(law.P)
    K = 1.1 * law.gain.mean
    _, gradient, step = cost_and_gradient(law.problem, K, spread)
    assert np.sum(gradient * step) < 0.0
    for j in range(4):
        move = np.zeros_like(K)
        move[0, j] = 1e-4 * abs(K[0, j])
        ahead, back = (cost_and_gradient(law.problem, K + s * move, spread)[0] for s in (1, -1))
        assert (ahead - back) / (2.0 * move[0, j]) == pytest.approx(gradient[0, j], rel=1e-5)


def test_a_constant_gain_costs_more_than_a_periodic_one_and_may_fail():
    law = periodic_lqr(mathieu_problem(depth=0.9, weight=0.04)).require()
    found = compare_laws(law)
    averaged, refined = found.constants
    assert found.periodic.mean_cost_ratio == pytest.approx(1.0, abs=1e-10)
    assert found.periodic.worst_cost_ratio == pytest.approx(1.0, abs=1e-8)
    assert not averaged.stable
    assert averaged.mean_cost_ratio == np.inf
    assert refined.stable
    assert 1.1 < refined.mean_cost_ratio < refined.worst_cost_ratio
    assert found.best_constant is refined
    assert np.all(found.periodic.peak_gain > np.abs(refined.gain.mean))


def test_refinement_is_no_worse_than_its_start_and_needs_no_further_step():
    law = periodic_lqr(mathieu_problem(depth=0.9)).require()
    _, refined = constant_lqr(law)
    rated = compare_laws(law).constants
    assert rated[1].mean_cost_ratio <= rated[0].mean_cost_ratio
    assert refined.slope <= 1e-6
    assert refined.refined
    spread = default_spread(law.P)
    least = cost_and_gradient(law.problem, refined.gain, spread)[0]
    for j in range(2):
        for sign in (-0.1, 0.1):
            moved = np.array(refined.gain)
            moved[0, j] += sign
            assert cost_and_gradient(law.problem, moved, spread)[0] > least


def test_without_modulation_nothing_is_gained():
    law = periodic_lqr(mathieu_problem(depth=0.0, frequency=1.3)).require()
    averaged, refined = compare_laws(law).constants
    assert averaged.worst_cost_ratio == pytest.approx(1.0, abs=1e-8)
    assert refined.mean_cost_ratio == pytest.approx(1.0, abs=1e-8)


def test_the_map_agrees_with_the_certificate_at_the_design():
    speeds, depths = np.array([1.8, 1.9, 2.0, 2.1]), np.array([0.0, 0.45, 0.9, 1.1])
    unit = [PeriodicSystem.from_matrices([[0, 1], [-1, 0]], [[[0, 0], [-1.0, 0]]], frequency=v) for v in speeds]
    law = periodic_lqr(mathieu_problem(depth=0.9, frequency=2.0, weight=0.04)).require()
    constant = FourierMatrix.of(constant_lqr(law, refine=False)[0].gain, frequency=2.0)
    B = [[0.0], [1.0]]
    options = {"design_depth": 0.9, "parameter": speeds, "checks": 4, "harmonics_below": 1e-9}
    periodic_map, constant_map = (law_map(unit, B, x, depths, **options) for x in (law.gain, constant))
    assert periodic_map.spectral_radius[2, 2] == pytest.approx(law.certificate.spectral_radius, rel=1e-7)
    closed = np.array([[0, 1], [-1, 0]]) - np.array(B) @ law.gain.mean
    growth = np.max(np.linalg.eigvals(closed).real)
    assert periodic_map.growth_rate[2, 0] == pytest.approx(growth, rel=1e-8)
    assert not np.any(periodic_map.unstable)
    assert constant_map.unstable[2, 2]
    assert not np.any(periodic_map.unresolved | constant_map.unresolved)


def test_the_map_refuses_laws_that_do_not_fit():
    unit = [mathieu(1.0)] * 2
    law = FourierMatrix.of([[0.0, 1.0]], frequency=2.0)
    with pytest.raises(ValueError, match="gains: expected one law or 2"):
        law_map(unit, [[0.0], [1.0]], [law], [0.1], design_depth=0.1, parameter=[1.0, 2.0])
    with pytest.raises(ValueError, match="design_depth"):
        law_map(unit, [[0.0], [1.0]], law, [0.1], design_depth=0.0, parameter=[1.0, 2.0])
