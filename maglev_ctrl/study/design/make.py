"""From an option's record to a proved law: plants at the corners, the synthesis asked for, one certificate for all."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING, assert_never

import numpy as np

from maglev_ctrl.arrays import read_only
from maglev_ctrl.errors import ModelError, Status
from maglev_ctrl.proofs.makers import decay_claim
from maglev_ctrl.scenario import ControlLaw, OptionRecord, Scenario, control_law
from maglev_ctrl.scenario.control_schema import (
    Corners,
    HookedLaw,
    Lqg,
    Lqi,
    Lqr,
    MultiObjective,
    OutputFeedback,
    Predictive,
    RiccatiLaw,
    Scheduled,
    SkyHook,
)
from maglev_ctrl.scenario.hooks import hooked_dampers
from maglev_ctrl.study.design.corners import Corner, corner_words, corners_of, systems_at
from maglev_ctrl.study.situation import OptionModel, Situation
from maglev_ctrl.synthesis.channels import generalised_plant, require_reachable
from maglev_ctrl.synthesis.damping.hooked import design_hooked
from maglev_ctrl.synthesis.design import Design, verify
from maglev_ctrl.synthesis.gaussian import GuidewayNoise, SensorNoise
from maglev_ctrl.synthesis.h2 import h2_output_feedback, h2_state_feedback
from maglev_ctrl.synthesis.h_infinity import h_infinity_output_feedback, h_infinity_state_feedback
from maglev_ctrl.synthesis.integral_action import Integral, lqi
from maglev_ctrl.synthesis.laws import design_lqg, design_lqr
from maglev_ctrl.synthesis.lmi.regions import Region, damping, disk, intersection
from maglev_ctrl.synthesis.result import Refused, Synthesis, proven
from maglev_ctrl.synthesis.scheduling.interpolated import scheduled_lqr
from maglev_ctrl.synthesis.scheduling.polytopic import polytopic_lpv
from maglev_ctrl.synthesis.scheduling.records import ScheduledDesign
from maglev_ctrl.synthesis.skyhook import SkyHook as SkyHookDamper
from maglev_ctrl.synthesis.skyhook import sky_hook
from maglev_ctrl.synthesis.weights import InputWeight, OutputWeight
from maglev_ctrl.systems import Controller, SecondOrderSystem
from maglev_ctrl.systems.plant import Plant
from maglev_ctrl.systems.scheduled import ScheduledController

if TYPE_CHECKING:
    from maglev_ctrl.synthesis.lmi.request import CommandLimits, Objective
    from maglev_ctrl.synthesis.predictive.design import PredictiveDesign

_OBJECTIVES: dict[str, Objective] = {
    "h2": "h2", "h_infinity": "h_infinity", "decay_rate": "decay", "gain": "gain", "none": "feasible",
}  # fmt: skip
_UNITS = {"speed": "m/s", "height": "m", "gap": "m", "payload": "kg"}
UNIT_DISTURBANCE = 1.0
"""m/s^2 (rad/s^2) per sqrt(Hz): what laws without a disturbance of their own are shown against."""


@dataclass(frozen=True, eq=False, slots=True)
class MadeLaw:
    """A law with what only its kind has: corners, region of poles, schedule, predictive law."""

    design: Design
    corners: tuple[Corner, ...]
    region: Region | None = None
    scheduled: ScheduledDesign | None = None
    predictive: PredictiveDesign | None = None


@dataclass(frozen=True, eq=False, slots=True)
class Task:
    """One option's law to be made: its record, the names spelled out, and the models to make it on."""

    name: str
    law: ControlLaw
    model: OptionModel

    @property
    def outputs(self) -> tuple[OutputWeight, ...]:
        """Weighted outputs."""
        return tuple(OutputWeight(name, allowed) for name, allowed in self.law.output_weights)

    @property
    def inputs(self) -> tuple[InputWeight, ...]:
        """Weighted commands."""
        return tuple(InputWeight(name, allowed) for name, allowed in self.law.input_weights)

    @property
    def sensors(self) -> tuple[SensorNoise, ...]:
        """The option's sensors and their noise."""
        return tuple(SensorNoise(name, density) for name, density in self.law.noise)

    def corners(self, corners: Corners | None) -> tuple[Corner, ...]:
        """The design point and the law's corners."""
        return corners_of(self.model, corners)

    def system(self) -> SecondOrderSystem:
        """The linear model at the design point, loops open, delays left out.

        Raises
        ------
        ModelError : there is no equilibrium at the design point
        """
        return self.model.plant(Situation.of_design(self.model.scenario), pade_order=0)

    def plants(
        self,
        corners: Sequence[Corner],
        *,
        disturbance: float,
        command_disturbance: float = 0.0,
        sensors: bool = False,
    ) -> tuple[Plant, ...]:
        """Generalised plants at the corners.

        Raises
        ------
        ModelError : no equilibrium, or a mode that no command moves or no sensor sees
        OutOfDomain : the forces are not known at a corner
        """
        found = tuple(
            generalised_plant(
                system,
                self.outputs,
                self.inputs,
                disturbance=disturbance,
                command_disturbance=command_disturbance,
                sensors=self.sensors if sensors else (),
                name=corner.name,
            )
            for corner, system in systems_at(self.model, tuple(corners))
        )
        for plant in found:
            require_reachable(plant)
        return found


