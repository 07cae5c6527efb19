"""The map report: nothing unstable or undecided gets lost on the way to page, picture and files."""

from __future__ import annotations

import csv
import io
import json
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from map_fixture import FILES, flat_plane, map_study, marked, on

from maglev_ctrl.analysis.first_instability import PeriodicMargin
from maglev_ctrl.analysis.plane_records import NO_ANSWER, UNRESOLVED, UNSTABLE
from maglev_ctrl.analysis.resonance import NO_RESONANCE
from maglev_ctrl.analysis.tongue_atlas import SpeedRange
from maglev_ctrl.errors import Agreement
from maglev_ctrl.report.chart import Chart, Marks
from maglev_ctrl.report.charts_periodic import short_words
from maglev_ctrl.report.map import write_map
from maglev_ctrl.report.map.chart import map_chart, share_words
from maglev_ctrl.report.map.content import comparison_table, map_model, speed_unit
from maglev_ctrl.report.map.data import json_text, ranges_csv, to_dataset
from maglev_ctrl.report.map.tables import (
    LOST_ITSELF,
    bracket_words,
    cure_table,
    difference_words,
    margin_table,
    place_table,
    removal_words,
)
from maglev_ctrl.report.map.words import (
    absent_words,
    critical_depth_words,
    margin_words,
    percent,
    span_words,
    worst_tongue,
)
from maglev_ctrl.report.model import FigureBlock, Report, Table
from maglev_ctrl.report.style import ABSENT, MINUS
from maglev_ctrl.study.map.records import MapStudy, PeriodicLawStudy


@pytest.fixture(scope="module")
def study() -> MapStudy:
    return map_study()


