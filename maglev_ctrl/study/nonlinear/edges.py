"""Where stability ends in the simulation: boundaries along the sweeps, starts that return."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from maglev_ctrl.analysis.simulation.attraction import attraction, axes_of
from maglev_ctrl.analysis.simulation.measure import Case, boundary_check
from maglev_ctrl.errors import MaglevError
from maglev_ctrl.study.nonlinear.compared import row
from maglev_ctrl.study.nonlinear.records import Compared
from maglev_ctrl.study.situation import PADE_ORDER
from maglev_ctrl.study.sweeps import DISPLAY, sweep, sweep_values, varied
from maglev_ctrl.systems import close_loop
from maglev_ctrl.vehicle import linearize

if TYPE_CHECKING:
    from maglev_ctrl.study.nonlinear.run import SimulatedOption

NEAR = 0.04
"""How far either side of a linear boundary the nonlinear one is looked for."""
TOLERANCE = 3e-3
"""Relative width of the bracket in which the nonlinear boundary is told; linear and nonlinear have to agree to 1 %."""
RUNS, CYCLES = 2, 8.0
POINTS = 15
SIZES = (0.1, 0.3, 0.6, 0.9)
"""Starts, in shares of the clearance."""
_FAULTS = (MaglevError, ValueError, ArithmeticError, np.linalg.LinAlgError)


def compared_boundaries(one: SimulatedOption) -> list[Compared]:
    """The first stability boundary of every sweep beside the one that small nonlinear motions show."""
    found: list[Compared] = []
    for parameter, values in sweep_values(one.model.scenario):
        chosen = np.linspace(values[0], values[-1], min(len(values), POINTS))
        looked = sweep(one.model, one.continuous, parameter=parameter, values=chosen)
        crossings = [crossing.value for crossing in looked.boundaries.crossings]
        if not crossings:
            continue
        unit, scale = DISPLAY[parameter]
        own = {"payload": one.model.scenario.vehicle.car.payload}.get(parameter)
        design = own if own is not None else float(getattr(one.situation, parameter) or crossings[0])
        linear = min(crossings, key=lambda value: abs(value - design))

        def make(value: float, parameter: str = parameter) -> Case:
            situation = varied(one.situation, parameter, value)  # type: ignore[arg-type]
            vehicle, balanced = one.model.balance(situation)
            return vehicle, balanced, one.model.law_at(situation, one.continuous)

        width = NEAR * abs(linear)
        name = f"stability boundary in {parameter.replace('_', ' ')}"
        try:
            check = boundary_check(
                make, (linear - width, linear + width), duration=_duration(one, make(linear)), tolerance=TOLERANCE,
                runs=RUNS,
            )  # fmt: skip
        except _FAULTS as fault:
            reason = f"{fault}"
            found.append(row(name, unit, linear=linear * scale, nonlinear=np.nan, band=(np.nan, np.nan), reason=reason))
            continue
        band = (check.bracket[0] * scale, check.bracket[1] * scale)
        found.append(
            row(name, unit, linear=linear * scale, nonlinear=check.boundary * scale, band=band, reason=check.reason)
        )
    return found


def _duration(one: SimulatedOption, there: Case) -> float:
    """Some cycles of the slowest oscillation at a boundary, at most what the scenario asks of a run."""
    vehicle, balanced, law = there
    plant = linearize(vehicle, balanced, pade_order=PADE_ORDER)
    s = np.linalg.eigvals((plant if law is None else close_loop(plant, law)).state_matrix())
    oscillating = np.abs(s.imag[s.imag > 1e-3 * np.abs(s)])
    wanted = CYCLES * 2.0 * np.pi / float(np.min(oscillating)) if oscillating.size else 2.0
    return float(np.clip(wanted, 1.0, max(one.request.duration, 1.0)))


def returned_starts(one: SimulatedOption, decay: float) -> tuple[tuple[str, float, int, int], ...]:
    """Starts of growing size along each vertical and lateral coordinate: how many of them return."""
    ride = one.model.scenario.ride
    room = float(np.min(one.balanced.magnet_heights)) - ride.smallest_height if one.vehicle.magnets else 0.0
    names = [name for name in one.vehicle.dofs if name.endswith((".heave", ".sway"))]
    if room <= 0.0 or not names:
        return ()
    try:
        found = attraction(
            one.vehicle, one.balanced, coordinates=dict.fromkeys(names, room), sizes=SIZES,
            duration=float(np.clip(5.0 / -decay, 2.0, 40.0)), controller=one.controller, directions=axes_of(names),
            limits=one.limits, sampling=one.sampling, computation=one.request.computing_delay, seed=one.request.seed,
        )  # fmt: skip
    except _FAULTS:
        return ()
    told = []
    for k, size in enumerate(found.sizes.tolist()):
        for i, name in enumerate(names):
            both = found.returned[k, [i, i + len(names)]]
            told.append((name, float(size * room), int(np.sum(both)), 2))
    return tuple(told)
