"""One option's loop under periodic forces: the periodic system in any situation, its modulation at unit depth."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from maglev_ctrl.analysis.tongue_removal import element_terms
from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.guideway import passing_frequency
from maglev_ctrl.scenario.scenario_schema import Periodic
from maglev_ctrl.study.modulation import ScenarioModulation, modulation_of
from maglev_ctrl.study.situation import PADE_ORDER, OptionModel, Situation
from maglev_ctrl.systems import Controller, PeriodicSystem, SecondOrderSystem, close_loop, modulate
from maglev_ctrl.vehicle import Actuator, Equilibrium, Vehicle, linearize

SHORT = 0.2  # rad: largest delay times frequency of a mode at which a delay may be merged into a lag on the map
LIGHT = 0.5  # damping ratio above which a mode does not resonate


@dataclass(frozen=True, eq=False, slots=True)
class Forcing:
    """The option's periodic system at any speed, its modulation at unit depth.

    `slowed` is the vehicle the map is drawn for. Where the delays are short against every mode, their Pade poles are a
    hundred times faster than anything the guideway excites, and integrating them over a whole map would cost more than
    all the rest: there each actuator has one lag with the same phase at low frequency. Elsewhere it is the vehicle
    itself. The deciding depth is always computed on the full model.
    """

    model: OptionModel
    vehicle: Vehicle
    slowed: Vehicle
    controller: Controller | None
    periodic: Periodic

    @classmethod
    def of(cls, model: OptionModel, controller: Controller | None, periodic: Periodic) -> Forcing:
        """The forcing of an option with its law, delays merged into lags on the map where they are short."""
        vehicle = model.vehicle()
        slowed = slowed_vehicle(vehicle) if delays_are_short(model, vehicle, controller) else vehicle
        return cls(model, vehicle, slowed, controller, periodic)

    @property
    def merged(self) -> bool:
        """Whether the map's model merges delay and bandwidth of its actuators."""
        return self.slowed is not self.vehicle

    def at(self, speed: float, *, full: bool = True) -> PeriodicSystem:
        """The periodic system at a speed, of the full model or of the one with slowed actuators."""
        situation = replace(Situation.of_design(self.model.scenario), speed=speed)
        return periodic_system(self.model, self.vehicle if full else self.slowed, situation, self.controller)


def periodic_system(
    model: OptionModel, vehicle: Vehicle, situation: Situation, controller: Controller | None,
    modulation: ScenarioModulation | None = None,
) -> PeriodicSystem:  # fmt: skip
    """The periodic system of a vehicle that is already built, in a situation, at unit depth of modulation.

    Parameters
    ----------
    modulation : None = that of the model's scenario

    Raises
    ------
    ModelError : there is no equilibrium
    OutOfDomain : the forces are not known there
    """
    modulation = modulation or modulation_of(model.scenario)
    held, balanced, closed = _closed(model, vehicle, situation, controller)
    K_cos, K_sin = modulation(held, balanced)
    return modulate(closed, K_cos, K_sin, frequency=passing_frequency(situation.speed, modulation.wavelength))


def element_parts(
    model: OptionModel, vehicle: Vehicle, situation: Situation, controller: Controller | None
) -> dict[str, tuple[FloatArray, FloatArray]]:
    """A_cos, A_sin (H, nx, nx) of every magnet's and coefficient element's modulation at unit depth, by its name.

    Raises
    ------
    ModelError : there is no equilibrium
    OutOfDomain : the forces are not known there
    """
    held, balanced, closed = _closed(model, vehicle, situation, controller)
    return element_terms(closed, modulation_of(model.scenario).elements(held, balanced))


def _closed(
    model: OptionModel, vehicle: Vehicle, situation: Situation, controller: Controller | None
) -> tuple[Vehicle, Equilibrium, SecondOrderSystem]:
    held, balanced = model.balance_of(vehicle, situation)
    plant = linearize(held, balanced, pade_order=PADE_ORDER)
    law = model.law_at(situation, controller)
    return held, balanced, plant if law is None else close_loop(plant, law)


def delays_are_short(
    model: OptionModel, vehicle: Vehicle, controller: Controller | None, *, closed: SecondOrderSystem | None = None
) -> bool:
    """Whether there are delays, and all of them short against every oscillating mode at the design point.

    `closed`: the closed loop at the design point, where it is known already.
    """
    longest = max((actuator.delay for actuator in vehicle.actuators), default=0.0)
    if longest == 0.0:
        return False  # nothing to merge
    if closed is None:
        closed = model.closed_of(vehicle, Situation.of_design(model.scenario), controller)
    s = np.linalg.eigvals(closed.state_matrix())
    oscillating = s[(s.imag > 0.0) & (-s.real < LIGHT * np.abs(s))]
    fastest = float(np.max(np.abs(oscillating))) if oscillating.size else 0.0
    return longest * fastest <= SHORT


def slowed_vehicle(vehicle: Vehicle) -> Vehicle:
    """The vehicle with delay and bandwidth of each actuator merged into one lag of the same phase at low frequency."""
    return replace(vehicle, actuators=tuple(_slowed(actuator) for actuator in vehicle.actuators))


def _slowed(actuator: Actuator) -> Actuator:
    lag = actuator.delay + (1.0 / actuator.bandwidth if actuator.bandwidth else 0.0)
    return actuator if lag == 0.0 else replace(actuator, delay=0.0, bandwidth=1.0 / lag)
