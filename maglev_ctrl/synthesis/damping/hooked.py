"""Hooked damping laws: an actuator opposes a weighted sum of velocities (sky-hook, ground-hook, relative, gap rate).

u = -damping * (sum of weight * rate of what is measured). The rate of a velocity is itself, an acceleration is
integrated, a gap or stroke is differentiated; what a name measures is judged by its rows, not by its spelling.
Karnopp, Crosby & Harwood, J. Eng. Ind. 96 (1974) 619 (sky-hook); Valasek et al., Vehicle System Dynamics 28 (1997) 193
(ground-hook).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.errors import Agreement, Status
from maglev_ctrl.synthesis.design import Design, verify
from maglev_ctrl.synthesis.weights import require_known, require_single
from maglev_ctrl.systems import Controller, SecondOrderSystem

Signal = Literal["velocity", "acceleration", "position"]
INTEGRATOR_CORNER = 0.2 * np.pi
"""rad/s: below 0.1 Hz an accelerometer's offset is rejected instead of integrated."""
DIFFERENTIATOR_CORNER = 400.0 * np.pi
"""rad/s: above 200 Hz a gap sensor's noise is no longer differentiated."""


@dataclass(frozen=True, eq=False, slots=True)
class Opposed:
    """One measured term of a hooked law; `weight` +1 for the end the actuator pushes, -1 for the end it reacts on.

    Weights between 0 and 1 share one damping among several terms (hybrid sky-hook and ground-hook).
    """

    measured: str
    weight: float = 1.0


@dataclass(frozen=True, eq=False, slots=True)
class HookedDamper:
    """`actuator` opposes the weighted rates of `terms` with `damping` N s/m: u = -damping * sum(weight * rate)."""

    actuator: str
    terms: tuple[Opposed, ...]
    damping: float


def hooked_controller(
    system: SecondOrderSystem,
    dampers: Sequence[HookedDamper],
    *,
    integrator_corner: float = INTEGRATOR_CORNER,
    differentiator_corner: float = DIFFERENTIATOR_CORNER,
    name: str = "hooked",
) -> Controller:
    """The law of hooked dampers; several dampers of one actuator add up (combined laws).

    An acceleration a is integrated by s / (s + corner)^2, which is 1/s far above the corner and rejects the sensor's
    offset; a gap or stroke is differentiated by s corner / (s + corner), which is s far below its corner.

    Parameters
    ----------
    integrator_corner, differentiator_corner : rad/s; the slowest and fastest mode to be damped should lie well between

    Raises
    ------
    ValueError : unknown names, negative damping, a corner that is not positive, no term, or a name that measures a
        mixture of positions, velocities and accelerations

    Examples
    --------
    >>> plant = SecondOrderSystem.from_matrices(
    ...     [[300.0, 0.0], [0.0, 50.0]], [[0.0, 0.0], [0.0, 0.0]], [[8e3, -8e3], [-8e3, 9.8e4]],
    ...     dofs=("car", "bogie"), inputs=("leg",), B=[[1.0], [-1.0]])
    >>> law = hooked_controller(plant, [HookedDamper("leg", (Opposed("bogie.velocity", -1.0),), 900.0)])
    >>> float(law.D[0, 0])  # ground-hook: the reaction -u opposes the bogie's velocity
    900.0
    """
    require_single(system)
    _check(system, dampers, integrator_corner, differentiator_corner)
    measured = tuple(dict.fromkeys(term.measured for damper in dampers for term in damper.terms))
    commands = tuple(dict.fromkeys(damper.actuator for damper in dampers))
    gain = np.zeros((len(commands), len(measured)))
    for damper in dampers:
        for term in damper.terms:
            gain[commands.index(damper.actuator), measured.index(term.measured)] -= damper.damping * term.weight
    signals = [signal_of(system, x) for x in measured]
    return _controller(gain, signals, (integrator_corner, differentiator_corner), measured, commands, name)


def design_hooked(
    system: SecondOrderSystem,
    dampers: Sequence[HookedDamper],
    *,
    integrator_corner: float = INTEGRATOR_CORNER,
    differentiator_corner: float = DIFFERENTIATOR_CORNER,
    refined: SecondOrderSystem | None = None,
    name: str = "hooked damping",
    law: str = "hooked damping",
) -> Design:
    """Hooked dampers with the certificate of their closed loop.

    Parameters
    ----------
    refined : a plant with higher Pade order for the certificate

    Raises
    ------
    ValueError : as in `hooked_controller`

    Examples
    --------
    >>> plant = SecondOrderSystem.from_matrices([[1.0]], [[0.0]], [[4.0]], inputs=("force",), B=[[1.0]],
    ...                                         outputs=("gap",), H_q=[[1.0]], guideway=("track",), H_w=[[-1.0]])
    >>> design = design_hooked(plant, [HookedDamper("force", (Opposed("gap"),), 0.8)], differentiator_corner=4e3)
    >>> round(design.certificate.spectral_abscissa, 3)
    -0.4
    """
    controller = hooked_controller(
        system, dampers,
        integrator_corner=integrator_corner, differentiator_corner=differentiator_corner, name=name,
    )  # fmt: skip
    signals = {x: signal_of(system, x) for x in controller.measured}
    notes = tuple(
        f"{verb} {side} {corner:.3g} rad/s: {', '.join(x for x in signals if signals[x] == kind)}"
        for kind, verb, side, corner in (
            ("acceleration", "integrated", "above", integrator_corner),
            ("position", "differentiated", "below", differentiator_corner),
        )
        if kind in signals.values()
    )
    certificate = verify(system, controller, refined=refined)
    status = Status.SOLVED if certificate.agreed is Agreement.AGREED else Status.NOT_VERIFIED
    return Design(name, law, controller, status, (), None, certificate, notes)


