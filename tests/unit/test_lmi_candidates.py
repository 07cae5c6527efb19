"""Stiff plants in newtons with outputs that repeat: proved in little time, close to what no law can beat."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad_vec
from scipy.linalg import null_space, solve_continuous_are, solve_continuous_lyapunov

from maglev_ctrl.analysis.hamiltonian import h_infinity_norm
from maglev_ctrl.errors import Status
from maglev_ctrl.proofs.claims import DecayClaim, EnergyClaim, ParameterClaim
from maglev_ctrl.proofs.prove import prove
from maglev_ctrl.synthesis.lmi import LmiSession, MultiObjective, closed_loops, multi_objective, quadratic_stability
from maglev_ctrl.synthesis.lmi import candidates as candidates_module
from maglev_ctrl.synthesis.lmi.blends import vertex_claims
from maglev_ctrl.synthesis.lmi.certify import common_claims, recomputed, state_feedback
from maglev_ctrl.synthesis.lmi.coordinates import compressed, distinct, regulator_basis
from maglev_ctrl.synthesis.lmi.optimise import optimise
from maglev_ctrl.synthesis.lmi.problem import Optimum, pose
from maglev_ctrl.synthesis.lmi.scaling import find_scaling, scale_vertex
from maglev_ctrl.synthesis.lmi.session import Clock
from maglev_ctrl.systems.plant import Plant

SESSION = LmiSession()


def bogie(mass=20e3, magnets=9e6, *, gaps=6, name="bogie"):
    """A car of 54 t on a bogie over magnets, 1.36 MN/m between; a coil of 30 Hz lifts the bogie.

    Watched: acceleration of the car (0.5 m/s^2), `gaps` equal magnet gaps (20 mm together), coil (20 kN).
    """
    car, spring, lag = 54e3, 1.36e6, 2.0 * np.pi * 30.0
    lower = magnets + spring
    A = np.array([
        [0.0, 0.0, 1.0, 0.0, 0.0],
        [0.0, 0.0, 0.0, 1.0, 0.0],
        [-spring / car, spring / car, 0.0, 0.0, 0.0],
        [spring / mass, -lower / mass, 0.0, 2e-3, 1.0 / mass],
        [0.0, 0.0, 0.0, 0.0, -lag],
    ])  # fmt: skip
    B1 = np.array([[0.0, 0.0], [0.0, 0.0], [0.5, 0.0], [0.0, 0.5], [0.0, 0.0]])
    gap = np.array([0.0, 1.0, 0.0, 0.0, 0.0]) / (0.02 * np.sqrt(gaps))
    C1 = np.vstack([A[2] / 0.5, *[gap] * gaps, np.zeros(5)])
    D12 = np.zeros((gaps + 2, 1))
    D12[-1] = 1.0 / 20e3
    return Plant.from_matrices(A, B1, [[0.0]] * 4 + [[lag]], C1, D12=D12, name=name)


CORNERS = [bogie(m, k, name=f"{m:g} kg, {k:g} N/m") for m in (12e3, 24e3) for k in (6e6, 12e6)]


REQUEST = MultiObjective("h2", decay_rate=0.2)


@cache
def designed(lyapunov):
    return multi_objective(CORNERS, REQUEST, lyapunov=lyapunov, session=SESSION).require()


def energy(plant, law):
    """H2 norm by the integral over frequency: no Lyapunov equation."""
    closed, C = plant.A + plant.B2 @ law, plant.C1 + plant.D12 @ law
    # Balanced by hand (metres, newtons), and split where the resonances are.
    T = np.array([1e-2, 1e-2, 1e-1, 1e-1, 1e4])
    closed, B, C = closed * T / T[:, None], plant.B1 / T[:, None], C * T

    def density(w):
        return np.linalg.norm(C @ np.linalg.solve(1j * w * np.eye(5) - closed, B)) ** 2

    points = np.concatenate([[0.0], np.unique(np.round(np.abs(np.linalg.eigvals(closed)), 6)), [1e3, np.inf]])
    pairs = pairwise(points)
    return np.sqrt(sum(quad_vec(density, a, b, epsrel=1e-8)[0] for a, b in pairs) / np.pi)


def least(plant):
    """What a regulator for this plant alone has."""
    T = np.array([1e-2, 1e-2, 1e-1, 1e-1, 1e4])
    A, B, C = plant.A * T / T[:, None], plant.B2 / T[:, None], plant.C1 * T
    P = solve_continuous_are(A, B, C.T @ C, plant.D12.T @ plant.D12, s=C.T @ plant.D12)
    w = plant.B1 / T[:, None]
    return np.sqrt(np.trace(w.T @ P @ w))


class TestStiffPolytope:
    def test_a_common_matrix_is_proved_in_one_solve(self):
        found = designed("common")
        assert found.status is Status.SOLVED and found.notes[0].startswith("1 semidefinite")
        decay, level = found.claims
        assert isinstance(decay, DecayClaim) and isinstance(level, EnergyClaim) and len(level.plants) == 4
        norms = [energy(plant, found.controller.D) for plant in CORNERS]
        told = [one.recomputed for one in found.performance if one.quantity.startswith("H2 norm")]
        assert np.allclose(told, norms, rtol=1e-5)
        assert max(map(least, CORNERS)) * (1.0 - 1e-6) < max(norms) < level.level

    def test_matrices_of_the_vertices_come_close_to_what_no_law_can_beat(self):
        found = designed("parameter_dependent")
        norms = [energy(plant, found.controller.D) for plant in CORNERS]
        bound = max(map(least, CORNERS))
        assert bound * (1.0 - 1e-6) < max(norms) < 1.03 * bound
        levels = [one.level for one in found.claims if isinstance(one, EnergyClaim)]
        assert np.all(np.array(levels) > norms) and np.allclose(levels, norms, rtol=2e-3)
        assert any("no one law stays below" in note for note in found.notes)
        poles = [np.max(np.linalg.eigvals(p.A + p.B2 @ found.controller.D).real) for p in CORNERS]
        assert max(poles) < -0.2

    def test_a_norm_that_one_matrix_cannot_prove_is_claimed_at_the_vertices(self):
        law = designed("common").controller
        worst = max(energy(plant, law.D) for plant in CORNERS)
        request = MultiObjective("feasible", h2_below=1.001 * worst)
        problem = pose(tuple(CORNERS), request, session=SESSION, clock=Clock(60.0))
        values = {"slack": np.eye(5), "Y": problem.scaled(law.D), "energy": np.array(1.0)}
        claims, notes = common_claims(problem, Optimum(Status.SOLVED, values, rate=0.05), law)
        assert [type(one) for one in claims] == [DecayClaim] + [EnergyClaim] * 4
        assert "vertices only" in notes[0]
        assert all(prove(one, CORNERS, [law]).holds for one in claims)
        # A mutant: the same claims for a law of half the gain.
        half = replace(law, D=0.5 * law.D)
        assert not all(prove(one, CORNERS, [half]).holds for one in claims)

    def test_decay_between_the_vertices_is_never_given_up(self):
        """The law for constant parameters: no quadratic function is common to its loops, and none is claimed."""
        found = designed("parameter_dependent")
        assert isinstance(found.claims[0], ParameterClaim)
        assert quadratic_stability(closed_loops(CORNERS, found.controller)).stable is not True
        problem = pose(tuple(CORNERS), MultiObjective("h2"), session=SESSION, clock=Clock(60.0))
        values = {"slack": np.eye(5), "Y": problem.scaled(found.controller.D), "energy": np.array(1.0)}
        claims, _ = common_claims(problem, Optimum(Status.SOLVED, values, rate=0.05), found.controller)
        assert isinstance(claims[0], DecayClaim) and not prove(claims[0], CORNERS, found.controllers).holds

    def test_no_claim_where_the_decay_between_is_not_proved(self):
        request = MultiObjective("h2", decay_rate=50.0)
        problem = pose(tuple(CORNERS), REQUEST, session=SESSION, clock=Clock(60.0))
        law = state_feedback(problem, problem.gain(optimise(problem).values), "law")
        optimum = Optimum(Status.SOLVED, {"energy": np.array(1.0)}, rate=50.0)
        claims, why = vertex_claims(problem.with_request(request), optimum, law)
        assert not claims and "between the vertices" in why


class TestCoordinates:
    def vertices(self, plants):
        request = MultiObjective("h2")
        scaling = find_scaling(plants, request)
        return [scale_vertex(plant, request, scaling) for plant in plants]

    def test_fewer_signals_have_the_same_norms(self):
        rng = np.random.default_rng(4)
        plant = Plant.from_matrices(
            rng.normal(size=(4, 4)) - 4.0 * np.eye(4), rng.normal(size=(4, 3)) @ rng.normal(size=(3, 6)),
            rng.normal(size=(4, 1)), np.tile(rng.normal(size=(2, 4)), (3, 1)), D12=np.tile([[1.0], [2.0]], (3, 1)),
        )  # fmt: skip
        whole = self.vertices([plant])[0]
        few = compressed([whole])[0]
        assert few.h2[0].shape == (4, 3) and few.h2[1].shape == (2, 4) and few.h_infinity[1].shape == (2, 4)
        K = 0.1 * rng.normal(size=(1, 4))
        for a, b, factor in ((whole, few, 1.0), (whole, replace(few, h2=(few.h2[0], 1.1 * few.h2[1], few.h2[2])), 1.1)):
            sizes = []
            for v in (a, b):
                B, C, D = v.h2
                W = solve_continuous_lyapunov(v.A + v.B @ K, -B @ B.T)
                sizes.append(np.trace((C + D @ K) @ W @ (C + D @ K).T))
            assert (abs(sizes[1] / sizes[0] - 1.0) < 1e-10) == (factor == 1.0)
        peaks = [
            h_infinity_norm(v.A + v.B @ K, v.h_infinity[0], v.h_infinity[1] + v.h_infinity[2] @ K, v.h_infinity[3])
            for v in (whole, few)
        ]
        assert peaks[1].lower == pytest.approx(peaks[0].lower, rel=1e-6)
        assert null_space(whole.h2[0]).shape[1] == 3

    def test_outputs_that_repeat_change_nothing(self):
        laws = [
            multi_objective([bogie(gaps=count)], MultiObjective("h2"), session=LmiSession()).require().controller.D
            for count in (1, 8)
        ]
        norms = [energy(bogie(), law) for law in laws]
        assert norms == pytest.approx([least(bogie())] * 2, rel=1e-4)

    def test_copies_of_a_vertex_are_solved_once_and_proved_each(self):
        plants = [CORNERS[0], CORNERS[3], CORNERS[0]]
        assert distinct(self.vertices(plants)) == (0, 1)
        problem = pose(tuple(plants), MultiObjective("h2"), session=SESSION, clock=Clock(60.0))
        assert problem.shape.vertices == 2
        found = multi_objective(plants, MultiObjective("h2"), session=SESSION).require()
        assert all(len(claim.plants) == 3 for claim in found.claims)

    def test_the_regulators_certificate_is_the_identity(self):
        vertices = self.vertices(CORNERS)
        T = regulator_basis(vertices)
        A, B = np.mean([v.A for v in vertices], axis=0), np.mean([v.B for v in vertices], axis=0)
        C, D = (np.mean([v.h2[k] for v in vertices], axis=0) for k in (1, 2))
        P = solve_continuous_are(A, B, C.T @ C + 1e-4 * np.linalg.norm(C, 2) ** 2 * np.eye(5), D.T @ D, s=C.T @ D)
        assert np.allclose(T.T @ P @ T, np.eye(5), atol=1e-3)

    def test_recomputed_norms_do_not_depend_on_units(self):
        law = multi_objective([CORNERS[0]], MultiObjective("h2"), session=SESSION).require()
        problem = pose((CORNERS[0],), MultiObjective("h2"), session=SESSION, clock=Clock(60.0))
        told = next(one.recomputed for one in recomputed(problem, law.controller) if one.quantity == "H2 norm")
        assert told == pytest.approx(energy(CORNERS[0], law.controller.D), rel=1e-6)


def test_the_law_of_a_common_matrix_is_there_when_the_time_is_up(monkeypatch):
    def late(problem):
        return optimise(problem) if problem.lyapunov == "common" else Optimum(Status.TIME_LIMIT, {})

    monkeypatch.setattr(candidates_module, "optimise", late)
    found = multi_objective(CORNERS, REQUEST, lyapunov="parameter_dependent", session=SESSION).require()
    assert isinstance(found.claims[0], DecayClaim) and len(found.claims) == 5
    assert found.status is Status.ALMOST_SOLVED
    assert any("the time was up" in note for note in found.notes)


def test_cvxopt_takes_over_where_clarabel_stumbles(monkeypatch):
    pytest.importorskip("cvxopt")

    def stumbling(problem):
        return Optimum(Status.NUMERICAL_ERROR, {}) if problem.solver == "CLARABEL" else optimise(problem)

    monkeypatch.setattr(candidates_module, "optimise", stumbling)
    found = multi_objective([CORNERS[0]], MultiObjective("h2"), session=SESSION).require()
    assert any("the answer is CVXOPT's" in note for note in found.notes)
    assert energy(CORNERS[0], found.controller.D) < 1.01 * least(CORNERS[0])
    in_a_hurry = multi_objective([CORNERS[0]], MultiObjective("h2"), session=SESSION, time_limit=5.0)
    assert in_a_hurry.status is Status.NUMERICAL_ERROR and not in_a_hurry.controllers
