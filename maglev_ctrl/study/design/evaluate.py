"""What a finished law does: poles at its corners, gain over frequency, and the law as a computer runs it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.linalg import solve_continuous_lyapunov

from maglev_ctrl.analysis.hamiltonian import balanced_realisation, largest_gain, response
from maglev_ctrl.analysis.loops import balanced
from maglev_ctrl.analysis.margins import Margins, loop_margins
from maglev_ctrl.arrays import ComplexArray, FloatArray, read_only, read_only_any
from maglev_ctrl.errors import MaglevError
from maglev_ctrl.proofs.claims import GainClaim
from maglev_ctrl.study.design.corners import Corner, systems_at
from maglev_ctrl.study.design.records import CornerPoles, GainCurve, Level, SampledLaw
from maglev_ctrl.study.situation import OptionModel
from maglev_ctrl.synthesis.design import Design
from maglev_ctrl.synthesis.discretise import discretisation_loss, discretise, return_ratio
from maglev_ctrl.synthesis.result import Synthesis
from maglev_ctrl.systems import close_loop
from maglev_ctrl.systems.plant import closed_channel

CURVE_POINTS = 600


def corner_poles(model: OptionModel, corners: tuple[Corner, ...], design: Design) -> tuple[CornerPoles, ...]:
    """Open- and closed-loop poles at every corner, delays left out; a scheduled law with its gains there.

    Raises
    ------
    ModelError : there is no equilibrium at a corner
    OutOfDomain : the forces are not known there
    """
    found: list[CornerPoles] = []
    for corner, system in systems_at(model, corners):
        law = model.law_at(corner.situation, design.controller)
        assert law is not None
        found.append(CornerPoles(corner.name, poles(system.state_matrix()),
                                 poles(close_loop(system, law).state_matrix())))  # fmt: skip
    return tuple(found)


def gain_curve(synthesis: Synthesis) -> GainCurve | None:
    """Largest gain from w to z over frequency at the first plant; None for sampled plants or without performance."""
    if not synthesis.controllers:
        return None
    plant, controller = synthesis.plants[0], synthesis.controllers[0]
    if plant.dt is not None or not plant.performance or not plant.disturbances:
        return None
    opened = (plant.A, plant.B1, plant.C1, plant.D11)
    closed = closed_channel(plant, controller)
    frequency = _frequencies((plant.A, closed[0]))
    levels = [claim.gamma for claim in synthesis.claims if isinstance(claim, GainClaim)]
    return GainCurve(
        frequency=read_only(frequency, name="frequency"),
        open_loop=read_only(_gains(opened, frequency), name="open_loop"),
        closed_loop=read_only(_gains(closed, frequency), name="closed_loop"),
        level=min(levels) if levels else float("nan"),
    )


def disturbance_levels(
    synthesis: Synthesis, allowed: Mapping[str, float], units: Mapping[str, str]
) -> tuple[Level, ...]:
    """Root mean squares of the performance under unit white noise on every disturbance, the worst over the plants.

    From the covariance of the closed loop; rows that white noise reaches without a lag have none and are left out.

    Parameters
    ----------
    allowed : acceptable value of every performance output, which the plants scale by
    units : SI units of outputs and commands, by name
    """
    found: dict[str, Level] = {}
    for i, plant in enumerate(synthesis.plants):
        law = synthesis.controllers[i if len(synthesis.controllers) > 1 else 0]
        A, B, C, D = closed_channel(plant, law)
        A, B, C = balanced_realisation(A, B, C)
        variance = np.diag(C @ solve_continuous_lyapunov(A, -B @ B.T) @ C.T)
        for name, value, through in zip(plant.performance, variance, D, strict=True):
            if np.any(through) or not value >= 0.0:
                continue
            level = float(np.sqrt(value)) * allowed[name]
            if name not in found or level > found[name].root_mean_square:
                found[name] = Level(name, units.get(name, ""), level, allowed[name], plant.name)
    return tuple(found.values())


def sampled_law(synthesis: Synthesis, period: float) -> SampledLaw:
    """The law as a computer runs it every `period` seconds, and the loss of the first one on its plant.

    A law that was designed for samples is its own; one sampled after it was designed is discretised by Tustin's rule.
    """
    plant, laws = synthesis.plants[0], synthesis.controllers
    if plant.dt is not None:
        told = "the law was designed for samples; there is no continuous law to compare it with"
        try:
            margins: Margins | None = loop_margins(balanced(return_ratio(plant, laws[0])))
        except (MaglevError, ValueError, np.linalg.LinAlgError) as fault:
            margins, told = None, f"{told}; margins of the sampled loop: {fault}"
        return SampledLaw(plant.dt, laws, None, margins, told)
    made = tuple(discretise(controller, period) for controller in laws)
    try:
        loss = discretisation_loss(plant, laws[0], period)
    except (MaglevError, ValueError, np.linalg.LinAlgError) as fault:
        return SampledLaw(period, made, None, None, f"{fault}")
    return SampledLaw(period, made, loss, None, "")


def poles(A: FloatArray) -> ComplexArray:
    """Eigenvalues, read-only."""
    return read_only_any(np.linalg.eigvals(A).astype(complex))


def _gains(system: tuple[FloatArray, FloatArray, FloatArray, FloatArray], frequency: FloatArray) -> FloatArray:
    A, B, C, D = system
    return largest_gain(response(*balanced_realisation(A, B, C), D, frequency))


def _frequencies(matrices: Sequence[FloatArray]) -> FloatArray:
    """From well below the slowest to well above the fastest pole, every pole's own frequency among them."""
    moduli = np.concatenate([np.abs(np.linalg.eigvals(A)) for A in matrices])
    moduli = moduli[moduli > 1e-3]
    if not moduli.size:
        return np.geomspace(1e-2, 1e2, CURVE_POINTS)
    grid = np.geomspace(0.1 * float(np.min(moduli)), 10.0 * float(np.max(moduli)), CURVE_POINTS)
    return np.asarray(np.unique(np.concatenate([grid, moduli])))
