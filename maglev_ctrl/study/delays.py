"""Modes of a loop with actuator delays, held against the exact delay: a Pade form is a model, not the delay."""

from __future__ import annotations

import numpy as np

from maglev_ctrl.analysis.loops import Loop
from maglev_ctrl.analysis.modes import Modes, modes
from maglev_ctrl.analysis.replay import pole_near
from maglev_ctrl.analysis.stability_gate import close
from maglev_ctrl.errors import ModelError, NotStable
from maglev_ctrl.study.loops import option_loops
from maglev_ctrl.study.situation import VERIFICATION_ORDER, OptionModel, Situation
from maglev_ctrl.systems import Controller
from maglev_ctrl.vehicle import Vehicle

SHIFT = 0.02  # of a growth rate: how far the exact delay may move what the fine Pade form gives
FLOOR = 1e-9  # of |s|: shifts below this are rounding


def settled_modes(
    model: OptionModel, vehicle: Vehicle, situation: Situation, controller: Controller | None
) -> tuple[Modes, str]:
    """Modes in a situation, and why they may not be told as they are ('' when nothing speaks against it).

    Where actuators delay, the modes are those of a fine Pade form; the stability gate, which knows the exact delay, has
    to give the same verdict, and the poles that decide have to stay where they are when the delay is made exact.

    Raises
    ------
    ModelError : there is no equilibrium
    OutOfDomain : the forces are not known there
    """
    delayed = any(actuator.delay > 0.0 for actuator in vehicle.actuators)
    if controller is None or not delayed:
        return modes(model.closed_of(vehicle, situation, controller)), ""
    found = modes(model.closed_of(vehicle, situation, controller, pade_order=VERIFICATION_ORDER))
    loops = option_loops(model, situation, controller)
    return found, "" if loops is None else _doubt(found, loops.loop())


def _doubt(found: Modes, loop: Loop) -> str:
    try:
        close(loop)
        exactly_stable, pole = True, ""
    except NotStable as fault:
        exactly_stable, pole = False, f" ({fault})"
    except ModelError as fault:
        return f"stability with the exact delay could not be proven: {fault}"
    if (found.spectral_abscissa < 0.0) != exactly_stable:
        says = "stable" if exactly_stable else "not stable"
        return (
            f"the delay's Pade form gives a growth rate of {found.spectral_abscissa:.3g} 1/s, but with the exact delay "
            f"the loop is {says}{pole}"
        )
    oscillating = np.where(found.s.imag > found.error_bound, found.damping_ratio, np.inf)
    for k in {found.critical, int(np.argmin(oscillating))}:
        s = complex(found.s[k])
        exact = pole_near(loop, s).pole
        if abs(exact - s) > max(SHIFT * abs(s.real), FLOOR * abs(s)):
            return f"the exact delay moves the mode {found.labels[k]} from {s:.4g} to {exact:.4g} 1/s"
    return ""
