"""The stiffness of everything static at a posture: what Newton's method needs."""

from __future__ import annotations

import numpy as np

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.vehicle.kinematics import stance
from maglev_ctrl.vehicle.loads import magnet_field
from maglev_ctrl.vehicle.operating import Posture
from maglev_ctrl.vehicle.shares import coefficient_share, magnet_stiffness, turning_stiffness
from maglev_ctrl.vehicle.structure import structure
from maglev_ctrl.vehicle.vehicle import Vehicle


def tangent_stiffness(vehicle: Vehicle, posture: Posture) -> FloatArray:
    """-dQ/dq of the static force balance at a posture, thrust held; (n, n).

    The geometric stiffness is always in: the balance itself turns its levers whatever the model's switch says.
    """
    known = structure(vehicle)
    here = stance(vehicle, posture.displacement)
    field = magnet_field(vehicle, posture, here)
    total = np.sum(magnet_stiffness(field), axis=0) + turning_stiffness(vehicle, posture, here, field)
    for element in vehicle.coefficient_elements:
        total += coefficient_share(element, vehicle, speed=posture.speed).K
    row = here.stroke[: len(known.links)]
    return np.asarray(total + row.T @ (known.static_stiffness[:, None] * row))
