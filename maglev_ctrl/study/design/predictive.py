"""Predictive control of one option, and the manoeuvre it is shown by."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from maglev_ctrl.arrays import FloatArray, read_only
from maglev_ctrl.errors import ModelError
from maglev_ctrl.scenario import ControlLaw, OptionRecord, Scenario
from maglev_ctrl.scenario.control_schema import Predictive
from maglev_ctrl.scenario.layout import layout, outputs_of
from maglev_ctrl.scenario.units import Dimensions, dimensions_of
from maglev_ctrl.study.design.records import PredictiveStudy, Signal
from maglev_ctrl.study.situation import OptionModel
from maglev_ctrl.synthesis.channels import generalised_plant
from maglev_ctrl.synthesis.design import Design
from maglev_ctrl.synthesis.predictive.design import PredictiveDesign, design_predictive
from maglev_ctrl.synthesis.predictive.problem import OutputLimit, predictive_problem
from maglev_ctrl.synthesis.predictive.simulate import PredictiveRun, simulate_predictive, simulate_saturated
from maglev_ctrl.synthesis.sampling import held_cost, sampled
from maglev_ctrl.synthesis.weights import InputWeight, OutputWeight
from maglev_ctrl.systems import SecondOrderSystem
from maglev_ctrl.systems.plant import Plant

SOFT_PRICE = 100.0
"""Price of breaking a soft limit by its own size, in units of an output at its allowed value for one second."""
_DISPLAY: tuple[tuple[str, str, float], ...] = (
    ("m", "mm", 1e3), ("N", "kN", 1e-3), ("m/s", "m/s", 1.0), ("m/s^2", "m/s^2", 1.0),
    ("rad/s", "deg/s", 180.0 / np.pi),
)  # fmt: skip


def predictive_law(
    model: OptionModel, system: SecondOrderSystem, law: ControlLaw, record: Predictive, linear: Design
) -> PredictiveDesign:
    """The predictive law: weights of the linear one, the actuators' force limits, and the limits on outputs.

    Raises
    ------
    ModelError : no stabilising regulator, or no terminal set was found
    """
    weights = linear.weights
    assert weights is not None
    limits = tuple(
        OutputLimit(
            name,
            -limit.value.value,
            limit.value.value,
            soft=not limit.hard,
            linear=0.0 if limit.hard else SOFT_PRICE * record.sampling_period / limit.value.value,
            quadratic=0.0 if limit.hard else SOFT_PRICE * record.sampling_period / limit.value.value**2,
        )
        for limit in record.limits
        for name in law.placed(limit.output)
    )
    plant = _plant(system, law, tuple(limit.name for limit in limits))
    dt = record.sampling_period
    _, _, Q, R, N = held_cost(plant.A, plant.B2, weights.Q, weights.R, weights.N, dt=dt)
    largest = np.array([_force_limit(model, name) for name in plant.commands])
    hard = any(limit.hard for limit in record.limits)
    problem = predictive_problem(
        sampled(plant, dt), horizon=record.horizon, Q=Q, R=R, N=N, command_limits=(-largest, largest),
        output_limits=limits, terminal="set" if hard else "cost",
    )  # fmt: skip
    return design_predictive(problem)


def predictive_study(
    scenario: Scenario, option: OptionRecord, record: Predictive, design: PredictiveDesign
) -> PredictiveStudy:
    """The manoeuvre of the scenario with prediction and with the saturated law.

    Raises
    ------
    ModelError : the manoeuvre names a freedom that the model has no state for
    """
    plant = design.problem.plant
    steps = max(2, round(record.duration / record.sampling_period))
    start, load = np.zeros(len(plant.states)), np.zeros(len(plant.disturbances))
    for item in record.start:
        start[_index(plant.states, item.output)] = item.value.value
    for item in record.load:
        load[_index(plant.disturbances, f"{item.output}.disturbance")] = item.value.value
    runs = (simulate_predictive(design, start, steps=steps, disturbance=load),
            simulate_saturated(design, start, steps=steps, disturbance=load))  # fmt: skip
    return PredictiveStudy(
        design=design,
        time=read_only(record.sampling_period * np.arange(steps), name="time"),
        signals=(*_outputs(scenario, option, design, runs), *_commands(design, runs)),
        with_prediction=runs[0],
        saturated=runs[1],
    )


def _plant(system: SecondOrderSystem, law: ControlLaw, limited: tuple[str, ...]) -> Plant:
    """States measured, disturbances in m/s^2, limited and weighted outputs in their own units as performance."""
    names = tuple(dict.fromkeys((*limited, *(name for name, _ in law.output_weights))))
    inputs = tuple(InputWeight(name, allowed) for name, allowed in law.input_weights)
    unit = generalised_plant(
        system, [OutputWeight(name, 1.0) for name in names], inputs,
        disturbance=float(np.sqrt(2.0)), name="design point",
    )  # fmt: skip
    kept = len(names)
    return replace(
        unit, C1=unit.C1[:kept], D11=unit.D11[:kept], D12=unit.D12[:kept], performance=unit.performance[:kept]
    )


def _force_limit(model: OptionModel, name: str) -> float:
    actuator = next((a for a in model.vehicle().actuators if a.name == name), None)
    return np.inf if actuator is None or actuator.force_limit is None else float(actuator.force_limit)


def _index(names: tuple[str, ...], name: str) -> int:
    if name not in names:
        raise ModelError(f"manoeuvre: {name!r} is no state of the model, which has {', '.join(names[:6])}, ...")
    return names.index(name)


def _outputs(
    scenario: Scenario, option: OptionRecord, design: PredictiveDesign, runs: tuple[PredictiveRun, PredictiveRun]
) -> list[Signal]:
    known = {name: dimensions for dimensions, members in outputs_of(option, layout(scenario.vehicle)).values()
             for name in members}  # fmt: skip
    limits = {limit.name: limit.upper for limit in design.problem.output_limits}
    found: list[Signal] = []
    for i, name in enumerate(design.problem.plant.performance):
        unit, scale = _shown(known.get(name, ()))
        found.append(_signal(name, unit, scale, limits.get(name, np.nan), runs[0].z[:, i], runs[1].z[:, i]))
    # Outputs of the same course (gaps of one stiff bogie) are shown once.
    distinct: list[Signal] = []
    alike: list[int] = []
    for one in found:
        place = next((k for k, other in enumerate(distinct) if _same(one, other)), None)
        if place is None:
            distinct.append(one)
            alike.append(0)
        else:
            alike[place] += 1
    return [replace(one, name=f"{one.name} (+{more} alike)" if more else one.name)
            for one, more in zip(distinct, alike, strict=True)]  # fmt: skip


def _same(one: Signal, other: Signal) -> bool:
    return bool(np.allclose(one.predicted, other.predicted, rtol=1e-9, atol=1e-12))


def _commands(design: PredictiveDesign, runs: tuple[PredictiveRun, PredictiveRun]) -> list[Signal]:
    return [
        _signal(name, "kN", 1e-3, float(design.problem.command_upper[i]), runs[0].u[:, i], runs[1].u[:, i])
        for i, name in enumerate(design.problem.plant.commands)
    ]


def _signal(name: str, unit: str, scale: float, limit: float, predicted: FloatArray, saturated: FloatArray) -> Signal:
    return Signal(name, unit, scale, limit if np.isfinite(limit) else np.nan,
                  read_only(predicted, name="predicted"), read_only(saturated, name="saturated"))  # fmt: skip


def _shown(dimensions: Dimensions) -> tuple[str, float]:
    for unit, shown, scale in _DISPLAY:
        if dimensions and dimensions_of(unit) == dimensions:
            return shown, scale
    return ("deg", 180.0 / np.pi) if not dimensions else ("SI", 1.0)
