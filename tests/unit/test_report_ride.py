"""Ride, gaps and actuators on the page: every number with its place, nothing unknown told as known."""

from __future__ import annotations

import math
from dataclasses import replace

import comparison_fixture as made
import numpy as np
import pytest
from matplotlib.lines import Line2D

from maglev_ctrl.errors import Verdict
from maglev_ctrl.report.chart import Axis, Chart, Line, Marks, Note, Panel, Rule, Span
from maglev_ctrl.report.comparison.ride_chart import ride_side_by_side
from maglev_ctrl.report.content import report_model
from maglev_ctrl.report.draw import draw
from maglev_ctrl.report.findings import key_findings, leading_option, tightest
from maglev_ctrl.report.interactive import interactive
from maglev_ctrl.report.model import Banner, Block, Bullets, FigureBlock, Paragraph, Table
from maglev_ctrl.report.ride import ride_blocks
from maglev_ctrl.report.ride.charts import acceleration_spectra, along_the_car, mask_words, nearest_masks, over_speed
from maglev_ctrl.report.ride.summary import supplied_power, worst_numbers, worst_passenger
from maglev_ctrl.report.ride.tables import (
    actuator_table,
    clearance_table,
    passenger_table,
    point_table,
    worst_speed_words,
)
from maglev_ctrl.report.values import judged_cell, reason_words
from maglev_ctrl.study.records import OptionStudy


def option(**parts: object) -> OptionStudy:
    return replace(made.plain_option("lqr", "LQR", "active_secondary"), **parts)  # type: ignore[arg-type]


def blocks(study: OptionStudy) -> list[Block]:
    return ride_blocks(study, design_speed=made.SPEED)


def texts(table: Table) -> list[list[str]]:
    return [[entry.text for entry in cells] for cells in table.rows]


def test_nothing_asked_nothing_told() -> None:
    assert blocks(option()) == []
    (why,) = blocks(option(ride_reason="the loop is not stable"))
    assert isinstance(why, Paragraph) and "the loop is not stable" in why.text


def test_passengers_stand_front_to_rear_with_their_class() -> None:
    told = texts(passenger_table(made.response(level=1.3), "LQR"))
    assert [cells[0] for cells in told] == [name for name, _ in made.PLACES]
    assert told[0][1:5] == ["12.0 m", "0.468", "0.175", "0.500"]
    assert told[0][5] == "a little uncomfortable"


def test_an_unknown_passenger_may_be_the_worst() -> None:
    found = made.response(open_point=True)
    assert worst_passenger(found) is None
    assert all(math.isnan(v) for v in worst_numbers(found)[:1])
    known = worst_passenger(made.response())
    assert known is not None and known.name == "front row"
    mutant = max((p for p in found.passengers if math.isfinite(p.total)), key=lambda p: p.total)  # the unknown left out
    assert mutant.name == "front row"
    told = blocks(option(ride=made.ride(open_point=True)))
    assert any(isinstance(b, Banner) and b.verdict is Verdict.NOT_EVALUATED and "UNRESOLVED" in b.text for b in told)
    assert any(isinstance(b, Bullets) and "rear row: the two methods differ" in b.items[0] for b in told)
    assert not any(isinstance(b, Banner) for b in blocks(option(ride=made.ride())))


def test_agreement_is_told_as_a_number() -> None:
    told = [b.text for b in blocks(option(ride=made.ride())) if isinstance(b, Paragraph)]
    assert any("two methods that agree" in text and "2.1e\N{MINUS SIGN}8" in text for text in told)


def test_clearances_in_millimetres_the_tightest_first() -> None:
    told = texts(clearance_table(made.response(level=2.2), "LQR"))
    assert told[0] == [
        "secondary_front", "stroke", "0 mm", "80.0 mm", "0 mm", "79.2 mm", "99.0 %", "44 1/h", "1.0",
    ]  # fmt: skip
    used = [float(cells[6].split()[0]) for cells in told]
    assert used == sorted(used, reverse=True) and len(told) == 12
    assert texts(clearance_table(made.response(level=0.5), "LQR"))[0][8].startswith("< 1e")