def make_law(scenario: Scenario, option: OptionRecord, model: OptionModel) -> MadeLaw | None:
    """The option's law, proved, or None for an option without one.

    Laws are designed on the plant without actuator delays, because a delay's Pade states cannot be measured.

    Raises
    ------
    ModelError : there is no equilibrium, no such law, or its claims could not be proved
    OutOfDomain : the forces are not known at a corner
    ValueError : a weight or sensor does not fit the plant
    """
    law = control_law(scenario, option)
    if law is None:
        return None
    task = Task(option.name, law, model)
    record = law.record
    match record:
        case Lqr():
            system = task.system()
            return _plain(task, system, design_lqr(system, task.outputs, task.inputs, name=task.name))
        case Lqg():
            system = task.system()
            made = design_lqg(
                system, task.outputs, task.inputs,
                sensors=task.sensors, disturbance=record.disturbance, name=task.name,
            )  # fmt: skip
            plant = task.plants(task.corners(None), disturbance=record.disturbance, sensors=True)[0]
            return _plain(task, system, made, plant=plant)
        case SkyHook():
            system = task.system()
            dampers = tuple(
                SkyHookDamper(actuator, velocity, damping=record.damping)
                for actuator, velocity in zip(law.actuators, law.placed(record.sensor), strict=True)
            )
            return _plain(task, system, sky_hook(system, dampers, name=task.name))
        case HookedLaw():
            system = task.system()
            hooked = hooked_dampers(model.vehicle(), record)
            return _plain(task, system, design_hooked(system, hooked, name=task.name))
        case Lqi():
            return _integral(task, record)
        case RiccatiLaw():
            return _riccati(task, record)
        case MultiObjective():
            return _multi_objective(task, record)
        case OutputFeedback():
            return _output_feedback(task, record)
        case Scheduled():
            return _scheduled(task, record)
        case Predictive():
            return _predictive(task, record)
        case _ as never:
            assert_never(never)


def judged_plant(system: SecondOrderSystem, controller: Controller, task: Task) -> Plant:
    """The plant with the measurements a finished controller takes, whatever they are called."""
    columns = [system.inputs.index(name) for name in controller.commands]
    C, D, _ = system.output_rows(controller.measured)
    if task.outputs and tuple(w.actuator for w in task.inputs) == controller.commands:
        shown = generalised_plant(system, task.outputs, task.inputs, disturbance=UNIT_DISTURBANCE, name="design point")
        quiet = read_only(np.zeros((len(controller.measured), len(shown.disturbances))), name="D21")
        return replace(
            shown, C2=read_only(C, name="C2"), D21=quiet, D22=read_only(D[:, columns], name="D22"),
            measured=controller.measured,
        )  # fmt: skip
    A, B = system.state_matrix(), system.input_matrix()[:, columns]
    return Plant.from_matrices(
        A, np.zeros((A.shape[0], 0)), B, np.zeros((0, A.shape[0])), C, D22=D[:, columns],
        states=system.states, disturbances=(), commands=controller.commands, performance=(),
        measured=controller.measured, name="design point",
    )  # fmt: skip


