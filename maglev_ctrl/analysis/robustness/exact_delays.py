"""A combination of changes looked at again with the actuators' delays exact, not in the Pade form of the search."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from maglev_ctrl.analysis.loops import Loop
from maglev_ctrl.analysis.robustness.parameters import UncertainParameter, perturbed_system
from maglev_ctrl.analysis.stability_gate import close
from maglev_ctrl.arrays import FloatArray, read_only
from maglev_ctrl.errors import ModelError, NotStable
from maglev_ctrl.systems import Controller, SecondOrderSystem


@dataclass(frozen=True, eq=False, slots=True)
class DelayedPlant:
    """A plant without delays inside it, and the exact delays (m,) in s of the controller's m commands."""

    plant: SecondOrderSystem
    delays: FloatArray


def delayed_loop(
    delayed: DelayedPlant, controller: Controller, parameters: Sequence[UncertainParameter], changes: ArrayLike
) -> Loop:
    """The loop with every parameter changed by its relative change (p,), delays exact.

    Raises
    ------
    ValueError : a delay cannot fall to zero or below, an unknown actuator, one change for each parameter is expected

    Examples
    --------
    >>> plant = SecondOrderSystem.from_matrices([[1.0]], [[0.0]], [[4.0]], inputs=("force",), B=[[1.0]])
    >>> law = Controller.static([[-0.5]], measured=("q1.velocity",), commands=("force",))
    >>> slower = UncertainParameter("delay", "actuator_delay", 0.2, ("force",))
    >>> delayed_loop(DelayedPlant(plant, np.array([0.1])), law, [slower], [0.2]).delays
    array([0.12])
    """
    given = read_only(changes, name="changes", shape=(len(parameters),))
    delays = np.array(delayed.delays, dtype=np.float64)
    others: list[UncertainParameter] = []
    kept: list[float] = []
    for parameter, change in zip(parameters, given, strict=True):
        if parameter.kind != "actuator_delay":
            others.append(parameter)
            kept.append(float(change))
            continue
        unknown = [name for name in parameter.members if name not in controller.commands]
        if unknown:
            raise ValueError(f"{parameter.name}: {unknown[0]!r} is no command of the controller")
        if change <= -1.0:
            raise ValueError(f"{parameter.name}: a delay cannot fall to zero (relative change {change:g})")
        hit = [not parameter.members or name in parameter.members for name in controller.commands]
        delays[hit] *= 1.0 + change
    system = perturbed_system(delayed.plant, others, kept) if others else delayed.plant
    return Loop.from_system(system, controller, delays=delays)


def stable_with_exact_delays(loop: Loop) -> bool | None:
    """Whether the loop passes the stability gate; None where the gate cannot tell.

    Examples
    --------
    >>> stable_with_exact_delays(Loop.from_transfer_function([1.0], [1.0, 0.0], delay=1.5))
    True
    >>> stable_with_exact_delays(Loop.from_transfer_function([1.0], [1.0, 0.0], delay=1.6))
    False
    """
    try:
        close(loop)
    except NotStable:
        return False
    except (ModelError, np.linalg.LinAlgError):
        return None
    return True
