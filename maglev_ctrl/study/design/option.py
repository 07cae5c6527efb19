"""The recipe for one option's law, from its record to its proved, sampled and documented design."""

from __future__ import annotations

import time
from dataclasses import replace

from maglev_ctrl.errors import ModelError, Status
from maglev_ctrl.scenario import OptionRecord, Scenario, control_law, describe_option
from maglev_ctrl.scenario.control_schema import DISTURBED, Predictive, Scheduled
from maglev_ctrl.study.design.budgeted import Step, budgeted, design_margins
from maglev_ctrl.study.design.document import design_document
from maglev_ctrl.study.design.evaluate import corner_poles, disturbance_levels, gain_curve, sampled_law
from maglev_ctrl.study.design.make import MadeLaw, make_law
from maglev_ctrl.study.design.predictive import predictive_study
from maglev_ctrl.study.design.records import LawStudy, Level, PredictiveStudy
from maglev_ctrl.study.design.signals import signal_units
from maglev_ctrl.study.faults import sentence, status_of
from maglev_ctrl.study.law import delayed_certificate
from maglev_ctrl.study.situation import OptionModel
from maglev_ctrl.synthesis.result import Synthesis


def study_law(scenario: Scenario, option: OptionRecord, *, step: Step | None = None) -> LawStudy:
    """Everything about one option's law; what has no answer is recorded with its reason, never dropped.

    Parameters
    ----------
    step : told what is being done
    """
    tell = step or (lambda words: None)
    started = time.perf_counter()
    blank = lost_law(scenario, option, "")
    try:
        if option.control is None:
            done = budgeted(scenario, option, blank, step=tell)
        else:
            done = _controlled(scenario, option, blank, tell)
        done = replace(done, document=design_document(scenario, done))
    except Exception as fault:  # whatever it is, the other options go on
        done = replace(blank, failure=sentence(fault), status=status_of(fault))
    return replace(done, seconds=time.perf_counter() - started)


def lost_law(scenario: Scenario, option: OptionRecord, reason: str) -> LawStudy:
    """The record of an option whose law does not exist, for a reason."""
    summary = describe_option(scenario, option)
    return LawStudy(
        name=option.name, label=option.label or option.name, kind=option.kind, summary=summary,
        law=summary[-1] if option.control is not None else "passive dampers of least cost", failure=reason,
        status=Status.NUMERICAL_ERROR, design=None, synthesis=None, corners=(), region=None, gain=None, levels=(),
        margins=None, margins_reason="", delays="", sampled=None, schedule=None, asked="",
        budget=None, chosen=float("nan"), predictive=None, document=None,
        notes=(), seconds=0.0,
    )  # fmt: skip


def _controlled(scenario: Scenario, option: OptionRecord, blank: LawStudy, tell: Step) -> LawStudy:
    model = OptionModel(scenario, option)
    tell("designing")
    made = make_law(scenario, option, model)
    if made is None:
        raise ModelError("the option has no control law")
    design = made.design
    if design.schedule is not None:
        model = replace(model, schedule=design.schedule)
    tell("poles, gains and margins")
    margins, reason = design_margins(model, design.controller)
    synthesis = design.synthesis
    assert option.control is not None
    period = option.control.sampling_period
    return replace(
        blank,
        status=design.status,
        design=design,
        synthesis=synthesis,
        corners=corner_poles(model, made.corners, design),
        region=made.region,
        gain=gain_curve(synthesis) if synthesis is not None and isinstance(option.control, DISTURBED) else None,
        levels=_levels(scenario, option, synthesis),
        margins=margins,
        margins_reason=reason,
        delays=delayed_certificate(model, design),
        sampled=None if period is None or synthesis is None else sampled_law(synthesis, period),
        schedule=made.scheduled,
        asked=_asked(option, made),
        predictive=_predicted(scenario, option, made),
        notes=design.notes,
    )  # fmt: skip


def _levels(scenario: Scenario, option: OptionRecord, synthesis: Synthesis | None) -> tuple[Level, ...]:
    """What the law's own disturbance leaves of every weighted output and command."""
    law = control_law(scenario, option)
    if law is None or synthesis is None or not synthesis.controllers or not isinstance(option.control, DISTURBED):
        return ()
    allowed = dict((*law.output_weights, *law.input_weights))
    units = signal_units(scenario, option, tuple(name for name, _ in law.output_weights), law.actuators)
    return disturbance_levels(synthesis, allowed, units)


def _predicted(scenario: Scenario, option: OptionRecord, made: MadeLaw) -> PredictiveStudy | None:
    if made.predictive is None or not isinstance(option.control, Predictive):
        return None
    return predictive_study(scenario, option, option.control, made.predictive)


def _asked(option: OptionRecord, made: MadeLaw) -> str:
    """How fast the parameter changes at most, against what the proof allows."""
    record = option.control
    if not isinstance(record, Scheduled) or record.fastest_change is None or made.scheduled is None:
        return ""
    wanted, limit = record.fastest_change, made.scheduled.rate_limit
    if limit >= wanted.value:
        return f"Asked for: {record.over} changes by {wanted.text} at most; the proof allows it."
    return f"Asked for: {record.over} changes by {wanted.text} at most; the proof does not allow it."
