"""Sky-hook damping: actuators that act as dampers to an inertial frame."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from maglev_ctrl.synthesis.damping.hooked import (
    INTEGRATOR_CORNER,
    HookedDamper,
    Opposed,
    design_hooked,
    is_absolute,
    signal_of,
)
from maglev_ctrl.synthesis.design import Design
from maglev_ctrl.synthesis.weights import require_distinct, require_known, require_single
from maglev_ctrl.systems import SecondOrderSystem


@dataclass(frozen=True, eq=False, slots=True)
class SkyHook:
    """One sky-hook damper: `actuator` opposes the absolute velocity `measured` with `damping` N s/m.

    `measured` names a velocity, or an acceleration, which is then integrated. `minus`, where given, is subtracted (the
    other end of a secondary suspension). `measured` and the actuator must act along the same direction.
    """

    actuator: str
    measured: str
    damping: float
    minus: str | None = None


def sky_hook(
    system: SecondOrderSystem,
    dampers: Sequence[SkyHook],
    *,
    corner: float = INTEGRATOR_CORNER,
    refined: SecondOrderSystem | None = None,
    name: str = "sky-hook",
) -> Design:
    """Sky-hook damping u = -damping * velocity (or velocity difference), with its certificate.

    Velocities are fed back as they are. An acceleration a is integrated by s / (s + corner)^2, which is 1/s far above
    `corner` and rejects the offset of the accelerometer; below the corner the phase turns and damping is lost, so
    `corner` should stay well under the slowest mode to be damped.

    Parameters
    ----------
    dampers : what each actuator opposes
    corner : rad/s, of the integrators; default 0.1 Hz
    refined : a plant with higher Pade order for the certificate

    Raises
    ------
    ValueError : unknown or doubled names, negative damping, or a measured name that is no velocity or acceleration

    Examples
    --------
    >>> plant = SecondOrderSystem.from_matrices([[1.0]], [[0.0]], [[4.0]], inputs=("force",), B=[[1.0]])
    >>> design = sky_hook(plant, [SkyHook("force", "q1.velocity", 1.6)])
    >>> round(design.certificate.spectral_abscissa, 9)
    -0.8
    """
    require_single(system)
    _check(system, dampers, corner)
    hooked = [
        HookedDamper(
            damper.actuator,
            (Opposed(damper.measured), *(() if damper.minus is None else (Opposed(damper.minus, -1.0),))),
            damper.damping,
        )
        for damper in dampers
    ]
    return design_hooked(system, hooked, integrator_corner=corner, refined=refined, name=name, law="sky-hook")


def _check(system: SecondOrderSystem, dampers: Sequence[SkyHook], corner: float) -> None:
    if not dampers:
        raise ValueError("dampers: expected at least one")
    if not (np.isfinite(corner) and corner > 0.0):
        raise ValueError(f"corner: expected a positive angular frequency in rad/s, got {corner!r}")
    known = (*system.outputs, *system.states)
    for damper in dampers:
        require_known(damper.actuator, system.inputs, what="actuator")
        for measured in (damper.measured, damper.minus):
            if measured is not None:
                require_known(measured, known, what="output")
                _require_absolute(system, measured)
        if not (np.isfinite(damper.damping) and damper.damping >= 0.0):
            raise ValueError(f"damping: expected N s/m of at least 0 for {damper.actuator!r}, got {damper.damping!r}")
    require_distinct((damper.actuator for damper in dampers), what="actuator")


def _require_absolute(system: SecondOrderSystem, name: str) -> None:
    """A sky-hook opposes what the guideway has no part in."""
    moving = name not in system.dofs and is_absolute(system, name)
    with suppress(ValueError):
        if moving and signal_of(system, name) != "position":
            return
    raise ValueError(f"output: {name!r} is neither an absolute velocity nor an absolute acceleration")
