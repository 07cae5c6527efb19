"""Worst cases, the nonlinear check and sensitivity peaks on the page, and all new records in report.json."""

from __future__ import annotations

import json
import math
from dataclasses import fields, replace
from pathlib import Path
from typing import Any, get_type_hints

import comparison_fixture as made
import numpy as np
import pytest
from test_report_document import _faults

from maglev_ctrl.analysis.loops import Loop
from maglev_ctrl.analysis.margin_sites import margin_sites
from maglev_ctrl.analysis.margins import loop_margins
from maglev_ctrl.analysis.response import records as response_records
from maglev_ctrl.analysis.robustness import records as robustness_records
from maglev_ctrl.arrays import FloatArray
from maglev_ctrl.errors import Verdict
from maglev_ctrl.report import write
from maglev_ctrl.report.charts_margins import disk_value
from maglev_ctrl.report.content_margin_sites import common_delay_words, margin_site_blocks
from maglev_ctrl.report.content_margins import margin_blocks, zone
from maglev_ctrl.report.content_nonlinear import nonlinear_blocks
from maglev_ctrl.report.content_option import option_section
from maglev_ctrl.report.content_robustness import factor_words, robustness_blocks
from maglev_ctrl.report.model import Banner, Block, FigureBlock, Paragraph, Table
from maglev_ctrl.report.schema import SCHEMA
from maglev_ctrl.report.serialise import UNITS, to_json
from maglev_ctrl.study import ride_records
from maglev_ctrl.study.nonlinear import records as nonlinear_records
from maglev_ctrl.study.records import OptionStudy
from maglev_ctrl.study.tuning import records as tuning_records
from maglev_ctrl.systems import Controller, SecondOrderSystem
from maglev_ctrl.vehicle import Actuator


def option(**parts: Any) -> OptionStudy:
    return replace(made.plain_option("lqr", "LQR", "active_secondary"), **parts)


def texts(blocks: list[Block], start: str) -> list[list[str]]:
    table = next(b for b in blocks if isinstance(b, Table) and b.caption.startswith(start))
    return [[entry.text for entry in cells] for cells in table.rows]


def test_guaranteed_and_found_factor_are_both_told() -> None:
    told = factor_words(made.worst_case().factor)
    assert "Guaranteed factor 2.600" in told and "Found factor 2.704" in told and "1.31 Hz" in told
    assert "The two agree." in told
    apart = factor_words(made.worst_case(stable=Verdict.NOT_EVALUATED).factor)
    assert "only the guaranteed one may be relied on" in apart and "The two agree." not in apart
    none = replace(made.worst_case().factor, found=math.inf)
    assert "No unstable combination was found up to a factor of 5.00" in factor_words(none)
    assert "agree" not in factor_words(none)


@pytest.mark.parametrize("verdict", list(Verdict))
def test_the_verdict_stands_on_top(verdict: Verdict) -> None:
    first = robustness_blocks(option(robustness=made.worst_case(stable=verdict)))[0]
    assert isinstance(first, Banner) and first.verdict is verdict
    assert ("proven" in first.text) is (verdict is Verdict.PASS)


def test_spreads_and_changes_in_per_cent_the_widest_first() -> None:
    found = made.worst_case()
    told = texts(robustness_blocks(option(robustness=found)), "Uncertain parameters")
    assert told[0] == ["cylinder_front.delay", "± 20.0 %", "+20.0 %", "+20.0 %", "+20.0 %", "+54.1 %"]
    assert told[2][0] == "secondary_front.stiffness" and told[2][2] == "\N{MINUS SIGN}10.0 %"
    values = texts(robustness_blocks(option(robustness=found)), "Worst values")
    assert values[1][:4] == ["Least damping ratio (%)", "11.0", "5.40", "1.20 Hz"]


def test_what_was_not_computed_is_not_told_as_zero() -> None:
    found = made.worst_case()
    nothing = replace(found.disk, nominal=math.nan, value=math.nan, changes=np.zeros(0), percent=np.zeros(0),
                      verified=False, reason="there is no loop to break")  # fmt: skip
    told = robustness_blocks(option(robustness=replace(found, disk=nothing)))
    assert texts(told, "Worst values")[2][2] == "\N{EN DASH}" == texts(told, "Uncertain")[0][4]
    assert robustness_blocks(option()) == []
    (why,) = robustness_blocks(option(robustness_reason="the loop is not stable"))
    assert isinstance(why, Paragraph) and "not stable" in why.text


