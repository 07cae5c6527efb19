"""Faults of electromagnets in a scenario: where their forces are not known, and which currents can be measured."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from maglev_ctrl.scenario.layout import layout
from maglev_ctrl.scenario.option_schema import OptionRecord
from maglev_ctrl.scenario.problems import Fault, KeyPath
from maglev_ctrl.scenario.scenario_schema import Scenario
from maglev_ctrl.scenario.units import Dimensions, dimensions_of
from maglev_ctrl.scenario.vehicle_schema import DoubleL, SixDof, TwoStage

SIDEWAYS = ("sway", "yaw")
"""Freedoms that need a lateral force, which an electromagnet's model does not know."""


def electromagnet_faults(scenario: Scenario) -> Iterator[Fault]:
    """Faults between `[forces] model = "electromagnet"` and the rest of the file."""
    vehicle = scenario.vehicle
    if isinstance(vehicle, DoubleL):
        yield Fault(
            ("forces", "model"),
            'expected "corner_image", "eddy_current", "table" or "coefficients": a double_l needs guidance forces, and '
            "electromagnets lift only",
        )
        return
    if isinstance(vehicle, SixDof | TwoStage) and vehicle.magnets is not None and vehicle.magnets.guidance:
        yield Fault(("vehicle", "magnets", "guidance"), "expected false: electromagnets lift and do not guide")
    if isinstance(vehicle, SixDof) and "freedom" not in vehicle.model_fields_set:
        yield Fault(
            ("vehicle", "freedom"),
            f"missing; expected freedoms without {' and '.join(SIDEWAYS)}: the lateral force of electromagnets is not "
            "modelled",
        )
        return
    for path, freedoms in _carriers(scenario):
        for index, freedom in enumerate(freedoms):
            if freedom in SIDEWAYS:
                yield Fault(
                    (*path, index),
                    f'expected no "{freedom}" on a body with electromagnets: their lateral force is not modelled',
                )
    if scenario.periodic is not None:
        yield Fault(
            ("periodic",),
            "expected no periodic guideway with electromagnets: it would change their force per current and their "
            "inductance too, and the theory varies the stiffness alone",
            at_key=True,
        )


def _carriers(scenario: Scenario) -> Iterator[tuple[KeyPath, tuple[str, ...]]]:
    vehicle = scenario.vehicle
    if isinstance(vehicle, SixDof) and layout(vehicle).magnets:
        yield ("vehicle", "freedom"), vehicle.freedom
    if isinstance(vehicle, TwoStage):
        for index, bogie in enumerate(vehicle.bogies):
            yield ("vehicle", "bogie", index, "freedom"), bogie.freedom


def current_sensor_faults(
    option: OptionRecord, commands: Mapping[str, tuple[Dimensions, tuple[str, ...]]], *, path: KeyPath
) -> Iterator[Fault]:
    """Faults of sensors of a current: nothing to measure, or a place that means nothing to them.

    Parameters
    ----------
    commands : the electromagnets' commands
    path : of the option
    """
    volts = any(dimensions == dimensions_of("V") for dimensions, _ in commands.values())
    for index, sensor in enumerate(option.sensors):
        if sensor.kind != "current":
            continue
        place: KeyPath = (*path, "sensor", index)
        if not volts:
            yield Fault((*place, "kind"), 'expected electromagnets with drive = "voltage", whose currents are states')
        if sensor.at is not None:
            yield Fault((*place, "at"), "a current is measured in its magnet; remove it", at_key=True)
