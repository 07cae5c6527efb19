"""Ride, gaps and actuators of one option, in reading order."""

from __future__ import annotations

from maglev_ctrl.analysis.response.records import RideResponse
from maglev_ctrl.errors import Agreement, Verdict
from maglev_ctrl.report.chart import Chart
from maglev_ctrl.report.model import Banner, Block, Bullets, FigureBlock, Paragraph
from maglev_ctrl.report.ride.charts import acceleration_spectra, along_the_car, girder_passing, over_speed
from maglev_ctrl.report.ride.summary import unresolved
from maglev_ctrl.report.ride.tables import (
    actuator_table,
    clearance_table,
    passenger_table,
    point_table,
    single_passings,
    worst_speed_words,
)
from maglev_ctrl.report.style import number
from maglev_ctrl.study.records import OptionStudy
from maglev_ctrl.study.ride_records import RideStudy


def ride_blocks(option: OptionStudy, *, design_speed: float) -> list[Block]:
    """All about the ride of one option; nothing where the scenario asks for none."""
    study = option.ride
    if study is None:
        return [Paragraph(f"The ride was not evaluated: {option.ride_reason}")] if option.ride_reason else []
    blocks: list[Block] = (
        [Paragraph(f"Irregularity of the guideway: {study.spectrum.rstrip('.')}.")] if study.spectrum else []
    )
    if study.points:
        point = study.points[0]
        if point.response is None:
            blocks.append(Banner(Verdict.NOT_EVALUATED, f"No ride at {point.where}: {point.reason}"))
        else:
            blocks += _response_blocks(option, study, point.response)
    blocks += _charts(over_speed(option, study, design_speed=design_speed))
    table = point_table(study, option.label)
    blocks += [] if table is None else [table]
    if study.passing is not None:
        blocks.append(Paragraph(worst_speed_words(study.passing)))
        blocks += _charts(girder_passing(option, study.passing, design_speed=design_speed))
    single = single_passings(study, option.label)
    return [*blocks, single] if single is not None else blocks


def _response_blocks(option: OptionStudy, study: RideStudy, response: RideResponse) -> list[Block]:
    blocks: list[Block] = [agreement_block(response)]
    if response.passengers:
        blocks.append(passenger_table(response, option.label))
        blocks += _charts(along_the_car(option, response))
    blocks += _charts(acceleration_spectra(option, study, response))
    if response.clearances:
        blocks.append(clearance_table(response, option.label))
    if response.actuators:
        blocks.append(actuator_table(response, option.label))
    open_questions = unresolved(study)
    return [*blocks, Bullets(open_questions)] if open_questions else blocks


def agreement_block(response: RideResponse) -> Block:
    """Whether the exact covariance and the integral over frequency tell the same."""
    largest = f"largest relative difference {number(response.largest_difference, digits=2)}"
    both = "covariance (Lyapunov) equations and the adaptive integral over frequency"
    if response.agreement is Agreement.AGREED:
        return Paragraph(f"All numbers by two methods that agree, {both}: {largest}.")
    why = f": {response.reason}" if response.reason else ""
    return Banner(Verdict.NOT_EVALUATED, f"UNRESOLVED: {both} do not agree everywhere ({largest}){why}")


def _charts(chart: Chart | None) -> list[Block]:
    return [] if chart is None else [FigureBlock(chart)]