def test_disagreement_and_contact_cannot_be_overlooked() -> None:
    banners = [b for b in nonlinear_blocks(option(nonlinear=made.nonlinear(contact=True))) if isinstance(b, Banner)]
    assert [b.verdict for b in banners] == [Verdict.FAIL, Verdict.NOT_EVALUATED, Verdict.NOT_EVALUATED]
    assert "Contact in 1 of 8 runs" in banners[0].text and "gap of magnet_front_0" in banners[2].text
    calm = nonlinear_blocks(option(nonlinear=made.nonlinear()))
    assert not any(isinstance(b, Banner) for b in calm)
    assert nonlinear_blocks(option()) == []


def test_linear_and_nonlinear_stand_side_by_side() -> None:
    told = nonlinear_blocks(option(nonlinear=made.nonlinear(contact=True)))
    assert texts(told, "Linear theory")[0] == [
        "standard deviation of the gap of magnet_front_0", "28.0 mm", "34.1 mm", "31.2 to 37.7", "UNRESOLVED",
    ]  # fmt: skip
    events = texts(told, "What ended runs")
    assert events[0][:5] == ["7.31 s", "3", "contact", "magnet_front_3", "0.420 m/s"]
    assert events[1][4] == "\N{EN DASH}"
    assert texts(told, "Region of attraction")[1] == ["car heave", "0.0500", "5 of 8"]
    said = " ".join(b.text for b in told if isinstance(b, Paragraph))
    assert "cylinder_front 3.1 %; 1 never" in said and "limit cycle of 3.1 mm" in said
    chart = next(b.chart for b in told if isinstance(b, FigureBlock))
    assert [panel.y.label for panel in chart.panels] == ["mm", "m/s²", "kN"]


def test_force_limits_are_told_to_count_where_they_do() -> None:
    body = made.plain_option("a", "a", "baseline").vehicle.bodies[0].name
    limited = Actuator("push", body, to="guideway", position=(0.0, 0.0, 0.0), force_limit=60e3)
    vehicle = made.plain_option("a", "a", "baseline").vehicle.with_elements(actuators=(limited,))

    def said(study: OptionStudy) -> str:
        blocks = option_section(made.small(), study, 0)[0].blocks
        return " ".join(item for b in blocks if hasattr(b, "items") for item in b.items)

    assert "nothing else checks them" in said(option(vehicle=vehicle))
    both = said(option(vehicle=vehicle, ride=made.ride(), nonlinear=made.nonlinear()))
    assert "3 \N{GREEK SMALL LETTER SIGMA} of the force is compared" in both and "the nonlinear check enforces" in both


def test_sensitivity_peaks_have_their_zone() -> None:
    margins = loop_margins(Loop.from_transfer_function([25.0], [1.0, 10.0, 10.0, 10.0]))
    peak = margins.channels[0].sensitivity_peak
    (cells,) = texts(margin_blocks(margins, "LQR"), "Sensitivity peaks")
    assert cells[1] == f"{peak:.2f}" and cells[4] == zone(peak)
    assert [zone(value) for value in (2.99, 3.0, 4.0, 5.0)] == ["A", "B", "C", "D"]
    low = loop_margins(Loop.from_transfer_function([2.0], [1.0, 10.0, 10.0, 10.0]))  # the mutant: another loop
    assert texts(margin_blocks(low, "LQR"), "Sensitivity peaks")[0][1] != cells[1]


def test_margins_by_site_and_skew_with_their_replays() -> None:
    plant = SecondOrderSystem.from_matrices([[1.0]], [[0.2]], [[4.0]], inputs=("force",), B=[[1.0]])
    law = Controller.static([[-1.0]], measured=("q1.velocity",), commands=("force",))
    sites = margin_sites(plant, law)
    told = margin_site_blocks(sites, "LQR")
    rows = texts(told, "Disk margins")
    assert [cells[0].split()[0] for cells in rows] == ["inputs", "outputs", "inputs"]
    assert rows[2][2] == f"{disk_value(sites.both.skewed[1]):.3g}".ljust(5, "0")[:5]
    assert rows[2][2] != rows[0][2]  # the mutant: one site told for another
    assert rows[0][-1] == "A"
    assert any("in all channels" in b.text or "common to all" in b.text for b in told if isinstance(b, Paragraph))
    late = replace(
        sites.common_delay, delay=0.012, frequency=12.0, pole_distance=1e-9, agreement=made.AGREED, reason=""
    )
    assert "up to 12.0 ms" in common_delay_words(late) and "1.91 Hz" in common_delay_words(late)
    assert "UNRESOLVED" in common_delay_words(replace(late, agreement=made.UNRESOLVED, reason="two answers"))


