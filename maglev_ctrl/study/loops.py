"""The loops of one option: what is broken to read margins, how the roots move as the option is faded in."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from maglev_ctrl.analysis.loops import Loop, return_ratio
from maglev_ctrl.arrays import ComplexArray, FloatArray, read_only_any
from maglev_ctrl.study.records import NyquistCurve, RootLocus
from maglev_ctrl.study.situation import OptionModel, Situation
from maglev_ctrl.systems import Controller, SecondOrderSystem, loop_matrices
from maglev_ctrl.vehicle import Vehicle, as_feedback, linearize

LOCUS_POINTS = 61
LOCUS_GAIN = 1.5
NYQUIST_POINTS = 1500


@dataclass(frozen=True, eq=False, slots=True)
class OptionLoops:
    """An option seen as feedback: the plant without it, the law that it is, exact actuator delays."""

    plant: SecondOrderSystem
    law: Controller
    delays: FloatArray

    def loop(self) -> Loop:
        """Return ratio broken at every channel, delays exact."""
        A, B, C, D = loop_matrices(self.plant, self.law)
        return Loop(A, B, C, D, self.law.commands, delays=self.delays)


def option_loops(model: OptionModel, situation: Situation, controller: Controller | None) -> OptionLoops | None:
    """The option's loops in a situation; None when it adds neither passive elements nor a control law.

    An active option is broken at its actuators' commands (its passive elements stay in the plant); a passive one at
    the forces of its own springs and dampers, each read as feedback from its stroke.

    Raises
    ------
    ModelError : there is no equilibrium
    OutOfDomain : the forces are not known there
    """
    vehicle = model.vehicle(situation.payload)
    controller = model.law_at(situation, controller)
    if controller is not None:
        held, balanced = model.balance_of(vehicle, situation)
        delays = {actuator.name: actuator.delay for actuator in held.actuators}
        return OptionLoops(
            plant=linearize(held, balanced, pade_order=0),
            law=controller,
            # An electromagnet's winding is no actuator of the option: it answers at once.
            delays=np.array([delays.get(name, 0.0) for name in controller.commands]),
        )
    own = own_connections(model, vehicle)
    if not own:
        return None
    opened, law = as_feedback(vehicle, own)
    held, balanced = model.balance_of(opened, situation)
    return OptionLoops(plant=linearize(held, balanced, pade_order=0), law=law, delays=np.zeros(len(own)))


def own_connections(model: OptionModel, vehicle: Vehicle) -> tuple[str, ...]:
    """Names of the springs and dampers that the option adds to the bare vehicle; a damper of nothing is no channel."""
    bare = OptionModel(model.scenario, None).vehicle()
    shared = {connection.name for connection in bare.connections}
    return tuple(
        one.name
        for one in vehicle.connections
        if one.name not in shared and (one.stiffness != 0.0 or one.damping != 0.0)
    )


def root_locus(loops: OptionLoops) -> RootLocus:
    """Closed-loop eigenvalues as all channels' gains rise together from 0 past 1 (delays left out)."""
    A, B, C, D = loop_matrices(loops.plant, loops.law)
    gain = np.linspace(0.0, LOCUS_GAIN, LOCUS_POINTS)
    identity = np.eye(len(loops.law.commands))
    closed = np.stack([A - B @ np.linalg.solve(identity + g * D, g * C) for g in gain])
    return RootLocus(gain=read_only_any(gain), s=read_only_any(np.linalg.eigvals(closed)))


def nyquist_curves(loop: Loop) -> tuple[NyquistCurve, ...]:
    """Return ratio of every channel with the other loops closed, on a grid that resolves each resonance of L."""
    frequency = _grid(loop)
    response = return_ratio(loop, frequency)
    return tuple(
        NyquistCurve(channel, read_only_any(frequency), read_only_any(_one_loop(response, i)))
        for i, channel in enumerate(loop.channels)
    )


def _one_loop(L: ComplexArray, i: int) -> ComplexArray:
    """L_ii with all other loops closed: L_ii - L_io (I + L_oo)^-1 L_oi."""
    others = [j for j in range(L.shape[-1]) if j != i]
    if not others:
        return np.asarray(L[:, i, i])
    L_oo = L[:, others][:, :, others] + np.eye(len(others))
    inner = np.linalg.solve(L_oo, L[:, others, i][..., None])[..., 0]
    return np.asarray(L[:, i, i] - np.einsum("fo,fo->f", L[:, i][:, others], inner))


def _grid(loop: Loop) -> FloatArray:
    """Logarithmic frequencies with clusters of a mode's own width around every resonance of L."""
    poles = np.linalg.eigvals(loop.A)
    modulus = np.abs(poles)
    oscillating = modulus[modulus > 1e-6]
    low = 0.02 * float(np.min(oscillating)) if oscillating.size else 1e-2
    high = 50.0 * float(np.max(oscillating)) if oscillating.size else 1e2
    low = max(low, 1e-6 * high)
    base = np.geomspace(low, high, NYQUIST_POINTS)
    spread = np.sinh(np.linspace(-8.0, 8.0, 121)) / np.sinh(8.0)
    clusters = [
        pole.imag + spread * max(40.0 * abs(pole.real), 0.2 * pole.imag)
        for pole in poles
        if pole.imag > 1e-6 and abs(pole.real) < 0.3 * pole.imag
    ]
    everything = np.concatenate([base, *clusters])
    return np.asarray(np.unique(everything[(everything >= low) & (everything <= high)]))
