"""One option at one operating situation: vehicle, equilibrium, plant and closed loop."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from maglev_ctrl.analysis.floquet_margins import scaled_controller
from maglev_ctrl.errors import OutOfDomain
from maglev_ctrl.scenario import OptionRecord, Scenario, build_option, build_vehicle
from maglev_ctrl.systems import Controller, SecondOrderSystem, close_loop
from maglev_ctrl.systems.scheduled import ScheduledController
from maglev_ctrl.vehicle import Equilibrium, OperatingPoint, Vehicle, equilibrium, linearize

PADE_ORDER = 2
"""Order of the Pade form of actuator delays in studies; every closed loop is checked again with VERIFICATION_ORDER."""

VERIFICATION_ORDER = 5


_KEPT = 4  # vehicles of an option at different payloads


@dataclass(frozen=True, eq=False, slots=True)
class Situation:
    """Speed (m/s), payload (kg), levitation height, guidance gap and lateral offset (m)."""

    speed: float
    payload: float | None
    height: float
    gap: float | None
    lateral_offset: float

    @classmethod
    def of_design(cls, scenario: Scenario) -> Situation:
        """The scenario's design point."""
        operating = scenario.operating
        return cls(
            speed=operating.speed, payload=None, height=operating.height, gap=operating.gap,
            lateral_offset=operating.lateral_offset,
        )  # fmt: skip

    @property
    def point(self) -> OperatingPoint:
        """What the vehicle floor calls it."""
        return OperatingPoint(self.speed, self.height, gap=self.gap, lateral_offset=self.lateral_offset)


@dataclass(frozen=True, eq=False, slots=True)
class OptionModel:
    """A scenario's vehicle with one option's elements (None: the bare vehicle), ready to be put into any situation.

    With `schedule` the option's law follows an operating parameter. `dampings` (N s/m) take the place of what the file
    gives some of its springs and dampers: those a damping budget has chosen.
    """

    scenario: Scenario
    option: OptionRecord | None
    schedule: ScheduledController | None = None
    dampings: tuple[tuple[str, float], ...] = ()
    _built: dict[float | None, Vehicle] = field(default_factory=dict, init=False, repr=False)  # of the last payloads

    def law_at(self, situation: Situation, controller: Controller | None) -> Controller | None:
        """The control law in a situation: the schedule's where there is one, else the one given.

        Raises
        ------
        OutOfDomain : the situation is outside the schedule
        """
        if controller is None or self.schedule is None:
            return controller
        value: float | None = getattr(situation, self.schedule.parameter)
        try:
            return self.schedule.at(self.scenario.vehicle.car.payload if value is None else value)
        except ValueError as fault:
            raise OutOfDomain(f"the law is not scheduled there: {fault}") from None

    def with_gain(self, factor: float) -> OptionModel:
        """The model with the commands of its schedule, where it has one, multiplied by a factor."""
        if self.schedule is None or factor == 1.0:
            return self
        laws = tuple(scaled_controller(law, factor) for law in self.schedule.controllers)
        return replace(self, schedule=replace(self.schedule, controllers=laws))

    def vehicle(self, payload: float | None = None) -> Vehicle:
        """The vehicle with the option's elements, at a payload (kg; None = the scenario's); kept for the next question,
        because what is computed of a vehicle once is kept with it."""
        found = self._built.get(payload)
        if found is None:
            if len(self._built) >= _KEPT:
                self._built.clear()
            found = self._built[payload] = self._vehicle(payload)
        return found

    def _vehicle(self, payload: float | None) -> Vehicle:
        bare = build_vehicle(self.scenario, payload=payload)
        if self.option is None:
            return bare
        built, chosen = build_option(self.scenario, self.option, bare), dict(self.dampings)
        if not chosen:
            return built
        connections = tuple(replace(c, damping=chosen.get(c.name, c.damping)) for c in built.connections)
        return replace(built, connections=connections)

    def balance(self, situation: Situation) -> tuple[Vehicle, Equilibrium]:
        """The vehicle and its equilibrium in a situation.

        With hold = "strength" the magnets keep the strength they need at the design point, and the height follows.

        Raises
        ------
        ModelError : there is no equilibrium
        OutOfDomain : the forces are not known there
        """
        return self.balance_of(self.vehicle(situation.payload), situation)

    def balance_of(self, vehicle: Vehicle, situation: Situation) -> tuple[Vehicle, Equilibrium]:
        """As `balance`, for a vehicle that is already built."""
        if self.scenario.operating.hold == "height" or not vehicle.magnets:
            return vehicle, equilibrium(vehicle, situation.point)
        design = Situation.of_design(self.scenario)
        designed = self.vehicle(None) if situation.payload is not None else vehicle
        strength = equilibrium(designed, design.point).strength
        magnets = tuple(replace(m, force=m.force.scaled(strength)) for m in vehicle.magnets)
        held = replace(vehicle, magnets=magnets)
        return held, equilibrium(held, situation.point, hold="strength")

    def plant(self, situation: Situation, *, pade_order: int = PADE_ORDER) -> SecondOrderSystem:
        """Linear model with the actuators' loops open.

        Raises
        ------
        ModelError : there is no equilibrium
        OutOfDomain : the forces are not known there
        """
        vehicle, balanced = self.balance(situation)
        return linearize(vehicle, balanced, pade_order=pade_order)

    def closed_of(
        self, vehicle: Vehicle, situation: Situation, controller: Controller | None, *, pade_order: int = PADE_ORDER
    ) -> SecondOrderSystem:
        """Linear model of a vehicle that is already built, with the controller's loops closed.

        Raises
        ------
        ModelError : there is no equilibrium
        OutOfDomain : the forces are not known there
        """
        held, balanced = self.balance_of(vehicle, situation)
        plant = linearize(held, balanced, pade_order=pade_order)
        law = self.law_at(situation, controller)
        return plant if law is None else close_loop(plant, law)
