"""The stiffness of everything static at a posture: what Newton's method needs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.vehicle.elements import Actuator
from maglev_ctrl.vehicle.kinematics import poses, stroke_row
from maglev_ctrl.vehicle.loads import magnet_field
from maglev_ctrl.vehicle.operating import Posture
from maglev_ctrl.vehicle.shares import coefficient_share, geometry_share, magnet_shares, spring_damper_share
from maglev_ctrl.vehicle.vehicle import Vehicle


def tangent_stiffness(vehicle: Vehicle, posture: Posture) -> FloatArray:
    """-dQ/dq of the static force balance at a posture, thrust held; (n, n).

    The geometric stiffness is always in: the balance itself turns its levers whatever the model's switch says.
    """
    n = len(vehicle.dofs)
    found = poses(vehicle, posture.displacement)
    field = magnet_field(vehicle, posture, found)
    shares = [
        *magnet_shares(vehicle, field, n),
        *(coefficient_share(e, found, speed=posture.speed, size=n) for e in vehicle.coefficient_elements),
        *(spring_damper_share(replace(e, lag=0.0), found, n) for e in vehicle.connections),
        geometry_share(vehicle, posture, found, field),
    ]
    total = np.zeros((n, n))
    for share in shares:
        total += share.K
    for actuator in vehicle.actuators:
        total += _bias_stiffness(actuator, posture, vehicle)
    return total


def _bias_stiffness(actuator: Actuator, posture: Posture, vehicle: Vehicle) -> FloatArray:
    row = stroke_row(
        poses(vehicle, posture.displacement), actuator.body, actuator.to,
        position=actuator.position, direction=actuator.direction, angular=actuator.angular, size=len(vehicle.dofs),
    )  # fmt: skip
    return np.asarray(actuator.static_stiffness * np.outer(row, row))
