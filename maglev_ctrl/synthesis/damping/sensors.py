"""Which sensors of a vehicle a hooked damper can use, with the signs that follow from where they sit."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Literal

import numpy as np

from maglev_ctrl.errors import ModelError
from maglev_ctrl.synthesis.damping.hooked import HookedDamper, Opposed
from maglev_ctrl.synthesis.weights import require_known
from maglev_ctrl.vehicle import GUIDEWAY, Actuator, Sensor, Vehicle

Hook = Literal["sky-hook", "ground-hook", "relative", "gap rate"]
HOOKS: tuple[Hook, ...] = ("sky-hook", "ground-hook", "relative", "gap rate")


def hooked_damper(vehicle: Vehicle, hook: Hook, actuator: str, damping: float) -> HookedDamper:
    """A hooked damper of one actuator on the sensors the vehicle has.

    sky-hook: absolute velocity (or acceleration) of the body the actuator pushes. ground-hook: the same of the unsprung
    body it reacts on, whose gap to the guideway serves where no absolute sensor is there. relative: the stroke between
    both ends. gap rate: a gap of either end. A sensor serves where it sits at the actuator and measures along it.

    Parameters
    ----------
    damping : N s/m, at least 0

    Raises
    ------
    ValueError : an unknown actuator or hook
    ModelError : the sensor that the law needs is missing (its kind and place are named)

    Examples
    --------
    >>> from maglev_ctrl.vehicle import Body
    >>> cart = Vehicle("cart", bodies=(Body("car", 10.0),), reference_height=0.1,
    ...                actuators=(Actuator("coil", "car"),), sensors=(Sensor("g", "gap", body="car"),))
    >>> hooked_damper(cart, "gap rate", "coil", 40.0).terms[0].measured
    'g'
    >>> hooked_damper(cart, "sky-hook", "coil", 40.0)
    Traceback (most recent call last):
        ...
    maglev_ctrl.errors.ModelError: sky-hook of 'coil' needs a velocity or acceleration sensor on 'car' ...: add one
    """
    require_known(actuator, [x.name for x in vehicle.actuators], what="actuator")
    if hook not in HOOKS:
        raise ValueError(f"hook: expected {', '.join(HOOKS)}, got {hook!r}")
    chosen = next(x for x in vehicle.actuators if x.name == actuator)
    term = _term(vehicle, hook, chosen)
    return HookedDamper(actuator, (term,), damping)


def _term(vehicle: Vehicle, hook: Hook, actuator: Actuator) -> Opposed:
    body, other = actuator.body, actuator.to
    here = [x for x in vehicle.sensors if _beside(x, actuator)]
    absolute = {
        end: sorted((x for x in here if x.body == end and x.to is None), key=lambda x: x.kind != "velocity")
        for end in (body, other)
    }
    gaps = [(x, 1.0 if x.body == body else -1.0) for x in here if x.kind == "gap" and x.body in (body, other)]
    where = f"at ({', '.join(f'{x:g}' for x in actuator.position)}) m"
    along = f"along ({', '.join(f'{x:g}' for x in actuator.direction)})"
    needs = f"{hook} of {actuator.name!r} needs"
    match hook:
        case "sky-hook":
            found = [(x, 1.0) for x in absolute[body]]
            missing = f"{needs} a velocity or acceleration sensor on {body!r} {where} {along}"
        case "ground-hook":
            if other == GUIDEWAY:
                raise ModelError(f"{needs} an unsprung body to react on, but {actuator.name!r} reacts on the guideway")
            found = [(x, -1.0) for x in absolute[other]] + [pair for pair in gaps if pair[0].body == other]
            missing = f"{needs} a velocity, acceleration or gap sensor on {other!r} {where} {along}"
        case "relative":
            ends = {body: other, other: body}
            found = [
                (x, 1.0 if x.body == body else -1.0)
                for x in here
                if x.kind in ("stroke", "gap") and ends.get(x.body) == x.to
            ]
            kind = "gap" if other == GUIDEWAY else "stroke"
            missing = f"{needs} a {kind} sensor between {body!r} and {other!r} {where} {along}"
        case "gap rate":
            found = gaps
            wanted = repr(body) if other == GUIDEWAY else f"{body!r} or {other!r}"
            missing = f"{needs} a gap sensor on {wanted} {where} {along}"
    return _first(found, actuator, missing)


def _first(found: Iterable[tuple[Sensor, float]], actuator: Actuator, missing: str) -> Opposed:
    for sensor, sign in found:
        turned = float(np.dot(sensor.direction, actuator.direction))
        return Opposed(sensor.name, sign * float(np.sign(turned)))
    raise ModelError(f"{missing}: add one")


def _beside(sensor: Sensor, actuator: Actuator) -> bool:
    """At the actuator's point, along its line of action, and of its sort (rotation or translation)."""
    parallel = abs(float(np.dot(sensor.direction, actuator.direction))) > 1.0 - 1e-9
    same_point = bool(np.allclose(sensor.position, actuator.position, rtol=0.0, atol=1e-6)) or sensor.angular
    return parallel and same_point and sensor.angular == actuator.angular
