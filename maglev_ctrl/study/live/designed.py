"""One option with its law, the values of its file as the sliders have them: what every view is computed from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from maglev_ctrl.errors import MaglevError, ModelError
from maglev_ctrl.scenario import Scenario
from maglev_ctrl.scenario.guideway_schema import EddyCurrentForces
from maglev_ctrl.scenario.problems import near_match
from maglev_ctrl.scenario.quantity_paths import ScenarioQuantity, with_quantity
from maglev_ctrl.study.forcing import delays_are_short, periodic_system, slowed_vehicle
from maglev_ctrl.study.law import designed_option
from maglev_ctrl.study.modulation import ScenarioModulation, modulation_of
from maglev_ctrl.study.situation import PADE_ORDER, OptionModel, Situation
from maglev_ctrl.systems import Controller, PeriodicSystem, SecondOrderSystem, at_depth, close_loop
from maglev_ctrl.vehicle import Equilibrium, Vehicle, linearize

NO_PERIOD = "the scenario describes no periodic forces: there is no map"
FAULTS = (MaglevError, ValueError, ArithmeticError, np.linalg.LinAlgError)


@dataclass(frozen=True, eq=False, slots=True)
class AtSituation:
    """The vehicle as it is held in a situation, its equilibrium, and its linear model with the loop open and closed."""

    situation: Situation
    held: Vehicle
    balanced: Equilibrium
    plant: SecondOrderSystem
    closed: SecondOrderSystem


@dataclass(frozen=True, eq=False, slots=True)
class Designed:
    """An option whose law is designed at its scenario's own design point."""

    model: OptionModel
    controller: Controller | None
    notes: tuple[str, ...]
    modulation: ScenarioModulation | None
    map_reason: str
    _merged: list[bool] = field(default_factory=list)
    _slowed: dict[float | None, Vehicle] = field(default_factory=dict)
    _last: list[AtSituation] = field(default_factory=list)

    def twin(self) -> Designed:
        """The same for another thread."""
        return replace(self, _merged=list(self._merged), _slowed=dict(self._slowed), _last=list(self._last))

    @property
    def merged(self) -> bool:
        """Whether on the map delay and bandwidth of every actuator are one lag, being short against every mode."""
        if not self._merged:
            vehicle, own = self.vehicle(None), Situation.of_design(self.model.scenario)
            self._merged.append(
                self.modulation is not None
                and delays_are_short(
                    self.model, vehicle, self.controller, closed=self.model.closed_of(vehicle, own, self.controller)
                )
            )
        return self._merged[0]

    def vehicle(self, payload: float | None) -> Vehicle:
        """The vehicle with the option's elements at a payload (kg)."""
        return self.model.vehicle(payload)

    def slowed(self, payload: float | None) -> Vehicle:
        """The vehicle the map is drawn for."""
        if not self.merged:
            return self.vehicle(payload)
        if payload not in self._slowed:
            self._slowed[payload] = slowed_vehicle(self.vehicle(payload))
        return self._slowed[payload]

    def closed(self, situation: Situation) -> tuple[SecondOrderSystem, Equilibrium]:
        """The closed loop in a situation and its equilibrium.

        Raises
        ------
        ModelError : there is no equilibrium
        OutOfDomain : the forces are not known there
        """
        at = self.at(situation)
        return at.closed, at.balanced

    def at(self, situation: Situation) -> AtSituation:
        """The loop in a situation with what it is made of; the last one is remembered.

        Raises
        ------
        ModelError : there is no equilibrium
        OutOfDomain : the forces are not known there
        """
        if self._last and self._last[0].situation == situation:
            return self._last[0]
        held, balanced = self.model.balance_of(self.vehicle(situation.payload), situation)
        plant = linearize(held, balanced, pade_order=PADE_ORDER)
        law = self.model.law_at(situation, self.controller)
        found = AtSituation(situation, held, balanced, plant, plant if law is None else close_loop(plant, law))
        self._last[:] = [found]
        return found

    def periodic(self, situation: Situation, depth: float, *, full: bool) -> PeriodicSystem:
        """The periodic system in a situation at a depth, of the full model or of the map's.

        Raises
        ------
        ModelError : there is no equilibrium
        OutOfDomain : the forces are not known there
        """
        vehicle = self.vehicle(situation.payload) if full else self.slowed(situation.payload)
        try:
            unit = periodic_system(self.model, vehicle, situation, self.controller, self.modulation)
        except (ValueError, np.linalg.LinAlgError) as fault:
            raise ModelError(f"{fault}") from None
        return at_depth(unit, depth)


def designed(
    scenario: Scenario, option_name: str, changes: Sequence[tuple[ScenarioQuantity, float]] = ()
) -> Designed:  # fmt: skip
    """The option of a scenario, some values of its file replaced, with its law.

    Raises
    ------
    ModelError : no option of that name, forces that are not solved, an invalid value, no equilibrium, or no law
    OutOfDomain : the forces are not known at the design point
    """
    if isinstance(scenario.forces, EddyCurrentForces) and scenario.solved_force is None:
        raise ModelError(
            f"{scenario.path}: its eddy-current forces have to be solved first; call maglev_ctrl.study.solve_forces"
        )
    if changes:
        scenario = with_quantity(scenario, tuple(changes))
    option = next((one for one in scenario.options if one.name == option_name), None)
    if option is None:
        names = [one.name for one in scenario.options]
        raise ModelError(f'unknown option "{option_name}"{near_match(option_name, names)}')
    try:
        model, design = designed_option(scenario, option)
        controller = None if design is None else design.controller
        model.balance(Situation.of_design(scenario))
    except (ValueError, ArithmeticError, np.linalg.LinAlgError) as fault:
        raise ModelError(f"{fault}") from None
    modulation, reason = None, NO_PERIOD
    if scenario.periodic is not None:
        try:
            modulation, reason = modulation_of(scenario), ""
        except FAULTS as fault:
            reason = f"{fault}"
    return Designed(model, controller, () if design is None else tuple(design.notes), modulation, reason)
