"""The recipe for one suspension option, from its elements to its verdicts."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from maglev_ctrl.analysis.margin_sites import MarginSites, margin_sites
from maglev_ctrl.analysis.margins import Margins, loop_margins
from maglev_ctrl.analysis.modes import modes
from maglev_ctrl.analysis.robustness.records import WorstCase
from maglev_ctrl.scenario import OptionRecord, Scenario, describe_option
from maglev_ctrl.study.delays import settled_modes
from maglev_ctrl.study.evidence import Evidence, MarginPoint, SweepCheck
from maglev_ctrl.study.faults import sentence
from maglev_ctrl.study.law import delayed_certificate, designed_option
from maglev_ctrl.study.loops import nyquist_curves, option_loops, root_locus
from maglev_ctrl.study.nonlinear.records import NonlinearStudy
from maglev_ctrl.study.nonlinear.run import nonlinear_study
from maglev_ctrl.study.periodic import floquet_study
from maglev_ctrl.study.records import FloquetStudy, NyquistCurve, OptionStudy, RootLocus, Sweep
from maglev_ctrl.study.requirements import judge, not_evaluated
from maglev_ctrl.study.ride import ride_study
from maglev_ctrl.study.ride_records import RideStudy
from maglev_ctrl.study.robustness import robustness_study
from maglev_ctrl.study.situation import OptionModel, Situation
from maglev_ctrl.study.sweeps import place, sweep, sweep_values, varied, worst_places
from maglev_ctrl.synthesis.design import Design
from maglev_ctrl.systems import Controller

Step = Callable[[str], None]
MARGIN_SWEEPS = ("speed", "payload")
MOST_SENSORS = 6
"""Laws that measure more signals than this are state feedback for all purposes: broken at their commands alone."""


def study_option(scenario: Scenario, option: OptionRecord, *, step: Step = lambda what: None) -> OptionStudy:
    """Everything about one option; what has no answer is recorded with its reason, never dropped.

    Parameters
    ----------
    step : told what is being worked on
    """
    started = time.perf_counter()
    vehicle = OptionModel(scenario, option).vehicle()
    blank = OptionStudy(
        name=option.name, label=option.label or option.name, kind=option.kind,
        summary=describe_option(scenario, option), vehicle=vehicle, failure="", equilibrium=None, system=None,
        open_system=None, modes=None, design=None, sweeps=(), locus=None, margins=None, margins_reason="", nyquist=(),
        floquet=None, floquet_reason="", requirements=(), notes=(), seconds=0.0,
    )  # fmt: skip
    try:
        done = _study(scenario, option, blank, step)
    except Exception as fault:  # whatever it is, the other options go on
        reason = sentence(fault)
        refused = tuple(not_evaluated(requirement, reason) for requirement in scenario.judged)
        done = replace(blank, failure=reason, requirements=refused)
    return replace(done, seconds=time.perf_counter() - started)


def _study(scenario: Scenario, option: OptionRecord, blank: OptionStudy, step: Step) -> OptionStudy:
    point = Situation.of_design(scenario)
    step("equilibrium and control law")
    model, design = designed_option(scenario, option)
    blank = replace(blank, vehicle=model.vehicle())
    _, balanced = model.balance(point)
    controller = design.controller if design else None
    notes = _notes(model, design)
    closed = model.closed_of(blank.vehicle, point, controller)
    found = modes(closed)
    settled, doubt = settled_modes(model, blank.vehicle, point, controller)
    step("sweeps")
    sweeps = tuple(sweep(model, controller, parameter=name, values=values) for name, values in sweep_values(scenario))
    checks: dict[str, tuple[SweepCheck, ...]] = {one.parameter: _checks(model, controller, one) for one in sweeps}
    step("margins")
    margin_points, locus, curves = _margins(model, controller, sweeps)
    sites = _margin_sites(model, controller)
    step("resonance map")
    periodic, periodic_reason = _periodic(model, controller)
    step("ride")
    ride, ride_reason = _ride(model, controller)
    step("worst cases")
    robustness, robustness_reason = _robustness(model, controller)
    nonlinear, nonlinear_reason = _nonlinear(model, controller, step)
    step("requirements")
    evidence = Evidence(
        design=SweepCheck("design point", settled, doubt),
        sweeps={one.parameter: one for one in sweeps},
        sweep_checks=checks,
        margin_points=margin_points,
        has_loops=locus is not None,
        floquet=periodic,
        floquet_reason=periodic_reason,
        design_values=_design_values(model),
        ride=ride,
        ride_reason=ride_reason,
        robustness=robustness,
        robustness_reason=robustness_reason,
    )
    first = margin_points[0] if margin_points else None
    return replace(
        blank,
        equilibrium=balanced,
        system=closed,
        open_system=model.plant(point),
        modes=found,
        design=design,
        sweeps=sweeps,
        locus=locus,
        margins=first.margins if first else None,
        margins_reason=first.reason if first else "the option adds no element and no loop: there is nothing to break",
        nyquist=curves,
        floquet=periodic,
        floquet_reason=periodic_reason,
        requirements=tuple(judge(requirement, evidence) for requirement in scenario.judged),
        notes=notes,
        ride=ride,
        ride_reason=ride_reason if scenario.irregularity is not None else "",
        robustness=robustness,
        robustness_reason=robustness_reason if scenario.uncertainty is not None else "",
        nonlinear=nonlinear,
        nonlinear_reason=nonlinear_reason,
        margin_sites=sites,
    )


def _notes(model: OptionModel, design: Design | None) -> tuple[str, ...]:
    """What the reader must know about the law: its origin, its status, its certificate with delays."""
    chosen = tuple(f"damping chosen by the budget: {name} {value / 1e3:.4g} kN s/m" for name, value in model.dampings)
    if design is None:
        return chosen
    held = delayed_certificate(model, design)
    verdict = f"with actuator delays the certificate does not hold: {held}" if held else ""
    return tuple(note for note in (*chosen, *design.notes, verdict) if note)


def _checks(model: OptionModel, controller: Controller | None, one: Sweep) -> tuple[SweepCheck, ...]:
    """The places of largest growth and of least damping, also between sweep points, examined by further methods."""
    design = Situation.of_design(model.scenario)
    found: list[SweepCheck] = []
    for value in worst_places(model, controller, one):
        situation = varied(design, one.parameter, value)
        settled, doubt = settled_modes(model, model.vehicle(situation.payload), situation, controller)
        found.append(SweepCheck(place(one, value), settled, doubt))
    return tuple(found)


def _margins(
    model: OptionModel, controller: Controller | None, sweeps: tuple[Sweep, ...]
) -> tuple[tuple[MarginPoint, ...], RootLocus | None, tuple[NyquistCurve, ...]]:
    """Margins at the design point first, then at the ends and at the least damped point of speed and payload sweeps."""
    design = Situation.of_design(model.scenario)
    loops = option_loops(model, design, controller)
    if loops is None:
        return (), None, ()
    points = [_margin_point("design point", model, controller, design)]
    for one in sweeps:
        if one.parameter in MARGIN_SWEEPS:
            for value in _margin_values(one, _design_values(model)[one.parameter]):
                situation = varied(design, one.parameter, value)
                points.append(_margin_point(place(one, value), model, controller, situation))
    return tuple(points), root_locus(loops), nyquist_curves(loops.loop())


def _margin_values(one: Sweep, design: float) -> list[float]:
    """The ends of what a sweep could evaluate and its least damped point; the design point has its own entry."""
    known = np.flatnonzero(np.isfinite(one.abscissa))
    if not known.size:
        return []
    values = {float(one.values[known[0]]), float(one.values[known[-1]])}
    if np.any(np.isfinite(one.least_damping)):
        values.add(float(one.values[int(np.nanargmin(one.least_damping))]))
    return sorted(values - {design})


def _margin_point(where: str, model: OptionModel, controller: Controller | None, situation: Situation) -> MarginPoint:
    try:
        loops = option_loops(model, situation, controller)
        found: Margins | None = loop_margins(loops.loop()) if loops else None
    except Exception as fault:
        return MarginPoint(where, None, sentence(fault))
    return MarginPoint(where, found, "")


def _periodic(model: OptionModel, controller: Controller | None) -> tuple[FloquetStudy | None, str]:
    if model.scenario.periodic is None:
        return None, "the scenario describes no periodic forcing"
    try:
        return floquet_study(model, controller), ""
    except Exception as fault:
        return None, sentence(fault)


def _ride(model: OptionModel, controller: Controller | None) -> tuple[RideStudy | None, str]:
    if model.scenario.irregularity is None:
        return None, "the scenario describes no irregularity of the guideway"
    try:
        return ride_study(model, controller), ""
    except Exception as fault:
        return None, sentence(fault)


def _robustness(model: OptionModel, controller: Controller | None) -> tuple[WorstCase | None, str]:
    if model.scenario.uncertainty is None:
        return None, "the scenario describes no uncertainty"
    try:
        return robustness_study(model, controller), ""
    except Exception as fault:
        return None, sentence(fault)


def _nonlinear(model: OptionModel, controller: Controller | None, step: Step) -> tuple[NonlinearStudy | None, str]:
    request = model.scenario.simulation
    if request is None:
        return None, ""
    try:
        study, _ = nonlinear_study(model, controller, request, step=lambda what: step(f"simulation: {what}"))
    except Exception as fault:
        return None, sentence(fault)
    return study, ""


def _margin_sites(model: OptionModel, controller: Controller | None) -> MarginSites | None:
    """Margins at commands, sensors and both; a law that measures every state has no sensors to break."""
    if controller is None or len(controller.measured) > MOST_SENSORS:
        return None
    design = Situation.of_design(model.scenario)
    law = model.law_at(design, controller)
    try:
        return None if law is None else margin_sites(model.plant(design), law)
    except Exception as fault:
        sentence(fault)  # a warning made an error passes
        return None  # the margins at the commands say why


def _design_values(model: OptionModel) -> dict[str, float]:
    """The design point's own value of every parameter that can be swept."""
    operating = model.scenario.operating
    values = {
        "speed": operating.speed,
        "height": operating.height,
        "lateral_offset": operating.lateral_offset,
        "payload": model.scenario.vehicle.car.payload,
    }
    return values if operating.gap is None else {**values, "gap": operating.gap}
