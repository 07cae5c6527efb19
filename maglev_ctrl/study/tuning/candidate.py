"""An option's model that remembers what it was asked for: one candidate is looked at in many ways."""

from __future__ import annotations

from dataclasses import dataclass, field

from maglev_ctrl.scenario import build_option, build_vehicle
from maglev_ctrl.study.situation import PADE_ORDER, OptionModel, Situation
from maglev_ctrl.systems import Controller, SecondOrderSystem, close_loop
from maglev_ctrl.vehicle import Equilibrium, Vehicle


@dataclass(eq=False, slots=True)
class Shared:
    """What every candidate of one option has in common: bare vehicles, and equilibria that no variable moves.

    `statics_fixed`: no design variable is a stiffness, so that springs, magnets and posture balance alike; then the
    equilibria found once hold for all candidates.
    """

    statics_fixed: bool
    bare: dict[float | None, Vehicle] = field(default_factory=dict)
    balanced: dict[tuple[object, ...], Equilibrium] = field(default_factory=dict)


@dataclass(frozen=True, eq=False, slots=True)
class CandidateModel(OptionModel):
    """As `OptionModel`, for one candidate; vehicles, equilibria and plants are built once.

    Only for options without a damping budget: the file's dampers are the candidate's.
    """

    shared: Shared = field(default_factory=lambda: Shared(statics_fixed=False))
    vehicles: dict[float | None, Vehicle] = field(default_factory=dict)
    plants: dict[tuple[object, ...], SecondOrderSystem] = field(default_factory=dict)

    def vehicle(self, payload: float | None = None) -> Vehicle:
        """The vehicle with the option's elements, at a payload (kg; None = the scenario's)."""
        if payload not in self.vehicles:
            if payload not in self.shared.bare:
                self.shared.bare[payload] = build_vehicle(self.scenario, payload=payload)
            bare = self.shared.bare[payload]
            made = bare if self.option is None else build_option(self.scenario, self.option, bare)
            self.vehicles[payload] = made
        return self.vehicles[payload]

    def balance_of(self, vehicle: Vehicle, situation: Situation) -> tuple[Vehicle, Equilibrium]:
        """As `balance`, for a vehicle that is already built."""
        if not self.shared.statics_fixed or self.scenario.operating.hold != "height":
            return OptionModel.balance_of(self, vehicle, situation)
        known = self.shared.balanced
        key = (*_place(situation), *(connection.name for connection in vehicle.connections))
        if key not in known:
            known[key] = OptionModel.balance_of(self, vehicle, situation)[1]
        return vehicle, known[key]

    def plant(self, situation: Situation, *, pade_order: int = PADE_ORDER) -> SecondOrderSystem:
        """Linear model with the actuators' loops open."""
        key = (*_place(situation), pade_order)
        if key not in self.plants:
            self.plants[key] = OptionModel.plant(self, situation, pade_order=pade_order)
        return self.plants[key]

    def closed_of(
        self, vehicle: Vehicle, situation: Situation, controller: Controller | None, *, pade_order: int = PADE_ORDER
    ) -> SecondOrderSystem:
        """Linear model of a vehicle that is already built, with the controller's loops closed."""
        if vehicle is not self.vehicle(situation.payload):
            return OptionModel.closed_of(self, vehicle, situation, controller, pade_order=pade_order)
        plant = self.plant(situation, pade_order=pade_order)
        law = self.law_at(situation, controller)
        return plant if law is None else close_loop(plant, law)


def _place(situation: Situation) -> tuple[object, ...]:
    return (situation.speed, situation.payload, situation.height, situation.gap, situation.lateral_offset)