def test_an_unknown_clearance_is_not_hidden_behind_the_tightest() -> None:
    found = made.response()
    lost = replace(found.clearances[3], used=math.nan, reason="the two methods differ")
    told = texts(clearance_table(replace(found, clearances=(*found.clearances, lost)), "LQR"))
    assert told[0][0] == lost.name and told[0][6] == "\N{EN DASH}"


def test_actuators_add_up() -> None:
    found = made.response()
    table = actuator_table(found, "LQR")
    told = texts(table)
    assert told[-1][0] == "All together" and told[-1][8] == "900 W" == f"{supplied_power(found):.0f} W"
    assert told[0][1:4] == ["9.00 kN", "27.0 kN", "60.0 kN"]
    assert told[0][7] == "\N{MINUS SIGN}90.0 W"
    assert math.isnan(supplied_power(made.response(active=False)))


def test_points_without_an_answer_come_first() -> None:
    table = point_table(made.ride(), "LQR")
    assert table is not None
    assert texts(table)[0] == ["550 km/h, payload 0 t", *["\N{EN DASH}"] * 4, "the loop is not stable there"]
    assert point_table(replace(made.ride(), points=made.ride().points[:1]), "LQR") is None


def test_comfort_classes_overlap_as_in_the_standard() -> None:
    chart = along_the_car(option(), made.response(level=2.2))
    assert chart is not None
    items = chart.panels[0].items
    bands = [(band.start, band.stop) for band in items if isinstance(band, Span)]
    assert bands[:2] == [(0.315, 0.63), (0.5, 1.0)]
    names = [note.text for note in items if isinstance(note, Note)]
    assert names[:2] == ["not uncomfortable", "a little uncomfortable"]
    total = next(mark for mark in items if isinstance(mark, Marks) and mark.label == "total")
    assert float(np.max(total.y)) == pytest.approx(2.2 * 1.5 * math.hypot(0.24, 0.09))


def test_spectra_are_logarithmic_with_the_mask_over_them() -> None:
    study = made.ride(level=2.2)
    response = study.points[0].response
    assert response is not None
    chart = acceleration_spectra(option(), study, response)
    assert chart is not None and [panel.title for panel in chart.panels] == ["vertical", "lateral"]
    panel = chart.panels[0]
    assert panel.x.log and panel.y.log
    mask = next(item for item in panel.items if isinstance(item, Line) and item.label == "mask")
    assert mask.y[1] == pytest.approx(0.1)
    worst = next(item for item in panel.items if isinstance(item, Marks))
    curve = next(s for s in response.spectra if (s.passenger, s.axis) == ("front row", "vertical"))
    there = float(np.interp(worst.x[0], curve.frequency, curve.density))
    assert float(worst.y[0]) == pytest.approx(there, rel=1e-9)
    mutant = worst.y[0] / study.masks[0].ratio  # the mask's own height
    assert mutant != pytest.approx(there, rel=0.1)
    assert "exceeds the mask" in mask_words(study.masks[0])
    assert "stays below" in mask_words(replace(study.masks[0], ratio=0.4))


def test_of_every_mask_the_nearest_passenger_is_told() -> None:
    first, second = made.ride().masks
    calmer = replace(first, passenger="centre", ratio=0.5 * first.ratio)
    assert [m.passenger for m in nearest_masks((calmer, first, second))] == ["front row", "rear row"]
    lost = replace(first, passenger="centre", ratio=math.nan)
    assert [m.passenger for m in nearest_masks((first, lost))] == ["centre"]  # the unknown may be the worst
    assert [m.passenger for m in nearest_masks((lost, first))] == ["centre"]


def test_girders_without_an_answer_say_why() -> None:
    passing = made.ride().passing
    assert passing is not None
    lost = replace(passing, worst_speed=math.nan, gap=np.zeros(0), reason="the loop is not stable")
    assert worst_speed_words(lost) == "Girder passing was not evaluated: the loop is not stable."
    doubted = worst_speed_words(replace(passing, reason="not at every speed: 540 km/h: not stable"))
    assert "144 km/h" in doubted and doubted.endswith("Not at every speed: 540 km/h: not stable.")


def test_curves_over_speed_by_payload_and_gaps_where_unknown() -> None:
    study = made.ride()
    chart = over_speed(option(), study, design_speed=made.SPEED)
    assert chart is not None
    lines = [item for item in chart.panels[0].items if isinstance(item, Line)]
    assert [line.label for line in lines] == ["payload 0 t", "payload 20.0 t"]
    assert math.isnan(lines[0].y[-1]) and np.isfinite(lines[1].y).all()
    assert len(lines[1].x) == 10  # the design point is one of them
    assert over_speed(option(), replace(study, points=study.points[:1]), design_speed=made.SPEED) is None


