"""Scheduled laws: interpolation, proofs between nodes, and mutants that the proofs catch."""

from dataclasses import replace

import numpy as np
import pytest

from maglev_ctrl.errors import ModelError, Status
from maglev_ctrl.proofs.claims import DecayClaim
from maglev_ctrl.proofs.prove import prove
from maglev_ctrl.synthesis.lmi.session import Clock
from maglev_ctrl.synthesis.scheduling.interpolated import scheduled_lqr
from maglev_ctrl.synthesis.scheduling.polytopic import polytopic_lpv
from maglev_ctrl.synthesis.scheduling.records import box_weights
from maglev_ctrl.synthesis.scheduling.segments import bernstein_loops, best_lyapunov, segment_limit
from maglev_ctrl.systems import Controller
from maglev_ctrl.systems.plant import Plant
from maglev_ctrl.systems.scheduled import ScheduledController


def _suspension(speed, *, effect=0.005):
    """Heave and pitch of an electrodynamic suspension: lift grows with speed, magnetic damping is negative."""
    mass, share = np.diag([2000.0, 3000.0]), speed**2 / (speed**2 + 20.0**2)
    K = 8e4 * share * np.array([[2.0, 0.005 * speed], [-0.005 * speed, 1.5]])
    C = -np.diag([4e3, 2e3]) / (1.0 + speed / 20.0)
    zero, one = np.zeros((2, 2)), np.eye(2)
    inverse = np.linalg.inv(mass)
    return Plant.from_matrices(
        np.block([[zero, one], [-inverse @ K, -inverse @ C]]), np.vstack([zero, one]),
        np.vstack([zero, inverse]) * 1e4 * (1.0 + effect * speed),
        np.vstack([np.diag([100.0, 100.0, 0, 0])[:2], np.zeros((2, 4))]),
        D12=np.vstack([zero, 2.0 * one]), states=("heave", "pitch", "heave.velocity", "pitch.velocity"),
        name=f"{speed:g} m/s",
    )  # fmt: skip


def _spring(stiffness, *, price=1.0):
    """A light, hardly controlled oscillator: varying its stiffness fast enough pumps it (Mathieu)."""
    return Plant.from_matrices(
        [[0.0, 1.0], [-stiffness, 0.0]], [[0.0], [1.0]], [[0.0], [1.0]], [[0.0, 0.3], [0.0, 0.0]],
        D12=[[0.0], [price]], name=f"k {stiffness:g}",
    )  # fmt: skip


def _magnet(pull):
    return Plant.from_matrices(
        [[0.0, 1.0], [pull, 0.0]], [[0.0], [1.0]], [[0.0], [1.0]], [[1.0, 0.0], [0.0, 0.0]], D12=[[0.0], [1.0]],
        name=f"pull {pull:g}",
    )  # fmt: skip


def test_schedule_interpolates_and_does_not_extrapolate():
    laws = tuple(Controller.static([[-k, -2 * k]], measured=("a", "b"), commands=("f",)) for k in (1.0, 3.0, 2.0))
    schedule = ScheduledController.from_nodes("speed", "m/s", [10.0, 20.0, 40.0], laws)
    assert [schedule.at(v).D[0, 0] for v in (10.0, 15.0, 20.0, 30.0, 40.0)] == [-1.0, -2.0, -3.0, -2.5, -2.0]
    for outside in (9.9, 40.1, np.nan):
        with pytest.raises(ValueError, match="speed: expected 10 to 40 m/s"):
            schedule.at(outside)
    with pytest.raises(ValueError, match="expected rising"):
        ScheduledController.from_nodes("speed", "m/s", [20.0, 10.0, 40.0], laws)
    with pytest.raises(ValueError, match="expected 2, one at each node"):
        ScheduledController.from_nodes("speed", "m/s", [20.0, 40.0], laws)
    other = Controller.static([[1.0]], measured=("a",), commands=("f",))
    with pytest.raises(ValueError, match="at speed 40 m/s has other signals"):
        ScheduledController.from_nodes("speed", "m/s", [10.0, 20.0, 40.0], (*laws[:2], other))


