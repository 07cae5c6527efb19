"""Electromagnets in a vehicle: the currents that carry it, and their circuits in the linear model.

A magnet of the vehicle that stands for several has them wired alike: one current and one voltage, `count` times the
force. About the equilibrium, with z the magnet's rise and w the rail's,

    force on the body  count (K_i i + K_s (z - w))                 K_s is a negative stiffness
    driven by voltage  L i' = -R i - K_i (z' - w') + v             state "<magnet>.current", input "<magnet>.voltage"
    driven by current  i is the input "<magnet>.current"
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.forces.electromagnet import Circuit, Electromagnet, circuit
from maglev_ctrl.vehicle.elements import Magnet
from maglev_ctrl.vehicle.loads import MagnetField
from maglev_ctrl.vehicle.operating import Equilibrium
from maglev_ctrl.vehicle.shares import Share
from maglev_ctrl.vehicle.vehicle import Vehicle

if TYPE_CHECKING:
    from maglev_ctrl.vehicle.skeleton import Skeleton


@dataclass(frozen=True, eq=False, slots=True)
class Wired:
    """Matrices of the linear model with the circuits of the electromagnets in; `F` (e, n, n_xi) by element."""

    A_internal: FloatArray
    G_v: FloatArray
    G_wv: FloatArray
    F: FloatArray
    B: FloatArray
    B_internal: FloatArray


def circuit_state(magnet: Magnet) -> tuple[str, ...]:
    """The magnet's internal state: its current where it is driven by voltage, else none."""
    driven = isinstance(magnet.force, Electromagnet) and magnet.force.drive == "voltage"
    return (f"{magnet.name}.current",) if driven else ()


def circuit_input(magnet: Magnet) -> tuple[str, ...]:
    """The magnet's input: "<name>.voltage" (V) or "<name>.current" (A); none without a winding.

    Examples
    --------
    >>> coil = Electromagnet(30.0, turns=300, pole_area=0.1, resistance=4.0)
    >>> circuit_input(Magnet("lift", "car", force=coil))
    ('lift.voltage',)
    """
    return (f"{magnet.name}.{magnet.force.drive}",) if isinstance(magnet.force, Electromagnet) else ()


def magnet_share(magnet: Magnet, size: int) -> Share:
    """A magnet's share with its state and input named and nothing filled in; `size` coordinates."""
    share = Share(magnet.name, "magnet", size)
    share.internal, share.inputs = circuit_state(magnet), circuit_input(magnet)
    states, commands = len(share.internal), len(share.inputs)
    share.A_internal, share.F, share.G_v = (
        np.zeros((states, states)),
        np.zeros((size, states)),
        np.zeros((states, size)),
    )
    share.B, share.B_internal = np.zeros((size, commands)), np.zeros((states, commands))
    return share


def magnet_circuits(vehicle: Vehicle, state: Equilibrium) -> Mapping[str, Circuit]:
    """Standing current, partials, voltage and power of every electromagnet at an equilibrium, by its name.

    Currents follow from the lift and the gap. Values are those of one winding: a magnet that stands for several takes
    `count` times the power.

    Raises
    ------
    OutOfDomain : saturated iron

    Examples
    --------
    >>> from maglev_ctrl.vehicle import Body, OperatingPoint, equilibrium
    >>> coil = Electromagnet.for_lift(5e3, 0.01, turns=300, pole_area=0.03, resistance=1.0)
    >>> car = Vehicle("car", (Body("car", 1e3),), magnets=(Magnet("lift", "car", force=coil, count=2),),
    ...               reference_height=0.01)
    >>> found = magnet_circuits(car, equilibrium(car, OperatingPoint(0.0, 0.01)))["lift"]
    >>> round(2 * found.force / 9.80665, 6)
    1000.0
    """
    found: dict[str, Circuit] = {}
    for magnet, height, lift in zip(vehicle.magnets, state.magnet_heights, state.forces.lift, strict=True):
        if isinstance(magnet.force, Electromagnet):
            given = float(magnet.force.unlimited().forces(height, None, 0.0).lift)
            found[magnet.name] = circuit(magnet.force, float(height), strength=float(lift) / (magnet.count * given))
    return found


def wired_magnets(vehicle: Vehicle, state: Equilibrium, fields: MagnetField, base: Skeleton) -> Wired:
    """The skeleton's internal states, forces and inputs with every electromagnet's circuit put in.

    Parameters
    ----------
    state, fields : the equilibrium, and its magnets' forces
    """
    blank = Wired(base.A_internal, base.G_v, base.G_wv, base.F, base.B, base.B_internal)
    found = magnet_circuits(vehicle, state)
    if not found:
        return blank
    A, G_v, G_wv, F, B, B_internal = (
        part.copy() for part in (blank.A_internal, blank.G_v, blank.G_wv, blank.F, blank.B, blank.B_internal)
    )
    for i, magnet in enumerate(vehicle.magnets):
        if magnet.name not in found:
            continue
        one, push, motion = found[magnet.name], fields.jacobian[i, 2], fields.motion[i, 2]
        force = magnet.count * one.force_by_current * push
        (command,) = (base.inputs.index(name) for name in circuit_input(magnet))
        if not circuit_state(magnet):
            B[:, command] = force
            continue
        (row,) = (base.internal.index(name) for name in circuit_state(magnet))
        A[row, row] = -one.resistance / one.inductance
        G_v[row] = -one.force_by_current / one.inductance * motion
        G_wv[row, base.heave_columns[i]] = one.force_by_current / one.inductance
        F[base.magnets.start + i, :, row] = force
        B_internal[row, command] = 1.0 / one.inductance
    return Wired(A, G_v, G_wv, F, B, B_internal)
