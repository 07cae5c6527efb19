"""From a vehicle's linear model to the generalised plant of a design: disturbances, performance, measurements, scaled.

Disturbances are white: an acceleration of every freedom, the noise of every sensor and, where wanted, the roughness of
the guideway, each in units of its density (two-sided, so that an H2 norm of one is a mean square of one). Performance
is every weighted output in units of its allowed value and every command in units of its allowed value.

The direct share of a white acceleration in a weighted acceleration has no finite variance and no law can change it; it
is left out, as in linear-quadratic control.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from maglev_ctrl.errors import ModelError
from maglev_ctrl.synthesis.gaussian import GuidewayNoise, SensorNoise, noise_factors
from maglev_ctrl.synthesis.neutral import hidden_modes
from maglev_ctrl.synthesis.weights import InputWeight, OutputWeight, quadratic_weights
from maglev_ctrl.systems import SecondOrderSystem
from maglev_ctrl.systems.plant import Plant


def generalised_plant(
    system: SecondOrderSystem,
    output_weights: Sequence[OutputWeight],
    input_weights: Sequence[InputWeight],
    *,
    disturbance: float,
    command_disturbance: float = 0.0,
    sensors: Sequence[SensorNoise] = (),
    guideway: GuidewayNoise | None = None,
    name: str = "plant",
) -> Plant:
    """The plant a law is designed on; without sensors every state is measured.

    Parameters
    ----------
    output_weights, input_weights : as in `design_lqr`
    disturbance : density of the acceleration of every freedom, one-sided, m/s^2 (rad/s^2) per sqrt(Hz)
    command_disturbance : density of a disturbance added to every command, in its allowed values per sqrt(Hz): what an
        uncertain actuator or plant does to a loop; it keeps the loop's own margins in the design's sight
    sensors : measured outputs and their noise densities; empty for state feedback
    guideway : roughness; needs sensors, because its states cannot be measured

    Raises
    ------
    ValueError : unknown or doubled names, densities that are not positive, or a guideway without sensors

    Examples
    --------
    >>> system = SecondOrderSystem.from_matrices([[1.0]], [[0.0]], [[4.0]], inputs=("force",), B=[[1.0]])
    >>> plant = generalised_plant(system, [OutputWeight("q1", 0.1)], [InputWeight("force", 2.0)], disturbance=1.0)
    >>> plant.performance, plant.measures_states
    (('q1', 'force'), True)
    """
    if guideway is not None and not sensors:
        raise ValueError("guideway: its roughness has states that cannot be measured; expected sensors")
    weights = quadratic_weights(system, output_weights, input_weights)
    model = noise_factors(system, weights, sensors, disturbance=disturbance, guideway=guideway)
    effort = np.diag([1.0 / given.allowed for given in input_weights])
    count = len(input_weights)
    B1, D21, disturbances = model.B1, model.D21, model.disturbances
    if command_disturbance > 0.0:
        push = np.sqrt(0.5) * command_disturbance * np.diag([given.allowed for given in input_weights])
        B1, D21 = np.hstack([B1, model.B @ push]), np.hstack([D21, model.D @ push])
        disturbances += tuple(f"{given.actuator}.disturbance" for given in input_weights)
    return Plant.from_matrices(
        model.A, B1, model.B,
        np.vstack([model.weights.rows, np.zeros((count, model.A.shape[0]))]),
        model.C if sensors else None,
        D12=np.vstack([weights.through, effort]),
        D21=D21 if sensors else None,
        D22=model.D if sensors else None,
        states=model.states, disturbances=disturbances, commands=weights.commands,
        performance=(*(given.output for given in output_weights), *weights.commands),
        measured=model.measured if sensors else None, name=name,
    )  # fmt: skip


def require_reachable(plant: Plant) -> None:
    """Refuse a plant with a mode that is not stable and that no command moves or no measurement sees.

    Raises
    ------
    ModelError : the mode by its pole and strongest states, and what would help

    Examples
    --------
    >>> require_reachable(Plant.from_matrices([[1.0]], [[1.0]], [[0.0]], [[1.0]]))
    Traceback (most recent call last):
        ...
    maglev_ctrl.errors.ModelError: the commands u1 cannot move the mode at 1 rad/s (x1): add an actuator
    """
    unmoved = hidden_modes(plant.A.T, plant.B2.T, plant.states)
    if unmoved:
        raise ModelError(f"the commands {', '.join(plant.commands)} cannot move {unmoved[0].label}: add an actuator")
    unseen = hidden_modes(plant.A, plant.C2, plant.states)
    if unseen:
        raise ModelError(f"the sensors {', '.join(plant.measured)} do not see {unseen[0].label}: add a sensor")