def test_interpolated_gains_of_a_suspension_hold_between_the_nodes():
    nodes = [10.0, 30.0, 60.0, 120.0]
    design = scheduled_lqr(
        [_suspension(v) for v in nodes], nodes, between=[(v, _suspension(v)) for v in (15.0, 45.0, 90.0)]
    )
    assert design.guarantee.startswith("interpolated") and design.rate_limit > 2.0  # a vehicle's 1 to 2 m/s per s
    assert all(check.proof.holds and check.abscissa < 0.0 for check in design.between)
    for v in np.linspace(10.0, 120.0, 23):
        plant, law = _suspension(v), design.schedule.at(v)
        assert np.max(np.linalg.eigvals(plant.A + plant.B2 @ law.D).real) < 0.0


def test_slow_variation_bound_holds_on_a_dense_grid_and_no_further_than_told():
    values = [1.0, 4.0, 9.0]
    plants = [_spring(k) for k in values]
    design = scheduled_lqr(plants, values, parameter="stiffness", unit="N/m")
    assert design.guarantee == "interpolated: slow variation"
    assert 0.0 < design.rate_limit < 20.0
    assert design.rate_limit == pytest.approx(np.min(design.segment_limits))
    K = [law.D for law in design.synthesis.controllers]
    for claim in design.synthesis.claims:
        i, j = claim.plants
        assert np.array_equal(claim.P[0], design.synthesis.claims[0].P[0]) or i > 0
        for share in np.linspace(0.0, 1.0, 101):
            A = (1 - share) * plants[i].A + share * plants[j].A
            loop = A + plants[0].B2 @ ((1 - share) * K[i] + share * K[j])
            P = (1 - share) * claim.P[0] + share * claim.P[1]
            for sign in (1.0, -1.0):
                moved = sign * claim.speed_limit / claim.width * (claim.P[1] - claim.P[0])
                assert np.max(np.linalg.eigvalsh(loop.T @ P + P @ loop + moved)) < 0.0
        faster = replace(claim, speed_limit=3.0 * claim.speed_limit)
        assert not prove(faster, plants, design.synthesis.controllers).holds
    # V must not jump at a node: neighbouring segments share their matrix
    assert np.array_equal(design.synthesis.claims[0].P[1], design.synthesis.claims[1].P[0])


def test_the_bound_is_no_artefact_a_fast_parameter_does_pump_the_loop():
    """Stiffness swung between the nodes at twice the natural frequency (Floquet multipliers by integration)."""
    low, high = 1.0, 4.0
    design = scheduled_lqr([_spring(low), _spring(high)], [low, high], parameter="stiffness", unit="N/m")
    rate = 2.0 * np.sqrt(2.5)
    period, steps = 2.0 * np.pi / rate, 4000

    def largest_multiplier(slowing):
        monodromy, h = np.eye(2), slowing * period / steps
        for i in range(steps):
            k = 2.5 + 1.5 * np.cos(rate / slowing * (i + 0.5) * h)
            A = _spring(k).A + _spring(k).B2 @ design.schedule.at(float(np.clip(k, low, high))).D
            monodromy = (np.eye(2) + h * A + 0.5 * h * h * A @ A) @ monodromy
        return np.max(np.abs(np.linalg.eigvals(monodromy)))

    assert largest_multiplier(1.0) > 1.0  # 1.5 * 3.16 = 4.7 N/m per s
    slow = 1.5 * rate / design.rate_limit
    assert largest_multiplier(slow) < 1.0
    assert design.rate_limit < 1.5 * rate


def test_swapped_gains_of_two_nodes_are_caught():
    plants = [_magnet(1.0), _magnet(20.0), _magnet(60.0)]
    design = scheduled_lqr(plants, [0.0, 1.0, 2.0], parameter="gap", unit="mm")
    laws = design.require().synthesis.controllers
    assert all(prove(claim, plants, laws).holds for claim in design.synthesis.claims)
    swapped = (laws[2], laws[1], laws[0])
    assert not all(prove(claim, plants, swapped).holds for claim in design.synthesis.claims)