def signal_of(system: SecondOrderSystem, name: str) -> Signal:
    """What an output or state measures: one pure derivative of displacement, absolute or against the guideway.

    Raises
    ------
    ValueError : the name mixes displacements, velocities, accelerations or internal states

    Examples
    --------
    >>> signal_of(SecondOrderSystem.from_matrices([[1.0]], [[0.0]], [[4.0]]), "q1.velocity")
    'velocity'
    """
    if name in system.outputs:
        i = system.outputs.index(name)
        place, rate, second, inner, track, track_rate = (
            bool(np.any(getattr(system, key)[i])) for key in ("H_q", "H_v", "H_a", "H_internal", "H_w", "H_wv")
        )
        kinds: tuple[tuple[Signal, bool, bool], ...] = (
            ("position", place, not (rate or second or track_rate)),
            ("velocity", rate, not (place or second or track)),
            ("acceleration", second, not (place or rate or track or track_rate)),
        )
        for signal, present, pure in kinds:
            if present and pure and not inner:
                return signal
    elif name in system.dofs:
        return "position"
    elif name in {f"{dof}.velocity" for dof in system.dofs}:
        return "velocity"
    raise ValueError(f"output: {name!r} is neither a displacement, nor a velocity, nor an acceleration")


def is_absolute(system: SecondOrderSystem, name: str) -> bool:
    """Whether an output or state is free of the guideway.

    Examples
    --------
    >>> is_absolute(SecondOrderSystem.from_matrices([[1.0]], [[0.0]], [[4.0]]), "q1.velocity")
    True
    """
    if name not in system.outputs:
        return True
    i = system.outputs.index(name)
    return not (np.any(system.H_w[i]) or np.any(system.H_wv[i]))


def _check(
    system: SecondOrderSystem, dampers: Sequence[HookedDamper], integrator_corner: float, differentiator_corner: float
) -> None:
    if not dampers:
        raise ValueError("dampers: expected at least one")
    for label, corner in (
        ("integrator_corner", integrator_corner), ("differentiator_corner", differentiator_corner)
    ):  # fmt: skip
        if not (np.isfinite(corner) and corner > 0.0):
            raise ValueError(f"{label}: expected a positive angular frequency in rad/s, got {corner!r}")
    known = (*system.outputs, *system.states)
    for damper in dampers:
        require_known(damper.actuator, system.inputs, what="actuator")
        if not damper.terms:
            raise ValueError(f"terms: expected at least one measured term for {damper.actuator!r}")
        for term in damper.terms:
            require_known(term.measured, known, what="output")
            if not np.isfinite(term.weight):
                raise ValueError(f"weight: expected a finite number for {term.measured!r}, got {term.weight!r}")
        if not (np.isfinite(damper.damping) and damper.damping >= 0.0):
            raise ValueError(f"damping: expected N s/m of at least 0 for {damper.actuator!r}, got {damper.damping!r}")


def _controller(
    gain: FloatArray,
    signals: Sequence[Signal],
    corners: tuple[float, float],
    measured: tuple[str, ...],
    commands: tuple[str, ...],
    name: str,
) -> Controller:
    slow, fast = corners
    sizes = {"velocity": 0, "acceleration": 2, "position": 1}
    count = sum(sizes[signal] for signal in signals)
    A, B = np.zeros((count, count)), np.zeros((count, len(measured)))
    C, D = np.zeros((len(commands), count)), np.array(gain)
    at = 0
    for column, signal in enumerate(signals):
        if signal == "acceleration":
            A[at : at + 2, at : at + 2] = [[0.0, 1.0], [-(slow**2), -2.0 * slow]]
            B[at + 1, column], C[:, at + 1], D[:, column] = 1.0, gain[:, column], 0.0
        elif signal == "position":  # fast * (y - x) with x' = fast * (y - x)
            A[at, at], B[at, column] = -fast, fast
            C[:, at], D[:, column] = -fast * gain[:, column], fast * gain[:, column]
        at += sizes[signal]
    return Controller.from_matrices(A, B, C, D, measured=measured, commands=commands, name=name)
