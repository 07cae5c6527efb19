"""Which sensors a damping law uses at each actuator of a built vehicle."""

from __future__ import annotations

from maglev_ctrl.scenario.control_schema import HookedLaw
from maglev_ctrl.synthesis.damping.hooked import HookedDamper
from maglev_ctrl.synthesis.damping.sensors import Hook, hooked_damper
from maglev_ctrl.vehicle import Vehicle

_KEYS: tuple[tuple[str, Hook], ...] = (
    ("sky", "sky-hook"), ("ground", "ground-hook"), ("relative", "relative"), ("gap_rate", "gap rate")
)  # fmt: skip


def hooked_dampers(vehicle: Vehicle, law: HookedLaw) -> tuple[HookedDamper, ...]:
    """Every damper of the law: each of its kinds at each actuator.

    Raises
    ------
    ModelError : the sensor that a kind needs at an actuator is missing (its kind and place are named)
    """
    return tuple(
        hooked_damper(vehicle, hook, actuator.name, getattr(law, key))
        for key, hook in _KEYS
        if getattr(law, key) > 0.0
        for actuator in vehicle.actuators
    )