def test_a_plant_between_the_nodes_that_is_not_held_is_told_then_refined():
    def plant_at(value):
        return _magnet(1.0 + 400.0 * value * (1.0 - value))  # pulls hardest in the middle

    nodes, middle = [0.0, 1.0], [(0.5, plant_at(0.5))]
    coarse = scheduled_lqr([plant_at(v) for v in nodes], nodes, between=middle, parameter="gap", unit="mm")
    assert coarse.guarantee == "none" and coarse.synthesis.status is Status.NOT_VERIFIED
    assert "UNRESOLVED at gap 0.5 mm, between the nodes" in coarse.synthesis.message
    with pytest.raises(ModelError, match="give a denser grid"):
        coarse.law_at([0.5])
    fine = scheduled_lqr(
        [plant_at(v) for v in nodes], nodes, between=middle, parameter="gap", unit="mm", plant_at=plant_at
    )
    assert fine.schedule.nodes.tolist() == [0.0, 0.5, 1.0]
    assert len(fine.synthesis.controllers) == 3 and all(check.proof.holds for check in fine.between)


def test_refinement_raises_the_rate_towards_what_is_wanted():
    ends = [1.0, 9.0]
    coarse = scheduled_lqr([_spring(k) for k in ends], ends, parameter="stiffness", unit="N/m")
    wanted = 1.05 * coarse.rate_limit
    fine = scheduled_lqr(
        [_spring(k) for k in ends], ends, parameter="stiffness", unit="N/m", plant_at=_spring, wanted_rate=wanted,
        refinements=2,
    )  # fmt: skip
    assert len(fine.schedule.nodes) > 2 and fine.rate_limit > coarse.rate_limit
    assert fine.rate_limit >= wanted or any("is not proved" in note for note in fine.synthesis.notes)


def test_one_inequality_for_all_nodes_is_at_least_as_good_as_lyapunov_equations():
    plants, nodes = [_spring(1.0), _spring(4.0)], np.array([1.0, 4.0])
    gains = np.stack([[[0.0, -0.3]], [[0.0, -0.3]]])
    loops = bernstein_loops(np.stack([p.A for p in plants]), np.stack([p.B2 for p in plants]), gains)
    P, rate = best_lyapunov([loops], nodes, start=0.0, clock=Clock(30.0))
    assert P is not None and segment_limit(loops, P[0], P[1], 3.0) >= 0.99 * rate > 0.0
    unstable = [loop + np.eye(2) for loop in loops]
    assert best_lyapunov([unstable], nodes, start=0.0, clock=Clock(30.0))[0] is None


@pytest.mark.parametrize("effect", [0.0, 0.005])
@pytest.mark.parametrize("objective", ["h2", "h_infinity", "decay"])
def test_polytopic_law_has_one_matrix_for_all_blends(objective, effect):
    nodes = [20.0, 50.0, 120.0]
    plants = [_suspension(v, effect=effect) for v in nodes]
    design = polytopic_lpv(plants, nodes, objective=objective, rate=1.0, parameter="speed", unit="m/s")
    assert design.guarantee == "polytopic: any variation" and design.rate_limit == np.inf
    claim = design.synthesis.claims[0]
    assert isinstance(claim, DecayClaim) and claim.cross == (effect > 0.0)
    laws, random = design.synthesis.controllers, np.random.default_rng(3)
    for weights in random.dirichlet(np.ones(3), 20):
        A, B = (sum(w * getattr(p, key) for w, p in zip(weights, plants, strict=True)) for key in ("A", "B2"))
        loop = A + B @ sum(w * law.D for w, law in zip(weights, laws, strict=True))
        P = claim.P[0]
        assert np.max(np.linalg.eigvalsh(loop.T @ P + P @ loop + 2.0 * P)) < 0.0
    assert pytest.approx(0.5 * (laws[0].D + laws[1].D)) == design.law_at([35.0]).D
    turned = tuple(replace(law, D=-law.D) for law in laws)
    assert not prove(claim, plants, turned).holds


