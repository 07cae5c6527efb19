"""Faults of the operating points a law has to hold at: corners, and the nodes of a schedule."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

from maglev_ctrl.errors import MaglevError
from maglev_ctrl.scenario.checks_values import product, unit_faults
from maglev_ctrl.scenario.control_schema import Corners, Scheduled
from maglev_ctrl.scenario.force_schema import CoefficientForces, ElectromagnetForces
from maglev_ctrl.scenario.operating_points import PARAMETERS, corners_in, points_of
from maglev_ctrl.scenario.option_schema import OptionRecord
from maglev_ctrl.scenario.problems import Fault, KeyPath
from maglev_ctrl.scenario.scenario_schema import Scenario
from maglev_ctrl.scenario.units import dimensions_of
from maglev_ctrl.vehicle import Vehicle

CORNER_LIMIT = 32
_STIFFNESS = "magnetic_stiffness"


def point_faults(scenario: Scenario, option: OptionRecord, *, path: KeyPath) -> Iterator[Fault]:
    """Every fault of an option's corners and of its schedule's nodes.

    Parameters
    ----------
    path : of the option
    """
    for corners, place in corners_in(option):
        yield from _corner_faults(scenario, corners, path=(*path, *place))
    if isinstance(option.control, Scheduled):
        yield from _schedule_faults(scenario, option.control, path=(*path, "control"))


def domain_faults(scenario: Scenario, option: OptionRecord, vehicle: Vehicle, *, path: KeyPath) -> Iterator[Fault]:
    """Points of an option at which the forces of the built vehicle are not known."""
    design = scenario.operating
    for point in points_of(option, path=path):
        height = point.value if point.key == "height" else design.height
        gap = point.value if point.key == "gap" else design.gap
        speed = point.value if point.key == "speed" else design.speed
        try:
            for magnet in vehicle.magnets:
                magnet.force.domain.require(height, gap, speed)
            for element in vehicle.coefficient_elements:
                element.table.at(speed)
        except (MaglevError, ValueError) as error:
            yield Fault(point.path, f"the forces are not known there: {error}")


def _corner_faults(scenario: Scenario, corners: Corners, *, path: KeyPath) -> Iterator[Fault]:
    keys = (*PARAMETERS, _STIFFNESS)
    values = {key: getattr(corners, key) for key in keys if getattr(corners, key)}
    if not values:
        yield Fault(path, "expected at least one list of values: speed, payload, height, gap or magnetic_stiffness")
    count = 1
    for key, found in values.items():
        count *= len(found)
        for index, value in enumerate(found):
            if value in found[:index]:
                yield Fault((*path, key, index), "this value is named twice; expected different ones")
        reason = _absent(scenario, key)
        if reason:
            yield Fault((*path, key), reason, at_key=True)
    if count > CORNER_LIMIT:
        yield Fault(path, f"expected at most {CORNER_LIMIT} combinations, got {count}")


def _absent(scenario: Scenario, key: str) -> str:
    """Why a parameter cannot be varied in this scenario; '' where it can."""
    forces, operating = scenario.forces, scenario.operating
    if key == "gap" and operating.gap is None:
        return "the design point has no guidance gap, so there is none to vary; remove it"
    if key in ("height", "gap") and isinstance(forces, CoefficientForces):
        return f"forces given as coefficients do not change with the {key}; remove it"
    if key == "height" and operating.hold == "strength":
        return 'with hold = "strength" the height follows from the magnets; remove it'
    if key == _STIFFNESS and isinstance(forces, ElectromagnetForces):
        return (
            "the stiffness of electromagnets, their force per current and their inductance belong together; vary the "
            "height instead"
        )
    return ""


def _schedule_faults(scenario: Scenario, law: Scheduled, *, path: KeyPath) -> Iterator[Fault]:
    unit = PARAMETERS[law.over]
    wanted = dimensions_of(unit)
    if law.fastest_change is not None:
        per_second = product(wanted, (("[time]", -1.0),))
        yield from unit_faults(
            f"the change of {law.over}", law.fastest_change, per_second, path=(*path, "fastest_change")
        )
    reason = _absent(scenario, law.over)
    if reason:
        yield Fault((*path, "over"), reason)
        return
    wrong = [
        fault
        for index, node in enumerate(law.nodes)
        for fault in unit_faults(law.over, node, wanted, path=(*path, "nodes", index))
    ]
    yield from wrong
    if wrong:
        return
    values = [node.value for node in law.nodes]
    if values[0] <= 0.0 and law.over != "payload":
        yield Fault((*path, "nodes", 0), f'expected a {law.over} above zero, got "{law.nodes[0].text}"')
    if any(b <= a for a, b in pairwise(values)):
        yield Fault((*path, "nodes"), "expected rising values")
        return
    design = scenario.vehicle.car.payload if law.over == "payload" else getattr(scenario.operating, law.over)
    if not values[0] <= design <= values[-1]:
        first, last = law.nodes[0].text, law.nodes[-1].text
        yield Fault(
            (*path, "nodes"),
            f"expected nodes on both sides of the design point, whose {law.over} is {design:g} {unit}; got {first} to "
            f"{last}",
        )
