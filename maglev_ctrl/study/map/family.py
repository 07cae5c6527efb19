"""The loop of one option over two quantities of its scenario: what a map is computed of."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from maglev_ctrl.analysis.floquet_margins import scaled_controller
from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.errors import ModelError
from maglev_ctrl.scenario.quantity_paths import DEPTH, GAIN, SITUATION, WAVELENGTH, ScenarioQuantity
from maglev_ctrl.study.forcing import delays_are_short, element_parts, periodic_system, slowed_vehicle
from maglev_ctrl.study.map.request import MapRequest
from maglev_ctrl.study.modulation import ScenarioModulation, modulation_of
from maglev_ctrl.study.situation import OptionModel, Situation
from maglev_ctrl.study.variants import of_file, varied_option
from maglev_ctrl.systems import Controller, PeriodicSystem, at_depth
from maglev_ctrl.vehicle import Vehicle

_KEPT_AT_MOST = 4096
"""Variants of the scenario and systems kept for reuse."""
_LOOP_STAYS = frozenset({*SITUATION, DEPTH, WAVELENGTH})
"""Quantities that leave vehicle and law alone. With others the loop may become as fast as its delays."""


@dataclass(frozen=True, eq=False, slots=True)
class _Variant:
    """The option with some values of the file replaced."""

    model: OptionModel
    controller: Controller | None
    modulation: ScenarioModulation
    vehicles: dict[float | None, Vehicle] = field(default_factory=dict)


@dataclass(frozen=True, eq=False, slots=True)
class OptionFamily:
    """Periodic systems of an option over two quantities, each at its actual depth of modulation.

    The law is designed once, at the scenario's own values; only a quantity of the law itself designs it anew. `merged`:
    delay and bandwidth of every actuator are one lag, as on the resonance map of the report; only where that was asked
    for, they are short against every mode and neither quantity changes the loop.
    """

    model: OptionModel
    controller: Controller | None
    x: ScenarioQuantity
    y: ScenarioQuantity
    merged: bool
    _variants: dict[tuple[float, ...], _Variant] = field(default_factory=dict)
    _units: dict[tuple[float, ...], PeriodicSystem] = field(default_factory=dict)
    _sizes: set[int] = field(default_factory=set)

    @classmethod
    def of(cls, model: OptionModel, controller: Controller | None, request: MapRequest) -> OptionFamily:
        """The family of an option whose law is designed already.

        Raises
        ------
        ModelError : there is no equilibrium at the design point
        OutOfDomain : the forces are not known there
        """
        x, y = request.x.quantity, request.y.quantity
        merged = (
            request.merge_delays
            and all(one.name in _LOOP_STAYS for one in (x, y))
            and delays_are_short(model, model.vehicle(), controller)
        )
        made = cls(model, controller, x, y, merged)
        made._sizes.add(len(made.nominal().A_0))
        return made

    def __call__(self, x: float, y: float) -> PeriodicSystem:
        """The system at two values (SI).

        Raises
        ------
        ModelError : no valid scenario, no equilibrium, or a model of another order than at the design point
        OutOfDomain : the forces are not known there
        """
        values = ((self.x, float(x)), (self.y, float(y)))
        key = tuple(value for quantity, value in values if quantity.name != DEPTH)
        depth = next((value for quantity, value in values if quantity.name == DEPTH), None)
        unit = self._units.get(key)
        if unit is None:
            unit = self._unit(values)
            if len(key) == 1 and len(self._units) < _KEPT_AT_MOST:
                self._units[key] = unit
        if depth is None:
            depth = self._variant(values).modulation.depth
        return at_depth(unit, depth)

    def nominal(self) -> PeriodicSystem:
        """The system at the scenario's own values, at its expected depth."""
        variant = self._variant(())
        unit = self._system(variant, Situation.of_design(self.model.scenario), self.controller)
        return at_depth(unit, variant.modulation.depth)

    def path(self, speed: float) -> PeriodicSystem:
        """The system at a speed, everything else at the scenario's own values, at unit depth."""
        situation = replace(Situation.of_design(self.model.scenario), speed=float(speed))
        return self._system(self._variant(()), situation, self.controller)

    def elements(self, speed: float) -> dict[str, tuple[FloatArray, FloatArray]]:
        """The parts of every element in the modulation of `path`, at unit depth."""
        situation = replace(Situation.of_design(self.model.scenario), speed=float(speed))
        variant = self._variant(())
        return element_parts(variant.model, self._vehicle(variant, None), situation, self.controller)

    def _unit(self, values: tuple[tuple[ScenarioQuantity, float], ...]) -> PeriodicSystem:
        """The system at unit depth."""
        variant = self._variant(values)
        moved = {quantity.name: value for quantity, value in values if quantity.name in SITUATION}
        situation = replace(Situation.of_design(variant.model.scenario), **moved)
        law, gain = variant.controller, next((value for quantity, value in values if quantity.name == GAIN), 1.0)
        if law is not None and gain != 1.0:
            law = scaled_controller(law, gain)
            variant = replace(variant, model=variant.model.with_gain(gain))
        system = self._system(variant, situation, law)
        if self._sizes and len(system.A_0) not in self._sizes:
            at = " and ".join(f"{quantity.name} {value:g} {quantity.unit}".rstrip() for quantity, value in values)
            size = next(iter(self._sizes))
            raise ModelError(f"the model has {len(system.A_0)} states at {at}, and {size} at the design point")
        return system

    def _system(self, variant: _Variant, situation: Situation, controller: Controller | None) -> PeriodicSystem:
        try:
            vehicle = self._vehicle(variant, situation.payload)
            return periodic_system(variant.model, vehicle, situation, controller, variant.modulation)
        except (ValueError, np.linalg.LinAlgError) as error:
            raise ModelError(str(error)) from None

    def _vehicle(self, variant: _Variant, payload: float | None) -> Vehicle:
        vehicle = variant.vehicles.get(payload)
        if vehicle is None:
            vehicle = variant.model.vehicle(payload)
            vehicle = variant.vehicles[payload] = slowed_vehicle(vehicle) if self.merged else vehicle
        return vehicle

    def _variant(self, values: tuple[tuple[ScenarioQuantity, float], ...]) -> _Variant:
        """The option with values of the file replaced, as far as they change it."""
        changes = tuple(one for one in values if of_file(one[0]))
        key = tuple(value for _, value in changes)
        found = self._variants.get(key)
        if found is None:
            found = self._varied(changes)
            if len(self._variants) < _KEPT_AT_MOST:
                self._variants[key] = found
        return found

    def _varied(self, changes: tuple[tuple[ScenarioQuantity, float], ...]) -> _Variant:
        model, controller = varied_option(self.model, self.controller, changes)
        try:
            return _Variant(model, controller, modulation_of(model.scenario))
        except (ValueError, np.linalg.LinAlgError) as error:
            raise ModelError(str(error)) from None
