"""Bounds that are slack, tight or impossible, and the largest decay rate, on a plant in newtons and metres."""

from __future__ import annotations

import re

import numpy as np
import pytest

from maglev_ctrl.analysis.hamiltonian import h_infinity_norm
from maglev_ctrl.errors import Status
from maglev_ctrl.synthesis.lmi import CommandLimits, LmiSession, MultiObjective, multi_objective
from maglev_ctrl.synthesis.lmi.bounds import violated
from maglev_ctrl.synthesis.lmi.coordinates import regulator_basis
from maglev_ctrl.synthesis.lmi.problem import pose
from maglev_ctrl.synthesis.lmi.scaling import find_scaling, scale_vertex
from maglev_ctrl.synthesis.lmi.session import Clock
from maglev_ctrl.systems.plant import Plant

SESSION = LmiSession()
MASS, FRAME, SPRING, MAGNET, LAG = 25e3, 3e3, 6e5, 4e6, 125.0


def bogie():
    """Car body over a frame on undamped magnets, a hydraulic force with a lag between them; N, m, kg."""
    A = np.zeros((5, 5))
    A[0, 2] = A[1, 3] = 1.0
    A[2, :2], A[2, 4] = np.array([-SPRING, SPRING]) / MASS, 1.0 / MASS
    A[3, :2], A[3, 4] = np.array([SPRING, -SPRING - MAGNET]) / FRAME, -1.0 / FRAME
    A[4, 4] = -LAG
    guideway = np.array([[0.0], [0.0], [0.0], [0.5 * MAGNET / FRAME], [0.0]])
    C = np.vstack([A[2] / 0.5, [0.0, 100.0, 0.0, 0.0, 0.0], np.zeros(5)])
    D = np.array([[0.0], [0.0], [1.0 / 5e3]])
    states = ("car", "frame", "car.velocity", "frame.velocity", "cylinder.force")
    return Plant.from_matrices(A, 0.01 * guideway, [[0.0]] * 4 + [[LAG]], C, D12=D, states=states, name="bogie")


PLANT = bogie()


def design(request, plants=(PLANT,)):
    return multi_objective(plants, request, session=SESSION)


def loop(law):
    K = law.controller.D
    return PLANT.A + PLANT.B2 @ K, PLANT.B1, PLANT.C1 + PLANT.D12 @ K


def slowest(law):
    return -float(np.max(np.linalg.eigvals(loop(law)[0]).real))


def peak(law):
    A, B, C = loop(law)
    return h_infinity_norm(A, B, C, np.zeros((3, 1))).lower


class TestDecay:
    def test_a_decay_rate_without_limit_is_not_given_an_optimum(self):
        found = design(MultiObjective("decay"))
        assert found.status is Status.UNBOUNDED and not found.controllers
        assert "as large as wanted" in found.message
        told = [float(x) for x in re.findall(r"([\d.e+]+) 1/s", found.message)]
        assert len(told) >= 2 and told == sorted(told)

    def test_more_gain_gives_more_decay_and_the_end_of_the_search_is_told(self):
        rates = []
        for gain in (1e6, 1e7, 1e8):
            found = design(MultiObjective("decay", gain_below=gain)).require()
            assert np.linalg.norm(found.controller.D, 2) < gain
            assert slowest(found) >= found.claims[0].rate
            rates.append(found.claims[0].rate)
            assert found.status is Status.SOLVED or any("no limit" in note for note in found.notes)
        assert rates[0] < rates[1] < rates[2]

    @pytest.mark.parametrize("rate", [4.0, 20.0, 70.0])
    def test_every_decay_rate_of_a_controllable_plant_is_had(self, rate):
        found = design(MultiObjective("h2", decay_rate=rate)).require()
        assert slowest(found) >= rate

    def test_the_shifted_regulator_has_the_identity_for_a_certificate(self):
        scaling = find_scaling((PLANT,), MultiObjective("h2"))
        v = scale_vertex(PLANT, MultiObjective("h2"), scaling)
        T = regulator_basis([v], (), shift=0.5)
        A, B = np.linalg.solve(T, v.A @ T), np.linalg.solve(T, v.B)
        closed = A - B @ B.T + 0.5 * np.eye(5)
        assert np.max(np.linalg.eigvalsh(closed + closed.T)) < 0.0
        wrong = A + B @ B.T + 0.5 * np.eye(5)
        assert np.max(np.linalg.eigvalsh(wrong + wrong.T)) > 0.0


class TestNorms:
    def test_a_slack_bound_costs_nothing(self):
        free = design(MultiObjective("h2")).require()
        bound = 1.5 * peak(free)
        found = design(MultiObjective("h2", h_infinity_below=bound)).require()
        assert np.allclose(found.controller.D, free.controller.D, rtol=1e-6)
        assert any("met by the optimum without asking for it: an H-infinity" in note for note in found.notes)
        assert found.claims[-1].gamma == bound

    def test_a_tight_bound_is_kept(self):
        least = peak(design(MultiObjective("h_infinity")).require())
        free = peak(design(MultiObjective("h2")).require())
        bound = 0.5 * (least + free)
        found = design(MultiObjective("h2", h_infinity_below=bound)).require()
        assert peak(found) < bound < free
        assert found.claims[-1].gamma == bound

    def test_what_a_law_breaks_is_seen(self):
        free = design(MultiObjective("h2")).require()
        level, rate = peak(free), slowest(free)
        for share, broken in ((1.01, set()), (0.99, {"h_infinity_below", "decay_rate"})):
            request = MultiObjective("h2", h_infinity_below=share * level, decay_rate=rate / share)
            posed = pose((PLANT,), request, session=SESSION, clock=Clock(9.0))
            assert violated(posed, free.controller.D) == broken


class TestImpossible:
    def test_a_norm_below_the_least_is_named_with_the_least(self):
        least = peak(design(MultiObjective("h_infinity")).require())
        found = design(MultiObjective("h2", h_infinity_below=1e-3 * least))
        assert found.status is Status.INFEASIBLE and not found.controllers
        assert "an H-infinity norm below" in found.message and "cannot be met" in found.message
        told = float(found.message.rsplit("about ", 1)[1])
        assert told == pytest.approx(least, rel=0.02)

    def test_a_gain_too_small_is_named_with_the_least_found(self):
        unstable = Plant.from_matrices(
            [[0.0, 1.0], [1000.0, 0.0]], [[0.0], [1.0]], [[0.0], [1.0]], [[1.0, 0.0], [0.0, 0.0]], D12=[[0.0], [1e-3]],
        )  # fmt: skip
        found = design(MultiObjective("h2", decay_rate=50.0, gain_below=1.0), (unstable,))
        assert found.status is Status.INFEASIBLE and "rescale" not in found.message
        assert found.message.startswith("a gain below 1 cannot be met")
        assert float(found.message.rsplit("about ", 1)[1]) == pytest.approx(1000.0, rel=0.05)

    def test_a_decay_rate_and_a_gain_that_exclude_each_other_are_named_as_a_pair(self):
        found = design(MultiObjective("h2", decay_rate=50.0, gain_below=1e4))
        assert found.status is Status.INFEASIBLE
        assert "a decay rate of 50 1/s and a gain below 10000 cannot both be met: each alone can" in found.message

    def test_starts_too_far_for_the_commands_are_told_with_the_share_that_is_not(self):
        limits = CommandLimits((2e4,), allowed=np.array([50.0, 0.0, 0.0, 0.0, 0.0]))
        found = design(MultiObjective("h2", commands=limits))
        assert not found.controllers and "rescale" not in found.message
        assert "of the initial states" in found.message or "of them there is one" in found.message
