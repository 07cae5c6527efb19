"""Passive elements seen as feedback, so that their margins come out of the same machinery as an active loop's."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from difflib import get_close_matches

import numpy as np

from maglev_ctrl.systems import Controller
from maglev_ctrl.vehicle.elements import Actuator, SpringDamper
from maglev_ctrl.vehicle.vehicle import Vehicle


def as_feedback(vehicle: Vehicle, names: Sequence[str]) -> tuple[Vehicle, Controller]:
    """The vehicle with some springs and dampers replaced by ideal actuators, and the passive law that drives them.

    Closing the law over the linear model gives back the eigenvalues of the original vehicle. The actuators carry the
    springs' static loads as a constant bias, so that the equilibrium is the same one.

    Parameters
    ----------
    names : connections to replace; each becomes an actuator of its name

    Raises
    ------
    ValueError : a name is not a connection of the vehicle

    Examples
    --------
    >>> from maglev_ctrl.systems import close_loop
    >>> from maglev_ctrl.vehicle import Body, OperatingPoint, linearize
    >>> leg = SpringDamper("leg", "car", stiffness=40.0, damping=2.0)
    >>> cart = Vehicle("cart", bodies=(Body("car", 10.0),), connections=(leg,), reference_height=0.1)
    >>> bare, law = as_feedback(cart, ["leg"])
    >>> close_loop(linearize(bare, OperatingPoint(0.0, 0.1)), law).K
    array([[40.]])
    """
    by_name = {connection.name: connection for connection in vehicle.connections}
    for name in names:
        if name not in by_name:
            near = get_close_matches(name, by_name, n=1)
            advice = f"did you mean {near[0]!r}?" if near else f"the connections are {', '.join(by_name) or 'none'}"
            raise ValueError(f"names: {name!r} is not a connection; {advice}")
    replaced = [by_name[name] for name in dict.fromkeys(names)]
    kept = tuple(connection for connection in vehicle.connections if connection not in replaced)
    actuators = tuple(_ideal_actuator(element) for element in replaced)
    grown = replace(vehicle, connections=kept, actuators=vehicle.actuators + actuators)
    return grown, _passive_law(replaced)


def _ideal_actuator(element: SpringDamper) -> Actuator:
    return Actuator(
        element.name, element.body, to=element.to, position=element.position, direction=element.direction,
        static_stiffness=element.stiffness, angular=element.angular,
    )  # fmt: skip


def _passive_law(elements: list[SpringDamper]) -> Controller:
    """u = -k stroke - c velocity, or -c times the velocity lagged by the damper's own lag."""
    lagged = [element for element in elements if element.lag > 0.0]
    m, n_x = len(elements), len(lagged)
    A, B = np.zeros((n_x, n_x)), np.zeros((n_x, 2 * m))
    C, D = np.zeros((m, n_x)), np.zeros((m, 2 * m))
    for i, element in enumerate(elements):
        D[i, i] = -element.stiffness
        if element.lag == 0.0:
            D[i, m + i] = -element.damping
            continue
        x = lagged.index(element)
        A[x, x], B[x, m + i], C[i, x] = -1.0 / element.lag, 1.0 / element.lag, -element.damping
    measured = [f"{element.name}.stroke" for element in elements]
    measured += [f"{element.name}.stroke.velocity" for element in elements]
    return Controller.from_matrices(
        A, B, C, D,
        measured=tuple(measured), commands=tuple(element.name for element in elements), name="passive",
    )  # fmt: skip
