"""Magnets and air over speed at a held height: what of a linear model follows the speed, without the rest."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.systems import SecondOrderSystem
from maglev_ctrl.vehicle import Equilibrium, Vehicle, equilibrium
from maglev_ctrl.vehicle.kinematics import stance
from maglev_ctrl.vehicle.loads import MagnetField, longitudinal_thrust, magnet_field, require_unsaturated
from maglev_ctrl.vehicle.operating import Posture
from maglev_ctrl.vehicle.shares import aerodynamic_damping, magnet_damping, magnet_stiffness, turning_stiffness


@dataclass(frozen=True, eq=False, slots=True)
class LevelMagnets:
    """C and K of a vehicle at other speeds and the same height, its currents trimmed anew; of whatever else may depend
    on speed it knows nothing, so what it gives is to be compared with the whole assembly.

    `rest`: C and K (n, n) of everything but magnets, air and turning forces; `preloads`: what the static forces take
    with the square of the speed (per m^2/s^2), which the drag of the air has.
    """

    vehicle: Vehicle
    balanced: Equilibrium
    rest: tuple[FloatArray, FloatArray]
    lift: float  # N, of all magnets
    preloads: dict[str, float]

    @classmethod
    def of(cls, vehicle: Vehicle, balanced: Equilibrium, plant: SecondOrderSystem) -> LevelMagnets | None:
        """From the model `plant` at one speed; None where more than the magnets follows the speed, or nothing trims."""
        if balanced.hold != "height" or not vehicle.magnets or vehicle.coefficient_elements:
            return None
        here = stance(vehicle, balanced.displacement)
        fields = magnet_field(vehicle, balanced.posture, here)
        C, K = _shares(vehicle, balanced.posture, fields)
        preloads: dict[str, float] = {}
        if vehicle.aerodynamics and vehicle.geometric_stiffness:
            other = 0.5 * balanced.at.speed if balanced.at.speed > 0.0 else 1.0
            moved = equilibrium(vehicle, replace(balanced.at, speed=other))
            square = other**2 - balanced.at.speed**2
            preloads = {
                name: (value - balanced.preloads[name]) / square for name, value in moved.preloads.items()
                if value != balanced.preloads[name]
            }  # fmt: skip
        return cls(vehicle, balanced, (plant.C - C, plant.K - K), float(np.sum(fields.lift)), preloads)

    def __call__(self, speed: float) -> tuple[FloatArray, FloatArray, MagnetField] | None:
        """C, K and the magnets' forces at a speed; None where they cannot carry.

        Raises
        ------
        OutOfDomain : the forces are not known there
        """
        level = replace(self.balanced.posture, speed=speed, strength=1.0)
        here = stance(self.vehicle, level.displacement)
        fields = magnet_field(self.vehicle, level, here, trimmed=False)
        lift = float(np.sum(fields.lift))
        if not (lift > 0.0 and self.lift > 0.0):
            return None
        strength = self.lift / lift
        fields = fields.scaled(strength)
        posture = replace(level, strength=strength, thrust=longitudinal_thrust(self.vehicle, level, fields.drag))
        if self.preloads:
            square = speed**2 - self.balanced.at.speed**2
            changed = {name: self.balanced.preloads[name] + rate * square for name, rate in self.preloads.items()}
            posture = replace(posture, static_forces={**posture.static_forces, **changed})
        require_unsaturated(self.vehicle, posture, fields.heights)
        C, K = _shares(self.vehicle, posture, fields)
        return self.rest[0] + C, self.rest[1] + K, fields


def _shares(vehicle: Vehicle, posture: Posture, fields: MagnetField) -> tuple[FloatArray, FloatArray]:
    """C and K (n, n) of magnets and air, and of what forces of fixed direction do where bodies turn."""
    here = stance(vehicle, posture.displacement)
    C, K = np.sum(magnet_damping(fields), axis=0), np.sum(magnet_stiffness(fields), axis=0)
    if vehicle.aerodynamics:
        C = C + np.sum(aerodynamic_damping(vehicle, posture, here), axis=0)
    if vehicle.geometric_stiffness:
        K = K + turning_stiffness(vehicle, posture, here, fields)
    return C, K
