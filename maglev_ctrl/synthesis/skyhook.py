"""Sky-hook damping: actuators that act as dampers to an inertial frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.errors import Agreement, Status
from maglev_ctrl.synthesis.design import Design, verify
from maglev_ctrl.synthesis.weights import require_distinct, require_known, require_single
from maglev_ctrl.systems import Controller, SecondOrderSystem

Signal = Literal["velocity", "acceleration"]


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
    corner: float = 0.2 * np.pi,
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
    measured: list[str] = []
    for damper in dampers:
        measured += [x for x in (damper.measured, damper.minus) if x is not None and x not in measured]
    commands = tuple(damper.actuator for damper in dampers)
    gain = np.zeros((len(dampers), len(measured)))
    for row, damper in enumerate(dampers):
        gain[row, measured.index(damper.measured)] -= damper.damping
        if damper.minus is not None:
            gain[row, measured.index(damper.minus)] += damper.damping
    signals = [_signal(system, x) for x in measured]
    controller = _controller(gain, signals, corner, tuple(measured), commands, name)
    integrated = tuple(x for x, signal in zip(measured, signals, strict=True) if signal == "acceleration")
    notes = (f"integrated above {corner:.3g} rad/s: {', '.join(integrated)}",) if integrated else ()
    certificate = verify(system, controller, refined=refined)
    status = Status.SOLVED if certificate.agreed is Agreement.AGREED else Status.NOT_VERIFIED
    return Design(name, "sky-hook", controller, status, (), None, certificate, notes)


def _check(system: SecondOrderSystem, dampers: Sequence[SkyHook], corner: float) -> None:
    if not dampers:
        raise ValueError("dampers: expected at least one")
    if not (np.isfinite(corner) and corner > 0.0):
        raise ValueError(f"corner: expected a positive angular frequency in rad/s, got {corner!r}")
    known = (*system.outputs, *system.states)
    for damper in dampers:
        require_known(damper.actuator, system.inputs, what="actuator")
        require_known(damper.measured, known, what="output")
        if damper.minus is not None:
            require_known(damper.minus, known, what="output")
        if not (np.isfinite(damper.damping) and damper.damping >= 0.0):
            raise ValueError(f"damping: expected N s/m of at least 0 for {damper.actuator!r}, got {damper.damping!r}")
    require_distinct((damper.actuator for damper in dampers), what="actuator")


def _signal(system: SecondOrderSystem, name: str) -> Signal:
    """What a name measures, judged by its rows, not by its spelling."""
    if name in system.outputs:
        i = system.outputs.index(name)
        place, rate, second, inner = (getattr(system, key)[i] for key in ("H_q", "H_v", "H_a", "H_internal"))
        track = np.any(system.H_w[i]) or np.any(system.H_wv[i])
        if not (np.any(place) or np.any(inner) or track):
            if np.any(second) and not np.any(rate):
                return "acceleration"
            if np.any(rate) and not np.any(second):
                return "velocity"
    elif name in {f"{dof}.velocity" for dof in system.dofs}:
        return "velocity"
    raise ValueError(f"output: {name!r} is neither an absolute velocity nor an absolute acceleration")


def _controller(
    gain: FloatArray,
    signals: Sequence[Signal],
    corner: float,
    measured: tuple[str, ...],
    commands: tuple[str, ...],
    name: str,
) -> Controller:
    integrated = [i for i, signal in enumerate(signals) if signal == "acceleration"]
    count = len(integrated)
    A = np.kron(np.eye(count), np.array([[0.0, 1.0], [-(corner**2), -2.0 * corner]]))
    B, C = np.zeros((2 * count, len(measured))), np.zeros((len(commands), 2 * count))
    D = np.array(gain)
    for place, column in enumerate(integrated):
        B[2 * place + 1, column] = 1.0
        C[:, 2 * place + 1] = gain[:, column]
        D[:, column] = 0.0
    return Controller.from_matrices(A, B, C, D, measured=measured, commands=commands, name=name)