PURE = {  # numbers without a unit, or told in the unit that another field of the record names
    "MaskResult.ratio", "MaskResult.worst", "SpanPassing.check", "FlexibleSpan.speed_ratio",
    "SignalStatistics.deviation", "SignalStatistics.by_lyapunov", "SignalStatistics.by_frequency",
    "SignalStatistics.rate", "SignalStatistics.difference", "ClearanceStatistics.used",
    "ClearanceStatistics.contact_per_hour", "ActuatorDemand.three_sigma_share", "ActuatorDemand.saturated",
    "RideResponse.largest_difference", "FactorBounds.proven", "FactorBounds.found", "FactorBounds.changes",
    "FactorBounds.pole_distance", "FactorBounds.limit", "WorstPoint.nominal", "WorstPoint.value", "WorstPoint.changes",
    "WorstCase.spreads", "NonlinearStudy.step_error", "Compared.linear", "Compared.nonlinear", "Compared.low",
    "Compared.high", "SimulatedSignal.values", "ObjectiveAxis.scale", "TunedVariable.scale", "TunedOption.violation",
    "RankedOption.distance", "RankingShift.factor",
}  # fmt: skip
NOT_TOLD = {"StabilityRange", "PsdMask"}  # parts of no option


def test_every_number_of_the_new_records_has_a_unit_or_none_by_choice() -> None:
    unknown = []
    modules = (response_records, robustness_records, ride_records, nonlinear_records, tuning_records)
    for module in modules:
        for name, record in vars(module).items():
            if not isinstance(record, type) or record.__module__ != module.__name__ or name in NOT_TOLD:
                continue
            hints = get_type_hints(record)
            for field in fields(record):
                key = f"{name}.{field.name}"
                if hints[field.name] in (float, FloatArray) and key not in UNITS and key not in PURE:
                    unknown.append(key)
    assert unknown == []


def test_json_obeys_its_schema_and_a_broken_one_does_not() -> None:
    data = json.loads(to_json(made.small()))
    assert _faults(SCHEMA, data) == []
    assert data["options"][2]["ride"]["points"][0]["response"]["clearances"][0]["three_sigma"]["unit"] == "m"
    assert data["options"][2]["robustness"]["growth"]["unit"] == "1/s"
    assert data["options"][0]["nonlinear"]["compared"][0]["linear"] == {"value": 28.0, "unit": "mm"}
    assert data["tuning"]["options"][1]["variables"][0]["upper"] == {"value": 5e4, "unit": "SI"}
    assert data["options"][2]["requirements"][-1]["hard"] is False
    data["tuning"]["options"][0]["feasible"] = "no"
    data["options"][2]["ride"]["points"][0]["response"]["passengers"][0]["agreement"] = "MAYBE"
    del data["options"][2]["robustness"]["factor"]["found"]
    assert len(_faults(SCHEMA, data)) == 3


def test_a_file_of_an_earlier_version_still_obeys() -> None:
    data = json.loads(to_json(made.small()))
    del data["tuning"]
    for one in data["options"]:
        for part in ("ride", "robustness", "nonlinear"):
            del one[part], one[f"{part}_reason"]
        for result in one["requirements"]:
            del result["hard"]
    assert _faults(SCHEMA, data) == []


def test_everything_is_written(tmp_path: Path) -> None:
    paths = write(made.small(), tmp_path / "out")
    text = paths[0].read_text(encoding="utf-8")
    assert all(
        f'data-chart="{key}"' in text for key in ("comparison-ride", "tuning-fronts", "lqr-spectra", "bare-traces")
    )
    assert paths[1].read_bytes().startswith(b"%PDF-1.7")
