"""Where a vehicle presses on its guideway, and how the force there changes with its motion.

Every magnet, and every spring, damper or actuator whose other end is the guideway, pushes its body with the vertical
force P + dF; the guideway feels the opposite. dF is the heave row of the element's own share of the linear model:
moving a body straight up moves all its points alike, so its heave row collects vertical forces and nothing else.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from maglev_ctrl.arrays import FloatArray, read_only
from maglev_ctrl.systems import Controller, SecondOrderSystem, close_loop
from maglev_ctrl.vehicle.assembly import linearize
from maglev_ctrl.vehicle.elements import GUIDEWAY
from maglev_ctrl.vehicle.operating import Equilibrium, OperatingPoint
from maglev_ctrl.vehicle.statics import equilibrium
from maglev_ctrl.vehicle.vehicle import Vehicle


@dataclass(frozen=True, eq=False, slots=True)
class VehicleOnGuideway:
    """A closed loop with the vertical forces it exerts on the guideway under it.

    `closed` is the loop; `input_places` (n_w,) m where each guideway input is felt, `rises` (n_w,) which of them is a
    heave. Contacts: `names` (k), `places` (k,) m, `weight` (k,) N the static load on the guideway, downwards; the lift
    grows by `by_state` x + `by_guideway` w + `by_rate` w', (k, n), (k, n_w), (k, n_w), and the load with it.
    """

    closed: SecondOrderSystem
    input_places: FloatArray
    rises: FloatArray
    names: tuple[str, ...]
    places: FloatArray
    weight: FloatArray
    by_state: FloatArray
    by_guideway: FloatArray
    by_rate: FloatArray


@dataclass(frozen=True, eq=False, slots=True)
class _Element:
    name: str
    body: str
    place: float
    weight: float


def vehicle_on_guideway(
    vehicle: Vehicle,
    at: Equilibrium | OperatingPoint,
    *,
    controller: Controller | None = None,
    loads: Mapping[str, float] | None = None,
    pade_order: int = 4,
) -> VehicleOnGuideway:
    """The closed loop of a vehicle, with what every magnet and every link to the guideway presses on it.

    Parameters
    ----------
    controller : closes the loop; none for a passive vehicle
    loads : static load (N, downwards) of elements by name, over what the equilibrium says; measured coefficients,
        which know no static force, need it
    pade_order : of the Pade form of actuator delays

    Raises
    ------
    ValueError : an element on a body that cannot heave, measured coefficients without a load, or an unknown name
    ModelError, OutOfDomain : no equilibrium

    Examples
    --------
    >>> from maglev_ctrl.forces import ImageForce
    >>> from maglev_ctrl.vehicle import models
    >>> coil = ImageForce(1e5, 1.0, 2.5e7, 0.02, 1.0)
    >>> car = models.heave_pitch_surge(20e3, pitch_inertia=1e5, spacing=6.0, force=coil, reference_height=0.1)
    >>> on = vehicle_on_guideway(car, OperatingPoint(40.0, 0.1))
    >>> on.names, float(np.sum(on.weight) / (20e3 * 9.80665)).__round__(9)
    (('magnet_front', 'magnet_rear'), 1.0)
    """
    state = at if isinstance(at, Equilibrium) else equilibrium(vehicle, at)
    system = linearize(vehicle, state, pade_order=pade_order)
    closed = system if controller is None else close_loop(system, controller)
    elements = _elements(vehicle, state, dict(loads or {}))
    command = None if controller is None else _commands(closed, controller)
    rows = [_force_rows(one, system, closed, controller=controller, command=command) for one in elements]
    n, n_w = len(closed.states), len(closed.guideway)
    positions = element_places(vehicle)
    felt = [name.partition("@") for name in closed.guideway]
    return VehicleOnGuideway(
        closed,
        read_only([positions[element] for _, _, element in felt], name="input_places"),
        read_only([1.0 if direction == "heave" else 0.0 for direction, _, _ in felt], name="rises"),
        tuple(one.name for one in elements),
        read_only([one.place for one in elements], name="places"),
        read_only([one.weight for one in elements], name="weight"),
        read_only(np.array([row[0] for row in rows]).reshape(-1, n), name="by_state"),
        read_only(np.array([row[1] for row in rows]).reshape(-1, n_w), name="by_guideway"),
        read_only(np.array([row[2] for row in rows]).reshape(-1, n_w), name="by_rate"),
    )


def element_places(vehicle: Vehicle) -> dict[str, float]:
    """x (m, forward) of every magnet, link, sensor and measured element, by its name: the places of its guideway input.

    Examples
    --------
    >>> from maglev_ctrl.vehicle import Body, SpringDamper
    >>> leg = SpringDamper("leg", "car", position=(2.0, 0.0, 0.0), stiffness=1e4)
    >>> element_places(Vehicle("cart", bodies=(Body("car", 10.0),), connections=(leg,), reference_height=0.1))
    {'leg': 2.0}
    """
    return {name: place[0] for name, place in vehicle.places.items()}


def _elements(vehicle: Vehicle, state: Equilibrium, loads: dict[str, float]) -> list[_Element]:
    found = [
        _Element(one.name, one.body, one.position[0], float(lift))
        for one, lift in zip(vehicle.magnets, state.forces.lift, strict=True)
    ]
    for element in vehicle.coefficient_elements:
        if element.name not in loads:
            raise ValueError(f"loads: expected the static load of {element.name!r}: measured matrices do not know it")
        found.append(_Element(element.name, element.body, vehicle.body(element.body).position[0], 0.0))
    for link in vehicle.links:
        if link.to == GUIDEWAY and not link.angular and link.direction[2] != 0.0:
            static = state.preloads.get(link.name, 0.0) * link.direction[2]
            found.append(_Element(link.name, link.body, link.position[0], float(static)))
    unknown = loads.keys() - {one.name for one in found}
    if unknown:
        raise ValueError(f"loads: {sorted(unknown)[0]!r} presses on no guideway; {', '.join(o.name for o in found)} do")
    for one in found:
        if f"{one.body}.heave" not in vehicle.dofs:
            raise ValueError(f"{one.name}: the force of an element on {one.body!r}, which cannot heave, is not known")
    return [_Element(one.name, one.body, one.place, float(loads.get(one.name, one.weight))) for one in found]


def _commands(closed: SecondOrderSystem, controller: Controller) -> tuple[FloatArray, FloatArray]:
    """The controller's commands over the closed loop's states, and over [w; w']."""
    Y, _, Y_w = closed.output_rows(controller.measured)
    by_state = controller.D @ Y
    count = len(controller.states)
    if count:
        by_state[:, -count:] += controller.C
    return by_state, controller.D @ Y_w


def _force_rows(
    one: _Element, system: SecondOrderSystem, closed: SecondOrderSystem, *, controller: Controller | None,
    command: tuple[FloatArray, FloatArray] | None,
) -> tuple[FloatArray, FloatArray, FloatArray]:  # fmt: skip
    """Vertical force of one element on its body by state, guideway displacements and their rates."""
    (share,) = (part for part in closed.contributions if part.name == one.name and part.kind != "controller")
    h = closed.dofs.index(f"{one.body}.heave")
    kept, n_w = list(closed.positions), len(closed.guideway)
    X, _, W = closed.acceleration_rows()
    by_state = np.concatenate([-share.K[h][kept], -share.C[h], share.F[h]]) - share.M[h] @ X
    by_both = -share.M[h] @ W
    for column, name in enumerate(system.guideway):
        if name.partition("@")[2] == one.name:
            by_both[column] += system.K_w[h, column]
            by_both[n_w + column] += system.C_w[h, column]
    if controller is not None and command is not None:
        for row, name in enumerate(controller.commands):
            # A magnet's own command pushes at once only where it is a current.
            if name in (one.name, f"{one.name}.current"):
                push = system.B[h, system.inputs.index(name)]
                by_state, by_both = by_state + push * command[0][row], by_both + push * command[1][row]
    return by_state, by_both[:n_w], by_both[n_w:]