def _plain(task: Task, system: SecondOrderSystem, design: Design, *, plant: Plant | None = None) -> MadeLaw:
    """A law of the vehicle's own design functions, given the claims the others have."""
    plant = judged_plant(system, design.controller, task) if plant is None else plant
    synthesis = proven(
        design.law, [plant], [design.controller],
        claims=[decay_claim([plant], [design.controller])], notes=design.notes, status=_claimed(design.status),
    )  # fmt: skip
    return MadeLaw(replace(design, synthesis=synthesis), task.corners(None))


def _claimed(status: Status) -> Status:
    return status if status in (Status.SOLVED, Status.ALMOST_SOLVED) else Status.ALMOST_SOLVED


def _adopted(task: Task, synthesis: Synthesis, *, schedule: ScheduledController | None = None) -> Design:
    """A synthesis on plants as the vehicle's design: closed again on the vehicle's own matrices and verified there.

    Raises
    ------
    ModelError : the synthesis returned no law
    """
    synthesis.require()
    point = Situation.of_design(task.model.scenario)
    controller = replace(synthesis.controllers[0], name=task.name)
    model = task.model
    if schedule is not None:
        model = replace(model, schedule=schedule)
        law = model.law_at(point, controller)
        assert law is not None
        controller = replace(law, name=task.name)
    certificate = verify(task.system(), controller)
    return Design(
        name=task.name, law=synthesis.law, controller=controller, status=synthesis.status, riccati=(), weights=None,
        certificate=certificate, notes=synthesis.notes, synthesis=synthesis, schedule=schedule,
    )  # fmt: skip


def _integral(task: Task, record: Lqi) -> MadeLaw:
    corners = task.corners(None)
    plants = task.plants(corners, disturbance=UNIT_DISTURBANCE)
    integrals = [Integral(name, item.value.value) for item in record.integral for name in task.law.placed(item.output)]
    return MadeLaw(_adopted(task, lqi(plants[0], integrals, name=task.name)), corners)


def _riccati(task: Task, record: RiccatiLaw) -> MadeLaw:
    corners = task.corners(None)
    guideway = None if record.guideway is None else GuidewayNoise(record.guideway)
    plant = generalised_plant(
        task.system(), task.outputs, task.inputs,
        disturbance=record.disturbance, command_disturbance=record.command_disturbance,
        sensors=task.sensors if record.feedback == "sensors" else (),
        guideway=guideway, name="design point",
    )  # fmt: skip
    require_reachable(plant)
    states = record.feedback == "states"
    if record.law == "h2":
        best = h2_state_feedback(plant) if states else h2_output_feedback(plant)
        return MadeLaw(_adopted(task, best.synthesis), corners)
    feedback = h_infinity_state_feedback if states else h_infinity_output_feedback
    made = feedback(plant, back_off=record.back_off, gain_bound=record.gain_bound)
    return MadeLaw(_adopted(task, made.synthesis), corners)


def region_of(record: MultiObjective) -> Region | None:
    """The region of poles a law asks for besides its decay rate; None without one."""
    wanted = [damping(record.damping_ratio)] if record.damping_ratio is not None else []
    wanted += [disk(0.0, record.fastest)] if record.fastest is not None else []
    return intersection(*wanted) if wanted else None


def _multi_objective(task: Task, record: MultiObjective) -> MadeLaw:
    corners = task.corners(record.corners)
    plants = task.plants(corners, disturbance=record.disturbance, command_disturbance=record.command_disturbance)
    region = region_of(record)
    from maglev_ctrl.synthesis.lmi.request import MultiObjective as Request
    from maglev_ctrl.synthesis.lmi.state_feedback import multi_objective

    request = Request(
        objective=_OBJECTIVES[record.objective], h2_below=record.h2_below, h_infinity_below=record.h_infinity_below,
        decay_rate=record.decay_rate, region=region, gain_below=record.gain_below,
        commands=_command_limits(task, record, plants[0]),
    )  # fmt: skip
    made = multi_objective(
        plants, request, lyapunov=record.lyapunov, cross_check=record.cross_check, time_limit=record.time_limit
    )
    return MadeLaw(_adopted(task, made), corners, region=region)


