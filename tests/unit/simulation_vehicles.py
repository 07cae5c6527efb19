"""Vehicles that the tests of the time simulation share."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from maglev_ctrl.forces import ImageForce
from maglev_ctrl.forces.base import AbstractForceModel, Domain, MagnetDerivatives, MagnetForces, no_forces
from maglev_ctrl.vehicle import (
    Actuator,
    Aerodynamics,
    Body,
    Equilibrium,
    Magnet,
    OperatingPoint,
    Sensor,
    SpringDamper,
    Vehicle,
    equilibrium,
)

COIL = ImageForce(1e5, 1.0, 2.5e7, 0.02, 1.0, vertical_velocity="receding_image")


@dataclass(frozen=True, eq=False, slots=True)
class WalledForce(AbstractForceModel):
    """Lift and guidance of one energy W = -a exp(-h/p - g/q), and a drag that falls with the speed."""

    strength: float = 1.0
    heights: tuple[float, float] = (0.0, np.inf)

    @property
    def domain(self) -> Domain:
        return Domain(height=self.heights, gap=(0.001, 1.0), speed=(1.0, 500.0))

    def forces(self, height, gap, speed):
        self.domain.require(height, gap, speed)
        h, g, v = np.broadcast_arrays(*(np.asarray(x, dtype=float) for x in (height, gap, speed)))
        F = self.strength * 1e5 * np.exp(-h / 0.05 - g / 0.08) * v / (v + 10.0)
        return MagnetForces(lift=F, guidance=0.6 * F, drag=3.0 * F / v)

    def derivatives(self, height, gap, speed):
        one, v = self.forces(height, gap, speed), np.asarray(speed, dtype=float)
        by_speed = 10.0 / (v * (v + 10.0))
        return MagnetDerivatives(
            by_height=one.scaled(-1.0 / 0.05),
            by_gap=one.scaled(-1.0 / 0.08),
            by_speed=MagnetForces(
                lift=one.lift * by_speed, guidance=one.guidance * by_speed, drag=one.drag * (by_speed - 1.0 / v)
            ),
            by_vertical_velocity=no_forces(one.lift.shape),
            by_lateral_velocity=one.scaled(-0.01),
        )

    def scaled(self, factor):
        return WalledForce(self.strength * float(factor), self.heights)


def full_vehicle(*, geometric: bool = True, kinematics: str = "consistent") -> tuple[Vehicle, Equilibrium]:
    """Every sort of element on a car of six freedoms over a bogie of three."""
    force = WalledForce()
    car = Body("car", 800.0, inertia=(300.0, 900.0, 1000.0), dofs=("surge", "sway", "heave", "roll", "pitch", "yaw"))
    bogie = Body("bogie", 300.0, inertia=(50.0, 90.0, 80.0), dofs=("heave", "roll", "yaw"), position=(0.5, 0.0, -0.4))
    vehicle = Vehicle(
        "all",
        (car, bogie),
        reference_height=0.04,
        reference_gap=0.05,
        magnets=tuple(
            Magnet(f"m{i}", body, force=force, position=(x, y, -0.6), side=side, count=2.0)
            for i, (body, x, y, side) in enumerate(
                [("car", 2.0, 0.7, 1), ("car", 2.0, -0.7, -1), ("car", -2.0, 0.6, 1), ("bogie", -1.5, -0.6, -1)]
            )
        ),
        connections=(
            SpringDamper("leg", "car", to="bogie", stiffness=4e4, damping=800.0, position=(0.5, 0.2, -0.3)),
            SpringDamper("lagged", "car", damping=500.0, lag=0.02, direction=(0.0, 0.6, 0.8), position=(1.0, 0.3, 0.1)),
            SpringDamper("twist", "car", to="bogie", stiffness=2e4, direction=(1.0, 0.0, 0.0), angular=True),
            SpringDamper("side", "bogie", stiffness=1e4, damping=90.0, direction=(0.0, 1.0, 0.0)),
        ),
        actuators=(
            Actuator("ideal", "car", position=(-1.0, 0.4, -0.2), direction=(0.0, 0.0, 1.0)),
            Actuator("slow", "car", to="bogie", bandwidth=60.0, force_limit=900.0, position=(0.5, -0.1, -0.2)),
        ),
        sensors=(
            Sensor("above", "gap", body="car", position=(1.5, 0.5, 0.0)),
            Sensor("shaken", "acceleration", body="car", position=(1.0, 0.0, 0.0)),
            Sensor("moved", "velocity", body="car", position=(0.5, 0.5, 0.5)),
        ),
        aerodynamics=(Aerodynamics("car", 0.4, position=(1.0, 0.0, 0.2)),),
        thrust_positions=(("car", (-2.0, 0.0, -0.3)),),
        geometric_stiffness=geometric,
        kinematics=kinematics,
    )
    return vehicle, equilibrium(vehicle, OperatingPoint(60.0, 0.04, gap=0.05))


def cart(
    *, mass: float = 10.0, stiffness: float = 4000.0, damping: float = 0.0, elements: dict | None = None
) -> tuple[Vehicle, Equilibrium]:
    """One mass on one spring."""
    leg = SpringDamper("leg", "car", stiffness=stiffness, damping=damping)
    vehicle = Vehicle("cart", (Body("car", mass),), connections=(leg,), reference_height=0.1, **(elements or {}))
    return vehicle, equilibrium(vehicle, OperatingPoint(20.0, 0.1))
