"""Control laws from engineering terms: linear-quadratic state feedback, output feedback with an observer, sky-hook."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from maglev_ctrl.errors import Agreement, ModelError, Status
from maglev_ctrl.synthesis.design import Certificate, Design, verify, worst
from maglev_ctrl.synthesis.gaussian import GuidewayNoise, SensorNoise, noise_model
from maglev_ctrl.synthesis.lq import Compensator, lqg
from maglev_ctrl.synthesis.neutral import NEUTRAL_RATE, Uncontrollable, hidden_modes, prepare
from maglev_ctrl.synthesis.riccati import RiccatiSolution, riccati_continuous
from maglev_ctrl.synthesis.skyhook import SkyHook, sky_hook
from maglev_ctrl.synthesis.weights import InputWeight, OutputWeight, quadratic_weights
from maglev_ctrl.systems import Controller, SecondOrderSystem

__all__ = ["GuidewayNoise", "SensorNoise", "SkyHook", "design_lqg", "design_lqr", "sky_hook"]


def design_lqr(
    system: SecondOrderSystem,
    output_weights: Sequence[OutputWeight],
    input_weights: Sequence[InputWeight],
    *,
    name: str = "LQR",
    neutral_rate: float = NEUTRAL_RATE,
    uncontrollable: Uncontrollable = "refuse",
) -> Design:
    """Linear-quadratic feedback of all states, those of actuator lags, delays and damper lags included.

    Minimises the integral of sum (z_i / allowed_i)^2 + sum (u_j / allowed_j)^2; accelerations among z carry the
    actuators' direct effect. A neutral mode without weight is made to decay at `neutral_rate` and this is noted.

    Parameters
    ----------
    output_weights : outputs or states and their largest acceptable values
    input_weights : actuators the design may use and their largest acceptable commands, N
    neutral_rate : rad/s
    uncontrollable : "leave" designs for the other modes when one mode cannot be moved; its pole stays, and the
        certificate shows it

    Raises
    ------
    ValueError : unknown or doubled names, batch axes
    ModelError : no stabilising law exists, with the mode that stands in the way

    Examples
    --------
    >>> plant = SecondOrderSystem.from_matrices([[1.0]], [[0.0]], [[-1.0]], inputs=("force",), B=[[1.0]])
    >>> design = design_lqr(plant, [OutputWeight("q1", 1.0)], [InputWeight("force", 1.0)])
    >>> design.status.name, design.certificate.stable
    ('SOLVED', True)
    """
    weights = quadratic_weights(system, output_weights, input_weights)
    A = system.state_matrix()
    B = system.input_matrix()[:, [system.inputs.index(x) for x in weights.commands]]
    prepared = prepare(A, B, weights, states=system.states, neutral_rate=neutral_rate, uncontrollable=uncontrollable)
    solution = riccati_continuous(prepared.A, B, prepared.Q, weights.R, weights.N).require()
    controller = Controller.static(-solution.gain, measured=system.states, commands=weights.commands, name=name)
    certificate = verify(system, controller)
    left_alone = any("stays as it is" in note for note in prepared.notes)
    status = _status((solution,), certificate, expected_stable=not left_alone)
    return Design(
        name=name, law="LQR", controller=controller, status=status, riccati=(solution,), weights=weights,
        certificate=certificate, notes=_notes(prepared.notes, (solution,)),
    )  # fmt: skip


def design_lqg(
    system: SecondOrderSystem,
    output_weights: Sequence[OutputWeight],
    input_weights: Sequence[InputWeight],
    *,
    sensors: Sequence[SensorNoise],
    disturbance: float,
    guideway: GuidewayNoise | None = None,
    refined: SecondOrderSystem | None = None,
    name: str = "LQG",
    neutral_rate: float = NEUTRAL_RATE,
) -> Design:
    """Linear-quadratic law on the estimate of a steady Kalman filter; sensors to commands, one dynamic controller.

    Every freedom is disturbed by an acceleration of the given density (force M times it), which accelerometers feel at
    once: process and measurement noise are then correlated and the filter knows it, as it knows the direct effect of
    the actuators on accelerometers. With `guideway` the estimator carries each guideway displacement as a state.

    Parameters
    ----------
    output_weights, input_weights : as in `design_lqr`
    sensors : measured outputs (or states) and their noise densities, one-sided, unit per sqrt(Hz)
    disturbance : density of the acceleration on every freedom, one-sided, m/s^2 (rad/s^2) per sqrt(Hz)
    guideway : roughness of the guideway
    refined : a plant with higher Pade order for the certificate

    Raises
    ------
    ValueError : unknown or doubled names, densities that are not positive, batch axes
    ModelError : no stabilising law exists, or the sensors do not see a mode that is not stable

    Examples
    --------
    >>> plant = SecondOrderSystem.from_matrices([[1.0]], [[0.0]], [[-1.0]], inputs=("force",), B=[[1.0]])
    >>> design = design_lqg(plant, [OutputWeight("q1", 1.0)], [InputWeight("force", 1.0)],
    ...                     sensors=[SensorNoise("q1", 1e-3)], disturbance=1.0)
    >>> design.certificate.stable, design.controller.measured
    (True, ('q1',))
    """
    weights = quadratic_weights(system, output_weights, input_weights)
    model = noise_model(system, weights, sensors, disturbance=disturbance, guideway=guideway)
    unseen = hidden_modes(model.A, model.C, model.states)
    if unseen:
        raise ModelError(f"the sensors {', '.join(model.measured)} do not see {unseen[0].label}: add a sensor")
    prepared = prepare(
        model.A, model.B, model.weights, states=model.states, neutral_rate=neutral_rate, uncontrollable="refuse"
    )
    compensator = lqg(
        model.A, model.B, model.C, model.D,
        weights=(prepared.Q, weights.R, model.weights.N),
        noise=(model.process, model.measurement, model.cross),
    )  # fmt: skip
    controller = _output_feedback(compensator, model.measured, weights.commands, name)
    certificate = verify(system, controller, refined=refined)
    solutions = (compensator.regulator, compensator.observer.riccati)
    return Design(
        name=name, law="LQG", controller=controller, status=_status(solutions, certificate, expected_stable=True),
        riccati=solutions, weights=weights, certificate=certificate, notes=_notes(prepared.notes, solutions),
    )  # fmt: skip


def _output_feedback(
    compensator: Compensator, measured: tuple[str, ...], commands: tuple[str, ...], name: str
) -> Controller:
    return Controller.from_matrices(
        compensator.A, compensator.B, compensator.C, np.zeros((len(commands), len(measured))),
        measured=measured, commands=commands, name=name,
    )  # fmt: skip


def _status(solutions: tuple[RiccatiSolution, ...], certificate: Certificate, *, expected_stable: bool) -> Status:
    """A solver's word counts only where the certificate bears it out."""
    refuted = certificate.agreed is not Agreement.AGREED or (expected_stable and not certificate.stable)
    return Status.NOT_VERIFIED if refuted else worst(*(solution.status for solution in solutions))


def _notes(notes: tuple[str, ...], solutions: tuple[RiccatiSolution, ...]) -> tuple[str, ...]:
    return notes + tuple(f"Riccati equation: {s.message}" for s in solutions if s.message)