def _command_limits(task: Task, record: MultiObjective, plant: Plant) -> CommandLimits | None:
    """The actuators' force limits, to be kept from every start the law names."""
    from maglev_ctrl.synthesis.lmi.request import CommandLimits

    if not record.hold_from:
        return None
    limits = {actuator.name: actuator.force_limit for actuator in task.model.vehicle().actuators}
    allowed = np.zeros(len(plant.states))
    for item in record.hold_from:
        if item.output not in plant.states:
            raise ModelError(f"hold_from: {item.output!r} is no state of the model: {', '.join(plant.states)}")
        allowed[plant.states.index(item.output)] = item.value.value
    return CommandLimits(
        limits=tuple(float(limits.get(name) or np.inf) for name in plant.commands),
        allowed=read_only(allowed, name="allowed"),
    )


def _output_feedback(task: Task, record: OutputFeedback) -> MadeLaw:
    corners = task.corners(record.corners)
    plants = task.plants(
        corners, disturbance=record.disturbance, command_disturbance=record.command_disturbance, sensors=True
    )
    mask = np.ones((len(plants[0].commands) + record.order, len(plants[0].measured) + record.order), dtype=bool)
    if task.law.links:
        for i, actuator in enumerate(plants[0].commands):
            for j, sensor in enumerate(plants[0].measured):
                mask[i, j] = (sensor, actuator) in task.law.links
    from maglev_ctrl.synthesis.structured.design import structured_design
    from maglev_ctrl.synthesis.structured.structure import Structure

    made = structured_design(
        plants, Structure.from_mask(mask, order=record.order),
        objective=record.objective, starts=record.starts, seed=record.seed, time_limit=record.time_limit,
    )  # fmt: skip
    return MadeLaw(_adopted(task, made), corners)


def _scheduled(task: Task, record: Scheduled) -> MadeLaw:
    """Gains over one operating parameter; the law at the design point is the schedule's there."""
    point = Situation.of_design(task.model.scenario)

    def corner(value: float) -> Corner:
        return Corner(replace(point, **{record.over: value}), 1.0, corner_words(record.over, value))

    def plant_at(value: float) -> Plant:
        return task.plants([corner(value)], disturbance=UNIT_DISTURBANCE)[0]

    values = [node.value for node in record.nodes]
    plants = [plant_at(value) for value in values]
    middles = [0.5 * (low + high) for low, high in pairwise(values)]
    between = [(value, plant_at(value)) for value in middles]
    wanted = None if record.fastest_change is None else record.fastest_change.value
    if record.method == "interpolated":
        made = scheduled_lqr(
            plants, values, parameter=record.over, unit=_UNITS[record.over], between=between, plant_at=plant_at,
            wanted_rate=wanted, time_limit=record.time_limit,
        )  # fmt: skip
    else:
        made = polytopic_lpv(
            plants,
            values,
            objective="regulator",
            parameter=record.over,
            unit=_UNITS[record.over],
            time_limit=record.time_limit,
        )
    if made.schedule is None:
        made.require()
        raise ModelError("scheduled law: no schedule over one parameter was made")
    design = _adopted(task, made.synthesis, schedule=made.schedule)
    nodes = tuple(corner(float(value)) for value in made.schedule.nodes)
    return MadeLaw(design, (*task.corners(None), *nodes), scheduled=made)


def _predictive(task: Task, record: Predictive) -> MadeLaw:
    """Predictive control; margins and sweeps are those of the linear law that it equals while no limit is active."""
    from maglev_ctrl.study.design.predictive import predictive_law

    system = task.system()
    linear = design_lqr(system, task.outputs, task.inputs, name=task.name)
    predictive = predictive_law(task.model, system, task.law, record, linear)
    if not predictive.synthesis.controllers:
        found = predictive.synthesis
        raise Refused(f"{found.status.value}; {found.message}", found.status)
    note = (
        "poles, sweeps and margins are those of the continuous linear-quadratic law with the same weights; while no "
        "limit is active the predictive law is its sampled form"
    )
    design = replace(
        linear, law="predictive control", synthesis=predictive.synthesis,
        notes=(*linear.notes, note, *predictive.synthesis.notes),
    )  # fmt: skip
    return MadeLaw(design, task.corners(None), predictive=predictive)