def test_guaranteed_h2_norm_of_equal_vertices_is_the_optimum():
    """Both vertices the same: K is the LQR of A'P + P A - P B B'P + C'C = 0, norm^2 = trace B1'P B1 = P22."""
    plant = _magnet(1.0)
    design = polytopic_lpv([plant, plant], [0.0, 1.0])
    p12 = 1.0 + np.sqrt(2.0)
    p22 = np.sqrt(2.0 * p12)
    assert design.synthesis.performance[0].recomputed == pytest.approx(np.sqrt(p22), rel=1e-4)
    assert pytest.approx(np.array([[-p12, -p22]]), rel=1e-3) == design.synthesis.controllers[0].D


def test_two_parameters_over_a_box():
    corners = [[0.0, 0.0], [1.0, 0.0], [0.0, 2.0], [1.0, 2.0]]

    def plant(gap, load):
        return replace(_magnet(10.0 + 20.0 * gap), B2=np.array([[0.0], [1.0 / (1.0 + 0.2 * load)]]))

    plants = [plant(*corner) for corner in corners]
    design = polytopic_lpv(plants, corners, objective="decay", rate=0.5)
    assert design.schedule is None and design.guarantee == "polytopic: any variation"
    weights = box_weights(design.corners, np.array([0.3, 0.5]))
    law = design.law_at([0.3, 0.5])
    assert weights.sum() == pytest.approx(1.0)
    A, B = (sum(w * getattr(p, key) for w, p in zip(weights, plants, strict=True)) for key in ("A", "B2"))
    assert np.max(np.linalg.eigvals(A + B @ law.D).real) < -0.5
    with pytest.raises(ValueError, match="expected a point between"):
        design.law_at([1.3, 0.5])


def test_swapped_vertex_laws_are_caught():
    plants = [_magnet(1.0), _magnet(80.0)]
    design = polytopic_lpv(plants, [0.0, 1.0], objective="h2", parameter="gap", unit="mm")
    first, last = design.require().synthesis.controllers
    claim = design.synthesis.claims[0]
    assert prove(claim, plants, (first, last)).holds
    assert not prove(claim, plants, (last, first)).holds


def test_a_command_that_changes_its_sign_has_no_common_matrix():
    """Half way the command moves nothing: no blended law can hold every blend."""
    plants = [_magnet(1.0), replace(_magnet(1.0), B2=np.array([[0.0], [-1.0]]))]
    design = polytopic_lpv(plants, [0.0, 1.0])
    assert "in the mean of the vertices the commands cannot move the mode" in design.synthesis.message
    assert design.guarantee == "none" and not design.synthesis.controllers
    assert np.isnan(design.rate_limit)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: scheduled_lqr([_magnet(1.0)], [0.0]), "at least two"),
        (lambda: scheduled_lqr([_magnet(1.0)] * 2, [1.0, 0.0]), "rising values"),
        (lambda: scheduled_lqr([_magnet(1.0)] * 2, [0.0, 1.0], between=[(2.0, _magnet(1.0))]), "between: expected"),
        (lambda: scheduled_lqr([replace(_magnet(1.0), D12=np.zeros((2, 1)))] * 2, [0.0, 1.0]), "must be weighed"),
        (lambda: scheduled_lqr([replace(_magnet(1.0), dt=0.1)] * 2, [0.0, 1.0]), "expected a continuous plant"),
        (lambda: polytopic_lpv([_magnet(1.0)] * 2, [0.0, 1.0], objective="h1"), "objective: expected"),
        (lambda: polytopic_lpv([_magnet(1.0)] * 2, [0.0, 1.0], rate=-1.0), "rate: expected"),
        (lambda: polytopic_lpv([_magnet(1.0)] * 3, [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]), "corners of a box"),
        (lambda: polytopic_lpv([_magnet(1.0)] * 2, [1.0, 0.0]), "expected rising"),
    ],
)  # fmt: skip
def test_refusals(call, words):
    with pytest.raises(ValueError, match=words):
        call()


def test_a_mode_no_command_moves_is_named():
    plant = replace(_magnet(1.0), B2=np.zeros((2, 1)))
    with pytest.raises(ModelError, match="cannot move the mode"):
        scheduled_lqr([plant, plant], [0.0, 1.0])
