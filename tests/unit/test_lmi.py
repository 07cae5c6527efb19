"""Multi-objective state feedback: closed forms, bounds kept, conflicts named, limits of time, problems reused."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import solve_continuous_are

from maglev_ctrl.analysis.hamiltonian import h_infinity_norm
from maglev_ctrl.errors import ModelError, Status
from maglev_ctrl.proofs.claims import DecayClaim, EllipsoidClaim, ParameterClaim
from maglev_ctrl.proofs.prove import prove
from maglev_ctrl.synthesis.lmi import (
    Channel,
    CommandLimits,
    LmiSession,
    MultiObjective,
    contains,
    damping,
    disk,
    half_plane,
    intersection,
    multi_objective,
    strip,
)
from maglev_ctrl.synthesis.lmi.conditions import Shape, build
from maglev_ctrl.systems.plant import Plant

SESSION = LmiSession()


def magnet(stiffness=1000.0, actuator=1.0, *, price=1e-3, name="magnet"):
    """A magnet: x'' = stiffness x + actuator u + w; the air gap and the priced command are watched."""
    return Plant.from_matrices(
        [[0.0, 1.0], [stiffness, 0.0]], [[0.0], [1.0]], [[0.0], [actuator]], [[1.0, 0.0], [0.0, 0.0]],
        D12=[[0.0], [price]], states=("gap", "speed"), name=name,
    )  # fmt: skip


CORNERS = [magnet(k, b, name=f"k {k:g} b {b:g}") for k in (500.0, 4000.0) for b in (0.4, 1.6)]


def design(plants, request, **options):
    return multi_objective(plants, request, session=SESSION, **options)


def poles(plants, law):
    return np.concatenate([np.linalg.eigvals(plant.A + plant.B2 @ law.controller.D) for plant in plants])


def scalar(a=1.0, b=2.0):
    return Plant.from_matrices([[a]], [[1.0]], [[b]], [[1.0], [0.0]], D12=[[0.0], [1.0]])


class TestClosedForms:
    def test_least_gain_of_one_state(self):
        found = design([scalar(3.0, 2.0)], MultiObjective("gain", decay_rate=1.0)).require()
        # 3 - 2 k < -1 needs k > 2; the law gives up at most 0.2 % of the square.
        assert 2.0 < -found.controller.D.item() < 2.0 * 1.0015

    def test_h2_of_one_state_is_the_regulators(self):
        found = design([scalar()], MultiObjective("h2")).require()
        P = solve_continuous_are([[1.0]], [[2.0]], [[1.0]], [[1.0]]).item()
        norm = next(one.recomputed for one in found.performance if one.quantity == "H2 norm")
        assert np.sqrt(P) * (1.0 - 1e-9) <= norm <= np.sqrt(P) * 1.003

    def test_h_infinity_of_one_state(self):
        found = design([scalar()], MultiObjective("h_infinity")).require()
        # x' = x + 2u + w, z = (x, u), u = k x: |1 + k^2|^(1/2) / |1 + 2k| at zero frequency, least at k = -inf: 1/2.
        norm = next(one.recomputed for one in found.performance if one.quantity == "H-infinity norm")
        gain = found.controller.D.item()
        assert norm == pytest.approx(np.hypot(1.0, gain) / abs(1.0 + 2.0 * gain), rel=1e-6)
        best = min(np.hypot(1.0, k) / abs(1.0 + 2.0 * k) for k in np.linspace(-300.0, -0.6, 100001))
        assert norm <= 1.005 * best

    def test_a_mutant_of_the_bound_is_caught(self):
        found = design([scalar()], MultiObjective("h2")).require()
        claim = next(one for one in found.claims if hasattr(one, "level"))
        assert prove(claim, found.plants, found.controllers).holds
        assert not prove(replace(claim, level=0.99 * claim.level), found.plants, found.controllers).holds
        flipped = replace(found.controller, D=-found.controller.D)
        assert not prove(claim, found.plants, [flipped]).holds


class TestBounds:
    @pytest.mark.parametrize(
        "region",
        [damping(0.6), half_plane(8.0), disk(-60.0, 55.0), intersection(strip(300.0), damping(0.3), half_plane(4.0))],
        ids=lambda one: one.label,
    )
    def test_poles_lie_in_the_region(self, region):
        found = design([magnet()], MultiObjective("feasible", region=region)).require()
        assert contains(region, poles([magnet()], found)).all()

    def test_gain_stays_below(self):
        free = design([magnet()], MultiObjective("h2")).require()
        size = np.linalg.norm(free.controller.D, 2)
        tied = design([magnet()], MultiObjective("h2", gain_below=0.8 * size))
        assert np.linalg.norm(tied.require().controller.D, 2) < 0.8 * size

    @pytest.mark.slow
    def test_everything_at_once(self):
        region = intersection(damping(0.4), strip(3000.0))
        request = MultiObjective("h2", h_infinity_below=0.02, decay_rate=4.0, region=region, gain_below=1e5)
        found = design(CORNERS, request).require()
        assert contains(intersection(region, half_plane(4.0)), poles(CORNERS, found)).all()
        for plant in CORNERS:
            closed, C = plant.A + plant.B2 @ found.controller.D, plant.C1 + plant.D12 @ found.controller.D
            assert h_infinity_norm(closed, plant.B1, C, plant.D11).lower < 0.02
        assert all(proof.holds for proof in found.proofs) and len(found.proofs) == 4

    def test_channels_choose_what_a_norm_is_taken_of(self):
        gap = Channel(performance=("z1",))
        found = design([magnet()], MultiObjective("h2", h2_channel=Channel(performance=("z2",)),
                                                  h_infinity_below=5e-3, h_infinity_channel=gap)).require()  # fmt: skip
        closed = magnet().A + magnet().B2 @ found.controller.D
        assert h_infinity_norm(closed, magnet().B1, [[1.0, 0.0]], [[0.0]]).lower < 5e-3

    @pytest.mark.parametrize("box", [True, False])
    def test_commands_stay_within_their_limits(self, box):
        start = np.array([2e-3, 0.05])
        states = None if box else np.array([start, start * [1.0, -1.0]])
        limits = CommandLimits((15.0,), initial_states=states, allowed=start if box else None)
        found = design(CORNERS[:2], MultiObjective("feasible", decay_rate=3.0, commands=limits)).require()
        claim = next(one for one in found.claims if isinstance(one, EllipsoidClaim))
        corners = [start, start * [1.0, -1.0]]
        assert all(x @ claim.P[0] @ x <= 1.0 for x in corners)
        for plant in CORNERS[:2]:
            closed = plant.A + plant.B2 @ found.controller.D
            step = np.linalg.matrix_power(np.eye(2) + closed * 1e-5 + closed @ closed * 5e-11, 20)
            for x in corners:
                state, largest = np.array(x), 0.0
                for _ in range(2000):
                    largest = max(largest, abs((found.controller.D @ state).item()))
                    state = step @ state
                assert largest < 15.0


class TestVertices:
    def test_one_law_holds_corners_where_the_nominal_regulator_fails(self):
        nominal = magnet(1000.0, 1.0)
        P = solve_continuous_are(nominal.A, nominal.B2, nominal.C1.T @ nominal.C1, [[1.0]])
        regulator = -nominal.B2.T @ P
        assert np.max(np.linalg.eigvals(nominal.A + nominal.B2 @ regulator).real) < 0.0
        assert max(np.max(np.linalg.eigvals(p.A + p.B2 @ regulator).real) for p in CORNERS) > 0.0
        found = design(CORNERS, MultiObjective("h2", decay_rate=2.0)).require()
        assert np.max(poles(CORNERS, found).real) < -2.0
        rng = np.random.default_rng(3)
        for share in rng.dirichlet(np.ones(4), 50):
            A = sum(s * p.A for s, p in zip(share, CORNERS, strict=True))
            B = sum(s * p.B2 for s, p in zip(share, CORNERS, strict=True))
            assert np.max(np.linalg.eigvals(A + B @ found.controller.D).real) < -2.0

    @pytest.mark.slow
    def test_constant_parameters_allow_more(self):
        request = MultiObjective("decay", gain_below=30000.0)
        common = design(CORNERS, request).require()
        single = design(CORNERS, request, lyapunov="parameter_dependent").require()
        rates = [one.claims[0].rate for one in (common, single)]
        assert isinstance(common.claims[0], DecayClaim) and isinstance(single.claims[0], ParameterClaim)
        assert rates[1] > 1.05 * rates[0]
        assert np.max(poles(CORNERS, single).real) < -rates[1]

    def test_the_best_decay_rate_of_one_plant_is_bound_by_the_gain(self):
        found = design([scalar(3.0, 2.0)], MultiObjective("decay", gain_below=5.0)).require()
        assert found.claims[0].rate == pytest.approx(7.0, rel=5e-3)


class TestRefusals:
    def test_a_pair_that_conflicts_is_named(self):
        found = design([scalar(3.0, 2.0)], MultiObjective("h2", decay_rate=5.0, gain_below=3.0, h2_below=50.0))
        assert found.status is Status.INFEASIBLE and not found.controllers
        assert "a decay rate of 5 1/s and a gain below 3 cannot both be met: each alone can" in found.message

    def test_a_requirement_that_fails_alone_is_named_alone(self):
        found = design([magnet()], MultiObjective("feasible", decay_rate=1.0, gain_below=100.0))
        assert found.message.startswith("a gain below 100 cannot be met (the test of the gain is sufficient only")

    def test_a_decay_rate_without_bound_is_said_to_be_so(self):
        for plants in ([scalar()], CORNERS):
            found = design(plants, MultiObjective("decay"))
            assert found.status is Status.UNBOUNDED and not found.controllers
            assert "as large as wanted" in found.message

    @pytest.mark.parametrize("limit", [0.0, 1e-4, 0.03])
    def test_the_time_limit_holds(self, limit):
        design([magnet()], MultiObjective("decay", gain_below=1e5))
        started = time.monotonic()
        found = design(CORNERS, MultiObjective("decay", gain_below=30000.0), time_limit=limit)
        assert time.monotonic() - started < limit + 2.0
        if found.controllers:  # what was reached in time, proved, and said to be no more than that
            assert limit > 1e-3 and found.status is Status.ALMOST_SOLVED
            assert any("stopped before its end" in note for note in found.notes)
        else:
            assert found.status is Status.TIME_LIMIT
            assert found.message.startswith(f"not finished within {limit:g} s")

    @pytest.mark.parametrize(
        ("plants", "request_", "fault", "words"),
        [
            ([], MultiObjective(), ValueError, "at least one vertex"),
            ([magnet()], MultiObjective(decay_rate=-1.0), ValueError, "decay_rate: expected a positive"),
            ([magnet()], MultiObjective(h2_below=0.0), ValueError, "h2_below: expected a positive"),
            ([magnet()], MultiObjective("best"), ValueError, "objective: expected one of"),
            ([magnet()], MultiObjective("h2", h2_channel=Channel(("wind",))), ValueError, "'wind' is not among"),
            ([magnet(), scalar()], MultiObjective(), ValueError, "same states at every vertex"),
            ([magnet(actuator=0.0)], MultiObjective(), ModelError, "cannot move the mode at 31.6"),
            ([replace(magnet(), dt=0.01)], MultiObjective(), ModelError, "sampled every 0.01 s"),
            ([replace(magnet(), D11=np.ones((2, 1)))], MultiObjective("h2"), ModelError, "H2 norm is infinite"),
            ([replace(magnet(), C2=np.eye(2)[::-1])], MultiObjective(), ModelError, "every state measured"),
            ([magnet()], MultiObjective(commands=CommandLimits((1.0,))), ValueError, "either initial_states or"),
            ([magnet()], MultiObjective(commands=CommandLimits((1.0, 2.0))), ValueError, "limits: expected 1"),
        ],
    )
    def test_what_cannot_be_meant_is_said_in_a_sentence(self, plants, request_, fault, words):
        with pytest.raises(fault, match=words):
            design(plants, request_)

    def test_a_mode_too_slow_for_the_rate_is_named(self):
        plant = Plant.from_matrices([[1.0, 0.0], [0.0, -0.5]], np.ones((2, 1)), [[1.0], [0.0]], np.eye(2))
        with pytest.raises(ModelError, match="x2, which decays more slowly than 2 1/s"):
            design([plant], MultiObjective(decay_rate=2.0))


class TestReuse:
    def test_problems_are_disciplined_in_their_parameters(self):
        for lyapunov in ("common", "parameter_dependent"):
            region = ((0.8, 0.6), (-0.6, 0.8))
            shape = Shape(2, 3, 1, h2=(2, 1), h_infinity=(2, 1), decay=True, region=region, lyapunov=lyapunov)
            assert build(shape).problem.is_dcp(dpp=True)

    def test_the_next_operating_point_costs_less(self):
        session = LmiSession()
        plants = [magnet(k) for k in (900.0, 1000.0, 1100.0, 1200.0)]
        seconds = []
        for plant in plants:
            started = time.perf_counter()
            multi_objective(
                [plant], MultiObjective("h2", decay_rate=3.0, region=damping(0.3)), session=session
            ).require()
            seconds.append(time.perf_counter() - started)
        assert min(seconds[1:]) < seconds[0]

    def test_what_was_solved_before_changes_nothing(self):
        session = LmiSession()
        gains = []
        for plant in (magnet(1000.0), magnet(3000.0, 0.1), magnet(1000.0)):
            found = multi_objective([plant], MultiObjective("h2"), session=session).require()
            gains.append(found.controller.D)
        assert np.array_equal(gains[0], gains[2])

    def test_another_solver_agrees(self):
        pytest.importorskip("cvxopt")
        found = design([magnet()], MultiObjective("h2"), cross_check=True).require()
        assert "CVXOPT finds the same optimum" in found.notes

    def test_units_do_not_matter(self):
        """Metres or micrometres, newtons or kilonewtons: the same law."""
        T, S = np.diag([1e6, 1e3]), 1e-3
        plant = magnet()
        other = Plant.from_matrices(
            T @ plant.A @ np.linalg.inv(T), T @ plant.B1, T @ plant.B2 * S, plant.C1 @ np.linalg.inv(T),
            D12=plant.D12 * S, states=plant.states,
        )  # fmt: skip
        first, second = (design([one], MultiObjective("h2")).require() for one in (plant, other))
        assert np.allclose(S * second.controller.D @ T, first.controller.D, rtol=0.02)