def test_worst_speed_of_girders_is_named() -> None:
    told = blocks(option(ride=made.ride()))
    words = next(b.text for b in told if isinstance(b, Paragraph) and "Girders of" in b.text)
    assert "144 km/h" in words and "meet the mode of 1.6 Hz" in words
    chart = next(b.chart for b in told if isinstance(b, FigureBlock) and b.chart.key == "lqr-girders")
    rule = next(item for item in chart.panels[0].items if isinstance(item, Rule) and item.label == "worst speed")
    gap = next(item for item in chart.panels[0].items if isinstance(item, Line))
    assert abs(rule.value - float(gap.x[int(np.argmax(gap.y))])) < 5.0


def test_options_side_by_side_say_why_a_bar_is_missing() -> None:
    chart = ride_side_by_side(made.small())
    assert chart is not None and len(chart.panels) == 3  # no option has margins here
    notes = [[n.text for n in panel.items if isinstance(n, Note)] for panel in chart.panels]
    assert notes[0][0] == "not evaluated" and notes[2][:2] == ["no actuators", "no actuators"]
    assert "630 W" in notes[2][2]
    assert ride_side_by_side(replace(made.small(), options=(option(),))) is None


def test_findings_tell_ride_and_what_it_decides() -> None:
    told = " ".join(key_findings(made.small()))
    assert "the worst passenger (front row) feels 0.269 m/s²" in told and "draw 630 W" in told
    assert "Damper windings fails by its ride, gaps or power alone" in told
    assert "1 of 3 options meet all 1 requirements" in told  # the wish is not counted
    assert "Wishes missed, which fails nothing: Active secondary, LQR: little_power." in told
    assert "contact in 1 of 8 runs" in told


def test_a_missed_wish_fails_nothing_and_leads_nowhere() -> None:
    best = leading_option(made.small())
    assert best is not None and best.name == "lqr"
    tight = tightest(best)
    assert tight is not None and tight.name == "ride"
    hard = replace(made.wish(), hard=True)  # the mutant: a wish taken for a requirement
    strict = tightest(replace(best, requirements=(*best.requirements[:-1], hard)))
    assert strict is not None and strict.name == "little_power"
    assert judged_cell(made.wish()).text == "✗ wish" and judged_cell(made.wish()).verdict is None
    assert judged_cell(made.wish(met=True)).verdict is Verdict.PASS
    assert judged_cell(hard).verdict is Verdict.FAIL
    assert "a wish that is missed" in reason_words(made.wish())
    section = next(s for s in report_model(made.small()).sections if s.title == "Option: Active secondary, LQR")
    (banner,) = (b for b in section.blocks if isinstance(b, Banner))
    assert banner.verdict is Verdict.PASS and "Wishes met: 0 of 1." in banner.text


def log_chart(log: bool) -> Chart:
    x = np.array([0.1, 1.0, 10.0])
    line = Line(x, x**2, "square")
    rule = Rule("y", 1.0, "one")
    panel = Panel((line, rule, Note(1.0, 1.0, "here")), Axis("f (Hz)", log=log), Axis("g (1)", log=log))
    return Chart("k", "caption", "alt", (panel,))


def test_a_power_is_straight_on_logarithmic_axes() -> None:
    def points(log: bool) -> int:
        """Points of the curve as drawn: those on the straight line between their neighbours are left out."""
        return max(np.size(artist.get_xdata()) for artist in draw(log_chart(log)).artists if isinstance(artist, Line2D))

    assert points(True) == 2
    assert points(False) == 3  # the mutant: linear axes
    assert "0.1" in [text.get_text() for text in draw(log_chart(True)).texts]
    spec = interactive(log_chart(True))
    assert spec["layout"]["xaxis"]["type"] == "log"
    note = next(a for a in spec["layout"]["annotations"] if a["text"] == "here")
    assert (note["x"], note["y"]) == (0.0, 0.0)  # plotly takes annotations in decades, shapes as they are
    assert spec["layout"]["shapes"][0]["y0"] == 1.0