@pytest.fixture(scope="module")
def written(study: MapStudy, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("map")
    (folder / "mine.txt").write_text("kept")
    assert write_map(study, folder) == tuple(folder / name for name in FILES)
    return folder


def items_of(chart: Chart, kind: type) -> list[Any]:
    return [item for panel in chart.panels for item in panel.items if isinstance(item, kind)]


def tables(report: Report) -> list[Table]:
    return [block for section in report.sections for block in section.blocks if isinstance(block, Table)]


# --- words ------------------------------------------------------------------------------------------------------------


def margin(**changes: Any) -> PeriodicMargin:
    known: dict[str, Any] = {
        "quantity": "depth", "nominal": 0.0, "limit": 1.0, "safe": 0.1234, "unsafe": 0.1236, "bound": "exact",
        "agreement": Agreement.AGREED, "tongue": NO_RESONANCE, "unmodulated": False, "missed_width": 0.01,
        "sought": (), "evaluated": 9, "reason": "",
    }  # fmt: skip
    return PeriodicMargin(**{**known, **changes})


def test_a_margin_is_told_with_what_kind_of_bound_it_is() -> None:
    assert margin_words(margin(), 100.0, "%", digits=4) == "12.34 %"
    assert margin_words(margin(bound="lower", unsafe=np.nan), 100.0, "%") == "≥ 12.3 %"
    assert margin_words(margin(bound="upper"), 100.0, "%") == "≤ 12.4 %"
    down = margin(nominal=1.0, limit=0.1, bound="lower", safe=0.1, unsafe=np.nan)
    assert margin_words(down, 1.0, "") == "≤ 0.100"
    assert margin_words(margin(agreement=Agreement.UNRESOLVED), 100.0, "%") == "UNRESOLVED"


def test_a_bracket_has_the_digits_its_error_leaves() -> None:
    assert bracket_words(margin(), 100.0, "%") == "12.35 ± 0.01 %"
    assert bracket_words(margin(safe=0.12349, unsafe=0.12351), 100.0, "%") == "12.350 ± 0.001 %"
    assert bracket_words(margin(safe=0.12344, unsafe=0.12366), 100.0, "%") == "12.36 ± 0.02 %"
    assert bracket_words(margin(unsafe=np.nan), 100.0, "%") == "stable at 12.34 %"
    assert bracket_words(margin(safe=np.nan, unsafe=np.nan), 100.0, "%") == ABSENT


def test_shares_are_never_rounded_to_all_or_nothing() -> None:
    assert percent(1e-5) != percent(0.0) and percent(1.0 - 1e-5) != percent(1.0)
    plane = marked(flat_plane((100, 100)), (3, 4), UNRESOLVED, 0.0)
    assert "less than 0.1 % UNRESOLVED" in share_words(plane) and "more than 99.9 % stable" in share_words(plane)


def test_ends_of_a_narrow_range_are_told_apart(study: MapStudy) -> None:
    atlas = study.options[0].atlas
    assert atlas is not None
    one = replace(atlas.ranges[0], lower=50.0, upper=50.0002)
    low, _, high = span_words(one, 3.6).partition(" to ")
    assert low != high


def test_the_smallest_depth_is_read_off_the_map(study: MapStudy) -> None:
    plane = flat_plane((11, 6))
    assert critical_depth_words(study, plane) == "none up to 50.0 %"
    lost = marked(plane, (4, slice(3, None)), UNSTABLE, 0.1)
    assert critical_depth_words(study, lost) == "30.0 % at 180 km/h"
    doubt = marked(lost, (7, 2), UNRESOLVED, 0.0)
    assert critical_depth_words(study, doubt) == "UNRESOLVED from 20.0 %; 30.0 % at 180 km/h"
    bare = marked(lost, (slice(9, None), slice(None)), UNSTABLE, 1.0)
    told = critical_depth_words(study, bare)
    assert told == "30.0 % at 180 km/h; unstable without modulation on 18.2 % of the speed axis"
    turned = replace(lost, x=lost.y, y=lost.x, state=lost.state.T)
    swapped = replace(study, x=study.y, y=study.x)
    assert critical_depth_words(swapped, turned) == "30.0 % at 180 km/h"


def test_a_tongue_between_the_points_of_the_map_is_told(study: MapStudy) -> None:
    option = study.options[0]
    here = next(one for one in option.tongues if one.peak_growth > 0.0)
    plane = marked(flat_plane((11, 6)), (4, slice(3, None)), UNSTABLE, 0.1)
    thin = replace(here, computed_centre=52.0, onset=0.05)
    told = critical_depth_words(study, plane, (thin,))
    assert told.startswith("5.00 % at 187 km/h (2 w") and told.endswith("on the map 30.0 % at 180 km/h")
    empty = critical_depth_words(study, flat_plane((11, 6)), (thin,))
    assert empty.startswith("5.00 %") and "on the map none up to 50.0 %" in empty
    assert critical_depth_words(study, plane, (replace(thin, onset=0.35),)) == "30.0 % at 180 km/h"
    one, x, y = on(study, plane)
    (tip,) = [
        mark for mark in items_of(map_chart(replace(one, tongues=(thin,)), plane, x, y), Marks) if "tip" in mark.label
    ]
    assert (tip.x.tolist(), tip.y.tolist()) == ([pytest.approx(187.2)], [pytest.approx(5.0)])
    mass = replace(study.x, quantity="payload", unit="t", label="payload")
    assert critical_depth_words(replace(study, x=mass), plane, (thin,)) == "30.0 % at 180 t"


def test_widths_are_compared_with_their_sign(study: MapStudy) -> None:
    row = next(one for one in study.options[0].tongues if one.computed_half_width > 0.0)
    wide = replace(row, first_order_half_width=1.1 * row.computed_half_width)
    assert difference_words(wide) == "+10.0 %"
    assert difference_words(replace(row, first_order_half_width=0.9 * row.computed_half_width)) == f"{MINUS}10.0 %"
    assert difference_words(replace(row, computed_half_width=np.nan)) == ABSENT
    assert difference_words(replace(row, first_order_half_width=0.0)) == "computed only"


def test_full_widths_stand_in_the_table(study: MapStudy) -> None:
    option = study.options[0]
    found = {cells[0].text: cells for cells in place_table(option, speed_unit(study), "10 %").rows}
    row = next(one for one in option.tongues if one.resonance.name.startswith("2 w1"))
    assert float(found["2 w1"][5].text) == pytest.approx(2.0 * 3.6 * row.computed_half_width, rel=5e-3)
    missing = [cells for cells in found.values() if "no unstable speed" in cells[-1].text]
    assert missing and all(cells[4].text == ABSENT for cells in missing)


def test_an_undecided_cure_is_no_cure(study: MapStudy) -> None:
    cure = next(one.removal for one in study.options[0].tongues if one.removal is not None).equal
    assert removal_words(replace(cure, agreement=Agreement.UNRESOLVED)).startswith("UNRESOLVED")
    assert removal_words(replace(cure, safe=np.inf, unsafe=1.0)) == "not by 1.00"


def test_a_crowded_tongue_says_who_grows_there_too(study: MapStudy) -> None:
    option = study.options[0]
    here = next(one for one in option.tongues if one.removal is not None)
    assert here.removal is not None
    undecided = replace(here.removal.equal, agreement=Agreement.UNRESOLVED)
    crowded = replace(here, removal=replace(here.removal, equal=undecided, crowd=("(w1 + w2)/1 (heave, pitch)",)))
    (cells,) = cure_table(replace(option, tongues=(crowded,))).rows
    assert cells[2].text == "not by its own modes: w1 + w2 grows there too" and cells[4].text == "overlaps w1 + w2"
    (cells,) = cure_table(replace(option, tongues=(here,))).rows
    assert "not by its own modes" not in cells[2].text


def test_a_tongue_without_an_answer_is_not_told_absent(study: MapStudy) -> None:
    option = study.options[0]
    here = next(one for one in option.tongues if one.peak_growth > 0.0)
    gone = replace(here, peak_growth=np.nan, computed_centre=np.nan, computed_half_width=np.nan, removal=None)
    later, never = replace(gone, onset=2.0 * gone.depth), replace(gone, onset=np.inf, reason="none up to depth 0.5")
    open_ = replace(gone, onset=np.nan, reason="the engines do not confirm the onset")
    alone = replace(option, atlas=None)
    assert worst_tongue(replace(alone, tongues=(later, never))) == "none at this depth"
    assert worst_tongue(replace(alone, tongues=(later, open_))).startswith("none found; not told apart: 2 w")
    assert worst_tongue(replace(alone, tongues=(here, open_))).startswith("2 w")
    bare = replace(alone, tongues=(replace(gone, onset=0.0, reason="a mode grows"),))
    assert worst_tongue(bare) == "unstable without modulation"
    mixed = replace(option, tongues=(here, later, never, open_))
    assert len(place_table(mixed, speed_unit(study), "10 %").rows) == 3 and len(cure_table(mixed).rows) == 1
    assert absent_words(mixed) == (f"None up to depth 0.5: {short_words(here.resonance.name)}.",)


def test_what_grows_most_is_told_from_the_decided_speeds(study: MapStudy) -> None:
    option = study.options[0]
    assert option.atlas is not None
    go = SpeedRange(10.0, 20.0, "go", (), -0.1, "")
    lost = SpeedRange(20.0, 21.0, "no-go", ("2 w1/1 (heave)",), 0.3, "")
    worse = SpeedRange(30.0, 31.0, "no-go", ("(w1 + w2)/1 (heave, pitch)",), 0.5, "")
    open_ = SpeedRange(40.0, 41.0, "unresolved", (), np.nan, "the engines do not decide")

    def told(*ranges: SpeedRange) -> str:
        assert option.atlas is not None
        return worst_tongue(replace(option, atlas=replace(option.atlas, ranges=ranges)))

    assert told(go) == "none at this depth"
    assert told(go, lost, worse) == "w1 + w2, 0.500 1/s"
    assert told(go, open_) == "none where decided; some speeds UNRESOLVED"
    assert told(lost, open_).endswith("; some speeds UNRESOLVED")


def test_a_margin_that_was_not_asked_is_not_told_lost(study: MapStudy) -> None:
    option = study.options[0]
    assert option.margins is not None
    passive = replace(option, margins=replace(option.margins, gain=None), margins_reason="the option has no controller")
    lost = replace(option, margins=replace(option.margins, gain=None, speed=None))
    for one, words in ((passive, "the option has no controller"), (lost, LOST_ITSELF)):
        assert one.margins is not None
        rows = {cells[0].text: cells for cells in margin_table(one, one.margins, (3.6, "km/h"), depth=0.1).rows}
        assert rows["gain, up"][5].text == words and rows["depth"][1].text == "10.0 %"
    compared = comparison_table(replace(study, options=(passive, lost)))
    assert [cells[7].text for cells in compared.rows] == [ABSENT, LOST_ITSELF]


# --- the report -------------------------------------------------------------------------------------------------------


def test_the_comparison_has_a_row_per_option(study: MapStudy) -> None:
    rows = {cells[0].text: [cell.text for cell in cells] for cells in comparison_table(study).rows}
    first, second = study.options[0].plane, study.options[1].plane
    assert first is not None and second is not None
    assert rows["Bare vehicle"][1] == percent(float(np.mean(first.state == UNSTABLE)))
    assert rows["Damper, <b>strong</b>"][2].startswith(percent(second.share(UNRESOLVED)))
    assert "no answer" in rows["Damper, <b>strong</b>"][2]
    assert rows["Broken option"][1:4] == ["no map", ABSENT, "no equilibrium at the design point"]


def test_speeds_are_told_in_the_unit_of_the_axis(study: MapStudy) -> None:
    assert speed_unit(study) == (3.6, "km/h")
    assert speed_unit(replace(study, x=replace(study.x, unit="m/s", scale=1.0))) == (1.0, "m/s")
    spin = replace(study.x, quantity="rotor.speed", unit="rad/s", scale=1.0)
    assert speed_unit(replace(study, x=spin)) == (3.6, "km/h")


def test_the_page_says_it_all(written: Path) -> None:
    page = (written / "map.html").read_text()
    for words in (
        "How to read a map", "stiffness of all magnets", "No map: no equilibrium at the design point", "UNRESOLVED",
        "the engines do not agree at the design point", "Riccati residual over one period", "without modulation",
        "magnet_front 61 %", "Go and no-go speeds", "the speed is on no axis",
    ):  # fmt: skip
        assert words in page, words
    assert "<b>strong</b>" not in page and "&lt;b&gt;strong&lt;/b&gt;" in page
    assert "http://" not in page.split("<script")[0].replace("http://www.w3.org", "")
    assert (written / "map.pdf").read_bytes().startswith(b"%PDF")
    assert (written / "mine.txt").read_text() == "kept"


def test_the_same_study_gives_the_same_files(study: MapStudy, written: Path, tmp_path: Path) -> None:
    write_map(study, tmp_path / "again")
    for name in FILES:
        assert (tmp_path / "again" / name).read_bytes() == (written / name).read_bytes(), name


def test_studies_without_maps_are_still_written(study: MapStudy, tmp_path: Path) -> None:
    failed = replace(study.options[2], name="only")
    write_map(replace(study, options=(failed,)), tmp_path / "one")
    assert "no equilibrium" in (tmp_path / "one" / "map.html").read_text()
    write_map(replace(study, options=()), tmp_path / "none")
    assert "No options" in (tmp_path / "none" / "map.html").read_text()


def test_a_law_without_an_answer_is_told_unresolved(study: MapStudy) -> None:
    law = PeriodicLawStudy(None, (), None, "the Riccati equation has no stabilising solution")
    report = map_model(replace(study, options=(replace(study.options[0], law=law),)))
    words = [str(getattr(block, "text", "")) for section in report.sections for block in section.blocks]
    assert "UNRESOLVED: the Riccati equation has no stabilising solution" in words


def test_figures_and_tables_keep_different_keys(study: MapStudy) -> None:
    report = map_model(study)
    keys = [chart.key for chart in report.charts()]
    assert len(keys) == len(set(keys)) == 4
    assert all(len(table.widths or table.columns) == len(table.columns) for table in tables(report))
    assert all(len(row) == len(table.columns) for table in tables(report) for row in table.rows)
    assert sum(isinstance(b, FigureBlock) for s in report.sections for b in s.blocks) == 4


# --- the files --------------------------------------------------------------------------------------------------------


def test_arrays_come_back_as_they_were(study: MapStudy, written: Path) -> None:
    import xarray

    first = study.options[0].plane
    assert first is not None
    with xarray.open_dataset(written / "map.nc", engine="scipy", mask_and_scale=False) as found:
        assert found.growth.dims == ("option", "speed", "depth")
        assert np.array_equal(found.growth[0], first.growth, equal_nan=True)
        assert np.array_equal(found.state[1], np.asarray(study.options[1].plane.state))  # type: ignore[union-attr]
        assert np.all(found.state[2] == NO_ANSWER) and np.all(np.isnan(found.growth[2]))
        assert found.speed.attrs["long_name"] == "speed" and found.speed.attrs["display_unit"] == "km/h"
        assert found.growth.attrs["units"] == "1/s"
        assert "0: " in found.tongue_index.attrs["names_of_option_0"]
        assert "2 w1/1 (car heave)" in found.tongue_index.attrs["names_of_option_0"]
        assert np.all(found.state_periodic_law[0] == NO_ANSWER) and not np.all(found.state_periodic_law[1] == NO_ANSWER)
        assert float(found.attrs["expected_depth"]) == study.depth


def test_a_map_off_the_grid_is_refused(study: MapStudy) -> None:
    wrong = replace(study.options[0], plane=flat_plane((7, 5)))
    with pytest.raises(ValueError, match=r"bare: expected a map of .* got growth of shape \(7, 5\)"):
        to_dataset(replace(study, options=(wrong,)))


def test_the_summary_is_plain_json(study: MapStudy) -> None:
    found = json.loads(json_text(study), parse_constant=lambda word: pytest.fail(word))
    bare, damper, broken = found["options"]
    assert bare["map"]["shares"]["unstable"] == study.options[0].plane.share(UNSTABLE)  # type: ignore[union-attr]
    assert bare["margins"]["speed"]["up"]["unit"] == "m/s"
    assert bare["margins"]["speed"]["up"]["safe"] == study.options[0].margins.speed[1].safe  # type: ignore[union-attr,index]
    assert bare["tongues"][0]["first_order_centre"]["unit"] == "m/s"
    assert bare["atlas"]["ranges"][0]["lower"] == {"value": 20.0, "unit": "m/s"}
    assert damper["periodic_law"]["ratings"][0]["name"] == "periodic"
    assert broken["map"] is None and broken["failure"] == "no equilibrium at the design point"


def test_ranges_are_told_in_metres_per_second_without_holes(study: MapStudy) -> None:
    rows = list(csv.DictReader(io.StringIO(ranges_csv(study))))
    bare = [one for one in rows if one["option"] == "bare"]
    assert float(bare[0]["from_m_per_s"]) == 20.0 and float(bare[-1]["to_m_per_s"]) == 115.0
    assert all(a["to_m_per_s"] == b["from_m_per_s"] for a, b in pairwise(bare))
    assert {one["verdict"] for one in bare} >= {"go", "no-go"}
    atlas = study.options[0].atlas
    assert atlas is not None and all(
        float(one["narrowest_seen_m_per_s"]) == pytest.approx(atlas.missed_width, rel=5e-3) for one in bare
    )
    assert [(one["verdict"], one["reason"]) for one in rows if one["option"] != "bare"] == [
        ("not evaluated", "the speed is on no axis"), ("not evaluated", "no equilibrium at the design point"),
    ]  # fmt: skip
