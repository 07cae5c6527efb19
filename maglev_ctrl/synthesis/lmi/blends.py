"""Claims for constant parameters: every blend of the vertices decays, norms and regions hold at the vertices."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from maglev_ctrl.arrays import FloatArray, read_only
from maglev_ctrl.proofs.claims import Claim, DecayClaim, EnergyClaim, GainClaim, RegionClaim
from maglev_ctrl.proofs.prove import prove
from maglev_ctrl.synthesis.lmi.certify import at_vertices, certificate, levels, supported
from maglev_ctrl.synthesis.lmi.problem import Optimum, Problem
from maglev_ctrl.synthesis.lmi.request import MultiObjective
from maglev_ctrl.synthesis.lmi.stability import closed_loops, parameter_certificate
from maglev_ctrl.systems import Controller

LOWERED = (1.0, 0.995, 0.98, 0.95, 0.9)
"""Shares of a decay rate that was the objective, tried in turn."""


def vertex_claims(problem: Problem, optimum: Optimum, controller: Controller) -> tuple[list[Claim], str]:
    """Decay of every constant blend, norms and regions vertex by vertex; or no claim, and why."""
    request = problem.request
    X = optimum.values.get("slack")
    first = np.eye(len(problem.scaling.states)) if X is None else certificate(problem, X)
    blends = _blends(problem, controller, optimum.rate, first)
    if blends is None:
        return [], "no certificate of stability between the vertices was found for the law"
    claims, count = [blends], len(problem.plants)
    plants, laws, blank = tuple(range(count)), (0,) * count, np.eye(len(problem.scaling.states))[None]
    two, infinity = levels(problem, optimum)
    if request.region is not None:
        region = RegionClaim(plants, laws, request.region.label, request.region.L, request.region.M, blank)
        claims += at_vertices(problem, region, controller)
    if request.has_h2:
        names = request.h2_channel
        energy = EnergyClaim(plants, laws, two, blank, names.disturbances, names.performance)
        claims += at_vertices(problem, energy, controller)
    if request.has_h_infinity:
        names = request.h_infinity_channel
        gain = GainClaim(plants, laws, infinity, blank, names.disturbances, names.performance)
        claims += at_vertices(problem, gain, controller)
    return claims, ""


def _blends(problem: Problem, controller: Controller, rate: float, first: FloatArray) -> Claim | None:
    """Decay of every blend: by one matrix, which is quick and says more, or else by one for each vertex.

    `first` is tried before any is looked for: of a common matrix it is the certificate.

    Conditions for a law (on A') and for the law found (on A) are both sufficient only, so that a decay rate found by
    the first may have to be lowered for the second; not below what is asked.
    """
    count = len(problem.plants)
    T = problem.transformation
    back = np.linalg.inv(T)
    loops = [np.asarray(back @ A @ T, dtype=np.float64) for A in closed_loops(problem.plants, controller)]
    for share in LOWERED if problem.request.objective == "decay" else (1.0,):
        slower = max(share * rate, problem.request.decay_rate or 0.0)
        common: Claim = DecayClaim(tuple(range(count)), (0,) * count, slower, first[None])
        common = supported(problem, common, MultiObjective(decay_rate=slower or None), controller)
        if prove(common, problem.plants, [controller]).holds:
            return common
        claim, _ = parameter_certificate(loops, slower, clock=problem.clock, solver=problem.solver)
        if claim is None:
            continue

        def physical(P: FloatArray) -> FloatArray:
            return np.asarray(back.T @ P @ back, dtype=np.float64)

        P = [physical(one) for one in claim.P]
        claim = replace(
            claim, V=read_only(physical(claim.V), name="V"), P=read_only([0.5 * (x + x.T) for x in P], name="P")
        )  # fmt: skip
        if prove(claim, problem.plants, [controller]).holds:
            return claim
    return None
